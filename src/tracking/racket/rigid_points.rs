//! The rotation and shift that lay points on others: as many as there are, or the corners of a triangle.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};

/// The rotation and shift that bring `local` nearest to `global` (Kabsch); `None` for fewer than three points or points
/// in line. Always a proper rotation: a mirrored figure is never answered.
pub fn rigid_from_points(local: &[Point3<f64>], global: &[Point3<f64>]) -> Option<Isometry3<f64>> {
    if local.len() < 3 || local.len() != global.len() {
        return None;
    }
    let mean = |p: &[Point3<f64>]| p.iter().fold(Vector3::zeros(), |s, q| s + q.coords) / p.len() as f64;
    let (cl, cg) = (mean(local), mean(global));
    let mut h = Matrix3::zeros();
    for (l, g) in local.iter().zip(global) {
        h += (g.coords - cg) * (l.coords - cl).transpose();
    }
    let svd = h.svd(true, true);
    let (u, vt) = (svd.u?, svd.v_t?);
    let mut s: Vec<f64> = svd.singular_values.iter().copied().collect();
    s.sort_by(|a, b| b.total_cmp(a));
    if s[1] < 1e-6 * s[0] || s[0] <= 0.0 {
        return None;
    }
    let mut d = Matrix3::identity();
    // The smallest singular value belongs to the figure's plane normal; its sign is what keeps the rotation proper.
    let smallest = svd.singular_values.imin();
    d[(smallest, smallest)] = (u.determinant() * vt.determinant()).signum();
    // A product of orthogonal matrices: a rotation to rounding, no search for the nearest one needed.
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * d * vt));
    let t = cg - rotation * cl;
    Some(Isometry3::from_parts(Translation3::from(t), rotation))
}

/// Three points seen as a flat figure: where it lies, how it is turned, and the points in its own plane.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    centre: Vector3<f64>,
    /// Its first side, across it in the plane, and the plane's normal.
    axes: Matrix3<f64>,
    flat: [Vector2<f64>; 3],
}

impl Triangle {
    /// `None` for points in line.
    pub fn of(points: [&Point3<f64>; 3]) -> Option<Triangle> {
        let [a, b, c] = points.map(|p| p.coords);
        let (side, other) = (b - a, c - a);
        let normal = side.cross(&other);
        if normal.norm_squared() <= 1e-12 * side.norm_squared() * other.norm_squared() {
            return None;
        }
        let (x, z) = (side.normalize(), normal.normalize());
        let (centre, y) = ((a + b + c) / 3.0, z.cross(&x));
        Some(Triangle { centre, axes: Matrix3::from_columns(&[x, y, z]), flat: [a, b, c].map(|p| Vector2::new((p - centre).dot(&x), (p - centre).dot(&y))) })
    }

    /// The rotation and shift that bring this triangle nearest to another, corner by corner: [`rigid_from_points`] without a search for
    /// singular values. Planes come to lie in each other, and one angle within is left.
    pub fn onto(&self, other: &Triangle) -> Isometry3<f64> {
        let (mut along, mut across) = (0.0, 0.0);
        for (p, q) in self.flat.iter().zip(&other.flat) {
            along += p.dot(q);
            across += p.perp(q);
        }
        let (sin, cos) = across.atan2(along).sin_cos();
        let within = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(other.axes * within * self.axes.transpose()));
        Isometry3::from_parts(Translation3::from(other.centre - rotation * self.centre), rotation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::racket::racket_figure::tests::figure;
    use rand::{Rng, SeedableRng};

    #[test]
    fn agrees_three_corners_are_laid_on_each_other_as_by_singular_values() {
        let f = figure();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        for corners in [[0, 1, 2], [0, 3, 4], [1, 2, 4]] {
            let local = corners.map(|m| f.points[m]);
            for _ in 0..20 {
                let rotation = UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| rng.random_range(-3.0..3.0)));
                let moved = Isometry3::from_parts(Translation3::new(0.3, 1.0, -0.2), rotation);
                let global = local.map(|p| moved * p + Vector3::from_fn(|_, _| rng.random_range(-0.02..0.02)));
                let expected = rigid_from_points(&local, &global).expect("a triangle");
                let [from, onto] = [&local, &global].map(|t| Triangle::of([&t[0], &t[1], &t[2]]).expect("a triangle"));
                let found = from.onto(&onto);
                assert!((found.translation.vector - expected.translation.vector).norm() < 1e-9);
                assert!(found.rotation.angle_to(&expected.rotation) < 1e-7);
            }
        }
        assert!(Triangle::of([&Point3::origin(), &Point3::new(0.1, 0.0, 0.0), &Point3::new(0.3, 0.0, 0.0)]).is_none());
    }
}
