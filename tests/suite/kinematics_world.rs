//! A world for testing `kinematics` that does not use its laws of motion: the racket is driven by smooth hand forces and
//! torques through Newton's and Euler's equations in small steps, the ball flies through air, and both are projected to
//! pixels with noise, constant tape errors, gaps and outliers.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::collections::BTreeMap;
use sweetspot::calibration::{Camera, CameraId, RigidTransform, StereoRig};
use sweetspot::equipment::{Ball, Head, Markers, Racket, Strings};
use sweetspot::tracking::{ImagePoint, PointState, RacketFigure, Target, TrackPoint, Tracks};

pub const FRAME_S: f64 = 1e-3;

/// How hard the world is.
#[derive(Debug, Clone, Copy)]
pub struct Difficulty {
    /// White noise of markers and of the ball.
    pub noise_px: f64,
    pub ball_noise_px: f64,
    pub tape_error_px: f64,
    pub outliers: f64,
    pub gaps: f64,
    /// The racket hangs still before impact and falls free after it.
    pub laboratory: bool,
    pub air: bool,
    /// Share of the drive (angular acceleration, changing force) of a hard swing before contact.
    pub drive: f64,
    /// Time in which that drive changes by its own size, s: a swing gains its rate within 0.05 to 0.1 s; muscles can change
    /// a force within 0.03 s.
    pub drive_change_s: f64,
    /// Share of a gripping hand's force and torque after contact, which die away within 5 to 20 ms.
    pub hold: f64,
    /// Fewest and most frames before the contact; as many after it, less up to one.
    pub frames: (u32, u32),
    /// Markers that neither camera sees, and as many more that one camera misses.
    pub hidden: usize,
    /// Error of the ball that a stretch of its pictures cannot tell, because its cover is learnt at the same places: in deviations of
    /// the stretch's mean and slope.
    pub ball_untold: f64,
    /// Both cameras' shake from picture to picture, per axis.
    pub shake_px: f64,
    /// Acceleration of a slow hand that carries the racket before and after the contact (a block, a drop shot), m/s²; 0 for a swing.
    pub slow_m_s2: f64,
    /// How many times faster than by 5 mm/s and 20 mrad/s a hung racket sways.
    pub sway_times: f64,
}

pub struct TrueShot {
    pub racket: Racket,
    pub ball: Ball,
    pub rig: StereoRig,
    pub tracks: Tracks,
    /// Columns of the impacts table.
    pub row: BTreeMap<&'static str, f64>,
    /// First contact, in frames.
    pub impact_frame: f64,
}

pub fn racket() -> Racket {
    Racket {
        name: "test".into(),
        mass_kg: 0.335,
        length_m: 0.685,
        balance_m: 0.325,
        stringbed_centre_m: 0.4975,
        swingweight_kgm2: 0.0325,
        twistweight_kgm2: 0.0015,
        spinweight_kgm2: None,
        head: Head { inner_length_m: 0.335, inner_width_m: 0.255, tube_radius_m: 0.010 },
        strings: Strings { tension_lb: 58.0 },
        markers: Some(Markers { m1: [-0.1775, 0.0, 0.0], m2: [0.0, -0.1375, 0.0], m3: [0.0, 0.1375, 0.0], m4: [0.2, -0.045, 0.0], m5: [0.2, 0.045, 0.0] }),
    }
}

pub fn ball() -> Ball {
    Ball { name: "test".into(), mass_kg: 0.0577, diameter_m: 0.066, inertia_factor: 0.6667 }
}

