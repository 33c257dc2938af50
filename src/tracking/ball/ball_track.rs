//! Follows the ball from frame to frame in space: predicted place in both pictures, outline fit, one point from two rays.

use crate::calibration::CameraId;
use crate::footage::{GreyImage, GreyPatch, GreyView, Rows};
use crate::tracking::ball::ball_fit::{self, BallFit, OutlineLevels};
use crate::tracking::ball::ball_pressed::Flattening;
use crate::tracking::ball::ball_ring::REACH_PX;
use crate::tracking::ball::ball_search::{self, BallCandidate};
use crate::tracking::ball::ball_shading::{BallShading, INSIDE_LIMB, LimbProfile};
use crate::tracking::ball::dim_picture::Stretch;
use crate::tracking::racket::racket_pose::View;
use crate::tracking::track_file::ImagePoint;
use nalgebra::{Point3, Vector2, Vector3};
use std::sync::LazyLock;

/// Least deviation of the ball's centre, px.
const FLOOR_SD_PX: f64 = 0.02;
/// Last step of a fit, px: the final one, and while the ball is first followed.
const SETTLED_PX: f64 = 0.004;
pub(in crate::tracking) const ROUGH_PX: f64 = 0.04;
/// Share of the outline that must stand out from the surroundings.
const LEAST_OUTLINE: f64 = 0.3;
/// The same when the other camera's ray meets this one's where the ball was expected.
const LEAST_SUPPORTED_OUTLINE: f64 = 0.15;
/// A faint outline may be this far from where the ball was expected, px.
pub(in crate::tracking) const FAINT_SHIFT_PX: f64 = 2.0;
/// A ball on the strings changes its velocity by less than this per frame, m (50 m/s over 5 ms), and depth is good to
/// about as much; with every pixel of search a quarter more.
const STEP_M: f64 = 0.015;
/// Frames after which a ball not seen by both cameras may be anywhere near.
const LONGEST_UNSEEN: f64 = 6.0;
/// Share above which a fit from the predicted place is taken at once.
const CLEAR_OUTLINE: f64 = 0.6;
/// A fit from a place this near to another one's end leads there too, px.
const SAME_OUTLINE_PX: f64 = 1.0;
/// A ball this near to its predicted place needs no more rows than those of its outline, px.
const CLOSE_PX: f64 = 1.0;
/// The two rays of one ball may miss each other by this, px (deviations are added).
const RAY_TOLERANCE_PX: f64 = 0.8;
/// No ball in play is faster, m/s.
pub(in crate::tracking) const FASTEST_M_S: f64 = 90.0;

/// The ball in one frame.
#[derive(Debug, Clone, Copy)]
pub struct BallFrame {
    pub points: [Option<ImagePoint>; 2],
    /// Where both rays meet, global, m; from one camera alone, on that ray at the predicted depth.
    pub position: Point3<f64>,
    /// Both cameras measured it.
    pub stereo: bool,
    /// Of a ball that the strings press.
    pub flattening: Option<Flattening>,
}

impl BallFrame {
    /// Takes away what one camera saw, and the frame with it when the other saw nothing.
    pub fn forget(frame: &mut Option<BallFrame>, camera: usize) {
        let Some(ball) = frame else { return };
        ball.points[camera] = None;
        ball.stereo = false;
        if ball.points.iter().all(Option::is_none) {
            *frame = None;
        }
    }
}

/// What all frames share.
#[derive(Clone)]
pub struct BallScene<'a> {
    pub view: &'a View<'a>,
    pub radius_m: f64,
    /// What the ball looks like across its outline, by camera.
    pub limb: [LimbProfile; 2],
    pub frame_rate_hz: f64,
    /// Whether a faint outline counts where the other camera's ray meets it: only once the ball's flight is known, or
    /// tracks of other things would live on.
    pub faint: bool,
    /// How either camera's pictures are stretched where the ball is looked for.
    pub dim: [Option<Stretch>; 2],
}

