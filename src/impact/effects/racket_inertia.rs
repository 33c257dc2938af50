//! `racket-inertia`: the racket's mass distribution is not what its file says.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;

pub(super) static CARD: EffectCard = EffectCard {
    name: "racket-inertia",
    kind: EffectKind::Physics,
    physics: "Mass, balance, swingweight or twistweight may be mis-stated or changed by added weight. Every rebound follows the true \
              values, not the stated ones.",
    equation: "M' = (1 + mass) M, c' = c + balance_m, I_y' = (1 + swing) I_y, I_x' = (1 + twist) I_x, I_z' = (1 + chop) I_z, about the centre of mass",
    parameters: &[
        ParameterCard::strength("swing", "", "relative error of the inertia about y", 0.0, (-0.8, 3.0), 0.05),
        ParameterCard::strength("twist", "", "relative error of the inertia about x", 0.0, (-0.8, 3.0), 0.1),
        ParameterCard::strength("mass", "", "relative error of the mass", 0.0, (-0.8, 3.0), 0.03),
        ParameterCard::strength("balance_m", "m", "shift of the centre of mass toward the tip", 0.0, (-0.2, 0.2), 0.005),
        ParameterCard::strength("chop", "", "relative error of the inertia about z", 0.0, (-0.8, 3.0), 0.1),
    ],
    source: "Spurr et al. 2014 (RDC within 1 %); Taraborrelli et al. 2019 (estimates from dimensions: swing -4 to +5 %, twist -11 to +12 %)",
    signature: "Heavier: faster rebound; swing inertia: at tip (and throat); twist inertia: with y squared; the racket's own velocities \
                after impact change in step. A balance point wrongly stated does not fly straight: its velocity, fitted over a window, looks like \
                window-bias.",
    confused_with: &["hand-mass", "frame-vibration", "grip-torque", "frame-torsion", "stringbed-edge", "swing-drive", "scale-error", "window-bias"],
    separated_by: "scales and a swing machine; momentum balance of a free racket (no restitution involved)",
    check_first: Some(
        "a mass_kg in ball.toml that is not the ball's looks the same as mass and moments of the racket all changed by one factor (weigh the ball), and so do \
         racket velocities and rates after the impact that are all told too large or too small by one factor",
    ),
    bases: Bases { rigid: "as given", viscoelastic: "as given" },
    effect: &RacketInertia,
};

#[derive(Debug)]
struct RacketInertia;

impl<T: Real> Effect<T> for RacketInertia {
    fn change_body(&self, p: &[T], body: &mut Body<T>) {
        body.racket_inertia.y *= p[0] + 1.0;
        body.racket_inertia.x *= p[1] + 1.0;
        body.racket_mass *= p[2] + 1.0;
        body.com_x -= p[3];
        body.racket_inertia.z *= p[4] + 1.0;
    }
}
