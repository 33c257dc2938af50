//! What all impacts of a session share: an offset of each measured input (of footage: of each output too, and an error of both in
//! proportion to what is measured), the mean of a spin that nobody measured, the error of the racket face's own axes, of its balance point and of the
//! contact's end.
//!
//! Every vector of the impacts table is resolved along axes that come from tape on the frame. Where the tape's middle lies
//! a fraction of a pixel from its image's, those axes are turned and shifted, by the same amount in every shot of a session
//! in which the racket is seen alike. A turn acts on inputs and outputs together, in proportion to the vectors: no offset of
//! single columns can take it up, and left alone it looks like a physical effect (a face that bends every exit the same
//! way). Where a table states how well the axes are known (`face_turn_x_sd` ...), the pose's error is therefore a nuisance
//! of six components per session with that prior (docs/diagnosis.md, "In formulas", offsets).
//!
//! To first order in the error, with θ the turn of vectors as seen and s the shift of the stringbed centre: v → v + θ × v,
//! impact position p → p + θ × p + (s_x, s_y) + h u_t/u_z. The last part: the plane is taken to lie h = s_z − (θ × p)_z above
//! the strings, so that the ball of relative velocity u is believed to touch h/u_z later. The centre of mass c is taken
//! where the axes put it, which is a point −(θ × c + s) away: the velocity given for it is Ω × that too high.
//!
//! A balance point stated s too far along x is not the centre of mass: its velocity is V + s Ω × x, and an impact at
//! impact_x lies s farther from the centre of mass than believed, which is the same as an impact_x smaller by s. The inertias
//! across x come from a swingweight about the axis 0.10 m from the butt, d from the balance point: they are stated 2 M d s too
//! large (parallel axes). To first order in s, whatever the model, the changes of rate that were measured are greater by
//! 2 M d s / I than with the stated inertia, and the impulse smaller by 2 M d s m_r X²/I² (1/m_r = 1/m + 1/m_e). The contact's
//! end is inferred, not seen: its error adds to every contact time (kinematics.md), and the racket's rates after impact are
//! those of a body that has turned freely for so much longer (Euler's equations).

use super::forward::{Inputs, Outputs};
use super::observation::{Gear, Observation};
use crate::equipment::SWINGWEIGHT_AXIS_FROM_BUTT_M;
use crate::impact_table::{INPUTS, OUTPUTS, SHARED};
use nalgebra::{DVector, Vector3};

/// Approach speed below which the instant of contact cannot be moved, m/s.
const SLOWEST: f64 = 0.5;
/// Where the impact position stands in [`INPUTS`].
const POSITION: usize = 12;
/// Components of the face's pose come first in [`SHARED`]; then the balance point and the contact time.
const FACE: usize = 6;
const BALANCE: usize = 6;
const CONTACT_TIME: usize = 7;
/// Errors in proportion: of velocities and the racket's rates, of the ball's spins.
const SPEED_SCALE: usize = 8;
const SPIN_SCALE: usize = 9;
/// Those whose effect on a row is told by [`shared_inputs`] and [`shared_outputs`]; the others act column by column.
pub const ACROSS_COLUMNS: usize = SPEED_SCALE;

/// Which of a session's shared deviations (order of [`SHARED`]) is the relative error of a column.
pub fn relative_sd(column: &str, shared_sd: &[f64; SHARED.len()]) -> f64 {
    match column {
        c if c.starts_with("ball_") && c.contains("_w") => shared_sd[SPIN_SCALE],
        c if c.contains("_v") || c.contains("_w") => shared_sd[SPEED_SCALE],
        _ => 0.0,
    }
}

/// The shared errors of one session.
#[derive(Debug, Clone, Default)]
pub struct SessionShift {
    /// Order of [`INPUTS`].
    pub offsets: Inputs,
    /// Mean of the inputs that nobody measured, order of [`INPUTS`].
    pub unmeasured: Inputs,
    /// Order of [`OUTPUTS`].
    pub output_offsets: Outputs,
    /// Errors in proportion to the measured value, order of [`INPUTS`] and [`OUTPUTS`].
    pub input_scales: Inputs,
    pub output_scales: Outputs,
    /// Order of [`SHARED`]: rad, m.
    pub shared: [f64; SHARED.len()],
}

