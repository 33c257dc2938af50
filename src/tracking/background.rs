//! What the fixed cameras see when nothing moves: the median of a few frames spread over the clip.

use crate::footage::{FootageError, FrameBuffer, FrameSource, GreyImage, GreyView, Rows};

/// Frames looked at. Seven spread over the clip keep a racket or ball that passes from entering the median; memory stays
/// the same however long the clip is.
const SAMPLES: usize = 7;
/// Pixels ranked at once.
const BLOCK: usize = 64;

/// The median picture of one camera; `None` when fewer than three frames can be read or their sizes differ.
pub fn background(source: &impl FrameSource, camera: usize) -> Result<Option<GreyImage>, FootageError> {
    let n = source.len();
    let mut buffers: [FrameBuffer; SAMPLES] = Default::default();
    let mut previous = usize::MAX;
    let mut pictures: Vec<GreyView> = Vec::with_capacity(SAMPLES);
    for (k, buffer) in buffers.iter_mut().enumerate() {
        let index = if n == 0 { break } else { (n - 1) * k / (SAMPLES - 1) };
        if index == previous || !matches!(source.read(index, camera, Rows::ALL, buffer), Ok(true)) {
            continue; // a gap or a broken file: the median does without
        }
        previous = index;
        pictures.extend(buffer.view());
    }
    let Some(first) = pictures.first() else { return Ok(None) };
    let (width, height) = (first.width, first.height);
    if pictures.len() < 3 || pictures.iter().any(|p| (p.width, p.height, p.rows) != (width, height, height)) {
        return Ok(None);
    }
    let mut pixels = vec![0u8; width * height];
    let mut ranked = [[0u8; BLOCK]; SAMPLES];
    let blocks = pixels.chunks_mut(width.max(1)).enumerate().flat_map(|(y, row)| row.chunks_mut(BLOCK).enumerate().map(move |(k, out)| (y, k * BLOCK, out)));
    for (y, x, out) in blocks {
        for (r, p) in ranked.iter_mut().zip(&pictures) {
            let seen = p.row(y).unwrap_or_default();
            r[..out.len()].copy_from_slice(&seen[x..x + out.len()]);
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
        out.copy_from_slice(&seen[seen.len() / 2][..out.len()]);
    }
    Ok(Some(GreyImage { width, height, pixels }))
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
        let (width, height) = (19, 13);
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
