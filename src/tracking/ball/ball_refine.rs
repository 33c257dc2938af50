//! The ball's centre once more, when its spin is known: every picture against a model of this very ball.
//!
//! The outline alone ([`crate::tracking::ball::ball_fit`]) is pulled by lines, panels and light where they meet it. With the spin the
//! cover can be collected from all pictures of one stretch of flight ([`crate::tracking::ball::ball_texture`]), and with it and the light every
//! picture can be predicted ([`crate::tracking::ball::ball_model`]). Each centre is still measured in its own picture: nothing is smoothed
//! along the flight. Pictures of the contact keep the centre of their outline.

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyImage, Rows};
use crate::tracking::ball::ball_learn::{BEYOND_A_BOUNCE, Learnt, Lesson, noise_share};
use crate::tracking::ball::ball_model::{BallFace, BallPicture, MARGIN_PX, ModelFit};
use crate::tracking::ball::ball_track::{BallFrame, outline_radius_px};
use crate::tracking::ball::bounce::Flights;
use crate::tracking::ball::contact_length::{SHORTEST_CONTACT_S, frames_of_contact};
use crate::tracking::ball::flight_sample::FlightSample;
use crate::tracking::ball::shot_ball::expected_ball;
use crate::tracking::ball::standing_before::StandingBefore;
use crate::tracking::ball::stray_ball;
use crate::tracking::pictures::camera_shake::camera_shake;
use crate::tracking::pictures::shot_frames::AT_ONCE;
use crate::tracking::racket::racket_pose::View;
use crate::tracking::shot_tracks::{ShotSetup, ShotTracks, TrackingError};
use crate::tracking::space_points;
use crate::tracking::track_file::{ImagePoint, PointState, Target};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use rayon::prelude::*;

/// Times of learning the ball and measuring its centres, and rounds of learning in each.
const ROUNDS: [usize; 4] = [6, 3, 3, 3];
/// A centre that moves farther than this from the outline's is not believed, px: while the ball is learnt, or where fewer pixels agree,
const FARTHEST_PX: f64 = 1.2;
/// and in the end, where this share of the pixels near the outline agrees. In 18 pictures of 188 rendered shots it was 1.2 to 2.0 px off, with 0.89 and more in
/// agreement: there the outline, of a ball whose one side is as grey as the wall, was wrong by as much, and the model by 0.03 to 0.5 px.
const FARTHEST_AGREED_PX: f64 = 2.5;
const AGREED: f64 = 0.85;
/// Least share of pixels near the outline that must agree.
const LEAST_AGREEING: f64 = 0.5;
/// A centre worse than this is left to the outline, px.
const MOST_SD_PX: f64 = 0.35;
/// Variance against what the sectors of a picture and a tilt of its light say, and what is added to it, px: what all pictures of a stretch have in
/// common no single picture shows. Part of it keeps in proportion to what changes from one to the next, part does not (light, cover, blur).
/// From 52 rendered sessions with known centres (docs/tracking-experiments.md, "Deviations").
const COMMON_VARIANCE: f64 = 1.2;
const COMMON_PX: f64 = 0.014;
/// Blur of the pictures of those sessions, px. Light that is not quite the model's near the limb moves a blurred outline by the blur's square.
const COMMON_BLUR_PX: f64 = 0.62;
/// Share of a centre's variance that all pictures of a stretch have in common.
pub(in crate::tracking) const SHARED_VARIANCE: f64 = 0.3;
/// Parts into which they are divided, every third frame each: one is enough where pictures are clear (court, laboratory: a centre 0.5 to
/// 2 % worse than from all three), in hard light two thirds of them are 2 to 5 % worse than all.
const PARTS: usize = 3;
/// A part has at least so many pictures of one camera and stretch, as far as there are as many.
const PART: usize = 8;
/// Noise of a pixel, as a share of the ball's brightness, for which one part is enough; by its square more are needed. Court and laboratory have
/// 0.024 to 0.034, hard light 0.043 to 0.064.
const CLEAR_NOISE: f64 = 0.03;
/// Fewest pictures of one camera from which a ball is learnt.
const FEWEST: usize = 4;

struct Sight {
    index: usize,
    camera: CameraId,
    picture: BallPicture,
    fit: Option<(ModelFit, Vector2<f64>)>,
}

