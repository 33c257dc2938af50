//! The racket in one frame as it was measured, and what all frames share: cameras, figure and tape.

use crate::calibration::CameraId;
use crate::footage::Rows;
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_pose::{MarkerObservation, RacketPose, View};
use crate::tracking::tape::band::BandShape;
use crate::tracking::track_file::ImagePoint;
use nalgebra::{Isometry3, Point3};

/// All bands of the five markers in two pictures.
pub const ALL_BANDS: usize = 10;

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
    /// The rows of a picture that [`measure`](super::racket_track::measure) looks at; all when a marker may be anywhere.
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
        Some(Rows::of([self.view.rows(top - margin, bottom + margin)]))
    }

    /// Largest distance between a marker's images at two poses, px; infinite where one is behind a camera.
    pub(super) fn apart_px(&self, a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
        let far = |camera: CameraId, marker: &Point3<f64>| Some((self.view.project(camera, &(a * marker))? - self.view.project(camera, &(b * marker))?).norm());
        let all = CameraId::BOTH.into_iter().flat_map(|camera| self.figure.points.iter().map(move |marker| (camera, marker)));
        all.map(|(camera, marker)| far(camera, marker).unwrap_or(f64::INFINITY)).fold(0.0, f64::max)
    }
}
