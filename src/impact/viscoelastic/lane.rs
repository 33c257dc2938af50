//! One lane's bookkeeping: how far a step may go, whether it has crossed a kink, what comes next.

use super::kernel::{CREEP, Mode, ONSET, SLIDE, STICK, Signs};
use crate::impact::error::ModelError;

/// Contact longer than this is an error of the model, s.
pub(super) const LONGEST_S: f64 = 20e-3;
/// Steps after which a contact is given up: only parameters at the edge of their range come near.
pub(super) const MOST_STEPS: usize = 20_000;
/// Share of the time in which ball and strings settle that one step may take (explicit stability ends at 2.8).
const SETTLING_SHARE: f64 = 1.0;
/// Steps never get shorter than this share of the longest.
const SHORTEST_SHARE: f64 = 1.0 / 512.0;
/// How close to its kink a step must end: force (N), compression (m), force balance (N), slip (m/s), friction left (N),
/// force again where a contact outlives it (N). A contact that ends by displacement is watched in N of a spring of [`BACK_IN_PLACE`] N/m.
pub(super) type Landing = [f64; 6];
/// Where the ledger is to close to 1e-9 J.
pub(super) const EXACT: Landing = [1e-6, 1e-10, 1e-6, 1e-7, 1e-6, 1e-6];
/// Otherwise: what the kink then adds to an outcome is a hundredth of the error of the steps (the force balance and the friction
/// left have their kinks in a derivative, so that the square of the miss counts).
pub(super) const CLOSE: Landing = [1e-4, 1e-7, 1e-2, 1e-7, 1e-3, 1e-4];
const BACK_IN_PLACE: f64 = 1e5;
/// Slip below which a sliding contact that could stick does: the rest is taken away by one impulse, m/s. Friction would need
/// less than a microsecond for it; the error is of the order of its square.
const STICK_SLIP: f64 = 1e-3;
/// Share of the slip that one sliding step may use up: its direction turns fast where it is small.
const SLIP_SHARE: f64 = 0.4;
/// Share of the longest step that one step may take while a hold gives way.
const CREEP_SHARE: f64 = 0.25;
/// Share of the slip while it grows and its direction follows: stability ends at 2.8.
const GROWING_SHARE: f64 = 1.5;

/// One lane's bookkeeping.
#[derive(Clone, Copy)]
pub(super) struct Lane {
    /// Which job; `None`: idle.
    pub job: Option<usize>,
    pub time: f64,
    pub steps: usize,
    pub longest: f64,
    pub most_steps: usize,
    /// Of the ball, m: no ball is squeezed further.
    pub radius: f64,
    pub step: f64,
    pub start: Signs,
    pub mode: Mode,
    pub hunt: Option<Hunt>,
    /// Slip at the last step, m/s, and whether it has fallen since the one before.
    pub slip_before: f64,
    pub falling: bool,
    /// How fast the force grew over the last step, N/s; 0 while it falls.
    pub rise: f64,
    /// Slip velocity per unit of tangential impulse, 1/kg; coefficient of friction.
    pub slip_compliance: f64,
    pub mu: f64,
    /// Friction acts through sideways springs: no stick, no slip of its own.
    pub springs: bool,
    /// The contact ends by displacement, not by force.
    pub by_displacement: bool,
    pub landing: &'static Landing,
    /// Greatest force (N), compression and deflection (m).
    pub peak: [f64; 3],
}

/// A step being shortened until it ends at a kink.
#[derive(Clone, Copy)]
pub(super) struct Hunt {
    kind: usize,
    low: (f64, f64),
    high: (f64, f64),
    /// Which end the last try has moved: 1 the high, -1 the low, 0 none yet.
    moved: i8,
    tries: usize,
}

