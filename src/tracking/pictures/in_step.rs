//! Whether both cameras took their pictures at the same instants, and what to do when they did not.
//!
//! A point that moves and is seen a frame too late by one camera misses the other camera's epipolar plane by the part of
//! its motion across that plane. Over a whole shot that miss follows the motion, while calibration and lens leave a miss
//! that stays: a straight-line fit of the miss against the motion tells both apart and gives the offset in frames.

use crate::calibration::CameraId;
use crate::footage::{Clip, FrameSource};
use crate::quantity::HOLD_95_PERCENT;
use crate::tracking::pictures::agreement::Agreement;
use crate::tracking::pictures::lost_picture::{lost_pictures, lost_words};
use crate::tracking::pictures::shot_frames::AT_ONCE;
use crate::tracking::racket::racket_pose::View;
use crate::tracking::shot_tracker::track_shot;
use crate::tracking::shot_tracks::{ShotSetup, ShotTracks, TrackingError};
use nalgebra::{SMatrix, SVector, Vector2, Vector3};
use rayon::prelude::*;
use std::sync::atomic::AtomicBool;

/// What to do about cameras that are out of step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SyncMode {
    /// Say so.
    #[default]
    Report,
    /// Pair the pictures anew by whole frames, and say so.
    Auto,
}

/// By how many frames the right camera is late, with one standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Offset {
    pub frames: f64,
    pub sd: f64,
    /// Root-mean-square miss of the epipolar planes with pictures paired as they are, px.
    pub miss_px: f64,
}

impl Offset {
    /// Whether both cameras expose at different times, by less than pairing anew could mend.
    fn is_part_of_frame(&self) -> bool {
        self.frames.abs() >= PART_OF_FRAME.0 && self.frames.abs() >= PART_OF_FRAME.1 * self.sd
    }

    fn words(&self) -> String {
        let side = if self.frames > 0.0 { "late" } else { "early" };
        format!("the right camera seems {:.2} +- {:.2} frames {side}", self.frames.abs(), HOLD_95_PERCENT * self.sd)
    }
}

/// Misses that stay the same over a shot: of the ball, and of tape put on by hand, px, one standard deviation each.
const STILL_SD_PX: [f64; 6] = [0.3, 0.3, 0.3, 0.3, 0.3, 0.15];
/// Least deviation of a single miss, px.
const FLOOR_PX: f64 = 0.1;
/// An offset is told when its deviation is below this, frames.
const TOLD_SD: f64 = 0.2;
/// One of a part of a frame from this on, frames, when it is as many deviations: sound recordings of 53 sessions show up to 0.1 frames and 3.5 deviations.
const PART_OF_FRAME: (f64, f64) = (0.15, 5.0);
/// Cameras started by one trigger are hardly farther out of step, frames.
const MOST_APART: i64 = 3;
/// Frames in which another pairing is tried first.
const EXCERPT: usize = 16;
/// Fewer frames with the ball in both pictures make the pairing itself doubtful.
const LEAST_BALL_FRAMES: usize = 6;
/// One intercept per target, then the offset.
const UNKNOWNS: usize = 7;

/// A tracked shot and how its pictures were paired in the end.
#[derive(Debug, Clone)]
pub struct InStep {
    pub tracked: ShotTracks,
    pub clip: Clip,
    /// Frame n pairs left n with right n + this.
    pub right_shift: i64,
    /// Whether the cameras were found out of step and left so.
    pub out_of_step: bool,
    /// Why points of this shot should not be believed; the first of its notes.
    pub doubt: Option<String>,
}

