//! The racket's six degrees of freedom from marker points in either camera (Gauss-Newton with Levenberg's damping).
//!
//! Every image point counts with its own deviation, whichever camera saw it; a marker needs no partner. Three markers
//! that span a plane suffice. The visible tape's offset from the tube's axis is part of the model ([`RacketFigure`]).

use crate::calibration::{CameraId, StereoRig, nearest_approach};
use crate::tracking::cholesky::Cholesky;
use crate::tracking::racket::foretold_pose::{Foretold, moved, turn_and_shift};
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::rigid_points::rigid_from_points;
use crate::tracking::track_file::{ImagePoint, Target, Tracks};
use nalgebra::{Isometry3, Matrix2x3, Matrix3, Matrix6, Point3, SMatrix, Vector2, Vector3};

/// One marker in one image: the centroid of the visible tape.
#[derive(Debug, Clone, Copy)]
pub struct MarkerObservation {
    pub camera: CameraId,
    /// 0 to 4 for m1 to m5.
    pub marker: usize,
    pub point: ImagePoint,
}

impl MarkerObservation {
    /// All of one frame, by camera and marker.
    pub fn in_frame(tracks: &Tracks, frame: u64) -> Vec<Self> {
        let bands = CameraId::BOTH.into_iter().flat_map(|camera| Target::MARKERS.map(|target| (camera, target)));
        bands.filter_map(|(camera, target)| Some(MarkerObservation { camera, marker: target.index(), point: tracks.get(frame, camera, target)? })).collect()
    }
}

/// Pose with its covariance: rotation vector about the global axes (rad), then translation (m).
#[derive(Debug, Clone)]
pub struct RacketPose {
    pub global_from_racket: Isometry3<f64>,
    /// 6x6, for the stated deviations of the observations (not rescaled by chi2).
    pub covariance: Matrix6<f64>,
    pub chi2: f64,
    pub dof: usize,
}

impl RacketPose {
    /// Chi-square per degree of freedom: 1 where the image points miss the pose by what they state.
    pub fn misfit(&self) -> f64 {
        self.chi2 / self.dof.max(1) as f64
    }

    /// Global position and 3x3 covariance (m²) of a point given in local racket axes.
    pub fn point(&self, local: &Point3<f64>) -> (Point3<f64>, Matrix3<f64>) {
        let arm = self.global_from_racket.rotation * local.coords;
        let mut j = SMatrix::<f64, 3, 6>::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-arm.cross_matrix()));
        j.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
        (self.global_from_racket * local, j * self.covariance * j.transpose())
    }

    /// Unit normal of the string plane (local z) in global axes.
    pub fn normal(&self) -> Vector3<f64> {
        self.global_from_racket.rotation * Vector3::z()
    }
}

/// Why no pose can be given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PoseError {
    #[error("{markers} markers in {points} image points; a pose needs 3 markers and 3 image points, or a start from a neighbouring frame")]
    TooFew { markers: usize, points: usize },
    #[error("the markers seen leave a direction free (condition number {condition:.1e}); 3 markers that are not in line are needed")]
    Undetermined { condition: f64 },
    #[error("the fit did not settle (chi2 {chi2:.3e} for {dof} degrees of freedom)")]
    NotConverged { chi2: f64, dof: usize },
    #[error("a marker lies behind a camera")]
    BehindCamera,
}

/// Both cameras as the fit needs them: pose and optical centre, computed once per clip.
#[derive(Debug, Clone)]
pub struct View<'a> {
    pub rig: &'a StereoRig,
    /// Pose `camera_from_global`: rotation and shift.
    rotation: [Matrix3<f64>; 2],
    shift: [Vector3<f64>; 2],
    eye: [Point3<f64>; 2],
}

impl<'a> View<'a> {
    pub fn new(rig: &'a StereoRig) -> Self {
        let camera_from_global = CameraId::BOTH.map(|c| rig.camera_from_global(c));
        let rotation = camera_from_global.map(|p| *p.rotation.to_rotation_matrix().matrix());
        let shift = camera_from_global.map(|p| p.translation.vector);
        View { rig, rotation, shift, eye: CameraId::BOTH.map(|c| rig.centre(c)) }
    }

