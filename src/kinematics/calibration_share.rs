//! What the calibration's uncertainty does to the motions of a shot.
//!
//! Every independent error of the calibration moves all triangulated points of a shot together; along a path the
//! displacement changes, and that change is an error of velocity. Errors of ball and racket on both sides of the contact are
//! the same errors: they enter the shot's covariance as common columns, so that what cancels between bodies does cancel.

use super::ball_flight::FlightEstimate;
use super::contact::{BodyMotion, PointMotion};
use super::racket_motion::{MotionEstimate, MovingRacket};
use super::shot_state::{BALL_IN, BALL_OUT, RACKET_IN, RACKET_OUT, SPIN_IN, SPIN_OUT, UNCERTAIN};
use crate::calibration::{CalibrationError3d, StereoRig};
use nalgebra::{DMatrix, Isometry3, Matrix6, Point3, SMatrix, Vector3, Vector6};

/// Length of path over which a displacement's change is taken for an error of velocity, s: half a window.
const HALF_WINDOW_S: f64 = 0.012;

/// Errors of the calibration and of the global axes.
#[derive(Debug, Clone)]
pub(crate) struct CalibrationShare {
    error: Option<CalibrationError3d>,
    global_from_left: Isometry3<f64>,
    /// Turns of the global axes, one standard deviation each, global axes, rad.
    axes: [Vector3<f64>; 3],
}

/// Which motions there are to disturb.
pub(crate) struct Disturbed<'a> {
    pub ball_in: &'a FlightEstimate,
    pub racket_in: &'a MotionEstimate,
    pub ball_out: Option<&'a FlightEstimate>,
    pub racket_out: Option<&'a MotionEstimate>,
    pub spin_in: Option<Vector3<f64>>,
    pub spin_out: Option<Vector3<f64>>,
}

impl CalibrationShare {
    /// A rig that carries no covariance (an imported calibration) contributes what it states of its axes only.
    pub fn of_rig(rig: &StereoRig) -> Self {
        let sd = rig.global_from_left.sd.get("rotation_rad").copied().unwrap_or([0.0; 3]);
        let turn = |k: usize| Vector3::ith(k, if sd[k].is_finite() { sd[k].abs() } else { 0.0 });
        CalibrationShare { error: CalibrationError3d::of_rig(rig), global_from_left: rig.global_from_left.isometry(), axes: [turn(0), turn(1), turn(2)] }
    }

    /// Columns for the root of a shot's covariance: one per independent error.
    pub fn columns(&self, motions: &Disturbed<'_>, moving: &MovingRacket) -> DMatrix<f64> {
        let mut parts: Vec<(usize, Vec<Vec<f64>>)> = Vec::new();
        for (at, flight, toward) in [(BALL_IN, Some(motions.ball_in), -1.0), (BALL_OUT, motions.ball_out, 1.0)] {
            parts.extend(flight.and_then(|f| Some((at, self.of_point(&PointMotion::from(f), toward)?))));
        }
        for (at, motion, toward) in [(RACKET_IN, Some(motions.racket_in), -1.0), (RACKET_OUT, motions.racket_out, 1.0)] {
            parts.extend(motion.and_then(|m| Some((at, self.of_body(&BodyMotion::from(m), moving, toward)?))));
        }
        let errors = parts.iter().map(|p| p.1.len()).max().unwrap_or(0);
        let mut columns = DMatrix::zeros(UNCERTAIN, errors + 3);
        for (at, own) in &parts {
            for (k, values) in own.iter().enumerate() {
                for (i, v) in values.iter().enumerate() {
                    columns[(at + i, k)] = *v;
                }
            }
        }
        // The global axes turn about the ball's place: shifts of everything together say nothing about an impact.
        let pivot = motions.ball_in.position;
        for (k, turn) in self.axes.iter().enumerate() {
            let mut put = |at: usize, v: Vector3<f64>| (0..3).for_each(|i| columns[(at + i, errors + k)] = v[i]);
            for (at, flight) in [(BALL_IN, Some(motions.ball_in)), (BALL_OUT, motions.ball_out)] {
                if let Some(f) = flight {
                    put(at, turn.cross(&(f.position - pivot)));
                    put(at + 3, turn.cross(&f.velocity));
                }
            }
            for (at, motion) in [(RACKET_IN, Some(motions.racket_in)), (RACKET_OUT, motions.racket_out)] {
                if let Some(m) = motion {
                    put(at, turn.cross(&(m.state.com - pivot)));
                    put(at + 3, *turn);
                    put(at + 6, turn.cross(&m.state.velocity));
                }
            }
            for (at, spin) in [(SPIN_IN, motions.spin_in), (SPIN_OUT, motions.spin_out)] {
                if let Some(w) = spin {
                    put(at, turn.cross(&w));
                }
            }
        }
        columns
    }

