//! A scalar on the sphere (the ball's markings): values at the corners of cells on a cube's surface, bilinear between.
//!
//! Four values make one place, and a cell's four corners couple with nothing outside it: normal equations are a sum of one
//! 4 × 4 block per cell, however many pixels there are.

/// Cells on the six faces and their corners; holds no values.
pub(super) struct SphereMap {
    /// Cells along a face's edge.
    edge: usize,
    nodes: usize,
    /// Nodes at the corners of each cell: (0, 0), (1, 0), (0, 1), (1, 1) along its two sides.
    corners: Vec<[u16; 4]>,
}

/// A place on the map.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub cell: u16,
    /// Along the cell's two sides, 0 to 1.
    pub at: [f32; 2],
    /// d at / d direction.
    pub slope: [[f32; 3]; 2],
}

impl Spot {
    /// Shares of the cell's corners.
    #[inline]
    pub fn weights(&self) -> [f32; 4] {
        let [p, q] = self.at;
        [(1.0 - p) * (1.0 - q), p * (1.0 - q), (1.0 - p) * q, p * q]
    }

    /// Slope of the map along the direction, from the values at the cell's corners.
    #[inline]
    pub fn gradient(&self, v: [f32; 4]) -> [f32; 3] {
        let [p, q] = self.at;
        let along = [(v[1] - v[0]) * (1.0 - q) + (v[3] - v[2]) * q, (v[2] - v[0]) * (1.0 - p) + (v[3] - v[1]) * p];
        std::array::from_fn(|k| along[0] * self.slope[0][k] + along[1] * self.slope[1][k])
    }
}

/// Spreads the cells of a face evenly over its angles: 4/π atan(a) to 1 %, and its slope.
#[inline]
fn even(a: f32) -> (f32, f32) {
    const C: [f32; 3] = [1.2732, -0.3502, 0.077];
    let a2 = a * a;
    (a * (C[0] + a2 * (C[1] + a2 * C[2])), C[0] + a2 * (3.0 * C[1] + 5.0 * C[2] * a2))
}

impl SphereMap {
    /// A map of `edge` × `edge` cells on each of six faces (`edge` up to 100).
    pub fn new(edge: usize) -> Self {
        let edge = edge.clamp(2, 100);
        let side = edge + 1;
        // Nodes by their whole coordinates on the cube: those on an edge belong to two faces.
        let mut number = vec![u16::MAX; side * side * side];
        let mut nodes = 0;
        let mut corners = Vec::with_capacity(6 * edge * edge);
        for face in 0..6 {
            let (axis, main) = (face / 2, if face % 2 == 0 { edge } else { 0 });
            for i in 0..edge {
                for j in 0..edge {
                    corners.push([(0, 0), (1, 0), (0, 1), (1, 1)].map(|(a, b)| {
                        let mut c = [0; 3];
                        c[axis] = main;
                        c[(axis + 1) % 3] = i + a;
                        c[(axis + 2) % 3] = j + b;
                        let at = &mut number[(c[0] * side + c[1]) * side + c[2]];
                        if *at == u16::MAX {
                            *at = nodes;
                            nodes += 1;
                        }
                        *at
                    }));
                }
            }
        }
        SphereMap { edge, nodes: usize::from(nodes), corners }
    }

    pub fn nodes(&self) -> usize {
        self.nodes
    }

    pub fn corners(&self) -> &[[u16; 4]] {
        &self.corners
    }

