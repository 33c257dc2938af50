//! The sums of one round of a band's fit, taken over many pixels at a time.
//!
//! The model of [`super::band`] needs four error functions and four bells per pixel; here they are computed side by side in
//! the widest registers the processor has, in single precision: a picture has eight bits. Sums run in eight fixed lanes, so
//! that every processor gives the same bits.

use super::octet::{LANES, Octet};
use super::racket_figure::VISIBLE_DEPTH;
use super::tape_light::BandShade;

/// Grey levels: white, black, background on either side with its slope along the tube, and how the white brightens across
/// the tube: linearly (light from the side would otherwise pull the band toward it by up to 0.3 px) and from the edges to
/// the middle (light from the camera's side).
pub const LEVELS: usize = 8;
/// Shift along and across, and the levels.
pub const UNKNOWNS: usize = 2 + LEVELS;
/// Arrays are filled up to a multiple of this: what a loop over them takes in one step, so that none of them ends one by one.
pub const STRIDE: usize = 64;
/// Arrays of one value per pixel: the columns of the design, the columns times their weight, and what leads to them.
const ARRAYS: usize = 2 * UNKNOWNS + 9 + 12;
/// Residuals are ranked to this, grey levels.
const RANK_STEP: f32 = 0.25;
const RANKS: usize = 256;

/// The band's model in one round. Lengths in px.
pub struct BandModel {
    /// The band's middle, along and across the tube, from where the pixels' places are counted.
    pub middle: (f64, f64),
    /// The tube's bend: across by this times the square of the way along it, 1/px.
    pub bend: f64,
    pub white_half: f64,
    pub radius: f64,
    pub bow: f64,
    /// 1 / (sqrt 2 times the blur), 1/px.
    pub blur: f64,
    pub black_end: f64,
    /// Light across the tube.
    pub shade: BandShade,
    /// `None` in the first round, which only finds them.
    pub levels: Option<[f64; LEVELS]>,
    /// Residuals beyond this count less (Huber).
    pub scale: f64,
}

/// Normal equations and sums of squares.
pub struct BandSums {
    pub jtj: [[f64; UNKNOWNS]; UNKNOWNS],
    pub jtr: [f64; UNKNOWNS],
    pub weight: f64,
    pub chi: f64,
}

/// The pixels of a band: place along and across the straight tube, px, and grey level. Memory is used again.
#[derive(Default)]
pub struct BandPixels {
    t: Vec<f32>,
    s: Vec<f32>,
    grey: Vec<f32>,
    /// How many there are; the arrays are filled up to whole strides.
    count: usize,
    work: Vec<f32>,
    residual: Vec<f32>,
}

impl BandPixels {
    pub fn clear(&mut self) {
        self.t.clear();
        self.s.clear();
        self.grey.clear();
    }

    #[inline]
    pub fn push(&mut self, t: f64, s: f64, grey: u8) {
        self.t.push(t as f32);
        self.s.push(s as f32);
        self.grey.push(f32::from(grey));
    }

    /// After the last [`Self::push`], before the first [`Self::sums`].
    pub fn complete(&mut self) {
        self.count = self.t.len();
        let n = self.count.next_multiple_of(STRIDE);
        for v in [&mut self.t, &mut self.s, &mut self.grey] {
            v.resize(n, 0.0);
        }
        self.residual.resize(n, 0.0);
        if self.work.len() < ARRAYS * n {
            self.work.resize(ARRAYS * n, 0.0);
        }
    }

    pub fn sums(&mut self, model: &BandModel) -> BandSums {
        pulp::Arch::new().dispatch(Round { pixels: self, model })
    }

    /// Median of the residuals of the last [`Self::sums`], without their signs, to an eighth of a grey level.
    pub fn median_residual(&self) -> f64 {
        let mut ranks = [0u16; RANKS];
        for r in &self.residual[..self.count] {
            ranks[((r.abs() / RANK_STEP) as usize).min(RANKS - 1)] += 1;
        }
        let mut below = 0;
        for (k, n) in ranks.iter().enumerate() {
            below += usize::from(*n);
            if 2 * below >= self.count {
                return f64::from(RANK_STEP) * (k as f64 + 0.5);
            }
        }
        0.0
    }
}