impl BallScene<'_> {
    /// Radius of the ball's outline in a picture, px, at a global place.
    pub fn radius_px(&self, camera: CameraId, at: &Point3<f64>) -> Option<f64> {
        outline_radius_px(self.view, camera, at, self.radius_m)
    }

    /// Places of a whole picture that may be the ball.
    pub(in crate::tracking) fn candidates(&self, image: &GreyView, camera: CameraId, background: &GreyImage, radius_px: f64) -> Vec<BallCandidate> {
        match &self.dim[camera.index()] {
            Some(stretch) => ball_search::candidates_in_dim(image, background, radius_px, stretch),
            None => ball_search::candidates(image, background, radius_px),
        }
    }

    /// The place near another that is likest to be the ball.
    fn nearby(&self, image: &GreyView, camera: CameraId, centre: Vector2<f64>, radius_px: f64, reach_px: i64) -> Option<Vector2<f64>> {
        match &self.dim[camera.index()] {
            Some(stretch) => ball_search::nearby_in_dim(image, centre, radius_px, reach_px, stretch),
            None => ball_search::nearby(image, centre, radius_px, reach_px),
        }
    }

    /// Good enough when the other camera says the same.
    pub(in crate::tracking) fn fair(f: &BallFit) -> bool {
        f.outline >= LEAST_SUPPORTED_OUTLINE && f.covariance[(0, 0)] + f.covariance[(1, 1)] < 0.3
    }

    /// An outline: good enough when both cameras' rays meet. Strings and clutter behind the ball raise the residual, not the
    /// doubt about the place.
    fn outlined(f: &BallFit) -> bool {
        f.outline >= LEAST_OUTLINE && f.edge > f.residual.max(0.7) && f.covariance[(0, 0)] + f.covariance[(1, 1)] < 0.5
    }

    /// Good enough by itself.
    pub(in crate::tracking) fn good(f: &BallFit) -> bool {
        Self::outlined(f) && f.edge > 2.0 * f.residual.max(0.7)
    }

    /// The outline near a place; a faint one counts when faint ones do.
    pub fn outline_near(&self, image: &GreyView, camera: CameraId, start: Vector2<f64>, radius_px: f64) -> Option<BallFit> {
        let outline = ball_fit::fit(image, start, radius_px, &self.limb[camera.index()], ROUGH_PX, None)?;
        (Self::outlined(&outline) || self.faint && Self::fair(&outline)).then_some(outline)
    }

    /// The rows that [`Self::measure_close`] looks at.
    pub fn close_rows(&self, predicted: &Point3<f64>) -> [Rows; 2] {
        CameraId::BOTH.map(|camera| {
            let (Some(uv), Some(radius)) = (self.view.project(camera, predicted), self.radius_px(camera, predicted)) else { return Rows::ALL };
            let half = radius + REACH_PX + 2.0 * CLOSE_PX + 1.0;
            Rows::of([self.view.rows(uv.y - half, uv.y + half + 1.0)])
        })
    }

    /// What [`Self::measure_close`] looks at, of a ball seen by both cameras.
    pub fn patches(&self, images: &[Option<GreyView>; 2], ball: &BallFrame) -> Option<[GreyPatch; 2]> {
        let patch = |camera: CameraId| {
            let (image, uv) = (images[camera.index()].as_ref()?, ball.points[camera.index()]?.uv);
            let half = self.radius_px(camera, &ball.position)? + REACH_PX + CLOSE_PX + 0.5;
            let corner = |sign: f64| ((uv.x + sign * half).round() as i64, (uv.y + sign * half).round() as i64);
            GreyPatch::of(image, corner(-1.0), corner(1.0))
        };
        Some([patch(CameraId::Left)?, patch(CameraId::Right)?])
    }

    /// Whether the ball is seen right where it was predicted, by every camera that also saw it in the frame before, or by all if none did: one that
    /// finds it again may have found another thing.
    pub fn as_foretold(&self, ball: &BallFrame, predicted: &Point3<f64>, saw_it: [bool; 2]) -> bool {
        let near = |camera: CameraId| Some((ball.points[camera.index()]?.uv - self.view.project(camera, predicted)?).norm() <= CLOSE_PX);
        let asked = |camera: &CameraId| saw_it[camera.index()] && ball.points[camera.index()].is_some();
        let any = CameraId::BOTH.iter().any(asked);
        CameraId::BOTH.into_iter().filter(|c| asked(c) || !any).all(|c| near(c).unwrap_or(true))
    }

    /// [`Self::measure`] where both cameras see the ball clearly and right where it was predicted: few rows suffice then. What was fitted comes
    /// back where more must be looked at. `before` is what the same pictures showed when they were measured first; `well_foretold` says that the ball
    /// has come straight to the predicted place for some frames, where any outline is its own.
    pub fn measure_close(
        &self,
        images: &[Option<GreyView>; 2],
        predicted: &Point3<f64>,
        before: Option<&[OutlineLevels; 2]>,
        unseen: f64,
        well_foretold: bool,
    ) -> Result<(BallFrame, [OutlineLevels; 2]), [Option<BallFit>; 2]> {
        let settled = if self.faint { SETTLED_PX } else { ROUGH_PX };
        let mut fits: [Option<BallFit>; 2] = [None, None];
        for camera in CameraId::BOTH {
            let (Some(image), Some(centre), Some(radius)) = (&images[camera.index()], self.view.project(camera, predicted), self.radius_px(camera, predicted))
            else {
                return Err(fits);
            };
            let f = ball_fit::fit(image, centre, radius, &self.limb[camera.index()], settled, before.map(|b| &b[camera.index()]));
            let sure = f.as_ref().is_some_and(|f| {
                let enough = if self.faint { Self::outlined(f) || Self::fair(f) } else { Self::outlined(f) && (well_foretold || f.outline >= CLEAR_OUTLINE) };
                enough && (f.uv - centre).norm() <= CLOSE_PX
            });
            fits[camera.index()] = f;
            if !sure {
                return Err(fits);
            }
        }
        let ball = self.together(&fits, predicted, self.most_off_m(1, unseen)).filter(|b| b.stereo);
        match (ball, &fits) {
            (Some(ball), [Some(left), Some(right)]) => Ok((ball, [left.outline_as_seen, right.outline_as_seen])),
            _ => Err(fits),
        }
    }

    /// The ball near a predicted place (global, m). `reach_px` is how far the prediction may be off in either picture, `unseen` how many frames ago both
    /// cameras saw it, `close` what [`Self::measure_close`] fitted there.
    pub fn measure(
        &self,
        images: &[Option<GreyView>; 2],
        predicted: &Point3<f64>,
        reach_px: [i32; 2],
        unseen: f64,
        close: &[Option<BallFit>; 2],
    ) -> Option<BallFrame> {
        let mut fits: [Option<BallFit>; 2] = [None, None];
        for camera in CameraId::BOTH {
            let Some(image) = &images[camera.index()] else { continue };
            let (Some(centre), Some(radius)) = (self.view.project(camera, predicted), self.radius_px(camera, predicted)) else { continue };
            let (limb, reach_px) = (&self.limb[camera.index()], reach_px[camera.index()]);
            // As long as the light is not known either, more would be for nothing.
            let settled = if self.faint { SETTLED_PX } else { ROUGH_PX };
            let near = |f: &BallFit| Self::outlined(f) && (f.uv - centre).norm() < f64::from(reach_px) + 1.5;
            // A faint outline counts only right where the ball was expected.
            let mut found = close[camera.index()]
                .clone()
                .or_else(|| ball_fit::fit(image, centre, radius, limb, settled, None))
                .filter(|f| near(f) || self.faint && Self::fair(f) && (f.uv - centre).norm() < FAINT_SHIFT_PX);
            // A clear outline where it was expected needs no search.
            if reach_px > 1
                && found.as_ref().is_none_or(|f| f.outline < CLEAR_OUTLINE)
                && let Some(start) = self.nearby(image, camera, centre, radius, i64::from(reach_px))
                && found.as_ref().is_none_or(|f| (f.uv - start).norm() > SAME_OUTLINE_PX)
                && let Some(other) = ball_fit::fit(image, start, radius, limb, settled, None).filter(near)
                && found.as_ref().is_none_or(|f| other.outline > f.outline)
            {
                found = Some(other);
            }
            // Once the flight is known, what the border leaves of the ball counts as a faint outline does.
            if self.faint && found.is_none() {
                found = ball_fit::fit_cut(image, centre, radius, limb, settled)
                    .filter(|f| image.holds(f.uv.x, f.uv.y) && Self::fair(f) && (f.uv - centre).norm() < FAINT_SHIFT_PX);
            }
            fits[camera.index()] = found;
        }
        self.together(&fits, predicted, self.most_off_m(reach_px[0].max(reach_px[1]), unseen))
    }

    /// How far from the predicted place the ball may be, m: between neighbours in time by a step, beyond them by what the strings change
    /// its velocity in as many frames.
    fn most_off_m(&self, reach_px: i32, unseen: f64) -> f64 {
        let n = unseen.clamp(1.0, LONGEST_UNSEEN) * 1000.0 / self.frame_rate_hz;
        let steps = if self.faint { 1.0 } else { (0.5 * n * (n + 1.0)).max(1.0) };
        STEP_M * (steps + 0.25 * f64::from(reach_px))
    }

    /// One ball from what either camera sees, within `most_off_m` of where it was predicted.
    fn together(&self, fits: &[Option<BallFit>; 2], predicted: &Point3<f64>, most_off_m: f64) -> Option<BallFrame> {
        let both = [fits[0].as_ref().map(image_point), fits[1].as_ref().map(image_point)];
        // Along the epipolar lines the two cameras agree on any depth: the place must also be near the expected one.
        if both.iter().all(Option::is_some)
            && fits.iter().flatten().any(Self::outlined)
            && let Some(b) = self.join(both, predicted)
            && (b.position - predicted).norm() < most_off_m
        {
            return Some(b);
        }
        // The cameras disagree or one sees nothing: only a clear outline stands alone, the clearer one of two.
        let clear = |f: &Option<BallFit>| f.as_ref().filter(|f| Self::good(f)).map_or(0.0, |f| f.outline);
        let shares = [clear(&fits[0]), clear(&fits[1])];
        let one = usize::from(shares[1] > shares[0]);
        let mut points = [None, None];
        points[one] = both[one];
        if shares[one] > 0.0 { self.join(points, predicted) } else { None }
    }

    pub(in crate::tracking) fn join(&self, points: [Option<ImagePoint>; 2], predicted: &Point3<f64>) -> Option<BallFrame> {
        match points {
            [Some(l), Some(r)] => {
                let (p, gap) = self.view.triangulate(l.uv, r.uv)?;
                let px = self.radius_px(CameraId::Left, &p)? / self.radius_m;
                let tolerance = RAY_TOLERANCE_PX + 3.0 * (l.sd.norm() + r.sd.norm());
                (gap * px < tolerance).then_some(BallFrame { points, position: p, stereo: true, flattening: None })
            }
            [Some(one), None] | [None, Some(one)] => {
                let camera = if points[0].is_some() { CameraId::Left } else { CameraId::Right };
                let ray = self.view.ray(camera, one.uv)?;
                let eye = self.view.eye(camera);
                let position = eye + ray * (predicted - eye).dot(&ray);
                Some(BallFrame { points, position, stereo: false, flattening: None })
            }
            _ => None,
        }
    }

    /// Adds the picture of the disc to a mean picture, by place in ball radii.
    pub fn add_to_mean(&self, mean: &mut MeanDisc, image: &GreyView, camera: CameraId, ball: &BallFrame) {
        let (Some(point), Some(radius)) = (ball.points[camera.index()], self.radius_px(camera, &ball.position)) else { return };
        for (cell, place) in mean.cells.iter_mut().zip(&*MEAN_PLACES) {
            let Some((x, y)) = *place else { continue };
            let at = point.uv + Vector2::new(x, y) * radius;
            // Places inside the picture are not negative: a cast rounds them down.
            if let Some(grey) = image.get((at.x + 0.5) as i64, (at.y + 0.5) as i64) {
                *cell = (cell.0 + f64::from(grey), cell.1 + 1.0);
            }
        }
    }

    /// Sets the limb profiles from the mean pictures of the discs.
    pub fn set_light(&mut self, means: &[MeanDisc; 2], near: &Point3<f64>, blur_px: &[f64; 2]) {
        for camera in CameraId::BOTH {
            let shading = BallShading::of_mean_disc(&means[camera.index()].disc()).unwrap_or_default();
            if let Some(radius) = self.radius_px(camera, near) {
                self.limb[camera.index()] = LimbProfile::new(&shading, radius, blur_px[camera.index()]);
            }
        }
    }
}

