//! The ball before and after contact: gravity always, drag and lift if the points show them.
//!
//! Drag −k |v| v with k = ρ C_D A / 2m, and a lift acceleration across the path that stays constant over the window.
//! Sources: Cross and Lindsey (C_D 0.507 ± 0.024 in free flight); Mehta, Alam and Subic 2008 (0.6 to 0.7 in tunnels);
//! Stepanek 1988 (lift below half the drag).
//!
//! How long a window these laws hold over is asked of the points: `bending_p` tests them against a path whose acceleration
//! changes freely. A bounce, a net cord, a barrel or a wrongly tracked stretch within the window bends it.

use super::least_squares::{Problem, Solution, SolveError, chi2_tail_3, probabilities, solve};
use super::sighting::{CommonError, Sighting, UsedSightings, Whitener, deviations, persistence};
use crate::calibration::{CameraId, StereoRig};
use crate::equipment::Ball;
use nalgebra::{DVector, Isometry3, Matrix6, Point3, SMatrix, Vector2, Vector3};

/// Density of air at 15 °C, sea level, kg/m³.
const AIR_DENSITY: f64 = 1.225;
/// Mean and spread of a tennis ball's drag coefficient over new and worn balls.
const DRAG: (f64, f64) = (0.55, 0.08);
/// Spread of lift over drag: a lift coefficient of about ±0.2 (3000 rpm at 30 m/s by the formula of the effect `air-flight`).
const LIFT_SHARE: f64 = 0.35;

#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FlightLaw {
    /// Gravity alone.
    Gravity,
    /// Gravity, drag and lift.
    Air,
    /// These, and a rate of change of acceleration that no flight has: what the others are tested against.
    Bending,
}

impl FlightLaw {
    /// The laws that a ball may follow.
    pub const ALL: [FlightLaw; 2] = [FlightLaw::Gravity, FlightLaw::Air];

    /// Word of shot.json.
    pub fn word(self) -> &'static str {
        match self {
            FlightLaw::Gravity => "gravity",
            FlightLaw::Air => "air",
            FlightLaw::Bending => "bending",
        }
    }
}

/// Spread of the rate of change of acceleration, m/s³: 6 cm aside after 15 ms, more than any window needs.
const BENDING: f64 = 1e5;

/// Ball at the reference time, global axes, SI.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightState {
    pub position: Point3<f64>,
    pub velocity: Vector3<f64>,
    pub drag_coefficient: f64,
    /// m/s², global axes.
    pub lift: Vector3<f64>,
    /// m/s³, global axes; zero but for [`FlightLaw::Bending`].
    pub bending: Vector3<f64>,
}

impl FlightState {
    pub fn new(position: Point3<f64>, velocity: Vector3<f64>) -> Self {
        FlightState { position, velocity, drag_coefficient: 0.0, lift: Vector3::zeros(), bending: Vector3::zeros() }
    }
}

pub struct FlightView<'a> {
    pub rig: &'a StereoRig,
    pub ball: &'a Ball,
    pub sightings: &'a [Sighting],
    pub reference_t: f64,
    pub gravity: Vector3<f64>,
    pub common: CommonError,
    pub noise_scale: f64,
}

impl FlightView<'_> {
    /// Drag per unit of coefficient and squared speed, 1/m.
    fn drag_per_m(&self) -> f64 {
        0.5 * AIR_DENSITY * std::f64::consts::PI * self.ball.radius_m().powi(2) / self.ball.mass_kg
    }

    /// Position `dt` after the reference time: third order in time, exact to 1e-6 m over 30 ms at 40 m/s.
    pub fn position(&self, s: &FlightState, dt: f64) -> Point3<f64> {
        let k = s.drag_coefficient * self.drag_per_m();
        let speed = s.velocity.norm();
        let acceleration = self.acceleration(s);
        let jerk = if speed > 0.0 { -(acceleration * speed + s.velocity * (s.velocity.dot(&acceleration) / speed)) * k } else { Vector3::zeros() };
        s.position + s.velocity * dt + acceleration * (dt * dt / 2.0) + (jerk + s.bending) * (dt * dt * dt / 6.0)
    }

    pub fn acceleration(&self, s: &FlightState) -> Vector3<f64> {
        self.gravity + s.lift - s.velocity * (s.drag_coefficient * self.drag_per_m() * s.velocity.norm())
    }
}

