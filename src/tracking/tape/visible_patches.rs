//! Where the visible patches of all five markers lie in both pictures at a pose, computed side by side: a search among things that look like
//! tape asks for them a hundred thousand times.

use crate::calibration::CameraId;
use crate::tracking::racket::racket_figure::{RacketFigure, VISIBLE_DEPTH};
use crate::tracking::racket::racket_pose::View;
use nalgebra::{Isometry3, Vector2};

/// Five markers in either picture, filled up to whole registers.
const WIDE: usize = 12;
/// One value for each of them.
type Wide = [f64; WIDE];

/// What does not change from pose to pose.
pub struct VisiblePatches {
    point: [Wide; 3],
    tube: [Wide; 3],
    /// From the tube's axis to the patch, m.
    depth: Wide,
    eye: [Wide; 3],
    /// Pose `camera_from_global`, row by row.
    rotation: [Wide; 9],
    shift: [Wide; 3],
    focal: [Wide; 2],
    centre: [Wide; 2],
    /// k1, k2, p1, p2, k3.
    distortion: [Wide; 5],
}

/// Fills a value of every marker in every picture; the last ones repeat the first marker's.
fn wide(of: impl Fn(CameraId, usize) -> f64) -> Wide {
    std::array::from_fn(|i| if i < 10 { of(CameraId::BOTH[i / 5], i % 5) } else { of(CameraId::Left, 0) })
}

impl VisiblePatches {
    pub fn of(view: &View, figure: &RacketFigure) -> Self {
        let camera = |c: CameraId| view.rig.camera(c);
        VisiblePatches {
            point: std::array::from_fn(|k| wide(|_, m| figure.points[m][k])),
            tube: std::array::from_fn(|k| wide(|_, m| figure.tube[m][k])),
            depth: wide(|_, m| VISIBLE_DEPTH * figure.tube_radius_m[m]),
            eye: std::array::from_fn(|k| wide(|c, _| view.eye(c)[k])),
            rotation: std::array::from_fn(|k| wide(|c, _| view.rotation(c)[(k / 3, k % 3)])),
            shift: std::array::from_fn(|k| wide(|c, _| view.shift(c)[k])),
            focal: [wide(|c, _| camera(c).fx), wide(|c, _| camera(c).fy)],
            centre: [wide(|c, _| camera(c).cx), wide(|c, _| camera(c).cy)],
            distortion: std::array::from_fn(|k| wide(|c, _| camera(c).distortion[k])),
        }
    }

    /// By camera and marker, px; not a number behind the camera.
    pub fn at(&self, global_from_racket: &Isometry3<f64>) -> [[Vector2<f64>; 5]; 2] {
        let [u, v] = pulp::Arch::new().dispatch(At { patches: self, global_from_racket });
        std::array::from_fn(|c| std::array::from_fn(|m| Vector2::new(u[5 * c + m], v[5 * c + m])))
    }
}

struct At<'a> {
    patches: &'a VisiblePatches,
    global_from_racket: &'a Isometry3<f64>,
}

impl pulp::NullaryFnOnce for At<'_> {
    type Output = [Wide; 2];

    #[inline(always)]
    fn call(self) -> [Wide; 2] {
        let p = self.patches;
        let turn = *self.global_from_racket.rotation.to_rotation_matrix().matrix();
        let origin = self.global_from_racket.translation.vector;
        let (mut u, mut v) = ([0.0; WIDE], [0.0; WIDE]);
        for i in 0..WIDE {
            let turned = |of: &[Wide; 3], k: usize| turn[(k, 0)] * of[0][i] + turn[(k, 1)] * of[1][i] + turn[(k, 2)] * of[2][i];
            // On the tube's axis; then on its side toward the camera, as in `RacketFigure::patch_in_global`.
            let at: [f64; 3] = std::array::from_fn(|k| turned(&p.point, k) + origin[k]);
            let axis: [f64; 3] = std::array::from_fn(|k| turned(&p.tube, k));
            let toward: [f64; 3] = std::array::from_fn(|k| p.eye[k][i] - at[k]);
            let product = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let far = 1.0 / product(&toward, &toward).sqrt();
            let along = product(&toward, &axis) * far;
            let across: [f64; 3] = std::array::from_fn(|k| toward[k] * far - along * axis[k]);
            let out = p.depth[i] / product(&across, &across).sqrt().max(1e-6);
            let patch: [f64; 3] = std::array::from_fn(|k| at[k] + out * across[k]);
            let [x, y, z]: [f64; 3] = std::array::from_fn(|k| {
                p.rotation[3 * k][i] * patch[0] + p.rotation[3 * k + 1][i] * patch[1] + p.rotation[3 * k + 2][i] * patch[2] + p.shift[k][i]
            });
            let [k1, k2, p1, p2, k3] = std::array::from_fn(|k| p.distortion[k][i]);
            let nearer = if z > 1e-9 { 1.0 / z } else { f64::NAN };
            let (x, y) = (x * nearer, y * nearer);
            let r2 = x * x + y * y;
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            u[i] = p.focal[0][i] * (x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)) + p.centre[0][i];
            v[i] = p.focal[1][i] * (y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y) + p.centre[1][i];
        }
        [u, v]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::racket::racket_figure::tests::figure;
    use crate::tracking::racket::racket_pose::tests::rig;
    use nalgebra::{Translation3, UnitQuaternion};

    #[test]
    fn agrees_side_by_side_patches_lie_where_each_does_alone() {
        let (rig, figure) = (rig(), figure());
        let view = View::new(&rig);
        let patches = VisiblePatches::of(&view, &figure);
        for k in 0..40 {
            let turn = UnitQuaternion::from_euler_angles(0.7 * f64::from(k), 0.3 - 0.4 * f64::from(k), 0.2 * f64::from(k));
            let pose = Isometry3::from_parts(Translation3::new(0.05 * f64::from(k % 9) - 0.2, 0.9, 0.04 * f64::from(k % 7)), turn);
            let together = patches.at(&pose);
            for (camera, seen) in CameraId::BOTH.into_iter().zip(together) {
                for (marker, uv) in seen.iter().enumerate() {
                    let alone = view.patch(camera, &figure, marker, &pose).expect("in front");
                    assert!((uv - alone).norm() < 1e-9, "{k} {marker}: {uv} {alone}");
                }
            }
        }
        // Behind both cameras nothing is seen.
        let eye = view.eye(CameraId::Left).coords + view.eye(CameraId::Right).coords;
        let behind = Isometry3::translation(eye.x, eye.y, eye.z);
        assert!(patches.at(&behind).iter().flatten().all(|uv| uv.x.is_nan()));
    }
}
