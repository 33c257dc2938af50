//! One contact, stepped through time in the laboratory frame.
//!
//! Normal force: `k d^1.25` on the way in, a smaller multiple of the same law on the way out, so that the energy given
//! back is a fixed share of the energy stored at the peak: that share's root is the restitution. Traction: Coulomb's
//! limit against the direction of first sliding, then whatever holds the ball from sliding. Response to a trial impulse
//! is found by applying it, not from a closed form.

use super::body::Body;
use super::nature::{ElasticHand, FirstTouch, FrameMode, Nature};
use nalgebra::{Matrix2, Matrix3, Point3, Unit, Vector2, Vector3};

/// Exponent of the contact force.
const FORCE_EXPONENT: f64 = 1.25;
/// N / m^1.25: about 27 mm of ball and bed together and 4.6 ms at 20 m/s.
const FORCE_SCALE: f64 = 6.6e4;
/// Peak compression of such an impact, m.
pub(super) const REFERENCE_DEPTH_M: f64 = 0.027;
/// No contact of ball and strings lasts longer, s.
const LONGEST_S: f64 = 0.03;

/// Racket and ball at the instant of first touch.
#[derive(Debug, Clone, PartialEq)]
pub struct Encounter {
    pub racket: Body,
    pub ball: Body,
    pub ball_radius_m: f64,
    /// Stringbed centre from the racket's centre of mass, along racket axes, m.
    pub face_centre: Vector3<f64>,
    pub face_centre_from_butt_m: f64,
    /// Half axes of the string bed along x and y, m.
    pub half_axes: Vector2<f64>,
    pub grip_torque_n_m: f64,
    /// Order of the impact in time, from 0.
    pub order: f64,
}

/// Racket and ball at last contact.
#[derive(Debug, Clone, PartialEq)]
pub struct Aftermath {
    pub racket: Body,
    pub ball: Body,
    pub contact_time_s: f64,
    pub peak_compression_m: f64,
    pub slid_throughout: bool,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ContactError {
    #[error("ball and racket do not approach each other ({approach_m_s:.2} m/s); the swing must meet the ball")]
    NoApproach { approach_m_s: f64 },
    #[error("the contact did not end within {LONGEST_S} s; the hidden effect is too strong")]
    NoRelease,
}

impl Encounter {
    /// Stringbed centre in the laboratory.
    fn face(&self, racket: &Body) -> Point3<f64> {
        racket.position + racket.attitude * self.face_centre
    }

    /// Where on the face the ball is, from the stringbed centre, racket axes, m.
    fn place(&self, racket: &Body, ball: &Body) -> Vector2<f64> {
        (racket.attitude.inverse() * (ball.position - self.face(racket))).xy()
    }