    pub fn eye(&self, camera: CameraId) -> &Point3<f64> {
        &self.eye[camera.index()]
    }

    /// Pose `camera_from_global`.
    pub fn rotation(&self, camera: CameraId) -> &Matrix3<f64> {
        &self.rotation[camera.index()]
    }

    pub fn shift(&self, camera: CameraId) -> &Vector3<f64> {
        &self.shift[camera.index()]
    }

    #[inline]
    fn in_camera(&self, camera: CameraId, p: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation[camera.index()] * p.coords + self.shift[camera.index()])
    }

    /// Pixel of a global point; `None` behind the camera.
    #[inline]
    pub fn project(&self, camera: CameraId, p: &Point3<f64>) -> Option<Vector2<f64>> {
        self.rig.camera(camera).project(&self.in_camera(camera, p))
    }

    /// Pixel of a global point and its derivative with respect to the point.
    #[inline]
    pub fn project_with_jacobian(&self, camera: CameraId, p: &Point3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let (uv, j) = self.rig.camera(camera).project_with_jacobian(&self.in_camera(camera, p))?;
        Some((uv, j * self.rotation[camera.index()]))
    }

    /// Pixel of the centroid of a marker's visible tape, with the racket at a pose; `None` behind the camera.
    #[inline]
    pub fn patch(&self, camera: CameraId, figure: &RacketFigure, marker: usize, pose: &Isometry3<f64>) -> Option<Vector2<f64>> {
        self.project(camera, &figure.patch_in_global(marker, pose, self.eye(camera)).0)
    }

    /// The same with its derivative with respect to a small rotation of the racket about the global axes and a shift.
    #[inline]
    pub fn patch_with_jacobian(
        &self,
        camera: CameraId,
        figure: &RacketFigure,
        marker: usize,
        pose: &Isometry3<f64>,
    ) -> Option<(Vector2<f64>, SMatrix<f64, 2, 6>)> {
        let (place, by_rotation) = figure.patch_in_global(marker, pose, self.eye(camera));
        let (uv, by_place) = self.project_with_jacobian(camera, &place)?;
        let turned = by_place * by_rotation;
        Some((uv, SMatrix::from_fn(|row, k| if k < 3 { turned[(row, k)] } else { by_place[(row, k - 3)] })))
    }

    /// Unit vector of the ray through a pixel, global axes; `None` where the distortion cannot be inverted.
    pub fn ray(&self, camera: CameraId, uv: Vector2<f64>) -> Option<Vector3<f64>> {
        let n = self.rig.camera(camera).normalise(uv)?;
        Some(self.rotation[camera.index()].tr_mul(&Vector3::new(n.x, n.y, 1.0)).normalize())
    }

    /// The rows of a picture that lie between two heights, px: the first, and the one after the last.
    pub fn rows(&self, top: f64, bottom: f64) -> (usize, usize) {
        let row = |v: f64| v.clamp(0.0, self.rig.image_size[1] as f64) as usize;
        (row(top.floor()), row(bottom.ceil()))
    }

    /// The middle of the volume both cameras look at: where the rays through the picture centres come nearest.
    pub fn focus(&self) -> Option<Point3<f64>> {
        let centre = Vector2::new(0.5 * self.rig.image_size[0] as f64, 0.5 * self.rig.image_size[1] as f64);
        Some(self.triangulate(centre, centre)?.0)
    }

    /// Point nearest to both rays and their distance, m; `None` for rays that are nearly parallel or meet behind.
    pub fn triangulate(&self, left: Vector2<f64>, right: Vector2<f64>) -> Option<(Point3<f64>, f64)> {
        self.nearest_to_rays(&self.ray(CameraId::Left, left)?, &self.ray(CameraId::Right, right)?)
    }

    /// [`View::triangulate`] for unit rays of the left (`a`) and right (`b`) camera.
    pub fn nearest_to_rays(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> Option<(Point3<f64>, f64)> {
        let (squared_sine, [s, t]) = nearest_approach(&(self.eye[1] - self.eye[0]), a, b);
        if squared_sine < 1e-8 || s <= 0.0 || t <= 0.0 {
            return None;
        }
        let (p, q) = (self.eye[0] + a * s, self.eye[1] + b * t);
        Some((nalgebra::center(&p, &q), (p - q).norm()))
    }
}

