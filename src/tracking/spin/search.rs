//! Global search: which turning rates make the pixels of many frames agree on one set of markings.
//!
//! For a candidate rate all pixels are turned back to one attitude and sorted into cells on the sphere; the variance
//! inside the cells is the cost. Short runs of frames come first: over them the cost has wide valleys, so that a coarse
//! grid cannot miss the right one. The rate is common to all runs, the markings are free in each. Then the runs grow.

use super::shading::Mark;
use super::view::ViewInfo;
use nalgebra::{Rotation3, Vector3};
use std::collections::BTreeSet;

/// Cells per edge of the cube around the sphere. A slice of 0.22, the width of a blurred line on a ball of 16 px;
/// single precision and no branch per pixel, because this loop is most of the search.
const WIDE: usize = 9;
/// Smaller cells, to rank what the search has found.
const NARROW: usize = 14;
/// Turn at the ends of a run that one grid step may add, rad: half a line's width.
const STEP_RAD: f64 = 0.14;
/// Places kept after the first lattice, and at the end.
const WIDEST: usize = 120;
const KEPT: usize = 12;

pub(super) struct Search<'a> {
    views: &'a [ViewInfo],
    /// Normal, weight, weight × contrast of every pixel, by view.
    pixels: Vec<Vec<Pixel>>,
}

struct Pixel {
    normal: [f32; 3],
    weight: f32,
    weighted: f32,
    /// Weight × contrast².
    square: f32,
}

/// A rate, rad/s, with the variance it leaves.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub omega: Vector3<f64>,
    pub cost: f64,
}

impl<'a> Search<'a> {
    pub fn new(views: &'a [ViewInfo], marks: &[Mark]) -> Self {
        let mut pixels: Vec<Vec<Pixel>> = views.iter().map(|_| Vec::new()).collect();
        for m in marks {
            let weighted = m.weight * m.contrast;
            let [weight, weighted, square] = [m.weight, weighted, weighted * m.contrast].map(|x| x as f32);
            pixels[m.view].push(Pixel { normal: m.normal.map(|x| x as f32).into(), weight, weighted, square });
        }
        Search { views, pixels }
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
    fn cost<const CELLS: usize>(&self, omega: &Vector3<f64>, runs: &[Vec<usize>], every: usize) -> f64 {
        let (mut squares, mut freedom) = (0.0f64, 0.0f64);
        for run in runs {
            let mut cells = vec![[0.0f32; 2]; CELLS * CELLS * CELLS];
            let (mut square, mut count) = (0.0f32, 0usize);
            let middle = run.iter().map(|&v| self.views[v].time_s).sum::<f64>() / run.len() as f64;
            for &v in run {
                let back = Rotation3::new(-omega * (self.views[v].time_s - middle));
                let r: [[f32; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| back[(i, j)] as f32 * (0.4999 * CELLS as f32)));
                let half = 0.5 * CELLS as f32;
                for p in self.pixels[v].iter().step_by(every) {
                    let place = |i: usize| (r[i][0] * p.normal[0] + r[i][1] * p.normal[1] + r[i][2] * p.normal[2] + half) as usize;
                    let at = (place(0) * CELLS + place(1)) * CELLS + place(2);
                    // A direction is a unit vector, so that the place is inside; `min` spares the check.
                    let cell = &mut cells[at.min(CELLS * CELLS * CELLS - 1)];
                    cell[0] += p.weight;
                    cell[1] += p.weighted;
                    square += p.square;
                    count += 1;
                }
            }
            let (mut explained, mut occupied) = (0.0f32, 0usize);
            for &[weight, weighted] in &cells {
                explained += weighted * weighted / weight.max(1e-6);
                occupied += usize::from(weight > 0.0);
            }
            squares += f64::from(square - explained).max(0.0);
            freedom += (count - occupied) as f64;
        }
        squares / freedom.max(1.0)
    }

    /// The best rates below `limit_rad_s`, best first, distinct on the scale the whole window resolves.
    ///
    /// `frame_s` is the time between frames.
    pub fn candidates(&self, frame_s: f64, limit_rad_s: f64) -> Vec<Candidate> {
        let first = self.views.iter().map(|v| v.time_s).fold(f64::INFINITY, f64::min);
        let last = self.views.iter().map(|v| v.time_s).fold(f64::NEG_INFINITY, f64::max);
        let whole = (last - first).max(frame_s);
        let mut length = (4.5 * frame_s).min(whole);
        let mut step = 2.0 * STEP_RAD / length;
        let reach = (limit_rad_s / step).ceil() as i64;
        let rate = |at: &[i64; 3], step: f64| Vector3::new(at[0] as f64, at[1] as f64, at[2] as f64) * step;
        let cube = |reach: i64| (-reach..=reach).flat_map(move |i| (-reach..=reach).flat_map(move |j| (-reach..=reach).map(move |k| [i, j, k])));
        let mut places: BTreeSet<[i64; 3]> = cube(reach).collect();
        let mut kept = WIDEST;
        // Over a few frames a single line slides along itself, and the cost has long level valleys: so not its minima are
        // kept but a broad beam of places, which longer runs thin out while the lattice becomes finer.
        let found = loop {
            let runs = self.runs(length);
            places.retain(|at| rate(at, step).norm() <= limit_rad_s);
            let mut costs: Vec<([i64; 3], f64)> = places.iter().map(|at| (*at, self.cost::<WIDE>(&rate(at, step), &runs, 3))).collect();
            costs.sort_by(|a, b| a.1.total_cmp(&b.1));
            if length >= whole {
                break costs;
            }
            costs.truncate(kept);
            kept = (kept / 2).max(KEPT);
            let next = (2.0 * length).min(whole);
            // Half the step, or nearly: the lattice of the last level is a part of the next one.
            step *= 0.5;
            length = next;
            places = costs.iter().flat_map(|(at, _)| cube(1).map(move |d| [2 * at[0] + d[0], 2 * at[1] + d[1], 2 * at[2] + d[2]])).collect();
        };
        let mut distinct: Vec<Candidate> = Vec::new();
        for (at, cost) in &found {
            let omega = rate(at, step);
            if distinct.iter().all(|d| (d.omega - omega).norm() > 2.5 * step) {
                distinct.push(Candidate { omega, cost: *cost });
            }
            if distinct.len() >= KEPT {
                break;
            }
        }
        let runs = self.runs(whole);
        let mut found: Vec<Candidate> = distinct.iter().map(|c| self.descend(*c, &runs, 0.5 * step)).collect();
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
        let mut best = Candidate { omega: from.omega, cost: self.cost::<NARROW>(&from.omega, runs, 1) };
        let mut step = step;
        for _ in 0..2 {
            for _ in 0..4 {
                let centre = best.omega;
                for axis in 0..3 {
                    for sign in [-1.0, 1.0] {
                        let mut omega = centre;
                        omega[axis] += sign * step;
                        let cost = self.cost::<NARROW>(&omega, runs, 1);
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
