//! The global axes from the three-sphere frame: corner sphere = origin, the arms along U and W, V = W x U.

use super::sphere::{SphereImage, SphereShape, Spot, bright_spots, fit_sphere};
use super::{CalibrationError, CameraId, RigidTransform, StereoRig, rays};
use crate::footage::GreyImage;
use crate::median::median;
use nalgebra::{Isometry3, Matrix2x3, Matrix3, Matrix6, Point3, Rotation3, SMatrix, Translation3, UnitQuaternion, Vector2, Vector3, Vector6};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Measured lengths of the frame's arms between sphere centres, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxesFrame {
    pub arm_u_m: f64,
    pub arm_w_m: f64,
}

/// The axes with what was seen of the frame, for `calibration.json` (`axes`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxesReport {
    /// Angle between the measured arms minus 90 degrees.
    pub orthogonality_error_deg: f64,
    pub orthogonality_sd_deg: f64,
    /// Measured lengths of the arms, mm, to be compared with the stated ones.
    pub arm_u_mm: f64,
    pub arm_w_mm: f64,
    pub arm_sd_mm: f64,
    /// Radius of the spheres, mm.
    pub sphere_radius_mm: f64,
    /// Root-mean-square distance between seen and predicted sphere centres, px.
    pub rms_px: f64,
    /// Centres of corner, U and W sphere in each picture, px.
    pub left_px: [[f64; 2]; 3],
    pub right_px: [[f64; 2]; 3],
    pub warnings: Vec<String>,
}

/// Mean square of the spheres' misses over their deviations beyond which something moved: good sessions stay below 7.
const UNLIKELY_CHI2: f64 = 16.0;
/// And the angle off the square beyond which what was found is no frame, degrees: a workshop's square is good to a tenth.
const NO_FRAME_DEG: f64 = 2.0;

/// Where the spheres of the frame lie in its own axes, m.
fn frame_points(frame: &AxesFrame) -> [Point3<f64>; 3] {
    [Point3::origin(), Point3::new(frame.arm_u_m, 0.0, 0.0), Point3::new(0.0, 0.0, frame.arm_w_m)]
}

/// The outline of a sphere is not centred on its centre's picture: it is centred where the point `(X, Y, Z - r²/Z)` falls
/// (the ellipse cut from the tangent cone; exact before distortion).
fn outline_point(p: &Point3<f64>, radius_m: f64) -> Point3<f64> {
    Point3::new(p.x, p.y, p.z - radius_m * radius_m / p.z)
}

fn axes_error(what: impl Into<String>) -> CalibrationError {
    CalibrationError::Axes { what: what.into() }
}

