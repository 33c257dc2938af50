//! What following one shot has in hand: its pictures, the cameras, the racket's figure and light as known so far.

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyView, Rows};
use crate::tracking::pictures::recording::Fingerprint;
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_pose::View;
use crate::tracking::racket::racket_scene::RacketScene;
use crate::tracking::shot_tracks::{ShotSetup, TrackingError};
use crate::tracking::tape::band::BandShape;
use nalgebra::Point3;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Frames over which a lost racket or ball is still expected where it was going.
pub const PATIENCE: usize = 6;
/// Of many frames to be worked on one core takes no more than this before another may take the rest: halves and quarters of all leave one waiting
/// for the other.
pub const AT_ONCE: usize = 8;

pub struct Shot<'a, S: FrameSource> {
    pub source: &'a S,
    pub setup: &'a ShotSetup<'a>,
    pub view: &'a View<'a>,
    pub figure: RacketFigure,
    pub shape: BandShape,
    /// Blur of either camera's pictures as the tape shows it, px.
    pub blur_px: [f64; 2],
    pub focus: Point3<f64>,
    pub cancel: &'a AtomicBool,
    pub progress: &'a (dyn Fn(usize) + Sync),
    /// Pictures that repeat the one before or are washed out, by index and camera; they are read as missing.
    pub stale: Vec<[bool; 2]>,
    /// Why a picture could not be read, by index and camera.
    pub broken: Mutex<BTreeMap<(usize, usize), String>>,
    /// Places for pictures, used again: fresh memory costs as much as reading a picture does.
    spare: Mutex<Vec<[FrameBuffer; 2]>>,
}

impl<'a, S: FrameSource> Shot<'a, S> {
    /// Before anything of it is known.
    pub(in crate::tracking) fn new(
        source: &'a S,
        setup: &'a ShotSetup<'a>,
        view: &'a View<'a>,
        (figure, focus): (RacketFigure, Point3<f64>),
        cancel: &'a AtomicBool,
        progress: &'a (dyn Fn(usize) + Sync),
    ) -> Self {
        let shape = BandShape::default();
        Shot {
            source,
            setup,
            view,
            figure,
            shape,
            blur_px: shape.blur_px,
            focus,
            cancel,
            progress,
            stale: Vec::new(),
            broken: Mutex::default(),
            spare: Mutex::default(),
        }
    }
}

