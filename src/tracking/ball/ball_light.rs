//! Light on the ball: from all around (from the sky more than from the ground), and from one direction, fading toward the limb as felt
//! does. One light in global axes serves both cameras and both stretches of flight.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use rayon::prelude::*;

/// How much darker or brighter than by Lambert's law the limb may be: beyond this it is no felt.
const LIMB: (f64, f64) = (-0.5, 0.8);
/// Unknowns: all around, toward the light (3), limb, sky.
const UNKNOWNS: usize = 6;
/// The first of them explain a few pixels; the sky wants many.
const FEW: usize = 5;
/// What the sky adds, as a share of the light from all around, before pictures tell: 0, with this deviation.
const SKY: f64 = 0.5;
/// Steps end when the cost changes by less than this share of it.
const SETTLED: f64 = 1e-5;
/// Light tried first, in one camera's axes: from the camera, from above, from either side, from behind either side.
const STARTS: [[f64; 3]; 6] = [[0.0, -0.3, -0.95], [0.0, -0.95, -0.3], [0.7, -0.6, -0.4], [-0.7, -0.6, -0.4], [0.7, -0.6, 0.4], [-0.7, -0.6, 0.4]];

/// Brightness in a direction `n` (outward normal) seen along `z`:
/// (ambient + sky n·up + max(0, n·light)) (1 − limb (1 + n·z)), up the second global axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallLight {
    pub ambient: f64,
    /// Toward the light, global axes, with its strength, grey levels.
    pub light: Vector3<f64>,
    /// Share of the brightness that is missing at the limb.
    pub limb: f64,
    /// How much brighter than `ambient` it is from straight above, and darker from below, grey levels (negative where the second axis
    /// points down). Without it a ball under the open sky seems to sit a thirtieth of a pixel lower in every picture than it does.
    pub sky: f64,
}

/// A [`BallLight`] in one camera's axes.
#[derive(Debug, Clone, Copy)]
pub struct SeenLight {
    ambient: f32,
    toward: [f32; 3],
    sky: [f32; 3],
    limb: f32,
}

impl SeenLight {
    /// Brightness at a normal, z away from the camera.
    #[inline(always)]
    pub fn at(&self, n: [f32; 3]) -> f32 {
        let [direct, sky] = [self.toward, self.sky].map(|l| n[0] * l[0] + n[1] * l[1] + n[2] * l[2]);
        (self.ambient + sky + direct.max(0.0)).max(0.0) * (1.0 - self.limb * (1.0 + n[2]))
    }
}

/// A clear pixel of the ball: normal, one less its share along the line of sight (0 at the disc's middle, 1 at the limb), grey level, what
/// gain and cover make of the light, weight.
#[derive(Clone, Copy)]
pub struct LitPixel {
    pub normal: Vector3<f64>,
    pub toward_limb: f64,
    pub grey: f64,
    pub relief: f64,
    pub weight: f64,
}

/// Normal equations of one step toward a better light.
#[derive(Debug, Clone, Copy)]
pub struct LightSums {
    /// The upper triangle, row by row.
    h: [f64; UNKNOWNS * (UNKNOWNS + 1) / 2],
    g: [f64; UNKNOWNS],
    cost: f64,
    count: f64,
}

impl Default for LightSums {
    fn default() -> Self {
        LightSums { h: [0.0; UNKNOWNS * (UNKNOWNS + 1) / 2], g: [0.0; UNKNOWNS], cost: 0.0, count: 0.0 }
    }
}

impl LightSums {
    /// `toward` and `up` are the light and the second global axis in the axes of the pixel's normal; the sums are in these axes.
    #[inline]
    pub fn add(&mut self, light: &BallLight, [toward, up]: &[Vector3<f64>; 2], p: &LitPixel) {
        let (direct, above, u) = (p.normal.dot(toward), p.normal.dot(up), p.toward_limb);
        let fall = (1.0 - light.limb * u) * p.relief;
        let base = light.ambient + light.sky * above + direct.max(0.0);
        let lit = if direct > 0.0 { fall } else { 0.0 };
        let row = [fall, p.normal.x * lit, p.normal.y * lit, p.normal.z * lit, -base * u * p.relief, above * fall];
        let residual = p.grey - base * fall;
        let mut at = 0;
        for i in 0..UNKNOWNS {
            let weighted = row[i] * p.weight;
            for x in &row[i..] {
                self.h[at] += weighted * x;
                at += 1;
            }
            self.g[i] += weighted * residual;
        }
        self.cost += residual * residual * p.weight;
        self.count += 1.0;
    }

    /// Adds sums over one camera's pictures; its axes stand in the rows of `axes`.
    pub fn merge(&mut self, other: &LightSums, axes: &Matrix3<f64>) {
        let mut turn = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::identity();
        turn.fixed_view_mut::<3, 3>(1, 1).copy_from(axes);
        let h = turn.tr_mul(&other.matrix()) * turn;
        let mut at = 0;
        for i in 0..UNKNOWNS {
            for j in i..UNKNOWNS {
                self.h[at] += h[(i, j)];
                at += 1;
            }
        }
        let g = turn.tr_mul(&SVector::from(other.g));
        self.g.iter_mut().zip(g.iter()).for_each(|(a, b)| *a += b);
        self.cost += other.cost;
        self.count += other.count;
    }

    fn matrix(&self) -> SMatrix<f64, UNKNOWNS, UNKNOWNS> {
        let mut h = SMatrix::zeros();
        let mut upper = self.h.iter();
        for i in 0..UNKNOWNS {
            for (j, x) in (i..UNKNOWNS).zip(&mut upper) {
                (h[(i, j)], h[(j, i)]) = (*x, *x);
            }
        }
        h
    }