/// Finds the frame in both pictures and lays the global axes.
///
/// # Returns  `global_from_left` with its standard deviations (picture noise only), and the report
/// # Errors  [`CalibrationError::Axes`] when no three bright spots of both pictures have the frame's shape
pub fn global_axes(rig: &StereoRig, left: &GreyImage, right: &GreyImage, frame: &AxesFrame) -> Result<(RigidTransform, AxesReport), CalibrationError> {
    for (image, name) in [(left, "left"), (right, "right")] {
        if [image.width, image.height] != rig.image_size {
            let (w, h, want) = (image.width, image.height, rig.image_size);
            return Err(axes_error(format!("{name} is {w}x{h} px, the boards are {}x{}; take them with the same setting", want[0], want[1])));
        }
    }
    let spots: [Vec<Spot>; 2] = rayon::join(|| bright_spots(left), || bright_spots(right)).into();
    let triple = frame_among_spots(rig, &spots, frame)?;
    // Centres to a small part of a pixel: first every sphere by itself, then with what the spheres have in common, the
    // radius in m and in each picture the blur and the light. Where a sphere is as dark as what is behind it, only that
    // tells where its outline is.
    let images = [left, right];
    let fit = |sphere: usize, camera: usize, shape: Option<&SphereShape>| {
        let spot = &spots[camera][triple[sphere][camera]];
        fit_sphere(images[camera], spot, shape).ok_or_else(|| {
            let (at, name) = (&spot.centre, CameraId::BOTH[camera].name());
            axes_error(format!(
                "the sphere at ({:.0}, {:.0}) of the {name} picture cannot be fitted: its outline is not told from what is behind it; take the frame's pictures again with light from the cameras' side or before a ground of another grey",
                at.x, at.y
            ))
        })
    };
    let both = |sphere: usize| {
        let (left, right) = rayon::join(|| fit(sphere, 0, None), || fit(sphere, 1, None));
        Ok([left?, right?])
    };
    let mut seen: Vec<[SphereImage; 2]> = (0..3).into_par_iter().map(both).collect::<Result<_, CalibrationError>>()?;
    let mut radius_m = 0.0;
    for _ in 0..2 {
        let mut depths = [[0.0; 2]; 3];
        for (depth, s) in depths.iter_mut().zip(&seen) {
            let p = midpoint(rig, &[s[0].centre, s[1].centre]).ok_or_else(|| axes_error("the rays to a sphere do not meet"))?;
            *depth = [p.z, (rig.right_from_left() * p).z];
        }
        let px_per_m = |sphere: usize, camera: usize| rig.camera(CameraId::BOTH[camera]).fx / depths[sphere][camera];
        if radius_m == 0.0 {
            let radii = (0..6).map(|k| seen[k / 2][k % 2].shape.radius_px / px_per_m(k / 2, k % 2));
            radius_m = median(radii).unwrap_or(0.0);
        }
        let shared: [SphereShape; 2] = [0, 1].map(|camera| {
            let of = |value: fn(&SphereShape) -> f64| median(seen.iter().map(|s| value(&s[camera].shape))).unwrap_or(0.0);
            SphereShape { radius_px: 0.0, blur_px: of(|s| s.blur_px), shading: [of(|s| s.shading[0]), of(|s| s.shading[1]), of(|s| s.shading[2])] }
        });
        seen.par_iter_mut().enumerate().for_each(|(sphere, pictures)| {
            for (camera, picture) in pictures.iter_mut().enumerate() {
                let shape = SphereShape { radius_px: radius_m * px_per_m(sphere, camera), ..shared[camera] };
                if let Ok(better) = fit(sphere, camera, Some(&shape)) {
                    *picture = better;
                }
            }
        });
    }
    let centres = [0, 1, 2].map(|i| [0, 1].map(|c| seen[i][c].centre));
    // Rods and uneven light leave about 0.03 px that the fit's own spread does not show.
    let sds = [0, 1, 2].map(|i| [0, 1].map(|c| seen[i][c].sd.map(|v| v.hypot(0.03))));
    lay_axes(rig, &centres, &sds, radius_m, frame)
}

