//! The way a ball came, and where it goes on to: straight through its last places, until it turns.

use nalgebra::{Point3, Vector3};

/// A line goes through so many places: over more of them gravity and drag bend it.
pub const OF_LINE: usize = 12;

/// Places whose line foretells the next one better than it is measured: with n of them its variance is 2 (2n + 1) / (n (n - 1)) of one place's.
const STRAIGHT: usize = 6;
/// A place farther off the line than this counts less: one camera may have taken another thing for the ball, which is off in depth.
const AGREES_M: f64 = 0.008;
const ROUNDS: usize = 3;

/// The straight line through places at frame numbers.
#[derive(Debug, Clone, Copy)]
pub struct StraightLine {
    mean_number: f64,
    mean: Vector3<f64>,
    /// Way per frame, m.
    pub step: Vector3<f64>,
}

impl StraightLine {
    pub fn through(places: impl Iterator<Item = (f64, Point3<f64>)> + Clone) -> Self {
        Self::weighted(places.map(|(number, place)| (number, place, 1.0)))
    }

    fn weighted(places: impl Iterator<Item = (f64, Point3<f64>, f64)> + Clone) -> Self {
        let n: f64 = places.clone().map(|p| p.2).sum();
        let (mean_number, mean) = places.clone().fold((0.0, Vector3::zeros()), |(m, p), (number, place, w)| (m + w * number / n, p + place.coords * (w / n)));
        let of = |number: f64| number - mean_number;
        let (square, along) =
            places.fold((0.0, Vector3::zeros()), |(s, a), (number, place, w)| (s + w * of(number).powi(2), a + place.coords * (w * of(number))));
        StraightLine { mean_number, mean, step: along / f64::max(square, 1e-9) }
    }

    /// What most of the places agree on.
    fn through_most(places: &[(f64, Point3<f64>)]) -> Self {
        let mut line = Self::through(places.iter().copied());
        for _ in 0..ROUNDS {
            let weight = |(number, place): &(f64, Point3<f64>)| (AGREES_M / (place - line.at(*number)).norm().max(1e-9)).min(1.0);
            line = Self::weighted(places.iter().map(|p| (p.0, p.1, weight(p))));
        }
        line
    }

    pub fn at(&self, number: f64) -> Point3<f64> {
        Point3::from(self.mean + self.step * (number - self.mean_number))
    }

    /// The frame number at which it is at a height, the third coordinate.
    pub fn number_at_height(&self, height: f64) -> Option<f64> {
        (self.step.z.abs() > 1e-9).then(|| self.mean_number + (height - self.mean.z) / self.step.z)
    }
}

/// Places of a ball that is followed, the newest last. Two neighbours alone foretell the next frame to twice their own errors, and a depth that one camera
/// has to do with for a hundred frames not at all.
#[derive(Debug, Clone)]
pub struct BallWay {
    places: Vec<(f64, Point3<f64>)>,
}

impl BallWay {
    /// From places it was seen at, two or more, the newest last.
    pub fn new(places: impl IntoIterator<Item = (f64, Point3<f64>)>) -> Self {
        let mut places: Vec<_> = places.into_iter().collect();
        places.drain(..places.len().saturating_sub(OF_LINE));
        BallWay { places }
    }

    /// Adds where the ball is; not `as_foretold` it has turned, and what was before its last place counts no more.
    pub fn go_on(&mut self, number: f64, place: Point3<f64>, as_foretold: bool) {
        let keep = if as_foretold { OF_LINE - 1 } else { 1 };
        self.places.drain(..self.places.len().saturating_sub(keep));
        self.places.push((number, place));
    }

    /// Whether it has gone straight on for long enough to be foretold to less than the error of one place.
    pub fn is_straight(&self) -> bool {
        self.places.len() >= STRAIGHT
    }

    /// Where it should be in a frame.
    pub fn foretold(&self, number: f64) -> Point3<f64> {
        StraightLine::through_most(&self.places).at(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_way_goes_straight_on_and_a_turn_begins_a_new_one() {
        let at = |k: f64| Point3::new(0.03 * k, 1.0 - 0.01 * k, 0.2);
        let noise = |k: i32| Vector3::new(0.0, 0.0, 0.004 * f64::from(k * 7919 % 13 - 6) / 6.0);
        let mut way = BallWay::new([0, 1].map(|k| (f64::from(k), at(f64::from(k)) + noise(k))));
        (2..30).for_each(|k| way.go_on(f64::from(k), at(f64::from(k)) + noise(k), true));
        // A hundred frames on, where two neighbours would be 0.4 m off.
        assert!((way.foretold(130.0) - at(130.0)).norm() < 0.06, "{}", way.foretold(130.0));
        let turned = |k: f64| at(29.0) - Vector3::x() * 0.04 * (k - 29.0);
        way.go_on(30.0, turned(30.0), false);
        assert!((way.foretold(31.0) - turned(31.0)).norm() < 0.01);
    }
}
