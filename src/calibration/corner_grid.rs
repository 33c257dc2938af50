//! The board's corners in a picture, grown from saddle points: from one corner to its neighbours along the edges, and on
//! from there, each where its neighbours say it must be and of the opposite kind (bright and dark sectors swapped).
//!
//! Answers the same for the same picture, takes milliseconds, and tells a picture without a board from a board that is partly
//! hidden. Needs squares of about five pixels or more.

use super::board::Checkerboard;
use super::homography::{homography, mapped};
use super::saddle_points::{Plane, SaddlePoint};
use crate::footage::GreyImage;
use nalgebra::{Matrix2, Point3, Vector2};
use std::collections::{BTreeMap, BTreeSet};

/// What a search for the board ended with.
#[derive(Debug, Clone, PartialEq)]
pub enum GridSearch {
    /// All corners, row by row, to some tenths of a pixel; ends and handedness are not sorted out.
    Complete(Vec<Vector2<f64>>),
    /// The largest part of a grid, or nothing like one (`corners` is 0).
    Partial {
        corners: usize,
        /// The grid runs on across the picture's border.
        cut_by_border: bool,
        /// Its largest part without gaps, as a smaller board (at least 3 by 3), with its corners row by row.
        whole_part: Option<(Checkerboard, Vec<Vector2<f64>>)>,
    },
    /// A whole board, of another number of corners than looked for.
    Another { columns: usize, rows: usize },
}

/// Levels tried: the full picture, then halved ones, on which blur and noise are smaller.
const LEVELS: usize = 4;
/// Starting points tried per level, strongest first.
const STARTS: usize = 400;
/// A neighbour lies along an edge within this angle (cosine of 15 degrees) ...
const ALONG_EDGE: f64 = 0.966;
/// ... its edges run like those of the corner before (cosine of 35 degrees) ...
const SAME_WAY: f64 = 0.82;
/// ... and it is within this factor as strong: light and tilt change little from corner to corner.
const STRENGTH_RATIO: f64 = 12.0;
/// A corner may lie this share of a step from where its neighbours put it.
const OFF_PLACE: f64 = 0.3;
/// Share of the corners from which on the missing ones are looked for one by one.
const NEARLY_ALL: f64 = 0.75;
/// Corners of a part from which on a strongly tilted board is looked for: such boards gave 18 of 54 and more.
const FEWEST_OF_A_PART: usize = 9;
/// Points looked at then, strongest first: a board's are among the strong.
const STRETCHED_POINTS: usize = 600;
/// Starting points of each direction.
const STRETCHED_STARTS: usize = 60;
/// How much the picture is stretched then (the tilt of 66 degrees between 55 and 76), and in how many directions.
const STRETCH: f64 = 2.5;
const STRETCH_TURNS: usize = 8;

/// Corners from which on a whole rectangle is a board: clutter makes smaller ones.
const FEWEST_OF_A_BOARD: usize = 16;

const SIDES: [(i32, i32); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];

/// Searches a picture for the board.
pub fn find_grid(image: &GreyImage, board: &Checkerboard) -> GridSearch {
    let mut best = NOTHING;
    let mut most = 0;
    let mut another = None;
    let mut plane = Some(Plane::of(image));
    let (mut levels, mut uneven) = (Vec::new(), None);
    for _ in 0..LEVELS {
        let Some(level) = plane else { break };
        let points = level.saddle_points();
        match search(&points, STARTS, board, image) {
            GridSearch::Complete(corners) if is_plane(board, &corners) => return GridSearch::Complete(corners),
            GridSearch::Complete(corners) => {
                uneven.get_or_insert(corners);
                most = board.corner_count();
            }
            GridSearch::Another { columns, rows } if columns * rows > most => (another, most) = (Some((columns, rows)), columns * rows),
            GridSearch::Another { .. } => {}
            GridSearch::Partial { corners, .. } if corners <= most => {}
            partial @ GridSearch::Partial { corners, .. } => (best, another, most) = (partial, None, corners),
        }
        plane = level.halved();
        levels.push(points);
    }
    if most >= FEWEST_OF_A_PART
        && let Some(corners) = levels.iter().find_map(|points| foreshortened(points, board, image))
    {
        return GridSearch::Complete(corners);
    }
    // A lens may bend a grid so far.
    if let Some(corners) = uneven {
        return GridSearch::Complete(corners);
    }
    another.map_or(best, |(columns, rows)| GridSearch::Another { columns, rows })
}

