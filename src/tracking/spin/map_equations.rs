//! The map's normal equations with their prior, a block per cell, solved by conjugate gradients on the map alone.

use super::sphere_map::{SphereMap, Spots};
use crate::tracking::lanes::LANES;

/// Prior of the map: precision of one value, and of the difference of two neighbours, in units of 1 / variance of the contrast.
const VALUE_PRECISION: f32 = 0.3;
const DIFFERENCE_PRECISION: f32 = 4.0;

pub(super) struct MapEquations<'m> {
    map: &'m SphereMap,
    /// The upper triangles of the cells' blocks, row by row; of each entry those of a face's row of cells side by side.
    blocks: [Vec<f32>; 10],
    /// One over the diagonal.
    inverse: Vec<f32>,
    pub right: Vec<f32>,
}

/// One cell's block as it is summed up.
type Block = [f32; 16];

impl<'m> MapEquations<'m> {
    /// Of pixels at these places with these values (contrast) and weights; `variance` is the contrast's.
    pub fn new(map: &'m SphereMap, spots: &Spots, values: &[f32], weights: &[f32], variance: f32) -> Self {
        // A node belongs to four cells, an edge to two.
        let (value, difference) = (0.25 * VALUE_PRECISION / variance, 0.5 * DIFFERENCE_PRECISION / variance);
        let own = value + 2.0 * difference;
        let bare: Block = {
            let d = -difference;
            [own, d, d, 0.0, d, own, 0.0, d, d, 0.0, own, d, 0.0, d, d, own]
        };
        let (edge, row) = (map.edge(), map.stride() - 1);
        let mut sums = vec![bare; 6 * edge * edge];
        pulp::Arch::new().dispatch(SumUp { sums: &mut sums, spots, weights });
        let mut blocks: [Vec<f32>; 10] = std::array::from_fn(|_| vec![0.0; 6 * edge * row]);
        for (all, k) in blocks.iter_mut().zip([0, 1, 2, 3, 5, 6, 7, 10, 11, 15]) {
            for (line, cells) in all.chunks_exact_mut(row).zip(sums.chunks_exact(edge)) {
                line.iter_mut().zip(cells).for_each(|(entry, cell)| *entry = cell[k]);
            }
        }
        let mut diagonal = vec![0.0; map.nodes()];
        map.add_cells(&sums.iter().map(|b| [b[0], b[5], b[10], b[15]]).collect::<Vec<_>>(), &mut diagonal);
        let inverse = diagonal.iter().map(|d| if *d > 0.0 { d.recip() } else { 0.0 }).collect();
        MapEquations { map, blocks, inverse, right: right_of(map, spots, values, weights) }
    }

    /// Improves a map by so many rounds at most.
    pub fn solve(&self, right: &[f32], x: &mut [f32], rounds: usize) {
        pulp::Arch::new().dispatch(ConjugateGradients { equations: self, right, x, rounds });
    }

    /// Normal equations times `x`.
    #[inline(always)]
    fn apply(&self, x: &[f32], out: &mut [f32]) {
        let (edge, stride) = (self.map.edge(), self.map.stride());
        let row = stride - 1;
        out.fill(0.0);
        for line in 0..6 * edge {
            let node = self.map.row(line);
            for first in (0..row).step_by(LANES) {
                let cells = line * row + first;
                let b = |k: usize| lanes(&self.blocks[k], cells);
                let (at, below) = (node + first, node + first + stride);
                let (p, q, r, s) = (lanes(x, at), lanes(x, below), lanes(x, at + 1), lanes(x, below + 1));
                let four = [[b(0), b(1), b(2), b(3)], [b(1), b(4), b(5), b(6)], [b(2), b(5), b(7), b(8)], [b(3), b(6), b(8), b(9)]];
                for (b, to) in four.iter().zip([at, below, at + 1, below + 1]) {
                    let Some(out) = out.get_mut(to..to + LANES) else { continue };
                    for l in 0..LANES {
                        out[l] += b[0][l] * p[l] + b[1][l] * q[l] + b[2][l] * r[l] + b[3][l] * s[l];
                    }
                }
            }
        }
        self.map.join(out);
    }
}

#[inline(always)]
fn lanes(x: &[f32], at: usize) -> &[f32; LANES] {
    x.get(at..).and_then(|x| x.first_chunk()).unwrap_or(&[0.0; LANES])
}

/// Sum of products over the map's corners.
#[inline(always)]
fn dot(a: &[f32], b: &[f32], share: &[f32]) -> f32 {
    let mut sums = [0.0f32; LANES];
    let (a16, b16, s16) = (a.chunks_exact(LANES), b.chunks_exact(LANES), share.chunks_exact(LANES));
    let rest: f32 = a16.remainder().iter().zip(b16.remainder()).zip(s16.remainder()).map(|((x, y), s)| x * y * s).sum();
    for ((x, y), s) in a16.zip(b16).zip(s16) {
        for l in 0..LANES {
            sums[l] += x[l] * y[l] * s[l];
        }
    }
    sums.iter().sum::<f32>() + rest
}

/// The right-hand side of values at pixels.
pub(super) fn right_of(map: &SphereMap, spots: &Spots, values: &[f32], weights: &[f32]) -> Vec<f32> {
    let mut sums = vec![[0.0f32; 4]; 6 * map.edge() * map.edge()];
    pulp::Arch::new().dispatch(SumRight { sums: &mut sums, spots, values, weights });
    let mut right = vec![0.0; map.nodes()];
    map.add_cells(&sums, &mut right);
    right
}