struct Round<'a> {
    pixels: &'a mut BandPixels,
    model: &'a BandModel,
}

impl pulp::NullaryFnOnce for Round<'_> {
    type Output = BandSums;

    #[inline(always)]
    fn call(self) -> BandSums {
        round(self.pixels, self.model)
    }
}

#[inline(always)]
fn round(p: &mut BandPixels, m: &BandModel) -> BandSums {
    let mut sums = BandSums { jtj: [[0.0; UNKNOWNS]; UNKNOWNS], jtr: [0.0; UNKNOWNS], weight: 0.0, chi: 0.0 };
    let n = p.t.len();
    if n == 0 {
        return sums;
    }
    let (places_t, places_s, grey, residual) = (&p.t[..n], &p.s[..n], &p.grey[..n], &mut p.residual[..n]);
    let (columns, rest) = p.work.split_at_mut(UNKNOWNS * n);
    let (weighted, rest) = rest.split_at_mut(UNKNOWNS * n);
    let (z, rest) = rest.split_at_mut(4 * n);
    let (erf, rest) = rest.split_at_mut(4 * n);
    let (bell, rest) = rest.split_at_mut(4 * n);
    let (t, rest) = rest.split_at_mut(n);
    let (s, rest) = rest.split_at_mut(n);
    let (q, rest) = rest.split_at_mut(n);
    let (depth, rest) = rest.split_at_mut(n);
    let (weight, rest) = rest.split_at_mut(n);
    let (pull, rest) = rest.split_at_mut(n);
    let (shade, rest) = rest.split_at_mut(n);
    let (shade_slope, _) = rest.split_at_mut(n);

    let [t0, s0, bend, radius, blur, bow, white_half, mean_depth] =
        [m.middle.0, m.middle.1, m.bend, m.radius, m.blur, m.bow, m.white_half, VISIBLE_DEPTH].map(|v| v as f32);
    // Place along and across the bent tube, across in radii, height of the tube's surface there.
    let across = 1.0 / radius;
    for i in 0..n {
        t[i] = places_t[i] - t0;
        s[i] = places_s[i] - s0 - bend * t[i] * t[i];
        q[i] = (s[i] * across).clamp(-1.0, 1.0);
        depth[i] = (1.0 - q[i] * q[i]).sqrt();
    }
    // Distances from the band's two ends and the tube's two sides, in blurs.
    let (ends, sides) = z.split_at_mut(2 * n);
    let (end_a, end_b) = ends.split_at_mut(n);
    let (side_c, side_e) = sides.split_at_mut(n);
    for i in 0..n {
        let along = t[i] - bow * (depth[i] - mean_depth);
        end_a[i] = (along + white_half) * blur;
        end_b[i] = (along - white_half) * blur;
        side_c[i] = (s[i] + radius) * blur;
        side_e[i] = (s[i] - radius) * blur;
    }
    erf_and_bell(z, erf, bell);

    let (erf_a, erf_b, erf_c, erf_e) = (&erf[..n], &erf[n..2 * n], &erf[2 * n..3 * n], &erf[3 * n..4 * n]);
    let (bell_a, bell_b, bell_c, bell_e) = (&bell[..n], &bell[n..2 * n], &bell[2 * n..3 * n], &bell[3 * n..4 * n]);
    // A pixel astride the tube's side shows the tube's part of what the lens spreads over it: the mean of a normal curve cut off at
    // both sides lies farther inside. Its place in radii, and by how much less that moves than the pixel.
    let narrowing = &mut *pull;
    let (sigma, unit) = (std::f32::consts::FRAC_1_SQRT_2 / blur, 1.0 / std::f32::consts::TAU.sqrt());
    for i in 0..n {
        let tube = (0.5 * (erf_c[i] - erf_e[i])).max(1e-3);
        let lean = (bell_e[i] - bell_c[i]) * unit / tube;
        let spread = ((radius - s[i]) * bell_e[i] + (radius + s[i]) * bell_c[i]) * unit / (sigma * tube);
        narrowing[i] = (1.0 - spread - lean * lean).clamp(0.0, 1.0);
        q[i] = ((s[i] - sigma * lean) * across).clamp(-1.0, 1.0);
        depth[i] = (1.0 - q[i] * q[i]).sqrt();
    }
    // Light, and its slope across the tube by place in the picture.
    let [ambient, sideways, up] = [m.shade.ambient, m.shade.across, m.shade.up].map(|v| v as f32);
    for i in 0..n {
        let direct = sideways * q[i] + up * depth[i];
        let on_tube = if q[i].abs() < 1.0 && direct > 0.0 { 1.0 } else { 0.0 };
        shade[i] = ambient + direct.max(0.0);
        shade_slope[i] = on_tube * (sideways - up * q[i] / depth[i].max(0.3)) * narrowing[i] * across;
    }
    let (shifts, of_levels) = columns.split_at_mut(2 * n);
    let mut of_levels = of_levels.chunks_exact_mut(n);
    let mut next = || of_levels.next().unwrap_or_default();
    let [white, black, plus, plus_slope, minus, minus_slope, lit, raised] = [next(), next(), next(), next(), next(), next(), next(), next()];
    let slope = 1.0 / m.black_end as f32;
    for i in 0..n {
        let (along, tube) = (0.5 * (erf_a[i] - erf_b[i]), 0.5 * (erf_c[i] - erf_e[i]));
        white[i] = tube * along * shade[i];
        black[i] = tube * (1.0 - along) * shade[i];
    }
    for i in 0..n {
        plus[i] = 0.5 * (1.0 + erf_e[i]);
        plus_slope[i] = plus[i] * (t[i] * slope);
    }
    for i in 0..n {
        minus[i] = 0.5 * (1.0 - erf_c[i]);
        minus_slope[i] = minus[i] * (t[i] * slope);
    }
    for i in 0..n {
        lit[i] = white[i] * q[i];
        raised[i] = white[i] * (depth[i] - mean_depth);
    }
    let first = match m.levels {
        None => {
            residual.copy_from_slice(grey);
            weight.fill(1.0);
            2
        }
        Some(l) => {
            let l = l.map(|v| v as f32);
            for i in 0..n {
                residual[i] = grey[i] - (l[0] * white[i] + l[1] * black[i] + l[6] * lit[i] + l[7] * raised[i]);
            }
            for i in 0..n {
                residual[i] -= l[2] * plus[i] + l[3] * plus_slope[i] + l[4] * minus[i] + l[5] * minus_slope[i];
            }
            let scale = m.scale as f32;
            for i in 0..n {
                weight[i] = (scale / residual[i].abs().max(1e-30)).min(1.0);
            }
            let unit = blur / std::f32::consts::PI.sqrt();
            // Derivatives by a shift of the band: along, the white ends move; across, the tube's sides move.
            let (along_shift, across_shift) = shifts.split_at_mut(n);
            for i in 0..n {
                let tube = 0.5 * (erf_c[i] - erf_e[i]);
                let level = l[0] + l[6] * q[i] + l[7] * (depth[i] - mean_depth);
                along_shift[i] = tube * shade[i] * (bell_b[i] - bell_a[i]) * unit * (level - l[1]);
            }
            for i in 0..n {
                let along = 0.5 * (erf_a[i] - erf_b[i]);
                let level = l[0] + l[6] * q[i] + l[7] * (depth[i] - mean_depth);
                let inside = level * along + l[1] * (1.0 - along);
                let tube = 0.5 * (erf_c[i] - erf_e[i]);
                across_shift[i] = inside * ((bell_e[i] - bell_c[i]) * unit * shade[i] - tube * shade_slope[i]);
            }
            for i in 0..n {
                let at = t[i] * slope;
                across_shift[i] += unit * (bell_c[i] * (l[4] + l[5] * at) - bell_e[i] * (l[2] + l[3] * at));
            }
            for i in 0..n {
                let on_tube = if q[i].abs() < 1.0 { 1.0 } else { 0.0 };
                across_shift[i] += on_tube * (l[7] * q[i] / depth[i].max(0.3) - l[6]) * narrowing[i] * across * white[i];
            }
            0
        }
    };
    weight[p.count..].fill(0.0);
    for i in 0..n {
        pull[i] = residual[i] * weight[i];
    }
    for (out, column) in weighted.chunks_exact_mut(n).zip(columns.chunks_exact(n)).skip(first) {
        for i in 0..n {
            out[i] = column[i] * weight[i];
        }
    }
    let column = |k: usize| &columns[k.min(UNKNOWNS - 1) * n..][..n];
    for i in first..UNKNOWNS {
        let left = &weighted[i * n..][..n];
        // The column itself and those after it, four at a time.
        for j in (i..UNKNOWNS).step_by(4) {
            for (k, v) in dots(left, [column(j), column(j + 1), column(j + 2), column(j + 3)]).into_iter().enumerate() {
                if j + k < UNKNOWNS {
                    (sums.jtj[i][j + k], sums.jtj[j + k][i]) = (v, v);
                }
            }
        }
    }
    let right = |k: usize| if k < UNKNOWNS { column(k) } else { &*residual };
    for i in (first..=UNKNOWNS).step_by(4) {
        for (k, v) in dots(pull, [right(i), right(i + 1), right(i + 2), right(i + 3)]).into_iter().enumerate() {
            match sums.jtr.get_mut(i + k) {
                Some(sum) => *sum = v,
                None => sums.chi = v,
            }
        }
    }
    let mut weights = Octet::ZERO;
    for w in weight.as_chunks::<LANES>().0 {
        for l in 0..LANES {
            weights.0[l] += w[l];
        }
    }
    [sums.weight] = totals(&[weights]);
    sums
}

