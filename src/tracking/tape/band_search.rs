//! Every place in a whole picture that looks like tape: bright, with dark on two opposite sides a few pixels away.

use crate::footage::GreyView;
use nalgebra::Vector2;
use std::ops::Range;

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
pub const MOST: usize = 70;

/// Rows scored at once: what belongs to so many stays in the near cache and is the same memory from one stripe to the next.
const STRIPE: usize = 64;
/// A place is the highest of its surroundings, so many pixels in every direction.
pub const AROUND: usize = 2;
/// Nine-pixel sums: less than 4 grey levels of contrast is noise in any camera.
const LEAST: u16 = 9 * 4;

/// Pixels from a place, along its tape, to the least and the farthest that should be dark: from a foreshortened band (0.7 of its length) to the
/// far end of the black.
fn dark_px(px_per_m: f64, white_half_m: f64) -> (f64, f64) {
    (0.75 * white_half_m * px_per_m + 0.8, 2.0 * white_half_m * px_per_m + 1.5)
}

/// Directions in which a line may run, over half a turn: near enough that the places asked lie on it.
const LINE_DIRECTIONS: usize = 16;
/// A line shows this share of a place's contrast on both sides of it, at half of the far end of the black and there: beside a band is the tube's
/// side, before and after it the black.
const LINE_SHARE: f64 = 0.5;

/// Rows and columns beyond a place that are looked at for it, px.
pub fn reach_px(px_per_m: f64, white_half_m: f64) -> f64 {
    dark_px(px_per_m, white_half_m).1.ceil() + 2.0
}

/// Candidates in some columns of more than a contrast, grey levels, strongest first and at most `most`. Where more than half as many lie along lines,
/// longer than any band, those come after all others: a white line of the court has hundreds, all stronger than tape. `px_per_m` is the scale of the
/// picture at the racket; `white_half_m` the expected half length of the white tape.
pub fn candidates(image: &GreyView, columns: Range<usize>, px_per_m: f64, white_half_m: f64, least_contrast: f64, most: usize) -> Vec<BandCandidate> {
    let (w, h) = (image.width, image.rows);
    let (near, far) = dark_px(px_per_m, white_half_m);
    let steps = ((far - near).round() as usize).clamp(2, 6);
    let along = |k: usize| -> Vec<(isize, isize)> {
        let angle = std::f64::consts::PI * k as f64 / DIRECTIONS as f64;
        let at = |i: usize| {
            let d = near + (far - near) * i as f64 / steps as f64;
            ((d * angle.cos()).round() as isize, (d * angle.sin()).round() as isize)
        };
        (0..=steps).map(at).collect()
    };
    let places: Vec<Vec<(isize, isize)>> = (0..DIRECTIONS).map(along).collect();
    let offsets: Vec<Vec<isize>> = places.iter().map(|along| along.iter().map(|(x, y)| y * w as isize + x).collect()).collect();
    let reach = far.ceil() as usize + 1;
    let margin = reach + 1;
    let columns = columns.start.max(margin)..columns.end.min(w.saturating_sub(margin));
    if columns.is_empty() || h <= 2 * margin {
        return Vec::new();
    }
    let least = ((9.0 * least_contrast) as u16).max(LEAST);
    let mut found = pulp::Arch::new().dispatch(Look { image, columns, reach, margin, offsets: &offsets, least }).unwrap_or_default();
    found.sort_by(|a, b| b.0.cmp(&a.0).then((a.2, a.1).cmp(&(b.2, b.1))));
    let found = Lines::new(image, far, &places).last_where_they_crowd(found, most);
    let first_row = Vector2::new(0.0, image.first_row as f64);
    found.into_iter().map(|(s, _, _, at)| BandCandidate { uv: at + first_row, contrast: f64::from(s) / 9.0 }).collect()
}

/// Tells lines from bands.
struct Lines<'a> {
    image: &'a GreyView<'a>,
    /// Steps from a place to those asked, by direction of the line.
    steps: [[(isize, isize); 4]; LINE_DIRECTIONS],
    /// Where the dark is looked for, by direction.
    places: &'a [Vec<(isize, isize)>],
    sums: Sums,
}

