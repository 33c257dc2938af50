//! The thesis's own construction (equations 4.1 to 4.26), kept apart from the fits as an independent check.
//!
//! Plane and axes from three markers, straight lines through ten frames, angular velocity from velocity differences, impact
//! where the ball's centre lies on the plane, by bisection. Slips of the printed text are put right and named: d of 4.8
//! needs a minus, 4.9 divides by the root of the sum, θ of 4.24 changes sign with the side marker, 4.10 is missing there
//! (docs/impact.md, where the thesis's print slips).

use super::shot_motion::ShotMotion;
use crate::tracking::{RacketFigure, SpacePoint, Target};
use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Frames on either side through which the thesis lays its lines (4.5.1).
pub const THESIS_FRAMES: usize = 10;

/// Coefficients of a U + b V + c W + d = 0 through three points (4.1, 4.5 to 4.8; d with the minus the printed 4.8 lacks).
pub fn plane(p1: &Point3<f64>, p2: &Point3<f64>, p3: &Point3<f64>) -> (Vector3<f64>, f64) {
    let ones = Vector3::repeat(1.0);
    let (u, v, w) = (Vector3::new(p1.x, p2.x, p3.x), Vector3::new(p1.y, p2.y, p3.y), Vector3::new(p1.z, p2.z, p3.z));
    let det = |a, b, c| Matrix3::from_columns(&[a, b, c]).determinant();
    (Vector3::new(det(ones, v, w), det(u, ones, w), det(u, v, ones)), -det(u, v, w))
}

/// Signed distance of a point from the plane (4.11; positive on the normal's side).
pub fn distance(plane: &(Vector3<f64>, f64), p: &Point3<f64>) -> f64 {
    (plane.0.dot(&p.coords) + plane.1) / plane.0.norm()
}

/// Local axes and origin of the racket (4.9, 4.20 to 4.26), global coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct RacketAxes {
    pub origin: Point3<f64>,
    pub x: Vector3<f64>,
    pub y: Vector3<f64>,
    pub z: Vector3<f64>,
}

impl RacketAxes {
    /// From the markers seen (m1 to m5, global); markers 2 and 3 give y (4.20), else markers 1 and 2 or 1 and 3 give x after
    /// a turn by ±θ (4.22 to 4.25). The plane needs any third marker. `None` when there are not enough.
    pub fn from_markers(seen: &[Option<Point3<f64>>; 5], figure: &RacketFigure) -> Option<Self> {
        let f = &figure.points;
        // Normal: the three seen markers that span the largest triangle, turned to the side of x × y.
        let mut best: Option<(f64, Vector3<f64>)> = None;
        for i in 0..5 {
            for j in i + 1..5 {
                for k in j + 1..5 {
                    let (Some(a), Some(b), Some(c)) = (seen[i], seen[j], seen[k]) else { continue };
                    let area = (f[j] - f[i]).cross(&(f[k] - f[i])).z;
                    let (normal, _) = plane(&a, &b, &c);
                    if best.as_ref().is_none_or(|b| area.abs() > b.0.abs()) && area.abs() > 1e-4 {
                        best = Some((area, normal * area.signum()));
                    }
                }
            }
        }
        let z = best?.1.try_normalize(1e-9)?;
        let half_width = 0.5 * (f[2] - f[1]).norm();
        let (x, y, origin) = match (seen[0], seen[1], seen[2]) {
            (_, Some(m2), Some(m3)) => {
                let y = (m3 - m2).normalize();
                (y.cross(&z), y, m2 + y * half_width)
            }
            (Some(m1), Some(side), None) | (Some(m1), None, Some(side)) => {
                let (index, sign) = if seen[1].is_some() { (1, 1.0) } else { (2, -1.0) };
                let theta = sign * half_width.atan2((f[index].x - f[0].x).abs());
                let x1 = (side - m1).normalize();
                let y1 = z.cross(&x1);
                let x = x1 * theta.cos() + y1 * theta.sin();
                let y = z.cross(&x);
                (x, y, side + y * (sign * half_width))
            }
            _ => return None,
        };
        Some(RacketAxes { origin, x, y, z })
    }