    /// From the racket's centre of mass to a place on the handle's axis, so far from the butt; laboratory axes.
    fn arm_to(&self, from_butt_m: f64) -> Vector3<f64> {
        self.racket.attitude * (self.face_centre + Vector3::x() * (self.face_centre_from_butt_m - from_butt_m))
    }
}

/// Traction between ball and strings: what the ball remembers of its sliding.
struct Traction {
    first_direction: Vector3<f64>,
    holds: bool,
    slid_throughout: bool,
    stretch: Vector2<f64>,
}

/// Axes of the contact at one instant.
struct Frame {
    normal: Vector3<f64>,
    tangents: [Vector3<f64>; 2],
    ball_arm: Vector3<f64>,
    racket_arm: Vector3<f64>,
}

impl Frame {
    /// With the ball pressed in by `depth` (m) at a place of the face; `side` is the face's that it came to.
    fn at(e: &Encounter, nature: &Nature, side: f64, place: &Vector2<f64>, racket: &Body, ball: &Body, depth: f64) -> Self {
        let axes = racket.attitude.to_rotation_matrix();
        let (x_axis, y_axis, z_axis) = (axes * Vector3::x(), axes * Vector3::y(), axes * Vector3::z() * side);
        let mut normal = z_axis;
        if nature.pocket_tilt_rad != 0.0 {
            let steep = nature.pocket_tilt_rad * (depth / REFERENCE_DEPTH_M).max(0.0).sqrt();
            let lean = |u: f64| (1.6 * u).tanh();
            normal = z_axis - steep * (lean(place.x / e.half_axes.x) * x_axis + lean(place.y / e.half_axes.y) * y_axis);
        }
        let normal = Unit::new_normalize(normal).into_inner();
        let t1 = Unit::new_normalize(x_axis - normal * normal.dot(&x_axis)).into_inner();
        let tangents = [t1, normal.cross(&t1) * side];
        let arm = e.ball_radius_m - nature.flattening * depth.max(0.0);
        let ball_arm = -normal * arm;
        let in_face = axes * Vector3::new(place.x, place.y, 0.0) + racket.attitude * e.face_centre;
        let racket_arm = if nature.moving_geometry { ball.position + ball_arm - racket.position } else { in_face };
        Frame { normal, tangents, ball_arm, racket_arm }
    }
}

/// Ball and racket while they touch, with what an angular impulse does to each.
struct Bodies {
    racket: Body,
    racket_give: Matrix3<f64>,
    ball: Body,
    ball_give: Matrix3<f64>,
}

impl Bodies {
    /// Velocity of the ball against the racket where they touch.
    fn slip(&self, f: &Frame) -> Vector3<f64> {
        self.ball.velocity_at(&f.ball_arm) - self.racket.velocity_at(&f.racket_arm)
    }

    /// An impulse on the ball where they touch, its reverse on the racket.
    fn kick(&mut self, f: &Frame, impulse: &Vector3<f64>) {
        self.ball.kick(&self.ball_give, &f.ball_arm, impulse);
        self.racket.kick(&self.racket_give, &f.racket_arm, &-impulse);
    }

    /// An angular impulse on the ball, its reverse on the racket.
    fn twist(&mut self, couple: &Vector3<f64>) {
        self.ball.twist(&self.ball_give, couple);
        self.racket.twist(&self.racket_give, &-couple);
    }

    /// Change of slip per unit impulse along the two tangents: apply a unit impulse, see what happens.
    fn response(&self, frame: &Frame) -> Matrix2<f64> {
        let mut change = Matrix2::zeros();
        for (j, direction) in frame.tangents.iter().enumerate() {
            let (mut b, mut r) = (self.ball.clone(), self.racket.clone());
            (b.velocity, b.rate, r.velocity, r.rate) = Default::default();
            b.kick(&self.ball_give, &frame.ball_arm, direction);
            r.kick(&self.racket_give, &frame.racket_arm, &-direction);
            let slip = b.velocity_at(&frame.ball_arm) - r.velocity_at(&frame.racket_arm);
            for (i, t) in frame.tangents.iter().enumerate() {
                change[(i, j)] = slip.dot(t);
            }
        }
        change
    }
}

/// The frame's modes while the ball pushes at one place: displacement of the string plane there per unit coordinate, coordinates and their rates.
struct Bending<'a> {
    modes: &'a [FrameMode],
    shapes: Vec<f64>,
    states: Vec<(f64, f64)>,
}

impl<'a> Bending<'a> {
    fn at_rest(modes: &'a [FrameMode], shape: impl Fn(&FrameMode) -> f64) -> Self {
        Bending { modes, shapes: modes.iter().map(shape).collect(), states: vec![(0.0, 0.0); modes.len()] }
    }

    /// How far the string plane stands out toward the ball, m (below 0: it gives way).
    fn bent(&self) -> f64 {
        self.shapes.iter().zip(&self.states).map(|(phi, (q, _))| phi * q).sum()
    }

    /// How fast, m/s.
    fn rise(&self) -> f64 {
        self.shapes.iter().zip(&self.states).map(|(phi, (_, rate))| phi * rate).sum()
    }

