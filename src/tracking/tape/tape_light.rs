//! The light on tape and tubes: matt white around a cylinder is not evenly bright, and the side away from the light not evenly dark.
//!
//! A band whose one side is dark seems to lie toward its bright side. How bright each side is follows from one light that all bands in
//! both cameras share, and from where each faces. It is found from how the bands of one frame brighten across.

use crate::calibration::CameraId;
use crate::footage::GreyView;
use crate::tracking::ball::ball_light::{BallLight, LitPixel};
use crate::tracking::racket::racket_scene::{RacketFrame, RacketScene};
use crate::tracking::tape::band::{self, BandPart, BandShape, BandView};
use nalgebra::{Matrix3, Vector3};
use std::sync::OnceLock;

/// Places across a band at which its brightness is read off, in tube radii.
const PLACES: [f64; 9] = [-0.8, -0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6, 0.8];
/// Bands that must show it.
const FEWEST_BANDS: usize = 6;
/// Brightness that a light leaves unexplained, as a share of what it explains, beyond which it is none.
const MOST_LEFT: f64 = 0.25;

/// Brightness by outward normal: `ambient + max(0, n · toward)`; the scale is free. Global axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TapeLight {
    ambient: f64,
    toward: Vector3<f64>,
}

/// The same over one band, by place across in radii q and height of the surface √(1 − q²): `ambient + max(0, across q + up √(1 − q²))`,
/// one in the mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BandShade {
    pub ambient: f64,
    pub across: f64,
    pub up: f64,
}

impl BandShade {
    /// Evenly bright.
    pub const EVEN: Self = BandShade { ambient: 1.0, across: 0.0, up: 0.0 };

    fn at(&self, q: f64) -> f64 {
        self.ambient + (self.across * q + self.up * (1.0 - q * q).max(0.0).sqrt()).max(0.0)
    }

    fn mean(&self) -> f64 {
        let places = MEAN_PLACES.get_or_init(|| std::array::from_fn(|i| (2.0 * i as f64 + 1.0) / STEPS as f64 - 1.0).map(|q: f64| (q, (1.0 - q * q).sqrt())));
        self.ambient + places.iter().map(|(q, up)| (self.across * q + self.up * up).max(0.0)).sum::<f64>() / STEPS as f64
    }
}

/// Places across over which a band's mean brightness is taken, with the surface's height there.
const STEPS: usize = 16;
static MEAN_PLACES: OnceLock<[(f64, f64); STEPS]> = OnceLock::new();

impl TapeLight {
    fn raw(&self, across: &Vector3<f64>, up: &Vector3<f64>) -> BandShade {
        BandShade { ambient: self.ambient, across: self.toward.dot(across), up: self.toward.dot(up) }
    }

    /// Over a band whose places across and up the surface have these directions (unit vectors, global axes).
    pub fn over(&self, across: &Vector3<f64>, up: &Vector3<f64>) -> BandShade {
        let raw = self.raw(across, up);
        let mean = raw.mean();
        if mean > 1e-6 { BandShade { ambient: raw.ambient / mean, across: raw.across / mean, up: raw.up / mean } } else { BandShade::EVEN }
    }

    /// From the bands of one frame, measured with the light known so far. `None` when they do not agree on one.
    pub fn of(scene: &RacketScene, images: &[Option<GreyView>; 2], frame: &RacketFrame) -> Option<Self> {
        let mut pixels = Vec::new();
        let mut bands = 0;
        for camera in CameraId::BOTH {
            let Some(image) = &images[camera.index()] else { continue };
            for marker in (0..5).filter(|m| frame.points[camera.index()][*m].is_some()) {
                let Some(view) = BandView::at(scene.view, scene.figure, &frame.pose.global_from_racket, camera, marker) else { continue };
                let Some(fit) = band::fit(image, &view, scene.shape, (0.0, 0.0), BandPart::Whole, None) else { continue };
                let shade = scene.shape.shade(&view);
                bands += 1;
                for q in PLACES {
                    let up = (1.0 - q * q).sqrt();
                    let grey = fit.brightness(q, up) * shade.at(q);
                    // Tape has no felt's dark limb: one fitted here and left out of the bands' shade would be made up for by the light.
                    pixels.push(LitPixel { normal: view.sideways * q + view.upward * up, toward_limb: 0.0, grey, relief: 1.0, weight: 1.0 });
                }
            }
        }
        if bands < FEWEST_BANDS {
            return None;
        }
        let away = -pixels.iter().map(|p| p.normal).sum::<Vector3<f64>>().try_normalize(1e-9)?;
        let right = away.cross(&Vector3::y()).try_normalize(1e-6)?;
        let axes = Matrix3::from_rows(&[right.transpose(), away.cross(&right).transpose(), away.transpose()]);
        let found = BallLight::of(&pixels, &axes)?;
        let at = |p: &LitPixel| found.ambient + p.normal.dot(&found.light).max(0.0);
        let (left, all) = pixels.iter().fold((0.0, 1e-9), |(l, a), p| (l + (p.grey - at(p)).powi(2), a + p.grey * p.grey));
        (found.ambient >= 0.0 && (left / all).sqrt() < MOST_LEFT).then_some(TapeLight { ambient: found.ambient, toward: found.light })
    }
}

impl BandShape {
    /// How the light falls on a band.
    pub fn shade(&self, band: &BandView) -> BandShade {
        self.light.map_or(BandShade::EVEN, |l| l.over(&band.sideways, &band.upward))
    }

    /// How bright the light makes a band in the mean, grey levels above black, where the light is known.
    pub fn lit(&self, band: &BandView) -> Option<f64> {
        self.light.map(|l| l.raw(&band.sideways, &band.upward).mean())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_band_is_as_bright_in_the_mean_under_any_light_and_dark_only_where_it_turns_away() {
        let light = TapeLight { ambient: 70.0, toward: Vector3::new(120.0, 90.0, 0.0) };
        // Lit straight from the side: half of the band turns away.
        let shade = light.over(&Vector3::x(), &Vector3::z());
        let mean = (0..1000).map(|i| shade.at((2.0 * f64::from(i) + 1.0) / 1000.0 - 1.0)).sum::<f64>() / 1000.0;
        assert!((mean - 1.0).abs() < 1e-3, "{mean}");
        assert!((shade.at(-0.9) - shade.at(-0.1)).abs() < 1e-12 && shade.at(0.9) > 1.5 * shade.at(0.1));
        assert!((shade.across / shade.ambient - 120.0 / 70.0).abs() < 1e-12);
        // Light from where nothing faces leaves it even, and so does none.
        assert!((light.over(&Vector3::z(), &-Vector3::y()).at(0.7) - 1.0).abs() < 1e-12);
        assert_eq!(TapeLight { ambient: 0.0, toward: Vector3::zeros() }.over(&Vector3::x(), &Vector3::z()), BandShade::EVEN);
    }
}