    /// Global position of a local point.
    pub fn point(&self, local: &Point3<f64>) -> Point3<f64> {
        self.origin + self.x * local.x + self.y * local.y + self.z * local.z
    }

    /// Local coordinates of a global vector (4.15, 4.16).
    pub fn local(&self, v: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(self.x.dot(v), self.y.dot(v), self.z.dot(v))
    }
}

/// Straight line through points by least squares: place at time 0 and velocity; `None` below three points.
pub fn line(points: &[(f64, Point3<f64>)]) -> Option<(Point3<f64>, Vector3<f64>)> {
    if points.len() < 3 {
        return None;
    }
    let n = points.len() as f64;
    let t0 = points.iter().map(|p| p.0).sum::<f64>() / n;
    let mean = points.iter().map(|p| p.1.coords).sum::<Vector3<f64>>() / n;
    let spread: f64 = points.iter().map(|p| (p.0 - t0).powi(2)).sum();
    let slope = points.iter().map(|p| (p.1.coords - mean) * (p.0 - t0)).sum::<Vector3<f64>>() / spread;
    slope.norm().is_finite().then(|| (Point3::from(mean - slope * t0), slope))
}

/// What the thesis's method says about a shot: velocities belong to the window's middle, the position to the instant at
/// which the ball's centre lies on the plane. Local axes of that instant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ThesisShot {
    pub ball_in_v: [f64; 3],
    pub racket_in_v: [f64; 3],
    /// From differences of velocity (4.10).
    pub racket_in_w: [f64; 3],
    /// Centre on the plane: local x, y, m, and time after first contact, s.
    pub centre_on_plane: [f64; 2],
    pub centre_on_plane_delay_s: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ball_out_v: Option<[f64; 3]>,
}

