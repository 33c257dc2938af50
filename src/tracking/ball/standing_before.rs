//! What stands before the ball: a pole, a post, a hand rail between camera and court.
//!
//! It is in the clip's median picture, and where it is the picture stays as it is while the ball flies past behind it. Half an outline
//! pulls the centre, and a turn is read off an edge that does not turn; so these places say nothing of the ball. A single picture cannot
//! tell them from a ball whose one side is as grey as the wall: asked is which of two levels each place shows that the ball passes, its own
//! or the one that this part of the ball has in the other pictures, and all places near it together.

use crate::calibration::CameraId;
use crate::footage::{GreyImage, GreyView};
use crate::median::upper_median;
use nalgebra::Vector2;

/// Places up to so many radii from the centre are behind what stands there, or before it.
const INSIDE: f64 = 0.85;
/// Around the ball the picture is mostly the median picture's: distances in radii.
const AROUND: [f64; 2] = [1.2, 1.5];
/// Fewest pictures of a camera that tell how the ball looks.
const FEWEST: usize = 8;
/// Parts of the ball along its diameter of which each has a usual level.
const PARTS: usize = 16;
/// Least deviation of a pixel from the median picture, grey levels.
const LEAST_NOISE: f64 = 2.0;
/// What one pixel of one picture may say at most, log-likelihood: lines, strings' shadows and glints are neither level.
const MOST_SAID: f64 = 3.0;
/// Pixels to either side that are asked with a place: a line on the ball is narrower, what hides a ball is not.
const NEAR: usize = 2;
/// Fewest of these that the ball passed, and what they must say together.
const FEWEST_NEAR: usize = 10;
const LEAST_SAID: f64 = 30.0;
/// What stands there hides at least this share of one of the discs: poles before the balls of rendered hard sessions hid 0.52 to 0.80, and where nothing
/// stood dark lines and grey walls made it 0 to 0.19.
const LEAST_SHARE: f64 = 0.3;

/// The ball in one picture.
pub struct Pass<'a> {
    pub camera: CameraId,
    /// Up to [`AROUND`] the ball at least.
    pub picture: GreyView<'a>,
    /// px.
    pub centre: Vector2<f64>,
    pub radius_px: f64,
}

/// Places of either camera's picture at which something stands before the ball.
#[derive(Debug, Clone, Default)]
pub struct StandingBefore {
    regions: [Option<Region>; 2],
}

#[derive(Debug, Clone)]
struct Region {
    /// First column and row.
    corner: (usize, usize),
    width: usize,
    covered: Vec<bool>,
}

impl StandingBefore {
    /// From the pictures of the free ball and the clip's median pictures.
    pub fn of(passes: &[Pass], still: &[Option<GreyImage>; 2]) -> Self {
        let of_camera = |camera: CameraId| {
            let own: Vec<&Pass> = passes.iter().filter(|p| p.camera == camera && (2.5..200.0).contains(&p.radius_px)).collect();
            Region::of(&own, still[camera.index()].as_ref()?)
        };
        StandingBefore { regions: CameraId::BOTH.map(of_camera) }
    }

    /// Whether something stands before the ball at a pixel.
    pub fn covers(&self, camera: CameraId, x: usize, y: usize) -> bool {
        self.regions[camera.index()].as_ref().is_some_and(|r| r.covers(x, y))
    }

    /// The share of a disc that is covered.
    pub fn share(&self, camera: CameraId, centre: &Vector2<f64>, radius_px: f64) -> f64 {
        self.regions[camera.index()].as_ref().map_or(0.0, |region| region.share(centre, radius_px))
    }

    /// Whether nothing stands before the ball in a camera's pictures.
    pub fn is_clear(&self, camera: CameraId) -> bool {
        self.regions[camera.index()].is_none()
    }
}

