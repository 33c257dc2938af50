//! Every shot characteristic of contract section 5, from one state. Definitions with equation numbers: docs/kinematics.md.

use crate::equipment::{Ball, Racket};
use crate::kinematics::contact::{ball_in_racket, crossing};
use crate::kinematics::shot_state::{Measure, ShotState};
use crate::kinematics::sweet_spot::{THESIS_NODE_OF_LENGTH, centre_of_percussion, dead_spot, effective_mass, ideal_point};
use crate::quantity::RPM;
use nalgebra::{Point3, Vector2, Vector3};

/// Below this speed an impact point counts as at rest, m/s: a hung racket sways by millimetres per second.
const AT_REST_M_S: f64 = 0.1;

/// What does not vary within a shot.
#[derive(Debug, Clone)]
pub struct ShotEquipment<'a> {
    pub racket: &'a Racket,
    pub ball: &'a Ball,
    /// Local points whose velocity is asked for, m from the stringbed centre.
    pub points: &'a [Vector2<f64>],
    /// Frame number at the clock's zero and the frame period, for `impact_frame`.
    pub clock: crate::kinematics::FrameClock,
    /// Upward, global axes; `None` without the axes' frame: then nothing knows it, nor does U (the left camera's x axis) point along the court.
    pub up: Option<Vector3<f64>>,
}

/// What the names of an asked point's velocities begin with: its place in whole millimetres.
pub fn point_name(p: &Vector2<f64>) -> String {
    // Nought added: a place just below zero is not "-0".
    let [x, y] = [p.x, p.y].map(|v| (1e3 * v).round() + 0.0);
    format!("point_{x}_{y}_mm")
}

struct List(Vec<Measure>);

impl List {
    fn put(&mut self, name: &str, unit: &'static str, value: impl Into<Option<f64>>) {
        self.0.push(Measure { name: name.to_owned(), unit, value: value.into() });
    }

    fn vector(&mut self, name: &str, unit: &'static str, v: Option<Vector3<f64>>) {
        for (k, axis) in ["x", "y", "z"].iter().enumerate() {
            self.put(&format!("{name}{axis}"), unit, v.map(|v| v[k]));
        }
    }
}

