//! Global search: which turning rates make pictures of the ball agree with each other, some frames apart.
//!
//! A spin turns the disc of one camera by the same rotation between any two of its frames that are as far apart. So for
//! every time apart the squared differences between each place of the earlier disc and each place of the later one
//! are summed over all such pairs of frames once; the cost of a rate is then a look into that table for each place, no
//! matter how many frames there are. Short times come first: over them the cost has wide valleys, so that a coarse
//! lattice cannot miss the right one. What is left is ranked by all pixels together: turned back to one attitude and
//! sorted into cells on the sphere, by the variance inside the cells.

use super::shading::Mark;
use super::view::{USED_RADIUS, ViewInfo};
use crate::calibration::CameraId;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// Cells per edge of the cube around the sphere for the last ranking: 0.14, the width of a blurred line on a ball of 16 px.
const CELLS: usize = 14;
/// Places along the used radius of the disc: 1.3 px on a ball of 16 px, the width of a blurred line.
const PLACES: usize = 5;
/// Side of a square of cells around the whole disc.
const SIDE: usize = 16;
/// Turn over the longest time apart that one lattice step may add, rad: a line's width.
const STEP_RAD: f64 = 0.28;
/// Frames apart at first.
const FIRST_APART: usize = 4;
/// Share of the places that count as unlike whatever they show: a rate that leaves hardly anything to compare is no find.
const UNSEEN: f32 = 0.005;
/// Places of the first lattice that are looked at more closely, kept after it, and at the end.
const HOPEFUL: usize = 700;
const WIDEST: usize = 120;
const KEPT: usize = 40;
/// One pixel in so many is asked while they are improved.
const SOME: usize = 2;
/// Those that are improved before they are ranked for good.
const RANKED: usize = 10;
/// Places of a lattice that a thread takes at a time, and of the last one, whose pixels all are asked.
const AT_ONCE: usize = 64;
const FEW_AT_ONCE: usize = 4;

pub(super) struct Search<'a> {
    views: &'a [ViewInfo],
    frame_s: f64,
    cameras: Vec<OneCamera>,
    /// Largest number of frames apart.
    longest: usize,
    variance: f32,
    middle_s: f64,
    pixels: Pixels,
    /// One in [`SOME`] of them.
    some: Pixels,
}

/// Pixels of all views: where they look and what they show.
struct Pixels {
    /// By view: its pixels.
    of_view: Vec<Range<usize>>,
    normals: [Vec<f32>; 3],
    /// Weight and weight × contrast.
    sums: Vec<[f32; 2]>,
    /// Sum of weight × contrast².
    square: f32,
}

impl Pixels {
    /// One mark in so many; marks stand view by view.
    fn new(views: usize, marks: &[Mark], every: usize) -> Self {
        let mut pixels = Pixels { of_view: Vec::with_capacity(views), normals: Default::default(), sums: Vec::new(), square: 0.0 };
        let mut marks = marks.iter().step_by(every).peekable();
        for view in 0..views {
            let first = pixels.sums.len();
            while let Some(m) = marks.next_if(|m| m.view == view) {
                for (all, n) in pixels.normals.iter_mut().zip(m.normal.iter()) {
                    all.push(*n as f32);
                }
                let weighted = m.weight * m.contrast;
                pixels.sums.push([m.weight as f32, weighted as f32]);
                pixels.square += (weighted * m.contrast) as f32;
            }
            pixels.of_view.push(first..pixels.sums.len());
        }
        pixels
    }
}

/// Cells of a view's pixels, turned by three rows.
struct Places<'a> {
    pixels: &'a Pixels,
    range: Range<usize>,
    rows: &'a [[f32; 3]; 3],
    out: &'a mut Vec<u32>,
}

