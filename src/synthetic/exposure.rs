//! One exposure: racket, ball and arm drawn over the backdrop, and what of each target the camera really saw.
//!
//! Only tiles of 4 x 4 px that something moving can reach are drawn; each sample has its own place within the pixel and
//! its own instant within the exposure.

use super::look::Look;
use super::motion::ShotMotion;
use super::player::{Limb, Player};
use super::pressed::PressedBall;
use super::racket_shape::{Paint, RacketShape, SeenTube};
use super::sampling::{INSTANTS, SAMPLES, hit_capsule, hit_sphere, instants, pattern};
use super::view::View;
use nalgebra::{Isometry3, Matrix3, Point3, UnitQuaternion, Vector2, Vector3};

const TILE: usize = 4;
/// A pressed ball is no wider than so many times the round one.
const WIDEST: f64 = 1.3;
/// Half width of the lines drawn round the ball, as the sine of the angle.
const LINE: f64 = 0.045;

/// What moves.
#[derive(Debug, Clone)]
pub struct Scene<'a> {
    pub motion: &'a ShotMotion,
    pub shape: &'a RacketShape,
    pub ball_radius_m: f64,
    /// Ball axes to the axes of its drawn lines.
    pub ball_marking: UnitQuaternion<f64>,
    pub player: Option<&'a Player>,
    /// A marker whose tape is covered.
    pub hidden_marker: Option<usize>,
    /// A thread above the butt.
    pub hung: bool,
}

/// What a camera saw of one target (markers 1 to 5, then the ball).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sight {
    /// Projection of the marker's point or of the ball's centre at mid-exposure, px.
    pub u: f64,
    pub v: f64,
    pub in_picture: bool,
    /// Share of the target, as far as it faces the camera, that nothing covers.
    pub fraction: f64,
    /// Centroid of what is visible, px.
    pub patch: Option<(f64, f64)>,
    /// Area of what is visible, px.
    pub patch_px: f64,
}

/// What a sample's line of sight can meet in one tile.
#[derive(Default, Clone)]
struct Tile {
    tubes: Vec<u16>,
    limbs: Vec<u16>,
    strings: bool,
    ball: bool,
}

/// Draws the moving things of time `t` into `light` (the backdrop on entry).
pub fn expose(view: &View, scene: &Scene, look: &Look, t: f64, exposure_s: f64, light: &mut [f32]) -> [Sight; 6] {
    let times = instants(exposure_s).map(|dt| t + dt);
    let rackets = times.map(|t| scene.motion.racket(t));
    let balls = times.map(|t| scene.motion.ball(t));
    let limbs: [Vec<Limb>; INSTANTS] = std::array::from_fn(|i| limbs_of(scene, &rackets[i]));
    let tiles = tiles_of(view, scene, &rackets, &balls, &limbs);
    let side = (rackets[0].rotation * Vector3::z()).dot(&(balls[0].translation.vector - rackets[0].translation.vector)).signum();
    let sun = view.pose.rotation * look.light.into_inner();
    let moments: [Moment; INSTANTS] = std::array::from_fn(|k| {
        let flattening = scene.motion.flattening(times[k]);
        Moment::of(view, scene, &rackets[k], &balls[k], &limbs[k], &sun, flattening, side)
    });
    let samples = pattern(look.blur_px).map(|s| (s, view.beside_pixel(&s.offset_px)));
    let mut counts = [Count::default(); 6];
    let across = view.width.div_ceil(TILE);
    for (index, tile) in tiles.iter().enumerate() {
        if tile.tubes.is_empty() && tile.limbs.is_empty() && !tile.strings && !tile.ball {
            continue;
        }
        let (u0, v0) = ((index % across) * TILE, (index / across) * TILE);
        for v in v0..(v0 + TILE).min(view.height) {
            for u in u0..(u0 + TILE).min(view.width) {
                let behind = f64::from(light[v * view.width + u]);
                let mut sum = 0.0;
                for (s, place) in &samples {
                    let (pu, pv) = (u as f64 + s.offset_px.x, v as f64 + s.offset_px.y);
                    let met = moments[s.instant].along(tile, scene, look, &sun, &view.direction_beside(u, v, place), behind);
                    for m in (0..met.crossed.len()).filter(|m| met.crossed[*m]) {
                        counts[m].add(met.tape == Some(m), pu, pv);
                    }
                    if let Some(seen) = met.ball {
                        counts[5].add(seen, pu, pv);
                    }
                    sum += met.colour;
                }
                light[v * view.width + u] = (sum / SAMPLES as f64) as f32;
            }
        }
    }
    let now = scene.motion.racket(t);
    std::array::from_fn(|i| {
        let point = if i < 5 { now * scene.shape.markers[i] } else { Point3::from(scene.motion.ball(t).translation.vector) };
        counts[i].sight(view, &point)
    })
}

