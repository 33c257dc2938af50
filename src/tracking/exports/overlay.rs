//! Contact sheets: every n-th picture of one camera side by side, with the tracks drawn in, frames of doubt first.
//!
//! What was measured is drawn as a ring (ball) or cross (tape) coloured by how far the two views disagree: green below
//! [`FINE_PX`], over yellow, to red at [`BAD_PX`]; blue where only one camera saw it. Where a hidden marker should be, by the markers
//! that are seen, is a magenta box. Markers carry their numbers. Behind each runs its track over the frames before.

use crate::calibration::{CameraId, StereoRig};
use crate::footage::{FootageError, FrameBuffer, FrameSource, GreyView, Rows};
use crate::tracking::racket::rigid_points::rigid_from_points;
use crate::tracking::track_file::{SpacePoint, Target, Tracks};
use image::{Rgb, RgbImage};
use nalgebra::{Point3, Vector2};
use std::collections::BTreeMap;

/// Residuals at and below this are green, at and above [`BAD_PX`] red.
pub const FINE_PX: f64 = 0.2;
pub const BAD_PX: f64 = 1.0;
/// Frames of doubt at the head of a sheet.
const DOUBTFUL: usize = 6;
/// Pictures of a sheet when no step is asked for, and most in any case.
const USUAL: usize = 20;
const MOST: usize = 400;
/// Frames of track drawn behind a point.
const TRAIL: u64 = 12;
/// Width of a sheet, px, that screens show well.
const SHEET_WIDTH_PX: usize = 1800;
/// Room around the tracks, px.
const MARGIN_PX: f64 = 24.0;
/// Largest sheet, px in all.
const MOST_PX: usize = 1 << 26;

/// Markers farther from their places on the racket tell nothing of a hidden one.
const SAME_FIGURE_M: f64 = 0.01;

const BLUE: Rgb<u8> = Rgb([90, 160, 255]);
const MAGENTA: Rgb<u8> = Rgb([255, 60, 255]);
const RED: Rgb<u8> = Rgb([230, 30, 30]);
const GREY: Rgb<u8> = Rgb([110, 110, 110]);
const WHITE: Rgb<u8> = Rgb([255, 255, 255]);

/// A shot's tracks, prepared for drawing.
pub struct Overlay<'a> {
    pub tracks: &'a Tracks,
    pub points: &'a [SpacePoint],
    pub rig: &'a StereoRig,
    /// In the racket's axes, m, where racket.toml has them.
    pub markers: Option<[Point3<f64>; 5]>,
}

/// One piece of a picture.
struct Piece {
    index: usize,
    frame: u64,
    doubtful: bool,
}

/// The part of the pictures that holds all tracks.
#[derive(Clone, Copy)]
struct Window {
    x0: usize,
    y0: usize,
    width: usize,
    height: usize,
    zoom: usize,
}

