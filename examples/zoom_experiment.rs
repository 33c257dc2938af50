//! The thesis's zoom experiment (section 3.4) on boards of the synthetic world: the same 30 positions,
//! calibrated at five focal lengths. The thesis found that the error in pixels falls when the picture is coarser while the
//! error in millimetres does not. A flat board does not do that: its error in pixels is that of finding corners, and grows.
//! A board bowed by a millimetre does: its corners are out of place by a fixed length, which is fewer pixels when the
//! picture is coarser.
//!
//! `cargo run --release --example zoom_experiment -- [FIGURE.svg]`: one line per focal length; with a file name also the
//! figure.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::io::Write;
use sweetspot::calibration::{Calibration, CalibrationOptions, Checkerboard, PairImages, calibrate_images};
use sweetspot::footage::GreyImage;
use sweetspot::report::chart::{Chart, Colour, Line, Points};
use sweetspot::synthetic::look::{Look, Sensor, Setting};
use sweetspot::synthetic::targets::{Board, COLUMNS, ROWS, SQUARE_M};
use sweetspot::synthetic::view::View;

const SIZE: usize = 512;
const PAIRS: u64 = 30;
const FOCAL_PX: [f64; 5] = [7500.0, 6000.0, 4700.0, 3600.0, 2700.0];
const BOW_M: f64 = 0.001;

/// Two cameras some 12 m from the origin, 7 m apart.
fn views(focal: f64) -> [View; 2] {
    [(-3.5, 1.2), (3.5, 1.3)].map(|(u, v)| {
        let distortion = [-0.3, 1.0, 2e-4, -3e-4, 0.0];
        View::looking_at(Point3::new(u, v, 11.5), Point3::new(0.0, 1.0, 0.0), [focal, focal - 2.0], [254.0, 257.0], distortion, [SIZE, SIZE]).expect("a view")
    })
}

/// The board's position number `n`, the same at every zoom.
fn board(n: u64, bow_m: f64) -> Board {
    let mut rng = ChaCha8Rng::seed_from_u64(n);
    let place = Vector3::new(rng.random_range(-0.07..0.07), 1.0 + rng.random_range(-0.10..0.10), rng.random_range(-0.4..0.4));
    // x to the right, y down, z away from the cameras; then tilted.
    let facing = Rotation3::from_matrix_unchecked(Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0));
    let tilt = Vector3::new(rng.random_range(-0.7..0.7), rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5));
    Board {
        pose: Isometry3::from_parts(place.into(), UnitQuaternion::from_scaled_axis(tilt) * UnitQuaternion::from_rotation_matrix(&facing)),
        fault: None,
        faulty_camera: 0,
        bow_m,
    }
}

fn calibrate(focal: f64, bow_m: f64, look: &Look, sensor: &Sensor) -> Calibration {
    let views = views(focal);
    let pairs: Vec<PairImages> = (0..PAIRS)
        .into_par_iter()
        .map(|n| {
            let take = |camera: usize| {
                let mut light = vec![12.0f32; SIZE * SIZE];
                board(n, bow_m).expose(&views[camera], camera, look, &mut light);
                Some(GreyImage { width: SIZE, height: SIZE, pixels: sensor.record(&light, SIZE, 2 * n + camera as u64) })
            };
            PairImages { name: n.to_string(), left: take(0), right: take(1) }
        })
        .collect();
    let board = Checkerboard { columns: COLUMNS, rows: ROWS, square_m: SQUARE_M };
    calibrate_images(&board, &pairs, &CalibrationOptions::default()).expect("calibrated")
}

/// Square in the picture (px), root mean square of the corners' residuals (px, mm), scatter of the squares held out (mm).
fn one_zoom(focal: f64, bow_m: f64, look: &Look, sensor: &Sensor) -> [f64; 4] {
    let c = calibrate(focal, bow_m, look, sensor);
    let board = Checkerboard { columns: COLUMNS, rows: ROWS, square_m: SQUARE_M };
    let neighbours = board.neighbours();
    let spacings: Vec<f64> = c
        .bundle
        .views
        .iter()
        .filter(|v| v.left.len() == board.corner_count())
        .map(|v| {
            let spacing = |&(a, b): &(usize, usize)| (v.left[a].uv - v.left[b].uv).norm();
            neighbours.iter().map(spacing).sum::<f64>() / neighbours.len() as f64
        })
        .collect();
    let square_px = spacings.iter().sum::<f64>() / spacings.len().max(1) as f64;
    let rms_px = c.rms_px(None);
    let rms_mm = rms_px * 1e3 * SQUARE_M / square_px;
    let verdict = c.verdict().expect("enough boards");
    let used = c.pairs.iter().filter(|p| p.used).count();
    let _ = writeln!(
        std::io::stdout(),
        "{:6.1}  {focal:8.0}  {square_px:9.2}  {rms_px:6.4}  {rms_mm:6.4}  {:10.4} ({:6.4})         {:16.3}  {used:5}",
        1e3 * bow_m,
        verdict.squares.mean,
        verdict.squares.sd,
        verdict.diagonal_error_max_mm
    );
    [square_px, rms_px, rms_mm, verdict.squares.sd]
}

fn main() {
    let look = Look::of(Setting::Court);
    let sensor = Sensor::new(&look, 0.0, 7);
    let _ = writeln!(std::io::stdout(), "bow mm  focal px  square px  rms px  rms mm  squares held out mm (sd)  diagonals max mm  pairs");
    let [flat, bowed] = [0.0, BOW_M].map(|bow| FOCAL_PX.map(|focal| one_zoom(focal, bow, &look, &sensor)));
    if let Some(path) = std::env::args().nth(1) {
        let series = |lines: &[[f64; 4]], k: usize| lines.iter().map(|l| (l[0], l[k])).collect::<Vec<_>>();
        let [flat_px, px, mm, squares] = [series(&flat, 1), series(&bowed, 1), series(&bowed, 2), series(&bowed, 3)];
        let chart = Chart::new("The same volume at five zooms")
            .x("square in the picture", "px")
            .y("error", "px or mm")
            .x_include(0.0)
            .y_include(0.0)
            .add(Line::new(&flat_px).colour(Colour::GREY).name("flat board: corners, px").dotted())
            .add(Points::new(&flat_px).colour(Colour::GREY))
            .add(Line::new(&px).colour(Colour::BLUE).name("bowed board: corners, px"))
            .add(Points::new(&px).colour(Colour::BLUE))
            .add(Line::new(&mm).colour(Colour::ORANGE).name("corners, mm").dashed())
            .add(Points::new(&mm).colour(Colour::ORANGE))
            .add(Line::new(&squares).colour(Colour::GREEN).name("squares in 3-D (sd), mm").dashed())
            .add(Points::new(&squares).colour(Colour::GREEN));
        std::fs::write(path, chart.to_svg()).expect("the figure can be written");
    }
}
