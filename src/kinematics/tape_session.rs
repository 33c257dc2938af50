//! What a session's tracks say about its tape: the tubes' direction in the throat, and how far off its middle a band is seen.
//!
//! A rigid figure of five bands in two cameras has 20 image coordinates and 6 degrees of freedom. What the bands' mean
//! places over a shot have left over from a common pose therefore tells, without any truth, how far each lies off: the part
//! that all shots share, and the part of each shot. `racket.toml` does not tell how the tubes run at markers 4 and 5, and
//! the visible side of a band depends on it (15 degrees move it by a sixth of a pixel, oppositely in the two cameras): the
//! direction that leaves least is taken.

use crate::calibration::StereoRig;
use crate::tracking::{MarkerObservation, RacketFigure, Target, Throat, Tracks, View, fit_pose};
use nalgebra::Vector2;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Frames looked at per shot, and shots per session, evenly spread.
const FRAMES: usize = 12;
const SHOTS: usize = 24;
/// Of the ten bands in a frame, as many must be seen: fewer leave little over from a pose.
const FEWEST_BANDS: usize = 9;
/// Directions tried, degrees from the racket's axis.
const ANGLES_DEG: std::ops::RangeInclusive<u32> = 1..=16;
const ANGLE_STEP_DEG: f64 = 4.0;
/// How far the throat of a racket may run from the tangent to its head, degrees (one deviation).
const ANGLE_SD_DEG: f64 = 15.0;
/// Error of a band that is expected before anything was seen, px, and how many residuals that is worth: a session's own twenty
/// mean residuals know better (worth five of them, a shared error of 0.03 px was stated as 0.05).
const EXPECTED_PX: f64 = 0.10;
const EXPECTED_WORTH: f64 = 1.0;
/// A band this many expected errors off is somebody's hand or another mistake: it counts no more than this.
const MOST: f64 = 4.0;

/// The tape of one racket as a session shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TapeErrors {
    /// The tubes at markers 4 and 5; `None` when no marker lies there or nothing was said about them.
    pub throat: Option<Throat>,
    /// Image error of a band that persists over one shot, per axis, one deviation, px.
    pub shot_px: f64,
    /// Image error of a band that all shots share.
    pub shared_px: f64,
}

impl TapeErrors {
    /// Before anything was seen.
    pub fn expected() -> Self {
        TapeErrors { throat: None, shot_px: EXPECTED_PX, shared_px: EXPECTED_PX }
    }

    /// From the tracks of shots with one racket. `seen` is how the pictures show its throat, which tell that better than tracks do; where
    /// they say nothing, the throat's direction is the one that leaves least.
    pub fn of(rig: &StereoRig, figure: &RacketFigure, shots: &[&Tracks], seen: &[Throat]) -> Self {
        let picked: Vec<Vec<Vec<MarkerObservation>>> = evenly(shots.len(), SHOTS).map(|i| frames(shots[i])).filter(|f| !f.is_empty()).collect();
        let view = View::new(rig);
        let residuals = |figure: &RacketFigure| -> Vec<Bands> { picked.par_iter().map(|shot| mean_residuals(&view, figure, shot)).collect() };
        let figure = match Throat::mean(seen) {
            Some(throat) => figure.with(&throat),
            None if picked.is_empty() => return Self::expected(),
            None => turned(figure, &residuals),
        };
        let (shot_px, shared_px) = if picked.is_empty() { (EXPECTED_PX, EXPECTED_PX) } else { spread(&residuals(&figure)) };
        TapeErrors { throat: figure.throat(), shot_px, shared_px }
    }
}

/// The figure with the throat's direction that leaves least.
fn turned(figure: &RacketFigure, residuals: &impl Fn(&RacketFigure) -> Vec<Bands>) -> RacketFigure {
    let Some(tangent) = figure.throat_angle() else { return figure.clone() };
    let cost = |angle: f64| {
        let size = |r: &Vector2<f64>| (r.norm() / EXPECTED_PX).min(MOST).powi(2);
        let misfit: f64 = residuals(&figure.with_throat(angle)).iter().flat_map(|b| b.values()).map(size).sum();
        misfit + ((angle - tangent).to_degrees() / ANGLE_SD_DEG).powi(2)
    };
    let angle = least(&ANGLES_DEG.map(|k| (f64::from(k) * ANGLE_STEP_DEG).to_radians()).map(|a| (a, cost(a))).collect::<Vec<_>>());
    // To half a degree, so that one more shot does not change every other.
    figure.with_throat((2.0 * angle.to_degrees()).round().to_radians() / 2.0)
}

