//! One shot measured: motions, contact, every characteristic with its uncertainty, and its row of the impacts table.

use super::KinematicsError;
use super::ball_flight::FlightEstimate;
use super::calibration_share::CalibrationShare;
use super::characteristics::{ShotEquipment, characteristics};
use super::contact::BodyMotion;
use super::face_pose::face_pose_sd;
use super::flights_meet::Passing;
use super::least_squares::chi2_tail_3;
use super::marker_distance::{MarkerDistance, marker_distances, mismatch_remark};
use super::racket_motion::MotionEstimate;
use super::racket_outline::{outside_strings, past_racket};
use super::shot_motion::{BENDS_P, MeasureSettings, ShotMotion, USUAL_CONTACT_S, measure_motion};
use super::shot_state::{BALANCE_SD_M, LEAVING_FLAT_SD_S, Measure, SPEED_SCALE_SD, SPIN_SCALE_SD, SpinVector, UncertainShot};
use super::sighting::UsedSightings;
use super::space_points::{on_rigid_racket, space_points};
use super::thesis_path::{ThesisShot, thesis_shot};
use crate::calibration::{CalibrationSpread, StereoRig};
use crate::equipment::{Ball, Racket};
use crate::impact_table::{INPUTS, ImpactRow, Measured, OUTPUTS};
use crate::quantity::{HOLD_95_PERCENT, Quantity, RPM};
use crate::tracking::{Flattening, SpacePoint, Tracks, View, widen_by_shake};
use nalgebra::{DMatrix, Matrix3, Vector2, Vector3};
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::ser::{SerializeMap, Serializer};
use serde::{Deserialize, Serialize};

/// Named quantities in the order in which shot.json shows them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Quantities(pub Vec<(String, Quantity)>);

impl Quantities {
    pub fn get(&self, name: &str) -> Option<&Quantity> {
        self.0.iter().find(|(n, _)| n == name).map(|(_, q)| q)
    }
}

impl Serialize for Quantities {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, quantity) in &self.0 {
            map.serialize_entry(name, quantity)?;
        }
        map.end()
    }
}

impl<'de> Deserialize<'de> for Quantities {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Quantities;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("an object of named quantities {value, sd, unit}")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Quantities, A::Error> {
                let mut all = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    all.push(entry);
                }
                Ok(Quantities(all))
            }
        }
        deserializer.deserialize_map(InOrder)
    }
}

/// How a window was fitted.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct WindowReport {
    pub frames: usize,
    /// From the contact to the farthest frame used, s.
    #[serde(default)]
    pub length_s: f64,
    /// Probability of a path that bends as much beyond the laws of flight, if it obeyed them: the test by which the ball's
    /// window is shortened. A racket's laws hold three orders of bending themselves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bending_p: Option<f64>,
    /// Whether farther points were left out because with them the path bends more than the laws.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub shortened: bool,
    /// Image points left out as outliers.
    pub rejected_points: usize,
    /// Factor by which the residuals exceed the tracks' own deviations.
    pub noise_scale: f64,
    /// Laws of motion with their probability, best first.
    pub laws: Vec<(String, f64)>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Windows {
    pub ball_in: WindowReport,
    pub racket_in: WindowReport,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ball_out: Option<WindowReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub racket_out: Option<WindowReport>,
}

/// Whether anything but ball and racket took part in the exchange of momentum.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MomentumVerdict {
    /// χ² of the unexplained impulse with three degrees of freedom.
    pub chi2: f64,
    /// Probability of a χ² this large if the hand did nothing.
    pub p_value: f64,
    pub hand_interferes: bool,
}

/// Rising, apex or falling: the sign of the ball's vertical velocity at first contact (thesis 5.5.1), apex when its 95 %
/// interval holds zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImpactTiming {
    Rising,
    Apex,
    Falling,
}

/// Where in the swing the ball was met: before the apex the racket moves away from the player (local x velocity of the
/// impact point below zero), after it toward the player (thesis 5.5.1, figure 5.26); apex when the 95 % interval holds zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SwingTiming {
    BeforeApex,
    Apex,
    AfterApex,
}

