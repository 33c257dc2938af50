//! Whether the two cameras saw one scene: the same instants, with the calibration that belongs to them.
//!
//! Where they did, the two rays of a ball meet to some hundredths of a pixel, one pose of the racket explains the tape in both pictures, and
//! what one camera sees the other sees too, but for what is hidden. Pictures of other instants, a camera that was moved, or another session's
//! calibration leave rays that pass each other; tracking then believes one camera at a time.

use crate::calibration::CameraId;
use crate::footage::Clip;
use crate::tracking::racket::racket_pose::View;
use crate::tracking::shot_tracks::ShotTracks;
use crate::tracking::track_file::Target;
use nalgebra::Point3;

/// Half of a good recording's balls lie nearer than 0.05 px (pressed ones do not), and three quarters of its tape nearer than 0.17 px; beyond these
/// the pairing of the pictures is doubted.
const DOUBTFUL_BALL_PX: f64 = 0.2;
const DOUBTFUL_TAPE_PX: f64 = 0.26;
/// Share of the markers' image points that the other camera does not confirm though its picture reaches there: an arm and a hand hide a quarter
/// of them. From the second on nothing that both cameras tell is believed.
const DOUBTFUL_ALONE: f64 = 0.4;
const CONTRADICTED: f64 = 0.75;
/// Nor is a doubtful recording of which both cameras confirm no more targets than these.
const FEWEST_CONFIRMED: usize = 30;
/// A marker must be this far inside the other camera's picture to be expected there, px.
const INSIDE_PX: f64 = 10.0;

/// How far what one camera sees is what the other does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Targets that both cameras measured, over all frames.
    pub both: usize,
    /// Share of the markers that one camera measured, and the other did not though it should.
    pub alone: f64,
    /// Half of the balls, three quarters of the tapes are nearer to the common place, px; `None` without such points.
    pub ball_px: Option<f64>,
    pub tape_px: Option<f64>,
}

impl Agreement {
    /// Of what was tracked in a clip.
    pub fn of(clip: &Clip, view: &View, tracked: &ShotTracks) -> Self {
        let inside = |camera: CameraId, at: &Point3<f64>| {
            let [width, height] = view.rig.image_size.map(|n| n as f64 - INSIDE_PX);
            view.project(camera, at).is_some_and(|uv| uv.x > INSIDE_PX && uv.y > INSIDE_PX && uv.x < width && uv.y < height)
        };
        let (mut together, mut alone) = (0, 0);
        for (pair, racket) in clip.pairs.iter().zip(&tracked.racket) {
            let Some(racket) = racket.as_ref().filter(|_| pair.files.iter().all(Option::is_some)) else { continue };
            for (marker, place) in tracked.figure.points.iter().enumerate() {
                let seen = CameraId::BOTH.map(|camera| racket.points[camera.index()][marker].is_some());
                match seen {
                    [true, true] => together += 1,
                    [false, false] => (),
                    _ => {
                        let other = CameraId::BOTH[usize::from(seen[0])];
                        alone += usize::from(inside(other, &(racket.pose.global_from_racket * place)));
                    }
                }
            }
        }
        let nearer = |ball: bool, share: f64| {
            let mut px: Vec<f64> = tracked.points.iter().filter(|p| (p.target == Target::Ball) == ball).map(|p| p.residual_px).collect();
            px.sort_by(f64::total_cmp);
            px.get((share * px.len() as f64) as usize).copied()
        };
        let ball_both = tracked.ball.iter().flatten().filter(|b| b.stereo).count();
        let alone = if alone == 0 { 0.0 } else { alone as f64 / (alone + together) as f64 };
        Agreement { both: together + ball_both, alone, ball_px: nearer(true, 0.5), tape_px: nearer(false, 0.75) }
    }

    /// Whether other pictures may belong together.
    pub fn doubtful(&self) -> bool {
        self.alone > DOUBTFUL_ALONE || self.ball_px.is_some_and(|px| px > DOUBTFUL_BALL_PX) || self.tape_px.is_some_and(|px| px > DOUBTFUL_TAPE_PX)
    }

    /// Whether the tape alone speaks against it, and not the ball: where the markers are is in question, not where the cameras stand.
    pub fn tape_alone(&self) -> bool {
        self.alone <= DOUBTFUL_ALONE && self.ball_px.is_some_and(|px| px <= DOUBTFUL_BALL_PX)
    }

    /// Whether the two cameras hardly confirm each other anywhere.
    pub fn contradicts(&self) -> bool {
        self.alone > CONTRADICTED || self.doubtful() && self.both < FEWEST_CONFIRMED
    }

    /// Whether a racket that was not told clearly from everything else is none. Tape that one camera alone sees where the figure says is tape.
    pub fn speaks_against_the_racket(&self) -> bool {
        self.tape_px.is_some_and(|px| px > DOUBTFUL_TAPE_PX) && (self.contradicts() || !self.tape_alone())
    }

    /// Whether the two cameras confirm each other without any doubt.
    pub fn confirms(&self) -> bool {
        !self.doubtful() && self.both >= FEWEST_CONFIRMED
    }

    /// For a sentence.
    pub fn words(&self) -> String {
        let px = |what: &str, px: Option<f64>| px.map(|px| format!("{what} {px:.2} px off its place in both views"));
        let alone = (self.alone > 0.0).then(|| format!("{:.0} % of the markers confirmed by one camera only", 100.0 * self.alone));
        let all: Vec<String> = [px("ball", self.ball_px), px("tape", self.tape_px), alone].into_iter().flatten().collect();
        all.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bound_what_both_cameras_confirm_raises_no_doubt_and_what_either_denies_does() {
        let good = Agreement { both: 250, alone: 0.25, ball_px: Some(0.02), tape_px: Some(0.1) };
        assert!(!good.doubtful() && !good.contradicts() && good.confirms() && !Agreement { both: 9, ..good }.confirms());
        assert!(!Agreement { ball_px: None, ..good }.doubtful());
        for bad in [Agreement { ball_px: Some(0.5), ..good }, Agreement { tape_px: Some(0.4), ..good }, Agreement { alone: 0.6, ..good }] {
            assert!(bad.doubtful() && !bad.contradicts(), "{bad:?}");
        }
        assert!(Agreement { tape_px: Some(0.4), ..good }.tape_alone() && !Agreement { tape_px: Some(0.4), ball_px: Some(0.5), ..good }.tape_alone());
        assert!(Agreement { both: 9, tape_px: Some(0.5), ..good }.contradicts() && !Agreement { both: 9, ..good }.contradicts());
        let one_sided = Agreement { both: 3, alone: 0.97, ..good };
        assert!(one_sided.contradicts() && !one_sided.speaks_against_the_racket());
        let letters = Agreement { tape_px: Some(0.9), alone: 0.6, ..good };
        assert!(letters.speaks_against_the_racket() && Agreement { both: 9, alone: 0.2, ..letters }.speaks_against_the_racket());
        assert!(!Agreement { alone: 0.2, ..letters }.speaks_against_the_racket(), "racket.toml may put markers elsewhere");
        assert_eq!(
            one_sided.words(),
            "ball 0.02 px off its place in both views, tape 0.10 px off its place in both views, 97 % of the markers confirmed by one camera only"
        );
    }
}
