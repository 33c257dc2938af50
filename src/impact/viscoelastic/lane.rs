//! One lane's bookkeeping: how far a step may go, whether it has crossed a kink, what comes next.

use super::kernel::{CREEP, Mode, ONSET, SLIDE, STICK, Signs};
use super::number::{Number, side_by_side};
use crate::impact::error::ModelError;

/// Contact longer than this is an error of the model, s.
pub(super) const LONGEST_S: f64 = 20e-3;
/// Steps after which a contact is given up: only parameters at the edge of their range come near.
pub(super) const MOST_STEPS: f64 = 20_000.0;
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

side_by_side! {
    /// How far one impact has come, and what its steps depend on.
    pub(super) struct Pace {
        /// s.
        time,
        steps,
        most_steps,
        /// s.
        longest,
        step,
        /// Of the ball, m: no ball is squeezed further.
        radius,
        /// Slip at the last step, m/s, and whether (1) it has fallen since the one before.
        slip_before,
        falling,
        /// How fast the force grew over the last step, N/s; 0 while it falls.
        rise,
        /// Slip velocity per unit of tangential impulse, 1/kg; coefficient of friction.
        slip_compliance,
        mu,
        /// 1: friction acts through sideways springs: no stick, no slip of its own.
        springs,
        /// 1: the contact ends by displacement, not by force.
        by_displacement,
        /// Greatest force (N), compression and deflection (m).
        peak_force,
        peak_compression,
        peak_deflection,
    }
}

/// One impact on its way, or several side by side.
#[derive(Clone, Copy)]
pub(super) struct Lane<T = f64> {
    pub pace: Pace<T>,
    /// At the start of the step.
    pub start: Signs<T>,
    pub mode: Mode<T>,
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
fn watch(kind: usize, lane: &Lane, end: &Signs, landing: &Landing) -> (f64, f64, bool) {
    let start = &lane.start;
    let (springs, by_displacement) = (lane.pace.springs > 0.0, lane.pace.by_displacement > 0.0);
    let changes = |a: f64, b: f64| a.abs() > landing[kind] && a * b < 0.0;
    match kind {
        0 if by_displacement => (BACK_IN_PLACE * start.approach, BACK_IN_PLACE * end.approach, end.approach <= 0.0),
        0 => (start.force, end.force, end.force <= 0.0),
        1 => (start.onset, end.onset, changes(start.onset, end.onset)),
        2 => (start.compressing, end.compressing, changes(start.compressing, end.compressing)),
        4 if springs => (start.grip_left, end.grip_left, changes(start.grip_left, end.grip_left)),
        3 if lane.mode.stick == SLIDE && !springs => {
            let size = start.slip();
            let after = end.slip_x * lane.mode.direction_x + end.slip_y * lane.mode.direction_y;
            (size, after, size > landing[3] && after <= 0.0)
        }
        4 if lane.mode.stick == STICK => (start.grip_left, end.grip_left, start.grip_left > 0.0 && end.grip_left < 0.0),
        5 if by_displacement => (start.force, end.force, changes(start.force, end.force)),
        _ => (1.0, 1.0, false),
    }
}

/// What vanishes at a kink of kind `kind`, for a contact that runs through modes `mode`.
pub(super) fn vanishing<T: Number>(kind: usize, by_displacement: bool, mode: &Mode, end: &Signs<T>) -> T {
    match kind {
        0 if by_displacement => end.approach,
        1 => end.onset,
        2 => end.compressing,
        3 => end.slip_x * mode.direction_x + end.slip_y * mode.direction_y,
        4 => end.grip_left,
        _ => end.force,
    }
}

#[inline(always)]
fn changes<T: Number>(a: T, b: T, landing: f64) -> T::Mask {
    a.same(landing).less(a.size()) & (a * b).less(a.same(0.0))
}

/// What a lane does after a step.
pub(super) enum Verdict {
    /// Take the step; whether the mode has changed, so that the rates at its end must be computed anew; which kind of kink it
    /// has ended at.
    Accept(bool, Option<usize>),
    /// Do it again with the lane's new step.
    Again,
    /// Last contact, or an error.
    Done(Result<(), ModelError>),
}

impl<T: Number> Lane<T> {
    #[inline(always)]
    pub fn same(like: T, one: &Lane) -> Self {
        Lane { pace: Pace::same(like, &one.pace), start: Signs::same(like, &one.start), mode: Mode::same(like, &one.mode) }
    }

    #[inline(always)]
    pub fn lane(&self, i: usize) -> Lane {
        Lane { pace: self.pace.lane(i), start: self.start.lane(i), mode: self.mode.lane(i) }
    }

    #[inline(always)]
    pub fn set_lane(&mut self, i: usize, one: &Lane) {
        self.pace.set_lane(i, &one.pace);
        self.start.set_lane(i, &one.start);
        self.mode.set_lane(i, &one.mode);
    }

