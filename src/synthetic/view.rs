//! One camera of a synthetic rig: where it stands, and the ray of every pixel.

use crate::calibration::Camera;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use std::collections::BTreeMap;

/// A camera with its pose and the directions of its pixel corners.
#[derive(Debug, Clone)]
pub struct View {
    pub camera: Camera,
    /// p_camera = pose * p_global.
    pub pose: Isometry3<f64>,
    pub width: usize,
    pub height: usize,
    /// Undistorted normalised coordinates at pixel centres from (-2, -2) to (width + 1, height + 1).
    grid: Vec<Vector2<f64>>,
}

/// Pixels of the ray grid beyond each edge, for sampling filters wider than a pixel.
const MARGIN: usize = 2;

/// A place beside any pixel's centre: the first of the four places of the ray grid around it, counted from the pixel's own, and their weights.
#[derive(Debug, Clone, Copy)]
pub struct BesidePixel {
    first: usize,
    weights: [f64; 4],
}

/// A line of sight in global axes; `direction` has unit depth along the camera's axis.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    pub origin: Point3<f64>,
    pub direction: Vector3<f64>,
}

impl View {
    /// A camera at `place` looking at `target`, upright.
    pub fn looking_at(
        place: Point3<f64>,
        target: Point3<f64>,
        focal_px: [f64; 2],
        centre_px: [f64; 2],
        distortion: [f64; 5],
        size: [usize; 2],
    ) -> Option<View> {
        let forward = (target - place).try_normalize(1e-6)?;
        let right = forward.cross(&Vector3::y()).try_normalize(1e-6)?; // V is up
        let down = forward.cross(&right);
        let r = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]));
        let rotation = UnitQuaternion::from_rotation_matrix(&r);
        let pose = Isometry3::from_parts(Translation3::from(-(rotation * place.coords)), rotation);
        let camera = Camera { fx: focal_px[0], fy: focal_px[1], cx: centre_px[0], cy: centre_px[1], distortion, rms_px: 0.0, sd: BTreeMap::new() };
        Self::new(camera, pose, size[0], size[1])
    }

    /// `None` when the distortion cannot be inverted somewhere in the picture.
    pub fn new(camera: Camera, pose: Isometry3<f64>, width: usize, height: usize) -> Option<View> {
        let mut grid = Vec::with_capacity((width + 2 * MARGIN) * (height + 2 * MARGIN));
        for v in 0..height + 2 * MARGIN {
            for u in 0..width + 2 * MARGIN {
                grid.push(camera.normalise(Vector2::new(u as f64 - MARGIN as f64, v as f64 - MARGIN as f64))?);
            }
        }
        Some(View { camera, pose, width, height, grid })
    }

    pub fn centre(&self) -> Point3<f64> {
        self.pose.inverse() * Point3::origin()
    }

    /// Direction through pixel coordinates, camera axes, unit depth. Bilinear between pixel centres (distortion is smooth).
    pub fn direction(&self, u: f64, v: f64) -> Vector3<f64> {
        let stride = self.width + 2 * MARGIN;
        let clamp = |x: f64, n: usize| (x + MARGIN as f64).clamp(0.0, (n + 2 * MARGIN - 1) as f64 - 1e-9);
        let (x, y) = (clamp(u, self.width), clamp(v, self.height));
        let (i, j) = (x as usize, y as usize);
        let (a, b) = (x - i as f64, y - j as f64);
        let at = |i: usize, j: usize| self.grid[j * stride + i];
        let p = (at(i, j) * (1.0 - a) + at(i + 1, j) * a) * (1.0 - b) + (at(i, j + 1) * (1.0 - a) + at(i + 1, j + 1) * a) * b;
        Vector3::new(p.x, p.y, 1.0)
    }

    /// A place at most `MARGIN` from a pixel's centre, for [`Self::direction_beside`].
    pub fn beside_pixel(&self, offset: &Vector2<f64>) -> BesidePixel {
        let limit = MARGIN as f64 - 1e-9;
        let o = offset.map(|x| x.clamp(-limit, limit));
        let (a, b) = (o.x - o.x.floor(), o.y - o.y.floor());
        let cell = o.map(|x| (x.floor() + MARGIN as f64) as usize);
        BesidePixel { first: cell.y * (self.width + 2 * MARGIN) + cell.x, weights: [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b] }
    }

    /// [`Self::direction`] through a place beside the centre of pixel (u, v), which must lie in the picture.
    pub fn direction_beside(&self, u: usize, v: usize, place: &BesidePixel) -> Vector3<f64> {
        let stride = self.width + 2 * MARGIN;
        let first = v * stride + u + place.first;
        let [upper, lower] = [&self.grid[first..first + 2], &self.grid[first + stride..first + stride + 2]];
        let [w, x, y, z] = place.weights;
        let p = upper[0] * w + upper[1] * x + lower[0] * y + lower[1] * z;
        Vector3::new(p.x, p.y, 1.0)
    }

    /// Line of sight in global axes.
    pub fn ray(&self, u: f64, v: f64) -> Ray {
        Ray { origin: self.centre(), direction: self.pose.rotation.inverse() * self.direction(u, v) }
    }

    /// Pixel of a point in global axes.
    pub fn project(&self, p: &Point3<f64>) -> Option<Vector2<f64>> {
        self.camera.project(&(self.pose * p))
    }

    /// Whether a pixel lies in the picture.
    pub fn holds(&self, p: &Vector2<f64>) -> bool {
        p.x > -0.5 && p.y > -0.5 && p.x < self.width as f64 - 0.5 && p.y < self.height as f64 - 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_ray_of_a_projected_point_passes_through_it() {
        let view = View::looking_at(
            Point3::new(11.5, 1.4, 3.8),
            Point3::new(0.3, 0.9, 0.3),
            [2950.0, 2953.0],
            [252.0, 262.0],
            [0.58, -0.13, -9e-4, -8e-4, 0.0],
            [512, 512],
        )
        .expect("invertible");
        for p in [Point3::new(0.1, 0.2, 0.5), Point3::new(0.5, 1.6, -0.3), Point3::new(0.3, 0.9, 0.3)] {
            let uv = view.project(&p).expect("in front");
            let ray = view.ray(uv.x, uv.y);
            let t = (p - ray.origin).dot(&ray.direction) / ray.direction.norm_squared();
            assert!((ray.origin + ray.direction * t - p).norm() < 2e-6, "{uv}");
        }
        let up = view.project(&Point3::new(0.3, 1.2, 0.3)).expect("in front") - view.project(&Point3::new(0.3, 0.9, 0.3)).expect("in front");
        assert!(up.y < -50.0, "V points up in the picture");
    }
}
