//! The racket in one frame: windows around where it is expected, band fits, one pose from both cameras, honest occlusion.

use crate::calibration::CameraId;
use crate::footage::{GreyView, Rows};
use crate::tracking::pictures::shot_frames::AT_ONCE;
use crate::tracking::racket::band_near::{find, least_of};
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_pose::{MarkerObservation, RacketPose, View, fit_pose_in};
use crate::tracking::tape::band::{self, BandFit, BandPart, BandShape, BandView, Settled};
use crate::tracking::track_file::ImagePoint;
use nalgebra::{Isometry3, Point3, Vector2};
use rayon::prelude::*;

/// Least deviation of a marker's image point, px: what the model of the tape itself is good to.
const FLOOR_SD_PX: f64 = 0.03;
/// A point farther than this many deviations (with the tolerance below) from the common pose is another thing.
const OUTLIER: f64 = 4.0;
/// What a good point may miss the pose by, px, beyond its own deviation (tape put on by hand, tube of another shape).
const MODEL_TOLERANCE_PX: f64 = 0.25;

/// A pose this near to the predicted one, px at every marker, was predicted well: the bands looked as expected there.
const CONFIRMED_PX: f64 = 1.0;
/// Misses of the pose, in deviations, beyond which a single point is doubtful.
const DOUBTFUL: f64 = 3.0;
/// How far a pose from one camera may be from the predicted one: m (depth from the racket's size: 0.1 px of 80 is 15 mm at
/// 12 m) and rad.
const ONE_CAMERA: (f64, f64) = (0.10, 0.25);

/// The racket in one frame.
#[derive(Debug, Clone)]
pub struct RacketFrame {
    pub pose: RacketPose,
    /// By camera and marker; `None` is occluded.
    pub points: [[Option<ImagePoint>; 5]; 2],
    /// Too few bands tell the pose: what they leave open is as it was foretold.
    pub foretold: bool,
}

impl RacketFrame {
    pub fn count(&self) -> usize {
        self.points.iter().flatten().flatten().count()
    }

    /// How far the bands miss the pose they share, px. (In units of what they state it says less: on a wrong figure bands are looked for
    /// with the wrong direction, and state more.)
    pub fn miss_px(&self) -> f64 {
        let variances = self.points.iter().flatten().flatten().map(|p| 0.5 * p.sd.norm_squared());
        (self.pose.misfit() * variances.sum::<f64>() / self.count().max(1) as f64).sqrt()
    }

    /// Whether both cameras have a part in the pose.
    pub fn stereo(&self) -> bool {
        self.points.iter().all(|c| c.iter().any(Option::is_some))
    }

    pub fn observations(&self) -> Vec<MarkerObservation> {
        let mut out = Vec::with_capacity(10);
        for camera in CameraId::BOTH {
            for marker in 0..5 {
                if let Some(point) = self.points[camera.index()][marker] {
                    out.push(MarkerObservation { camera, marker, point });
                }
            }
        }
        out
    }
}

/// What all frames share.
#[derive(Clone, Copy)]
pub struct RacketScene<'a> {
    pub view: &'a View<'a>,
    pub figure: &'a RacketFigure,
    pub shape: &'a BandShape,
}

impl RacketScene<'_> {
    /// The rows of a picture that [`measure`] looks at; all when a marker may be anywhere.
    pub fn rows(&self, camera: CameraId, predicted: &Isometry3<f64>, reach_px: i32) -> Rows {
        self.rows_around(camera, predicted, reach_px).unwrap_or(Rows::ALL)
    }

    fn rows_around(&self, camera: CameraId, predicted: &Isometry3<f64>, reach_px: i32) -> Option<Rows> {
        let (mut top, mut bottom, mut size) = (f64::INFINITY, f64::NEG_INFINITY, 0.0f64);
        for marker in 0..self.figure.points.len() {
            let at = predicted * self.figure.points[marker];
            let (uv, by_place) = self.view.project_with_jacobian(camera, &at)?;
            (top, bottom) = (top.min(uv.y), bottom.max(uv.y));
            size = size.max(by_place.norm());
        }
        // The search, a move by as much in the fit, and once more from there; half a band in any direction.
        let band_m = self.shape.white_half_m + self.shape.black_m + 2.0 * self.figure.tube_radius_m.into_iter().fold(0.0, f64::max);
        let margin = size * band_m + 3.0 * f64::from(reach_px) + 8.0;
        let row = |v: f64| v.clamp(0.0, self.view.rig.image_size[1] as f64) as usize;
        let first = row((top - margin).floor());
        Some(Rows::span(first, row((bottom + margin).ceil()) - first))
    }

    /// Largest distance between a marker's images at two poses, px; infinite where one is behind a camera.
    fn apart_px(&self, a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
        let far = |camera: CameraId, marker: &Point3<f64>| Some((self.view.project(camera, &(a * marker))? - self.view.project(camera, &(b * marker))?).norm());
        let all = CameraId::BOTH.into_iter().flat_map(|camera| self.figure.points.iter().map(move |marker| (camera, marker)));
        all.map(|(camera, marker)| far(camera, marker).unwrap_or(f64::INFINITY)).fold(0.0, f64::max)
    }
}

