//! The sums of one round of a band's fit, taken over many pixels at a time.
//!
//! The model of [`super::band`] needs four error functions and four bells per pixel; here they are computed side by side in
//! the widest registers the processor has. Sums run in eight fixed lanes, so that every processor gives the same bits.

use super::racket_figure::VISIBLE_DEPTH;

/// Grey levels: white, black, background on either side with its slope along the tube, and how the white brightens across
/// the tube: linearly (light from the side would otherwise pull the band toward it by up to 0.3 px) and from the edges to
/// the middle (light from the camera's side).
pub const LEVELS: usize = 8;
/// Shift along and across, and the levels.
pub const UNKNOWNS: usize = 2 + LEVELS;
const LANES: usize = 8;
/// Arrays of one value per pixel: the columns of the design, the columns times their weight, and what leads to them.
const ARRAYS: usize = 2 * UNKNOWNS + 5 + 12;

/// The band's model in one round.
pub struct BandModel {
    pub white_half: f64,
    pub radius: f64,
    pub bow: f64,
    /// 1 / (sqrt 2 times the blur), 1/px.
    pub blur: f64,
    pub black_end: f64,
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

/// Pixels of one round: place along and across the tube from the band's middle, px, and grey level. Memory is used again.
#[derive(Default)]
pub struct BandPixels {
    t: Vec<f64>,
    s: Vec<f64>,
    grey: Vec<f64>,
    work: Vec<f64>,
    /// |residual| of every pixel after [`Self::sums`] with levels.
    pub residuals: Vec<f64>,
}

impl BandPixels {
    pub fn clear(&mut self) {
        self.t.clear();
        self.s.clear();
        self.grey.clear();
    }

    #[inline]
    pub fn push(&mut self, t: f64, s: f64, grey: u8) {
        self.t.push(t);
        self.s.push(s);
        self.grey.push(f64::from(grey));
    }