struct FlightFit<'a> {
    view: &'a FlightView<'a>,
    law: FlightLaw,
    cameras: [Isometry3<f64>; 2],
    whitener: Whitener,
    /// Prior spread of the lift, m/s².
    lift_sd: f64,
}

impl<'a> FlightFit<'a> {
    fn new(view: &'a FlightView<'a>, law: FlightLaw, lift_sd: f64) -> Self {
        let whitener = Whitener::new(view.sightings, view.common, view.noise_scale, [0.0; 2]);
        FlightFit { view, law, cameras: CameraId::BOTH.map(|c| view.rig.camera_from_global(c)), whitener, lift_sd }
    }

    fn misfits(&self, state: &FlightState) -> Option<Vec<Vector2<f64>>> {
        self.view
            .sightings
            .iter()
            .map(|s| {
                let p = self.view.position(state, s.t - self.view.reference_t);
                Some(self.view.rig.camera(s.camera).project(&(self.cameras[s.camera.index()] * p))? - s.uv)
            })
            .collect()
    }
}

impl Problem for FlightFit<'_> {
    type State = FlightState;

    fn scales(&self) -> Vec<f64> {
        let mut s = vec![1e-3, 1e-3, 1e-3, 0.1, 0.1, 0.1];
        if self.law != FlightLaw::Gravity {
            s.extend([DRAG.1, self.lift_sd, self.lift_sd, self.lift_sd]);
        }
        if self.law == FlightLaw::Bending {
            s.extend([BENDING; 3]);
        }
        s
    }

    fn moved(&self, s: &FlightState, d: &DVector<f64>) -> FlightState {
        let mut next = s.clone();
        next.position += Vector3::new(d[0], d[1], d[2]);
        next.velocity += Vector3::new(d[3], d[4], d[5]);
        if self.law != FlightLaw::Gravity {
            next.drag_coefficient += d[6];
            next.lift += Vector3::new(d[7], d[8], d[9]);
        }
        if self.law == FlightLaw::Bending {
            next.bending += Vector3::new(d[10], d[11], d[12]);
        }
        next
    }

    fn residuals(&self, s: &FlightState) -> Option<DVector<f64>> {
        let seen = self.whitener.whiten(&self.misfits(s)?);
        let mut all: Vec<f64> = seen.iter().copied().collect();
        if self.law != FlightLaw::Gravity {
            all.push((s.drag_coefficient - DRAG.0) / DRAG.1);
            all.extend((s.lift / self.lift_sd).iter());
        }
        if self.law == FlightLaw::Bending {
            all.extend((s.bending / BENDING).iter());
        }
        Some(DVector::from_vec(all))
    }
}

#[derive(Debug, Clone)]
pub struct FlightResult {
    pub law: FlightLaw,
    pub state: FlightState,
    /// Of position and velocity.
    pub covariance: Matrix6<f64>,
    pub ln_evidence: f64,
    /// χ² of the points, and with what the priors add.
    pub chi2: f64,
    pub cost: f64,
}

pub(crate) fn fit_flight(view: &FlightView<'_>, law: FlightLaw, start: &FlightState) -> Result<FlightResult, SolveError> {
    let speed = start.velocity.norm();
    let drag = DRAG.0 * view.drag_per_m() * speed * speed;
    let problem = FlightFit::new(view, law, (LIFT_SHARE * drag).max(0.05));
    let mut start = start.clone();
    start.drag_coefficient = if law == FlightLaw::Gravity { 0.0 } else { DRAG.0 };
    (start.lift, start.bending) = (Vector3::zeros(), Vector3::zeros());
    let Solution { state, covariance, cost, ln_det_information } = solve(&problem, start)?;
    let air = -DRAG.1.ln() - 3.0 * problem.lift_sd.ln();
    let ln_prior = match law {
        FlightLaw::Gravity => 0.0,
        FlightLaw::Air => air,
        FlightLaw::Bending => air - 3.0 * BENDING.ln(),
    };
    let chi2 = problem.misfits(&state).map_or(f64::INFINITY, |m| problem.whitener.whiten(&m).norm_squared());
    Ok(FlightResult {
        law,
        state,
        covariance: covariance.fixed_view::<6, 6>(0, 0).into_owned(),
        ln_evidence: -0.5 * cost - 0.5 * ln_det_information + ln_prior,
        chi2,
        cost,
    })
}

