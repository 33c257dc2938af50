//! How a racket that is followed moves: its pose and velocity and what both are known to (a filter after Kalman 1960), so that what few bands leave
//! open goes on as it went over many frames, not as two neighbouring poses differ by chance.

use crate::tracking::racket::foretold_pose::{Foretold, moved, turn_and_shift};
use crate::tracking::racket::racket_pose::RacketPose;
use crate::tracking::racket::racket_scene::RacketFrame;
use nalgebra::{Isometry3, Matrix6, Vector6};

/// How fast a swung racket's velocity changes, rad/s² and m/s².
const ACCELERATION: (f64, f64) = (2000.0, 1000.0);
/// What the velocity of a racket just found may be, rad/s and m/s.
const FASTEST: (f64, f64) = (30.0, 30.0);
/// How far off a foretold pose may be of which nothing is known, rad and m.
const OFF: (f64, f64) = (0.1, 0.1);
/// Variance of a pose against what its bands state: what is wrong with one of them (half covered, in the shade) stays so for some frames.
const SHARED: f64 = 2.0;

/// A racket at one time. Angles (rad) are rotation vectors about the global axes; these come first, then the shifts (m).
#[derive(Debug, Clone)]
pub struct RacketMotion {
    number: f64,
    pose: Isometry3<f64>,
    /// Per second, in the direction in which it is followed.
    velocity: Vector6<f64>,
    pose_covariance: Matrix6<f64>,
    /// Of velocity (rows) and pose.
    both: Matrix6<f64>,
    velocity_covariance: Matrix6<f64>,
    frame_rate_hz: f64,
}

fn diagonal((of_turn, of_shift): (f64, f64)) -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::new(of_turn, of_turn, of_turn, of_shift, of_shift, of_shift))
}

impl RacketMotion {
    /// Of a racket just found in the frame of this number: its velocity is not known.
    pub fn start(number: f64, pose: &RacketPose, frame_rate_hz: f64) -> Self {
        RacketMotion {
            number,
            pose: pose.global_from_racket,
            velocity: Vector6::zeros(),
            pose_covariance: pose.covariance * SHARED,
            both: Matrix6::zeros(),
            velocity_covariance: diagonal((FASTEST.0.powi(2), FASTEST.1.powi(2))),
            frame_rate_hz,
        }
    }

    pub fn number(&self) -> f64 {
        self.number
    }

    pub fn pose(&self) -> &Isometry3<f64> {
        &self.pose
    }

    /// On to another frame: as fast as before, but for what its velocity may have changed by.
    fn at(&self, number: f64) -> Self {
        let t = (number - self.number).abs() / self.frame_rate_hz;
        let acceleration = diagonal((ACCELERATION.0.powi(2), ACCELERATION.1.powi(2)));
        RacketMotion {
            number,
            pose: moved(&self.pose, &(self.velocity * t).into()),
            pose_covariance: self.pose_covariance
                + (self.both + self.both.transpose()) * t
                + self.velocity_covariance * (t * t)
                + acceleration * (t.powi(4) / 4.0),
            both: self.both + self.velocity_covariance * t + acceleration * (t.powi(3) / 2.0),
            velocity_covariance: self.velocity_covariance + acceleration * (t * t),
            ..*self
        }
    }

    /// Where it should be in a frame.
    pub fn foretold(&self, number: f64) -> Foretold {
        let there = self.at(number);
        Foretold::new(there.pose, &there.pose_covariance).unwrap_or(Foretold::within(there.pose, OFF.0, OFF.1))
    }

    /// The same motion followed the other way in time.
    pub fn turned_back(&self) -> Self {
        RacketMotion { velocity: -self.velocity, both: -self.both, ..*self }
    }

    /// Goes on to a frame in which it was found.
    pub fn go_on(&mut self, number: f64, frame: &RacketFrame) {
        let before = self.at(number);
        let off = turn_and_shift(&before.pose, &frame.pose.global_from_racket);
        let after = if frame.foretold { before.known_to(&off, frame.pose.covariance) } else { before.measured(&off, &frame.pose) };
        *self = after.unwrap_or_else(|| Self::start(number, &frame.pose, self.frame_rate_hz));
    }