/// Radius of the outline of a ball at a global place, px.
pub fn outline_radius_px(view: &View, camera: CameraId, at: &Point3<f64>, radius_m: f64) -> Option<f64> {
    let toward = (view.eye(camera) - at).normalize();
    let (_, j) = view.project_with_jacobian(camera, at)?;
    let a = toward.cross(&Vector3::y()).try_normalize(1e-6)?;
    let b = toward.cross(&a);
    // A sphere's outline is tangent to it: sin instead of tan of half the angle makes it larger by (r/z)²/2, below 1e-5.
    Some(radius_m * 0.5 * ((j * a).norm() + (j * b).norm()))
}

/// Places along a side of a mean picture: about as many as a ball has pixels.
const MEAN_SIDE: usize = 15;
/// The places of a mean picture that tell the light, in ball radii; those near the outline do not.
static MEAN_PLACES: LazyLock<Vec<Option<(f64, f64)>>> =
    LazyLock::new(|| (0..MEAN_SIDE * MEAN_SIDE).map(|i| Some(MeanDisc::place(i)).filter(|(x, y)| x.hypot(*y) < INSIDE_LIMB)).collect());

/// A mean picture of the ball's disc on a grid of places as wide as the disc, [`MEAN_SIDE`] to a side.
#[derive(Debug, Clone)]
pub struct MeanDisc {
    cells: Vec<(f64, f64)>,
}

