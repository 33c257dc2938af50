//! Marker positions from a photograph, against a picture whose racket is known: a ray-cast racket with white tape on a black
//! tube lies on a ruled sheet, seen by a tilted camera whose lens distorts.

use nalgebra::{Matrix3, Point3, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sweetspot::footage::GreyImage;
use sweetspot::kinematics::{GridError, GridPhotograph, TapeError, tape_places};

use super::kinematics_world::racket;
use std::sync::OnceLock;

const SIZE: (usize, usize) = (1700, 900);
const TUBE: f64 = 0.010;
/// Half the width of a tape, m.
const TAPE: f64 = 0.006;

struct Scene {
    camera: Point3<f64>,
    /// Rows: right, down, forward.
    turn: Matrix3<f64>,
    focal: f64,
    radial: f64,
    /// Racket on the sheet: place of the stringbed centre, direction of its x axis.
    origin: Vector2<f64>,
    angle: f64,
    markers: [Vector2<f64>; 5],
}

impl Scene {
    fn new(tilt: f64) -> Self {
        let camera = Point3::new(0.10, 0.02 - 1.4 * tilt, 1.4);
        let forward = (Point3::new(0.10, 0.02, 0.0) - camera).normalize();
        let right = Vector3::x();
        let down = forward.cross(&right);
        let turn = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
        // On the ellipse of the head's tube (inner 0.335 by 0.255, tube 0.010), and in the throat.
        let markers = [[-0.1775, 0.001], [0.0, -0.1375], [0.0, 0.1375], [0.2, -0.045], [0.2, 0.045]].map(|[x, y]| Vector2::new(x, y));
        Scene { camera, turn, focal: 2900.0, radial: -0.03, origin: Vector2::new(-0.05, 0.03), angle: 0.12, markers }
    }

    fn on_sheet(&self, local: &Vector2<f64>) -> Vector2<f64> {
        let (s, c) = self.angle.sin_cos();
        // Seen from above with y to the right of x's opposite: z points up.
        self.origin + Vector2::new(c * local.x - s * local.y, s * local.x + c * local.y)
    }

    fn pixel(&self, p: &Point3<f64>) -> Vector2<f64> {
        let q = self.turn * (p - self.camera);
        let middle = Vector2::new(SIZE.0 as f64 - 1.0, SIZE.1 as f64 - 1.0) / 2.0;
        let straight = Vector2::new(self.focal * q.x / q.z, self.focal * q.y / q.z);
        let mut d = straight;
        for _ in 0..30 {
            d = straight / (1.0 + self.radial * d.norm_squared() / middle.norm_squared());
        }
        middle + d
    }

    fn ray(&self, uv: &Vector2<f64>) -> Vector3<f64> {
        let middle = Vector2::new(SIZE.0 as f64 - 1.0, SIZE.1 as f64 - 1.0) / 2.0;
        let d = uv - middle;
        let d = d * (1.0 + self.radial * d.norm_squared() / middle.norm_squared());
        self.turn.transpose() * Vector3::new(d.x / self.focal, d.y / self.focal, 1.0)
    }

    /// The tube's axis as pieces, each with its length along the tape it carries, if any: (from, to, tape's middle).
    fn tube(&self) -> Vec<(Point3<f64>, Point3<f64>)> {
        let lift = |p: Vector2<f64>| {
            let q = self.on_sheet(&p);
            Point3::new(q.x, q.y, TUBE)
        };
        let (a, b) = (0.1775, 0.1375);
        let head = (0..90).map(|k| {
            let at = |k: usize| (k as f64 / 90.0 * std::f64::consts::TAU).sin_cos();
            let ((s0, c0), (s1, c1)) = (at(k), at(k + 1));
            (lift(Vector2::new(a * c0, b * s0)), lift(Vector2::new(a * c1, b * s1)))
        });
        let arms = [-1.0, 1.0].into_iter().flat_map(|side| {
            // From the flank straight through the marker to the handle; beside the marker lies the head's tube.
            [(lift(Vector2::new(0.115, side * 0.1048)), lift(Vector2::new(0.26, side * 0.0028)))]
        });
        let handle = [(lift(Vector2::new(0.26, 0.0)), lift(Vector2::new(0.4975, 0.0)))];
        head.chain(arms).chain(handle).collect()
    }

    fn picture(&self, seed: u64) -> GreyImage {
        let pieces = self.tube();
        let tapes = self.markers.map(|m| {
            let q = self.on_sheet(&m);
            Point3::new(q.x, q.y, TUBE)
        });
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut pixels = Vec::with_capacity(SIZE.0 * SIZE.1);
        for y in 0..SIZE.1 {
            for x in 0..SIZE.0 {
                let mut sum = 0.0;
                let ray = self.ray(&Vector2::new(x as f64, y as f64));
                let sheet = self.camera + ray * (-self.camera.z / ray.z);
                let near: Vec<_> = pieces.iter().filter(|(a, b)| (sheet - (a + (b - a) * 0.5)).xy().norm() < 0.03 + 0.5 * (b - a).norm()).copied().collect();
                for (dx, dy) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                    sum += self.shade(&near, &tapes, &Vector2::new(x as f64 + dx, y as f64 + dy)) / 4.0;
                }
                let light = 0.8 + 0.2 * x as f64 / SIZE.0 as f64;
                let noise: f64 = (0..4).map(|_| rng.random_range(-2.0..2.0)).sum::<f64>() / 2.0;
                pixels.push((sum * light + noise).round().clamp(0.0, 255.0) as u8);
            }
        }
        GreyImage { width: SIZE.0, height: SIZE.1, pixels }
    }

    fn shade(&self, pieces: &[(Point3<f64>, Point3<f64>)], tapes: &[Point3<f64>; 5], uv: &Vector2<f64>) -> f64 {
        let ray = self.ray(uv).normalize();
        let sheet = self.camera + ray * (-self.camera.z / ray.z);
        for (a, b) in pieces {
            // Nearest approach of ray and axis, both as lines; the surface lies √(r² − d²) before it.
            let axis = b - a;
            let w = self.camera - a;
            let (aa, ar, aw, rw) = (axis.norm_squared(), axis.dot(&ray), axis.dot(&w), ray.dot(&w));
            let s = ((aw - ar * rw) / (aa - ar * ar)).clamp(0.0, 1.0);
            let on_axis = a + axis * s;
            let t = ray.dot(&(on_axis - self.camera));
            let d2 = (self.camera + ray * t - on_axis).norm_squared();
            if d2 < TUBE * TUBE {
                let sine = (1.0 - ar * ar / aa).sqrt();
                let surface = self.camera + ray * (t - (TUBE * TUBE - d2).sqrt() / sine);
                let direction = axis.normalize();
                let taped = tapes.iter().any(|m| (m - on_axis).norm() < 0.03 && (surface - m).dot(&direction).abs() < TAPE);
                return if taped { 235.0 } else { 35.0 };
            }
        }
        // Rulings 0.8 mm wide every centimetre, strings 1.3 mm over the sheet within the head.
        let ruled = [sheet.x, sheet.y].iter().any(|v| (v - 0.01 * (v / 0.01).round()).abs() < 0.0004);
        let (s, c) = self.angle.sin_cos();
        let d = Vector2::new(sheet.x, sheet.y) - self.origin;
        let local = Vector2::new(c * d.x + s * d.y, -s * d.x + c * d.y);
        let stringed = (local.x / 0.1675).hypot(local.y / 0.1275) < 1.0 && [local.x / 0.018, local.y / 0.014].iter().any(|v| (v - v.round()).abs() < 0.045);
        if stringed {
            150.0
        } else if ruled {
            70.0
        } else {
            225.0
        }
    }
}

