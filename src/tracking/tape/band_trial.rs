//! What pictures say about a quantity of the bands that no file tells: it is tried at several values, and the one that leaves least of the
//! bands unexplained is taken.

use crate::calibration::CameraId;
use crate::footage::GreyView;
use crate::tracking::racket::racket_scene::{RacketFrame, RacketScene};
use crate::tracking::tape::band::{self, BandPart, BandShape, BandView};
use rayon::prelude::*;

/// Neighbouring pixels miss together: as many count as one.
const TOGETHER: f64 = 4.0;
/// One band's picture says no more than this against a value (another thing lies across it).
const MOST: f64 = 12.0;

/// Half of chi squared against each of the values, one look of the band each.
pub fn against(image: &GreyView, looks: impl IntoIterator<Item = (BandView, BandShape)>) -> Option<Vec<f64>> {
    let mut misfits = Vec::new();
    let mut like = None;
    for (band, shape) in looks {
        let fit = band::fit(image, &band, &shape, (0.0, 0.0), BandPart::Whole, like.as_ref())?;
        misfits.push(fit.misfit);
        like = Some(fit.settled);
    }
    let least = misfits.iter().map(|m| m.0).fold(f64::INFINITY, f64::min).max(0.25);
    Some(misfits.iter().map(|(misfit, pixels)| (0.5 * pixels / TOGETHER * (misfit.max(0.25) / least).ln()).min(MOST)).collect())
}

/// [`against`] for every band of a frame whose marker is `asked`, by marker; `looks` answers how a band would look at each value.
pub fn against_in_frame<L: IntoIterator<Item = (BandView, BandShape)>>(
    images: &[Option<GreyView>; 2],
    frame: &RacketFrame,
    asked: impl Fn(usize) -> bool,
    looks: impl Fn(CameraId, usize) -> Option<L> + Sync,
) -> Vec<(usize, Vec<f64>)> {
    let of_camera = |c: CameraId| (0..frame.points[c.index()].len()).map(move |m| (c, m));
    let seen: Vec<(CameraId, usize)> =
        CameraId::BOTH.into_iter().flat_map(of_camera).filter(|(c, m)| asked(*m) && frame.points[c.index()][*m].is_some()).collect();
    seen.par_iter().filter_map(|&(camera, marker)| Some((marker, against(images[camera.index()].as_ref()?, looks(camera, marker)?)?))).collect()
}

/// A quantity tried at evenly spaced values.
#[derive(Debug, Clone)]
pub struct Trial<const N: usize> {
    pub values: [f64; N],
    /// Half of chi squared; what is known beforehand may be added.
    pub against: [f64; N],
}

impl<const N: usize> Trial<N> {
    pub fn new(values: [f64; N]) -> Self {
        Trial { values, against: [0.0; N] }
    }

    pub fn add(&mut self, against: &[f64]) {
        self.against.iter_mut().zip(against).for_each(|(sum, a)| *sum += a);
    }

    /// The same with what is known beforehand: a value with its deviation.
    pub fn expecting(mut self, value: f64, sd: f64) -> Self {
        self.against.iter_mut().zip(self.values).for_each(|(sum, v)| *sum += 0.5 * ((v - value) / sd).powi(2));
        self
    }

    /// The end beyond which the least lies: the value there, if less is said against it than against any other.
    pub fn end(&self) -> Option<f64> {
        let least = |ends: &[usize]| ends.iter().map(|k| self.against[*k]).fold(f64::INFINITY, f64::min);
        let inside = least(&std::array::from_fn::<usize, N, _>(|k| k)[1..N - 1]);
        let end = if self.against[0] <= self.against[N - 1] { 0 } else { N - 1 };
        (self.against[end] < inside).then(|| self.values[end])
    }

    /// The value that least is said against, with its deviation; `None` where it lies at an end or nothing is said.
    pub fn least(&self) -> Option<(f64, f64)> {
        let best = (1..N - 1).min_by(|&a, &b| self.against[a].total_cmp(&self.against[b]))?;
        let (a, b, c) = (self.against[best - 1], self.against[best], self.against[best + 1]);
        let (step, bend) = (self.values[best + 1] - self.values[best], a - 2.0 * b + c);
        (b <= a && b <= c && bend > 1e-9).then(|| (self.values[best] + 0.5 * step * (a - c) / bend, step / bend.sqrt()))
    }
}

/// How the bands at several tubes would look: the scene's own shape on each figure.
pub fn on_figures<'a>(
    scene: &'a RacketScene,
    frame: &'a RacketFrame,
    figures: &'a [crate::tracking::racket::racket_figure::RacketFigure],
    camera: CameraId,
    marker: usize,
) -> Option<Vec<(BandView, BandShape)>> {
    let look = |figure| Some((BandView::at(scene.view, figure, &frame.pose.global_from_racket, camera, marker)?, *scene.shape));
    figures.iter().map(look).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_least_is_the_vertex_of_a_parabola_and_no_end() {
        let parabola = |middle: f64| {
            let mut t = Trial::new([0.0, 1.0, 2.0, 3.0, 4.0]);
            t.add(&[0.0, 1.0, 2.0, 3.0, 4.0].map(|v: f64| 2.0 * (v - middle).powi(2)));
            t
        };
        let (value, sd) = parabola(1.7).least().expect("inside");
        assert!((value - 1.7).abs() < 1e-12 && (sd - 0.5).abs() < 1e-12);
        assert!(parabola(4.6).least().is_none() && Trial::new([0.0, 1.0, 2.0]).least().is_none());
        // There it is looked for beyond the end; not where nothing is said, or all is told.
        assert_eq!([parabola(4.6), parabola(-0.8), parabola(1.7), Trial::new([0.0; 5])].map(|t| t.end()), [Some(4.0), Some(0.0), None, None]);
        // As sure beforehand as the pictures are: halfway.
        let (value, _) = parabola(1.0).expecting(3.0, 0.5).least().expect("inside");
        assert!((value - 2.0).abs() < 1e-12);
    }
}