/// The content of shot.json.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shot {
    pub id: String,
    pub racket: String,
    pub ball: String,
    /// `+z` or `-z`: the face the ball came to.
    pub ball_side_of_face: String,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<(String, String)>,
    pub quantities: Quantities,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub impact_timing: Option<ImpactTiming>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub swing_timing: Option<SwingTiming>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub momentum: Option<MomentumVerdict>,
    pub windows: Windows,
    /// Deviations of the face's axes that all shots of the session share: turn about x, y, z (rad), shift along them (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub face_pose_sd: Option<[f64; 6]>,
    /// The same shot by the thesis's construction, as a check.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thesis: Option<ThesisShot>,
    /// Distances between markers in the footage against racket.toml.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub marker_distances: Vec<MarkerDistance>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
}

/// A shot with what else the shell writes.
#[derive(Debug, Clone)]
pub struct MeasuredShot {
    pub shot: Shot,
    pub points: Vec<SpacePoint>,
    pub motion: ShotMotion,
}

/// Spin of the ball on both sides of the contact, where it was measured.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ShotSpin {
    pub before: Option<SpinVector>,
    pub after: Option<SpinVector>,
    /// Rate about one known axis where the markings gave no vector (the axis stands in the remarks).
    pub before_component: Option<SpinComponent>,
    pub after_component: Option<SpinComponent>,
    pub remarks: Vec<String>,
}

/// A spin of which only the part about one axis could be measured, rad/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpinComponent {
    pub rate_rad_s: f64,
    pub sd_rad_s: f64,
}

/// What is measured on: everything a shot's files say.
pub struct ShotInput<'a> {
    pub id: &'a str,
    pub rig: &'a StereoRig,
    pub tracks: &'a Tracks,
    pub racket: &'a Racket,
    pub ball: &'a Ball,
    pub spin: &'a ShotSpin,
    /// Recorded torque of the mount about the handle, N m.
    pub grip_torque_n_m: Option<f64>,
    /// Largest that the pictures show, by the strings.
    pub ball_flattening: Option<Flattening>,
    pub groups: &'a [(String, String)],
    /// Local points whose velocity is asked for, m.
    pub asked_points: &'a [Vector2<f64>],
}

/// The ball's velocity does not change where error alone would make as much of a change in more than one shot of a thousand,
const NOTHING_P: f64 = 0.001;
/// or where the change is less than a fiftieth of the speed at which ball and racket meet (a ball that strings throw back changes by more than that
/// speed, one that the frame turns aside by a part of it), should the tracks' deviations be understated.
const NOTHING_OF_SPEED: f64 = 0.02;
/// How far beyond the racket's outline the ball may be turned round, m: a head is an ellipse to some millimetres only.
const BEYOND_M: f64 = 0.010;
const NO_VERTICAL: &str = "the calibration has no axes' frame, and nothing knows what is up: gravity is taken along the left camera's downward axis, and playing angle, \
                           topspin, planar_relative_velocity_up, impact timing, unexplained and carrying impulse and the momentum balance are left out";

