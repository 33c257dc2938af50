//! Brightness of everything in a picture, 0 to 255, and the sensor that records it.

use nalgebra::{Unit, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// What kind of footage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Setting {
    /// Hung racket before a dark curtain.
    Lab,
    /// A player, cameras outdoors, advertisements behind.
    Court,
    /// Court with low contrast, strong noise, glints, lost and doubled frames, one marker hidden half of the time.
    Hard,
}

/// Brightness by surface.
#[derive(Debug, Clone)]
pub struct Look {
    pub tape: f64,
    pub black: f64,
    pub frame: f64,
    pub ornament: f64,
    pub grip: f64,
    pub string: f64,
    pub ball: f64,
    pub ball_line: f64,
    pub skin: f64,
    pub board_white: f64,
    pub board_black: f64,
    pub sphere: f64,
    /// Toward the light.
    pub light: Unit<Vector3<f64>>,
    /// Share of light that comes from everywhere.
    pub ambient: f64,
    /// Share of the tape's brightness that follows the light.
    pub tape_shading: f64,
    /// How much darker felt is at the limb, as a share.
    pub felt_limb: f64,
    /// Half width of the lens blur's triangular profile, px.
    pub blur_px: f64,
    /// Read noise, grey levels.
    pub read_noise: f64,
    /// Variance per grey level.
    pub shot_noise: f64,
}

impl Look {
    pub fn of(setting: Setting) -> Look {
        let lab = Look {
            tape: 238.0,
            black: 3.0,
            frame: 48.0,
            ornament: 95.0,
            grip: 26.0,
            string: 46.0,
            ball: 205.0,
            ball_line: 30.0,
            skin: 90.0,
            board_white: 178.0,
            board_black: 8.0,
            sphere: 240.0,
            light: Unit::new_normalize(Vector3::new(0.75, 0.6, 0.25)),
            ambient: 0.35,
            tape_shading: 0.10,
            felt_limb: 0.0,
            blur_px: 1.25,
            read_noise: 1.0,
            shot_noise: 0.02,
        };
        match setting {
            Setting::Lab => lab,
            Setting::Court => Look {
                tape: 250.0,
                black: 8.0,
                frame: 40.0,
                ornament: 120.0,
                grip: 60.0,
                string: 112.0,
                ball: 235.0,
                ball_line: 55.0,
                skin: 105.0,
                board_white: 190.0,
                light: Unit::new_normalize(Vector3::new(0.35, 0.85, 0.4)),
                ambient: 0.38,
                read_noise: 1.6,
                shot_noise: 0.035,
                ..lab
            },
            Setting::Hard => Look {
                tape: 205.0,
                black: 40.0,
                frame: 58.0,
                ornament: 150.0,
                grip: 66.0,
                string: 122.0,
                ball: 185.0,
                ball_line: 75.0,
                skin: 100.0,
                board_white: 160.0,
                board_black: 25.0,
                light: Unit::new_normalize(Vector3::new(0.3, 0.85, -0.4)),
                ambient: 0.5,
                blur_px: 1.6,
                read_noise: 3.0,
                shot_noise: 0.12,
                ..lab
            },
        }
    }

    /// The same with tape and felt as matt surfaces are.
    pub fn matted(self) -> Look {
        Look { tape_shading: 1.0 - self.ambient, felt_limb: 0.2, ..self }
    }

    /// Brightness of a matt surface with outward `normal` (global axes).
    pub fn matt(&self, brightness: f64, normal: &Vector3<f64>) -> f64 {
        brightness * (self.ambient + (1.0 - self.ambient) * normal.dot(&self.light).max(0.0))
    }
}

/// Grey noise from a table of deviates: as good as drawing each, and ten times as fast.
#[derive(Debug, Clone)]
pub struct Sensor {
    deviates: Vec<f32>,
    sd: [f32; 256],
    black: f32,
}

impl Sensor {
    /// `black_level` grey levels are taken off every pixel after its noise is added.
    pub fn new(look: &Look, black_level: f64, seed: u64) -> Sensor {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let deviates = (0..1 << 17).map(|_| StandardNormal.sample(&mut rng)).collect();
        let black = black_level as f32;
        Sensor { deviates, black, sd: std::array::from_fn(|level| (look.read_noise.powi(2) + look.shot_noise * level as f64).sqrt() as f32) }
    }

    /// Adds noise and rounds to eight bits. `seed` picks the noise of this picture.
    pub fn record(&self, light: &[f32], width: usize, seed: u64) -> Vec<u8> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mask = self.deviates.len() - 1;
        let mut out = Vec::with_capacity(light.len());
        for row in light.chunks(width.max(1)) {
            let mut at = rng.random_range(0..self.deviates.len());
            let step = 2 * rng.random_range(0..512_usize) + 1;
            for &value in row {
                at = (at + step) & mask;
                let level = value.clamp(0.0, 255.0);
                out.push((level + self.sd[level as usize] * self.deviates[at] - self.black + 0.5).clamp(0.0, 255.0) as u8);
            }
        }
        out
    }
}
