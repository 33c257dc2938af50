//! Every shot characteristic of contract section 5, from one state. Definitions with equation numbers: docs/kinematics.md.

use crate::equipment::{Ball, Racket};
use crate::kinematics::contact::{BodyMotion, PointMotion, ball_in_racket, crossing};
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
    let meeting = Meeting::of(s, e);
    meeting.table_columns(&mut list);
    meeting.timing(&mut list);
    meeting.global_velocities(&mut list);
    meeting.spins(&mut list);
    meeting.velocities_of_points(&mut list);
    meeting.place_and_angles(&mut list);
    let restitution = meeting.restitutions(&mut list);
    meeting.sweet_spots(restitution, &mut list);
    meeting.efficiency(&mut list);
    meeting.momentum_balance(&mut list);
    list.0
}

/// Ball and racket at first and last contact.
struct Meeting<'a> {
    s: &'a ShotState,
    e: &'a ShotEquipment<'a>,
    /// As its masses and inertias are in this state.
    racket: Racket,
    inertia: Vector3<f64>,
    /// The motions' centre of mass is the balance point as stated; momentum, energy and special points are those of the true
    /// one, and feel its uncertainty.
    com: Point3<f64>,
    true_com: Point3<f64>,
    /// Instants of first and last contact on the shot's clock, s.
    first_t: f64,
    last_t: Option<f64>,
    /// At first contact.
    ball_in: PointMotion,
    racket_in: BodyMotion,
    /// The ball's centre and the impact point under it, racket-local, m.
    at: Point3<f64>,
    impact: Point3<f64>,
    /// At last contact, global axes.
    ball_out: Option<Vector3<f64>>,
    racket_out: Option<Vector3<f64>>,
    rate_out: Option<Vector3<f64>>,
}

impl<'a> Meeting<'a> {
    fn of(s: &'a ShotState, e: &'a ShotEquipment<'a>) -> Self {
        let racket = s.racket(e.racket);
        let (radius, com, true_com) = (e.ball.radius_m(), e.racket.com_local(), racket.com_local());
        // First contact: centre one radius from the plane (contract section 1).
        let dt = crossing(&s.ball_in, &s.racket_in, &com, s.side, radius).unwrap_or(0.0);
        let (ball_in, racket_in) = (s.ball_in.after(dt), s.racket_in.after(dt));
        let at = ball_in_racket(&ball_in, &racket_in, &com);
        // Last contact: one radius again, on the paths after (less what the ball's and the frame's shape take off).
        let leaving = s.ball_out.as_ref().zip(s.racket_out.as_ref()).filter(|_| s.leaves);
        let leaving_dt = leaving.map(|(b, r)| crossing(b, r, &com, s.side, radius - s.leaving_bent_m).unwrap_or(0.0) - s.leaving_flat_s);
        // Without a last contact the motions stand where they were fitted, a usual contact after the first.
        let out_dt = leaving_dt.unwrap_or(0.0);
        let body_out = s.racket_out.as_ref().map(|r| r.after(out_dt));
        Meeting {
            inertia: racket.inertia_kg_m2(),
            com,
            true_com,
            first_t: s.in_t + dt,
            last_t: leaving_dt.map(|dt| s.out_t + dt),
            impact: Point3::new(at.x, at.y, 0.0),
            at,
            ball_out: s.ball_out.as_ref().map(|b| b.after(out_dt).velocity),
            racket_out: body_out.as_ref().map(|r| r.velocity),
            rate_out: body_out.as_ref().map(|r| r.attitude * r.rate_body),
            ball_in,
            racket_in,
            racket,
            s,
            e,
        }
    }

    /// A global vector in local axes at first contact.
    fn local(&self, v: Vector3<f64>) -> Vector3<f64> {
        self.racket_in.attitude.inverse() * v
    }

    fn contact_time(&self) -> Option<f64> {
        self.last_t.map(|t| t - self.first_t)
    }

    /// Velocity of a point of the racket at first contact, local axes.
    fn point_in(&self, p: &Point3<f64>) -> Vector3<f64> {
        self.local(self.racket_in.point_velocity(p, &self.com))
    }