impl SessionShift {
    fn any_shared(&self) -> bool {
        self.shared.iter().any(|v| *v != 0.0)
    }

    /// The measured inputs with what the session shares taken out.
    pub fn inputs_of(&self, o: &Observation, gear: &Gear) -> Inputs {
        let mean = |j: usize| if o.missing[j] { self.unmeasured[j] } else { 0.0 };
        let mut inputs: Inputs = std::array::from_fn(|j| o.inputs[j] * (1.0 - self.input_scales[j]) - self.offsets[j] + mean(j));
        if self.any_shared() {
            for (by, moved) in self.shared.iter().zip(shared_inputs(o, gear)) {
                inputs.iter_mut().zip(moved).for_each(|(x, m)| *x -= by * m);
            }
        }
        inputs
    }

    /// The measured outputs with what the session shares taken out; order of `o.measured`.
    pub fn outputs_of(&self, o: &Observation, gear: &Gear) -> DVector<f64> {
        let mut outputs = DVector::from_iterator(
            o.measured.len(),
            o.outputs.iter().zip(&o.measured).map(|(y, &k)| y * (1.0 - self.output_scales[k]) - self.output_offsets[k]),
        );
        if self.any_shared() {
            for (by, moved) in self.shared.iter().zip(shared_outputs(o, gear)) {
                outputs.axpy(-by, &moved, 1.0);
            }
        }
        outputs
    }
}

/// Derivative of the measured inputs with respect to each shared error.
pub fn shared_inputs(o: &Observation, gear: &Gear) -> [Inputs; SHARED.len()] {
    let x = &o.inputs;
    let vector = |at: usize| Vector3::new(x[at], x[at + 1], x[at + 2]);
    let position = Vector3::new(x[POSITION], x[POSITION + 1], 0.0);
    let centre = gear.racket.com_local().coords;
    let strings = vector(6) + vector(9).cross(&(position - centre));
    let u = vector(0) - strings;
    // How far along the face the position moves when contact is placed 1 m too high.
    let along = if u.z.abs() > SLOWEST { u / u.z } else { Vector3::zeros() };
    std::array::from_fn(|k| {
        let mut moved = [0.0; INPUTS.len()];
        if k >= FACE {
            if k == BALANCE {
                moved[6..9].copy_from_slice(vector(9).cross(&Vector3::x()).as_slice());
                moved[POSITION] = -1.0;
            }
            return moved;
        }
        let mut axis = Vector3::zeros();
        axis[k % 3] = 1.0;
        let (shift, height) = if k < 3 {
            for at in [0, 3, 6, 9] {
                let turned = axis.cross(&vector(at));
                moved[at..at + 3].copy_from_slice(turned.as_slice());
            }
            let turned = axis.cross(&position);
            (turned, -turned.z)
        } else {
            (axis, axis.z)
        };
        let point = other_point(k, &axis, &vector(9), &centre);
        moved[6..9].iter_mut().zip(&point).for_each(|(m, p)| *m += p);
        moved[POSITION] = shift.x + height * along.x;
        moved[POSITION + 1] = shift.y + height * along.y;
        moved
    })
}

/// Derivative of the velocity given for the centre of mass `c`, because it is another point's, by component `k` of the pose.
fn other_point(k: usize, axis: &Vector3<f64>, rate: &Vector3<f64>, c: &Vector3<f64>) -> Vector3<f64> {
    -rate.cross(&if k < 3 { axis.cross(c) } else { *axis })
}