/// The moving things at one instant of the exposure, in camera axes or, for the racket, in its own: one rotation a sample.
struct Moment {
    racket_turn: Matrix3<f64>,
    eye: Point3<f64>,
    tubes: Vec<SeenTube>,
    sun_on_racket: Vector3<f64>,
    limbs: Vec<(Point3<f64>, Point3<f64>, f64, f64)>,
    ball_centre: Point3<f64>,
    ball_radius_m: f64,
    pressed: Option<PressedBall>,
    marking: Matrix3<f64>,
}

/// What one sample's line of sight meets.
struct Met {
    colour: f64,
    /// Markers whose tape is there, also behind other things; and the one whose tape is seen.
    crossed: [bool; 5],
    tape: Option<usize>,
    /// The ball is there; whether it is seen through nothing but strings.
    ball: Option<bool>,
}

impl Moment {
    /// `flattening` of a ball that lies on the `side` of the face.
    fn of(view: &View, scene: &Scene, racket: &Isometry3<f64>, ball: &Isometry3<f64>, limbs: &[Limb], sun: &Vector3<f64>, flattening: f64, side: f64) -> Self {
        let to_camera = view.pose;
        let from_camera = (to_camera * racket).inverse();
        let racket_turn = *from_camera.rotation.to_rotation_matrix().matrix();
        let eye = from_camera * Point3::origin();
        let ball_centre = to_camera * Point3::from(ball.translation.vector);
        let toward_strings = to_camera.rotation * racket.rotation * Vector3::z() * -side;
        Moment {
            racket_turn,
            tubes: scene.shape.seen_from(&eye),
            eye,
            sun_on_racket: racket_turn * sun,
            limbs: limbs.iter().map(|l| (to_camera * l.from, to_camera * l.to, l.radius, l.brightness)).collect(),
            ball_centre,
            ball_radius_m: scene.ball_radius_m,
            pressed: (flattening > 0.0).then(|| PressedBall::new(&ball_centre, scene.ball_radius_m, &toward_strings, flattening)),
            marking: *(scene.ball_marking * ball.rotation.inverse() * to_camera.rotation.inverse()).to_rotation_matrix().matrix(),
        }
    }

    fn along(&self, tile: &Tile, scene: &Scene, look: &Look, sun: &Vector3<f64>, direction: &Vector3<f64>, behind: f64) -> Met {
        let shade = |brightness: f64, cosine: f64| brightness * (look.ambient + (1.0 - look.ambient) * cosine.max(0.0));
        let on_racket = self.racket_turn * direction;
        let mut colour = behind;
        let mut nearest = f64::INFINITY;
        let (mut tape, mut crossed) = (None, [false; 5]);
        for &i in &tile.tubes {
            let Some(hit) = scene.shape.hit(usize::from(i), &self.tubes[usize::from(i)], &on_racket, scene.hidden_marker) else { continue };
            let of_marker = if let Paint::Tape(m) = hit.paint { Some(m) } else { None };
            if let Some(m) = of_marker {
                crossed[m] = true;
            }
            if hit.depth < nearest {
                nearest = hit.depth;
                tape = of_marker;
                let cosine = hit.normal.dot(&self.sun_on_racket);
                colour = match hit.paint {
                    Paint::Frame => shade(look.frame, cosine),
                    Paint::Ornament => shade(look.ornament, cosine),
                    Paint::Black => shade(look.black, cosine),
                    Paint::Tape(_) => look.tape * (1.0 - look.tape_shading + look.tape_shading * cosine.max(0.0)),
                    Paint::Grip => shade(look.grip, cosine),
                };
            }
        }
        for &i in &tile.limbs {
            let (from, to, radius, brightness) = &self.limbs[usize::from(i)];
            if let Some((depth, normal)) = hit_capsule(from, to, *radius, &Point3::origin(), direction)
                && depth < nearest
            {
                (nearest, tape) = (depth, None);
                colour = shade(*brightness, normal.dot(sun));
            }
        }
        let mut ball = None;
        if tile.ball
            && let Some((depth, normal, on_round_ball)) = self.hit_ball(direction)
        {
            ball = Some(depth < nearest);
            if depth < nearest {
                (nearest, tape) = (depth, None);
                let own = self.marking * on_round_ball;
                let line = own.x.abs() < LINE || own.y.abs() < LINE;
                let toward_limb = 1.0 + normal.dot(direction) / direction.norm();
                colour = shade(if line { look.ball_line } else { look.ball }, normal.dot(sun)) * (1.0 - look.felt_limb * toward_limb);
            }
        }
        if tile.strings
            && let Some(depth) = scene.shape.string_hit(&self.eye, &on_racket)
            && depth < nearest
        {
            colour = look.string;
        }
        Met { colour, crossed, tape, ball }
    }

