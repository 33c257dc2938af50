//! Bright spheres in one picture: where they may be, and their centres to a small part of a pixel.

use super::view::sample;
use crate::footage::GreyImage;
use nalgebra::{SMatrix, SVector, Vector2};

/// A bright round spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    pub centre: Vector2<f64>,
    pub radius_px: f64,
    /// Least brightness above its surroundings, over all directions, grey levels.
    pub contrast: f64,
}

/// The outline of a sphere in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereImage {
    /// Centre of the outline, px.
    pub centre: Vector2<f64>,
    /// One standard deviation per axis, px.
    pub sd: Vector2<f64>,
    pub radius_px: f64,
    /// Root-mean-square misfit of the grey values as a share of the brightness.
    pub misfit: f64,
}

/// Largest number of spots looked at in one picture; spheres are among the brightest against all sides.
const MAX_SPOTS: usize = 80;
const RADII_PX: [f64; 9] = [2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0, 32.0];
const MIN_CONTRAST: f64 = 8.0;

/// Bright spots of any size, brightest against their darkest-contrast direction first, without overlaps.
pub fn bright_spots(image: &GreyImage) -> Vec<Spot> {
    let sums = BoxSums::new(image);
    let mut spots: Vec<Spot> = Vec::new();
    for radius in RADII_PX {
        let inner = (0.6 * radius).max(1.0) as i64;
        let margin = (1.8 * radius) as i64 + 2;
        let step = (radius / 3.0).max(1.0) as i64;
        let mut y = margin;
        while y < image.height as i64 - margin {
            let mut x = margin;
            while x < image.width as i64 - margin {
                let bright = sums.mean(x, y, inner);
                let mut contrast = f64::INFINITY;
                for k in 0..12 {
                    let (s, c) = (k as f64 * std::f64::consts::TAU / 12.0).sin_cos();
                    let around = sums.mean(x + (1.7 * radius * c).round() as i64, y + (1.7 * radius * s).round() as i64, (radius / 4.0) as i64);
                    contrast = contrast.min(bright - around);
                    if contrast < MIN_CONTRAST {
                        break;
                    }
                }
                if contrast >= MIN_CONTRAST {
                    spots.push(Spot { centre: Vector2::new(x as f64, y as f64), radius_px: radius, contrast });
                }
                x += step;
            }
            y += step;
        }
    }
    spots.sort_by(|a, b| b.contrast.total_cmp(&a.contrast).then(a.centre.y.total_cmp(&b.centre.y)).then(a.centre.x.total_cmp(&b.centre.x)));
    let mut kept: Vec<Spot> = Vec::new();
    for s in spots {
        if kept.iter().all(|k| (k.centre - s.centre).norm() > k.radius_px.max(s.radius_px)) {
            kept.push(s);
            if kept.len() == MAX_SPOTS {
                break;
            }
        }
    }
    kept
}

/// Summed-area table for box means; boxes are cut at the picture's border.
struct BoxSums {
    width: usize,
    height: usize,
    table: Vec<u64>,
}

impl BoxSums {
    fn new(image: &GreyImage) -> Self {
        let (w, h) = (image.width, image.height);
        let mut table = vec![0u64; (w + 1) * (h + 1)];
        for y in 0..h {
            let mut row = 0u64;
            for x in 0..w {
                row += u64::from(image.pixels[y * w + x]);
                table[(y + 1) * (w + 1) + x + 1] = table[y * (w + 1) + x + 1] + row;
            }
        }
        BoxSums { width: w, height: h, table }
    }

    fn mean(&self, x: i64, y: i64, half: i64) -> f64 {
        let clamp = |v: i64, top: usize| v.clamp(0, top as i64) as usize;
        let (x0, x1) = (clamp(x - half, self.width - 1), clamp(x + half + 1, self.width));
        let (y0, y1) = (clamp(y - half, self.height - 1), clamp(y + half + 1, self.height));
        let at = |x: usize, y: usize| self.table[y * (self.width + 1) + x] as i64;
        let n = (x1.saturating_sub(x0) * y1.saturating_sub(y0)).max(1);
        (at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0)) as f64 / n as f64
    }
}

const UNKNOWNS: usize = 10;

