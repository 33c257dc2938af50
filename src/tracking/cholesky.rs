//! Cholesky's factor of a small symmetric matrix whose size is known when the program is compiled: the loops unroll, nothing is
//! allocated. Tracking solves ten thousands of such systems per clip.

/// h = L Lᵀ.
pub struct Cholesky<const N: usize> {
    /// Column by column from the diagonal down, which holds its inverse; what lies above has no meaning.
    columns: [[f64; N]; N],
}

impl<const N: usize> Cholesky<N> {
    /// Of a symmetric matrix, of which the upper half is looked at; `None` where it is not positive definite.
    pub fn of(h: &[[f64; N]; N]) -> Option<Self> {
        let mut columns = *h;
        for j in 0..N {
            let (before, from) = columns.split_at_mut(j);
            let column = from.first_mut()?;
            // Whole columns, so that several numbers go through a register at once.
            for earlier in before {
                let by = earlier[j];
                for i in 0..N {
                    column[i] -= earlier[i] * by;
                }
            }
            let v = column[j];
            if !(v > 0.0 && v.is_finite()) {
                return None;
            }
            let inverse = 1.0 / v.sqrt();
            for c in column.iter_mut() {
                *c *= inverse;
            }
            column[j] = inverse;
        }
        Some(Cholesky { columns })
    }

    /// L⁻¹ b.
    pub fn solve_lower(&self, mut b: [f64; N]) -> [f64; N] {
        for (k, column) in self.columns.iter().enumerate() {
            b[k] *= column[k];
            for i in k + 1..N {
                b[i] -= column[i] * b[k];
            }
        }
        b
    }

    /// h⁻¹ b.
    pub fn solve(&self, b: [f64; N]) -> [f64; N] {
        let mut x = self.solve_lower(b);
        for i in (0..N).rev() {
            for k in i + 1..N {
                x[i] -= self.columns[i][k] * x[k];
            }
            x[i] *= self.columns[i][i];
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
