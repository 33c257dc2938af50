//! Every place that may be the centre of a circle of the ball's size: votes of the grey gradients (Hough's transform with
//! the radius known). Works on any surroundings, brighter or darker than the ball.

use crate::footage::{GreyImage, GreyView};
use nalgebra::Vector2;

/// A place that may be the ball.
#[derive(Debug, Clone, Copy)]
pub struct BallCandidate {
    pub uv: Vector2<f64>,
    pub votes: f64,
}

/// Most candidates kept per picture.
const MOST: usize = 16;
/// A gradient counts up to this, grey levels over two pixels: bright clutter must not outvote a pale ball.
const CAP: f64 = 30.0;
/// Less is noise, grey levels over two pixels.
const LEAST: f64 = 6.0;
/// A pixel belongs to something that moves when it or a neighbour differs from the background by this, in mean differences
/// of the whole picture (most of it is still, so that is the noise) plus a few grey levels.
const MOVING: (f64, f64) = (3.0, 5.0);

/// A box of pixels, inclusive.
#[derive(Debug, Clone, Copy)]
struct Region {
    x0: i64,
    y0: i64,
    x1: i64,
    y1: i64,
}

impl Region {
    fn width(&self) -> usize {
        (self.x1 - self.x0 + 1).max(0) as usize
    }

    fn height(&self) -> usize {
        (self.y1 - self.y0 + 1).max(0) as usize
    }
}

/// Candidates in a whole picture, most votes first; only what differs from the background votes.
pub fn candidates(image: &GreyView, background: &GreyImage, radius_px: f64) -> Vec<BallCandidate> {
    let (w, h) = (image.width, image.height);
    if background.width != w || background.height != h || image.rows != h || !(2.5..100.0).contains(&radius_px) {
        return Vec::new();
    }
    let moving = moving(image, background);
    let region = Region { x0: 0, y0: 0, x1: w as i64 - 1, y1: h as i64 - 1 };
    let votes = vote(image, radius_px, &region, &region, |x, y| moving[y as usize * w + x as usize]);
    let (least, gap) = (2.0 * radius_px, (0.5 * radius_px) as i64);
    let mut found: Vec<BallCandidate> = Vec::new();
    for y in 1..h - 1 {
        for x in 1..w - 1 {
            let v = votes[y * w + x];
            // A ball with a third of its outline against other grey gives about 2 votes for each pixel of radius.
            if v > least && (y - 1..=y + 1).all(|j| (x - 1..=x + 1).all(|i| votes[j * w + i] <= v)) {
                found.push(BallCandidate { uv: Vector2::new(x as f64, y as f64), votes: v });
            }
        }
    }
    found.sort_by(|a, b| b.votes.total_cmp(&a.votes).then(a.uv.y.total_cmp(&b.uv.y)).then(a.uv.x.total_cmp(&b.uv.x)));
    let mut kept: Vec<BallCandidate> = Vec::new();
    for c in found {
        if kept.len() == MOST {
            break;
        }
        if kept.iter().all(|k| (k.uv - c.uv).amax() > gap as f64) {
            kept.push(c);
        }
    }
    kept
}

/// The place within `reach_px` of `centre` with the most votes, whole pixels from it; `None` near the picture's border.
pub fn nearby(image: &GreyView, centre: Vector2<f64>, radius_px: f64, reach_px: i64) -> Option<Vector2<f64>> {
    let (cx, cy) = (centre.x.round() as i64, centre.y.round() as i64);
    let centres = Region { x0: cx - reach_px - 1, y0: cy - reach_px - 1, x1: cx + reach_px + 1, y1: cy + reach_px + 1 };
    let margin = radius_px.ceil() as i64 + 1;
    let pixels = Region { x0: centres.x0 - margin, y0: centres.y0 - margin, x1: centres.x1 + margin, y1: centres.y1 + margin };
    if !image.contains(pixels.x0, pixels.y0, pixels.x1, pixels.y1) {
        return None;
    }
    let votes = vote(image, radius_px, &pixels, &centres, |_, _| true);
    let w = centres.width();
    let mut best = (0.0, centre);
    for j in 1..centres.height() - 1 {
        for i in 1..w - 1 {
            let v = votes[j * w + i];
            if v > best.0 {
                best = (v, Vector2::new((centres.x0 + i as i64) as f64, (centres.y0 + j as i64) as f64));
            }
        }
    }
    Some(best.1)
}