/// Indices `[sphere][camera]` of the three spots that have the frame's shape.
fn frame_among_spots(rig: &StereoRig, spots: &[Vec<Spot>; 2], frame: &AxesFrame) -> Result<[[usize; 2]; 3], CalibrationError> {
    struct Candidate {
        at: [usize; 2],
        p: Point3<f64>,
        miss_px: f64,
        contrast: f64,
    }
    let mut candidates = Vec::new();
    let to_right = rig.right_from_left();
    for (i, l) in spots[0].iter().enumerate() {
        for (j, r) in spots[1].iter().enumerate() {
            let Some(p) = midpoint(rig, &[l.centre, r.centre]) else { continue };
            let (Some(a), Some(b)) = (rig.left.project(&p), rig.right.project(&(to_right * p))) else { continue };
            // Spots are centred to a pixel or two before the fit, so the limit is wide; the frame's shape decides.
            let miss_px = (a - l.centre).norm().max((b - r.centre).norm());
            if miss_px < 1.5 + 0.4 * l.radius_px.min(r.radius_px) {
                candidates.push(Candidate { at: [i, j], p, miss_px, contrast: l.contrast.min(r.contrast) });
            }
        }
    }
    candidates.sort_by(|a, b| b.contrast.total_cmp(&a.contrast).then(a.at.cmp(&b.at)));
    candidates.truncate(400);
    let (u, w) = (frame.arm_u_m, frame.arm_w_m);
    let hypotenuse = u.hypot(w);
    let allowed = 0.04 * hypotenuse;
    let mut best: Option<(f64, [[usize; 2]; 3])> = None;
    for c in &candidates {
        for e in candidates.iter().filter(|e| ((e.p - c.p).norm() - u).abs() < allowed && distinct(c.at, e.at)) {
            for f in candidates.iter().filter(|f| ((f.p - c.p).norm() - w).abs() < allowed && distinct(c.at, f.at) && distinct(e.at, f.at)) {
                let off = [(e.p - c.p).norm() - u, (f.p - c.p).norm() - w, (e.p - f.p).norm() - hypotenuse];
                if off.iter().any(|d| d.abs() > allowed) {
                    continue;
                }
                let shape: f64 = off.iter().map(|d| (d / (0.01 * hypotenuse)).powi(2)).sum();
                let rays: f64 = [c, e, f].iter().map(|s| s.miss_px.powi(2)).sum();
                let brightness: f64 = [c, e, f].iter().map(|s| s.contrast).fold(f64::INFINITY, f64::min);
                let cost = shape + rays - 4.0 * (brightness / MIN_BRIGHTNESS).ln();
                if best.is_none_or(|(b, _)| cost < b) {
                    best = Some((cost, [c.at, e.at, f.at]));
                }
            }
        }
    }
    best.map(|b| b.1).ok_or_else(|| {
        axes_error(format!(
            "no three of {} and {} bright spots are {u:.3} m and {w:.3} m apart at a right angle; check arm_u_m, arm_w_m and square_m, and that all three spheres are in both pictures",
            spots[0].len(),
            spots[1].len()
        ))
    })
}

/// Grey levels above the surroundings that make a spot neither likely nor unlikely to be a sphere.
const MIN_BRIGHTNESS: f64 = 20.0;

fn distinct(a: [usize; 2], b: [usize; 2]) -> bool {
    a[0] != b[0] && a[1] != b[1]
}

fn midpoint(rig: &StereoRig, uv: &[Vector2<f64>; 2]) -> Option<Point3<f64>> {
    rays::midpoint(&rig.left, &rig.right, &rig.right_from_left(), uv)
}

