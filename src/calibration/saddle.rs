//! The place of one corner from the grey values of the four squares around it.
//!
//! Gradient-based refinement (`cornerSubPix`) uses only the slope near the edges and leaves errors of several hundredths
//! of a pixel that depend on where the corner lies within its pixel. Fitting the picture of two crossing blurred edges
//! uses all pixels at their noise level: on the practice boards the error falls to about a third.

use super::board::Checkerboard;
use crate::footage::GreyImage;
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

/// Reach of the window along the squares' sides, as a share of a side; the next edge must stay outside the window.
const REACH: f64 = 0.7;
/// Distance the window keeps from the next edge, px.
const MARGIN_PX: f64 = 2.5;
const UNKNOWNS: usize = 11;
type Unknowns = SVector<f64, UNKNOWNS>;

/// Refines all corners of a view; a corner whose fit does not settle close to its start keeps its place. Also says whether
/// all settled.
pub fn refine_corners(board: &Checkerboard, corners: &[Vector2<f64>], image: &GreyImage) -> (Vec<Vector2<f64>>, bool) {
    let straight: Vec<_> = (0..corners.len()).map(|i| settle(image, corners[i], &Edges { bends: [0.0; 2], ..Edges::of(board, corners, i) }, None)).collect();
    let near: Vec<_> = straight.iter().zip(corners).map(|(fit, start)| fit.as_ref().map_or(*start, |f| f.at)).collect();
    if straight.iter().any(Option::is_none) {
        return (near, false);
    }
    // How the lens bends the edges is known once the corners are.
    let bent = |i: usize| settle(image, near[i], &Edges::of(board, &near, i), straight[i].as_ref());
    let refined: Vec<_> = (0..corners.len()).map(bent).collect();
    let all_settled = refined.iter().all(Option::is_some);
    (refined.into_iter().zip(near).map(|(fit, start)| fit.map_or(start, |f| f.at)).collect(), all_settled)
}

/// A corner as fitted.
struct Fit {
    at: Vector2<f64>,
    unknowns: Unknowns,
}

/// The two edges through a corner.
struct Edges {
    /// Mean vectors to the neighbours along the columns and down the rows, px.
    along: Vector2<f64>,
    down: Vector2<f64>,
    /// Curvatures of the edge along and of the edge down, 1/px, positive to the left of their direction: a wide lens bends them, and straight edges
    /// would find the corner towards the inside of the bend (by 0.02 px where k1 is -0.4).
    bends: [f64; 2],
}

impl Edges {
    fn of(board: &Checkerboard, corners: &[Vector2<f64>], i: usize) -> Self {
        let (along, down) = sides(board, corners, i);
        let (row, column) = (i / board.columns, i % board.columns);
        // At the rim the bend of the next corner inwards stands in.
        let middle = |at: usize, count: usize| (count > 2).then(|| at.clamp(1, count - 2));
        let bend = |before: usize, at: usize, after: usize| {
            let (side, second) = ((corners[after] - corners[before]) / 2.0, corners[after] - 2.0 * corners[at] + corners[before]);
            side.perp(&second) / side.norm().powi(3)
        };
        let at = |r: usize, c: usize| r * board.columns + c;
        Edges {
            along,
            down,
            bends: [
                middle(column, board.columns).map_or(0.0, |c| bend(at(row, c - 1), at(row, c), at(row, c + 1))),
                middle(row, board.rows).map_or(0.0, |r| bend(at(r - 1, column), at(r, column), at(r + 1, column))),
            ],
        }
    }
}

/// Refines again where the window stood off centre: pixels missing on one side pull the corner.
fn settle(image: &GreyImage, start: Vector2<f64>, edges: &Edges, before: Option<&Fit>) -> Option<Fit> {
    let mut fit = refine(image, start, edges, before)?;
    let mut from = start;
    for _ in 0..2 {
        if (fit.at - from).norm() < 0.15 {
            break;
        }
        from = fit.at;
        fit = refine(image, from, edges, Some(&fit))?;
    }
    // Further than that the start was not this corner, or the squares are not what the model thinks.
    ((fit.at - start).norm() < 0.25 * edges.along.norm().min(edges.down.norm())).then_some(fit)
}

