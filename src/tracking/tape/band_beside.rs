//! What lies beside a band, by the way along it: two rows of the picture, a pixel or two off either side of the tube.
//!
//! A pixel astride the tube's side shows what is behind it too. That changes along a band, and not evenly: beside the throat the head ends,
//! and the court shines through between. With one level and a slope for it, bands in the throat were pulled across by up to 0.15 px.

use crate::tracking::tape::band_sums::BESIDE_UNIT;

const UNIT: f32 = BESIDE_UNIT as f32;

/// Places along a band at which what lies beside it is known.
const KNOTS: usize = 48;
/// Least distance between them, px: as far as the picture resolves.
const LEAST_SPACING_PX: f64 = 1.0;

/// Sums of grey by place along, linearly between the knots, for the positive side across and the negative one.
pub struct Beside {
    first: f32,
    /// Knots from the first place to the last.
    length: f32,
    per_px: f32,
    grey: [[f32; KNOTS]; 2],
    weight: [[f32; KNOTS]; 2],
}

impl Beside {
    /// For places from `from` to `to`, px along the band.
    pub fn new(from: f64, to: f64) -> Self {
        let spacing = ((to - from) / (KNOTS - 2) as f64).max(LEAST_SPACING_PX);
        let length = (((to - from) / spacing) as f32).max(0.0);
        Beside { first: from as f32, length, per_px: 1.0 / spacing as f32, grey: [[0.0; KNOTS]; 2], weight: [[0.0; KNOTS]; 2] }
    }

    /// The knot before a place, and the share of the one after it.
    fn knot(&self, along: f32) -> (usize, f32) {
        let at = ((along - self.first) * self.per_px).clamp(0.0, self.length);
        let knot = (at as usize).min(KNOTS - 2);
        (knot, at - knot as f32)
    }

    /// Adds a pixel on the positive side across or the negative one.
    pub fn add(&mut self, along: f32, positive: bool, grey: f32) {
        let (k, share) = self.knot(along);
        let side = usize::from(!positive);
        for (knot, weight) in [(k, 1.0 - share), (k + 1, share)] {
            self.grey[side][knot] += weight * grey;
            self.weight[side][knot] += weight;
        }
    }

    /// Turns the sums into means, less the side's own mean, in [`BESIDE_UNIT`]; where nothing was seen, nothing is added.
    pub fn complete(&mut self) {
        for (grey, weight) in self.grey.iter_mut().zip(&self.weight) {
            let mean = grey.iter().sum::<f32>() / weight.iter().sum::<f32>().max(1e-3);
            for (g, w) in grey.iter_mut().zip(weight) {
                *g = if *w > 0.1 { (*g / w - mean) / UNIT } else { 0.0 };
            }
        }
    }

    /// At a place along, on the side of `across`.
    pub fn at(&self, along: f32, across: f32) -> f32 {
        let (k, share) = self.knot(along);
        let grey = &self.grey[usize::from(across < 0.0)];
        grey[k] + share * (grey[k + 1] - grey[k])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_step_along_one_side_is_seen_there_and_not_on_the_other() {
        let mut beside = Beside::new(-8.0, 8.0);
        for t in -16..=16 {
            let t = 0.5 * t as f32;
            beside.add(t, true, if t < 0.0 { 40.0 } else { 140.0 });
            beside.add(t, false, 90.0);
        }
        beside.complete();
        assert!((beside.at(5.0, 1.0) - beside.at(-5.0, 1.0) - 100.0 / UNIT).abs() < 1e-4);
        assert!(beside.at(5.0, -1.0).abs() < 1e-5 && beside.at(-5.0, -1.0).abs() < 1e-5);
        // Beyond the ends it goes on as it ends; a long band has wider steps.
        assert_eq!(beside.at(90.0, 1.0), beside.at(8.0, 1.0));
        let mut long = Beside::new(-400.0, 400.0);
        (-400..=400).for_each(|t| long.add(t as f32, true, (100 + t / 8) as f32));
        long.complete();
        assert!((long.at(160.0, 1.0) - 20.0 / UNIT).abs() < 0.03 && (long.at(-160.0, 1.0) + 20.0 / UNIT).abs() < 0.03);
    }
}