/// Maximum-likelihood pose of the frame from its six outline centres, by Gauss-Newton on `global_from_left`.
fn lay_axes(
    rig: &StereoRig,
    centres: &[[Vector2<f64>; 2]; 3],
    sds: &[[Vector2<f64>; 2]; 3],
    radius_m: f64,
    frame: &AxesFrame,
) -> Result<(RigidTransform, AxesReport), CalibrationError> {
    let mut measured = [Point3::origin(); 3];
    for (m, uv) in measured.iter_mut().zip(centres) {
        *m = midpoint(rig, uv).ok_or_else(|| axes_error("the rays to a sphere do not meet"))?;
    }
    let (pose, normal, chi2) = fit_frame(rig, centres, sds, radius_m, frame, &measured).ok_or_else(|| axes_error("the frame's pose does not settle"))?;
    let covariance = normal.try_inverse().ok_or_else(|| axes_error("the frame's pose is not determined"))? * (chi2 / 6.0).max(1.0);
    let mut out = RigidTransform::from_isometry(&pose);
    out.sd.insert("rotation_rad".into(), [0, 1, 2].map(|i| covariance[(i, i)].max(0.0).sqrt()));
    out.sd.insert("t_m".into(), [3, 4, 5].map(|i| covariance[(i, i)].max(0.0).sqrt()));

    let (u, w) = (measured[1] - measured[0], measured[2] - measured[0]);
    let angle = u.angle(&w).to_degrees();
    // Depth is the weakest direction of two cameras: the spread of a sphere's place from its rays' noise.
    let spread = sphere_spread(rig, &measured[0], sds[0]).unwrap_or(0.0);
    let orthogonality_sd_deg = (spread * (1.0 / u.norm().powi(2) + 1.0 / w.norm().powi(2)).sqrt()).to_degrees();
    let arm_sd = spread * std::f64::consts::SQRT_2;
    let mut warnings = Vec::new();
    if (angle - 90.0).abs() > 3.0 * orthogonality_sd_deg + 0.1 {
        warnings.push(format!("the arms of the frame meet at {angle:.2} degrees instead of 90"));
    }
    for (name, seen, stated) in [("arm_u_m", u.norm(), frame.arm_u_m), ("arm_w_m", w.norm(), frame.arm_w_m)] {
        if (seen - stated).abs() > 3.0 * arm_sd + 0.002 * stated {
            warnings.push(format!("{name} is {stated:.4} m in session.toml and {seen:.4} m in the pictures"));
        }
    }
    let scales = [u.norm() / frame.arm_u_m, w.norm() / frame.arm_w_m];
    let measured_scale = 0.5 * (scales[0] + scales[1]);
    let both_off_alike = (scales[0] - scales[1]).abs() < 0.5 * (measured_scale - 1.0).abs();
    let mut squares = 0.0;
    for (sphere, uv) in frame_points(frame).iter().zip(centres) {
        for id in CameraId::BOTH {
            let seen = predicted(rig, &pose, sphere, id, radius_m).ok_or_else(|| axes_error("the frame lies behind a camera"))?;
            squares += (seen.0 - uv[id.index()]).norm_squared();
        }
    }
    if (measured_scale - 1.0).abs() > 0.002 && (measured_scale - 1.0).abs() > 3.0 * arm_sd / (frame.arm_u_m.hypot(frame.arm_w_m)) && both_off_alike {
        warnings.push(format!(
            "both arms come out {:.2} % {}: square_m of session.toml (or the printed board) is off by as much, and with it every length and speed",
            100.0 * (measured_scale - 1.0).abs(),
            if measured_scale > 1.0 { "too long" } else { "too short" }
        ));
    }
    // Six centres of two coordinates, six numbers of the pose.
    if chi2 / 6.0 > UNLIKELY_CHI2 && (angle - 90.0).abs() > NO_FRAME_DEG {
        return Err(axes_error(format!(
            "what was found in the place of the frame's spheres meets at {angle:.1} degrees and lies {:.1} px from where the frame's shape puts it: it is no frame of two square arms; see that no sphere is hidden, and that nothing beside them looks like one",
            (squares / 6.0).sqrt()
        )));
    }
    if chi2 / 6.0 > UNLIKELY_CHI2 {
        warnings.push(format!(
            "the spheres lie {:.2} px from where the frame's shape puts them, {:.0} times what their outlines are good to: a camera moved between the boards and the frame, the frame's lengths are wrong, or the boards were not where the frame stands",
            (squares / 6.0).sqrt(),
            (chi2 / 6.0).sqrt()
        ));
    }
    if let [Some(true), Some(true)] = CameraId::BOTH.map(|id| points_down(rig, &pose, id)) {
        warnings.push(
            "V, which is up, points down in both pictures: arm_u_m and arm_w_m are exchanged, the pictures are mirrored, or both cameras stood on their heads"
                .to_owned(),
        );
    }
    let report = AxesReport {
        orthogonality_error_deg: angle - 90.0,
        orthogonality_sd_deg,
        arm_u_mm: 1e3 * u.norm(),
        arm_w_mm: 1e3 * w.norm(),
        arm_sd_mm: 1e3 * arm_sd,
        sphere_radius_mm: 1e3 * radius_m,
        rms_px: (squares / 6.0).sqrt(),
        left_px: [0, 1, 2].map(|i| centres[i][0].into()),
        right_px: [0, 1, 2].map(|i| centres[i][1].into()),
        warnings,
    };
    Ok((out, report))
}

/// Whether the V axis runs down one camera's picture more than across it. `None` where its end cannot be seen.
fn points_down(rig: &StereoRig, pose: &Isometry3<f64>, id: CameraId) -> Option<bool> {
    let at = |v: f64| predicted(rig, pose, &Point3::new(0.0, v, 0.0), id, 0.0).map(|p| p.0);
    let up = at(0.1)? - at(0.0)?;
    Some(up.y > up.x.abs())
}