/// All characteristics, in the order of shot.json. The list has the same names whatever the state holds.
pub fn characteristics(s: &ShotState, e: &ShotEquipment<'_>) -> Vec<Measure> {
    let mut list = List(Vec::with_capacity(160));
    let (racket, ball) = (&s.racket(e.racket), e.ball);
    // The motions' centre of mass is the balance point as stated; momentum, energy and special points are those of the true
    // one, and feel its uncertainty.
    let (n, radius, com, true_com) = (s.side, ball.radius_m(), e.racket.com_local(), racket.com_local());
    let inertia = racket.inertia_kg_m2();
    let (m, mass) = (s.ball_mass, s.racket_mass);

    // First contact: centre one radius from the plane (contract section 1).
    let dt = crossing(&s.ball_in, &s.racket_in, &com, n, radius).unwrap_or(0.0);
    let t0 = s.in_t + dt;
    let (b0, r0) = (s.ball_in.after(dt), s.racket_in.after(dt));
    let local = |v: Vector3<f64>| r0.attitude.inverse() * v;
    let at = ball_in_racket(&b0, &r0, &com);
    let impact = Point3::new(at.x, at.y, 0.0);
    // The thesis's instant: centre on the plane, both motions carried on as if nothing were in the way (4.11).
    let through = crossing(&b0, &r0, &com, n, 0.0);
    let on_plane = through.map(|t| ball_in_racket(&b0.after(t), &r0.after(t), &com));
    // Last contact: one radius again, on the paths after (less what the ball's and the frame's shape take off).
    let leaving = s.ball_out.as_ref().zip(s.racket_out.as_ref()).filter(|_| s.leaves);
    let leaving_dt = leaving.map(|(b, r)| crossing(b, r, &com, n, radius - s.leaving_bent_m).unwrap_or(0.0) - s.leaving_flat_s);
    // Without a last contact the motions stand where they were fitted, a usual contact after the first.
    let out_dt = leaving_dt.unwrap_or(0.0);
    let body_out = s.racket_out.as_ref().map(|r| r.after(out_dt));
    let ball_out = s.ball_out.as_ref().map(|b| b.after(out_dt).velocity);
    let racket_out = body_out.as_ref().map(|r| r.velocity);
    let rate_out = body_out.as_ref().map(|r| r.attitude * r.rate_body);
    let last_t = leaving_dt.map(|dt| s.out_t + dt);
    let contact_time = last_t.map(|t| t - t0);

    // The impacts table's own columns, local axes at first contact.
    list.vector("ball_in_v", "m/s", Some(local(b0.velocity)));
    list.vector("ball_in_w", "rad/s", s.spin_in.map(local));
    list.vector("racket_in_v", "m/s", Some(local(r0.velocity)));
    list.vector("racket_in_w", "rad/s", Some(r0.rate_body));
    list.put("impact_x", "m", at.x);
    list.put("impact_y", "m", at.y);
    list.vector("ball_out_v", "m/s", ball_out.map(local));
    list.vector("ball_out_w", "rad/s", s.spin_out.map(local));
    list.vector("racket_out_v", "m/s", racket_out.map(local));
    list.vector("racket_out_w", "rad/s", rate_out.map(local));
    list.put("contact_time", "s", contact_time);

    // Timing.
    list.put("impact_frame", "frame", e.clock.frame_at(t0));
    list.put("last_contact_frame", "frame", last_t.map(|t| e.clock.frame_at(t)));
    list.put("centre_on_plane_delay", "s", through);
    list.put("centre_on_plane_x", "m", on_plane.map(|p| p.x));
    list.put("centre_on_plane_y", "m", on_plane.map(|p| p.y));

    // Global velocities and speeds.
    list.vector("ball_in_global_v", "m/s", Some(b0.velocity));
    list.vector("ball_out_global_v", "m/s", ball_out);
    list.vector("racket_in_global_v", "m/s", Some(r0.velocity));
    list.vector("racket_out_global_v", "m/s", racket_out);
    list.vector("racket_in_global_w", "rad/s", Some(r0.attitude * r0.rate_body));
    list.vector("racket_out_global_w", "rad/s", rate_out);
    list.put("ball_in_speed", "m/s", b0.velocity.norm());
    list.put("ball_out_speed", "m/s", ball_out.map(|v| v.norm()));
    list.put("racket_in_speed", "m/s", r0.velocity.norm());
    list.put("racket_out_speed", "m/s", racket_out.map(|v| v.norm()));
    list.put("racket_in_rate", "rad/s", r0.rate_body.norm());
    list.put("racket_out_rate", "rad/s", rate_out.map(|w| w.norm()));

    // Spin: size, and the topspin component about the horizontal axis across the path (positive = topspin).
    for (name, spin, velocity) in [("ball_in", s.spin_in, Some(b0.velocity)), ("ball_out", s.spin_out, ball_out)] {
        let topspin = spin.zip(velocity).and_then(|(w, v)| e.up?.cross(&v).try_normalize(1e-6).map(|axis| w.dot(&axis)));
        list.vector(&format!("{name}_global_w"), "rad/s", spin);
        list.put(&format!("{name}_spin"), "rad/s", spin.map(|w| w.norm()));
        list.put(&format!("{name}_spin_rpm"), "rpm", spin.map(|w| w.norm() * RPM));
        list.put(&format!("{name}_topspin"), "rad/s", topspin);
        list.put(&format!("{name}_topspin_rpm"), "rpm", topspin.map(|w| w * RPM));
    }

    // Points of the racket, local axes.
    let tip = Point3::new(racket.stringbed_centre_m - racket.length_m, 0.0, 0.0);
    let point_in = |p: &Point3<f64>| local(r0.point_velocity(p, &com));
    // V + Ω x ρ with the place as at first contact, the axes in which the impacts table stands: an impulse model knows no turn
    // during contact, and a restitution from the table is to be the one here.
    let point_out = |p: &Point3<f64>| racket_out.zip(rate_out).map(|(v, w)| local(v) + local(w).cross(&(p - com)));
    for (name, p) in [("tip", &tip), ("impact_point", &impact)] {
        list.vector(&format!("{name}_in_v"), "m/s", Some(point_in(p)));
        list.put(&format!("{name}_in_speed"), "m/s", point_in(p).norm());
        list.vector(&format!("{name}_out_v"), "m/s", point_out(p));
        list.put(&format!("{name}_out_speed"), "m/s", point_out(p).map(|v| v.norm()));
    }
    for p in e.points {
        let name = point_name(p);
        let p = Point3::new(p.x, p.y, 0.0);
        list.vector(&format!("{name}_in_v"), "m/s", Some(point_in(&p)));
        list.vector(&format!("{name}_out_v"), "m/s", point_out(&p));
    }

    // Impact position from the three origins; b counts toward the tip.
    let from_com = Vector2::new(at.x - true_com.x, at.y);
    let b = -from_com.x;
    list.put("impact_x_from_com", "m", from_com.x);
    list.put("impact_from_butt", "m", racket.stringbed_centre_m - at.x);

    // Angles. u = ball relative to the impact point; v_n its approach along the normal.
    let v_ip = point_in(&impact);
    let u = local(b0.velocity) - v_ip;
    let approach = -n * u.z;
    let up_in_face = e.up.map(local).and_then(|up| Vector3::new(up.x, up.y, 0.0).try_normalize(1e-6));
    list.put("playing_angle_deg", "deg", up_in_face.map(|y| u.dot(&y).atan2(approach).to_degrees()));
    list.put("incidence_angle_deg", "deg", (approach / u.norm()).clamp(-1.0, 1.0).acos().to_degrees());
    // The thesis's sum of two unsigned angles (4.16a, b), z on the ball's side, U global.
    let along_u = (r0.attitude * -u).x / u.norm();
    let normal_u = n * (r0.attitude * Vector3::z()).x;
    let thesis_angle = (along_u.clamp(-1.0, 1.0).acos() + normal_u.clamp(-1.0, 1.0).acos()).to_degrees();
    list.put("playing_angle_thesis_deg", "deg", e.up.map(|_| thesis_angle));
    list.put("planar_racket_velocity", "m/s", v_ip.xy().norm());
    list.put("planar_relative_velocity", "m/s", u.xy().norm());
    // How fast the face brushes up past the ball: what makes topspin.
    list.put("planar_relative_velocity_up", "m/s", up_in_face.map(|y| -u.dot(&y)));

    // Restitution along the normal of first contact: apparent against the impact point before, true against it after.
    let rebound = ball_out.map(|v| n * (local(v) - v_ip).z);
    let apparent = rebound.map(|r| r / approach);
    let separation = ball_out.zip(point_out(&impact)).map(|(v, ip)| n * (local(v) - ip).z);
    let restitution = separation.map(|s| s / approach);
    let m_e = effective_mass(mass, &inertia, &from_com);
    list.put("apparent_restitution", "", apparent);
    list.put("restitution", "", restitution);
    list.put("restitution_from_apparent", "", apparent.map(|a| a + m / m_e * (1.0 + a)));
    list.put("effective_mass", "kg", m_e);

    // Sweet spots, from the butt, and how far beyond them (toward the tip) the impact was.
    let com_in = point_in(&true_com);
    let ideal = ideal_point(mass, inertia.y, m, n * com_in.z, n * local(b0.velocity).z, n * r0.rate_body.y);
    let spots = [
        ("centre_of_percussion", Some(centre_of_percussion(racket, s.hand_from_butt))),
        ("node_point", Some(s.node_of_length * racket.length_m - racket.balance_m)),
        ("node_point_thesis", Some(THESIS_NODE_OF_LENGTH * racket.length_m - racket.balance_m)),
        ("dead_spot", restitution.and_then(|e| dead_spot(mass, inertia.y, m, e))),
        ("ideal_point", ideal),
    ];
    for (name, spot) in spots {
        list.put(&format!("{name}_from_butt"), "m", spot.map(|x| racket.balance_m + x));
        list.put(&format!("impact_beyond_{name}"), "m", spot.map(|x| b - x));
    }
    // Impact success ratio (5.6): momentum of the ideal point over that of the impact point.
    let momentum = |x: f64, y: f64| effective_mass(mass, &inertia, &Vector2::new(x, y)) * n * (r0.rate_body.x * y - r0.rate_body.y * x + com_in.z);
    let actual = momentum(from_com.x, from_com.y);
    // A racket at rest brings no momentum: the ratio of two noises is no ratio.
    let moves = actual.abs() > AT_REST_M_S * m_e;
    list.put("impact_success_ratio", "", ideal.map(|b| momentum(-b, 0.0) / actual).filter(|_| moves));
    // Efficiency (5.8), court frame, each inertia with its own axis. A spin of 300 rad/s holds 7 % of the energy of a ball of 30 m/s: without both spins there is
    // none, and what one component leaves unknown is as much.
    let spin_energy = |w: Vector3<f64>| ball.inertia_kg_m2() * (m / ball.mass_kg) * w.norm_squared();
    let racket_energy = mass * com_in.norm_squared() + inertia.component_mul(&r0.rate_body).dot(&r0.rate_body);
    let energy_in = s.spin_in.map(|w| racket_energy + m * b0.velocity.norm_squared() + spin_energy(w));
    let energy_out = ball_out.zip(s.spin_out).map(|(v, w)| m * v.norm_squared() + spin_energy(w));
    list.put("efficiency", "", energy_out.zip(energy_in).map(|(out, brought)| out / brought));

    // Momentum balance: what else pushed on ball and racket while they touched (local axes at first contact).
    let fall = contact_time.zip(e.up).map(|(t, up)| -up * (crate::kinematics::GRAVITY_M_S2 * t));
    let lacking = ball_out.zip(point_out(&true_com)).zip(fall).map(|((bo, ro), fall)| local((bo - b0.velocity) * m - fall * (m + mass)) + (ro - com_in) * mass);
    list.vector("unexplained_impulse_", "N s", lacking);
    // What a support gives that carries the racket through the contact, as a stand, a string or a quiet hand does.
    list.vector("carrying_impulse_", "N s", fall.map(|fall| local(-fall * mass)));
    list.vector("ball_impulse_", "N s", ball_out.map(|v| local((v - b0.velocity) * m)));
    list.0
}

#[cfg(test)]
mod tests;
