//! One picture of the ball, and its pixels as directions on the sphere.

use crate::calibration::{CameraId, StereoRig};
use crate::footage::{GreyView, WHITE};
use crate::median::upper_median;
use nalgebra::{Matrix2, Matrix3, Point3, Vector2, Vector3};

/// The ball in one picture.
#[derive(Debug, Clone, Copy)]
pub struct BallView<'a> {
    pub camera: CameraId,
    /// Middle of the exposure, s, from any origin.
    pub time_s: f64,
    /// As much of the picture as shows the ball.
    pub picture: GreyView<'a>,
    /// Projected centre of the ball, px, and its standard deviation.
    pub centre_px: Vector2<f64>,
    pub centre_sd_px: f64,
    /// Standard deviation of the part of the centre's error that it has in common with its neighbours in time, px: a light or a
    /// background that all see. Smoothing along the track does not take it away.
    pub centre_shared_px: f64,
    /// Centre of the ball in global axes, m. Used for scale and viewing direction only, so that a few mm do not matter.
    pub position: Point3<f64>,
}

/// One pixel on the ball.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Index of the view.
    pub view: usize,
    /// Outward normal in global axes.
    pub normal: Vector3<f64>,
    /// The same normal in the camera's own directions: right, down, toward the camera.
    pub disc: Vector3<f64>,
    pub grey: f64,
}

impl Sample {
    /// Whether the picture says only that the ball is at least as bright.
    pub fn is_white(&self) -> bool {
        self.grey >= f64::from(WHITE)
    }
}

/// What the estimator keeps of one view.
#[derive(Debug, Clone, Copy)]
pub(super) struct ViewInfo {
    pub camera: CameraId,
    pub time_s: f64,
    /// The camera's right, down and toward, as directions in global axes.
    pub axes: Matrix3<f64>,
    /// The ball's radius in the picture, px.
    pub radius_px: f64,
    /// By how much the centre is off, px along either side of the picture, for each of the independent standard errors of its
    /// camera's smoothed track.
    pub centre_errors: CentreErrors,
}

/// Terms of a smoothed track at most.
pub(super) const TRACK_TERMS: usize = 4;
pub(super) type CentreErrors = [f64; TRACK_TERMS];

/// Part of the ball's disc that is used: beyond it, lines are foreshortened below the width of the blur and the
/// background mixes in. Measured in docs/spin-experiments.md, "Used part of the disc".
pub(super) const USED_RADIUS: f64 = 0.88;

/// Centres of a camera from which a track is smoothed.
const FEWEST_SMOOTHED: usize = 5;
/// How what centres have in common is shared out among constant, slope and bends of the track: it changes slowly.
const SHARED_BY_TERM: [f64; TRACK_TERMS] = [0.6, 0.6, 0.3, 0.1];

/// The views of which more than half of the ball's disc is in the picture and below white.
#[derive(Default)]
pub(super) struct SampledViews {
    pub infos: Vec<ViewInfo>,
    /// View by view; those at white too.
    pub samples: Vec<Sample>,
    /// Views left out because more than half of the disc is white.
    pub overexposed: usize,
}

/// The pixels of the ball's disc in all views that can be used.
pub(super) fn sample_views(views: &[BallView], rig: &StereoRig, radius_m: f64) -> SampledViews {
    let (centres, errors) = smooth_centres(views);
    let mut sampled = SampledViews::default();
    for ((view, centre), centre_errors) in views.iter().zip(&centres).zip(errors) {
        let start = sampled.samples.len();
        let at = sampled.infos.len();
        match sample_view(view, *centre, rig, radius_m, at, &mut sampled.samples) {
            Some((info, shown)) if 2 * shown.usable > shown.all => sampled.infos.push(ViewInfo { centre_errors, ..info }),
            left_out => {
                sampled.samples.truncate(start);
                sampled.overexposed += usize::from(left_out.is_some_and(|(_, shown)| 2 * shown.white > shown.all));
            }
        }
    }
    sampled
}

/// How many pixels the used part of a view's disc has, in the picture or beyond it, and what they are.
struct Shown {
    all: usize,
    usable: usize,
    white: usize,
}

