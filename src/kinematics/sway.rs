//! How still the rackets of a session hang before they are hit.
//!
//! A racket on a thread sways by millimetres per second or hardly at all; within a window of some 20 ms one shot tells no more
//! than that it does not swing, all shots of a session together tell how much.

use nalgebra::Vector3;

/// Spread of a hung racket's velocity and angular velocity, per component, one deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sway {
    pub velocity_m_s: f64,
    pub rate_rad_s: f64,
}

/// One shot's racket before the impact, measured as if it might move: velocity and angular velocity, each with its variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenSway {
    pub(crate) velocity: Vector3<f64>,
    pub(crate) velocity_variance: Vector3<f64>,
    pub(crate) rate: Vector3<f64>,
    pub(crate) rate_variance: Vector3<f64>,
}

/// Faster than this nothing hangs: such a shot says nothing of sway.
const SWINGS_M_S: f64 = 0.1;
const SWINGS_RAD_S: f64 = 0.4;
/// One deviation of the logarithm of a sway from what is usual.
const LN_SD: f64 = 1.0;

impl Sway {
    /// Before anything was seen.
    pub fn usual() -> Self {
        Sway { velocity_m_s: 0.005, rate_rad_s: 0.02 }
    }

    /// The sway under which what was seen is most likely, within what is usual. Shots whose racket swings do not count.
    pub fn learnt(seen: &[SeenSway]) -> Self {
        let still: Vec<&SeenSway> = seen.iter().filter(|s| s.velocity.norm() < SWINGS_M_S && s.rate.norm() < SWINGS_RAD_S).collect();
        let of = |usual: f64, parts: fn(&SeenSway) -> (Vector3<f64>, Vector3<f64>)| {
            let values: Vec<(f64, f64)> =
                still.iter().map(|s| parts(s)).flat_map(|(v, variance)| [0, 1, 2].map(|k| (v[k], variance[k]))).filter(|(_, v)| *v > 0.0).collect();
            let cost = |sway: f64| {
                let seen: f64 = values.iter().map(|(v, variance)| (variance + sway * sway).ln() + v * v / (variance + sway * sway)).sum();
                seen + ((sway / usual).ln() / LN_SD).powi(2)
            };
            // From a twentieth to three times what is usual, in steps of a tenth.
            let tried = (-32..=12).map(|k| usual * 1.1f64.powi(k));
            tried.min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(usual)
        };
        let usual = Self::usual();
        Sway { velocity_m_s: of(usual.velocity_m_s, |s| (s.velocity, s.velocity_variance)), rate_rad_s: of(usual.rate_rad_s, |s| (s.rate, s.rate_variance)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shots whose velocities alternate by `size` in each component; the rates likewise.
    fn shots(size: f64, sd: f64) -> Vec<SeenSway> {
        let variance = Vector3::repeat(sd * sd);
        let at = |k: u32| Vector3::repeat(if k.is_multiple_of(2) { size } else { -size });
        (0..40).map(|k| SeenSway { velocity: at(k), velocity_variance: variance, rate: at(k), rate_variance: variance }).collect()
    }

    #[test]
    fn truth_a_sessions_sway_is_found_and_noise_does_not_pass_for_it() {
        // v² = sd² + sway² makes the likelihood greatest.
        let found = Sway::learnt(&shots(0.005, 0.003));
        assert!((found.velocity_m_s - 0.004).abs() < 0.0005 && (found.rate_rad_s - 0.004).abs() < 0.001, "{found:?}");
        let still = Sway::learnt(&shots(0.001, 0.002));
        assert!(still.velocity_m_s < 0.0012 && still.rate_rad_s < 0.002, "{still:?}");
    }

    #[test]
    fn truth_rackets_that_swing_or_are_not_seen_leave_the_usual() {
        assert_eq!(Sway::learnt(&[]), Sway::usual());
        assert_eq!(Sway::learnt(&shots(3.0, 0.01)), Sway::usual());
    }
}
