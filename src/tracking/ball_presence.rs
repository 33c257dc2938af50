//! Whether there is a ball where an outline was followed: a ball hides what is behind it.
//!
//! Past strings, frame and clutter a circle of the ball's size can be made out of other edges, and a ball that is lost before a thing as
//! bright as itself leaves its follower with nothing better. Inside such a circle the picture is the clip's median picture; inside a
//! ball it is not, even before something as bright, for a ball has a dark side and lines.

use super::ball_track::BallFrame;
use crate::footage::{GreyImage, GreyView};
use nalgebra::Vector2;

/// How far from the centre pixels are asked, in radii: well inside the outline.
const INSIDE: f64 = 0.7;
/// A ball that changes the picture by less than this share of what it usually does is not there.
const LEAST_SHARE: f64 = 0.25;
/// Fewest pictures that tell what is usual.
const FEWEST: usize = 6;

/// How much a disc differs from the same place of the median picture, grey levels in the mean; `None` where either is not known.
pub fn change(image: &GreyView, still: &GreyImage, centre: &Vector2<f64>, radius_px: f64) -> Option<f64> {
    let reach = INSIDE * radius_px;
    let (x0, x1) = ((centre.x - reach).ceil() as i64, (centre.x + reach).floor() as i64);
    let (y0, y1) = ((centre.y - reach).ceil() as i64, (centre.y + reach).floor() as i64);
    if x0 < 0 || y0 < 0 || x1 >= still.width as i64 || y1 >= still.height as i64 {
        return None;
    }
    let (mut sum, mut count) = (0u32, 0u32);
    for y in y0..=y1 {
        let half = (reach * reach - (y as f64 - centre.y).powi(2)).max(0.0).sqrt();
        let columns = (centre.x - half).ceil() as usize..=(centre.x + half).floor() as usize;
        let (first, row) = image.part_of_row(y as usize)?;
        let seen = row.get(columns.start().checked_sub(first)?..=columns.end().checked_sub(first)?)?;
        let behind = still.pixels.get(y as usize * still.width..(y as usize + 1) * still.width)?.get(columns)?;
        sum += seen.iter().zip(behind).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>();
        count += seen.len() as u32;
    }
    (count > 0).then(|| f64::from(sum) / f64::from(count))
}

/// Takes away the points at which hardly anything has changed; `changes` are [`change`] of each frame and camera.
pub fn drop_absent(ball: &mut [Option<BallFrame>], changes: &[[Option<f64>; 2]]) {
    for camera in 0..2 {
        let mut sorted: Vec<f64> = changes.iter().filter_map(|c| c[camera]).collect();
        if sorted.len() < FEWEST {
            continue;
        }
        sorted.sort_by(f64::total_cmp);
        let least = LEAST_SHARE * sorted[sorted.len() / 2];
        for (frame, changes) in ball.iter_mut().zip(changes) {
            if changes[camera].is_some_and(|c| c < least) {
                BallFrame::forget(frame, camera);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn truth_a_ball_differs_from_the_median_picture_and_an_empty_circle_does_not() {
        let still = GreyImage { width: 64, height: 64, pixels: (0..64 * 64).map(|i| 90 + (i * 7919 % 5) as u8).collect() };
        let mut picture = still.clone();
        for (i, p) in picture.pixels.iter_mut().enumerate() {
            let d = Vector2::new((i % 64) as f64 - 20.3, (i / 64) as f64 - 30.6);
            *p = if d.norm() < 8.0 { (96.0 - 8.0 * d.y) as u8 } else { *p + (i % 3) as u8 };
        }
        let view = GreyView::of(&picture);
        let at = |x: f64, y: f64| change(&view, &still, &Vector2::new(x, y), 8.0);
        assert!(at(20.3, 30.6).is_some_and(|c| c > 15.0) && at(45.0, 30.0).is_some_and(|c| c < 2.0) && at(2.0, 30.0).is_none());
        let ball = BallFrame {
            points: [None, Some(super::super::ImagePoint { uv: Vector2::zeros(), sd: Vector2::repeat(0.1) })],
            position: Point3::origin(),
            stereo: false,
        };
        let mut seen = vec![Some(ball); 8];
        let mut changes = vec![[None, Some(20.0)]; 8];
        changes[5] = [None, Some(1.0)];
        drop_absent(&mut seen, &changes);
        assert!((0..8).all(|k| seen[k].is_some() == (k != 5)));
    }
}
