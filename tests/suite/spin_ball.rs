//! A small renderer of a marked ball in flight, for the tests of spin only: exact perspective, supersampled, blurred,
//! noisy. It shares nothing with the estimator but the camera model's projection.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::collections::BTreeMap;
use sweetspot::calibration::{Camera, CameraId, RigidTransform, StereoRig};
use sweetspot::footage::GreyView;
use sweetspot::tracking::spin::BallView;

/// What is drawn on the ball.
#[derive(Debug, Clone)]
pub enum Markings {
    /// Lines along circles: axis and height of the circle's plane (0 = great circle), half width in rad.
    Circles(Vec<(Vector3<f64>, f64, f64)>),
    /// Round dots: direction and angular radius.
    Dots(Vec<(Vector3<f64>, f64)>),
    /// One great circle whose plane stands across the spin: turning does not move it.
    SpinCircle,
    None,
}

impl Markings {
    fn dark(&self, b: &Vector3<f64>) -> bool {
        match self {
            Markings::Circles(c) => c.iter().any(|(axis, height, half)| (axis.dot(b).clamp(-1.0, 1.0).asin() - height).abs() < *half),
            Markings::Dots(d) => d.iter().any(|(at, r)| at.angle(b) < *r),
            Markings::SpinCircle | Markings::None => false,
        }
    }
}

#[derive(Debug, Clone)]
pub struct Scene {
    pub markings: Markings,
    pub omega: Vector3<f64>,
    pub frames: usize,
    pub frame_rate_hz: f64,
    pub velocity: Vector3<f64>,
    /// Grey of the unmarked ball in full light, of the ink relative to it, of the background.
    pub bright: f64,
    pub ink: f64,
    pub background: f64,
    pub blur_px: f64,
    pub noise: f64,
    pub centre_sd_px: f64,
    pub light: Vector3<f64>,
    /// Share of light that comes from everywhere.
    pub ambient: f64,
    /// Sudden changes of the lamps' brightness from frame to frame, share.
    pub flicker: f64,
    pub seed: u64,
}

pub struct Picture {
    pub camera: CameraId,
    pub time_s: f64,
    pub pixels: Vec<u8>,
    pub size: (usize, usize),
    pub left: i64,
    pub top: i64,
    pub centre_px: Vector2<f64>,
    pub centre_sd_px: f64,
    pub centre_shared_px: f64,
    pub position: Point3<f64>,
}

impl Picture {
    pub fn view(&self) -> BallView<'_> {
        let corner = [self.left, self.top].map(|first| usize::try_from(first).expect("inside the picture"));
        let picture = GreyView::patch(&self.pixels, corner.into(), self.size, (512, 512));
        BallView {
            camera: self.camera,
            time_s: self.time_s,
            picture,
            centre_px: self.centre_px,
            centre_sd_px: self.centre_sd_px,
            centre_shared_px: self.centre_shared_px,
            position: self.position,
        }
    }
}

pub const RADIUS_M: f64 = 0.033;

pub fn rig_of_poses(image_size: [usize; 2], cameras: [Camera; 2], camera_from_global: [Isometry3<f64>; 2]) -> StereoRig {
    let [left, right] = cameras;
    let right_from_left = camera_from_global[1] * camera_from_global[0].inverse();
    let between = RigidTransform::from_isometry(&right_from_left);
    StereoRig {
        image_size,
        left,
        right,
        r: between.r,
        t: between.t,
        rms_stereo_px: 0.0,
        pairs: Vec::new(),
        square_mm: None,
        global_from_left: RigidTransform::from_isometry(&camera_from_global[0].inverse()),
        more: BTreeMap::new(),
    }
}

/// Two cameras 12 m from the origin, 40 degrees apart, looking along −U with V up.
pub fn rig() -> StereoRig {
    let pose = |angle: f64| {
        let centre = Vector3::new(12.0 * angle.cos(), 1.2, 12.0 * angle.sin());
        let forward = (Vector3::new(0.0, 1.0, 0.0) - centre).normalize();
        let right = forward.cross(&Vector3::y()).normalize();
        let down = forward.cross(&right);
        let r = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[right, down, forward]).transpose());
        Isometry3::from_parts(Translation3::from(-(r * centre)), UnitQuaternion::from_rotation_matrix(&r))
    };
    let camera = |f: f64| Camera { fx: f, fy: f, cx: 250.0, cy: 260.0, distortion: [0.3, -0.5, 0.0, 0.0, 0.0], rms_px: 0.0, sd: BTreeMap::new() };
    rig_of_poses([512, 512], [camera(2950.0), camera(3050.0)], [pose(0.35), pose(-0.35)])
}

impl Scene {
    /// A fresh scene of the ordinary kind: two drawn lines, 20 frames at 1000 fps, noise 3 grey levels.
    pub fn usual(omega: Vector3<f64>, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let turn = random_turn(&mut random);
        Scene {
            markings: Markings::Circles(vec![(turn * Vector3::x(), 0.0, 0.06), (turn * Vector3::y(), 0.0, 0.06)]),
            omega,
            frames: 20,
            frame_rate_hz: 1000.0,
            velocity: Vector3::new(-24.0, 3.0, 5.0),
            bright: 190.0,
            ink: 0.3,
            background: 30.0,
            blur_px: 0.6,
            noise: 3.0,
            centre_sd_px: 0.05,
            light: Vector3::new(0.6, 0.75, 0.2).normalize(),
            ambient: 0.35,
            flicker: 0.02,
            seed,
        }
    }

