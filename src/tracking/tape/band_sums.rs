//! The sums of one round of a band's fit, taken over many pixels at a time.
//!
//! The model of [`crate::tracking::tape::band`] needs four error functions and four bells per pixel; here they are computed side by side in
//! the widest registers the processor has, in single precision: a picture has eight bits. Products are fused with their sums and
//! sums run in sixteen fixed lanes, so that every processor gives the same bits.

use crate::footage::is_cut_off;
use crate::tracking::lanes::LANES;
use crate::tracking::racket::racket_figure::VISIBLE_DEPTH;
use crate::tracking::tape::tape_light::BandShade;

/// Grey levels: white, black, background on either side with how much of what lies beside the band shows in it, and how the white
/// brightens across the tube: linearly (light from the side would otherwise pull the band toward it by up to 0.3 px) and from the edges to
/// the middle (light from the camera's side). Once the light is known the last is how the black brightens across.
pub const LEVELS: usize = 8;
/// Shift along and across, and the levels.
pub const UNKNOWNS: usize = 2 + LEVELS;
/// Pixels taken in one step; arrays are filled up to whole steps. All that one step computes stays in the nearest cache.
const STEP: usize = 32;
/// One value for each of the pixels of a step.
type Step = [f32; STEP];
/// Products of two of the columns of the design and of the residual, each pair once.
const PRODUCTS: usize = (UNKNOWNS + 1) * (UNKNOWNS + 2) / 2;
/// Grey levels by which what lies beside a band is divided, so that all columns are of one size.
pub const BESIDE_UNIT: f64 = 50.0;
/// Residuals are ranked to this, grey levels.
const RANK_STEP: f32 = 0.25;
const RANKS: usize = 256;
/// Tangent of the slant up to which a tube's bend is followed under its sides, and what it must carry them across to matter, px.
const FARTHEST_SLANT: f32 = 1.3;
const LEAST_SLANT_PX: f32 = 0.004;
/// What a pixel astride the edge of the light sees beyond the light at its middle: in deviations of the light within the pixel, for an edge
/// right at its middle (a normal deviate is above zero by 1/sqrt(2 pi) in the mean), and how many deviations from the edge it ends. Between it
/// falls with the fourth power, true to 0.006 deviations.
const AT_EDGE: f32 = 0.398_942_3;
const EDGE_REACH: f32 = 3.1;

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
    /// Light across the tube.
    pub shade: BandShade,
    /// The last level is the black's.
    pub black_shaded: bool,
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

/// The pixels of a band: place along and across the straight tube, px, grey level, and what lies beside the band there
/// (less its mean, in [`BESIDE_UNIT`]). Memory is used again.
#[derive(Default)]
pub struct BandPixels {
    t: Vec<f32>,
    s: Vec<f32>,
    grey: Vec<f32>,
    beside: Vec<f32>,
    /// How many there are; the arrays may be longer.
    count: usize,
    /// Pixels beside the band: along and across from its middle, grey level; the same of them.
    around: Vec<[f32; 3]>,
    around_count: usize,
    residual: Vec<f32>,
    scratch: Box<Scratch>,
}

/// Which places are a band's, and which lie beside it, px along and across from its middle.
pub struct BandZone {
    pub middle: [f32; 2],
    /// As in [`BandModel`].
    pub bend: f32,
    pub ends: [f32; 2],
    pub side: f32,
    /// Nearest and farthest across of what lies beside.
    pub beside: [f32; 2],
}

impl BandZone {
    /// Along from the middle, across from the tube's axis there.
    #[inline(always)]
    fn off_middle(&self, [t, s]: [f32; 2]) -> [f32; 2] {
        let along = t - self.middle[0];
        [along, s - self.middle[1] - self.bend * along * along]
    }

    #[inline(always)]
    fn on_band(&self, [along, aside]: [f32; 2]) -> bool {
        (along >= self.ends[0]) & (along <= self.ends[1]) & (aside.abs() <= self.side)
    }