/// Two cameras at the ends of the net, 12 m away, 36° apart, as at Wimbledon.
pub fn rig() -> StereoRig {
    let camera =
        |fx: f64, k1: f64| Camera { fx, fy: fx * 1.001, cx: 252.0, cy: 259.0, distortion: [k1, 0.5, 1e-4, -2e-4, 0.0], rms_px: 0.1, sd: BTreeMap::new() };
    let look = |eye: Point3<f64>| {
        let forward = (Point3::new(0.0, 1.0, 0.0) - eye).normalize();
        let right = forward.cross(&Vector3::y()).normalize();
        let r = Matrix3::from_rows(&[right.transpose(), forward.cross(&right).transpose(), forward.transpose()]);
        let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
        Isometry3::from_parts(Translation3::from(-(q * eye.coords)), q)
    };
    let left = look(Point3::new(11.6, 1.1, -3.6));
    let right = look(Point3::new(11.8, 1.3, 3.9));
    let right_from_left = RigidTransform::from_isometry(&(right * left.inverse()));
    StereoRig {
        image_size: [512, 512],
        left: camera(2950.0, -0.2),
        right: camera(3010.0, 0.3),
        r: right_from_left.r,
        t: right_from_left.t,
        rms_stereo_px: 0.1,
        pairs: Vec::new(),
        square_mm: None,
        global_from_left: RigidTransform::from_isometry(&left.inverse()),
        more: BTreeMap::new(),
    }
}

#[derive(Clone)]
struct Body {
    com: Vector3<f64>,
    q: UnitQuaternion<f64>,
    v: Vector3<f64>,
    w: Vector3<f64>,
}

/// Smooth hand force (N/kg, body axes) and angular acceleration beyond Euler's (rad/s², body axes) at a time.
type Drive<'a> = &'a dyn Fn(f64) -> (Vector3<f64>, Vector3<f64>);

const FINE: f64 = 2.5e-5;

impl Body {
    /// One fine step of either sign (midpoint rule on velocities, exact rotation of the midpoint rate).
    fn step(&mut self, inertia: &Vector3<f64>, drive: Drive, t: f64, h: f64) {
        let rate_dot = |w: &Vector3<f64>, t: f64| {
            let l = inertia.component_mul(w);
            (-w.cross(&l)).component_div(inertia) + drive(t).1
        };
        let middle_w = self.w + rate_dot(&self.w, t) * (h / 2.0);
        let middle_q = self.q * UnitQuaternion::from_scaled_axis(self.w * (h / 2.0));
        let a = middle_q * drive(t + h / 2.0).0 + Vector3::new(0.0, -9.80665, 0.0);
        self.com += self.v * h + a * (h * h / 2.0);
        self.v += a * h;
        self.w += rate_dot(&middle_w, t + h / 2.0) * h;
        self.q *= UnitQuaternion::from_scaled_axis(middle_w * h);
    }

    fn pose(&self, com_local: &Point3<f64>) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.com - self.q * com_local.coords), self.q)
    }
}

struct Flight {
    p: Vector3<f64>,
    v: Vector3<f64>,
    drag: f64,
    lift: Vector3<f64>,
}

impl Flight {
    fn step(&mut self, h: f64) {
        let a = |v: &Vector3<f64>| Vector3::new(0.0, -9.80665, 0.0) - v * (self.drag * v.norm()) + self.lift.cross(v) * v.norm();
        let middle = self.v + a(&self.v) * (h / 2.0);
        self.p += middle * h;
        self.v += a(&middle) * h;
    }
}

fn normal3(rng: &mut ChaCha8Rng, sd: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| sd * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, rng))
}

