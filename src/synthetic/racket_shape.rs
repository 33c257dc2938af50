//! The racket as a camera sees it: tubes with tape bands, a net of strings, a handle. Racket axes, m.

use crate::equipment::Racket;
use nalgebra::{Point3, Vector2, Vector3};

/// Length of the white band along the tube, and of the black bands on both sides, m.
const WHITE_M: f64 = 0.022;
const BLACK_M: f64 = 0.018;
const STRING_RADIUS_M: f64 = 0.000_68;

/// A straight piece of tube.
#[derive(Debug, Clone, Copy)]
pub struct Tube {
    pub from: Point3<f64>,
    axis: Vector3<f64>,
    pub length: f64,
    pub radius: f64,
    /// Arc length of `from` along its curve, and which curve.
    along: f64,
    curve: usize,
}

impl Tube {
    pub fn end(&self) -> Point3<f64> {
        self.from + self.axis * self.length
    }
}

/// How a tube stands to an eye: what all its lines of sight share.
#[derive(Debug, Clone, Copy)]
pub struct SeenTube {
    axis: Vector3<f64>,
    /// From the tube's start to the eye, along the axis and square to it.
    along: f64,
    beside: Vector3<f64>,
    /// Square of the eye's distance from the axis, less that of the radius.
    clearance: f64,
}

/// What a line of sight meets on a tube.
#[derive(Debug, Clone, Copy)]
pub struct TubeHit {
    pub depth: f64,
    pub normal: Vector3<f64>,
    pub paint: Paint,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Paint {
    Frame,
    /// A lighter ornament on the frame.
    Ornament,
    Black,
    /// White tape of marker 0..5.
    Tape(usize),
    Grip,
}

/// Geometry of one racket.
#[derive(Debug, Clone)]
pub struct RacketShape {
    pub tubes: Vec<Tube>,
    /// Markers on their tubes' axes, racket axes.
    pub markers: [Point3<f64>; 5],
    /// (curve, arc length) of each marker.
    tape: [(usize, f64); 5],
    inner: Vector2<f64>,
    main_spacing: f64,
    cross_spacing: f64,
}

impl RacketShape {
    /// `None` when the racket file has no markers.
    pub fn new(racket: &Racket) -> Option<RacketShape> {
        let markers = racket.markers.as_ref()?.points();
        let r = racket.head.tube_radius_m;
        let (a, b) = (markers[0].x.abs(), markers[2].y.abs());
        let mut shape = RacketShape {
            tubes: Vec::new(),
            markers,
            tape: [(0, 0.0); 5],
            inner: Vector2::new(0.5 * racket.head.inner_length_m, 0.5 * racket.head.inner_width_m),
            main_spacing: racket.head.inner_width_m / 19.0,
            cross_spacing: racket.head.inner_length_m / 21.0,
        };
        // Head: a closed curve that starts at the throat side, so that no tape sits at the seam.
        let n = 96;
        let points: Vec<Point3<f64>> = (0..=n)
            .map(|i| {
                let angle = std::f64::consts::TAU * f64::from(i) / f64::from(n);
                Point3::new(a * angle.cos(), -b * angle.sin(), 0.0)
            })
            .collect();
        shape.add_curve(0, &points, r);
        // Throat: straight tubes through markers 4 and 5 from the shaft to the head.
        for (curve, m) in [(1, markers[3]), (2, markers[4])] {
            let shaft = Point3::new(m.x + 0.095, m.y.signum() * 0.011, 0.0);
            let direction = (m - shaft).normalize();
            let mut end = m;
            while (end.x / a).powi(2) + (end.y / b).powi(2) > 1.0 && end.x > 0.0 {
                end += direction * 0.002;
            }
            shape.add_curve(curve, &[shaft, end], r * 0.95);
        }
        let butt = racket.stringbed_centre_m;
        let neck = markers[3].x + 0.085;
        shape.add_curve(3, &[Point3::new(neck, 0.0, 0.0), Point3::new(butt - 0.19, 0.0, 0.0)], 0.0135);
        shape.add_curve(4, &[Point3::new(butt - 0.19, 0.0, 0.0), Point3::new(butt, 0.0, 0.0)], 0.0155);
        for (k, m) in shape.markers.into_iter().enumerate() {
            let nearest = shape.tubes.iter().filter(|t| t.curve < 3).map(|t| {
                let s = (m - t.from).dot(&t.axis).clamp(0.0, t.length);
                ((t.from + t.axis * s - m).norm(), t.curve, t.along + s)
            });
            let best = nearest.min_by(|p, q| p.0.total_cmp(&q.0))?;
            shape.tape[k] = (best.1, best.2);
        }
        Some(shape)
    }