/// The watched quantity of kind `kind` over a step: at its start, at its end, and whether it has a kink in between.
fn watch(kind: usize, lane: &Lane, end: &Signs) -> (f64, f64, bool) {
    let start = &lane.start;
    let changes = |a: f64, b: f64| a.abs() > lane.landing[kind] && a * b < 0.0;
    match kind {
        0 if lane.by_displacement => (BACK_IN_PLACE * start.approach, BACK_IN_PLACE * end.approach, end.approach <= 0.0),
        0 => (start.force, end.force, end.force <= 0.0),
        1 => (start.onset, end.onset, changes(start.onset, end.onset)),
        2 => (start.compressing, end.compressing, changes(start.compressing, end.compressing)),
        4 if lane.springs => (start.grip_left, end.grip_left, changes(start.grip_left, end.grip_left)),
        3 if lane.mode.stick == SLIDE && !lane.springs => {
            let size = start.slip[0].hypot(start.slip[1]);
            let d = lane.mode.direction;
            let after = end.slip[0] * d[0] + end.slip[1] * d[1];
            (size, after, size > lane.landing[3] && after <= 0.0)
        }
        4 if lane.mode.stick == STICK => (start.grip_left, end.grip_left, start.grip_left > 0.0 && end.grip_left < 0.0),
        5 if lane.by_displacement => (start.force, end.force, changes(start.force, end.force)),
        _ => (1.0, 1.0, false),
    }
}

/// What a lane does after a step.
pub(super) enum Verdict {
    /// Take the step; `true`: the mode has changed, the rates at its end must be computed anew.
    Accept(bool),
    /// Do it again with the lane's new step.
    Again,
    /// Last contact, or an error.
    Done(Result<(), ModelError>),
}

impl Lane {
    pub fn judge(&mut self, end: &Signs, finite: bool) -> Verdict {
        self.steps += 1;
        if !finite {
            return Verdict::Done(Err(ModelError::NotFinite));
        }
        // A ball squeezed beyond its radius is outside the equations; its contact counts as one that does not end.
        if self.steps > self.most_steps || self.time > LONGEST_S || end.onset + ONSET > self.radius {
            return Verdict::Done(Err(ModelError::NoRelease { elapsed_s: self.time, force_n: end.force }));
        }
        if let Some(hunt) = self.hunt {
            let (_, value, _) = watch(hunt.kind, self, end);
            if value.abs() <= self.landing[hunt.kind] || hunt.tries >= 60 || hunt.high.0 - hunt.low.0 < 1e-15 {
                return self.land(hunt.kind, end);
            }
            let mut next = Hunt { tries: hunt.tries + 1, ..hunt };
            match self.first_kink(end) {
                // A kink of another kind hides in the shorter step; it comes first.
                Some((kind, before, after)) if kind != hunt.kind => {
                    next = Hunt { kind, low: (0.0, before), high: (self.step, after), moved: 0, tries: next.tries }
                }
                // The watched value's sign tells on which side of the kink this try has landed. Illinois: an end that stays
                // twice running counts half, so that both ends move.
                _ if value * hunt.high.1 > 0.0 => {
                    next.high = (self.step, value);
                    next.low.1 *= if hunt.moved > 0 { 0.5 } else { 1.0 };
                    next.moved = 1;
                }
                _ => {
                    next.low = (self.step, value);
                    next.high.1 *= if hunt.moved < 0 { 0.5 } else { 1.0 };
                    next.moved = -1;
                }
            }
            self.hunt = Some(next);
            return self.aim();
        }
        if let Some((kind, before, after)) = self.first_kink(end) {
            if after.abs() <= self.landing[kind] {
                return self.land(kind, end);
            }
            self.hunt = Some(Hunt { kind, low: (0.0, before), high: (self.step, after), moved: 0, tries: 0 });
            return self.aim();
        }
        let before = self.mode.stick;
        self.accept(end);
        Verdict::Accept(self.mode.stick != before)
    }

    fn first_kink(&self, end: &Signs) -> Option<(usize, f64, f64)> {
        let mut first: Option<(usize, f64, f64, f64)> = None;
        for kind in 0..self.landing.len() {
            let (before, after, kink) = watch(kind, self, end);
            if kink {
                let share = before / (before - after);
                if first.is_none_or(|f| share < f.3) {
                    first = Some((kind, before, after, share));
                }
            }
        }
        first.map(|(kind, before, after, _)| (kind, before, after))
    }