/// All bands of the five markers in two pictures.
pub const ALL_BANDS: usize = 10;

/// The bands seen whole in the frame before, by camera and marker.
#[derive(Debug, Default, Clone)]
pub struct KnownBands([[Known; 5]; 2]);

#[derive(Debug, Default, Clone, Copy)]
struct Known {
    seen: bool,
    /// What it looked like, once it has been fitted where it was expected.
    like: Option<Settled>,
}

impl KnownBands {
    /// Of a frame just measured; `None` where they are too few.
    pub fn of(scene: &RacketScene, images: &[Option<GreyView>; 2], frame: &RacketFrame, least_contrast: &[f64; 2]) -> Option<Self> {
        let bands = scene.expected(&frame.pose.global_from_racket)?;
        let mut known = KnownBands::default();
        for camera in CameraId::BOTH {
            let (c, image) = (camera.index(), images[camera.index()].as_ref()?);
            for (marker, band) in bands.0[c].iter().enumerate() {
                known.0[c][marker].seen = frame.points[c][marker].is_some() && stands_out(scene, image, band, least_contrast[c]);
            }
        }
        known.tell().then_some(known)
    }

    /// Whether they are enough to tell that the racket goes on as it went.
    fn tell(&self) -> bool {
        self.0.iter().all(|c| c.iter().filter(|k| k.seen).count() >= FEW_BANDS)
    }

    fn count(&self) -> usize {
        self.0.iter().flatten().filter(|k| k.seen).count()
    }
}

/// Whether a band has the contrast of tape right where it is expected.
fn stands_out(scene: &RacketScene, image: &GreyView, band: &BandView, least_contrast: f64) -> bool {
    band.contrast(image, scene.shape, 0.0, 0.0).is_some_and(|c| c >= least_of(scene, band, least_contrast))
}

/// The bands of all markers as they should look at a pose, by camera and marker.
pub struct ExpectedBands([[BandView; 5]; 2]);

impl RacketScene<'_> {
    /// `None` where a marker is behind a camera or its tube points at one.
    pub fn expected(&self, pose: &Isometry3<f64>) -> Option<ExpectedBands> {
        let band = |camera: CameraId, marker: usize| BandView::at(self.view, self.figure, pose, camera, marker);
        let of = |camera| -> Option<[BandView; 5]> { Some([band(camera, 0)?, band(camera, 1)?, band(camera, 2)?, band(camera, 3)?, band(camera, 4)?]) };
        Some(ExpectedBands([of(CameraId::Left)?, of(CameraId::Right)?]))
    }
}

impl ExpectedBands {
    /// The rows of both pictures that [`confirm`] looks at.
    pub fn rows(&self, scene: &RacketScene, known: &KnownBands) -> [Rows; 2] {
        let limit = |v: f64| v.clamp(0.0, scene.view.rig.image_size[1] as f64) as usize;
        let rows = |(band, known): (&BandView, &Known)| {
            // A band not seen before is searched around where the others say it is.
            let half = band.half_height(scene.shape) + CONFIRMED_PX + if known.seen { 0.5 } else { 2.5 };
            (limit((band.centre.y - half).floor()), limit((band.centre.y + half).ceil() + 1.0))
        };
        [0, 1].map(|c| Rows::of(self.0[c].iter().zip(&known.0[c]).map(rows)))
    }
}