    /// With a pose, so far off, that its bands alone tell.
    fn measured(mut self, off: &Vector6<f64>, pose: &RacketPose) -> Option<Self> {
        let own = pose.covariance * (SHARED * pose.misfit().max(1.0));
        // What is farther off than it should be has changed its velocity by more than usual.
        let unlike = off.dot(&((self.pose_covariance + own).try_inverse()? * off)) / 6.0;
        if unlike > 1.0 {
            self.pose_covariance *= unlike;
            self.both *= unlike;
            self.velocity_covariance *= unlike;
        }
        let gain = self.pose_covariance * (self.pose_covariance + own).try_inverse()?;
        let left = self.pose_covariance - gain * self.pose_covariance;
        self.known_to(&(gain * off), 0.5 * (left + left.transpose()))
    }

    /// With the pose moved by so much and known to a covariance, by all that is known: its velocity follows.
    fn known_to(self, off: &Vector6<f64>, covariance: Matrix6<f64>) -> Option<Self> {
        let by_pose = self.both * self.pose_covariance.try_inverse()?;
        let velocity_covariance = self.velocity_covariance - by_pose * (self.pose_covariance - covariance) * by_pose.transpose();
        let after = RacketMotion {
            pose: moved(&self.pose, &(*off).into()),
            velocity: self.velocity + by_pose * off,
            both: by_pose * covariance,
            velocity_covariance: 0.5 * (velocity_covariance + velocity_covariance.transpose()),
            pose_covariance: covariance,
            ..self
        };
        let known = after.pose_covariance.diagonal().iter().chain(after.velocity_covariance.diagonal().iter()).all(|v| *v > 0.0 && v.is_finite());
        (known && after.velocity.norm().is_finite()).then_some(after)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    const RATE_HZ: f64 = 1000.0;

    /// A racket at 20 rad/s and 18 m/s, so many frames on.
    fn swung(frame: f64) -> Isometry3<f64> {
        let t = frame / RATE_HZ;
        let turned = UnitQuaternion::from_scaled_axis(Vector3::new(4.0, 19.0, -5.0) * t);
        Isometry3::from_parts(Translation3::from(Vector3::new(-17.0, 3.0, 5.0) * t), turned * UnitQuaternion::from_euler_angles(0.3, 0.4, -0.5))
    }

    fn seen(pose: Isometry3<f64>, covariance: Matrix6<f64>, foretold: bool) -> RacketFrame {
        let pose = RacketPose { global_from_racket: pose, covariance, chi2: 6.0, dof: 6 };
        RacketFrame { pose, points: [[None; 5]; 2], foretold }
    }

    /// Good to 1 mrad and 0.2 mm.
    fn sure() -> Matrix6<f64> {
        diagonal((1e-6, 4e-8))
    }

    /// Followed through the swing up to frame 10.
    fn followed() -> RacketMotion {
        let mut motion = RacketMotion::start(0.0, &seen(swung(0.0), sure(), false).pose, RATE_HZ);
        (1..=10).for_each(|frame| motion.go_on(f64::from(frame), &seen(swung(f64::from(frame)), sure(), false)));
        motion
    }

    #[test]
    fn law_a_racket_is_foretold_to_what_it_states() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut random = |sd: &Vector6<f64>| sd.map(|sd| sd * rng.sample::<f64, _>(StandardNormal));
        let sd = Vector6::new(2e-3, 2e-3, 2e-3, 3e-4, 3e-4, 3e-4);
        let change = diagonal(ACCELERATION).diagonal() / RATE_HZ;
        let rounds = 60;
        let mut off = 0.0;
        for _ in 0..rounds {
            let (mut pose, mut velocity) = (swung(0.0), Vector6::new(4.0, 19.0, -5.0, -17.0, 3.0, 5.0));
            let mut motion: Option<RacketMotion> = None;
            for frame in 0..=20 {
                let measured = seen(moved(&pose, &random(&sd).into()), Matrix6::from_diagonal(&sd.map(|sd| sd * sd)), false);
                match &mut motion {
                    Some(motion) => motion.go_on(f64::from(frame), &measured),
                    None => motion = Some(RacketMotion::start(0.0, &measured.pose, RATE_HZ)),
                }
                let faster = random(&change);
                pose = moved(&pose, &((velocity + faster * 0.5) / RATE_HZ).into());
                velocity += faster;
            }
            let foretold = motion.expect("followed").foretold(21.0);
            off += foretold.off(&pose).powi(2) / 6.0 / f64::from(rounds);
        }
        // One band's faults are the next frame's, too: half of the variance is for these, which here there are none of.
        assert!((0.4..1.1).contains(&off), "{off}");
    }