    /// V + Ω x ρ at last contact, with the place as at first contact, the axes in which the impacts table stands: an impulse model knows no turn
    /// during contact, and a restitution from the table is to be the one here.
    fn point_out(&self, p: &Point3<f64>) -> Option<Vector3<f64>> {
        self.racket_out.zip(self.rate_out).map(|(v, w)| self.local(v) + self.local(w).cross(&(p - self.com)))
    }

    /// The impact from the true centre of mass.
    fn impact_from_com(&self) -> Vector2<f64> {
        Vector2::new(self.at.x - self.true_com.x, self.at.y)
    }

    /// Ball relative to the impact point, and its approach along the normal.
    fn meeting_velocity(&self) -> (Vector3<f64>, f64) {
        let u = self.local(self.ball_in.velocity) - self.point_in(&self.impact);
        (u, -self.s.side * u.z)
    }

    fn effective_mass(&self) -> f64 {
        effective_mass(self.s.racket_mass, &self.inertia, &self.impact_from_com())
    }

    /// The impacts table's own columns, local axes at first contact.
    fn table_columns(&self, list: &mut List) {
        list.vector("ball_in_v", "m/s", Some(self.local(self.ball_in.velocity)));
        list.vector("ball_in_w", "rad/s", self.s.spin_in.map(|w| self.local(w)));
        list.vector("racket_in_v", "m/s", Some(self.local(self.racket_in.velocity)));
        list.vector("racket_in_w", "rad/s", Some(self.racket_in.rate_body));
        list.put("impact_x", "m", self.at.x);
        list.put("impact_y", "m", self.at.y);
        list.vector("ball_out_v", "m/s", self.ball_out.map(|v| self.local(v)));
        list.vector("ball_out_w", "rad/s", self.s.spin_out.map(|w| self.local(w)));
        list.vector("racket_out_v", "m/s", self.racket_out.map(|v| self.local(v)));
        list.vector("racket_out_w", "rad/s", self.rate_out.map(|w| self.local(w)));
        list.put("contact_time", "s", self.contact_time());
    }

    fn timing(&self, list: &mut List) {
        // The thesis's instant: centre on the plane, both motions carried on as if nothing were in the way (4.11).
        let through = crossing(&self.ball_in, &self.racket_in, &self.com, self.s.side, 0.0);
        let on_plane = through.map(|t| ball_in_racket(&self.ball_in.after(t), &self.racket_in.after(t), &self.com));
        list.put("impact_frame", "frame", self.e.clock.frame_at(self.first_t));
        list.put("last_contact_frame", "frame", self.last_t.map(|t| self.e.clock.frame_at(t)));
        list.put("centre_on_plane_delay", "s", through);
        list.put("centre_on_plane_x", "m", on_plane.map(|p| p.x));
        list.put("centre_on_plane_y", "m", on_plane.map(|p| p.y));
    }

    /// Velocities along global axes, and sizes.
    fn global_velocities(&self, list: &mut List) {
        let (ball, racket) = (&self.ball_in, &self.racket_in);
        list.vector("ball_in_global_v", "m/s", Some(ball.velocity));
        list.vector("ball_out_global_v", "m/s", self.ball_out);
        list.vector("racket_in_global_v", "m/s", Some(racket.velocity));
        list.vector("racket_out_global_v", "m/s", self.racket_out);
        list.vector("racket_in_global_w", "rad/s", Some(racket.attitude * racket.rate_body));
        list.vector("racket_out_global_w", "rad/s", self.rate_out);
        list.put("ball_in_speed", "m/s", ball.velocity.norm());
        list.put("ball_out_speed", "m/s", self.ball_out.map(|v| v.norm()));
        list.put("racket_in_speed", "m/s", racket.velocity.norm());
        list.put("racket_out_speed", "m/s", self.racket_out.map(|v| v.norm()));
        list.put("racket_in_rate", "rad/s", racket.rate_body.norm());
        list.put("racket_out_rate", "rad/s", self.rate_out.map(|w| w.norm()));
    }