    /// Accepts the step where the mask holds.
    #[inline(always)]
    pub fn accept_where(&mut self, mask: T::Mask, end: &Signs<T>, deflection: T) {
        let mut next = *self;
        next.accept(end, deflection);
        self.pace.replace(mask, &next.pace);
        self.start.replace(mask, &next.start);
        self.mode.replace(mask, &next.mode);
    }

    /// 0 where the step can be accepted as it is, 1 where [`Lane::judge`] must look: a kink, a change of mode, an end.
    #[inline(always)]
    pub fn busy(&self, end: &Signs<T>, finite: T::Mask, landing: &Landing) -> T {
        let (pace, start) = (&self.pace, &self.start);
        let (zero, half, one) = (end.force.same(0.0), end.force.same(0.5), end.force.same(1.0));
        let by_displacement = half.less(pace.by_displacement);
        let springs = half.less(pace.springs);
        let free = pace.springs.less(half);
        let (sliding, creeping) = (self.mode.stick.less(half) & free, self.mode.stick.same(1.5).less(self.mode.stick));
        let slip = (end.slip_x * end.slip_x + end.slip_y * end.slip_y).sqrt();
        let before = (start.slip_x * start.slip_x + start.slip_y * start.slip_y).sqrt();
        let after = end.slip_x * self.mode.direction_x + end.slip_y * self.mode.direction_y;
        let nil = zero.same(f64::MIN_POSITIVE);
        let spent = sliding & zero.same(landing[3]).less(before) & after.less(nil);
        let stops = sliding & slip.less(pace.slip_before) & slip.less(zero.same(STICK_SLIP)) & (-nil).less(end.grip_left);
        let gives = half.less(self.mode.stick) & free & zero.less(start.grip_left) & end.grip_left.less(zero);
        let kink = changes(start.onset, end.onset, landing[1])
            | changes(start.compressing, end.compressing, landing[2])
            | spent
            | stops
            | (springs & changes(start.grip_left, end.grip_left, landing[4]))
            | gives
            | creeping
            | (by_displacement & changes(start.force, end.force, landing[5]));
        let lasts = zero.less(T::choose(by_displacement, end.approach, end.force))
            & pace.steps.less(pace.most_steps)
            & pace.time.less(zero.same(LONGEST_S))
            & end.onset.less(pace.radius - ONSET)
            & finite;
        T::choose(lasts, T::choose(kink, one, zero), one)
    }

    #[inline(always)]
    fn accept(&mut self, end: &Signs<T>, deflection: T) {
        let (pace, mode) = (&mut self.pace, &mut self.mode);
        pace.time = pace.time + pace.step;
        pace.rise = ((end.force - self.start.force) / pace.step).positive_part();
        self.start = *end;
        let (zero, half, one) = (end.force.same(0.0), end.force.same(0.5), end.force.same(1.0));
        let slip = (end.slip_x * end.slip_x + end.slip_y * end.slip_y).sqrt();
        let turns = mode.stick.less(half) & pace.springs.less(half) & zero.same(1e-6).less(slip);
        mode.direction_x = T::choose(turns, end.slip_x / slip, mode.direction_x);
        mode.direction_y = T::choose(turns, end.slip_y / slip, mode.direction_y);
        pace.falling = T::choose(slip.less(pace.slip_before), one, zero);
        pace.slip_before = slip;
        pace.peak_force = pace.peak_force.larger(end.force);
        pace.peak_compression = pace.peak_compression.larger(end.onset + ONSET);
        pace.peak_deflection = pace.peak_deflection.larger(deflection);
        self.set_step();
    }

