//! The frame-rate study of 4.5.1 on the user's own tracks: what would a slower camera have got wrong?
//!
//! Every k-th frame of the tracks is kept, in every phase, and the shot measured again, by the fits and by the thesis's
//! straight lines; the differences to the full tracks are the errors a slower camera adds. Linearity is R² of a straight
//! line through the tip's path in ten frames (figures 4.14 to 4.16; the printed 0.1, 0.2, 0.4 s there mean 0.01, 0.02,
//! 0.04 s).

use super::KinematicsError;
use super::racket_motion::MotionEstimate;
use super::shot::{MeasuredShot, ShotInput, measure_shot};
use super::shot_motion::MeasureSettings;
use super::thesis_path::{THESIS_FRAMES, line};
use crate::tracking::Tracks;
use nalgebra::{Matrix3, Point3, Vector3};
use serde::Serialize;

/// One slower camera. Errors are root mean squares per component over the phases, against the full tracks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SlowerCamera {
    pub frame_rate_hz: f64,
    /// Phases that could be measured, of `keep_every`.
    pub phases: usize,
    pub keep_every: usize,
    pub ball_velocity_m_s: Option<f64>,
    pub racket_velocity_m_s: Option<f64>,
    pub racket_rate_rad_s: Option<f64>,
    pub impact_position_m: Option<f64>,
    pub instant_s: Option<f64>,
    /// The thesis's straight lines through ten frames: ball, racket, rate before contact, against the fits on all frames.
    pub line_ball_velocity_m_s: Option<f64>,
    pub line_racket_velocity_m_s: Option<f64>,
    pub line_racket_rate_rad_s: Option<f64>,
    /// R² of a straight line through the tip's path over ten frames before contact at this rate (fewer where the tracks end),
    /// and the path's largest distance from it, m.
    pub tip_r2: Option<f64>,
    pub tip_bow_m: Option<f64>,
    /// The tip at this rate's frames on both sides of the contact (figures 4.14 to 4.16).
    pub tip_path: TipPath,
    /// Why phases failed, without repeats.
    pub failed: Vec<String>,
}

/// Where the tip stood, in the plane that holds most of its path: time from contact, s, along the path and aside, m.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct TipPath {
    pub before: Vec<[f64; 3]>,
    pub after: Vec<[f64; 3]>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameRateStudy {
    pub id: String,
    pub frame_rate_hz: f64,
    pub cameras: Vec<SlowerCamera>,
}

/// Measures the shot at its own rate and at each `keep_every`-th frame (2 and 4 for 1000 → 500 and 250).
///
/// # Errors  [`KinematicsError`] when the full tracks cannot be measured; a slower camera's failures are part of the result.
pub fn frame_rate_study(input: &ShotInput<'_>, settings: &MeasureSettings, keep_every: &[usize]) -> Result<FrameRateStudy, KinematicsError> {
    let full = measure_shot(input, settings)?;
    let mut cameras = vec![slower(&full, input, settings, 1)];
    cameras.extend(keep_every.iter().filter(|k| **k > 1).map(|k| slower(&full, input, settings, *k)));
    Ok(FrameRateStudy { id: input.id.to_owned(), frame_rate_hz: 1.0 / settings.frame_period_s, cameras })
}

#[derive(Default)]
struct Rms(f64, usize);

impl Rms {
    fn add(&mut self, differences: impl IntoIterator<Item = f64>) {
        for d in differences {
            self.0 += d * d;
            self.1 += 1;
        }
    }

    fn value(&self) -> Option<f64> {
        (self.1 > 0).then(|| (self.0 / self.1 as f64).sqrt())
    }
}

