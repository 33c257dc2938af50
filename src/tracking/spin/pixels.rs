//! The ball's pixels as directions in the axes of the map's cells, side by side.

use super::sphere_map::{SphereMap, Spots};
use nalgebra::{Rotation3, Vector3};
use std::ops::Range;

/// Directions, their coordinates in three rows.
#[derive(Debug, Default)]
pub(super) struct Rows([Vec<f32>; 3]);

impl Rows {
    pub fn push(&mut self, direction: &Vector3<f64>) {
        self.0.iter_mut().zip(direction.iter()).for_each(|(row, x)| row.push(*x as f32));
    }

    pub fn of(&self, pixels: &Range<usize>) -> [&[f32]; 3] {
        self.0.each_ref().map(|row| &row[pixels.clone()])
    }
}

/// Turns directions by the rows of a rotation.
struct Turned<'a> {
    by: &'a [[f32; 3]; 3],
    from: [&'a [f32]; 3],
    to: [&'a mut [f32]; 3],
}

impl pulp::NullaryFnOnce for Turned<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Turned { by, from: [x, y, z], to } = self;
        let n = x.len();
        let (x, y, z) = (&x[..n], &y[..n], &z[..n]);
        for (row, to) in by.iter().zip(to) {
            let to = &mut to[..n];
            for i in 0..n {
                to[i] = row[0] * x[i] + row[1] * y[i] + row[2] * z[i];
            }
        }
    }
}

/// The pixels on the map at one spin.
pub(super) struct Design {
    pub spots: Spots,
    /// In the axes of the map's cells.
    pub body: Rows,
    pub omega: Vector3<f64>,
    /// Attitude of the map's cells on the ball.
    pub cells: Rotation3<f64>,
}

impl Design {
    pub fn new(pixels: usize, cells: Rotation3<f64>) -> Self {
        let row = || vec![0.0; pixels];
        let spots = Spots { cell: vec![0; pixels], at: [row(), row()] };
        Design { spots, body: Rows([row(), row(), row()]), omega: Vector3::zeros(), cells }
    }

    /// Turns every view's pixels back.
    pub fn turn(&mut self, map: &SphereMap, looks_at: &Rows, of_view: &[Range<usize>], back: &[[[f32; 3]; 3]]) {
        for (pixels, by) in of_view.iter().zip(back) {
            let to = self.body.0.each_mut().map(|row| &mut row[pixels.clone()]);
            pulp::Arch::new().dispatch(Turned { by, from: looks_at.of(pixels), to });
            map.look_up(self.body.of(pixels), pixels.start, &mut self.spots);
        }
    }
}

/// Turns slopes along directions in the map's axes into what a turn changes: the rows times (slope × direction).
pub(super) struct Moment<'a> {
    pub by: [[f32; 3]; 3],
    pub body: [&'a [f32]; 3],
    pub slopes: [&'a mut [f32]; 3],
}

impl pulp::NullaryFnOnce for Moment<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Moment { by, body: [x, y, z], slopes: [u, v, w] } = self;
        let n = x.len();
        let (x, y, z, u, v, w) = (&x[..n], &y[..n], &z[..n], &mut u[..n], &mut v[..n], &mut w[..n]);
        for i in 0..n {
            let turn = [v[i] * z[i] - w[i] * y[i], w[i] * x[i] - u[i] * z[i], u[i] * y[i] - v[i] * x[i]];
            let row = |k: usize| by[k][0] * turn[0] + by[k][1] * turn[1] + by[k][2] * turn[2];
            (u[i], v[i], w[i]) = (row(0), row(1), row(2));
        }
    }
}
