//! A beam with a point mass on it (a hand on the handle), and how its modes change with the mass and its place.

use super::{BAND, Beam, DOF, assemble, dot, interpolation, multiply};
use crate::impact::dual::Dual;
use crate::impact::error::ModelError;
use crate::impact::real::Real;
use nalgebra::{DMatrix, DVector};

impl Beam {
    /// How each mode changes with a point mass `(m from the butt, kg)` that the beam carries, per metre and per kilogram: frequency,
    /// modal mass, shape.
    ///
    /// From the eigenvalue problem differentiated, (K − λM) dφ − dλ Mφ = λ dM φ, with φ kept at 1 at the tip (Nelson 1976).
    fn slopes(&self, (place, mass): (f64, f64)) -> Option<Vec<[(f64, f64, Vec<f64>); 2]>> {
        const TIP: usize = DOF - 2;
        let (k, m) = assemble(&self.segments, &self.mesh, &[(place, mass)]);
        let (element, weights) = interpolation(&self.mesh, Dual::<1>::variable(place, 0));
        let mut slopes = Vec::with_capacity(self.modes.len());
        for mode in &self.modes {
            let phi = &mode.shape;
            let lambda = (std::f64::consts::TAU * mode.frequency_hz).powi(2);
            let m_phi = multiply(&m, phi);
            let mut a = DMatrix::zeros(DOF, DOF);
            for i in 0..DOF {
                for d in 0..BAND.min(i + 1) {
                    let v = k[i][d] - lambda * m[i][d];
                    (a[(i, i - d)], a[(i - d, i)]) = (v, v);
                }
            }
            // The tip's displacement stays 1: its column makes room for dλ.
            a.set_column(TIP, &-DVector::from_column_slice(&m_phi));
            let lu = a.lu();
            // dM φ = w' (w φ) + w (w' φ) by the place, w (w φ) by the mass.
            let here: f64 = (0..4).map(|i| weights[i].value * phi[2 * element + i]).sum();
            let turned: f64 = (0..4).map(|i| weights[i].slope[0] * phi[2 * element + i]).sum();
            let mut pair = [(0.0, 0.0, Vec::new()), (0.0, 0.0, Vec::new())];
            for (by_mass, slot) in pair.iter_mut().enumerate() {
                let mut load = DVector::zeros(DOF);
                for i in 0..4 {
                    load[2 * element + i] =
                        if by_mass == 1 { weights[i].value * here } else { mass.max(0.0) * (weights[i].slope[0] * here + weights[i].value * turned) };
                }
                let own = load.dot(&DVector::from_column_slice(phi));
                let mut d_phi = lu.solve(&(load * lambda))?;
                let d_lambda = std::mem::take(&mut d_phi[TIP]);
                let d_phi = d_phi.as_slice().to_vec();
                *slot = (d_lambda / (2.0 * lambda.sqrt() * std::f64::consts::TAU), 2.0 * dot(&d_phi, &m_phi) + own, d_phi);
            }
            slopes.push(pair);
        }
        Some(slopes)
    }
}

impl<T: Real> Beam<T> {
    /// The same beam with a point mass on it; derivatives by the mass and its place are those of the eigenvalue problem.
    ///
    /// # Errors
    /// As [`Beam::new`].
    pub fn with_point_mass(&self, from_butt: T, mass: T) -> Result<Self, ModelError> {
        let load = (from_butt.value(), mass.value());
        let plain = Beam::new(&self.segments, &[load])?;
        let mut beam = Beam::of(&plain);
        if from_butt.is_constant() && mass.is_constant() {
            return Ok(beam);
        }
        let slopes = plain.slopes(load).ok_or(ModelError::NotFinite)?;
        // Value 0 with the derivatives of place and mass.
        let moved = [from_butt - load.0, mass - load.1];
        for (mode, pair) in beam.modes.iter_mut().zip(&slopes) {
            for (by, (frequency, modal_mass, shape)) in moved.iter().zip(pair) {
                mode.frequency_hz += *by * *frequency;
                mode.modal_mass += *by * *modal_mass;
                for (x, slope) in mode.shape.iter_mut().zip(shape) {
                    *x += *by * *slope;
                }
            }
        }
        // The node moves by -dφ/φ'.
        let lean = Beam::<Dual<1>>::of(&plain).shape(0, Dual::variable(plain.head_node, 0)).slope[0];
        let there = beam.shape(0, T::constant(plain.head_node));
        beam.head_node = -(there - there.value()) / lean + plain.head_node;
        Ok(beam)
    }
}

#[cfg(test)]
mod tests {
    use super::super::RacketBeam;
    use super::*;

    /// Derivatives of the loaded beam's modes by a point mass and its place, against differences.
    #[test]
    fn agrees_modes_of_a_loaded_beam_with_differences() {
        let racket = RacketBeam { mass: 0.33, balance: 0.325, inertia: 0.0158, length: 0.685, frequency_hz: 140.0 };
        let beam = racket.build().expect("valid");
        let (place, mass, h) = (0.0712, 0.21, 1e-4);
        let dual = Beam::<Dual<2>>::of(&beam).with_point_mass(Dual::variable(place, 0), Dual::variable(mass, 1)).expect("valid");
        let at = |place: f64, mass: f64| Beam::new(&beam.segments, &[(place, mass)]).expect("valid");
        let numbers = |b: &Beam| [b.modes[0].frequency_hz, b.modes[0].modal_mass, b.shape(0, 0.43), b.head_node, b.modes[1].frequency_hz, b.shape(2, 0.21)];
        let m = &dual.modes;
        let s = |mode: usize, x: f64| dual.shape(mode, Dual::constant(x));
        let seen = [m[0].frequency_hz, m[0].modal_mass, s(0, 0.43), dual.head_node, m[1].frequency_hz, s(2, 0.21)];
        for (k, (up, down)) in [(at(place + h, mass), at(place - h, mass)), (at(place, mass + h), at(place, mass - h))].into_iter().enumerate() {
            for (seen, (a, b)) in seen.iter().zip(numbers(&up).into_iter().zip(numbers(&down))) {
                let expected = (a - b) / (2.0 * h);
                assert!((seen.slope[k] - expected).abs() < 1e-5 * (1.0 + expected.abs()), "{k}: {} against {expected}", seen.slope[k]);
            }
        }
    }
}
