//! Faults of a recording that the pictures themselves show: a picture that repeats the one before, a dark or washed-out one.

use crate::calibration::CameraId;
use crate::footage::{FrameSource, GreyView};
use crate::median::upper_median;

/// Every this many rows count for the fingerprint: noise makes any two pictures differ within a few rows.
const ROW_STEP: usize = 4;
/// Fewest rows that two pictures must share to be called equal.
const LEAST_ROWS: usize = 4;
/// A picture is dark (or washed out) when its mean grey is below (above) the clip's median by this factor.
const FACTOR: f64 = 3.0;
/// Rows whose mean is off by this factor are reason to look at the whole picture.
const SUSPECT: f64 = 1.7;
/// A picture with a higher mean grey is white nearly everywhere.
const WHITE: f64 = 250.0;

/// What tells two pictures apart, of the rows that were read.
#[derive(Debug, Clone, PartialEq)]
pub struct Fingerprint {
    /// Number of the first row, in steps.
    first: usize,
    /// One value per row; `None` where it was not read.
    rows: Vec<Option<u64>>,
    /// Mean grey of these rows.
    mean: f64,
}

impl Fingerprint {
    /// Of every fourth row: FNV-1a over eight bytes at a time, in four lanes so that none waits for the other.
    pub fn of(view: &GreyView) -> Self {
        let first = view.first_row.div_ceil(ROW_STEP);
        let mut rows = Vec::with_capacity(view.rows / ROW_STEP + 1);
        let (mut sum, mut read) = (0u64, 0);
        for y in (first * ROW_STEP..view.first_row + view.rows).step_by(ROW_STEP) {
            let Some(row) = view.row(y) else {
                rows.push(None);
                continue;
            };
            read += 1;
            let mut lanes = [0xcbf2_9ce4_8422_2325u64, 0x9ae1_6a3b_2f90_404f, 0xc949_d7c7_509e_6557, 0xff51_afd7_ed55_8ccd];
            let (words, rest) = row.as_chunks::<8>();
            // Greys of every other byte side by side: sixteen bits hold the sums of 128 words.
            const EVERY_OTHER: u64 = 0x00ff_00ff_00ff_00ff;
            for many in words.chunks(128) {
                let mut greys = [0u64; 4];
                let mut add = |k: usize, word: &[u8; 8]| {
                    let word = u64::from_le_bytes(*word);
                    lanes[k] = (lanes[k] ^ word).wrapping_mul(0x0100_0000_01b3).rotate_left(23);
                    greys[k] += (word & EVERY_OTHER) + ((word >> 8) & EVERY_OTHER);
                };
                let (fours, left) = many.as_chunks::<4>();
                for [a, b, c, d] in fours {
                    add(0, a);
                    add(1, b);
                    add(2, c);
                    add(3, d);
                }
                left.iter().enumerate().for_each(|(k, word)| add(k, word));
                sum += greys.iter().flat_map(|g| [0, 16, 32, 48].map(|by| (g >> by) & 0xffff)).sum::<u64>();
            }
            for byte in rest {
                lanes[0] = (lanes[0] ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3).rotate_left(23);
            }
            rows.push(Some(lanes.iter().fold(0u64, |h, lane| (h ^ lane).wrapping_mul(0x0100_0000_01b3).rotate_left(23))));
            sum += rest.iter().map(|b| u64::from(*b)).sum::<u64>();
        }
        let mean = sum as f64 / (read * view.width).max(1) as f64;
        Fingerprint { first, rows, mean }
    }

    /// Mean grey of the rows that were read.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Whether two pictures are equal in all rows that both show.
    fn equals(&self, other: &Self) -> bool {
        let from = self.first.max(other.first);
        let both = || self.rows.iter().skip(from - self.first).zip(other.rows.iter().skip(from - other.first)).filter_map(|(a, b)| a.zip(*b));
        both().all(|(a, b)| a == b) && both().count() >= LEAST_ROWS
    }
}

/// Every picture's fingerprint, by frame index and camera.
pub type Fingerprints = Vec<[Option<Fingerprint>; 2]>;

/// Pictures that are exactly the one before in the same camera, by frame index and camera. A camera's noise never repeats;
/// the later of two equal pictures is the stale one.
pub fn repeated(prints: &[[Option<Fingerprint>; 2]]) -> Vec<[bool; 2]> {
    let equal = |i: usize, c: usize| prints[i][c].as_ref().zip(prints[i - 1][c].as_ref()).is_some_and(|(a, b)| a.equals(b));
    (0..prints.len()).map(|i| [0, 1].map(|c| i > 0 && equal(i, c))).collect()
}

