//! Is anything missing at all? A generic set of smooth corrections, tested at once.
//!
//! Impulses at the contact point (along the normal, the slip, across it, along the face's axes), spin impulses on the
//! ball, impulses and angular impulses on the racket, each times smooth features of the inputs, and a friction that goes with what
//! sliding balls differ by. They span what almost any missing mechanism would do, whatever its name. Statistic T = U' I⁺ U of rank q; its p-value by a wild bootstrap
//! (random signs on the impacts' contributions), which keeps its level with outliers and wrongly stated noise where
//! chi-square and F tails do not (docs/diagnosis.md, "In formulas", structure). The noise scale c is what is left when all structure is taken
//! out: it tells a wrongly stated noise from a wrong model. It is found for each group of outputs by itself (Σ e² over
//! Σ (1 − h), h the leverage) and averaged over the numbers measured: (chi² − T)/(dof − q) would be too small where the terms
//! take most out of those outputs whose noise is understated the most, and the floor of the error with it.

use super::by_group::{GroupMisfit, GroupTest, group_test};
use super::fit::Fit;
use super::forward::Inputs;
use super::lone_term::{LoneTerm, lone_term};
use super::observation::{Gear, Observation, Observations};
use super::project::{Nuisance, Projected, beside, project, project_out};
use super::tails::chi2_tail;
use crate::impact_table::OUTPUTS;
use nalgebra::{DMatrix, DVector, RowDVector, Vector3};
use rand::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};

/// Level of the structure test.
pub const STRUCTURE_LEVEL: f64 = 0.003;
/// Chi-square per number of a table that agrees with the model to a thousandth of its noise.
const EXACT: f64 = 1e-6;

/// Draws of the wild bootstrap.
const DRAWS: usize = 400;
/// The noise scale is not believed below this: deviations overstated more than twofold are a matter for the table.
const SMALLEST_SCALE: f64 = 0.25;

/// Groups of outputs whose noise is judged together: the beginnings of their names.
const GROUPS: [&str; 5] = ["ball_out_v", "ball_out_w", "racket_out_v", "racket_out_w", "contact_time"];
/// Rates that vary by less are those of a racket that hangs, rad/s: a swing's vary by several.
const LEAST_TURNING: f64 = 0.3;
/// Degrees of freedom by which a group's noise scale is drawn toward that of all.
const COMMON_WORTH: f64 = 20.0;

/// Noise of a group of outputs.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct GroupNoise {
    /// Beginning of the outputs' names.
    pub outputs: String,
    /// Variance relative to the stated one.
    pub scale: f64,
    /// Degrees of freedom it was found from.
    pub freedom: f64,
}

/// Outcome of the structure test.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StructureTest {
    /// T and its rank q.
    pub statistic: f64,
    pub rank: usize,
    pub p_value: f64,
    /// c: the variance of the residuals relative to the stated one, with all structure taken out.
    pub noise_scale: f64,
    /// The same for each group of outputs.
    #[serde(default)]
    pub noise_by_group: Vec<GroupNoise>,
    /// chi² − T.
    #[serde(default)]
    pub residual_chi2: f64,
    /// Degrees of freedom left when all structure is taken out.
    pub residual_freedom: f64,
    /// chi-square less what noise of scale c explains: how much structure the residuals hold, in units of c.
    pub excess: f64,
    /// Columns of groups looked at, and what is most its own in those whose groups differ ([`super::by_group`]).
    #[serde(default)]
    pub columns_of_groups: usize,
    #[serde(default)]
    pub by_group: Vec<GroupMisfit>,
    /// One simple term that explains what all smooth corrections together do not show ([`super::lone_term`]).
    #[serde(default)]
    pub lone_term: Option<LoneTerm>,
    pub seed: u64,
}

impl StructureTest {
    /// The noise scale for judging single effects. When no structure shows, all residuals are noise, and all of them
    /// together tell its scale best: with few impacts c alone rests on what a hundred generic terms have left over.
    pub fn noise_scale_for_screening(&self) -> f64 {
        if self.p_value > 0.05 { self.noise_scale_of_all().max(SMALLEST_SCALE) } else { self.noise_scale }
    }

    fn noise_scale_of_all(&self) -> f64 {
        (self.statistic + self.residual_chi2) / (self.rank as f64 + self.residual_freedom)
    }
}

