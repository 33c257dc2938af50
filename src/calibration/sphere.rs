//! Bright spheres in one picture: where they may be, and their centres to a small part of a pixel.

use super::view::sample;
use crate::footage::GreyImage;
use crate::median::median;
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
    pub shape: SphereShape,
    /// Root-mean-square misfit of the grey values as a share of the brightness.
    pub misfit: f64,
}

/// What spheres of one frame have in common in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereShape {
    pub radius_px: f64,
    /// Standard deviation of the blur, px.
    pub blur_px: f64,
    /// Brightness relative to the middle per radius to the right and down, and per unit toward the camera.
    pub shading: [f64; 3],
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

const UNKNOWNS: usize = 11;
type Unknowns = SVector<f64, UNKNOWNS>;
/// Step after which pixels around foreign ones are left out.
const MASKED_FROM: usize = 12;
/// Misfit that makes a pixel foreign, as a share of the contrast.
const FOREIGN_SHARE: f64 = 0.25;
/// How much the light on the spheres of one frame differs (sd, relative brightness), where it is taken from all three ...
const SHADING_SD: f64 = 0.05;
/// ... against grey values that scatter by this share of the contrast.
const GREY_SHARE: f64 = 0.03;

/// Fits a blurred, shaded disc on a linear background to the grey values around a spot.
///
/// Unknowns: centre (2), radius, blur, three of the background and four of the disc's brightness, which is linear in the
/// sphere's normal (diffuse light from one side plus light from all around). Pixels that follow neither (the frame's rods)
/// lose weight (Tukey). Several starts around the spot are tried, because a rod that touches the sphere
/// makes a second, worse optimum; the one that explains most pixels wins. Where `shape` is known, its radius and blur are
/// held and its shading is a guide.
pub fn fit_sphere(image: &GreyImage, spot: &Spot, shape: Option<&SphereShape>) -> Option<SphereImage> {
    let mut best: Option<(f64, SphereImage)> = None;
    for radius in shape.map_or_else(|| vec![0.8 * spot.radius_px, spot.radius_px, 1.25 * spot.radius_px], |s| vec![s.radius_px]) {
        for (dx, dy) in [(0.0, 0.0), (0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4)] {
            let start = Spot { centre: spot.centre + Vector2::new(dx, dy) * radius, radius_px: radius, contrast: spot.contrast };
            if let Some((cost, fit)) = fit_from(image, spot, &start, shape)
                && best.as_ref().is_none_or(|b| cost < b.0 - 1e-9)
            {
                best = Some((cost, fit));
            }
        }
    }
    best.map(|b| b.1)
}

/// One descent; returns the mean robust cost over the pixels near the spot, and the fit.
fn fit_from(image: &GreyImage, spot: &Spot, start: &Spot, shape: Option<&SphereShape>) -> Option<(f64, SphereImage)> {
    let r0 = start.radius_px;
    let reach = 1.5 * r0 + 2.5;
    let (inside, contrast) = brightness(image, spot)?;
    let mut p = first_guess(start, shape, inside, contrast);
    // Misfit beyond which a pixel is something else: shading and texture stay within a tenth of the contrast.
    let loose = (0.25 * contrast).max(6.0);
    let tight = (0.1 * contrast).max(4.0);
    let mut answer = None;
    // Pixels that are clearly something else (a rod), found half-way: their neighbours are blends with it, and leave too.
    let mut foreign: Vec<Vector2<f64>> = Vec::new();
    for iteration in 0..60 {
        let limit = if iteration < 8 { loose } else { tight };
        if iteration == MASKED_FROM {
            let is_foreign = |(_, residual, _): &(Vector2<f64>, f64, _)| residual.abs() > FOREIGN_SHARE * contrast;
            foreign = around(image, &p, reach).filter(is_foreign).map(|(here, ..)| here).collect();
        }
        let masked = if iteration > MASKED_FROM { foreign.as_slice() } else { &[] };
        let Equations { mut normal, mut gradient, squared, weights, cost } = Equations::of(around(image, &p, reach), limit, masked);
        if weights < 2.0 * UNKNOWNS as f64 {
            return None;
        }
        if let Some(s) = shape {
            hold_shape(&mut normal, &mut gradient, &p, s, contrast);
        }
        answer = Some((cost, normal, squared / (weights - UNKNOWNS as f64)));
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
        if shape.is_none() {
            p[2] = p[2].clamp(0.6 * r0, 1.6 * r0);
            p[3] = p[3].clamp(0.25, 0.4 * r0 + 0.5);
            for k in [5, 6, 10] {
                p[k] = p[k].clamp(-1.0, 1.0);
            }
        }
        if iteration > MASKED_FROM + 4 && longest < 1e-6 {
            break;
        }
    }
    let (cost, normal, variance) = answer?;
    let covariance = normal.cholesky()?.inverse() * variance;
    let out = SphereImage {
        centre: Vector2::new(p[0], p[1]),
        sd: Vector2::new(covariance[(0, 0)].max(0.0).sqrt(), covariance[(1, 1)].max(0.0).sqrt()),
        shape: SphereShape { radius_px: p[2], blur_px: p[3], shading: [p[5], p[6], p[10]] },
        misfit: variance.max(0.0).sqrt() / p[4].abs().max(1e-9),
    };
    let moved = (out.centre - spot.centre).norm();
    (p[4] > MIN_CONTRAST && moved < 1.5 * spot.radius_px + 2.0 && out.sd.norm().is_finite()).then_some((cost, out))
}