impl pulp::NullaryFnOnce for Places<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let n = self.range.len();
        let [x, y, z] = self.pixels.normals.each_ref().map(|v| &v[self.range.clone()]);
        self.out.clear();
        self.out.resize(n, 0);
        let (x, y, z, out) = (&x[..n], &y[..n], &z[..n], &mut self.out[..n]);
        let r = self.rows;
        for i in 0..n {
            let place = |k: usize| whole(r[k][0] * x[i] + r[k][1] * y[i] + r[k][2] * z[i] + (0.5 * CELLS as f32 - 0.5));
            out[i] = (place(0) * CELLS as u32 + place(1)) * CELLS as u32 + place(2);
        }
    }
}

/// The pictures of one camera on a common grid over the disc.
struct OneCamera {
    /// The camera's right, down and toward at the middle of the flight.
    axes: Matrix3<f64>,
    /// Directions of the grid's places in those axes.
    places: [Vec<f32>; 3],
    /// Number of the place at each cell of the square, and of what lies on the ball's far side; one beyond the last where there is none.
    number: [u8; SIDE * SIDE + 1],
    /// By frame: contrast and weight at every place.
    frames: BTreeMap<i64, Vec<[f32; 2]>>,
}

/// Sums over all pairs of frames so far apart: squared difference and weight, by earlier and later place. The last column
/// (off the disc) is zero.
struct Apart {
    frames: usize,
    camera: usize,
    sums: Vec<[f32; 2]>,
    weight: f32,
}

/// Which places of a level go on to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Beam {
    /// Those best on it.
    Level,
    /// Half of them, and the best over all levels so far. Over long times a fast rate has few places that are seen twice, and among many
    /// such rates some agree by chance and crowd out the right one; but not on all levels.
    AllLevels,
}

/// A place of a lattice of rates, and the sum of its costs on this and all coarser levels.
#[derive(Clone, Copy)]
struct Place {
    at: [i64; 3],
    so_far: f32,
}

impl<'a> Search<'a> {
    pub fn new(views: &'a [ViewInfo], marks: &[Mark], frame_s: f64) -> Self {
        let cameras: Vec<OneCamera> = CameraId::BOTH.iter().filter_map(|c| OneCamera::new(*c, views, marks, frame_s)).collect();
        let longest = cameras.iter().filter_map(|c| Some((c.frames.keys().last()? - c.frames.keys().next()?) as usize)).max().unwrap_or(0);
        let (sum, weight) = marks.iter().fold((0.0, 1e-12), |(s, w), m| (s + m.weight * m.contrast * m.contrast, w + m.weight));
        let middle_s = views.iter().map(|v| v.time_s).sum::<f64>() / views.len().max(1) as f64;
        let [pixels, some] = [1, SOME].map(|every| Pixels::new(views.len(), marks, every));
        Search { views, frame_s, cameras, longest, variance: (sum / weight) as f32, middle_s, pixels, some }
    }

    fn apart(&self, frames: &BTreeSet<usize>) -> Vec<Apart> {
        let one = |camera: usize, frames: usize| Apart::new(&self.cameras[camera], camera, frames);
        let all: Vec<(usize, usize)> = frames.iter().flat_map(|f| (0..self.cameras.len()).map(move |c| (c, *f))).collect();
        all.into_par_iter().with_max_len(1).map(|(camera, frames)| one(camera, frames)).filter(|a| a.weight > 0.0).collect()
    }

    /// Mean squared difference over all places that are seen twice, with some that are taken for unlike.
    fn cost(&self, omega: &Vector3<f64>, tables: &[Apart]) -> f32 {
        let (mut sum, mut weight, mut most) = (0.0f32, 0.0f32, 0.0f32);
        for t in tables {
            let camera = &self.cameras[t.camera];
            // Right, down and toward the camera are left-handed: there a turn goes the other way.
            let r = turn(&(camera.axes.tr_mul(omega) * (-(t.frames as f64) * self.frame_s)).map(|x| x as f32).into());
            let width = camera.len() + 1;
            let mut cells = [0u32; SIDE * SIDE];
            pulp::Arch::new().dispatch(Turned { places: &camera.places, rows: &r, out: &mut cells });
            for (at, row) in cells.iter().zip(t.sums.chunks_exact(width)) {
                let [square, own] = row[usize::from(camera.number[*at as usize])];
                sum += square;
                weight += own;
            }
            most += t.weight;
        }
        let unseen = UNSEEN * most;
        (sum + unseen * 2.0 * self.variance) / (weight + unseen).max(f32::MIN_POSITIVE)
    }