/// Dimensionless inputs of an impact, as features and words use them.
#[derive(Debug, Clone, Copy)]
pub struct ContactInputs {
    /// Approach speed along the normal, m/s.
    pub approach_m_s: f64,
    /// Tangential velocity of the ball's contact point relative to the strings (spin included), x and y, m/s.
    pub slip_m_s: [f64; 2],
    /// Tangential velocity of the ball's centre relative to the impact point, x and y, m/s.
    pub tangential_m_s: [f64; 2],
    /// +1 when the ball arrives from +z.
    pub side: f64,
}

impl ContactInputs {
    pub fn of(x: &Inputs, gear: &Gear) -> Self {
        let ball = Vector3::new(x[0], x[1], x[2]);
        let spin = Vector3::new(x[3], x[4], x[5]);
        let racket = Vector3::new(x[6], x[7], x[8]);
        let rate = Vector3::new(x[9], x[10], x[11]);
        let lever = Vector3::new(x[12], x[13], 0.0) - gear.racket.com_local().coords;
        let relative = ball - racket - rate.cross(&lever);
        let side = if relative.z < 0.0 { 1.0 } else { -1.0 };
        let contact = spin.cross(&Vector3::new(0.0, 0.0, -side * gear.ball.radius_m()));
        ContactInputs {
            approach_m_s: relative.z.abs(),
            slip_m_s: [relative.x + contact.x, relative.y + contact.y],
            tangential_m_s: [relative.x, relative.y],
            side,
        }
    }
}

/// How many there are; the order of [`features`].
const FEATURES: usize = 22;
/// The racket's rate among them.
const SWING: usize = 11;

/// Raw features of one impact: 1, v, v², X, Y, X², Y², |G|, |S|, torque, order, swing, G_x, G_y, S_x, S_y, S_z, XY, Y·torque, spin size,
/// vX, vY.
fn features(o: &Observation, x: &Inputs, gear: &Gear) -> [f64; FEATURES] {
    let x = &o.without_unmeasured(x);
    let contact = ContactInputs::of(x, gear);
    let v = contact.approach_m_s.max(1.0);
    let r = gear.ball.radius_m();
    let (lx, ly) = (0.5 * gear.racket.head.inner_length_m, 0.5 * gear.racket.head.inner_width_m);
    let (px, py) = (x[12] / lx, x[13] / ly);
    let g = contact.slip_m_s.map(|s| s / v);
    let s = [x[3] * r / v, x[4] * r / v, x[5] * r / v];
    let swing = (x[9] * x[9] + x[10] * x[10] + x[11] * x[11]).sqrt();
    [
        1.0,
        v,
        v * v,
        px,
        py,
        px * px,
        py * py,
        g[0].hypot(g[1]),
        s[0].hypot(s[1]),
        x[14],
        o.order,
        swing,
        g[0],
        g[1],
        s[0],
        s[1],
        s[2],
        px * py,
        py * x[14],
        x[3].hypot(x[4]) * r,
        v * px,
        v * py,
    ]
}

/// The features of all impacts of the fit.
fn features_of_all(fit: &Fit, observations: &Observations, impacts: &[&Observation]) -> Vec<[f64; FEATURES]> {
    fit.impacts.iter().zip(impacts).map(|(l, o)| features(o, &l.true_inputs, &observations.gear[o.gear])).collect()
}

