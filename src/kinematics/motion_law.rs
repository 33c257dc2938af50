//! Laws of motion a racket may follow in a window of some 20 ms on one side of the contact.

use super::motion_state::Part;
use nalgebra::Vector3;

/// How the racket may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionLaw {
    /// Hangs still (a laboratory racket before impact), up to a slow sway.
    Rest,
    /// Nearly still, hung or in a quiet hand: sways, and is hardly accelerated.
    Sway(Reach),
    /// Constant velocity, constant angular velocity, with the weight carried. After the contact only: a racket that hung is carried on by what it hung
    /// from; a hand always accelerates what it carries.
    Coasting,
    /// Carried by a slow hand: small acceleration and angular acceleration, in body axes, that change at constant rates.
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

/// Force (m/s²) and angular acceleration (rad/s²) of a hand that carries a racket slowly (a block, a drop shot): it would gain 1 m/s within a tenth of a second.
const CARRIES: (f64, f64) = (8.0, 20.0);
/// Weight of laws of free flight where the racket did not hang: a hand that held it lets go in few shots.
const LET_GO: f64 = 0.05;
/// Least weight of a law.
const NEVER: f64 = 1e-9;

/// How fast a nearly still racket sways: by some 15 mm/s, or by some 50.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reach {
    Slight,
    Wide,
}

impl Reach {
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
    /// Each √2 times the one before, so that the true one is never off by more than a fifth.
    pub const ALL: [Fade; 6] = [Fade(5), Fade(7), Fade(10), Fade(14), Fade(20), Fade(28)];

    pub fn time_s(self) -> f64 {
        1e-3 * f64::from(self.0)
    }
}

/// How given force and torque run in time: factors of the value at the reference time, its slope and its curvature.
pub(crate) type Course = [f64; 3];

impl MotionLaw {
    /// Laws that the window before the contact may follow.
    pub const BEFORE_CONTACT: [MotionLaw; 15] = [
        MotionLaw::Rest,
        MotionLaw::Sway(Reach::Slight),
        MotionLaw::Sway(Reach::Wide),
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

    /// Laws for the window after the contact: those (what the blow has set moving no longer sways), a racket that goes on as it was carried, a hand that
    /// lets go, and a racket set free that is balanced elsewhere than stated.
    pub fn after_contact() -> Vec<MotionLaw> {
        let blown = Self::BEFORE_CONTACT.into_iter().filter(|law| !matches!(law, MotionLaw::Sway(_)));
        blown.chain([MotionLaw::Coasting, MotionLaw::OffBalance]).chain(Fade::ALL.map(MotionLaw::Release)).collect()
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

    /// Logarithm of the prior weight, where the racket hung still before the contact with the probability `hung`: the time constants of a release share the
    /// weight of one law. Laws that fix an acceleration exactly would be preferred for their fewer numbers wherever a window cannot tell some m/s² from
    /// none, and their deviations are as small as if nothing acted: it must be likely that nothing does.
    pub(crate) fn ln_weight(self, hung: f64) -> f64 {
        let weight = match self {
            MotionLaw::Release(_) => 1.0 / Fade::ALL.len() as f64,
            MotionLaw::Coasting => hung,
            MotionLaw::Carried => 1.0 - hung,
            _ if self.free() => hung + (1.0 - hung) * LET_GO,
            _ => 1.0,
        };
        weight.max(NEVER).ln()
    }

    /// What a racket does that hangs from a stand, or lies in a hand as still as that.
    pub(crate) fn hangs(self) -> bool {
        matches!(self, MotionLaw::Rest | MotionLaw::Sway(_))
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
            MotionLaw::Sway(_) | MotionLaw::Release(_) => &[Place, Turn, Velocity, Rate, Force, RateDot],
            MotionLaw::Carried | MotionLaw::Swing(_) | MotionLaw::Hold(_) => &[Place, Turn, Velocity, Rate, Force, RateDot, ForceSlope, RateDdot],
            MotionLaw::Drift => &[Place, Turn, Velocity, Rate, Force, RateDot, ForceSlope, RateDdot, ForceCurve, RateDddot],
        }
    }

    /// Step of a part in the fit: a hung racket hardly moves.
    pub(crate) fn step(self, part: Part) -> f64 {
        match (self, part) {
            (MotionLaw::Rest | MotionLaw::Sway(_), Part::Velocity) => 1e-3,
            (MotionLaw::Rest | MotionLaw::Sway(_), Part::Rate) => 1e-2,
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

    pub(crate) fn falls(self) -> bool {
        !matches!(self, MotionLaw::Rest | MotionLaw::Sway(_) | MotionLaw::Coasting | MotionLaw::Carried)
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
    /// within `memory_s`.
    pub(crate) fn prior(self, part: Part, memory_s: f64) -> Option<Vector3<f64>> {
        // Brisk: a centre of mass 0.35 m from the pivot at 30 rad/s needs 300 m/s²; a swing gains 30 rad/s within 0.05 to
        // 0.1 s (physics.md E.7). Gentle is a third of that, abrupt twice.
        let (force, rate_dot) = match self {
            MotionLaw::Sway(reach) => reach.drives(),
            MotionLaw::Carried => CARRIES,
            MotionLaw::Swing(Pace::Gentle) | MotionLaw::Hold(Pace::Gentle) => (100.0, 130.0),
            MotionLaw::Swing(Pace::Abrupt) | MotionLaw::Hold(Pace::Abrupt) => (600.0, 1000.0),
            _ => (300.0, 400.0),
        };
        // About the handle the inertia is a tenth of the others': the same hand turns the racket faster there.
        let twist = Vector3::new(2.5, 1.0, 1.0);
        let memory_s = if matches!(self, MotionLaw::Swing(Pace::Even) | MotionLaw::Hold(Pace::Even)) { 3.0 * memory_s } else { memory_s };
        let (slope, curve) = (1.0 / memory_s, 1.0 / (memory_s * memory_s));
        match part {
            Part::Place | Part::Turn | Part::Lever => None,
            Part::Velocity => Some(Vector3::repeat(match self {
                MotionLaw::Rest => 0.005,
                MotionLaw::Sway(reach) => reach.velocities().0,
                _ => 20.0,
            })),
            Part::Rate => Some(Vector3::repeat(match self {
                MotionLaw::Rest => 0.02,
                MotionLaw::Sway(reach) => reach.velocities().1,
                _ => 30.0,
            })),
            Part::Force => Some(Vector3::repeat(force)),
            Part::RateDot => Some(twist * rate_dot),
            Part::ForceSlope => Some(Vector3::repeat(force * slope)),
            Part::RateDdot => Some(twist * (rate_dot * slope)),
            Part::ForceCurve => Some(Vector3::repeat(force * curve)),
            Part::RateDddot => Some(twist * (rate_dot * curve)),
        }
    }
}
