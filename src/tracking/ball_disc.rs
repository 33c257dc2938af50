//! The ball's disc at a finer spacing than the pixels, and the lens that blurs it into a picture.
//!
//! Light and cover change within a pixel (a drawn line is one pixel wide), so the disc is drawn unblurred, about three places per
//! pixel either way, and blurred by two passes of a normal curve that stands for lens and pixel together. Moving the centre by
//! part of a pixel needs the second step only, and the derivatives come with it.

use nalgebra::{Vector2, Vector3};

/// Places of the disc that one pixel sees along a row: plus and minus four deviations of the blur.
const TAPS: usize = 16;
/// Spacing of small and large discs, px.
const SPACING_PX: (f64, f64) = (1.0 / 3.0, 0.5);
/// A ball beyond this radius is large, px.
const LARGE_PX: f64 = 12.0;

/// Places of one disc and how much of each lies on the ball.
pub struct BallDisc {
    spacing: f64,
    /// Rows and columns of the ball's square.
    places: usize,
    /// Length of a row with empty places on both sides.
    stride: usize,
    /// Share of each place on the ball.
    pub cover: Vec<f32>,
    /// Index and normal (camera axes) of the places on the ball.
    pub normals: Vec<(u32, Vector3<f64>)>,
}

/// How each pixel row or column looks at the rows or columns of the disc.
struct Look {
    /// First place, weights and their derivatives by the centre.
    pixels: Vec<(usize, [f32; TAPS], [f32; TAPS])>,
}

/// A blurred disc: values and derivatives by the centre, row by row of a window.
#[derive(Default, Clone)]
pub struct Blurred {
    pub value: Vec<f32>,
    pub by_x: Vec<f32>,
    pub by_y: Vec<f32>,
}

impl BallDisc {
    pub fn new(radius_px: f64) -> Self {
        let spacing = if radius_px < LARGE_PX { SPACING_PX.0 } else { SPACING_PX.1 };
        let half = ((radius_px + 1.0) / spacing).ceil() as usize;
        let places = 2 * half + 1;
        let stride = places + 2 * TAPS;
        let mut disc = BallDisc { spacing, places, stride, cover: vec![0.0; places * stride], normals: Vec::with_capacity(places * places) };
        for row in 0..places {
            let y = (row as f64 - half as f64) * spacing;
            for column in 0..places {
                let x = (column as f64 - half as f64) * spacing;
                let rho = x.hypot(y);
                let share = ((radius_px - rho) / spacing + 0.5).clamp(0.0, 1.0);
                if share > 0.0 {
                    let at = row * stride + TAPS + column;
                    disc.cover[at] = share as f32;
                    let q = (rho / radius_px).min(1.0);
                    let out = if rho > 1e-9 { q / rho } else { 0.0 };
                    disc.normals.push((at as u32, Vector3::new(x * out, y * out, -(1.0 - q * q).sqrt())));
                }
            }
        }
        disc
    }

    /// The disc with a brightness at each normal.
    pub fn painted(&self, brightness: impl Fn(&Vector3<f64>) -> f64) -> Vec<f32> {
        let mut out = vec![0.0; self.cover.len()];
        for (at, normal) in &self.normals {
            let at = *at as usize;
            if let (Some(o), Some(c)) = (out.get_mut(at), self.cover.get(at)) {
                *o = c * brightness(normal) as f32;
            }
        }
        out
    }

    /// Which places the pixels at `first`, `first` + 1, ... (px from the centre) look at.
    fn look(&self, first: f64, count: usize, blur_px: f64) -> Look {
        let half = (self.places / 2) as f64;
        let unit = self.spacing / ((std::f64::consts::TAU).sqrt() * blur_px);
        let pixel = |k: usize| {
            let at = (first + k as f64) / self.spacing + half;
            // The places from here on, counted from TAPS before the disc.
            let from = (at - 0.5 * (TAPS - 1) as f64).ceil() + TAPS as f64;
            let (mut weight, mut slope) = ([0.0; TAPS], [0.0; TAPS]);
            if !(0.0..=(self.places + TAPS) as f64).contains(&from) {
                return (0, weight, slope);
            }
            for i in 0..TAPS {
                let t = (at + TAPS as f64 - from - i as f64) * self.spacing / blur_px;
                let w = unit * (-0.5 * t * t).exp();
                weight[i] = w as f32;
                slope[i] = (w * t / blur_px) as f32;
            }
            (from as usize, weight, slope)
        };
        Look { pixels: (0..count).map(pixel).collect() }
    }

    /// The rows of the disc (with their weights) that a pixel row looks at.
    fn rows<'a>(&'a self, look: &'a (usize, [f32; TAPS], [f32; TAPS])) -> impl Iterator<Item = (usize, f32, f32)> + 'a {
        (0..TAPS).filter_map(move |i| {
            let row = (look.0 + i).checked_sub(TAPS)?;
            (row < self.places).then_some((row, look.1[i], look.2[i]))
        })
    }

