//! Global search: which turning rates make the pixels of many frames agree on one set of markings.
//!
//! For a candidate rate all pixels are turned back to one attitude and sorted into cells on the sphere; the variance
//! inside the cells is the cost. Short runs of frames come first: over them the cost has wide valleys, so that a coarse
//! grid cannot miss the right one. The rate is common to all runs, the markings are free in each. Then the runs grow.

use super::shading::Mark;
use super::sphere_map::cube_cell;
use super::view::ViewInfo;
use nalgebra::{Rotation3, Vector3};

/// Cells per edge of a cube's face: 0.22 rad, the width of a blurred line on a ball of 16 px.
const CELLS: usize = 7;
/// Turn at the ends of a run that one grid step may add, rad: half a line's width.
const STEP_RAD: f64 = 0.14;
/// Candidates kept after the coarse grid.
const KEPT: usize = 12;

pub(super) struct Search<'a> {
    marks: &'a [Mark],
    views: &'a [ViewInfo],
    /// Range of `marks` of each view.
    ranges: Vec<std::ops::Range<usize>>,
}

/// A rate, rad/s, with the variance it leaves.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub omega: Vector3<f64>,
    pub cost: f64,
}

impl<'a> Search<'a> {
    /// `marks` must be ordered by view.
    pub fn new(views: &'a [ViewInfo], marks: &'a [Mark]) -> Self {
        let mut ranges = Vec::with_capacity(views.len());
        let mut start = 0;
        for v in 0..views.len() {
            let end = start + marks[start..].iter().take_while(|m| m.view == v).count();
            ranges.push(start..end);
            start = end;
        }
        Search { marks, views, ranges }
    }

    /// Runs of views of about `length_s`, together covering the whole window.
    fn runs(&self, length_s: f64) -> Vec<Vec<usize>> {
        let first = self.views.iter().map(|v| v.time_s).fold(f64::INFINITY, f64::min);
        let last = self.views.iter().map(|v| v.time_s).fold(f64::NEG_INFINITY, f64::max);
        let count = ((last - first) / length_s).round().clamp(1.0, 1000.0) as usize;
        let each = (last - first) / count as f64 * (1.0 + 1e-9) + 1e-12;
        let mut runs = vec![Vec::new(); count];
        for (i, v) in self.views.iter().enumerate() {
            runs[(((v.time_s - first) / each) as usize).min(count - 1)].push(i);
        }
        runs.retain(|r| r.len() >= 2);
        runs
    }

    /// Weighted variance inside the cells, per degree of freedom, over all runs; `every` skips pixels.
    fn cost(&self, omega: &Vector3<f64>, runs: &[Vec<usize>], every: usize) -> f64 {
        let (mut squares, mut freedom) = (0.0, 0.0);
        let mut cells = [(0.0f64, 0.0f64, 0.0f64, 0u32); 6 * CELLS * CELLS];
        for run in runs {
            cells.fill((0.0, 0.0, 0.0, 0));
            let middle = run.iter().map(|&v| self.views[v].time_s).sum::<f64>() / run.len() as f64;
            for &v in run {
                let back = Rotation3::new(-omega * (self.views[v].time_s - middle));
                for m in self.marks[self.ranges[v].clone()].iter().step_by(every) {
                    let c = &mut cells[cube_cell(&(back * m.normal), CELLS)];
                    let wy = m.weight * m.contrast;
                    c.0 += m.weight;
                    c.1 += wy;
                    c.2 += wy * m.contrast;
                    c.3 += 1;
                }
            }
            for &(w, wy, wyy, n) in &cells {
                if n > 1 {
                    squares += wyy - wy * wy / w.max(1e-12);
                    freedom += f64::from(n - 1);
                }
            }
        }
        squares / f64::max(freedom, 1.0)
    }

    /// The best rates below `limit_rad_s`, best first, distinct on the scale the whole window resolves.
    ///
    /// `frame_s` is the time between frames.
    pub fn candidates(&self, frame_s: f64, limit_rad_s: f64) -> Vec<Candidate> {
        let first = self.views.iter().map(|v| v.time_s).fold(f64::INFINITY, f64::min);
        let last = self.views.iter().map(|v| v.time_s).fold(f64::NEG_INFINITY, f64::max);
        let whole = (last - first).max(frame_s);
        let mut length = (4.5 * frame_s).min(whole);
        let runs = self.runs(length);
        let step = 2.0 * STEP_RAD / length;
        let reach = (limit_rad_s / step).ceil() as i64;
        let mut grid = std::collections::BTreeMap::new();
        for i in -reach..=reach {
            for j in -reach..=reach {
                for k in -reach..=reach {
                    let omega = Vector3::new(i as f64, j as f64, k as f64) * step;
                    if omega.norm() <= limit_rad_s {
                        grid.insert((i, j, k), self.cost(&omega, &runs, 2));
                    }
                }
            }
        }
        let mut found: Vec<Candidate> = grid
            .iter()
            .filter(|&(&(i, j, k), &cost)| {
                let around = (-1..=1).flat_map(|a| (-1..=1).flat_map(move |b| (-1..=1).map(move |c| (i + a, j + b, k + c))));
                around.filter_map(|at| grid.get(&at)).all(|&other| cost <= other)
            })
            .map(|(&(i, j, k), &cost)| Candidate { omega: Vector3::new(i as f64, j as f64, k as f64) * step, cost })
            .collect();
        found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        found.truncate(KEPT);
        // Grow the runs; the grid around each candidate shrinks in step.
        let mut last_step = step;
        loop {
            let runs = self.runs(length);
            let step = (2.0 * STEP_RAD / length).min(last_step);
            for c in &mut found {
                *c = self.descend(*c, &runs, step);
            }
            if length >= whole {
                break;
            }
            last_step = step;
            length = (1.8 * length).min(whole);
        }
        found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let apart = 2.0 * STEP_RAD / whole;
        let mut distinct: Vec<Candidate> = Vec::new();
        for c in found {
            if distinct.iter().all(|d| (d.omega - c.omega).norm() > apart) {
                distinct.push(c);
            }
        }
        distinct
    }

    /// Moves to the best of the neighbours (faces of a cube of ±step, then ±step/2) until none is better.
    fn descend(&self, from: Candidate, runs: &[Vec<usize>], step: f64) -> Candidate {
        let mut best = Candidate { omega: from.omega, cost: self.cost(&from.omega, runs, 1) };
        let mut step = step;
        for _ in 0..2 {
            for _ in 0..4 {
                let centre = best.omega;
                for axis in 0..3 {
                    for sign in [-1.0, 1.0] {
                        let mut omega = centre;
                        omega[axis] += sign * step;
                        let cost = self.cost(&omega, runs, 1);
                        if cost < best.cost {
                            best = Candidate { omega, cost };
                        }
                    }
                }
                if best.omega == centre {
                    break;
                }
            }
            step *= 0.5;
        }
        best
    }
}
