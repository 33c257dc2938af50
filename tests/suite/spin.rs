//! Spin of the ball: rendered balls with known spin, and the practice footage with its truth.

use crate::shared::shared;
use crate::spin_ball::{Picture, RADIUS_M, Scene, random_turn, rig, rig_of_poses};
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

#[test]
fn law_rendered_balls() {
    let rig = rig();
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let (mut z, mut rates) = (Vec::new(), Vec::new());
    let n: u64 = std::env::var("N").ok().and_then(|s| s.parse().ok()).unwrap_or(12);
    for seed in 0..n {
        let omega = random_spin(&mut random, 84.0, 300.0);
        let mut scene = Scene::usual(omega, seed);
        let env = |k: &str, d: f64| std::env::var(k).ok().and_then(|s| s.parse().ok()).unwrap_or(d);
        scene.noise = env("NOISE", scene.noise);
        scene.centre_sd_px = env("CENTRE", scene.centre_sd_px);
        scene.blur_px = env("SBLUR", scene.blur_px);
        scene.ambient = env("AMBIENT", scene.ambient);
        let pictures = scene.render(&rig);
        let views: Vec<BallView> = pictures.iter().map(Picture::view).collect();
        let start = cpu_ms();
        let got = estimate_spin(&views, &rig, RADIUS_M, &SpinSettings::new(1000.0));
        let ms = cpu_ms() - start;
        match &got {
            SpinEstimate::Vector { omega_rad_s, covariance, quality, .. } => {
                let miss = omega_rad_s - omega;
                let z2 = miss.dot(&(covariance.try_inverse().unwrap() * miss));
                z.push(z2);
                rates.push(omega_rad_s.norm() / omega.norm() - 1.0);
                eprintln!(
                    "sim {seed} |w| {:.1} rate {:+.2} % axis {:.2} deg miss {:.2?} z2 {z2:.2} sd {:.2?} noise {:.4} outl {:.3} margin {:?} {ms:.0} ms",
                    omega.norm(),
                    100.0 * rates.last().unwrap(),
                    omega_rad_s.angle(&omega).to_degrees(),
                    miss.as_slice(),
                    covariance.diagonal().map(f64::sqrt).as_slice(),
                    quality.noise,
                    quality.outliers,
                    quality.margin
                );
            }
            other => eprintln!("sim {seed} |w| {:.1} {omega:?}: {other:?} {ms:.0} ms", omega.norm()),
        }
    }
    let k = z.len() as f64;
    eprintln!("sim mean z2/3 {:.2}  mean rate {:+.3} %  rms rate {:.3} %", z.iter().sum::<f64>() / k / 3.0, 100.0 * rates.iter().sum::<f64>() / k, 100.0 * (rates.iter().map(|r| r * r).sum::<f64>() / k).sqrt());
}