/// Measures the ball's centres of a tracked shot again and renews its points; `turning` says how its lines turn before
/// and after the contact. Where nobody knows the ball is taken for bare: its lines then are pixels that disagree. Where something is
/// `standing` before the ball its picture says nothing.
pub(in crate::tracking) fn refine_ball(
    source: &impl FrameSource,
    setup: &ShotSetup,
    shot: &mut ShotTracks,
    turning: &[Option<Vector3<f64>>; 2],
    sample: &FlightSample,
    standing: &StandingBefore,
) -> Result<(), TrackingError> {
    let Some(contact) = shot.contact_frame else { return Ok(()) };
    let view = View::new(setup.rig);
    let mut sights = sights(source, setup, &view, shot, contact, turning, sample, standing)?;
    let textured = turning.map(|t| t.is_some());
    measure(&mut sights, &textured, shot.blur_px);
    for sight in &sights {
        let Some(ball) = shot.ball.get_mut(sight.index).and_then(Option::as_mut) else { continue };
        if let Some((point, farthest_px)) = believed(sight, shot.blur_px[sight.camera.index()])
            && ball.points[sight.camera.index()].is_some_and(|old| (point.uv - old.uv).norm() < farthest_px)
        {
            ball.points[sight.camera.index()] = Some(point);
            if let [Some(l), Some(r)] = ball.points
                && let Some((position, _)) = view.triangulate(l.uv, r.uv)
            {
                ball.position = position;
            }
        }
    }
    renew(source, setup, shot, &view);
    Ok(())
}

/// Writes the balls' points into the tracks and the space points.
fn renew(source: &impl FrameSource, setup: &ShotSetup, shot: &mut ShotTracks, view: &View) {
    stray_ball::drop_strays(source, view, &mut shot.ball, shot.contact_frame, setup.frame_rate_hz, stray_ball::FINAL_PX);
    shot.contact_frame = space_points::first_contact(source, &shot.racket, &shot.ball, setup.ball.radius_m(), setup.frame_rate_hz);
    let shake_px = camera_shake(&shot.tracks, &frames_of_contact(shot.contact_frame, setup.frame_rate_hz));
    shot.points = space_points::space_points(source, setup, view, &shot.figure, &shot.racket, &shot.ball, shot.contact_frame);
    space_points::widen_by_shake(view, &mut shot.points, shake_px);
    for index in 0..source.len() {
        let number = source.number(index);
        for camera in CameraId::BOTH {
            let point = shot.ball[index].as_ref().and_then(|b| b.points[camera.index()]);
            if let Ok(at) = shot.tracks.points.binary_search_by_key(&(number, camera, Target::Ball), |p| (p.frame, p.camera, p.target)) {
                shot.tracks.points[at].point = point;
                shot.tracks.points[at].state = if point.is_some() { PointState::Measured } else { PointState::Occluded };
            }
        }
    }
}

