//! Whether there is a ball where an outline was followed: a ball hides what is behind it.
//!
//! Past strings, frame and clutter a circle of the ball's size can be made out of other edges, and a ball that is lost before a thing as
//! bright as itself leaves its follower with nothing better. Inside such a circle the picture is the clip's median picture; inside a
//! ball it is not, even before something as bright, for a ball has a dark side and lines.

use crate::footage::GreyView;
use crate::median::upper_median;
use nalgebra::Vector2;

/// How far from the centre pixels are asked, in radii: well inside the outline.
const INSIDE: f64 = 0.7;
/// What is around a ball, in radii.
const AROUND: [f64; 2] = [1.15, 1.5];
/// A ball that changes the picture by less than this share of what it usually does is not there.
const LEAST_SHARE: f64 = 0.25;
/// Fewest pictures that tell what is usual.
const FEWEST: usize = 6;

/// How much a disc differs from the same place of the median picture, grey levels in the mean; `None` where either is not known.
pub fn change(image: &GreyView, still: &GreyView, centre: &Vector2<f64>, radius_px: f64) -> Option<f64> {
    change_between(image, still, centre, [0.0, INSIDE * radius_px])
}

/// The same around a ball. A ball hides a disc and nothing else, while frame, arm and strings that move go on beyond it.
pub fn change_around(image: &GreyView, still: &GreyView, centre: &Vector2<f64>, radius_px: f64) -> Option<f64> {
    change_between(image, still, centre, AROUND.map(|radii| radii * radius_px))
}

/// The mean difference from the median picture between two distances from a place, px.
fn change_between(image: &GreyView, still: &GreyView, centre: &Vector2<f64>, [inner, outer]: [f64; 2]) -> Option<f64> {
    let (x0, x1) = ((centre.x - outer).ceil() as i64, (centre.x + outer).floor() as i64);
    let (y0, y1) = ((centre.y - outer).ceil() as i64, (centre.y + outer).floor() as i64);
    if x0 < 0 || y0 < 0 || x1 >= still.width as i64 || y1 >= still.height as i64 {
        return None;
    }
    let (mut sum, mut count) = (0u32, 0u32);
    for y in y0..=y1 {
        let half_of = |radius: f64| (radius * radius - (y as f64 - centre.y).powi(2)).max(0.0).sqrt();
        let (half, hole) = (half_of(outer), half_of(inner));
        let columns = (centre.x - half).ceil() as usize..=(centre.x + half).floor() as usize;
        let (first, row) = image.part_of_row(y as usize)?;
        let seen = row.get(columns.start().checked_sub(first)?..=columns.end().checked_sub(first)?)?;
        let (first, row) = still.part_of_row(y as usize)?;
        let behind = row.get(columns.start().checked_sub(first)?..=columns.end().checked_sub(first)?)?;
        let sides = if hole > 0.0 {
            let left = ((centre.x - hole).ceil() as usize).saturating_sub(*columns.start());
            let right = ((centre.x + hole).floor() as usize + 1).saturating_sub(*columns.start());
            [0..left.min(seen.len()), right.min(seen.len())..seen.len()]
        } else {
            [0..seen.len(), 0..0]
        };
        for side in sides {
            sum += seen[side.clone()].iter().zip(&behind[side.clone()]).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>();
            count += side.len() as u32;
        }
    }
    (count > 0).then(|| f64::from(sum) / f64::from(count))
}

/// The points at which hardly anything has changed, by frame and camera, with what a ball should change; `changes` are [`change`] of each
/// frame and camera.
pub fn absent(changes: &[[Option<f64>; 2]]) -> Vec<(usize, usize, f64)> {
    let mut out = Vec::new();
    for camera in 0..2 {
        let known: Vec<f64> = changes.iter().filter_map(|c| c[camera]).collect();
        if known.len() < FEWEST {
            continue;
        }
        let Some(usual) = upper_median(known) else { continue };
        let least = LEAST_SHARE * usual;
        out.extend(changes.iter().enumerate().filter(|(_, c)| c[camera].is_some_and(|c| c < least)).map(|(index, _)| (index, camera, least)));
    }
    out
}

/// The first, the middle and the last of the frames in which a camera saw the ball farther than `away_px` from its place in frame `index`.
pub fn elsewhere(places: &[Option<Vector2<f64>>], index: usize, away_px: f64) -> Option<[usize; 3]> {
    let here = places[index]?;
    let away: Vec<usize> = (0..places.len()).filter(|i| places[*i].is_some_and(|uv| (uv - here).norm() > away_px)).collect();
    Some([*away.first()?, *away.get(away.len() / 2)?, *away.last()?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footage::GreyImage;

    #[test]
    fn truth_a_ball_differs_from_the_median_picture_and_an_empty_circle_does_not() {
        let still = GreyImage { width: 64, height: 64, pixels: (0..64 * 64).map(|i| 90 + (i * 7919 % 5) as u8).collect() };
        let mut picture = still.clone();
        for (i, p) in picture.pixels.iter_mut().enumerate() {
            let d = Vector2::new((i % 64) as f64 - 20.3, (i / 64) as f64 - 30.6);
            *p = if d.norm() < 8.0 { (96.0 - 8.0 * d.y) as u8 } else { *p + (i % 3) as u8 };
        }
        let view = GreyView::of(&picture);
        let empty = GreyView::of(&still);
        let at = |x: f64, y: f64| change(&view, &empty, &Vector2::new(x, y), 8.0);
        // A bar that passes fills the disc and goes on beyond it.
        let mut barred = still.clone();
        (0..64 * 64).filter(|i| (i % 64) / 16 == 2).for_each(|i| barred.pixels[i] = 20);
        let seen = |picture: &GreyImage, x: f64| {
            let (picture, still, place) = (GreyView::of(picture), GreyView::of(&still), Vector2::new(x, 30.6));
            [change, change_around].map(|of| of(&picture, &still, &place, 8.0).expect("seen"))
        };
        let [ball, bar, nothing] = [seen(&picture, 20.3), seen(&barred, 39.5), seen(&picture, 44.0)];
        assert!(ball[0] > 15.0 && ball[1] < 2.0 && nothing[0] < 2.0 && bar[0] > 60.0 && bar[1] > 0.4 * bar[0], "{ball:?} {bar:?} {nothing:?}");
        assert!(at(20.3, 30.6).is_some_and(|c| c > 15.0) && at(45.0, 30.0).is_some_and(|c| c < 2.0) && at(2.0, 30.0).is_none());
        // A ball that stayed until the clip's middle is in the median picture, and not in the pictures of later frames.
        let places: Vec<Option<Vector2<f64>>> = (0..20).map(|k| (k != 3).then(|| Vector2::new(20.3 + 6.0 * (f64::from(k) - 10.0).max(0.0), 30.6))).collect();
        assert_eq!(elsewhere(&places, 2, 17.0), Some([13, 16, 19]));
        assert!(elsewhere(&places, 3, 17.0).is_none() && elsewhere(&places[..10], 2, 17.0).is_none());
        let with_ball = GreyView::of(&picture);
        assert!(change(&view, &with_ball, &Vector2::new(20.3, 30.6), 8.0).is_some_and(|c| c < 1.0));
        let mut changes = vec![[None, Some(20.0)]; 8];
        changes[5] = [None, Some(1.0)];
        assert_eq!(absent(&changes), [(5, 1, 5.0)]);
    }
}
