//! The ball's centre in one image, from its outline alone.
//!
//! A ball is a sphere of known size, so its outline is a circle of known radius. Around that circle every sector has its
//! own grey levels, one for the surroundings and one for the ball; only how the ball brightens inward from its limb is
//! common ([`crate::tracking::ball::ball_shading`]). Each sector then says how far out the outline lies, and the centre is what most
//! sectors agree on: drawn lines, panels of another colour, strings and the frame spoil a few sectors, not the centre.
//!
//! (Tried and left: nine spherical harmonics for the whole disc, which drawn lines pulled by up to 1 px; free brightening
//! in every sector, 0.25 px; a ring wider than 2 px inside, where the panels' borders are.)

use crate::footage::GreyView;
use crate::tracking::ball::ball_ring::{BallRing, DIRECTIONS, RingModel, SectorFits};
use crate::tracking::ball::ball_shading::{LimbProfile, SECTORS};
use nalgebra::{Matrix2, Vector2};
use std::cell::RefCell;
use std::sync::LazyLock;

/// Fewest sectors that the picture's border must leave.
const FEWEST_SEEN: f64 = 10.0;
const ROUNDS: usize = 10;
/// From this round on sectors that disagree count less.
const ROBUST_FROM: usize = 3;
/// What one sector is good to beyond its noise, px: lines and panels that touch the outline.
const SECTOR_SD_PX: f64 = 0.12;
/// Of a cut ball: what the whole outline may be thought too far out or in, px. A whole ball's opposite sectors cancel it.
const RADIUS_SD_PX: f64 = 0.15;
/// Rounds of the sectors' agreement end where the shift changes by less, px.
const AGREED_PX: f64 = 1e-4;
/// Tukey's limit, in deviations.
const TUKEY: f64 = 4.0;

/// The ball in one image.
#[derive(Debug, Clone)]
pub struct BallFit {
    /// Projected centre, px.
    pub uv: Vector2<f64>,
    /// From the scatter of the sectors, px².
    pub covariance: Matrix2<f64>,
    /// Share of the sectors that see the outline (to 0.4 px) and agree with the centre.
    pub outline: f64,
    /// Median over sectors of the root-mean-square residual, grey levels.
    pub residual: f64,
    /// Mean absolute difference of ball and surroundings just inside the outline, grey levels.
    pub edge: f64,
    /// What a fit to the same picture may begin with.
    pub outline_as_seen: OutlineLevels,
}

/// Grey levels of every sector, surroundings and ball, and residuals beyond which a pixel counts less.
#[derive(Debug, Clone, Copy)]
pub struct OutlineLevels {
    levels: [[f32; 2]; SECTORS],
    scale: f32,
}

thread_local! {
    static RING: RefCell<BallRing> = RefCell::default();
}

/// Fits the centre, starting at `start` and with the levels of an earlier fit there if there was one, until a step is below `settled_px`. `None` when the ball leaves the picture, the fit runs away, or the picture does
/// not determine the centre.
pub fn fit(image: &GreyView, start: Vector2<f64>, radius_px: f64, profile: &LimbProfile, settled_px: f64, before: Option<&OutlineLevels>) -> Option<BallFit> {
    RING.with_borrow_mut(|ring| fit_in(ring, image, start, radius_px, profile, settled_px, before, false))
}

/// [`fit`] of a ball of which the picture's border may cut some off: from the sectors that it holds.
pub fn fit_cut(image: &GreyView, start: Vector2<f64>, radius_px: f64, profile: &LimbProfile, settled_px: f64) -> Option<BallFit> {
    RING.with_borrow_mut(|ring| fit_in(ring, image, start, radius_px, profile, settled_px, None, true))
}

fn fit_in(
    ring: &mut BallRing,
    image: &GreyView,
    start: Vector2<f64>,
    radius_px: f64,
    profile: &LimbProfile,
    settled_px: f64,
    before: Option<&OutlineLevels>,
    cut: bool,
) -> Option<BallFit> {
    if !(2.5..200.0).contains(&radius_px) {
        return None;
    }
    let directions = &*DIRECTIONS;
    ring.reset(radius_px);
    let mut centre = start;
    let mut levels = before.map_or([[0.0; 2]; SECTORS], |b| b.levels.map(|l| l.map(f64::from)));
    let mut scale = before.map_or(f64::INFINITY, |b| f64::from(b.scale));
    // The first rounds find levels and place roughly: both are known where the picture has been measured before.
    for round in if before.is_some() { ROBUST_FROM } else { 0 }..ROUNDS {
        let sectors = ring.round(image, &RingModel { centre, profile, levels: &levels, scale }, cut)?;
        let seen = sectors.seen.iter().sum::<f64>();
        if seen < FEWEST_SEEN {
            return None;
        }
        let mut settle = |step: &Vector2<f64>| {
            for (k, (levels, u)) in levels.iter_mut().zip(directions).enumerate() {
                let outward = u.dot(step);
                for (i, level) in levels.iter_mut().enumerate() {
                    *level += sectors.change[i][k] - sectors.less_per_px[i][k] * outward;
                }
            }
        };
        if round == 0 {
            settle(&Vector2::zeros());
            continue;
        }
        // Those of cut sectors come last.
        let mut variances: [f64; SECTORS] = std::array::from_fn(|k| if sectors.seen[k] > 0.0 { sectors.variance[k] } else { f64::INFINITY });
        let usual = variances.select_nth_unstable_by(seen as usize / 2, f64::total_cmp).1.max(0.25);
        let agreed = pulp::Arch::new().dispatch(Agreement { sectors: &sectors, usual, tukey: if round < ROBUST_FROM { f64::INFINITY } else { TUKEY } })?;
        let step = agreed.shift.map(|v| v.clamp(-1.0, 1.0));
        centre += step;
        if (centre - start).norm() > 0.8 * radius_px || !centre.norm().is_finite() {
            return None;
        }
        settle(&step);
        scale = (2.0 * usual.sqrt()).max(1.0);
        if round > ROBUST_FROM && step.norm() < settled_px || round + 1 == ROUNDS {
            let outline_as_seen = OutlineLevels { levels: levels.map(|l| l.map(|v| v as f32)), scale: scale as f32 };
            // A lit ball is dark on one side.
            let inside = |sector: usize| profile.at(-1.0, sector).map_or(1.0, |l| f64::from(l.ball));
            let edge = levels.iter().enumerate().map(|(k, l)| sectors.seen[k] * (l[1] * inside(k) - l[0]).abs()).sum::<f64>() / seen;
            return Some(BallFit {
                uv: centre,
                covariance: agreed.covariance + of_radius(&sectors.seen),
                outline: agreed.share,
                residual: usual.sqrt(),
                edge,
                outline_as_seen,
            });
        }
    }
    None
}

