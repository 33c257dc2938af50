//! The racket frame as a free beam: bending modes, their nodes, shapes and modal masses (physics reference, section F).
//!
//! Three segments (handle, throat, head) whose line densities follow from mass, balance and swingweight; the bending
//! stiffness is scaled so that the first mode has the frequency asked for. Hermite cubic elements, consistent mass. This
//! replaces the assumption of a node at 0.82 of the length: rackets come out at 0.78 to 0.81.

mod loaded;

use super::error::ModelError;
use super::real::Real;
use nalgebra::{SMatrix, SymmetricEigen};
use std::sync::{Arc, Mutex};

/// Edges between handle and throat, and throat and head, from the butt of a 0.685 m racket, m.
const EDGES: [f64; 2] = [0.19, 0.36];
const REFERENCE_LENGTH: f64 = 0.685;
/// Stiffness of handle, throat and head relative to each other.
const RELATIVE_STIFFNESS: [f64; 3] = [1.0, 1.0, 0.7];
const ELEMENTS: usize = 60;
const DOF: usize = 2 * (ELEMENTS + 1);
/// Half bandwidth of the element matrices plus the diagonal.
const BAND: usize = 4;
/// Modes kept; one or two more are iterated along to speed convergence.
pub const MODES: usize = 3;
const SUBSPACE: usize = 5;

/// One part of a beam: from where to where, its line density and its bending stiffness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// m from the butt.
    pub from: f64,
    /// m from the butt.
    pub to: f64,
    /// kg/m.
    pub density: f64,
    /// N m².
    pub stiffness: f64,
}

/// One bending mode, scaled to 1 at the tip.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode<T = f64> {
    /// Hz.
    pub frequency_hz: T,
    /// Modal mass for a shape that is 1 at the tip, kg.
    pub modal_mass: T,
    /// Displacement and slope at every node of the mesh.
    shape: Vec<T>,
}

/// A beam with its first modes.
#[derive(Debug, Clone, PartialEq)]
pub struct Beam<T = f64> {
    pub length: f64,
    pub segments: Vec<Segment>,
    pub modes: Vec<Mode<T>>,
    /// The first mode's node in the head, from the butt, m.
    head_node: T,
    mesh: Vec<f64>,
}

/// What fixes a racket's beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RacketBeam {
    /// kg.
    pub mass: f64,
    /// Centre of mass from the butt, m.
    pub balance: f64,
    /// About the centre of mass, axis across the face, kg m².
    pub inertia: f64,
    /// m.
    pub length: f64,
    /// First bending frequency with free ends, Hz.
    pub frequency_hz: f64,
}

impl RacketBeam {
    /// Three segments with these edges, their line densities from mass, first and second moment (three linear equations); `None` unless all three
    /// are positive.
    fn segments(&self, edges: [f64; 2]) -> Option<Vec<Segment>> {
        let l = self.length;
        let s = [0.0, edges[0] * l / REFERENCE_LENGTH, edges[1] * l / REFERENCE_LENGTH, l];
        let row = |n: i32| -> [f64; 3] { std::array::from_fn(|i| (s[i + 1].powi(n) - s[i].powi(n)) / f64::from(n)) };
        let butt = self.inertia + self.mass * self.balance * self.balance;
        let (a, b, c) = (row(1), row(2), row(3));
        let m = nalgebra::Matrix3::new(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]);
        let mu = m.lu().solve(&nalgebra::Vector3::new(self.mass, self.mass * self.balance, butt))?;
        let segment = |i: usize| Segment { from: s[i], to: s[i + 1], density: mu[i], stiffness: RELATIVE_STIFFNESS[i] };
        (mu.min() > 0.0).then(|| (0..3).map(segment).collect())
    }

    /// The beam of this racket.
    ///
    /// # Errors
    /// [`ModelError::Body`] when no distribution of mass along the length has these mass, balance and swingweight.
    pub fn build(&self) -> Result<Beam, ModelError> {
        for (what, seen) in [("frame frequency (Hz)", self.frequency_hz), ("racket length (m)", self.length), ("racket mass (kg)", self.mass)] {
            if !(seen.is_finite() && seen > 0.0) {
                return Err(ModelError::Body { what, seen, allowed: "a positive number".into() });
            }
        }
        // The usual edges first; they move within reason until a distribution is found.
        let mut tries = vec![EDGES];
        for handle in [0.16, 0.22, 0.13, 0.25, 0.10, 0.28] {
            for head in [0.36, 0.40, 0.32, 0.45, 0.30, 0.50] {
                if head > handle + 0.03 {
                    tries.push([handle, head]);
                }
            }
        }
        let segments = tries.into_iter().find_map(|edges| self.segments(edges)).ok_or_else(|| ModelError::Body {
            what: "swingweight against mass and balance: inertia about the centre of mass (kg m²)",
            seen: self.inertia,
            allowed: format!(
                "what some distribution of {} kg along {} m with balance {} m has (a uniform rod has {:.5})",
                self.mass,
                self.length,
                self.balance,
                self.mass * self.length * self.length / 12.0
            ),
        })?;
        let unit = Beam::new(&segments, &[])?;
        let scale = (self.frequency_hz / unit.modes[0].frequency_hz).powi(2);
        Ok(unit.stiffened(scale))
    }
}

