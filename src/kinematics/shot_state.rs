//! What every characteristic of a shot is computed from, with its covariance, and the propagation of that covariance.

use super::contact::{BodyMotion, PointMotion};
use super::shot_motion::ShotMotion;
use crate::equipment::{Ball, Racket};
use crate::quantity::Quantity;
use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, UnitQuaternion, Vector3};

/// Number of uncertain numbers behind a shot: ball (6) and racket (12) before, the same after, spin before and after (3
/// each), the ball's distance from the plane when it leaves, the two masses.
pub const UNCERTAIN: usize = 45;

/// Spread of the ball's distance from the string plane at last contact, m: it leaves while still a little flat and while
/// the strings have come back (thesis 2.7; physics.md C.6); the last contact is not seen between frames.
pub const LEAVING_GAP_SD_M: f64 = 0.0015;
/// Spread of the masses in the files, relative: kitchen scales, and tape and dampers that were not weighed.
pub const MASS_SD: f64 = 0.005;

/// Spin as a vector with its covariance, global axes, rad/s.
#[derive(Debug, Clone, PartialEq)]
pub struct SpinVector {
    pub omega: Vector3<f64>,
    pub covariance: Matrix3<f64>,
}

/// One set of values of everything uncertain.
#[derive(Debug, Clone)]
pub struct ShotState {
    pub side: f64,
    /// Reference times of the motions before and after, s on the shot's clock.
    pub in_t: f64,
    pub out_t: f64,
    pub ball_in: PointMotion,
    pub racket_in: BodyMotion,
    pub ball_out: Option<PointMotion>,
    pub racket_out: Option<BodyMotion>,
    pub spin_in: Option<Vector3<f64>>,
    pub spin_out: Option<Vector3<f64>>,
    pub leaving_gap: f64,
    pub ball_mass: f64,
    pub racket_mass: f64,
}

/// A shot's state with a square root of its covariance: column k is one independent standard deviation.
#[derive(Debug, Clone)]
pub struct UncertainShot {
    pub state: ShotState,
    pub root: DMatrix<f64>,
}

impl UncertainShot {
    pub fn new(motion: &ShotMotion, racket: &Racket, ball: &Ball, spin_in: Option<&SpinVector>, spin_out: Option<&SpinVector>) -> Self {
        let state = ShotState {
            side: motion.side,
            in_t: motion.ball_in.reference_t,
            out_t: motion.ball_out.as_ref().map_or(0.0, |b| b.reference_t),
            ball_in: PointMotion::from(&motion.ball_in),
            racket_in: BodyMotion::from(&motion.racket_in),
            ball_out: motion.ball_out.as_ref().map(PointMotion::from),
            racket_out: motion.racket_out.as_ref().map(BodyMotion::from),
            spin_in: spin_in.map(|s| s.omega),
            spin_out: spin_out.map(|s| s.omega),
            leaving_gap: 0.0,
            ball_mass: ball.mass_kg,
            racket_mass: racket.mass_kg,
        };
        let mut root = DMatrix::zeros(UNCERTAIN, UNCERTAIN);
        put(&mut root, 0, &motion.ball_in.covariance);
        put(&mut root, 6, &motion.racket_in.covariance);
        if let Some(b) = &motion.ball_out {
            put(&mut root, 18, &b.covariance);
        }
        if let Some(r) = &motion.racket_out {
            put(&mut root, 24, &r.covariance);
        }
        for (at, spin) in [(36, spin_in), (39, spin_out)] {
            if let Some(s) = spin {
                put(&mut root, at, &s.covariance);
            }
        }
        root[(42, 42)] = LEAVING_GAP_SD_M;
        root[(43, 43)] = MASS_SD * ball.mass_kg;
        root[(44, 44)] = MASS_SD * racket.mass_kg;
        UncertainShot { state, root }
    }

