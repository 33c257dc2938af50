//! Where racket and ball are at any instant of a shot: swing or rest, contact, recoil; flight with drag, lift and gravity.

use super::body::Body;
use super::impact_world::{HAND_FROM_BUTT_M, WorldImpact};
use crate::equipment::Racket;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

/// Spacing of the stored path, s.
const STEP_S: f64 = 1e-4;
/// In axes whose second one points up, m/s².
pub(super) const GRAVITY: Vector3<f64> = Vector3::new(0.0, -9.81, 0.0);
/// Density of air.
pub(super) const AIR_KG_M3: f64 = 1.19;

#[derive(Debug, Clone, Copy)]
struct Instant {
    place: Point3<f64>,
    velocity: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
}

/// The path of one body on a regular time grid.
#[derive(Debug, Clone)]
pub struct Path {
    start_s: f64,
    instants: Vec<Instant>,
}

impl Path {
    /// Pose at `t`: cubic between stored places, great-circle between stored attitudes; held at the ends.
    pub fn pose(&self, t: f64) -> Isometry3<f64> {
        let last = self.instants.len() - 1;
        let x = ((t - self.start_s) / STEP_S).clamp(0.0, last as f64);
        let i = (x as usize).min(last.saturating_sub(1));
        let (a, b, s) = (&self.instants[i], &self.instants[(i + 1).min(last)], x - i as f64);
        let place = hermite(a, b, s, STEP_S);
        Isometry3::from_parts(place.into(), a.attitude.try_slerp(&b.attitude, s, 1e-12).unwrap_or(a.attitude))
    }
}

fn hermite(a: &Instant, b: &Instant, s: f64, span: f64) -> Point3<f64> {
    let (s2, s3) = (s * s, s * s * s);
    Point3::from(
        a.place.coords * (2.0 * s3 - 3.0 * s2 + 1.0)
            + a.velocity * (span * (s3 - 2.0 * s2 + s))
            + b.place.coords * (3.0 * s2 - 2.0 * s3)
            + b.velocity * (span * (s3 - s2)),
    )
}

/// Motion of both bodies around one impact; t = 0 at first contact.
#[derive(Debug, Clone)]
pub struct ShotMotion {
    /// Racket frame: origin at the stringbed centre, local axes of the contract.
    racket: Path,
    ball: Path,
    /// Stringbed centre from the centre of mass that turns freely, racket axes.
    face_centre: Vector3<f64>,
    pub contact_time_s: f64,
    /// Share by which the strings flatten the ball at most.
    pub flattening: f64,
    /// Hand on the handle, along racket axes from the stringbed centre.
    pub hand: Vector3<f64>,
}

/// The ball's part of what ball and strings give together: 33 kN/m and more as it is pressed against strings of 27 to 45 kN/m
/// (docs/impact.md, base visco-elastic).
const BALLS_PART: f64 = 0.45;
/// Power of time by which the flattening is skewed.
const PEAKS_EARLY: f64 = 0.9;
/// A ball flattened by more has no shape known here.
const MOST_FLATTENED: f64 = 0.4;

/// How the racket is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hold {
    /// Hung from a thread: at rest, then free.
    Hung,
    /// Swung by a hand that goes on after the impact.
    Swung,
}

