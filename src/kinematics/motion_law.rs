//! Laws of motion a racket may follow in a window of some 20 ms on one side of the contact.

use super::motion_state::Part;
use nalgebra::Vector3;

/// How the racket may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionLaw {
    /// Hangs still (a laboratory racket before impact), up to a slow sway.
    Rest,
    /// Hangs and sways: moves by centimetres per second and is hardly accelerated.
    Sway(Reach),
    /// Nearly still in a hand (a block): as slow as what sways widely, and accelerated by some m/s².
    Quiet,
    /// Constant velocity, constant angular velocity.
    Coasting,
    /// Carried by a slow hand (a block, a drop shot): small acceleration and angular acceleration, in body axes, that change at constant rates.
    Carried,
    /// Falls freely, constant angular velocity.
    SteadyFall,
    /// Falls freely, torque-free rotation with the racket's own inertia (Euler).
    FreeBody,
    /// As a free body, about a centre of mass that lies off the stated balance point.
    OffBalance,
    /// Driven along an arc: force and angular acceleration in body axes that change at constant rates.
    Swing(Pace),
    /// Held by a hand: Euler's equations with a force and a torque in body axes that change at constant rates.
    Hold(Pace),
    /// As a hold, but the rates of force and torque change too (quadratic in time).
    Drift,
    /// After contact: Euler's equations with a force and a torque in body axes that die away exponentially.
    Release(Fade),
}

/// Force (m/s²) and angular acceleration (rad/s²) of a hand that carries a racket slowly: it would gain 1 m/s within a tenth of a second. And how slowly:
/// spreads of velocity (m/s) and rate (rad/s) before the contact. A faster racket is swung, with hundreds of m/s²: where it shows none, none is there.
const CARRIES: (f64, f64) = (12.0, 30.0);
const SLOWLY: (f64, f64) = (2.0, 5.0);
/// The same of a hand that holds the racket nearly still, and spreads of its velocity (m/s) and rate (rad/s).
const HOLDS_STILL: (f64, f64) = (4.0, 10.0);
const NEARLY_STILL: (f64, f64) = (0.15, 0.6);
/// Weight of a slight sway: most rackets that hang hang still, and known to do so to a few per cent as if there were no other law.
const SLIGHTLY: f64 = 0.25;
/// Weight of laws of free flight where a slow hand carried the racket: it lets go in few shots.
const LET_GO: f64 = 0.02;
/// Weight before the contact of laws by which nothing, or gravity alone, acts on a racket that moves: a hand does. Fast rackets that show no acceleration are
/// told from swung ones by twelve powers of ten.
const NOTHING_ACTS: f64 = 0.01;
/// A hand makes up for what a blow changed of the racket's motion within some 0.05 to 0.1 s, as a swing gains its rate (thesis, table 5.27), and changes that drive by
/// its own size in as long as muscles take. Without it the gentlest drive that the window allows wins also where the blow was large, and the estimate at the
/// contact is drawn toward no drive.
const MADE_UP_S: f64 = 0.08;
/// Time in which muscles change a force by its own size, s.
pub(crate) const MUSCLES_S: f64 = 0.030;
/// Least weight of a law.
const NEVER: f64 = 1e-9;

/// How fast a hung racket sways: by some 15 mm/s, or by some 50.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reach {
    Slight,
    Wide,
}

impl Reach {
    pub const ALL: [Reach; 2] = [Reach::Slight, Reach::Wide];

    /// Spreads of velocity (m/s) and rate (rad/s).
    fn velocities(self) -> (f64, f64) {
        match self {
            Reach::Slight => (0.015, 0.06),
            Reach::Wide => (0.05, 0.2),
        }
    }

    /// Spreads of acceleration (m/s²) and angular acceleration (rad/s²): a pendulum of 1 s at that velocity gains six times it in a second, a stiffer support
    /// somewhat more.
    fn drives(self) -> (f64, f64) {
        let (velocity, rate) = self.velocities();
        (10.0 * velocity, 10.0 * rate)
    }
}

/// How strong a drive is and how fast it changes. There is no law with a strictly constant force: a hand that pushes also
/// changes its push, and a law that forbids the change would claim too much precision at the window's edge. Even is the
/// nearest to it: brisk, but changing three times more slowly than muscles can.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pace {
    Even,
    Gentle,
    Brisk,
    Abrupt,
}

/// Time constant of a hand that lets go, ms. Flesh settles within some 5 ms, a grip that the blow pulls open within 10 to 20.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Fade(u8);