impl Overlay<'_> {
    /// The sheet of one camera; `every` n-th frame, 0 for about twenty frames in all. `None` when nothing was tracked.
    pub fn sheet(&self, source: &impl FrameSource, camera: CameraId, every: usize) -> Result<Option<RgbImage>, FootageError> {
        let Some(window) = self.window(camera) else { return Ok(None) };
        let residuals: BTreeMap<(u64, Target), f64> = self.points.iter().map(|p| ((p.frame, p.target), p.residual_px)).collect();
        let (width, height) = (window.width * window.zoom + 2, window.height * window.zoom + 2);
        let columns = (SHEET_WIDTH_PX / width).max(1);
        let mut pieces = self.pieces(source, camera, every);
        pieces.truncate(MOST.min(MOST_PX / (width * height * columns) * columns).max(1));
        let rows = pieces.len().div_ceil(columns);
        let mut sheet = RgbImage::new((columns * width) as u32, (rows * height) as u32);
        let mut buffer = FrameBuffer::default();
        for (k, piece) in pieces.iter().enumerate() {
            let (left, top) = (k % columns * width, k / columns * height);
            let mut tile = Tile { sheet: &mut sheet, left, top, window };
            match source.read(piece.index, camera.index(), Rows::ALL, &mut buffer) {
                Ok(true) => {
                    if let Some(view) = buffer.view() {
                        tile.picture(&view);
                    }
                }
                // A gap, or a picture that cannot be read: named elsewhere, grey here.
                Ok(false) | Err(_) => tile.fill(GREY),
            }
            self.draw(&mut tile, piece, camera, &residuals);
        }
        Ok(Some(sheet))
    }

    /// The frames shown: the most doubtful first, then every n-th.
    fn pieces(&self, source: &impl FrameSource, camera: CameraId, every: usize) -> Vec<Piece> {
        let index_of: BTreeMap<u64, usize> = (0..source.len()).map(|i| (source.number(i), i)).collect();
        let frames: Vec<u64> = self.tracks.frames().into_iter().filter(|f| index_of.contains_key(f)).collect();
        let every = if every == 0 { frames.len().div_ceil(USUAL).max(1) } else { every };
        let mut doubts: Vec<(f64, u64)> = frames.iter().map(|f| (self.doubt(*f, camera), *f)).filter(|(d, _)| *d > 1.0).collect();
        doubts.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut out: Vec<Piece> = Vec::new();
        for (_, frame) in doubts {
            // Neighbours show the same trouble.
            if out.len() < DOUBTFUL && out.iter().all(|p| p.frame.abs_diff(frame) > 2) {
                out.push(Piece { index: index_of[&frame], frame, doubtful: true });
            }
        }
        out.extend(frames.iter().step_by(every).map(|f| Piece { index: index_of[f], frame: *f, doubtful: false }));
        out
    }

    /// How much a frame deserves a look: largest residual in units of [`FINE_PX`] times two, one for each hidden target.
    fn doubt(&self, frame: u64, camera: CameraId) -> f64 {
        let from = self.points.partition_point(|p| p.frame < frame);
        let worst = self.points[from..].iter().take_while(|p| p.frame == frame).map(|p| p.residual_px).fold(0.0, f64::max);
        let hidden = Target::ALL.iter().filter(|t| self.tracks.get(frame, camera, **t).is_none()).count();
        worst / (2.0 * FINE_PX) + hidden as f64
    }

    fn window(&self, camera: CameraId) -> Option<Window> {
        let seen = self.tracks.points.iter().filter(|p| p.camera == camera).filter_map(|p| p.point);
        let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        for p in seen {
            low = low.inf(&p.uv);
            high = high.sup(&p.uv);
        }
        let [w, h] = self.rig.image_size.map(|n| n as f64);
        let from = |v: f64, most: f64| (v - MARGIN_PX).clamp(0.0, most - 1.0).floor() as usize;
        let to = |v: f64, most: f64| (v + MARGIN_PX).clamp(1.0, most).ceil() as usize;
        if !(low.x <= high.x && low.y <= high.y) {
            return None;
        }
        let (x0, y0) = (from(low.x, w), from(low.y, h));
        let (width, height) = (to(high.x, w).saturating_sub(x0).max(1), to(high.y, h).saturating_sub(y0).max(1));
        Some(Window { x0, y0, width, height, zoom: if width <= 300 { 2 } else { 1 } })
    }

    /// Where a target is that one camera does not see: as the other sees it or, a marker, by three others.
    fn expected(&self, frame: u64, target: Target) -> Option<Point3<f64>> {
        let from = self.points.partition_point(|p| p.frame < frame);
        let seen = || self.points[from..].iter().take_while(|p| p.frame == frame);
        if let Some(point) = seen().find(|p| p.target == target) {
            return Some(point.position);
        }
        let markers = self.markers?;
        let (local, global): (Vec<_>, Vec<_>) = seen().filter_map(|p| Some((*markers.get(p.target.index())?, p.position))).unzip();
        let global_from_racket = rigid_from_points(&local, &global)?;
        let fits = local.iter().zip(&global).all(|(l, g)| (global_from_racket * l - g).norm() < SAME_FIGURE_M);
        Some(global_from_racket * markers.get(target.index()).filter(|_| fits)?)
    }

    fn draw(&self, tile: &mut Tile, piece: &Piece, camera: CameraId, residuals: &BTreeMap<(u64, Target), f64>) {
        let colour = |frame: u64, target: Target| residuals.get(&(frame, target)).map_or(BLUE, |r| shade(*r));
        for target in Target::ALL {
            let mut before: Option<Vector2<f64>> = None;
            for frame in piece.frame.saturating_sub(TRAIL)..=piece.frame {
                let now = self.tracks.get(frame, camera, target).map(|p| p.uv);
                if let (Some(a), Some(b)) = (before, now) {
                    tile.line(a, b, colour(frame, target));
                }
                before = now.or(before);
            }
            match self.tracks.get(piece.frame, camera, target) {
                Some(p) if target == Target::Ball => tile.ring(p.uv, 11.0, colour(piece.frame, target)),
                Some(p) => {
                    tile.cross(p.uv, colour(piece.frame, target));
                    tile.name(p.uv, target, colour(piece.frame, target));
                }
                None => {
                    if let Some(uv) = self.expected(piece.frame, target).and_then(|place| self.rig.project(camera, &place)) {
                        tile.square(uv, MAGENTA);
                        tile.name(uv, target, MAGENTA);
                    }
                }
            }
        }
        tile.border(if piece.doubtful { RED } else { GREY });
        tile.number(piece.frame, (2, 1), if piece.doubtful { RED } else { WHITE });
    }
}

