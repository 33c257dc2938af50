//! One camera: pinhole with OpenCV's k1 k2 p1 p2 k3 distortion. Pixel (0, 0) is the centre of the top-left pixel.

use nalgebra::{Matrix2, Matrix2x3, Point3, Vector2};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Intrinsic parameters of one camera, px, with the standard deviations of those that were estimated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
    pub rms_px: f64,
    /// One standard deviation by name: `fx`, `fy`, `cx`, `cy`, `k1`, `k2`, `p1`, `p2`, `k3`.
    #[serde(default)]
    pub sd: BTreeMap<String, f64>,
}

impl Camera {
    /// Distorts normalised coordinates; also returns the 2×2 Jacobian.
    #[inline]
    pub fn distort(&self, x: f64, y: f64) -> (Vector2<f64>, Matrix2<f64>) {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2); // d radial / d r²
        let xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        let jacobian = Matrix2::new(
            radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y,
            2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y,
            radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (Vector2::new(xd, yd), jacobian)
    }

    /// Pixel of a point in the camera's own frame (x right, y down, z forward, m); `None` behind the camera.
    #[inline]
    pub fn project(&self, p: &Point3<f64>) -> Option<Vector2<f64>> {
        self.project_with_jacobian(p).map(|(uv, _)| uv)
    }

    /// Pixel and its derivative with respect to the point.
    #[inline]
    pub fn project_with_jacobian(&self, p: &Point3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        if p.z <= 1e-9 {
            return None;
        }
        let (x, y, iz) = (p.x / p.z, p.y / p.z, 1.0 / p.z);
        let (d, jd) = self.distort(x, y);
        let j = Matrix2::new(self.fx * iz, 0.0, 0.0, self.fy * iz) * jd;
        // x and y are px/pz and py/pz: the column of pz follows from the other two.
        let by_depth = -(j * Vector2::new(x, y));
        Some((
            Vector2::new(self.fx * d.x + self.cx, self.fy * d.y + self.cy),
            Matrix2x3::from_columns(&[j.column(0).into_owned(), j.column(1).into_owned(), by_depth]),
        ))
    }

    /// Normalised, undistorted coordinates of a pixel (Newton's method; `None` where the distortion cannot be inverted).
    pub fn normalise(&self, uv: Vector2<f64>) -> Option<Vector2<f64>> {
        let target = Vector2::new((uv.x - self.cx) / self.fx, (uv.y - self.cy) / self.fy);
        let mut p = target;
        for _ in 0..50 {
            let (d, j) = self.distort(p.x, p.y);
            let step = j.try_inverse()? * (d - target);
            p -= step;
            if !p.norm().is_finite() {
                return None;
            }
            if step.norm() < 1e-14 * (1.0 + p.norm()) {
                return Some(p);
            }
        }
        let miss = (self.distort(p.x, p.y).0 - target).norm();
        (miss < 1e-9).then_some(p)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera { fx: 3000.0, fy: 2990.0, cx: 250.0, cy: 260.0, distortion: [-0.6, 3.0, 1e-3, -2e-3, 0.5], rms_px: 0.0, sd: BTreeMap::new() }
    }

    #[test]
    fn truth_undistorting_a_distorted_point_is_the_identity() {
        let c = camera();
        for i in -5..=5 {
            for j in -5..=5 {
                let p = Point3::new(0.02 * i as f64, 0.017 * j as f64, 1.0);
                let back = c.normalise(c.project(&p).expect("in front")).expect("invertible");
                assert!((back - Vector2::new(p.x, p.y)).norm() < 1e-12);
            }
        }
    }

    #[test]
    fn truth_projection_jacobian_equals_central_differences() {
        let c = camera();
        let p = Point3::new(0.4, -0.7, 12.0);
        let (_, j) = c.project_with_jacobian(&p).expect("in front");
        for k in 0..3 {
            let h = 1e-5;
            let (mut a, mut b) = (p, p);
            a[k] += h;
            b[k] -= h;
            let d = (c.project(&a).expect("in front") - c.project(&b).expect("in front")) / (2.0 * h);
            assert!((d - j.column(k)).norm() < 1e-6 * (1.0 + d.norm()));
        }
    }
}
