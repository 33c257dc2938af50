//! The ball on the strings: flattened along the face's normal and wider across it.
//!
//! A circle of the free ball's size keeps to one side of the outline of a pressed ball and is up to 5 mm off. Here the outline is that of a
//! spheroid of the ball's volume whose axis is the face's normal, which the racket's pose tells. How much it is flattened is what both
//! cameras' outlines agree with best, over all frames of the contact together: it rises and falls like half a sine, or nearly (Brody 2000, thesis
//! equation 2.21; docs/impact.md, squeezed ball, whose k is the largest share).

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyView};
use crate::tracking::ball::ball_edges::{BallEdges, Radii, downhill, levels};
use crate::tracking::ball::ball_ring::DIRECTIONS;
use crate::tracking::ball::ball_shading::SECTORS;
use crate::tracking::ball::ball_through::ThroughContact;
use crate::tracking::ball::ball_track::{BallFrame, BallScene};
use crate::tracking::ball::contact_length::{LONGEST_CONTACT_S, SHORTEST_CONTACT_S};
use crate::tracking::ball::stray_ball::{OUTLINE_PX, drop_strays};
use crate::tracking::pictures::shot_frames::{AT_ONCE, Shot};
use crate::tracking::racket::racket_scene::RacketFrame;
use crate::tracking::shot_tracks::TrackingError;
use crate::tracking::space_points::first_contact;
use crate::tracking::track_file::ImagePoint;
use nalgebra::{Matrix2x3, Matrix3, Point3, Vector2, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Flattenings tried in every frame: none to almost half, in steps of this.
const STEP: f64 = 0.03;
const STEPS: usize = 15;
/// One in so many of them is looked for anywhere, those after it from where the last was.
const LOOK_AGAIN: usize = 3;
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
/// What a pressed ball's true shape may differ from the spheroid's, as a share of the flattening and of what it moves the outline by: it is
/// flat on one side and round on the other.
const SHAPE_SHARE: f64 = 0.15;
/// Along a line of sight places are tried this far apart in the other picture, px, so many each way.
const ALONG_PX: f64 = 0.5;
const ALONG: i32 = 7;
/// A circle fitted to a pressed ball is no farther off than this, px: what lies farther from it is another thing.
const CIRCLE_OFF_PX: f64 = 2.5;
/// Nor is the way that the flights foretell: on 180 rendered shots by 0.1 to 0.25 px, in one of a hundred frames by 0.9.
const WAY_OFF_PX: f64 = 1.5;
/// Where a pressed ball could not be measured and the circle stays, that is off by this share of flattening and radius, one deviation.
const CIRCLE_OFF_SHARE: f64 = 0.4;
/// Frames on either side of the contact that tell how bright the ball is, at 1000 frames a second.
const FREE_FRAMES: f64 = 6.0;

/// How much the strings flatten the ball.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Flattening {
    /// Share by which the ball is shorter along the face's normal than a free one.
    pub share: f64,
    /// One standard deviation.
    pub sd: f64,
}

impl Flattening {
    /// Whether a ball may have it.
    pub fn is_possible(&self) -> bool {
        (0.0..1.0).contains(&self.share) && self.sd > 0.0 && self.sd.is_finite()
    }
}

/// The flattening in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PressedFrame {
    pub frame: u64,
    #[serde(flatten)]
    pub flattening: Flattening,
}

impl PressedFrame {
    /// Where the ball of a shot was measured as pressed.
    pub fn of(source: &impl FrameSource, ball: &[Option<BallFrame>]) -> Vec<PressedFrame> {
        let frame = |(index, ball): (usize, &Option<BallFrame>)| Some(PressedFrame { frame: source.number(index), flattening: ball.as_ref()?.flattening? });
        ball.iter().enumerate().filter_map(frame).collect()
    }
}

/// One camera's picture of the ball, and how a body lies in it.
struct Sight {
    camera: CameraId,
    radius_px: f64,
    /// Where the ball is looked for, px, and how that changes with the place, px per m.
    uv: Vector2<f64>,
    across: Matrix2x3<f64>,
    edges: BallEdges,
}

impl Sight {
    fn outline(&self, share: f64, normal: &Vector3<f64>) -> Option<Radii> {
        spheroid_outline(share, normal, self.radius_px, &self.across)
    }