    /// Displacements of a global point, global axes, m, one per independent error.
    fn displacements(&self, p: &Point3<f64>) -> Option<Vec<Vector3<f64>>> {
        let in_left = self.global_from_left.inverse_transform_point(p);
        Some(self.error.as_ref()?.displacements(&in_left)?.into_iter().map(|d| self.global_from_left.rotation * d).collect())
    }

    /// Errors of position and velocity of a flying point.
    fn of_point(&self, at: &PointMotion, toward: f64) -> Option<Vec<Vec<f64>>> {
        let dt = toward * HALF_WINDOW_S;
        let (here, there) = (self.displacements(&at.position)?, self.displacements(&at.after(dt).position)?);
        Some(here.iter().zip(&there).map(|(a, b)| a.iter().copied().chain(((b - a) / dt).iter().copied()).collect()).collect())
    }

    /// Errors of centre of mass, attitude, velocity and angular velocity of the racket.
    fn of_body(&self, at: &BodyMotion, moving: &MovingRacket, toward: f64) -> Option<Vec<Vec<f64>>> {
        let dt = toward * HALF_WINDOW_S;
        let (here, there) = (self.rigid(at, moving)?, self.rigid(&at.after(dt), moving)?);
        let body = at.attitude.inverse();
        let three = |v: &Vector6<f64>, k: usize| Vector3::new(v[k], v[k + 1], v[k + 2]);
        let errors = here.iter().zip(&there).map(|(a, b)| {
            let (velocity, turning) = ((three(b, 0) - three(a, 0)) / dt, body * ((three(b, 3) - three(a, 3)) / dt));
            [three(a, 0), three(a, 3), velocity, turning].iter().flat_map(|v| [v.x, v.y, v.z]).collect()
        });
        Some(errors.collect())
    }

    /// The small shift of the centre of mass and turn (global axes) that follow the markers' displacements best.
    fn rigid(&self, at: &BodyMotion, moving: &MovingRacket) -> Option<Vec<Vector6<f64>>> {
        let pose = at.pose(&moving.com_local);
        let (mut normal, mut sums) = (Matrix6::zeros(), Vec::<Vector6<f64>>::new());
        for marker in &moving.figure.points {
            let p = pose * marker;
            let mut moves = SMatrix::<f64, 3, 6>::zeros();
            moves.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            moves.fixed_view_mut::<3, 3>(0, 3).copy_from(&-(p - at.com).cross_matrix());
            normal += moves.transpose() * moves;
            let displacements = self.displacements(&p)?;
            sums.resize(displacements.len(), Vector6::zeros());
            sums.iter_mut().zip(&displacements).for_each(|(s, d)| *s += moves.transpose() * d);
        }
        let factor = normal.cholesky()?;
        Some(sums.iter().map(|s| factor.solve(s)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Camera, RigidTransform};
    use nalgebra::UnitQuaternion;
    use std::collections::BTreeMap;

    /// Two cameras 8 m apart that look at a volume 12 m away; only the distance between them is uncertain, by 0.1 %.
    fn rig() -> StereoRig {
        let camera = Camera { fx: 2950.0, fy: 2950.0, cx: 256.0, cy: 256.0, distortion: [0.0; 5], rms_px: 0.1, sd: BTreeMap::new() };
        let right_from_left = Isometry3::new(Vector3::new(7.0, 0.0, 3.0), Vector3::new(0.0, -0.6, 0.0));
        let t = right_from_left.translation.vector;
        let mut covariance = vec![vec![0.0; 24]; 24];
        for i in 0..3 {
            for j in 0..3 {
                covariance[21 + i][21 + j] = 1e-6 * t[i] * t[j];
            }
        }
        let reference: Vec<[f64; 3]> = (0..27).map(|k| [f64::from(k % 3) - 1.0, f64::from(k / 3 % 3) - 1.0, 11.0 + f64::from(k / 9)]).collect();
        let transform = RigidTransform::from_isometry(&right_from_left);
        let more = BTreeMap::from([
            ("covariance".to_owned(), serde_json::json!({ "matrix": covariance })),
            ("volume".to_owned(), serde_json::json!({ "reference_points_m": reference })),
        ]);
        StereoRig {
            image_size: [512, 512],
            left: camera.clone(),
            right: camera,
            r: transform.r,
            t: transform.t,
            rms_stereo_px: 0.1,
            pairs: Vec::new(),
            square_mm: None,
            global_from_left: RigidTransform::from_isometry(&Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, 1.0, -0.2))),
            more,
        }
    }