impl<'a> Lines<'a> {
    /// `far`: pixels from a place to the far end of the black.
    fn new(image: &'a GreyView<'a>, far: f64, places: &'a [Vec<(isize, isize)>]) -> Self {
        let steps = std::array::from_fn(|k| {
            let (sin, cos) = (std::f64::consts::PI * k as f64 / LINE_DIRECTIONS as f64).sin_cos();
            [0.5, -0.5, 1.0, -1.0].map(|d| ((d * far * cos).round() as isize, (d * far * sin).round() as isize))
        });
        Lines { image, steps, places, sums: Sums::new(2 * far.ceil() as usize) }
    }

    /// The first `most` of these places, strongest first; where more than half as many lie along lines, these after all others.
    fn last_where_they_crowd(mut self, mut places: Vec<Highest>, most: usize) -> Vec<Highest> {
        if self.crowd(&places[..most.min(places.len())], most / 2) {
            let mut others = 0;
            let looked_at = places.iter().map(|place| (self.hold(place), *place)).take_while(|(along, _)| {
                others += usize::from(!along);
                others <= most
            });
            let (along, apart): (Vec<_>, Vec<_>) = looked_at.partition(|(along, _)| *along);
            places = apart.into_iter().chain(along).map(|(_, place)| place).collect();
        }
        places.truncate(most);
        places
    }

    /// Whether more than so many of these places lie along lines.
    fn crowd(&mut self, places: &[Highest], many: usize) -> bool {
        let mut along = 0;
        for (left, place) in (0..places.len()).rev().zip(places) {
            along += usize::from(self.hold(place));
            if along > many || along + left <= many {
                break;
            }
        }
        along > many
    }

    /// Whether a place goes on as such on two opposite sides. What lies beyond the border is taken to go on.
    fn hold(&mut self, (score, x, y, _): &Highest) -> bool {
        let least = (LINE_SHARE * f64::from(*score)) as u16;
        let sum = |(dx, dy): &(isize, isize)| sum_at(self.image, *x as isize + dx, *y as isize + dy);
        let Some(here) = sum(&(0, 0)) else { return false };
        // What is not as bright needs no look at what is dark around it.
        let as_bright = |steps: &&[(isize, isize); 4]| steps.iter().all(|step| sum(step).is_none_or(|sum| sum + least >= here));
        let mut bright = self.steps.iter().filter(as_bright).peekable();
        if bright.peek().is_none() {
            return false;
        }
        self.sums.look(self.image, [*x, *y]);
        let goes_on = |step: &(isize, isize)| self.sums.at(*step).is_none_or(|sum| self.stands_out(*step, sum.checked_sub(least)));
        bright.any(|steps| steps.iter().all(goes_on))
    }

    /// Whether on two opposite sides of a place something is as dark as this, as [`Row::places`] has it; also where the border is too near to tell.
    fn stands_out(&self, (x, y): (isize, isize), dark: Option<u16>) -> bool {
        for along in self.places {
            let mut sides = [u16::MAX; 2];
            for (dx, dy) in along {
                for (side, sign) in sides.iter_mut().zip([1, -1]) {
                    let Some(sum) = self.sums.at((x + sign * dx, y + sign * dy)) else { return true };
                    *side = (*side).min(sum);
                }
            }
            if dark.is_some_and(|dark| sides[0].max(sides[1]) <= dark) {
                return true;
            }
        }
        false
    }
}

/// 3x3 sum around a place; `None` beyond the border.
#[inline]
fn sum_at(image: &GreyView, x: isize, y: isize) -> Option<u16> {
    let (x, y) = (usize::try_from(x - 1).ok()?, usize::try_from(y - 1).ok()?);
    let mut sum = 0;
    for row in y..y + 3 {
        sum += image.row(image.first_row + row)?.get(x..x + 3)?.iter().map(|v| u16::from(*v)).sum::<u16>();
    }
    Some(sum)
}

/// 3x3 sums around a place; memory is used again.
struct Sums {
    reach: usize,
    /// Row by row, [`Self::BEYOND`] where the picture ends.
    sums: Vec<u16>,
    columns: Vec<u16>,
}

