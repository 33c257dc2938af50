//! The ball on the strings: flattened along the face's normal and wider across it.
//!
//! A circle of the free ball's size keeps to one side of the outline of a pressed ball and is up to 5 mm off. Here the outline is that of a
//! spheroid of the ball's volume whose axis is the face's normal, which the racket's pose tells. How much it is flattened is what both
//! cameras' outlines agree with best, over all frames of the contact together: ball and strings are a spring (physics.md E.2), so that the
//! flattening rises and falls like half a sine, or nearly. (Thesis section 4.9.3 leaves these frames out.)

use super::ball_edges::{BallEdges, OutlineCost, Radii, direction, levels};
use super::ball_shading::SECTORS;
use super::ball_track::{BallFrame, BallScene};
use super::contact_length::{LONGEST_CONTACT_S, SHORTEST_CONTACT_S};
use super::racket_track::RacketFrame;
use super::shot_ball::expected_ball;
use super::shot_frames::Shot;
use super::shot_tracker::TrackingError;
use super::space_points::first_contact;
use super::track_file::ImagePoint;
use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyView};
use nalgebra::{Matrix2x3, Matrix3, Point3, Vector2, Vector3};
use rayon::prelude::*;

/// Flattenings tried in every frame: none to almost half, in steps of this.
const STEP: f64 = 0.03;
const STEPS: usize = 15;
/// Steps of the curve's height, and how many lengths of contact are tried.
const CURVE_STEP: f64 = 0.02;
const LENGTHS: usize = 6;
/// How far one frame may be from the curve, one deviation.
const OFF_CURVE: f64 = 0.04;
/// Sectors that a line or a border of light spoils together: neighbours are not independent.
const SECTORS_ALIKE: f64 = 2.0;
/// The ball is pressed where the outlines agree so much better with it (log-likelihood).
const LEAST_GAIN: f64 = 4.5;
/// A frame in which it is flattened by less, or by fewer deviations, is measured as a round ball's.
const LEAST_SHARE: f64 = 0.03;
const LEAST_DEVIATIONS: f64 = 2.0;
/// What a pressed ball's true shape may differ from the spheroid's, as a share of what the flattening moves the outline by: it is flat on
/// one side and round on the other.
const SHAPE_SHARE: f64 = 0.15;
/// Frames on either side of the contact that tell how bright the ball is, at 1000 frames a second.
const FREE_FRAMES: f64 = 6.0;

/// How much the strings flatten the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flattening {
    /// Share by which the ball is shorter along the face's normal than a free one.
    pub share: f64,
    /// One standard deviation.
    pub sd: f64,
}

/// One camera's picture of the ball, and how a body lies in it.
struct Sight {
    camera: CameraId,
    radius_px: f64,
    /// Change of the picture with the place, px per m.
    across: Matrix2x3<f64>,
    edges: BallEdges,
}

impl Sight {
    /// Outline of a spheroid that is flattened by a share along `normal`. Seen from afar a body {x: xᵀ M⁻¹ x = 1} has the outline {u: uᵀ (J M Jᵀ)⁻¹ u = 1}.
    fn outline(&self, share: f64, normal: &Vector3<f64>) -> Option<Radii> {
        let (along, across) = ((1.0 - share).powi(2), 1.0 / (1.0 - share));
        let body = Matrix3::identity() * across + normal * normal.transpose() * (along - across);
        let [flat, round] = [body, Matrix3::identity()].map(|m| (self.across * m * self.across.transpose()).try_inverse());
        let (flat, round) = (flat?, round?);
        Some(std::array::from_fn(|k| {
            let u = direction(k);
            self.radius_px * (u.dot(&(round * u)) / u.dot(&(flat * u))).sqrt()
        }))
    }
}

/// A frame of the contact: what its outlines say of every flattening tried.
struct Touch {
    index: usize,
    /// s after first contact.
    time_s: f64,
    place: Point3<f64>,
    normal: Vector3<f64>,
    sights: Vec<Sight>,
    /// By flattening tried.
    costs: [f64; STEPS],
}

