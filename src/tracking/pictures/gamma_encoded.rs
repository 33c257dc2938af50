//! Pictures that are not linear in light, told by their noise.
//!
//! Light comes in photons: the variance of a pixel's grey rises in proportion to the grey, on top of a constant that is the
//! electronics' (the photon transfer method of EMVA 1288). A camera that writes grey as light to the power γ < 1 stretches dark and
//! presses bright greys, so that the variance goes with grey to a power between 2 - 2/γ (electronics) and 2 - 1/γ (photons): with γ = 0.45
//! between -2.4 and -0.2, where linear pictures have 0 to 1. Nothing but two pictures of the same still places is needed.

use crate::calibration::CameraId;
use crate::footage::{FrameSource, GreyView, Rows};
use crate::tracking::pictures::shot_frames::Shot;
use std::sync::LazyLock;

/// Limits of the ranges of grey whose noise is compared. Below them a black level cuts the noise off, above them white does.
const RANGES: [f64; 10] = [12.0, 17.0, 24.0, 34.0, 48.0, 68.0, 96.0, 135.0, 190.0, 236.0];
/// Every so many rows and columns is looked at.
const STEP: usize = 2;
/// Share of a range's pixels that count, those that differ least: what moves is among the others.
const STILL: f64 = 0.75;
/// Fewest pixels of a range, and fewest ranges.
const FEWEST: u32 = 300;
const FEWEST_RANGES: usize = 3;
/// Variance of whole numbers' rounding keeps a range without noise from having a logarithm of nothing.
const ROUNDING: f64 = 1.0 / 12.0;
/// Scatter of a range's logarithm whatever its pixels, and with their number (what moves is not spread evenly over the ranges).
const SCATTER: (f64, f64) = (0.02, 3.0);
/// Power of grey below which each camera's pictures are told, and by how many of its deviations (of 58 cameras in linear light none is below 0,
/// with γ = 0.45 all are below -0.7).
const TOLD: (f64, f64) = (-0.6, 3.0);
/// Pictures that a camera may miss before it is not asked.
const MOST_MISSING: usize = 8;

/// Differences between two pictures, by range of their mean grey.
struct NoiseByGrey {
    /// How many pixels differ by so many grey levels.
    ranges: [[u32; 256]; RANGES.len() - 1],
    /// Sum over the pixels of both greys.
    greys: [u64; RANGES.len() - 1],
}

/// The range of a pixel by the sum of its greys in both pictures; `None` outside all of them.
static RANGE_OF: LazyLock<[Option<usize>; 511]> = LazyLock::new(|| {
    std::array::from_fn(|sum| RANGES.partition_point(|limit| *limit <= 0.5 * sum as f64).checked_sub(1).filter(|range| *range < RANGES.len() - 1))
});

impl NoiseByGrey {
    fn none() -> Self {
        NoiseByGrey { ranges: [[0; 256]; RANGES.len() - 1], greys: [0; RANGES.len() - 1] }
    }

    fn add(&mut self, a: &GreyView, b: &GreyView) {
        let range_of = &*RANGE_OF;
        for y in (0..a.height).step_by(STEP) {
            let (Some(a), Some(b)) = (a.row(y), b.row(y)) else { continue };
            for (a, b) in a.iter().zip(b).step_by(STEP) {
                let sum = usize::from(*a) + usize::from(*b);
                if let Some(range) = range_of[sum] {
                    self.ranges[range][usize::from(a.abs_diff(*b))] += 1;
                    self.greys[range] += sum as u64;
                }
            }
        }
    }

    /// The power of grey with which the variance goes, and one over its variance.
    fn power(self) -> Option<(f64, f64)> {
        let mut points: Vec<(f64, f64, f64)> = Vec::new();
        for (counts, greys) in self.ranges.iter().zip(self.greys) {
            let pixels = counts.iter().sum::<u32>();
            if pixels < FEWEST {
                continue;
            }
            let n = f64::from(pixels);
            let still = (STILL * n) as u32;
            // The smallest differences, until there are so many.
            let (mut left, mut squares) = (still, 0.0);
            for (difference, count) in counts.iter().enumerate() {
                squares += f64::from((*count).min(left)) * (difference * difference) as f64;
                left = left.saturating_sub(*count);
            }
            let variance = squares / (2.0 * f64::from(still)) + ROUNDING;
            points.push(((0.5 * greys as f64 / n).ln(), variance.ln(), 1.0 / (SCATTER.0 + SCATTER.1 / n.min(10_000.0))));
        }
        if points.len() < FEWEST_RANGES {
            return None;
        }
        let sum = |f: &dyn Fn(&(f64, f64, f64)) -> f64| points.iter().map(|p| p.2 * f(p)).sum::<f64>();
        let weight = sum(&|_| 1.0);
        let (x, y) = (sum(&|p| p.0) / weight, sum(&|p| p.1) / weight);
        let information = sum(&|p| (p.0 - x).powi(2));
        Some((sum(&|p| (p.0 - x) * (p.1 - y)) / information, information))
    }
}

