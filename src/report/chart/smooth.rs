//! A smooth curve through a scatter, with its pointwise 95 % band.
//!
//! Local linear regression with a tricube kernel over the nearest share of points (Cleveland, JASA 1979). The band uses
//! the smoother's own weights: sd² = σ² Σ lᵢ², σ² from the residuals of the same fit over n - trace (Cleveland and Devlin,
//! JASA 1988).

/// A smooth on a grid of abscissas.
#[derive(Debug, Clone, PartialEq)]
pub struct Smooth {
    pub x: Vec<f64>,
    pub y: Vec<f64>,
    /// Half-width of the 95 % band.
    pub half: Vec<f64>,
}

impl Smooth {
    pub fn line(&self) -> Vec<(f64, f64)> {
        self.x.iter().copied().zip(self.y.iter().copied()).collect()
    }

    /// (x, low, high)
    pub fn band(&self) -> Vec<(f64, f64, f64)> {
        self.x.iter().zip(&self.y).zip(&self.half).map(|((x, y), h)| (*x, y - h, y + h)).collect()
    }
}

/// Smooths `(x, y)` at `grid` places with windows of `share` (0 to 1) of the points. `None` below 8 finite points or when
/// all abscissas are equal.
pub fn local_linear(points: &[(f64, f64)], share: f64, grid: usize) -> Option<Smooth> {
    let mut p: Vec<(f64, f64)> = points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
    p.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let (n, (first, last)) = (p.len(), (p.first()?.0, p.last()?.0));
    if n < 8 || last <= first || grid < 2 {
        return None;
    }
    let window = ((share * n as f64).ceil() as usize).clamp(6.min(n), n);
    // Fit at (a subset of) the data for the residual variance.
    let every = n.div_ceil(400);
    let (mut squares, mut trace, mut count) = (0.0, 0.0, 0.0);
    for (i, &(x, y)) in p.iter().enumerate().step_by(every) {
        let fit = fit_at(&p, x, window)?;
        squares += (y - fit.value).powi(2);
        trace += fit.weight_of(&p, i);
        count += 1.0;
    }
    let sigma = (squares / (count - trace).max(1.0)).sqrt();
    let mut smooth = Smooth { x: Vec::new(), y: Vec::new(), half: Vec::new() };
    for k in 0..grid {
        let x = first + (last - first) * k as f64 / (grid - 1) as f64;
        let fit = fit_at(&p, x, window)?;
        smooth.x.push(x);
        smooth.y.push(fit.value);
        smooth.half.push(1.96 * sigma * fit.norm);
    }
    Some(smooth)
}

struct Fit {
    value: f64,
    /// Square root of the sum of squared weights.
    norm: f64,
    x: f64,
    reach: f64,
    moments: [f64; 3],
}

impl Fit {
    /// Weight of point `i` in the value.
    fn weight_of(&self, p: &[(f64, f64)], i: usize) -> f64 {
        let d = p[i].0 - self.x;
        let [s0, s1, s2] = self.moments;
        let det = s0 * s2 - s1 * s1;
        let w = tricube(d, self.reach);
        if det > 1e-12 * s0 * s2 { w * (s2 - s1 * d) / det } else { w / s0 }
    }
}

fn tricube(d: f64, reach: f64) -> f64 {
    let u = (d / reach).abs();
    if u < 1.0 { (1.0 - u * u * u).powi(3) } else { 0.0 }
}

fn fit_at(p: &[(f64, f64)], x: f64, window: usize) -> Option<Fit> {
    // The window of nearest abscissas, found by sliding over the sorted points.
    let mut low = p.partition_point(|q| q.0 < x).saturating_sub(window);
    let top = p.len() - window;
    low = low.min(top);
    while low < top && (p[low + window].0 - x) < (x - p[low].0) {
        low += 1;
    }
    let near = &p[low..low + window];
    // A little beyond the farthest, so that it still counts; never zero.
    let reach = 1.001 * (x - near.first()?.0).max(near.last()?.0 - x).max(1e-12 * (1.0 + x.abs()));
    let inside = || p.iter().skip(low).take_while(|q| q.0 - x < reach).chain(p[..low].iter().rev().take_while(|q| x - q.0 < reach));
    let mut s = [0.0; 3];
    for q in inside() {
        let (d, w) = (q.0 - x, tricube(q.0 - x, reach));
        s[0] += w;
        s[1] += w * d;
        s[2] += w * d * d;
    }
    let mut fit = Fit { value: 0.0, norm: 0.0, x, reach, moments: s };
    let det = s[0] * s[2] - s[1] * s[1];
    for q in inside() {
        let (d, w) = (q.0 - x, tricube(q.0 - x, reach));
        let l = if det > 1e-12 * s[0] * s[2] { w * (s[2] - s[1] * d) / det } else { w / s[0] };
        fit.value += l * q.1;
        fit.norm += l * l;
    }
    fit.norm = fit.norm.sqrt();
    fit.value.is_finite().then_some(fit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    #[test]
    fn truth_a_straight_line_is_reproduced() {
        let points: Vec<(f64, f64)> = (0..50).map(|i| (i as f64 * 0.3, 2.0 - 0.7 * i as f64 * 0.3)).collect();
        let s = local_linear(&points, 0.4, 20).expect("enough points");
        for (x, y) in s.line() {
            assert!((y - (2.0 - 0.7 * x)).abs() < 1e-9);
        }
    }

    #[test]
    fn law_the_band_covers_the_truth_about_95_times_in_100() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let (mut inside, mut all) = (0, 0);
        for _ in 0..200 {
            let points: Vec<(f64, f64)> = (0..120)
                .map(|_| {
                    let x: f64 = rng.random_range(-1.0..1.0);
                    (x, 0.5 * x + 0.3 * rng.sample::<f64, _>(StandardNormal))
                })
                .collect();
            let s = local_linear(&points, 0.5, 9).expect("enough points");
            all += s.x.len();
            inside += s.x.iter().zip(s.y.iter().zip(&s.half)).filter(|(x, (y, h))| (*y - 0.5 * *x).abs() <= **h).count();
        }
        let share = inside as f64 / all as f64;
        assert!((0.92..0.98).contains(&share), "{share}");
    }

    #[test]
    fn fails_too_few_or_equal_abscissas_give_none() {
        assert!(local_linear(&[(0.0, 1.0); 20], 0.5, 10).is_none());
        assert!(local_linear(&[(0.0, 1.0), (1.0, 2.0)], 0.5, 10).is_none());
    }
}
