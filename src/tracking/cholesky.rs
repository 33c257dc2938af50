//! Cholesky's factor of a small symmetric matrix whose size is known when the program is compiled: the loops unroll, nothing is
//! allocated. Tracking solves ten thousands of such systems per clip.

/// h = L Lᵀ.
pub struct Cholesky<const N: usize> {
    /// Row by row; the diagonal holds its inverse.
    l: [[f64; N]; N],
}

impl<const N: usize> Cholesky<N> {
    /// Of a symmetric matrix, of which the lower half is looked at; `None` where it is not positive definite.
    pub fn of(h: &[[f64; N]; N]) -> Option<Self> {
        let mut l = [[0.0; N]; N];
        for j in 0..N {
            for i in j..N {
                let mut v = h[i][j];
                for k in 0..j {
                    v -= l[i][k] * l[j][k];
                }
                if i > j {
                    l[i][j] = v * l[j][j];
                } else if v > 0.0 && v.is_finite() {
                    l[j][j] = 1.0 / v.sqrt();
                } else {
                    return None;
                }
            }
        }
        Some(Cholesky { l })
    }

    /// L⁻¹ b.
    pub fn solve_lower(&self, mut b: [f64; N]) -> [f64; N] {
        for i in 0..N {
            for k in 0..i {
                b[i] -= self.l[i][k] * b[k];
            }
            b[i] *= self.l[i][i];
        }
        b
    }

    /// h⁻¹ b.
    pub fn solve(&self, b: [f64; N]) -> [f64; N] {
        let mut x = self.solve_lower(b);
        for i in (0..N).rev() {
            for k in i + 1..N {
                x[i] -= self.l[k][i] * x[k];
            }
            x[i] *= self.l[i][i];
        }
        x
    }

    /// h⁻¹.
    pub fn inverse(&self) -> [[f64; N]; N] {
        std::array::from_fn(|k| self.solve(std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 })))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_product_and_refuses_what_is_not_positive() {
        let a: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|k| ((i * 7 + k * k * 3) % 11) as f64 - 4.0));
        let h: [[f64; 6]; 6] =
            std::array::from_fn(|i| std::array::from_fn(|k| (0..6).map(|n| a[i][n] * a[k][n]).sum::<f64>() + if i == k { 1.0 } else { 0.0 }));
        let b = [1.0, -2.0, 0.5, 3.0, 0.0, 7.0];
        let factor = Cholesky::of(&h).expect("positive");
        let (x, inverse, half) = (factor.solve(b), factor.inverse(), factor.solve_lower(b));
        for i in 0..6 {
            assert!((h[i].iter().zip(&x).map(|(h, x)| h * x).sum::<f64>() - b[i]).abs() < 1e-9);
            assert!((inverse[i].iter().zip(&b).map(|(h, b)| h * b).sum::<f64>() - x[i]).abs() < 1e-9);
        }
        assert!((half.iter().map(|v| v * v).sum::<f64>() - b.iter().zip(&x).map(|(b, x)| b * x).sum::<f64>()).abs() < 1e-9);
        assert!(Cholesky::of(&[[1.0, 2.0], [2.0, 1.0]]).is_none() && Cholesky::of(&[[f64::NAN]]).is_none());
    }
}