/// Responses of the 13 outputs to a unit of each channel; columns: normal, slip, across, x, y, spin n, spin slip, spin x,
/// spin y, racket impulse z, x, y, racket angular impulse x, y, z; what a blow on the other face reverses is taken along its own normal.
pub(super) fn channels(x: &Inputs, gear: &Gear) -> DMatrix<f64> {
    let contact = ContactInputs::of(x, gear);
    let n = contact.side;
    let (m, big_m) = (gear.ball.mass_kg, gear.racket.mass_kg);
    let (r, ball_inertia, inertia) = (gear.ball.radius_m(), gear.ball.inertia_kg_m2(), gear.racket.inertia_kg_m2());
    let lever = Vector3::new(x[12], x[13], 0.0) - gear.racket.com_local().coords;
    let length = contact.slip_m_s[0].hypot(contact.slip_m_s[1]).max(0.5);
    let slip = Vector3::new(contact.slip_m_s[0] / length, contact.slip_m_s[1] / length, 0.0);
    let across = Vector3::new(-slip.y, slip.x, 0.0);
    // Everything in parts of the normal impulse of a perfectly plastic contact: features then say "restitution changes by".
    let scale = contact.approach_m_s / (1.0 / m + 1.0 / big_m + lever.x * lever.x / inertia.y + lever.y * lever.y / inertia.x);
    let impulse = |j: Vector3<f64>| {
        let j = j * scale;
        let spin = Vector3::new(0.0, 0.0, -n * r).cross(&j) / ball_inertia;
        let turn = -lever.cross(&j).component_div(&inertia);
        [j / m, spin, -j / big_m, turn]
    };
    let none = Vector3::zeros();
    let about = |w: Vector3<f64>| [none, w * scale / ball_inertia, none, none];
    let columns = [
        impulse(Vector3::z() * n),
        impulse(slip),
        impulse(across),
        impulse(Vector3::x()),
        impulse(Vector3::y()),
        about(Vector3::z() * r),
        about(across * r),
        about(Vector3::x() * r),
        about(Vector3::y() * r),
        [none, none, Vector3::z() * n * scale / big_m, none],
        [none, none, Vector3::x() * scale / big_m, none],
        [none, none, Vector3::y() * scale / big_m, none],
        [none, none, none, Vector3::x() * n * scale / inertia.x * 0.1],
        [none, none, none, Vector3::y() * n * scale / inertia.y * 0.1],
        [none, none, none, Vector3::z() * scale / inertia.z * 0.1],
    ];
    DMatrix::from_fn(13, columns.len(), |row, c| if row < 12 { columns[c][row / 3][row % 3] } else { 0.0 })
}

/// Which features go with which channel: smooth, of the symmetry a mechanism could have.
const TERMS: [(usize, &[usize]); 15] = [
    (0, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 16, 17, 19, 20, 21]),
    (1, &[0, 1, 5, 6, 7, 8, 9, 10, 19]),
    (2, &[0, 1, 7, 16]),
    (3, &[0, 1, 3, 4, 12, 13, 14, 15, 16]),
    (4, &[0, 1, 3, 4, 12, 13, 14, 15, 16]),
    (5, &[0, 3, 4, 12, 13, 16]),
    (6, &[0, 1, 5, 6, 7, 8]),
    (7, &[0, 1, 3, 4, 12, 13, 14, 15]),
    (8, &[0, 1, 3, 4, 12, 13, 14, 15]),
    (9, &[0, 1, 3, 4, 5, 6, 9, 10]),
    (10, &[0, 1, 3, 4, 12, 13]),
    (11, &[0, 1, 3, 4, 12, 13]),
    (12, &[0, 1, 3, 4, 5, 6, 10, 18]),
    (13, &[0, 1, 3, 4, 5, 6]),
    (14, &[0, 1, 3, 4, 12, 13]),
];

/// Middles of the places on the face, in half lengths and half widths, whose own impulse along the normal is tested: a dead
/// spot is not smooth.
const SPOTS_ALONG: [f64; 5] = [-0.7, -0.35, 0.0, 0.35, 0.7];
const SPOTS_ACROSS: [f64; 3] = [-0.5, 0.0, 0.5];
/// Radius of such a place, m.
const SPOT_M: f64 = 0.035;
/// Impacts that a place must hold, and impacts of a table that has places.
const FEWEST_IN_SPOT: f64 = 4.0;
const FEWEST_FOR_SPOTS: usize = 100;

/// Half swings over the whole table of an impulse along the normal that wanders with the order of the impacts (warmth,
/// another stringing); its steady drift is among the features. Tables large enough for places have them.
const HALF_SWINGS: [f64; 5] = [2.0, 3.0, 4.0, 5.0, 6.0];

/// Angles by which these turn from one impact to the next, rad: the impact's own is cos(angle · order). None of a table that
/// has no order or is too small.
pub fn swings_in_order(impacts: &[&Observation]) -> Vec<f64> {
    let last = impacts.iter().map(|o| o.order).fold(0.0, f64::max);
    let told = impacts.len() >= FEWEST_FOR_SPOTS && last > 0.0;
    HALF_SWINGS.iter().filter(|_| told).map(|half| std::f64::consts::PI * half / last).collect()
}