    pub fn sums(&mut self, model: &BandModel) -> BandSums {
        pulp::Arch::new().dispatch(Round { pixels: self, model })
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
    let real = p.t.len();
    if real == 0 {
        return sums;
    }
    let n = real.next_multiple_of(LANES);
    for v in [&mut p.t, &mut p.s, &mut p.grey] {
        v.resize(n, 0.0);
    }
    if p.work.len() < ARRAYS * n {
        p.work.resize(ARRAYS * n, 0.0);
    }
    let (t, s, grey) = (&p.t[..n], &p.s[..n], &p.grey[..n]);
    let (columns, rest) = p.work.split_at_mut(UNKNOWNS * n);
    let (weighted, rest) = rest.split_at_mut(UNKNOWNS * n);
    let (z, rest) = rest.split_at_mut(4 * n);
    let (erf, rest) = rest.split_at_mut(4 * n);
    let (bell, rest) = rest.split_at_mut(4 * n);
    let (q, rest) = rest.split_at_mut(n);
    let (depth, rest) = rest.split_at_mut(n);
    let (residual, rest) = rest.split_at_mut(n);
    let (weight, _) = rest.split_at_mut(n);

    // Place across the tube in radii, height of the tube's surface there.
    let across = 1.0 / m.radius;
    for ((q, d), s) in q.iter_mut().zip(depth.iter_mut()).zip(s) {
        *q = (s * across).clamp(-1.0, 1.0);
        *d = (1.0 - *q * *q).sqrt();
    }
    // Distances from the band's two ends and the tube's two sides, in blurs.
    let (ends, sides) = z.split_at_mut(2 * n);
    let (end_a, end_b) = ends.split_at_mut(n);
    for (((a, b), t), d) in end_a.iter_mut().zip(end_b).zip(t).zip(&*depth) {
        let along = t - m.bow * (d - VISIBLE_DEPTH);
        *a = (along + m.white_half) * m.blur;
        *b = (along - m.white_half) * m.blur;
    }
    let (side_c, side_e) = sides.split_at_mut(n);
    for ((c, e), s) in side_c.iter_mut().zip(side_e).zip(s) {
        *c = (s + m.radius) * m.blur;
        *e = (s - m.radius) * m.blur;
    }
    erf_and_bell(z, erf, bell);

    let (erf_a, erf_b, erf_c, erf_e) = (&erf[..n], &erf[n..2 * n], &erf[2 * n..3 * n], &erf[3 * n..4 * n]);
    let (bell_a, bell_b, bell_c, bell_e) = (&bell[..n], &bell[n..2 * n], &bell[2 * n..3 * n], &bell[3 * n..4 * n]);
    let (shifts, of_levels) = columns.split_at_mut(2 * n);
    let mut of_levels = of_levels.chunks_exact_mut(n);
    let mut next = || of_levels.next().unwrap_or_default();
    let [white, black, plus, plus_slope, minus, minus_slope, lit, raised] = [next(), next(), next(), next(), next(), next(), next(), next()];
    for i in 0..n {
        let (along, tube) = (0.5 * (erf_a[i] - erf_b[i]), 0.5 * (erf_c[i] - erf_e[i]));
        white[i] = tube * along;
        black[i] = tube * (1.0 - along);
    }
    let slope = 1.0 / m.black_end;
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
        raised[i] = white[i] * (depth[i] - VISIBLE_DEPTH);
    }
    match &m.levels {
        None => {
            shifts.fill(0.0);
            residual.copy_from_slice(grey);
            weight.fill(1.0);
        }
        Some(l) => {
            for i in 0..n {
                residual[i] = grey[i] - (l[0] * white[i] + l[1] * black[i] + l[6] * lit[i] + l[7] * raised[i]);
            }
            for i in 0..n {
                residual[i] -= l[2] * plus[i] + l[3] * plus_slope[i] + l[4] * minus[i] + l[5] * minus_slope[i];
            }
            for (w, r) in weight.iter_mut().zip(&*residual) {
                *w = (m.scale / r.abs().max(1e-300)).min(1.0);
            }
            let unit = m.blur / std::f64::consts::PI.sqrt();
            // Derivatives by a shift of the band: along, the white ends move; across, the tube's sides move.
            let (along_shift, across_shift) = shifts.split_at_mut(n);
            for i in 0..n {
                let tube = 0.5 * (erf_c[i] - erf_e[i]);
                let level = l[0] + l[6] * q[i] + l[7] * (depth[i] - VISIBLE_DEPTH);
                along_shift[i] = tube * (bell_b[i] - bell_a[i]) * unit * (level - l[1]);
            }
            for i in 0..n {
                let along = 0.5 * (erf_a[i] - erf_b[i]);
                let level = l[0] + l[6] * q[i] + l[7] * (depth[i] - VISIBLE_DEPTH);
                let inside = level * along + l[1] * (1.0 - along);
                across_shift[i] = inside * (bell_e[i] - bell_c[i]) * unit;
            }
            for i in 0..n {
                let at = t[i] * slope;
                across_shift[i] += unit * (bell_c[i] * (l[4] + l[5] * at) - bell_e[i] * (l[2] + l[3] * at));
            }
            for i in 0..n {
                let on_tube = if q[i].abs() < 1.0 { 1.0 } else { 0.0 };
                across_shift[i] += on_tube * (l[7] * q[i] / depth[i].max(0.3) - l[6]) * across * white[i];
            }
        }
    }
    weight[real..].fill(0.0);
    p.residuals.clear();
    p.residuals.extend(residual[..real].iter().map(|r| r.abs()));
    for (out, column) in weighted.chunks_exact_mut(n).zip(columns.chunks_exact(n)) {
        for i in 0..n {
            out[i] = column[i] * weight[i];
        }
    }
    for i in 0..UNKNOWNS {
        let left = &weighted[i * n..(i + 1) * n];
        // The column itself and those after it, four at a time, and the residual.
        let mut j = i;
        while j < UNKNOWNS {
            let at = |k: usize| if j + k < UNKNOWNS { &columns[(j + k) * n..(j + k + 1) * n] } else { &residual[..n] };
            let four = dots(left, [at(0), at(1), at(2), at(3)]);
            for (k, v) in four.into_iter().enumerate() {
                if j + k < UNKNOWNS {
                    (sums.jtj[i][j + k], sums.jtj[j + k][i]) = (v, v);
                } else {
                    sums.jtr[i] = v;
                }
            }
            j += 4;
        }
        if (UNKNOWNS - i).is_multiple_of(4) {
            sums.jtr[i] = dots(left, [&residual[..n]; 1])[0];
        }
    }
    for (w, r) in weight[..real].iter().zip(&*residual) {
        sums.weight += w;
        sums.chi += w * r * r;
    }
    sums
}

/// Sums of products of one array with several, in eight lanes; all lengths are multiples of that.
#[inline(always)]
fn dots<const K: usize>(a: &[f64], b: [&[f64]; K]) -> [f64; K] {
    let mut lanes = [[0.0; LANES]; K];
    for i in (0..a.len()).step_by(LANES) {
        let Some(x) = a.get(i..i + LANES) else { break };
        for k in 0..K {
            let Some(y) = b[k].get(i..i + LANES) else { break };
            for l in 0..LANES {
                lanes[k][l] += x[l] * y[l];
            }
        }
    }
    lanes.map(|l| l.iter().sum())
}

/// Error function (Abramowitz and Stegun 7.1.26, absolute error below 1.5e-7, far below a grey level) and exp(-z²).
#[inline(always)]
fn erf_and_bell(z: &[f64], erf: &mut [f64], bell: &mut [f64]) {
    for ((z, f), b) in z.iter().zip(erf).zip(bell) {
        let size = z.abs();
        let g = exp_below_zero(-(size * size).min(40.0));
        let t = 1.0 / (1.0 + 0.327_591_1 * size);
        let p = t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
        *f = (1.0 - p * g).copysign(*z);
        *b = g;
    }
}

/// exp(x) for x from -700 to 0, relative error below 1e-11: powers of two times a polynomial, without branches.
#[inline(always)]
fn exp_below_zero(x: f64) -> f64 {
    // Added to a number it leaves the nearest integer in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let r = x - (shifted - ROUND) * std::f64::consts::LN_2;
    // Taylor's series to the ninth power; |r| is below 0.35.
    let mut p = 1.0 / 362_880.0;
    for factorial in [40_320.0, 5_040.0, 720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0] {
        p = p * r + 1.0 / factorial;
    }
    p * f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_plain_functions() {
        let z: Vec<f64> = (-640..640).map(|i| i as f64 * 0.01).collect();
        let (mut f, mut g) = (vec![0.0; z.len()], vec![0.0; z.len()]);
        erf_and_bell(&z, &mut f, &mut g);
        for (k, z) in z.iter().enumerate() {
            assert!((g[k] - (-z * z).exp()).abs() < 1e-11, "{z}");
            assert!((f[k] - super::super::band::erf(*z)).abs() < 2e-8, "{z}: {}", f[k]);
        }
    }

    #[test]
    fn law_sums_equal_those_of_numerical_derivatives() {
        let mut pixels = BandPixels::default();
        let grey = |t: f64, s: f64| (120.0 + 60.0 * (0.7 * t).cos() - 9.0 * s).clamp(0.0, 255.0) as u8;
        let places: Vec<(f64, f64)> = (-7..=7).flat_map(|i| (-5..=5).map(move |k| (i as f64 + 0.2, k as f64 - 0.3))).collect();
        // Without bow and slopes of the background, whose small shares the derivatives leave out.
        let levels = [190.0, 30.0, 80.0, 0.0, 70.0, 0.0, 12.0, 20.0];
        let model = |t: f64, s: f64| {
            let mut one = BandPixels::default();
            one.push(t, s, 0);
            // One pixel of grey 0: the sum of its squared residual is the model's square.
            let sums = one.sums(&BandModel { white_half: 2.8, radius: 2.4, bow: 0.0, blur: 1.1, black_end: 7.5, levels: Some(levels), scale: 1e9 });
            sums.chi.sqrt()
        };
        for (t, s) in &places {
            pixels.push(*t, *s, grey(*t, *s));
        }
        let sums = pixels.sums(&BandModel { white_half: 2.8, radius: 2.4, bow: 0.0, blur: 1.1, black_end: 7.5, levels: Some(levels), scale: 1e9 });
        let (mut tt, mut ss, mut tr, h) = (0.0, 0.0, 0.0, 1e-5);
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
