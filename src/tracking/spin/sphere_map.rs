//! A scalar on the sphere (the ball's markings): smooth, compact kernels around evenly spread nodes.

use nalgebra::Vector3;

/// Cells per edge of a cube's face in the table that finds the nodes near a direction.
const TABLE: usize = 16;

/// Fixed nodes and the table that finds them; holds no values.
pub(super) struct SphereMap {
    nodes: Vec<Vector3<f64>>,
    near: Vec<Vec<u16>>,
    /// Reach of a kernel, chord length on the unit sphere.
    reach: f64,
}

/// Kernel values, and gradients, of the nodes that reach one direction.
#[derive(Default, Clone)]
pub(super) struct KernelRow {
    pub node: Vec<u16>,
    pub value: Vec<f64>,
    /// d value / d direction.
    pub slope: Vec<Vector3<f64>>,
}

impl SphereMap {
    /// A map of `count` nodes (up to 65 535).
    ///
    /// The reach of 2 node distances lets 10 to 12 kernels overlap: a ripple of the map below 1 %.
    pub fn new(count: u16) -> Self {
        let reach = 2.0 * (4.0 * std::f64::consts::PI / f64::from(count.max(12))).sqrt();
        // Fibonacci lattice: equal areas, no pole.
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let nodes: Vec<Vector3<f64>> = (0..count)
            .map(|i| {
                let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
                let (s, c) = (golden * f64::from(i)).sin_cos();
                let r = (1.0 - z * z).sqrt();
                Vector3::new(r * c, r * s, z)
            })
            .collect();
        // A cell's corner lies at most this far from its middle (on the cube's face, hence not farther on the sphere).
        let slack = std::f64::consts::SQRT_2 / TABLE as f64;
        let near = (0..6 * TABLE * TABLE)
            .map(|cell| {
                let middle = cell_middle(cell, TABLE);
                (0..count).filter(|&k| (nodes[k as usize] - middle).norm() < reach + slack).collect()
            })
            .collect();
        SphereMap { nodes, near, reach }
    }

    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// The kernels at a unit direction. k = (1 − d²/ρ²)², d the chord.
    pub fn row(&self, direction: &Vector3<f64>, row: &mut KernelRow) {
        row.node.clear();
        row.value.clear();
        row.slope.clear();
        let inverse = 1.0 / (self.reach * self.reach);
        for &k in &self.near[cube_cell(direction, TABLE)] {
            let d = direction - self.nodes[k as usize];
            let u = 1.0 - d.norm_squared() * inverse;
            if u > 0.0 {
                row.node.push(k);
                row.value.push(u * u);
                row.slope.push(d * (-4.0 * u * inverse));
            }
        }
    }
}

/// Number of the cell of a cube's surface (six faces of n × n) that a direction points at.
pub(super) fn cube_cell(d: &Vector3<f64>, n: usize) -> usize {
    let (ax, ay, az) = (d.x.abs(), d.y.abs(), d.z.abs());
    let (face, main, a, b) = if ax >= ay && ax >= az {
        (usize::from(d.x < 0.0), ax, d.y, d.z)
    } else if ay >= az {
        (2 + usize::from(d.y < 0.0), ay, d.z, d.x)
    } else {
        (4 + usize::from(d.z < 0.0), az, d.x, d.y)
    };
    let half = 0.5 * n as f64;
    let scale = half / main.max(1e-300);
    let place = |c: f64| ((c * scale + half) as usize).min(n - 1);
    (face * n + place(a)) * n + place(b)
}

fn cell_middle(cell: usize, n: usize) -> Vector3<f64> {
    let (face, i, j) = (cell / (n * n), cell / n % n, cell % n);
    let c = |k: usize| (2.0 * k as f64 + 1.0) / n as f64 - 1.0;
    let main = if face % 2 == 0 { 1.0 } else { -1.0 };
    let (a, b) = (c(i), c(j));
    match face / 2 {
        0 => Vector3::new(main, a, b),
        1 => Vector3::new(b, main, a),
        _ => Vector3::new(a, b, main),
    }
    .normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn directions() -> impl Iterator<Item = Vector3<f64>> {
        (0..500).map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / 500.0;
            let (s, c) = (1.7 * i as f64).sin_cos();
            Vector3::new(c * (1.0 - z * z).sqrt(), s * (1.0 - z * z).sqrt(), z)
        })
    }

    #[test]
    fn truth_the_table_finds_every_node_in_reach() {
        let map = SphereMap::new(700);
        let mut row = KernelRow::default();
        for d in directions() {
            map.row(&d, &mut row);
            let all = map.nodes.iter().filter(|n| (d - **n).norm() < map.reach).count();
            assert_eq!(row.node.len(), all);
            assert!(all >= 5, "only {all} kernels reach {d:?}");
        }
    }

    #[test]
    fn truth_kernel_slope_equals_central_differences() {
        let map = SphereMap::new(700);
        let (mut row, mut a, mut b) = (KernelRow::default(), KernelRow::default(), KernelRow::default());
        for d in directions().step_by(37) {
            map.row(&d, &mut row);
            for axis in 0..3 {
                let mut h = Vector3::zeros();
                h[axis] = 1e-6;
                map.row(&(d + h), &mut a);
                map.row(&(d - h), &mut b);
                for (k, node) in row.node.iter().enumerate() {
                    let at = |r: &KernelRow| r.node.iter().position(|n| n == node).map_or(0.0, |i| r.value[i]);
                    assert!(((at(&a) - at(&b)) / 2e-6 - row.slope[k][axis]).abs() < 1e-4);
                }
            }
        }
    }

    #[test]
    fn truth_a_cell_holds_its_own_middle() {
        for n in [1, 4, 7, 16] {
            for cell in 0..6 * n * n {
                assert_eq!(cube_cell(&cell_middle(cell, n), n), cell);
            }
        }
    }
}