/// The racket seen from straight above, drawn once for all tests.
fn level() -> &'static GreyImage {
    static PICTURE: OnceLock<GreyImage> = OnceLock::new();
    PICTURE.get_or_init(|| Scene::new(0.0).picture(1))
}

fn pointed(scene: &Scene) -> [Vector2<f64>; 5] {
    // As a person points: within some 2 mm.
    let off = [[3.0, -2.0], [-2.0, 4.0], [2.0, 2.0], [-3.0, -3.0], [1.0, 3.0]].map(|[x, y]| Vector2::new(x, y));
    std::array::from_fn(|k| {
        let q = scene.on_sheet(&scene.markers[k]);
        scene.pixel(&Point3::new(q.x, q.y, TUBE)) + off[k]
    })
}

#[test]
fn truth_markers_of_a_photographed_racket_within_half_a_millimetre() {
    for (tilt, seed) in [(0.0, 1), (0.25, 2)] {
        let scene = Scene::new(tilt);
        let image = if tilt == 0.0 { level().clone() } else { scene.picture(seed) };
        if let Some(folder) = std::env::var_os("SWEETSPOT_KEEP") {
            let path = std::path::Path::new(&folder).join(format!("photograph-{seed}.png"));
            image::GrayImage::from_raw(SIZE.0 as u32, SIZE.1 as u32, image.pixels.clone()).unwrap().save(path).unwrap();
            eprintln!("{:?}", pointed(&scene));
        }
        let sheet = GridPhotograph::find(&image, 0.01).unwrap();
        eprintln!("tilt {tilt}: {} squares, rms {:.3} px, {:.1} px/m", sheet.squares.len(), sheet.rms_px, sheet.px_per_m);
        assert!(sheet.squares.len() > 500 && sheet.rms_px < 0.3, "{} squares, {} px", sheet.squares.len(), sheet.rms_px);
        let camera = sheet.camera(1.4).unwrap();
        // Where the camera stands, in the sheet's own coordinates: distances to two known places.
        for local in [Vector2::new(-0.1775, 0.0), Vector2::new(0.2, -0.045)] {
            let q = scene.on_sheet(&local);
            let seen = sheet.to_sheet(&scene.pixel(&Point3::new(q.x, q.y, 0.0)));
            let (found, truth) = ((Vector2::new(camera.x, camera.y) - seen).norm(), (Vector2::new(scene.camera.x, scene.camera.y) - q).norm());
            assert!((found - truth).abs() < 0.02, "camera {found} against {truth} m");
        }
        let places = tape_places(&image, &sheet, &pointed(&scene), 1.4, &racket()).unwrap();
        for (k, (p, m)) in places.iter().zip(&scene.markers).enumerate() {
            let error = Vector2::new(p.local[0], p.local[1]) - (m - 0.5 * (scene.markers[1] + scene.markers[2]));
            eprintln!("  m{}: {:+.2} {:+.2} mm, stated ± {:.2}", k + 1, 1e3 * error.x, 1e3 * error.y, 1e3 * p.sd);
            assert!(error.norm() < 0.5e-3, "m{}: {error:?}", k + 1);
            assert!(error.amax() < 3.0 * p.sd, "m{}: {error:?} against {}", k + 1, p.sd);
        }
    }
}

