//! The racket as a moving rigid body: candidate laws of motion, fitted straight to the image points of both cameras.
//!
//! A state is position of the centre of mass, attitude, velocity, angular velocity at a reference time (the contact), so
//! nothing has to be carried from the middle of a window to its edge afterwards (what the effect `window-bias` is about). A law says how the
//! state goes on from there. Which law holds is a matter of evidence: each law's marginal likelihood weighs its result,
//! and the spread between laws is part of the uncertainty.

use super::least_squares::{Problem, Solution, SolveError, probabilities, solve};
use super::motion_law::{AfterContact, MotionLaw};
use super::motion_state::{MotionState, Part};
use super::sighting::{CommonError, Sighting, UsedSightings, Whitener, deviations, persistence};
use crate::calibration::{CameraId, StereoRig};
use crate::tracking::RacketFigure;
use nalgebra::{DVector, Isometry3, Matrix3, Point3, SMatrix, UnitQuaternion, Vector2, Vector3};

/// 12×12 covariance of (centre of mass, small rotation about global axes, velocity, angular velocity in body axes).
pub type MotionCovariance = SMatrix<f64, 12, 12>;

/// What the racket is and where gravity points.
#[derive(Debug, Clone)]
pub struct MovingRacket {
    pub figure: RacketFigure,
    /// The stated balance point, local axes, m from the stringbed centre.
    pub com_local: Point3<f64>,
    /// Principal inertias about the centre of mass, kg m².
    pub inertia: Vector3<f64>,
    /// Global axes, m/s².
    pub gravity: Vector3<f64>,
    /// Where the centre of mass lies from the stated balance point, body axes, m, by what flies freely in the session.
    pub balance: Vector3<f64>,
    /// How well that is known, per axis.
    pub balance_sd: Vector3<f64>,
}

/// Longest integration step, s: at 50 rad/s the fourth-order error of a step is below 1e-9 rad.
const STEP_S: f64 = 1.0e-3;

impl MovingRacket {
    fn rate_dot(&self, law: MotionLaw, s: &MotionState, rate: &Vector3<f64>, dt: f64) -> Vector3<f64> {
        let given = s.given(law, dt).1;
        if !law.gyroscopic() {
            return given;
        }
        let i = self.inertia;
        given + Vector3::new((i.y - i.z) * rate.y * rate.z / i.x, (i.z - i.x) * rate.z * rate.x / i.y, (i.x - i.y) * rate.x * rate.y / i.z)
    }

    /// Poses (origin at the stringbed centre) at times `dt` after the reference time, in any order.
    pub fn poses(&self, law: MotionLaw, state: &MotionState, dts: &[f64]) -> Vec<Isometry3<f64>> {
        let mut order: Vec<usize> = (0..dts.len()).collect();
        order.sort_by(|a, b| dts[*a].abs().total_cmp(&dts[*b].abs()));
        let mut out = vec![Isometry3::identity(); dts.len()];
        for sign in [-1.0, 1.0] {
            let (mut t, mut moving) = (0.0, self.at_centre_of_mass(state, 1.0));
            for &i in order.iter().filter(|&&i| if sign < 0.0 { dts[i] < 0.0 } else { dts[i] >= 0.0 }) {
                self.advance(law, state, &mut moving, &mut t, dts[i]);
                out[i] = moving.pose(&(self.com_local + self.lever(state)));
            }
        }
        out
    }

    fn lever(&self, state: &MotionState) -> Vector3<f64> {
        self.balance + state.lever_body
    }

    /// The state of the centre of mass from that of the stated balance point; with `sign` −1 the way back.
    fn at_centre_of_mass(&self, state: &MotionState, sign: f64) -> MotionState {
        let lever = self.lever(state) * sign;
        MotionState {
            com: state.com + state.global_from_racket * lever,
            velocity: state.velocity + state.global_from_racket * state.rate_body.cross(&lever),
            ..state.clone()
        }
    }

    /// The whole state `dt` after the reference time (reference values of force and angular acceleration moved along).
    pub fn state_at(&self, law: MotionLaw, state: &MotionState, dt: f64) -> MotionState {
        let (mut t, mut moving) = (0.0, self.at_centre_of_mass(state, 1.0));
        self.advance(law, state, &mut moving, &mut t, dt);
        moving = self.at_centre_of_mass(&moving, -1.0);
        (moving.force_body, moving.rate_dot_body) = state.given(law, dt);
        moving.force_slope_body = state.force_slope_body + state.force_curve_body * dt;
        moving.rate_ddot_body = state.rate_ddot_body + state.rate_dddot_body * dt;
        moving
    }