    /// Depth, outward normal, and the direction the place had on the round ball.
    fn hit_ball(&self, direction: &Vector3<f64>) -> Option<(f64, Vector3<f64>, Vector3<f64>)> {
        match &self.pressed {
            Some(ball) => ball.hit(direction),
            None => hit_sphere(&self.ball_centre, self.ball_radius_m, &Point3::origin(), direction).map(|(depth, normal)| (depth, normal, normal)),
        }
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Count {
    all: u32,
    seen: u32,
    sum: Vector2<f64>,
}

impl Count {
    fn add(&mut self, seen: bool, u: f64, v: f64) {
        self.all += 1;
        if seen {
            self.seen += 1;
            self.sum += Vector2::new(u, v);
        }
    }

    fn sight(&self, view: &View, point: &Point3<f64>) -> Sight {
        let Some(uv) = view.project(point) else { return Sight::default() };
        let seen = f64::from(self.seen);
        Sight {
            u: uv.x,
            v: uv.y,
            in_picture: view.holds(&uv),
            fraction: if self.all > 0 { seen / f64::from(self.all) } else { 0.0 },
            patch: (self.seen > 0).then(|| (self.sum.x / seen, self.sum.y / seen)),
            patch_px: seen / SAMPLES as f64,
        }
    }
}

fn limbs_of(scene: &Scene, racket: &Isometry3<f64>) -> Vec<Limb> {
    let mut limbs = scene.player.map_or_else(Vec::new, |p| p.arm(racket, &scene.motion.hand));
    if scene.hung {
        let butt = racket * Point3::from(scene.motion.hand + Vector3::x() * super::impact_world::HAND_FROM_BUTT_M);
        limbs.push(super::backdrop::thread(&butt));
    }
    limbs
}

/// Pieces of one thing follow each other, so a repeat stands last.
fn mark_once(list: &mut Vec<u16>, i: usize) {
    if list.last() != Some(&(i as u16)) {
        list.push(i as u16);
    }
}

/// Which tiles each moving thing can reach during the exposure.
fn tiles_of(view: &View, scene: &Scene, rackets: &[Isometry3<f64>; INSTANTS], balls: &[Isometry3<f64>; INSTANTS], limbs: &[Vec<Limb>; INSTANTS]) -> Vec<Tile> {
    let (across, down) = (view.width.div_ceil(TILE), view.height.div_ceil(TILE));
    let mut tiles = vec![Tile::default(); across * down];
    let mut reach = |points: &mut dyn Iterator<Item = (Point3<f64>, f64)>, mark: &mut dyn FnMut(&mut Tile)| {
        let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        for (p, radius) in points {
            let depth = (view.pose * p).z;
            let Some(uv) = view.project(&p) else { return };
            let margin = Vector2::repeat(1.15 * view.camera.fx.max(view.camera.fy) * radius / depth.max(0.1) + 2.5);
            low = low.inf(&(uv - margin));
            high = high.sup(&(uv + margin));
        }
        let range =
            |a: f64, b: f64, n: usize| (a / TILE as f64).floor().clamp(0.0, n as f64) as usize..((b / TILE as f64).floor() + 1.0).clamp(0.0, n as f64) as usize;
        for j in range(low.y, high.y, down) {
            for i in range(low.x, high.x, across) {
                mark(&mut tiles[j * across + i]);
            }
        }
    };
    let ends = [0, INSTANTS - 1];
    // A long thing across the picture would mark a large box: it is marked piece by piece.
    const PIECES: usize = 8;
    let piece = |from: Point3<f64>, to: Point3<f64>, i: usize| from + (to - from) * (i as f64 / PIECES as f64);
    for (i, tube) in scene.shape.tubes.iter().enumerate() {
        let to = tube.end();
        let pieces = if tube.length > 0.05 { PIECES } else { 1 };
        for p in 0..pieces {
            let span = |j: usize| if pieces == 1 { if j == 0 { tube.from } else { to } } else { piece(tube.from, to, j) };
            let mut points = ends.iter().flat_map(|&k| [(rackets[k] * span(p), tube.radius), (rackets[k] * span(p + 1), tube.radius)]);
            reach(&mut points, &mut |t| mark_once(&mut t.tubes, i));
        }
    }
    let inner = scene.shape.inner();
    let mut rim = ends.iter().flat_map(|&k| {
        (0..16).map(move |a| {
            let (s, c) = (f64::from(a) * std::f64::consts::TAU / 16.0).sin_cos();
            (rackets[k] * Point3::new(inner.x * c, inner.y * s, 0.0), 0.005)
        })
    });
    reach(&mut rim, &mut |t| t.strings = true);
    for i in 0..limbs[0].len() {
        for p in 0..PIECES {
            let mut points = ends.iter().flat_map(|&k| {
                let l = &limbs[k][i];
                [(piece(l.from, l.to, p), l.radius), (piece(l.from, l.to, p + 1), l.radius)]
            });
            reach(&mut points, &mut |t| mark_once(&mut t.limbs, i));
        }
    }
    let mut centre = ends.iter().map(|&k| (Point3::from(balls[k].translation.vector), WIDEST * scene.ball_radius_m));
    reach(&mut centre, &mut |t| t.ball = true);
    tiles
}
