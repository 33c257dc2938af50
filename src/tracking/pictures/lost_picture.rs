//! Pictures lost without a gap in the numbers (renumbered by an export): from one picture to the next all that moves goes twice its way, or
//! more, and goes on as before. No racket and no ball does that, so that a recording of which it is seen is in doubt: the times of what follows
//! are wrong, or, where one camera alone lost it, the pairs of pictures are.

use crate::calibration::CameraId;
use crate::short_list::short_list;
use crate::tracking::track_file::{ImagePoint, Target, Tracks};

/// A target tells when it moves by so much from one picture to the next, px, and by so many of its deviations.
const LEAST_PX: f64 = 1.0;
const LEAST_SDS: f64 = 8.0;
/// Nor may its steps before and after differ by more than this share: it is struck then.
const STEADY: f64 = 0.5;
/// One target alone (the ball, beside a racket at rest) must move by more and more steadily.
const ALONE: (f64, f64) = (1.5, 0.2);
/// The ways must be a whole multiple to within the first, and scatter about it by no more than the second (true ones lie within 0.06 and 0.12).
const WHOLE: (f64, f64) = (0.2, 0.15);
/// More pictures lost in a row leave too little to compare.
const MOST_LOST: f64 = 5.0;
/// Places named in a sentence.
const NAMED: usize = 5;

/// Pictures lost after a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LostPictures {
    pub after: u64,
    /// How many, by camera.
    pub lost: [u64; 2],
}

/// Of one frame, by camera and target.
type Seen = [[Option<ImagePoint>; 6]; 2];

/// Where pictures were lost without a gap in the numbers.
pub fn lost_pictures(tracks: &Tracks) -> Vec<LostPictures> {
    let mut frames: Vec<(u64, Seen)> = Vec::new();
    for p in &tracks.points {
        if frames.last().is_none_or(|(frame, _)| *frame != p.frame) {
            frames.push((p.frame, Seen::default()));
        }
        if let Some((_, seen)) = frames.last_mut() {
            seen[p.camera.index()][p.target.index()] = p.point;
        }
    }
    let in_a_row = |four: &&[(u64, Seen)]| four[3].0 - four[0].0 == 3;
    let told = |four: &[(u64, Seen)]| LostPictures {
        after: four[1].0,
        lost: [0, 1].map(|camera| lost_between([0, 1, 2, 3].map(|k| &four[k].1[camera])).unwrap_or(0)),
    };
    frames.windows(4).filter(in_a_row).map(told).filter(|l| l.lost != [0, 0]).collect()
}

/// How many pictures are missing between the middle ones of four frames of one camera.
fn lost_between(frames: [&[Option<ImagePoint>; 6]; 4]) -> Option<u64> {
    let (mut along, mut size, mut steps) = (0.0, 0.0, Vec::new());
    let (mut bends, mut targets) = (0.0_f64, 0);
    for target in 0..Target::ALL.len() {
        let Some([p, q, r, s]) = four(frames.map(|f| f[target])) else { continue };
        let (before, step, after) = (q.uv - p.uv, r.uv - q.uv, s.uv - r.uv);
        let usual = 0.5 * (before + after);
        let sd = [p, q, r, s].iter().map(|p| p.sd.max()).fold(0.0, f64::max);
        let bend = (before - after).norm() / usual.norm();
        if usual.norm() > LEAST_PX.max(LEAST_SDS * sd) && bend < STEADY {
            along += step.dot(&usual);
            size += usual.norm_squared();
            steps.push((step, usual));
            (bends, targets) = (bends.max(bend), targets + 1);
        }
    }
    if targets == 0 || targets == 1 && (size.sqrt() < ALONE.0 || bends > ALONE.1) {
        return None;
    }
    let times = along / size;
    let scatter = (steps.iter().map(|(step, usual)| (step - times * usual).norm_squared()).sum::<f64>() / size).sqrt();
    let lost = times.round() - 1.0;
    ((1.0..=MOST_LOST).contains(&lost) && (times.round() - times).abs() < WHOLE.0 && scatter < WHOLE.1).then_some(lost as u64)
}

fn four(points: [Option<ImagePoint>; 4]) -> Option<[ImagePoint; 4]> {
    let [p, q, r, s] = points;
    Some([p?, q?, r?, s?])
}

