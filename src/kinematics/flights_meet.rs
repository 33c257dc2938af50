//! Whether the ball's flights before and after the contact are those of one ball that the strings alone turned.
//!
//! Strings push the ball for a few milliseconds, so that its two flights, drawn on, meet in the middle of the contact: along the push they do so at some
//! time, across it they pass each other by what the push goes from side to side meanwhile. Where court, net or frame turned the ball as well, within a few
//! frames of the strings and unseen, a turn of 10 m/s puts them a centimetre apart for every millisecond between. Strings that hold the ball at one place of
//! them all along would carry it aside as well, but no farther than they go themselves.

use super::ball_flight::FlightEstimate;
use super::contact::{BodyMotion, PointMotion, ball_in_racket};
use super::shot_motion::{SURELY_FREE_S, ShotMotion};
use crate::tracking::{MOST_APART_M, MOST_APART_SDS};
use nalgebra::{Matrix3, Matrix3x6, Vector3};

/// From here on, m, and so many deviations, two flights that do not meet are worth a look. (Of 82 rendered shots that the strings alone turned none passed by more
/// than 8 mm, with spins of up to 4000 rpm and strings that give way sideways.)
const WORTH_A_LOOK_M: f64 = 0.012;

/// Two flights at the time at which they come nearest to each other across the change of velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passing {
    pub apart_m: f64,
    /// One standard deviation of that, m.
    pub sd_m: f64,
    /// How far strings that hold the ball at one place of them from the first contact to the last carry it aside, m.
    pub carried_m: f64,
}

impl Passing {
    /// Of a shot both of whose contacts are known.
    pub fn of_shot(motion: &ShotMotion) -> Option<Self> {
        let contact_s = (motion.last_contact_t? - motion.first_contact_t).clamp(0.0, SURELY_FREE_S);
        let (racket, com) = (BodyMotion::from(&motion.racket_in), &motion.moving.com_local);
        let strings = racket.point_velocity(&ball_in_racket(&PointMotion::from(&motion.ball_in), &racket, com), com);
        Passing::of(&motion.ball_in, motion.ball_out.as_ref()?, &strings, contact_s)
    }

    /// Of the flights before and after; `None` where the ball was not turned at all. `strings` is their velocity where they meet the ball, m/s.
    fn of(before: &FlightEstimate, after: &FlightEstimate, strings: &Vector3<f64>, contact_s: f64) -> Option<Self> {
        let at = |flight: &FlightEstimate, t: f64| PointMotion::from(flight).after(t - flight.reference_t);
        let mut t = 0.5 * (before.reference_t + after.reference_t);
        for _ in 0..3 {
            let (a, b) = (at(before, t), at(after, t));
            let turned = b.velocity - a.velocity;
            t -= (b.position - a.position).dot(&turned) / turned.norm_squared();
        }
        let (a, b) = (at(before, t), at(after, t));
        let along = (b.velocity - a.velocity).try_normalize(1e-6)?;
        let apart = b.position - a.position;
        let across = apart.try_normalize(1e-9)?;
        let covariance = |flight: &FlightEstimate| {
            let mut carried = Matrix3x6::zeros();
            carried.fixed_columns_mut::<3>(0).copy_from(&Matrix3::identity());
            carried.fixed_columns_mut::<3>(3).copy_from(&(Matrix3::identity() * (t - flight.reference_t)));
            carried * flight.covariance * carried.transpose()
        };
        let share = Matrix3::identity() - along * along.transpose();
        let spread = share * (covariance(before) + covariance(after)) * share;
        let carried_m = contact_s * (share * (strings - a.velocity)).norm();
        Some(Passing { apart_m: apart.norm(), sd_m: across.dot(&(spread * across)).max(0.0).sqrt(), carried_m })
    }

    /// What is to be said of flights that nearly meet.
    pub fn remark(&self) -> Option<String> {
        (self.apart_m > WORTH_A_LOOK_M.max(MOST_APART_SDS * self.sd_m)).then(|| {
            format!(
                "the ball's ways before and after the contact pass each other by {:.0} mm (sd {:.0}): court, net or frame may have turned it as well, and \
                 then its velocity and spin at the contact are not these; look at its track",
                1e3 * self.apart_m,
                1e3 * self.sd_m
            )
        })
    }

    /// Whether something else than the strings turned the ball.
    pub fn turned_elsewhere(&self) -> bool {
        self.apart_m > self.carried_m + MOST_APART_M.max(MOST_APART_SDS * self.sd_m)
    }
}

#[cfg(test)]
mod tests {
    use super::super::sighting::UsedSightings;
    use super::*;
    use nalgebra::{Matrix6, Point3};

    /// A straight flight whose place is known to 2 mm per axis, its velocity exactly.
    fn flight(reference_t: f64, position: Point3<f64>, velocity: Vector3<f64>) -> FlightEstimate {
        let mut covariance = Matrix6::zeros();
        (0..3).for_each(|k| covariance[(k, k)] = 4e-6);
        FlightEstimate {
            reference_t,
            position,
            velocity,
            acceleration: Vector3::zeros(),
            covariance,
            laws: Vec::new(),
            used: UsedSightings { frames: 10, rejected: 0, length_s: 0.02, noise_scale: 1.0 },
            bending_p: None,
            shortened: false,
        }
    }

    #[test]
    fn truth_flights_pass_by_what_lies_across_the_push_and_strings_carry_as_far_as_they_go() {
        let before = flight(0.0, Point3::origin(), Vector3::new(0.0, 0.0, -20.0));
        let after = |aside_m: f64| flight(0.005, Point3::new(aside_m, 0.0, 0.0), Vector3::new(0.0, 0.0, 15.0));
        let passing = |aside_m: f64, strings: Vector3<f64>| Passing::of(&before, &after(aside_m), &strings, 0.005).expect("a turned ball");
        let still = passing(0.03, Vector3::zeros());
        assert!((still.apart_m - 0.03).abs() < 1e-12 && (still.sd_m - 8e-6f64.sqrt()).abs() < 1e-12 && still.carried_m == 0.0, "{still:?}");
        // Strings that move across the push at 4 m/s carry the ball 20 mm in 5 ms; along it they carry it nowhere aside.
        assert!((passing(0.03, Vector3::new(4.0, 0.0, 9.0)).carried_m - 0.02).abs() < 1e-12);
        let told = |aside_m: f64, speed: f64| {
            let passing = passing(aside_m, Vector3::new(speed, 0.0, 0.0));
            (passing.turned_elsewhere(), passing.remark().is_some())
        };
        // 5 deviations of 2.8 mm are 14 mm: from there on it is remarked; from 20 mm and what the strings carry it is another thing's doing.
        assert_eq!((told(0.013, 0.0), told(0.016, 0.0), told(0.021, 0.0), told(0.03, 4.0)), ((false, false), (false, true), (true, true), (false, true)));
        assert_eq!(told(0.041, 4.0), (true, true));
        assert!(passing(0.03, Vector3::zeros()).remark().is_some_and(|words| words.contains("pass each other by 30 mm (sd 3)")));
    }
}