impl Pace {
    fn word(self) -> &'static str {
        match self {
            Pace::Even => "even",
            Pace::Gentle => "gentle",
            Pace::Brisk => "brisk",
            Pace::Abrupt => "abrupt",
        }
    }
}

impl Fade {
    /// Each √2 times the one before, so that the true one is never off by more than a fifth. In windows of 20 to 30 ms a slower one is a drive that changes
    /// evenly; 28 ms, tried, won over those with deviations half as large as its errors.
    pub const ALL: [Fade; 5] = [Fade(5), Fade(7), Fade(10), Fade(14), Fade(20)];

    pub fn time_s(self) -> f64 {
        1e-3 * f64::from(self.0)
    }
}

/// What is known of a racket before its laws after the contact are weighed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AfterContact {
    /// Probability that a slow hand carried it before.
    pub slow_hand: f64,
    pub blow: Blow,
}

/// What the impact changed of a racket's velocity, m/s, and rate, rad/s, body axes; nothing while that is not known.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Blow {
    pub velocity: Vector3<f64>,
    pub rate: Vector3<f64>,
}

/// How given force and torque run in time: factors of the value at the reference time, its slope and its curvature.
pub(crate) type Course = [f64; 3];

impl MotionLaw {
    /// Laws that any window may follow.
    pub const EVERYWHERE: [MotionLaw; 14] = [
        MotionLaw::Rest,
        MotionLaw::Coasting,
        MotionLaw::Carried,
        MotionLaw::SteadyFall,
        MotionLaw::FreeBody,
        MotionLaw::Swing(Pace::Even),
        MotionLaw::Swing(Pace::Gentle),
        MotionLaw::Swing(Pace::Brisk),
        MotionLaw::Swing(Pace::Abrupt),
        MotionLaw::Hold(Pace::Even),
        MotionLaw::Hold(Pace::Gentle),
        MotionLaw::Hold(Pace::Brisk),
        MotionLaw::Hold(Pace::Abrupt),
        MotionLaw::Drift,
    ];

    /// Laws for the window before the contact: those, and what a racket does that no blow has set moving yet.
    pub fn before_contact() -> Vec<MotionLaw> {
        Self::EVERYWHERE.into_iter().chain(Reach::ALL.map(MotionLaw::Sway)).chain([MotionLaw::Quiet]).collect()
    }

    /// Laws for the window after the contact: those, a hand that lets go, and a racket set free that is balanced elsewhere than stated.
    pub fn after_contact() -> Vec<MotionLaw> {
        Self::EVERYWHERE.into_iter().chain([MotionLaw::OffBalance]).chain(Fade::ALL.map(MotionLaw::Release)).collect()
    }

    /// Laws enough to tell whether a racket flies freely after the contact, and about which point.
    pub(crate) const TOLD_FREE: [MotionLaw; 9] = [
        MotionLaw::Rest,
        MotionLaw::Coasting,
        MotionLaw::Carried,
        MotionLaw::SteadyFall,
        MotionLaw::FreeBody,
        MotionLaw::OffBalance,
        MotionLaw::Hold(Pace::Gentle),
        MotionLaw::Hold(Pace::Brisk),
        MotionLaw::Release(Fade(10)),
    ];

    /// Logarithm of the prior weight: the time constants of a release share the weight of one law. After the contact it depends on the probability `slow_hand`
    /// that a slow hand carried the racket before it (`None` before the contact): laws that fix an acceleration exactly would be preferred for their fewer
    /// numbers wherever a window cannot tell the hand's few m/s² from none, with deviations as small as if nothing acted.
    pub(crate) fn ln_weight(self, slow_hand: Option<f64>) -> f64 {
        let weight = match (self, slow_hand) {
            (MotionLaw::Release(_), _) => 1.0 / Fade::ALL.len() as f64,
            (MotionLaw::Sway(Reach::Slight), _) => SLIGHTLY,
            (MotionLaw::Coasting, Some(slow_hand)) => 1.0 - slow_hand,
            (MotionLaw::Carried, Some(slow_hand)) => slow_hand,
            (law, Some(slow_hand)) if law.free() => 1.0 - slow_hand * (1.0 - LET_GO),
            (law, None) if law.free() || law == MotionLaw::Coasting => NOTHING_ACTS,
            _ => 1.0,
        };
        weight.max(NEVER).ln()
    }

    /// A slow hand carries the racket.
    pub(crate) fn in_slow_hand(self) -> bool {
        matches!(self, MotionLaw::Carried | MotionLaw::Quiet)
    }