/// Beams built last. A fit prepares the same racket hundreds of times, and the modes cost more than many impacts.
static RECENT: Mutex<Vec<(RacketBeam, Arc<Beam>)>> = Mutex::new(Vec::new());
/// Beams kept: a table's rackets, each with a few values of the parameters that change it.
const KEPT: usize = 32;

impl RacketBeam {
    /// As [`RacketBeam::build`], or the same beam built before.
    ///
    /// # Errors
    /// See [`RacketBeam::build`].
    pub fn shared(&self) -> Result<Arc<Beam>, ModelError> {
        let lock = || RECENT.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((_, beam)) = lock().iter().find(|(racket, _)| racket == self) {
            return Ok(Arc::clone(beam));
        }
        let beam = Arc::new(self.build()?);
        let mut recent = lock();
        if recent.len() >= KEPT {
            recent.remove(0);
        }
        recent.push((*self, Arc::clone(&beam)));
        Ok(beam)
    }
}

impl Beam {
    /// Modes of a free beam made of `segments` (butt to tip, without gaps) with point masses `(m from the butt, kg)`.
    ///
    /// # Errors
    /// [`ModelError::Body`] when a segment has no length, density or stiffness.
    pub fn new(segments: &[Segment], point_masses: &[(f64, f64)]) -> Result<Self, ModelError> {
        let bad = |what, seen| ModelError::Body { what, seen, allowed: "positive numbers, segments joined end to end".into() };
        let length = segments.last().ok_or_else(|| bad("number of beam segments", 0.0))?.to;
        for s in segments {
            for (what, v) in [("beam segment length (m)", s.to - s.from), ("line density (kg/m)", s.density), ("bending stiffness (N m²)", s.stiffness)] {
                if !(v.is_finite() && v > 0.0) {
                    return Err(bad(what, v));
                }
            }
        }
        let mesh = mesh(segments, length);
        let (k, m) = assemble(segments, &mesh, point_masses);
        let modes = lowest_modes(&k, &m, &mesh)
            .into_iter()
            .map(|(w2, v)| {
                let tip = v[DOF - 2];
                // v has unit modal mass; dividing by its tip value divides the modal mass by its square.
                Mode { frequency_hz: w2.sqrt() / std::f64::consts::TAU, modal_mass: 1.0 / (tip * tip), shape: v.iter().map(|x| x / tip).collect() }
            })
            .collect();
        let mut beam = Beam { length, segments: segments.to_vec(), modes, head_node: 0.0, mesh };
        beam.head_node = beam.nodes(0).last().copied().unwrap_or(0.8 * length);
        Ok(beam)
    }

    /// The same beam with every stiffness multiplied by `scale`: shapes stay, frequencies go with its square root.
    pub fn stiffened(mut self, scale: f64) -> Self {
        for s in &mut self.segments {
            s.stiffness *= scale;
        }
        for m in &mut self.modes {
            m.frequency_hz *= scale.sqrt();
        }
        self
    }

    /// Where mode `mode` does not move, from the butt, m, in rising order.
    pub fn nodes(&self, mode: usize) -> Vec<f64> {
        let f = |s: f64| self.shape(mode, s);
        self.mesh
            .windows(2)
            .filter(|w| f(w[0]) * f(w[1]) < 0.0)
            .map(|w| {
                let (mut a, mut b) = (w[0], w[1]);
                let rising = f(b) > f(a);
                for _ in 0..60 {
                    let mid = 0.5 * (a + b);
                    if (f(mid) > 0.0) == rising { b = mid } else { a = mid }
                }
                0.5 * (a + b)
            })
            .collect()
    }
}

impl<T: Real> Beam<T> {
    /// The same beam in another number.
    pub fn of(plain: &Beam) -> Self {
        let modes = plain.modes.iter().map(|m| Mode {
            frequency_hz: T::constant(m.frequency_hz),
            modal_mass: T::constant(m.modal_mass),
            shape: m.shape.iter().map(|x| T::constant(*x)).collect(),
        });
        Beam {
            length: plain.length,
            segments: plain.segments.clone(),
            modes: modes.collect(),
            head_node: T::constant(plain.head_node),
            mesh: plain.mesh.clone(),
        }
    }