    /// Variance inside the cells per degree of freedom, all these pixels turned back to one attitude.
    fn spread(&self, omega: &Vector3<f64>, pixels: &Pixels) -> f32 {
        const ALL: usize = CELLS * CELLS * CELLS;
        let mut cells = vec![[0.0f32; 2]; ALL];
        let mut places = Vec::new();
        for (view, range) in self.views.iter().zip(&pixels.of_view) {
            let rows = turn(&(-omega * (view.time_s - self.middle_s)).map(|x| x as f32).into()).map(|row| row.map(|x| x * (0.4999 * CELLS as f32)));
            pulp::Arch::new().dispatch(Places { pixels, range: range.clone(), rows: &rows, out: &mut places });
            for (at, [weight, weighted]) in places.iter().zip(&pixels.sums[range.clone()]) {
                // A direction is a unit vector, so that the place is inside; `min` spares the check.
                let cell = &mut cells[(*at as usize).min(ALL - 1)];
                cell[0] += weight;
                cell[1] += weighted;
            }
        }
        let (mut explained, mut occupied) = (0.0f32, 0usize);
        for &[weight, weighted] in &cells {
            explained += weighted * weighted / weight.max(1e-6);
            occupied += usize::from(weight > 0.0);
        }
        (pixels.square - explained).max(0.0) / (pixels.sums.len().saturating_sub(occupied)).max(1) as f32
    }

    /// The best rates below `limit_rad_s`, best first, distinct on the scale the whole window resolves.
    pub fn candidates(&self, limit_rad_s: f64, beam: Beam) -> Vec<Vector3<f64>> {
        let mut length = FIRST_APART.min(self.longest);
        if length == 0 {
            return Vec::new();
        }
        let mut step = STEP_RAD / (length as f64 * self.frame_s);
        let reach = (limit_rad_s / step).ceil() as i64;
        let rate = |at: &[i64; 3], step: f64| Vector3::new(at[0] as f64, at[1] as f64, at[2] as f64) * step;
        let cube = |reach: i64| (-reach..=reach).flat_map(move |i| (-reach..=reach).flat_map(move |j| (-reach..=reach).map(move |k| [i, j, k])));
        // The best places of a level.
        let best = |places: Vec<Place>, step: f64, apart: &BTreeSet<usize>, kept: usize| {
            let tables = self.apart(apart);
            let cost = |p: Place| {
                let own = self.cost(&rate(&p.at, step), &tables);
                (own, Place { so_far: p.so_far + own, ..p })
            };
            let mut costs: Vec<(f32, Place)> = places.into_par_iter().with_min_len(AT_ONCE).with_max_len(AT_ONCE).map(cost).collect();
            costs.sort_by(|a, b| a.0.total_cmp(&b.0));
            if beam == Beam::AllLevels
                && let Some(others) = costs.get_mut(kept / 2..)
            {
                others.sort_by(|a, b| a.1.so_far.total_cmp(&b.1.so_far));
            }
            costs.into_iter().take(kept).map(|c| c.1).collect::<Vec<_>>()
        };
        let mut places: Vec<Place> = cube(reach).filter(|at| rate(at, step).norm() <= limit_rad_s).map(|at| Place { at, so_far: 0.0 }).collect();
        places = best(places, step, &[length.div_ceil(2), length].into(), HOPEFUL);
        let mut kept = WIDEST;
        // Over a few frames a single line slides along itself, and the cost has long level valleys: so not its minima are
        // kept but a broad beam of places, which longer times thin out while the lattice becomes finer.
        loop {
            places = best(places, step, &(1..=4).map(|k| (k * length).div_ceil(4)).collect(), kept);
            if length >= self.longest {
                break;
            }
            kept = (kept / 2).max(KEPT);
            length = (2 * length).min(self.longest);
            // Half the step, or nearly: the lattice of the last level is a part of the next one.
            step *= 0.5;
            let mut finer: BTreeMap<[i64; 3], f32> = BTreeMap::new();
            for (p, d) in places.iter().flat_map(|p| cube(1).map(move |d| (p, d))) {
                let so_far = finer.entry([0, 1, 2].map(|k| 2 * p.at[k] + d[k])).or_insert(p.so_far);
                *so_far = so_far.min(p.so_far);
            }
            places = finer.into_iter().map(|(at, so_far)| Place { at, so_far }).filter(|p| rate(&p.at, step).norm() <= limit_rad_s).collect();
        }
        let mut ranked: Vec<(Vector3<f64>, f32)> =
            places.par_iter().with_max_len(FEW_AT_ONCE).map(|p| rate(&p.at, step)).map(|omega| (omega, self.spread(&omega, &self.pixels))).collect();
        ranked.sort_by(|a, b| a.1.total_cmp(&b.1));
        let distinct = |found: Vec<(Vector3<f64>, f32)>, apart: f64, most: usize| {
            let mut kept: Vec<(Vector3<f64>, f32)> = Vec::new();
            for c in found {
                if kept.len() < most && kept.iter().all(|k| (k.0 - c.0).norm() > apart) {
                    kept.push(c);
                }
            }
            kept
        };
        let mut ranked: Vec<_> = distinct(ranked, 1.5 * step, RANKED).into_par_iter().with_max_len(1).map(|c| self.descend(c.0, 0.5 * step)).collect();
        ranked.sort_by(|a, b| a.1.total_cmp(&b.1));
        let apart = STEP_RAD / (self.longest as f64 * self.frame_s);
        distinct(ranked, apart, RANKED).into_iter().map(|c| c.0).collect()
    }