/// Green, yellow, red by residual.
fn shade(residual_px: f64) -> Rgb<u8> {
    let s = ((residual_px - FINE_PX) / (BAD_PX - FINE_PX)).clamp(0.0, 1.0);
    let part = |v: f64| (255.0 * v.clamp(0.0, 1.0)) as u8;
    Rgb([part(2.0 * s), part(2.0 - 2.0 * s), 40])
}

/// One piece of the sheet, drawn on in full-picture coordinates.
struct Tile<'a> {
    sheet: &'a mut RgbImage,
    left: usize,
    top: usize,
    window: Window,
}

/// Tile pixels to a dot of a digit.
const DOT: usize = 2;
/// From a marker to its number, right and down, px.
const NAME_OFFSET_PX: f64 = 3.0;
/// Digits on a grid of 3 x 5, row by row from the top, highest bit left.
const DIGITS: [[u8; 5]; 10] = [
    [7, 5, 5, 5, 7],
    [2, 6, 2, 2, 7],
    [7, 1, 7, 4, 7],
    [7, 1, 7, 1, 7],
    [5, 5, 7, 1, 1],
    [7, 4, 7, 1, 7],
    [7, 4, 7, 5, 7],
    [7, 1, 1, 2, 2],
    [7, 5, 7, 5, 7],
    [7, 5, 7, 1, 7],
];

