//! A contact that lasts: while the impulse acts, the face turns under the ball, the ball travels across it and sinks in.
//!
//! The normal impulse of an instantaneous contact is cut into equal parts, each of which acts where racket and ball then are;
//! between them both move freely, the racket's angular momentum kept in the laboratory. The parts follow the time law of a spring
//! that gives back the share e² of its energy: a quarter of a sine while it is compressed, a slower one (by 1/e) while it expands.
//! At last contact the normal impulse is completed so that the work returned is e² times the work absorbed (Stronge's energetic
//! coefficient), and a ball that holds the strings holds them as they then stand. Coulomb's friction acts with every part, along
//! the first slip until that is used up. A contact of no duration is the instantaneous one, but for balls on the edge of sliding.

use super::collision::{Impulse, Regime, pocket, response, slip_axes};
use super::contact::Contact;
use super::laws::{Laws, Sliding};
use crate::impact::real::{Real, rotation};
use nalgebra::{Matrix3, Vector3};

/// Parts of the impulse while the spring is compressed, and again while it expands. With twice as many the outcome moves by less than
/// a hundredth of what the duration does.
const PARTS: usize = 5;

/// Racket and ball along the axes of the face as it stands.
struct Bodies<'a, T: Real> {
    at: &'a Contact<'a, T>,
    laws: &'a Laws<T>,
    /// Contact axes (tilted pocket) in face axes.
    frame: Matrix3<T>,
    /// From the ball's centre to the contact point; displacement of the normal force.
    arm: Vector3<T>,
    offset: Vector3<T>,
    ball: Vector3<T>,
    spin: Vector3<T>,
    racket: Vector3<T>,
    angular_momentum: Vector3<T>,
    /// Ball's centre from the racket's centre of mass.
    centre: Vector3<T>,
    /// Contact point from the racket's centre of mass.
    lever: Vector3<T>,
    /// Face axes to those at first touch.
    turn: Matrix3<T>,
}

impl<T: Real> Bodies<'_, T> {
    fn rate(&self) -> Vector3<T> {
        self.angular_momentum.component_div(&self.at.body.racket_inertia)
    }

    /// Free motion for a time; the contact point then lies `depth` behind the frame.
    fn drift(&mut self, time: T, depth: T) {
        let by = rotation(&(self.rate() * time));
        self.centre += (self.ball - self.racket) * time;
        for v in [&mut self.ball, &mut self.spin, &mut self.racket, &mut self.angular_momentum, &mut self.centre] {
            *v = by.tr_mul(v);
        }
        self.turn *= by;
        self.lever = Vector3::new(self.centre.x, self.centre.y, depth * -self.at.side);
    }

    /// Slip in contact axes.
    fn slip(&self) -> Vector3<T> {
        self.frame.tr_mul(&(self.ball + self.spin.cross(&self.arm) - self.racket - self.rate().cross(&self.lever)))
    }

    /// An impulse on the ball, in contact axes.
    fn kick(&mut self, j: Vector3<T>) {
        let b = self.at.body;
        let push = self.frame.column(2) * j.z;
        let j = self.frame * j;
        self.ball += j / b.ball_mass;
        self.spin += (self.arm.cross(&j) + self.offset.cross(&push)) / self.laws.ball_inertia;
        self.racket -= j / b.racket_mass;
        self.angular_momentum -= self.lever.cross(&j) + self.offset.cross(&push);
    }

    /// The push of a part `share` of the whole, with what acts from outside meanwhile.
    fn push(&mut self, normal: T, share: T) {
        let before = self.angular_momentum.x;
        self.kick(Vector3::new(T::zero(), T::zero(), normal * self.at.side));
        self.racket += self.laws.drive * (share / self.at.body.racket_mass);
        self.angular_momentum += self.laws.drive_twist * share;
        let (twist, most) = (self.angular_momentum.x - before, (self.laws.twist_hold * share).abs());
        self.angular_momentum.x -= twist.min(most).max(-most);
    }
}

/// How the push is parted: equal parts of its impulse while the ball comes, equal parts while it leaves.
struct Phases<T> {
    /// Impulse until the ball stops, and what of it comes again.
    compression: T,
    restitution: T,
    closing_s: T,
    opening_s: T,
    lasts_s: T,
}

impl<T: Real> Phases<T> {
    /// Impulse of a part, when it has half passed, and how deep the bed is then, as a share.
    fn part(&self, part: usize) -> (T, T, f64) {
        let middle = ((part % PARTS) as f64 + 0.5) / PARTS as f64;
        // Angle of the quarter sine at which this part of the impulse has half passed.
        match part / PARTS {
            0 => {
                let then = self.closing_s * ((1.0 - middle).acos() * std::f64::consts::FRAC_2_PI);
                (self.compression / PARTS as f64, then, (1.0 - (1.0 - middle).powi(2)).sqrt())
            }
            1 => {
                let then = self.closing_s + self.opening_s * (middle.asin() * std::f64::consts::FRAC_2_PI);
                (self.restitution * self.compression / PARTS as f64, then, (1.0 - middle * middle).sqrt())
            }
            _ => (T::zero(), self.lasts_s, 0.0),
        }
    }
}

/// Friction from part to part.
struct Friction<T> {
    law: Sliding,
    /// The slip has stopped.
    holds: bool,
    /// Direction of the slip.
    along: [T; 2],
}