    /// Acceleration of the stated balance point (global) and angular acceleration (body) at the reference time.
    pub fn accelerations(&self, law: MotionLaw, s: &MotionState) -> (Vector3<f64>, Vector3<f64>) {
        let g = if law.falls() { self.gravity } else { Vector3::zeros() };
        let (lever, rate, rate_dot) = (self.lever(s), s.rate_body, self.rate_dot(law, s, &s.rate_body, 0.0));
        let round = rate_dot.cross(&lever) + rate.cross(&rate.cross(&lever));
        (g + s.global_from_racket * (s.force_body - round), rate_dot)
    }

    fn advance(&self, law: MotionLaw, start: &MotionState, s: &mut MotionState, t: &mut f64, to: f64) {
        let steps = ((to - *t).abs() / STEP_S).ceil().max(1.0) as usize;
        let h = (to - *t) / steps as f64;
        if h == 0.0 {
            return;
        }
        let gravity = if law.falls() { self.gravity } else { Vector3::zeros() };
        let force = |q: &UnitQuaternion<f64>, at: f64| gravity + q * start.given(law, at).0;
        for _ in 0..steps {
            // Rates by fourth-order Runge-Kutta; the attitude by the rotation of the Simpson-averaged rate, with the
            // commutator term of Magnus's expansion.
            let w0 = s.rate_body;
            let k1 = self.rate_dot(law, start, &w0, *t);
            let k2 = self.rate_dot(law, start, &(w0 + k1 * (h / 2.0)), *t + h / 2.0);
            let k3 = self.rate_dot(law, start, &(w0 + k2 * (h / 2.0)), *t + h / 2.0);
            let k4 = self.rate_dot(law, start, &(w0 + k3 * h), *t + h);
            let middle = w0 + k2 * (h / 2.0);
            let w1 = w0 + (k1 + 2.0 * k2 + 2.0 * k3 + k4) * (h / 6.0);
            let turn = (w0 + middle * 4.0 + w1) * (h / 6.0) + w0.cross(&w1) * (h * h / 12.0);
            let half = (w0 * 5.0 + middle * 8.0 - w1) * (h / 24.0);
            let q0 = s.global_from_racket;
            let qm = q0 * UnitQuaternion::from_scaled_axis(half);
            let q1 = q0 * UnitQuaternion::from_scaled_axis(turn);
            let (a0, am, a1) = (force(&q0, *t), force(&qm, *t + h / 2.0), force(&q1, *t + h));
            s.com += s.velocity * h + (a0 + am * 2.0) * (h * h / 6.0);
            s.velocity += (a0 + am * 4.0 + a1) * (h / 6.0);
            s.rate_body = w1;
            s.global_from_racket = q1;
            *t += h;
        }
    }
}

/// Everything a fit of the racket looks at.
pub struct MotionView<'a> {
    pub rig: &'a StereoRig,
    pub racket: &'a MovingRacket,
    /// Sorted by target, camera, frame; markers only.
    pub sightings: &'a [Sighting],
    /// Reference time, s, on the clock of the sightings.
    pub reference_t: f64,
    pub common: CommonError,
    /// Time within which a drive may change by its own size, s.
    pub memory_s: f64,
    /// Factor on all stated deviations, from the fit of the richest law.
    pub noise_scale: f64,
    /// How far all bands of a picture are off together, px, by camera.
    pub shake_px: [f64; 2],
    /// For the laws after the contact; `None` before it.
    pub after: Option<AfterContact>,
}

struct LawFit<'a> {
    view: &'a MotionView<'a>,
    law: MotionLaw,
    times: Vec<f64>,
    frame_of: Vec<usize>,
    centres: [Point3<f64>; 2],
    cameras: [Isometry3<f64>; 2],
    whitener: Whitener,
}

impl<'a> LawFit<'a> {
    fn new(view: &'a MotionView<'a>, law: MotionLaw) -> Self {
        let mut times: Vec<f64> = view.sightings.iter().map(|s| s.t - view.reference_t).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        let frame_of = view.sightings.iter().map(|s| times.partition_point(|t| *t < s.t - view.reference_t)).collect();
        let cameras = CameraId::BOTH.map(|c| view.rig.camera_from_global(c));
        let whitener = Whitener::new(view.sightings, view.common, view.noise_scale, view.shake_px);
        LawFit { view, law, times, frame_of, centres: cameras.map(|c| c.inverse() * Point3::origin()), cameras, whitener }
    }