    /// Whether a place (along, across) is the band's.
    pub fn holds(&self, place: [f32; 2]) -> bool {
        self.on_band(self.off_middle(place))
    }
}

/// What one step computes, one value a pixel; it is all written before it is read, so that no step clears it.
#[derive(Default)]
struct Scratch {
    t: Step,
    s: Step,
    q: Step,
    depth: Step,
    z: [Step; 4],
    erf: [Step; 4],
    bell: [Step; 4],
    narrowing: Step,
    shade: Step,
    shade_slope: Step,
    steeper: Step,
    tube: Step,
    inside: Step,
    /// Columns of the design, then the residual.
    c: [Step; UNKNOWNS + 1],
    /// 0 for pixels that are cut off, else 1.
    counts: Step,
    weight: Step,
}

impl BandPixels {
    pub fn clear(&mut self) {
        (self.count, self.around_count) = (0, 0);
    }

    #[cfg(test)]
    pub fn push(&mut self, t: f64, s: f64, grey: u8) {
        let all = BandZone { middle: [0.0; 2], bend: 0.0, ends: [-1e9, 1e9], side: 1e9, beside: [2e9; 2] };
        self.push_row([t as f32, s as f32], [0.0; 2], &[grey], &all);
    }

    /// Adds the pixels of a row that belong to the band or lie beside it; the first one's place (along, across) and the way from each to the
    /// next are given.
    #[inline(always)]
    pub fn push_row(&mut self, first: [f32; 2], way: [f32; 2], row: &[u8], zone: &BandZone) {
        let most = self.count + row.len();
        self.room_for(most);
        if self.around.len() < self.around_count + row.len() {
            self.around.resize(2 * (self.around_count + row.len()), [0.0; 3]);
        }
        let [along, across, greys] = [&mut self.t, &mut self.s, &mut self.grey].map(|v| &mut v[self.count..most]);
        let around = &mut self.around[self.around_count..][..row.len()];
        let (mut at, mut beside) = (0, 0);
        let (mut t, mut s, mut from_middle, mut aside): (Step, Step, Step, Step) = ([0.0; STEP], [0.0; STEP], [0.0; STEP], [0.0; STEP]);
        let (mut on_band, mut off_it) = ([0u32; STEP], [0u32; STEP]);
        for (k, row) in row.chunks(STEP).enumerate() {
            for i in 0..STEP {
                let x = (k * STEP + i) as f32;
                (t[i], s[i]) = (first[0] + x * way[0], first[1] + x * way[1]);
                [from_middle[i], aside[i]] = zone.off_middle([t[i], s[i]]);
                on_band[i] = u32::from(zone.on_band([from_middle[i], aside[i]]));
                off_it[i] = u32::from((aside[i].abs() >= zone.beside[0]) & (aside[i].abs() <= zone.beside[1]));
            }
            // Written in any case, kept where it belongs: no branch to guess.
            for (i, grey) in row.iter().enumerate() {
                let grey = f32::from(*grey);
                (along[at], across[at], greys[at]) = (t[i], s[i], grey);
                around[beside] = [from_middle[i], aside[i], grey];
                at += on_band[i] as usize;
                beside += off_it[i] as usize;
            }
        }
        self.count += at;
        self.around_count += beside;
    }

    /// The pixels beside the band: along and across from its middle, grey level.
    pub fn beside_it(&self) -> &[[f32; 3]] {
        &self.around[..self.around_count]
    }

    #[inline(always)]
    fn room_for(&mut self, pixels: usize) {
        if self.residual.len() < pixels {
            for v in [&mut self.t, &mut self.s, &mut self.grey, &mut self.beside, &mut self.residual] {
                v.resize((2 * pixels).next_multiple_of(STEP), 0.0);
            }
        }
    }

