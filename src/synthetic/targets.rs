//! Pictures for calibration: the checkerboard in many poses (some of them bad) and the three-sphere frame of the axes.

use super::look::Look;
use super::sampling::{INSTANTS, SAMPLES, hit_capsule, hit_sphere, pattern};
use super::view::View;
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use rand::Rng;

/// Inner corners and size of the board.
pub const COLUMNS: usize = 9;
pub const ROWS: usize = 6;
pub const SQUARE_M: f64 = 0.060;
/// White rim round the squares, m.
const RIM_M: f64 = 0.035;
pub const ARM_U_M: f64 = 0.600;
pub const ARM_W_M: f64 = 0.400;
const SPHERE_RADIUS_M: f64 = 0.022;

/// What may be wrong with a picture of the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum BoardFault {
    /// The board was moved during the exposure.
    Blurred,
    /// The sun on the board: white floods the black squares.
    Bloomed,
    /// A corner of the board is outside one picture.
    PartlyOut,
    /// The board is not in one picture.
    Missing,
}

/// A board in space: board axes (x along the columns, y along the rows, z toward the cameras) to global.
#[derive(Debug, Clone, Copy)]
pub struct Board {
    pub pose: Isometry3<f64>,
    pub fault: Option<BoardFault>,
    /// Camera that suffers from `PartlyOut` or `Missing`.
    pub faulty_camera: usize,
    /// How far the middle stands out of the plane of the edges, m: no board is quite flat.
    pub bow_m: f64,
}

impl Board {
    /// The inner corners in board axes, origin at the middle of the board.
    pub fn corners() -> impl Iterator<Item = Point3<f64>> {
        (0..ROWS).flat_map(|j| {
            (0..COLUMNS).map(move |i| Point3::new((i as f64 - 0.5 * (COLUMNS - 1) as f64) * SQUARE_M, (j as f64 - 0.5 * (ROWS - 1) as f64) * SQUARE_M, 0.0))
        })
    }

    /// Half sizes of the printed area with its rim, m.
    fn half() -> Vector2<f64> {
        Vector2::new(0.5 * (COLUMNS + 1) as f64, 0.5 * (ROWS + 1) as f64) * SQUARE_M + Vector2::repeat(RIM_M)
    }

    /// Projections of the corners that fall into the picture.
    pub fn corners_in(&self, view: &View) -> Vec<Option<Vector2<f64>>> {
        Self::corners().map(|c| view.project(&(self.pose * c)).filter(|p| view.holds(p))).collect()
    }

    /// Draws a pose: within the volume, seen by both cameras (by one only in part when `fault` says so).
    pub fn draw(views: &[View; 2], fault: Option<BoardFault>, faulty_camera: usize, rng: &mut impl Rng) -> Option<Board> {
        for _ in 0..4000 {
            let partly = fault == Some(BoardFault::PartlyOut);
            let spread = if partly { 1.25 } else { 0.85 };
            let centre = Point3::new(rng.random_range(-0.45..1.0), 0.98 + rng.random_range(-spread..spread), 0.25 + rng.random_range(-spread..spread));
            let mut tilt = || {
                let angle: f64 = rng.random_range(8.0..46.0_f64).to_radians();
                if rng.random::<bool>() { angle } else { -angle }
            };
            let (pitch, yaw) = (tilt(), tilt());
            let roll = rng.random_range(-0.5..0.5);
            // Board x runs against W, y down, z toward +U where the cameras stand.
            let facing = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[-Vector3::z(), -Vector3::y(), -Vector3::x()]));
            let turned = facing * Rotation3::from_euler_angles(pitch, yaw, roll);
            let pose = Isometry3::from_parts(Translation3::from(centre.coords), UnitQuaternion::from_rotation_matrix(&turned));
            let board = Board { pose, fault, faulty_camera, bow_m: 0.0 };
            let inside = [0, 1].map(|c| board.corners_in(&views[c]).iter().flatten().count());
            let whole = COLUMNS * ROWS;
            let margin = |view: &View| {
                let h = Self::half();
                [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].iter().all(|(a, b)| {
                    view.project(&(pose * Point3::new(a * h.x, b * h.y, 0.0)))
                        .is_some_and(|p| p.x > 3.0 && p.y > 3.0 && p.x < view.width as f64 - 4.0 && p.y < view.height as f64 - 4.0)
                })
            };
            // Neither edge-on nor square to a camera: 12 to 48 degrees off its line of sight.
            let slant = |view: &View| (pose.rotation * Vector3::z()).dot(&(centre - view.centre()).normalize()).clamp(-1.0, 1.0).acos().to_degrees();
            if !views.iter().all(|v| (12.0..48.0).contains(&slant(v))) {
                continue;
            }
            let other = 1 - faulty_camera;
            let good = if partly {
                inside[faulty_camera] < whole && inside[faulty_camera] > whole / 3 && inside[other] == whole
            } else {
                margin(&views[0]) && margin(&views[1])
            };
            if good {
                return Some(board);
            }
        }
        None
    }

    /// Draws the board into `light` (the backdrop on entry) of camera number `camera`.
    pub fn expose(&self, view: &View, camera: usize, look: &Look, light: &mut [f32]) {
        if self.fault == Some(BoardFault::Missing) && camera == self.faulty_camera {
            return;
        }
        // A moved board: some ten pixels during the exposure.
        let shake = if self.fault == Some(BoardFault::Blurred) { Vector3::new(0.0, 0.035, 0.03) } else { Vector3::zeros() };
        let poses: [Isometry3<f64>; INSTANTS] = std::array::from_fn(|i| {
            let mut pose = self.pose;
            pose.translation.vector += shake * ((i as f64 + 0.5) / INSTANTS as f64 - 0.5);
            (view.pose * pose).inverse()
        });
        let eyes = poses.map(|p| p * Point3::origin());
        let turns = poses.map(|p| *p.rotation.to_rotation_matrix().matrix());
        let half = Self::half();
        let normal = self.pose.rotation * Vector3::z();
        let (bright, dark) = (look.matt(look.board_white * 1.3, &-normal).min(look.board_white), look.board_black);
        let bloom = self.fault == Some(BoardFault::Bloomed);
        let colour = |x: f64, y: f64| -> Option<f64> {
            if x.abs() > half.x || y.abs() > half.y {
                return None;
            }
            let (i, j) = (x / SQUARE_M + 0.5 * (COLUMNS + 1) as f64, y / SQUARE_M + 0.5 * (ROWS + 1) as f64);
            let printed = i > 0.0 && j > 0.0 && i < (COLUMNS + 1) as f64 && j < (ROWS + 1) as f64;
            let mut black = printed && (i.floor() + j.floor()).rem_euclid(2.0) < 0.5;
            if bloom && black {
                // Light spreads a third of a square into the black.
                let edge = |t: f64| (t - t.floor()).min(t.ceil() - t);
                black = edge(i).min(edge(j)) > 0.36;
            }
            Some(if black {
                if bloom { 120.0 } else { dark }
            } else if bloom {
                255.0
            } else {
                bright
            })
        };
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(a, b)| self.pose * (Point3::new(a * half.x, b * half.y, 0.0)));
        let points: Vec<Vector2<f64>> = corners.iter().flat_map(|c| [c + shake * 0.5, c - shake * 0.5]).filter_map(|c| view.project(&c)).collect();
        draw_region(view, &points, 2.5, look, light, |direction, instant| {
            let d = turns[instant] * direction;
            let depth = -eyes[instant].z / d.z;
            let mut p = eyes[instant] + d * depth;
            if self.bow_m != 0.0 {
                // The bow is a few tenths of a millimetre: where the ray meets the plane is where it is high enough.
                let height = self.bow_m * (1.0 - 0.5 * ((p.x / half.x).powi(2) + (p.y / half.y).powi(2)));
                p += d * (height / d.z);
            }
            if depth > 0.0 { colour(p.x, p.y) } else { None }
        });
    }
}