/// Grey value in a spot's middle, and by how much it is brighter than what is around it.
fn brightness(image: &GreyImage, spot: &Spot) -> Option<(f64, f64)> {
    let inside = sample(image, spot.centre)?;
    // Typical contrast: the spot's own is that of its worst direction.
    let around = (0..24).filter_map(|k| {
        let (s, c) = (k as f64 * std::f64::consts::TAU / 24.0).sin_cos();
        sample(image, spot.centre + Vector2::new(c, s) * (1.7 * spot.radius_px))
    });
    Some((inside, (inside - median(around)?).max(spot.contrast)))
}

/// The unknowns that a descent begins with.
fn first_guess(start: &Spot, shape: Option<&SphereShape>, inside: f64, contrast: f64) -> Unknowns {
    let mut p = Unknowns::zeros();
    p[0] = start.centre.x;
    p[1] = start.centre.y;
    p[2] = start.radius_px;
    p[3] = 0.8;
    p[4] = contrast.max(1.0);
    p[7] = inside - contrast;
    if let Some(s) = shape {
        (p[3], p[5], p[6], p[10]) = (s.blur_px, s.shading[0], s.shading[1], s.shading[2]);
    }
    p
}

/// The pixels within `reach` of the model's centre: place, grey value less the model's, and the model's derivatives.
fn around<'a>(image: &'a GreyImage, p: &'a Unknowns, reach: f64) -> impl Iterator<Item = (Vector2<f64>, f64, Unknowns)> + 'a {
    let centre = Vector2::new(p[0], p[1]);
    let (x0, x1) = ((centre.x - reach).ceil() as i64, (centre.x + reach).floor() as i64);
    let (y0, y1) = ((centre.y - reach).ceil() as i64, (centre.y + reach).floor() as i64);
    (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| (x, y))).filter_map(move |(x, y)| {
        let (dx, dy) = (x as f64 - centre.x, y as f64 - centre.y);
        let d = dx.hypot(dy);
        if d > reach || x < 0 || y < 0 {
            return None;
        }
        let grey = image.get(x as usize, y as usize).map(f64::from)?;
        let (value, derivative) = disc(p, dx, dy, d);
        Some((Vector2::new(x as f64, y as f64), grey - value, derivative))
    })
}

/// Normal equations of one step, and the sums that judge where it starts.
struct Equations {
    normal: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    gradient: Unknowns,
    /// Weighted squares of the residuals, and the weights.
    squared: f64,
    weights: f64,
    /// Mean robust cost of all pixels, 0 to 1.
    cost: f64,
}

