//! What all impacts of a session share: an offset of each measured input, and the error of the racket face's own axes.
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
//! the strings, so that the ball of relative velocity u is believed to touch h/u_z later.

use super::forward::Inputs;
use super::observation::{Gear, Observation};
use crate::impact_table::{FACE_POSE, INPUTS, OUTPUTS};
use nalgebra::{DVector, Vector3};

/// Approach speed below which the instant of contact cannot be moved, m/s.
const SLOWEST: f64 = 0.5;
/// Where the impact position stands in [`INPUTS`].
const POSITION: usize = 12;

/// The shared errors of one session.
#[derive(Debug, Clone, Default)]
pub struct SessionShift {
    /// Order of [`INPUTS`].
    pub offsets: Inputs,
    /// Order of [`FACE_POSE`]: rad, m.
    pub face: [f64; FACE_POSE.len()],
}

impl SessionShift {
    fn turned(&self) -> bool {
        self.face.iter().any(|v| *v != 0.0)
    }

    /// The measured inputs with what the session shares taken out.
    pub fn inputs_of(&self, o: &Observation, gear: &Gear) -> Inputs {
        let mut inputs: Inputs = std::array::from_fn(|j| o.inputs[j] - self.offsets[j]);
        if self.turned() {
            for (by, moved) in self.face.iter().zip(face_inputs(o, gear)) {
                inputs.iter_mut().zip(moved).for_each(|(x, m)| *x -= by * m);
            }
        }
        inputs
    }

    /// The measured outputs with what the session shares taken out; order of `o.measured`.
    pub fn outputs_of(&self, o: &Observation) -> DVector<f64> {
        let mut outputs = DVector::from_column_slice(&o.outputs);
        if self.turned() {
            for (by, moved) in self.face.iter().zip(face_outputs(o)) {
                outputs.axpy(-by, &moved, 1.0);
            }
        }
        outputs
    }
}

/// Derivative of the measured inputs with respect to each component of the face's pose.
pub fn face_inputs(o: &Observation, gear: &Gear) -> [Inputs; FACE_POSE.len()] {
    let x = &o.inputs;
    let vector = |at: usize| Vector3::new(x[at], x[at + 1], x[at + 2]);
    let position = Vector3::new(x[POSITION], x[POSITION + 1], 0.0);
    let strings = vector(6) + vector(9).cross(&(position - gear.racket.com_local().coords));
    let u = vector(0) - strings;
    // How far along the face the position moves when contact is placed 1 m too high.
    let along = if u.z.abs() > SLOWEST { u / u.z } else { Vector3::zeros() };
    std::array::from_fn(|k| {
        let mut moved = [0.0; INPUTS.len()];
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
        moved[POSITION] = shift.x + height * along.x;
        moved[POSITION + 1] = shift.y + height * along.y;
        moved
    })
}

/// Derivative of the measured outputs with respect to each component of the face's pose; order of `o.measured`. A vector of
/// which a component is missing turns as if that were zero.
pub fn face_outputs(o: &Observation) -> [DVector<f64>; FACE_POSE.len()] {
    let mut all = [0.0; OUTPUTS.len()];
    for (&k, value) in o.measured.iter().zip(&o.outputs) {
        all[k] = *value;
    }
    std::array::from_fn(|k| {
        let mut moved = [0.0; OUTPUTS.len()];
        if k < 3 {
            let mut axis = Vector3::zeros();
            axis[k] = 1.0;
            for at in [0, 3, 6, 9] {
                let turned = axis.cross(&Vector3::new(all[at], all[at + 1], all[at + 2]));
                moved[at..at + 3].copy_from_slice(turned.as_slice());
            }
        }
        DVector::from_iterator(o.measured.len(), o.measured.iter().map(|&k| moved[k]))
    })
}