/// The pictures of the ball in free flight.
fn sights(
    source: &impl FrameSource,
    setup: &ShotSetup,
    view: &View,
    shot: &ShotTracks,
    contact: f64,
    turning: &[Option<Vector3<f64>>; 2],
    sample: &FlightSample,
    standing: &StandingBefore,
) -> Result<Vec<Sight>, TrackingError> {
    let numbers: Vec<f64> = (0..source.len()).map(|i| source.number(i) as f64).collect();
    let free = Flights::of(source, view, &shot.ball, contact, setup.frame_rate_hz).beside_the_strings();
    let both = |buffer: &mut FrameBuffer, index: usize| -> Result<Vec<Sight>, TrackingError> {
        let mut out = Vec::with_capacity(2);
        // A ball that the strings press is no sphere.
        let Some(mut ball) = shot.ball[index].filter(|b| b.flattening.is_none()) else { return Ok(out) };
        // Where one camera had followed another thing the two rays met elsewhere, and a ball there is of another size.
        if !ball.stereo
            && let Some((place, _)) = expected_ball(&shot.ball, &numbers, index)
        {
            ball.position = place;
        }
        let frames = source.number(index) as f64 - contact;
        let t = frames / setup.frame_rate_hz;
        let stretch = if frames < -free[0] || frames > free[1] {
            // How its cover has turned there nobody knows.
            BEYOND_A_BOUNCE
        } else if t < 0.0 {
            0
        } else if t > SHORTEST_CONTACT_S {
            1
        } else {
            return Ok(out);
        };
        // The ball is learnt from the frames that tell its spin.
        let teaches = sample.side(source.number(index), t).is_some();
        let omega = turning.get(stretch).copied().flatten().unwrap_or_default();
        for camera in CameraId::BOTH {
            let Some(point) = ball.points[camera.index()] else { continue };
            let Some(radius_px) = outline_radius_px(view, camera, &ball.position, setup.ball.radius_m()) else { continue };
            if let Some((pixels, side, origin)) = crop(source, index, camera, &point.uv, radius_px, setup.rig.image_size, buffer)? {
                let camera_from_global = local_axes(setup, view, camera, &ball);
                let ball_from_camera = Rotation3::from_scaled_axis(omega * t).inverse().matrix() * camera_from_global.transpose();
                let behind = shot.still[camera.index()].as_ref().and_then(|b| window(b, &origin, side));
                let centre = point.uv;
                let covered = covered(standing, camera, &origin, side);
                let picture = BallPicture {
                    pixels,
                    behind,
                    covered,
                    side,
                    origin,
                    centre,
                    radius_px,
                    camera_from_global,
                    ball_from_camera,
                    gain: 1.0,
                    teaches,
                    camera,
                    stretch,
                };
                out.push(Sight { index, camera, picture, fit: None });
            }
        }
        Ok(out)
    };
    let sights: Result<Vec<Vec<Sight>>, TrackingError> = (0..source.len()).into_par_iter().with_max_len(AT_ONCE).map_init(FrameBuffer::default, both).collect();
    Ok(sights?.into_iter().flatten().collect())
}

type Crop = (Vec<f32>, usize, Vector2<f64>);

/// The pixels around the ball; `None` where they are not all in the picture.
fn crop(
    source: &impl FrameSource,
    index: usize,
    camera: CameraId,
    centre: &Vector2<f64>,
    radius_px: f64,
    size: [usize; 2],
    buffer: &mut FrameBuffer,
) -> Result<Option<Crop>, TrackingError> {
    let half = (radius_px + MARGIN_PX).floor();
    if !(2.0..200.0).contains(&half) {
        return Ok(None);
    }
    let (left, top, side) = (centre.x.round() - half, centre.y.round() - half, 2 * half as usize + 1);
    if left < 0.0 || top < 0.0 || left + side as f64 > size[0] as f64 || top + side as f64 > size[1] as f64 {
        return Ok(None);
    }
    // A picture that cannot be read is named where the shot is tracked.
    if !matches!(source.read(index, camera.index(), Rows::span(top as usize, side), buffer), Ok(true)) {
        return Ok(None);
    }
    let Some(view) = buffer.view() else { return Ok(None) };
    let mut pixels = Vec::with_capacity(side * side);
    for y in top as usize..top as usize + side {
        let Some(row) = view.row(y).and_then(|row| row.get(left as usize..left as usize + side)) else { return Ok(None) };
        pixels.extend(row.iter().map(|p| f32::from(*p)));
    }
    Ok(Some((pixels, side, Vector2::new(left, top))))
}

/// The same pixels of the median picture.
fn window(image: &GreyImage, origin: &Vector2<f64>, side: usize) -> Option<Vec<f32>> {
    let (left, top) = (origin.x as usize, origin.y as usize);
    let row = |y: usize| image.pixels.get(y * image.width + left..y * image.width + left + side);
    let rows: Option<Vec<&[u8]>> = (top..top + side).map(row).collect();
    (left + side <= image.width).then_some(rows?.concat().into_iter().map(f32::from).collect())
}

/// Which of these pixels show what stands before the ball, if any does.
fn covered(standing: &StandingBefore, camera: CameraId, origin: &Vector2<f64>, side: usize) -> Option<Vec<bool>> {
    let (left, top) = (origin.x as usize, origin.y as usize);
    let of = || (0..side * side).map(|at| standing.covers(camera, left + at % side, top + at / side)).collect::<Vec<_>>();
    (!standing.is_clear(camera)).then(of).filter(|covered| covered.contains(&true))
}