/// A board tilted about its diagonal by more than 55 degrees shows its squares as narrow rhombs: the edges that a saddle of the smoothed picture tells, always
/// at right angles, lie 15 degrees and more from theirs, and no neighbour is found. Stretched across the rhombs they are squares again. Tried in
/// several directions, as nobody knows the tilt yet; the points are the same, so it costs little.
fn foreshortened(points: &[SaddlePoint], board: &Checkerboard, image: &GreyImage) -> Option<Vec<Vector2<f64>>> {
    (0..STRETCH_TURNS).find_map(|k| {
        let (s, c) = (k as f64 * std::f64::consts::PI / STRETCH_TURNS as f64).sin_cos();
        let across = Vector2::new(c, s);
        let along = across * across.transpose();
        let (map, back) = (Matrix2::identity() + along * (STRETCH - 1.0), Matrix2::identity() - along * (1.0 - 1.0 / STRETCH));
        let stretched: Vec<SaddlePoint> = points.iter().take(STRETCHED_POINTS).map(|p| p.drawn(&map, &back)).collect();
        match search(&stretched, STRETCHED_STARTS, board, image) {
            GridSearch::Complete(corners) => Some(corners.into_iter().map(|p| back * p).collect()).filter(|corners: &Vec<_>| is_plane(board, corners)),
            _ => None,
        }
    })
}

/// Whether no corner is far from where a plane grid has it.
fn is_plane(board: &Checkerboard, corners: &[Vector2<f64>]) -> bool {
    let allowed = OFF_PLACE * board.smallest_spacing_px(corners);
    homography(&board.corners(), corners).is_some_and(|h| board.corners().iter().zip(corners).all(|(b, p)| (mapped(&h, b.x, b.y) - p).norm() <= allowed))
}

const NOTHING: GridSearch = GridSearch::Partial { corners: 0, cut_by_border: false, whole_part: None };

fn search(points: &[SaddlePoint], starts: usize, board: &Checkerboard, image: &GreyImage) -> GridSearch {
    let mut best: Option<Grid> = None;
    let mut most = 3; // fewer than four corners are no grid
    let mut tried = BTreeSet::new();
    for start in 0..points.len().min(starts) {
        if tried.contains(&start) {
            continue;
        }
        let grid = Grid::grown(points, start, board);
        if grid.cells.len() > 3 {
            tried.extend(grid.cells.values().map(|c| c.point));
        }
        if grid.cells.len() <= most {
            continue;
        }
        most = grid.cells.len();
        if let Some(corners) = grid.board(board) {
            return GridSearch::Complete(corners);
        }
        best = Some(grid);
    }
    let Some(grid) = best else { return NOTHING };
    let (whole_part, cut_by_border) = (grid.whole_part(board.square_m), !grid.spans(board) && grid.cut_by_border(image));
    match &whole_part {
        // A whole rectangle, nothing beside it and the picture going on around it.
        Some((whole, _)) if most >= FEWEST_OF_A_BOARD && whole.corner_count() == most && !cut_by_border => {
            GridSearch::Another { columns: whole.columns.max(whole.rows), rows: whole.columns.min(whole.rows) }
        }
        _ => GridSearch::Partial { corners: most.min(board.corner_count()), cut_by_border, whole_part },
    }
}

