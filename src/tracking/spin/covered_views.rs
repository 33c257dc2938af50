//! Pictures in which something passes before the ball: a tube, a tape, a hand.
//!
//! A pixel that shows it counts little in a registration, but a whole edge of them looks like a line that does not turn, and a few such
//! pictures leave more unexplained than a wrong spin does. They are told by what they leave against what the others leave: a wrong spin
//! leaves as much in all.

use super::shading::Mark;
use crate::median::upper_median;

/// Mean square of what is left in a picture, in units of the median over all, from which something else is seen in it: 60 to 160 with a tube
/// before the ball, 14 at most in some 800 rendered pictures without, whatever the spin they were registered with.
const MUCH_LEFT: f64 = 20.0;
/// Largest share of the pictures that may go.
const MOST: f64 = 0.25;

/// The marks of pictures in which nothing but the ball is seen, if there are others; `residuals` are what a registration left at each mark.
pub(super) fn clear_marks(residuals: &[f32], marks: &[Mark], views: usize) -> Option<Vec<Mark>> {
    let (mut squares, mut counts) = (vec![0.0; views], vec![0.0; views]);
    for (r, m) in residuals.iter().zip(marks) {
        squares[m.view] += f64::from(r * r) * m.weight;
        counts[m.view] += m.weight;
    }
    let left: Vec<f64> = squares.iter().zip(&counts).map(|(s, c)| if *c > 0.0 { s / c } else { 0.0 }).collect();
    let usual = upper_median(left.iter().copied().filter(|l| *l > 0.0))?;
    let gone: Vec<bool> = left.iter().map(|l| *l > MUCH_LEFT * usual).collect();
    let count = gone.iter().filter(|g| **g).count();
    (count > 0 && count as f64 <= MOST * views as f64).then(|| marks.iter().copied().filter(|m| !gone[m.view]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    /// 20 pictures of 50 pixels, each with its size of what is left.
    fn told(size: impl Fn(usize) -> f32) -> Option<Vec<usize>> {
        let marks: Vec<Mark> =
            (0..1000).map(|i| Mark { view: i / 50, normal: Vector3::z(), disc: Vector3::z(), contrast: 0.0, weight: 1.0 + (i % 3) as f64 }).collect();
        let residuals: Vec<f32> = (0..1000).map(|i| size(i / 50) * if i % 2 == 0 { 1.0 } else { -0.8 }).collect();
        let mut views: Vec<usize> = clear_marks(&residuals, &marks, 20)?.iter().map(|m| m.view).collect();
        views.dedup();
        Some(views)
    }

    #[test]
    fn few_pictures_that_leave_far_more_than_the_others_go() {
        assert_eq!(told(|view| if view == 3 || view == 7 { 0.4 } else { 0.05 }), Some((0..20).filter(|v| *v != 3 && *v != 7).collect()));
    }

    #[test]
    fn pictures_that_all_leave_much_or_too_many_of_them_stay() {
        assert_eq!(told(|view| 0.2 + 0.02 * view as f32), None);
        assert_eq!(told(|view| if view < 6 { 0.4 } else { 0.05 }), None);
    }
}
