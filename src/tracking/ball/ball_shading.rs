//! How the ball brightens from its limb inward, measured on the ball itself.
//!
//! The ball turns, so over some frames its lines and panels average out in the mean picture of the disc and what stays is
//! the light: a level everywhere (sky, floor) and a direction (sun, lamp). [`LimbProfile`] turns that into what a camera
//! records across the outline in each direction, blur included.

use crate::tracking::tape::band::erf;
use nalgebra::{Matrix4, Vector3, Vector4};

/// Sectors around the outline: 15 degrees, about two pixels of arc on a ball of 16 px.
pub const SECTORS: usize = 24;
/// Places of a mean picture up to so many radii from its centre tell the light.
pub const INSIDE_LIMB: f64 = 0.9;
/// Range of the profile around the outline, px, and its spacing.
const FROM_PX: f64 = -2.6;
const TO_PX: f64 = 3.6;
const SPACING_PX: f64 = 0.05;
/// Steps in that range.
const PLACES: usize = ((TO_PX - FROM_PX) / SPACING_PX + 0.5) as usize;

/// Grey level of a surface: `ambient + max(0, n · light)`, in camera axes (x right, y down, z away); the scale is free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallShading {
    pub ambient: f64,
    /// Unit vector toward the light.
    pub light: Vector3<f64>,
}

impl Default for BallShading {
    /// Light from above and from the camera's side.
    fn default() -> Self {
        BallShading { ambient: 0.35, light: Vector3::new(0.0, -0.6, -0.8) }
    }
}

impl BallShading {
    fn at(&self, n: &Vector3<f64>) -> f64 {
        self.ambient + n.dot(&self.light).max(0.0)
    }

    /// Fits the light to a mean picture of the disc: (x, y, grey), places in ball radii from the centre. `None` when too
    /// few places are given or the mean picture is not lit like a ball.
    pub fn of_mean_disc(disc: &[(f64, f64, f64)]) -> Option<Self> {
        let places: Vec<(Vector3<f64>, f64)> =
            disc.iter().filter(|(x, y, _)| x.hypot(*y) < INSIDE_LIMB).map(|(x, y, g)| (Vector3::new(*x, *y, -(1.0 - x * x - y * y).sqrt()), *g)).collect();
        if places.len() < 20 {
            return None;
        }
        // The light's vector (with its strength) and the level, by Gauss-Newton over the lit part; several starts, because
        // which part is lit depends on the answer.
        let mut best: Option<(f64, Vector4<f64>)> = None;
        for start in [Vector3::new(0.0, -0.3, -0.95), Vector3::new(0.0, -0.95, -0.3), Vector3::new(0.7, -0.6, -0.4), Vector3::new(-0.7, -0.6, -0.4)] {
            let mut p = Vector4::new(start.x, start.y, start.z, 0.3) * 100.0;
            for _ in 0..20 {
                let (mut h, mut g) = (Matrix4::identity() * 1e-6, Vector4::zeros());
                for (n, grey) in &places {
                    let lit = n.dot(&p.xyz()) > 0.0;
                    let row = if lit { Vector4::new(n.x, n.y, n.z, 1.0) } else { Vector4::new(0.0, 0.0, 0.0, 1.0) };
                    h += row * row.transpose();
                    g += row * *grey;
                }
                let Some(next) = h.cholesky().map(|c| c.solve(&g)) else { break };
                let done = (next - p).norm() < 1e-6 * p.norm();
                p = next;
                if done {
                    break;
                }
            }
            let miss: f64 = places.iter().map(|(n, grey)| (grey - p.w - n.dot(&p.xyz()).max(0.0)).powi(2)).sum();
            if best.is_none_or(|b| miss < b.0) {
                best = Some((miss, p));
            }
        }
        let (_, p) = best?;
        let strength = p.xyz().norm();
        let ambient = p.w / strength;
        // A light from behind, or none, is not what a mean ball looks like: lines have not averaged out.
        (strength > 5.0 && (0.0..10.0).contains(&ambient)).then(|| BallShading { ambient: ambient.max(0.02), light: p.xyz() / strength })
    }
}

/// What a camera records across the outline: share of the surroundings, and of the ball, by distance from the outline.
#[derive(Debug, Clone)]
pub struct LimbProfile {
    /// By sector and place, at the lower end of each step, with the slope over the step; [`PLACES`] of each sector.
    places: Vec<Limb>,
}

/// The profile at one place and its slope outward, 1/px.
#[derive(Debug, Clone, Copy)]
pub struct Limb {
    pub disc: f32,
    pub disc_slope: f32,
    pub ball: f32,
    pub ball_slope: f32,
}