/// Measures a frame in which the bands that the frame before showed, all but one at most, are seen where and as expected: one fit each,
/// beginning with what the band looked like before; the others are looked for where these say they are. `None` where that does not hold;
/// [`measure`] then looks farther.
pub fn confirm(
    scene: &RacketScene,
    images: &[Option<GreyView>; 2],
    predicted: &Isometry3<f64>,
    expected: &ExpectedBands,
    least_contrast: &[f64; 2],
    known: &mut KnownBands,
) -> Option<RacketFrame> {
    let mut fits = Vec::with_capacity(ALL_BANDS);
    if !known.tell() {
        return None;
    }
    let enough = known.count() - 1;
    // A glance at all of them before any is measured.
    let mut at_hand: Vec<(CameraId, usize, &GreyView, &BandView)> = Vec::with_capacity(ALL_BANDS);
    for camera in CameraId::BOTH {
        let (c, image) = (camera.index(), images[camera.index()].as_ref()?);
        let bands = expected.0[c].iter().enumerate().filter(|(marker, band)| known.0[c][*marker].seen && stands_out(scene, image, band, least_contrast[c]));
        at_hand.extend(bands.map(|(marker, band)| (camera, marker, image, band)));
    }
    if at_hand.len() < enough {
        return None;
    }
    for (camera, marker, image, band) in at_hand {
        let c = camera.index();
        let fit = band::fit(image, band, scene.shape, (0.0, 0.0), BandPart::Whole, known.0[c][marker].like.as_ref());
        fits.extend(fit.filter(|fit| fit.white - fit.black > least_of(scene, band, least_contrast[c])).map(|fit| (camera, marker, fit)));
    }
    leave_out_hidden(scene, &mut fits, predicted);
    let mut pose = agree(scene, &mut fits, predicted)?;
    if fits.len() < enough || !(scene.apart_px(&pose.global_from_racket, predicted) < CONFIRMED_PX) {
        return None;
    }
    if fits.len() < ALL_BANDS {
        let look = Look { scene, images, least_contrast };
        if let Some(more) = look.from(&pose.global_from_racket, 1, true, fits.clone()) {
            (pose, fits) = (more.pose, more.fits);
        }
    }
    let mut points = [[None; 5]; 2];
    let before = std::mem::take(known);
    for (camera, marker, f) in &fits {
        let c = camera.index();
        points[c][*marker] = Some(image_point(f));
        // One seen in part is looked for in part again.
        let whole = before.0[c][*marker].seen || images[c].as_ref().is_some_and(|image| stands_out(scene, image, &expected.0[c][*marker], least_contrast[c]));
        known.0[c][*marker] = Known { seen: whole, like: whole.then_some(f.settled) };
    }
    Some(RacketFrame { pose, points, foretold: false })
}

/// Measures every marker near a predicted pose. `reach_px` is how far the prediction may be off; `least_contrast` the
/// contrast a band must have, by camera. `None` when fewer than three markers or five image points agree on one pose; with
/// one camera alone, fewer than four, or a pose far from the predicted one (one camera hardly tells depth).
pub fn measure(
    scene: &RacketScene,
    images: &[Option<GreyView>; 2],
    predicted: &Isometry3<f64>,
    reach_px: i32,
    least_contrast: &[f64; 2],
) -> Option<RacketFrame> {
    // A prediction that all bands confirm needs no second look; bands that were not found get a second chance where the others
    // say they are.
    let possible = 5 * images.iter().flatten().count();
    let look = Look { scene, images, least_contrast };
    let first = look.from(predicted, 1, false, Vec::new());
    let close = first.filter(|a| a.dropped == 0 && scene.apart_px(&a.pose.global_from_racket, predicted) < CONFIRMED_PX);
    let Agreed { pose, fits, .. } = match close {
        Some(agreed) if agreed.fits.len() == possible => agreed,
        Some(agreed) => look.from(&agreed.pose.global_from_racket, 1, true, agreed.fits.clone()).unwrap_or(agreed),
        None => {
            let rough = look.from(predicted, reach_px, false, Vec::new())?;
            look.from(&rough.pose.global_from_racket, 1, true, Vec::new()).unwrap_or(rough)
        }
    };
    let one_camera = fits.iter().all(|f| f.0 == fits[0].0);
    if one_camera {
        let (p, q) = (&pose.global_from_racket, predicted);
        if (p.translation.vector - q.translation.vector).norm() > ONE_CAMERA.0 || p.rotation.angle_to(&q.rotation) > ONE_CAMERA.1 {
            return None;
        }
    }
    Some(RacketFrame { pose, points: points_of(&fits), foretold: false })
}