/// What to say of them; `None` without any.
pub fn lost_words(all: &[LostPictures]) -> Option<String> {
    let of = |cameras: [bool; 2]| -> Vec<u64> { all.iter().filter(|l| l.lost.map(|n| n > 0) == cameras).map(|l| l.after).collect() };
    let frames = |after: &[u64]| {
        let numbers: Vec<String> = after.iter().map(u64::to_string).collect();
        format!("frame {}", short_list(&numbers, NAMED, ", "))
    };
    let mut sentences = Vec::new();
    let both = of([true, true]);
    if !both.is_empty() {
        sentences.push(format!(
            "pictures of both cameras seem lost after {}: all that moves goes a multiple of its way there, and the times after it are wrong",
            frames(&both)
        ));
    }
    for (k, camera) in CameraId::BOTH.into_iter().enumerate() {
        let after = of([k == 0, k == 1]);
        if !after.is_empty() {
            let camera = camera.name();
            sentences.push(format!(
                "pictures of the {camera} camera (of it at least) seem lost after {}: all that moves goes a multiple of its way there in its pictures",
                frames(&after)
            ));
        }
    }
    (!sentences.is_empty()).then(|| format!("{}; number the pictures so that those lost leave a gap", sentences.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::track_file::{PointState, TrackPoint};
    use nalgebra::Vector2;

    /// Five markers and a ball that slows down, in pictures of the given instants (frames), one list per camera.
    fn seen(instants: [&[f64]; 2]) -> Tracks {
        let mut points = Vec::new();
        for (camera, instants) in CameraId::BOTH.into_iter().zip(instants) {
            for (k, t) in instants.iter().enumerate() {
                for target in Target::ALL {
                    let way = 2.0 + 0.5 * target.index() as f64;
                    let uv = Vector2::new(100.0 + way * t - 0.03 * t * t, 200.0 - 0.5 * way * t);
                    points.push(TrackPoint {
                        frame: 300 + k as u64,
                        camera,
                        target,
                        point: Some(ImagePoint { uv, sd: Vector2::repeat(0.05) }),
                        state: PointState::Measured,
                    });
                }
            }
        }
        points.sort_by_key(|p| (p.frame, p.camera, p.target));
        Tracks { points }
    }

    #[test]
    fn truth_a_picture_that_is_missing_without_a_gap_is_told_with_its_camera() {
        let even: Vec<f64> = (0..14).map(f64::from).collect();
        let without = |gone: &[f64]| -> Vec<f64> { even.iter().copied().filter(|t| !gone.contains(t)).collect() };
        assert_eq!(lost_pictures(&seen([&even, &even])), []);
        assert!(lost_words(&[]).is_none());
        let one = without(&[6.0]);
        assert_eq!(lost_pictures(&seen([&one, &one])), [LostPictures { after: 305, lost: [1, 1] }]);
        assert_eq!(lost_pictures(&seen([&even, &one])), [LostPictures { after: 305, lost: [0, 1] }]);
        let two = without(&[6.0, 7.0]);
        let found = lost_pictures(&seen([&two, &two]));
        assert_eq!(found, [LostPictures { after: 305, lost: [2, 2] }]);
        assert!(lost_words(&found).is_some_and(|w| w.contains("both cameras") && w.contains("frame 305")));
    }

    #[test]
    fn truth_what_is_struck_or_speeds_up_lost_no_picture() {
        let struck: Vec<f64> = (0..14).map(|k| f64::from(k.min(6)) + 2.0 * f64::from((k - 6).max(0))).collect();
        let turned: Vec<f64> = (0..14).map(|k| f64::from(k.min(6)) - 1.5 * f64::from((k - 6).max(0))).collect();
        let faster: Vec<f64> = (0..14).map(|k| 1.2_f64.powi(k)).collect();
        // A repeated picture and the way made up after it: its points are left out by the tracker, here they are not.
        let again: Vec<f64> = (0..14).map(|k| if k == 6 { 5.0 } else { f64::from(k) }).collect();
        for t in [struck, turned, faster, again] {
            assert_eq!(lost_pictures(&seen([&t, &t])), [], "{t:?}");
        }
    }
}
