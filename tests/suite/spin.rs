//! Spin of the ball: rendered balls with known spin, and the practice footage with its truth.

use crate::shared::shared;
use crate::spin_ball::{Markings, Picture, RADIUS_M, Scene, random_turn, rig, rig_of_poses};
use rand::{Rng, SeedableRng};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use std::collections::BTreeMap;
use std::path::Path;
use sweetspot::calibration::{Camera, CameraId, StereoRig};
use sweetspot::tracking::spin::{BallView, SpinEstimate, SpinSettings, estimate_spin};

fn numbers(v: &serde_json::Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn vector(v: &serde_json::Value) -> Vector3<f64> {
    Vector3::from_iterator(numbers(v))
}

fn pose(v: &serde_json::Value) -> Isometry3<f64> {
    let r: Vec<f64> = v["R"].as_array().unwrap().iter().flat_map(numbers).collect();
    let r = Rotation3::from_matrix(&Matrix3::from_row_slice(&r));
    Isometry3::from_parts(Translation3::from(vector(&v["t"])), UnitQuaternion::from_rotation_matrix(&r))
}

fn true_rig(truth: &serde_json::Value) -> StereoRig {
    let camera = |v: &serde_json::Value| {
        let d = numbers(&v["dist"]);
        let k = |i: usize, j: usize| v["K"][i][j].as_f64().unwrap();
        Camera { fx: k(0, 0), fy: k(1, 1), cx: k(0, 2), cy: k(1, 2), distortion: [d[0], d[1], d[2], d[3], d[4]], rms_px: 0.0, sd: BTreeMap::new() }
    };
    let c = &truth["cameras"];
    rig_of_poses([512, 512], [camera(&c["left"]), camera(&c["right"])], [pose(&c["left"]), pose(&c["right"])])
}

/// Processor time of this thread, ms (0 where the system does not tell).
fn cpu_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|n| n.parse::<f64>().ok()).unwrap_or(0.0) * 1e-6
}

/// Frame number at the end of a file's name.
fn frame_number(path: &Path) -> Option<u64> {
    let stem = path.file_stem()?.to_str()?;
    let digits: String = stem.chars().rev().skip_while(|c| !c.is_ascii_digit()).take_while(|c| c.is_ascii_digit()).collect();
    digits.chars().rev().collect::<String>().parse().ok()
}

/// Pictures of a practice shot with true centres, before first and after last contact.
fn practice_shot(session: &Path, id: &str, shot: &serde_json::Value) -> [Vec<Picture>; 2] {
    let mut out = [Vec::new(), Vec::new()];
    let end = shot["contact_time"].as_f64().unwrap();
    for camera in CameraId::BOTH {
        let folder = session.join("shots").join(id).join(camera.name());
        let files: BTreeMap<u64, _> =
            std::fs::read_dir(folder).unwrap().filter_map(|e| e.ok()).filter_map(|e| Some((frame_number(&e.path())?, e.path()))).collect();
        for f in shot["frames"].as_array().unwrap() {
            let t = f["t"].as_f64().unwrap();
            let ball = &f["cameras"][camera.name()]["ball"];
            let side = usize::from(t > end);
            if (0.0..=end).contains(&t) || !ball["visible"].as_bool().unwrap_or(false) {
                continue;
            }
            let Some(path) = files.get(&f["frame"].as_u64().unwrap()) else { continue };
            let picture = image::load_from_memory(&std::fs::read(path).unwrap()).unwrap().to_luma8();
            out[side].push(Picture {
                camera,
                time_s: t,
                size: (picture.width() as usize, picture.height() as usize),
                pixels: picture.into_raw(),
                left: 0,
                top: 0,
                centre_sd_px: 0.05,
                centre_px: Vector2::new(ball["u"].as_f64().unwrap(), ball["v"].as_f64().unwrap()),
                position: Point3::from(vector(&f["points"]["ball"])),
            });
        }
    }
    out
}

