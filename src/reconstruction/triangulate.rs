//! One point from its pixels in both cameras: maximum likelihood in pixels, with covariance.

use crate::calibration::{CalibrationError3d, Camera, CameraId, StereoRig, nearest_approach};
use crate::tracking::{ImagePoint, with_errors_alike};
use nalgebra::{Isometry3, Matrix2, Matrix2x3, Matrix3, Point3, Vector2, Vector3};

/// Smallest angle between the rays, rad. Below it a pixel of noise moves the point by more than 300 pixels' worth of depth.
const MIN_RAY_ANGLE: f64 = 0.003;

/// Why two pixels give no point.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TriangulationError {
    #[error("the rays are nearly parallel ({angle_rad:.2e} rad; allowed: at least {MIN_RAY_ANGLE} rad)")]
    ParallelRays { angle_rad: f64 },
    #[error("the rays meet behind camera `{camera}`", camera = .camera.name())]
    BehindCamera { camera: CameraId },
    #[error("pixel ({u:.1}, {v:.1}) of camera `{camera}` is outside what its distortion can map back", camera = .camera.name())]
    NotInvertible { camera: CameraId, u: f64, v: f64 },
    #[error("pixel ({u}, {v}) with deviation ({u_sd}, {v_sd}) of camera `{camera}`; allowed: finite, deviations above 0", camera = .camera.name())]
    BadPixel { camera: CameraId, u: f64, v: f64, u_sd: f64, v_sd: f64 },
    #[error("the search for the point did not settle")]
    NotConverged,
}

/// A point in global axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangulated {
    /// m.
    pub position: Point3<f64>,
    /// Covariance from the pixel deviations alone, m².
    pub covariance: Matrix3<f64>,
    /// Covariance from the calibration, without the common shift and turn of everything (which belongs to the global axes),
    /// m²; `None` for a rig without `covariance` and `volume`. It is the same error for all points of a session: add it
    /// for positions and distances, leave it out of differences between frames.
    pub calibration_covariance: Option<Matrix3<f64>>,
    /// Whether the point lies more than half the calibrated volume's extent outside it, where the calibration is a guess.
    pub far_outside: bool,
    /// Root-mean-square distance between the pixels and the point's projections, px. Two cameras leave one redundant number
    /// a point, so a single small residual says little.
    pub residual_px: f64,
    /// Squared distance in deviations, one degree of freedom: above 12 the two pixels hardly show the same point.
    pub chi2: f64,
}

/// Normal matrix, gradient, and residuals of both pictures.
type Equations = (Matrix3<f64>, Vector3<f64>, [Vector2<f64>; 2]);

/// A rig prepared for many points.
#[derive(Debug, Clone)]
pub struct Triangulator {
    cameras: [Camera; 2],
    right_from_left: Isometry3<f64>,
    global_from_left: Isometry3<f64>,
    calibration: Option<CalibrationError3d>,
    /// Smallest and largest left-camera coordinates a point may have without being far outside, m.
    allowed: Option<(Point3<f64>, Point3<f64>)>,
}

/// One point; for many points prepare a [`Triangulator`] once.
///
/// # Inputs  pixels with one standard deviation per axis, px
/// # Errors  [`TriangulationError`]
pub fn triangulate(rig: &StereoRig, left: &ImagePoint, right: &ImagePoint) -> Result<Triangulated, TriangulationError> {
    Triangulator::new(rig).triangulate(left, right)
}

impl Triangulator {
    pub fn new(rig: &StereoRig) -> Self {
        let calibration = CalibrationError3d::of_rig(rig);
        let allowed = calibration.as_ref().map(|c| {
            let (low, high) = c.extent();
            let margin = (high - low) * 0.5;
            (low - margin, high + margin)
        });
        Triangulator {
            cameras: [rig.left.clone(), rig.right.clone()],
            right_from_left: rig.right_from_left(),
            global_from_left: rig.global_from_left.isometry(),
            calibration,
            allowed,
        }
    }

    /// The maximum-likelihood point: least squares of pixel distances weighted by their deviations (Gauss-Newton from the
    /// rays' midpoint).
    pub fn triangulate(&self, left: &ImagePoint, right: &ImagePoint) -> Result<Triangulated, TriangulationError> {
        self.triangulate_alike(left, right, 0.0)
    }