    fn step(&mut self, load_n: f64, dt: f64) {
        for ((mode, phi), state) in self.modes.iter().zip(&self.shapes).zip(&mut self.states) {
            let w = std::f64::consts::TAU * mode.frequency_hz;
            state.1 += dt * (-phi * load_n / mode.modal_mass_kg - 2.0 * mode.damping_ratio * w * state.1 - w * w * state.0);
            state.0 += dt * state.1;
        }
    }
}

/// A hand at the handle, moving with it at first touch.
struct Hand {
    elastic: ElasticHand,
    arm: Vector3<f64>,
    velocity: Vector3<f64>,
    stretch: Vector3<f64>,
}

impl Hand {
    fn at(elastic: ElasticHand, e: &Encounter) -> Self {
        let arm = e.arm_to(elastic.from_butt_m);
        Hand { elastic, velocity: e.racket.velocity_at(&arm), arm, stretch: Vector3::zeros() }
    }

    fn pull(&mut self, racket: &mut Body, give: &Matrix3<f64>, dt: f64) {
        let rate = self.velocity - racket.velocity_at(&self.arm);
        self.stretch += rate * dt;
        let pull = self.stretch * self.elastic.stiffness_n_m + rate * self.elastic.damping_n_s_m;
        self.velocity -= pull * (dt / self.elastic.mass_kg);
        racket.kick(give, &self.arm, &(pull * dt));
    }
}

