//! What the fixed cameras see when nothing moves: the median of a few frames spread over the clip.

use crate::footage::{FootageError, FrameBuffer, FrameSource, GreyImage};

/// Frames looked at. Seven spread over the clip keep a racket or ball that passes from entering the median; memory stays
/// the same however long the clip is.
const SAMPLES: usize = 7;

/// The median picture of one camera; `None` when fewer than three frames can be read or their sizes differ.
pub fn background(source: &impl FrameSource, camera: usize) -> Result<Option<GreyImage>, FootageError> {
    let n = source.len();
    let mut pictures: Vec<GreyImage> = Vec::with_capacity(SAMPLES);
    let mut buffer = FrameBuffer::default();
    let mut previous = usize::MAX;
    for k in 0..SAMPLES {
        let index = if n == 0 { break } else { (n - 1) * k / (SAMPLES - 1) };
        if index == previous || !matches!(source.read(index, camera, None, &mut buffer), Ok(true)) {
            continue; // a gap or a broken file: the median does without
        }
        previous = index;
        if let Some(view) = buffer.view() {
            let mut pixels = Vec::with_capacity(view.width * view.rows);
            for y in view.first_row..view.first_row + view.rows {
                pixels.extend_from_slice(view.row(y).unwrap_or_default());
            }
            pictures.push(GreyImage { width: view.width, height: view.height, pixels });
        }
    }
    let Some(first) = pictures.first() else { return Ok(None) };
    let (width, height) = (first.width, first.height);
    if pictures.len() < 3 || pictures.iter().any(|p| p.width != width || p.pixels.len() != width * height) {
        return Ok(None);
    }
    let mut pixels = vec![0u8; width * height];
    let mut values = [0u8; SAMPLES];
    for (at, out) in pixels.iter_mut().enumerate() {
        for (v, p) in values.iter_mut().zip(&pictures) {
            *v = p.pixels[at];
        }
        let seen = &mut values[..pictures.len()];
        seen.sort_unstable();
        *out = seen[seen.len() / 2];
    }
    Ok(Some(GreyImage { width, height, pixels }))
}