    /// Where a place beside that lies in the picture.
    fn at(&self, offset: &Vector3<f64>) -> Vector2<f64> {
        self.uv + self.across * offset
    }
}

/// Outline of a spheroid that is flattened by a share along `normal`; `across` is the change of the picture with the place, px per m, and `radius_px` the round
/// ball's. Seen from afar a body {x: xᵀ M⁻¹ x = 1} has the outline {u: uᵀ (J M Jᵀ)⁻¹ u = 1}.
fn spheroid_outline(share: f64, normal: &Vector3<f64>, radius_px: f64, across: &Matrix2x3<f64>) -> Option<Radii> {
    let (short, long) = ((1.0 - share).powi(2), 1.0 / (1.0 - share));
    let body = Matrix3::identity() * long + normal * normal.transpose() * (short - long);
    let [flat, round] = [body, Matrix3::identity()].map(|m| (across * m * across.transpose()).try_inverse());
    let (flat, round) = (flat?, round?);
    Some(std::array::from_fn(|k| {
        let u = DIRECTIONS[k];
        radius_px * (u.dot(&(round * u)) / u.dot(&(flat * u))).sqrt()
    }))
}

/// A frame of the contact: what its outlines say of every flattening tried.
struct Touch {
    index: usize,
    /// s after first contact.
    time_s: f64,
    place: Point3<f64>,
    /// By the ball's free flights, to some tenths of a pixel; otherwise it is a circle's.
    foretold: bool,
    normal: Vector3<f64>,
    sights: Vec<Sight>,
    /// By flattening tried.
    costs: [f64; STEPS],
}

/// Where a ball with some flattening costs least.
struct Placed {
    cost: f64,
    /// From where it was looked for, m, where two cameras tell it.
    offset: Vector3<f64>,
    /// In each sight.
    centres: Vec<Vector2<f64>>,
}