/// Sums of products of one array with several of its length, in eight lanes; the length is a multiple of that.
#[inline(always)]
pub fn dots<const K: usize>(a: &[f32], b: [&[f32]; K]) -> [f64; K] {
    let a = a.as_chunks::<LANES>().0;
    let mut of = [a; K];
    for (chunks, b) in of.iter_mut().zip(b) {
        *chunks = b.as_chunks::<LANES>().0.get(..a.len()).unwrap_or(a);
    }
    let mut lanes = [Octet::ZERO; K];
    for (i, x) in a.iter().enumerate() {
        for k in 0..K {
            lanes[k] = lanes[k].plus_products(x, &of[k][i]);
        }
    }
    totals(&lanes)
}

// Not inlined: otherwise the compiler arranges the lanes for these sums and shuffles them in every step.
#[inline(never)]
fn totals<const K: usize>(lanes: &[Octet; K]) -> [f64; K] {
    let mut totals = [0.0; K];
    for (total, Octet([a, b, c, d, e, f, g, h])) in totals.iter_mut().zip(lanes) {
        *total = f64::from(((a + e) + (c + g)) + ((b + f) + (d + h)));
    }
    totals
}

/// Error function (Abramowitz and Stegun 7.1.26, absolute error below 3e-7 in single precision, far below a grey level) and
/// exp(-z²).
#[inline(always)]
fn erf_and_bell(z: &[f32], erf: &mut [f32], bell: &mut [f32]) {
    for ((z, f), b) in z.iter().zip(erf).zip(bell) {
        let size = z.abs();
        let g = exp_below_zero(-(size * size).min(80.0));
        let t = 1.0 / (1.0 + 0.327_591_1 * size);
        let p = t * (0.254_829_6 + t * (-0.284_496_72 + t * (1.421_413_7 + t * (-1.453_152 + t * 1.061_405_4))));
        *f = (1.0 - p * g).copysign(*z);
        *b = g;
    }
}