    #[test]
    fn truth_a_racket_that_goes_on_is_foretold_for_a_dozen_frames() {
        let motion = followed();
        for ahead in [1.0, 4.0, 12.0] {
            let off = turn_and_shift(&motion.foretold(10.0 + ahead).pose, &swung(10.0 + ahead));
            assert!(off.rows(0, 3).norm() < 1e-3 * ahead && off.rows(3, 3).norm() < 1e-4 * ahead, "{ahead}: {off}");
        }
    }

    #[test]
    fn law_turned_back_it_is_foretold_where_it_came_from() {
        let motion = followed();
        let back = motion.turned_back();
        for ago in [1.0, 4.0, 8.0] {
            let before = back.foretold(10.0 - ago);
            let off = turn_and_shift(&before.pose, &swung(10.0 - ago));
            assert!(off.rows(0, 3).norm() < 1e-3 * ago && off.rows(3, 3).norm() < 1e-4 * ago, "{ago}: {off}");
            assert!(before.allows(&swung(10.0 - ago)) && !motion.foretold(10.0 + ago).allows(&swung(10.0 - ago)));
        }
    }

    #[test]
    fn law_what_the_bands_do_not_tell_goes_on_as_it_went() {
        // For three frames one camera alone shows it: depth (x) and one tilt are off by what that camera cannot tell.
        let (mut unsure, mut motion) = (sure(), followed());
        (unsure[(1, 1)], unsure[(3, 3)]) = (0.08f64.powi(2), 0.03f64.powi(2));
        for (frame, wrong) in [(11.0, 0.02), (12.0, -0.03), (13.0, 0.03)] {
            motion.go_on(frame, &seen(moved(&swung(frame), &[0.0, 2.0 * wrong, 0.0, wrong, 0.0, 0.0]), unsure, false));
        }
        let off = turn_and_shift(&motion.foretold(18.0).pose, &swung(18.0));
        assert!(off.rows(0, 3).norm() < 0.03 && off.rows(3, 3).norm() < 0.01, "{off}");
    }

    #[test]
    fn law_an_impact_changes_the_velocity_within_some_frames() {
        // It loses 6 m/s in 4 ms.
        let at = |frame: f64| {
            let pose = swung(frame);
            let ms = (frame - 10.0).clamp(0.0, 4.0);
            let lost = 6.0 * (ms * ms / 8.0 + (frame - 14.0).max(0.0)) / RATE_HZ;
            Isometry3::from_parts(Translation3::from(pose.translation.vector + Vector3::x() * lost), pose.rotation)
        };
        let mut motion = RacketMotion::start(0.0, &seen(at(0.0), sure(), false).pose, RATE_HZ);
        for frame in 1..=18 {
            motion.go_on(f64::from(frame), &seen(at(f64::from(frame)), sure(), false));
        }
        let off = turn_and_shift(&motion.foretold(19.0).pose, &at(19.0));
        assert!(off.rows(3, 3).norm() < 5e-4, "{off}");
    }
}