/// Tracks a clip and checks that its cameras are in step.
pub fn track_in_step(clip: &Clip, setup: &ShotSetup, mode: SyncMode, cancel: &AtomicBool, progress: &(dyn Fn(usize) + Sync)) -> Result<InStep, TrackingError> {
    let view = View::new(setup.rig);
    let as_paired = |clip: &Clip, tracked: ShotTracks| {
        let (agreement, offset) = rayon::join(|| Agreement::of(clip, &view, &tracked), || offset(clip, setup, &tracked));
        Paired { agreement, offset: offset.filter(|o| o.sd < TOLD_SD), tracked }
    };
    let first = match track_shot(clip, setup, cancel, progress) {
        Ok(tracked) => Ok(as_paired(clip, tracked)),
        Err(e @ TrackingError::NoRacket { .. }) => Err(e),
        Err(e) => return Err(e),
    };
    let tracked_as = |clip: &Clip| match track_shot(clip, setup, cancel, &|_| ()) {
        Ok(again) => Ok(Some(as_paired(clip, again))),
        Err(TrackingError::Cancelled) => Err(TrackingError::Cancelled),
        Err(_) => Ok(None),
    };
    let around = first.as_ref().ok().and_then(|f| middle_of_the_ball(clip, &f.tracked)).unwrap_or_else(|| clip.number(clip.len() / 2));
    if first.as_ref().ok().is_none_or(|f| f.agreement.contradicts())
        && let Some(exchanged) = tracked_as(&clip.exchanged().around(around, EXCERPT))?
        && exchanged.agreement.confirms()
    {
        let as_they_are = first.map_or("as they are no racket is found in both views".into(), |f| {
            format!("as they are both views agree on {} points in {} frames", f.agreement.both, clip.len())
        });
        let (points, frames) = (exchanged.agreement.both, exchanged.tracked.racket.len());
        return Err(TrackingError::Exchanged { found: format!("{as_they_are}, exchanged on {points} in {frames} frames") });
    }
    let mut best: Option<(i64, Clip, Paired)> = None;
    for shift in shifts_to_try(first.as_ref().ok()) {
        let shifted = clip.shifted(shift);
        // Pictures that do not belong together take long to follow: a few of them show it.
        if tracked_as(&shifted.around(around, EXCERPT))?.is_none_or(|part| part.agreement.doubtful()) {
            continue;
        }
        let Some(again) = tracked_as(&shifted)?.filter(|again| again.fits_better_than(first.as_ref().ok())) else { continue };
        if best.as_ref().is_none_or(|b| b.2.agreement.both < again.agreement.both) {
            let settled = !again.agreement.doubtful();
            best = Some((shift, shifted, again));
            if settled {
                break;
            }
        }
    }
    if let Some((shift, shifted, Paired { tracked: mut again, agreement, .. })) = best {
        let found = words(shift, first.as_ref().ok(), &agreement);
        match (mode, first) {
            (SyncMode::Auto, _) => {
                again.notes.insert(0, format!("{found}; corrected: frame n pairs the left picture n with the right picture n {shift:+}"));
                return Ok(InStep { right_shift: shift, ..InStep::as_recorded(&shifted, again, false, None) });
            }
            (SyncMode::Report, Ok(Paired { tracked, .. })) => {
                return Ok(InStep::as_recorded(clip, tracked, true, Some(format!("{found}; `--sync auto` corrects it"))));
            }
            (SyncMode::Report, Err(_)) => return Err(TrackingError::OutOfStep { found }),
        }
    }
    let first = first?;
    if !first.tracked.clear_racket && first.agreement.speaks_against_the_racket() {
        return Err(TrackingError::NotARacket { found: first.agreement.words() });
    }
    if first.agreement.contradicts() {
        return Err(TrackingError::Contradiction { found: first.agreement.words() });
    }
    let doubt = first.doubt();
    Ok(InStep::as_recorded(clip, first.tracked, false, doubt))
}

impl InStep {
    /// Pictures paired by their numbers as the clip has them.
    fn as_recorded(clip: &Clip, mut tracked: ShotTracks, out_of_step: bool, doubt: Option<String>) -> Self {
        let lost = lost_words(&lost_pictures(&tracked.tracks));
        let doubt = doubt.into_iter().chain(lost).reduce(|a, b| format!("{a}; {b}"));
        tracked.notes.splice(0..0, doubt.clone());
        InStep { tracked, clip: clip.clone(), right_shift: 0, out_of_step, doubt }
    }
}

/// What was tracked with pictures paired in one way.
struct Paired {
    tracked: ShotTracks,
    agreement: Agreement,
    /// When it is told.
    offset: Option<Offset>,
}

impl Paired {
    /// An offset that is one of whole frames rather than none.
    fn out_of_step(&self) -> Option<Offset> {
        self.offset.filter(|o| o.frames.abs() >= 0.5 && o.frames.abs() >= 3.0 * o.sd)
    }

    /// What speaks against it though no other pairing is better.
    fn doubt(&self) -> Option<String> {
        let found = self.agreement.words();
        if let Some(o) = self.out_of_step() {
            return Some(format!("{} ({found}), and pairing by whole frames does not mend it: is a picture lost in one camera from some frame on?", o.words()));
        }
        if let Some(o) = self.offset.filter(Offset::is_part_of_frame) {
            return Some(format!("{}; whatever moves is misplaced by its way in that time: let one trigger start both exposures", o.words()));
        }
        let why = if self.agreement.tape_alone() {
            "does racket.toml say where the markers are? Or was a camera moved since calibration?"
        } else {
            "was a camera moved since calibration, or a picture lost in one of them? Is diameter_m of ball.toml right?"
        };
        self.agreement.doubtful().then(|| format!("the two cameras do not agree ({found}): {why}"))
    }

