//! The rigid figure of five tape markers, and where a camera sees the centroid of each tape.
//!
//! The tape wraps the tube, so the visible patch is the half cylinder that faces the camera. Across the tube its image is
//! spread evenly, so the centroid of the visible patch is the image of the axis point moved toward the camera by the mean
//! depth of a half circle over its width, (1/2r) ∫ sqrt(r² - s²) ds = (π/4) r, along the direction perpendicular to the
//! tube (derived here; on rendered sequences the factor fitted freely was 0.78 to 0.79, π/4 = 0.785).

use crate::equipment::Racket;
use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

/// Mean depth of the visible half cylinder, in tube radii.
pub const VISIBLE_DEPTH: f64 = std::f64::consts::FRAC_PI_4;

/// Five markers on the tube's axis with the tube's direction at each, local racket axes.
#[derive(Debug, Clone)]
pub struct RacketFigure {
    /// m1 to m5, m.
    pub points: [Point3<f64>; 5],
    /// Unit vector along the tube at each marker; the sign has no meaning.
    pub tube: [Unit<Vector3<f64>>; 5],
    /// Curvature of the tube's axis at each marker, toward the inside of the bend, 1/m. In the throat, whose shape racket.toml does
    /// not tell, it is zero until pictures tell it ([`Self::with_throat_bend`]).
    pub bend: [Vector3<f64>; 5],
    /// Markers between head and shaft, off the racket's axis.
    pub throat_markers: [bool; 5],
    /// At each marker.
    pub tube_radius_m: [f64; 5],
}

/// The tubes at markers 4 and 5.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Throat {
    /// From the racket's axis.
    pub angle_deg: f64,
    /// Of the head's tubes' width.
    pub width: f64,
}

impl Throat {
    /// Of what several shots with one racket show; `None` of none.
    pub fn mean(seen: &[Throat]) -> Option<Throat> {
        let n = seen.len() as f64;
        let mean = |of: fn(&Throat) -> f64| seen.iter().map(of).sum::<f64>() / n;
        (n > 0.0).then(|| Throat { angle_deg: mean(|t| t.angle_deg), width: mean(|t| t.width) })
    }

    /// Whether a racket may have it.
    pub fn is_possible(&self) -> bool {
        (0.0..90.0).contains(&self.angle_deg) && (0.5..2.0).contains(&self.width)
    }
}

impl RacketFigure {
    /// The figure of a racket; `None` when racket.toml has no `[markers]`.
    pub fn of(racket: &Racket) -> Option<Self> {
        let points = racket.markers.as_ref()?.points();
        let r = racket.head.tube_radius_m;
        let (a, b) = (0.5 * racket.head.inner_length_m + r, 0.5 * racket.head.inner_width_m + r);
        let tube = points.map(|p| tube_direction(&p, a, b));
        let bend = points.map(|p| bend(&p, a, b));
        let throat_markers = std::array::from_fn(|k| bend[k] == Vector3::zeros() && points[k].y != 0.0);
        Some(RacketFigure { points, tube, bend, throat_markers, tube_radius_m: [r; 5] })
    }

    /// Angle of the tubes at the throat markers from the racket's axis, rad; `None` when no marker lies off the head.
    pub fn throat_angle(&self) -> Option<f64> {
        let throat = self.in_throat().next()?;
        Some(self.tube[throat].y.abs().atan2(self.tube[throat].x.abs()))
    }

    /// The same figure with the throat's tubes at another angle: toward the tip they spread from the axis.
    pub fn with_throat(&self, angle_rad: f64) -> Self {
        let mut figure = self.clone();
        for k in self.in_throat() {
            let outward = self.points[k].y.signum();
            figure.tube[k] = Unit::new_normalize(Vector3::new(-angle_rad.cos(), outward * angle_rad.sin(), 0.0));
        }
        figure.with_throat_bend(self.throat_bend())
    }

    /// The same figure with the throat's tubes so many times as wide as the head's.
    pub fn with_throat_width(&self, to_head: f64) -> Self {
        let mut figure = self.clone();
        let head = self.head_tube_radius_m();
        self.in_throat().for_each(|k| figure.tube_radius_m[k] = head * to_head);
        figure
    }

    /// How the throat's tubes run and how wide they are; `None` when no marker lies off the head.
    pub fn throat(&self) -> Option<Throat> {
        let width = self.tube_radius_m[self.in_throat().next()?] / self.head_tube_radius_m();
        Some(Throat { angle_deg: self.throat_angle()?.to_degrees(), width })
    }

    /// The same figure with this throat.
    pub fn with(&self, throat: &Throat) -> Self {
        self.with_throat(throat.angle_deg.to_radians()).with_throat_width(throat.width)
    }

