//! What a rendered session of footage should be: its scenario file's table.

use super::footage_world::FootageWorldError;
use super::hidden::Hidden;
use super::look::Setting;
use serde::{Deserialize, Serialize};

/// Largest session this room renders.
const MAX_SHOTS: usize = 1000;

/// What a rendered session should be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FootageSpec {
    pub setting: Setting,
    pub seed: u64,
    pub shots: usize,
    #[serde(default)]
    pub hidden: Vec<Hidden>,
    #[serde(default = "defaults::boards")]
    pub boards: usize,
    /// Among the boards: one each that is blurred, flooded with light, partly out of one picture, missing from one.
    #[serde(default)]
    pub bad_boards: bool,
    #[serde(default = "defaults::before")]
    pub frames_before: usize,
    #[serde(default = "defaults::after")]
    pub frames_after: usize,
    #[serde(default = "defaults::rate")]
    pub frame_rate_hz: f64,
    #[serde(default = "defaults::exposure")]
    pub exposure_s: f64,
    /// Width and height, px.
    #[serde(default = "defaults::size")]
    pub size_px: [usize; 2],
    /// Sensor noise relative to the setting's own.
    #[serde(default = "defaults::one")]
    pub noise: f64,
    /// Grey levels taken off before the picture is rounded to eight bits, as a camera with a raised black point does: a
    /// dark curtain becomes plain black and the files small.
    #[serde(default)]
    pub black_level: f64,
    /// Tape and felt as matt surfaces are: tape shaded like all else (otherwise nearly even, as retro-reflecting tape lit from the cameras),
    /// the ball darker toward its limb.
    #[serde(default)]
    pub matt: bool,
    /// The ball stays round on the strings (otherwise they press it).
    #[serde(default)]
    pub round_ball: bool,
    /// Incoming spin relative to the setting's own.
    #[serde(default = "defaults::one")]
    pub spin: f64,
    #[serde(default)]
    pub format: PictureFormat,
}

mod defaults {
    pub fn boards() -> usize {
        16
    }
    pub fn before() -> usize {
        20
    }
    pub fn after() -> usize {
        20
    }
    pub fn rate() -> f64 {
        1000.0
    }
    pub fn exposure() -> f64 {
        1e-4
    }
    pub fn size() -> [usize; 2] {
        [512, 512]
    }
    pub fn one() -> f64 {
        1.0
    }
}

impl FootageSpec {
    /// A plain session of the setting.
    pub fn new(setting: Setting, shots: usize, seed: u64) -> Self {
        FootageSpec {
            setting,
            seed,
            shots,
            hidden: Vec::new(),
            boards: defaults::boards(),
            bad_boards: false,
            frames_before: defaults::before(),
            frames_after: defaults::after(),
            frame_rate_hz: defaults::rate(),
            exposure_s: defaults::exposure(),
            size_px: defaults::size(),
            noise: 1.0,
            black_level: 0.0,
            matt: false,
            round_ball: false,
            spin: 1.0,
            format: PictureFormat::default(),
        }
    }

    /// Refuses values that no recording has.
    pub(super) fn check(&self) -> Result<(), FootageWorldError> {
        let need = |key: &'static str, seen: f64, lo: f64, hi: f64, allowed: &'static str| {
            if seen >= lo && seen <= hi { Ok(()) } else { Err(FootageWorldError::Value { key, seen, allowed }) }
        };
        need("shots", self.shots as f64, 0.0, MAX_SHOTS as f64, "0 to 1000")?;
        need("boards", self.boards as f64, 0.0, 200.0, "0 to 200")?;
        need("frames_before", self.frames_before as f64, 6.0, 200.0, "6 to 200")?;
        need("frames_after", self.frames_after as f64, 6.0, 200.0, "6 to 200")?;
        need("frame_rate_hz", self.frame_rate_hz, 100.0, 1e5, "100 to 100000")?;
        need("exposure_s", self.exposure_s * self.frame_rate_hz, 0.0, 1.0, "0 to one frame period")?;
        need("size_px", self.size_px[0].min(self.size_px[1]) as f64, 128.0, 4096.0, "128 to 4096 a side")?;
        need("size_px", self.size_px[0].max(self.size_px[1]) as f64, 128.0, 4096.0, "128 to 4096 a side")?;
        need("noise", self.noise, 0.0, 10.0, "0 to 10")?;
        need("black_level", self.black_level, 0.0, 100.0, "0 to 100")?;
        need("spin", self.spin, 0.0, 4.0, "0 to 4")
    }
}

/// File format of the pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PictureFormat {
    #[default]
    Bmp,
    Png,
}