    /// Moves to the best of the neighbours (faces of a cube of ±step, then ±step/2) until none is better.
    fn descend(&self, from: Vector3<f64>, step: f64) -> (Vector3<f64>, f32) {
        let mut best = (from, self.spread(&from, &self.some));
        let mut step = step;
        for _ in 0..2 {
            for _ in 0..3 {
                let centre = best.0;
                for axis in 0..3 {
                    for sign in [-1.0, 1.0] {
                        let mut omega = centre;
                        omega[axis] += sign * step;
                        let cost = self.spread(&omega, &self.some);
                        if cost < best.1 {
                            best = (omega, cost);
                        }
                    }
                }
                if best.0 == centre {
                    break;
                }
            }
            step *= 0.5;
        }
        (best.0, self.spread(&best.0, &self.pixels))
    }
}

/// Nearest whole number to a value between 0 and 2^22: the sum's last bits (a cast would have to look for other values).
#[inline(always)]
fn whole(x: f32) -> u32 {
    (x + 8_388_608.0).to_bits() & 0x3f_ffff
}

/// Rotation by a small or large vector (Rodrigues' formula).
fn turn(phi: &[f32; 3]) -> [[f32; 3]; 3] {
    let [x, y, z] = *phi;
    let square = x * x + y * y + z * z;
    let angle = square.sqrt();
    let (s, c) = angle.sin_cos();
    let (a, b) = if angle < 1e-3 { (1.0, 0.5) } else { (s / angle, (1.0 - c) / square) };
    [
        [c + b * x * x, b * x * y - a * z, b * x * z + a * y],
        [b * x * y + a * z, c + b * y * y, b * y * z - a * x],
        [b * x * z - a * y, b * y * z + a * x, c + b * z * z],
    ]
}

/// Cells of the square to the unit of the disc.
const PER_UNIT: f32 = PLACES as f32 / USED_RADIUS as f32;

/// Cell of a place on the disc, in cells from its middle, in the square around it.
#[inline(always)]
fn cell(x: f32, y: f32) -> u32 {
    let at = |v: f32| whole(v + 0.5 * SIDE as f32) & (SIDE as u32 - 1);
    at(y) * SIDE as u32 + at(x)
}

