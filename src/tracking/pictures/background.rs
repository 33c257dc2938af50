//! What the fixed cameras see when nothing moves: the median of a few frames spread over the clip.

use crate::footage::{FootageError, FrameBuffer, FrameSource, GreyImage, GreyView, Rows};
use std::ops::Range;

/// Frames looked at. Seven spread over the clip keep a racket or ball that passes from entering the median; memory stays
/// the same however long the clip is.
const SAMPLES: usize = 7;
/// Pixels ranked at once.
const BLOCK: usize = 64;

/// Rows ranked at once: seven whole pictures would be fresh memory, page by page, which costs more than opening the files again.
const STRIPE: usize = 128;

/// The median picture of one camera over a whole clip; `None` when fewer than three frames can be read or their sizes differ.
pub fn background(source: &impl FrameSource, camera: usize) -> Result<Option<GreyImage>, FootageError> {
    background_of(source, camera, &(0..source.len()).collect::<Vec<_>>())
}

/// [`background`] over some frames, in order.
pub fn background_of(source: &impl FrameSource, camera: usize, frames: &[usize]) -> Result<Option<GreyImage>, FootageError> {
    let Some(last) = frames.len().checked_sub(1) else { return Ok(None) };
    let mut indices: Vec<usize> = (0..SAMPLES).map(|k| frames[last * k / (SAMPLES - 1)]).collect();
    indices.dedup();
    let mut samples: Vec<(usize, FrameBuffer)> = indices.into_iter().map(|index| (index, FrameBuffer::default())).collect();
    let mut still: Option<GreyImage> = None;
    loop {
        let first_row = still.as_ref().map_or(0, |s| s.pixels.len() / s.width.max(1));
        // A gap or a broken file: the median does without. A picture that was decoded whole is at hand.
        samples.retain_mut(|(index, buffer)| {
            let whole = first_row > 0 && buffer.view().is_some_and(|v| v.rows == v.height);
            whole || matches!(source.read(*index, camera, Rows::span(first_row, STRIPE), buffer), Ok(true))
        });
        let pictures: Vec<GreyView> = samples.iter().filter_map(|(_, buffer)| buffer.view()).collect();
        let Some(first) = pictures.first() else { return Ok(None) };
        let (width, height) = (first.width, first.height);
        if pictures.len() < 3 || pictures.iter().any(|p| (p.width, p.height) != (width, height)) {
            return Ok(None);
        }
        let still = still.get_or_insert_with(|| GreyImage { width, height, pixels: Vec::with_capacity(width * height) });
        if !add_medians(still, &pictures, first_row..height.min(first_row + STRIPE)) {
            return Ok(None);
        }
        if still.pixels.len() == width * height {
            break;
        }
    }
    Ok(still)
}

/// Appends the medians of these rows; `false` where a picture lacks one.
fn add_medians(still: &mut GreyImage, pictures: &[GreyView], rows: Range<usize>) -> bool {
    let mut ranked = [[0u8; BLOCK]; SAMPLES];
    for y in rows {
        for x in (0..still.width).step_by(BLOCK) {
            let width = BLOCK.min(still.width - x);
            for (r, p) in ranked.iter_mut().zip(pictures) {
                let Some(seen) = p.row(y).and_then(|row| row.get(x..x + width)) else { return false };
                r[..width].copy_from_slice(seen);
            }
            // Odd-even transposition: n rounds of exchanges between neighbours put n values in order, a block of pixels at once.
            let seen = &mut ranked[..pictures.len()];
            for round in 0..seen.len() {
                for pair in seen[round % 2..].chunks_exact_mut(2) {
                    let [a, b] = pair else { continue };
                    for (x, y) in a.iter_mut().zip(b) {
                        (*x, *y) = ((*x).min(*y), (*x).max(*y));
                    }
                }
            }
            still.pixels.extend_from_slice(&seen[seen.len() / 2][..width]);
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Still(Vec<GreyImage>);

    impl FrameSource for Still {
        fn len(&self) -> usize {
            self.0.len()
        }

        fn number(&self, index: usize) -> u64 {
            index as u64
        }

        fn read(&self, index: usize, _: usize, _: Rows, buffer: &mut FrameBuffer) -> Result<bool, FootageError> {
            buffer.put(self.0[index].clone());
            Ok(true)
        }
    }

    #[test]
    fn agrees_with_sorting_every_pixel() {
        let (width, height) = (19, 300);
        for n in [3, 4, 5, 6, 7] {
            let picture = |k: usize| (0..width * height).map(|i| ((i * 37 + k * k * 101 + (i * k) % 23 * 11) % 256) as u8).collect();
            let pictures: Vec<GreyImage> = (0..n).map(|k| GreyImage { width, height, pixels: picture(k) }).collect();
            let found = background(&Still(pictures.clone()), 0).expect("read").expect("enough");
            for at in 0..width * height {
                let mut values: Vec<u8> = pictures.iter().map(|p| p.pixels[at]).collect();
                values.sort_unstable();
                assert_eq!(found.pixels[at], values[n / 2]);
            }
        }
    }
}