    /// The two most flexible laws of moderate size: whatever moves in a window, one of them follows it.
    pub(crate) const FLEXIBLE: [MotionLaw; 2] = [MotionLaw::Swing(Pace::Abrupt), MotionLaw::Hold(Pace::Abrupt)];

    /// Word of shot.json.
    pub fn word(self) -> String {
        match self {
            MotionLaw::Rest => "rest".to_owned(),
            MotionLaw::Sway(Reach::Slight) => "slight-sway".to_owned(),
            MotionLaw::Sway(Reach::Wide) => "wide-sway".to_owned(),
            MotionLaw::Coasting => "coasting".to_owned(),
            MotionLaw::Carried => "carried".to_owned(),
            MotionLaw::Quiet => "quiet-hand".to_owned(),
            MotionLaw::SteadyFall => "steady-fall".to_owned(),
            MotionLaw::FreeBody => "free-body".to_owned(),
            MotionLaw::OffBalance => "off-balance".to_owned(),
            MotionLaw::Swing(pace) => format!("{}-swing", pace.word()),
            MotionLaw::Hold(pace) => format!("{}-hold", pace.word()),
            MotionLaw::Drift => "drifting-hold".to_owned(),
            MotionLaw::Release(fade) => format!("release-{}ms", fade.0),
        }
    }