fn slower(full: &MeasuredShot, input: &ShotInput<'_>, settings: &MeasureSettings, keep_every: usize) -> SlowerCamera {
    let period = settings.frame_period_s * keep_every as f64;
    let names = |stem: &str| ["x", "y", "z"].map(|a| format!("{stem}{a}"));
    let truth = |name: &str| full.shot.quantities.get(name).map(|q| q.value);
    let [mut ball, mut racket, mut rate, mut position, mut instant, mut line_ball, mut line_racket, mut line_rate] = std::array::from_fn(|_| Rms::default());
    let (mut phases, mut failed) = (0, Vec::new());
    for phase in 0..keep_every as u64 {
        // Frames are numbered anew, so that the period is the slower camera's.
        let points = input.tracks.points.iter().filter(|p| p.frame % keep_every as u64 == phase);
        let tracks = Tracks { points: points.map(|p| crate::tracking::TrackPoint { frame: p.frame / keep_every as u64, ..*p }).collect() };
        let slow_settings = MeasureSettings {
            frame_period_s: period,
            window_s: settings.window_s.max(THESIS_FRAMES as f64 * period),
            impact_frame: settings.impact_frame.map(|f| f / keep_every as u64),
            ..settings.clone()
        };
        let measured = match measure_shot(&ShotInput { tracks: &tracks, ..*input }, &slow_settings) {
            Ok(m) => m,
            Err(e) => {
                failed.push(e.to_string());
                continue;
            }
        };
        phases += 1;
        let own = |name: &str| measured.shot.quantities.get(name).map(|q| q.value);
        let differences = |stems: &[&str]| -> Vec<f64> { stems.iter().flat_map(|s| names(s)).filter_map(|n| Some(own(&n)? - truth(&n)?)).collect() };
        ball.add(differences(&["ball_in_v", "ball_out_v"]));
        racket.add(differences(&["racket_in_v", "racket_out_v"]));
        rate.add(differences(&["racket_in_w", "racket_out_w"]));
        position.add(["impact_x", "impact_y"].iter().filter_map(|n| Some(own(n)? - truth(n)?)));
        instant.add(own("impact_frame").zip(truth("impact_frame")).map(|(s, f)| (s * keep_every as f64 + phase as f64 - f) * settings.frame_period_s));
        if let Some(t) = &measured.shot.thesis {
            let against = |stem: &str, v: &[f64; 3]| -> Vec<f64> { names(stem).iter().zip(v).filter_map(|(n, v)| Some(v - truth(n)?)).collect() };
            line_ball.add(against("ball_in_v", &t.ball_in_v));
            line_racket.add(against("racket_in_v", &t.racket_in_v));
            line_rate.add(against("racket_in_w", &t.racket_in_w));
        }
    }
    failed.sort();
    failed.dedup();
    let (before, after) = tip_places(full, period);
    let tip = linearity(&before);
    SlowerCamera {
        frame_rate_hz: 1.0 / period,
        phases,
        keep_every,
        ball_velocity_m_s: ball.value(),
        racket_velocity_m_s: racket.value(),
        racket_rate_rad_s: rate.value(),
        impact_position_m: position.value(),
        instant_s: instant.value(),
        line_ball_velocity_m_s: line_ball.value(),
        line_racket_velocity_m_s: line_racket.value(),
        line_racket_rate_rad_s: line_rate.value(),
        tip_r2: tip.map(|t| t.0),
        tip_bow_m: tip.map(|t| t.1),
        tip_path: in_plane(&before, &after),
        failed,
    }
}

/// Times and places of the racket's tip (marker 1) at ten frames on either side of the contact, as far as the tracks reach;
/// the places are those of the fitted motions, so noise does not blur the comparison.
fn tip_places(full: &MeasuredShot, period: f64) -> (Vec<(f64, Point3<f64>)>, Vec<(f64, Point3<f64>)>) {
    let m = &full.motion;
    let tip = m.moving.figure.points[0];
    let seen: Vec<f64> = m.frames.values().filter(|f| f.pose.is_some()).map(|f| f.t).collect();
    let (first, last) = (seen.first().copied().unwrap_or(0.0), seen.last().copied().unwrap_or(0.0));
    let path = |motion: &MotionEstimate, contact: f64, toward: f64| {
        let times = (0..THESIS_FRAMES).map(|k| contact + toward * (k as f64 + 0.5) * period).filter(|t| (first..=last).contains(t));
        let dts: Vec<f64> = times.map(|t| t - motion.reference_t).collect();
        let poses = m.moving.poses(motion.best.law, &motion.best.state, &dts);
        dts.iter().zip(&poses).map(|(dt, p)| (dt + motion.reference_t - m.first_contact_t, p * tip)).collect::<Vec<_>>()
    };
    let before = path(&m.racket_in, m.first_contact_t, -1.0);
    let after = m.racket_out.as_ref().zip(m.last_contact_t).map_or_else(Vec::new, |(out, t)| path(out, t, 1.0));
    (before, after)
}

/// R² of a straight line through a path, and the path's largest distance from it, m; `None` for fewer than three places or
/// a tip that does not move.
fn linearity(path: &[(f64, Point3<f64>)]) -> Option<(f64, f64)> {
    let (at, v) = line(path)?;
    let mean = path.iter().map(|p| p.1.coords).sum::<Vector3<f64>>() / path.len() as f64;
    let total: f64 = path.iter().map(|p| (p.1.coords - mean).norm_squared()).sum();
    let left: f64 = path.iter().map(|(t, p)| (p - (at + v * *t)).norm_squared()).sum();
    let bow = path.iter().map(|(t, p)| (p - (at + v * *t)).norm()).fold(0.0, f64::max);
    (total > 1e-8).then(|| (1.0 - left / total, bow))
}

fn in_plane(before: &[(f64, Point3<f64>)], after: &[(f64, Point3<f64>)]) -> TipPath {
    let n = (before.len() + after.len()).max(1) as f64;
    let all = || before.iter().chain(after).map(|p| p.1.coords);
    let mean = all().sum::<Vector3<f64>>() / n;
    let spread: Matrix3<f64> = all().map(|p| (p - mean) * (p - mean).transpose()).sum();
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let axis = |k: usize| {
        let v: Vector3<f64> = eigen.eigenvectors.column(order[k]).into_owned();
        // The sign of an eigenvector is chance: the larger part counts positive.
        let largest = v.iamax();
        v * v[largest].signum()
    };
    let (along, aside) = (axis(0), axis(1));
    let places = |path: &[(f64, Point3<f64>)]| path.iter().map(|(t, p)| [*t, along.dot(&(p.coords - mean)), aside.dot(&(p.coords - mean))]).collect();
    TipPath { before: places(before), after: places(after) }
}