    fn misfits(&self, state: &MotionState) -> Option<Vec<Vector2<f64>>> {
        let poses = self.view.racket.poses(self.law, state, &self.times);
        self.view
            .sightings
            .iter()
            .zip(&self.frame_of)
            .map(|(s, &k)| {
                let c = s.camera.index();
                let eye = poses[k].inverse_transform_point(&self.centres[c]);
                let p = poses[k] * self.view.racket.figure.patch_point(s.target.index(), &eye).0;
                Some(self.view.rig.camera(s.camera).project(&(self.cameras[c] * p))? - s.uv)
            })
            .collect()
    }

    /// Prior deviations of a part; where the centre of mass lies is a matter of the racket, not of the law.
    fn prior(&self, part: Part) -> Option<Vector3<f64>> {
        if part == Part::Lever { Some(self.view.racket.balance_sd) } else { self.law.prior(part, self.view.memory_s, self.view.after.as_ref()) }
    }
}

impl Problem for LawFit<'_> {
    type State = MotionState;

    fn scales(&self) -> Vec<f64> {
        self.law.parts().iter().flat_map(|part| [self.law.step(*part); 3]).collect()
    }

    fn moved(&self, state: &MotionState, step: &DVector<f64>) -> MotionState {
        let mut moved = state.clone();
        for (k, part) in self.law.parts().iter().enumerate() {
            part.shift(&mut moved, Vector3::new(step[3 * k], step[3 * k + 1], step[3 * k + 2]));
        }
        moved
    }

    fn residuals(&self, state: &MotionState) -> Option<DVector<f64>> {
        let misfits = self.misfits(state)?;
        let seen = self.whitener.whiten(&misfits);
        let prior_rows = self.law.parts().iter().filter_map(|part| self.prior(*part).map(|sd| part.of(state).component_div(&sd)));
        let mut all: Vec<f64> = seen.iter().copied().collect();
        for row in prior_rows {
            all.extend(row.iter());
        }
        Some(DVector::from_vec(all))
    }
}

/// One law's result: state, covariance, and the logarithm of its evidence up to a constant all laws share.
#[derive(Debug, Clone)]
pub struct LawResult {
    pub law: MotionLaw,
    pub state: MotionState,
    pub covariance: MotionCovariance,
    /// Covariance of the lever, where the law has one.
    pub lever_covariance: Option<Matrix3<f64>>,
    pub ln_evidence: f64,
    pub chi2: f64,
}

/// Fits one law from a starting state.
pub(crate) fn fit_law(view: &MotionView<'_>, law: MotionLaw, start: &MotionState) -> Result<LawResult, SolveError> {
    let problem = LawFit::new(view, law);
    let mut start = start.clone();
    if law == MotionLaw::Rest {
        (start.velocity, start.rate_body) = (Vector3::zeros(), Vector3::zeros());
    }
    for part in Part::OPTIONAL.iter().filter(|part| !law.parts().contains(part)) {
        let unused = part.of(&start);
        part.shift(&mut start, -unused);
    }
    let Solution { state, covariance, cost, ln_det_information } = solve(&problem, start)?;
    let ln_prior: f64 = law.parts().iter().filter_map(|part| problem.prior(*part)).map(|sd| -sd.map(f64::ln).sum()).sum();
    let lever = law.parts().iter().position(|part| *part == Part::Lever);
    let chi2 = problem.misfits(&state).map_or(f64::INFINITY, |m| problem.whitener.whiten(&m).norm_squared());
    Ok(LawResult {
        law,
        state,
        covariance: covariance.fixed_view::<12, 12>(0, 0).into_owned(),
        lever_covariance: lever.map(|k| covariance.fixed_view::<3, 3>(3 * k, 3 * k).into_owned()),
        ln_evidence: -0.5 * cost - 0.5 * ln_det_information + ln_prior + law.ln_weight(view.after.map(|after| after.slow_hand)),
        chi2,
    })
}

