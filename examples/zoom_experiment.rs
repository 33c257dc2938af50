//! The thesis's zoom experiment (section 3.4) on drawn boards: the same 0.5 m cube calibrated with 25 pairs at five focal
//! lengths. The thesis found that the error in pixels falls with the zoom while the error in millimetres does not.
//!
//! `cargo run --release --example zoom_experiment -- [GREY_NOISE]` (default 2 grey levels). One line per zoom.

use nalgebra::{Isometry3, Matrix3, Point3, UnitQuaternion, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::io::Write;
use sweetspot::calibration::{CalibrationOptions, Camera, CameraId, Checkerboard, PairImages, calibrate_images};
use sweetspot::footage::GreyImage;

const SIZE: usize = 512;
const DISTANCE_M: f64 = 3.0;
const BOARD: Checkerboard = Checkerboard { columns: 7, rows: 5, square_m: 0.0315 };

/// The board as a camera sees it: 4x4 samples a pixel, white rim of one square, grey noise.
fn draw(camera: &Camera, pose: &Isometry3<f64>, noise: f64, rng: &mut ChaCha8Rng) -> GreyImage {
    let r = pose.rotation.to_rotation_matrix();
    let to_board = Matrix3::from_columns(&[r.matrix().column(0).into_owned(), r.matrix().column(1).into_owned(), pose.translation.vector])
        .try_inverse()
        .expect("the board is seen from the front");
    let s = BOARD.square_m;
    let grey = |u: f64, v: f64| {
        let x = to_board * Vector3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
        let (i, j) = ((x.x / x.z / s).floor() as i64, (x.y / x.z / s).floor() as i64);
        let (columns, rows) = (BOARD.columns as i64, BOARD.rows as i64);
        match (i, j) {
            _ if i < -2 || j < -2 || i > columns || j > rows => 60.0,
            _ if i < -1 || j < -1 || i >= columns || j >= rows => 190.0,
            _ if (i + j).rem_euclid(2) == 0 => 30.0,
            _ => 190.0,
        }
    };
    let pixels = (0..SIZE * SIZE)
        .map(|k| {
            let (u, v) = ((k % SIZE) as f64, (k / SIZE) as f64);
            let mean = (0..16).map(|q| grey(u + (q % 4) as f64 / 4.0 - 0.375, v + (q / 4) as f64 / 4.0 - 0.375)).sum::<f64>() / 16.0;
            let n: f64 = StandardNormal.sample(rng);
            (mean + noise * n).round().clamp(0.0, 255.0) as u8
        })
        .collect();
    GreyImage { width: SIZE, height: SIZE, pixels }
}

fn main() {
    let noise: f64 = std::env::args().nth(1).map_or(2.0, |a| a.parse().expect("grey noise: a number"));
    let mut out = std::io::stdout();
    let _ = writeln!(out, "focal px  square px  rms left px  rms right px  rms left mm  rms right mm  square mean mm  sd mm  pairs");
    for zoom in [2400.0, 1900.0, 1400.0, 1000.0, 700.0] {
        let camera = Camera { fx: zoom, fy: zoom, cx: 255.5, cy: 255.5, distortion: [0.0; 5], rms_px: 0.0, sd: Default::default() };
        let right_from_left = Isometry3::new(Vector3::new(-1.5, 0.0, 0.4), Vector3::new(0.0, 0.5, 0.0));
        let middle = Vector3::new((BOARD.columns - 1) as f64, (BOARD.rows - 1) as f64, 0.0) * (BOARD.square_m / 2.0);
        let pairs: Vec<PairImages> = (0..25u64)
            .into_par_iter()
            .map(|n| {
                // The same positions at every zoom, as in the thesis.
                let mut rng = ChaCha8Rng::seed_from_u64(n);
                let turn = UnitQuaternion::from_scaled_axis(Vector3::new(
                    rng.random_range(-0.6..0.6),
                    0.25 + rng.random_range(-0.6..0.6),
                    rng.random_range(-0.4..0.4),
                ));
                let place = Point3::new(rng.random_range(-0.12..0.12), rng.random_range(-0.12..0.12), DISTANCE_M + rng.random_range(-0.25..0.25));
                let pose = Isometry3::from_parts(place.coords.into(), turn) * Isometry3::translation(-middle.x, -middle.y, 0.0);
                let left = draw(&camera, &pose, noise, &mut rng);
                let right = draw(&camera, &(right_from_left * pose), noise, &mut rng);
                PairImages { name: n.to_string(), left: Some(left), right: Some(right) }
            })
            .collect();
        match calibrate_images(&BOARD, &pairs, &CalibrationOptions::default()) {
            Ok(c) => {
                let sides: Vec<f64> = c
                    .bundle
                    .views
                    .iter()
                    .filter(|v| v.left.len() == BOARD.corner_count())
                    .map(|v| BOARD.mean_spacing_px(&v.left.iter().map(|q| q.uv).collect::<Vec<Vector2<f64>>>()))
                    .collect();
                let square_px = sides.iter().sum::<f64>() / sides.len().max(1) as f64;
                let mm = 1e3 * BOARD.square_m / square_px;
                let (l, r) = (c.rms_px(Some(CameraId::Left)), c.rms_px(Some(CameraId::Right)));
                let (mean, sd) = c.verdict().map_or((f64::NAN, f64::NAN), |v| (v.squares.mean, v.squares.sd));
                let used = c.pairs.iter().filter(|p| p.used).count();
                let _ = writeln!(out, "{zoom:8.0}  {square_px:9.2}  {l:11.4}  {r:12.4}  {:11.4}  {:12.4}  {mean:14.4}  {sd:5.4}  {used:5}", l * mm, r * mm);
            }
            Err(e) => {
                let _ = writeln!(out, "{zoom:8.0}  {e}");
            }
        }
    }
}