/// Measures a shot.
///
/// # Errors  [`KinematicsError`]; nothing after contact is not an error, the shot then has no outputs and says why.
pub fn measure_shot(input: &ShotInput<'_>, settings: &MeasureSettings) -> Result<MeasuredShot, KinematicsError> {
    let motion = measure_motion(input.rig, input.tracks, input.racket, input.ball, settings)?;
    let calibration = CalibrationShare::of_rig(input.rig);
    let uncertain = UncertainShot::new(&motion, input.racket, input.ball, input.spin.before.as_ref(), input.spin.after.as_ref(), &calibration);
    let equipment = ShotEquipment {
        racket: input.racket,
        ball: input.ball,
        points: input.asked_points,
        clock: motion.clock,
        up: settings.axes_known.then(|| -settings.gravity().normalize()),
    };
    let (measures, covariance) = uncertain.propagate(|s| characteristics(s, &equipment));
    let characteristics = Characteristics { measures, covariance };
    let face = BodyMotion::from(&motion.racket_in).pose(&motion.moving.com_local);
    characteristics.refuse_no_impact(input, &(face.rotation.inverse() * settings.gravity()))?;
    let passing = Passing::of_shot(&motion);
    if let Some(Passing { apart_m, sd_m, .. }) = passing.filter(Passing::turned_elsewhere) {
        return Err(KinematicsError::TurnedElsewhere { apart_m, sd_m });
    }
    let mut quantities = characteristics.quantities();
    for (name, component) in [("ball_in_spin_component", input.spin.before_component), ("ball_out_spin_component", input.spin.after_component)] {
        if let Some(c) = component {
            quantities.0.push((name.to_owned(), Quantity::new(c.rate_rad_s, c.sd_rad_s, "rad/s")));
            quantities.0.push((format!("{name}_rpm"), Quantity::new(c.rate_rad_s * RPM, c.sd_rad_s * RPM, "rpm")));
        }
    }
    // Set on the mount, not measured: no deviation of its own.
    quantities.0.extend(input.grip_torque_n_m.map(|torque| ("grip_torque".to_owned(), Quantity::new(torque, 0.0, "N m"))));
    quantities.0.extend(input.ball_flattening.map(|f| ("ball_flattening".to_owned(), Quantity::new(f.share, f.sd, ""))));
    let points = space_points(input.rig, input.tracks, &motion);
    let marker_distances = marker_distances(&points, &motion.moving.figure);
    let thesis = thesis_shot(&points, &motion);
    // The distances and the thesis's construction use single points, independent of the rigid figure; what is written is as
    // near as the whole figure allows.
    let mut points = on_rigid_racket(input.rig, input.tracks, &motion, &points);
    let mut spread = CalibrationSpread::of_rig(input.rig);
    for point in &mut points {
        point.sd = spread.widen(&point.position, &point.sd);
    }
    widen_by_shake(&View::new(input.rig), &mut points, motion.shake_px);
    let windows = windows(&motion);
    let shot = Shot {
        id: input.id.to_owned(),
        racket: input.racket.name.clone(),
        ball: input.ball.name.clone(),
        ball_side_of_face: (if motion.side > 0.0 { "+z" } else { "-z" }).to_owned(),
        groups: input.groups.to_vec(),
        impact_timing: impact_timing(&quantities).filter(|_| settings.axes_known),
        swing_timing: swing_timing(&quantities),
        momentum: characteristics.momentum_verdict(),
        face_pose_sd: face_pose_sd(input.rig, &motion.moving.figure, &face, settings.tape.shared_px),
        thesis,
        remarks: remarks(input, settings, &motion, passing, &quantities, &marker_distances, &windows),
        quantities,
        windows,
        marker_distances,
    };
    Ok(MeasuredShot { shot, points, motion })
}

/// The characteristics of a shot, each with its deviation, and what their errors have in common.
struct Characteristics {
    measures: Vec<(Measure, f64)>,
    covariance: DMatrix<f64>,
}

impl Characteristics {
    fn quantities(&self) -> Quantities {
        Quantities(self.measures.iter().filter_map(|(m, sd)| Some((m.name.clone(), m.quantity(*sd)?))).collect())
    }

    fn value(&self, name: &str) -> Option<f64> {
        self.measures.iter().find(|(m, _)| m.name == name).and_then(|(m, sd)| m.quantity(*sd)).map(|q| q.value)
    }