    /// Blurs discs (from [`Self::painted`] or the cover) into a window of `side` x `side` pixels whose first pixel is the picture's
    /// (0, 0); `centre` is counted from it.
    pub fn blurred<const K: usize>(&self, discs: [&[f32]; K], centre: &Vector2<f64>, side: usize, blur_px: f64, slopes: bool) -> [Blurred; K] {
        let (columns, rows) = (self.look(-centre.x, side, blur_px), self.look(-centre.y, side, blur_px));
        discs.map(|disc| {
            let n = side * side;
            let mut out = Blurred { value: vec![0.0; n], by_x: vec![0.0; if slopes { n } else { 0 }], by_y: vec![0.0; if slopes { n } else { 0 }] };
            let (mut line, mut slope) = (vec![0.0f32; self.stride], vec![0.0f32; self.stride]);
            for (v, look) in rows.pixels.iter().enumerate() {
                line.fill(0.0);
                slope.fill(0.0);
                for (row, w, s) in self.rows(look) {
                    let Some(source) = disc.get(row * self.stride..(row + 1) * self.stride) else { continue };
                    line.iter_mut().zip(source).for_each(|(l, d)| *l += w * d);
                    if slopes {
                        slope.iter_mut().zip(source).for_each(|(l, d)| *l += s * d);
                    }
                }
                for (u, (from, weight, by_centre)) in columns.pixels.iter().enumerate() {
                    let at = v * side + u;
                    let Some(seen) = line.get(*from..from + TAPS) else { continue };
                    out.value[at] = dot(seen, weight);
                    if slopes {
                        out.by_x[at] = dot(seen, by_centre);
                        out.by_y[at] = slope.get(*from..from + TAPS).map_or(0.0, |s| dot(s, weight));
                    }
                }
            }
            out
        })
    }

    /// What the pixels of a window say of each place: the transposed blur.
    pub fn gathered<const K: usize>(&self, windows: [&[f32]; K], centre: &Vector2<f64>, side: usize, blur_px: f64) -> [Vec<f32>; K] {
        let (columns, rows) = (self.look(-centre.x, side, blur_px), self.look(-centre.y, side, blur_px));
        windows.map(|window| {
            let mut out = vec![0.0f32; self.cover.len()];
            let mut line = vec![0.0f32; self.stride];
            for (look, pixels) in rows.pixels.iter().zip(window.chunks_exact(side)) {
                line.fill(0.0);
                for ((from, weight, _), pixel) in columns.pixels.iter().zip(pixels) {
                    if let Some(seen) = line.get_mut(*from..from + TAPS) {
                        seen.iter_mut().zip(weight).for_each(|(l, w)| *l += w * pixel);
                    }
                }
                for (row, w, _) in self.rows(look) {
                    if let Some(to) = out.get_mut(row * self.stride..(row + 1) * self.stride) {
                        to.iter_mut().zip(&line).for_each(|(o, l)| *o += w * l);
                    }
                }
            }
            out
        })
    }
}

#[inline]
fn dot(a: &[f32], b: &[f32; TAPS]) -> f32 {
    let mut lanes = [0.0f32; 8];
    for (a, b) in a.as_chunks::<8>().0.iter().zip(b.as_chunks::<8>().0) {
        for l in 0..8 {
            lanes[l] += a[l] * b[l];
        }
    }
    let [a, b, c, d, e, f, g, h] = lanes;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_blurred_cover_is_half_at_the_outline_and_its_sum_is_the_discs_area() {
        let (disc, centre) = (BallDisc::new(8.3), Vector2::new(13.27, 12.61));
        let [b] = disc.blurred([&disc.cover], &centre, 27, 0.62, false);
        let area: f64 = b.value.iter().map(|v| f64::from(*v)).sum();
        assert!((area / (std::f64::consts::PI * 8.3 * 8.3) - 1.0).abs() < 2e-3, "{area}");
        for (i, v) in b.value.iter().enumerate() {
            let rho = (Vector2::new((i % 27) as f64, (i / 27) as f64) - centre).norm() - 8.3;
            // A curved edge: the share half a blur's square over the radius lower than a straight one's.
            let straight = 0.5 * (1.0 - super::super::band::erf(rho / (0.62 * std::f64::consts::SQRT_2)));
            assert!((f64::from(*v) - straight).abs() < 0.03, "{rho} {v} {straight}");
        }
    }

    #[test]
    fn law_slopes_are_differences_and_gathering_is_the_transpose_of_blurring() {
        let disc = BallDisc::new(6.1);
        let painted = disc.painted(|n| 100.0 + 50.0 * n.x - 30.0 * n.y * n.z);
        let (centre, h) = (Vector2::new(10.3, 9.8), 1e-2);
        let at = |x: f64, y: f64| disc.blurred([&painted], &Vector2::new(x, y), 21, 0.62, true)[0].clone();
        let (now, right, left, down, up) = (at(10.3, 9.8), at(10.3 + h, 9.8), at(10.3 - h, 9.8), at(10.3, 9.8 + h), at(10.3, 9.8 - h));
        for i in 0..441 {
            assert!((f64::from(right.value[i] - left.value[i]) / (2.0 * h) - f64::from(now.by_x[i])).abs() < 0.3);
            assert!((f64::from(down.value[i] - up.value[i]) / (2.0 * h) - f64::from(now.by_y[i])).abs() < 0.3);
        }
        let window: Vec<f32> = (0..441).map(|i| ((i * 37) % 11) as f32 - 4.0).collect();
        let [gathered] = disc.gathered([&window], &centre, 21, 0.62);
        let one: f64 = now.value.iter().zip(&window).map(|(a, b)| f64::from(a * b)).sum();
        let other: f64 = painted.iter().zip(&gathered).map(|(a, b)| f64::from(a * b)).sum();
        assert!((one / other - 1.0).abs() < 1e-3, "{one} {other}");
    }
}
