//! Published numbers against the visco-elastic model (physics reference, C.7): `sweetspot explore published`.

use super::rig::{WALL, at_rest, clamped, frame, prepared, pure_drive};
use crate::impact::PreparedModel;
use crate::impact::body::Body;
use crate::impact::error::ModelError;
use crate::impact::input::ImpactInput;
use crate::impact::viscoelastic::Run;
use nalgebra::{Matrix2, Rotation3, Vector2, Vector3};

/// One line of the table.
#[derive(Debug, Clone, serde::Serialize)]
pub struct Line {
    pub quantity: &'static str,
    pub published: &'static str,
    /// Of the reference's own prototype with the same parameters (set P2).
    pub reference: f64,
    pub model: f64,
    pub unit: &'static str,
}

fn head_on(body: Body, changes: &[(&str, f64)], speed: f64, along: f64) -> Result<Run, ModelError> {
    let input = at_rest(&body, [0.0, 0.0, -speed], [0.0; 3], along, 0.0);
    prepared(body, changes)?.run_default(&input)
}

fn restitution(run: &Run, along: f64, speed: f64) -> f64 {
    let o = &run.output;
    (o.ball_velocity.z - o.racket_velocity.z + o.racket_rate.y * along) / speed
}

/// All lines of the table.
///
/// # Errors
/// None with the documented parameters; passed on from the model.
pub fn table() -> Result<Vec<Line>, ModelError> {
    let mut lines = Vec::new();
    let mut add = |quantity, published, reference, model, unit| lines.push(Line { quantity, published, reference, model, unit });
    for (quantity, published, reference, speed) in [
        ("restitution on a rigid wall, 7.06 m/s", "0.728-0.762 (ITF)", 0.745, 7.06),
        ("restitution on a rigid wall, 20 m/s", "0.575 (Miller and Messner 2003)", 0.570, 20.0),
        ("restitution on a rigid wall, 40 m/s", "0.40 (the text's other speed)", 0.427, 40.0),
        ("restitution on a rigid wall, 45 m/s", "0.40 (Miller and Messner 2003)", 0.406, 45.0),
    ] {
        let r = head_on(clamped(60.0), &WALL, speed, 0.0)?;
        add(quantity, published, reference, r.output.ball_velocity.z / speed, "");
    }
    for (quantity, published, reference, speed) in [
        ("contact time on a rigid wall, 7 m/s", "about 5 ms", 4.3, 7.0),
        ("contact time on a rigid wall, 20 m/s", "between", 3.6, 20.0),
        ("contact time on a rigid wall, 30 m/s", "3.5 ms", 3.3, 30.0),
    ] {
        add(quantity, published, reference, 1e3 * head_on(clamped(60.0), &WALL, speed, 0.0)?.output.contact_time.unwrap_or(0.0), "ms");
    }
    for (quantity, published, e, ms, speed) in [
        ("head clamped, 8.5 m/s", "e about 0.85 (Brody 1979); 4.5-6.8 ms", 0.872, 5.8, 8.5),
        ("head clamped, 20 m/s", "e falls with speed", 0.831, 5.2, 20.0),
        ("head clamped, 30 m/s", "e falls with speed", 0.804, 4.7, 30.0),
    ] {
        let r = head_on(clamped(60.0), &[("mu", 0.0)], speed, 0.0)?;
        add(quantity, published, e, restitution(&r, 0.0, speed), "");
        add(quantity, published, ms, 1e3 * r.output.contact_time.unwrap_or(0.0), "ms");
    }
    for (quantity, mm, speed) in [("head clamped, 20 m/s", 15.5, 20.0), ("head clamped, 30 m/s", 22.9, 30.0), ("head clamped, 35 m/s", 26.3, 35.0)] {
        add(quantity, "strings deflect 10-25 mm", mm, 1e3 * head_on(clamped(60.0), &[("mu", 0.0)], speed, 0.0)?.peak_deflection, "mm");
    }
    for (quantity, n, speed) in [("head clamped, 20 m/s", 698.0, 20.0), ("head clamped, 30 m/s", 1195.0, 30.0)] {
        add(quantity, "of the order of 1000 N", n, head_on(clamped(60.0), &[("mu", 0.0)], speed, 0.0)?.peak_force, "N");
    }
    // A pool ball hardly deforms: what the strings alone give back.
    let mut pool = clamped(60.0);
    pool.ball_mass = 0.17;
    let hard = [("k_B0", 1e6), ("A_K", 0.0), ("A_C", 0.0), ("c_B0", 0.0), ("kS0", 34e3), ("mu", 0.0)];
    add("pool ball on strings", "95 % of the height, e 0.97", 0.96, restitution(&head_on(pool, &hard, 5.0, 0.0)?, 0.0, 5.0), "");
    for (quantity, e, ms, mm, speed) in [
        ("free racket 0.225 m from its centre, 10 m/s", 0.849, 4.9, 6.3, 10.0),
        ("free racket 0.225 m from its centre, 20 m/s", 0.813, 4.5, 13.1, 20.0),
        ("free racket 0.225 m from its centre, 30 m/s", 0.785, 4.2, 19.6, 30.0),
        ("free racket 0.225 m from its centre, 35 m/s", 0.774, 4.0, 22.6, 35.0),
        ("free racket 0.225 m from its centre, 40 m/s", 0.763, 3.9, 25.5, 40.0),
    ] {
        let r = head_on(frame(), &[("mu", 0.0)], speed, -0.225)?;
        add(quantity, "0.758-0.885 (Hatze)", e, restitution(&r, -0.225, speed), "");
        add(quantity, "4-6 ms", ms, 1e3 * r.output.contact_time.unwrap_or(0.0), "ms");
        add(quantity, "strings deflect 10-25 mm", mm, 1e3 * r.peak_deflection, "mm");
    }
    for (quantity, e, ms, lb) in [("head clamped, 20 m/s, 40 lb", 0.848, 5.6, 40.0), ("head clamped, 20 m/s, 70 lb", 0.821, 5.0, 70.0)] {
        let r = head_on(clamped(lb), &[("mu", 0.0)], 20.0, 0.0)?;
        add(quantity, "lower tension, faster ball", e, restitution(&r, 0.0, 20.0), "");
        add(quantity, "lower tension, longer contact", ms, 1e3 * r.output.contact_time.unwrap_or(0.0), "ms");
    }
    for (quantity, published, reference, from_butt, across) in [
        ("power potential of a Pure Drive, centre", "41 % (TWU)", 37.7, 0.52, 0.0),
        ("power potential of a Pure Drive, throat", "51 % (TWU)", 51.8, 0.40, 0.0),
        ("power potential of a Pure Drive, tip", "22 % (TWU)", 20.3, 0.62, 0.0),
        ("power potential of a Pure Drive, edge", "20.5 % (TWU)", 15.9, 0.52, 0.076),
    ] {
        let body = pure_drive();
        let input = at_rest(&body, [0.0, 0.0, -20.0], [0.0; 3], 0.330 - from_butt, across);
        let r = prepared(body, &[("mu", 0.0)])?.run_default(&input)?;
        add(quantity, published, reference, 100.0 * r.output.ball_velocity.z / 20.0, "%");
    }
    // Spin change over tangential velocity change: free racket, 30 m/s, 8 m/s across.
    let input = at_rest(&frame(), [0.0, 8.0, -30.0], [0.0; 3], -0.2, 0.0);
    let o = prepared(frame(), &[])?.run_default(&input)?.output;
    let ratio = frame().ball_radius * o.ball_spin.x / (o.ball_velocity.y - 8.0);
    add("radius times spin change over speed change", "slightly above 1.5 (TWU)", 1.65, ratio, "");
    // 13.5 m/s at 30 degrees from the normal, 270 rad/s of backspin, at the stringbed's centre.
    let (angle, body) = (30f64.to_radians(), frame());
    let across = 13.5 * angle.sin();
    let input = at_rest(&body, [0.0, across, -13.5 * angle.cos()], [270.0, 0.0, 0.0], -body.com_x, 0.0);
    let o = prepared(body, &[])?.run_default(&input)?.output;
    let grip = (across - o.ball_velocity.y) / (o.ball_velocity.z - input.ball_velocity.z);
    add("13.5 m/s, 30 degrees, 270 rad/s of backspin: tangential over normal impulse", "about 0.4 (TWU)", 0.33, grip, "");
    // 25.0 m/s at 40 degrees from the normal, 3820 rpm of backspin; positive out is topspin.
    for (quantity, reference, changes) in
        [("spin off a clamped bed, 40 degrees, 3820 rpm backspin in", 1225.0, &[][..]), ("the same, strings of 60 kN/m sideways", 1810.0, &[("k_t", 60e3)][..])]
    {
        let (angle, body) = (40f64.to_radians(), clamped(60.0));
        let spin = 3820.0 * std::f64::consts::TAU / 60.0;
        // Travelling along +y, topspin is about −x.
        let input = at_rest(&body, [0.0, 25.0 * angle.sin(), -25.0 * angle.cos()], [spin, 0.0, 0.0], 0.0, 0.0);
        let r = prepared(body, changes)?.run_default(&input)?;
        add(quantity, "1207-1803 rpm (TWU)", reference, -r.output.ball_spin.x * 60.0 / std::f64::consts::TAU, "rpm");
    }
    Ok(lines)
}

