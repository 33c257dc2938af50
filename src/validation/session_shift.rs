//! What all impacts of a session share: an offset of each measured input (of footage: of each output too), the error of the
//! racket face's own axes, of its balance point and of the contact's end.
//!
//! Every vector of the impacts table is resolved along axes that come from tape on the frame. Where the tape's middle lies
//! a fraction of a pixel from its image's, those axes are turned and shifted, by the same amount in every shot of a session
//! in which the racket is seen alike. A turn acts on inputs and outputs together, in proportion to the vectors: no offset of
//! single columns can take it up, and left alone it looks like a physical effect (a face that bends every exit the same
//! way). Where a table states how well the axes are known (`face_turn_x_sd` ...), the pose's error is therefore a nuisance
//! of six components per session with that prior (missing-physics.md, section 4).
//!
//! To first order in the error, with θ the turn of vectors as seen and s the shift of the stringbed centre: v → v + θ × v,
//! impact position p → p + θ × p + (s_x, s_y) + h u_t/u_z. The last part: the plane is taken to lie h = s_z − (θ × p)_z above
//! the strings, so that the ball of relative velocity u is believed to touch h/u_z later. The centre of mass c is taken
//! where the axes put it, which is a point −(θ × c + s) away: the velocity given for it is Ω × that too high.
//!
//! A balance point stated s too far along x is not the centre of mass: its velocity is V + s Ω × x, and an impact at
//! impact_x lies s farther from the centre of mass than believed, which is the same as an impact_x smaller by s. The contact's
//! end is inferred, not seen: its error adds to every contact time (kinematics.md).

use super::forward::{Inputs, Outputs};
use super::observation::{Gear, Observation};
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

/// The shared errors of one session.
#[derive(Debug, Clone, Default)]
pub struct SessionShift {
    /// Order of [`INPUTS`].
    pub offsets: Inputs,
    /// Order of [`OUTPUTS`].
    pub output_offsets: Outputs,
    /// Order of [`SHARED`]: rad, m.
    pub shared: [f64; SHARED.len()],
}

impl SessionShift {
    fn any_shared(&self) -> bool {
        self.shared.iter().any(|v| *v != 0.0)
    }

    /// The measured inputs with what the session shares taken out.
    pub fn inputs_of(&self, o: &Observation, gear: &Gear) -> Inputs {
        let mut inputs: Inputs = std::array::from_fn(|j| o.inputs[j] - self.offsets[j]);
        if self.any_shared() {
            for (by, moved) in self.shared.iter().zip(shared_inputs(o, gear)) {
                inputs.iter_mut().zip(moved).for_each(|(x, m)| *x -= by * m);
            }
        }
        inputs
    }

    /// The measured outputs with what the session shares taken out; order of `o.measured`.
    pub fn outputs_of(&self, o: &Observation, gear: &Gear) -> DVector<f64> {
        let mut outputs = DVector::from_iterator(o.measured.len(), o.outputs.iter().zip(&o.measured).map(|(y, &k)| y - self.output_offsets[k]));
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
            moved[6..9].copy_from_slice(vector(9).cross(&Vector3::x()).as_slice());
        } else if k == CONTACT_TIME {
            moved[OUTPUTS.len() - 1] = 1.0;
        }
        DVector::from_iterator(o.measured.len(), o.measured.iter().map(|&k| moved[k]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_layout_of_the_shared_errors_is_that_of_the_table() {
        assert_eq!((SHARED[FACE - 1], SHARED[BALANCE], SHARED[CONTACT_TIME]), ("face_shift_z", "balance_shift", "contact_time_shift"));
        assert_eq!((INPUTS[POSITION], OUTPUTS[OUTPUTS.len() - 1]), ("impact_x", "contact_time"));
        assert_eq!((INPUTS[6], INPUTS[9], OUTPUTS[6], OUTPUTS[9]), ("racket_in_vx", "racket_in_wx", "racket_out_vx", "racket_out_wx"));
    }
}