    /// What is estimated under it, in the order of the columns of the fit. Pose and velocities always come first.
    pub(crate) fn parts(self) -> &'static [Part] {
        use Part::{Force, ForceCurve, ForceSlope, Lever, Place, Rate, RateDddot, RateDdot, RateDot, Turn, Velocity};
        match self {
            MotionLaw::Rest | MotionLaw::Coasting | MotionLaw::SteadyFall | MotionLaw::FreeBody => &[Place, Turn, Velocity, Rate],
            MotionLaw::OffBalance => &[Place, Turn, Velocity, Rate, Lever],
            MotionLaw::Sway(_) | MotionLaw::Quiet | MotionLaw::Release(_) => &[Place, Turn, Velocity, Rate, Force, RateDot],
            MotionLaw::Carried | MotionLaw::Swing(_) | MotionLaw::Hold(_) => &[Place, Turn, Velocity, Rate, Force, RateDot, ForceSlope, RateDdot],
            MotionLaw::Drift => &[Place, Turn, Velocity, Rate, Force, RateDot, ForceSlope, RateDdot, ForceCurve, RateDddot],
        }
    }

    /// Step of a part in the fit: a hung racket hardly moves.
    pub(crate) fn step(self, part: Part) -> f64 {
        match (self, part) {
            (MotionLaw::Rest | MotionLaw::Sway(_) | MotionLaw::Quiet, Part::Velocity) => 1e-3,
            (MotionLaw::Rest | MotionLaw::Sway(_) | MotionLaw::Quiet, Part::Rate) => 1e-2,
            _ => part.step(),
        }
    }

    pub(crate) fn gyroscopic(self) -> bool {
        matches!(self, MotionLaw::FreeBody | MotionLaw::OffBalance | MotionLaw::Hold(_) | MotionLaw::Drift | MotionLaw::Release(_))
    }

    /// Nothing but gravity acts.
    pub(crate) fn free(self) -> bool {
        matches!(self, MotionLaw::SteadyFall | MotionLaw::FreeBody | MotionLaw::OffBalance)
    }

    /// A hand drives it all the time.
    fn driven(self) -> bool {
        matches!(self, MotionLaw::Swing(_) | MotionLaw::Hold(_) | MotionLaw::Drift)
    }

    pub(crate) fn falls(self) -> bool {
        !matches!(self, MotionLaw::Rest | MotionLaw::Sway(_) | MotionLaw::Quiet | MotionLaw::Coasting | MotionLaw::Carried)
    }

    /// How force and torque stand `dt` after the reference time.
    pub(crate) fn course(self, dt: f64) -> Course {
        match self {
            MotionLaw::Release(fade) => [(-dt / fade.time_s()).exp(), 0.0, 0.0],
            _ => [1.0, dt, 0.5 * dt * dt],
        }
    }

    /// Prior standard deviations of a part (SI), but for the lever, which is the racket's. Wide: they weigh the laws against
    /// each other and hardly move an estimate. A hung racket sways by millimetres per second. A drive changes by its own size
    /// within `memory_s`, and after a blow is the stronger the more that changed.
    pub(crate) fn prior(self, part: Part, memory_s: f64, after: Option<&AfterContact>) -> Option<Vector3<f64>> {
        // Brisk: a centre of mass 0.35 m from the pivot at 30 rad/s needs 300 m/s²; a swing gains 30 rad/s (thesis,
        // table 5.27) within 0.05 to 0.1 s. Gentle is a third of that, abrupt twice.
        let (force, rate_dot) = match self {
            MotionLaw::Sway(reach) => reach.drives(),
            MotionLaw::Carried => CARRIES,
            MotionLaw::Quiet => HOLDS_STILL,
            MotionLaw::Swing(Pace::Gentle) | MotionLaw::Hold(Pace::Gentle) => (100.0, 130.0),
            MotionLaw::Swing(Pace::Abrupt) | MotionLaw::Hold(Pace::Abrupt) => (600.0, 1000.0),
            _ => (300.0, 400.0),
        };
        // About the handle the inertia is a tenth of the others': the same hand turns the racket faster there.
        let twist = Vector3::new(2.5, 1.0, 1.0);
        let memory_s = if matches!(self, MotionLaw::Swing(Pace::Even) | MotionLaw::Hold(Pace::Even)) { 3.0 * memory_s } else { memory_s };
        let (slope, curve) = (1.0 / memory_s, 1.0 / (memory_s * memory_s));
        let (mut force, mut rate_dot) = (Vector3::repeat(force), twist * rate_dot);
        let (mut force_slope, mut rate_dot_slope) = (force * slope, rate_dot * slope);
        if let Some(AfterContact { blow, .. }) = after.filter(|_| self.driven()) {
            let both = |a: Vector3<f64>, b: Vector3<f64>| a.zip_map(&b, f64::hypot);
            let made_up = [blow.velocity / MADE_UP_S, blow.rate / MADE_UP_S];
            (force, rate_dot) = (both(force, made_up[0]), both(rate_dot, made_up[1]));
            (force_slope, rate_dot_slope) = (both(force_slope, made_up[0] / MUSCLES_S), both(rate_dot_slope, made_up[1] / MUSCLES_S));
        }
        match part {
            Part::Place | Part::Turn | Part::Lever => None,
            Part::Velocity => Some(Vector3::repeat(match self {
                MotionLaw::Rest => 0.005,
                MotionLaw::Sway(reach) => reach.velocities().0,
                MotionLaw::Quiet => NEARLY_STILL.0,
                MotionLaw::Carried if after.is_none() => SLOWLY.0,
                _ => 20.0,
            })),
            Part::Rate => Some(Vector3::repeat(match self {
                MotionLaw::Rest => 0.02,
                MotionLaw::Sway(reach) => reach.velocities().1,
                MotionLaw::Quiet => NEARLY_STILL.1,
                MotionLaw::Carried if after.is_none() => SLOWLY.1,
                _ => 30.0,
            })),
            Part::Force => Some(force),
            Part::RateDot => Some(rate_dot),
            Part::ForceSlope => Some(force_slope),
            Part::RateDdot => Some(rate_dot_slope),
            Part::ForceCurve => Some(force * curve),
            Part::RateDddot => Some(rate_dot * curve),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_after_a_blow_a_hand_is_expected_to_make_up_for_it_axis_by_axis() {
        let blow = Blow { velocity: Vector3::new(0.0, 0.0, -8.0), rate: Vector3::new(16.0, 0.0, 0.0) };
        let after = AfterContact { slow_hand: 0.0, blow };
        let prior = |law: MotionLaw, part: Part| law.prior(part, 0.01, Some(&after)).expect("a prior");
        let near = |a: Vector3<f64>, b: [f64; 3]| (a - Vector3::from(b)).norm() < 1e-9 * a.norm();
        // 8 m/s and 16 rad/s within 0.08 s are 100 m/s² and 200 rad/s², which change by their own size in 30 ms.
        let gentle = MotionLaw::Hold(Pace::Gentle);
        assert!(near(prior(gentle, Part::Force), [100.0, 100.0, f64::hypot(100.0, 100.0)]));
        assert!(near(prior(gentle, Part::RateDot), [f64::hypot(325.0, 200.0), 130.0, 130.0]));
        assert!(near(prior(gentle, Part::ForceSlope), [1e4, 1e4, f64::hypot(1e4, 100.0 / 0.03)]));
        assert!(near(prior(gentle, Part::RateDdot), [f64::hypot(32_500.0, 200.0 / 0.03), 13_000.0, 13_000.0]));
        // A hand that lets go makes up for nothing, and before the contact there is no blow.
        assert!(near(prior(MotionLaw::Release(Fade(10)), Part::Force), [300.0; 3]));
        assert!(near(gentle.prior(Part::Force, 0.03, None).expect("a prior"), [100.0; 3]));
    }
}