impl Touch {
    /// Of a frame whose face has this normal and whose ball is, or should be, at `place`.
    fn of(
        scene: &BallScene,
        images: &[Option<GreyView>; 2],
        usual: &[[f32; SECTORS]; 2],
        (index, time_s): (usize, f64),
        place: Point3<f64>,
        normal: Vector3<f64>,
        seen: Option<&BallFrame>,
    ) -> Option<Self> {
        let sight = |camera: CameraId| {
            let c = camera.index();
            let (uv, across) = scene.view.project_with_jacobian(camera, &place)?;
            let start = seen.and_then(|b| b.points[c]).map_or(uv, |p| p.uv);
            let (image, radius_px) = (images[c].as_ref()?, scene.radius_px(camera, &place)?);
            let mut sight = Sight { camera, radius_px, across, edges: BallEdges::of(image, start, radius_px, &scene.limb[c], &usual[c])? };
            // Once more from where the best of all outlines lies.
            let costs = (0..STEPS).filter_map(|k| Some(sight.edges.cost(&sight.outline(STEP * k as f64, &normal)?)));
            let best: OutlineCost = costs.min_by(|a, b| a.cost.total_cmp(&b.cost))?;
            sight.edges = BallEdges::of(image, best.centre, radius_px, &scene.limb[c], &usual[c])?;
            Some(sight)
        };
        let sights: Vec<Sight> = CameraId::BOTH.into_iter().filter_map(sight).collect();
        let mut costs = [0.0; STEPS];
        for (k, cost) in costs.iter_mut().enumerate() {
            for sight in &sights {
                *cost += sight.edges.cost(&sight.outline(STEP * k as f64, &normal)?).cost;
            }
        }
        Some(Touch { index, time_s, place, normal, costs, sights })
    }

    /// Cost at a flattening, between those tried.
    fn cost(&self, share: f64) -> f64 {
        let at = (share / STEP).clamp(0.0, (STEPS - 1) as f64);
        let k = (at as usize).min(STEPS - 2);
        self.costs[k] + (self.costs[k + 1] - self.costs[k]) * (at - k as f64)
    }

    /// The flattening that this frame's outlines and the curve of all say; costs count one `heat`-th.
    fn settle(&self, on_curve: f64, heat: f64) -> Flattening {
        const FINER: usize = 6;
        let shares = (0..=(STEPS - 1) * FINER).map(|k| k as f64 * STEP / FINER as f64);
        let costs: Vec<(f64, f64)> = shares.map(|s| (s, self.cost(s) / heat + 0.5 * ((s - on_curve) / OFF_CURVE).powi(2))).collect();
        let least = costs.iter().map(|c| c.1).fold(f64::INFINITY, f64::min);
        let (mut sum, mut mean, mut square) = (0.0, 0.0, 0.0);
        for (share, cost) in costs {
            let w = (least - cost).exp();
            (sum, mean, square) = (sum + w, mean + w * share, square + w * share * share);
        }
        let share = mean / sum;
        Flattening { share, sd: (square / sum - share * share).max(0.0).sqrt().max(STEP / FINER as f64) }
    }

    /// The ball with this flattening; `None` where its pictures do not tell its place.
    fn ball(&self, scene: &BallScene, flattening: Flattening, heat: f64) -> Option<BallFrame> {
        let mut points: [Option<ImagePoint>; 2] = [None, None];
        for sight in &self.sights {
            let centre = |share: f64| Some(sight.edges.cost(&sight.outline(share.max(0.0), &self.normal)?).centre);
            let Flattening { share, sd } = flattening;
            let uv = centre(share)?;
            // How the centre goes with the flattening.
            let by_share = 0.5 * (centre(share + sd)? - centre(share - sd)?);
            let Some(alone) = sight.edges.covariance(&sight.outline(share, &self.normal)?, &uv) else { continue };
            let shape = SHAPE_SHARE * share * sight.radius_px;
            let deviation = |k: usize| (heat * alone[(k, k)] + by_share[k].powi(2) + shape * shape).sqrt();
            points[sight.camera.index()] = Some(ImagePoint { uv, sd: Vector2::new(deviation(0), deviation(1)) });
        }
        let joined = scene.join(points, &self.place)?;
        Some(BallFrame { flattening: Some(flattening), ..joined })
    }
}

/// Flattening over the contact: half a sine.
#[derive(Debug, Clone, Copy)]
struct Press {
    most: f64,
    length_s: f64,
}

impl Press {
    const NONE: Press = Press { most: 0.0, length_s: SHORTEST_CONTACT_S };

    fn at(&self, time_s: f64) -> f64 {
        if (0.0..self.length_s).contains(&time_s) { self.most * (std::f64::consts::PI * time_s / self.length_s).sin() } else { 0.0 }
    }

    fn cost(&self, touches: &[Touch]) -> f64 {
        touches.iter().map(|t| t.cost(self.at(t.time_s))).sum()
    }

