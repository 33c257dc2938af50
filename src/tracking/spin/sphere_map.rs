//! A scalar on the sphere (the ball's markings): values at the corners of cells on a cube's surface, bilinear between.
//!
//! Four values make one place, and a cell's four corners couple with nothing outside it: normal equations are a sum of one
//! 4 × 4 block per cell, however many pixels there are. Every face has its corners for itself, row by row, so that its cells are
//! worked on side by side; what faces share at the cube's edges is made equal.

use crate::tracking::lanes::LANES;
use std::collections::BTreeMap;

/// Cells on the six faces and their corners; holds no values.
pub(super) struct SphereMap {
    /// Cells along a face's edge.
    edge: usize,
    /// Nodes from one row of a face to the next; those beyond its own hold nothing.
    stride: usize,
    /// Nodes that are one corner of the cube's surface, where two faces meet and where three do.
    twins: Vec<[usize; 2]>,
    triplets: Vec<[usize; 3]>,
    /// By node: one, shared out among those that are one corner; nothing beyond a row.
    share: Vec<f32>,
}

/// Places on the map, side by side.
#[derive(Debug, Default)]
pub(super) struct Spots {
    pub cell: Vec<u32>,
    /// Along the cell's two sides, 0 to 1.
    pub at: [Vec<f32>; 2],
}

impl Spots {
    /// Shares of the cell's corners: (0, 0), (1, 0), (0, 1), (1, 1) along its two sides.
    #[inline(always)]
    pub fn weights(&self, i: usize) -> [f32; 4] {
        let (p, q) = (self.at[0][i], self.at[1][i]);
        [(1.0 - p) * (1.0 - q), p * (1.0 - q), (1.0 - p) * q, p * q]
    }

    /// The map's value at every place; by cell its corners' values.
    pub fn values(&self, cells: &[[f32; 4]]) -> Vec<f32> {
        pulp::Arch::new().dispatch(Values { spots: self, cells })
    }
}

/// A direction on the cube's surface.
struct OnCube {
    cell: u32,
    at: [f32; 2],
    /// The other two coordinates over the main one, and d at / d tangent over the main one.
    tangent: [f32; 2],
    slope: [f32; 2],
    /// The main coordinate's sign, negative.
    back: f32,
    main: MainAxis,
}

/// Which coordinate is the largest: the first, else the second, else the third.
#[derive(Clone, Copy)]
struct MainAxis {
    first: bool,
    second: bool,
}

impl MainAxis {
    #[inline(always)]
    fn choose(self, of: [f32; 3]) -> f32 {
        let second_or_third = if self.second { of[1] } else { of[2] };
        if self.first { of[0] } else { second_or_third }
    }
}

impl OnCube {
    /// Where a unit direction points, on `edge` × `edge` cells of each face.
    #[inline(always)]
    fn of(edge: f32, [x, y, z]: [f32; 3]) -> Self {
        let axis = MainAxis { first: (x.abs() >= y.abs()) & (x.abs() >= z.abs()), second: y.abs() >= z.abs() };
        let (main, one, two) = (axis.choose([x, y, z]), axis.choose([y, z, x]), axis.choose([z, x, y]));
        let inverse = 1.0 / main.abs().max(1e-6);
        let half = 0.5 * edge;
        let tangent = [one * inverse, two * inverse];
        let ((u, du), (v, dv)) = (even(tangent[0]), even(tangent[1]));
        let (u, v) = (half * (u + 1.0), half * (v + 1.0));
        let (i, j) = (u.clamp(0.0, edge - 1.0).floor(), v.clamp(0.0, edge - 1.0).floor());
        let (behind, back) = if main < 0.0 { (1.0, 1.0) } else { (0.0, -1.0) };
        // Whole numbers far below 2^24.
        let cell = (((2.0 * axis.choose([0.0, 1.0, 2.0]) + behind) * edge + i) * edge + j) as i32 as u32;
        OnCube { cell, at: [u - i, v - j], tangent, slope: [half * du * inverse, half * dv * inverse], back, main: axis }
    }

    /// Slope of the map along the direction, from the values at the cell's corners.
    #[inline(always)]
    fn gradient(&self, [p, q]: [f32; 2], v: [f32; 4]) -> [f32; 3] {
        let along = [((v[1] - v[0]) * (1.0 - q) + (v[3] - v[2]) * q) * self.slope[0], ((v[2] - v[0]) * (1.0 - p) + (v[3] - v[1]) * p) * self.slope[1]];
        let main = self.back * (along[0] * self.tangent[0] + along[1] * self.tangent[1]);
        [[main, along[1], along[0]], [along[0], main, along[1]], [along[1], along[0], main]].map(|of| self.main.choose(of))
    }
}