    /// A vector by the name of its components, with its covariance.
    fn vector(&self, name: &str) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let place = |axis: &str| self.measures.iter().position(|(m, _)| m.name == format!("{name}_{axis}"));
        let at = [place("x")?, place("y")?, place("z")?];
        let value = |k: usize| self.measures[at[k]].0.value;
        Some((Vector3::new(value(0)?, value(1)?, value(2)?), Matrix3::from_fn(|a, b| self.covariance[(at[a], at[b])])))
    }

    /// Whether the momentum of ball and racket is kept, or a hand pushed meanwhile.
    fn momentum_verdict(&self) -> Option<MomentumVerdict> {
        let (lacking, covariance) = self.vector("unexplained_impulse")?;
        let (carrying, _) = self.vector("carrying_impulse")?;
        let information = covariance.try_inverse()?;
        // A racket may hang, lie in a quiet hand or fall: what carries it, all of its weight or some or none, does not interfere.
        let carried = (carrying.dot(&(information * lacking)) / carrying.dot(&(information * carrying)).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let v = lacking - carrying * carried;
        let chi2 = v.dot(&(information * v));
        let p_value = chi2_tail_3(chi2);
        Some(MomentumVerdict { chi2, p_value, hand_interferes: p_value < 0.05 })
    }

    /// Refuses a ball that meets nothing, or that turns round where there is no racket. `gravity` is racket-local.
    fn refuse_no_impact(&self, input: &ShotInput<'_>, gravity: &Vector3<f64>) -> Result<(), KinematicsError> {
        let value = |name: &str| self.value(name).unwrap_or(0.0);
        let (x_m, y_m) = (value("impact_x"), value("impact_y"));
        let past_m = past_racket(input.racket, input.ball, &Vector2::new(x_m, y_m));
        if let Some((push, spread)) = self.vector("ball_impulse") {
            // What gravity does meanwhile is no impact.
            let lasted_s = self.value("contact_time").map_or(USUAL_CONTACT_S, |t| t.max(0.0));
            let change = push / input.ball.mass_kg - gravity * lasted_s;
            let spread = spread / input.ball.mass_kg.powi(2);
            let against = ["x", "y", "z"].map(|a| value(&format!("ball_in_v{a}")) - value(&format!("impact_point_in_v{a}")));
            let speed_m_s = Vector3::from(against).norm();
            if let Some(information) = spread.try_inverse() {
                let change_m_s = change.norm();
                if chi2_tail_3(change.dot(&(information * change))) > NOTHING_P || change_m_s < NOTHING_OF_SPEED * speed_m_s {
                    return Err(if past_m > 0.0 {
                        KinematicsError::PassesBy { past_m, x_m, y_m }
                    } else {
                        KinematicsError::FliesOn { x_m, y_m, change_m_s, sd_m_s: spread.trace().sqrt(), speed_m_s }
                    });
                }
            }
        }
        if past_m > BEYOND_M {
            return Err(KinematicsError::OffTheFace { x_m, y_m, past_m });
        }
        Ok(())
    }
}

/// Whether the ball rose or fell as it was hit.
fn impact_timing(quantities: &Quantities) -> Option<ImpactTiming> {
    let v = quantities.get("ball_in_global_vy")?;
    Some(if v.value.abs() < HOLD_95_PERCENT * v.sd {
        ImpactTiming::Apex
    } else if v.value > 0.0 {
        ImpactTiming::Rising
    } else {
        ImpactTiming::Falling
    })
}

fn swing_timing(quantities: &Quantities) -> Option<SwingTiming> {
    // A racket that does not swing has no apex.
    quantities.get("impact_point_in_speed").filter(|v| v.value > 1.0 && v.value > 5.0 * v.sd)?;
    let v = quantities.get("impact_point_in_vx")?;
    Some(if v.value.abs() < HOLD_95_PERCENT * v.sd {
        SwingTiming::Apex
    } else if v.value < 0.0 {
        SwingTiming::BeforeApex
    } else {
        SwingTiming::AfterApex
    })
}

/// What the reader of a shot is to know beside its numbers.
fn remarks(
    input: &ShotInput<'_>,
    settings: &MeasureSettings,
    motion: &ShotMotion,
    passing: Option<Passing>,
    quantities: &Quantities,
    marker_distances: &[MarkerDistance],
    windows: &Windows,
) -> Vec<String> {
    let mut remarks = motion.remarks.clone();
    remarks.extend(input.spin.remarks.iter().cloned());
    let outside = motion.frames.values().filter(|f| f.ball.is_some_and(|b| b.far_outside)).count();
    if outside > 0 {
        remarks.push(format!(
            "the ball lies far outside the volume that the checkerboards filled in {outside} of {} frames: there the calibration is a guess",
            motion.frames.len()
        ));
    }
    let value = |name: &str| quantities.get(name).map_or(0.0, |q| q.value);
    let outside_m = outside_strings(&input.racket.head, &Vector2::new(value("impact_x"), value("impact_y")));
    if outside_m > 0.0 {
        let outside_mm = 1e3 * outside_m;
        remarks
            .push(format!("on the frame, {outside_mm:.0} mm outside the strings: effective mass, ideal point and the model are those of a hit on the strings"));
    }
    if !settings.axes_known {
        remarks.push(NO_VERTICAL.to_owned());
    }
    if quantities.get("impact_success_ratio").is_none() {
        remarks.push("no impact_success_ratio: the impact point stood still before the impact, and has no momentum to compare".to_owned());
    }
    remarks.extend(passing.and_then(|passing| passing.remark()));
    remarks.extend(mismatch_remark(marker_distances));
    for (when, window) in [("before", Some(&windows.ball_in)), ("after", windows.ball_out.as_ref())] {
        let Some((w, p)) = window.and_then(|w| Some((w, w.bending_p?))).filter(|(_, p)| *p < BENDS_P) else { continue };
        remarks.push(format!(
            "the ball's path {when} contact bends more than gravity and air explain, even over {} frames (p = {p:.1e}): look at its track",
            w.frames
        ));
    }
    remarks
}