impl Touch {
    /// Of a frame whose face has this normal and whose ball lies at `place`, which is foretold or that of a ball taken for round.
    fn of(
        scene: &BallScene,
        images: &[Option<GreyView>; 2],
        usual: &[[f32; SECTORS]; 2],
        (index, time_s): (usize, f64),
        (place, foretold): (Point3<f64>, bool),
        normal: Vector3<f64>,
    ) -> Option<Self> {
        let sight = |camera: CameraId, centre: Vector2<f64>| {
            let c = camera.index();
            let (uv, across) = scene.view.project_with_jacobian(camera, &place)?;
            let (image, radius_px) = (images[c].as_ref()?, scene.radius_px(camera, &place)?);
            Some(Sight { camera, radius_px, uv, across, edges: BallEdges::of(image, centre, radius_px, &scene.limb[c], &usual[c])? })
        };
        let first: Vec<Sight> = CameraId::BOTH.into_iter().filter_map(|c| sight(c, scene.view.project(c, &place)?)).collect();
        let mut touch = Touch { index, time_s, place, foretold, normal, sights: first, costs: [0.0; STEPS] };
        let mut seen: [Option<Placed>; STEPS] = Default::default();
        if !foretold {
            // Once more from where the best of some outlines lies.
            for k in (0..STEPS).step_by(LOOK_AGAIN) {
                seen[k] = touch.best(STEP * k as f64, None);
            }
            let centres = seen.iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost))?.centres.clone();
            let sights: Vec<Sight> = touch.sights.iter().zip(centres).filter_map(|(s, centre)| sight(s.camera, centre)).collect();
            if sights.len() < touch.sights.len() {
                seen = Default::default();
            }
            touch.sights = sights;
        }
        let mut last: Option<Placed> = None;
        for k in 0..STEPS {
            let placed = touch.best(STEP * k as f64, seen[k].take().or(last).as_ref())?;
            touch.costs[k] = placed.cost;
            last = Some(placed);
        }
        Some(touch)
    }

    /// Where a ball flattened by a share costs least, from where one flattened nearly as much does, where the ball is foretold, or from anywhere. Two
    /// cameras are asked for one place in space.
    fn best(&self, share: f64, near: Option<&Placed>) -> Option<Placed> {
        let outlines: Vec<Radii> = self.sights.iter().map(|s| s.outline(share, &self.normal)).collect::<Option<_>>()?;
        let on_grid = |k: usize| self.sights[k].edges.best_on_grid(&outlines[k]);
        let [one, two] = self.sights.as_slice() else {
            let (sight, outline) = (self.sights.first()?, outlines.first()?);
            let start = near.and_then(|p| p.centres.first().copied()).unwrap_or_else(|| if self.foretold { sight.uv } else { on_grid(0) });
            let (centre, cost) = downhill(start, 1.0, |c| sight.edges.bowl_at(outline, c));
            return Some(Placed { cost, offset: Vector3::zeros(), centres: vec![centre] });
        };
        let cost = |offset: &Vector3<f64>| one.edges.cost_at(&outlines[0], &one.at(offset)) + two.edges.cost_at(&outlines[1], &two.at(offset));
        let start = match near {
            Some(placed) => placed.offset,
            None if self.foretold => Vector3::zeros(),
            None => {
                // From where either camera alone sees it best, along that camera's line of sight.
                let mut starts: Vec<(f64, Vector3<f64>)> = Vec::new();
                for (k, (seen, other)) in [(one, two), (two, one)].into_iter().enumerate() {
                    let ray = seen.across.row(0).transpose().cross(&seen.across.row(1).transpose()).try_normalize(0.0)?;
                    let beside = seen.across.transpose() * (seen.across * seen.across.transpose()).try_inverse()? * (on_grid(k) - seen.uv);
                    let spacing = ALONG_PX / (other.across * ray).norm().max(1e-9);
                    starts.extend((-ALONG..=ALONG).map(|k| beside + ray * (spacing * f64::from(k))).map(|offset| (cost(&offset), offset)));
                }
                starts.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?.1
            }
        };
        let bowl = |(k, sight): (usize, &Sight), offset: &Vector3<f64>| sight.edges.bowl_at(&outlines[k], &sight.at(offset)).seen(&sight.across);
        let (offset, cost) = downhill(start, 1.0 / one.across.row(0).norm(), |offset| bowl((0, one), offset) + bowl((1, two), offset));
        Some(Placed { cost, offset, centres: vec![one.at(&offset), two.at(&offset)] })
    }

    /// Whether a ball lies near to where it was looked for.
    fn near_its_place(&self, ball: &BallFrame) -> bool {
        self.sights.iter().all(|s| ball.points[s.camera.index()].is_none_or(|p| (p.uv - s.uv).norm() < WAY_OFF_PX))
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

    /// The ball with this flattening, whose deviation then tells what the shape may be as well; `None` where its pictures do not tell its
    /// place.
    fn ball(&self, scene: &BallScene, flattening: Flattening, heat: f64) -> Option<BallFrame> {
        let Flattening { share, sd } = flattening;
        let placed = self.best(share, None)?;
        let [less, more] = [(share - sd).max(0.0), share + sd].map(|share| self.best(share, Some(&placed)));
        let (less, more) = (less?.centres, more?.centres);
        let mut points: [Option<ImagePoint>; 2] = [None, None];
        for (k, (sight, uv)) in self.sights.iter().zip(placed.centres).enumerate() {
            let alone = sight.edges.covariance(&sight.outline(share, &self.normal)?, &uv)?;
            // How the centre goes with the flattening.
            let by_share = 0.5 * (more[k] - less[k]);
            let shape = SHAPE_SHARE * share * sight.radius_px;
            let deviation = |i: usize| (heat * alone[(i, i)] + by_share[i].powi(2) + shape * shape).sqrt();
            points[sight.camera.index()] = Some(ImagePoint { uv, sd: Vector2::new(deviation(0), deviation(1)) });
        }
        let joined = scene.join(points, &self.place)?;
        Some(BallFrame { flattening: Some(Flattening { share, sd: sd.hypot(SHAPE_SHARE * share) }), ..joined })
    }
}

/// Whether a pressed ball lies where a circle was fitted to it, if one was.
fn near_circle(circle: Option<&BallFrame>, pressed: &BallFrame) -> bool {
    let off = |camera: usize| Some((circle?.points[camera]?.uv - pressed.points[camera]?.uv).norm());
    (0..2).all(|camera| off(camera).is_none_or(|off| off < CIRCLE_OFF_PX))
}