/// Spreads the cells of a face evenly over its angles: 4/π atan(a) to 1 %, and its slope.
#[inline(always)]
fn even(a: f32) -> (f32, f32) {
    const C: [f32; 3] = [1.2732, -0.3502, 0.077];
    let a2 = a * a;
    (a * (C[0] + a2 * (C[1] + a2 * C[2])), C[0] + a2 * (3.0 * C[1] + 5.0 * C[2] * a2))
}

impl SphereMap {
    /// A map of `edge` × `edge` cells on each of six faces (`edge` up to 100).
    pub fn new(edge: usize) -> Self {
        let edge = edge.clamp(2, 100);
        let stride = edge.next_multiple_of(LANES) + 1;
        // By their whole coordinates on the cube.
        let mut same: BTreeMap<[usize; 3], Vec<usize>> = BTreeMap::new();
        for face in 0..6 {
            let (axis, main) = (face / 2, if face % 2 == 0 { edge } else { 0 });
            for i in 0..=edge {
                for j in 0..=edge {
                    let mut c = [0; 3];
                    (c[axis], c[(axis + 1) % 3], c[(axis + 2) % 3]) = (main, i, j);
                    same.entry(c).or_default().push((face * (edge + 1) + i) * stride + j);
                }
            }
        }
        let mut share = vec![0.0; 6 * (edge + 1) * stride];
        same.values().flatten().for_each(|node| share[*node] = 1.0);
        same.values().for_each(|nodes| nodes.iter().for_each(|node| share[*node] = 1.0 / nodes.len() as f32));
        let twins = same.values().filter_map(|nodes| nodes.as_slice().try_into().ok()).collect();
        let triplets = same.values().filter_map(|nodes| nodes.as_slice().try_into().ok()).collect();
        SphereMap { edge, stride, twins, triplets, share }
    }

    pub fn nodes(&self) -> usize {
        self.share.len()
    }

    pub fn edge(&self) -> usize {
        self.edge
    }

    pub fn stride(&self) -> usize {
        self.stride
    }

    /// First node of a row of cells, all faces one after the other; the row below begins a stride later.
    #[inline(always)]
    pub fn row(&self, line: usize) -> usize {
        (line / self.edge * (self.edge + 1) + line % self.edge) * self.stride
    }

    pub fn share(&self) -> &[f32] {
        &self.share
    }

    /// Adds what every cell, in order, has for its corners to their nodes.
    pub fn add_cells(&self, cells: &[[f32; 4]], nodes: &mut [f32]) {
        for (line, cells) in cells.chunks_exact(self.edge).enumerate() {
            let row = self.row(line);
            let Some((upper, lower)) = nodes.get_mut(row..row + 2 * self.stride).map(|both| both.split_at_mut(self.stride)) else { continue };
            for (j, cell) in cells.iter().enumerate() {
                upper[j] += cell[0];
                lower[j] += cell[1];
                upper[j + 1] += cell[2];
                lower[j + 1] += cell[3];
            }
        }
        self.join(nodes);
    }

    /// Sums what stands at nodes that are one corner, and puts the sum at all of them.
    #[inline(always)]
    pub fn join(&self, x: &mut [f32]) {
        for [a, b] in &self.twins {
            let sum = x[*a] + x[*b];
            (x[*a], x[*b]) = (sum, sum);
        }
        for [a, b, c] in &self.triplets {
            let sum = x[*a] + x[*b] + x[*c];
            (x[*a], x[*b], x[*c]) = (sum, sum, sum);
        }
    }

    /// The four values of every cell, in order: (0, 0), (1, 0), (0, 1), (1, 1) along its two sides.
    pub fn by_cell(&self, map: &[f32]) -> Vec<[f32; 4]> {
        let mut out = Vec::with_capacity(6 * self.edge * self.edge);
        for line in 0..6 * self.edge {
            let row = self.row(line);
            let (upper, lower) = (&map[row..=row + self.edge], &map[row + self.stride..=row + self.stride + self.edge]);
            out.extend(upper.windows(2).zip(lower.windows(2)).map(|(u, l)| [u[0], l[0], u[1], l[1]]));
        }
        out
    }