    /// Whether this pairing is right where the other, the recording's own, is not.
    fn fits_better_than(&self, other: Option<&Paired>) -> bool {
        if self.offset.is_some_and(|o| o.frames.abs() >= 0.5) {
            return false;
        }
        match other {
            // What was told must be gone.
            Some(other) if other.out_of_step().is_some() => self.offset.is_some() && self.agreement.both >= other.agreement.both,
            Some(other) if other.agreement.doubtful() => !self.agreement.doubtful() && self.agreement.both > other.agreement.both,
            _ => {
                let before = other.map_or(0, |o| points_in_both(&o.tracked));
                !self.agreement.doubtful() && points_in_both(&self.tracked) >= LEAST_BALL_FRAMES.max(2 * before)
            }
        }
    }
}

/// Other pairings worth a try, the likeliest first; none when nothing speaks against the recording's own.
fn shifts_to_try(first: Option<&Paired>) -> Vec<i64> {
    let told = first.and_then(|f| Some(-f.out_of_step()?.frames.round() as i64));
    let doubted = first.is_none_or(|f| f.agreement.doubtful() || f.offset.is_none() && points_in_both(&f.tracked) < LEAST_BALL_FRAMES);
    let near = (1..=MOST_APART).flat_map(|n| [-n, n]).filter(|n| doubted && Some(*n) != told);
    told.into_iter().chain(near).collect()
}

/// Number of the frame amid those that show the ball or, without one, the racket.
fn middle_of_the_ball(clip: &Clip, tracked: &ShotTracks) -> Option<u64> {
    let shown = |frames: Vec<usize>| frames.get(frames.len() / 2).map(|index| clip.number(*index));
    let ball = (0..clip.len()).filter(|i| tracked.ball[*i].is_some()).collect();
    shown(ball).or_else(|| shown((0..clip.len()).filter(|i| tracked.racket[*i].is_some()).collect()))
}

fn words(shift: i64, first: Option<&Paired>, now: &Agreement) -> String {
    let (n, side) = (shift.abs(), if shift < 0 { "late" } else { "early" });
    let frames = if n == 1 { "one frame".to_owned() } else { format!("{n} frames") };
    let why = match first.map(|f| (f, f.out_of_step().filter(|o| o.frames.round() as i64 == -shift))) {
        Some((_, Some(o))) => format!(
            "by the epipolar misses of the moving points {:.2} +- {:.2} frames, root mean square {:.2} px as paired",
            o.frames.abs(),
            HOLD_95_PERCENT * o.sd,
            o.miss_px
        ),
        Some((f, None)) => format!("both views agree on {} points as paired, and on {} so", f.agreement.both, now.both),
        None => format!("as paired no racket is found in both views, and so they agree on {} points", now.both),
    };
    format!("the right camera's pictures are {frames} {side} ({why})")
}

/// Frames in which both cameras measured the ball.
fn points_in_both(tracked: &ShotTracks) -> usize {
    tracked.ball.iter().flatten().filter(|b| b.stereo).count()
}

/// By how many frames the right camera's pictures are late, from the ball and the tape in both views.
pub fn offset(source: &impl FrameSource, setup: &ShotSetup, tracked: &ShotTracks) -> Option<Offset> {
    let view = View::new(setup.rig);
    let figure = &tracked.figure;
    // Image points of a frame by camera and target; tape moved from its visible patch to the tube's axis, which both
    // cameras share.
    let seen = |index: usize| -> [[Option<(Vector2<f64>, f64)>; 6]; 2] {
        CameraId::BOTH.map(|camera| {
            std::array::from_fn(|target| {
                if target == 5 {
                    let p = tracked.ball.get(index)?.as_ref()?.points[camera.index()]?;
                    return Some((p.uv, p.sd.max()));
                }
                let racket = tracked.racket.get(index)?.as_ref()?;
                let p = racket.points[camera.index()][target]?;
                let pose = racket.pose.global_from_racket;
                let patch = view.patch(camera, figure, target, &pose)?;
                let axis = view.project(camera, &(pose * figure.points[target]))?;
                Some((p.uv + axis - patch, p.sd.max()))
            })
        })
    };
    let all: Vec<_> = (0..source.len()).into_par_iter().with_max_len(AT_ONCE).map(seen).collect();
    let of_frame = |i: usize| {
        let mut rows: Vec<(usize, f64, f64, f64)> = Vec::new();
        let n = source.number(i);
        if source.number(i - 1).checked_add(1) != Some(n) || n.checked_add(1) != Some(source.number(i + 1)) {
            return rows;
        }
        for target in 0..6 {
            let (Some(left), Some(right)) = (all[i][0][target], all[i][1][target]) else { continue };
            let (Some(before), Some(after)) = (all[i - 1][1][target], all[i + 1][1][target]) else { continue };
            let Some(a) = view.ray(CameraId::Left, left.0) else { continue };
            let miss = |uv: Vector2<f64>| miss_px(&view, &a, &view.ray(CameraId::Right, uv)?);
            let (Some(m), Some(m0), Some(m1)) = (miss(right.0), miss(before.0), miss(after.0)) else { continue };
            let motion = 0.5 * (m1 - m0);
            // Uneven motion (the hit itself) has no one speed.
            if (m1 - 2.0 * m + m0).abs() < 0.3 + 0.3 * motion.abs() {
                rows.push((target, m, motion, left.1.hypot(right.1).hypot(FLOOR_PX)));
            }
        }
        rows
    };
    let rows: Vec<_> = (1..source.len().saturating_sub(1)).into_par_iter().with_max_len(AT_ONCE).flat_map_iter(of_frame).collect();
    solve(&rows)
}