/// Flattening over the contact, k sin(π t / T): thesis equation 2.21.
#[derive(Debug, Clone, Copy)]
struct Press {
    most: f64,
    length_s: f64,
}

impl Press {
    const NONE: Press = Press { most: 0.0, length_s: SHORTEST_CONTACT_S };
    /// What is expected where the pictures do not tell: flattenings by a fifth or a quarter for 5 ms.
    const USUAL: Press = Press { most: 0.22, length_s: 5e-3 };

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
    /// Measures the ball anew where the strings press it. Circles that stay state what they may be off by.
    pub(in crate::tracking) fn press_ball(
        &self,
        scene: &BallScene,
        racket: &[Option<RacketFrame>],
        ball: &mut [Option<BallFrame>],
    ) -> Result<(), TrackingError> {
        let rate = self.setup.frame_rate_hz;
        // What was followed where the ball is hidden at the strings, their edge, tells another contact than its flight.
        let astray = first_contact(self.source, racket, ball, scene.radius_m, rate);
        drop_strays(self.source, self.view, ball, astray, rate, OUTLINE_PX);
        let Some(contact) = first_contact(self.source, racket, ball, scene.radius_m, rate) else { return Ok(()) };
        let times_s: Vec<f64> = (0..ball.len()).map(|i| (self.source.number(i) as f64 - contact) / rate).collect();
        let during: Vec<usize> = (0..ball.len()).filter(|i| (0.0..LONGEST_CONTACT_S).contains(&times_s[*i])).collect();
        let way = self.through_contact(racket, ball, contact);
        if let Some(way) = &way {
            self.keep_to_the_way(scene, way, ball, &during);
        }
        let (press, pressed) = self.pressed_balls(scene, racket, ball, (way.as_ref(), &during), &times_s)?.unwrap_or((Press::USUAL, Vec::new()));
        for (b, time_s) in ball.iter_mut().zip(&times_s).filter_map(|(b, t)| Some((b.as_mut()?, *t))) {
            let off = CIRCLE_OFF_SHARE * press.at(time_s);
            for camera in CameraId::BOTH {
                let radius_px = scene.radius_px(camera, &b.position).unwrap_or_default();
                if let Some(point) = b.points[camera.index()].as_mut().filter(|_| off > 0.0) {
                    point.sd = point.sd.map(|sd| sd.hypot(off * radius_px));
                }
            }
        }
        for (index, b) in pressed {
            ball[index] = Some(b);
        }
        Ok(())
    }

    /// The balls that are pressed, by frame, and the curve of their flattening; `None` where the outlines do not tell it. They are looked for in the
    /// frames of the contact along the ball's `way`, or where it was found. `times_s` counts from first contact.
    fn pressed_balls(
        &self,
        scene: &BallScene,
        racket: &[Option<RacketFrame>],
        ball: &[Option<BallFrame>],
        (way, during): (Option<&ThroughContact>, &[usize]),
        times_s: &[f64],
    ) -> Result<Option<(Press, Vec<(usize, BallFrame)>)>, TrackingError> {
        let Some(usual) = self.usual_levels(scene, ball, times_s)? else { return Ok(None) };
        let touch = |buffers: &mut [FrameBuffer; 2], index: &usize| -> Result<Option<Touch>, TrackingError> {
            let foretold = way.map(|way| way.at(self.source.number(*index) as f64));
            let (Some(racket), Some(place)) = (&racket[*index], foretold.or(ball[*index].map(|b| b.position))) else { return Ok(None) };
            let images = self.read_rows(*index, self.ball_rows(scene, &place, 4), buffers)?;
            let normal = racket.pose.global_from_racket.rotation * Vector3::z();
            Ok(Touch::of(scene, &images, &usual, (*index, times_s[*index]), (place, foretold.is_some()), normal))
        };
        let touches: Result<Vec<Option<Touch>>, TrackingError> = during.par_iter().with_max_len(1).map_init(Default::default, touch).collect();
        let touches: Vec<Touch> = touches?.into_iter().flatten().collect();
        let Some((press, cost)) = Press::of(&touches) else { return Ok(None) };
        // Half a unit is what a sector of a right outline adds.
        let sectors = touches.iter().map(|t| t.sights.len() * SECTORS).sum::<usize>();
        let heat = SECTORS_ALIKE * (2.0 * cost / sectors.max(1) as f64).max(1.0);
        if Press::NONE.cost(&touches) - cost < heat * LEAST_GAIN {
            return Ok(None);
        }
        let pressed = |t: &Touch| {
            let flattening = t.settle(press.at(t.time_s), heat);
            let told = flattening.share > LEAST_SHARE.max(LEAST_DEVIATIONS * flattening.sd);
            let found = if told { t.ball(scene, flattening, heat) } else { None };
            let found = found.filter(|b| if way.is_some() { t.near_its_place(b) } else { near_circle(ball[t.index].as_ref(), b) });
            Some((t.index, found?))
        };
        Ok(Some((press, touches.par_iter().with_max_len(1).filter_map(pressed).collect())))
    }