/// Steps the contact from first touch to release with time step `dt` (s).
pub fn collide(encounter: &Encounter, nature: &Nature, dt: f64) -> Result<Aftermath, ContactError> {
    let (racket, ball) = (encounter.racket.clone(), encounter.ball.clone());
    let mut bodies = Bodies { racket_give: racket.compliance(), ball_give: ball.compliance(), racket, ball };
    let first_axes = encounter.racket.attitude.to_rotation_matrix();
    let side = (encounter.racket.attitude * Vector3::z()).dot(&(encounter.ball.position - encounter.face(&encounter.racket))).signum();
    let first_place = encounter.place(&encounter.racket, &encounter.ball);
    let frame_at = |bodies: &Bodies, depth: f64| {
        let place = if nature.moving_geometry { encounter.place(&bodies.racket, &bodies.ball) } else { first_place };
        Frame::at(encounter, nature, side, &place, &bodies.racket, &bodies.ball, depth)
    };
    let mut frame = frame_at(&bodies, 0.0);
    let (touch, mut traction) = first_touch(encounter, &bodies, &frame, first_place)?;
    let mut bending = Bending::at_rest(&nature.modes, |m| side * m.shape.at(first_place, encounter.face_centre_from_butt_m));
    let mut hand = nature.hand.map(|h| Hand::at(h, encounter));
    let grip_arm = encounter.arm_to(super::impact_world::HAND_FROM_BUTT_M);
    let push = bodies.racket.velocity_at(&grip_arm).try_normalize(1e-3).unwrap_or_default();

    // Contact time goes with the root of the inverse stiffness (nearly: the force is a little steeper than linear).
    let force_scale = FORCE_SCALE / nature.softness.powf(FORCE_EXPONENT + 1.0);
    let (mut depth, mut peak, mut time) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut share: Option<f64> = None;
    loop {
        let closing = -bodies.slip(&frame).dot(&frame.normal) + bending.rise();
        if share.is_none() && closing <= 0.0 {
            share = Some(nature.returned_share(&touch, peak));
        }
        let mut load = force_scale * depth.max(0.0).powf(FORCE_EXPONENT) * if depth < peak { share.unwrap_or(1.0) } else { 1.0 };
        if nature.flux != 0.0 && share.is_none() {
            load += nature.flux * bodies.ball.mass_kg / encounter.ball_radius_m * closing * closing * (1.0 - 0.5 * depth / encounter.ball_radius_m);
        }
        if nature.drive_n != 0.0 {
            // The arm pushes while the ball is felt: in proportion to the load, saturating.
            bodies.racket.kick(&bodies.racket_give, &grip_arm, &(push * (nature.drive_n * (load / 300.0).tanh() * dt)));
        }
        let normal_impulse = load * dt;
        bodies.kick(&frame, &(frame.normal * normal_impulse));
        let slip = bodies.slip(&frame);
        let held = traction_impulse(&mut traction, nature, &frame, &slip, load, dt, || bodies.response(&frame));
        bodies.kick(&frame, &held);
        if nature.inertia_loss_per_m != 0.0 && depth > 0.0 {
            // A flattened ball turns more easily: the same torque does more.
            bodies.ball.twist(&bodies.ball_give, &(frame.ball_arm.cross(&held) * (nature.inertia_loss_per_m * depth)));
        }
        if nature.trailing_m != 0.0 {
            let lag = -traction.first_direction * (nature.trailing_m * (1.0 - (-touch.slip_m_s / 6.0).exp()));
            bodies.twist(&lag.cross(&(frame.normal * normal_impulse)));
        }
        if nature.pivot_radius_m != 0.0 {
            let turning = (bodies.ball.rate - bodies.racket.rate).dot(&frame.normal);
            bodies.twist(&(frame.normal * (-nature.friction * nature.pivot_radius_m * normal_impulse * (turning / 30.0).tanh())));
        }
        bending.step(load, dt);
        if let Some(hand) = &mut hand {
            hand.pull(&mut bodies.racket, &bodies.racket_give, dt);
        }
        if nature.grip_share != 0.0 {
            let axis = bodies.racket.attitude * Vector3::x();
            let twist = bodies.racket.rate.dot(&axis);
            let torque = nature.grip_share * encounter.grip_torque_n_m * (twist / 4.0).tanh();
            bodies.racket.twist(&bodies.racket_give, &(-axis * torque * dt));
        }

        depth += dt * (-bodies.slip(&frame).dot(&frame.normal) + bending.rise());
        peak = peak.max(depth);
        time += dt;
        if nature.moving_geometry {
            bodies.racket.precess(dt);
        }
        bodies.ball.drift(dt);
        let attitude = bodies.racket.attitude;
        bodies.racket.drift(dt);
        if nature.moving_geometry {
            bodies.racket_give = bodies.racket.compliance();
            frame = frame_at(&bodies, depth);
        } else {
            bodies.racket.attitude = attitude; // forces see the face as it was at first touch; the turn is added at the end
            if nature.pocket_tilt_rad != 0.0 || nature.flattening != 0.0 {
                frame = frame_at(&bodies, depth);
            }
        }
        if depth <= 0.0 && share.is_some() {
            break;
        }
        if time > LONGEST_S {
            return Err(ContactError::NoRelease);
        }
    }
    let Bodies { mut racket, mut ball, .. } = bodies;
    if !nature.moving_geometry {
        // Mean rate over the contact, for pictures only: the outcome of an impulse does not depend on it.
        let mean = 0.5 * (encounter.racket.rate + racket.rate);
        racket.attitude = nalgebra::UnitQuaternion::from_scaled_axis(mean * time) * nalgebra::UnitQuaternion::from_rotation_matrix(&first_axes);
        // The forces saw the face as it was; the ball must leave the face as it is: one radius from it, less what the frame is
        // bent. Left where the unturned face let it go, a ball that slid across a twisting face lay up to 12 mm inside the strings.
        let normal = racket.attitude * Vector3::z() * side;
        ball.position += normal * (encounter.ball_radius_m + bending.bent() - (ball.position - encounter.face(&racket)).dot(&normal));
    }
    Ok(Aftermath { racket, ball, contact_time_s: time, peak_compression_m: peak, slid_throughout: traction.slid_throughout })
}