/// Cells of turned places; one beyond the last of those that have turned to the far side.
struct Turned<'a> {
    places: &'a [Vec<f32>; 3],
    rows: &'a [[f32; 3]; 3],
    out: &'a mut [u32; SIDE * SIDE],
}

impl pulp::NullaryFnOnce for Turned<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let [x, y, z] = self.places;
        let n = x.len().min(y.len()).min(z.len()).min(SIDE * SIDE);
        let (x, y, z, out) = (&x[..n], &y[..n], &z[..n], &mut self.out[..n]);
        let [right, down, toward] = *self.rows;
        let r = [right.map(|v| v * PER_UNIT), down.map(|v| v * PER_UNIT), toward];
        for i in 0..n {
            let at = |k: usize| r[k][0] * x[i] + r[k][1] * y[i] + r[k][2] * z[i];
            out[i] = if at(2) > 0.0 { cell(at(0), at(1)) } else { (SIDE * SIDE) as u32 };
        }
    }
}

impl OneCamera {
    /// Places on the grid.
    fn len(&self) -> usize {
        self.places[0].len()
    }

    fn new(camera: CameraId, views: &[ViewInfo], marks: &[Mark], frame_s: f64) -> Option<Self> {
        let own: Vec<&ViewInfo> = views.iter().filter(|v| v.camera == camera).collect();
        let axes = own.get(own.len() / 2)?.axes;
        let spacing = USED_RADIUS / PLACES as f64;
        let mut places: [Vec<f32>; 3] = Default::default();
        let mut number = [u8::MAX; SIDE * SIDE + 1];
        for (i, number) in number.iter_mut().take(SIDE * SIDE).enumerate() {
            let at = |k: usize| (k as f64 - 0.5 * SIDE as f64) * spacing;
            let (x, y) = (at(i % SIDE), at(i / SIDE));
            let q = x * x + y * y;
            if q.sqrt() < USED_RADIUS {
                *number = places[0].len() as u8;
                for (all, v) in places.iter_mut().zip([x, y, (1.0 - q).sqrt()]) {
                    all.push(v as f32);
                }
            }
        }
        let none = places[0].len() as u8;
        number.iter_mut().for_each(|n| *n = (*n).min(none));
        let mut frames: BTreeMap<i64, Vec<[f32; 2]>> = BTreeMap::new();
        for m in marks.iter().filter(|m| views[m.view].camera == camera) {
            let frame = (views[m.view].time_s / frame_s).round() as i64;
            let d = axes.transpose() * m.normal;
            let at = usize::from(number[cell(d.x as f32 * PER_UNIT, d.y as f32 * PER_UNIT) as usize]);
            let places = frames.entry(frame).or_insert_with(|| vec![[0.0; 2]; usize::from(none) + 1]);
            places[at][0] += (m.weight * m.contrast) as f32;
            places[at][1] += m.weight as f32;
        }
        for grid in frames.values_mut() {
            grid.truncate(usize::from(none));
            for [value, weight] in grid {
                *value /= weight.max(1e-6);
            }
        }
        Some(OneCamera { axes, places, number, frames })
    }
}

impl Apart {
    fn new(camera: &OneCamera, at: usize, frames: usize) -> Self {
        let width = camera.len() + 1;
        let mut sums = vec![[0.0f32; 2]; camera.len() * width];
        for (frame, early) in &camera.frames {
            let Some(late) = camera.frames.get(&(frame + frames as i64)) else { continue };
            for (a, row) in early.iter().zip(sums.chunks_exact_mut(width)) {
                for (b, sum) in late.iter().zip(row) {
                    // Two means of many pixels are good to as little as the poorer one.
                    let weight = a[1].min(b[1]);
                    sum[0] += weight * (a[0] - b[0]) * (a[0] - b[0]);
                    sum[1] += weight;
                }
            }
        }
        // As if every place were seen again.
        let weight = sums.iter().map(|s| s[1]).sum::<f32>() / camera.len().max(1) as f32;
        Apart { frames, camera: at, sums, weight }
    }
}