/// What a radius thought too large or too small adds to the covariance of a cut ball's centre, px².
fn of_radius(seen: &[f64; SECTORS]) -> Matrix2<f64> {
    if seen.iter().all(|s| *s > 0.0) {
        return Matrix2::zeros();
    }
    let directions = || seen.iter().zip(&*DIRECTIONS);
    let (outward, turned) = directions().fold((Vector2::zeros(), Matrix2::zeros()), |(v, m), (s, u)| (v + u * *s, m + u * u.transpose() * *s));
    let per_px = turned.try_inverse().map_or_else(Vector2::zeros, |inverse| inverse * outward);
    per_px * per_px.transpose() * (RADIUS_SD_PX * RADIUS_SD_PX)
}

struct Agreed {
    shift: Vector2<f64>,
    covariance: Matrix2<f64>,
    share: f64,
}

struct Agreement<'a> {
    sectors: &'a SectorFits,
    /// Mean square of the residuals in half of the sectors.
    usual: f64,
    tukey: f64,
}

impl pulp::NullaryFnOnce for Agreement<'_> {
    type Output = Option<Agreed>;

    #[inline(always)]
    fn call(self) -> Option<Agreed> {
        agree(self.sectors, self.usual, self.tukey)
    }
}

/// The shift most sectors agree on.
#[inline(always)]
fn agree(sectors: &SectorFits, usual: f64, tukey: f64) -> Option<Agreed> {
    let (across, down) = &*DIRECTIONS_APART;
    let (mut precision, mut per_sd, mut sure) = ([0.0; SECTORS], [0.0; SECTORS], [0.0; SECTORS]);
    for k in 0..SECTORS {
        // The noise is the same everywhere: no sector is trusted beyond what half of them show.
        let variance = sectors.variance[k].max(usual) / sectors.information[k] + SECTOR_SD_PX * SECTOR_SD_PX;
        precision[k] = 1.0 / variance;
        per_sd[k] = precision[k].sqrt();
        sure[k] = if variance < 0.16 { 1.0 } else { 0.0 };
    }
    let mut shift = Vector2::<f64>::zeros();
    let mut out: Option<Agreed> = None;
    // Without a limit all count the same, and the first round is the answer.
    for round in 0..if tukey.is_infinite() { 1 } else { 5 } {
        let mut terms = [[0.0; SECTORS]; 8];
        for k in 0..SECTORS {
            let (d, x, y) = (sectors.outward[k], across[k], down[k]);
            let z = (d - (x * shift.x + y * shift.y)) * per_sd[k];
            let kept = (1.0 - (z / tukey) * (z / tukey)).max(0.0);
            let w = if round == 0 { sectors.seen[k] } else { sectors.seen[k] * kept * kept };
            let p = w * precision[k];
            let good = if z.abs() < 2.5 { sectors.seen[k] * sure[k] } else { 0.0 };
            let of_sector = [p * x * x, p * x * y, p * y * y, p * d * x, p * d * y, w * z * z, w, good];
            for i in 0..8 {
                terms[i][k] = of_sector[i];
            }
        }
        let mut sums = [0.0; 8];
        for i in 0..8 {
            sums[i] = total(&terms[i]);
        }
        let [xx, xy, yy, gx, gy, chi, weight, good] = sums;
        let inverse = Matrix2::new(xx, xy, xy, yy).try_inverse()?;
        let next = inverse * Vector2::new(gx, gy);
        // The scatter of the sectors corrects their stated deviations, upward only.
        let scatter = (chi / (weight - 2.0).max(1.0)).max(1.0);
        out = Some(Agreed { shift: next, covariance: inverse * scatter, share: good / SECTORS as f64 });
        if round > 0 && (next - shift).amax() < AGREED_PX {
            break;
        }
        shift = next;
    }
    out.filter(|o| o.covariance[(0, 0)] > 0.0 && o.covariance[(1, 1)] > 0.0 && o.covariance.norm().is_finite())
}

/// The sum over all sectors, in an order that suits wide registers.
#[inline(always)]
fn total(terms: &[f64; SECTORS]) -> f64 {
    let (mut eight, mut four) = ([0.0; 8], [0.0; 4]);
    for l in 0..8 {
        eight[l] = terms[l] + terms[l + 8] + terms[l + 16];
    }
    for l in 0..4 {
        four[l] = eight[l] + eight[l + 4];
    }
    (four[0] + four[2]) + (four[1] + four[3])
}

/// [`DIRECTIONS`], across and down.
static DIRECTIONS_APART: LazyLock<([f64; SECTORS], [f64; SECTORS])> = LazyLock::new(|| (DIRECTIONS.map(|u| u.x), DIRECTIONS.map(|u| u.y)));