/// Rows: right and down in the picture and away from the camera, at the ball, in global axes.
fn local_axes(setup: &ShotSetup, view: &View, camera: CameraId, ball: &BallFrame) -> Matrix3<f64> {
    let away = (ball.position - view.eye(camera)).normalize();
    let right = setup.rig.camera_from_global(camera).rotation.inverse() * Vector3::x();
    let right = (right - away * right.dot(&away)).normalize();
    Matrix3::from_rows(&[right.transpose(), away.cross(&right).transpose(), away.transpose()])
}

/// The pictures to learn from, in parts each of which is spread over the whole time.
fn parts(sights: &mut [Sight]) -> [Vec<&mut BallPicture>; PARTS] {
    let group = |picture: &BallPicture| 2 * picture.stretch.min(1) + picture.camera.index();
    let (mut all, mut seen) = ([0usize; 4], [0usize; 4]);
    sights.iter().filter(|s| s.picture.teaches).for_each(|s| all[group(&s.picture)] += 1);
    let mut parts: [Vec<&mut BallPicture>; PARTS] = Default::default();
    for picture in sights.iter_mut().map(|s| &mut s.picture).filter(|p| p.teaches) {
        let group = group(picture);
        parts[seen[group] % (all[group] / PART).clamp(1, PARTS)].push(picture);
        seen[group] += 1;
    }
    parts
}

/// Learns the ball from both cameras' pictures and fits every centre, in turns.
fn measure(sights: &mut [Sight], textured: &[bool; 2], blur_px: [f64; 2]) {
    let mut parts = parts(sights).into_iter();
    let lessons_of = |pictures: Vec<_>| -> Vec<Lesson> { pictures.into_par_iter().with_max_len(AT_ONCE).map(|p| Lesson::new(p, blur_px)).collect() };
    let mut lessons = lessons_of(parts.next().unwrap_or_default());
    if lessons.len() < FEWEST {
        return;
    }
    let needed = noise_share(&lessons).map_or(PARTS, |noise| (noise / CLEAR_NOISE).powi(2).round() as usize);
    for part in parts.take(needed.saturating_sub(1)) {
        lessons.append(&mut lessons_of(part));
    }
    let Some(mut learnt) = Learnt::start(&lessons, blur_px) else { return };
    for (pass, rounds) in ROUNDS.into_iter().enumerate() {
        for _ in 0..rounds {
            if learnt.improve(&mut lessons, textured).is_none() {
                return;
            }
        }
        // In the end every picture is measured, not only those that teach.
        if pass + 1 < ROUNDS.len() {
            lessons.par_iter_mut().with_max_len(AT_ONCE).for_each(|lesson| {
                let model = learnt.model(lesson.picture);
                if let Some(f) = lesson.picture.fit(&lesson.face, &model, &lesson.shown)
                    && (f.centre - lesson.picture.centre).norm() < FARTHEST_PX
                {
                    lesson.picture.centre = f.centre;
                    lesson.picture.gain = f.gain;
                }
            });
            learnt.sharpen(&mut lessons);
        }
    }
    drop(lessons);
    sights.par_iter_mut().with_max_len(AT_ONCE).for_each(|sight| {
        let model = learnt.model(&sight.picture);
        sight.fit = sight.picture.fit_tilted(&BallFace::new(&sight.picture), &model);
    });
}

/// The fitted centre, if it may be believed, and how far from the outline's, px.
fn believed(sight: &Sight, blur_px: f64) -> Option<(ImagePoint, f64)> {
    let (f, other) = sight.fit?;
    let sd = Vector2::new(f.covariance[(0, 0)], f.covariance[(1, 1)]) + other.component_mul(&other);
    let common_px = COMMON_PX * (blur_px / COMMON_BLUR_PX).powi(2).max(1.0);
    let sd = sd.map(|variance| (COMMON_VARIANCE * variance + common_px * common_px).sqrt());
    let farthest_px = if f.agreeing > AGREED { FARTHEST_AGREED_PX } else { FARTHEST_PX };
    (f.agreeing > LEAST_AGREEING && sd.max() < MOST_SD_PX).then_some((ImagePoint { uv: f.centre, sd }, farthest_px))
}
