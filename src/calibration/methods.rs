//! The other calibration methods of the thesis (section 2.6.2) on the same pictures: the direct linear transform with 11
//! parameters (Abdel-Aziz and Karara 1971), with 5 distortion terms besides, and the modified one that enforces orthogonal
//! image axes (Hatze 1988, 10 free parameters). Judged like figure 2.24: mean and largest error of lengths re-measured.
//!
//! Their control points are the corners of the boards that are not held out, at the places the joint adjustment gives them:
//! a control object more exact than anyone could build, so the differences are those of the methods alone.

use super::calibrator::Calibration;
use super::rays::midpoint;
use nalgebra::{DMatrix, DVector, Matrix3, Point3, SMatrix, Vector2, Vector3, Vector4};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A method and its error on boards it has not seen. `methods` in `calibration.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MethodError {
    pub method: String,
    /// Parameters per camera.
    pub parameters: usize,
    /// Mean and largest absolute error of distances between corners (neighbours and diagonals), mm.
    pub mean_error_mm: f64,
    pub max_error_mm: f64,
    /// Root-mean-square distance in the pictures it was fitted to, px.
    pub rms_px: f64,
    pub lengths: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Dlt,
    DltDistortion,
    Modified,
    ModifiedDistortion,
}

impl Kind {
    const ALL: [Kind; 4] = [Kind::Dlt, Kind::DltDistortion, Kind::Modified, Kind::ModifiedDistortion];

    fn name(self) -> &'static str {
        match self {
            Kind::Dlt => "DLT, 11 parameters",
            Kind::DltDistortion => "DLT, 11 parameters and 5 of distortion",
            Kind::Modified => "modified DLT, orthogonal",
            Kind::ModifiedDistortion => "modified DLT, orthogonal, 5 of distortion",
        }
    }

    fn parameters(self) -> usize {
        match self {
            Kind::Dlt => 11,
            Kind::DltDistortion => 16,
            Kind::Modified => 10,
            Kind::ModifiedDistortion => 15,
        }
    }
}

/// Coefficients L1 to L11 of `u = (L1 X + L2 Y + L3 Z + L4) / (L9 X + L10 Y + L11 Z + 1)` and the same for v, from control
/// points; `None` when they lie in a plane or are too few.
fn dlt_coefficients(points: &[Point3<f64>], pixels: &[Vector2<f64>]) -> Option<[f64; 11]> {
    if points.len() < 6 || points.len() != pixels.len() {
        return None;
    }
    let n = points.len() as f64;
    let middle = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n;
    let centre = pixels.iter().sum::<Vector2<f64>>() / n;
    let size = points.iter().map(|p| (p.coords - middle).norm()).sum::<f64>() / n;
    let spread = pixels.iter().map(|p| (p - centre).norm()).sum::<f64>() / n;
    if !(size > 1e-12 && spread > 1e-12) {
        return None;
    }
    let mut a = DMatrix::zeros(2 * points.len(), 12);
    for (i, (p, uv)) in points.iter().zip(pixels).enumerate() {
        let x = (p.coords - middle) / size;
        let u = (uv - centre) / spread;
        let row = [x.x, x.y, x.z, 1.0];
        for k in 0..4 {
            a[(2 * i, k)] = row[k];
            a[(2 * i, 8 + k)] = -u.x * row[k];
            a[(2 * i + 1, 4 + k)] = row[k];
            a[(2 * i + 1, 8 + k)] = -u.y * row[k];
        }
    }
    let eigen = (a.transpose() * &a).symmetric_eigen();
    let mut order: Vec<usize> = (0..12).collect();
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    // A second vanishing eigenvalue means that the points lie in a plane.
    if eigen.eigenvalues[order[1]] <= 1e-10 * eigen.eigenvalues[order[11]] {
        return None;
    }
    let h = eigen.eigenvectors.column(order[0]);
    let small = SMatrix::<f64, 3, 4>::from_fn(|i, j| h[4 * i + j]);
    let mut to_small = SMatrix::<f64, 4, 4>::identity() / size;
    to_small[(3, 3)] = 1.0;
    for k in 0..3 {
        to_small[(k, 3)] = -middle[k] / size;
    }
    let full = to_pixels(spread, &centre) * small * to_small;
    let w = full[(2, 3)];
    if w.abs() < 1e-12 * full.norm() {
        return None;
    }
    let l = full / w;
    let out = [l[(0, 0)], l[(0, 1)], l[(0, 2)], l[(0, 3)], l[(1, 0)], l[(1, 1)], l[(1, 2)], l[(1, 3)], l[(2, 0)], l[(2, 1)], l[(2, 2)]];
    out.iter().all(|v| v.is_finite()).then_some(out)
}

/// From coordinates about `centre` (px), in units of `scale` (px), to pixels.
fn to_pixels(scale: f64, centre: &Vector2<f64>) -> Matrix3<f64> {
    Matrix3::new(scale, 0.0, centre.x, 0.0, scale, centre.y, 0.0, 0.0, 1.0)
}

/// One camera of a method: a 3x4 matrix and distortion terms about its principal point.
#[derive(Debug, Clone)]
struct MethodCamera {
    matrix: SMatrix<f64, 3, 4>,
    centre: Vector2<f64>,
    scale: f64,
    /// Radial 1 to 3 and decentring 1, 2, in units of `scale`.
    distortion: [f64; 5],
}

impl MethodCamera {
    fn project(&self, p: &Point3<f64>) -> Option<Vector2<f64>> {
        let x = self.matrix * Vector4::new(p.x, p.y, p.z, 1.0);
        (x.z.abs() > 1e-12).then(|| {
            let ideal = Vector2::new(x.x / x.z, x.y / x.z);
            let d = (ideal - self.centre) / self.scale;
            let r2 = d.norm_squared();
            let [k1, k2, k3, p1, p2] = self.distortion;
            let radial = r2 * (k1 + r2 * (k2 + r2 * k3));
            let shift = Vector2::new(
                d.x * radial + 2.0 * p1 * d.x * d.y + p2 * (r2 + 2.0 * d.x * d.x),
                d.y * radial + p1 * (r2 + 2.0 * d.y * d.y) + 2.0 * p2 * d.x * d.y,
            );
            ideal + shift * self.scale
        })
    }

    /// From the free numbers of a method: 11 coefficients of a matrix in centred coordinates, or 10 of a camera (focal
    /// lengths, centre, rotation vector, shift), then the distortion.
    fn from_free(kind: Kind, free: &DVector<f64>, start: &MethodCamera) -> Self {
        let mut out = start.clone();
        let distortion_at = match kind {
            Kind::Dlt | Kind::DltDistortion => {
                let mut m = SMatrix::<f64, 3, 4>::zeros();
                for i in 0..11 {
                    m[(i / 4, i % 4)] = free[i];
                }
                m[(2, 3)] = 1.0;
                out.matrix = to_pixels(start.scale, &start.centre) * m;
                11
            }
            Kind::Modified | Kind::ModifiedDistortion => {
                let k = Matrix3::new(
                    free[0] * start.scale,
                    0.0,
                    start.centre.x + free[2] * start.scale,
                    0.0,
                    free[1] * start.scale,
                    start.centre.y + free[3] * start.scale,
                    0.0,
                    0.0,
                    1.0,
                );
                let r = nalgebra::Rotation3::from_scaled_axis(Vector3::new(free[4], free[5], free[6]));
                let mut pose = SMatrix::<f64, 3, 4>::zeros();
                pose.fixed_view_mut::<3, 3>(0, 0).copy_from(r.matrix());
                for i in 0..3 {
                    pose[(i, 3)] = free[7 + i];
                }
                out.matrix = k * pose;
                out.centre = Vector2::new(k[(0, 2)], k[(1, 2)]);
                10
            }
        };
        for (i, d) in out.distortion.iter_mut().enumerate() {
            *d = if distortion_at + i < free.len() { free[distortion_at + i] } else { 0.0 };
        }
        out
    }

    /// The free numbers of a method that stand for this camera, without distortion: what [`Self::from_free`] makes it of. `points`: some that it sees.
    fn to_free(&self, kind: Kind, points: &[Point3<f64>]) -> Option<DVector<f64>> {
        let (mut matrix, scale, middle) = (self.matrix, self.scale, self.centre);
        let mut free = DVector::zeros(kind.parameters());
        match kind {
            Kind::Dlt | Kind::DltDistortion => {
                matrix = to_pixels(scale, &middle).try_inverse()? * matrix;
                for i in 0..11 {
                    free[i] = matrix[(i / 4, i % 4)];
                }
            }
            Kind::Modified | Kind::ModifiedDistortion => {
                // Split the matrix into camera and pose (Hartley and Zisserman 2003, section 6.2.4), then forget the skew.
                if points.first().map(|p| (matrix * Vector4::new(p.x, p.y, p.z, 1.0)).z)? < 0.0 {
                    matrix = -matrix;
                }
                let m: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into_owned();
                let third: Vector3<f64> = m.row(2).transpose();
                let size = third.norm();
                let (a, b): (Vector3<f64>, Vector3<f64>) = (m.row(0).transpose() / size, m.row(1).transpose() / size);
                let r3 = third / size;
                let (cx, cy) = (a.dot(&r3), b.dot(&r3));
                let (fx, fy) = ((a - r3 * cx).norm(), (b - r3 * cy).norm());
                let rough = Matrix3::from_rows(&[((a - r3 * cx) / fx).transpose(), ((b - r3 * cy) / fy).transpose(), r3.transpose()]);
                let svd = rough.svd(true, true);
                let r = svd.u? * svd.v_t?;
                if r.determinant() < 0.0 {
                    return None;
                }
                let t: Vector3<f64> = Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0).try_inverse()? * matrix.column(3) / size;
                let turn = nalgebra::Rotation3::from_matrix_unchecked(r).scaled_axis();
                for (i, v) in
                    [fx / scale, fy / scale, (cx - middle.x) / scale, (cy - middle.y) / scale, turn.x, turn.y, turn.z, t.x, t.y, t.z].into_iter().enumerate()
                {
                    free[i] = v;
                }
            }
        }
        Some(free)
    }
}

/// Fits one camera of a method to control points by least squares in the picture (Gauss-Newton with damping).
fn fit_camera(kind: Kind, points: &[Point3<f64>], pixels: &[Vector2<f64>], image_size: [usize; 2]) -> Option<(MethodCamera, f64)> {
    let l = dlt_coefficients(points, pixels)?;
    let scale = image_size[0].max(image_size[1]) as f64;
    let middle = Vector2::new((image_size[0] as f64 - 1.0) / 2.0, (image_size[1] as f64 - 1.0) / 2.0);
    let matrix = SMatrix::<f64, 3, 4>::from_fn(|i, j| if (i, j) == (2, 3) { 1.0 } else { l[4 * i + j] });
    let start = MethodCamera { matrix, centre: middle, scale, distortion: [0.0; 5] };
    let mut free = start.to_free(kind, points)?;
    let n = free.len();
    let residuals = |free: &DVector<f64>| -> Option<DVector<f64>> {
        let camera = MethodCamera::from_free(kind, free, &start);
        let mut r = DVector::zeros(2 * points.len());
        for (i, (p, uv)) in points.iter().zip(pixels).enumerate() {
            let d = uv - camera.project(p)?;
            r[2 * i] = d.x;
            r[2 * i + 1] = d.y;
        }
        Some(r)
    };
    let mut r = residuals(&free)?;
    let mut damping = 1e-6;
    for _ in 0..60 {
        let mut j = DMatrix::zeros(r.len(), n);
        for k in 0..n {
            let h = 1e-6 * (1.0 + free[k].abs());
            let mut moved = free.clone();
            moved[k] += h;
            let up = residuals(&moved)?;
            moved[k] -= 2.0 * h;
            j.set_column(k, &((residuals(&moved)? - up) / (2.0 * h)));
        }
        let normal = j.transpose() * &j;
        let gradient = j.transpose() * &r;
        let mut better = None;
        while better.is_none() && damping < 1e9 {
            let mut damped = normal.clone();
            for k in 0..n {
                damped[(k, k)] *= 1.0 + damping;
            }
            better = damped
                .cholesky()
                .map(|c| &free + c.solve(&gradient))
                .and_then(|f| residuals(&f).map(|r| (f, r)))
                .filter(|(_, trial)| trial.norm_squared() < r.norm_squared());
            damping *= if better.is_some() { 0.1 } else { 10.0 };
        }
        let Some((next, next_r)) = better else { break };
        let gain = 1.0 - next_r.norm_squared() / r.norm_squared().max(1e-300);
        (free, r) = (next, next_r);
        if gain < 1e-10 {
            break;
        }
    }
    let rms = (r.norm_squared() / points.len() as f64).sqrt();
    Some((MethodCamera::from_free(kind, &free, &start), rms))
}

/// Least squares in both pictures from a start near the point.
fn intersect(cameras: &[MethodCamera; 2], uv: [Vector2<f64>; 2], start: &Point3<f64>) -> Option<Point3<f64>> {
    let mut p = *start;
    for _ in 0..20 {
        let mut j = SMatrix::<f64, 4, 3>::zeros();
        let mut r = Vector4::zeros();
        for c in 0..2 {
            let d = uv[c] - cameras[c].project(&p)?;
            (r[2 * c], r[2 * c + 1]) = (d.x, d.y);
            for k in 0..3 {
                let (mut a, mut b) = (p, p);
                a[k] += 1e-5;
                b[k] -= 1e-5;
                let slope = (cameras[c].project(&a)? - cameras[c].project(&b)?) / 2e-5;
                (j[(2 * c, k)], j[(2 * c + 1, k)]) = (slope.x, slope.y);
            }
        }
        let step = (j.transpose() * j).cholesky()?.solve(&(j.transpose() * r));
        p += step;
        if step.norm() < 1e-10 {
            break;
        }
    }
    Some(p)
}

impl Calibration {
    /// Every method on the same folds; the joint adjustment comes last. Empty with too few boards to hold any out.
    pub fn compare_methods(&self) -> Vec<MethodError> {
        let folds = self.folds();
        let lengths = |corners: &[Option<Point3<f64>>]| -> Vec<f64> {
            let stated = self.board.corners();
            let pairs = self.board.neighbours().into_iter().chain(self.board.diagonals());
            pairs.filter_map(|(i, j)| Some(1e3 * ((corners[i]? - corners[j]?).norm() - (stated[i] - stated[j]).norm()).abs())).collect()
        };
        let summary = |name: &str, parameters: usize, errors: Vec<f64>, rms: Vec<f64>| MethodError {
            method: name.to_owned(),
            parameters,
            mean_error_mm: errors.iter().sum::<f64>() / errors.len().max(1) as f64,
            max_error_mm: errors.iter().copied().fold(0.0, f64::max),
            rms_px: (rms.iter().map(|r| r * r).sum::<f64>() / rms.len().max(1) as f64).sqrt(),
            lengths: errors.len(),
        };
        let mut out: Vec<MethodError> = Kind::ALL
            .into_par_iter()
            .filter_map(|kind| {
                let (mut errors, mut rms) = (Vec::new(), Vec::new());
                for held_out in &folds {
                    let bundle = self.without(held_out)?;
                    let mut control = [(Vec::new(), Vec::new()), (Vec::new(), Vec::new())];
                    for v in bundle.views.iter().filter(|v| v.is_in_both()) {
                        for (side, corners) in control.iter_mut().zip([&v.left, &v.right]) {
                            for c in corners {
                                side.0.push(v.pose * bundle.corner(c.index));
                                side.1.push(c.uv);
                            }
                        }
                    }
                    let (left, rms_left) = fit_camera(kind, &control[0].0, &control[0].1, self.image_size)?;
                    let (right, rms_right) = fit_camera(kind, &control[1].0, &control[1].1, self.image_size)?;
                    rms.extend([rms_left, rms_right]);
                    let cameras = [left, right];
                    for &view in held_out {
                        let v = &self.bundle.views[view];
                        let mut corners = vec![None; self.board.corner_count()];
                        for l in &v.left {
                            if let Some(r) = v.right.iter().find(|r| r.index == l.index) {
                                let start = midpoint(&bundle.left, &bundle.right, &bundle.right_from_left, &[l.uv, r.uv]);
                                corners[l.index] = start.and_then(|s| intersect(&cameras, [l.uv, r.uv], &s));
                            }
                        }
                        errors.extend(lengths(&corners));
                    }
                }
                (!errors.is_empty()).then(|| summary(kind.name(), kind.parameters(), errors, rms))
            })
            .collect();
        if let Some(boards) = self.held_out_boards() {
            let errors = boards.iter().flat_map(|b| lengths(&b.corners)).collect();
            let parameters = self.model.free_parameters() / 2;
            out.push(summary("checkerboard, joint adjustment", parameters, errors, vec![self.rms_px(None)]));
        }
        out
    }
}

/// DLT coefficients of both cameras as DLTdv (version 8) and easyWand read them: 11 rows, one column per camera, for pixels
/// counted from (1, 1) in the upper left corner, in global axes (m).
///
/// The coefficients have no distortion terms: they belong to undistorted pixels.
pub fn dltdv_csv(rig: &super::StereoRig) -> Option<String> {
    use super::CameraId;
    let mut columns = Vec::new();
    for id in CameraId::BOTH {
        let c = rig.camera(id);
        let k = Matrix3::new(c.fx, 0.0, c.cx + 1.0, 0.0, c.fy, c.cy + 1.0, 0.0, 0.0, 1.0);
        let m = k * rig.camera_from_global(id).to_homogeneous().fixed_view::<3, 4>(0, 0);
        let w = m[(2, 3)];
        if w.abs() < 1e-9 {
            return None; // the global origin lies in the camera's plane: coefficients of this form do not exist
        }
        columns.push((0..11).map(|i| m[(i / 4, i % 4)] / w).collect::<Vec<f64>>());
    }
    Some((0..11).map(|i| format!("{:e},{:e}\n", columns[0][i], columns[1][i])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_camera_without_distortion_is_a_dlt() {
        let k = Matrix3::new(2000.0, 0.0, 300.0, 0.0, 1990.0, 200.0, 0.0, 0.0, 1.0);
        let pose = nalgebra::Isometry3::new(Vector3::new(0.1, -0.2, 8.0), Vector3::new(0.2, -0.4, 0.1)).to_homogeneous();
        let m = k * pose.fixed_view::<3, 4>(0, 0);
        let points: Vec<_> = (0..27).map(|i| Point3::new((i % 3) as f64 - 1.0, (i / 3 % 3) as f64 - 1.0, 0.7 * (i / 9) as f64)).collect();
        let pixels: Vec<_> = points
            .iter()
            .map(|p| {
                let x = m * Vector4::new(p.x, p.y, p.z, 1.0);
                Vector2::new(x.x / x.z, x.y / x.z)
            })
            .collect();
        let l = dlt_coefficients(&points, &pixels).expect("well posed");
        for i in 0..11 {
            assert!((l[i] - m[(i / 4, i % 4)] / m[(2, 3)]).abs() < 1e-6 * (1.0 + l[i].abs()), "{i}");
        }
        for kind in Kind::ALL {
            let (camera, rms) = fit_camera(kind, &points, &pixels, [640, 480]).expect("fits");
            assert!(rms < 1e-5, "{} {rms}", kind.name());
            assert!((camera.project(&points[5]).expect("in front") - pixels[5]).norm() < 1e-4);
        }
        let flat: Vec<_> = points.iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect();
        assert!(dlt_coefficients(&flat, &pixels).is_none());
    }
}
