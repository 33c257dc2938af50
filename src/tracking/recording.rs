//! Faults of a recording that the pictures themselves show: a picture that repeats the one before, a dark or washed-out one.

use crate::footage::{FrameSource, GreyView};

/// Every this many rows count for the fingerprint: noise makes any two pictures differ within a few rows.
const ROW_STEP: usize = 4;
/// A picture is dark (or washed out) when its mean grey is below (above) the clip's median by this factor.
const FACTOR: f64 = 3.0;
/// A picture with a higher mean grey is white nearly everywhere.
const WHITE: f64 = 250.0;

/// What tells two pictures apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fingerprint {
    hash: u64,
    mean: f64,
}

impl Fingerprint {
    /// Of every fourth row: FNV-1a over eight bytes at a time, in four lanes so that none waits for the other.
    pub fn of(view: &GreyView) -> Self {
        let mut lanes = [0xcbf2_9ce4_8422_2325u64, 0x9ae1_6a3b_2f90_404f, 0xc949_d7c7_509e_6557, 0xff51_afd7_ed55_8ccd];
        let (mut sum, mut n) = (0u64, 0u64);
        for y in (view.first_row..view.first_row + view.rows).step_by(ROW_STEP) {
            let row = view.row(y).unwrap_or_default();
            let (words, rest) = row.as_chunks::<8>();
            for four in words.chunks(4) {
                for (lane, word) in lanes.iter_mut().zip(four) {
                    *lane = (*lane ^ u64::from_le_bytes(*word)).wrapping_mul(0x0100_0000_01b3).rotate_left(23);
                }
            }
            for byte in rest {
                lanes[0] = (lanes[0] ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3).rotate_left(23);
            }
            sum += row.iter().map(|b| u32::from(*b)).sum::<u32>() as u64;
            n += row.len() as u64;
        }
        let hash = lanes.iter().fold(0u64, |h, lane| (h ^ lane).wrapping_mul(0x0100_0000_01b3).rotate_left(23));
        Fingerprint { hash, mean: sum as f64 / n.max(1) as f64 }
    }
}

/// Pictures that are exactly the one before in the same camera, by frame index and camera. A camera's noise never repeats;
/// the later of two equal pictures is the stale one.
pub fn repeated(prints: &[[Option<Fingerprint>; 2]]) -> Vec<[bool; 2]> {
    (0..prints.len()).map(|i| [0, 1].map(|c| i > 0 && prints[i][c].is_some() && prints[i][c].map(|p| p.hash) == prints[i - 1][c].map(|p| p.hash))).collect()
}

/// Pictures that are washed out: white nearly everywhere, so that nothing in them can be measured. By index and camera.
pub fn washed_out(prints: &[[Option<Fingerprint>; 2]]) -> Vec<[bool; 2]> {
    prints.iter().map(|p| p.map(|p| p.is_some_and(|p| p.mean > WHITE))).collect()
}

/// What the user should know about stale pictures.
pub fn notes(source: &impl FrameSource, stale: &[[bool; 2]]) -> Vec<String> {
    let mut out = Vec::new();
    for (camera, name) in ["left", "right"].iter().enumerate() {
        for i in (0..stale.len()).filter(|i| stale[*i][camera]) {
            out.push(format!("{name} frame {} repeats the frame before; its points are left out", source.number(i)));
        }
    }
    out
}

/// Frames whose picture is much darker or brighter than the clip's usual one, with what it is.
pub fn dark_or_bright(source: &impl FrameSource, prints: &[[Option<Fingerprint>; 2]]) -> Vec<String> {
    let mut out = Vec::new();
    for (camera, name) in ["left", "right"].iter().enumerate() {
        let mut means: Vec<f64> = prints.iter().filter_map(|p| Some(p[camera]?.mean)).collect();
        means.sort_by(f64::total_cmp);
        let Some(usual) = means.get(means.len() / 2).map(|m| m.max(1.0)) else { continue };
        for (i, print) in prints.iter().enumerate() {
            let Some(mean) = print[camera].map(|p| p.mean) else { continue };
            let what = if mean * FACTOR < usual {
                "dark"
            } else if mean > usual * FACTOR || mean > WHITE {
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
    use crate::footage::GreyImage;

    #[test]
    fn truth_the_later_of_two_equal_pictures_is_stale() {
        let picture = |k: u8| GreyImage { width: 20, height: 12, pixels: (0..240u32).map(|i| (i as u8).wrapping_mul(7).wrapping_add(k)).collect() };
        let print = |k| Some(Fingerprint::of(&GreyView::of(&picture(k))));
        let prints = vec![[print(1), print(2)], [print(3), print(4)], [print(3), print(5)], [None, print(6)], [print(3), print(6)]];
        let stale = repeated(&prints);
        assert_eq!(stale, [[false, false], [false, false], [true, false], [false, false], [false, true]]);
    }
}