/// Votes of the gradients in `pixels` for centres in `centres`, smoothed over 3x3.
fn vote(image: &GreyView, radius_px: f64, pixels: &Region, centres: &Region, counts: impl Fn(i64, i64) -> bool) -> Vec<f64> {
    let (w, h) = (centres.width(), centres.height());
    let mut raw = vec![0.0f64; w * h];
    let x_range = pixels.x0.max(1)..=pixels.x1.min(image.width as i64 - 2);
    for y in pixels.y0.max(image.first_row as i64 + 1)..=pixels.y1.min((image.first_row + image.rows) as i64 - 2) {
        let rows = [y - 1, y, y + 1].map(|r| image.row(r as usize));
        let [Some(above), Some(here), Some(below)] = rows else { continue };
        for x in x_range.clone() {
            if !counts(x, y) {
                continue;
            }
            let i = x as usize;
            let gx = f64::from(here[i + 1]) - f64::from(here[i - 1]);
            let gy = f64::from(below[i]) - f64::from(above[i]);
            let g = (gx * gx + gy * gy).sqrt();
            if g < LEAST {
                continue;
            }
            let weight = g.min(CAP) / CAP;
            let (dx, dy) = (gx / g * radius_px, gy / g * radius_px);
            for sign in [1.0, -1.0] {
                let (cx, cy) = ((x as f64 + sign * dx).round() as i64 - centres.x0, (y as f64 + sign * dy).round() as i64 - centres.y0);
                if cx >= 0 && cy >= 0 && (cx as usize) < w && (cy as usize) < h {
                    raw[cy as usize * w + cx as usize] += weight;
                }
            }
        }
    }
    let mut smooth = vec![0.0f64; w * h];
    for y in 1..h.saturating_sub(1) {
        for x in 1..w.saturating_sub(1) {
            let row = |j: usize| raw[j * w + x - 1] + raw[j * w + x] + raw[j * w + x + 1];
            smooth[y * w + x] = row(y - 1) + row(y) + row(y + 1);
        }
    }
    smooth
}

/// Pixels that differ from the background, or whose neighbours do.
fn moving(image: &GreyView, background: &GreyImage) -> Vec<bool> {
    let (w, h) = (image.width, image.height);
    let mut difference = vec![0u8; w * h];
    let mut sum = 0u64;
    for y in 0..h {
        let Some(row) = image.row(y) else { continue };
        for x in 0..w {
            let d = row[x].abs_diff(background.pixels[y * w + x]);
            difference[y * w + x] = d;
            sum += u64::from(d);
        }
    }
    let least = (MOVING.0 * sum as f64 / (w * h) as f64 + MOVING.1).min(255.0) as u8;
    let mut out = vec![false; w * h];
    for y in 1..h.saturating_sub(1) {
        for x in 1..w.saturating_sub(1) {
            if difference[y * w + x] >= least {
                for j in y - 1..=y + 1 {
                    out[j * w + x - 1..=j * w + x + 1].fill(true);
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(centre: (f64, f64), level: u8) -> GreyImage {
        let pixels = (0..120 * 100)
            .map(|i| {
                let (x, y) = ((i % 120) as f64, (i / 120) as f64);
                if (x - centre.0).hypot(y - centre.1) < 8.0 { level } else { 60 }
            })
            .collect();
        GreyImage { width: 120, height: 100, pixels }
    }

    #[test]
    fn truth_a_disc_brighter_or_darker_is_the_first_candidate() {
        let background = GreyImage { width: 120, height: 100, pixels: vec![60; 12_000] };
        for level in [20, 180] {
            let p = picture((70.3, 40.6), level);
            let found = candidates(&GreyView::of(&p), &background, 8.0);
            assert!((found[0].uv - Vector2::new(70.3, 40.6)).norm() < 1.2, "{found:?}");
            let near = nearby(&GreyView::of(&p), Vector2::new(67.0, 43.0), 8.0, 6).expect("inside");
            assert!((near - Vector2::new(70.3, 40.6)).norm() < 1.2, "{near}");
            assert!(nearby(&GreyView::of(&p), Vector2::new(3.0, 43.0), 8.0, 6).is_none());
        }
    }
}