    /// [`Triangulator::triangulate`] where the two pictures' errors are not independent: `alike` is their correlation in either
    /// picture axis. The place is the same, its covariance is not.
    pub fn triangulate_alike(&self, left: &ImagePoint, right: &ImagePoint, alike: f64) -> Result<Triangulated, TriangulationError> {
        for (camera, p) in [(CameraId::Left, left), (CameraId::Right, right)] {
            if !(p.uv.x.is_finite() && p.uv.y.is_finite() && p.sd.x > 0.0 && p.sd.y > 0.0 && p.sd.x.is_finite() && p.sd.y.is_finite()) {
                return Err(TriangulationError::BadPixel { camera, u: p.uv.x, v: p.uv.y, u_sd: p.sd.x, v_sd: p.sd.y });
            }
        }
        let mut x = self.midpoint(left.uv, right.uv)?;
        let weights = [left.sd, right.sd].map(|sd| Vector2::new(1.0 / (sd.x * sd.x), 1.0 / (sd.y * sd.y)));
        let (mut last_step, mut settled) = (f64::INFINITY, false);
        for _ in 0..50 {
            let (normal, gradient, _) = self.equations(&x, left, right, &weights)?;
            let step = normal.cholesky().ok_or(TriangulationError::NotConverged)?.solve(&gradient);
            x += step;
            let size = step.norm();
            if size < 1e-12 * (1.0 + x.coords.norm()) {
                settled = true;
                break;
            }
            if !size.is_finite() || size > 1e3 * last_step {
                return Err(TriangulationError::NotConverged);
            }
            last_step = size;
        }
        // Steps of rounding's size may go on for ever.
        if !settled && last_step > 1e-9 * (1.0 + x.coords.norm()) {
            return Err(TriangulationError::NotConverged);
        }
        let (normal, _, residuals) = self.equations(&x, left, right, &weights)?;
        let covariance = normal.try_inverse().ok_or(TriangulationError::NotConverged)?;
        let [(_, jl), (_, jr)] = self.seen(&x)?;
        let whitened = [(jl, left), (jr, right)].map(|(j, p)| Matrix2::from_diagonal(&p.sd.map(f64::recip)) * j);
        let covariance = with_errors_alike(&covariance, &whitened, alike);
        let r = self.global_from_left.rotation.to_rotation_matrix();
        let to_global = |c: Matrix3<f64>| {
            let g = r.matrix() * c * r.matrix().transpose();
            (g + g.transpose()) / 2.0
        };
        let chi2 = residuals.iter().zip(&weights).map(|(d, w)| d.x * d.x * w.x + d.y * d.y * w.y).sum();
        Ok(Triangulated {
            position: self.global_from_left * x,
            covariance: to_global(covariance),
            calibration_covariance: self.calibration.as_ref().and_then(|c| c.covariance(&x)).map(to_global),
            far_outside: self.allowed.is_some_and(|(low, high)| (0..3).any(|i| x[i] < low[i] || x[i] > high[i])),
            residual_px: (residuals.iter().map(|d| d.norm_squared()).sum::<f64>() / 2.0).sqrt(),
            chi2,
        })
    }

    /// Midpoint of the rays' closest approach, left camera's frame.
    fn midpoint(&self, left: Vector2<f64>, right: Vector2<f64>) -> Result<Point3<f64>, TriangulationError> {
        let ray = |id: CameraId, uv: Vector2<f64>| {
            let n = self.cameras[id.index()].normalise(uv).ok_or(TriangulationError::NotInvertible { camera: id, u: uv.x, v: uv.y })?;
            Ok(Vector3::new(n.x, n.y, 1.0).normalize())
        };
        let left_from_right = self.right_from_left.inverse();
        let d1 = ray(CameraId::Left, left)?;
        let d2 = left_from_right.rotation * ray(CameraId::Right, right)?;
        let origin2 = left_from_right.translation.vector;
        let (squared_sine, [s, t]) = nearest_approach(&origin2, &d1, &d2);
        let sine = squared_sine.max(0.0).sqrt();
        if sine < MIN_RAY_ANGLE {
            return Err(TriangulationError::ParallelRays { angle_rad: sine });
        }
        if s <= 0.0 {
            return Err(TriangulationError::BehindCamera { camera: CameraId::Left });
        }
        if t <= 0.0 {
            return Err(TriangulationError::BehindCamera { camera: CameraId::Right });
        }
        Ok(Point3::from((d1 * s + origin2 + d2 * t) / 2.0))
    }