/// Signed distance of two rays, px at the place where they come nearest.
fn miss_px(view: &View, a: &Vector3<f64>, b: &Vector3<f64>) -> Option<f64> {
    let (p, _) = view.nearest_to_rays(a, b)?;
    let base = view.eye(CameraId::Right) - view.eye(CameraId::Left);
    let normal = a.cross(b).try_normalize(1e-9)?;
    let px_per_m = view.rig.camera(CameraId::Left).fx / (p - view.eye(CameraId::Left)).norm();
    Some(base.dot(&normal) * px_per_m)
}

/// miss = still(target) + offset * motion, for rows (target, miss, motion, deviation); Huber's weights.
fn solve(rows: &[(usize, f64, f64, f64)]) -> Option<Offset> {
    if rows.len() < 8 {
        return None;
    }
    let mut x = SVector::<f64, UNKNOWNS>::zeros();
    let mut out = None;
    for round in 0..6 {
        let mut h = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut g = SVector::<f64, UNKNOWNS>::zeros();
        for (k, sd) in STILL_SD_PX.iter().enumerate() {
            h[(k, k)] = sd.powi(-2);
        }
        let (mut chi2, mut weight) = (0.0, 0.0);
        for (target, miss, motion, sd) in rows {
            let r = miss - x[*target] - x[6] * motion;
            let z = (r / sd).abs();
            let w = if round == 0 || z < 2.0 { 1.0 } else { 2.0 / z };
            let precision = w * sd.powi(-2);
            for (i, a) in [(*target, 1.0), (6, *motion)] {
                for (j, b) in [(*target, 1.0), (6, *motion)] {
                    h[(i, j)] += precision * a * b;
                }
                g[i] += precision * a * miss;
            }
            chi2 += w * z * z;
            weight += w;
        }
        h[(6, 6)] += 1e-9;
        let inverse = h.try_inverse()?;
        x = inverse * g;
        // Misses of neighbouring frames are not independent: the scatter counts, upward only.
        let scatter = (chi2 / (weight - 2.0).max(1.0)).max(1.0);
        let miss_px = (rows.iter().map(|r| r.1 * r.1).sum::<f64>() / rows.len() as f64).sqrt();
        out = Some(Offset { frames: x[6], sd: (inverse[(6, 6)] * scatter).sqrt(), miss_px });
    }
    out.filter(|o| o.frames.is_finite() && o.sd.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_an_offset_is_told_from_a_miss_that_stays() {
        // A ball that falls and then rises, 0.2 px of calibration error, right camera late by `late` frames.
        for late in [0.0, 1.0, -2.0] {
            let rows: Vec<_> = (0..40)
                .map(|k| {
                    let motion = if k < 20 { -1.2 } else { 0.9 } + 0.02 * k as f64;
                    let noise = 0.05 * ((k * 7919 % 13) as f64 / 6.0 - 1.0);
                    (5usize, 0.2 + late * motion + noise, motion, 0.1)
                })
                .collect();
            let o = solve(&rows).expect("enough");
            assert!((o.frames - late).abs() < 0.1 && o.sd < TOLD_SD, "{late}: {o:?}");
        }
        // Cameras with a trigger each are apart by a part of a frame.
        let told = |late: f64, sd: f64| Offset { frames: late, sd, miss_px: 0.3 }.is_part_of_frame();
        assert!(told(0.29, 0.018) && told(-0.29, 0.018) && !told(0.1, 0.01) && !told(0.3, 0.1));
        // The same speed all along leaves it open whether a tenth of a pixel is an offset: the deviation says so.
        let rows: Vec<_> = (0..40).map(|_| (5usize, 0.1, 0.2, 0.1)).collect();
        assert!(solve(&rows).expect("enough").sd > TOLD_SD);
        assert!(solve(&rows[..5]).is_none());
    }
}
