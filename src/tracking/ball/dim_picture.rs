//! Pictures that use little of the grey scale (a short exposure, flat light), made ready for the search of the ball.
//!
//! A camera that gets a quarter of the light shows a ball that differs from the wall by 6 grey levels instead of 25, while the noise of its
//! electronics stays as it was. The search ([`crate::tracking::ball::ball_search`]) asks for so many grey levels that noise of an ordinary
//! picture does not vote: such a ball has none. Smoothed over 3x3 pixels, of which a ball has hundreds, the noise of a slope is a quarter; then
//! the greys are stretched until noise is what it is in an ordinary picture, as far as the grey scale goes. Places are looked for so; they are
//! measured in the pictures as they are.

use crate::footage::{GreyImage, GreyView};

/// Every so many rows and columns tell the noise and the range of grey.
const STEP: usize = 3;
/// Share of the pixels that may be darker than the range of grey, and brighter.
const BEYOND: f64 = 0.005;
/// The slope's noise after stretching, grey levels over two pixels: in ordinary pictures it is 1.5 to 4.
const NOISE: f64 = 1.8;
/// Smoothing leaves this of a pixel's noise in a slope over two pixels (twelve of the eighteen pixels do not cancel).
const LEFT_IN_SLOPE: f64 = 0.385;
/// Noise of a picture without any, grey levels: rounding to whole ones.
const ROUNDING: f64 = 0.29;
/// Deviation of a pixel over the mean difference of a picture from the median of seven.
const DEVIATION: f64 = 1.14;
/// Grey scale used at most: what is brighter (tape, mostly) is cut off.
const SCALE: f64 = 240.0;
/// Stretched by less it is an ordinary picture.
const LEAST_GAIN: f64 = 1.5;
const MOST_GAIN: f64 = 12.0;

/// How a camera's pictures are stretched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// Grey that becomes black.
    black: f64,
    /// Grey levels to one.
    gain: f64,
}

impl Stretch {
    /// For pictures like this one; `None` where they need none: they use the grey scale, or are as noisy as they could be made.
    pub fn of(image: &GreyView, background: &GreyImage) -> Option<Self> {
        let (mut counts, mut difference, mut n) = ([0u32; 256], 0u64, 0u32);
        for y in (0..image.height.min(background.height)).step_by(STEP) {
            let (row, behind) = (image.row(y)?, background.pixels.get(y * background.width..(y + 1) * background.width)?);
            for (a, b) in row.iter().zip(behind).step_by(STEP) {
                counts[usize::from(*b)] += 1;
                difference += u64::from(a.abs_diff(*b));
                n += 1;
            }
        }
        if n == 0 {
            return None;
        }
        let at_share = |share: f64| {
            let (mut left, least) = (0, (share * f64::from(n)) as u32);
            let reached = |count: &u32| {
                left += count;
                left > least
            };
            counts.iter().position(reached).unwrap_or(255) as f64
        };
        let (black, white) = (at_share(BEYOND), at_share(1.0 - BEYOND));
        let noise = (DEVIATION * difference as f64 / f64::from(n)).hypot(ROUNDING);
        let gain = (NOISE / (LEFT_IN_SLOPE * noise)).min(SCALE / (white - black).max(1.0)).min(MOST_GAIN);
        (gain >= LEAST_GAIN).then_some(Stretch { black, gain })
    }

    /// A whole picture, smoothed and stretched.
    pub fn whole(&self, image: &GreyView) -> Option<GreyImage> {
        self.part(image, (0, 0), (image.width as i64 - 1, image.height as i64 - 1))
    }