    /// Where a unit direction points.
    #[inline]
    pub fn spot(&self, d: &[f32; 3]) -> Spot {
        let size = d.map(f32::abs);
        let axis = if size[0] >= size[1] && size[0] >= size[2] {
            0
        } else if size[1] >= size[2] {
            1
        } else {
            2
        };
        let (one, two) = ((axis + 1) % 3, (axis + 2) % 3);
        let inverse = 1.0 / size[axis].max(1e-6);
        let half = 0.5 * self.edge as f32;
        let (a, b) = (d[one] * inverse, d[two] * inverse);
        let ((u, du), (v, dv)) = (even(a), even(b));
        let (u, v) = (half * (u + 1.0), half * (v + 1.0));
        let (i, j) = ((u as usize).min(self.edge - 1), (v as usize).min(self.edge - 1));
        let sign = if d[axis] < 0.0 { 1.0 } else { -1.0 };
        let mut slope = [[0.0; 3]; 2];
        slope[0][one] = half * du * inverse;
        slope[0][axis] = half * du * inverse * a * sign;
        slope[1][two] = half * dv * inverse;
        slope[1][axis] = half * dv * inverse * b * sign;
        let face = 2 * axis + usize::from(d[axis] < 0.0);
        Spot { cell: ((face * self.edge + i) * self.edge + j) as u16, at: [u - i as f32, v - j as f32], slope }
    }

    /// The four values around a place.
    #[inline]
    pub fn values(&self, spot: &Spot, map: &[f32]) -> [f32; 4] {
        self.corners[usize::from(spot.cell)].map(|k| map[usize::from(k)])
    }

    /// The same of every cell, for many places.
    pub fn by_cell(&self, map: &[f32]) -> Vec<[f32; 4]> {
        self.corners.iter().map(|corners| corners.map(|k| map[usize::from(k)])).collect()
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

    /// Directions of the nodes, found by the map itself: the mean of where its corners are met.
    fn filled(map: &SphereMap, value: impl Fn(&Vector3<f32>) -> f32) -> Vec<f32> {
        let mut sums = vec![(0.0, 0.0); map.nodes()];
        for i in 0..400_000 {
            let z = 1.0 - (2.0 * i as f32 + 1.0) / 400_000.0;
            let (s, c) = (2.399_963_2 * f64::from(i)).sin_cos();
            let d = Vector3::new(c as f32 * (1.0 - z * z).sqrt(), s as f32 * (1.0 - z * z).sqrt(), z);
            let spot = map.spot(&d.into());
            for (k, w) in map.corners()[usize::from(spot.cell)].iter().zip(spot.weights()) {
                let sum = &mut sums[usize::from(*k)];
                *sum = (sum.0 + w * w * w * value(&d), sum.1 + w * w * w);
            }
        }
        sums.iter().map(|(v, w)| v / w).collect()
    }

    #[test]
    fn truth_the_surface_has_as_many_nodes_as_a_cube_and_holds_a_smooth_pattern() {
        let map = SphereMap::new(16);
        assert_eq!(map.nodes(), 6 * 16 * 16 + 2);
        let pattern = |d: &Vector3<f32>| d.x * d.y + 0.5 * d.z;
        let values = filled(&map, pattern);
        for d in directions() {
            let spot = map.spot(&d.into());
            let got: f32 = map.values(&spot, &values).iter().zip(spot.weights()).map(|(v, w)| v * w).sum();
            assert!((got - pattern(&d)).abs() < 0.01, "{d:?}: {got}, {}", pattern(&d));
        }
    }

    #[test]
    fn truth_slope_equals_central_differences() {
        let map = SphereMap::new(10);
        let values: Vec<f32> = (0..map.nodes()).map(|i| ((i * i) as f32 * 0.37).sin()).collect();
        let at = |d: Vector3<f32>| {
            let spot = map.spot(&d.into());
            (spot.cell, map.values(&spot, &values).iter().zip(spot.weights()).map(|(v, w)| v * w).sum::<f32>())
        };
        let mut compared = 0;
        for d in directions() {
            let spot = map.spot(&d.into());
            let slope = spot.gradient(map.values(&spot, &values));
            for (axis, slope) in slope.iter().enumerate() {
                let mut h = Vector3::zeros();
                h[axis] = 2e-3;
                let (a, b) = (at(d + h), at(d - h));
                if a.0 == spot.cell && b.0 == spot.cell {
                    compared += 1;
                    assert!(((a.1 - b.1) / 4e-3 - slope).abs() < 0.03 * (1.0 + slope.abs()), "{d:?} {axis}: {slope}");
                }
            }
        }
        assert!(compared > 800, "{compared}");
    }
}