/// Fits the pose to the observations of both cameras. `start` is a pose from a neighbouring frame; without it the markers
/// seen by both cameras (at least three, not in line) give one.
///
/// # Errors  [`PoseError`]; the fit never answers with an unsettled or undetermined pose.
pub fn fit_pose(view: &View, figure: &RacketFigure, observations: &[MarkerObservation], start: Option<&Isometry3<f64>>) -> Result<RacketPose, PoseError> {
    let mut seen = [false; 5];
    for o in observations.iter().filter(|o| o.marker < 5) {
        seen[o.marker] = true;
    }
    let markers = seen.iter().filter(|s| **s).count();
    let too_few = PoseError::TooFew { markers, points: observations.len() };
    if markers < 3 || observations.len() < 3 || observations.iter().any(|o| o.marker >= 5) {
        return Err(too_few);
    }
    let start = match start {
        Some(s) => *s,
        None => start_from_pairs(view, figure, observations).ok_or(too_few)?,
    };
    settle(view, figure, observations, start, None)
}

/// The pose of a racket of which too few markers are seen to tell it alone: what they leave open stays as foretold.
///
/// # Errors  the fit does not settle; a marker behind a camera
pub fn fit_pose_near(view: &View, figure: &RacketFigure, observations: &[MarkerObservation], foretold: &Foretold) -> Result<RacketPose, PoseError> {
    settle(view, figure, observations, foretold.pose, Some(foretold))
}

/// Largest condition number of the normal matrix of a pose.
const MOST_CONDITION: f64 = 1e8;

/// A step below this ends the fit, rad and m.
const SETTLED: f64 = 1e-5;

/// Three angles, then three shifts.
struct Normal {
    jtj: [[f64; 6]; 6],
    jtr: [f64; 6],
    chi2: f64,
}

fn normal_equations(
    view: &View,
    figure: &RacketFigure,
    observations: &[MarkerObservation],
    pose: &Isometry3<f64>,
    foretold: Option<&Foretold>,
) -> Option<Normal> {
    let mut n = Normal { jtj: [[0.0; 6]; 6], jtr: [0.0; 6], chi2: 0.0 };
    if let Some(foretold) = foretold {
        let off = turn_and_shift(pose, &foretold.pose);
        let pull = foretold.precision * off;
        n.jtj = std::array::from_fn(|i| std::array::from_fn(|k| foretold.precision[(i, k)]));
        n.jtr = pull.into();
        n.chi2 = off.dot(&pull);
    }
    for o in observations {
        let (uv, by_pose) = view.patch_with_jacobian(o.camera, figure, o.marker, pose)?;
        for row in 0..2 {
            let w = 1.0 / o.point.sd[row];
            let r = w * (o.point.uv[row] - uv[row]);
            let j: [f64; 6] = std::array::from_fn(|k| w * by_pose[(row, k)]);
            for i in 0..6 {
                for k in 0..6 {
                    n.jtj[i][k] += j[i] * j[k];
                }
                n.jtr[i] += j[i] * r;
            }
            n.chi2 += r * r;
        }
    }
    Some(n)
}