impl<T: Real> Friction<T> {
    /// Impulse on the ball beside a part of the push that allows `limit`; `stick` would hold the slip where it belongs. The last part decides
    /// nothing.
    fn impulse(&mut self, slip: &Vector3<T>, stick: [T; 2], limit: T, last: bool) -> [T; 2] {
        let needed = stick[0].hypot(stick[1]);
        let forward = slip.x * self.along[0] + slip.y * self.along[1];
        if !last {
            self.holds = self.holds || forward.value() <= 0.0 || needed.value() <= limit.value();
        }
        if !self.holds {
            if self.law == Sliding::Exact {
                let size = slip.x.hypot(slip.y);
                self.along = [slip.x / size, slip.y / size];
            }
            [-limit * self.along[0], -limit * self.along[1]]
        } else if last || needed.value() <= limit.value() {
            stick
        } else {
            [stick[0] * limit / needed, stick[1] * limit / needed]
        }
    }
}

/// The whole of a lasting contact, as impulses along the axes at first touch that lead to its outcome. `instant`: the same
/// contact without duration.
pub(super) fn collide_lasting<T: Real>(at: &Contact<T>, laws: &Laws<T>, instant: &Impulse<T>) -> Impulse<T> {
    let (zero, side) = (T::zero(), at.side);
    let (frame, arm) = pocket(at, laws);
    let mut bodies = Bodies {
        at,
        laws,
        frame,
        arm,
        offset: frame.column(0) * laws.arm_offset[0] + frame.column(1) * laws.arm_offset[1],
        ball: at.input.ball_velocity,
        spin: at.input.ball_spin,
        racket: at.input.racket_velocity,
        angular_momentum: at.input.racket_rate.component_mul(&at.body.racket_inertia),
        centre: at.lever + Vector3::new(zero, zero, T::constant(side * at.body.ball_radius)),
        lever: at.lever,
        turn: Matrix3::identity(),
    };
    let axes = slip_axes(laws, &frame);
    let first = axes.map_or_else(|| bodies.slip(), |axes| axes.tr_mul(&bodies.slip()));
    let size = first.x.hypot(first.y);
    let along = if size.value() > 0.0 { [first.x / size, first.y / size] } else { [zero; 2] };
    bodies.offset -= (frame.column(0) * along[0] + frame.column(1) * along[1]) * laws.normal_offset;
    let held_slip = laws.rebound([first.x, first.y]);

    let e = laws.effective_restitution();
    let whole = instant.ball.dot(&frame.column(2)) * side;
    if whole.value() <= 0.0 {
        return *instant;
    }
    let (compression, lasts) = (whole / (e + 1.0), at.duration(laws.face_time));
    let phases = Phases { compression, restitution: e, closing_s: lasts * e / (e + 1.0), opening_s: lasts / (e + 1.0), lasts_s: lasts };
    let depth = laws.bed_share * at.approach_speed * phases.closing_s * std::f64::consts::FRAC_2_PI;
    let mut friction = Friction { law: laws.sliding, holds: size.value() == 0.0, along };
    let (mut now, mut given) = (zero, zero);
    // Work of the normal force on the spring: all of it, and what was absorbed.
    let (mut work, mut absorbed) = (zero, zero);
    for part in 0..=2 * PARTS {
        let (normal, then, sunk) = phases.part(part);
        bodies.drift(then - now, depth * sunk);
        now = then;
        let k = response(at.body, laws, &bodies.frame, &bodies.arm, &bodies.lever, &bodies.offset);
        let before = -bodies.slip().z * side;
        let last = part == 2 * PARTS;
        // The last one completes the work: what it must still absorb, from a separation that it changes by K.
        let normal = if last {
            let still = (-(e * e) + 1.0) * absorbed - work;
            ((before * before - k[(2, 2)] * still * 2.0).max(zero).sqrt() + before) / k[(2, 2)]
        } else {
            normal
        };
        given += normal;
        let share = given / whole;
        bodies.push(normal, normal / whole);
        // Slip along the face as it stands when the ball comes and when it leaves, by impulses along the leaning pocket.
        let k = axes.map_or(k, |axes| axes.tr_mul(&k));
        let slip = axes.map_or_else(|| bodies.slip(), |axes| axes.tr_mul(&bodies.slip()));
        let wish = [held_slip[0] * share - slip.x, held_slip[1] * share - slip.y];
        let det = k[(0, 0)] * k[(1, 1)] - k[(0, 1)] * k[(1, 0)];
        let stick = [(k[(1, 1)] * wish[0] - k[(0, 1)] * wish[1]) / det, (k[(0, 0)] * wish[1] - k[(1, 0)] * wish[0]) / det];
        let [along, across] = friction.impulse(&slip, stick, laws.friction * normal, last);
        bodies.kick(Vector3::new(along, across, zero));
        let after = -bodies.slip().z * side;
        let done = (before + after) * normal * 0.5;
        work += done;
        absorbed += match (before.value() > 0.0, after.value() > 0.0) {
            (true, true) => done,
            (true, false) => before * before / (before - after) * normal * 0.5,
            _ => zero,
        };
    }
    let (turn, b, i) = (bodies.turn, at.body, &at.input);
    let regime = if friction.holds { Regime::Stick } else { Regime::Slide };
    let rate = turn * bodies.rate();
    Impulse {
        ball: (turn * bodies.ball - i.ball_velocity) * b.ball_mass,
        ball_angular: (turn * bodies.spin - i.ball_spin) * laws.ball_inertia,
        racket: (turn * bodies.racket - i.racket_velocity) * b.racket_mass,
        racket_angular: (rate - i.racket_rate).component_mul(&b.racket_inertia),
        regime,
        spare_friction: instant.spare_friction,
    }
}