/// The power of grey of pictures that are not linear in light, from each camera's power and one over its variance. A camera that sees an arm moving over dark
/// ground has it too: cameras are set alike, so that the other must say the same.
fn told(cameras: &[(f64, f64)]) -> Option<f64> {
    let information: f64 = cameras.iter().map(|(_, i)| i).sum();
    let power = cameras.iter().map(|(p, i)| p * i).sum::<f64>() / information;
    (cameras.iter().all(|(p, _)| *p < TOLD.0) && -power * information.sqrt() > TOLD.1).then_some(power)
}

impl<S: FrameSource> Shot<'_, S> {
    /// What the user should know of pictures that are not linear in light.
    pub(in crate::tracking) fn gamma_encoded(&self) -> Option<String> {
        let cameras: Vec<(f64, f64)> = CameraId::BOTH.into_iter().filter_map(|camera| self.noise_by_grey(camera).power()).collect();
        told(&cameras).map(|power| {
            format!(
                "the pictures' noise falls where they are brighter (variance with grey to the power {power:.1}), as in pictures that are encoded with a gamma and not linear in light: places and spin of the ball are less certain than stated (spin by up to seven times); record with gamma 1"
            )
        })
    }

    /// Of the first two neighbouring pictures from a quarter of the clip on, before most of what moves comes.
    fn noise_by_grey(&self, camera: CameraId) -> NoiseByGrey {
        let mut noise = NoiseByGrey::none();
        let start = self.source.len() / 4;
        self.with_buffers(|[one, other]| {
            for index in start..(start + MOST_MISSING).min(self.source.len().saturating_sub(1)) {
                let a = self.read_one(index, camera.index(), Rows::ALL, one).ok().flatten();
                let b = if a.is_some() { self.read_one(index + 1, camera.index(), Rows::ALL, other).ok().flatten() } else { None };
                if let Some((a, b)) = a.zip(b) {
                    return noise.add(&a, &b);
                }
            }
        });
        noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footage::GreyImage;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    #[test]
    fn law_both_cameras_must_say_that_the_light_is_pressed() {
        assert!(told(&[(-1.0, 22.0), (-0.8, 22.0)]).is_some_and(|power| (power + 0.9).abs() < 1e-9));
        assert_eq!(told(&[(-1.7, 22.0), (0.15, 22.0)]), None);
        assert_eq!(told(&[(-1.0, 1.0), (-0.8, 1.0)]), None);
        assert!(told(&[(-1.0, 22.0)]).is_some() && told(&[]).is_none());
    }

    /// The power of two pictures of a scene of all lights, a part of which moves, written with a gamma.
    fn power(gamma: f64, photons: f64, electronics: f64) -> Option<(f64, f64)> {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut picture = |moved: usize| {
            let pixels = (0..256 * 256).map(|i| {
                let (x, y) = (i % 256, i / 256);
                // A sixteenth moves, of middle greys alone: far less than the share that is left out of any range.
                let light = if y < 16 { ((x + moved) * 37 % 200) as f64 } else { 3.0 + 0.9 * x as f64 };
                let noise = Normal::new(0.0, (electronics * electronics + photons * light).sqrt()).expect("a deviation");
                (255.0 * ((light + noise.sample(&mut rng)).clamp(0.0, 255.0) / 255.0).powf(gamma)).round() as u8
            });
            GreyImage { width: 256, height: 256, pixels: pixels.collect() }
        };
        let (a, b) = (picture(0), picture(3));
        let mut noise = NoiseByGrey::none();
        noise.add(&GreyView::of(&a), &GreyView::of(&b));
        noise.power()
    }

    #[test]
    fn truth_noise_rises_with_the_light_in_linear_pictures_and_falls_in_encoded_ones() {
        for (photons, electronics) in [(0.03, 1.2), (0.0, 2.5), (0.15, 0.5)] {
            let (linear, _) = power(1.0, photons, electronics).expect("enough");
            assert!((-0.2..1.2).contains(&linear), "{photons} {electronics}: {linear}");
        }
        for (photons, electronics, low, high) in [(0.03, 1.2, -2.6, -0.8), (0.0, 2.5, -2.6, -1.8)] {
            let (encoded, information) = power(0.45, photons, electronics).expect("enough");
            assert!((low..high).contains(&encoded) && -encoded * information.sqrt() > TOLD.1, "{photons} {electronics}: {encoded}");
        }
    }
}