fn settle(
    view: &View,
    figure: &RacketFigure,
    observations: &[MarkerObservation],
    start: Isometry3<f64>,
    foretold: Option<&Foretold>,
) -> Result<RacketPose, PoseError> {
    let dof = (2 * observations.len()).saturating_sub(6);
    let mut pose = start;
    let mut now = normal_equations(view, figure, observations, &pose, foretold).ok_or(PoseError::BehindCamera)?;
    let mut damping = 1e-6;
    let mut settled = false;
    for _ in 0..60 {
        let mut h = now.jtj;
        for i in 0..6 {
            h[i][i] += damping * now.jtj[i][i].max(1e-12);
        }
        let Some(step) = Cholesky::of(&h).map(|c| c.solve(now.jtr)) else {
            damping *= 10.0;
            continue;
        };
        let next_pose = moved(&pose, &step);
        // A tenth of the best measurement; so near the minimum the next step would be smaller by a thousand.
        if step.iter().map(|s| s * s).sum::<f64>() < SETTLED * SETTLED {
            now.chi2 -= step.iter().zip(&now.jtr).map(|(s, r)| s * r).sum::<f64>();
            pose = next_pose;
            settled = true;
            break;
        }
        match normal_equations(view, figure, observations, &next_pose, foretold) {
            Some(next) if next.chi2 <= now.chi2 * (1.0 + 1e-12) => {
                (pose, now) = (next_pose, next);
                damping = (damping * 0.1).max(1e-12);
            }
            _ if damping > 1e8 => break,
            _ => damping *= 10.0,
        }
    }
    if !settled {
        return Err(PoseError::NotConverged { chi2: now.chi2, dof });
    }
    // Judge the condition with angles times the racket's size, so that all six numbers are lengths.
    let scale: [f64; 6] = [0.2, 0.2, 0.2, 1.0, 1.0, 1.0];
    let undetermined = |condition: f64| PoseError::Undetermined { condition };
    let covariance = Cholesky::of(&now.jtj).ok_or(undetermined(f64::INFINITY))?.inverse();
    // The traces bound the condition number from above; only where they leave it open are the eigenvalues needed.
    let trace = |f: &dyn Fn(usize) -> f64| (0..6).map(f).sum::<f64>();
    let bound = trace(&|i| now.jtj[i][i] / scale[i].powi(2)) * trace(&|i| covariance[i][i] * scale[i].powi(2));
    if !(bound < MOST_CONDITION) {
        let scaled = Matrix6::from_fn(|i, j| now.jtj[i][j] / (scale[i] * scale[j]));
        let eigen = scaled.symmetric_eigenvalues();
        let condition = eigen.max() / eigen.min().max(f64::MIN_POSITIVE);
        if eigen.min() <= 0.0 || condition > MOST_CONDITION {
            return Err(undetermined(condition));
        }
    }
    let mut global_from_racket = pose;
    global_from_racket.rotation.renormalize();
    Ok(RacketPose { global_from_racket, covariance: covariance.into(), chi2: now.chi2, dof })
}