/// Draws the three spheres and the rods of the axes frame into `light`.
pub fn expose_axes(view: &View, look: &Look, light: &mut [f32]) {
    let spheres = axes_spheres().map(|p| view.pose * p);
    let below = view.pose.rotation * Vector3::y() * -0.012;
    let sun = view.pose.rotation * look.light.into_inner();
    let shade = |brightness: f64, normal: Vector3<f64>| brightness * (0.75 + 0.25 * normal.dot(&sun).max(0.0));
    let points: Vec<Vector2<f64>> = axes_spheres().iter().filter_map(|p| view.project(p)).collect();
    draw_region(view, &points, 20.0, look, light, |direction, _| {
        let mut best: Option<(f64, f64)> = None;
        for s in &spheres {
            if let Some((depth, normal)) = hit_sphere(s, SPHERE_RADIUS_M, &Point3::origin(), direction) {
                best = Some(best.filter(|b| b.0 < depth).unwrap_or((depth, shade(look.sphere, normal))));
            }
        }
        for end in [1, 2] {
            let rod = hit_capsule(&(spheres[0] + below), &(spheres[end] + below), 0.006, &Point3::origin(), direction);
            if let Some((depth, normal)) = rod {
                best = Some(best.filter(|b| b.0 < depth).unwrap_or((depth, shade(look.frame, normal))));
            }
        }
        best.map(|b| b.1)
    });
}

/// Corner, end of the U arm, end of the W arm; global axes.
pub fn axes_spheres() -> [Point3<f64>; 3] {
    [Point3::origin(), Point3::new(ARM_U_M, 0.0, 0.0), Point3::new(0.0, 0.0, ARM_W_M)]
}

/// Samples every pixel of the box round `points`; `colour` gets a direction in camera axes and the instant.
fn draw_region(view: &View, points: &[Vector2<f64>], margin_px: f64, look: &Look, light: &mut [f32], colour: impl Fn(&Vector3<f64>, usize) -> Option<f64>) {
    let Some(first) = points.first() else { return };
    let (low, high) = points.iter().fold((*first, *first), |(l, h), p| (l.inf(p), h.sup(p)));
    let range = |a: f64, b: f64, n: usize| (a - margin_px).floor().clamp(0.0, n as f64) as usize..(b + margin_px).ceil().clamp(0.0, n as f64) as usize;
    let samples = pattern(look.blur_px);
    for v in range(low.y, high.y, view.height) {
        for u in range(low.x, high.x, view.width) {
            let behind = f64::from(light[v * view.width + u]);
            let sum: f64 =
                samples.iter().map(|s| colour(&view.direction(u as f64 + s.offset_px.x, v as f64 + s.offset_px.y), s.instant).unwrap_or(behind)).sum();
            light[v * view.width + u] = (sum / SAMPLES as f64) as f32;
        }
    }
}
