//! Whether a session's balls fly through air, or through a simulated world without.
//!
//! Over a window of some 15 ms drag bows a path by less than its noise, and what tracks have in common bows it as much: one flight alone
//! tells air from none with odds of three to one, and sometimes wrongly. The same air surrounds all of a session's flights.

use super::ball_flight::FlightLaw;
use super::shot_motion::ShotMotion;
use std::collections::BTreeMap;

/// What one flight may say at most, as the logarithm of its odds: paths bent for another reason are louder than their likelihood owns.
const LOUDEST: f64 = 2.0;
/// Share of what flights say that counts, because errors of one calibration bend many of them alike.
const COUNTS: f64 = 0.5;
/// The session's word, at most: 55 to one.
const MOST: f64 = 4.0;

/// By shot, the logarithm of its own odds of air against none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AirSeen(BTreeMap<String, f64>);

impl AirSeen {
    /// From motions that were measured with even odds.
    pub fn of<'a>(shots: impl IntoIterator<Item = (&'a str, &'a ShotMotion)>) -> Self {
        let own = |motion: &ShotMotion| -> f64 {
            let flights = [Some(&motion.ball_in), motion.ball_out.as_ref()];
            let odds = |laws: &[(FlightLaw, f64)]| {
                let of = |law: FlightLaw| laws.iter().find(|(l, _)| *l == law).map_or(0.0, |(_, p)| *p).max(1e-9);
                (of(FlightLaw::Air) / of(FlightLaw::Gravity)).ln().clamp(-LOUDEST, LOUDEST)
            };
            flights.into_iter().flatten().map(|f| odds(&f.laws)).sum()
        };
        AirSeen(shots.into_iter().map(|(id, motion)| (id.to_owned(), own(motion))).collect())
    }

    /// Odds of air against none for one shot, by what the others say.
    pub fn odds(&self, shot: &str) -> f64 {
        let others: f64 = self.0.iter().filter(|(id, _)| *id != shot).map(|(_, ln)| ln).sum();
        (COUNTS * others).clamp(-MOST, MOST).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_shot_hears_the_others_and_not_itself() {
        let seen = |own: &[f64]| AirSeen(own.iter().enumerate().map(|(i, ln)| (i.to_string(), *ln)).collect());
        assert_eq!(AirSeen::default().odds("0"), 1.0);
        assert_eq!(seen(&[3.0]).odds("0"), 1.0);
        assert!((seen(&[-4.0, 1.0, 1.0]).odds("0") - 1.0f64.exp()).abs() < 1e-12);
        // Many that say little are believed, but never beyond the most.
        assert_eq!(seen(&[0.5; 40]).odds("7"), MOST.exp());
    }
}