/// Whether the racket turns before its impacts by more than the noise of its rate as it is stated, and by more than what a rate is told to: that of one
/// that hangs still is no input to depend on. `sd`: of the rate's size over the impacts, rad/s.
pub fn racket_turns(observations: &Observations, sd: f64) -> bool {
    let noise = observations.usual_input_sd();
    sd > (noise[9] * noise[9] + noise[10] * noise[10] + noise[11] * noise[11]).sqrt().max(LEAST_TURNING)
}

/// How far each impact belongs to each place; places with hardly any impacts are left out.
fn spots(fit: &Fit, observations: &Observations, impacts: &[&Observation]) -> Vec<Vec<f64>> {
    let Some(head) = observations.gear.first().map(|g| &g.racket.head) else { return Vec::new() };
    if impacts.len() < FEWEST_FOR_SPOTS {
        return Vec::new();
    }
    let middles = SPOTS_ALONG.iter().flat_map(|x| SPOTS_ACROSS.iter().map(move |y| (0.5 * x * head.inner_length_m, 0.5 * y * head.inner_width_m)));
    middles
        .map(|(x, y)| fit.impacts.iter().map(|l| (-((l.true_inputs[12] - x).powi(2) + (l.true_inputs[13] - y).powi(2)) / (SPOT_M * SPOT_M)).exp()).collect())
        .filter(|shares: &Vec<f64>| shares.iter().sum::<f64>() > FEWEST_IN_SPOT)
        .collect()
}

/// What the friction that sliding balls feel may go with: feature of [`features`] or the slip's direction.
const FRICTION_GOES_WITH: [usize; 6] = [1, 3, 4, 7, 8, 10];
/// Sliding balls that must tell the friction, in effect.
const FEWEST_SLIDING: f64 = 8.0;

/// Whitened derivatives of each impact's prediction by the logarithm of the friction: few balls slide, and what they alone do differently
/// an impulse that all have in part does not show. `None` where the friction is not free or hardly any ball tells it.
pub(super) fn friction_slope(fit: &Fit) -> Option<Vec<DVector<f64>>> {
    let parameter = fit.names.iter().position(|n| n == "friction" || n == "mu")?;
    let column = fit.column_of(parameter)?;
    let slope: Vec<DVector<f64>> = fit.design.iter().map(|a| a.column(column) * fit.values[parameter]).collect();
    (effective(slope.iter().map(|s| s.norm_squared())) >= FEWEST_SLIDING).then_some(slope)
}

/// How many impacts of equal weight would carry as much.
pub(super) fn effective(weights: impl Iterator<Item = f64>) -> f64 {
    let (sum, squares) = weights.fold((0.0, 0.0), |(s, q), w| (s + w, q + w * w));
    if squares > 0.0 { sum * sum / squares } else { 0.0 }
}

/// Whitened signatures of a friction that goes with what the sliding balls differ by; no columns where nothing tells it.
fn friction_signatures(fit: &Fit, raw: &[[f64; FEATURES]]) -> Vec<DMatrix<f64>> {
    let Some(slope) = friction_slope(fit) else { return fit.impacts.iter().map(|l| DMatrix::zeros(l.z.len(), 0)).collect() };
    let weights: Vec<f64> = slope.iter().map(|s| s.norm_squared()).collect();
    let total: f64 = weights.iter().sum();
    // The slip's direction, from across the face to along it: strings slide on each other one way only.
    let direction = |f: &[f64; FEATURES]| (f[12] * f[12] - f[13] * f[13]) / (f[12] * f[12] + f[13] * f[13]).max(1e-12);
    let mut columns: Vec<Vec<f64>> = FRICTION_GOES_WITH.iter().map(|&k| raw.iter().map(|f| f[k]).collect()).collect();
    columns.push(raw.iter().map(direction).collect());
    columns.retain_mut(|values| {
        let mean = values.iter().zip(&weights).map(|(v, w)| v * w).sum::<f64>() / total;
        let sd = (values.iter().zip(&weights).map(|(v, w)| w * (v - mean).powi(2)).sum::<f64>() / total).sqrt();
        values.iter_mut().for_each(|v| *v = (*v - mean) / sd.max(1e-300));
        sd > 1e-9 * (1.0 + mean.abs())
    });
    slope.iter().enumerate().map(|(i, s)| s * RowDVector::from_iterator(columns.len(), columns.iter().map(|c| c[i]))).collect()
}