impl Equations {
    /// Residuals count less the nearer they come to `limit` (Tukey), those beside `foreign` pixels not at all.
    fn of(pixels: impl Iterator<Item = (Vector2<f64>, f64, Unknowns)>, limit: f64, foreign: &[Vector2<f64>]) -> Self {
        let mut sums = Equations { normal: SMatrix::zeros(), gradient: Unknowns::zeros(), squared: 0.0, weights: 0.0, cost: 0.0 };
        let mut n = 0usize;
        for (here, residual, derivative) in pixels {
            n += 1;
            if foreign.iter().any(|f| (f - here).norm_squared() < 2.1) {
                sums.cost += 1.0;
                continue;
            }
            let u = residual / limit;
            let w = if u.abs() < 1.0 { (1.0 - u * u).powi(2) } else { 0.0 };
            sums.normal += derivative * derivative.transpose() * w;
            sums.gradient += derivative * (residual * w);
            sums.squared += w * residual * residual;
            sums.weights += w;
            sums.cost += if u.abs() < 1.0 { 1.0 - (1.0 - u * u).powi(3) } else { 1.0 };
        }
        sums.cost /= n as f64;
        sums
    }
}

/// Holds radius and blur where they are, and draws the shading to the known one.
fn hold_shape(normal: &mut SMatrix<f64, UNKNOWNS, UNKNOWNS>, gradient: &mut Unknowns, p: &Unknowns, shape: &SphereShape, contrast: f64) {
    for k in [2, 3] {
        normal.row_mut(k).fill(0.0);
        normal.column_mut(k).fill(0.0);
        normal[(k, k)] = 1.0;
        gradient[k] = 0.0;
    }
    let weight = (GREY_SHARE * contrast / SHADING_SD).powi(2);
    for (k, known) in [(5, shape.shading[0]), (6, shape.shading[1]), (10, shape.shading[2])] {
        normal[(k, k)] += weight;
        gradient[k] += weight * (known - p[k]);
    }
}

/// Grey value of the model at an offset from the centre, and its derivatives.
fn disc(p: &Unknowns, dx: f64, dy: f64, d: f64) -> (f64, Unknowns) {
    let (radius, blur) = (p[2], p[3]);
    // A logistic step: close to the integral of a Gaussian blur of standard deviation `blur`.
    let z = (radius - d) / (0.6 * blur);
    let cover = 1.0 / (1.0 + (-z.clamp(-40.0, 40.0)).exp());
    let slope = cover * (1.0 - cover) / (0.6 * blur);
    // The normal's component toward the camera, kept off zero where its slope is infinite.
    let toward = (1.0 - (d / radius).powi(2)).max(0.04).sqrt();
    let (nx, ny) = (dx / radius, dy / radius);
    let shade = 1.0 + p[5] * nx + p[6] * ny + p[10] * (toward - 1.0);
    let lit = p[4] * shade;
    let value = p[7] + p[8] * dx + p[9] * dy + lit * cover;
    let inverse = 1.0 / d.max(1e-6);
    let relative = p[4] * cover;
    // How fast the shading changes outward because the surface turns away.
    let turning = if d < 0.979 * radius { p[10] / (toward * radius * radius) } else { 0.0 };
    let mut g = Unknowns::zeros();
    g[0] = lit * slope * dx * inverse - relative * (p[5] / radius - turning * dx) - p[8];
    g[1] = lit * slope * dy * inverse - relative * (p[6] / radius - turning * dy) - p[9];
    g[2] = lit * slope + relative * (turning * d * d / radius - (p[5] * nx + p[6] * ny) / radius);
    g[3] = -lit * slope * (radius - d) / blur;
    g[4] = shade * cover;
    g[5] = relative * nx;
    g[6] = relative * ny;
    g[7] = 1.0;
    g[8] = dx;
    g[9] = dy;
    g[10] = relative * (toward - 1.0);
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
            assert!((fit.shape.radius_px - 5.2).abs() < 0.15, "{fit:?}");
        }
    }

    #[test]
    fn fails_an_even_picture_has_no_spots() {
        assert!(bright_spots(&GreyImage { width: 80, height: 60, pixels: vec![77; 4800] }).is_empty());
        assert!(bright_spots(&GreyImage { width: 3, height: 2, pixels: vec![200; 6] }).is_empty());
    }
}