impl LimbProfile {
    pub fn new(shading: &BallShading, radius_px: f64, blur_px: f64) -> Self {
        let n = PLACES + 1;
        let k = 1.0 / (blur_px * std::f64::consts::SQRT_2);
        // Sharp profile on cells from well inside to the outline; each cell's blurred share is a difference of two erf.
        let inside = ((4.0 * blur_px - FROM_PX) / SPACING_PX).ceil() as usize;
        let mut cells: Vec<[f64; SECTORS]> = Vec::with_capacity(inside);
        for c in 0..inside {
            let x = -(c as f64 + 0.5) * SPACING_PX;
            let q = ((radius_px + x) / radius_px).clamp(0.0, 1.0);
            let depth = (1.0 - q * q).sqrt();
            cells.push(std::array::from_fn(|s| {
                let a = std::f64::consts::TAU * (s as f64 + 0.5) / SECTORS as f64;
                shading.at(&Vector3::new(q * a.cos(), q * a.sin(), -depth))
            }));
        }
        let mut disc = Vec::with_capacity(n);
        let mut ball = Vec::with_capacity(n);
        // Everything deeper than the last cell counts with the last cell's level.
        let step: Vec<f64> = (0..=n + inside + 1).map(|i| 0.5 * (1.0 - erf((FROM_PX + i as f64 * SPACING_PX) * k))).collect();
        for i in 0..n {
            disc.push(step[i]);
            let mut sum = [0.0; SECTORS];
            for (c, cell) in cells.iter().enumerate() {
                // Cell from -(c+1) to -c spacings: its share at x is step(x + c) - step(x + c + 1).
                let far = if c + 1 == inside { 0.0 } else { step[i + c + 1] };
                let share = step[i + c] - far;
                for (s, v) in sum.iter_mut().zip(cell) {
                    *s += share * v;
                }
            }
            ball.push(sum);
        }
        let slope = |a: f64, b: f64| ((b - a) / SPACING_PX) as f32;
        let limb = |k: usize, i: usize| Limb {
            disc: disc[i] as f32,
            disc_slope: slope(disc[i], disc[i + 1]),
            ball: ball[i][k] as f32,
            ball_slope: slope(ball[i][k], ball[i + 1][k]),
        };
        LimbProfile { places: (0..SECTORS).flat_map(|k| (0..PLACES).map(move |i| (k, i))).map(|(k, i)| limb(k, i)).collect() }
    }

    /// One sector's profile, step by step ([`Self::step`]).
    #[inline]
    pub fn sector(&self, sector: usize) -> &[Limb; PLACES] {
        self.places.as_chunks::<PLACES>().0.get(sector).unwrap_or(&[Limb::NONE; PLACES])
    }

    /// The step of a place, px outside the outline (negative inside), and how far beyond the step's lower end it lies. Places beyond
    /// the profile's range are taken for its ends.
    #[inline(always)]
    pub fn step(from_outline: f32) -> (u32, f32) {
        // Added to a small number, it leaves the nearest integer in the lowest bits: a cast would take the places one by one.
        const ROUND: f32 = 8_388_608.0;
        let f = ((from_outline - FROM_PX as f32) * (1.0 / SPACING_PX) as f32).max(0.5).min(PLACES as f32 - 0.5);
        let step = f - 0.5 + ROUND;
        (step.to_bits() & 0x7f_ffff, (f - (step - ROUND)) * SPACING_PX as f32)
    }

    /// At `x` px outside the outline (negative inside), in a sector; `None` beyond the profile's range.
    pub fn at(&self, x: f64, sector: usize) -> Option<Limb> {
        let f = (x - FROM_PX) / SPACING_PX;
        if sector >= SECTORS || !(0.0..PLACES as f64).contains(&f) {
            return None;
        }
        let (step, beyond) = Self::step(x as f32);
        let limb = self.sector(sector).get(step as usize)?;
        Some(Limb { disc: limb.disc + beyond * limb.disc_slope, ball: limb.ball + beyond * limb.ball_slope, ..*limb })
    }
}

impl Limb {
    pub const NONE: Limb = Limb { disc: 0.0, disc_slope: 0.0, ball: 0.0, ball_slope: 0.0 };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_light_is_found_again_on_its_own_mean_disc() {
        let truth = BallShading { ambient: 0.4, light: Vector3::new(0.6, -0.7, -0.3877).normalize() };
        let mut disc = Vec::new();
        for i in -8..=8 {
            for j in -8..=8 {
                let (x, y) = (i as f64 / 8.5, j as f64 / 8.5);
                if x.hypot(y) < 1.0 {
                    disc.push((x, y, 130.0 * truth.at(&Vector3::new(x, y, -(1.0 - x * x - y * y).sqrt()))));
                }
            }
        }
        let found = BallShading::of_mean_disc(&disc).expect("found");
        assert!((found.ambient - 0.4).abs() < 0.02 && found.light.dot(&truth.light) > 0.999, "{found:?}");
    }

    #[test]
    fn truth_profile_of_an_evenly_lit_ball_is_a_blurred_step() {
        let flat = BallShading { ambient: 1.0, light: Vector3::new(0.0, 0.0, 1.0) };
        let p = LimbProfile::new(&flat, 8.0, 0.6);
        for x in [-2.0, -0.5, 0.0, 0.4, 1.5] {
            let limb = p.at(x, 3).expect("in range");
            let step = 0.5 * (1.0 - erf(x / (0.6 * std::f64::consts::SQRT_2)));
            assert!((f64::from(limb.disc) - step).abs() < 1e-3 && (f64::from(limb.ball) - step).abs() < 1e-3, "{x}: {limb:?}");
        }
        assert!(p.at(-3.0, 0).is_none() && p.at(4.0, 0).is_none());
    }
}