/// Fits a blurred disc with linear shading on a linear background to the grey values around a spot.
///
/// Unknowns: centre (2), radius, blur, three of the disc's brightness, three of the background. Pixels that follow neither
/// (the frame's rods) lose weight (Tukey). Several starts around the spot are tried, because a rod that touches the sphere
/// makes a second, worse optimum; the one that explains most pixels wins. `radius_px` fixes the radius when it is known.
pub fn fit_sphere(image: &GreyImage, spot: &Spot, radius_px: Option<f64>) -> Option<SphereImage> {
    let mut best: Option<(f64, SphereImage)> = None;
    for radius in radius_px.map_or_else(|| vec![0.8 * spot.radius_px, spot.radius_px, 1.25 * spot.radius_px], |r| vec![r]) {
        for (dx, dy) in [(0.0, 0.0), (0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4)] {
            let start = Spot { centre: spot.centre + Vector2::new(dx, dy) * radius, radius_px: radius, contrast: spot.contrast };
            if let Some((cost, fit)) = fit_from(image, spot, &start, radius_px.is_some())
                && best.as_ref().is_none_or(|b| cost < b.0 - 1e-9)
            {
                best = Some((cost, fit));
            }
        }
    }
    best.map(|b| b.1)
}

/// One descent; returns the mean robust cost over the pixels near the spot, and the fit.
fn fit_from(image: &GreyImage, spot: &Spot, start: &Spot, fixed_radius: bool) -> Option<(f64, SphereImage)> {
    let r0 = start.radius_px;
    let reach = 1.5 * r0 + 2.5;
    let inside = sample(image, start.centre)?;
    let mut p = SVector::<f64, UNKNOWNS>::zeros();
    p[0] = start.centre.x;
    p[1] = start.centre.y;
    p[2] = r0;
    p[3] = 0.8;
    p[4] = spot.contrast.max(1.0);
    p[7] = inside - spot.contrast;
    // Misfit beyond which a pixel is something else: shading and texture stay within a tenth of the contrast.
    let loose = (0.25 * spot.contrast).max(6.0);
    let tight = (0.1 * spot.contrast).max(4.0);
    let mut answer = None;
    for iteration in 0..60 {
        let limit = if iteration < 8 { loose } else { tight };
        let centre = Vector2::new(p[0], p[1]);
        let (x0, x1) = ((centre.x - reach).ceil() as i64, (centre.x + reach).floor() as i64);
        let (y0, y1) = ((centre.y - reach).ceil() as i64, (centre.y + reach).floor() as i64);
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut gradient = SVector::<f64, UNKNOWNS>::zeros();
        let (mut squared, mut weights, mut cost, mut n) = (0.0, 0.0, 0.0, 0usize);
        for y in y0..=y1 {
            for x in x0..=x1 {
                let (dx, dy) = (x as f64 - centre.x, y as f64 - centre.y);
                let d = dx.hypot(dy);
                if d > reach || x < 0 || y < 0 {
                    continue;
                }
                let Some(grey) = image.get(x as usize, y as usize).map(f64::from) else { continue };
                let (value, derivative) = disc(&p, dx, dy, d);
                let residual = grey - value;
                let u = residual / limit;
                let w = if u.abs() < 1.0 { (1.0 - u * u).powi(2) } else { 0.0 };
                normal += derivative * derivative.transpose() * w;
                gradient += derivative * (residual * w);
                squared += w * residual * residual;
                weights += w;
                cost += if u.abs() < 1.0 { 1.0 - (1.0 - u * u).powi(3) } else { 1.0 };
                n += 1;
            }
        }
        if weights < 2.0 * UNKNOWNS as f64 {
            return None;
        }
        if fixed_radius {
            normal.row_mut(2).fill(0.0);
            normal.column_mut(2).fill(0.0);
            normal[(2, 2)] = 1.0;
            gradient[2] = 0.0;
        }
        answer = Some((cost / n as f64, normal, squared / (weights - UNKNOWNS as f64)));
        let mut damped = normal;
        for i in 0..UNKNOWNS {
            damped[(i, i)] = damped[(i, i)] * 1.001 + 1e-9;
        }
        let mut step = damped.cholesky()?.solve(&gradient);
        let longest = Vector2::new(step[0], step[1]).norm().max(step[2].abs());
        if longest > 0.5 {
            step *= 0.5 / longest;
        }
        p += step;
        p[2] = p[2].clamp(0.6 * r0, 1.6 * r0);
        p[3] = p[3].clamp(0.25, 0.4 * r0 + 0.5);
        if iteration > 12 && longest < 1e-6 {
            break;
        }
    }
    let (cost, normal, variance) = answer?;
    let covariance = normal.cholesky()?.inverse() * variance;
    let out = SphereImage {
        centre: Vector2::new(p[0], p[1]),
        sd: Vector2::new(covariance[(0, 0)].max(0.0).sqrt(), covariance[(1, 1)].max(0.0).sqrt()),
        radius_px: p[2],
        misfit: variance.max(0.0).sqrt() / p[4].abs().max(1e-9),
    };
    let moved = (out.centre - spot.centre).norm();
    (p[4] > MIN_CONTRAST && moved < 1.5 * spot.radius_px + 2.0 && out.sd.norm().is_finite()).then_some((cost, out))
}