#[test]
fn real_practice_balls_turn_as_they_were_made_to() {
    let Some(folder) = shared("practice/footage") else { return };
    for name in ["lab-11", "court-12", "hard-13"] {
        let truth: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.join(format!("{name}.truth.json"))).unwrap()).unwrap();
        let rig = true_rig(&truth);
        for (id, shot) in truth["shots"].as_object().unwrap() {
            let sides = practice_shot(&folder.join(name), id, shot);
            for (pictures, key) in sides.iter().zip(["ball_in_w", "ball_out_w"]) {
                let views: Vec<BallView> = pictures.iter().map(Picture::view).collect();
                let expected = vector(&shot["global"][key]);
                let start = cpu_ms();
                let got = estimate_spin(&views, &rig, 0.033, &SpinSettings::new(1000.0));
                let ms = cpu_ms() - start;
                match &got {
                    SpinEstimate::Vector { omega_rad_s, covariance, frames_used, quality } => {
                        let miss = omega_rad_s - expected;
                        let z2 = miss.dot(&(covariance.try_inverse().unwrap() * miss));
                        eprintln!(
                            "{name} {id} {key}: |w| {:.1} rate {:+.2} % axis {:.2} deg  miss {:.2?} z2 {z2:.2} sd {:.2?} frames {frames_used} {quality:?} {ms:.0} ms",
                            expected.norm(),
                            100.0 * (omega_rad_s.norm() / expected.norm() - 1.0),
                            omega_rad_s.angle(&expected).to_degrees(),
                            miss.as_slice(),
                            covariance.diagonal().map(f64::sqrt).as_slice()
                        );
                    }
                    other => eprintln!("{name} {id} {key}: |w| {:.1} {expected:?}: {other:?} {ms:.0} ms", expected.norm()),
                }
            }
        }
    }
}

/// Spins of random direction between the rates.
fn random_spin(random: &mut rand_chacha::ChaCha8Rng, slowest: f64, fastest: f64) -> Vector3<f64> {
    let rate = random.random_range(slowest..fastest);
    random_turn(random) * Vector3::x() * rate
}

/// What became of a number of rendered balls of one kind.
#[derive(Default, Debug)]
struct Tally {
    /// Relative error of the rate, angle between the axes (deg), squared normalised error (3 degrees of freedom).
    rate: Vec<f64>,
    axis_deg: Vec<f64>,
    z2: Vec<f64>,
    one_axis_z: Vec<f64>,
    refused: Vec<String>,
    ms: Vec<f64>,
}

fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|v| v * v).sum::<f64>() / x.len().max(1) as f64).sqrt()
}

impl Tally {
    fn worst_rate(&self) -> f64 {
        self.rate.iter().fold(0.0, |m, r| m.max(r.abs()))
    }

    fn worst_axis_deg(&self) -> f64 {
        self.axis_deg.iter().fold(0.0, |m, a| m.max(*a))
    }

    /// Mean squared normalised error per component; 1 when the covariance is right.
    fn z2_mean(&self) -> f64 {
        self.z2.iter().sum::<f64>() / (3 * self.z2.len()).max(1) as f64
    }

    fn add(&mut self, got: &SpinEstimate, omega: &Vector3<f64>, label: &str) {
        match got {
            SpinEstimate::Vector { omega_rad_s, covariance, quality, .. } => {
                let miss = omega_rad_s - omega;
                self.z2.push(miss.dot(&(covariance.try_inverse().unwrap() * miss)));
                self.rate.push(omega_rad_s.norm() / omega.norm() - 1.0);
                self.axis_deg.push(omega_rad_s.angle(omega).to_degrees());
                if std::env::var_os("TELL").is_some() {
                    eprintln!(
                        "{label} |w| {:.1} rate {:+.2} % axis {:.2} deg miss {:.2?} z2 {:.2} sd {:.2?} {quality:?}",
                        omega.norm(),
                        100.0 * self.rate.last().unwrap(),
                        self.axis_deg.last().unwrap(),
                        miss.as_slice(),
                        self.z2.last().unwrap(),
                        covariance.diagonal().map(f64::sqrt).as_slice(),
                    );
                }
            }
            SpinEstimate::OneAxis { axis, rate_rad_s, sd_rad_s, .. } => {
                self.one_axis_z.push((rate_rad_s - omega.dot(axis)) / sd_rad_s);
                if std::env::var_os("TELL").is_some() {
                    eprintln!("{label} |w| {:.1} {:?} along {axis:.3?}: {rate_rad_s:.1} sd {sd_rad_s:.1}, true {:.1}", omega.norm(), omega.as_slice(), omega.dot(axis));
                }
            }
            SpinEstimate::Refused { reason } => {
                if std::env::var_os("TELL").is_some() {
                    eprintln!("{label} |w| {:.1} {:.1?}: {reason}", omega.norm(), omega.as_slice());
                }
                self.refused.push(reason.to_string());
            }
        }
    }