    #[test]
    fn truth_an_uncertain_baseline_is_an_uncertain_scale() {
        // All lengths grow with the baseline (similar triangles): 0.1 % of a speed of 30 m/s is 0.03 m/s, along the path.
        let rig = rig();
        let share = CalibrationShare::of_rig(&rig);
        let global = rig.global_from_left.isometry();
        let velocity = global.rotation * Vector3::new(20.0, -10.0, 20.0);
        let at = PointMotion { position: global * Point3::new(0.1, -0.2, 12.0), velocity, acceleration: Vector3::zeros() };
        let errors = share.of_point(&at, -1.0).expect("in view");
        let sum: f64 = errors.iter().map(|e| Vector3::new(e[3], e[4], e[5]).norm_squared()).sum();
        assert!((sum.sqrt() - 0.03).abs() < 1e-6, "{}", sum.sqrt());
        let along: f64 = errors.iter().map(|e| Vector3::new(e[3], e[4], e[5]).dot(&velocity).powi(2) / 900.0).sum();
        assert!((along.sqrt() - 0.03).abs() < 1e-6);
    }

    #[test]
    fn law_a_scale_error_leaves_a_rackets_turning_alone() {
        let rig = rig();
        let share = CalibrationShare::of_rig(&rig);
        let global = rig.global_from_left.isometry();
        let points = [[-0.1775, 0.0], [0.0, -0.1375], [0.0, 0.1375], [0.2, -0.045], [0.2, 0.045]].map(|[x, y]| Point3::new(x, y, 0.0));
        let figure = crate::tracking::RacketFigure {
            points,
            tube: [Vector3::x_axis(); 5],
            bend: [Vector3::zeros(); 5],
            throat_markers: [false; 5],
            tube_radius_m: [0.01; 5],
        };
        let moving = MovingRacket {
            figure,
            com_local: Point3::new(0.17, 0.0, 0.0),
            inertia: Vector3::new(0.0015, 0.015, 0.017),
            gravity: Vector3::zeros(),
            balance: Vector3::zeros(),
            balance_sd: Vector3::zeros(),
        };
        let at = BodyMotion {
            com: global * Point3::new(0.1, -0.2, 12.0),
            attitude: UnitQuaternion::from_euler_angles(0.2, 1.0, -0.4),
            velocity: Vector3::new(0.0, 10.0, 0.0),
            rate_body: Vector3::new(3.0, 30.0, 5.0),
            acceleration: Vector3::zeros(),
            rate_dot_body: Vector3::zeros(),
        };
        let errors = share.of_body(&at, &moving, 1.0).expect("in view");
        let size = |from: usize| errors.iter().flat_map(|e| &e[from..from + 3]).map(|v| v * v).sum::<f64>().sqrt();
        // The figure's size is known, so the markers' centroid is what is displaced: its path over half a window counts.
        let centroid = |b: &BodyMotion| b.pose(&moving.com_local) * Point3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / 5.0);
        let expected = 1e-3 * (centroid(&at.after(HALF_WINDOW_S)) - centroid(&at)).norm() / HALF_WINDOW_S;
        assert!((size(6) - expected).abs() < 1e-5, "velocity {} against {expected}", size(6));
        assert!(size(3) < 1e-9 && size(9) < 1e-6, "turn {} and turning {}", size(3), size(9));
    }
}
