//! Where tracking gets its frames from: a recorded clip, or pictures in memory (tests, synthetic worlds).

use super::bitmap::Bitmap;
use super::{Clip, FootageError, GreyImage, GreyView, Rows};
use std::sync::Arc;

/// Frames of both cameras by index. Reading is independent per index, so that several threads may read at once.
pub trait FrameSource: Sync {
    fn len(&self) -> usize;

    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of a frame, as in its file name. Ascending; gaps are allowed.
    fn number(&self, index: usize) -> u64;

    /// Reads camera 0 (left) or 1 (right) into the buffer; `false` when that camera lacks the frame. `rows` are the only rows
    /// needed; more may be read.
    fn read(&self, index: usize, camera: usize, rows: Rows, buffer: &mut FrameBuffer) -> Result<bool, FootageError>;
}

/// A reusable place for one picture.
#[derive(Debug, Default)]
pub struct FrameBuffer {
    bitmap: Bitmap,
    whole: Option<Arc<GreyImage>>,
}

impl FrameBuffer {
    /// What was read last.
    pub fn view(&self) -> Option<GreyView<'_>> {
        self.whole.as_deref().map(GreyView::of).or_else(|| self.bitmap.view())
    }

    /// Puts a whole picture in.
    pub fn put(&mut self, image: impl Into<Arc<GreyImage>>) {
        self.whole = Some(image.into());
    }
}

impl FrameSource for Clip {
    fn len(&self) -> usize {
        self.pairs.len()
    }

    fn number(&self, index: usize) -> u64 {
        self.pairs.get(index).map_or(0, |p| p.number)
    }

    fn read(&self, index: usize, camera: usize, rows: Rows, buffer: &mut FrameBuffer) -> Result<bool, FootageError> {
        let (Some(pair), Some(known)) = (self.pairs.get(index), self.known.get(index)) else { return Ok(false) };
        let Some(path) = &pair.files[camera] else { return Ok(false) };
        buffer.whole = None;
        if !buffer.bitmap.read(path, rows, &known[camera]).unwrap_or(false) {
            buffer.put(self.decoded.read(path)?);
        }
        Ok(true)
    }
}
