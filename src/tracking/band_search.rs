//! Every place in a whole picture that looks like tape: bright, with dark on two opposite sides a few pixels away.

use crate::footage::GreyView;
use nalgebra::Vector2;

/// A place that may be a tape band.
#[derive(Debug, Clone, Copy)]
pub struct BandCandidate {
    pub uv: Vector2<f64>,
    /// Bright less the brighter of the two darks, grey levels.
    pub contrast: f64,
}

/// Directions tried over half a turn; 22.5 degrees apart, well inside the width of a band.
const DIRECTIONS: usize = 8;
/// Most candidates kept per picture: a cluttered court shows some tens.
const MOST: usize = 70;

/// Candidates, strongest first. `px_per_m` is the scale of the picture at the racket; `white_half_m` the expected half
/// length of the white tape.
pub fn candidates(image: &GreyView, px_per_m: f64, white_half_m: f64) -> Vec<BandCandidate> {
    let (w, h) = (image.width, image.rows);
    let Some(smooth) = box_sum(image) else { return Vec::new() };
    // From a foreshortened band (0.7 of its length) to the far end of the black.
    let near = 0.75 * white_half_m * px_per_m + 0.8;
    let far = 2.0 * white_half_m * px_per_m + 1.5;
    let steps = ((far - near).round() as usize).clamp(2, 6);
    let mut offsets = Vec::with_capacity(DIRECTIONS);
    for k in 0..DIRECTIONS {
        let angle = std::f64::consts::PI * k as f64 / DIRECTIONS as f64;
        let along: Vec<isize> = (0..=steps)
            .map(|i| {
                let d = near + (far - near) * i as f64 / steps as f64;
                (d * angle.sin()).round() as isize * w as isize + (d * angle.cos()).round() as isize
            })
            .collect();
        offsets.push(along);
    }
    let margin = far.ceil() as usize + 2;
    if w <= 2 * margin || h <= 2 * margin {
        return Vec::new();
    }
    let mut score = vec![0u16; w * h];
    // Nine-pixel sums: less than 4 grey levels of contrast is noise in any camera.
    let least = 9 * 4;
    // Nothing within reach is darker than the darkest of a box around: most places need no look at all.
    let darkest = darkest_around(&smooth, w, far.ceil() as usize + 1);
    for y in margin..h - margin {
        for x in margin..w - margin {
            let at = y * w + x;
            let here = i32::from(smooth[at]);
            if here - i32::from(darkest[at]) <= least {
                continue;
            }
            let mut best = least;
            for along in &offsets {
                let dark = |sign: isize| along.iter().map(|o| i32::from(smooth[(at as isize + sign * o) as usize])).min().unwrap_or(here);
                let first = here - dark(1);
                if first > best {
                    best = best.max(first.min(here - dark(-1)));
                }
            }
            if best > least {
                score[at] = best as u16;
            }
        }
    }
    let mut found: Vec<(u16, usize, usize)> = Vec::new();
    for y in margin..h - margin {
        for x in margin..w - margin {
            let s = score[y * w + x];
            if s == 0 {
                continue;
            }
            // Ties go to the first in reading order.
            let highest = (y - 2..=y + 2).all(|j| {
                (x - 2..=x + 2).all(|i| {
                    let other = score[j * w + i];
                    other < s || (other == s && (j, i) >= (y, x))
                })
            });
            if highest {
                found.push((s, x, y));
            }
        }
    }
    found.sort_by(|a, b| b.0.cmp(&a.0).then((a.2, a.1).cmp(&(b.2, b.1))));
    found.truncate(MOST);
    found
        .iter()
        .map(|(s, x, y)| BandCandidate { uv: centroid(&score, w, *x, *y) + Vector2::new(0.0, image.first_row as f64), contrast: f64::from(*s) / 9.0 })
        .collect()
}

/// Centroid of the score around its peak.
fn centroid(score: &[u16], w: usize, x: usize, y: usize) -> Vector2<f64> {
    let (mut sum, mut at) = (0.0, Vector2::zeros());
    for j in y - 2..=y + 2 {
        for i in x - 2..=x + 2 {
            let s = f64::from(score[j * w + i]);
            sum += s;
            at += Vector2::new(i as f64, j as f64) * s;
        }
    }
    at / sum
}

/// Smallest value within `reach` rows and columns of each place; near the border, of places the box does not wholly cover,
/// only something not smaller than that.
fn darkest_around(values: &[u16], w: usize, reach: usize) -> Vec<u16> {
    // Minima over 2, 4, 8, ... neighbours by doubling, then two overlapping runs make the box; rows first, then columns.
    let span = 2 * reach + 1;
    let run = (span / 2 + 1).next_power_of_two().min(span);
    let mut out = values.to_vec();
    let mut line = vec![0u16; w];
    for row in out.chunks_exact_mut(w) {
        let mut step = 1;
        while step < run && step < w {
            line.copy_from_slice(row);
            for (a, b) in row.iter_mut().zip(&line[step..]) {
                *a = (*a).min(*b);
            }
            step *= 2;
        }
        line.copy_from_slice(row);
        if let (Some(middle), Some(far)) = (row.get_mut(reach..), line.get(span - run..)) {
            for ((a, near), far) in middle.iter_mut().zip(&line).zip(far) {
                *a = (*near).min(*far);
            }
        }
    }
    let h = values.len() / w.max(1);
    let mut step = 1;
    while step < run && step < h {
        for y in 0..h - step {
            let (above, below) = out.split_at_mut((y + step) * w);
            for (a, b) in above[y * w..(y + 1) * w].iter_mut().zip(&below[..w]) {
                *a = (*a).min(*b);
            }
        }
        step *= 2;
    }
    let runs = out.clone();
    for y in reach..h.saturating_sub(reach) {
        let (near, far) = (&runs[(y - reach) * w..(y - reach + 1) * w], &runs[(y + reach + 1 - run) * w..(y + reach + 2 - run) * w]);
        for ((a, near), far) in out[y * w..(y + 1) * w].iter_mut().zip(near).zip(far) {
            *a = (*near).min(*far);
        }
    }
    out
}

/// 3x3 sums; the border keeps its nearest inner value.
fn box_sum(image: &GreyView) -> Option<Vec<u16>> {
    let (w, h) = (image.width, image.rows);
    if w < 3 || h < 3 {
        return None;
    }
    let mut out = vec![0u16; w * h];
    for y in 0..h {
        let rows = [y.saturating_sub(1), y, (y + 1).min(h - 1)].map(|r| image.row(image.first_row + r));
        let [Some(a), Some(b), Some(c)] = rows else { return None };
        let line = &mut out[y * w..(y + 1) * w];
        for x in 1..w - 1 {
            let column = |i: usize| u16::from(a[i]) + u16::from(b[i]) + u16::from(c[i]);
            line[x] = column(x - 1) + column(x) + column(x + 1);
        }
        line[0] = line[1];
        line[w - 1] = line[w - 2];
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_looking_through_every_box() {
        let (w, h) = (61, 47);
        let values: Vec<u16> = (0..w * h).map(|i| (i * 7919 % 2003) as u16).collect();
        for reach in [1, 2, 3, 6, 9, 10] {
            let fast = darkest_around(&values, w, reach);
            for y in reach..h - reach {
                for x in reach..w - reach {
                    let slow = (y - reach..=y + reach).flat_map(|j| &values[j * w + x - reach..=j * w + x + reach]).min();
                    assert_eq!(Some(&fast[y * w + x]), slow, "{reach}: {x} {y}");
                }
            }
        }
    }
}