    /// Normal matrix, gradient and residuals (seen minus predicted) at a point of the left camera's frame.
    fn equations(&self, x: &Point3<f64>, left: &ImagePoint, right: &ImagePoint, weights: &[Vector2<f64>; 2]) -> Result<Equations, TriangulationError> {
        let [(l, jl), (r, jr)] = self.seen(x)?;
        let (dl, dr) = (left.uv - l, right.uv - r);
        let mut normal = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        for (j, d, w) in [(jl, dl, weights[0]), (jr, dr, weights[1])] {
            let wj = Matrix2x3::from_rows(&[j.row(0) * w.x, j.row(1) * w.y]);
            normal += j.transpose() * wj;
            gradient += wj.transpose() * d;
        }
        Ok((normal, gradient, [dl, dr]))
    }

    /// Where either picture shows a point, and how that changes with it; left camera's frame.
    fn seen(&self, x: &Point3<f64>) -> Result<[(Vector2<f64>, Matrix2x3<f64>); 2], TriangulationError> {
        let behind = |camera| TriangulationError::BehindCamera { camera };
        let left = self.cameras[0].project_with_jacobian(x).ok_or(behind(CameraId::Left))?;
        let (uv, j) = self.cameras[1].project_with_jacobian(&(self.right_from_left * x)).ok_or(behind(CameraId::Right))?;
        Ok([left, (uv, j * self.right_from_left.rotation.to_rotation_matrix().matrix())])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::RigidTransform;
    use nalgebra::{Translation3, UnitQuaternion};

    fn rig() -> StereoRig {
        let camera =
            |fx: f64, k1| Camera { fx, fy: fx - 3.0, cx: 250.0, cy: 262.0, distortion: [k1, 1.5, 1e-3, -5e-4, 0.0], rms_px: 0.0, sd: Default::default() };
        let pose =
            RigidTransform::from_isometry(&Isometry3::from_parts(Translation3::new(-7.5, 0.1, 2.4), UnitQuaternion::from_euler_angles(0.02, 0.65, -0.03)));
        let global = Isometry3::from_parts(Translation3::new(11.0, 1.5, 4.0), UnitQuaternion::from_euler_angles(0.3, -1.2, 2.0));
        StereoRig {
            image_size: [512, 512],
            left: camera(2950.0, -0.5),
            right: camera(3080.0, 0.4),
            r: pose.r,
            t: pose.t,
            rms_stereo_px: 0.0,
            pairs: Vec::new(),
            square_mm: None,
            global_from_left: RigidTransform::from_isometry(&global),
            more: Default::default(),
        }
    }

    fn seen(rig: &StereoRig, p: &Point3<f64>, sd: f64) -> [ImagePoint; 2] {
        CameraId::BOTH.map(|id| ImagePoint { uv: rig.project(id, p).expect("in front"), sd: Vector2::new(sd, sd) })
    }

    #[test]
    fn truth_projected_points_come_back() {
        let rig = rig();
        let left = rig.global_from_left.isometry();
        for i in 0..27 {
            let p = left * Point3::new((i % 3) as f64 - 1.0, (i / 3 % 3) as f64 - 1.0, 11.0 + (i / 9) as f64);
            let [l, r] = seen(&rig, &p, 0.1);
            let t = triangulate(&rig, &l, &r).expect("well posed");
            assert!((t.position - p).norm() < 1e-9 && t.residual_px < 1e-9);
        }
    }

    #[test]
    fn law_noise_spreads_as_the_covariance_says() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, Normal};
        let rig = rig();
        let p = rig.global_from_left.isometry() * Point3::new(0.4, -0.3, 12.2);
        let [mut l, mut r] = seen(&rig, &p, 0.1);
        r.sd = Vector2::new(0.3, 0.05);
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let unit = Normal::new(0.0, 1.0).expect("valid");
        let (uv_l, uv_r) = (l.uv, r.uv);
        let n = 4000;
        let mut chi2_sum = 0.0;
        let mut mahalanobis = 0.0;
        for _ in 0..n {
            l.uv = uv_l + Vector2::new(unit.sample(&mut rng), unit.sample(&mut rng)).component_mul(&l.sd);
            r.uv = uv_r + Vector2::new(unit.sample(&mut rng), unit.sample(&mut rng)).component_mul(&r.sd);
            let t = triangulate(&rig, &l, &r).expect("well posed");
            let e = t.position - p;
            mahalanobis += e.dot(&(t.covariance.try_inverse().expect("positive") * e));
            chi2_sum += t.chi2;
        }
        // Means of 4000 chi-squared values with 3 and 1 degrees of freedom: sd 0.039 and 0.022.
        assert!((mahalanobis / n as f64 - 3.0).abs() < 0.16);
        assert!((chi2_sum / n as f64 - 1.0).abs() < 0.1);
    }

    #[test]
    fn agrees_the_share_of_the_calibration_is_that_of_points_csv() {
        let mut rig = rig();
        let left = rig.global_from_left.isometry();
        let rows: Vec<Vec<f64>> = (0..24).map(|i| (0..24).map(|j| if i == j { [0.5, 1e-6][usize::from(i >= 4)] } else { 0.0 }).collect()).collect();
        let reference: Vec<[f64; 3]> = (0..8).map(|i| [f64::from(i & 1), f64::from(i >> 1 & 1), 11.0 + f64::from(i >> 2)]).collect();
        rig.more.insert("covariance".into(), serde_json::json!({ "matrix": rows }));
        rig.more.insert("volume".into(), serde_json::json!({ "reference_points_m": reference }));
        let mut spread = crate::calibration::CalibrationSpread::of_rig(&rig);
        for near in [0.0, 0.3] {
            let p = left * Point3::new(near, 0.2, 11.4 + near);
            let [l, r] = seen(&rig, &p, 0.1);
            let t = triangulate(&rig, &l, &r).expect("well posed");
            let share = t.calibration_covariance.expect("a covariance is there").diagonal();
            let own = t.covariance.diagonal();
            let widened = spread.widen(&p, &own.map(f64::sqrt));
            assert!(share.min() > 0.0 && (widened.map(|v| v * v) - own - share).norm() < 1e-6 * (own + share).norm());
            // A hand's breadth further the same share is used.
            let beside = spread.widen(&(p + Vector3::new(0.03, 0.0, 0.0)), &Vector3::zeros());
            assert_eq!(beside, spread.widen(&p, &Vector3::zeros()));
        }
    }

    #[test]
    fn law_errors_alike_in_both_pictures_widen_the_height_and_narrow_the_depth() {
        let mut rig = rig();
        rig.global_from_left = RigidTransform::from_isometry(&Isometry3::identity());
        let [l, r] = seen(&rig, &Point3::new(0.1, 0.2, 11.4), 0.1);
        let space = Triangulator::new(&rig);
        let [alone, alike] = [0.0, 0.25].map(|c| space.triangulate_alike(&l, &r, c).expect("well posed"));
        let ratio = alike.covariance.diagonal().component_div(&alone.covariance.diagonal());
        assert_eq!(alone.position, alike.position);
        assert!((ratio.y - 1.25).abs() < 0.02 && ratio.z < 0.9 && alike.covariance.cholesky().is_some(), "{ratio}");
    }

    #[test]
    fn fails_parallel_rays_points_behind_and_bad_pixels() {
        let mut rig = rig();
        rig.r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        rig.right = rig.left.clone();
        rig.t = [-0.001, 0.0, 0.0];
        let at = |u: f64, v: f64| ImagePoint { uv: Vector2::new(u, v), sd: Vector2::new(0.1, 0.1) };
        assert!(matches!(triangulate(&rig, &at(250.0, 262.0), &at(250.0, 262.0)), Err(TriangulationError::ParallelRays { .. })));
        rig.t = [-7.0, 0.0, 0.0];
        assert!(matches!(triangulate(&rig, &at(100.0, 262.0), &at(400.0, 262.0)), Err(TriangulationError::BehindCamera { .. })));
        assert!(matches!(triangulate(&rig, &at(f64::NAN, 262.0), &at(400.0, 262.0)), Err(TriangulationError::BadPixel { .. })));
        let flat = ImagePoint { uv: Vector2::new(400.0, 262.0), sd: Vector2::new(0.0, 0.1) };
        assert!(matches!(triangulate(&rig, &at(100.0, 262.0), &flat), Err(TriangulationError::BadPixel { .. })));
    }
}
