//! Pictures that a recorder stored once more, told by the racket: it stands still for a frame in one camera while it moves in the other.

use crate::median::upper_median;
use crate::tracking::racket::racket_scene::RacketFrame;
use crate::tracking::track_file::ImagePoint;

/// A racket that moves by less than the first in one camera's picture, and by more than the second in the other's and before or
/// after, px.
const STILL_PX: (f64, f64) = (0.3, 1.0);

/// A racket that moves by more than this from frame to frame before and after, px, does not stand still between.
const STOPPED_PX: f64 = 2.0;

/// A racket that moves by more than this a frame before, px, may be seen to stand and then to catch up; the misses of that may have
/// this share of those of a racket that goes on as before (true ones 0.02 to 0.06).
const CATCHING_UP: (f64, f64) = (0.7, 0.15);

/// Pictures missing in a row, after which one of them may stand in the next frame, and how late that one is at least, frames.
const MOST_MISSING: usize = 4;
const LATE_FRAMES: f64 = 0.6;
/// Where the other camera cannot tell that it is in time, every band is one frame late to this.
const A_FRAME_LATE: f64 = 0.4;
/// With none missing, a repeat whose bands were found half-way to where the racket was expected is as late as the first, where the other camera's is in time to the
/// second, frames, and the racket moves as fast before and after, to this share: one that is struck does not.
const HALF_WAY: (f64, f64) = (0.4, 0.2);
const AS_FAST: f64 = 0.3;