/// Grey value of the model at an offset from the centre, and its derivatives.
fn disc(p: &SVector<f64, UNKNOWNS>, dx: f64, dy: f64, d: f64) -> (f64, SVector<f64, UNKNOWNS>) {
    let (radius, blur) = (p[2], p[3]);
    // A logistic step: close to the integral of a Gaussian blur of standard deviation `blur`.
    let z = (radius - d) / (0.6 * blur);
    let cover = 1.0 / (1.0 + (-z.clamp(-40.0, 40.0)).exp());
    let slope = cover * (1.0 - cover) / (0.6 * blur);
    let lit = p[4] + p[5] * dx + p[6] * dy;
    let value = p[7] + p[8] * dx + p[9] * dy + lit * cover;
    let inverse = 1.0 / d.max(1e-6);
    let mut g = SVector::<f64, UNKNOWNS>::zeros();
    g[0] = lit * slope * dx * inverse - p[5] * cover - p[8];
    g[1] = lit * slope * dy * inverse - p[6] * cover - p[9];
    g[2] = lit * slope;
    g[3] = -lit * slope * (radius - d) / blur;
    g[4] = cover;
    g[5] = dx * cover;
    g[6] = dy * cover;
    g[7] = 1.0;
    g[8] = dx;
    g[9] = dy;
    (value, g)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A shaded disc, 8x8 samples a pixel, with a dark bar under it.
    fn picture(cx: f64, cy: f64, radius: f64) -> GreyImage {
        let (width, height) = (64, 64);
        let mut pixels = vec![0u8; width * height];
        for y in 0..height {
            for x in 0..width {
                let mut sum = 0.0;
                for i in 0..64 {
                    let (sx, sy) = (x as f64 - 0.5 + (i % 8) as f64 / 8.0 + 1.0 / 16.0, y as f64 - 0.5 + (i / 8) as f64 / 8.0 + 1.0 / 16.0);
                    let d = (sx - cx).hypot(sy - cy);
                    sum += if d < radius {
                        200.0 - 6.0 * (sy - cy)
                    } else if sy > cy + 0.9 * radius && sx < cx {
                        10.0
                    } else {
                        90.0
                    };
                }
                pixels[y * width + x] = (sum / 64.0).round() as u8;
            }
        }
        GreyImage { width, height, pixels }
    }

    #[test]
    fn truth_a_shaded_disc_beside_a_rod_is_centred_to_a_twentieth_of_a_pixel() {
        for (cx, cy) in [(31.3, 30.2), (30.0, 33.5), (32.77, 31.61)] {
            let image = picture(cx, cy, 5.2);
            let spots = bright_spots(&image);
            let fit = fit_sphere(&image, &spots[0], None).expect("fits");
            assert!((fit.centre - Vector2::new(cx, cy)).norm() < 0.05, "{fit:?} {cx} {cy}");
            assert!((fit.radius_px - 5.2).abs() < 0.15, "{fit:?}");
        }
    }

    #[test]
    fn fails_an_even_picture_has_no_spots() {
        assert!(bright_spots(&GreyImage { width: 80, height: 60, pixels: vec![77; 4800] }).is_empty());
        assert!(bright_spots(&GreyImage { width: 3, height: 2, pixels: vec![200; 6] }).is_empty());
    }
}