fn windows(m: &ShotMotion) -> Windows {
    let window = |used: &UsedSightings, laws: Vec<(String, f64)>| WindowReport {
        frames: used.frames,
        length_s: used.length_s,
        rejected_points: used.rejected,
        noise_scale: used.noise_scale,
        laws,
        bending_p: None,
        shortened: false,
    };
    let flight = |f: &FlightEstimate| WindowReport {
        bending_p: f.bending_p,
        shortened: f.shortened,
        ..window(&f.used, f.laws.iter().map(|(l, p)| (l.word().to_owned(), *p)).collect())
    };
    let motion = |f: &MotionEstimate| window(&f.used, f.laws.iter().map(|(l, p)| (l.word(), *p)).collect());
    Windows {
        ball_in: flight(&m.ball_in),
        racket_in: motion(&m.racket_in),
        ball_out: m.ball_out.as_ref().map(flight),
        racket_out: m.racket_out.as_ref().map(motion),
    }
}

impl Shot {
    /// The shot's row of the impacts table (contract section 4).
    pub fn impact_row(&self, sequence: f64) -> ImpactRow {
        let mut row = ImpactRow::new(&self.id);
        (row.racket, row.ball, row.sequence) = (Some(self.racket.clone()), Some(self.ball.clone()), sequence);
        for name in INPUTS.iter().chain(OUTPUTS.iter()) {
            row.set(name, self.quantities.get(name).map(|q| Measured { value: q.value, sd: Some(q.sd) }));
        }
        let pose = self.face_pose_sd.map_or([None; 6], |sd| sd.map(Some));
        let shared = pose.into_iter().chain([BALANCE_SD_M, LEAVING_FLAT_SD_S, SPEED_SCALE_SD, SPIN_SCALE_SD].map(Some));
        row.shared_sd.iter_mut().zip(shared).for_each(|(cell, sd)| *cell = sd);
        row.groups = self.groups.iter().cloned().collect();
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quantities(values: &[(&str, f64, f64)]) -> Quantities {
        Quantities(values.iter().map(|(name, value, sd)| ((*name).to_owned(), Quantity::new(*value, *sd, "m/s"))).collect())
    }

    #[test]
    fn truth_a_ball_rises_or_falls_where_its_interval_does_not_hold_zero() {
        let timing = |value: f64, sd: f64| impact_timing(&quantities(&[("ball_in_global_vy", value, sd)]));
        assert_eq!((timing(2.0, 0.5), timing(-2.0, 0.5)), (Some(ImpactTiming::Rising), Some(ImpactTiming::Falling)));
        // 95 % are 1.96 deviations.
        assert_eq!(
            (timing(0.97, 0.5), timing(0.99, 0.5), timing(-0.97, 0.5)),
            (Some(ImpactTiming::Apex), Some(ImpactTiming::Rising), Some(ImpactTiming::Apex))
        );
        assert_eq!(impact_timing(&quantities(&[])), None);
    }

    #[test]
    fn truth_before_the_apex_of_a_swing_the_racket_moves_away_from_the_player() {
        let timing = |speed: f64, sd: f64, along: f64| swing_timing(&quantities(&[("impact_point_in_speed", speed, sd), ("impact_point_in_vx", along, 0.5)]));
        // Local x runs toward the handle.
        assert_eq!((timing(20.0, 0.5, -2.0), timing(20.0, 0.5, 2.0)), (Some(SwingTiming::BeforeApex), Some(SwingTiming::AfterApex)));
        assert_eq!((timing(20.0, 0.5, 0.9), timing(20.0, 0.5, -0.9)), (Some(SwingTiming::Apex), Some(SwingTiming::Apex)));
        // A racket that stands, or may stand, does not swing.
        assert_eq!((timing(0.9, 0.01, -2.0), timing(2.0, 0.5, -2.0)), (None, None));
    }
}
