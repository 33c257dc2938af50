//! Which of the rates the search has found is the ball's, and whether it clearly is.

use super::registration::{Effort, Registrar, Registration};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Least lead over a rival behind a barrier, as a share of what the markings explain; twice that for a best solution that
/// stands still. Measured (docs/spin-experiments.md, "Rivals"): a line that slides along itself leads by up to 0.18 where it stands
/// still; two lines or dots lead by more than 0.3 over the nearest true rival.
const LEAST_LEAD: f64 = 0.2;
/// Least lead over a rival that is far away, barrier or not: one wrong spin in footage led by 0.07.
const LEAST_FAR_LEAD: f64 = 0.1;
/// Rise of the cost on the way to a rival that makes it one of its own.
const BARRIER: f64 = 0.015;
/// Axes about which a ball that seems to stand still is turned: one in 0.25 rad, twice the width of a blurred line.
const PROBES: u32 = 100;
/// What a fit on the best one's slope, that has not arrived after as many steps, tells of how flat their valley is: squared distance, this
/// share of it where it is as good, a quarter of that where it is behind by `FLAT_LEAD` of what the markings explain. Rendered sessions, and
/// balls with a single line by another renderer (docs/spin-experiments.md, "Flat valleys").
const FLAT_SHARE: f64 = 0.3;
const FLAT_LEAD: f64 = 0.02;
/// Turn over the window within which another candidate lies in the same valley, rad.
pub(super) const SAME_VALLEY: f64 = 0.4;
/// Candidates that are registered.
const CONTESTANTS: usize = 4;
/// Which candidate: a coarse map without blur.
const COARSE: Effort = Effort { steps: 4, last_step_rad_s: 0.5, light: false, memory_s: 0.0 };

/// The best candidate and its strongest rival.
#[derive(Debug, Clone)]
pub(super) struct Contest {
    pub omega: Vector3<f64>,
    /// A rival that cannot be ruled out.
    pub rival: Option<Vector3<f64>>,
    /// Other candidates in the same valley, best first.
    pub near: Vec<Vector3<f64>>,
    /// Covariance along the valley, where another fit stands on the best one's slope.
    pub flat: Matrix3<f64>,
    /// Lead over the rival in log-likelihood, as a share of what the markings explain.
    pub margin: Option<f64>,
}

/// Whether a solution hardly moves the markings; everything that stands still favours it: shading, strings, dirt.
pub(super) fn stands_still(omega: &Vector3<f64>, span_s: f64) -> bool {
    omega.norm() * span_s < 0.3
}

/// Registers the candidates (rad/s) on a coarse map and finds whether one clearly wins. Rivals closer than a twelfth of the rate
/// are the same valley, whose width is the covariance's business.
pub(super) fn contest(coarse: &Registrar, candidates: &[Vector3<f64>], span_s: f64) -> Option<Contest> {
    let apart = |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).norm() > f64::max(a.norm() / 12.0, 0.15 / span_s.max(1e-6));
    let mut fits: Vec<(Vector3<f64>, Registration)> = Vec::new();
    for omega in candidates {
        if fits.len() < CONTESTANTS && fits.iter().all(|(start, f)| apart(start, omega) && apart(&f.omega, omega)) {
            fits.push((*omega, coarse.refine(*omega, &COARSE)));
        }
    }
    let noise = fits.iter().map(|(_, f)| f.noise).min_by(f64::total_cmp)?;
    let cost = |f: &Registration| coarse.cost(&f.residuals, noise);
    let explained = |f: &Registration| {
        let bare: Vec<f32> = f.residuals.iter().zip(&f.markings).map(|(r, m)| r + m).collect();
        coarse.cost(&bare, noise) - cost(f)
    };
    let mut fits: Vec<Registration> = fits.into_iter().map(|(_, f)| f).collect();
    fits.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
    // Those that are near go on until they have arrived, or have met.
    let limit = cost(&fits[0]) + 2.5 * LEAST_LEAD * explained(&fits[0]);
    fits.par_iter_mut().with_max_len(1).filter(|f| cost(f) <= limit).for_each(|f| *f = coarse.refine(f.omega, &Effort { steps: 6, ..COARSE }));
    fits.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
    let best = fits.first()?;
    let at_best = coarse.cost_at(&best.omega, noise, &COARSE);
    let gain = explained(best).max(1.0);
    let still = stands_still(&best.omega, span_s);
    let mut strongest: Option<(f64, f64, Vector3<f64>)> = None;
    let mut flat: Matrix3<f64> = Matrix3::zeros();
    for f in fits.iter().skip(1).filter(|f| apart(&best.omega, &f.omega)) {
        let lead = (cost(f) - cost(best)) / gain;
        let way = f.omega - best.omega;
        let level = |share: f64| (coarse.cost_at(&(best.omega + way * share), noise, &COARSE) - at_best) / gain;
        let far = way.norm() > f64::max(best.omega.norm() / 3.0, 1.0 / span_s.max(1e-6));
        let needed = if still {
            2.0 * LEAST_LEAD
        } else if far && lead < LEAST_FAR_LEAD {
            LEAST_FAR_LEAD
        } else if lead < LEAST_LEAD && level(0.3).max(level(0.6)) > level(1.0) + BARRIER {
            LEAST_LEAD
        } else {
            0.0 // on the slope of the same valley: it has only not arrived yet
        };
        if needed == 0.0 && lead < LEAST_FAR_LEAD {
            let along = way * way.transpose() * (FLAT_SHARE * (FLAT_LEAD / (FLAT_LEAD + lead)).powi(2));
            flat = if along.trace() > flat.trace() { along } else { flat };
        }
        let strength = lead - needed;
        if strongest.is_none_or(|s| strength < s.0) {
            strongest = Some((strength, lead, f.omega));
        }
    }
    if still && strongest.is_none_or(|s| s.0 > 0.0) {
        // A line that slides along itself seems to stand still, and no search finds its rate: so a turn of one radian is
        // tried about axes all around.
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let turned = |i: u32| {
            let z = (f64::from(i) + 0.5) / f64::from(PROBES);
            let ((s, c), r) = ((golden * f64::from(i)).sin_cos(), (1.0 - z * z).sqrt());
            let omega = Vector3::new(r * c, r * s, z) / span_s.max(1e-6);
            ((coarse.cost_at(&omega, noise, &COARSE) - at_best) / gain, omega)
        };
        let slides: Vec<_> = (0..PROBES).into_par_iter().with_max_len(1).map(turned).collect();
        let slides = slides.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        strongest = slides.map(|(lead, omega)| (lead - 2.0 * LEAST_LEAD, lead, omega)).or(strongest);
    }
    let rival = strongest.filter(|s| s.0 < 0.0).map(|s| s.2);
    let near = fits.iter().skip(1).map(|f| f.omega).filter(|w| (w - best.omega).norm() * span_s < SAME_VALLEY).collect();
    Some(Contest { omega: best.omega, rival, near, flat, margin: strongest.map(|s| s.1) })
}