    /// A box of a picture (inclusive), smoothed and stretched, as a picture of its own; `None` where not all of it is in memory. At its border
    /// pixels count twice.
    pub fn part(&self, image: &GreyView, (x0, y0): (i64, i64), (x1, y1): (i64, i64)) -> Option<GreyImage> {
        if x1 < x0 || y1 < y0 || !image.contains(x0, y0, x1, y1) {
            return None;
        }
        let (width, height) = ((x1 - x0 + 1) as usize, (y1 - y0 + 1) as usize);
        let mut rows: Vec<&[u8]> = Vec::with_capacity(height);
        for y in y0..=y1 {
            let (first, row) = image.part_of_row(y as usize)?;
            let from = (x0 as usize).checked_sub(first)?;
            rows.push(row.get(from..from + width)?);
        }
        let stretched: Vec<u8> =
            (0..=9 * 255).map(|sum| (self.gain * (f64::from(sum) / 9.0 - self.black) + 0.5 * (255.0 - SCALE)).round().clamp(0.0, 255.0) as u8).collect();
        let mut pixels = Vec::with_capacity(width * height);
        let mut columns = vec![0usize; width];
        for y in 0..height {
            let (above, here, below) = (rows[y.saturating_sub(1)], rows[y], rows[(y + 1).min(height - 1)]);
            for (sum, ((a, h), b)) in columns.iter_mut().zip(above.iter().zip(here).zip(below)) {
                *sum = usize::from(*a) + usize::from(*h) + usize::from(*b);
            }
            let last = width - 1;
            pixels.extend((0..width).map(|x| stretched[columns[x.saturating_sub(1)] + columns[x] + columns[(x + 1).min(last)]]));
        }
        Some(GreyImage { width, height, pixels })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::ball::ball_search::{candidates, candidates_in_dim, nearby, nearby_in_dim};
    use nalgebra::Vector2;
    use rand::{Rng, SeedableRng};

    const SIZE: (usize, usize) = (160, 120);

    /// A wall with a bright board and a dark gap below it; a disc at `centre`, `contrast` brighter than the wall; noise of 1.2 grey levels, all times `gain`.
    fn picture(seed: u64, disc: Option<(f64, f64)>, contrast: f64, gain: f64) -> GreyImage {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut noise = || (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>() * 1.2;
        let pixels = (0..SIZE.0 * SIZE.1)
            .map(|i| {
                let (x, y) = ((i % SIZE.0) as f64, (i / SIZE.0) as f64);
                let wall = if y < 20.0 {
                    190.0
                } else if y < 26.0 {
                    4.0
                } else {
                    80.0
                };
                let inside = disc.map_or(0.0, |(u, v)| (8.5 - (x - u).hypot(y - v)).clamp(0.0, 1.0));
                (gain * (wall + inside * contrast) + noise()).round().clamp(0.0, 255.0) as u8
            })
            .collect();
        GreyImage { width: SIZE.0, height: SIZE.1, pixels }
    }

    #[test]
    fn truth_a_ball_of_five_grey_levels_is_found_in_dim_pictures_where_the_usual_search_has_none() {
        let place = Vector2::new(90.3, 70.6);
        let (ball, empty) = (picture(1, Some((place.x, place.y)), 25.0, 0.2), picture(2, None, 0.0, 0.2));
        let view = GreyView::of(&ball);
        let stretch = Stretch::of(&view, &empty).expect("dim");
        assert!(candidates(&view, &empty, 8.0).is_empty());
        let found = candidates_in_dim(&view, &empty, 8.0, &stretch);
        assert!(found.first().is_some_and(|c| (c.uv - place).norm() < 2.0), "{found:?}");
        let start = Vector2::new(86.0, 73.0);
        let near = nearby_in_dim(&view, start, 8.0, 7, &stretch).expect("inside");
        assert!((near - place).norm() < 2.0 && nearby(&view, start, 8.0, 7).is_some(), "{near}");
        // Where there is none, noise makes none.
        let other = picture(3, None, 0.0, 0.2);
        let none = candidates_in_dim(&GreyView::of(&other), &empty, 8.0, &stretch);
        assert!(none.is_empty(), "{none:?}");
    }

    #[test]
    fn truth_an_ordinary_picture_is_not_stretched() {
        let (ball, empty) = (picture(1, Some((90.3, 70.6)), 25.0, 1.2), picture(2, None, 0.0, 1.2));
        assert_eq!(Stretch::of(&GreyView::of(&ball), &empty), None);
    }

    #[test]
    fn law_a_box_is_as_the_whole_picture_is_there() {
        let image = picture(4, Some((60.0, 60.0)), 25.0, 0.3);
        let (view, stretch) = (GreyView::of(&image), Stretch { black: 20.0, gain: 3.0 });
        let whole = stretch.whole(&view).expect("whole");
        let part = stretch.part(&view, (30, 40), (70, 80)).expect("inside");
        for (y, x) in (41..80).flat_map(|y| (31..70).map(move |x| (y, x))) {
            assert_eq!(part.pixels[(y - 40) * 41 + x - 30], whole.pixels[y * SIZE.0 + x], "{x} {y}");
        }
        assert!(stretch.part(&view, (-1, 0), (5, 5)).is_none() && stretch.part(&view, (9, 9), (8, 12)).is_none());
    }
}