/// Derivative of the measured outputs with respect to each shared error; order of `o.measured`. A vector of which a component
/// is missing turns as if that were zero.
pub fn shared_outputs(o: &Observation, gear: &Gear) -> [DVector<f64>; SHARED.len()] {
    let mut all = [0.0; OUTPUTS.len()];
    for (&k, value) in o.measured.iter().zip(&o.outputs) {
        all[k] = *value;
    }
    std::array::from_fn(|k| {
        let mut moved = [0.0; OUTPUTS.len()];
        let vector = |at: usize| Vector3::new(all[at], all[at + 1], all[at + 2]);
        if k < FACE {
            let mut axis = Vector3::zeros();
            axis[k % 3] = 1.0;
            if k < 3 {
                for at in [0, 3, 6, 9] {
                    moved[at..at + 3].copy_from_slice(axis.cross(&vector(at)).as_slice());
                }
            }
            let point = other_point(k, &axis, &vector(9), &gear.racket.com_local().coords);
            moved[6..9].iter_mut().zip(&point).for_each(|(m, p)| *m += p);
        } else if k == BALANCE {
            let (racket, inertia) = (&gear.racket, gear.racket.inertia_kg_m2());
            let per_m = 2.0 * racket.mass_kg * (racket.balance_m - SWINGWEIGHT_AXIS_FROM_BUTT_M);
            let (x, y) = (o.inputs[POSITION] - racket.com_local().x, o.inputs[POSITION + 1]);
            let reduced = 1.0 / (1.0 / gear.ball.mass_kg + 1.0 / racket.mass_kg + x * x / inertia.y + y * y / inertia.x);
            let impulse = per_m * reduced * (x / inertia.y).powi(2);
            let shift = vector(9).cross(&Vector3::x());
            let turn = [0.0, per_m / inertia.y, per_m / inertia.z];
            for a in 0..3 {
                moved[a] = -impulse * (all[a] - o.inputs[a]);
                moved[6 + a] = shift[a] - impulse * (all[6 + a] - o.inputs[6 + a]);
                moved[9 + a] = (turn[a] - impulse) * (all[9 + a] - o.inputs[9 + a]);
            }
        } else if k == CONTACT_TIME {
            moved[OUTPUTS.len() - 1] = 1.0;
            let (rate, inertia) = (vector(9), gear.racket.inertia_kg_m2());
            // Euler's equations of a body left to itself.
            let change = -rate.cross(&inertia.component_mul(&rate)).component_div(&inertia);
            moved[9..12].copy_from_slice(change.as_slice());
        }
        DVector::from_iterator(o.measured.len(), o.measured.iter().map(|&k| moved[k]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::equipment::{Ball, Racket};

    #[test]
    fn truth_the_layout_of_the_shared_errors_is_that_of_the_table() {
        assert_eq!((SHARED[FACE - 1], SHARED[BALANCE], SHARED[CONTACT_TIME]), ("face_shift_z", "balance_shift", "contact_time_shift"));
        assert_eq!((SHARED[SPEED_SCALE], SHARED[SPIN_SCALE]), ("speed_scale", "spin_scale"));
        assert_eq!((INPUTS[POSITION], OUTPUTS[OUTPUTS.len() - 1]), ("impact_x", "contact_time"));
        assert_eq!((INPUTS[6], INPUTS[9], OUTPUTS[6], OUTPUTS[9]), ("racket_in_vx", "racket_in_wx", "racket_out_vx", "racket_out_wx"));
    }

    fn racket(balance_m: f64) -> Racket {
        toml::from_str(&format!(
            "name = \"r\"\nmass_kg = 0.33\nlength_m = 0.685\nbalance_m = {balance_m}\nstringbed_centre_m = 0.4975\nswingweight_kgm2 = 0.0325\n\
             twistweight_kgm2 = 0.0015\n[head]\ninner_length_m = 0.335\ninner_width_m = 0.255\n[strings]\ntension_lb = 60.0\n"
        ))
        .expect("racket")
    }

    fn ball() -> Ball {
        toml::from_str("name = \"b\"\nmass_kg = 0.0577\ndiameter_m = 0.066\ninertia_factor = 0.6\n").expect("ball")
    }

    /// Every output measured, all of them zero.
    fn observation() -> Observation {
        Observation {
            id: "a".into(),
            gear: 0,
            order: 0.0,
            own: Default::default(),
            session: 0,
            held_out: false,
            inputs: [0.0; INPUTS.len()],
            input_sd: [0.0; INPUTS.len()],
            missing: [false; INPUTS.len()],
            open_spin_sd: [0.0; 2],
            measured: (0..OUTPUTS.len()).collect(),
            outputs: vec![0.0; OUTPUTS.len()],
            output_sd: vec![1.0; OUTPUTS.len()],
            shared_sd: [0.0; SHARED.len()],
            groups: Default::default(),
            held_by: "a".into(),
        }
    }

    /// A racket hung at rest, hit on its long axis at 20 m/s with e = 0.8; its balance point is stated 1.5 mm too near the tip.
    #[test]
    fn truth_a_mis_stated_balance_point_is_taken_out() {
        // Ball out, velocity of the centre of mass, rate about y, by hand (docs/impact.md, closed forms) for a racket hit x from its centre of mass.
        let hit = |r: &Racket, x: f64| {
            let i = r.inertia_kg_m2().y;
            let impulse = 1.8 * 20.0 / (1.0 / 0.0577 + 1.0 / 0.33 + x * x / i);
            [-20.0 + impulse / 0.0577, -impulse / 0.33, impulse * x / i]
        };
        let (truth, stated) = (racket(0.325), racket(0.3265));
        let (impact_x, shift) = (-0.05, -0.0015);
        let [ball_out, v, w] = hit(&truth, impact_x - truth.com_local().x);
        let mut o = observation();
        (o.inputs[2], o.inputs[POSITION]) = (-20.0, impact_x);
        // What is called the centre of mass moves with the racket there.
        (o.outputs[2], o.outputs[8], o.outputs[10]) = (ball_out, v - w * shift, w);
        let gear = Gear { racket: stated.clone(), ball: ball() };
        let mut taken_out = SessionShift::default();
        taken_out.shared[BALANCE] = shift;
        let inputs = taken_out.inputs_of(&o, &gear);
        let outputs = taken_out.outputs_of(&o, &gear);
        let plain = hit(&stated, impact_x - stated.com_local().x);
        let corrected = hit(&stated, inputs[POSITION] - stated.com_local().x);
        for (k, at) in [(0, 2), (1, 8), (2, 10)] {
            let (before, after) = (plain[k] - o.outputs[at], corrected[k] - outputs[at]);
            // Second order: (2 M d s / I)² is 2e-4.
            assert!(after.abs() < 0.02 * before.abs() + 5e-4, "{}: off by {before:.4}, then by {after:.4}", OUTPUTS[at]);
        }
    }

    /// A racket turning freely at rates such as follow an off-centre hit, followed for 0.3 ms in steps of 1 us by the
    /// conservation of its angular momentum: the body's share of a momentum that turns against it.
    #[test]
    fn truth_rates_stated_too_late_are_taken_back() {
        let (racket, ball) = (racket(0.325), ball());
        let inertia = racket.inertia_kg_m2();
        let at_end = Vector3::new(60.0, -40.0, 5.0);
        let (late_s, step_s) = (3e-4, 1e-6);
        let mut momentum: Vector3<f64> = inertia.component_mul(&at_end);
        for _ in 0..(late_s / step_s) as usize {
            let turned = nalgebra::UnitQuaternion::from_scaled_axis(momentum.component_div(&inertia) * step_s);
            momentum = turned.inverse() * momentum;
        }
        let stated = momentum.component_div(&inertia);
        let mut o = observation();
        o.outputs[9..12].copy_from_slice(stated.as_slice());
        let mut shift = SessionShift::default();
        shift.shared[CONTACT_TIME] = late_s;
        let outputs = shift.outputs_of(&o, &Gear { racket, ball });
        let back = Vector3::new(outputs[9], outputs[10], outputs[11]);
        assert!((stated - at_end).norm() > 0.5, "{stated}");
        assert!((back - at_end).norm() < 0.02 * (stated - at_end).norm(), "{back} instead of {at_end}, stated {stated}");
    }
}