impl Sums {
    const BEYOND: u16 = u16::MAX;

    /// `reach` rows and columns to every side.
    fn new(reach: usize) -> Self {
        Sums { reach, sums: Vec::new(), columns: Vec::new() }
    }

    /// Takes the sums around a place.
    fn look(&mut self, image: &GreyView, [x, y]: [usize; 2]) {
        let (reach, side) = (self.reach, 2 * self.reach + 1);
        self.sums.clear();
        self.sums.resize(side * side, Self::BEYOND);
        // Columns of which all three are in the picture.
        let (left, right) = (x.saturating_sub(reach).max(1), (x + reach + 1).min(image.width.saturating_sub(1)));
        if left >= right {
            return;
        }
        for (k, out) in self.sums.chunks_exact_mut(side).enumerate() {
            let Some(above) = (y + k).checked_sub(reach + 1) else { continue };
            let row = |j: usize| image.row(image.first_row + above + j)?.get(left - 1..right + 1);
            let (Some(a), Some(b), Some(c)) = (row(0), row(1), row(2)) else { continue };
            self.columns.clear();
            self.columns.extend(a.iter().zip(b).zip(c).map(|((a, b), c)| u16::from(*a) + u16::from(*b) + u16::from(*c)));
            for (out, three) in out[left + reach - x..].iter_mut().zip(self.columns.windows(3)) {
                *out = three[0] + three[1] + three[2];
            }
        }
    }

    /// The sum so far from the place; `None` beyond the border.
    #[inline]
    fn at(&self, (dx, dy): (isize, isize)) -> Option<u16> {
        let reach = self.reach as isize;
        let sum = self.sums[((dy + reach) * (2 * reach + 1) + dx + reach) as usize];
        (sum != Self::BEYOND).then_some(sum)
    }
}

/// A place that is the highest of its surroundings: its score, column and row, and the scores' centroid.
type Highest = (u16, usize, usize, Vector2<f64>);

/// A look through a whole picture.
struct Look<'a> {
    image: &'a GreyView<'a>,
    columns: Range<usize>,
    reach: usize,
    margin: usize,
    offsets: &'a [Vec<isize>],
    /// Scores up to here are no place's.
    least: u16,
}

impl pulp::NullaryFnOnce for Look<'_> {
    type Output = Option<Vec<Highest>>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Look { image, columns, reach, margin, offsets, least } = self;
        let (w, h) = (image.width, image.rows);
        let mut stripe = Stripe::default();
        let mut found = Vec::new();
        for top in (margin..h - margin).step_by(STRIPE) {
            let end = (top + STRIPE).min(h - margin);
            // The rows next to those asked for are scored as well, and what these look at lies farther out.
            let scored = (top - AROUND).max(margin)..(end + AROUND).min(h - margin);
            stripe.smooth(image, scored.start - reach..scored.end + reach)?;
            stripe.score(w, top - AROUND..end + AROUND, scored, (&columns, reach), (offsets, least));
            for y in top..end {
                stripe.highest(w, &columns, y, least, &mut found);
            }
        }
        Some(found)
    }
}

/// What belongs to some rows of a picture; its memory is used again.
#[derive(Default)]
struct Stripe {
    /// Sums of three rows, by column.
    columns: Vec<u16>,
    /// 3x3 sums from `smooth_from` on.
    smooth: Vec<u16>,
    smooth_from: usize,
    /// Scores from `score_from` on.
    score: Vec<u16>,
    score_from: usize,
    darkest: Darkest,
}

impl Stripe {
    /// 3x3 sums of some rows; the border keeps its nearest inner value.
    #[inline(always)]
    fn smooth(&mut self, image: &GreyView, rows: Range<usize>) -> Option<()> {
        let (w, h) = (image.width, image.rows);
        self.smooth.resize(w * rows.len(), 0);
        self.columns.resize(w, 0);
        self.smooth_from = rows.start;
        for (y, line) in rows.zip(self.smooth.chunks_exact_mut(w)) {
            let [a, b, c] = [y.saturating_sub(1), y, (y + 1).min(h - 1)].map(|r| image.row(image.first_row + r));
            let (a, b, c) = (a?, b?, c?);
            for (sum, ((a, b), c)) in self.columns.iter_mut().zip(a.iter().zip(b).zip(c)) {
                *sum = u16::from(*a) + u16::from(*b) + u16::from(*c);
            }
            let columns = self.columns.iter().zip(&self.columns[1..]).zip(&self.columns[2..]);
            for (sum, ((a, b), c)) in line[1..w - 1].iter_mut().zip(columns) {
                *sum = a + b + c;
            }
            line[0] = line[1];
            line[w - 1] = line[w - 2];
        }
        Some(())
    }