impl Region {
    fn of(passes: &[&Pass], still: &GreyImage) -> Option<Self> {
        if passes.len() < FEWEST {
            return None;
        }
        let noise = noise(passes, still)?;
        let levels = Levels::of(passes);
        // The part of the picture that the ball passes.
        let inside = passes.iter().flat_map(|p| disc(&p.centre, INSIDE * p.radius_px)).filter(|(x, y)| still.get(*x, *y).is_some());
        let (mut low, mut high) = ((usize::MAX, usize::MAX), (0, 0));
        for (x, y) in inside {
            low = (low.0.min(x), low.1.min(y));
            high = (high.0.max(x), high.1.max(y));
        }
        let (width, height) = ((high.0 + 1).checked_sub(low.0)?, (high.1 + 1).checked_sub(low.1)?);
        let (mut said, mut passed) = (vec![0.0f64; width * height], vec![false; width * height]);
        for pass in passes {
            for (x, y) in disc(&pass.centre, INSIDE * pass.radius_px) {
                let (Some(grey), Some(behind)) = (pass.picture.get(x as i64, y as i64), still.get(x, y)) else { continue };
                let Some((level, scatter)) = levels.at(pass, x, y) else { continue };
                let (grey, at) = (f64::from(grey), (y - low.1) * width + x - low.0);
                let off = |from: f64, sd: f64| ((grey - from) / sd).powi(2);
                said[at] += (0.5 * (off(level, scatter.max(noise)) - off(f64::from(behind), noise))).clamp(-MOST_SAID, MOST_SAID);
                passed[at] = true;
            }
        }
        let near = |x: usize, y: usize, reach: usize| {
            let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
            (y.saturating_sub(reach)..(y + reach + 1).min(height)).flat_map(move |y| columns.clone().map(move |x| y * width + x))
        };
        let told: Vec<bool> = (0..width * height)
            .map(|at| {
                let (count, sum) = near(at % width, at / width, NEAR).filter(|i| passed[*i]).fold((0, 0.0), |(n, s), i| (n + 1, s + said[i]));
                passed[at] && count >= FEWEST_NEAR && sum > LEAST_SAID
            })
            .collect();
        // A pixel beside its edge shows some of it.
        let covered = (0..width * height).map(|at| near(at % width, at / width, 1).any(|i| told[i])).collect();
        let region = Region { corner: low, width, covered };
        passes.iter().any(|p| region.share(&p.centre, INSIDE * p.radius_px) > LEAST_SHARE).then_some(region)
    }

    fn share(&self, centre: &Vector2<f64>, radius_px: f64) -> f64 {
        let (covered, all) = disc(centre, radius_px).fold((0usize, 0usize), |(covered, all), (x, y)| (covered + usize::from(self.covers(x, y)), all + 1));
        covered as f64 / all.max(1) as f64
    }

    fn covers(&self, x: usize, y: usize) -> bool {
        let (Some(x), Some(y)) = (x.checked_sub(self.corner.0), y.checked_sub(self.corner.1)) else { return false };
        x < self.width && self.covered.get(y * self.width + x).is_some_and(|c| *c)
    }
}

/// The usual level and scatter of each part of the ball.
struct Levels(Vec<Option<(f64, f64)>>);

impl Levels {
    fn of(passes: &[&Pass]) -> Self {
        let mut greys: Vec<Vec<f64>> = vec![Vec::new(); PARTS * PARTS];
        for pass in passes {
            for (x, y) in disc(&pass.centre, INSIDE * pass.radius_px) {
                if let Some(grey) = pass.picture.get(x as i64, y as i64) {
                    greys[part(pass, x, y)].push(f64::from(grey));
                }
            }
        }
        let usual = |greys: Vec<f64>| {
            let level = upper_median(greys.iter().copied())?;
            Some((level, upper_median(greys.iter().map(|g| (g - level).abs()))? / 0.6745))
        };
        Levels(greys.into_iter().map(usual).collect())
    }

    fn at(&self, pass: &Pass, x: usize, y: usize) -> Option<(f64, f64)> {
        self.0[part(pass, x, y)]
    }
}

/// Which part of the ball a pixel inside its disc shows.
fn part(pass: &Pass, x: usize, y: usize) -> usize {
    let along = |at: usize, centre: f64| (((at as f64 - centre) / pass.radius_px + 1.0) * 0.5 * PARTS as f64).clamp(0.0, (PARTS - 1) as f64) as usize;
    along(y, pass.centre.y) * PARTS + along(x, pass.centre.x)
}

/// How far a pixel of a picture is from the median picture's, grey levels, one deviation: where the quarter of the pictures say so around which least moves.
fn noise(passes: &[&Pass], still: &GreyImage) -> Option<f64> {
    let around = |pass: &&Pass| {
        let [inner, outer] = AROUND.map(|radii| radii * pass.radius_px);
        let off = disc(&pass.centre, outer).filter(|(x, y)| (Vector2::new(*x as f64, *y as f64) - pass.centre).norm() > inner);
        let off = off.filter_map(|(x, y)| Some((f64::from(pass.picture.get(x as i64, y as i64)?) - f64::from(still.get(x, y)?)).abs()));
        upper_median(off.collect::<Vec<_>>())
    };
    let mut usual: Vec<f64> = passes.iter().filter_map(around).collect();
    usual.sort_by(f64::total_cmp);
    Some((usual.get(usual.len() / 4)? / 0.6745).max(LEAST_NOISE))
}

