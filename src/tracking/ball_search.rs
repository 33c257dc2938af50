//! Every place in a whole picture where something of the ball's size differs from the background.

use crate::footage::{GreyImage, GreyView};
use nalgebra::Vector2;

/// A place that may be the ball.
#[derive(Debug, Clone, Copy)]
pub struct BallCandidate {
    pub uv: Vector2<f64>,
    pub score: f64,
}

/// Most candidates kept per picture.
const MOST: usize = 14;

/// Candidates, strongest first: boxes of the ball's size that differ from the background more than most of their
/// surroundings do.
pub fn candidates(image: &GreyView, background: &GreyImage, radius_px: f64) -> Vec<BallCandidate> {
    let (w, h) = (image.width, image.height);
    if background.width != w || background.height != h || image.rows != h || !(2.0..100.0).contains(&radius_px) {
        return Vec::new();
    }
    // Sums over boxes by the integral image.
    let mut sum = vec![0u32; (w + 1) * (h + 1)];
    for y in 0..h {
        let (Some(row), back) = (image.row(y), &background.pixels[y * w..(y + 1) * w]) else { return Vec::new() };
        let mut line = 0u32;
        for x in 0..w {
            line += u32::from(row[x].abs_diff(back[x]));
            sum[(y + 1) * (w + 1) + x + 1] = sum[y * (w + 1) + x + 1] + line;
        }
    }
    let mean = |x: i64, y: i64, r: i64| -> f64 {
        let (x0, x1) = ((x - r).clamp(0, w as i64) as usize, (x + r + 1).clamp(0, w as i64) as usize);
        let (y0, y1) = ((y - r).clamp(0, h as i64) as usize, (y + r + 1).clamp(0, h as i64) as usize);
        let total =
            u64::from(sum[y1 * (w + 1) + x1]) + u64::from(sum[y0 * (w + 1) + x0]) - u64::from(sum[y0 * (w + 1) + x1]) - u64::from(sum[y1 * (w + 1) + x0]);
        total as f64 / (((x1 - x0) * (y1 - y0)) as f64).max(1.0)
    };
    let inner = (0.55 * radius_px).round() as i64;
    let ring = 1.55 * radius_px;
    let spot = (0.25 * radius_px).round() as i64;
    let offsets: [(i64, i64); 8] = std::array::from_fn(|k| {
        let a = std::f64::consts::TAU * k as f64 / 8.0;
        ((ring * a.cos()).round() as i64, (ring * a.sin()).round() as i64)
    });
    let noise = mean(w as i64 / 2, h as i64 / 2, w.max(h) as i64);
    // A still picture differs from its median by its noise alone; most of the picture is still.
    let least = 5.0 + 1.5 * noise;
    let margin = (radius_px + 4.0).ceil() as i64;
    let mut found: Vec<BallCandidate> = Vec::new();
    for y in (margin..h as i64 - margin).step_by(2) {
        for x in (margin..w as i64 - margin).step_by(2) {
            let inside = mean(x, y, inner);
            if inside < least {
                continue;
            }
            let mut outside = offsets.map(|(i, j)| mean(x + i, y + j, spot));
            outside.sort_by(f64::total_cmp);
            // Two of eight places may show the racket, the arm or a bright object that touches.
            let score = inside - outside[5];
            if score > 0.4 * inside && score > least {
                found.push(BallCandidate { uv: Vector2::new(x as f64, y as f64), score });
            }
        }
    }
    found.sort_by(|a, b| b.score.total_cmp(&a.score).then((a.uv.y, a.uv.x).partial_cmp(&(b.uv.y, b.uv.x)).unwrap_or(std::cmp::Ordering::Equal)));
    let mut kept: Vec<BallCandidate> = Vec::new();
    for c in found {
        if kept.len() == MOST {
            break;
        }
        if kept.iter().all(|k| (k.uv - c.uv).norm() > 0.8 * radius_px) {
            kept.push(c);
        }
    }
    kept
}