struct ConjugateGradients<'a> {
    equations: &'a MapEquations<'a>,
    right: &'a [f32],
    x: &'a mut [f32],
    rounds: usize,
}

impl pulp::NullaryFnOnce for ConjugateGradients<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let ConjugateGradients { equations, right, x, rounds } = self;
        let (share, inverse) = (equations.map.share(), equations.inverse.as_slice());
        let n = x.len().min(right.len()).min(inverse.len());
        let mut image = vec![0.0f32; n];
        equations.apply(x, &mut image);
        let mut residual: Vec<f32> = right.iter().zip(&image).map(|(a, b)| a - b).collect();
        let mut z: Vec<f32> = residual.iter().zip(inverse).map(|(r, d)| r * d).collect();
        let mut direction = z.clone();
        let mut rz = dot(&residual, &z, share);
        let scaled: Vec<f32> = right.iter().zip(inverse).map(|(r, d)| r * d).collect();
        let end = 1e-7 * dot(right, &scaled, share) + f32::MIN_POSITIVE;
        for _ in 0..rounds {
            if rz <= end {
                break;
            }
            equations.apply(&direction, &mut image);
            let alpha = rz / dot(&direction, &image, share).max(f32::MIN_POSITIVE);
            let (x, residual, z, direction) = (&mut x[..n], &mut residual[..n], &mut z[..n], &mut direction[..n]);
            let (image, inverse) = (&image[..n], &inverse[..n]);
            for i in 0..n {
                x[i] += alpha * direction[i];
                residual[i] -= alpha * image[i];
                z[i] = residual[i] * inverse[i];
            }
            let next = dot(residual, z, share);
            let beta = next / rz;
            rz = next;
            for i in 0..n {
                direction[i] = z[i] + beta * direction[i];
            }
        }
    }
}

struct SumUp<'a> {
    sums: &'a mut [Block],
    spots: &'a Spots,
    weights: &'a [f32],
}

impl pulp::NullaryFnOnce for SumUp<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (i, (cell, weight)) in self.spots.cell.iter().zip(self.weights).enumerate() {
            let k = self.spots.weights(i);
            let block = &mut self.sums[*cell as usize];
            for (a, own) in k.iter().enumerate() {
                for (b, other) in k.iter().enumerate() {
                    block[4 * a + b] += own * weight * other;
                }
            }
        }
    }
}

struct SumRight<'a> {
    sums: &'a mut [[f32; 4]],
    spots: &'a Spots,
    values: &'a [f32],
    weights: &'a [f32],
}

impl pulp::NullaryFnOnce for SumRight<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (i, (cell, (value, weight))) in self.spots.cell.iter().zip(self.values.iter().zip(self.weights)).enumerate() {
            for (sum, k) in self.sums[*cell as usize].iter_mut().zip(self.spots.weights(i)) {
                *sum += k * weight * value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places all over the sphere, the map's edges among them.
    fn places(map: &SphereMap, n: usize) -> (Vec<[f32; 3]>, Spots) {
        let direction = |i: usize| {
            let z = 1.0 - (2.0 * i as f32 + 1.0) / n as f32;
            let (s, c) = (2.399_963_2 * i as f64).sin_cos();
            [c as f32 * (1.0 - z * z).sqrt(), s as f32 * (1.0 - z * z).sqrt(), z]
        };
        let all: Vec<[f32; 3]> = (0..n).map(direction).collect();
        let rows = [0, 1, 2].map(|k| all.iter().map(|d| d[k]).collect::<Vec<f32>>());
        let mut spots = Spots { cell: vec![0; n], at: [vec![0.0; n], vec![0.0; n]] };
        map.look_up([&rows[0], &rows[1], &rows[2]], 0, &mut spots);
        (all, spots)
    }

    #[test]
    fn truth_a_pattern_seen_at_many_places_is_found_on_cells_of_any_number() {
        for edge in [5, 12, 16, 20] {
            let map = SphereMap::new(edge);
            let (all, spots) = places(&map, 20_000);
            let pattern = |d: &[f32; 3]| d[0] * d[1] - 0.5 * d[2];
            let values: Vec<f32> = all.iter().map(pattern).collect();
            let weights: Vec<f32> = (0..all.len()).map(|i| if i % 7 == 0 { 0.0 } else { 400.0 }).collect();
            let equations = MapEquations::new(&map, &spots, &values, &weights, 0.1);
            let mut found = vec![0.0; map.nodes()];
            equations.solve(&equations.right, &mut found, 60);
            let shown = spots.values(&map.by_cell(&found));
            let worst = shown.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 1.5 / (edge * edge) as f32, "{edge}: {worst}");
        }
    }

    #[test]
    fn law_the_solution_satisfies_the_equations() {
        let map = SphereMap::new(12);
        let (all, spots) = places(&map, 3_000);
        let values: Vec<f32> = (0..all.len()).map(|i| ((i * i) as f32 * 0.37).sin()).collect();
        let weights: Vec<f32> = (0..all.len()).map(|i| 20.0 + (i % 5) as f32).collect();
        let equations = MapEquations::new(&map, &spots, &values, &weights, 0.05);
        let mut found = vec![0.0; map.nodes()];
        equations.solve(&equations.right, &mut found, 200);
        let mut image = vec![0.0; map.nodes()];
        equations.apply(&found, &mut image);
        let largest = equations.right.iter().fold(0.0f32, |m, r| m.max(r.abs()));
        let missed = image.iter().zip(&equations.right).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(missed < 1e-3 * largest, "{missed} of {largest}");
    }
}