/// Size of each sighting's residual under a law's result, in its own stated deviations.
pub(crate) fn sighting_deviations(view: &MotionView<'_>, result: &LawResult) -> Vec<f64> {
    LawFit::new(view, result.law)
        .misfits(&result.state)
        .map_or_else(|| vec![f64::INFINITY; view.sightings.len()], |m| deviations(view.sightings, &m, view.common))
}

/// Factor on the deviations for errors that persist from frame to frame under a law's result.
pub(crate) fn motion_persistence(view: &MotionView<'_>, result: &LawResult) -> f64 {
    let problem = LawFit::new(view, result.law);
    problem.misfits(&result.state).map_or(1.0, |m| persistence(view.sightings, &problem.whitener.whiten(&m)))
}

/// The racket at the reference time, averaged over the laws by their evidence.
#[derive(Debug, Clone)]
pub struct MotionEstimate {
    pub reference_t: f64,
    pub state: MotionState,
    /// Acceleration of the stated balance point, global axes.
    pub acceleration: Vector3<f64>,
    /// Angular acceleration, body axes.
    pub rate_dot_body: Vector3<f64>,
    pub covariance: MotionCovariance,
    /// Laws with their probability, best first.
    pub laws: Vec<(MotionLaw, f64)>,
    /// The best law's own state, for poses at other times.
    pub best: LawResult,
    pub used: UsedSightings,
    /// Where a racket that flew freely says its centre of mass lies.
    pub lever: Option<FreeLever>,
}

/// Centre of mass from the stated balance point, as one free flight shows it.
#[derive(Debug, Clone)]
pub struct FreeLever {
    /// Body axes, m.
    pub lever: Vector3<f64>,
    pub covariance: Matrix3<f64>,
    /// That the racket flew freely at all.
    pub probability: f64,
}

impl MotionEstimate {
    /// Velocity of the centre of mass and angular velocity at the reference time, global axes.
    pub fn velocities(&self) -> (Vector3<f64>, Vector3<f64>) {
        (self.state.velocity, self.state.global_from_racket * self.state.rate_body)
    }
}

/// Averages results by evidence; the spread between them joins the covariance.
pub(crate) fn average(racket: &MovingRacket, mut results: Vec<LawResult>, reference_t: f64, used: UsedSightings) -> Option<MotionEstimate> {
    results.sort_by(|a, b| b.ln_evidence.total_cmp(&a.ln_evidence));
    let best = results.first()?.clone();
    let weights = probabilities(results.iter().map(|r| r.ln_evidence));
    let offset = |r: &LawResult| -> SMatrix<f64, 12, 1> {
        let turn = (r.state.global_from_racket * best.state.global_from_racket.inverse()).scaled_axis();
        let parts = [r.state.com - best.state.com, turn, r.state.velocity - best.state.velocity, r.state.rate_body - best.state.rate_body];
        SMatrix::from_iterator(parts.iter().flat_map(|v| [v.x, v.y, v.z]))
    };
    let mut mean = SMatrix::<f64, 12, 1>::zeros();
    let (mut acceleration, mut rate_dot) = (Vector3::zeros(), Vector3::zeros());
    for (r, w) in results.iter().zip(&weights) {
        mean += offset(r) * *w;
        let (a, d) = racket.accelerations(r.law, &r.state);
        acceleration += a * *w;
        rate_dot += d * *w;
    }
    let mut covariance = MotionCovariance::zeros();
    for (r, w) in results.iter().zip(&weights) {
        let d = offset(r) - mean;
        covariance += (r.covariance + d * d.transpose()) * *w;
    }
    let part = |k: usize| Vector3::new(mean[3 * k], mean[3 * k + 1], mean[3 * k + 2]);
    let state = MotionState {
        com: best.state.com + part(0),
        global_from_racket: UnitQuaternion::from_scaled_axis(part(1)) * best.state.global_from_racket,
        velocity: best.state.velocity + part(2),
        rate_body: best.state.rate_body + part(3),
        ..best.state.clone()
    };
    let laws: Vec<(MotionLaw, f64)> = results.iter().zip(&weights).map(|(r, w)| (r.law, *w)).collect();
    let free = laws.iter().filter(|(l, _)| l.free()).map(|(_, w)| w).sum();
    let lever = results.iter().find_map(|r| {
        let covariance = r.lever_covariance?;
        Some(FreeLever { lever: racket.lever(&r.state), covariance, probability: free })
    });
    Some(MotionEstimate { reference_t, state, acceleration, rate_dot_body: rate_dot, covariance, laws, best, used, lever })
}