    /// Displacement of mode `mode` (0: the first) at `from_butt` metres, where the tip's is 1.
    pub fn shape(&self, mode: usize, from_butt: T) -> T {
        let (e, n) = interpolation(&self.mesh, from_butt);
        let shape = &self.modes[mode].shape[2 * e..2 * e + 4];
        // From 0, as a sum starts.
        shape.iter().zip(&n).fold(T::zero(), |sum, (x, y)| sum + *x * *y)
    }

    /// The first mode's node in the head, from the butt, m.
    pub fn head_node(&self) -> T {
        self.head_node
    }
}

/// Stiffness and mass of the mesh with point masses `(m from the butt, kg)` on it.
fn assemble(segments: &[Segment], mesh: &[f64], point_masses: &[(f64, f64)]) -> (Vec<[f64; BAND]>, Vec<[f64; BAND]>) {
    let mut k = vec![[0.0; BAND]; DOF];
    let mut m = vec![[0.0; BAND]; DOF];
    for (e, w) in mesh.windows(2).enumerate() {
        let middle = 0.5 * (w[0] + w[1]);
        let s = segments.iter().find(|s| middle < s.to).unwrap_or(&segments[segments.len() - 1]);
        add_element(&mut k, &mut m, 2 * e, w[1] - w[0], s);
    }
    for &(at, mass) in point_masses {
        let (e, n) = interpolation(mesh, at);
        for i in 0..4 {
            for j in 0..=i {
                m[2 * e + i][i - j] += mass.max(0.0) * n[i] * n[j];
            }
        }
    }
    (k, m)
}

/// Nodes of the mesh: every segment gets elements in proportion to its length, at least two.
fn mesh(segments: &[Segment], length: f64) -> Vec<f64> {
    let mut counts: Vec<usize> = segments.iter().map(|s| (((s.to - s.from) / length * ELEMENTS as f64).round() as usize).max(2)).collect();
    // Rounding is settled on the longest segment.
    let longest = (0..counts.len()).max_by_key(|&i| counts[i]).unwrap_or(0);
    let others: usize = counts.iter().sum::<usize>() - counts[longest];
    counts[longest] = ELEMENTS.saturating_sub(others).max(1);
    let mut s = vec![segments[0].from];
    for (segment, &n) in segments.iter().zip(&counts) {
        s.extend((1..=n).map(|i| segment.from + (segment.to - segment.from) * i as f64 / n as f64));
    }
    s.truncate(ELEMENTS + 1);
    s
}

/// The element that holds a point and the weights of its two nodes' displacements and slopes there (Hermite cubics).
fn interpolation<T: Real>(mesh: &[f64], from_butt: T) -> (usize, [T; 4]) {
    let s = from_butt.max(T::constant(mesh[0])).min(T::constant(mesh[ELEMENTS]));
    let e = mesh.partition_point(|x| *x <= s.value()).clamp(1, ELEMENTS) - 1;
    let h = mesh[e + 1] - mesh[e];
    let t = (s - mesh[e]) / h;
    let (t2, t3) = (t * t, t * t * t);
    (e, [-(t2 * 3.0) + 1.0 + t3 * 2.0, (t - t2 * 2.0 + t3) * h, t2 * 3.0 - t3 * 2.0, (t3 - t2) * h])
}

fn add_element(k: &mut [[f64; BAND]], m: &mut [[f64; BAND]], first: usize, h: f64, s: &Segment) {
    let c = s.stiffness / (h * h * h);
    let ke = [
        [12.0, 6.0 * h, -12.0, 6.0 * h],
        [6.0 * h, 4.0 * h * h, -6.0 * h, 2.0 * h * h],
        [-12.0, -6.0 * h, 12.0, -6.0 * h],
        [6.0 * h, 2.0 * h * h, -6.0 * h, 4.0 * h * h],
    ];
    let d = s.density * h / 420.0;
    let me = [
        [156.0, 22.0 * h, 54.0, -13.0 * h],
        [22.0 * h, 4.0 * h * h, 13.0 * h, -3.0 * h * h],
        [54.0, 13.0 * h, 156.0, -22.0 * h],
        [-13.0 * h, -3.0 * h * h, -22.0 * h, 4.0 * h * h],
    ];
    for i in 0..4 {
        for j in 0..=i {
            k[first + i][i - j] += c * ke[i][j];
            m[first + i][i - j] += d * me[i][j];
        }
    }
}