/// Standardised smooth features by which an effect's form may differ from the catalogue's: speed, place, obliqueness, spin.
/// One row per impact; constants are left out.
pub fn form_features(fit: &Fit, observations: &Observations, impacts: &[&Observation]) -> DMatrix<f64> {
    const FORM: [usize; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 17, 19];
    let raw = features_of_all(fit, observations, impacts);
    let n = raw.len();
    let mut columns: Vec<DVector<f64>> = Vec::new();
    for f in FORM {
        let column = DVector::from_iterator(n, raw.iter().map(|r| r[f]));
        let mean = column.mean();
        let sd = column.variance().sqrt();
        if sd > 1e-9 * (1.0 + mean.abs()) {
            columns.push((column.add_scalar(-mean)) / sd);
        }
    }
    if columns.is_empty() { DMatrix::zeros(n, 0) } else { DMatrix::from_columns(&columns) }
}

/// Whitened signatures of all generic corrections, one outputs × terms block per impact of the fit.
pub fn generic_signatures(fit: &Fit, observations: &Observations, impacts: &[&Observation]) -> Vec<DMatrix<f64>> {
    let raw = features_of_all(fit, observations, impacts);
    let n = raw.len() as f64;
    let mut mean = [0.0; FEATURES];
    let mut sd = [0.0; FEATURES];
    for f in 1..FEATURES {
        mean[f] = raw.iter().map(|r| r[f]).sum::<f64>() / n;
        sd[f] = (raw.iter().map(|r| (r[f] - mean[f]).powi(2)).sum::<f64>() / n).sqrt();
    }
    let varies = |f: usize| f == 0 || sd[f] > 1e-9 * (1.0 + mean[f].abs()) && (f != SWING || racket_turns(observations, sd[f]));
    // Few impacts cannot carry the curved features of every channel.
    let short = raw.len() < 60;
    let terms: Vec<(usize, usize)> = TERMS
        .iter()
        .flat_map(|(c, list)| list.iter().map(move |f| (*c, *f)))
        .filter(|(c, f)| varies(*f) && (!short || *c == 0 || matches!(f, 0 | 1 | 3 | 4 | 7 | 12 | 13)))
        .collect();
    let mut rebounds = spots(fit, observations, impacts);
    rebounds.extend(swings_in_order(impacts).iter().map(|angle| impacts.iter().map(|o| (angle * o.order).cos()).collect()));
    let friction = friction_signatures(fit, &raw);
    fit.impacts
        .iter()
        .zip(impacts)
        .zip(&raw)
        .enumerate()
        .map(|(i, ((l, o), feature))| {
            // The slip's direction too goes by what was measured: one that an unmeasured spin, told by the outputs, turns meets its own noise.
            let response = channels(&o.without_unmeasured(&l.true_inputs), &observations.gear[o.gear]);
            let mut block = DMatrix::zeros(l.measured.len(), terms.len() + rebounds.len());
            let v = feature[1];
            for (column, share) in rebounds.iter().enumerate() {
                for (row, &output) in l.measured.iter().enumerate() {
                    block[(row, terms.len() + column)] = response[(output, 0)] * share[i] * v / mean[1].max(1.0);
                }
            }
            for (column, (c, f)) in terms.iter().enumerate() {
                let value = if *f == 0 { 1.0 } else { (feature[*f] - mean[*f]) / sd[*f] };
                for (row, &output) in l.measured.iter().enumerate() {
                    block[(row, column)] = response[(output, *c)] * value;
                }
            }
            beside(&(&l.whitener * block), &friction[i])
        })
        .collect()
}

/// What a structure test looks at beside the smooth corrections.
#[derive(Clone, Copy)]
pub enum BesideSmooth<'a> {
    /// Every column of groups, and every single term.
    All,
    /// These columns, whose groups get terms of their own, and this single term: an earlier fit failed by them.
    Known { groups: &'a [GroupMisfit], lone_term: Option<LoneTerm> },
}

