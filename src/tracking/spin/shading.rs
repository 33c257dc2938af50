//! Light on the ball: a smooth pattern that stays with the camera while the markings turn under it.

use super::view::{Sample, ViewInfo};
use nalgebra::{DMatrix, DVector, Vector3};

/// Harmonics up to order 3 of the normal, the constant left out (a view's gain takes it). A matt ball under any lights
/// is held by order 2 to about 1 % (Basri and Jacobs 2003; Ramamoorthi and Hanrahan 2001); order 3 takes glints.
pub(super) const TERMS: usize = 15;

pub(super) fn terms(n: &Vector3<f64>) -> [f64; TERMS] {
    let (x, y, z) = (n.x, n.y, n.z);
    let zz = z - 0.7; // the used part of the disc has z near 0.5 to 1: keeps the terms apart
    [
        x,
        y,
        zz,
        x * y,
        x * zz,
        y * zz,
        x * x - y * y,
        zz * zz,
        x * (x * x - 3.0 * y * y),
        y * (3.0 * x * x - y * y),
        x * y * zz,
        zz * (x * x - y * y),
        x * zz * zz,
        y * zz * zz,
        zz * zz * zz,
    ]
}

/// One pixel with gain and smooth shading divided out: `contrast` is −0.4 on a line that reflects 60 % of the felt's light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mark {
    pub view: usize,
    pub normal: Vector3<f64>,
    pub disc: Vector3<f64>,
    pub contrast: f64,
    /// Relative information: (gain × shading)², mean 1 over all pixels.
    pub weight: f64,
}

/// Contrasts beyond these are no pen marks but things in front of the ball; they are clipped so that they pull less.
const DARKEST: f64 = -0.8;
const BRIGHTEST: f64 = 0.5;

/// Fitted shading per camera: relative brightness over the disc.
#[derive(Debug, Clone)]
pub(super) struct Shading {
    /// Constant, then the harmonics; empty when too few pixels.
    coefficients: [Vec<f64>; 2],
}

impl Shading {
    /// Brightness relative to the view's gain at a place on the disc.
    pub fn at(&self, camera: crate::calibration::CameraId, disc: &Vector3<f64>) -> f64 {
        match self.coefficients[camera.index()].split_first() {
            Some((constant, rest)) => (constant + terms(disc).iter().zip(rest).map(|(t, c)| t * c).sum::<f64>()).max(0.05),
            None => 1.0,
        }
    }
}

/// Divides out one gain per view and one shading pattern per camera; robust against marks and things in front.
///
/// `markings`: contrast of the markings at every pixel as a first registration found it, or nothing yet.
pub(super) fn divide_out(views: &[ViewInfo], samples: &[Sample], markings: Option<&[f32]>) -> (Shading, Vec<Mark>) {
    let mut per_view: Vec<Vec<usize>> = vec![Vec::new(); views.len()];
    for (i, s) in samples.iter().enumerate() {
        per_view[s.view].push(i);
    }
    // Grey of the felt as it would be without markings.
    let felt: Vec<f64> = match markings {
        Some(m) => samples.iter().zip(m).map(|(s, m)| s.grey / (1.0 + f64::from(*m)).max(0.2)).collect(),
        None => samples.iter().map(|s| s.grey).collect(),
    };
    // Gain: the median over the disc.
    let gains: Vec<f64> = per_view.iter().map(|own| median(own.iter().map(|&i| felt[i]).collect()).max(1.0)).collect();
    let mut shading = Shading { coefficients: [Vec::new(), Vec::new()] };
    for camera in crate::calibration::CameraId::BOTH {
        let own: Vec<usize> = (0..samples.len()).filter(|&i| views[samples[i].view].camera == camera).collect();
        if own.len() < 10 * (TERMS + 1) {
            continue;
        }
        let row = |i: usize| {
            let t = terms(&samples[i].disc);
            DVector::from_fn(TERMS + 1, |k, _| if k == 0 { 1.0 } else { t[k - 1] })
        };
        let mut weight = vec![1.0; own.len()];
        for _ in 0..4 {
            let mut normal = DMatrix::<f64>::identity(TERMS + 1, TERMS + 1) * 1e-6;
            let mut right = DVector::<f64>::zeros(TERMS + 1);
            for (&i, &w) in own.iter().zip(&weight) {
                let r = row(i);
                normal.ger(w, &r, &r, 1.0);
                right.axpy(w * felt[i] / gains[samples[i].view], &r, 1.0);
            }
            let Some(solution) = normal.cholesky().map(|c| c.solve(&right)) else { break };
            let misses: Vec<f64> = own.iter().map(|&i| felt[i] / gains[samples[i].view] - row(i).dot(&solution)).collect();
            let scale = 1.5 * median(misses.iter().map(|m| m.abs()).collect()).max(1e-3);
            for (k, miss) in misses.iter().enumerate() {
                weight[k] = 1.0 / (1.0 + (miss / (2.0 * scale)).powi(2)).powi(2);
            }
            shading.coefficients[camera.index()] = solution.iter().copied().collect();
        }
    }
    let mut marks: Vec<Mark> = samples
        .iter()
        .map(|s| {
            let bright = gains[s.view] * shading.at(views[s.view].camera, &s.disc);
            Mark { view: s.view, normal: s.normal, disc: s.disc, contrast: (s.grey / bright - 1.0).clamp(DARKEST, BRIGHTEST), weight: bright * bright }
        })
        .collect();
    let mean = marks.iter().map(|m| m.weight).sum::<f64>() / marks.len().max(1) as f64;
    for m in &mut marks {
        m.weight /= mean.max(1e-12);
    }
    (shading, marks)
}

/// Median; 0 of nothing.
pub(super) fn median(mut x: Vec<f64>) -> f64 {
    if x.is_empty() {
        return 0.0;
    }
    let mid = x.len() / 2;
    *x.select_nth_unstable_by(mid, f64::total_cmp).1
}