fn start_from_pairs(view: &View, figure: &RacketFigure, observations: &[MarkerObservation]) -> Option<Isometry3<f64>> {
    let at = |camera, marker| observations.iter().find(|o| o.camera == camera && o.marker == marker).map(|o| o.point.uv);
    let mut local = Vec::with_capacity(5);
    let mut global = Vec::with_capacity(5);
    for m in 0..5 {
        if let (Some(l), Some(r)) = (at(CameraId::Left, m), at(CameraId::Right, m)) {
            local.push(figure.points[m]);
            global.push(view.triangulate(l, r)?.0);
        }
    }
    rigid_from_points(&local, &global)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::calibration::{Camera, RigidTransform};
    use crate::tracking::racket::racket_figure::tests::figure;
    use nalgebra::{Translation3, UnitQuaternion, Vector6};
    use rand::{Rng, SeedableRng};
    use rand_distr::{Distribution, Normal as Gauss};
    use std::collections::BTreeMap;

    /// Cameras 12 m away, 34 degrees apart, f 3000 px, looking at (0, 1, 0) along -U.
    pub(crate) fn rig() -> StereoRig {
        let camera = |k1| Camera { fx: 3000.0, fy: 2995.0, cx: 255.0, cy: 256.0, distortion: [k1, 0.3, 1e-3, -5e-4, 0.0], rms_px: 0.1, sd: BTreeMap::new() };
        let look = |w: f64| {
            let eye = Point3::new(11.5, 1.2, w);
            let z = (Point3::new(0.0, 1.0, 0.0) - eye).normalize();
            let x = z.cross(&Vector3::y()).normalize();
            let y = z.cross(&x);
            let r = Matrix3::from_rows(&[x.transpose(), y.transpose(), z.transpose()]);
            let q = UnitQuaternion::from_matrix(&r);
            Isometry3::from_parts(Translation3::from(-(q * eye.coords)), q)
        };
        let (left, right) = (look(3.6), look(-3.5));
        let between = RigidTransform::from_isometry(&(right * left.inverse()));
        StereoRig {
            image_size: [512, 512],
            left: camera(0.5),
            right: camera(-0.6),
            r: between.r,
            t: between.t,
            rms_stereo_px: 0.1,
            pairs: Vec::new(),
            square_mm: None,
            global_from_left: RigidTransform::from_isometry(&left.inverse()),
            more: BTreeMap::new(),
        }
    }

    pub(crate) fn pose() -> Isometry3<f64> {
        // x toward -W, z toward +U: a forehand.
        let r = Matrix3::from_columns(&[-Vector3::z(), Vector3::y(), Vector3::x()]);
        Isometry3::from_parts(
            Translation3::new(0.1, 0.9, 0.2),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.2, -0.3, 0.1)) * UnitQuaternion::from_matrix(&r),
        )
    }

    fn observe(
        view: &View,
        f: &RacketFigure,
        pose: &Isometry3<f64>,
        sd: f64,
        mut error: impl FnMut() -> f64,
        keep: impl Fn(CameraId, usize) -> bool,
    ) -> Vec<MarkerObservation> {
        let mut all = Vec::new();
        for camera in CameraId::BOTH {
            for marker in (0..5).filter(|m| keep(camera, *m)) {
                let uv = view.patch(camera, f, marker, pose).expect("in front") + Vector2::new(error(), error());
                all.push(MarkerObservation { camera, marker, point: ImagePoint { uv, sd: Vector2::new(sd, sd) } });
            }
        }
        all
    }

    #[test]
    fn truth_exact_points_give_the_exact_pose() {
        let (rig, f) = (rig(), figure());
        let view = View::new(&rig);
        let o = observe(&view, &f, &pose(), 0.1, || 0.0, |_, _| true);
        let fit = fit_pose(&view, &f, &o, None).expect("fits");
        assert!((fit.global_from_racket.translation.vector - pose().translation.vector).norm() < 1e-8);
        assert!(fit.global_from_racket.rotation.angle_to(&pose().rotation) < 1e-7);
        assert!(fit.chi2 < 1e-8 && fit.dof == 14);
    }

    #[test]
    fn truth_three_markers_split_between_the_cameras_suffice_with_a_start() {
        let (rig, f) = (rig(), figure());
        let view = View::new(&rig);
        let o = observe(&view, &f, &pose(), 0.1, || 0.0, |c, m| if c == CameraId::Left { m == 0 || m == 1 } else { m == 4 || m == 1 });
        let mut start = pose();
        start.translation.vector += Vector3::new(0.01, -0.02, 0.015);
        let fit = fit_pose(&view, &f, &o, Some(&start)).expect("fits");
        assert!((fit.global_from_racket.translation.vector - pose().translation.vector).norm() < 1e-6);
    }

    #[test]
    fn truth_what_few_markers_leave_open_stays_as_foretold() {
        let (rig, f) = (rig(), figure());
        let view = View::new(&rig);
        let off = |mm: f64| Foretold::within(Translation3::new(0.0, 1e-3 * mm, 0.0) * pose(), 0.01, 0.002);
        // Two markers: the turn about the line through them is free.
        let two = observe(&view, &f, &pose(), 0.05, || 0.0, |_, marker| marker < 2);
        assert!(fit_pose(&view, &f, &two, Some(&off(2.0).pose)).is_err());
        let fit = fit_pose_near(&view, &f, &two, &off(2.0)).expect("fits");
        for marker in 0..2 {
            let apart = (fit.global_from_racket * f.points[marker] - pose() * f.points[marker]).norm();
            assert!(apart < 3e-4, "{marker}: {apart}");
        }
        assert!(fit.global_from_racket.rotation.angle_to(&pose().rotation) < 0.01);
        // Nothing seen: all as foretold, to what it is foretold to.
        let none = fit_pose_near(&view, &f, &[], &off(2.0)).expect("fits");
        assert!(off(2.0).off(&none.global_from_racket) < 1e-9);
        assert!((none.covariance[(5, 5)].sqrt() - 0.002).abs() < 1e-9);
        assert!((off(6.0).off(&pose()) - 3.0).abs() < 1e-9);
    }

    #[test]
    fn law_stated_covariance_covers_the_scatter() {
        let (rig, f) = (rig(), figure());
        let view = View::new(&rig);
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let gauss = Gauss::new(0.0, 0.1).expect("sd");
        let (mut mahalanobis, mut chi2, n) = (0.0, 0.0, 400);
        for _ in 0..n {
            let tilt = UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| rng.random_range(-0.5..0.5)));
            let mut truth = pose();
            truth.rotation = tilt * truth.rotation;
            let o = observe(&view, &f, &truth, 0.1, || gauss.sample(&mut rng), |c, m| !(c == CameraId::Right && m == 3));
            let fit = fit_pose(&view, &f, &o, None).expect("fits");
            let w = (truth.rotation * fit.global_from_racket.rotation.inverse()).scaled_axis();
            let t = truth.translation.vector - fit.global_from_racket.translation.vector;
            let e = Vector6::new(w.x, w.y, w.z, t.x, t.y, t.z);
            mahalanobis += (e.transpose() * fit.covariance.try_inverse().expect("regular") * e)[0] / n as f64;
            chi2 += fit.misfit() / n as f64;
        }
        // chi-square with 6 and 12 degrees of freedom over 400 trials: 4 sd are 0.69 and 0.08.
        assert!((mahalanobis - 6.0).abs() < 0.7, "{mahalanobis}");
        assert!((chi2 - 1.0).abs() < 0.085, "{chi2}");
    }

    #[test]
    fn law_a_mirrored_figure_is_never_fitted() {
        // A plane figure seen in a mirror is the figure from behind; with a marker off the plane it is another figure.
        let (rig, mut f) = (rig(), figure());
        f.points[0].z += 0.03;
        let mut mirrored = f.clone();
        for (p, tube) in mirrored.points.iter_mut().zip(&mut mirrored.tube) {
            p.y = -p.y;
            *tube = nalgebra::Unit::new_normalize(Vector3::new(tube.x, -tube.y, tube.z));
        }
        let view = View::new(&rig);
        let misfit = |seen: &RacketFigure| {
            let o = observe(&view, seen, &pose(), 0.1, || 0.0, |_, _| true);
            fit_pose(&view, &f, &o, None).map_or(f64::INFINITY, |fit| fit.misfit())
        };
        assert!(misfit(&f) < 1e-6 && misfit(&mirrored) > 100.0, "{} {}", misfit(&f), misfit(&mirrored));
    }

    #[test]
    fn fails_two_markers_and_three_in_line() {
        let (rig, mut f) = (rig(), figure());
        let view = View::new(&rig);
        let o = observe(&view, &f, &pose(), 0.1, || 0.0, |_, m| m < 2);
        assert!(matches!(fit_pose(&view, &f, &o, None), Err(PoseError::TooFew { markers: 2, points: 4 })));
        f.points[1] = Point3::new(0.0, 0.0, 0.0);
        f.points[2] = Point3::new(0.1, 0.0, 0.0);
        let o = observe(&view, &f, &pose(), 0.1, || 0.0, |_, m| m < 3);
        assert!(fit_pose(&view, &f, &o, None).is_err());
    }
}