/// The structure test of a fit.
pub fn structure_test(fit: &Fit, observations: &Observations, impacts: &[&Observation], beside_smooth: BesideSmooth, seed: u64) -> StructureTest {
    let (known_groups, known_term) = match beside_smooth {
        BesideSmooth::All => (None, None),
        BesideSmooth::Known { groups, lone_term } => (Some(groups), lone_term),
    };
    let mut signatures = generic_signatures(fit, observations, impacts);
    let GroupTest { tested: columns_of_groups, failing } = group_test(fit, observations, impacts, &signatures, known_groups, seed);
    let mut by_group = Vec::new();
    for (misfit, blocks) in failing {
        signatures = signatures.iter().zip(&blocks).map(|(own, more)| beside(own, more)).collect();
        by_group.push(misfit);
    }
    let with = |signatures: &[DMatrix<f64>], lone: Option<LoneTerm>| match lone {
        Some(term) => signatures.iter().zip(term.signature(fit, observations, impacts)).map(|(own, more)| beside(own, &more)).collect(),
        None => signatures.to_vec(),
    };
    let mut test = StructureTest { lone_term: known_term, columns_of_groups, ..of_signatures(fit, &with(&signatures, known_term), seed) };
    if is_exact(fit) {
        return test;
    }
    if let BesideSmooth::All = beside_smooth {
        test.p_value = by_group.iter().map(|g: &GroupMisfit| g.p_value).fold(test.p_value, f64::min);
        if test.p_value >= STRUCTURE_LEVEL
            && let Some(lone) = lone_term(fit, observations, impacts, test.noise_scale_of_all())
        {
            let with_it = of_signatures(fit, &with(&signatures, Some(lone)), seed);
            test = StructureTest { p_value: lone.p_value, lone_term: Some(lone), columns_of_groups, ..with_it };
        }
    }
    StructureTest { by_group, ..test }
}

/// What a table misses by no more than rounding has no structure.
fn is_exact(fit: &Fit) -> bool {
    fit.chi2 + fit.prior_residual().norm_squared() < EXACT * fit.count() as f64
}

/// The test of given corrections.
fn of_signatures(fit: &Fit, signatures: &[DMatrix<f64>], seed: u64) -> StructureTest {
    let projected = project(fit, signatures);
    let directions = independent_directions(&projected);
    let q = directions.ncols();
    let parts = &projected.contributions * &directions;
    let statistic = parts.row_sum().norm_squared();
    let prior_terms = fit.prior_precision.iter().filter(|p| **p > 0.0).count();
    let chi2 = fit.chi2 + fit.prior_residual().norm_squared();
    let dof = (fit.count() + prior_terms) as f64 - fit.columns.len() as f64;
    let residual_freedom = (dof - q as f64).max(1.0);
    let residual_chi2 = (chi2 - statistic).max(0.0);
    let (noise_scale, noise_by_group) = noise_by_group(fit, &projected, &directions, &parts.row_sum().transpose(), residual_chi2 / residual_freedom);
    let p_value = if is_exact(fit) { 1.0 } else { wild_p_value(&parts, statistic, seed) };
    let excess = (statistic / noise_scale - q as f64).max(0.0);
    StructureTest {
        statistic,
        rank: q,
        p_value,
        noise_scale,
        noise_by_group,
        residual_chi2,
        residual_freedom,
        excess,
        columns_of_groups: 0,
        by_group: Vec::new(),
        lone_term: None,
        seed,
    }
}

/// What smooth corrections find beyond `nuisance`: the excess over what noise of scale `c` gives them, and its p-value.
pub fn structure_beyond(fit: &Fit, observations: &Observations, impacts: &[&Observation], nuisance: &Nuisance, c: f64, seed: u64) -> (f64, f64) {
    let projected = project_out(fit, nuisance, &generic_signatures(fit, observations, impacts));
    let directions = independent_directions(&projected);
    let parts = &projected.contributions * &directions;
    let statistic = parts.row_sum().norm_squared();
    ((statistic / c - directions.ncols() as f64).max(0.0), wild_p_value(&parts, statistic, seed))
}

/// Directions in the space of the terms, terms × rank, along which the projected scores are independent with variance one.
pub(super) fn independent_directions(projected: &Projected) -> DMatrix<f64> {
    let m = projected.score.len();
    let root: Vec<f64> = (0..m).map(|i| projected.information[(i, i)].max(1e-300).sqrt()).collect();
    let scaled = DMatrix::from_fn(m, m, |i, j| {
        // Terms that the nuisance absorbs (below a millionth of what they were) say nothing.
        let told = projected.information[(i, i)] > 1e-6 * projected.raw[i] && projected.information[(j, j)] > 1e-6 * projected.raw[j];
        if told { projected.information[(i, j)] / (root[i] * root[j]) } else { 0.0 }
    });
    let eigen = scaled.symmetric_eigen();
    let kept: Vec<usize> = (0..m).filter(|&i| eigen.eigenvalues[i] > 1e-6).collect();
    let mut directions = DMatrix::zeros(m, kept.len());
    for (column, &i) in kept.iter().enumerate() {
        let scale = 1.0 / eigen.eigenvalues[i].sqrt();
        for row in 0..m {
            directions[(row, column)] = eigen.eigenvectors[(row, i)] * scale / root[row];
        }
    }
    directions
}