impl<S: FrameSource> Shot<'_, S> {
    /// Works with a place for two pictures.
    pub(in crate::tracking) fn with_buffers<R>(&self, work: impl FnOnce(&mut [FrameBuffer; 2]) -> R) -> R {
        let mut buffers = self.spare.lock().ok().and_then(|mut spare| spare.pop()).unwrap_or_default();
        let out = work(&mut buffers);
        if let Ok(mut spare) = self.spare.lock() {
            spare.push(buffers);
        }
        out
    }

    pub(in crate::tracking) fn scene(&self) -> RacketScene<'_> {
        RacketScene { view: self.view, figure: &self.figure, shape: &self.shape }
    }

    fn check_cancelled(&self) -> Result<(), TrackingError> {
        if self.cancel.load(Ordering::Relaxed) { Err(TrackingError::Cancelled) } else { Ok(()) }
    }

    /// Reads both pictures of a frame; a picture that is missing or broken is `None`.
    pub(in crate::tracking) fn read<'b>(&self, index: usize, buffers: &'b mut [FrameBuffer; 2]) -> Result<[Option<GreyView<'b>>; 2], TrackingError> {
        self.read_rows(index, [Rows::ALL; 2], buffers)
    }

    /// [`Self::read`], of each picture only the rows needed.
    pub(in crate::tracking) fn read_rows<'b>(
        &self,
        index: usize,
        rows: [Rows; 2],
        buffers: &'b mut [FrameBuffer; 2],
    ) -> Result<[Option<GreyView<'b>>; 2], TrackingError> {
        let [l, r] = buffers;
        Ok([self.read_one(index, 0, rows[0], l)?, self.read_one(index, 1, rows[1], r)?])
    }

    pub(in crate::tracking) fn read_one<'b>(
        &self,
        index: usize,
        camera: usize,
        rows: Rows,
        buffer: &'b mut FrameBuffer,
    ) -> Result<Option<GreyView<'b>>, TrackingError> {
        self.check_cancelled()?;
        if self.stale.get(index).is_some_and(|s| s[camera]) {
            return Ok(None);
        }
        let there = self.source.read(index, camera, rows, buffer).unwrap_or_else(|e| {
            if let Ok(mut broken) = self.broken.lock() {
                broken.insert((index, camera), e.to_string());
            }
            false
        });
        let view = if there { buffer.view() } else { None };
        let [calibrated_width, calibrated_height] = self.setup.rig.image_size;
        if let Some(GreyView { width, height, .. }) = view
            && (width, height) != (calibrated_width, calibrated_height)
        {
            // One picture of another size is broken; most of them are of another camera than the calibration's.
            if self.has_mostly_size(camera, (calibrated_width, calibrated_height)) {
                if let Ok(mut broken) = self.broken.lock() {
                    let camera_name = CameraId::BOTH[camera].name();
                    let what = format!(
                        "{camera_name} camera, frame {}: {width}x{height} px where the others have {calibrated_width}x{calibrated_height}",
                        self.source.number(index)
                    );
                    broken.insert((index, camera), what);
                }
                return Ok(None);
            }
            return Err(TrackingError::Size {
                frame: self.source.number(index),
                camera: CameraId::BOTH[camera],
                width,
                height,
                calibrated_width,
                calibrated_height,
            });
        }
        Ok(view)
    }

    /// Whether most of a few of a camera's pictures have this size.
    fn has_mostly_size(&self, camera: usize, size: (usize, usize)) -> bool {
        const SAMPLES: usize = 5;
        let n = self.source.len();
        let mut buffer = FrameBuffer::default();
        let of_size = |index: usize| {
            let there = self.source.read(index, camera, Rows::ALL, &mut buffer).unwrap_or(false);
            buffer.view().filter(|_| there).map(|v| (v.width, v.height) == size)
        };
        let seen: Vec<bool> = (0..SAMPLES).map(|k| k * n.saturating_sub(1) / (SAMPLES - 1)).filter_map(of_size).collect();
        2 * seen.iter().filter(|same| **same).count() > seen.len()
    }

    /// Mean grey of a whole picture; `None` where it is missing.
    pub(in crate::tracking) fn mean_grey(&self, index: usize, camera: usize) -> Option<f64> {
        self.with_buffers(|buffers| Some(Fingerprint::of(&self.read_one(index, camera, Rows::ALL, &mut buffers[camera]).ok()??).mean()))
    }

    /// Pixels per metre at the middle of the volume.
    pub(in crate::tracking) fn px_per_m(&self, camera: CameraId) -> f64 {
        self.setup.rig.camera(camera).fx / (self.view.eye(camera) - self.focus).norm()
    }
}

/// Frame indices by halving the clip: 1/2, 1/4, 3/4, 1/8, ... of its length, each once.
pub fn spread(n: usize) -> Vec<usize> {
    let (mut out, mut taken) = (Vec::with_capacity(n), vec![false; n]);
    let parts = n.next_power_of_two();
    let mut step = parts;
    while step > 1 {
        for k in (step / 2..parts).step_by(step) {
            let index = k * n / parts;
            if !std::mem::replace(&mut taken[index], true) {
                out.push(index);
            }
        }
        step /= 2;
    }
    out.extend((0..n).filter(|&i| !taken[i]));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_spread_visits_every_frame_once_middle_first() {
        for n in [0, 1, 2, 3, 7, 44, 300] {
            let mut order = spread(n);
            if n > 2 {
                assert!(order[0] > n / 4 && order[0] < 3 * n / 4 + 1, "{n} {}", order[0]);
            }
            order.sort_unstable();
            assert_eq!(order, (0..n).collect::<Vec<_>>());
        }
    }
}
