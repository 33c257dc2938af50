//! Two rays and the point between them, and how the calibration's uncertainty moves that point.

use super::bundle::{SharedMatrix, pixel_derivatives};
use super::distortion::{ROTATION, SHARED, SHIFT};
use super::{Camera, StereoRig};
use nalgebra::{Isometry3, Matrix2x3, Matrix3, Matrix6, Point3, SMatrix, Vector2, Vector3};

/// Midpoint of the two rays' closest approach in the left camera's frame; `None` for parallel rays or behind a camera.
pub fn midpoint(left: &Camera, right: &Camera, right_from_left: &Isometry3<f64>, uv: &[Vector2<f64>; 2]) -> Option<Point3<f64>> {
    let left_from_right = right_from_left.inverse();
    let a = left.normalise(uv[0])?;
    let b = right.normalise(uv[1])?;
    let d1 = Vector3::new(a.x, a.y, 1.0).normalize();
    let d2 = (left_from_right.rotation * Vector3::new(b.x, b.y, 1.0)).normalize();
    let o2 = left_from_right.translation.vector;
    let (squared_sine, [s, t]) = nearest_approach(&o2, &d1, &d2);
    (squared_sine >= 1e-10 && s > 0.0 && t > 0.0).then(|| Point3::from((d1 * s + o2 + d2 * t) / 2.0))
}