impl ShotMotion {
    /// Paths from `before_s` ahead of first contact to `after_s` behind it.
    pub fn new(hit: &WorldImpact, racket: &Racket, hold: Hold, before_s: f64, after_s: f64) -> ShotMotion {
        let (first, last, contact) = (&hit.encounter, &hit.aftermath, hit.aftermath.contact_time_s);
        let back = (before_s / STEP_S).ceil() as usize + 2;
        let on = (contact / STEP_S).ceil() as usize;
        let forth = (after_s / STEP_S).ceil() as usize + 2;
        let times = || (0..=back + on + forth).map(move |i| (i as f64 - back as f64) * STEP_S);
        let start_s = -(back as f64) * STEP_S;

        let drag = Drag { area_m2: std::f64::consts::PI * first.ball_radius_m.powi(2), mass_kg: first.ball.mass_kg, radius_m: first.ball_radius_m };
        let through = |a: &Body, b: &Body, t: f64| {
            let of = |body: &Body| Instant { place: body.position, velocity: body.velocity, attitude: body.attitude };
            let (a, b, s) = (of(a), of(b), (t / contact).clamp(0.0, 1.0));
            let h = 1e-4;
            let velocity =
                (hermite(&a, &b, (s + h).min(1.0), contact) - hermite(&a, &b, (s - h).max(0.0), contact)) / (((s + h).min(1.0) - (s - h).max(0.0)) * contact);
            Instant { place: hermite(&a, &b, s, contact), velocity, attitude: a.attitude.try_slerp(&b.attitude, s, 1e-12).unwrap_or(a.attitude) }
        };
        let ball = times()
            .map(|t| {
                if t < 0.0 {
                    drag.fly(&first.ball, t)
                } else if t <= contact {
                    through(&first.ball, &last.ball, t)
                } else {
                    drag.fly(&last.ball, t - contact)
                }
            })
            .collect();

        let hand = Vector3::new(racket.stringbed_centre_m - HAND_FROM_BUTT_M, 0.0, 0.0);
        let arm = first.face_centre + hand; // hand from the centre of mass, racket axes
        let mut after: Vec<Instant> = Vec::with_capacity(forth + 1);
        let mut free = last.racket.clone();
        for _ in 0..=forth {
            after.push(Instant { place: free.position, velocity: free.velocity, attitude: free.attitude });
            match hold {
                Hold::Hung => {
                    free.velocity += GRAVITY * STEP_S;
                    free.precess(STEP_S);
                }
                Hold::Swung => {
                    // The arm brings the racket back toward its swing within some 50 ms.
                    let pull = STEP_S / 0.05;
                    free.velocity += (first.racket.velocity - free.velocity) * (0.6 * pull);
                    free.rate += (first.racket.rate - free.rate) * (0.6 * pull);
                }
            }
            free.drift(STEP_S);
        }
        let racket_path = times()
            .map(|t| {
                if t < 0.0 {
                    match hold {
                        Hold::Hung => Instant { place: first.racket.position, velocity: Vector3::zeros(), attitude: first.racket.attitude },
                        Hold::Swung => swing(&first.racket, &arm, t),
                    }
                } else if t <= contact {
                    through(&first.racket, &last.racket, t)
                } else {
                    let x = (t - contact) / STEP_S;
                    let i = (x as usize).min(after.len() - 2);
                    let (a, b, s) = (&after[i], &after[i + 1], x - i as f64);
                    Instant { place: hermite(a, b, s, STEP_S), velocity: a.velocity.lerp(&b.velocity, s), attitude: a.attitude.slerp(&b.attitude, s) }
                }
            })
            .collect();
        ShotMotion {
            racket: Path { start_s, instants: racket_path },
            ball: Path { start_s, instants: ball },
            face_centre: first.face_centre,
            contact_time_s: contact,
            flattening: (BALLS_PART * hit.aftermath.peak_compression_m / (2.0 * first.ball_radius_m)).min(MOST_FLATTENED),
            hand,
        }
    }

    /// Racket frame (stringbed centre, local axes) to global at `t`.
    pub fn racket(&self, t: f64) -> Isometry3<f64> {
        let com = self.racket.pose(t);
        let centre = com * Point3::from(self.face_centre);
        Isometry3::from_parts(centre.into(), com.rotation)
    }

    /// Share by which the strings flatten the ball at `t`: most a little before the middle of the contact.
    pub fn flattening(&self, t: f64) -> f64 {
        if (0.0..self.contact_time_s).contains(&t) { self.flattening * (std::f64::consts::PI * (t / self.contact_time_s).powf(PEAKS_EARLY)).sin() } else { 0.0 }
    }

    /// Ball frame (centre, ball axes) to global at `t`.
    pub fn ball(&self, t: f64) -> Isometry3<f64> {
        self.ball.pose(t)
    }
}

/// Before impact the hand leads the racket round: the hand moves with a steady acceleration, the racket turns about it at
/// a rate that still rises a little.
fn swing(at_contact: &Body, arm: &Vector3<f64>, t: f64) -> Instant {
    let lever = at_contact.attitude * arm;
    let hand_velocity = at_contact.velocity_at(&lever);
    let hand_acceleration = hand_velocity * 4.0;
    let gain = 5.0; // per second: share of the rate gained
    let turn = UnitQuaternion::from_scaled_axis(at_contact.rate * (t + 0.5 * gain * t * t));
    let rate = at_contact.rate * (1.0 + gain * t);
    let hand = at_contact.position + lever + hand_velocity * t + hand_acceleration * (0.5 * t * t);
    let now = turn * lever;
    Instant { place: hand - now, velocity: hand_velocity + hand_acceleration * t - rate.cross(&now), attitude: turn * at_contact.attitude }
}

struct Drag {
    area_m2: f64,
    mass_kg: f64,
    radius_m: f64,
}

impl Drag {
    fn acceleration(&self, v: &Vector3<f64>, spin: &Vector3<f64>) -> Vector3<f64> {
        let speed = v.norm();
        if speed < 1e-6 {
            return GRAVITY;
        }
        let push = 0.5 * AIR_KG_M3 * self.area_m2 / self.mass_kg;
        let across = spin.cross(v);
        let ratio = self.radius_m * spin.norm() / speed;
        let lift = across.try_normalize(1e-9).unwrap_or_default() * (speed * speed * 0.9 * ratio / (1.0 + 2.0 * ratio));
        GRAVITY - v * (push * 0.52 * speed) + lift * push
    }

    /// Flight from the body's state for `t` (either sign), spin constant.
    fn fly(&self, body: &Body, t: f64) -> Instant {
        let steps = (t.abs() / 1e-3).ceil().max(1.0);
        let dt = t / steps;
        let (mut place, mut v) = (body.position, body.velocity);
        for _ in 0..steps as usize {
            let middle = v + self.acceleration(&v, &body.rate) * (0.5 * dt);
            place += middle * dt;
            v += self.acceleration(&middle, &body.rate) * dt;
        }
        Instant { place, velocity: v, attitude: UnitQuaternion::from_scaled_axis(body.rate * t) * body.attitude }
    }
}