/// Pictures in which the racket stands still for one frame although the other camera sees it move: the recorder stored an earlier
/// picture once more (a picture that was coded anew need not be equal byte by byte). By index and camera.
pub fn stood_still(frames: &[Option<RacketFrame>]) -> Vec<[bool; 2]> {
    // Which bands a camera sees in two frames.
    let both = |from: usize, to: usize, camera: usize| -> Option<[bool; 5]> {
        let (a, b) = (frames.get(from)?.as_ref()?.points[camera], frames.get(to)?.as_ref()?.points[camera]);
        Some(std::array::from_fn(|m| a[m].is_some() && b[m].is_some()))
    };
    // Motion of these bands in one camera's picture from one frame to another: the lower median, the upper one and the largest.
    let motion_of = |least: usize, from: usize, to: usize, camera: usize, bands: &[bool; 5]| {
        let (a, b) = (frames.get(from)?.as_ref()?.points[camera], frames.get(to)?.as_ref()?.points[camera]);
        let mut moved: Vec<f64> = (0..5).filter(|m| bands[*m]).filter_map(|m| Some((b[m]?.uv - a[m]?.uv).norm())).collect();
        moved.sort_by(f64::total_cmp);
        (moved.len() >= least).then(|| [moved[(moved.len() - 1) / 2], moved[moved.len() / 2], moved[moved.len() - 1]])
    };
    let motion = |from, to, camera| Some(motion_of(2, from, to, camera, &[true; 5])?[1]);
    // Where one band moves on the picture is no repeat, however many stand.
    let stands = |[_, median, largest]: [f64; 3]| median < STILL_PX.0 && largest < STILL_PX.1;
    // The last frames before one, of which some may be missing, with how many frames earlier they are; the next ones after one.
    let earlier = |i: usize| (1..=MOST_MISSING).filter_map(move |frames| Some((frames, i.checked_sub(frames)?)));
    let later = |i: usize| (1..=MOST_MISSING).map(move |frames| (frames, i + frames));
    // px per frame up to a frame, of these bands: of a racket that turns about two of them these always stand.
    let pace = |i: usize, camera: usize, bands: &[bool; 5]| {
        let least = bands.iter().filter(|b| **b).count().clamp(1, 2);
        earlier(i).find_map(|(frames, a)| Some(motion_of(least, a, i, camera, bands)?[0] / frames as f64))
    };
    // The two pictures of such a frame do not fit together, so that either camera's bands may be left out in it.
    let sees_it_move = |i: usize, camera: usize| {
        let around = |(frames, a): (usize, usize)| (0..2).find_map(|more| Some(motion(a, i + more, camera)? / (frames + more) as f64));
        earlier(i).find_map(around).is_some_and(|pace| pace > STILL_PX.1)
    };
    let still = |i: usize, camera: usize| {
        let Some(bands) = i.checked_sub(1).and_then(|before| both(before, i, camera)) else { return false };
        let moves = |pace: Option<f64>| pace.is_some_and(|m| m > STILL_PX.1);
        motion_of(2, i - 1, i, camera, &bands).is_some_and(stands)
            && sees_it_move(i, 1 - camera)
            && (moves(motion_of(1, i, i + 1, camera, &bands).map(|m| m[0])) || moves(pace(i - 1, camera, &bands)))
    };
    // A racket that moves fast before and after does not stop for one frame, whatever the other camera sees of it. One band is enough: in
    // a frame whose pictures do not fit together most are left out.
    let stopped = |i: usize, camera: usize| {
        let Some(bands) = i.checked_sub(1).and_then(|before| both(before, i, camera)) else { return false };
        let fast = |pace: Option<f64>| pace.is_some_and(|m| m > STOPPED_PX);
        motion_of(1, i - 1, i, camera, &bands).is_some_and(stands)
            && fast(pace(i - 1, camera, &bands))
            && fast(later(i).find_map(|(frames, b)| Some(motion_of(1, i, b, camera, &bands)?[0] / frames as f64)))
    };
    // Whether the racket moves as fast before the first and after the last of three frames as on the way between them.
    let as_fast = |before: usize, after: usize, camera: usize| {
        let across = motion(before, after, camera).map(|way| way / (after - before) as f64);
        let beside = [before.checked_sub(1).and_then(|earlier| motion(earlier, before, camera)), motion(after, after + 1, camera)];
        beside.map(|pace| Some((pace? / across? - 1.0).abs() < AS_FAST))
    };
    // Where the picture before is missing, it may be that one which stands here: the bands are a frame's way behind the line from the last
    // picture to the next, and the other camera's are not.
    let behind = |i: usize, camera: usize| {
        let seen_before = (1..=MOST_MISSING).filter_map(|g| i.checked_sub(g)).find(|a| motion(*a, i, camera).is_some());
        let late = |a: usize, camera: usize| frames_late(frames, [a, i, i + 1], camera);
        let all_late = |a: usize| each_late(frames, [a, i, i + 1], camera).iter().all(|late| (late - 1.0).abs() < A_FRAME_LATE);
        seen_before.filter(|a| *a + 1 < i).is_some_and(|a| {
            late(a, camera).is_some_and(|late| late > LATE_FRAMES && late < (i - a) as f64)
                && match late(a, 1 - camera) {
                    Some(late) => late.abs() < 1.0 - LATE_FRAMES,
                    None => all_late(a) && as_fast(a, i + 1, camera) == [Some(true); 2],
                }
        })
    };
    let half_way = |i: usize, camera: usize| {
        let Some(before) = i.checked_sub(1) else { return false };
        let late = each_late(frames, [before, i, i + 1], camera);
        let in_time = || frames_late(frames, [before, i, i + 1], 1 - camera).is_some_and(|late| late.abs() < HALF_WAY.1);
        let as_fast = as_fast(before, i + 1, camera);
        late.len() >= 2 && late.iter().all(|late| *late > HALF_WAY.0) && in_time() && as_fast.contains(&Some(true)) && !as_fast.contains(&Some(false))
    };
    let told = |i: usize, camera: usize| {
        half_way(i, camera) || still(i, camera) || stopped(i, camera) || behind(i, camera) || catches_up(frames, i, camera).is_some_and(|told| told)
    };
    (0..frames.len()).map(|i| [0, 1].map(|c| told(i, c))).collect()
}