    /// The curve that all frames agree with best, and its cost.
    fn of(touches: &[Touch]) -> Option<(Press, f64)> {
        let lengths = (0..LENGTHS).map(|k| SHORTEST_CONTACT_S + (LONGEST_CONTACT_S - SHORTEST_CONTACT_S) * k as f64 / (LENGTHS - 1) as f64);
        let most = (1..).map(|k| CURVE_STEP * f64::from(k)).take_while(|m| *m < STEP * (STEPS - 1) as f64);
        let curves = lengths.flat_map(|length_s| most.clone().map(move |most| Press { most, length_s }));
        curves.map(|p| (p, p.cost(touches))).min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

impl<S: FrameSource> Shot<'_, S> {
    /// Measures the ball anew where the strings press it.
    pub(super) fn press_ball(&self, scene: &BallScene, racket: &[Option<RacketFrame>], ball: &mut [Option<BallFrame>]) -> Result<(), TrackingError> {
        let Some(contact) = first_contact(self.source, racket, ball, scene.radius_m) else { return Ok(()) };
        let numbers: Vec<f64> = (0..ball.len()).map(|i| self.source.number(i) as f64).collect();
        let time_s = |i: usize| (numbers[i] - contact) / self.setup.frame_rate_hz;
        let known: &[Option<BallFrame>] = ball;
        let Some(usual) = self.usual_levels(scene, known, &time_s)? else { return Ok(()) };
        let touch = |buffers: &mut [FrameBuffer; 2], index: usize| -> Result<Option<Touch>, TrackingError> {
            let Some(racket) = &racket[index] else { return Ok(None) };
            let Some(place) = known[index].map(|b| b.position).or_else(|| Some(expected_ball(known, &numbers, index)?.0)) else { return Ok(None) };
            let images = self.read_rows(index, self.ball_rows(scene, &place, 4), buffers)?;
            let normal = racket.pose.global_from_racket.rotation * Vector3::z();
            Ok(Touch::of(scene, &images, &usual, (index, time_s(index)), place, normal, known[index].as_ref()))
        };
        let indices: Vec<usize> = (0..ball.len()).filter(|i| (0.0..LONGEST_CONTACT_S).contains(&time_s(*i))).collect();
        let touches: Result<Vec<Option<Touch>>, TrackingError> = indices.into_par_iter().map_init(Default::default, touch).collect();
        let touches: Vec<Touch> = touches?.into_iter().flatten().collect();
        let Some((press, cost)) = Press::of(&touches) else { return Ok(()) };
        // Half a unit is what a sector of a right outline adds.
        let sectors = touches.iter().map(|t| t.sights.len() * SECTORS).sum::<usize>();
        let heat = SECTORS_ALIKE * (2.0 * cost / sectors.max(1) as f64).max(1.0);
        if std::env::var("PQ").is_ok() {
            eprintln!("Q curve {cost:.1} {press:?} none {:.1} heat {heat:.2}", Press::NONE.cost(&touches));
        }
        if Press::NONE.cost(&touches) - cost < heat * LEAST_GAIN {
            return Ok(());
        }
        for t in &touches {
            let flattening = t.settle(press.at(t.time_s), heat);
            if flattening.share > LEAST_SHARE.max(LEAST_DEVIATIONS * flattening.sd)
                && let Some(pressed) = t.ball(scene, flattening, heat)
            {
                ball[t.index] = Some(pressed);
            }
        }
        Ok(())
    }

    /// How bright every sector's ball is in free flight near the contact, by camera: the median, because lines pass.
    fn usual_levels(&self, scene: &BallScene, ball: &[Option<BallFrame>], time_s: &dyn Fn(usize) -> f64) -> Result<Option<[[f32; SECTORS]; 2]>, TrackingError> {
        let near = FREE_FRAMES / 1000.0;
        let free = |t: f64| (-near..0.0).contains(&t) || (LONGEST_CONTACT_S..LONGEST_CONTACT_S + near).contains(&t);
        let mut seen: [Vec<[f32; SECTORS]>; 2] = Default::default();
        let mut buffers: [FrameBuffer; 2] = Default::default();
        for (index, b) in ball.iter().enumerate().filter_map(|(i, b)| Some((i, b.as_ref()?))).filter(|(i, _)| free(time_s(*i))) {
            let images = self.read_rows(index, self.ball_rows(scene, &b.position, 1), &mut buffers)?;
            for camera in CameraId::BOTH {
                let c = camera.index();
                let (Some(image), Some(point), Some(radius_px)) = (&images[c], b.points[c], scene.radius_px(camera, &b.position)) else { continue };
                seen[c].extend(levels(image, &point.uv, radius_px, &scene.limb[c]));
            }
        }
        let median = |seen: &[[f32; SECTORS]], k: usize| {
            let mut levels: Vec<f32> = seen.iter().map(|l| l[k]).collect();
            let mid = levels.len() / 2;
            *levels.select_nth_unstable_by(mid, f32::total_cmp).1
        };
        Ok(seen.iter().all(|s| !s.is_empty()).then(|| seen.each_ref().map(|s| std::array::from_fn(|k| median(s, k)))))
    }
}