/// Mean vectors to the neighbours along the columns and down the rows, px.
fn sides(board: &Checkerboard, corners: &[Vector2<f64>], i: usize) -> (Vector2<f64>, Vector2<f64>) {
    let (r, c) = (i / board.columns, i % board.columns);
    let between = |before: Option<usize>, after: Option<usize>| match (before, after) {
        (Some(a), Some(b)) => (corners[b] - corners[a]) / 2.0,
        (Some(a), None) => corners[i] - corners[a],
        (None, Some(b)) => corners[b] - corners[i],
        (None, None) => Vector2::zeros(),
    };
    (
        between((c > 0).then(|| i - 1), (c + 1 < board.columns).then(|| i + 1)),
        between((r > 0).then(|| i - board.columns), (r + 1 < board.rows).then(|| i + board.columns)),
    )
}

/// `I = a + g·x + (b + h·x) tanh(d1 w) tanh(d2 w)`, with d1, d2 the distances to the two edges through the corner, bent as they are known
/// to be; g and h let the light vary over the window. Begins with what was fitted before.
fn refine(image: &GreyImage, start: Vector2<f64>, edges: &Edges, before: Option<&Fit>) -> Option<Fit> {
    let Edges { along, down, bends } = *edges;
    let to_squares = Matrix2::from_columns(&[along, down]).try_inverse()?;
    let shortest = along.norm().min(down.norm());
    let reach = REACH.min(1.0 - MARGIN_PX / shortest);
    if reach < 0.3 {
        return None;
    }
    let half = Vector2::new(reach * (along.x.abs() + down.x.abs()), reach * (along.y.abs() + down.y.abs()));
    let (x0, x1) = ((start.x - half.x).ceil() as i64, (start.x + half.x).floor() as i64);
    let (y0, y1) = ((start.y - half.y).ceil() as i64, (start.y + half.y).floor() as i64);
    let mut pixels: Vec<(f64, f64, f64)> = Vec::with_capacity(((x1 - x0 + 1).max(0) * (y1 - y0 + 1).max(0)).min(1 << 20) as usize);
    for y in y0..=y1 {
        for x in x0..=x1 {
            let d = Vector2::new(x as f64 - start.x, y as f64 - start.y);
            let s = to_squares * d;
            if s.x.abs() <= reach && s.y.abs() <= reach && x >= 0 && y >= 0 {
                pixels.push((d.x, d.y, f64::from(image.get(x as usize, y as usize)?)));
            }
        }
    }
    if pixels.len() < 3 * UNKNOWNS {
        return None;
    }
    let mut p = match before {
        Some(fit) => fit.unknowns,
        None => first_guess(&pixels, edges, &to_squares),
    };
    p[0] = 0.0;
    p[1] = 0.0;
    if p[8].abs() < 2.0 {
        return None;
    }
    for iteration in 0..25 {
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut gradient = Unknowns::zeros();
        let (s1, c1) = p[2].sin_cos();
        let (s2, c2) = p[3].sin_cos();
        for &(x, y, grey) in &pixels {
            let (dx, dy) = (x - p[0], y - p[1]);
            let (u1, u2) = (c1 * dx + s1 * dy, c2 * dx + s2 * dy);
            let (d1, d2) = (c1 * dy - s1 * dx - 0.5 * bends[0] * u1 * u1, c2 * dy - s2 * dx - 0.5 * bends[1] * u2 * u2);
            let (t1, t2) = (tanh(d1 * p[4]), tanh(d2 * p[4]));
            let contrast = p[8] + p[9] * x + p[10] * y;
            let (g1, g2) = ((1.0 - t1 * t1) * t2 * contrast, (1.0 - t2 * t2) * t1 * contrast);
            let residual = grey - (p[5] + p[6] * x + p[7] * y + contrast * t1 * t2);
            let derivative = Unknowns::from([
                p[4] * (g1 * s1 + g2 * s2),
                -p[4] * (g1 * c1 + g2 * c2),
                -p[4] * g1 * u1,
                -p[4] * g2 * u2,
                g1 * d1 + g2 * d2,
                1.0,
                x,
                y,
                t1 * t2,
                x * t1 * t2,
                y * t1 * t2,
            ]);
            normal.syger(1.0, &derivative, &derivative, 1.0);
            gradient += derivative * residual;
        }
        normal.fill_upper_triangle_with_lower_triangle();
        for i in 0..UNKNOWNS {
            normal[(i, i)] = normal[(i, i)] * (1.0 + 1e-6) + 1e-12;
        }
        let mut step = normal.cholesky()?.solve(&gradient);
        let size = step[0].hypot(step[1]);
        if size > 1.0 {
            step /= size;
        }
        p += step;
        p[4] = p[4].clamp(0.1, 6.0);
        if size < 1e-4 && (iteration > 1 || before.is_some()) {
            break;
        }
    }
    let moved = Vector2::new(p[0], p[1]);
    (moved.norm() < 0.25 * shortest).then_some(Fit { at: start + moved, unknowns: p })
}