/// A corner with its place on the grid.
#[derive(Debug, Clone, Copy)]
struct Cell {
    point: usize,
    /// Edges toward growing first and second grid number.
    along: [Vector2<f64>; 2],
}

struct Grid<'a> {
    points: &'a [SaddlePoint],
    cells: BTreeMap<(i32, i32), Cell>,
}

impl<'a> Grid<'a> {
    fn grown(points: &'a [SaddlePoint], start: usize, board: &Checkerboard) -> Self {
        let first = Cell { point: start, along: points[start].edges };
        let mut grid = Grid { points, cells: BTreeMap::from([((0, 0), first)]) };
        let mut used = BTreeSet::from([start]);
        // A board's grid cannot be longer than this; clutter that repeats must not run on.
        let reach = board.columns.max(board.rows) as i32 + 1;
        let mut grew = true;
        while grew {
            grew = false;
            for at in grid.cells.keys().copied().collect::<Vec<_>>() {
                for side in SIDES {
                    let next = (at.0 + side.0, at.1 + side.1);
                    if next.0.abs() > reach || next.1.abs() > reach || grid.cells.contains_key(&next) {
                        continue;
                    }
                    if let Some(cell) = grid.neighbour(at, side).filter(|c| !used.contains(&c.point)) {
                        used.insert(cell.point);
                        grid.cells.insert(next, cell);
                        grew = true;
                    }
                }
            }
        }
        grid
    }

    fn place(&self, at: (i32, i32)) -> Option<Vector2<f64>> {
        self.cells.get(&at).map(|c| self.points[c.point].at)
    }

    /// The step to the neighbour, from neighbours that are known already.
    fn step(&self, at: (i32, i32), side: (i32, i32)) -> Option<Vector2<f64>> {
        let here = self.place(at)?;
        if let Some(before) = self.place((at.0 - side.0, at.1 - side.1)) {
            return Some(here - before);
        }
        [(side.1, side.0), (-side.1, -side.0)].into_iter().find_map(|across| {
            let beside = (at.0 + across.0, at.1 + across.1);
            Some(self.place((beside.0 + side.0, beside.1 + side.1))? - self.place(beside)?)
        })
    }

    fn neighbour(&self, at: (i32, i32), side: (i32, i32)) -> Option<Cell> {
        let cell = self.cells.get(&at)?;
        let here = &self.points[cell.point];
        let direction = if side.0 != 0 { cell.along[0] * f64::from(side.0) } else { cell.along[1] * f64::from(side.1) };
        let step = self.step(at, side);
        let mut nearest: Option<(f64, Cell)> = None;
        for (i, p) in self.points.iter().enumerate() {
            let d = p.at - here.at;
            let distance = match step {
                Some(step) => {
                    let off = (d - step).norm();
                    if off > OFF_PLACE * step.norm() {
                        continue;
                    }
                    off
                }
                None => {
                    let length = d.norm();
                    if length < 3.0 || d.dot(&direction) < ALONG_EDGE * length {
                        continue;
                    }
                    length
                }
            };
            if nearest.as_ref().is_some_and(|n| n.0 <= distance) || p.strength > STRENGTH_RATIO * here.strength || here.strength > STRENGTH_RATIO * p.strength {
                continue;
            }
            let Some(along) = oriented(p, &cell.along) else { continue };
            if p.bright_towards(along[0] + along[1]) != here.bright_towards(cell.along[0] + cell.along[1]) {
                nearest = Some((distance, Cell { point: i, along }));
            }
        }
        nearest.map(|n| n.1)
    }