/// How ball and strings meet, and the traction before anything has slid.
fn first_touch(e: &Encounter, bodies: &Bodies, frame: &Frame, place: Vector2<f64>) -> Result<(FirstTouch, Traction), ContactError> {
    let first = bodies.slip(frame);
    let approach = -first.dot(&frame.normal);
    if approach <= 0.0 {
        return Err(ContactError::NoApproach { approach_m_s: approach });
    }
    let slip = first - frame.normal * first.dot(&frame.normal);
    let touch = FirstTouch {
        place,
        half_axes: e.half_axes,
        approach_m_s: approach,
        slip_m_s: slip.norm(),
        spin_across_rad_s: (e.ball.rate - frame.normal * e.ball.rate.dot(&frame.normal)).norm(),
        grip_torque_n_m: e.grip_torque_n_m,
        order: e.order,
    };
    let traction = Traction {
        first_direction: slip.try_normalize(1e-9).unwrap_or(frame.tangents[0]),
        holds: slip.norm() < 1e-9,
        slid_throughout: true,
        stretch: Vector2::zeros(),
    };
    Ok((touch, traction))
}

/// Tangential impulse on the ball during one step.
fn traction_impulse(
    memory: &mut Traction,
    nature: &Nature,
    frame: &Frame,
    slip: &Vector3<f64>,
    load_n: f64,
    dt: f64,
    response: impl Fn() -> Matrix2<f64>,
) -> Vector3<f64> {
    let limit = nature.traction_limit(load_n);
    let planar = Vector2::new(slip.dot(&frame.tangents[0]), slip.dot(&frame.tangents[1]));
    let lift = |v: Vector2<f64>| frame.tangents[0] * v.x + frame.tangents[1] * v.y;
    if let Some(springs) = &nature.lateral {
        // Strings stretched sideways by the ball; they slip under it when the pull exceeds the traction limit.
        let (s, c) = springs.soft_direction_rad.sin_cos();
        let turned = Vector2::new(c * planar.x + s * planar.y, -s * planar.x + c * planar.y);
        let mut force = Vector2::from_fn(|i, _| -springs.stiffness_n_m[i] * memory.stretch[i] - springs.damping_n_s_m[i] * turned[i]);
        let size = force.norm();
        let rate = if size > limit {
            // The ball slides over the strings, which creep under what traction is left.
            force *= limit / size;
            Vector2::from_fn(|i, _| -(force[i] + springs.stiffness_n_m[i] * memory.stretch[i]) / springs.damping_n_s_m[i])
        } else {
            memory.slid_throughout = false;
            turned
        };
        memory.stretch += rate * dt;
        return lift(Vector2::new(c * force.x - s * force.y, s * force.x + c * force.y)) * dt;
    }
    let first = Vector2::new(memory.first_direction.dot(&frame.tangents[0]), memory.first_direction.dot(&frame.tangents[1]));
    if !memory.holds && planar.dot(&first) > 0.0 {
        // The last sliding step only takes what is left.
        let need = response().try_inverse().map_or(f64::INFINITY, |m| (m * planar).norm());
        if need > limit * dt {
            return lift(-first * (limit * dt));
        }
    }
    memory.holds = true;
    memory.slid_throughout = false;
    let need = response().try_inverse().map_or_else(Vector2::zeros, |m| -(m * planar));
    let size = need.norm();
    lift(if size > limit * dt { need * (limit * dt / size) } else { need })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::hidden::{Hidden, entries, nature};
    use crate::synthetic::impact_world::{Kind, WorldImpact, draw, equipment, meet};
    use rand::SeedableRng;

    fn impacts(kind: Kind, n: usize, world: &Nature) -> Vec<WorldImpact> {
        let mut rng = rand_chacha::ChaCha12Rng::seed_from_u64(11);
        let (racket, ball) = equipment();
        (0..n).map(|i| meet(&racket, &ball, &draw(kind, i as f64, &mut rng), world).expect("they meet")).collect()
    }

    #[test]
    fn truth_a_head_on_hit_of_the_balance_point_is_that_of_two_free_bodies() {
        let (racket, ball) = equipment();
        let mut rng = rand_chacha::ChaCha12Rng::seed_from_u64(1);
        let mut approach = draw(Kind::Lab, 0.0, &mut rng);
        approach.ball = Vector3::new(0.0, 0.0, -25.0);
        approach.ball_spin = Vector3::zeros();
        approach.place = racket.com_local().coords.xy();
        let world = Nature::default();
        let out = meet(&racket, &ball, &approach, &world).expect("they meet").truth;
        // Momentum and restitution of two bodies on one line.
        let (m, big) = (ball.mass_kg, racket.mass_kg);
        let expected = -25.0 * (m - world.restitution * big) / (m + big);
        assert!((out.ball_out.z - expected).abs() < 2e-3, "{} {expected}", out.ball_out.z);
        assert!(out.ball_out.xy().norm() < 1e-9 && out.racket_out_rate.norm() < 1e-9);
        assert!((3e-3..6.5e-3).contains(&out.contact_time), "{}", out.contact_time);
    }

    #[test]
    fn law_linear_and_angular_momentum_are_kept_when_nothing_holds_the_racket() {
        let world = nature(&[Hidden::new("lateral-strings", 1.0), Hidden::new("ball-damping", 1.0)]).expect("known");
        for hit in impacts(Kind::Court, 20, &world) {
            let (e, a) = (&hit.encounter, &hit.aftermath);
            let linear = |r: &Body, b: &Body| r.velocity * r.mass_kg + b.velocity * b.mass_kg;
            assert!((linear(&e.racket, &e.ball) - linear(&a.racket, &a.ball)).norm() < 1e-10);
            // About the contact point of the first instant, where every impulse acts.
            let arm = |b: &Body, p: &nalgebra::Point3<f64>| b.position - p;
            let to_ball = e.ball.position - e.racket.position - e.racket.attitude * e.face_centre;
            let n = e.racket.attitude * Vector3::z();
            let point = e.ball.position - n * n.dot(&to_ball);
            let spin = |b: &Body, rate: &Vector3<f64>| b.compliance().try_inverse().expect("a body") * rate;
            for (before, after) in [(&e.racket, &a.racket), (&e.ball, &a.ball)] {
                let frozen = Body { attitude: before.attitude, ..after.clone() };
                let about = |now: &Body| spin(&frozen, &now.rate) + arm(before, &point).cross(&now.velocity) * before.mass_kg;
                assert!((about(before) - about(after)).norm() < 1e-9, "every impulse passes through the contact point");
            }
        }
    }

    #[test]
    fn ladder_a_finer_step_changes_less_than_a_tenth_of_the_noise() {
        for e in entries() {
            let world = nature(&[Hidden::new(e.name, 1.0)]).expect("known");
            for hit in impacts(Kind::Lab, 4, &world) {
                let fine = collide(&hit.encounter, &world, super::super::impact_world::TIME_STEP_S / 10.0).expect("they meet");
                let change = fine.ball.velocity - hit.aftermath.ball.velocity;
                assert!(change.norm() < 0.01, "{}: {change}", e.name);
                assert!((fine.ball.rate - hit.aftermath.ball.rate).norm() < 0.8, "{}", e.name);
            }
        }
    }

    #[test]
    fn law_passive_worlds_never_gain_energy() {
        let energy = |b: &Body| {
            let local = b.attitude.inverse() * b.rate;
            0.5 * b.mass_kg * b.velocity.norm_squared() + 0.5 * b.inertia_kg_m2.component_mul(&local).dot(&local)
        };
        for name in ["frame-vibration", "lateral-strings", "ball-damping", "string-tilt", "friction-law", "pivot-spin-loss", "diagonal-strings"] {
            let world = nature(&[Hidden::new(name, 1.0)]).expect("known");
            for hit in impacts(Kind::Lab, 30, &world) {
                let (before, after) = (energy(&hit.encounter.ball), energy(&hit.aftermath.ball) + energy(&hit.aftermath.racket));
                assert!(after < before, "{name}: {before} -> {after} J");
            }
        }
    }

    #[test]
    fn fails_a_ball_that_flies_away_is_refused() {
        let world = Nature::default();
        let mut e = impacts(Kind::Lab, 1, &world).remove(0).encounter;
        e.ball.velocity = -e.ball.velocity;
        assert!(matches!(collide(&e, &world, 1e-5), Err(ContactError::NoApproach { .. })));
    }
}