    /// Sets the step to where the watched quantity should vanish.
    fn aim(&mut self) -> Verdict {
        if let Some(h) = &self.hunt {
            let ((a, ga), (b, gb)) = (h.low, h.high);
            let share = if ga == gb { 0.5 } else { (ga / (ga - gb)).clamp(0.01, 0.99) };
            // After many tries halve: an odd function must not hold the stepper.
            self.step = if h.tries > 20 { 0.5 * (a + b) } else { a + share * (b - a) };
        }
        Verdict::Again
    }

    /// Ends the step at a kink.
    fn land(&mut self, kind: usize, end: &Signs) -> Verdict {
        self.hunt = None;
        if kind == 0 {
            self.time += self.step;
            return Verdict::Done(Ok(()));
        }
        let before = self.mode.stick;
        self.accept(end);
        // Slip that is used up without a hold, and a hold that gives way: both creep first.
        if ((kind == 3 && self.mode.stick == SLIDE) || kind == 4) && !self.springs {
            self.mode.stick = if kind == 3 && end.grip_left >= 0.0 { STICK } else { CREEP };
            self.slip_before = 0.0;
        }
        self.pace();
        Verdict::Accept(self.mode.stick != before)
    }

    fn accept(&mut self, end: &Signs) {
        self.time += self.step;
        self.rise = ((end.force - self.start.force) / self.step).max(0.0);
        self.start = *end;
        let slip = end.slip[0].hypot(end.slip[1]);
        if self.springs {
            // The springs' own deflection says how friction acts.
        } else if self.mode.stick == SLIDE {
            if slip > 1e-6 {
                self.mode.direction = [end.slip[0] / slip, end.slip[1] / slip];
            }
            if slip < self.slip_before && slip <= STICK_SLIP && end.grip_left >= 0.0 {
                self.mode.stick = STICK;
            }
        } else if self.mode.stick == CREEP {
            if end.grip_left >= 0.0 {
                self.mode.stick = STICK;
            } else if slip > STICK_SLIP {
                self.mode.stick = SLIDE;
                self.mode.direction = [end.slip[0] / slip, end.slip[1] / slip];
            }
        }
        self.falling = slip < self.slip_before;
        self.slip_before = slip;
        self.pace();
        self.peak[0] = self.peak[0].max(end.force);
        self.peak[1] = self.peak[1].max(end.onset + ONSET);
    }

    pub fn pace(&mut self) {
        self.step = self.longest.min((SETTLING_SHARE * self.start.settling).max(SHORTEST_SHARE * self.longest));
        let slip = self.start.slip[0].hypot(self.start.slip[1]);
        let force = self.start.force + 0.5 * self.rise * self.step;
        let used = self.slip_compliance * self.mu * force * self.step;
        if self.mode.stick == CREEP {
            self.step *= CREEP_SHARE;
        }
        let share = if self.falling { SLIP_SHARE } else { GROWING_SHARE };
        if self.mode.stick == SLIDE && !self.springs && used > share * slip {
            self.step *= (share * slip / used).max(1.0 / 4096.0);
        }
    }
}

pub(super) const IDLE: Lane = Lane {
    job: None,
    time: 0.0,
    steps: 0,
    longest: 0.0,
    most_steps: MOST_STEPS,
    radius: 0.0,
    step: 0.0,
    start: Signs { force: 0.0, onset: 0.0, compressing: 0.0, slip: [0.0; 2], grip_left: 0.0, stick: [0.0; 2], settling: 0.0, approach: 0.0 },
    mode: Mode { side: 1.0, stick: SLIDE, direction: [1.0, 0.0] },
    hunt: None,
    slip_before: 0.0,
    falling: true,
    rise: 0.0,
    slip_compliance: 0.0,
    mu: 0.0,
    springs: false,
    by_displacement: false,
    landing: &EXACT,
    peak: [0.0; 3],
};