    /// Where unit directions, whose coordinates stand in three rows, point; from `first` on.
    pub fn look_up(&self, directions: [&[f32]; 3], first: usize, spots: &mut Spots) {
        pulp::Arch::new().dispatch(LookUp { edge: self.edge as f32, directions, first, spots });
    }

    /// Slopes of the map along such directions, from what every cell holds.
    pub fn gradients(&self, directions: [&[f32]; 3], spots: &Spots, cells: &[[f32; 4]]) -> [Vec<f32>; 3] {
        pulp::Arch::new().dispatch(Gradients { edge: self.edge as f32, directions, spots, cells })
    }
}

struct LookUp<'a> {
    edge: f32,
    directions: [&'a [f32]; 3],
    first: usize,
    spots: &'a mut Spots,
}

impl pulp::NullaryFnOnce for LookUp<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let [x, y, z] = self.directions;
        let n = x.len().min(y.len()).min(z.len());
        let range = self.first..self.first + n;
        let [p, q] = &mut self.spots.at;
        let (cell, p, q) = (&mut self.spots.cell[range.clone()], &mut p[range.clone()], &mut q[range]);
        let (x, y, z, cell, p, q) = (&x[..n], &y[..n], &z[..n], &mut cell[..n], &mut p[..n], &mut q[..n]);
        for i in 0..n {
            let there = OnCube::of(self.edge, [x[i], y[i], z[i]]);
            cell[i] = there.cell;
            [p[i], q[i]] = there.at;
        }
    }
}

/// What the cells of up to [`LANES`] places hold, side by side.
#[inline(always)]
fn gathered(cell: &[u32], cells: &[[f32; 4]]) -> [[f32; LANES]; 4] {
    let mut out = [[0.0f32; LANES]; 4];
    for (lane, at) in cell.iter().take(LANES).enumerate() {
        let v = cells[*at as usize];
        for k in 0..4 {
            out[k][lane] = v[k];
        }
    }
    out
}

struct Values<'a> {
    spots: &'a Spots,
    cells: &'a [[f32; 4]],
}

impl pulp::NullaryFnOnce for Values<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn call(self) -> Vec<f32> {
        let Values { spots, cells } = self;
        let mut out = vec![0.0f32; spots.cell.len()];
        let [p, q] = spots.at.each_ref().map(|v| v.chunks(LANES));
        for (((out, cell), p), q) in out.chunks_mut(LANES).zip(spots.cell.chunks(LANES)).zip(p).zip(q) {
            let v = gathered(cell, cells);
            for (i, ((out, p), q)) in out.iter_mut().zip(p).zip(q).enumerate() {
                let (a, b) = (v[0][i] + p * (v[1][i] - v[0][i]), v[2][i] + p * (v[3][i] - v[2][i]));
                *out = a + q * (b - a);
            }
        }
        out
    }
}

struct Gradients<'a> {
    edge: f32,
    directions: [&'a [f32]; 3],
    spots: &'a Spots,
    cells: &'a [[f32; 4]],
}

