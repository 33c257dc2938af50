//! A session of footage with known truth: cameras, boards, axes, shots; pictures one by one and the truth beside them.

use super::backdrop::Backdrop;
use super::contact::ContactError;
use super::exposure::{Scene, Sight, expose};
use super::footage_spec::{FootageSpec, PictureFormat};
use super::hidden::{HiddenError, entry, nature};
use super::impact_world::{Approach, Kind, WorldImpact, draw, equipment, meet, stream};
use super::look::{Look, Sensor, Setting};
use super::measurement::TrueImpact;
use super::motion::{Hold, ShotMotion};
use super::player::Player;
use super::racket_shape::RacketShape;
use super::targets::{ARM_U_M, ARM_W_M, Board, BoardFault, COLUMNS, ROWS, SQUARE_M, axes_spheres, expose_axes};
use super::view::View;
use crate::equipment::{Ball, Racket};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha12Rng;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

const CAMERAS: [&str; 2] = ["left", "right"];

#[derive(Debug, thiserror::Error)]
pub enum FootageWorldError {
    #[error("`{key}` is {seen}; allowed: {allowed}")]
    Value { key: &'static str, seen: f64, allowed: &'static str },
    #[error(transparent)]
    Hidden(#[from] HiddenError),
    #[error("hidden effect {name:?} is a fault of measurement and cannot be seen in pictures; write a table (`kind = \"table\"`) instead")]
    NotInPictures { name: String },
    #[error("shot {id}: {source}")]
    Contact { id: String, source: ContactError },
    #[error("no place for the checkerboard in both pictures; make the pictures larger")]
    NoBoard,
    #[error("the axes frame is not in both pictures; make the pictures larger")]
    NoAxes,
    #[error("the cameras' distortion cannot be inverted over the whole picture")]
    Distortion,
    #[error("a picture could not be encoded ({0})")]
    Encode(String),
    #[error("{0}")]
    Sink(#[from] std::io::Error),
    #[error("interrupted")]
    Cancelled,
}

/// One shot, ready to be filmed.
struct Shot {
    id: String,
    hit: WorldImpact,
    truth: TrueImpact,
    approach: Approach,
    motion: ShotMotion,
    ball_marking: UnitQuaternion<f64>,
    /// Frame number of first contact, with its fraction.
    impact_frame: f64,
    frames: std::ops::RangeInclusive<i64>,
    faults: ShotFaults,
}

/// What a recording lost.
#[derive(Debug, Clone, Default)]
struct ShotFaults {
    missing: Option<(usize, Vec<i64>)>,
    duplicated: Option<(usize, i64)>,
    hidden_marker: Option<(usize, i64)>,
}

/// A session that can be filmed.
pub struct FootageWorld {
    pub spec: FootageSpec,
    pub racket: Racket,
    pub ball: Ball,
    look: Look,
    views: [View; 2],
    boards: Vec<Board>,
    shots: Vec<Shot>,
    player: Option<Player>,
    backdrop: Backdrop,
}

/// A picture to take.
#[derive(Clone, Copy)]
enum Picture {
    Board(usize, usize),
    Axes(usize),
    Frame { shot: usize, camera: usize, number: i64 },
}

/// Receives each file: path below the session folder, bytes. Called from several threads.
pub type Sink<'a> = dyn Fn(&str, &[u8]) -> std::io::Result<()> + Sync + 'a;

impl FootageWorld {
    /// Plans the session: cameras, board poses, impacts and motions. Nothing is drawn yet.
    pub fn new(spec: &FootageSpec) -> Result<FootageWorld, FootageWorldError> {
        spec.check()?;
        let world = nature(&spec.hidden)?;
        if !world.is_measured_rightly() {
            let name = spec.hidden.iter().find(|h| nature(std::slice::from_ref(h)).is_ok_and(|n| !n.is_measured_rightly()));
            return Err(FootageWorldError::NotInPictures { name: name.map(|h| h.effect.clone()).unwrap_or_default() });
        }
        let (racket, ball) = equipment();
        let look = Look::of(spec.setting);
        let mut look = if spec.matt { look.matted() } else { look };
        look.read_noise *= spec.noise;
        look.shot_noise *= spec.noise * spec.noise;
        let mut rng = ChaCha12Rng::seed_from_u64(spec.seed);
        let views = rig(spec.size_px, &mut rng)?;
        let mut boards = Vec::with_capacity(spec.boards);
        let bad = [BoardFault::Blurred, BoardFault::Bloomed, BoardFault::PartlyOut, BoardFault::Missing];
        for i in 0..spec.boards {
            let fault = if spec.bad_boards && i % 3 == 2 { bad.get(i / 3).copied() } else { None };
            let camera = rng.random_range(0..2);
            boards.push(Board::draw(&views, fault, camera, &mut rng).ok_or(FootageWorldError::NoBoard)?);
        }
        let court = spec.setting != Setting::Lab;
        let player = court.then(|| Player::new(Point3::new(0.0, 0.0, -1.15), look.skin));
        let mut shots = Vec::with_capacity(spec.shots);
        for i in 0..spec.shots {
            let mut rng = stream(spec.seed, 1 + i as u64);
            let id = format!("shot-{:02}", i + 1);
            let approach = place(spec, draw(if court { Kind::Court } else { Kind::Lab }, i as f64, &mut rng), &mut rng);
            let hit = meet(&racket, &ball, &approach, &world).map_err(|source| FootageWorldError::Contact { id: id.clone(), source })?;
            let truth = TrueImpact { grip_torque: (!court).then_some(approach.grip_torque), ..hit.truth };
            let impact_frame = rng.random_range(250.0..380.0_f64);
            let first = impact_frame.floor() as i64 - spec.frames_before as i64;
            let contact_frames = (hit.aftermath.contact_time_s * spec.frame_rate_hz).ceil() as i64;
            let last = impact_frame.floor() as i64 + contact_frames + spec.frames_after as i64;
            let lead = (spec.frames_before as f64 + 3.0) / spec.frame_rate_hz;
            let tail = (spec.frames_after as f64 + 4.0) / spec.frame_rate_hz + hit.aftermath.contact_time_s;
            let mut motion = ShotMotion::new(&hit, &racket, if court { Hold::Swung } else { Hold::Hung }, lead, tail);
            if spec.round_ball {
                motion.flattening = 0.0;
            }
            let mut faults = ShotFaults::default();
            if spec.setting == Setting::Hard {
                let gone = (0..3).map(|_| rng.random_range(first + 2..=last)).collect();
                faults.missing = Some((rng.random_range(0..2), gone));
                faults.duplicated = Some((rng.random_range(0..2), rng.random_range(first + 3..impact_frame.floor() as i64 - 2)));
                faults.hidden_marker = Some((rng.random_range(0..5), impact_frame.floor() as i64));
            }
            let random_axis = Vector3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
            let ball_marking = UnitQuaternion::from_scaled_axis(random_axis * 3.0);
            shots.push(Shot { id, hit, truth, approach, motion, ball_marking, impact_frame, frames: first..=last, faults });
        }
        Ok(FootageWorld { backdrop: Backdrop::new(spec.setting, spec.seed), spec: spec.clone(), racket, ball, look, views, boards, shots, player })
    }

    /// How many pictures [`Self::film`] takes.
    pub fn pictures(&self) -> usize {
        self.list().len()
    }

    fn list(&self) -> Vec<Picture> {
        let mut list = Vec::new();
        for camera in 0..2 {
            list.extend((0..self.boards.len()).map(|i| Picture::Board(i, camera)));
            list.push(Picture::Axes(camera));
        }
        for (shot, s) in self.shots.iter().enumerate() {
            for camera in 0..2 {
                list.extend(s.frames.clone().map(|number| Picture::Frame { shot, camera, number }));
            }
        }
        list
    }

    /// Takes every picture and hands all files of the session to `sink`; `tick` after each picture. Returns the truth, in
    /// the form of the practice material.
    pub fn film(&self, sink: &Sink, tick: &(dyn Fn() + Sync), cancel: &AtomicBool) -> Result<serde_json::Value, FootageWorldError> {
        let sensor = Sensor::new(&self.look, self.spec.black_level, self.spec.seed ^ 0x5E45);
        let body = self.player.as_ref().map_or_else(Vec::new, Player::body);
        let empty = [0, 1].map(|c| self.backdrop.draw(&self.views[c], &self.look, &[]));
        let filled = if body.is_empty() { empty.clone() } else { [0, 1].map(|c| self.backdrop.draw(&self.views[c], &self.look, &body)) };
        let shape = RacketShape::new(&self.racket).ok_or(FootageWorldError::Value { key: "markers", seen: 0.0, allowed: "a racket with markers" })?;
        let list = self.list();
        let sights: Vec<Option<[Sight; 6]>> = list
            .par_iter()
            .enumerate()
            .map(|(index, picture)| {
                if cancel.load(Ordering::Relaxed) {
                    return Err(FootageWorldError::Cancelled);
                }
                let sights = self.take(*picture, index as u64, &empty, &filled, &shape, &sensor, sink)?;
                tick();
                Ok(sights)
            })
            .collect::<Result<_, FootageWorldError>>()?;
        for (name, text) in self.texts()? {
            sink(&name, text.as_bytes())?;
        }
        Ok(self.truth(&list, &sights))
    }

    fn take(
        &self,
        picture: Picture,
        index: u64,
        empty: &[Vec<f32>; 2],
        filled: &[Vec<f32>; 2],
        shape: &RacketShape,
        sensor: &Sensor,
        sink: &Sink,
    ) -> Result<Option<[Sight; 6]>, FootageWorldError> {
        let noise = self.spec.seed.wrapping_mul(0x9E37_79B9).wrapping_add(index);
        let record = |camera: usize, light: &[f32]| self.encode(&sensor.record(light, self.views[camera].width, noise));
        match picture {
            Picture::Board(i, camera) => {
                let mut light = empty[camera].clone();
                self.boards[i].expose(&self.views[camera], camera, &self.look, &mut light);
                sink(&format!("calib/{}/{:03}.{}", CAMERAS[camera], i, self.extension(index)), &record(camera, &light)?)?;
                Ok(None)
            }
            Picture::Axes(camera) => {
                let mut light = empty[camera].clone();
                expose_axes(&self.views[camera], &self.look, &mut light);
                sink(&format!("axes/{}.{}", CAMERAS[camera], self.extension(index)), &record(camera, &light)?)?;
                Ok(None)
            }
            Picture::Frame { shot, camera, number } => {
                let s = &self.shots[shot];
                let view = &self.views[camera];
                let hidden = |n: i64| s.faults.hidden_marker.filter(|(_, from)| n >= *from).map(|(m, _)| m);
                let shoot = |n: i64| {
                    let mut light = filled[camera].clone();
                    let scene = Scene {
                        motion: &s.motion,
                        shape,
                        ball_radius_m: self.ball.radius_m(),
                        ball_marking: s.ball_marking,
                        player: self.player.as_ref(),
                        hidden_marker: hidden(n),
                        hung: self.spec.setting == Setting::Lab,
                    };
                    let sights = expose(view, &scene, &self.look, self.time(s, n), self.spec.exposure_s, &mut light);
                    (light, sights)
                };
                let (mut light, sights) = shoot(number);
                if s.faults.duplicated == Some((camera, number)) {
                    light = shoot(number - 1).0;
                }
                let gone = s.faults.missing.as_ref().is_some_and(|(c, n)| *c == camera && n.contains(&number));
                if !gone {
                    sink(&format!("shots/{}/{}/frame_{:06}.{}", s.id, CAMERAS[camera], number, self.extension(index)), &record(camera, &light)?)?;
                }
                Ok(Some(sights))
            }
        }
    }

    /// Time of the middle of a frame, s from first contact.
    fn time(&self, shot: &Shot, number: i64) -> f64 {
        (number as f64 - shot.impact_frame) / self.spec.frame_rate_hz
    }

    /// Extension of a file; in a hard session every fourth lies.
    fn extension(&self, index: u64) -> &'static str {
        let png = self.spec.format == PictureFormat::Png;
        let lies = self.spec.setting == Setting::Hard && index % 4 == 3;
        if png != lies { "png" } else { "bmp" }
    }

    fn encode(&self, pixels: &[u8]) -> Result<Vec<u8>, FootageWorldError> {
        use image::ImageEncoder;
        use image::codecs::{bmp::BmpEncoder, png};
        let mut bytes = Vec::with_capacity(pixels.len() + 2048);
        let (w, h) = (self.spec.size_px[0] as u32, self.spec.size_px[1] as u32);
        let done = match self.spec.format {
            PictureFormat::Bmp => BmpEncoder::new(&mut bytes).write_image(pixels, w, h, image::ExtendedColorType::L8),
            PictureFormat::Png => png::PngEncoder::new_with_quality(&mut bytes, png::CompressionType::Best, png::FilterType::Adaptive).write_image(
                pixels,
                w,
                h,
                image::ExtendedColorType::L8,
            ),
        };
        done.map_err(|e| FootageWorldError::Encode(e.to_string()))?;
        Ok(bytes)
    }

    /// The text files of the session.
    fn texts(&self) -> Result<Vec<(String, String)>, FootageWorldError> {
        let toml = |r: Result<String, toml::ser::Error>| r.map_err(|e| FootageWorldError::Encode(e.to_string()));
        let setting = match self.spec.setting {
            Setting::Lab => "lab",
            Setting::Court => "court",
            Setting::Hard => "hard",
        };
        let session = format!(
            "name = \"synthetic {setting} {}\"\nframe_rate_hz = {:?}\nexposure_s = {:?}\nracket = \"racket.toml\"\nball = \"ball.toml\"\n\n[calibration]\nboard_columns = {COLUMNS}\nboard_rows = {ROWS}\nsquare_m = {SQUARE_M:?}\nimages = \"calib\"\n\n[axes]\nimages = \"axes\"\narm_u_m = {ARM_U_M:?}\narm_w_m = {ARM_W_M:?}\n",
            self.spec.seed, self.spec.frame_rate_hz, self.spec.exposure_s
        );
        let (racket, ball) = (toml(toml::to_string(&self.racket))?, toml(toml::to_string(&self.ball))?);
        let whole = [("session.toml", session), ("racket.toml", racket), ("ball.toml", ball)].map(|(name, text)| (name.to_owned(), text));
        // What the mount of a laboratory was set to, no picture shows.
        let recorded = |s: &Shot| Some((format!("shots/{}/shot.toml", s.id), format!("grip_torque = {:?}\n", s.truth.grip_torque?)));
        Ok(whole.into_iter().chain(self.shots.iter().filter_map(recorded)).collect())
    }

    fn truth(&self, list: &[Picture], sights: &[Option<[Sight; 6]>]) -> serde_json::Value {
        use serde_json::{Map, Value, json};
        let mut of_frame = std::collections::BTreeMap::new();
        for (picture, sight) in list.iter().zip(sights) {
            if let (Picture::Frame { shot, camera, number }, Some(sight)) = (picture, sight) {
                of_frame.insert((*shot, *number, *camera), sight);
            }
        }
        let names = ["m1", "m2", "m3", "m4", "m5", "ball"];
        let camera = |v: &View| {
            let c = &v.camera;
            let r = v.pose.rotation.to_rotation_matrix();
            json!({
                "K": [[c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]],
                "dist": c.distortion,
                "R": rows(r.matrix()),
                "t": triple(&v.pose.translation.vector),
                "centre": triple(&v.centre().coords),
            })
        };
        let mut shots = Map::new();
        for (i, s) in self.shots.iter().enumerate() {
            let frames: Vec<Value> = s
                .frames
                .clone()
                .map(|n| {
                    let t = self.time(s, n);
                    let racket = s.motion.racket(t);
                    let markers = self.racket.markers.as_ref().map(crate::equipment::Markers::points).unwrap_or_default();
                    let mut points = Map::new();
                    for (k, name) in names.iter().enumerate() {
                        let p = if k < 5 { (racket * markers[k]).coords } else { s.motion.ball(t).translation.vector };
                        points.insert((*name).to_owned(), triple(&p));
                    }
                    let mut cameras = Map::new();
                    for (c, camera) in CAMERAS.iter().enumerate() {
                        let mut seen = Map::new();
                        if let Some(sights) = of_frame.get(&(i, n, c)) {
                            for (k, name) in names.iter().enumerate() {
                                seen.insert((*name).to_owned(), sight_json(&sights[k]));
                            }
                        }
                        cameras.insert((*camera).to_owned(), Value::Object(seen));
                    }
                    json!({"frame": n, "t": t, "points": points, "cameras": cameras, "flattening": s.motion.flattening(t)})
                })
                .collect();
            shots.insert(s.id.clone(), self.shot_json(s, frames));
        }
        let bad: Map<String, Value> = self
            .boards
            .iter()
            .enumerate()
            .filter_map(|(i, b)| {
                let both = matches!(b.fault, Some(BoardFault::Blurred | BoardFault::Bloomed));
                b.fault.map(|f| (format!("{i:03}"), json!({"kind": f, "camera": if both { "both" } else { CAMERAS[b.faulty_camera] }})))
            })
            .collect();
        let pairs: Map<String, Value> = self
            .boards
            .iter()
            .enumerate()
            .map(|(i, b)| {
                let uv = |v: &View| -> Vec<Value> {
                    Board::corners().map(|c| v.project(&(b.pose * c)).map_or(Value::Null, |p| json!([p.x, p.y]))).collect()
                };
                let r = b.pose.rotation.to_rotation_matrix();
                let value = json!({"R_board": rows(r.matrix()), "centre": triple(&b.pose.translation.vector), "corners_uv": {"left": uv(&self.views[0]), "right": uv(&self.views[1])}});
                (format!("{i:03}"), value)
            })
            .collect();
        let spheres = |v: &View| -> Vec<Value> { axes_spheres().iter().filter_map(|p| v.project(p)).map(|p| json!([p.x, p.y])).collect() };
        let laws: Vec<String> = self.spec.hidden.iter().filter_map(|h| entry(&h.effect).ok()).map(|e| format!("{}: {}", e.name, e.law)).collect();
        let aliases: Map<String, Value> =
            self.spec.hidden.iter().filter_map(|h| entry(&h.effect).ok()).map(|e| (e.name.to_owned(), json!(e.aliases))).collect();
        json!({
            "seed": self.spec.seed,
            "scenario": self.spec.setting,
            "image_size": self.spec.size_px,
            "pixel_convention": "centre of the top-left pixel is (0, 0); OpenCV distortion k1 k2 p1 p2 k3",
            "time_convention": "frame time is the middle of its exposure; t = 0 at first contact",
            "hidden": self.spec.hidden,
            "aliases": aliases,
            "laws": laws,
            "cameras": {"left": camera(&self.views[0]), "right": camera(&self.views[1])},
            "camera_names_swapped": self.views[0].centre().z < self.views[1].centre().z,
            "axes_spheres_uv": {"left": spheres(&self.views[0]), "right": spheres(&self.views[1])},
            "arm_u_m": ARM_U_M,
            "arm_w_m": ARM_W_M,
            "calib": {"bad": bad, "pairs": pairs},
            "shots": shots,
        })
    }

    fn shot_json(&self, s: &Shot, frames: Vec<serde_json::Value>) -> serde_json::Value {
        use serde_json::json;
        let row: serde_json::Map<String, serde_json::Value> = s.truth.named().map(|(name, v)| (name.to_owned(), json!(v))).collect();
        let (e, a) = (&s.hit.encounter, &s.hit.aftermath);
        let axes = s.approach.attitude.to_rotation_matrix();
        let mut missing = serde_json::Map::new();
        if let Some((c, n)) = &s.faults.missing {
            missing.insert(CAMERAS[*c].to_owned(), json!(n));
        }
        let mut duplicated = serde_json::Map::new();
        if let Some((c, n)) = s.faults.duplicated {
            duplicated.insert(CAMERAS[c].to_owned(), json!({"frame": n, "copy_of": n - 1}));
        }
        let hidden = s.faults.hidden_marker.map_or_else(
            || json!({}),
            |(m, from)| json!({"marker": format!("m{}", m + 1), "frames": s.frames.clone().filter(|n| *n >= from).collect::<Vec<i64>>()}),
        );
        json!({
            "racket": "racket.toml",
            "stroke": if self.spec.setting == Setting::Lab { "lab" } else { "forehand" },
            "ball_side_of_face": if (s.approach.ball - s.approach.racket).z < 0.0 { 1 } else { -1 },
            "contact_time": a.contact_time_s,
            "impacts_row": row,
            "global": {
                "ball_in": triple(&e.ball.velocity), "ball_out": triple(&a.ball.velocity),
                "ball_in_w": triple(&e.ball.rate), "ball_out_w": triple(&a.ball.rate),
                "racket_com_in": triple(&e.racket.velocity), "racket_com_out": triple(&a.racket.velocity),
                "racket_in_w": triple(&e.racket.rate), "racket_out_w": triple(&a.racket.rate),
                "racket_axes_at_contact": rows(axes.matrix()),
                "stringbed_centre_at_contact": triple(&s.approach.face_centre.coords),
                "ball_at_contact": triple(&e.ball.position.coords), "ball_at_release": triple(&a.ball.position.coords),
            },
            "impact_frame": s.impact_frame.round() as i64,
            "impact_frame_exact": s.impact_frame,
            "defects": {"missing": missing, "duplicated": duplicated, "hidden": hidden},
            "frames": frames,
        })
    }
}

fn sight_json(s: &Sight) -> serde_json::Value {
    serde_json::json!({
        "u": s.u, "v": s.v, "visible": s.in_picture && s.patch.is_some(), "fraction": s.fraction,
        "patch_u": s.patch.map(|p| p.0), "patch_v": s.patch.map(|p| p.1), "patch_px": s.patch_px,
    })
}

fn triple(v: &Vector3<f64>) -> serde_json::Value {
    serde_json::json!([v.x, v.y, v.z])
}

fn rows(m: &nalgebra::Matrix3<f64>) -> serde_json::Value {
    serde_json::json!([[m.m11, m.m12, m.m13], [m.m21, m.m22, m.m23], [m.m31, m.m32, m.m33]])
}

/// Puts an impact somewhere in the filmed volume, with the face turned a little from its mean attitude.
fn place(spec: &FootageSpec, mut approach: Approach, rng: &mut impl Rng) -> Approach {
    let court = spec.setting != Setting::Lab;
    let turn = if court { 0.14 } else { 0.06 };
    let mut small = |most: f64| rng.random_range(-most..most);
    approach.attitude = UnitQuaternion::from_scaled_axis(Vector3::new(small(turn), small(turn), small(turn))) * approach.attitude;
    approach.face_centre = Point3::new(0.32 + small(0.1), if court { 1.0 } else { 0.92 } + small(0.09), if court { 0.12 } else { 0.30 } + small(0.08));
    approach.ball_spin *= spec.spin;
    approach
}

/// Two cameras some twelve metres away toward the net, seven metres apart.
fn rig(size: [usize; 2], rng: &mut impl Rng) -> Result<[View; 2], FootageWorldError> {
    for _ in 0..50 {
        let views = draw_rig(size, rng)?;
        // The axes frame stands on the floor near the lower edge; both cameras must see all of it.
        let seen = |v: &View| axes_spheres().iter().all(|p| v.project(p).is_some_and(|uv| uv.y < size[1] as f64 - 12.0 && v.holds(&uv)));
        if views.iter().all(seen) {
            return Ok(views);
        }
    }
    Err(FootageWorldError::NoAxes)
}

fn draw_rig(size: [usize; 2], rng: &mut impl Rng) -> Result<[View; 2], FootageWorldError> {
    let mut one = |w: f64| {
        let mut near = |middle: f64, most: f64| middle + rng.random_range(-most..most);
        let place = Point3::new(near(11.8, 0.5), near(1.35, 0.25), near(w, 0.5));
        let target = Point3::new(near(0.3, 0.03), near(0.86, 0.03), near(0.28, 0.05));
        let scale = size[0].min(size[1]) as f64 / 512.0;
        let fx = near(2960.0, 100.0) * scale;
        let focal = [fx, fx * near(1.0, 1e-3)];
        let centre = [near(0.5 * size[0] as f64, 15.0 * scale), near(0.5 * size[1] as f64, 15.0 * scale)];
        let distortion = [near(0.0, 0.5), near(0.0, 2.0), near(0.0, 1.5e-3), near(0.0, 1.5e-3), 0.0];
        View::looking_at(place, target, focal, centre, distortion, size).ok_or(FootageWorldError::Distortion)
    };
    let pair = [one(3.7)?, one(-3.4)?];
    // Names say nothing of where a camera stands.
    let [a, b] = pair;
    Ok(if rng.random::<bool>() { [a, b] } else { [b, a] })
}