    /// Bright with dark on two opposite sides: by how much, for the rows `scored` of `rows`; zero in the others and beside the columns.
    #[inline(always)]
    fn score(&mut self, w: usize, rows: Range<usize>, scored: Range<usize>, (columns, reach): (&Range<usize>, usize), (offsets, least): (&[Vec<isize>], u16)) {
        // Nothing within reach is darker than the darkest of a box around: most places need no look at all.
        let darkest = self.darkest.around(&self.smooth, w, reach);
        let smooth = &self.smooth;
        self.score.clear();
        self.score.resize(w * rows.len(), 0);
        self.score_from = rows.start;
        for y in scored {
            let (from, to) = ((y - self.smooth_from) * w, (y - rows.start) * w);
            Row { smooth, darkest, from: from + columns.start, offsets, least }.score(&mut self.score[to..][columns.clone()]);
        }
    }

    /// Appends the places of a row that are the highest of their surroundings and above `least`, with the scores' centroid there. Ties go to the first
    /// in reading order.
    #[inline(always)]
    fn highest(&self, w: usize, columns: &Range<usize>, y: usize, least: u16, found: &mut Vec<Highest>) {
        const SIDE: usize = 2 * AROUND + 1;
        let rows: [&[u16]; SIDE] = std::array::from_fn(|j| &self.score[(y + j - AROUND - self.score_from) * w..][..w]);
        let row = rows[AROUND];
        for x in columns.clone() {
            // Most places have a higher neighbour in their own row.
            let s = row[x];
            if s <= least || row[x - 1] >= s || row[x + 1] > s {
                continue;
            }
            let (before, after) = (&rows[..AROUND], &rows[AROUND + 1..]);
            let highest =
                |rows: &[&[u16]], from: usize, to: usize| rows.iter().flat_map(|row| &row[x + from - AROUND..=x + to - AROUND]).copied().fold(0, u16::max);
            let first = s > highest(before, 0, 2 * AROUND) && s > highest(&[row], 0, AROUND - 1);
            if first && s >= highest(after, 0, 2 * AROUND) && s >= highest(&[row], AROUND + 1, 2 * AROUND) {
                let (mut sum, mut at) = (0.0, Vector2::zeros());
                for (j, row) in rows.iter().enumerate() {
                    for (i, score) in row[x - AROUND..][..SIDE].iter().enumerate() {
                        let s = f64::from(*score);
                        sum += s;
                        at += Vector2::new((x + i - AROUND) as f64, (y + j - AROUND) as f64) * s;
                    }
                }
                found.push((s, x, y, at / sum));
            }
        }
    }
}

/// Scores of a row's places, the first of them at `from`.
struct Row<'a> {
    smooth: &'a [u16],
    darkest: &'a [u16],
    from: usize,
    offsets: &'a [Vec<isize>],
    /// Places together none of which is so much brighter than what is around need no score.
    least: u16,
}

