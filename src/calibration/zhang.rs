//! A first guess of one camera from homographies of a plane (Zhang 2000, section 3.1, with zero skew and the principal
//! point at the picture's centre), and of a board's pose. The bundle adjustment starts here.

use super::Camera;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;

/// Focal lengths from the homographies of at least one tilted view; the principal point stays at the centre.
///
/// With a long lens and few tilts the closed form may have no real answer: then the focal length is searched on a
/// logarithmic grid for the value with which the homographies come nearest to rotations.
pub fn first_camera(homographies: &[Matrix3<f64>], image_size: [usize; 2]) -> Option<Camera> {
    let (cx, cy) = ((image_size[0] as f64 - 1.0) / 2.0, (image_size[1] as f64 - 1.0) / 2.0);
    let centred: Vec<Matrix3<f64>> = homographies.iter().map(|h| Matrix3::new(1.0, 0.0, -cx, 0.0, 1.0, -cy, 0.0, 0.0, 1.0) * h).collect();
    if centred.is_empty() {
        return None;
    }
    let (fx, fy) = closed_form(&centred).filter(|&(fx, fy)| plausible(fx, fy, image_size)).or_else(|| searched(&centred, image_size))?;
    Some(Camera { fx, fy, cx, cy, distortion: [0.0; 5], rms_px: 0.0, sd: BTreeMap::new() })
}

fn plausible(fx: f64, fy: f64, image_size: [usize; 2]) -> bool {
    let side = image_size[0].max(image_size[1]) as f64;
    let range = 0.2 * side..200.0 * side;
    range.contains(&fx) && range.contains(&fy) && (fx / fy).abs().ln().abs() < 0.3
}

/// Zhang's two equations per view in 1/fx² and 1/fy².
fn closed_form(centred: &[Matrix3<f64>]) -> Option<(f64, f64)> {
    let mut a = DMatrix::zeros(2 * centred.len(), 2);
    let mut b = DVector::zeros(2 * centred.len());
    for (i, h) in centred.iter().enumerate() {
        // Vanishing points of the board's axes and of their bisectors, scaled to even weight (as in Bouguet's toolbox).
        let (mut h1, mut h2): (Vector3<f64>, Vector3<f64>) = (h.column(0).into(), h.column(1).into());
        let (mut d1, mut d2) = ((h1 + h2) * 0.5, (h1 - h2) * 0.5);
        for v in [&mut h1, &mut h2, &mut d1, &mut d2] {
            *v /= v.norm();
        }
        a[(2 * i, 0)] = h1.x * h2.x;
        a[(2 * i, 1)] = h1.y * h2.y;
        b[2 * i] = -h1.z * h2.z;
        a[(2 * i + 1, 0)] = d1.x * d2.x;
        a[(2 * i + 1, 1)] = d1.y * d2.y;
        b[2 * i + 1] = -d1.z * d2.z;
    }
    let x = a.svd(true, true).solve(&b, 1e-14).ok()?;
    (x[0] > 0.0 && x[1] > 0.0).then(|| (1.0 / x[0].sqrt(), 1.0 / x[1].sqrt()))
}

/// One focal length for both axes, by how nearly `K⁻¹ H` has two columns of equal length at right angles.
fn searched(centred: &[Matrix3<f64>], image_size: [usize; 2]) -> Option<(f64, f64)> {
    let side = image_size[0].max(image_size[1]) as f64;
    let miss = |f: f64| -> f64 {
        centred
            .iter()
            .map(|h| {
                let a = Vector3::new(h[(0, 0)] / f, h[(1, 0)] / f, h[(2, 0)]);
                let b = Vector3::new(h[(0, 1)] / f, h[(1, 1)] / f, h[(2, 1)]);
                let scale = a.norm_squared() + b.norm_squared();
                (a.dot(&b) / scale).powi(2) + ((a.norm_squared() - b.norm_squared()) / scale).powi(2)
            })
            .sum()
    };
    let best = (0..=200).map(|i| 0.3 * side * 500f64.powf(i as f64 / 200.0)).min_by(|x, y| miss(*x).total_cmp(&miss(*y)))?;
    Some((best, best))
}

/// Pose `camera_from_board` from a homography and the camera's focal lengths (Zhang 2000, equation 3 and appendix C).
pub fn board_pose(h: &Matrix3<f64>, camera: &Camera) -> Option<Isometry3<f64>> {
    let k = Matrix3::new(camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0);
    let m = k.try_inverse()? * h;
    let (a, b): (Vector3<f64>, Vector3<f64>) = (m.column(0).into(), m.column(1).into());
    let mut scale = 2.0 / (a.norm() + b.norm());
    if m[(2, 2)] * scale < 0.0 {
        scale = -scale; // the board is in front of the camera
    }
    let (r1, r2) = (a * scale, b * scale);
    let rough = Matrix3::from_columns(&[r1, r2, r1.cross(&r2)]);
    let svd = rough.svd(true, true);
    let (u, vt) = (svd.u?, svd.v_t?);
    let r = u * vt;
    let r = if r.determinant() < 0.0 { u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0)) * vt } else { r };
    let t: Vector3<f64> = m.column(2) * scale;
    let pose = Isometry3::from_parts(Translation3::from(t), UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r)));
    (t.z > 0.0 && t.norm().is_finite()).then_some(pose)
}

#[cfg(test)]
mod tests {
    use super::super::homography::homography;
    use super::*;
    use nalgebra::{Point3, Vector2};

    #[test]
    fn truth_noise_free_views_give_the_camera_and_the_poses() {
        let camera = Camera { fx: 3000.0, fy: 2950.0, cx: 255.5, cy: 255.5, distortion: [0.0; 5], rms_px: 0.0, sd: BTreeMap::new() };
        let board: Vec<_> = (0..54).map(|i| Point3::new((i % 9) as f64 * 0.06, (i / 9) as f64 * 0.06, 0.0)).collect();
        let poses: Vec<_> = [(0.5, 0.1, 0.2), (-0.4, 0.5, 1.0), (0.3, -0.6, -0.3)]
            .iter()
            .map(|&(a, b, c)| Isometry3::from_parts(Translation3::new(0.1 * a, -0.2 * b, 12.0), UnitQuaternion::from_euler_angles(a, b, c)))
            .collect();
        let hs: Vec<_> = poses
            .iter()
            .map(|pose| {
                let pixels: Vec<Vector2<f64>> = board.iter().map(|p| camera.project(&(pose * p)).expect("in front")).collect();
                homography(&board, &pixels).expect("well posed")
            })
            .collect();
        let found = first_camera(&hs, [512, 512]).expect("found");
        assert!((found.fx - 3000.0).abs() < 0.01 && (found.fy - 2950.0).abs() < 0.01, "{found:?}");
        for (h, pose) in hs.iter().zip(&poses) {
            let p = board_pose(h, &found).expect("in front");
            assert!((p.translation.vector - pose.translation.vector).norm() < 1e-3);
            assert!(p.rotation.angle_to(&pose.rotation) < 1e-4);
        }
    }
}