    /// After the last row, before the first [`Self::sums`]: what lies beside the band at a place along and across.
    pub fn complete(&mut self, beside: impl Fn(f32, f32) -> f32) {
        let end = self.steps_end();
        self.room_for(end);
        for i in 0..self.count {
            self.beside[i] = beside(self.t[i], self.s[i]);
        }
        for v in [&mut self.t, &mut self.s, &mut self.grey, &mut self.beside] {
            v[self.count..end].fill(0.0);
        }
    }

    /// Pixels up to a whole step.
    fn steps_end(&self) -> usize {
        self.count.next_multiple_of(STEP)
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
    let [t0, s0, bend, radius, blur, bow, white_half, mean_depth] =
        [m.middle.0, m.middle.1, m.bend, m.radius, m.blur, m.bow, m.white_half, VISIBLE_DEPTH].map(|v| v as f32);
    let across = 1.0 / radius;
    // The bend is the axis': seen slantwise, the sides of the tube belong to a place of it farther back than the middle does. That is followed
    // as far as a parabola is good for the axis; end-on there is none.
    let far = FARTHEST_SLANT * (radius * radius - bow * bow).max(0.0).sqrt();
    let slant = bow.clamp(-far, far);
    let slantwise = (bend * slant * slant).abs() > LEAST_SLANT_PX;
    let (sigma, unit) = (std::f32::consts::FRAC_1_SQRT_2 / blur, 1.0 / std::f32::consts::TAU.sqrt());
    let steep = blur / std::f32::consts::PI.sqrt();
    let [ambient, sideways, up] = [m.shade.ambient, m.shade.across, m.shade.up].map(|v| v as f32);
    let l = m.levels.unwrap_or_default().map(|v| v as f32);
    let scale = if m.levels.is_some() { m.scale as f32 } else { f32::INFINITY };
    // The last level is either the white's or the black's.
    let [of_white, of_black] = if m.black_shaded { [0.0, 1.0] } else { [1.0, 0.0] };
    let (raised, black_lit) = (of_white * l[7], of_black * l[7]);

    let mut sums = [[0.0f32; LANES]; PRODUCTS];
    let mut weights = [0.0f32; LANES];
    let end = p.steps_end();
    let Scratch { t, s, q, depth, z, erf, bell, narrowing, shade, shade_slope, steeper, tube, inside, c, counts, weight } = &mut *p.scratch;
    let places = p.t[..end].as_chunks::<STEP>().0.iter().zip(p.s.as_chunks::<STEP>().0).zip(p.beside.as_chunks::<STEP>().0);
    let steps = places.zip(p.grey.as_chunks::<STEP>().0).zip(p.residual.as_chunks_mut::<STEP>().0);
    for (k, ((((places_t, places_s), beside), grey), residual)) in steps.enumerate() {
        let real = p.count.saturating_sub(k * STEP);
        for i in 0..STEP {
            t[i] = places_t[i] - t0;
            s[i] = places_s[i] - s0 - bend * t[i] * t[i];
            q[i] = (s[i] * across).clamp(-1.0, 1.0);
            depth[i] = (1.0 - q[i] * q[i]).sqrt();
        }
        if slantwise {
            for i in 0..STEP {
                let on_axis = t[i] - slant * (depth[i] - mean_depth);
                s[i] = places_s[i] - s0 - bend * on_axis * on_axis;
                q[i] = (s[i] * across).clamp(-1.0, 1.0);
                depth[i] = (1.0 - q[i] * q[i]).sqrt();
            }
        }
        for i in 0..STEP {
            let along = t[i] - bow * (depth[i] - mean_depth);
            z[0][i] = (along + white_half) * blur;
            z[1][i] = (along - white_half) * blur;
            z[2][i] = (s[i] + radius) * blur;
            z[3][i] = (s[i] - radius) * blur;
        }
        for k in 0..4 {
            erf_and_bell(&z[k], &mut erf[k], &mut bell[k]);
        }
        let [erf_a, erf_b, erf_c, erf_e] = &*erf;
        let [bell_a, bell_b, bell_c, bell_e] = &*bell;
        for i in 0..STEP {
            tube[i] = 0.5 * (erf_c[i] - erf_e[i]);
            inside[i] = 0.5 * (erf_a[i] - erf_b[i]);
            let share = 1.0 / tube[i].max(1e-3);
            let lean = (bell_e[i] - bell_c[i]) * unit * share;
            let spread = ((radius - s[i]) * bell_e[i] + (radius + s[i]) * bell_c[i]) * (unit / sigma) * share;
            narrowing[i] = (1.0 - spread - lean * lean).clamp(0.0, 1.0) * across;
            q[i] = ((s[i] - sigma * lean) * across).clamp(-1.0, 1.0);
        }
        // A pixel sees a mean over places of the tube, not what its mean place shows: toward the sides the surface falls away ever faster,
        // and where the light ends it is even. By the places' spread; without it light from the side pulls bands by 0.02 px.
        for i in 0..STEP {
            let variance = narrowing[i] * sigma * sigma * across;
            let squared = (1.0 - q[i] * q[i] - variance).max(1e-4);
            depth[i] = squared.sqrt() * (1.0 - 0.5 * (q[i] * q[i] * variance / (squared * squared)).min(0.5));
            let on_tube = if q[i].abs() < 1.0 { narrowing[i] } else { 0.0 };
            // The slope of the tube's surface there, toward the camera.
            steeper[i] = q[i] / depth[i].max(0.3);
            let direct = sideways * q[i] + up * depth[i];
            let slope = sideways - up * steeper[i];
            let deviation = slope.abs() * variance.sqrt();
            let near_edge = (1.0 - direct.abs() / (EDGE_REACH * deviation).max(1e-6)).max(0.0);
            let cubed = near_edge * near_edge * near_edge;
            let past_edge = AT_EDGE * 4.0 / EDGE_REACH * cubed;
            let lit = if direct > 0.0 { 1.0 - past_edge } else { past_edge };
            shade[i] = ambient + direct.max(0.0) + AT_EDGE * deviation * near_edge * cubed;
            shade_slope[i] = lit * slope * on_tube;
            narrowing[i] = on_tube;
        }
        for i in 0..STEP {
            c[2][i] = tube[i] * inside[i] * shade[i];
            c[3][i] = tube[i] * (1.0 - inside[i]) * shade[i];
            c[4][i] = 0.5 * (1.0 + erf_e[i]);
            c[6][i] = 0.5 * (1.0 - erf_c[i]);
        }
        for i in 0..STEP {
            c[5][i] = c[4][i] * beside[i];
            c[7][i] = c[6][i] * beside[i];
            c[8][i] = c[2][i] * q[i];
            c[9][i] = of_white * c[2][i] * (depth[i] - mean_depth) + of_black * c[3][i] * q[i];
        }
        for i in 0..STEP {
            let white = l[0] * c[2][i] + l[1] * c[3][i] + l[6] * c[8][i] + l[7] * c[9][i];
            let around = l[2] * c[4][i] + l[3] * c[5][i] + l[4] * c[6][i] + l[5] * c[7][i];
            counts[i] = if is_cut_off(grey[i], white + around) { 0.0 } else { 1.0 };
            residual[i] = (grey[i] - white - around) * counts[i];
        }
        // Derivatives by a shift of the band: along, the white ends move; across, the tube's sides move.
        for i in 0..STEP {
            let level = l[0] + l[6] * q[i] + raised * (depth[i] - mean_depth);
            let black = l[1] + black_lit * q[i];
            c[0][i] = tube[i] * shade[i] * (bell_b[i] - bell_a[i]) * steep * (level - black);
            let inside = level * inside[i] + black * (1.0 - inside[i]);
            c[1][i] = inside * ((bell_e[i] - bell_c[i]) * steep * shade[i] - tube[i] * shade_slope[i]);
        }
        for i in 0..STEP {
            let around = steep * (bell_c[i] * (l[4] + l[5] * beside[i]) - bell_e[i] * (l[2] + l[3] * beside[i]));
            c[1][i] += around + narrowing[i] * ((raised * steeper[i] - l[6]) * c[2][i] - black_lit * c[3][i]);
        }
        for i in 0..STEP {
            weight[i] = (scale / residual[i].abs().max(1e-30)).min(1.0) * counts[i];
        }
        if real < STEP {
            weight[real..].fill(0.0);
        }
        c[UNKNOWNS] = *residual;
        let mut sums = sums.iter_mut();
        for i in 0..=UNKNOWNS {
            let mut weighted: Step = [0.0; STEP];
            for l in 0..STEP {
                weighted[l] = c[i][l] * weight[l];
            }
            for (column, sum) in c[i..].iter().zip(&mut sums) {
                add_products(sum, &weighted, column);
            }
        }
        add_products(&mut weights, weight, &[1.0; STEP]);
    }
    let mut out = BandSums { jtj: [[0.0; UNKNOWNS]; UNKNOWNS], jtr: [0.0; UNKNOWNS], weight: f64::from(total(&fourths(&weights))), chi: 0.0 };
    let totals = totals(&sums);
    let mut sums = totals.iter().map(|sum| f64::from(*sum));
    for i in 0..UNKNOWNS {
        for j in i..UNKNOWNS {
            let v = sums.next().unwrap_or_default();
            (out.jtj[i][j], out.jtj[j][i]) = (v, v);
        }
        out.jtr[i] = sums.next().unwrap_or_default();
    }
    out.chi = sums.next().unwrap_or_default();
    out
}

#[inline(always)]
fn add_products(to: &mut [f32; LANES], a: &Step, b: &Step) {
    for h in 0..STEP / LANES {
        for l in 0..LANES {
            to[l] = a[h * LANES + l].mul_add(b[h * LANES + l], to[l]);
        }
    }
}

/// The totals of all lanes, side by side.
#[inline(always)]
fn totals(sums: &[[f32; LANES]; PRODUCTS]) -> [f32; PRODUCTS] {
    let mut fours = [[0.0f32; 4]; PRODUCTS];
    for k in 0..PRODUCTS {
        fours[k] = fourths(&sums[k]);
    }
    let mut out = [0.0; PRODUCTS];
    for k in 0..PRODUCTS {
        out[k] = total(&fours[k]);
    }
    out
}

#[inline(always)]
fn fourths(lanes: &[f32; LANES]) -> [f32; 4] {
    let mut four = [0.0f32; 4];
    for l in 0..4 {
        four[l] = (lanes[l] + lanes[l + 8]) + (lanes[l + 4] + lanes[l + 12]);
    }
    four
}

#[inline(always)]
fn total(four: &[f32; 4]) -> f32 {
    (four[0] + four[2]) + (four[1] + four[3])
}

/// Error function (Abramowitz and Stegun 7.1.26, absolute error below 3e-7 in single precision, far below a grey level) and
/// exp(-z²).
#[inline(always)]
fn erf_and_bell(z: &Step, erf: &mut Step, bell: &mut Step) {
    for i in 0..STEP {
        let size = z[i].abs();
        let g = exp_below_zero(-(size * size).min(80.0));
        let t = 1.0 / 0.327_591_1f32.mul_add(size, 1.0);
        let p = t.mul_add(1.061_405_4, -1.453_152).mul_add(t, 1.421_413_7).mul_add(t, -0.284_496_72).mul_add(t, 0.254_829_6) * t;
        erf[i] = (-p).mul_add(g, 1.0).copysign(z[i]);
        bell[i] = g;
    }
}

/// exp(x) for x from -87 to 0, relative error below 1e-6: powers of two times a polynomial, without branches.
#[inline(always)]
fn exp_below_zero(x: f32) -> f32 {
    // Added to a number it leaves the nearest integer in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    let shifted = x.mul_add(std::f32::consts::LOG2_E, ROUND);
    let r = (shifted - ROUND).mul_add(-std::f32::consts::LN_2, x);
    // Taylor's series to the sixth power; |r| is below 0.35.
    let mut p = 1.0f32 / 720.0;
    for factorial in [120.0, 24.0, 6.0, 2.0, 1.0, 1.0] {
        p = p.mul_add(r, 1.0 / factorial);
    }
    p * f32::from_bits(shifted.to_bits().wrapping_add(127) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_plain_functions() {
        let many: Vec<f32> = (-640..640).map(|i| i as f32 * 0.01).collect();
        for z in many.as_chunks::<STEP>().0 {
            let (mut f, mut g) = ([0.0; STEP], [0.0; STEP]);
            erf_and_bell(z, &mut f, &mut g);
            for (k, z) in z.iter().enumerate() {
                let z = f64::from(*z);
                assert!((f64::from(g[k]) - (-z * z).exp()).abs() < 1e-6, "{z}");
                assert!((f64::from(f[k]) - crate::tracking::tape::band::erf(z)).abs() < 5e-7, "{z}: {}", f[k]);
            }
        }
    }

    #[test]
    fn law_sums_equal_those_of_numerical_derivatives() {
        for black_shaded in [false, true] {
            sums_equal_those_of_numerical_derivatives(black_shaded);
        }
    }

    #[test]
    fn truth_a_lit_tube_is_as_bright_as_the_mean_of_its_places_under_the_lens() {
        let (radius, sigma, white) = (2.4f64, 0.6f64, 100.0);
        for (ambient, across, up) in [(0.35, 0.2, 0.6), (0.35, -0.35, 0.45), (0.35, 0.5, 0.3), (0.3, 0.5, -0.2), (0.3, 0.1, 0.7)] {
            let band = BandModel {
                middle: (0.0, 0.0),
                bend: 0.0,
                white_half: 50.0,
                radius,
                bow: 0.0,
                blur: 1.0 / (sigma * std::f64::consts::SQRT_2),
                shade: BandShade { ambient, across, up },
                black_shaded: true,
                levels: Some([white, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
                scale: 1e9,
            };
            // Where the light is: what the model puts too far to one side pulls the band to the other.
            let (mut pull, mut light) = (0.0, 0.0);
            for k in -40..=40 {
                let s = 0.1 * f64::from(k);
                let mut one = BandPixels::default();
                one.push(0.0, s, 0);
                one.complete(|_, _| 0.0);
                let model = one.sums(&band).chi.sqrt();
                // Midpoints of 4000 strips of the tube.
                let strip = 2.0 * radius / 4000.0;
                let truth: f64 = (0..4000)
                    .map(|i| strip * (f64::from(i) + 0.5) - radius)
                    .map(|x| {
                        let q = x / radius;
                        let lit = ambient + (across * q + up * (1.0 - q * q).sqrt()).max(0.0);
                        white * lit * (-0.5 * ((s - x) / sigma).powi(2)).exp() * strip / (sigma * std::f64::consts::TAU.sqrt())
                    })
                    .sum();
                assert!((model - truth).abs() < 0.006 * white, "{ambient} {across} {up} at {s}: {model} instead of {truth}");
                pull += s * (model - truth);
                light += truth;
            }
            assert!((pull / light).abs() < 0.006, "{ambient} {across} {up}: {} px", pull / light);
        }
    }

    fn sums_equal_those_of_numerical_derivatives(black_shaded: bool) {
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
            shade: BandShade { ambient: 0.5, across: 0.3, up: 0.5 },
            black_shaded,
            levels: Some(levels),
            scale: 1e9,
        };
        let model = |t: f64, s: f64| {
            let mut one = BandPixels::default();
            one.push(t, s, 0);
            one.complete(|_, _| 0.0);
            // One pixel of grey 0: the sum of its squared residual is the model's square.
            one.sums(&band).chi.sqrt()
        };
        for (t, s) in &places {
            pixels.push(*t, *s, grey(*t, *s));
        }
        pixels.complete(|_, _| 0.0);
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