/// Noise scale of all measured numbers and of each group, when the terms along `directions` (of which they hold `amounts`) are
/// taken out.
fn noise_by_group(fit: &Fit, projected: &Projected, directions: &DMatrix<f64>, amounts: &DVector<f64>, common: f64) -> (f64, Vec<GroupNoise>) {
    // Sum of squares, degrees of freedom, numbers.
    let mut groups = [(0.0, 0.0, 0usize); GROUPS.len()];
    for (i, l) in fit.impacts.iter().enumerate() {
        let terms = projected.left(i) * directions;
        let left = &l.z - &terms * amounts;
        let by_fit = &fit.design[i] * &fit.covariance;
        for (row, &output) in l.measured.iter().enumerate() {
            let leverage = terms.row(row).norm_squared() + by_fit.row(row).dot(&fit.design[i].row(row));
            if let Some(group) = GROUPS.iter().position(|g| OUTPUTS[output].starts_with(g)) {
                groups[group].0 += left[row] * left[row];
                groups[group].1 += (1.0 - leverage).max(0.0);
                groups[group].2 += 1;
            }
        }
    }
    let numbers: usize = groups.iter().map(|g| g.2).sum();
    let known: Vec<GroupNoise> = GROUPS
        .iter()
        .zip(groups)
        .filter(|(_, g)| g.2 > 0)
        .map(|(name, (squares, freedom, _))| GroupNoise {
            outputs: (*name).to_owned(),
            scale: (squares + COMMON_WORTH * common) / (freedom + COMMON_WORTH),
            freedom,
        })
        .collect();
    let sum: f64 = known.iter().zip(groups.iter().filter(|g| g.2 > 0)).map(|(k, g)| k.scale * g.2 as f64).sum();
    ((sum / numbers.max(1) as f64).max(SMALLEST_SCALE), known)
}

/// Tail of |Σ ±s_i|² over random signs, as a scaled chi-square with the draws' mean and variance.
pub(super) fn wild_p_value(parts: &DMatrix<f64>, statistic: f64, seed: u64) -> f64 {
    let (n, q) = parts.shape();
    if q == 0 || n == 0 {
        return 1.0;
    }
    let mut generator = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let by_impact = parts.transpose();
    let mut draws = Vec::with_capacity(DRAWS);
    for _ in 0..DRAWS {
        let mut sum = DVector::zeros(q);
        for i in 0..n {
            sum.axpy(if generator.random::<bool>() { 1.0 } else { -1.0 }, &by_impact.column(i), 1.0);
        }
        draws.push(sum.norm_squared());
    }
    let mean = draws.iter().sum::<f64>() / DRAWS as f64;
    let variance = draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (DRAWS - 1) as f64;
    if !(variance > 0.0) {
        return 1.0;
    }
    let freedom = 2.0 * mean * mean / variance;
    chi2_tail(statistic * freedom / mean, freedom)
}

/// A p-value as people write it.
pub fn p_text(p: f64) -> String {
    if p < 1e-4 { "p < 0.0001".to_owned() } else { format!("p = {}", format!("{p:.2}").replace("0.00", &format!("{p:.4}"))) }
}

/// Whether a noise floor may be lower than it is given.
pub fn is_least_floor(floor: f64) -> bool {
    floor * floor <= SMALLEST_SCALE * (1.0 + 1e-9)
}

/// A noise floor as people read it: below a half it is not followed.
pub fn floor_text(floor: f64) -> String {
    format!("{floor:.2}{}", if is_least_floor(floor) { " or less" } else { "" })
}

/// A probability in per cent as people write it: never certain.
pub fn probability_text(p: f64) -> String {
    match p {
        p if p > 0.995 => "above 99 %".to_owned(),
        p if p < 0.005 => "below 1 %".to_owned(),
        p => format!("{:.0} %", 100.0 * p),
    }
}