/// exp(x) for x from -87 to 0, relative error below 1e-6: powers of two times a polynomial, without branches.
#[inline(always)]
fn exp_below_zero(x: f32) -> f32 {
    // Added to a number it leaves the nearest integer in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let r = x - (shifted - ROUND) * std::f32::consts::LN_2;
    // Taylor's series to the sixth power; |r| is below 0.35.
    let mut p = 1.0 / 720.0;
    for factorial in [120.0, 24.0, 6.0, 2.0, 1.0, 1.0] {
        p = p * r + 1.0 / factorial;
    }
    p * f32::from_bits(shifted.to_bits().wrapping_add(127) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_plain_functions() {
        let z: Vec<f32> = (-640..640).map(|i| i as f32 * 0.01).collect();
        let (mut f, mut g) = (vec![0.0; z.len()], vec![0.0; z.len()]);
        erf_and_bell(&z, &mut f, &mut g);
        for (k, z) in z.iter().enumerate() {
            let z = f64::from(*z);
            assert!((f64::from(g[k]) - (-z * z).exp()).abs() < 1e-6, "{z}");
            assert!((f64::from(f[k]) - super::super::band::erf(z)).abs() < 5e-7, "{z}: {}", f[k]);
        }
    }

    #[test]
    fn law_sums_equal_those_of_numerical_derivatives() {
        let mut pixels = BandPixels::default();
        let grey = |t: f64, s: f64| (120.0 + 60.0 * (0.7 * t).cos() - 9.0 * s).clamp(0.0, 255.0) as u8;
        let places: Vec<(f64, f64)> = (-7..=7).flat_map(|i| (-5..=5).map(move |k| (i as f64 + 0.2, k as f64 - 0.3))).collect();
        // Without bow and slopes of the background, whose small shares the derivatives leave out.
        let levels = [190.0, 30.0, 80.0, 0.0, 70.0, 0.0, 12.0, 20.0];
        let band = BandModel {
            middle: (0.4, -0.2),
            bend: 0.01,
            white_half: 2.8,
            radius: 2.4,
            bow: 0.0,
            blur: 1.1,
            black_end: 7.5,
            shade: BandShade { ambient: 0.5, across: 0.3, up: 0.5 },
            levels: Some(levels),
            scale: 1e9,
        };
        let model = |t: f64, s: f64| {
            let mut one = BandPixels::default();
            one.push(t, s, 0);
            one.complete();
            // One pixel of grey 0: the sum of its squared residual is the model's square.
            one.sums(&band).chi.sqrt()
        };
        for (t, s) in &places {
            pixels.push(*t, *s, grey(*t, *s));
        }
        pixels.complete();
        let sums = pixels.sums(&band);
        let (mut tt, mut ss, mut tr, h) = (0.0, 0.0, 0.0, 0.02);
        for (t, s) in &places {
            // A shift of the band along the tube is a shift of the pixel against it.
            let jt = (model(t - h, *s) - model(t + h, *s)) / (2.0 * h);
            let js = (model(*t, s - h) - model(*t, s + h)) / (2.0 * h);
            tt += jt * jt;
            ss += js * js;
            tr += jt * (f64::from(grey(*t, *s)) - model(*t, *s));
        }
        assert!((sums.jtj[0][0] / tt - 1.0).abs() < 0.02, "{} {tt}", sums.jtj[0][0]);
        assert!((sums.jtj[1][1] / ss - 1.0).abs() < 0.02, "{} {ss}", sums.jtj[1][1]);
        assert!((sums.jtr[0] - tr).abs() < 0.02 * tr.abs().max(1000.0), "{} {tr}", sums.jtr[0]);
        assert_eq!(sums.weight, places.len() as f64);
    }
}