    fn head_tube_radius_m(&self) -> f64 {
        let head = (0..self.points.len()).find(|k| !self.in_throat().any(|t| t == *k));
        self.tube_radius_m[head.unwrap_or(0)]
    }

    /// Markers between head and shaft, off the racket's axis.
    pub fn in_throat(&self) -> impl Iterator<Item = usize> {
        (0..self.points.len()).filter(|&k| self.throat_markers[k])
    }

    /// The same figure with the throat's tubes bent so much, 1/m, away from the racket's axis where it is positive (they spread toward the head).
    pub fn with_throat_bend(&self, per_m: f64) -> Self {
        let mut figure = self.clone();
        for k in self.in_throat() {
            let across = Vector3::z().cross(&self.tube[k]);
            figure.bend[k] = across * (per_m * (across.y * self.points[k].y).signum());
        }
        figure
    }

    /// How much the throat's tubes are bent, 1/m; zero without any.
    fn throat_bend(&self) -> f64 {
        self.in_throat().next().map_or(0.0, |k| self.bend[k].norm() * (self.bend[k].y * self.points[k].y).signum())
    }

    /// The local point whose image is the centroid of the visible tape, seen from `eye` (local axes), with the unit
    /// vector from the axis toward the camera.
    pub fn patch_point(&self, marker: usize, eye: &Point3<f64>) -> (Point3<f64>, Vector3<f64>) {
        let p = self.points[marker];
        let n = toward(&p.coords, &self.tube[marker], &eye.coords);
        (p + VISIBLE_DEPTH * self.tube_radius_m[marker] * n, n)
    }

    /// Global position of the visible tape's centroid for a camera at `eye` (global), and its derivative with respect to
    /// a small rotation of the racket about the global axes.
    #[inline]
    pub fn patch_in_global(&self, marker: usize, global_from_racket: &Isometry3<f64>, eye: &Point3<f64>) -> (Point3<f64>, Matrix3<f64>) {
        let arm = global_from_racket.rotation * self.points[marker].coords;
        let centre = arm + global_from_racket.translation.vector;
        let axis = global_from_racket.rotation * self.tube[marker].into_inner();
        let view = (eye.coords - centre).normalize();
        let along = view.dot(&axis);
        let perpendicular = view - along * axis;
        let length = perpendicular.norm().max(1e-6); // along the tube the patch is a ring's end: no side faces the camera
        let n = perpendicular / length;
        let depth = VISIBLE_DEPTH * self.tube_radius_m[marker];
        // The axis a turns as ω × a; the change of `view` itself (metres over the camera's distance) is left out. The perpendicular
        // p = v - (v·a) a then changes by -(a vᵀ + (v·a) I)(ω × a), and n = p/|p| by what of that is perpendicular to n; a is.
        let axis_by_rotation = axis.cross_matrix();
        let across = axis_by_rotation - n * n.cross(&axis).transpose();
        let n_by_rotation = (axis * view.cross(&axis).transpose() + along * across) / length;
        (Point3::from(centre + depth * n), depth * n_by_rotation - arm.cross_matrix())
    }

    /// Distance between two markers, m.
    pub fn distance_m(&self, i: usize, j: usize) -> f64 {
        (self.points[i] - self.points[j]).norm()
    }
}

/// Unit vector from the axis toward the eye, perpendicular to the tube.
fn toward(p: &Vector3<f64>, tube: &Unit<Vector3<f64>>, eye: &Vector3<f64>) -> Vector3<f64> {
    let view = eye - p;
    let across = view - view.dot(tube) * tube.into_inner();
    across.try_normalize(1e-9).unwrap_or_else(Vector3::z)
}

/// Curvature of the head's ellipse at a marker on it, 1/m: at (a cos e, b sin e) it is ab / (a² sin² e + b² cos² e)^1.5
/// along the inward normal.
fn bend(p: &Point3<f64>, a: f64, b: f64) -> Vector3<f64> {
    let (x, y) = (p.x / a, p.y / b);
    if x.hypot(y) > 1.1 {
        return Vector3::zeros();
    }
    let (sin, cos) = y.atan2(x).sin_cos();
    let size = a * b / ((a * sin).powi(2) + (b * cos).powi(2)).powf(1.5);
    Vector3::new(-cos / a, -sin / b, 0.0).normalize() * size
}