impl Tile<'_> {
    fn set(&mut self, x: usize, y: usize, colour: Rgb<u8>) {
        let (x, y) = ((self.left + x) as u32, (self.top + y) as u32);
        if x < self.sheet.width() && y < self.sheet.height() {
            self.sheet.put_pixel(x, y, colour);
        }
    }

    fn size(&self) -> (usize, usize) {
        (self.window.width * self.window.zoom + 2, self.window.height * self.window.zoom + 2)
    }

    fn picture(&mut self, view: &GreyView) {
        let w = self.window;
        for y in 0..w.height * w.zoom {
            let Some(row) = view.row(w.y0 + y / w.zoom) else { continue };
            for x in 0..w.width * w.zoom {
                if let Some(grey) = row.get(w.x0 + x / w.zoom) {
                    self.set(x + 1, y + 1, Rgb([*grey; 3]));
                }
            }
        }
    }

    fn fill(&mut self, colour: Rgb<u8>) {
        let (w, h) = self.size();
        (0..h).for_each(|y| (0..w).for_each(|x| self.set(x, y, colour)));
    }

    fn border(&mut self, colour: Rgb<u8>) {
        let (w, h) = self.size();
        (0..w).for_each(|x| [0, h - 1].into_iter().for_each(|y| self.set(x, y, colour)));
        (0..h).for_each(|y| [0, w - 1].into_iter().for_each(|x| self.set(x, y, colour)));
    }

    /// Place on the tile of a place in the picture (pixel centres).
    fn place(&self, uv: Vector2<f64>) -> Vector2<f64> {
        let corner = Vector2::new(self.window.x0 as f64, self.window.y0 as f64);
        (uv - corner + Vector2::repeat(0.5)) * self.window.zoom as f64 + Vector2::repeat(0.5)
    }

    /// A dot at a place on the tile; nothing outside it.
    fn dot(&mut self, at: Vector2<f64>, colour: Rgb<u8>) {
        let (w, h) = self.size();
        if at.x >= 1.0 && at.y >= 1.0 && at.x < (w - 1) as f64 && at.y < (h - 1) as f64 {
            self.set(at.x as usize, at.y as usize, colour);
        }
    }

    fn line(&mut self, from: Vector2<f64>, to: Vector2<f64>, colour: Rgb<u8>) {
        let (a, b) = (self.place(from), self.place(to));
        let steps = (b - a).amax().ceil().clamp(1.0, 4096.0) as usize;
        for k in 0..=steps {
            self.dot(a + (b - a) * (k as f64 / steps as f64), colour);
        }
    }

    fn ring(&mut self, uv: Vector2<f64>, radius_px: f64, colour: Rgb<u8>) {
        let (middle, radius) = (self.place(uv), radius_px * self.window.zoom as f64);
        let steps = (8.0 * radius) as usize;
        for k in 0..steps {
            let a = std::f64::consts::TAU * k as f64 / steps as f64;
            self.dot(middle + Vector2::new(a.cos(), a.sin()) * radius, colour);
        }
        self.dot(middle, colour);
    }

    /// Four arms that leave the point itself free.
    fn cross(&mut self, uv: Vector2<f64>, colour: Rgb<u8>) {
        for d in [Vector2::x(), -Vector2::x(), Vector2::y(), -Vector2::y()] {
            self.line(uv + d * 3.0, uv + d * 7.0, colour);
        }
    }

    fn square(&mut self, uv: Vector2<f64>, colour: Rgb<u8>) {
        let corner = |x: f64, y: f64| uv + Vector2::new(x, y) * 5.0;
        let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        for k in 0..4 {
            self.line(corners[k], corners[(k + 1) % 4], colour);
        }
    }

    /// A marker's number beside it; the ball's ring needs none.
    fn name(&mut self, uv: Vector2<f64>, target: Target, colour: Rgb<u8>) {
        let (at, (w, h)) = (self.place(uv + Vector2::repeat(NAME_OFFSET_PX)), self.size());
        let inside = at.x >= 1.0 && at.y >= 1.0 && at.x < w.saturating_sub(4 * DOT) as f64 && at.y < h.saturating_sub(7 * DOT) as f64;
        if inside && target != Target::Ball {
            self.number(target.index() as u64 + 1, (at.x as usize, at.y as usize), colour);
        }
    }

    /// A number on black; its upper left corner on the tile.
    fn number(&mut self, n: u64, (left, top): (usize, usize), colour: Rgb<u8>) {
        for (k, c) in n.to_string().bytes().enumerate() {
            let rows = DIGITS[usize::from(c - b'0') % 10];
            for y in 0..7 * DOT {
                for x in 0..4 * DOT {
                    let (row, column) = (y / DOT, x / DOT);
                    let lit = (1..=5).contains(&row) && column < 3 && rows[row - 1] >> (2 - column) & 1 == 1;
                    self.set(left + k * 4 * DOT + x, top + y, if lit { colour } else { Rgb([0, 0, 0]) });
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footage::GreyImage;
    use crate::tracking::racket::racket_pose::tests::rig;
    use crate::tracking::{ImagePoint, PointState, TrackPoint};
    use nalgebra::{Point3, Vector3};

    struct Dark(usize);

    impl FrameSource for Dark {
        fn len(&self) -> usize {
            self.0
        }

        fn number(&self, index: usize) -> u64 {
            10 + index as u64
        }

        fn read(&self, index: usize, _: usize, _: Rows, buffer: &mut FrameBuffer) -> Result<bool, FootageError> {
            buffer.put(GreyImage { width: 512, height: 512, pixels: vec![20; 512 * 512] });
            Ok(index != 4)
        }
    }

    #[test]
    fn truth_the_doubtful_frame_leads_and_points_take_their_residuals_colour() {
        let rig = rig();
        let (mut tracks, mut points) = (Tracks::default(), Vec::new());
        for frame in 10..20 {
            for camera in CameraId::BOTH {
                for target in Target::ALL {
                    let uv = Vector2::new(200.0 + 10.0 * target.index() as f64, 300.0);
                    let point = Some(ImagePoint { uv, sd: Vector2::repeat(0.1) });
                    tracks.points.push(TrackPoint { frame, camera, target, point, state: PointState::Measured });
                }
            }
            for target in Target::ALL {
                let residual_px = if frame == 16 && target == Target::Ball { 3.0 } else { 0.05 };
                points.push(SpacePoint { frame, t: 0.0, target, position: Point3::origin(), sd: Vector3::zeros(), residual_px });
            }
        }
        let overlay = Overlay { tracks: &tracks, points: &points, rig: &rig, markers: None };
        let pieces: Vec<(u64, bool)> = overlay.pieces(&Dark(10), CameraId::Left, 3).iter().map(|p| (p.frame, p.doubtful)).collect();
        assert_eq!(pieces, [(16, true), (10, false), (13, false), (16, false), (19, false)]);
        let sheet = overlay.sheet(&Dark(10), CameraId::Left, 3).expect("read").expect("tracked");
        // Zoomed twice; the first piece is frame 16: the ball's ring is red, the tape's crosses are green.
        let window = overlay.window(CameraId::Left).expect("tracked");
        let at = |u: f64, v: f64| {
            let p = |x: f64, corner: usize| ((x - corner as f64 + 0.5) * window.zoom as f64 + 0.5) as u32;
            *sheet.get_pixel(p(u, window.x0), p(v, window.y0))
        };
        assert_eq!(at(250.0, 300.0), shade(3.0));
        assert_eq!(at(200.0, 304.0), shade(0.0));
        assert_eq!(at(225.0, 290.0), Rgb([20; 3]));
        // Marker 1 carries a 1: its upright stroke between black.
        let name = |dots: f64, row: f64| at(200.0 + NAME_OFFSET_PX + (dots - 0.5) * 0.5 * DOT as f64, 300.0 + NAME_OFFSET_PX + (row - 0.5) * 0.5 * DOT as f64);
        assert_eq!([name(1.5, 3.5), name(0.5, 3.5), name(2.5, 3.5)], [shade(0.0), Rgb([0; 3]), Rgb([0; 3])]);
        assert!(Overlay { tracks: &Tracks::default(), points: &[], ..overlay }.sheet(&Dark(10), CameraId::Left, 3).expect("read").is_none());
    }

    #[test]
    fn truth_a_hidden_marker_is_expected_by_three_others_where_they_lie_on_the_racket() {
        let rig = rig();
        let markers = [[-0.2, 0.0, 0.0], [-0.1, 0.13, 0.0], [-0.1, -0.13, 0.0], [0.15, 0.05, 0.0], [0.15, -0.05, 0.0]].map(Point3::from);
        let pose = nalgebra::Isometry3::new(Vector3::new(0.3, 1.0, 0.1), Vector3::new(0.2, -0.7, 1.1));
        let seen = |target: Target, away: f64| SpacePoint {
            frame: 7,
            t: 0.0,
            target,
            position: pose * markers[target.index()] + Vector3::x() * away,
            sd: Vector3::zeros(),
            residual_px: 0.0,
        };
        let place = |points: &[SpacePoint]| Overlay { tracks: &Tracks::default(), points, rig: &rig, markers: Some(markers) }.expected(7, Target::M4);
        let three = [Target::M1, Target::M2, Target::M5].map(|target| seen(target, 0.0));
        assert!((place(&three).expect("three others") - pose * markers[3]).norm() < 1e-9);
        assert_eq!(place(&three[..2]), None);
        // One of them is elsewhere.
        assert_eq!(place(&[three[0], three[1], seen(Target::M5, 0.2)]), None);
        assert_eq!(place(&[three[0], seen(Target::M4, 0.2)]).map(|p| (p - pose * markers[3]).norm() > 0.1), Some(true));
    }
}
