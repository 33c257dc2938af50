//! `string-tilt`: the pocket in the strings leans toward the centre.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "string-tilt",
    kind: EffectKind::Physics,
    physics: "Off centre the strings are stiffer on the frame's side, so the pocket's normal leans toward the centre of the face. The \
              ball leaves a few degrees toward the centre, the more the deeper the pocket.",
    equation: "tilt = -strength x_S (x / 0.165^2, y / 0.12^2), x_S = 13.1 mm (v_n / 20 m/s), of the normal that points to the ball; the whole \
               contact frame turns",
    parameters: &[ParameterCard::strength("strength", "", "0 none; 1: 2.6 degrees at 50 mm across and 20 m/s", 0.5, (-5.0, 5.0), 0.5)],
    source: "Tennis Warehouse University (rebounds lean toward the centre on both halves)",
    signature: "Exit direction leans toward the centre: odd in x and y, in proportion to approach speed; present on a clamped racket as \
                well.",
    confused_with: &["finite-contact", "face-plane-offset", "grip-torque"],
    separated_by: "odd part of the exit angle on a head-clamped racket",
    check_first: None,
    bases: Bases { rigid: "as given", viscoelastic: "as given, with the momentary deflection" },
    effect: &StringTilt,
};

/// Deflection of the strings on a free racket at the reference speed, m.
const DEPTH: f64 = 13.1e-3;
/// m/s.
const REFERENCE_SPEED: f64 = 20.0;
/// Half length and width over which the pocket leans, m.
const ALONG: f64 = 0.165;
const ACROSS: f64 = 0.12;

#[derive(Debug)]
struct StringTilt;

impl<T: Real> Effect<T> for StringTilt {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        // Toward the centre as the ball sees it: the contact's normal is the face's, whichever side the ball is on.
        let depth = at.approach_speed * (at.side * DEPTH / REFERENCE_SPEED);
        laws.tilt[0] -= p[0] * depth * at.input.position.x / (ALONG * ALONG);
        laws.tilt[1] -= p[0] * depth * at.input.position.y / (ACROSS * ACROSS);
    }

    fn change_viscoelastic(&self, p: &[T], at: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.tilt_x += p[0] * at.side / (ALONG * ALONG);
        laws.tilt_y += p[0] * at.side / (ACROSS * ACROSS);
    }
}