/// Direction of the tube at a marker: on the head, the tangent of the head's ellipse (semi-axes `a`, `b`, m, on the tube's
/// axis); in the throat, the tangent from the marker to that ellipse on the marker's own side.
fn tube_direction(p: &Point3<f64>, a: f64, b: f64) -> Unit<Vector3<f64>> {
    let (x, y) = (p.x / a, p.y / b);
    let radius = x.hypot(y);
    let direction = if radius < 1.1 || p.y == 0.0 {
        Vector3::new(-p.y / (b * b), p.x / (a * a), 0.0)
    } else {
        // Tangent points of the unit circle from (x, y): angles ± acos(1/ρ) from the point's own.
        let turn = (1.0 / radius).acos() * p.y.signum() * if p.x < 0.0 { -1.0 } else { 1.0 };
        let at = y.atan2(x) + turn;
        Vector3::new(a * at.cos() - p.x, b * at.sin() - p.y, 0.0)
    };
    Unit::try_new(direction, 1e-9).unwrap_or_else(Vector3::x_axis)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn figure() -> RacketFigure {
        let points = [[-0.1775, 0.0], [0.0, -0.1375], [0.0, 0.1375], [0.2, -0.045], [0.2, 0.045]].map(|[x, y]| Point3::new(x, y, 0.0));
        RacketFigure {
            points,
            tube: points.map(|p| tube_direction(&p, 0.1775, 0.1375)),
            bend: points.map(|p| bend(&p, 0.1775, 0.1375)),
            throat_markers: [false, false, false, true, true],
            tube_radius_m: [0.01; 5],
        }
    }

    #[test]
    fn truth_tube_runs_along_y_at_the_tip_along_x_at_the_sides_and_outward_in_the_throat() {
        let f = figure();
        assert!(f.tube[0].y.abs() > 0.999);
        assert!(f.tube[1].x.abs() > 0.999 && f.tube[2].x.abs() > 0.999);
        // Radius of curvature b²/a at the tip, a²/b at the sides.
        assert!((f.bend[0] - Vector3::new(0.1775 / 0.1375f64.powi(2), 0.0, 0.0)).norm() < 1e-9);
        assert!((f.bend[2] - Vector3::new(0.0, -0.1375 / 0.1775f64.powi(2), 0.0)).norm() < 1e-9);
        assert_eq!(f.bend[3], Vector3::zeros());
        let angle = (f.tube[4].y / -f.tube[4].x).atan().to_degrees();
        assert!((20.0..50.0).contains(&angle), "{angle}");
        assert!((f.throat_angle().expect("an angle").to_degrees() - angle).abs() < 1e-9);
        let other = f.with_throat(0.4);
        assert!((other.throat_angle().expect("an angle") - 0.4).abs() < 1e-12 && (other.tube[3].y / other.tube[3].x - 0.4f64.tan()).abs() < 1e-12);
        assert_eq!((other.tube[0], other.tube[2]), (f.tube[0], f.tube[2]));
        // A bent throat turns with its tubes: outward from the racket's axis, across the tube.
        let bent = f.with_throat_bend(3.0).with_throat(0.4);
        assert!((bent.throat_bend() - 3.0).abs() < 1e-12 && bent.bend[3].y < 0.0 && bent.bend[4].y > 0.0 && bent.bend[4].dot(&bent.tube[4]).abs() < 1e-12);
        assert_eq!(bent.bend[2], f.bend[2]);
        assert!((f.tube[3].y / f.tube[3].x + f.tube[4].y / f.tube[4].x).abs() < 1e-12);
    }

    #[test]
    fn truth_patch_centroid_equals_the_mean_over_the_visible_half_cylinder() {
        // Far camera, 40 degrees from the tube: average the points of the half cylinder over their image width.
        let f = figure();
        let eye = Point3::new(40f64.to_radians().cos() * 1e6, 0.0, 40f64.to_radians().sin() * 1e6);
        let (p, n) = f.patch_point(2, &eye);
        let mut mean = Vector3::zeros();
        let steps = 20_000;
        for i in 0..steps {
            let s = (i as f64 + 0.5) / steps as f64 * 2.0 - 1.0;
            mean += (Vector3::new(0.0, s, 0.0) + n * (1.0 - s * s).sqrt()) * f.tube_radius_m[2] / steps as f64;
        }
        assert!((p - f.points[2] - mean).norm() < 1e-7);
    }

    #[test]
    fn truth_rotation_derivative_equals_central_differences() {
        let f = figure();
        let eye = Point3::new(11.0, 1.0, -3.0);
        let pose = Isometry3::new(Vector3::new(0.1, 0.9, 0.2), Vector3::new(0.4, -0.8, 1.1));
        for marker in 0..5 {
            let (_, j) = f.patch_in_global(marker, &pose, &eye);
            for k in 0..3 {
                let turned = |h: f64| {
                    let mut w = Vector3::zeros();
                    w[k] = h;
                    let mut q = pose;
                    q.rotation = nalgebra::UnitQuaternion::from_scaled_axis(w) * q.rotation;
                    f.patch_in_global(marker, &q, &eye).0
                };
                let d = (turned(1e-5) - turned(-1e-5)) / 2e-5;
                assert!((d - j.column(k)).norm() < 2e-3 * d.norm().max(0.01), "{marker} {k}: {d} {}", j.column(k));
            }
        }
    }
}
