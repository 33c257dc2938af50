//! The projective map from the board's plane to an image (normalised direct linear transform, Hartley and Zisserman 2003,
//! algorithm 4.2), and how well a view fits one.

use nalgebra::{DMatrix, Matrix3, Point3, Vector2, Vector3};

/// `H` with `(u, v, 1) ~ H (x, y, 1)` for board points `(x, y, 0)` in m and pixels. `None` for fewer than four points or a
/// degenerate set.
pub fn homography(board: &[Point3<f64>], pixels: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    if board.len() < 4 || board.len() != pixels.len() {
        return None;
    }
    let plane: Vec<Vector2<f64>> = board.iter().map(|p| Vector2::new(p.x, p.y)).collect();
    let (tb, ti) = (normaliser(&plane)?, normaliser(pixels)?);
    let mut a = DMatrix::zeros(2 * board.len(), 9);
    for (i, (b, p)) in plane.iter().zip(pixels).enumerate() {
        let x = tb * Vector3::new(b.x, b.y, 1.0);
        let u = ti * Vector3::new(p.x, p.y, 1.0);
        for k in 0..3 {
            a[(2 * i, k)] = x[k];
            a[(2 * i, 6 + k)] = -u.x * x[k];
            a[(2 * i + 1, 3 + k)] = x[k];
            a[(2 * i + 1, 6 + k)] = -u.y * x[k];
        }
    }
    // The smallest right singular vector, as the eigenvector of the 9x9 normal matrix.
    let eigen = (a.transpose() * &a).symmetric_eigen();
    let least = (0..9).min_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]))?;
    let h = eigen.eigenvectors.column(least);
    let h = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    let h = ti.try_inverse()? * h * tb;
    (h[(2, 2)].abs() > 1e-300 && h.iter().all(|v| v.is_finite())).then(|| h / h[(2, 2)])
}

/// Where a homography puts the board point `(x, y)`, px.
pub fn mapped(h: &Matrix3<f64>, x: f64, y: f64) -> Vector2<f64> {
    let u = h * Vector3::new(x, y, 1.0);
    Vector2::new(u.x / u.z, u.y / u.z)
}

/// Root-mean-square distance between the pixels and the homography's prediction, px.
pub fn homography_rms_px(h: &Matrix3<f64>, board: &[Point3<f64>], pixels: &[Vector2<f64>]) -> f64 {
    let sum: f64 = board.iter().zip(pixels).map(|(b, p)| (mapped(h, b.x, b.y) - p).norm_squared()).sum();
    (sum / board.len().max(1) as f64).sqrt()
}

/// Shift to the centroid, scale to a mean distance of sqrt(2).
fn normaliser(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let c = points.iter().sum::<Vector2<f64>>() / n;
    let spread = points.iter().map(|p| (p - c).norm()).sum::<f64>() / n;
    (spread > 1e-12 && spread.is_finite()).then(|| {
        let s = std::f64::consts::SQRT_2 / spread;
        Matrix3::new(s, 0.0, -s * c.x, 0.0, s, -s * c.y, 0.0, 0.0, 1.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_known_homography_is_found_again() {
        let h = Matrix3::new(900.0, 30.0, 120.0, -20.0, 880.0, 90.0, 0.2, -0.1, 1.0);
        let board: Vec<_> = (0..12).map(|i| Point3::new((i % 4) as f64 * 0.05, (i / 4) as f64 * 0.05, 0.0)).collect();
        let pixels: Vec<_> = board.iter().map(|b| mapped(&h, b.x, b.y)).collect();
        let found = homography(&board, &pixels).expect("well posed");
        assert!((found - h).norm() < 1e-6 * h.norm());
        assert!(homography_rms_px(&found, &board, &pixels) < 1e-8);
        assert!(homography(&board[..3], &pixels[..3]).is_none());
        assert!(homography(&[board[0]; 6], &[pixels[0]; 6]).is_none());
    }
}