    /// Values of `f` with the standard deviation of each, and their covariance: central differences along the columns of
    /// the covariance's root (first-order propagation with the function's own curvature averaged out).
    pub fn propagate(&self, f: impl Fn(&ShotState) -> Vec<Measure>) -> (Vec<(Measure, f64)>, DMatrix<f64>) {
        let centre = f(&self.state);
        let mut spread = DMatrix::zeros(centre.len(), UNCERTAIN);
        for k in 0..UNCERTAIN {
            let column = self.root.column(k);
            if column.iter().all(|v| *v == 0.0) {
                continue;
            }
            let step: DVector<f64> = column.into_owned();
            let (ahead, behind) = (f(&self.state.moved(&step)), f(&self.state.moved(&-step)));
            for (i, m) in centre.iter().enumerate() {
                let (a, b) = (ahead.get(i).and_then(|m| m.value), behind.get(i).and_then(|m| m.value));
                spread[(i, k)] = match (a, m.value, b) {
                    (Some(a), _, Some(b)) => 0.5 * (a - b),
                    (Some(a), Some(c), None) => a - c,
                    (None, Some(c), Some(b)) => c - b,
                    _ => 0.0,
                };
            }
        }
        let covariance = &spread * spread.transpose();
        let out = centre.into_iter().enumerate().map(|(i, m)| (m, covariance[(i, i)].sqrt())).collect();
        (out, covariance)
    }
}

/// A named value before its deviation is known; `None` when the shot does not give it.
#[derive(Debug, Clone, PartialEq)]
pub struct Measure {
    pub name: String,
    pub unit: &'static str,
    pub value: Option<f64>,
}

impl Measure {
    pub fn quantity(&self, sd: f64) -> Option<Quantity> {
        self.value.filter(|v| v.is_finite() && sd.is_finite()).map(|v| Quantity::new(v, sd, self.unit))
    }
}

impl ShotState {
    /// The state after a step in everything uncertain, in the order of [`UNCERTAIN`].
    pub fn moved(&self, d: &DVector<f64>) -> ShotState {
        let v = |k: usize| Vector3::new(d[k], d[k + 1], d[k + 2]);
        let point = |p: &PointMotion, k: usize| PointMotion { position: p.position + v(k), velocity: p.velocity + v(k + 3), acceleration: p.acceleration };
        let body = |b: &BodyMotion, k: usize| BodyMotion {
            com: b.com + v(k),
            attitude: UnitQuaternion::from_scaled_axis(v(k + 3)) * b.attitude,
            velocity: b.velocity + v(k + 6),
            rate_body: b.rate_body + v(k + 9),
            acceleration: b.acceleration,
            rate_dot_body: b.rate_dot_body,
        };
        ShotState {
            ball_in: point(&self.ball_in, 0),
            racket_in: body(&self.racket_in, 6),
            ball_out: self.ball_out.as_ref().map(|b| point(b, 18)),
            racket_out: self.racket_out.as_ref().map(|b| body(b, 24)),
            spin_in: self.spin_in.map(|s| s + v(36)),
            spin_out: self.spin_out.map(|s| s + v(39)),
            leaving_gap: self.leaving_gap + d[42],
            ball_mass: self.ball_mass + d[43],
            racket_mass: self.racket_mass + d[44],
            ..self.clone()
        }
    }
}

/// Writes the symmetric square root of a covariance block; eigenvalues below zero are rounding.
fn put<const N: usize>(root: &mut DMatrix<f64>, at: usize, covariance: &SMatrix<f64, N, N>) {
    let eigen = DMatrix::from_fn(N, N, |i, j| 0.5 * (covariance[(i, j)] + covariance[(j, i)])).symmetric_eigen();
    for k in 0..N {
        let length = eigen.eigenvalues[k].max(0.0).sqrt();
        for i in 0..N {
            root[(at + i, at + k)] = eigen.eigenvectors[(i, k)] * length;
        }
    }
}