/// Mean residual of each band (camera, marker) over a shot, px.
type Bands = BTreeMap<(usize, usize), Vector2<f64>>;

/// `most` of `n` indices, evenly spread.
pub fn evenly(n: usize, most: usize) -> impl Iterator<Item = usize> {
    let count = n.min(most);
    (0..count).map(move |k| k * n / count.max(1))
}

/// The frames of a shot that show nearly every band.
fn frames(tracks: &Tracks) -> Vec<Vec<MarkerObservation>> {
    let seen = tracks.frames().into_iter().map(|frame| MarkerObservation::in_frame(tracks, frame));
    let full: Vec<Vec<MarkerObservation>> = seen.filter(|o| o.len() >= FEWEST_BANDS).collect();
    evenly(full.len(), FRAMES).map(|i| full[i].clone()).collect()
}

fn mean_residuals(view: &View, figure: &RacketFigure, shot: &[Vec<MarkerObservation>]) -> Bands {
    let mut sums: BTreeMap<(usize, usize), (Vector2<f64>, f64)> = BTreeMap::new();
    for seen in shot {
        let Ok(pose) = fit_pose(view, figure, seen, None) else { continue };
        for o in seen {
            let Some(uv) = view.patch(o.camera, figure, o.marker, &pose.global_from_racket) else { continue };
            let sum = sums.entry((o.camera.index(), o.marker)).or_insert((Vector2::zeros(), 0.0));
            sum.0 += o.point.uv - uv;
            sum.1 += 1.0;
        }
    }
    sums.into_iter().map(|(band, (sum, n))| (band, sum / n)).collect()
}

/// The place of the least value, by a parabola through it and its neighbours.
fn least(values: &[(f64, f64)]) -> f64 {
    let Some(i) = (0..values.len()).min_by(|&a, &b| values[a].1.total_cmp(&values[b].1)) else { return 0.0 };
    if i == 0 || i + 1 == values.len() {
        return values[i].0;
    }
    let ((a, fa), (b, fb), (_, fc)) = (values[i - 1], values[i], values[i + 1]);
    let bend = fa - 2.0 * fb + fc;
    if bend > 0.0 { b + 0.5 * (b - a) * (fa - fc) / bend } else { b }
}

/// Deviations per axis of what changes from shot to shot, and of what does not.
fn spread(shots: &[Bands]) -> (f64, f64) {
    let coordinates = 4.0 * Target::MARKERS.len() as f64;
    // The pose takes six of twenty coordinates along.
    let left_over = (coordinates - 6.0) / coordinates;
    let clip = |r: f64| r.clamp(-MOST * EXPECTED_PX, MOST * EXPECTED_PX);
    let mut by_band: BTreeMap<(usize, usize, usize), Vec<f64>> = BTreeMap::new();
    for (&(camera, marker), r) in shots.iter().flatten() {
        for axis in 0..2 {
            by_band.entry((camera, marker, axis)).or_default().push(clip(r[axis]));
        }
    }
    let (mut within, mut within_n, mut between, mut between_n) = (0.0, 0.0, 0.0, 0.0);
    for values in by_band.values() {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        within += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
        within_n += n - 1.0;
        between += mean * mean;
        between_n += 1.0;
    }
    let expected = EXPECTED_PX.powi(2);
    let settle = |sum: f64, n: f64| (EXPECTED_WORTH * expected + sum / left_over) / (EXPECTED_WORTH + n);
    (settle(within, within_n).sqrt(), settle(between, between_n).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_shared_and_changing_parts_are_told_apart() {
        // Forty shots; every band off by 0.2 px in all of them, and by ± 0.05 px from shot to shot.
        let shots: Vec<Bands> = (0..40)
            .map(|s| {
                let by = if s % 2 == 0 { 0.05 } else { -0.05 };
                (0..10).map(|b| ((b / 5, b % 5), Vector2::new(0.2 + by, -0.2 + by))).collect()
            })
            .collect();
        let (shot, shared) = spread(&shots);
        let inflated = (20.0f64 / 14.0).sqrt();
        assert!((shot / (0.05 * inflated) - 1.0).abs() < 0.05, "{shot}");
        assert!((0.20..0.2 * inflated).contains(&shared), "between what was expected and what was seen: {shared}");
    }

    #[test]
    fn truth_the_least_value_lies_between_the_steps() {
        let values: Vec<(f64, f64)> = (0..8).map(|k| (f64::from(k), (f64::from(k) - 3.3).powi(2))).collect();
        assert!((least(&values) - 3.3).abs() < 1e-12);
        assert_eq!(least(&values[4..]), 4.0);
    }
}