/// Applies the thesis's method to the reconstructed points of a shot (time from first contact).
pub fn thesis_shot(points: &[SpacePoint], motion: &ShotMotion) -> Option<ThesisShot> {
    let (figure, com) = (&motion.moving.figure, &motion.moving.com_local);
    let mut frames: BTreeMap<u64, (f64, [Option<Point3<f64>>; 6])> = BTreeMap::new();
    for p in points {
        frames.entry(p.frame).or_insert((p.t, [None; 6])).1[p.target.index()] = Some(p.position);
    }
    let all: Vec<(f64, [Option<Point3<f64>>; 6])> = frames.into_values().collect();
    let before: Vec<_> = all.iter().filter(|f| f.0 < 0.0).collect();
    let before = &before[before.len().saturating_sub(THESIS_FRAMES)..];
    let leave = motion.last_contact_t.map(|t| t - motion.first_contact_t);
    let after: Vec<_> = all.iter().filter(|f| leave.is_some_and(|l| f.0 > l)).take(THESIS_FRAMES).collect();
    let ball_line =
        |frames: &[&(f64, [Option<Point3<f64>>; 6])]| line(&frames.iter().filter_map(|f| Some((f.0, f.1[Target::Ball.index()]?))).collect::<Vec<_>>());
    let (ball_at, ball_v) = ball_line(before)?;
    let axes: Vec<(f64, RacketAxes)> =
        before.iter().filter_map(|f| Some((f.0, RacketAxes::from_markers(&[f.1[0], f.1[1], f.1[2], f.1[3], f.1[4]], figure)?))).collect();
    // Points carried by the racket, each with its line: the centre of mass, one toward the tip, one across, and three that
    // hold the plane.
    let arm = 0.2;
    let carried = |local: Point3<f64>| line(&axes.iter().map(|(t, a)| (*t, a.point(&local))).collect::<Vec<_>>());
    let (_, com_v) = carried(*com)?;
    let (_, tip_v) = carried(*com - Vector3::x() * arm)?;
    let (_, side_v) = carried(*com + Vector3::y() * arm)?;
    let markers = [carried(figure.points[0])?, carried(figure.points[1])?, carried(figure.points[2])?];
    let three = |t: f64| markers.map(|(p, v)| p + v * t);
    let at = |t: f64| {
        let m = three(t);
        RacketAxes::from_markers(&[Some(m[0]), Some(m[1]), Some(m[2]), None, None], figure)
    };
    let gap = |t: f64| {
        let [m1, m2, m3] = three(t);
        let face = plane(&m1, &m2, &m3);
        Some(distance(&face, &(ball_at + ball_v * t)) * at(t)?.z.dot(&face.0).signum() * motion.side)
    };
    // Bisection (4.11) between 1 ms before the first contact and 5 ms after it.
    let (mut low, mut high) = (-0.001, 0.005);
    if gap(low)? < 0.0 || gap(high)? > 0.0 {
        return None;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if gap(middle)? > 0.0 { low = middle } else { high = middle }
    }
    let racket = at(low)?;
    let impact = racket.local(&(ball_at + ball_v * low - racket.origin));
    // Rates along the axes of the window's middle, to which the differences belong.
    let middle = &axes.get(axes.len() / 2)?.1;
    let (toward_tip, across) = (middle.local(&(tip_v - com_v)), middle.local(&(side_v - com_v)));
    let rate = Vector3::new(across.z / arm, toward_tip.z / arm, -toward_tip.y / arm);
    Some(ThesisShot {
        ball_in_v: racket.local(&ball_v).into(),
        racket_in_v: racket.local(&com_v).into(),
        racket_in_w: rate.into(),
        centre_on_plane: [impact.x, impact.y],
        centre_on_plane_delay_s: low,
        ball_out_v: ball_line(&after).map(|(_, v)| racket.local(&v).into()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, UnitQuaternion};

    fn figure() -> RacketFigure {
        let points = [[-0.1775, 0.0], [0.0, -0.1375], [0.0, 0.1375], [0.2, -0.045], [0.2, 0.045]].map(|[x, y]| Point3::new(x, y, 0.0));
        RacketFigure { points, tube: [Vector3::x_axis(); 5], bend: [Vector3::zeros(); 5], throat_markers: [false; 5], tube_radius_m: [0.01; 5] }
    }

    #[test]
    fn truth_plane_through_three_points_by_hand() {
        // x + y + z = 1 through the unit points; the origin lies 1/√3 below.
        let (n, d) = plane(&Point3::new(1.0, 0.0, 0.0), &Point3::new(0.0, 1.0, 0.0), &Point3::new(0.0, 0.0, 1.0));
        assert!((n - Vector3::repeat(1.0)).norm() < 1e-15 && (d + 1.0).abs() < 1e-15);
        assert!((distance(&(n, d), &Point3::origin()) + 1.0 / 3f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn agrees_axes_with_the_pose_whichever_marker_is_hidden() {
        let f = figure();
        let pose = Isometry3::from_parts(Vector3::new(0.3, 1.0, -0.2).into(), UnitQuaternion::from_euler_angles(0.3, -1.1, 2.0));
        let all = f.points.map(|p| Some(pose * p));
        for hidden in [vec![], vec![0], vec![1], vec![2], vec![3, 4], vec![1, 4], vec![2, 3]] {
            let mut seen = all;
            for h in &hidden {
                seen[*h] = None;
            }
            let a = RacketAxes::from_markers(&seen, &f).unwrap_or_else(|| panic!("{hidden:?}"));
            assert!((a.origin - pose * Point3::origin()).norm() < 1e-12, "{hidden:?}");
            for (axis, unit) in [(a.x, Vector3::x()), (a.y, Vector3::y()), (a.z, Vector3::z())] {
                assert!((axis - pose * unit).norm() < 1e-12, "{hidden:?}");
            }
        }
        let mut two = all;
        (two[0], two[1], two[3]) = (None, None, None);
        assert_eq!(RacketAxes::from_markers(&two, &f), None);
    }

    #[test]
    fn truth_line_of_exact_points() {
        let points: Vec<_> = (0..5).map(|i| (0.001 * i as f64, Point3::new(1.0 + 0.02 * i as f64, 2.0, -0.01 * i as f64))).collect();
        let (p, v) = line(&points).expect("five points");
        assert!((p - Point3::new(1.0, 2.0, 0.0)).norm() < 1e-12 && (v - Vector3::new(20.0, 0.0, -10.0)).norm() < 1e-9);
        assert_eq!(line(&points[..2]), None);
    }
}