/// Mean grey of every picture: of the rows that were read, or, where these look unusual, what `whole` finds in the whole
/// picture. With it the camera's usual mean grey.
pub fn mean_greys(prints: &[[Option<Fingerprint>; 2]], whole: impl Fn(usize, usize) -> Option<f64>) -> [MeanGreys; 2] {
    [0, 1].map(|camera| {
        let of_rows: Vec<Option<f64>> = prints.iter().map(|p| Some(p[camera].as_ref()?.mean)).collect();
        let usual = median(of_rows.iter().flatten().copied());
        let suspect = |m: f64| is_darker(m, usual, SUSPECT) || is_brighter(m, usual, SUSPECT);
        if !of_rows.iter().flatten().any(|m| suspect(*m)) {
            return MeanGreys { by_frame: of_rows, usual };
        }
        // Rows of the racket's surroundings may be darker or brighter than others of the same picture.
        let samples = (0..SAMPLES).filter_map(|k| whole((prints.len() - 1) * k / (SAMPLES - 1), camera));
        let usual = median(samples);
        let by_frame = of_rows.iter().enumerate().map(|(i, m)| m.and_then(|m| if suspect(m) { whole(i, camera) } else { Some(usual) })).collect();
        MeanGreys { by_frame, usual }
    })
}

/// Mean grey of a picture without light.
const NO_LIGHT: f64 = 1.0;
/// Whole pictures that say how bright the clip usually is.
const SAMPLES: usize = 9;

/// How bright one camera's pictures are.
pub struct MeanGreys {
    by_frame: Vec<Option<f64>>,
    usual: f64,
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    upper_median(values).unwrap_or(NO_LIGHT)
}

/// Less than a share of the usual mean grey. Below one grey level there is no light to speak of: a dark curtain makes such pictures.
fn is_darker(mean: f64, usual: f64, times: f64) -> bool {
    usual >= NO_LIGHT && mean * times < usual
}

/// So many times the usual mean grey, or white nearly everywhere.
fn is_brighter(mean: f64, usual: f64, times: f64) -> bool {
    mean > usual.max(NO_LIGHT) * times || mean > WHITE
}

/// Pictures that are washed out: white nearly everywhere, so that nothing in them can be measured. By index and camera.
pub fn washed_out(means: &[MeanGreys; 2], index: usize) -> [bool; 2] {
    means.each_ref().map(|m| m.by_frame[index].is_some_and(|mean| mean > WHITE))
}

/// What the user should know about stale pictures.
pub fn notes(source: &impl FrameSource, stale: &[[bool; 2]]) -> Vec<String> {
    let mut out = Vec::new();
    for camera in CameraId::BOTH {
        for i in (0..stale.len()).filter(|i| stale[*i][camera.index()]) {
            out.push(format!("{} frame {} repeats the frame before; its points are left out", camera.name(), source.number(i)));
        }
    }
    out
}

/// Frames whose picture is much darker or brighter than the clip's usual one, with what it is.
pub fn dark_or_bright(source: &impl FrameSource, means: &[MeanGreys; 2]) -> Vec<String> {
    let mut out = Vec::new();
    for (means, camera) in means.iter().zip(CameraId::BOTH) {
        let (usual, name) = (means.usual, camera.name());
        for (i, mean) in means.by_frame.iter().enumerate() {
            let Some(mean) = *mean else { continue };
            let what = if is_darker(mean, usual, FACTOR) {
                "dark"
            } else if is_brighter(mean, usual, FACTOR) {
                "washed out"
            } else {
                continue;
            };
            let left_out = if mean > WHITE { "; its points are left out" } else { "" };
            out.push(format!("{name} frame {} is {what} (mean grey {mean:.0}, usually {usual:.0}){left_out}", source.number(i)));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footage::{FootageError, FrameBuffer, GreyImage, Rows};

    #[test]
    fn bound_pictures_before_a_black_curtain_are_not_dark() {
        struct Frames;
        impl FrameSource for Frames {
            fn len(&self) -> usize {
                3
            }
            fn number(&self, index: usize) -> u64 {
                index as u64
            }
            fn read(&self, _: usize, _: usize, _: Rows, _: &mut FrameBuffer) -> Result<bool, FootageError> {
                Ok(false)
            }
        }
        let told = |means: [f64; 3]| {
            let camera = || MeanGreys { by_frame: means.map(Some).to_vec(), usual: median(means.into_iter()) };
            dark_or_bright(&Frames, &[camera(), camera()]).len()
        };
        assert_eq!((told([0.3, 0.3, 0.2]), told([60.0, 60.0, 15.0]), told([60.0, 60.0, 200.0])), (0, 2, 2));
    }

    #[test]
    fn truth_the_later_of_two_equal_pictures_is_stale() {
        let picture = |k: u8| GreyImage { width: 20, height: 40, pixels: (0..800u32).map(|i| (i as u8).wrapping_mul(7).wrapping_add(k)).collect() };
        let print = |k| Some(Fingerprint::of(&GreyView::of(&picture(k))));
        let band = |k, first| {
            let p = picture(k);
            Fingerprint::of(&GreyView::band(&p.pixels[20 * first..], 20, false, (20, 40), first, 40 - first).expect("fits"))
        };
        assert!(band(3, 0).equals(&band(3, 13)) && !band(3, 0).equals(&band(4, 13)));
        assert!(!band(3, 0).equals(&band(3, 35)), "one row in common is not enough");
        let prints = vec![[print(1), print(2)], [print(3), print(4)], [print(3), print(5)], [None, print(6)], [print(3), print(6)]];
        let stale = repeated(&prints);
        assert_eq!(stale, [[false, false], [false, false], [true, false], [false, false], [false, true]]);
    }
}