    /// How bright every sector's ball is in free flight near the contact, by camera: the median, because lines pass.
    fn usual_levels(&self, scene: &BallScene, ball: &[Option<BallFrame>], times_s: &[f64]) -> Result<Option<[[f32; SECTORS]; 2]>, TrackingError> {
        let near = FREE_FRAMES / 1000.0;
        let free = |t: f64| (-near..0.0).contains(&t) || (LONGEST_CONTACT_S..LONGEST_CONTACT_S + near).contains(&t);
        let frames: Vec<(usize, &BallFrame)> = ball.iter().enumerate().filter_map(|(i, b)| Some((i, b.as_ref()?))).filter(|(i, _)| free(times_s[*i])).collect();
        let of_frame = |buffers: &mut [FrameBuffer; 2], (index, b): &(usize, &BallFrame)| -> Result<[Option<[f32; SECTORS]>; 2], TrackingError> {
            let images = self.read_rows(*index, self.ball_rows(scene, &b.position, 1), buffers)?;
            Ok(CameraId::BOTH.map(|camera| {
                let c = camera.index();
                levels(images[c].as_ref()?, &b.points[c]?.uv, scene.radius_px(camera, &b.position)?, &scene.limb[c])
            }))
        };
        let all: Result<Vec<_>, TrackingError> = frames.par_iter().with_max_len(AT_ONCE).map_init(Default::default, of_frame).collect();
        let all = all?;
        let seen: [Vec<[f32; SECTORS]>; 2] = [0, 1].map(|c| all.iter().filter_map(|levels| levels[c]).collect());
        let median = |seen: &[[f32; SECTORS]], k: usize| {
            let mut levels: Vec<f32> = seen.iter().map(|l| l[k]).collect();
            let mid = levels.len() / 2;
            *levels.select_nth_unstable_by(mid, f32::total_cmp).1
        };
        Ok(seen.iter().all(|s| !s.is_empty()).then(|| seen.each_ref().map(|s| std::array::from_fn(|k| median(s, k)))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_spheroid_is_wider_along_its_axis_and_shorter_across_it() {
        let from_the_front = Matrix2x3::new(250.0, 0.0, 0.0, 0.0, 250.0, 0.0);
        let wide = spheroid_outline(0.2, &Vector3::z(), 8.0, &from_the_front).expect("seen");
        assert!(wide.iter().all(|r| (r - 8.0 / 0.8f64.sqrt()).abs() < 1e-9), "{wide:?}");
        let aside = spheroid_outline(0.2, &Vector3::x(), 8.0, &from_the_front).expect("seen");
        for (k, r) in aside.iter().enumerate() {
            let u = DIRECTIONS[k];
            let ellipse = 8.0 / ((u.x / 0.8).powi(2) + u.y * u.y * 0.8).sqrt();
            assert!((r - ellipse).abs() < 1e-9, "{k}: {r} {ellipse}");
        }
        assert!(spheroid_outline(0.0, &Vector3::x(), 8.0, &from_the_front).expect("seen").iter().all(|r| (r - 8.0).abs() < 1e-12));
    }

    #[test]
    fn law_the_press_rises_and_falls_within_the_contact() {
        let press = Press { most: 0.2, length_s: 5e-3 };
        assert!((press.at(2.5e-3) - 0.2).abs() < 1e-12 && press.at(-1e-6) == 0.0 && press.at(5.1e-3) == 0.0);
    }
}