impl pulp::NullaryFnOnce for Gradients<'_> {
    type Output = [Vec<f32>; 3];

    #[inline(always)]
    fn call(self) -> [Vec<f32>; 3] {
        let Gradients { edge, directions: [x, y, z], spots, cells } = self;
        let n = spots.cell.len();
        let mut out: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0f32; n]);
        for first in (0..n).step_by(LANES) {
            let range = first..(first + LANES).min(n);
            let v = gathered(&spots.cell[range.clone()], cells);
            let (x, y, z) = (&x[range.clone()], &y[range.clone()], &z[range.clone()]);
            let (p, q) = (&spots.at[0][range.clone()], &spots.at[1][range.clone()]);
            let [ox, oy, oz] = &mut out;
            let (ox, oy, oz) = (&mut ox[range.clone()], &mut oy[range.clone()], &mut oz[range]);
            let m = x.len().min(LANES);
            let (x, y, z, p, q, ox, oy, oz) = (&x[..m], &y[..m], &z[..m], &p[..m], &q[..m], &mut ox[..m], &mut oy[..m], &mut oz[..m]);
            for i in 0..m {
                [ox[i], oy[i], oz[i]] = OnCube::of(edge, [x[i], y[i], z[i]]).gradient([p[i], q[i]], [v[0][i], v[1][i], v[2][i], v[3][i]]);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn directions() -> impl Iterator<Item = Vector3<f32>> {
        (0..500).map(|i| {
            let z = 1.0 - (2.0 * i as f32 + 1.0) / 500.0;
            let (s, c) = (1.7 * i as f32).sin_cos();
            Vector3::new(c * (1.0 - z * z).sqrt(), s * (1.0 - z * z).sqrt(), z)
        })
    }

    fn spots(map: &SphereMap, d: &[Vector3<f32>]) -> Spots {
        let rows = [0, 1, 2].map(|k| d.iter().map(|d| d[k]).collect::<Vec<f32>>());
        let mut spots = Spots { cell: vec![0; d.len()], at: [vec![0.0; d.len()], vec![0.0; d.len()]] };
        map.look_up([&rows[0], &rows[1], &rows[2]], 0, &mut spots);
        spots
    }

    fn values(map: &SphereMap, values: &[f32], d: &[Vector3<f32>]) -> Vec<f32> {
        spots(map, d).values(&map.by_cell(values))
    }

    /// Directions of the nodes, found by the map itself: the mean of where its corners are met.
    fn filled(map: &SphereMap, value: impl Fn(&Vector3<f32>) -> f32) -> Vec<f32> {
        let (mut sums, mut weights) = (vec![0.0; map.nodes()], vec![0.0; map.nodes()]);
        let all: Vec<Vector3<f32>> = (0..400_000)
            .map(|i| {
                let z = 1.0 - (2.0 * i as f32 + 1.0) / 400_000.0;
                let (s, c) = (2.399_963_2 * f64::from(i)).sin_cos();
                Vector3::new(c as f32 * (1.0 - z * z).sqrt(), s as f32 * (1.0 - z * z).sqrt(), z)
            })
            .collect();
        let spots = spots(map, &all);
        let mut of_cells = [vec![[0.0f32; 4]; 6 * map.edge() * map.edge()], vec![[0.0f32; 4]; 6 * map.edge() * map.edge()]];
        for (i, d) in all.iter().enumerate() {
            let cell = spots.cell[i] as usize;
            for (k, w) in spots.weights(i).into_iter().enumerate() {
                of_cells[0][cell][k] += w * w * w * value(d);
                of_cells[1][cell][k] += w * w * w;
            }
        }
        map.add_cells(&of_cells[0], &mut sums);
        map.add_cells(&of_cells[1], &mut weights);
        sums.iter().zip(&weights).map(|(v, w)| if *w > 0.0 { v / w } else { 0.0 }).collect()
    }

    #[test]
    fn truth_the_surface_has_as_many_corners_as_a_cube_and_holds_a_smooth_pattern() {
        let map = SphereMap::new(16);
        assert!((map.share().iter().sum::<f32>() - (6.0 * 16.0 * 16.0 + 2.0)).abs() < 1e-3);
        let pattern = |d: &Vector3<f32>| d.x * d.y + 0.5 * d.z;
        let found = filled(&map, pattern);
        let all: Vec<Vector3<f32>> = directions().collect();
        for (d, got) in all.iter().zip(values(&map, &found, &all)) {
            assert!((got - pattern(d)).abs() < 0.01, "{d:?}: {got}, {}", pattern(d));
        }
    }

    #[test]
    fn truth_slope_equals_central_differences() {
        for edge in [10, 16] {
            let map = SphereMap::new(edge);
            let mut random: Vec<f32> = (0..map.nodes()).map(|i| ((i * i) as f32 * 0.37).sin()).collect();
            map.join(&mut random);
            let all: Vec<Vector3<f32>> = directions().collect();
            let rows = [0, 1, 2].map(|k| all.iter().map(|d| d[k]).collect::<Vec<f32>>());
            let here = spots(&map, &all);
            let slopes = map.gradients([&rows[0], &rows[1], &rows[2]], &here, &map.by_cell(&random));
            let mut compared = 0;
            for axis in 0..3 {
                let moved = |by: f32| {
                    let there: Vec<Vector3<f32>> = all.iter().map(|d| d + Vector3::ith(axis, by)).collect();
                    (spots(&map, &there).cell, values(&map, &random, &there))
                };
                let (a, b) = (moved(2e-3), moved(-2e-3));
                for i in 0..all.len() {
                    if a.0[i] == here.cell[i] && b.0[i] == here.cell[i] {
                        compared += 1;
                        let slope = slopes[axis][i];
                        assert!(((a.1[i] - b.1[i]) / 4e-3 - slope).abs() < 0.03 * (1.0 + slope.abs()), "{:?} {axis}: {slope}", all[i]);
                    }
                }
            }
            assert!(compared > 800, "{compared}");
        }
    }
}
