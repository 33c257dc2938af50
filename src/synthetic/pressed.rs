//! The ball's shape while strings press it: two halves of different ellipsoids on one equator, the half toward the strings the flatter one.
//!
//! The volume stays; the centre of mass lies where the ball's path has it. What the tracker takes a pressed ball for is another shape.

use nalgebra::{Point3, Vector3};

/// How much more than the whole ball the half toward the strings is flattened.
const TOWARD_STRINGS: f64 = 1.6;

/// A ball as it is at one instant.
#[derive(Debug, Clone, Copy)]
pub struct PressedBall {
    /// Middle of the equator.
    middle: Point3<f64>,
    /// Toward the strings, unit.
    axis: Vector3<f64>,
    /// Half axes: toward the strings and away from them, and of the equator, m.
    halves: [f64; 2],
    equator: f64,
}

impl PressedBall {
    /// `share` by which the ball is shorter along `axis` (unit vector, toward the strings) than it is free.
    pub fn new(centre: &Point3<f64>, radius_m: f64, axis: &Vector3<f64>, share: f64) -> Self {
        let halves = [1.0 - TOWARD_STRINGS * share, 1.0 - (2.0 - TOWARD_STRINGS) * share].map(|a| a * radius_m);
        // The centre of mass of half an ellipsoid lies 3/8 of its half axis from the equator.
        let middle = centre + axis * (3.0 / 8.0 * (halves[1] - halves[0]));
        PressedBall { middle, axis: *axis, halves, equator: radius_m / (1.0 - share).sqrt() }
    }

    /// Nearest hit of a ray from the origin: depth, outward normal, and the direction the place had on the round ball.
    pub fn hit(&self, direction: &Vector3<f64>) -> Option<(f64, Vector3<f64>, Vector3<f64>)> {
        let from = -self.middle.coords;
        [1.0, -1.0].into_iter().zip(self.halves).find_map(|(side, half)| {
            // In units of the half axes the ellipsoid is a unit sphere.
            let scaled = |v: &Vector3<f64>| {
                let along = v.dot(&self.axis);
                (v - self.axis * along) / self.equator + self.axis * (along / half)
            };
            let (w, d) = (scaled(&from), scaled(direction));
            let (aa, half_b) = (d.norm_squared(), d.dot(&w));
            let disc = half_b * half_b - aa * (w.norm_squared() - 1.0);
            if disc <= 0.0 {
                return None;
            }
            let depth = (-half_b - disc.sqrt()) / aa;
            let unit = w + d * depth;
            (depth > 0.0 && unit.dot(&self.axis) * side >= 0.0).then(|| (depth, scaled(&unit).normalize(), unit))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::sampling::hit_sphere;
    use super::*;

    #[test]
    fn truth_a_ball_that_is_not_pressed_is_a_sphere() {
        let (centre, axis) = (Point3::new(0.004, -0.002, 1.0), Vector3::new(0.2, -0.3, 0.9).normalize());
        let ball = PressedBall::new(&centre, 0.033, &axis, 0.0);
        for i in 0..400 {
            let d = Vector3::new((i % 20) as f64 / 250.0 - 0.04, (i / 20) as f64 / 250.0 - 0.04, 1.0);
            let (own, sphere) = (ball.hit(&d), hit_sphere(&centre, 0.033, &Point3::origin(), &d));
            assert_eq!(own.is_some(), sphere.is_some());
            if let (Some(a), Some(b)) = (own, sphere) {
                assert!((a.0 - b.0).abs() < 1e-9 && (a.1 - b.1).norm() < 1e-6 && (a.2 - b.1).norm() < 1e-6);
            }
        }
    }

    #[test]
    fn truth_seen_along_the_axis_it_is_wider_and_across_it_shorter() {
        let far = Point3::new(0.0, 0.0, 1.0);
        let area = |axis: Vector3<f64>, share: f64| {
            let ball = PressedBall::new(&far, 0.033, &axis, share);
            let ray = |i: usize| Vector3::new((i % 200) as f64 / 2000.0 - 0.05, (i / 200) as f64 / 2000.0 - 0.05, 1.0);
            (0..200 * 200).filter(|i| ball.hit(&ray(*i)).is_some()).count() as f64
        };
        let round = area(Vector3::z(), 0.0);
        // Along the axis π e², across it π e (a + b) / 2, e² = r² / (1 - s).
        assert!((area(Vector3::z(), 0.2) / round - 1.25).abs() < 0.02, "{}", area(Vector3::z(), 0.2) / round);
        assert!((area(Vector3::x(), 0.2) / round - 0.8 / 0.8f64.sqrt()).abs() < 0.02, "{}", area(Vector3::x(), 0.2) / round);
    }
}
