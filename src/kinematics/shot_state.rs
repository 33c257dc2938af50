//! What every characteristic of a shot is computed from, with its covariance, and the propagation of that covariance.

use super::calibration_share::{CalibrationShare, Disturbed};
use super::contact::{BodyMotion, PointMotion};
use super::shot_motion::ShotMotion;
use super::sweet_spot::{HAND_PIVOT_FROM_BUTT_M, HAND_PIVOT_SD_M, NODE_OF_LENGTH, NODE_OF_LENGTH_SD};
use crate::equipment::{Ball, Racket};
use crate::quantity::Quantity;
use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, UnitQuaternion, Vector3};

/// Number of uncertain numbers behind a shot: ball (6) and racket (12) before, the same after, spin before and after (3
/// each), how much earlier and nearer to the plane than seen the ball leaves, the two masses, swingweight, twistweight,
/// balance, node and hand.
pub const UNCERTAIN: usize = 51;
/// Where each begins.
pub(crate) const BALL_IN: usize = 0;
pub(crate) const RACKET_IN: usize = 6;
pub(crate) const BALL_OUT: usize = 18;
pub(crate) const RACKET_OUT: usize = 24;
pub(crate) const SPIN_IN: usize = 36;
pub(crate) const SPIN_OUT: usize = 39;
const LEAVING_FLAT: usize = 42;
const LEAVING_BENT: usize = 43;
const BALL_MASS: usize = 44;
const RACKET_MASS: usize = 45;
const SWINGWEIGHT: usize = 46;
const TWISTWEIGHT: usize = 47;
const BALANCE: usize = 48;
const NODE: usize = 49;
const HAND: usize = 50;

/// By how much earlier than one radius from the strings the ball may leave because it is still flat, s. A ball that springs
/// back with the force (hysteresis) leaves round, at no difference; one with viscous losses (docs/impact.md, base visco-elastic)
/// 0.13 to 0.15 ms earlier whatever its speed, string or racket. The 95 % interval holds both; all shots share the error.
pub const LEAVING_FLAT_SD_S: f64 = 0.07e-3;
/// Spread of the bent frame's place at the impact point when the ball leaves, m, against the rigid racket that the markers
/// show: a blow of 1.5 N s off the node sets a mode of 0.2 kg and 140 Hz swinging by some 3 mm.
pub const LEAVING_BENT_SD_M: f64 = 0.003;
/// Spread of the masses in the files, relative: kitchen scales, and tape and dampers that were not weighed.
pub const MASS_SD: f64 = 0.005;
/// Spread of the swingweight, relative: a machine reads within 1 % (Spurr et al. 2014), a pendulum as well.
pub const SWINGWEIGHT_SD: f64 = 0.01;
/// Spread of the twistweight, relative: small, and seldom measured on a good bifilar suspension.
pub const TWISTWEIGHT_SD: f64 = 0.03;
/// Spread of the balance, m: read on a ruler. A velocity "of the centre of mass" is that of the balance point as stated; what
/// follows from the true one (momentum, energy, special points and distances to them) feels this. All shots with a racket
/// share the error: the impacts table states it in a column of its own.
pub const BALANCE_SD_M: f64 = 0.001;
/// Errors in proportion to what is measured, which all shots of a session share: as ball and racket roll and turn, other sides
/// of felt and tape come into view, always in the same sense for the same motion. Relative, one deviation per component; in
/// rendered sessions with known truth velocities and the racket's rates were off by 0.05 to 0.2 %, spins by 0.2 to 1 %.
pub const SPEED_SCALE_SD: f64 = 0.0015;
pub const SPIN_SCALE_SD: f64 = 0.005;

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
    /// Whether the last contact follows from the motions after it.
    pub leaves: bool,
    pub spin_in: Option<Vector3<f64>>,
    pub spin_out: Option<Vector3<f64>>,
    /// How much earlier the ball leaves because it is flat, s, and how much nearer to the rigid plane because the frame is
    /// bent, m.
    pub leaving_flat_s: f64,
    pub leaving_bent_m: f64,
    pub ball_mass: f64,
    pub racket_mass: f64,
    /// Swingweight and twistweight over those stated, balance less the stated one, m.
    pub swingweight_ratio: f64,
    pub twistweight_ratio: f64,
    pub balance_shift: f64,
    /// Node of the first bending mode over the racket's length; place of the hand's pivot, m from the butt.
    pub node_of_length: f64,
    pub hand_from_butt: f64,
}

/// A shot's state with a square root of its covariance: column k is one independent standard deviation.
#[derive(Debug, Clone)]
pub struct UncertainShot {
    pub state: ShotState,
    pub root: DMatrix<f64>,
}