#[test]
fn fails_a_picture_without_a_sheet_or_a_place_without_tape_is_named() {
    let blank = GreyImage { width: 400, height: 300, pixels: vec![128; 400 * 300] };
    assert!(matches!(GridPhotograph::find(&blank, 0.01), Err(GridError::TooFew { .. })));
    assert!(matches!(GridPhotograph::find(&blank, 0.0), Err(GridError::Value { .. })));
    let empty = GreyImage { width: 0, height: 0, pixels: Vec::new() };
    assert!(GridPhotograph::find(&empty, 0.01).is_err());
    let (scene, image) = (Scene::new(0.0), level());
    let sheet = GridPhotograph::find(image, 0.01).unwrap();
    let mut wrong = pointed(&scene);
    wrong[3] = Vector2::new(330.0, 450.0);
    assert!(matches!(tape_places(image, &sheet, &wrong, 1.4, &racket()), Err(TapeError::NotFound { marker: 4, .. })));
    wrong[3] = Vector2::new(-5.0, 3.0);
    assert!(tape_places(image, &sheet, &wrong, 1.4, &racket()).is_err());
}

#[test]
fn cli_racket_writes_the_markers_of_a_photograph_and_leaves_the_rest_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (photo, file, overlay) = (folder.path().join("p.png"), folder.path().join("racket.toml"), folder.path().join("seen.png"));
    image::GrayImage::from_raw(SIZE.0 as u32, SIZE.1 as u32, level().pixels.clone()).unwrap().save(&photo).unwrap();
    let text = format!("# borrowed from the club\n{}", toml::to_string(&racket()).unwrap());
    std::fs::write(&file, &text).unwrap();
    let measure = |overlay: &std::path::Path| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_sweetspot"));
        command.arg("racket").arg(&file).arg("--photo").arg(&photo).args(["--camera-height", "1.4", "--write", "--json", "--overlay"]).arg(overlay);
        for uv in pointed(&Scene::new(0.0)) {
            command.args(["--tape", &format!("{:.0},{:.0}", uv.x, uv.y)]);
        }
        command.output().unwrap()
    };
    // What was measured on is not drawn over, nor is the racket's file.
    for given in [&photo, &file] {
        let (before, out) = (std::fs::read(given).unwrap(), measure(given));
        assert!(out.status.code() == Some(2) && String::from_utf8_lossy(&out.stderr).contains("would replace it"), "{}", String::from_utf8_lossy(&out.stderr));
        assert!(std::fs::read(given).unwrap() == before);
    }
    let out = measure(&overlay);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(written.starts_with("# borrowed from the club\n") && written.contains("tension_lb") && written.contains("from a photograph"), "{written}");
    let read: sweetspot::equipment::Racket = toml::from_str(&written).unwrap();
    let (m, json) = (read.markers.unwrap(), serde_json::from_slice::<serde_json::Value>(&out.stdout).unwrap());
    assert!((m.m1[0] + 0.1775).abs() < 1e-3 && (m.m5[1] - 0.045).abs() < 1e-3 && json["markers"][4]["sd"].as_f64().unwrap() > 1e-4);
    assert!(image::open(&overlay).unwrap().width() == SIZE.0 as u32);
    // Four tapes are no racket.
    let few = std::process::Command::new(env!("CARGO_BIN_EXE_sweetspot"))
        .arg("racket")
        .arg(&file)
        .arg("--photo")
        .arg(&photo)
        .args(["--camera-height", "1.4", "--tape", "10,10"])
        .output()
        .unwrap();
    assert!(few.status.code() == Some(2) && String::from_utf8_lossy(&few.stderr).contains("five times"));
}