    /// The board's corners row by row, when the grid holds all of them, or all but a few that are found where they must be.
    fn board(&self, board: &Checkerboard) -> Option<Vec<Vector2<f64>>> {
        let range = |k: fn(&(i32, i32)) -> i32| Some((self.cells.keys().map(k).min()?, self.cells.keys().map(k).max()?));
        let ((i0, i1), (j0, j1)) = (range(|c| c.0)?, range(|c| c.1)?);
        let (columns, rows) = (board.columns as i32, board.rows as i32);
        let mut best: Option<(usize, f64, Vec<(i32, i32)>)> = None;
        let mut ties = 0;
        for (first, second, swapped) in [(columns, rows, false), (rows, columns, true)] {
            if swapped && columns == rows {
                continue;
            }
            for i in i0.min(i1 + 1 - first)..=(i1 + 1 - first).max(i0) {
                for j in j0.min(j1 + 1 - second)..=(j1 + 1 - second).max(j0) {
                    let places: Vec<(i32, i32)> =
                        (0..rows).flat_map(|r| (0..columns).map(move |c| if swapped { (i + r, j + c) } else { (i + c, j + r) })).collect();
                    let inside: Vec<&Cell> = places.iter().filter_map(|p| self.cells.get(p)).collect();
                    let strength: f64 = inside.iter().map(|c| self.points[c.point].strength.ln()).sum();
                    let better = best.as_ref().map_or(std::cmp::Ordering::Greater, |b| inside.len().cmp(&b.0));
                    ties = if better.is_gt() { 1 } else { ties + usize::from(better.is_eq()) };
                    if better.is_gt() || better.is_eq() && best.as_ref().is_some_and(|b| strength > b.1) {
                        best = Some((inside.len(), strength, places));
                    }
                }
            }
        }
        let (found, _, places) = best?;
        let all = board.corner_count();
        if ties > 1 || (found as f64) < NEARLY_ALL * all as f64 {
            return None; // which of the grid's corners are the board's would be a guess
        }
        let found: Vec<Option<Vector2<f64>>> = places.iter().map(|p| self.place(*p)).collect();
        if found.iter().all(Option::is_some) {
            return found.into_iter().collect();
        }
        self.completed(board, &found)
    }

    /// The largest rectangle without gaps.
    fn whole_part(&self, square_m: f64) -> Option<(Checkerboard, Vec<Vector2<f64>>)> {
        let mut best: Option<(usize, [i32; 4])> = None;
        for &(i0, j0) in self.cells.keys() {
            let mut longest = i32::MAX;
            for j in j0.. {
                let length = (i0..).take_while(|i| self.cells.contains_key(&(*i, j))).count() as i32;
                longest = longest.min(length);
                let rows = j - j0 + 1;
                if longest < 3 {
                    break;
                }
                let size = (longest * rows) as usize;
                if rows >= 3 && best.is_none_or(|b| size > b.0) {
                    best = Some((size, [i0, j0, longest, rows]));
                }
            }
        }
        let (_, [i0, j0, columns, rows]) = best?;
        let corners = (j0..j0 + rows).flat_map(|j| (i0..i0 + columns).map(move |i| (i, j))).map(|at| self.place(at)).collect::<Option<Vec<_>>>()?;
        Some((Checkerboard { columns: columns as usize, rows: rows as usize, square_m }, corners))
    }

    /// Missing corners, where a plane grid through the others puts them and a saddle is near.
    fn completed(&self, board: &Checkerboard, found: &[Option<Vector2<f64>>]) -> Option<Vec<Vector2<f64>>> {
        let (points, pixels): (Vec<Point3<f64>>, Vec<Vector2<f64>>) = board.corners().iter().zip(found).filter_map(|(b, p)| Some((*b, (*p)?))).unzip();
        let h = homography(&points, &pixels)?;
        let at = |p: Point3<f64>| mapped(&h, p.x, p.y);
        board
            .corners()
            .iter()
            .zip(found)
            .map(|(b, seen)| {
                seen.or_else(|| {
                    let must = at(*b);
                    let step =
                        (at(Point3::new(b.x + board.square_m, b.y, 0.0)) - must).norm().min((at(Point3::new(b.x, b.y + board.square_m, 0.0)) - must).norm());
                    let near = |p: &&SaddlePoint| (p.at - must).norm() < OFF_PLACE * step;
                    self.points.iter().filter(near).map(|p| p.at).min_by(|a, b| (a - must).norm().total_cmp(&(b - must).norm()))
                })
            })
            .collect()
    }