/// y = A x for a symmetric banded A (row i holds A[i][i], A[i][i−1], ...).
fn multiply(a: &[[f64; BAND]], x: &[f64]) -> Vec<f64> {
    let mut y = vec![0.0; DOF];
    for i in 0..DOF {
        y[i] += a[i][0] * x[i];
        for d in 1..BAND.min(i + 1) {
            y[i] += a[i][d] * x[i - d];
            y[i - d] += a[i][d] * x[i];
        }
    }
    y
}

/// Banded Cholesky factor L (A = L Lᵀ); A is positive definite by construction.
fn cholesky(mut a: Vec<[f64; BAND]>) -> Vec<[f64; BAND]> {
    for i in 0..DOF {
        for d in (0..BAND.min(i + 1)).rev() {
            let j = i - d;
            let mut sum = a[i][d];
            for e in d + 1..BAND.min(i + 1) {
                let below = e - d;
                if below < BAND {
                    sum -= a[i][e] * a[j][below];
                }
            }
            a[i][d] = if d == 0 { sum.max(f64::MIN_POSITIVE).sqrt() } else { sum / a[j][0] };
        }
    }
    a
}

fn solve(l: &[[f64; BAND]], mut x: Vec<f64>) -> Vec<f64> {
    for i in 0..DOF {
        let mut sum = x[i];
        for d in 1..BAND.min(i + 1) {
            sum -= l[i][d] * x[i - d];
        }
        x[i] = sum / l[i][0];
    }
    for i in (0..DOF).rev() {
        x[i] /= l[i][0];
        let v = x[i];
        for d in 1..BAND.min(i + 1) {
            x[i - d] -= l[i][d] * v;
        }
    }
    x
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// The lowest elastic modes as (ω², shape with unit modal mass), by subspace iteration beside the two rigid motions.
fn lowest_modes(k: &[[f64; BAND]], m: &[[f64; BAND]], mesh: &[f64]) -> Vec<(f64, Vec<f64>)> {
    let length = mesh[ELEMENTS] - mesh[0];
    // Rigid motions: translation and rotation, M-orthonormal; modes are kept orthogonal to them.
    let mut rigid: Vec<Vec<f64>> =
        vec![(0..DOF).map(|i| f64::from(i % 2 == 0)).collect(), (0..DOF).map(|i| if i % 2 == 0 { mesh[i / 2] - mesh[0] } else { 1.0 }).collect()];
    orthonormalise(&mut rigid, &[], m);
    // Start: the uniform beam's look, polynomials of rising degree.
    let mut v: Vec<Vec<f64>> = (0..SUBSPACE)
        .map(|n| {
            let w = (n + 2) as f64 * std::f64::consts::PI / length;
            (0..DOF).map(|i| if i % 2 == 0 { (w * (mesh[i / 2] - mesh[0])).cos() } else { -w * (w * (mesh[i / 2] - mesh[0])).sin() }).collect()
        })
        .collect();
    orthonormalise(&mut v, &rigid, m);
    // Shift by the first estimate, so that the free beam's stiffness becomes positive definite.
    let shift = v.iter().map(|x| dot(x, &multiply(k, x))).fold(f64::INFINITY, f64::min).max(f64::MIN_POSITIVE);
    let shifted: Vec<[f64; BAND]> = k.iter().zip(m).map(|(a, b)| std::array::from_fn(|d| a[d] + shift * b[d])).collect();
    let factor = cholesky(shifted);
    let mut values = [0.0; SUBSPACE];
    for _ in 0..60 {
        v = v.iter().map(|x| solve(&factor, multiply(m, x))).collect();
        orthonormalise(&mut v, &rigid, m);
        let kv: Vec<Vec<f64>> = v.iter().map(|x| multiply(k, x)).collect();
        let small = SMatrix::<f64, SUBSPACE, SUBSPACE>::from_fn(|i, j| dot(&v[i], &kv[j]));
        let eigen = SymmetricEigen::new((small + small.transpose()) * 0.5);
        let mut order: Vec<usize> = (0..SUBSPACE).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        v = order.iter().map(|&c| (0..DOF).map(|i| (0..SUBSPACE).map(|j| v[j][i] * eigen.eigenvectors[(j, c)]).sum()).collect()).collect();
        let next: [f64; SUBSPACE] = std::array::from_fn(|i| eigen.eigenvalues[order[i]]);
        let moved = (0..MODES).map(|i| ((next[i] - values[i]) / next[i]).abs()).fold(0.0, f64::max);
        values = next;
        if moved < 1e-13 {
            break;
        }
    }
    values.into_iter().zip(v).take(MODES).collect()
}

/// Gram-Schmidt in the mass product, twice for rounding, against `fixed` and among themselves.
fn orthonormalise(v: &mut [Vec<f64>], fixed: &[Vec<f64>], m: &[[f64; BAND]]) {
    for i in 0..v.len() {
        for _ in 0..2 {
            let (done, rest) = v.split_at_mut(i);
            for other in fixed.iter().chain(done.iter()) {
                let c = dot(other, &multiply(m, &rest[0]));
                for (x, o) in rest[0].iter_mut().zip(other) {
                    *x -= c * o;
                }
            }
        }
        let norm = dot(&v[i], &multiply(m, &v[i])).sqrt().max(f64::MIN_POSITIVE);
        for x in &mut v[i] {
            *x /= norm;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uniform free beam: cos(βL) cosh(βL) = 1.
    #[test]
    fn truth_uniform_beam() {
        let beam = Beam::new(&[Segment { from: 0.0, to: 0.685, density: 0.33 / 0.685, stiffness: 100.0 }], &[]).expect("valid");
        for (mode, hz) in beam.modes.iter().zip([109.334, 301.385, 590.834]) {
            assert!((mode.frequency_hz - hz).abs() < 1e-3, "{}", mode.frequency_hz);
            assert!((mode.modal_mass - 0.33 / 4.0).abs() < 1e-6, "{}", mode.modal_mass);
        }
        let expected: [&[f64]; 2] = [&[0.22416, 0.77584], &[0.13211, 0.5, 0.86789]];
        for (k, nodes) in expected.iter().enumerate() {
            for (node, share) in beam.nodes(k).iter().zip(*nodes) {
                assert!((node / 0.685 - share).abs() < 1e-5, "{node}");
            }
        }
        assert!((beam.shape(0, 0.0) - 1.0).abs() < 1e-9 && (beam.shape(1, 0.0) + 1.0).abs() < 1e-9);
    }

    /// First row of table F.4, and the seed's 109 Hz frame with 0.2 kg at 40 mm.
    #[test]
    fn truth_racket_beam() {
        let i = 0.0325 - 0.33 * 0.225f64.powi(2);
        let racket = RacketBeam { mass: 0.33, balance: 0.325, inertia: i, length: 0.685, frequency_hz: 140.0 };
        let beam = racket.build().expect("valid");
        for (s, mu) in beam.segments.iter().zip([0.7244, 0.1505, 0.5131]) {
            assert!((s.density - mu).abs() < 1e-4, "{}", s.density);
        }
        assert!((beam.segments[0].stiffness - 182.2).abs() < 0.1 && (beam.segments[2].stiffness - 127.5).abs() < 0.1);
        assert!((beam.modes[0].frequency_hz - 140.0).abs() < 1e-9);
        assert!((beam.modes[1].frequency_hz - 379.7).abs() < 0.1 && (beam.modes[2].frequency_hz - 736.9).abs() < 0.1);
        let nodes = beam.nodes(0);
        assert!((nodes[0] - 0.12340).abs() < 1e-4 && (nodes[1] - 0.54672).abs() < 1e-4, "{nodes:?}");
        assert!((beam.modes[0].modal_mass - 0.06798).abs() < 1e-5 && (beam.shape(0, 0.0) - 0.662).abs() < 1e-3);
        for (s, phi) in [(0.40, -0.64), (0.43, -0.57), (0.47, -0.43), (0.51, -0.22), (0.55, 0.02), (0.60, 0.37), (0.64, 0.66), (0.685, 1.0)] {
            assert!((beam.shape(0, s) - phi).abs() < 0.006, "phi({s}) = {}", beam.shape(0, s));
        }
        let free = RacketBeam { frequency_hz: 109.0, ..racket }.build().expect("valid");
        let held = Beam::new(&free.segments, &[(0.04, 0.2)]).expect("valid");
        // The seed's frame is another one (its free node at 0.132 m): 97 Hz and 77 mm there; the same direction and size here.
        assert!((95.0..101.0).contains(&held.modes[0].frequency_hz), "{}", held.modes[0].frequency_hz);
        assert!((0.06..0.09).contains(&held.nodes(0)[0]), "{}", held.nodes(0)[0]);
    }

    #[test]
    fn fails_impossible_mass_distribution() {
        let rod_with_too_much = RacketBeam { mass: 0.33, balance: 0.325, inertia: 0.2, length: 0.685, frequency_hz: 140.0 };
        assert!(matches!(rod_with_too_much.build(), Err(ModelError::Body { .. })));
    }
}