/// Probability of points that bend as much beyond gravity, drag and lift, if these were all: χ² with three degrees of freedom,
/// the gain of a free rate of change of acceleration. `scale` gives the factor on the deviations that the residuals of a fit
/// ask for; it is taken from the freer fit, which a bend does not spoil. `None` when the points do not tell.
pub(crate) fn bending_p(view: &FlightView<'_>, start: &FlightState, scale: impl Fn(&FlightView<'_>, &FlightResult) -> f64) -> Option<f64> {
    let free = fit_flight(view, FlightLaw::Bending, start).ok()?;
    let scaled = FlightView { noise_scale: scale(view, &free), ..*view };
    let free = fit_flight(&scaled, FlightLaw::Bending, start).ok()?;
    let bound = fit_flight(&scaled, FlightLaw::Air, start).ok()?;
    Some(chi2_tail_3(bound.cost - free.cost))
}

pub(crate) fn flight_deviations(view: &FlightView<'_>, result: &FlightResult) -> Vec<f64> {
    let problem = FlightFit::new(view, result.law, 1.0);
    problem.misfits(&result.state).map_or_else(|| vec![f64::INFINITY; view.sightings.len()], |m| deviations(view.sightings, &m, view.common))
}

/// Factor on the deviations for errors that persist from frame to frame under a law's result.
pub(crate) fn flight_persistence(view: &FlightView<'_>, result: &FlightResult) -> f64 {
    let problem = FlightFit::new(view, result.law, 1.0);
    problem.misfits(&result.state).map_or(1.0, |m| persistence(view.sightings, &problem.whitener.whiten(&m)))
}

/// The ball at the reference time, averaged over the laws.
#[derive(Debug, Clone)]
pub struct FlightEstimate {
    pub reference_t: f64,
    pub position: Point3<f64>,
    pub velocity: Vector3<f64>,
    pub acceleration: Vector3<f64>,
    pub covariance: Matrix6<f64>,
    pub laws: Vec<(FlightLaw, f64)>,
    pub used: UsedSightings,
    /// Probability of points that bend as much if gravity, drag and lift were all; `None` when the points do not tell.
    pub bending_p: Option<f64>,
    /// Whether farther points were left out because the whole path bends more than the laws.
    pub shortened: bool,
}

/// Averages the laws; `air_odds` is the session's prior odds of air against none (1 when nothing is known). `used` and `bending_p` tell of the points.
pub(crate) fn average_flight(
    view: &FlightView<'_>,
    mut results: Vec<FlightResult>,
    air_odds: f64,
    used: UsedSightings,
    bending_p: Option<f64>,
) -> Option<FlightEstimate> {
    for r in &mut results {
        if r.law == FlightLaw::Air {
            r.ln_evidence += air_odds.ln();
        }
    }
    results.sort_by(|a, b| b.ln_evidence.total_cmp(&a.ln_evidence));
    let weights = probabilities(results.iter().map(|r| r.ln_evidence));
    let vector = |r: &FlightResult| {
        let (p, v) = (r.state.position, r.state.velocity);
        SMatrix::<f64, 6, 1>::new(p.x, p.y, p.z, v.x, v.y, v.z)
    };
    let mut mean = SMatrix::<f64, 6, 1>::zeros();
    let mut acceleration = Vector3::zeros();
    for (r, w) in results.iter().zip(&weights) {
        mean += vector(r) * *w;
        acceleration += view.acceleration(&r.state) * *w;
    }
    let mut covariance = Matrix6::zeros();
    for (r, w) in results.iter().zip(&weights) {
        let d = vector(r) - mean;
        covariance += (r.covariance + d * d.transpose()) * *w;
    }
    Some(FlightEstimate {
        reference_t: view.reference_t,
        position: Point3::new(mean[0], mean[1], mean[2]),
        velocity: Vector3::new(mean[3], mean[4], mean[5]),
        acceleration,
        covariance,
        laws: results.iter().zip(&weights).map(|(r, w)| (r.law, *w)).collect(),
        used,
        bending_p,
        shortened: false,
    })
}
