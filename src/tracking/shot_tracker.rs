//! One shot from beginning to end: find the racket and the ball, follow both ways in time, name what was seen.

use crate::calibration::CameraId;
use crate::footage::FrameSource;
use crate::tracking::ball::ball_rays;
use crate::tracking::ball::ball_track::BallFrame;
use crate::tracking::ball::bounce::turned_unseen_words;
use crate::tracking::ball::contact_length::frames_of_contact;
use crate::tracking::ball::stray_ball;
use crate::tracking::pictures::camera_shake::{camera_shake, shake_words};
use crate::tracking::pictures::recording;
use crate::tracking::pictures::shot_frames::Shot;
use crate::tracking::pictures::stood_still::stood_still;
use crate::tracking::racket::face;
use crate::tracking::racket::marker_deviations;
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_pose::View;
use crate::tracking::racket::racket_scene::RacketFrame;
use crate::tracking::racket::stray_racket;
use crate::tracking::shot_tracks::{ShotSetup, ShotTracks, TrackingError};
use crate::tracking::side_by_side::{SideBySide, side_by_side};
use crate::tracking::space_points;
use crate::tracking::tape::throat::ThroatEvidence;
use crate::tracking::track_file::{PointState, Target, TrackPoint, Tracks};
use std::sync::atomic::AtomicBool;

/// Tracks a whole shot. `progress` is called with the number of frames done, from any thread.
pub fn track_shot(source: &impl FrameSource, setup: &ShotSetup, cancel: &AtomicBool, progress: &(dyn Fn(usize) + Sync)) -> Result<ShotTracks, TrackingError> {
    if source.is_empty() {
        return Err(TrackingError::NoFrames);
    }
    let figure = RacketFigure::of(setup.racket).ok_or_else(|| TrackingError::NoMarkers { racket: setup.racket.name.clone() })?;
    let view = View::new(setup.rig);
    let focus = view.focus().ok_or(TrackingError::NoVolume)?;
    let mut shot = Shot::new(source, setup, &view, (figure.clone(), focus), cancel, progress);
    // The ball is looked for and followed beside the racket: pictures that turn out to be stale are not known yet.
    let watched = Shot::new(source, setup, &view, (figure, focus), cancel, progress);
    let scene = watched.unlit_ball();
    let SideBySide { start, racket, still, look } = side_by_side(&mut shot, &watched, &scene)?;
    let (mut racket, prints) = shot.both_ways(&start, racket)?;
    shot.stale = recording::repeated(&prints);
    for (stale, still) in shot.stale.iter_mut().zip(stood_still(&racket)) {
        *stale = [stale[0] || still[0], stale[1] || still[1]];
    }
    let mut notes = recording::notes(source, &shot.stale);
    let means = recording::mean_greys(&prints, |index, camera| shot.mean_grey(index, camera));
    for (index, stale) in shot.stale.iter_mut().enumerate() {
        let washed_out = recording::washed_out(&means, index);
        *stale = [stale[0] || washed_out[0], stale[1] || washed_out[1]];
    }
    shot.remeasure_stale(&start, &mut racket)?;
    let seen: Vec<(usize, &RacketFrame)> = racket.iter().enumerate().filter_map(|(i, r)| Some((i, r.as_ref().filter(|r| r.stereo())?))).collect();
    if let Some(figure) = shot.throat_of(ThroatEvidence::near(), &seen)? {
        shot.figure = figure;
    }
    let figure = shot.figure.clone();
    marker_deviations::settle(&view, &figure, &mut racket);
    notes.extend(recording::dark_or_bright(source, &means));
    // With stale pictures left out the ball is another.
    let any_stale = shot.stale.iter().flatten().any(|stale| *stale);
    let mut ball = shot.find_and_follow_ball(&scene, &racket, &still, Some(look).filter(|_| !any_stale))?;
    notes.extend(ball_rays::drop_two_things(&view, &racket, &mut ball, setup.ball.radius_m()));
    face::settle(&view, &figure, &mut racket, &ball);
    let contact_frame = space_points::first_contact(source, &racket, &ball, setup.ball.radius_m(), setup.frame_rate_hz);
    stray_ball::drop_strays(source, &view, &mut ball, contact_frame, setup.frame_rate_hz, stray_ball::OUTLINE_PX);
    let contact_frame = space_points::first_contact(source, &racket, &ball, setup.ball.radius_m(), setup.frame_rate_hz);
    marker_deviations::grow_unusual(&view, &figure, &mut racket);
    let hit = frames_of_contact(contact_frame, setup.frame_rate_hz);
    let numbers: Vec<f64> = (0..source.len()).map(|index| source.number(index) as f64).collect();
    stray_racket::drop_strays(&view, &figure, &mut racket, (&numbers, setup.frame_rate_hz), &hit);
    let tracks = named(source, &racket, &ball);
    let shake = || camera_shake(&tracks, &hit);
    let told = || -> Vec<String> { shot.saturated_ball(&ball).into_iter().chain(shot.gamma_encoded()).collect() };
    let ((mut points, shake_px), told) =
        rayon::join(|| (space_points::space_points(source, setup, &view, &figure, &racket, &ball, contact_frame), shake()), told);
    space_points::widen_by_shake(&view, &mut points, shake_px);
    notes.extend(contact_frame.and_then(|contact| turned_unseen_words(source, &view, &ball, contact, setup.frame_rate_hz)));
    notes.extend(unseen(&tracks));
    notes.extend(shake_words(shake_px));
    notes.extend(told);
    let mut broken = shot.broken.into_inner().unwrap_or_default();
    broken.append(&mut watched.broken.into_inner().unwrap_or_default());
    let unreadable = broken.into_values().collect();
    Ok(ShotTracks { figure, tracks, racket, ball, points, contact_frame, notes, unreadable, still, blur_px: shot.blur_px, clear_racket: start.clear })
}

/// Targets that no picture shows.
fn unseen(tracks: &Tracks) -> Vec<String> {
    let seen = |target: &Target| tracks.points.iter().any(|p| p.target == *target && p.point.is_some());
    let words = |target: Target| match target {
        Target::Ball => "no ball was found; is it in the clip, of the size in ball.toml, and frame_rate_hz that of the recording?".to_owned(),
        marker => format!("{} was seen in no picture; is its tape on, and where racket.toml says?", marker.name()),
    };
    Target::ALL.into_iter().filter(|target| !seen(target)).map(words).collect()
}

/// All points of a shot: every target in every picture that exists, measured or occluded.
fn named(source: &impl FrameSource, racket: &[Option<RacketFrame>], ball: &[Option<BallFrame>]) -> Tracks {
    let mut points = Vec::new();
    for index in 0..source.len() {
        if racket[index].is_none() && ball[index].is_none() {
            continue;
        }
        for camera in CameraId::BOTH {
            for target in Target::ALL {
                let point = if target == Target::Ball {
                    ball[index].as_ref().and_then(|b| b.points[camera.index()])
                } else {
                    racket[index].as_ref().and_then(|r| r.points[camera.index()][target.index()])
                };
                let state = if point.is_some() { PointState::Measured } else { PointState::Occluded };
                points.push(TrackPoint { frame: source.number(index), camera, target, point, state });
            }
        }
    }
    Tracks { points }
}