    fn tell(&self, label: &str) {
        eprintln!(
            "{label}: {} vectors, rate rms {:.2} % worst {:.2} %, axis rms {:.2} worst {:.2} deg, z2 per component {:.2}; {} one-axis (z rms {:.2}), {} refused; {:.0} ms each",
            self.rate.len(),
            100.0 * rms(&self.rate),
            100.0 * self.worst_rate(),
            rms(&self.axis_deg),
            self.worst_axis_deg(),
            self.z2_mean(),
            self.one_axis_z.len(),
            rms(&self.one_axis_z),
            self.refused.len(),
            self.ms.iter().sum::<f64>() / self.ms.len().max(1) as f64
        );
    }
}

/// Renders and measures `n` balls: rates between the two, the scene as `change` leaves it.
fn tally(label: &str, n: u64, rates: (f64, f64), change: impl Fn(&mut Scene, &mut rand_chacha::ChaCha8Rng)) -> Tally {
    let rig = rig();
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(label.bytes().map(u64::from).sum());
    let mut out = Tally::default();
    let n = std::env::var("N").ok().and_then(|s| s.parse().ok()).unwrap_or(n);
    for k in 0..n {
        let omega = random_spin(&mut random, rates.0, rates.1);
        let mut scene = Scene::usual(omega, random.random());
        change(&mut scene, &mut random);
        let pictures = scene.render(&rig);
        let views: Vec<BallView> = pictures.iter().map(Picture::view).collect();
        let start = cpu_ms();
        let got = estimate_spin(&views, &rig, RADIUS_M, &SpinSettings::new(scene.frame_rate_hz));
        out.ms.push(cpu_ms() - start);
        out.add(&got, &omega, &format!("  {label} {k}"));
    }
    out.tell(label);
    out
}

fn lines_and_dots(random: &mut rand_chacha::ChaCha8Rng) -> Markings {
    let mut dots: Vec<(Vector3<f64>, f64)> = (0..5).map(|_| (random_turn(random) * Vector3::x(), random.random_range(0.12..0.3))).collect();
    dots.push((random_turn(random) * Vector3::x(), 0.35));
    Markings::Dots(dots)
}

#[test]
fn law_two_drawn_lines() {
    tally("two lines", 12, (84.0, 300.0), |_, _| {});
}

#[test]
fn law_fast() {
    tally("fast", 6, (300.0, 500.0), |_, _| {});
}

#[test]
fn law_slow() {
    tally("slow", 6, (10.0, 80.0), |_, _| {});
}

#[test]
fn law_dots() {
    tally("dots", 8, (84.0, 300.0), |s, r| s.markings = lines_and_dots(r));
}

#[test]
fn law_three_lines() {
    tally("three lines", 6, (84.0, 300.0), |s, r| {
        let turn = random_turn(r);
        s.markings = Markings::Circles([Vector3::x(), Vector3::y(), Vector3::z()].map(|a| (turn * a, 0.0, 0.05)).to_vec());
    });
}

#[test]
fn law_hard() {
    tally("hard", 8, (84.0, 300.0), |s, _| {
        s.noise = 5.0;
        s.bright = 90.0;
        s.ink = 0.45;
        s.frames = 25;
        s.blur_px = 0.75;
        s.background = 100.0;
        s.centre_sd_px = 0.15;
    });
}

#[test]
fn law_one_line() {
    tally("one line", 6, (84.0, 300.0), |s, r| s.markings = Markings::Circles(vec![(random_turn(r) * Vector3::x(), 0.0, 0.06)]));
}

#[test]
fn law_one_line_about_its_own_axis() {
    tally("line about its axis", 4, (84.0, 300.0), |s, _| s.markings = Markings::SpinCircle);
}

#[test]
fn fails_without_markings() {
    tally("bare", 4, (84.0, 300.0), |s, _| s.markings = Markings::None);
}

#[test]
fn law_short() {
    tally("short", 6, (84.0, 300.0), |s, _| s.frames = 7);
}