impl Row<'_> {
    #[inline(always)]
    fn score(&self, out: &mut [u16]) {
        const WIDE: usize = 32;
        let n = out.len();
        if n < WIDE {
            for x in 0..n {
                self.places::<1>(x).into_iter().for_each(|s| out[x..][..1].copy_from_slice(&s));
            }
            return;
        }
        // The last ones are looked at together with some before them once more.
        for x in (0..n / WIDE).map(|k| k * WIDE).chain([n - WIDE]) {
            if let Some(scores) = self.places::<WIDE>(x) {
                out[x..][..WIDE].copy_from_slice(&scores);
            }
        }
    }

    /// How much brighter `N` places are than the brighter of two darks on opposite sides, in the direction where that is most; zero below
    /// [`LEAST`], `None` where none can be above `least`.
    #[inline(always)]
    fn places<const N: usize>(&self, x: usize) -> Option<[u16; N]> {
        let at = self.from + x;
        let many = |values: &[u16], at: usize| -> [u16; N] { std::array::from_fn(|i| values[at..][..N][i]) };
        let (here, darkest) = (many(self.smooth, at), many(self.darkest, at));
        // A box holds its own middle: what is darkest in it is not brighter.
        if (0..N).all(|i| here[i] - darkest[i] <= self.least) {
            return None;
        }
        let mut dark = [u16::MAX; N];
        for along in self.offsets {
            let mut sides = [[u16::MAX; N]; 2];
            for o in along {
                for (side, offset) in sides.iter_mut().zip([*o, -o]) {
                    let there = many(self.smooth, at.wrapping_add_signed(offset));
                    for i in 0..N {
                        side[i] = side[i].min(there[i]);
                    }
                }
            }
            for i in 0..N {
                dark[i] = dark[i].min(sides[0][i].max(sides[1][i]));
            }
        }
        Some(std::array::from_fn(|i| if here[i] > dark[i] + LEAST { here[i] - dark[i] } else { 0 }))
    }
}

/// Smallest values of boxes; memory is used again.
#[derive(Default)]
struct Darkest {
    out: Vec<u16>,
    runs: Vec<u16>,
    line: Vec<u16>,
}

impl Darkest {
    /// Smallest value within `reach` rows and columns of each place; near the border, of places the box does not wholly cover,
    /// only something not smaller than that.
    #[inline(always)]
    fn around(&mut self, values: &[u16], w: usize, reach: usize) -> &[u16] {
        // Minima over 2, 4, 8, ... neighbours by doubling, then two overlapping runs make the box; rows first, then columns.
        let span = 2 * reach + 1;
        let run = (span / 2 + 1).next_power_of_two().min(span);
        let Darkest { out, runs, line } = self;
        out.clear();
        out.extend_from_slice(values);
        line.resize(w, 0);
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
                for ((a, near), far) in middle.iter_mut().zip(&*line).zip(far) {
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
        runs.clear();
        runs.extend_from_slice(out);
        for y in reach..h.saturating_sub(reach) {
            let (near, far) = (&runs[(y - reach) * w..(y - reach + 1) * w], &runs[(y + reach + 1 - run) * w..(y + reach + 2 - run) * w]);
            for ((a, near), far) in out[y * w..(y + 1) * w].iter_mut().zip(near).zip(far) {
                *a = (*near).min(*far);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_looking_through_every_box() {
        let (w, h) = (61, 47);
        let values: Vec<u16> = (0..w * h).map(|i| (i * 7919 % 2003) as u16).collect();
        for reach in [1, 2, 3, 6, 9, 10] {
            let mut darkest = Darkest::default();
            let fast = darkest.around(&values, w, reach);
            for y in reach..h - reach {
                for x in reach..w - reach {
                    let slow = (y - reach..=y + reach).flat_map(|j| &values[j * w + x - reach..=j * w + x + reach]).min();
                    assert_eq!(Some(&fast[y * w + x]), slow, "{reach}: {x} {y}");
                }
            }
        }
    }

    #[test]
    fn agrees_places_side_by_side_have_the_scores_they_have_alone() {
        let (w, h) = (100, 40);
        let smooth: Vec<u16> = (0..w * h).map(|i| (i * 7919 % 2003) as u16).collect();
        let offsets: Vec<Vec<isize>> =
            [(3, 0), (2, 2), (0, 3), (-2, 2)].map(|(x, y): (isize, isize)| vec![x + y * w as isize, 2 * x + 2 * y * w as isize]).to_vec();
        let (from, darkest) = (20 * w + 8, vec![0; w * h]);
        let row = Row { smooth: &smooth, darkest: &darkest, from, offsets: &offsets, least: LEAST };
        let mut together = vec![0; 84];
        row.score(&mut together);
        for (x, score) in together.iter().enumerate() {
            let dark = |o: &isize, sign: isize| smooth[from.strict_add_signed(x as isize + sign * o)];
            let darker = |along: &Vec<isize>| [1, -1].map(|sign| along.iter().map(|o| dark(o, sign)).min().unwrap_or(0)).into_iter().max();
            let least = offsets.iter().filter_map(darker).min().unwrap_or(0);
            let alone = smooth[from + x].saturating_sub(least);
            assert_eq!(*score, if alone > LEAST { alone } else { 0 }, "{x}");
        }
        assert!(together.iter().any(|s| *s > 0) && together.contains(&0));
    }

    #[test]
    fn agrees_sums_around_a_place_are_those_of_every_place_and_end_where_the_picture_does() {
        let (w, h, reach) = (23, 17, 6);
        let image = crate::footage::GreyImage { width: w, height: h, pixels: (0..w * h).map(|i| (i * 7919 % 251) as u8).collect() };
        let view = GreyView::of(&image);
        let mut sums = Sums::new(reach as usize);
        let mut beyond = 0;
        for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
            sums.look(&view, [x, y]);
            for (dx, dy) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))) {
                let alone = sum_at(&view, x as isize + dx, y as isize + dy);
                assert_eq!(sums.at((dx, dy)), alone, "{x} {y} {dx} {dy}");
                beyond += usize::from(alone.is_none());
            }
        }
        assert!(beyond > 0 && sum_at(&view, 1, 1).is_some() && sum_at(&view, 0, 1).is_none());
    }