/// Looks for the bands of one frame.
struct Look<'a> {
    scene: &'a RacketScene<'a>,
    images: &'a [Option<GreyView<'a>>; 2],
    least_contrast: &'a [f64; 2],
}

impl Look<'_> {
    /// The bands that agree on a pose, of those known and those found near `pose`; the others count as well where they are seen in part
    /// or as specks, if `weak`.
    fn from(&self, pose: &Isometry3<f64>, reach_px: i32, weak: bool, mut fits: Vec<(CameraId, usize, BandFit)>) -> Option<Agreed> {
        add_bands(self.scene, self.images, pose, (reach_px, weak), self.least_contrast, &mut fits);
        let seen = fits.len();
        let pose = agree(self.scene, &mut fits, pose)?;
        Some(Agreed { pose, dropped: seen - fits.len(), fits })
    }
}

/// Adds the bands not yet known that are found near a pose.
pub(in crate::tracking) fn add_bands(
    scene: &RacketScene,
    images: &[Option<GreyView>; 2],
    pose: &Isometry3<f64>,
    how: (i32, bool),
    least_contrast: &[f64; 2],
    fits: &mut Vec<(CameraId, usize, BandFit)>,
) {
    let mut known = [[false; 5]; 2];
    fits.iter().for_each(|f| known[f.0.index()][f.1] = true);
    for camera in CameraId::BOTH {
        let Some(image) = &images[camera.index()] else { continue };
        for marker in (0..5).filter(|m| !known[camera.index()][*m]) {
            if let Some(f) = find(scene, image, pose, camera, marker, how, least_contrast[camera.index()]) {
                fits.push((camera, marker, f));
            }
        }
    }
    fits.sort_by_key(|f| (f.0, f.1));
    leave_out_hidden(scene, fits, pose);
}

/// Leaves out bands that were found on the tape of another one nearer to the camera: of a racket seen edge-on one tube hides the other, and the
/// hidden band's fit goes to the tape that is seen. Two tubes' middles less than a radius apart leave less than half of the farther one.
fn leave_out_hidden(scene: &RacketScene, fits: &mut Vec<(CameraId, usize, BandFit)>, pose: &Isometry3<f64>) {
    let depth = |camera: CameraId, marker: usize| (pose * scene.figure.points[marker] - scene.view.eye(camera)).norm();
    let hidden = |k: usize| {
        let (camera, marker, fit) = &fits[k];
        fits.iter()
            .filter(|(c, m, _)| c == camera && m != marker)
            .any(|(_, other, f)| (f.uv - fit.uv).norm() < fit.radius_px && depth(*camera, *other) < depth(*camera, *marker))
    };
    let hidden: Vec<bool> = (0..fits.len()).map(hidden).collect();
    if hidden.contains(&true) {
        let mut hidden = hidden.into_iter();
        fits.retain(|_| !hidden.next().unwrap_or(false));
    }
}

/// [`measure`] where the frames before say how the racket moves. A doubled picture shows it where it was: a band or two of that camera may
/// still agree with the other's on a pose, one whose depth has jumped. Such a frame is measured from the other camera alone.
pub(in crate::tracking) fn measure_following(
    scene: &RacketScene,
    images: &[Option<GreyView>; 2],
    predicted: &Isometry3<f64>,
    reach_px: i32,
    least_contrast: &[f64; 2],
) -> Option<RacketFrame> {
    let frame = measure(scene, images, predicted, reach_px, least_contrast)?;
    let jumped = scene.apart_px(&frame.pose.global_from_racket, predicted) > JUMP_PX;
    let mut images = *images;
    for (image, points) in images.iter_mut().zip(&frame.points) {
        if (1..FEW_BANDS).contains(&points.iter().flatten().count()) {
            *image = None;
        }
    }
    let few = images.iter().flatten().count() == 1;
    let alone = if jumped && few { measure(scene, &images, predicted, reach_px, least_contrast) } else { None };
    Some(alone.unwrap_or(frame))
}