/// Whether every band stands in a frame and makes up for it on its way to the next that is seen: no racket does that, however slow, whatever the other
/// camera sees.
fn catches_up(frames: &[Option<RacketFrame>], i: usize, camera: usize) -> Option<bool> {
    let points = |k: usize| frames.get(k)?.as_ref().map(|f| f.points[camera]);
    let (before, now) = (points(i.checked_sub(1)?)?, points(i)?);
    let both = |a: &[Option<ImagePoint>; 5]| a.iter().zip(&before).filter(|(a, b)| a.is_some() && b.is_some()).count();
    let (ago, earlier) = (1..=MOST_MISSING).find_map(|ago| Some((ago, points((i - 1).checked_sub(ago)?).filter(|a| both(a) >= 2)?)))?;
    let (on, next) = (1..=MOST_MISSING).find_map(|on| Some((on, points(i + on).filter(|b| both(b) >= 2)?)))?;
    let (mut catching_up, mut going_on, mut way, mut bands) = (0.0, 0.0, 0.0, 0);
    for m in 0..before.len() {
        let (Some(a), Some(b), Some(c), Some(d)) = (earlier[m], before[m], now[m], next[m]) else { continue };
        let pace = (b.uv - a.uv) / ago as f64;
        let (first, second) = (c.uv - b.uv, d.uv - c.uv);
        catching_up += first.norm_squared() + (second - (on + 1) as f64 * pace).norm_squared();
        going_on += (first - pace).norm_squared() + (second - on as f64 * pace).norm_squared();
        way += pace.norm();
        bands += 1;
    }
    Some(bands >= 2 && way > CATCHING_UP.0 * bands as f64 && catching_up < CATCHING_UP.1 * going_on)
}

/// How many frames' way the bands of the middle one of three frames are behind the straight line between the others, in one camera's picture: the median;
/// `None` where too few are seen or they hardly move.
fn frames_late(frames: &[Option<RacketFrame>], three: [usize; 3], camera: usize) -> Option<f64> {
    let late = each_late(frames, three, camera);
    if late.len() < 2 { None } else { upper_median(late) }
}