/// The pixels of a disc that are not left of or above the picture.
fn disc(centre: &Vector2<f64>, radius: f64) -> impl Iterator<Item = (usize, usize)> + use<> {
    let centre = *centre;
    let (from, to) = (centre.add_scalar(-radius), centre.add_scalar(radius));
    let rows = from.y.max(0.0).ceil() as usize..(to.y + 1.0).max(0.0).floor() as usize;
    rows.flat_map(move |y| (from.x.max(0.0).ceil() as usize..(to.x + 1.0).max(0.0).floor() as usize).map(move |x| (x, y)))
        .filter(move |(x, y)| (Vector2::new(*x as f64, *y as f64) - centre).norm_squared() < radius * radius)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footage::GreyImage;

    const SIDE: usize = 120;
    const RADIUS: f64 = 8.4;

    /// A noise of ± 3 grey levels that is the same in no two pictures.
    fn noise(seed: usize, at: usize) -> i32 {
        ((at.wrapping_mul(2_654_435_761) ^ seed.wrapping_mul(40_503)).wrapping_mul(2_246_822_519) >> 13) as i32 % 7 - 3
    }

    /// A lit ball with a dark line that turns, over a wall of 90, behind a pole of 100 at columns `pole`.
    fn picture(k: usize, centre: Option<Vector2<f64>>, pole: std::ops::Range<usize>) -> GreyImage {
        let of = |at: usize| {
            let (x, y) = (at % SIDE, at / SIDE);
            let grey = match centre.map(|c| (Vector2::new(x as f64, y as f64) - c) / RADIUS) {
                _ if pole.contains(&x) => 100,
                Some(d) if d.norm() < 1.0 => {
                    let line = (d.y - 0.8 * (0.4 * k as f64).sin()).abs() < 0.15;
                    if line { 70 } else { (125.0 - 35.0 * d.y) as i32 }
                }
                _ => 90,
            };
            (grey + noise(k, at)).clamp(0, 255) as u8
        };
        GreyImage { width: SIDE, height: SIDE, pixels: (0..SIDE * SIDE).map(of).collect() }
    }

    fn found(pole: std::ops::Range<usize>) -> (StandingBefore, Vec<Vector2<f64>>) {
        let centres: Vec<Vector2<f64>> = (0..24).map(|k| Vector2::new(16.3 + 3.7 * k as f64, 60.0 + 0.4 * k as f64)).collect();
        let pictures: Vec<GreyImage> = centres.iter().enumerate().map(|(k, c)| picture(k, Some(*c), pole.clone())).collect();
        let pass = |(centre, picture)| Pass { camera: CameraId::Left, picture: GreyView::of(picture), centre, radius_px: RADIUS };
        let passes: Vec<Pass> = centres.iter().copied().zip(&pictures).map(pass).collect();
        let still = picture(99, None, pole);
        (StandingBefore::of(&passes, &[Some(still), None]), centres)
    }

    #[test]
    fn truth_a_pole_before_the_ball_is_found_where_the_ball_passed_behind_it() {
        let (standing, centres) = found(50..62);
        assert!(!standing.is_clear(CameraId::Left) && standing.is_clear(CameraId::Right));
        // In the middle of the ball's way: the pole, and a pixel beside it that shows some of it.
        let covered: Vec<usize> = (0..SIDE).filter(|x| standing.covers(CameraId::Left, *x, 65)).collect();
        assert_eq!(covered, (49..63).collect::<Vec<_>>());
        assert!(!standing.covers(CameraId::Left, 55, 20) && !standing.covers(CameraId::Right, 55, 65));
        let shares: Vec<f64> = centres.iter().map(|c| standing.share(CameraId::Left, c, RADIUS)).collect();
        assert!(shares[0] == 0.0 && shares[23] == 0.0 && shares[11] > 0.5, "{shares:?}");
    }

    #[test]
    fn truth_nothing_stands_before_a_ball_whose_dark_side_is_as_grey_as_the_wall() {
        assert!(CameraId::BOTH.iter().all(|c| found(0..0).0.is_clear(*c)));
    }
}