/// Means of tables 5.27 (men) and 5.28 (women), global axes: X to the net, Y up, Z along the baseline.
struct Players {
    who: &'static str,
    com: [f64; 3],
    ball_in: [f64; 3],
    ball_out: [f64; 3],
    rate: [f64; 3],
    topspin_rpm: f64,
}

const PLAYERS: [Players; 2] = [
    Players {
        who: "men",
        com: [15.96, 6.21, -4.43],
        ball_in: [-9.30, -0.64, 1.13],
        ball_out: [32.86, 5.37, -4.72],
        rate: [2.75, 30.53, 6.46],
        topspin_rpm: 1125.0,
    },
    Players {
        who: "women",
        com: [14.93, 5.51, -1.10],
        ball_in: [-9.34, 0.20, 0.08],
        ball_out: [30.54, 4.47, -0.81],
        rate: [4.33, 30.24, 8.88],
        topspin_rpm: 1036.0,
    },
];

/// A mean shot of the campaign, predicted.
#[derive(Debug, Clone, serde::Serialize)]
pub struct MeanShot {
    pub who: &'static str,
    /// Whether the chop rate has the sign of the table or the other one; the table's convention is not known.
    pub chop_as_printed: bool,
    /// Sideways stiffness of the strings, N/m; 0: rigid.
    pub strings_n_m: f64,
    pub published_forward_m_s: f64,
    pub forward_m_s: f64,
    pub published_topspin_rpm: f64,
    pub topspin_rpm: f64,
    /// The face's attitude, solved so that the upward and sideways speeds agree, degrees.
    pub open_deg: f64,
    pub yaw_deg: f64,
}