    fn add_curve(&mut self, curve: usize, points: &[Point3<f64>], radius: f64) {
        let mut along = 0.0;
        for pair in points.windows(2) {
            let step = pair[1] - pair[0];
            let length = step.norm();
            let axis = step / length;
            // A little overlap closes the wedge between neighbours on the outside of the bend.
            let overlap = if points.len() > 2 { 0.035 * radius } else { 0.0 };
            self.tubes.push(Tube { from: pair[0] - axis * overlap, axis, length: length + 2.0 * overlap, radius, along: along - overlap, curve });
            along += length;
        }
    }

    /// The tubes as they stand to an eye in racket axes.
    pub fn seen_from(&self, eye: &Point3<f64>) -> Vec<SeenTube> {
        let seen = |tube: &Tube| {
            let w = eye - tube.from;
            let along = w.dot(&tube.axis);
            let beside = w - tube.axis * along;
            SeenTube { axis: tube.axis, along, beside, clearance: beside.norm_squared() - tube.radius * tube.radius }
        };
        self.tubes.iter().map(seen).collect()
    }

    /// Nearest hit of tube `index`, standing to the eye as `seen` says, by a ray in racket axes; `hidden_marker` shows no white.
    pub fn hit(&self, index: usize, seen: &SeenTube, direction: &Vector3<f64>, hidden_marker: Option<usize>) -> Option<TubeHit> {
        let lengthwise = direction.dot(&seen.axis);
        let (aa, half_b) = (direction.norm_squared() - lengthwise * lengthwise, direction.dot(&seen.beside));
        let disc = half_b * half_b - aa * seen.clearance;
        if disc <= 0.0 || aa < 1e-12 {
            return None;
        }
        let tube = &self.tubes[index];
        let depth = (-half_b - disc.sqrt()) / aa;
        let s = seen.along + lengthwise * depth;
        if !(0.0..=tube.length).contains(&s) || depth <= 0.0 {
            return None;
        }
        let normal = (seen.beside + (direction - seen.axis * lengthwise) * depth) / tube.radius;
        Some(TubeHit { depth, normal, paint: self.paint(tube, tube.along + s, hidden_marker) })
    }

    fn paint(&self, tube: &Tube, along: f64, hidden_marker: Option<usize>) -> Paint {
        if tube.curve >= 3 {
            return if tube.curve == 4 { Paint::Grip } else { Paint::Frame };
        }
        for (k, (curve, middle)) in self.tape.iter().enumerate() {
            if *curve != tube.curve {
                continue;
            }
            let off = (along - middle).abs();
            if off < 0.5 * WHITE_M {
                return if hidden_marker == Some(k) { Paint::Frame } else { Paint::Tape(k) };
            }
            if off < 0.5 * WHITE_M + BLACK_M {
                return if hidden_marker == Some(k) { Paint::Frame } else { Paint::Black };
            }
        }
        // A few lighter letters and lines on the head, as rackets have.
        if tube.curve == 0 && ((along * 17.0).sin() > 0.97 || (0.30..0.315).contains(&along)) { Paint::Ornament } else { Paint::Frame }
    }

    /// Depth at which a ray in racket axes passes a string, if it meets one.
    pub fn string_hit(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        if direction.z.abs() < 1e-9 {
            return None;
        }
        let depth = -origin.z / direction.z;
        let p = origin + direction * depth;
        if (p.x / self.inner.x).powi(2) + (p.y / self.inner.y).powi(2) > 1.05 {
            return None;
        }
        let near = |x: f64, spacing: f64| {
            let off = x / spacing - (x / spacing).floor() - 0.5;
            off.abs() * spacing < STRING_RADIUS_M
        };
        (depth > 0.0 && (near(p.y, self.main_spacing) || near(p.x, self.cross_spacing))).then_some(depth)
    }

    /// Half axes of the string bed, m.
    pub fn inner(&self) -> Vector2<f64> {
        self.inner
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::impact_world::equipment;

    #[test]
    fn truth_the_middle_of_each_tape_is_its_marker() {
        let shape = RacketShape::new(&equipment().0).expect("markers");
        for (k, m) in shape.markers.iter().enumerate() {
            let origin = m + Vector3::z() * 5.0;
            let seen = shape.seen_from(&origin);
            let hit =
                (0..shape.tubes.len()).filter_map(|i| shape.hit(i, &seen[i], &-Vector3::z(), None)).min_by(|a, b| a.depth.total_cmp(&b.depth)).expect("a tube");
            assert_eq!(hit.paint, Paint::Tape(k));
            assert!((hit.depth - (5.0 - 0.01)).abs() < 6e-4, "one tube radius before the axis: {}", hit.depth);
        }
    }
}