impl UncertainShot {
    pub(crate) fn new(
        motion: &ShotMotion,
        racket: &Racket,
        ball: &Ball,
        spin_in: Option<&SpinVector>,
        spin_out: Option<&SpinVector>,
        calibration: &CalibrationShare,
    ) -> Self {
        let state = ShotState {
            side: motion.side,
            in_t: motion.ball_in.reference_t,
            out_t: motion.ball_out.as_ref().map_or(0.0, |b| b.reference_t),
            leaves: motion.last_contact_t.is_some(),
            ball_in: PointMotion::from(&motion.ball_in),
            racket_in: BodyMotion::from(&motion.racket_in),
            ball_out: motion.ball_out.as_ref().map(PointMotion::from),
            racket_out: motion.racket_out.as_ref().map(BodyMotion::from),
            spin_in: spin_in.map(|s| s.omega),
            spin_out: spin_out.map(|s| s.omega),
            leaving_flat_s: 0.0,
            leaving_bent_m: 0.0,
            ball_mass: ball.mass_kg,
            racket_mass: racket.mass_kg,
            swingweight_ratio: 1.0,
            twistweight_ratio: 1.0,
            balance_shift: 0.0,
            node_of_length: NODE_OF_LENGTH,
            hand_from_butt: HAND_PIVOT_FROM_BUTT_M,
        };
        let disturbed = Disturbed {
            ball_in: &motion.ball_in,
            racket_in: &motion.racket_in,
            ball_out: motion.ball_out.as_ref(),
            racket_out: motion.racket_out.as_ref(),
            spin_in: state.spin_in,
            spin_out: state.spin_out,
        };
        let shared = calibration.columns(&disturbed, &motion.moving);
        let mut root = DMatrix::zeros(UNCERTAIN, UNCERTAIN + shared.ncols());
        root.columns_mut(UNCERTAIN, shared.ncols()).copy_from(&shared);
        put(&mut root, BALL_IN, &motion.ball_in.covariance);
        put(&mut root, RACKET_IN, &motion.racket_in.covariance);
        if let Some(b) = &motion.ball_out {
            put(&mut root, BALL_OUT, &b.covariance);
        }
        if let Some(r) = &motion.racket_out {
            put(&mut root, RACKET_OUT, &r.covariance);
        }
        for (at, spin) in [(SPIN_IN, spin_in), (SPIN_OUT, spin_out)] {
            if let Some(s) = spin {
                put(&mut root, at, &s.covariance);
            }
        }
        for (k, sd) in [
            (LEAVING_FLAT, LEAVING_FLAT_SD_S),
            (LEAVING_BENT, LEAVING_BENT_SD_M),
            (BALL_MASS, MASS_SD * ball.mass_kg),
            (RACKET_MASS, MASS_SD * racket.mass_kg),
            (SWINGWEIGHT, SWINGWEIGHT_SD),
            (TWISTWEIGHT, TWISTWEIGHT_SD),
            (BALANCE, BALANCE_SD_M),
            (NODE, NODE_OF_LENGTH_SD),
            (HAND, HAND_PIVOT_SD_M),
        ] {
            root[(k, k)] = sd;
        }
        UncertainShot { state, root }
    }

    /// Values of `f` with the standard deviation of each, and their covariance: central differences along the columns of
    /// the covariance's root (first-order propagation with the function's own curvature averaged out).
    pub fn propagate(&self, f: impl Fn(&ShotState) -> Vec<Measure>) -> (Vec<(Measure, f64)>, DMatrix<f64>) {
        let centre = f(&self.state);
        let mut spread = DMatrix::zeros(centre.len(), self.root.ncols());
        for k in 0..self.root.ncols() {
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
    /// The racket with this state's mass, balance and inertias. A spinweight that was stated follows the swingweight.
    pub fn racket(&self, stated: &Racket) -> Racket {
        Racket {
            mass_kg: self.racket_mass,
            balance_m: stated.balance_m + self.balance_shift,
            swingweight_kgm2: stated.swingweight_kgm2 * self.swingweight_ratio,
            twistweight_kgm2: stated.twistweight_kgm2 * self.twistweight_ratio,
            spinweight_kgm2: stated.spinweight_kgm2.map(|s| s * self.swingweight_ratio),
            ..stated.clone()
        }
    }

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
            ball_in: point(&self.ball_in, BALL_IN),
            racket_in: body(&self.racket_in, RACKET_IN),
            ball_out: self.ball_out.as_ref().map(|b| point(b, BALL_OUT)),
            racket_out: self.racket_out.as_ref().map(|b| body(b, RACKET_OUT)),
            spin_in: self.spin_in.map(|s| s + v(SPIN_IN)),
            spin_out: self.spin_out.map(|s| s + v(SPIN_OUT)),
            leaving_flat_s: self.leaving_flat_s + d[LEAVING_FLAT],
            leaving_bent_m: self.leaving_bent_m + d[LEAVING_BENT],
            ball_mass: self.ball_mass + d[BALL_MASS],
            racket_mass: self.racket_mass + d[RACKET_MASS],
            swingweight_ratio: self.swingweight_ratio + d[SWINGWEIGHT],
            twistweight_ratio: self.twistweight_ratio + d[TWISTWEIGHT],
            balance_shift: self.balance_shift + d[BALANCE],
            node_of_length: self.node_of_length + d[NODE],
            hand_from_butt: self.hand_from_butt + d[HAND],
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