impl Default for MeanDisc {
    fn default() -> Self {
        MeanDisc { cells: vec![(0.0, 0.0); MEAN_SIDE * MEAN_SIDE] }
    }
}

impl MeanDisc {
    fn place(i: usize) -> (f64, f64) {
        let at = |k: usize| k as f64 / (MEAN_SIDE / 2) as f64 - 1.0;
        (at(i % MEAN_SIDE), at(i / MEAN_SIDE))
    }

    /// Adds the pictures of another mean.
    pub fn add(&mut self, other: &MeanDisc) {
        for (cell, more) in self.cells.iter_mut().zip(&other.cells) {
            *cell = (cell.0 + more.0, cell.1 + more.1);
        }
    }

    fn disc(&self) -> Vec<(f64, f64, f64)> {
        self.cells.iter().enumerate().filter(|(_, c)| c.1 > 0.0).map(|(i, c)| (Self::place(i).0, Self::place(i).1, c.0 / c.1)).collect()
    }
}

pub(in crate::tracking) fn image_point(f: &BallFit) -> ImagePoint {
    let sd = |v: f64| v.sqrt().hypot(FLOOR_SD_PX);
    ImagePoint { uv: f.uv, sd: Vector2::new(sd(f.covariance[(0, 0)]), sd(f.covariance[(1, 1)])) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footage::GreyImage;
    use crate::tracking::racket::racket_pose::tests::rig;

    /// Bright discs before a dark wall, a grey ramp two pixels wide at the outline.
    fn picture(centre: Vector2<f64>, radius: f64) -> GreyImage {
        let grey = |i: usize| {
            let inside = 0.5 + 0.5 * (radius - (Vector2::new((i % 512) as f64, (i / 512) as f64) - centre).norm());
            50 + (130.0 * inside.clamp(0.0, 1.0)) as u8
        };
        GreyImage { width: 512, height: 512, pixels: (0..512 * 512).map(grey).collect() }
    }

    #[test]
    fn truth_two_discs_on_one_epipolar_line_are_no_ball_where_none_can_have_got_to() {
        let rig = rig();
        let view = View::new(&rig);
        let limb = LimbProfile::new(&BallShading::default(), 8.0, 0.55);
        let scene = BallScene { view: &view, radius_m: 0.033, limb: [limb.clone(), limb], frame_rate_hz: 1000.0, faint: false, dim: [None; 2] };
        let there = Point3::new(0.1, 1.05, 0.05);
        // The right camera shows another disc, 5 cm farther along the left one's ray.
        let other = there + view.ray(CameraId::Left, view.project(CameraId::Left, &there).expect("seen")).expect("a ray") * 0.05;
        let image = |camera: CameraId, at: &Point3<f64>| picture(view.project(camera, at).expect("seen"), scene.radius_px(camera, at).expect("seen"));
        let (left, same, another) = (image(CameraId::Left, &there), image(CameraId::Right, &there), image(CameraId::Right, &other));
        let measure = |right: &GreyImage, unseen: f64| {
            scene.measure(&[Some(GreyView::of(&left)), Some(GreyView::of(right))], &there, [8, 8], unseen, &[None, None]).expect("a ball")
        };
        assert!(measure(&same, 1.0).stereo && !measure(&another, 1.0).stereo);
        // Six frames after both cameras saw it the strings may have sent it there.
        assert!(measure(&another, 6.0).stereo);
    }
}