    pub fn render(&self, rig: &StereoRig) -> Vec<Picture> {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed ^ 0x5bd1_e995);
        let attitude = random_turn(&mut random);
        let markings = match &self.markings {
            Markings::SpinCircle => Markings::Circles(vec![(attitude.inverse() * self.omega.normalize(), 0.0, 0.06)]),
            other => other.clone(),
        };
        let mut out = Vec::new();
        for k in 0..self.frames {
            let t = (k as f64 - 0.5 * self.frames as f64) / self.frame_rate_hz;
            let position = Point3::from(Vector3::new(0.3, 1.0, 0.1) + self.velocity * t + Vector3::new(0.0, -4.9 * t * t, 0.0));
            let body_from_global = (Rotation3::new(self.omega * t) * attitude).inverse();
            for camera in CameraId::BOTH {
                let gain = 1.0 + self.flicker * random.sample::<f64, _>(StandardNormal);
                out.push(self.picture(rig, &markings, camera, t, position, &body_from_global, gain, &mut random));
            }
        }
        out
    }

    fn picture(
        &self,
        rig: &StereoRig,
        markings: &Markings,
        camera: CameraId,
        time_s: f64,
        position: Point3<f64>,
        body: &Rotation3<f64>,
        gain: f64,
        random: &mut ChaCha8Rng,
    ) -> Picture {
        const HALF: i64 = 15;
        const FINE: usize = 5;
        let centre = rig.project(camera, &position).unwrap();
        let (left, top) = (centre.x.round() as i64 - HALF, centre.y.round() as i64 - HALF);
        let size = (2 * HALF + 1) as usize;
        let global_from_camera = rig.camera_from_global(camera).inverse();
        let eye = rig.centre(camera);
        let wide = size * FINE;
        let mut fine = vec![0.0; wide * wide];
        for row in 0..wide {
            for column in 0..wide {
                let at = |i: usize| (i as f64 + 0.5) / FINE as f64 - 0.5;
                let uv = Vector2::new(left as f64 + at(column), top as f64 + at(row));
                let p = rig.camera(camera).normalise(uv).unwrap();
                let ray = (global_from_camera.rotation * Vector3::new(p.x, p.y, 1.0)).normalize();
                let to = position - eye;
                let along = to.dot(&ray);
                let off2 = to.norm_squared() - along * along;
                fine[row * wide + column] = if off2 < RADIUS_M * RADIUS_M {
                    let hit = eye + ray * (along - (RADIUS_M * RADIUS_M - off2).sqrt());
                    let n = (hit - position) / RADIUS_M;
                    let light = self.ambient + (1.0 - self.ambient) * n.dot(&self.light).max(0.0);
                    let albedo = if markings.dark(&(body * n)) { self.ink } else { 1.0 };
                    self.bright * gain * light * albedo
                } else {
                    self.background
                };
            }
        }
        let blurred = blur(&fine, wide, self.blur_px * FINE as f64);
        let mut pixels = Vec::with_capacity(size * size);
        for row in 0..size {
            for column in 0..size {
                let mut sum = 0.0;
                for i in 0..FINE {
                    for j in 0..FINE {
                        sum += blurred[(row * FINE + i) * wide + column * FINE + j];
                    }
                }
                let noise: f64 = StandardNormal.sample(random);
                pixels.push((sum / (FINE * FINE) as f64 + self.noise * noise).round().clamp(0.0, 255.0) as u8);
            }
        }
        let mut shift = || self.centre_sd_px * random.sample::<f64, _>(StandardNormal);
        let centre_px = centre + Vector2::new(shift(), shift());
        Picture { camera, time_s, pixels, size: (size, size), left, top, centre_px, centre_sd_px: self.centre_sd_px.max(0.02), centre_shared_px: 0.0, position }
    }
}

pub fn random_turn(random: &mut ChaCha8Rng) -> Rotation3<f64> {
    let q: [f64; 4] = std::array::from_fn(|_| random.sample(StandardNormal));
    UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q[0], q[1], q[2], q[3])).to_rotation_matrix()
}

fn blur(x: &[f64], n: usize, sd: f64) -> Vec<f64> {
    if sd < 0.05 {
        return x.to_vec();
    }
    let reach = (3.5 * sd).ceil() as i64;
    let kernel: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sd).powi(2)).exp()).collect();
    let total: f64 = kernel.iter().sum();
    let pass = |x: &[f64], step: usize, other: usize| {
        let mut out = vec![0.0; n * n];
        for line in 0..n {
            for i in 0..n {
                let sum: f64 =
                    kernel.iter().enumerate().map(|(k, w)| w * x[line * other + (i as i64 + k as i64 - reach).clamp(0, n as i64 - 1) as usize * step]).sum();
                out[line * other + i * step] = sum / total;
            }
        }
        out
    };
    let once = pass(x, 1, n);
    pass(&once, n, 1)
}