/// The same of every band that is seen and moves.
fn each_late(frames: &[Option<RacketFrame>], [a, i, b]: [usize; 3], camera: usize) -> Vec<f64> {
    let points = |k: usize| frames.get(k)?.as_ref().map(|f| f.points[camera]);
    let (Some(from), Some(at), Some(to)) = (points(a), points(i), points(b)) else { return Vec::new() };
    let frames = (b - a) as f64;
    let late = |m: usize| {
        let way = to[m]?.uv - from[m]?.uv;
        let share = (at[m]?.uv - from[m]?.uv).dot(&way) / way.norm_squared();
        (way.norm() > STILL_PX.1 * frames).then(|| (i - a) as f64 - share * frames)
    };
    (0..from.len()).filter_map(late).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::racket::racket_pose::RacketPose;
    use nalgebra::{Isometry3, Matrix6, Vector2};

    /// Three bands that move by 3 px a frame to the right in the left camera's pictures and by 2 px downward in the right one's; the numbers are
    /// which frames the pictures show.
    fn seen(shown: &[[Option<f64>; 2]]) -> Vec<Option<RacketFrame>> {
        let frame = |[left, right]: &[Option<f64>; 2]| {
            let mut points = [[None; 5]; 2];
            for m in 0..3 {
                let place = Vector2::new(100.0 + 20.0 * m as f64, 90.0);
                points[0][m] = left.map(|k| ImagePoint { uv: place + Vector2::x() * (3.0 * k), sd: Vector2::repeat(0.05) });
                points[1][m] = right.map(|k| ImagePoint { uv: place + Vector2::y() * (2.0 * k), sd: Vector2::repeat(0.05) });
            }
            let pose = RacketPose { global_from_racket: Isometry3::identity(), covariance: Matrix6::identity(), chi2: 0.0, dof: 6 };
            Some(RacketFrame { pose, points, foretold: false })
        };
        shown.iter().map(frame).collect()
    }

    /// A racket seen edge-on that turns about two of its bands: where only those are seen, it seems to stand.
    #[test]
    fn truth_bands_that_always_stand_tell_of_no_repeat() {
        let shown: Vec<[Option<f64>; 2]> = (0..10).map(|k| [Some(f64::from(k)); 2]).collect();
        let mut frames = seen(&shown);
        for (k, points) in frames.iter_mut().flatten().map(|f| &mut f.points[0]).enumerate() {
            for m in [3, 4] {
                let place = Vector2::new(50.0 + 0.1 * k as f64, 20.0 * m as f64);
                points[m] = Some(ImagePoint { uv: place, sd: Vector2::repeat(0.05) });
            }
            if k == 5 || k == 6 {
                points[..3].fill(None);
            }
        }
        assert!(stood_still(&frames).iter().all(|s| *s == [false, false]), "{:?}", stood_still(&frames));
    }

    #[test]
    fn truth_a_picture_that_came_a_frame_late_is_found_even_behind_a_missing_one() {
        let even: Vec<[Option<f64>; 2]> = (0..10).map(|k| [Some(f64::from(k)); 2]).collect();
        assert!(stood_still(&seen(&even)).iter().all(|s| *s == [false, false]));
        let mut repeated = even.clone();
        repeated[5][1] = Some(4.0);
        assert_eq!(stood_still(&seen(&repeated))[5], [false, true]);
        // The one it repeats is missing.
        repeated[4][1] = None;
        let found = stood_still(&seen(&repeated));
        assert_eq!(found.iter().position(|s| s[1]), Some(5));
        assert!(found.iter().all(|s| !s[0]));
        // Nor does the other camera see the racket in it.
        repeated[5][0] = None;
        assert_eq!(stood_still(&seen(&repeated)).iter().position(|s| s[1]), Some(5));
        repeated[5][0] = Some(5.0);
        // The other camera's picture of the frame before is missing.
        repeated[4] = [None, Some(4.0)];
        assert_eq!(stood_still(&seen(&repeated))[5], [false, true]);
        // The other camera hardly sees it move, and the picture before the repeated one is missing.
        let mut slow: Vec<[Option<f64>; 2]> = (0..10).map(|k| [Some(0.2 * f64::from(k)), Some(1.5 * f64::from(k))]).collect();
        (slow[5][1], slow[3][1]) = (Some(6.0), None);
        assert_eq!(stood_still(&seen(&slow))[5], [false, true]);
        // Slower than a racket may stop, and the other camera hardly sees it move.
        let mut slower: Vec<[Option<f64>; 2]> = (0..10).map(|k| [Some(0.05 * f64::from(k)), Some(0.6 * f64::from(k))]).collect();
        slower[5][1] = Some(2.4);
        assert_eq!(stood_still(&seen(&slower))[5], [false, true]);
        // Nor is the picture after it there.
        slower[6][1] = None;
        assert_eq!(stood_still(&seen(&slower))[5], [false, true]);
        // The other camera hardly sees it move, and the picture after it is missing.
        (slow[3][1], slow[6][1]) = (Some(4.5), None);
        assert_eq!(stood_still(&seen(&slow))[5], [false, true]);
        // One that is struck, or set in motion, does not catch up.
        for after in [-1.0, 0.0, 0.4, 1.6, 3.0] {
            let struck: Vec<[Option<f64>; 2]> = (0..10).map(|k| [Some(f64::from(k.min(5)) + after * f64::from((k - 5).max(0))); 2]).collect();
            assert!(stood_still(&seen(&struck)).iter().all(|s| *s == [false, false]), "{after}");
        }
        // Its bands were found half-way to where the racket was expected.
        let mut half_way = even.clone();
        half_way[5][1] = Some(4.4);
        assert_eq!(stood_still(&seen(&half_way)).iter().position(|s| s[1]), Some(5));
        // A missing picture alone is no repeat, and neither is a racket that was stopped on the way: both cameras see that.
        let mut missing = even.clone();
        missing[4][1] = None;
        assert!(stood_still(&seen(&missing)).iter().all(|s| *s == [false, false]));
        let mut turned: Vec<[Option<f64>; 2]> = (0..10).map(|k| [Some(f64::from(k) - f64::from((k - 5).max(0)) * 0.6); 2]).collect();
        turned[4][1] = None;
        assert!(stood_still(&seen(&turned)).iter().all(|s| *s == [false, false]));
    }
}