/// Samples one view with the affine camera at the ball's centre: the ball subtends 0.3° at 12 m, so the error of that
/// approximation is below 0.03 px. `None` when the geometry is impossible.
fn sample_view(view: &BallView, centre: Vector2<f64>, rig: &StereoRig, radius_m: f64, at: usize, out: &mut Vec<Sample>) -> Option<(ViewInfo, Shown)> {
    let camera_from_global = rig.camera_from_global(view.camera);
    let in_camera = camera_from_global * view.position;
    let (_, jacobian) = rig.camera(view.camera).project_with_jacobian(&in_camera)?;
    let toward = -in_camera.coords.try_normalize(1e-9)?;
    // Directions across the line of sight, nearest to the image's right and down.
    let right = (Vector3::x() - toward * toward.x).try_normalize(1e-9)?;
    let down = right.cross(&toward) * if right.cross(&toward).y >= 0.0 { 1.0 } else { -1.0 };
    let across = jacobian * radius_m;
    let (a, b) = (across * right, across * down);
    let px_from_disc = Matrix2::new(a.x, b.x, a.y, b.y);
    let disc_from_px = px_from_disc.try_inverse()?;
    let radius_px = px_from_disc.determinant().abs().sqrt();
    if !(radius_px.is_finite() && (2.0..=200.0).contains(&radius_px) && centre.x.is_finite() && centre.y.is_finite()) {
        return None;
    }
    let axes = camera_from_global.rotation.inverse().to_rotation_matrix().matrix() * Matrix3::from_columns(&[right, down, toward]);
    let nearer = radius_m / in_camera.coords.norm();
    let reach = radius_px.ceil() as i64 + 1;
    let (u0, v0) = (centre.x.round() as i64, centre.y.round() as i64);
    let mut shown = Shown { all: 0, usable: 0, white: 0 };
    for row in v0.saturating_sub(reach)..=v0.saturating_add(reach) {
        for column in u0.saturating_sub(reach)..=u0.saturating_add(reach) {
            let mut p = disc_from_px * Vector2::new(column as f64 - centre.x, row as f64 - centre.y);
            // The ball's near side is nearer than its centre and so looks larger: 0.3 % at 12 m, and so would the spin.
            p *= 1.0 - nearer * (1.0 - p.norm_squared()).max(0.0).sqrt();
            let rho2 = p.norm_squared();
            if rho2 > USED_RADIUS * USED_RADIUS {
                continue;
            }
            shown.all += 1;
            let Some(grey) = view.picture.get(column, row).map(f64::from) else { continue };
            let disc = Vector3::new(p.x, p.y, (1.0 - rho2).sqrt());
            let sample = Sample { view: at, normal: axes * disc, disc, grey };
            *(if sample.is_white() { &mut shown.white } else { &mut shown.usable }) += 1;
            out.push(sample);
        }
    }
    Some((ViewInfo { camera: view.camera, time_s: view.time_s, axes, radius_px, centre_errors: [0.0; TRACK_TERMS] }, shown))
}

/// Centres smoothed along each camera's track: the ball flies freely over the window, so a low-order polynomial in time
/// holds it, and the noise of single centres, which the eye would take for small turns of the ball, averages out. With them
/// what is left of their errors: of the polynomial's coefficients by the scatter of single centres, and of what they have in common,
/// which no smoothing takes away.
fn smooth_centres(views: &[BallView]) -> (Vec<Vector2<f64>>, Vec<CentreErrors>) {
    let mut centres: Vec<Vector2<f64>> = views.iter().map(|v| v.centre_px).collect();
    let mut errors = vec![[0.0; TRACK_TERMS]; views.len()];
    for camera in CameraId::BOTH {
        let own: Vec<usize> = (0..views.len()).filter(|&i| views[i].camera == camera).collect();
        // Fewer stay as they are.
        let terms = match own.len() {
            0..=7 => 2,
            8..=13 => 3,
            _ => 4,
        };
        let (first, last) = own.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &i| (a.min(views[i].time_s), b.max(views[i].time_s)));
        let half = 0.5 * (last - first);
        if !(half > 0.0 && half.is_finite()) {
            continue;
        }
        // Legendre's polynomials, scaled to a mean square of 1: what the errors have in common scatters alike along each.
        let basis = |t: f64| {
            let x = (t - 0.5 * (first + last)) / half;
            let p = [1.0, 1.73 * x, 1.12 * (3.0 * x * x - 1.0), 1.32 * (5.0 * x * x - 3.0) * x];
            nalgebra::DVector::from_fn(terms, |k, _| p[k])
        };
        // Two rounds: the second without centres that lie 4 deviations off the first curve.
        let mut keep = own.clone();
        let mut scatter = nalgebra::DMatrix::<f64>::zeros(terms, terms);
        for _ in 0..2 {
            let mut normal = nalgebra::DMatrix::<f64>::zeros(terms, terms);
            let mut right = nalgebra::DMatrix::<f64>::zeros(terms, 2);
            for &i in &keep {
                let b = basis(views[i].time_s);
                let w = views[i].centre_sd_px.clamp(0.01, 10.0).powi(-2);
                normal += &b * b.transpose() * w;
                right += &b * views[i].centre_px.transpose() * w;
            }
            let Some(factor) = normal.cholesky() else { break };
            scatter = factor.inverse();
            if own.len() < FEWEST_SMOOTHED {
                break;
            }
            let solution = factor.solve(&right);
            for &i in &own {
                let fitted = solution.transpose() * basis(views[i].time_s);
                centres[i] = Vector2::new(fitted[0], fitted[1]);
            }
            let Some(usual) = upper_median(keep.iter().map(|&i| (centres[i] - views[i].centre_px).norm())) else { break };
            let limit = (4.0 * usual).max(0.15);
            keep = own.iter().copied().filter(|&i| (centres[i] - views[i].centre_px).norm() <= limit).collect();
            if keep.len() < terms + 2 {
                break;
            }
        }
        let shared = own.iter().map(|&i| views[i].centre_shared_px.clamp(0.0, 10.0).powi(2)).sum::<f64>() / own.len() as f64;
        for (k, share) in SHARED_BY_TERM.iter().enumerate().take(terms) {
            scatter[(k, k)] += shared * share;
        }
        if let Some(root) = scatter.cholesky().map(|c| c.l()) {
            for &i in &own {
                let off = root.tr_mul(&basis(views[i].time_s));
                errors[i] = std::array::from_fn(|k| off.get(k).copied().unwrap_or(0.0));
            }
        }
    }
    (centres, errors)
}