/// Fewer bands than this in one camera's picture tell little beside the other's.
const FEW_BANDS: usize = 3;
/// A pose farther than this from the predicted one, px at any marker, is a jump.
const JUMP_PX: f64 = 1.5;

/// The bands that share a pose, and how many did not.
struct Agreed {
    pose: RacketPose,
    fits: Vec<(CameraId, usize, BandFit)>,
    dropped: usize,
}

pub(in crate::tracking) fn points_of(fits: &[(CameraId, usize, BandFit)]) -> [[Option<ImagePoint>; 5]; 2] {
    let mut points = [[None; 5]; 2];
    for (camera, marker, f) in fits {
        points[camera.index()][*marker] = Some(image_point(f));
    }
    points
}

pub(in crate::tracking) fn observations_of(fits: &[(CameraId, usize, BandFit)]) -> Vec<MarkerObservation> {
    fits.iter().map(|(camera, marker, f)| MarkerObservation { camera: *camera, marker: *marker, point: image_point(f) }).collect()
}

fn image_point(f: &BandFit) -> ImagePoint {
    let sd = |v: f64| (v + FLOOR_SD_PX * FLOOR_SD_PX).sqrt();
    ImagePoint { uv: f.uv, sd: Vector2::new(sd(f.covariance[(0, 0)]), sd(f.covariance[(1, 1)])) }
}

/// The pose most bands agree on; bands that do not are removed, worst first.
fn agree(scene: &RacketScene, fits: &mut Vec<(CameraId, usize, BandFit)>, start: &Isometry3<f64>) -> Option<RacketPose> {
    loop {
        let mut markers = [false; 5];
        fits.iter().for_each(|f| markers[f.1] = true);
        let seen = markers.iter().filter(|m| **m).count();
        if seen < 3 || fits.len() < 5 && seen < 4 {
            return None;
        }
        let observations = observations_of(fits);
        let pose = fit_pose_in(scene.view, scene.figure, &observations, Some(start)).ok()?;
        match worst_miss(scene, &observations, &pose)? {
            (i, z) if z > OUTLIER => {
                fits.remove(i);
            }
            _ => return Some(pose),
        }
    }
}

/// The observation that misses a pose most, and by how many deviations (with what a good one may miss it by).
pub(in crate::tracking) fn worst_miss(scene: &RacketScene, observations: &[MarkerObservation], pose: &RacketPose) -> Option<(usize, f64)> {
    let mut worst = (0, 0.0);
    for (i, o) in observations.iter().enumerate() {
        let (p, _) = scene.figure.patch_in_global(o.marker, &pose.global_from_racket, scene.view.eye(o.camera));
        let r = o.point.uv - scene.view.project(o.camera, &p)?;
        let squared = |k: usize| r[k] * r[k] / (o.point.sd[k] * o.point.sd[k] + MODEL_TOLERANCE_PX * MODEL_TOLERANCE_PX);
        let z = (squared(0) + squared(1)).sqrt();
        if z > worst.1 {
            worst = (i, z);
        }
    }
    Some(worst)
}