/// Edges towards the neighbours, even light, a contrast that follows from the mean deviation of (x, y, grey level).
fn first_guess(pixels: &[(f64, f64, f64)], edges: &Edges, to_squares: &Matrix2<f64>) -> Unknowns {
    let mean = pixels.iter().map(|p| p.2).sum::<f64>() / pixels.len() as f64;
    let mut p = Unknowns::zeros();
    p[2] = edges.along.y.atan2(edges.along.x);
    p[3] = edges.down.y.atan2(edges.down.x);
    p[4] = 1.0;
    p[5] = mean;
    // The sign says which diagonal is bright; its size is twice the mean deviation.
    let signed: f64 = pixels.iter().map(|q| (to_squares * Vector2::new(q.0, q.1)).iter().product::<f64>().signum() * (q.2 - mean)).sum::<f64>();
    // Distances to the edge along the columns and to the edge down the rows have opposite handedness.
    p[8] = -signed / pixels.len() as f64;
    p
}

/// To a few units of the last place of 1, in half the library function's time; most pixels are far from an edge.
fn tanh(x: f64) -> f64 {
    if x.abs() > 18.0 { x.signum() } else { 1.0 - 2.0 / ((2.0 * x).exp() + 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rms error of the corners found on a drawn board, the edges of which the lens bends by `bent` (1/px) down the picture.
    fn error_px(bent: f64) -> f64 {
        let board = Checkerboard { columns: 3, rows: 3, square_m: 1.0 };
        let (along, down, origin) = (Vector2::new(11.3, 2.1), Vector2::new(-3.4, 10.2), Vector2::new(30.37, 21.81));
        let back = Matrix2::from_columns(&[along, down]).try_inverse().expect("regular");
        let (width, height) = (80, 72);
        let bend = |p: Vector2<f64>| Vector2::new(0.0, 0.5 * bent * (p.x - 40.0).powi(2));
        let mut pixels = vec![0u8; width * height];
        for (i, p) in pixels.iter_mut().enumerate() {
            let mut sum = 0.0;
            for k in 0..400 {
                // A 2-pixel-wide tent of samples: a blur of its own, unlike the model's.
                let (a, b) = ((k % 20) as f64 / 10.0 - 0.95, (k / 20) as f64 / 10.0 - 0.95);
                let at = Vector2::new((i % width) as f64 + a, (i / width) as f64 + b);
                let s = back * (at - bend(at) - origin);
                let dark = (s.x.floor() as i64 + s.y.floor() as i64).rem_euclid(2) == 0;
                let weight = (1.0 - a.abs()) * (1.0 - b.abs());
                sum += weight * if dark { 20.0 } else { 150.0 + 0.2 * (i % width) as f64 };
            }
            *p = (sum / 100.0).round() as u8;
        }
        let image = GreyImage { width, height, pixels };
        let drawn = |i: usize| {
            let straight = origin + along * (i % 3) as f64 + down * (i / 3) as f64;
            (0..20).fold(straight, |at, _| straight + bend(at))
        };
        let truth: Vec<_> = (0..9).map(drawn).collect();
        let rough: Vec<_> = truth.iter().enumerate().map(|(i, t)| t + Vector2::new(0.4 - 0.1 * i as f64, 0.3 - 0.06 * i as f64)).collect();
        let (found, settled) = refine_corners(&board, &rough, &image);
        assert!(settled);
        (found.iter().zip(&truth).map(|(f, t)| (f - t).norm_squared()).sum::<f64>() / 9.0).sqrt()
    }

    #[test]
    fn truth_corners_of_a_drawn_board_are_found_to_two_hundredths_of_a_pixel() {
        // The drawn edge is sharper than the pixels can follow and its blur is not the model's: 0.0104.
        let rms = error_px(0.0);
        assert!(rms < 0.02, "{rms}");
    }

    #[test]
    fn truth_a_wide_lens_does_not_pull_the_corners_into_its_bends() {
        let rms = error_px(3e-3);
        assert!(rms < 0.02, "{rms}");
    }

    #[test]
    fn fails_an_even_picture_keeps_the_corners_where_they_were() {
        let board = Checkerboard { columns: 3, rows: 3, square_m: 1.0 };
        let corners: Vec<_> = (0..9).map(|i| Vector2::new(20.0 + 10.0 * (i % 3) as f64, 20.0 + 10.0 * (i / 3) as f64)).collect();
        let image = GreyImage { width: 70, height: 70, pixels: vec![90; 4900] };
        assert_eq!(refine_corners(&board, &corners, &image), (corners, false));
    }
}
