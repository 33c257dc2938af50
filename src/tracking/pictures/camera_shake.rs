//! A camera that shakes: all that its pictures show moves together from one to the next, which no single picture tells.
//!
//! Third differences in time leave next to nothing of a smooth motion; what they have in common over the bands of one camera is the
//! camera's. Those of white noise of variance s² go against their neighbours (coefficients -1, 3, -3, 1: covariance -15 s²), those of a
//! motion that still changes go with them, so that a swing is never taken for shake. The errors of single bands go the same way, by
//! what the bands' scatter about their mean says, and are taken off.

use crate::calibration::CameraId;
use crate::median::upper_median;
use crate::tracking::track_file::{Target, Tracks};
use nalgebra::Vector2;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// Fewest bands that tell what they have in common, and fewest pairs of neighbouring third differences.
const FEWEST_BANDS: usize = 3;
const FEWEST_PAIRS: usize = 8;
/// Median of minus the product of neighbouring third differences of white noise in two dimensions, in its variance per axis (the mean
/// is 30): one picture that was lost or misread does not move it.
const MEDIAN: f64 = 19.6;
/// The bands' mean must move so many times as much (variance) as single bands' errors make it (at most 2.6 times in 144 views of
/// cameras that stand), and by so much, px.
const TIMES: f64 = 4.0;
const LEAST_PX: f64 = 0.03;

/// Bands of one picture.
type Bands = [Option<Vector2<f64>>; 5];

/// Deviation of either camera's shake per axis, px, independent from picture to picture; 0 where none shows. The frames of the
/// `contact` are left out: the blow is no smooth motion.
pub fn camera_shake(tracks: &Tracks, contact: &RangeInclusive<f64>) -> [f64; 2] {
    CameraId::BOTH.map(|camera| {
        let mut pictures: BTreeMap<u64, Bands> = BTreeMap::new();
        for p in tracks.points.iter().filter(|p| p.camera == camera && p.target != Target::Ball && !contact.contains(&(p.frame as f64))) {
            pictures.entry(p.frame).or_default()[p.target.index()] = p.point.map(|point| point.uv);
        }
        shake(&pictures).unwrap_or(0.0)
    })
}

fn shake(pictures: &BTreeMap<u64, Bands>) -> Option<f64> {
    let third = |frame: u64| -> Option<Bands> {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| pictures.get(&(frame + k)));
        let (a, b, c, d) = (a?, b?, c?, d?);
        Some([0, 1, 2, 3, 4].map(|k| Some(d[k]? - a[k]? + (b[k]? - c[k]?) * 3.0)))
    };
    let (mut common, mut own) = (Vec::new(), 0.0);
    for frame in pictures.keys() {
        let (Some(now), Some(next)) = (third(*frame), third(frame + 1)) else { continue };
        let bands: Vec<(Vector2<f64>, Vector2<f64>)> = now.into_iter().zip(next).filter_map(|(a, b)| a.zip(b)).collect();
        if bands.len() < FEWEST_BANDS {
            continue;
        }
        let n = bands.len() as f64;
        let (sum_a, sum_b) = bands.iter().fold((Vector2::zeros(), Vector2::zeros()), |(a, b), (x, y)| (a + x, b + y));
        let (mean_a, mean_b) = (sum_a / n, sum_b / n);
        common.push(-mean_a.dot(&mean_b));
        own -= bands.iter().map(|(a, b)| (a - mean_a).dot(&(b - mean_b))).sum::<f64>() / (n * (n - 1.0));
    }
    if common.len() < FEWEST_PAIRS {
        return None;
    }
    let own = (own / (30.0 * common.len() as f64)).max(0.0);
    let all = upper_median(common)? / MEDIAN;
    let shake = (all - own).max(0.0).sqrt();
    (all > TIMES * own && shake > LEAST_PX).then_some(shake)
}

/// What to say of it; `None` where no camera shakes.
pub fn shake_words(shake_px: [f64; 2]) -> Option<String> {
    let shaking: Vec<String> = CameraId::BOTH
        .into_iter()
        .zip(shake_px)
        .filter(|(_, px)| *px > 0.0)
        .map(|(camera, px)| format!("the {} camera by {px:.2} px", camera.name()))
        .collect();
    (!shaking.is_empty())
        .then(|| format!("the pictures shake from one to the next: {}; deviations in space and of velocities contain that", shaking.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::track_file::{ImagePoint, PointState, TrackPoint};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    /// Bands on a swing that changes its acceleration, each with its own error, in cameras that shake; `lost` frames are missing in the numbers.
    fn swing(seed: u64, band_px: f64, shake_px: [f64; 2], lost: f64) -> Tracks {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = |sd: f64| if sd > 0.0 { Normal::new(0.0, sd).expect("a deviation").sample(&mut rng) } else { 0.0 };
        let mut points = Vec::new();
        for frame in 0..40u64 {
            for camera in CameraId::BOTH {
                let shake = Vector2::new(noise(shake_px[camera.index()]), noise(shake_px[camera.index()]));
                for (k, target) in Target::MARKERS.into_iter().enumerate() {
                    let t = frame as f64 + if frame > 20 { lost } else { 0.0 };
                    let lever = 20.0 + 10.0 * k as f64;
                    let angle = 0.02 * t + 0.3 * (t / 25.0).powi(3);
                    let uv = Vector2::new(3.0 * t + lever * angle.cos(), lever * angle.sin()) + shake + Vector2::new(noise(band_px), noise(band_px));
                    let point = Some(ImagePoint { uv, sd: Vector2::repeat(band_px.max(0.01)) });
                    points.push(TrackPoint { frame, camera, target, point, state: PointState::Measured });
                }
            }
        }
        Tracks { points }
    }

    #[test]
    fn truth_a_camera_that_shakes_is_told_from_bands_that_err_and_from_a_swing() {
        let none = 1e9..=1e9;
        for (band_px, lost) in [(0.0, 0.0), (0.03, 0.0), (0.15, 0.0), (0.03, 1.0)] {
            let told: Vec<[f64; 2]> = (0..20).map(|seed| camera_shake(&swing(seed, band_px, [0.0, 0.0], lost), &none)).collect();
            assert!(told.iter().all(|s| *s == [0.0, 0.0]), "{band_px} px, {lost} lost: {told:?}");
        }
        let told: Vec<[f64; 2]> = (0..20).map(|seed| camera_shake(&swing(seed, 0.04, [0.3, 0.0], 0.0), &none)).collect();
        assert!(told.iter().all(|s| (0.15..0.5).contains(&s[0]) && s[1] == 0.0), "{told:?}");
        let mean = (told.iter().map(|s| s[0] * s[0]).sum::<f64>() / 20.0).sqrt();
        assert!((mean / 0.3 - 1.0).abs() < 0.15, "{mean}");
    }

    #[test]
    fn bound_a_blow_in_the_contact_is_no_shake() {
        let mut tracks = swing(1, 0.03, [0.0, 0.0], 0.0);
        for p in tracks.points.iter_mut().filter(|p| (18..=26).contains(&p.frame)) {
            let aside = if p.frame % 2 == 0 { 2.0 } else { -2.0 };
            p.point = p.point.map(|point| ImagePoint { uv: point.uv.add_scalar(aside), ..point });
        }
        assert_eq!(camera_shake(&tracks, &(17.0..=26.0)), [0.0, 0.0]);
    }
}