pub fn true_shot(seed: u64, d: &Difficulty) -> TrueShot {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (racket, ball, rig) = (racket(), ball(), rig());
    let figure = RacketFigure::of(&racket).expect("markers");
    let (com_local, inertia, radius) = (racket.com_local(), racket.inertia_kg_m2(), ball.radius_m());

    // State at first contact. Court forehand: z toward the net, y up, handle toward the player; either face.
    let side = if rng.random::<bool>() { 1.0 } else { -1.0 };
    let base = Matrix3::from_columns(&[-Vector3::z(), Vector3::y() * side, Vector3::x() * side]);
    let tilt = UnitQuaternion::from_scaled_axis(normal3(&mut rng, 0.25));
    let q = tilt * UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(base));
    let impact = Vector2::new(rng.random_range(-0.10..0.08), rng.random_range(-0.06..0.06));
    let mut start = Body { com: Vector3::zeros(), q, v: Vector3::zeros(), w: Vector3::zeros() };
    if !d.laboratory {
        start.v = Vector3::new(rng.random_range(10.0..20.0), rng.random_range(0.0..10.0), rng.random_range(-8.0..2.0));
        start.w = Vector3::new(8.0, 7.0, 10.0).component_mul(&normal3(&mut rng, 1.0)) + Vector3::new(0.0, 30.0 * side, 5.0);
    }
    if d.laboratory {
        let mut sway = ChaCha8Rng::seed_from_u64(seed ^ 0x7377_6179);
        (start.v, start.w) = (normal3(&mut sway, 0.005 * d.sway_times), normal3(&mut sway, 0.02 * d.sway_times));
    }
    // A slow hand holds the racket up, and gains some m/s² in any direction besides.
    let mut carrying = ChaCha8Rng::seed_from_u64(seed ^ 0x736c_6f77);
    if d.slow_m_s2 > 0.0 {
        (start.v, start.w) = (Vector3::new(0.8, 0.3, 0.0) + normal3(&mut carrying, 0.3), normal3(&mut carrying, 1.5));
    }
    let gains = normal3(&mut carrying, 1.0).normalize() * d.slow_m_s2;
    let carried = (q.inverse() * (gains + Vector3::new(0.0, 9.80665, 0.0)), normal3(&mut carrying, 2.0 * d.slow_m_s2));
    start.com = Vector3::new(0.0, 1.0, 0.0) + normal3(&mut rng, 0.08);
    let contact_point = start.pose(&com_local) * Point3::new(impact.x, impact.y, side * radius);
    let ball_in = if d.laboratory {
        Vector3::new(rng.random_range(-35.0..-18.0), rng.random_range(-8.0..8.0), rng.random_range(-8.0..8.0))
    } else {
        Vector3::new(rng.random_range(-16.0..-6.0), rng.random_range(-4.0..4.0), rng.random_range(-2.0..2.0))
    };
    // Accelerations: a pivot some 0.3 to 0.7 m behind the centre of mass plus what the hand does, changing over 10 ms.
    let (driven, held) = if d.laboratory { (0.0, 0.0) } else { (d.drive, d.hold) };
    let swing_force = normal3(&mut rng, 250.0 * driven);
    let swing_slope = normal3(&mut rng, 250.0 / d.drive_change_s * driven);
    let swing_torque = Vector3::new(300.0, 250.0, 250.0).component_mul(&normal3(&mut rng, driven));
    let swing_torque_slope = normal3(&mut rng, 250.0 / d.drive_change_s * driven);
    let wave_share = 0.006 / d.drive_change_s;
    let phase: f64 = rng.random_range(0.0..6.0);
    let before = |t: f64| {
        if d.laboratory {
            return (q.inverse() * Vector3::new(0.0, 9.80665, 0.0), Vector3::zeros()); // hangs from a thread
        }
        if d.slow_m_s2 > 0.0 {
            return carried;
        }
        let wave = (90.0 * t + phase).sin();
        (swing_force * (1.0 + wave_share * wave) + swing_slope * t, swing_torque * (1.0 + wave_share * wave) + swing_torque_slope * t)
    };
    let drag = if d.air { rng.random_range(0.48..0.62) * 0.5 * 1.2 * std::f64::consts::PI * radius * radius / ball.mass_kg } else { 0.0 };
    let lift = if d.air { normal3(&mut rng, 0.25 * drag) } else { Vector3::zeros() };

    // Contact: an impulse along the normal and a little across, rotations to match; 4 to 5.6 ms.
    let contact_time = rng.random_range(0.0040..0.0056);
    let z = start.q * Vector3::z() * side;
    let arm = contact_point.coords - start.com;
    let v_ip = start.v + (start.q * start.w).cross(&arm);
    let approach = -(ball_in - v_ip).dot(&z);
    let m_e = 1.0 / (1.0 / racket.mass_kg + (impact.x - com_local.x).powi(2) / inertia.y + impact.y.powi(2) / inertia.x);
    let push = z * (1.75 * approach / (1.0 / ball.mass_kg + 1.0 / m_e)) + normal3(&mut rng, 0.08);
    let ball_out = ball_in + push / ball.mass_kg;
    let w_change = (start.q.inverse() * arm.cross(&-push)).component_div(&inertia);
    let mut after_contact = start.clone();
    let hand = normal3(&mut rng, if d.laboratory { 0.0 } else { 0.5 });
    after_contact.v = start.v - push / racket.mass_kg + hand;
    after_contact.w = start.w + w_change + normal3(&mut rng, if d.laboratory { 0.0 } else { 3.0 });
    after_contact.com = start.com + (start.v + after_contact.v) * (contact_time / 2.0);
    after_contact.q = start.q * UnitQuaternion::from_scaled_axis((start.w + after_contact.w) * (contact_time / 2.0));
    // Pushed for as long before the middle of the contact as after it, the ball goes its mean velocity's way.
    let pushed = after_contact.pose(&com_local).inverse() * Point3::from(contact_point.coords + (ball_in + ball_out) * (contact_time / 2.0));
    let leave =
        after_contact.pose(&com_local) * Point3::new(pushed.x + rng.random_range(-0.01..0.01), pushed.y, side * (radius - rng.random_range(0.0..0.002)));
    let after_force = normal3(&mut rng, 150.0 * held);
    let after_torque = Vector3::new(500.0, 250.0, 250.0).component_mul(&normal3(&mut rng, held));
    // Drawn apart, so that worlds that differ in these alone share everything else.
    let mut apart = ChaCha8Rng::seed_from_u64(seed ^ 0x6c65_7474_696e_6721);
    let letting_go = apart.random_range(0.005..0.020);
    let after = |t: f64| {
        if d.slow_m_s2 > 0.0 {
            return carried;
        }
        let fade = (-(t - contact_time) / letting_go).exp();
        (after_force * fade, after_torque * fade)
    };

    let impact_frame = 300.0 + rng.random_range(0.0..1.0);
    let (fewest, most) = (i64::from(d.frames.0), i64::from(d.frames.1));
    let (count_before, count_after) = (rng.random_range(fewest..most), rng.random_range(fewest - 1..most));
    let mut seen: BTreeMap<i64, (Isometry3<f64>, Vector3<f64>)> = BTreeMap::new();
    let time = |frame: i64| (frame as f64 - impact_frame) * FRAME_S;
    for (sign, frames) in [(-1.0, (300 - count_before..=300).rev().collect::<Vec<_>>()), (1.0, (301..307 + count_after).collect())] {
        let forward = sign > 0.0;
        let (mut body, mut flight, mut t) = if forward {
            (after_contact.clone(), Flight { p: leave.coords, v: ball_out, drag, lift }, contact_time)
        } else {
            (start.clone(), Flight { p: contact_point.coords, v: ball_in, drag, lift }, 0.0)
        };
        for frame in frames {
            let to = time(frame);
            if forward && to < contact_time {
                let share = to / contact_time;
                let com = start.com + start.v * to + (after_contact.v - start.v) * (to * share / 2.0);
                let q = start.q * UnitQuaternion::from_scaled_axis(start.w * to + (after_contact.w - start.w) * (to * share / 2.0));
                let body = Body { com, q, v: start.v, w: start.w };
                let p = contact_point.coords + (leave.coords - contact_point.coords) * share - z * (0.02 * (share * std::f64::consts::PI).sin());
                seen.insert(frame, (body.pose(&com_local), p));
                continue;
            }
            let steps = ((to - t).abs() / FINE).ceil().max(1.0);
            let h = (to - t) / steps;
            for _ in 0..steps as usize {
                body.step(&inertia, if forward { &after } else { &before }, t, h);
                flight.step(h);
                t += h;
            }
            if !forward && d.laboratory {
                // Hung: still but for a sway of millimetres per second, too slow to turn into anything within the window.
                body = Body { com: start.com + start.v * t, q: start.q * UnitQuaternion::from_scaled_axis(start.w * t), ..start.clone() };
            }
            seen.insert(frame, (body.pose(&com_local), flight.p));
        }
    }

    // Pixels.
    let bias: Vec<Vector2<f64>> = (0..12).map(|k| normal3(&mut rng, if k % 6 == 5 { 0.35 * d.tape_error_px } else { d.tape_error_px }).xy()).collect();
    // As the view turns the tape's error drifts: by a quarter of its size within a window's half.
    let drift: Vec<Vector2<f64>> = (0..12).map(|k| normal3(&mut rng, if k % 6 == 5 { 12.0 } else { 25.0 } * d.tape_error_px).xy()).collect();
    // Markers out of sight: the first `hidden` of a shuffled list for both cameras, the next `hidden` for one of them.
    let mut order: Vec<usize> = (0..5).collect();
    for k in (1..5).rev() {
        order.swap(k, apart.random_range(0..=k));
    }
    let one_eyed = apart.random_range(0..2usize);
    let out_of_sight = |camera: CameraId, target: Target| {
        let rank = order.iter().position(|k| *k == target.index());
        rank.is_some_and(|r| r < d.hidden || (r < 2 * d.hidden && camera.index() == one_eyed))
    };
    // By camera and side of the contact: constant at the stretch's middle, slope, and that middle.
    let stretches: Vec<(Vector2<f64>, Vector2<f64>, f64)> = (0..4)
        .map(|k| {
            let t: Vec<f64> = seen.keys().map(|f| time(*f)).filter(|t| if k % 2 == 0 { *t < 0.0 } else { *t > contact_time }).collect();
            let middle = t.iter().sum::<f64>() / t.len() as f64;
            let spread = t.iter().map(|t| (t - middle).powi(2)).sum::<f64>();
            let untold = d.ball_untold * d.ball_noise_px;
            (normal3(&mut apart, untold / (t.len() as f64).sqrt()).xy(), normal3(&mut apart, untold / spread.sqrt()).xy(), middle)
        })
        .collect();
    let mut points = Vec::new();
    for (&frame, (pose, p)) in &seen {
        for camera in CameraId::BOTH {
            let shake = normal3(&mut apart, d.shake_px).xy();
            let eye = pose.inverse_transform_point(&rig.centre(camera));
            for target in Target::ALL {
                let place = if target == Target::Ball { Point3::from(*p) } else { pose * figure.patch_point(target.index(), &eye).0 };
                let sd = if target == Target::Ball { d.ball_noise_px } else { d.noise_px } * rng.random_range(0.7..1.4);
                let k = 6 * camera.index() + target.index();
                let mut uv = rig.project(camera, &place).expect("in view") + normal3(&mut rng, sd).xy() + bias[k] + drift[k] * time(frame) + shake;
                if target == Target::Ball {
                    let (constant, slope, middle) = &stretches[2 * camera.index() + usize::from(time(frame) > 0.0)];
                    uv += constant + slope * (time(frame) - middle);
                }
                if rng.random::<f64>() < d.outliers {
                    uv += normal3(&mut rng, 3.0).xy();
                }
                let hidden = rng.random::<f64>() < d.gaps || out_of_sight(camera, target);
                points.push(TrackPoint {
                    frame: frame as u64,
                    camera,
                    target,
                    point: (!hidden).then_some(ImagePoint { uv, sd: Vector2::new(sd, sd) }),
                    state: if hidden { PointState::Occluded } else { PointState::Measured },
                });
            }
        }
    }
    points.sort_by_key(|p| (p.frame, p.camera, p.target));

    let mut row = BTreeMap::new();
    let local = |v: Vector3<f64>| start.q.inverse() * v;
    let mut put = |names: [&'static str; 3], v: Vector3<f64>| row.extend(names.into_iter().zip(v.iter().copied()));
    put(["ball_in_vx", "ball_in_vy", "ball_in_vz"], local(ball_in));
    put(["racket_in_vx", "racket_in_vy", "racket_in_vz"], local(start.v));
    put(["racket_in_wx", "racket_in_wy", "racket_in_wz"], start.w);
    put(["ball_out_vx", "ball_out_vy", "ball_out_vz"], local(ball_out));
    put(["racket_out_vx", "racket_out_vy", "racket_out_vz"], local(after_contact.v));
    put(["racket_out_wx", "racket_out_wy", "racket_out_wz"], local(after_contact.q * after_contact.w));
    row.insert("impact_x", impact.x);
    row.insert("impact_y", impact.y);
    row.insert("contact_time", contact_time);
    TrueShot { racket, ball, rig, tracks: Tracks { points }, row, impact_frame }
}