    #[test]
    fn truth_columns_that_are_left_out_hold_no_candidate_and_change_no_other() {
        let grey = |x: usize, y: usize| -> u8 {
            let bands = [(60.3, 50.0), (150.0, 80.4)];
            let near = bands.iter().any(|(u, v): &(f64, f64)| (x as f64 - u).abs() < 2.5 && (y as f64 - v).abs() < 3.0);
            if near { 200 } else { 20 + ((x * 31 + y * 17) % 3) as u8 }
        };
        let image = crate::footage::GreyImage { width: 220, height: 120, pixels: (0..220 * 120).map(|i| grey(i % 220, i / 220)).collect() };
        let view = GreyView::of(&image);
        let all = candidates(&view, 0..usize::MAX, 240.0, 0.0125, 0.0, MOST);
        let some = candidates(&view, 100..200, 240.0, 0.0125, 0.0, MOST);
        assert_eq!((all.len(), some.len()), (2, 1), "{all:?} {some:?}");
        // Anywhere on the band: all of it is as bright.
        assert!((some[0].uv - Vector2::new(150.0, 80.4)).norm() < 2.0 && all.iter().any(|c| c.uv == some[0].uv && c.contrast == some[0].contrast));
    }

    #[test]
    fn truth_bands_come_before_places_along_a_line_that_is_stronger() {
        let bands = [(60.3, 50.0), (150.0, 40.4)];
        let grey = |x: usize, y: usize| -> u8 {
            let near = bands.iter().any(|(u, v): &(f64, f64)| (x as f64 - u).abs() < 2.5 && (y as f64 - v).abs() < 3.0);
            let uneven = ((x * 7919 + y * 104_729) % 17) as u8;
            // One runs slantwise below them from border to border, one upright between them.
            let line = (y as f64 - 80.0 - 0.1 * x as f64).abs() < 2.0 || (x.abs_diff(100) < 2 && (15..90).contains(&y));
            match (line, near) {
                (true, _) => 220 + uneven,
                (_, true) => 120,
                _ => 20 + uneven % 3,
            }
        };
        let image = crate::footage::GreyImage { width: 220, height: 120, pixels: (0..220 * 120).map(|i| grey(i % 220, i / 220)).collect() };
        let found = candidates(&GreyView::of(&image), 0..usize::MAX, 240.0, 0.0125, 0.0, 12);
        assert_eq!(found.len(), 12, "the line has its places after them");
        let among_the_first = |(u, v): &(f64, f64)| found[..6].iter().any(|c| (c.uv - Vector2::new(*u, *v)).norm() < 2.5);
        assert!(bands.iter().all(among_the_first), "{found:?}");
    }
}
