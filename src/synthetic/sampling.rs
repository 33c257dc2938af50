//! Sixteen samples a pixel: places that imitate a lens' blur, times that fill the exposure, neither correlated with the
//! other, so that a moving edge is blurred without being shifted.

use nalgebra::{Point3, Vector2, Vector3};

pub const SAMPLES: usize = 16;
/// Instants of the exposure that are drawn.
pub const INSTANTS: usize = 8;

/// One sample of a pixel: offset from its centre, px, and which instant of the exposure.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    pub offset_px: Vector2<f64>,
    pub instant: usize,
}

/// The pattern for a lens whose blur has a triangular profile of half width `reach_px` in each direction.
pub fn pattern(reach_px: f64) -> [Sample; SAMPLES] {
    // Magnitudes are a Latin arrangement of eight strata; each instant has two opposite places, so that no place goes
    // with early or late.
    const ACROSS: [usize; INSTANTS] = [0, 3, 6, 1, 4, 7, 2, 5];
    const SIGN: [f64; INSTANTS] = [1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0];
    const INSTANT: [usize; INSTANTS] = [3, 6, 0, 5, 2, 7, 4, 1];
    let tent = |stratum: usize| reach_px * (1.0 - (1.0 - (stratum as f64 + 0.5) / INSTANTS as f64).sqrt());
    std::array::from_fn(|i| {
        let k = i / 2;
        let flip = if i % 2 == 0 { 1.0 } else { -1.0 };
        Sample { offset_px: Vector2::new(tent(k), SIGN[k] * tent(ACROSS[k])) * flip, instant: INSTANT[k] }
    })
}

/// Times of the instants relative to the middle of the exposure, s.
pub fn instants(exposure_s: f64) -> [f64; INSTANTS] {
    std::array::from_fn(|i| exposure_s * ((i as f64 + 0.5) / INSTANTS as f64 - 0.5))
}

/// Nearest hit of a sphere (camera or any axes): depth and outward normal.
pub fn hit_sphere(centre: &Point3<f64>, radius: f64, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
    let w = origin - centre;
    let (aa, half_b) = (direction.norm_squared(), direction.dot(&w));
    let disc = half_b * half_b - aa * (w.norm_squared() - radius * radius);
    if disc <= 0.0 {
        return None;
    }
    let depth = (-half_b - disc.sqrt()) / aa;
    (depth > 0.0).then(|| (depth, (w + direction * depth) / radius))
}

/// Nearest hit of a capsule (a cylinder with round ends): depth and outward normal.
pub fn hit_capsule(from: &Point3<f64>, to: &Point3<f64>, radius: f64, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
    let span = to - from;
    let length = span.norm();
    let axis = span / length.max(1e-9);
    let w = origin - from;
    let d = direction - axis * direction.dot(&axis);
    let e = w - axis * w.dot(&axis);
    let (aa, half_b) = (d.norm_squared(), d.dot(&e));
    let disc = half_b * half_b - aa * (e.norm_squared() - radius * radius);
    if disc > 0.0 && aa > 1e-12 {
        let depth = (-half_b - disc.sqrt()) / aa;
        if (0.0..=length).contains(&(w + direction * depth).dot(&axis)) && depth > 0.0 {
            return Some((depth, (e + d * depth) / radius));
        }
    }
    let ends = [hit_sphere(from, radius, origin, direction), hit_sphere(to, radius, origin, direction)];
    ends.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_the_pattern_is_centred_and_place_does_not_go_with_time() {
        let times = instants(1.0);
        let p = pattern(1.0);
        let mean: Vector2<f64> = p.iter().map(|s| s.offset_px).sum();
        let drift: Vector2<f64> = p.iter().map(|s| s.offset_px * times[s.instant]).sum();
        assert!(mean.norm() < 1e-12 && drift.norm() < 1e-12);
        let spread = p.iter().map(|s| s.offset_px.x.powi(2)).sum::<f64>() / SAMPLES as f64;
        assert!((spread - 1.0 / 6.0).abs() < 0.01, "variance of a triangle of half width 1: {spread}");
        let twist: f64 = p.iter().map(|s| s.offset_px.x * s.offset_px.y).sum();
        assert!(twist.abs() < 0.2, "{twist}");
    }
}