/// Pixel of the outline centre of a sphere of the frame, and its derivative with respect to the point in the left camera's frame.
fn predicted(rig: &StereoRig, pose: &Isometry3<f64>, sphere: &Point3<f64>, id: CameraId, radius_m: f64) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
    outline_centre(rig, &(pose.inverse() * sphere), id, radius_m)
}

/// The same for a sphere in the left camera's frame.
fn outline_centre(rig: &StereoRig, in_left: &Point3<f64>, id: CameraId, radius_m: f64) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
    match id {
        CameraId::Left => rig.left.project_with_jacobian(&outline_point(in_left, radius_m)),
        CameraId::Right => {
            let to_right = rig.right_from_left();
            let (uv, j) = rig.right.project_with_jacobian(&outline_point(&(to_right * in_left), radius_m))?;
            Some((uv, j * to_right.rotation.to_rotation_matrix().matrix()))
        }
    }
}

fn fit_frame(
    rig: &StereoRig,
    centres: &[[Vector2<f64>; 2]; 3],
    sds: &[[Vector2<f64>; 2]; 3],
    radius_m: f64,
    frame: &AxesFrame,
    measured: &[Point3<f64>; 3],
) -> Option<(Isometry3<f64>, Matrix6<f64>, f64)> {
    let u = (measured[1] - measured[0]).normalize();
    let arm_w = measured[2] - measured[0];
    let w = (arm_w - u * u.dot(&arm_w)).normalize();
    let r = Matrix3::from_rows(&[u.transpose(), w.cross(&u).transpose(), w.transpose()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
    let mut pose = Isometry3::from_parts(Translation3::from(-(rotation * measured[0].coords)), rotation);
    for _ in 0..30 {
        let mut normal = Matrix6::zeros();
        let mut gradient = Vector6::zeros();
        let mut chi2 = 0.0;
        let back = pose.rotation.to_rotation_matrix().matrix().transpose();
        for (i, sphere) in frame_points(frame).iter().enumerate() {
            for id in CameraId::BOTH {
                let (uv, j) = predicted(rig, &pose, sphere, id, radius_m)?;
                let arm = sphere.coords - pose.translation.vector;
                let mut d = SMatrix::<f64, 2, 6>::zeros();
                d.fixed_view_mut::<2, 3>(0, 0).copy_from(&(j * back * arm.cross_matrix()));
                d.fixed_view_mut::<2, 3>(0, 3).copy_from(&(j * -back));
                for k in 0..2 {
                    let weight = 1.0 / sds[i][id.index()][k].powi(2);
                    let residual = centres[i][id.index()][k] - uv[k];
                    normal += d.row(k).transpose() * d.row(k) * weight;
                    gradient += d.row(k).transpose() * (residual * weight);
                    chi2 += residual * residual * weight;
                }
            }
        }
        let step = normal.cholesky()?.solve(&gradient);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
        pose = Isometry3::from_parts(Translation3::from(pose.translation.vector + Vector3::new(step[3], step[4], step[5])), turn * pose.rotation);
        if step.norm() < 1e-12 {
            return Some((pose, normal, chi2));
        }
        if !step.norm().is_finite() {
            return None;
        }
    }
    None
}

/// Largest standard deviation of one sphere's place from the noise of its two centres, m.
fn sphere_spread(rig: &StereoRig, p: &Point3<f64>, sds: [Vector2<f64>; 2]) -> Option<f64> {
    let mut normal = Matrix3::zeros();
    for (id, sd) in CameraId::BOTH.into_iter().zip(sds) {
        let (_, j) = outline_centre(rig, p, id, 0.0)?;
        for k in 0..2 {
            normal += j.row(k).transpose() * j.row(k) / sd[k].powi(2);
        }
    }
    normal.try_inverse().map(|c| c.symmetric_eigenvalues().max().max(0.0).sqrt())
}