/// Where two rays come nearest: the distances along unit directions `a`, from an origin, and `b`, from `base` beside it, and the squared sine of the
/// angle between them. Of nearly parallel rays the distances mean nothing.
pub fn nearest_approach(base: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> (f64, [f64; 2]) {
    let cosine = a.dot(b);
    let squared_sine = 1.0 - cosine * cosine;
    let (along_a, along_b) = (base.dot(a), base.dot(b));
    (squared_sine, [(along_a - cosine * along_b) / squared_sine, (cosine * along_a - along_b) / squared_sine])
}

type PointByShared = SMatrix<f64, 3, SHARED>;
type GaugeByShared = SMatrix<f64, 6, SHARED>;

/// How wrong a triangulated point may be because the calibration is not exact, apart from a common shift and turn of
/// everything.
///
/// The principal points of long lenses are uncertain by many pixels, but that turns the whole scene, and the global axes
/// are measured in the same turned scene. What is left after taking out the common shift and turn over the calibrated
/// volume is what distances, speeds and angles feel (the free-network adjustment of photogrammetry).
#[derive(Debug, Clone)]
pub struct CalibrationError3d {
    left: Camera,
    right: Camera,
    right_from_left: Isometry3<f64>,
    covariance: SharedMatrix,
    /// Symmetric square root of the covariance.
    root: SharedMatrix,
    middle: Point3<f64>,
    gauge: GaugeByShared,
    extent: (Point3<f64>, Point3<f64>),
}

impl CalibrationError3d {
    /// # Inputs  cameras and covariance of the calibration; `reference` points of the calibrated volume, left camera's frame
    pub fn new(left: &Camera, right: &Camera, right_from_left: &Isometry3<f64>, covariance: &SharedMatrix, reference: &[Point3<f64>]) -> Option<Self> {
        let n = reference.len() as f64;
        let middle = Point3::from(reference.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n.max(1.0));
        let bound = |pick: fn(f64, f64) -> f64| reference.iter().copied().reduce(|a, b| Point3::new(pick(a.x, b.x), pick(a.y, b.y), pick(a.z, b.z)));
        let extent = (bound(f64::min)?, bound(f64::max)?);
        let (left, right) = (left.clone(), right.clone());
        let eigen = ((covariance + covariance.transpose()) * 0.5).symmetric_eigen();
        let lengths = eigen.eigenvalues.map(|l| l.max(0.0).sqrt());
        let root = eigen.eigenvectors * SharedMatrix::from_diagonal(&lengths);
        let mut out =
            CalibrationError3d { left, right, right_from_left: *right_from_left, covariance: *covariance, root, middle, gauge: GaugeByShared::zeros(), extent };
        let mut normal = Matrix6::zeros();
        let mut sum = GaugeByShared::zeros();
        for p in reference {
            let moves = out.rigid(p);
            normal += moves.transpose() * moves;
            sum += moves.transpose() * out.sensitivity(p)?;
        }
        out.gauge = normal.cholesky()?.solve(&sum);
        Some(out)
    }

    /// From a rig that carries `covariance` and `volume`; `None` for one that does not (an imported calibration).
    pub fn of_rig(rig: &StereoRig) -> Option<Self> {
        let rows: Vec<Vec<f64>> = serde_json::from_value(rig.more.get("covariance")?.get("matrix")?.clone()).ok()?;
        let reference: Vec<[f64; 3]> = serde_json::from_value(rig.more.get("volume")?.get("reference_points_m")?.clone()).ok()?;
        if rows.len() != SHARED
            || rows.iter().any(|r| r.len() != SHARED || r.iter().any(|v| !v.is_finite()))
            || reference.len() < 3
            || reference.len() > 100_000
        {
            return None;
        }
        let covariance = SharedMatrix::from_fn(|i, j| rows[i][j]);
        let points: Vec<Point3<f64>> = reference.into_iter().map(Point3::from).collect();
        Self::new(&rig.left, &rig.right, &rig.right_from_left(), &covariance, &points)
    }

    /// Smallest and largest coordinates of the reference points, left camera's frame, m.
    pub fn extent(&self) -> (Point3<f64>, Point3<f64>) {
        self.extent
    }

    /// Covariance of a point from the calibration, left camera's frame, m². `None` behind a camera.
    pub fn covariance(&self, p: &Point3<f64>) -> Option<Matrix3<f64>> {
        let a = self.sensitivity(p)? - self.rigid(p) * self.gauge;
        let c = a * self.covariance * a.transpose();
        Some((c + c.transpose()) / 2.0)
    }

    /// How a point moves with the calibration's error, left camera's frame, m: one displacement per independent standard
    /// deviation of the calibration (the same ones for every point; their squares sum to [`Self::covariance`]). `None` behind
    /// a camera.
    pub fn displacements(&self, p: &Point3<f64>) -> Option<Vec<Vector3<f64>>> {
        let moved = (self.sensitivity(p)? - self.rigid(p) * self.gauge) * self.root;
        Some(moved.column_iter().map(|c| c.into_owned()).collect())
    }

    /// Variance of the distance between two points from the calibration, m² (shift and turn do not change distances).
    pub fn distance_variance(&self, a: &Point3<f64>, b: &Point3<f64>) -> Option<f64> {
        let along = (b - a).try_normalize(1e-12)?;
        let row = along.transpose() * (self.sensitivity(b)? - self.sensitivity(a)?);
        Some((row * self.covariance * row.transpose())[0].max(0.0))
    }

    /// Covariance of a point from pixel noise of one standard deviation `sd_px` per coordinate, m².
    pub fn pixel_covariance(&self, p: &Point3<f64>, sd_px: f64) -> Option<Matrix3<f64>> {
        let (j, _) = self.pixels(p)?;
        Some((j.transpose() * j).try_inverse()? * (sd_px * sd_px))
    }

    /// Moves of a point under small shifts and turns about the volume's middle.
    fn rigid(&self, p: &Point3<f64>) -> SMatrix<f64, 3, 6> {
        let mut m = SMatrix::<f64, 3, 6>::zeros();
        m.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        m.fixed_view_mut::<3, 3>(0, 3).copy_from(&-(p - self.middle).cross_matrix());
        m
    }

    /// Derivatives of the four pixel coordinates with respect to the point and to the shared parameters.
    fn pixels(&self, p: &Point3<f64>) -> Option<(SMatrix<f64, 4, 3>, SMatrix<f64, 4, SHARED>)> {
        let r = self.right_from_left.rotation.to_rotation_matrix().into_inner();
        let in_right = self.right_from_left * p;
        let zero = Vector2::zeros();
        let (l, d) = (pixel_derivatives(&self.left, p, zero)?, pixel_derivatives(&self.right, &in_right, zero)?);
        let mut j = SMatrix::<f64, 4, 3>::zeros();
        let mut h = SMatrix::<f64, 4, SHARED>::zeros();
        j.fixed_view_mut::<2, 3>(0, 0).copy_from(&l.point);
        let through: Matrix2x3<f64> = d.point * r;
        j.fixed_view_mut::<2, 3>(2, 0).copy_from(&through);
        h.fixed_view_mut::<2, 9>(0, 0).copy_from(&l.intrinsics);
        h.fixed_view_mut::<2, 9>(2, 9).copy_from(&d.intrinsics);
        h.fixed_view_mut::<2, 3>(2, ROTATION).copy_from(&(d.point * -(r * p.coords).cross_matrix()));
        h.fixed_view_mut::<2, 3>(2, SHIFT).copy_from(&d.point);
        Some((j, h))
    }

    /// Derivative of the triangulated point with respect to the shared parameters, pixels held.
    fn sensitivity(&self, p: &Point3<f64>) -> Option<PointByShared> {
        let (j, h) = self.pixels(p)?;
        Some(-((j.transpose() * j).try_inverse()? * j.transpose() * h))
    }
}
