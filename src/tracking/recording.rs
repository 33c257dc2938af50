//! Faults of a recording that the pictures themselves show: a picture that repeats the one before, a dark or washed-out one.

use crate::footage::{FrameSource, GreyView};

/// Every this many rows count for the fingerprint: noise makes any two pictures differ within a few rows.
const ROW_STEP: usize = 4;
/// A picture is dark (or washed out) when its mean grey is below (above) the clip's median by this factor.
const FACTOR: f64 = 3.0;

/// What tells two pictures apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fingerprint {
    hash: u64,
    mean: f64,
}

impl Fingerprint {
    /// Of every fourth row (FNV-1a over eight bytes at a time).
    pub fn of(view: &GreyView) -> Self {
        let (mut hash, mut sum, mut n) = (0xcbf2_9ce4_8422_2325u64, 0u64, 0u64);
        for y in (view.first_row..view.first_row + view.rows).step_by(ROW_STEP) {
            for eight in view.row(y).unwrap_or_default().chunks(8) {
                let mut word = [0u8; 8];
                word[..eight.len()].copy_from_slice(eight);
                hash = (hash ^ u64::from_le_bytes(word)).wrapping_mul(0x0100_0000_01b3).rotate_left(23);
                sum += word.iter().map(|b| u64::from(*b)).sum::<u64>();
                n += eight.len() as u64;
            }
        }
        Fingerprint { hash, mean: sum as f64 / n.max(1) as f64 }
    }
}

/// Pictures that are exactly the one before in the same camera, by frame index and camera. A camera's noise never repeats;
/// the later of two equal pictures is the stale one.
pub fn repeated(prints: &[[Option<Fingerprint>; 2]]) -> Vec<[bool; 2]> {
    (0..prints.len()).map(|i| [0, 1].map(|c| i > 0 && prints[i][c].is_some() && prints[i][c].map(|p| p.hash) == prints[i - 1][c].map(|p| p.hash))).collect()
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
            } else if mean > usual * FACTOR || mean > 250.0 {
                "washed out"
            } else {
                continue;
            };
            out.push(format!("{name} frame {} is {what} (mean grey {mean:.0}, usually {usual:.0})", source.number(i)));
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