    /// The light after one step of Gauss and Newton.
    pub fn step(&self, light: &BallLight) -> Option<BallLight> {
        self.step_of(light, UNKNOWNS)
    }

    /// The same for the first unknowns only.
    fn step_of(&self, light: &BallLight, free: usize) -> Option<BallLight> {
        if self.count < 60.0 {
            return None;
        }
        let (mut h, mut g) = (self.matrix(), SVector::from(self.g));
        let prior = (self.cost / self.count + 1.0) / (SKY * light.ambient.abs().max(1.0)).powi(2);
        h[(5, 5)] += prior;
        g[5] -= prior * light.sky;
        for k in 0..UNKNOWNS {
            h[(k, k)] += if k < free { 1e-6 * (1.0 + h[(k, k)]) } else { 1e12 * (1.0 + h[(k, k)]) };
        }
        let s = h.cholesky()?.solve(&g);
        let next = BallLight {
            ambient: light.ambient + s[0],
            light: light.light + Vector3::new(s[1], s[2], s[3]),
            limb: (light.limb + s[4]).clamp(LIMB.0, LIMB.1),
            sky: light.sky + s[5],
        };
        (next.ambient.is_finite() && next.light.norm().is_finite() && next.limb.is_finite() && next.sky.is_finite()).then_some(next)
    }
}

impl BallLight {
    /// The light as a camera sees it whose axes stand in the rows of `axes`.
    pub fn seen(&self, axes: &Matrix3<f64>) -> SeenLight {
        let [toward, sky] = self.directions(axes);
        let sky = sky * self.sky;
        let [toward, sky] = [toward, sky].map(|v| v.map(|x| x as f32).into());
        SeenLight { ambient: self.ambient as f32, toward, sky, limb: self.limb as f32 }
    }

    /// The light's vector and straight up in a camera's axes.
    pub fn directions(&self, axes: &Matrix3<f64>) -> [Vector3<f64>; 2] {
        [axes * self.light, axes * Vector3::y()]
    }

    /// What a usual place of the lit side shows, grey levels.
    pub fn usual(&self) -> f64 {
        (self.ambient + 0.5 * self.light.norm()).max(1.0)
    }

    pub fn scaled(&self, by: f64) -> BallLight {
        BallLight { ambient: self.ambient * by, light: self.light * by, sky: self.sky * by, ..*self }
    }

    /// The light that explains clear pixels of a ball without a cover best (normals in global axes); `axes` are one camera's (rows, in
    /// global axes). Which pixels are lit depends on the answer, so there are several starts.
    pub fn of(pixels: &[LitPixel], axes: &Matrix3<f64>) -> Option<BallLight> {
        let from = |start: &[f64; 3]| {
            let mut light = BallLight { ambient: 40.0, light: axes.tr_mul(&Vector3::from(*start)) * 100.0, limb: 0.0, sky: 0.0 };
            let mut cost = f64::INFINITY;
            for _ in 0..10 {
                let (mut sums, before) = (LightSums::default(), cost);
                let directions = light.directions(&Matrix3::identity());
                pixels.iter().for_each(|p| sums.add(&light, &directions, p));
                cost = sums.cost;
                if (before - cost).abs() < SETTLED * cost {
                    break;
                }
                let Some(next) = sums.step_of(&light, FEW) else { break };
                light = next;
            }
            (cost, light)
        };
        let found: Vec<(f64, BallLight)> = STARTS.par_iter().map(from).collect();
        found.into_iter().filter(|f| f.0.is_finite()).min_by(|a, b| a.0.total_cmp(&b.0)).map(|f| f.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Clear pixels of a bare ball, and the axes of the camera that sees it.
    fn seen(truth: &BallLight) -> (Vec<LitPixel>, Matrix3<f64>) {
        let axes = Matrix3::new(0.8, 0.0, 0.6, 0.0, -1.0, 0.0, 0.6, 0.0, -0.8);
        let pixels = (0..900)
            .filter_map(|i| {
                let (x, y) = ((i % 30) as f64 / 15.0 - 0.97, (i / 30) as f64 / 15.0 - 0.97);
                let q = x * x + y * y;
                (q < 0.85).then(|| Vector3::new(x, y, -(1.0 - q).sqrt()))
            })
            .map(|n| {
                let grey = f64::from(truth.seen(&axes).at(n.map(|x| x as f32).into()));
                LitPixel { normal: axes.tr_mul(&n), toward_limb: 1.0 + n.z, grey, relief: 1.0, weight: 1.0 }
            })
            .collect();
        (pixels, axes)
    }

    #[test]
    fn truth_direct_light_ambient_and_limb_are_found() {
        let truth = BallLight { ambient: 60.0, light: Vector3::new(50.0, 90.0, -30.0), limb: 0.2, sky: 0.0 };
        let (pixels, axes) = seen(&truth);
        let found = BallLight::of(&pixels, &axes).expect("a light");
        assert!((found.light - truth.light).norm() < 1.0 && (found.ambient - 60.0).abs() < 0.5 && (found.limb - 0.2).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn truth_a_sky_brighter_than_the_ground_is_told_from_the_sun() {
        let truth = BallLight { ambient: 80.0, light: Vector3::new(40.0, 90.0, -10.0), limb: 0.15, sky: 24.0 };
        let (pixels, axes) = seen(&truth);
        let mut found = BallLight::of(&pixels, &axes).expect("a light");
        for _ in 0..12 {
            let mut sums = LightSums::default();
            pixels.iter().for_each(|p| sums.add(&found, &found.directions(&Matrix3::identity()), p));
            found = sums.step(&found).expect("a step");
        }
        assert!((found.sky - 24.0).abs() < 1.0 && (found.light - truth.light).norm() < 2.0 && (found.limb - 0.15).abs() < 0.01, "{found:?}");
    }
}