    /// Whether it is as long and as wide as the board, so that what it lacks is inside the picture.
    fn spans(&self, board: &Checkerboard) -> bool {
        let length = |of: fn(&(i32, i32)) -> i32| {
            let (least, most) = self.cells.keys().map(of).fold((i32::MAX, i32::MIN), |(least, most), k| (least.min(k), most.max(k)));
            (most - least + 1).max(0) as usize
        };
        let (i, j) = (length(|c| c.0), length(|c| c.1));
        i >= board.columns && j >= board.rows || i >= board.rows && j >= board.columns
    }

    /// Whether a next corner would lie outside the picture.
    fn cut_by_border(&self, image: &GreyImage) -> bool {
        self.cells.keys().any(|&at| {
            SIDES.iter().any(|&side| {
                let next = (at.0 + side.0, at.1 + side.1);
                let (Some(here), Some(before)) = (self.place(at), self.place((at.0 - side.0, at.1 - side.1))) else { return false };
                let p = here * 2.0 - before;
                let inside = p.x > 2.0 && p.y > 2.0 && p.x < image.width as f64 - 3.0 && p.y < image.height as f64 - 3.0;
                !inside && !self.cells.contains_key(&next)
            })
        })
    }
}

/// The point's edges in the order and sense of its neighbour's; `None` where they do not run the same way.
fn oriented(p: &SaddlePoint, along: &[Vector2<f64>; 2]) -> Option<[Vector2<f64>; 2]> {
    let fit = |a: &Vector2<f64>, b: &Vector2<f64>| a.dot(&along[0]).abs().min(b.dot(&along[1]).abs());
    let [a, b] = p.edges;
    let (a, b) = if fit(&a, &b) >= fit(&b, &a) { (a, b) } else { (b, a) };
    (fit(&a, &b) >= SAME_WAY).then(|| [a * a.dot(&along[0]).signum(), b * b.dot(&along[1]).signum()])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A board drawn with four samples a pixel side, cut off at the picture's border.
    fn drawn(board: &Checkerboard, width: usize, height: usize, along: Vector2<f64>, down: Vector2<f64>, origin: Vector2<f64>) -> GreyImage {
        let back = nalgebra::Matrix2::from_columns(&[along, down]).try_inverse().expect("regular");
        let mut pixels = vec![0u8; width * height];
        for (i, p) in pixels.iter_mut().enumerate() {
            let mut sum = 0.0;
            for k in 0..16 {
                let at = Vector2::new((i % width) as f64 + (k % 4) as f64 / 4.0 - 0.375, (i / width) as f64 + (k / 4) as f64 / 4.0 - 0.375);
                let s = back * (at - origin);
                let on = s.x > -1.6 && s.y > -1.6 && s.x < board.columns as f64 + 0.6 && s.y < board.rows as f64 + 0.6;
                let square = s.x > -1.0 && s.y > -1.0 && s.x < board.columns as f64 && s.y < board.rows as f64;
                let dark = square && (s.x.floor() as i64 + s.y.floor() as i64).rem_euclid(2) == 0;
                sum += if !on {
                    30.0
                } else if dark {
                    15.0
                } else {
                    170.0
                };
            }
            // Grain that repeats with no square's period.
            *p = (sum / 16.0 + ((i * 7919) % 7) as f64).round() as u8;
        }
        GreyImage { width, height, pixels }
    }

    #[test]
    fn truth_a_drawn_board_is_found_whole_at_any_turn() {
        let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
        for k in 0..12 {
            let (s, c) = (0.52 * k as f64).sin_cos();
            let (along, down) = (Vector2::new(11.0 * c, 11.0 * s), Vector2::new(-7.0 * s + 2.0 * c, 7.0 * c + 2.0 * s));
            let origin = Vector2::new(128.0, 120.0) - along * 4.0 - down * 2.5;
            let GridSearch::Complete(corners) = find_grid(&drawn(&board, 256, 240, along, down, origin), &board) else { panic!("turn {k}") };
            let truth: Vec<_> = (0..54).map(|i| origin + along * (i % 9) as f64 + down * (i / 9) as f64).collect();
            let off = |order: &[Vector2<f64>]| order.iter().zip(&truth).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            let found = board.right_handed(corners);
            let off = off(&found).min(off(&board.turned(&found, 1)));
            assert!(off < 0.5, "turn {k}: {off}");
        }
    }

    #[test]
    fn truth_a_board_tilted_about_its_diagonal_is_found_whole() {
        let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
        // Seen under 59 to 73 degrees: rhombs whose sides meet at 54 to 33 degrees, turned in the picture.
        for (k, half) in [0.47f64, 0.41, 0.35, 0.29].into_iter().flat_map(|half| (0..6).map(move |k| (k, half))) {
            let turn = 0.26 + 0.52 * k as f64;
            let at = |angle: f64| Vector2::new(18.0 * angle.cos(), 18.0 * angle.sin());
            let (along, down) = (at(turn - half), at(turn + half));
            let origin = Vector2::new(170.0, 165.0) - along * 4.0 - down * 2.5;
            let GridSearch::Complete(corners) = find_grid(&drawn(&board, 340, 330, along, down, origin), &board) else { panic!("{half} rad, turn {k}") };
            let truth: Vec<_> = (0..54).map(|i| origin + along * (i % 9) as f64 + down * (i / 9) as f64).collect();
            let found = board.right_handed(corners);
            let off = |order: &[Vector2<f64>]| order.iter().zip(&truth).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            let off = off(&found).min(off(&board.turned(&found, 1)));
            assert!(off < 1.0, "{half} rad, turn {k}: {off}");
        }
    }

    #[test]
    fn fails_a_board_with_a_hand_before_it_near_the_border_is_not_cut_by_it() {
        let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
        let (along, down) = (Vector2::new(12.0, 1.0), Vector2::new(-1.0, 12.0));
        // The squares of the last column run out of the picture, its corners do not.
        let mut image = drawn(&board, 256, 240, along, down, Vector2::new(153.0, 80.0));
        for y in 97..132 {
            image.pixels[y * 256 + 190..y * 256 + 225].fill(90);
        }
        let GridSearch::Partial { corners, cut_by_border, .. } = find_grid(&image, &board) else { panic!("whole") };
        assert!(corners > 20 && !cut_by_border, "{corners} {cut_by_border}");
    }

    #[test]
    fn fails_a_cut_board_and_an_empty_picture_are_told_apart() {
        let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
        let (along, down) = (Vector2::new(12.0, 1.0), Vector2::new(-1.0, 12.0));
        let cut = drawn(&board, 256, 240, along, down, Vector2::new(190.0, 80.0));
        assert!(matches!(find_grid(&cut, &board), GridSearch::Partial { corners, cut_by_border: true, whole_part: Some(_) } if corners >= 24));
        let empty = GreyImage { width: 256, height: 240, pixels: vec![80; 256 * 240] };
        assert_eq!(find_grid(&empty, &board), NOTHING);
        // A larger board than the one asked for is not taken for it.
        let other = Checkerboard { columns: 12, rows: 9, square_m: 0.06 };
        let image = drawn(&other, 256, 240, along, down, Vector2::new(60.0, 70.0));
        assert!(matches!(find_grid(&image, &other), GridSearch::Complete(_)));
        assert_eq!(find_grid(&image, &board), GridSearch::Another { columns: 12, rows: 9 });
        assert_eq!(find_grid(&image, &Checkerboard { columns: 13, rows: 9, square_m: 0.06 }), GridSearch::Another { columns: 12, rows: 9 });
    }
}