    /// Sets the length of the next step.
    #[inline(always)]
    pub fn set_step(&mut self) {
        let (pace, start, stick) = (&mut self.pace, &self.start, self.mode.stick);
        let half = stick.same(0.5);
        let step = pace.longest.smaller((start.settling * SETTLING_SHARE).larger(pace.longest * SHORTEST_SHARE));
        let slip = (start.slip_x * start.slip_x + start.slip_y * start.slip_y).sqrt();
        let force = start.force + pace.rise * step * 0.5;
        let used = pace.slip_compliance * pace.mu * force * step;
        let share = T::choose(half.less(pace.falling), slip.same(SLIP_SHARE), slip.same(GROWING_SHARE)) * slip;
        let shortens = stick.less(half) & pace.springs.less(half) & share.less(used);
        let factor = T::choose(shortens, (share / used).larger(slip.same(1.0 / 4096.0)), slip.same(1.0));
        let creeping = stick.same(1.5).less(stick);
        pace.step = step * T::choose(creeping, slip.same(CREEP_SHARE), factor);
    }
}

impl Lane {
    /// What becomes of a step that is not an ordinary one; `hunt` is the search for its kink.
    pub fn judge(&mut self, hunt: &mut Option<Hunt>, end: &Signs, deflection: f64, finite: bool, landing: &Landing) -> Verdict {
        if !finite {
            return Verdict::Done(Err(ModelError::NotFinite));
        }
        // A ball squeezed beyond its radius is outside the equations; its contact counts as one that does not end.
        if self.pace.steps > self.pace.most_steps || self.pace.time > LONGEST_S || end.onset + ONSET > self.pace.radius {
            return Verdict::Done(Err(ModelError::NoRelease { elapsed_s: self.pace.time, force_n: end.force }));
        }
        if let Some(now) = *hunt {
            let (_, value, _) = watch(now.kind, self, end, landing);
            if value.abs() <= landing[now.kind] || now.tries >= 60 || now.high.0 - now.low.0 < 1e-15 {
                *hunt = None;
                return self.land(now.kind, end, deflection);
            }
            let mut next = Hunt { tries: now.tries + 1, ..now };
            let step = self.pace.step;
            match self.first_kink(end, landing) {
                // A kink of another kind hides in the shorter step; it comes first.
                Some((kind, before, after)) if kind != now.kind => next = Hunt { kind, low: (0.0, before), high: (step, after), moved: 0, tries: next.tries },
                // The watched value's sign tells on which side of the kink this try has landed. Illinois: an end that stays
                // twice running counts half, so that both ends move.
                _ if value * now.high.1 > 0.0 => {
                    next.high = (step, value);
                    next.low.1 *= if now.moved > 0 { 0.5 } else { 1.0 };
                    next.moved = 1;
                }
                _ => {
                    next.low = (step, value);
                    next.high.1 *= if now.moved < 0 { 0.5 } else { 1.0 };
                    next.moved = -1;
                }
            }
            self.pace.step = next.aim();
            *hunt = Some(next);
            return Verdict::Again;
        }
        if let Some((kind, before, after)) = self.first_kink(end, landing) {
            if after.abs() <= landing[kind] {
                return self.land(kind, end, deflection);
            }
            let first = Hunt { kind, low: (0.0, before), high: (self.pace.step, after), moved: 0, tries: 0 };
            self.pace.step = first.aim();
            *hunt = Some(first);
            return Verdict::Again;
        }
        let before = self.mode.stick;
        self.change_mode(end);
        self.accept(end, deflection);
        Verdict::Accept(self.mode.stick != before, None)
    }

    fn first_kink(&self, end: &Signs, landing: &Landing) -> Option<(usize, f64, f64)> {
        let mut first: Option<(usize, f64, f64, f64)> = None;
        for kind in 0..landing.len() {
            let (before, after, kink) = watch(kind, self, end, landing);
            if kink {
                let share = before / (before - after);
                if first.is_none_or(|f| share < f.3) {
                    first = Some((kind, before, after, share));
                }
            }
        }
        first.map(|(kind, before, after, _)| (kind, before, after))
    }

    /// Ends the step at a kink.
    fn land(&mut self, kind: usize, end: &Signs, deflection: f64) -> Verdict {
        if kind == 0 {
            self.pace.time += self.pace.step;
            self.pace.peak_deflection = self.pace.peak_deflection.max(deflection);
            return Verdict::Done(Ok(()));
        }
        let before = self.mode.stick;
        self.change_mode(end);
        self.accept(end, deflection);
        // Slip that is used up without a hold, and a hold that gives way: both creep first.
        if ((kind == 3 && self.mode.stick == SLIDE) || kind == 4) && self.pace.springs == 0.0 {
            self.mode.stick = if kind == 3 && end.grip_left >= 0.0 { STICK } else { CREEP };
            self.pace.slip_before = 0.0;
        }
        self.set_step();
        Verdict::Accept(self.mode.stick != before, Some(kind))
    }

    /// Slide to stick, and what becomes of a creep. Where springs act, their own deflection says how friction does.
    fn change_mode(&mut self, end: &Signs) {
        if self.pace.springs > 0.0 {
            return;
        }
        let slip = end.slip();
        if self.mode.stick == SLIDE {
            if slip < self.pace.slip_before && slip <= STICK_SLIP && end.grip_left >= 0.0 {
                self.mode.stick = STICK;
            }
        } else if self.mode.stick == CREEP {
            if end.grip_left >= 0.0 {
                self.mode.stick = STICK;
            } else if slip > STICK_SLIP {
                self.mode.stick = SLIDE;
            }
        }
    }
}

impl Hunt {
    /// The step at which the watched quantity should vanish.
    fn aim(&self) -> f64 {
        let ((a, ga), (b, gb)) = (self.low, self.high);
        let share = if ga == gb { 0.5 } else { (ga / (ga - gb)).clamp(0.01, 0.99) };
        // After many tries halve: an odd function must not hold the stepper.
        if self.tries > 20 { 0.5 * (a + b) } else { a + share * (b - a) }
    }
}