    /// Spin: size, and the topspin component about the horizontal axis across the path (positive = topspin).
    fn spins(&self, list: &mut List) {
        for (name, spin, velocity) in [("ball_in", self.s.spin_in, Some(self.ball_in.velocity)), ("ball_out", self.s.spin_out, self.ball_out)] {
            let topspin = spin.zip(velocity).and_then(|(w, v)| self.e.up?.cross(&v).try_normalize(1e-6).map(|axis| w.dot(&axis)));
            list.vector(&format!("{name}_global_w"), "rad/s", spin);
            list.put(&format!("{name}_spin"), "rad/s", spin.map(|w| w.norm()));
            list.put(&format!("{name}_spin_rpm"), "rpm", spin.map(|w| w.norm() * RPM));
            list.put(&format!("{name}_topspin"), "rad/s", topspin);
            list.put(&format!("{name}_topspin_rpm"), "rpm", topspin.map(|w| w * RPM));
        }
    }

    /// Points of the racket, local axes.
    fn velocities_of_points(&self, list: &mut List) {
        let tip = Point3::new(self.racket.stringbed_centre_m - self.racket.length_m, 0.0, 0.0);
        for (name, p) in [("tip", &tip), ("impact_point", &self.impact)] {
            let (before, after) = (self.point_in(p), self.point_out(p));
            list.vector(&format!("{name}_in_v"), "m/s", Some(before));
            list.put(&format!("{name}_in_speed"), "m/s", before.norm());
            list.vector(&format!("{name}_out_v"), "m/s", after);
            list.put(&format!("{name}_out_speed"), "m/s", after.map(|v| v.norm()));
        }
        for p in self.e.points {
            let name = point_name(p);
            let p = Point3::new(p.x, p.y, 0.0);
            list.vector(&format!("{name}_in_v"), "m/s", Some(self.point_in(&p)));
            list.vector(&format!("{name}_out_v"), "m/s", self.point_out(&p));
        }
    }

    /// Impact position from the other two origins, and the angles.
    fn place_and_angles(&self, list: &mut List) {
        list.put("impact_x_from_com", "m", self.impact_from_com().x);
        list.put("impact_from_butt", "m", self.racket.stringbed_centre_m - self.at.x);
        let (u, approach) = self.meeting_velocity();
        let attitude = &self.racket_in.attitude;
        let up_in_face = self.e.up.map(|up| self.local(up)).and_then(|up| Vector3::new(up.x, up.y, 0.0).try_normalize(1e-6));
        list.put("playing_angle_deg", "deg", up_in_face.map(|y| u.dot(&y).atan2(approach).to_degrees()));
        list.put("incidence_angle_deg", "deg", (approach / u.norm()).clamp(-1.0, 1.0).acos().to_degrees());
        // The thesis's sum of two unsigned angles (4.16a, b), z on the ball's side, U global.
        let along_u = (attitude * -u).x / u.norm();
        let normal_u = self.s.side * (attitude * Vector3::z()).x;
        let thesis_angle = (along_u.clamp(-1.0, 1.0).acos() + normal_u.clamp(-1.0, 1.0).acos()).to_degrees();
        list.put("playing_angle_thesis_deg", "deg", self.e.up.map(|_| thesis_angle));
        list.put("planar_racket_velocity", "m/s", self.point_in(&self.impact).xy().norm());
        list.put("planar_relative_velocity", "m/s", u.xy().norm());
        // How fast the face brushes up past the ball: what makes topspin.
        list.put("planar_relative_velocity_up", "m/s", up_in_face.map(|y| -u.dot(&y)));
    }

    /// Restitution along the normal of first contact: apparent against the impact point before, true (which is returned) against it after.
    fn restitutions(&self, list: &mut List) -> Option<f64> {
        let (n, (_, approach), m_e) = (self.s.side, self.meeting_velocity(), self.effective_mass());
        let rebound = self.ball_out.map(|v| n * (self.local(v) - self.point_in(&self.impact)).z);
        let apparent = rebound.map(|r| r / approach);
        let separation = self.ball_out.zip(self.point_out(&self.impact)).map(|(v, ip)| n * (self.local(v) - ip).z);
        let restitution = separation.map(|s| s / approach);
        list.put("apparent_restitution", "", apparent);
        list.put("restitution", "", restitution);
        list.put("restitution_from_apparent", "", apparent.map(|a| a + self.s.ball_mass / m_e * (1.0 + a)));
        list.put("effective_mass", "kg", m_e);
        restitution
    }