/// Tables 5.27 and 5.28: the face's two unknown angles are solved from the ball's upward and sideways speed; forward speed and
/// topspin are then predictions.
///
/// # Errors
/// Passed on from the model.
pub fn mean_shots() -> Result<Vec<MeanShot>, ModelError> {
    let mut all = Vec::new();
    for players in &PLAYERS {
        for chop_as_printed in [true, false] {
            for (strings_n_m, damping) in [(0.0, 20.0), (30e3, 20.0)] {
                let model = prepared(frame(), &[("k_t", strings_n_m), ("c_t", damping)])?;
                all.push(mean_shot(players, chop_as_printed, strings_n_m, &model)?);
            }
        }
    }
    Ok(all)
}

fn mean_shot(players: &Players, chop_as_printed: bool, strings_n_m: f64, model: &PreparedModel) -> Result<MeanShot, ModelError> {
    let chop = if chop_as_printed { 1.0 } else { -1.0 };
    let rate = Vector3::new(players.rate[0], players.rate[1], chop * players.rate[2]);
    // Mean frame of a forehand: z to the net, y up, x (toward the handle) to −Z; then yaw about the vertical and opening about x.
    let square = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[-Vector3::z(), Vector3::y(), Vector3::x()]));
    let out = |a: &Vector2<f64>| -> Result<(Vector3<f64>, Vector3<f64>), ModelError> {
        let global_from_local = Rotation3::from_axis_angle(&Vector3::y_axis(), a.x) * square * Rotation3::from_axis_angle(&Vector3::x_axis(), a.y);
        let local = |v: [f64; 3]| global_from_local.inverse() * Vector3::from(v);
        let input = ImpactInput {
            ball_velocity: local(players.ball_in),
            ball_spin: Vector3::zeros(),
            racket_velocity: local(players.com),
            racket_rate: rate,
            position: Vector2::new(0.51 - 0.5496, 0.0),
            grip_torque: 0.0,
            order: 0.0,
        };
        let o = model.predict(&input)?;
        Ok((global_from_local * o.ball_velocity, global_from_local * o.ball_spin))
    };
    let miss = |a: &Vector2<f64>| -> Result<Vector2<f64>, ModelError> {
        let (v, _) = out(a)?;
        Ok(Vector2::new(v.y - players.ball_out[1], v.z - players.ball_out[2]))
    };
    let mut a = Vector2::zeros();
    for _ in 0..20 {
        let f = miss(&a)?;
        if f.norm() < 1e-9 {
            break;
        }
        let h = 1e-4;
        let columns = [miss(&(a + Vector2::new(h, 0.0)))? - f, miss(&(a + Vector2::new(0.0, h)))? - f];
        let jacobian = Matrix2::from_columns(&columns) / h;
        a -= jacobian.try_inverse().ok_or(ModelError::NotFinite)? * f;
    }
    let (v, w) = out(&a)?;
    Ok(MeanShot {
        who: players.who,
        chop_as_printed,
        strings_n_m,
        published_forward_m_s: players.ball_out[0],
        forward_m_s: v.x,
        published_topspin_rpm: players.topspin_rpm,
        topspin_rpm: -w.z * 60.0 / std::f64::consts::TAU,
        open_deg: -a.y.to_degrees(),
        yaw_deg: a.x.to_degrees(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No line is further from the reference's P2 column than its printed digits and the wall's small own loss allow.
    #[test]
    fn truth_published_table() {
        for line in table().expect("contacts") {
            let digits = match line.unit {
                // The prototype's place and racket are not printed, its range is: 1.6 to 1.7, and 0.33.
                "" if line.quantity.starts_with("radius times") => 0.07,
                "" if line.quantity.starts_with("13.5 m/s") => 0.01,
                "" => 0.004,
                "ms" => 0.08,
                "mm" => 0.06,
                "%" => 0.1,
                "N" => 1.0,
                // The prototype gives 1217 to 1233 rpm for friction from 0.35 to 0.5.
                _ => 10.0,
            };
            eprintln!("{:<60} {:<42} {:>9.3} {:>9.3} {}", line.quantity, line.published, line.reference, line.model, line.unit);
            assert!((line.model - line.reference).abs() <= digits, "{line:?}");
        }
    }

    #[test]
    fn truth_mean_shots_of_the_campaign() {
        for s in mean_shots().expect("contacts") {
            eprintln!("{s:?}");
            let limit = if s.who == "men" { 0.03 } else { 0.04 };
            assert!((s.forward_m_s / s.published_forward_m_s - 1.0).abs() <= limit, "{s:?}");
            // With the other sign of the chop rate both spins come near print; as printed they do not.
            if !s.chop_as_printed && s.strings_n_m > 0.0 {
                assert!((s.topspin_rpm / s.published_topspin_rpm - 1.0).abs() < 0.1, "{s:?}");
            }
        }
    }
}