/// Deviations as the whole clip shows them. What a band's own picture cannot tell (tape not quite where the file says, a tube of
/// another shape, light along the tube) shows as misses of the common pose, marker by marker and camera by camera: those deviations
/// grow until the misses are what they state. A single point that still misses by more than [`DOUBTFUL`]
/// deviations (another thing touches the band) grows by itself. Where all bands together then miss by less than they state, all
/// shrink to what they miss by. Every pose is then fitted again.
pub fn settle_deviations(view: &View, figure: &RacketFigure, frames: &mut [Option<RacketFrame>]) {
    let misses = |frame: &RacketFrame| -> Vec<(usize, usize, f64)> {
        let miss = |o: &MarkerObservation| {
            let (patch, _) = figure.patch_in_global(o.marker, &frame.pose.global_from_racket, view.eye(o.camera));
            let r = o.point.uv - view.project(o.camera, &patch)?;
            Some((o.camera.index(), o.marker, 0.5 * ((r.x / o.point.sd.x).powi(2) + (r.y / o.point.sd.y).powi(2))))
        };
        frame.observations().iter().filter_map(miss).collect()
    };
    let refit = |frame: &mut RacketFrame| {
        if !frame.foretold
            && let Ok(pose) = fit_pose_in(view, figure, &frame.observations(), Some(&frame.pose.global_from_racket))
        {
            frame.pose = pose;
        }
    };
    // By camera and marker: sum of the squared misses and their number.
    let collect = |frames: &[Option<RacketFrame>]| {
        let mut sums = [[(0.0, 0.0); 5]; 2];
        let of_frame = |frame: &RacketFrame| {
            // A fit takes its share of the scatter: that of the observations beyond the pose's six numbers is left.
            let left = frame.pose.dof as f64 / (frame.pose.dof + 6) as f64;
            (left, misses(frame))
        };
        let of_frames: Vec<_> =
            frames.par_iter().with_max_len(AT_ONCE).flatten().filter(|f| f.stereo() && !f.foretold && f.pose.dof >= 4).map(of_frame).collect();
        for (left, misses) in of_frames {
            for (camera, marker, z2) in misses {
                let sum = &mut sums[camera][marker];
                *sum = (sum.0 + z2.min(DOUBTFUL * DOUBTFUL) / left, sum.1 + 1.0);
            }
        }
        sums
    };
    for _ in 0..2 {
        let sums = collect(frames);
        frames.par_iter_mut().with_max_len(AT_ONCE).flatten().for_each(|frame| {
            for (points, sums) in frame.points.iter_mut().zip(&sums) {
                for (point, sum) in points.iter_mut().zip(sums) {
                    if let Some(p) = point.as_mut().filter(|_| sum.1 >= 5.0) {
                        p.sd *= (sum.0 / sum.1).sqrt().max(1.0);
                    }
                }
            }
            refit(frame);
        });
    }
    let (sum, count) = collect(frames).iter().flatten().filter(|b| b.1 >= 5.0).fold((0.0, 0.0), |(s, n), b| (s + b.0 / b.1, n + 1.0));
    if count > 0.0 && sum < count {
        let by = (sum / count).sqrt().max(LEAST_SHRUNK);
        frames.par_iter_mut().with_max_len(AT_ONCE).flatten().for_each(|frame| {
            frame.points.iter_mut().flatten().flatten().for_each(|p| p.sd *= by);
            // All alike: the pose stays where it is.
            frame.pose.covariance *= by * by;
            frame.pose.chi2 /= by * by;
        });
    }
    frames.par_iter_mut().with_max_len(AT_ONCE).flatten().for_each(|frame| {
        for _ in 0..2 {
            let worst = misses(frame).into_iter().max_by(|a, b| a.2.total_cmp(&b.2));
            let Some((camera, marker, z2)) = worst.filter(|w| w.2 > DOUBTFUL * DOUBTFUL) else { break };
            if let Some(p) = &mut frame.points[camera][marker] {
                p.sd *= z2.sqrt();
            }
            // What the other bands put so far elsewhere is not the marker.
            frame.points[camera][marker] = frame.points[camera][marker].filter(|p| p.sd.max() < MOST_SD_PX);
            refit(frame);
        }
        frame.points.iter_mut().flatten().flatten().for_each(|p| p.sd *= OF_MISSES);
        frame.pose.covariance *= OF_MISSES * OF_MISSES;
        frame.pose.chi2 /= OF_MISSES * OF_MISSES;
    });
}

/// Bands' errors against their misses of the common pose, which contain the figure's errors as well: 0.86 to 1.05 on rendered sessions, 0.80 to
/// 0.94 on others' (against the true patches).
const OF_MISSES: f64 = 0.95;
/// A marker known worse than this is not measured, px.
const MOST_SD_PX: f64 = 0.9;
/// Deviations shrink to no less than this share: what stays the same over a clip are few numbers (20 coordinates of ten bands, of which a
/// pose takes six), and they may be small by chance.
const LEAST_SHRUNK: f64 = 0.5;