    /// Sweet spots, from the butt, and how far beyond them (toward the tip) the impact was.
    fn sweet_spots(&self, restitution: Option<f64>, list: &mut List) {
        let (racket, inertia, n, rate) = (&self.racket, &self.inertia, self.s.side, &self.racket_in.rate_body);
        let (m, mass, from_com) = (self.s.ball_mass, self.s.racket_mass, self.impact_from_com());
        let com_in = self.point_in(&self.true_com);
        let ideal = ideal_point(mass, inertia.y, m, n * com_in.z, n * self.local(self.ball_in.velocity).z, n * rate.y);
        let spots = [
            ("centre_of_percussion", Some(centre_of_percussion(racket, self.s.hand_from_butt))),
            ("node_point", Some(self.s.node_of_length * racket.length_m - racket.balance_m)),
            ("node_point_thesis", Some(THESIS_NODE_OF_LENGTH * racket.length_m - racket.balance_m)),
            ("dead_spot", restitution.and_then(|e| dead_spot(mass, inertia.y, m, e))),
            ("ideal_point", ideal),
        ];
        for (name, spot) in spots {
            list.put(&format!("{name}_from_butt"), "m", spot.map(|x| racket.balance_m + x));
            list.put(&format!("impact_beyond_{name}"), "m", spot.map(|x| -from_com.x - x));
        }
        // Impact success ratio (5.6): momentum of the ideal point over that of the impact point.
        let momentum = |x: f64, y: f64| effective_mass(mass, inertia, &Vector2::new(x, y)) * n * (rate.x * y - rate.y * x + com_in.z);
        let actual = momentum(from_com.x, from_com.y);
        // A racket at rest brings no momentum: the ratio of two noises is no ratio.
        let moves = actual.abs() > AT_REST_M_S * self.effective_mass();
        list.put("impact_success_ratio", "", ideal.map(|b| momentum(-b, 0.0) / actual).filter(|_| moves));
    }

    /// Efficiency (5.8), court frame, each inertia with its own axis. A spin of 300 rad/s holds 7 % of the energy of a ball of 30 m/s: without both spins
    /// there is none, and what one component leaves unknown is as much.
    fn efficiency(&self, list: &mut List) {
        let (ball, rate, m) = (self.e.ball, &self.racket_in.rate_body, self.s.ball_mass);
        let spin_energy = |w: Vector3<f64>| ball.inertia_kg_m2() * (m / ball.mass_kg) * w.norm_squared();
        let racket_energy = self.s.racket_mass * self.point_in(&self.true_com).norm_squared() + self.inertia.component_mul(rate).dot(rate);
        let energy_in = self.s.spin_in.map(|w| racket_energy + m * self.ball_in.velocity.norm_squared() + spin_energy(w));
        let energy_out = self.ball_out.zip(self.s.spin_out).map(|(v, w)| m * v.norm_squared() + spin_energy(w));
        list.put("efficiency", "", energy_out.zip(energy_in).map(|(out, brought)| out / brought));
    }

    /// What else pushed on ball and racket while they touched (local axes at first contact).
    fn momentum_balance(&self, list: &mut List) {
        let (m, mass, before) = (self.s.ball_mass, self.s.racket_mass, self.ball_in.velocity);
        let com_in = self.point_in(&self.true_com);
        let fall = self.contact_time().zip(self.e.up).map(|(t, up)| -up * (crate::kinematics::GRAVITY_M_S2 * t));
        let after = self.ball_out.zip(self.point_out(&self.true_com));
        let lacking = after.zip(fall).map(|((ball, racket), fall)| self.local((ball - before) * m - fall * (m + mass)) + (racket - com_in) * mass);
        list.vector("unexplained_impulse_", "N s", lacking);
        // What a support gives that carries the racket through the contact, as a stand, a string or a quiet hand does.
        list.vector("carrying_impulse_", "N s", fall.map(|fall| self.local(-fall * mass)));
        list.vector("ball_impulse_", "N s", self.ball_out.map(|v| self.local((v - before) * m)));
    }
}

#[cfg(test)]
mod tests;
