//! What stands behind the shot and does not move: floor, curtain or wall with advertisements, the player's body.

use super::look::{Look, Setting};
use super::player::Limb;
use super::sampling::hit_capsule;
use super::view::View;
use nalgebra::{Point3, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// A board, letter or stain on the wall.
#[derive(Debug, Clone, Copy)]
struct Patch {
    centre: Vector2<f64>,
    half: Vector2<f64>,
    round: bool,
    brightness: f64,
    opacity: f64,
}

/// The place of a session, without what moves.
#[derive(Debug, Clone)]
pub struct Backdrop {
    setting: Setting,
    seed: u64,
    wall_u: f64,
    patches: Vec<Patch>,
}

impl Backdrop {
    pub fn new(setting: Setting, seed: u64) -> Backdrop {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xBACD);
        let mut patches = Vec::new();
        if setting != Setting::Lab {
            for _ in 0..9 {
                let centre = Vector2::new(rng.random_range(-2.6..2.9), rng.random_range(0.1..2.1));
                let letters = rng.random_range(4..10);
                let size = rng.random_range(0.06..0.15);
                let (paper, ink) = if rng.random::<bool>() { (rng.random_range(110.0..150.0), 215.0) } else { (0.0, rng.random_range(170.0..250.0)) };
                if paper > 0.0 {
                    patches.push(Patch {
                        centre,
                        half: Vector2::new(0.62 * size * f64::from(letters), 1.1 * size),
                        round: false,
                        brightness: paper,
                        opacity: 0.9,
                    });
                }
                for i in 0..letters {
                    let x = centre.x + (f64::from(i) - 0.5 * f64::from(letters - 1)) * size * 1.15;
                    let mut stroke = |dx: f64, dy: f64, hx: f64, hy: f64| {
                        patches.push(Patch {
                            centre: Vector2::new(x + dx * size, centre.y + dy * size),
                            half: Vector2::new(hx * size, hy * size),
                            round: false,
                            brightness: ink,
                            opacity: 0.95,
                        });
                    };
                    stroke(-0.35, 0.0, 0.10, 0.5);
                    for (dx, dy, hx, hy) in [(0.0, 0.42, 0.38, 0.09), (0.0, 0.0, 0.34, 0.09), (0.0, -0.42, 0.38, 0.09), (0.33, 0.0, 0.10, 0.5)] {
                        if rng.random::<f64>() < 0.6 {
                            stroke(dx, dy, hx, hy);
                        }
                    }
                }
            }
            for _ in 0..14 {
                let r = rng.random_range(0.02..0.09);
                patches.push(Patch {
                    centre: Vector2::new(rng.random_range(-2.6..2.9), rng.random_range(-0.5..2.1)),
                    half: Vector2::new(r, r * rng.random_range(0.5..1.0)),
                    round: true,
                    brightness: rng.random_range(20.0..240.0),
                    opacity: 0.9,
                });
            }
        }
        Backdrop { setting, seed, wall_u: if setting == Setting::Lab { -1.6 } else { -3.5 }, patches }
    }

    /// Light of every pixel of a camera, without what moves; row by row.
    pub fn draw(&self, view: &View, look: &Look, body: &[Limb]) -> Vec<f32> {
        (0..view.height)
            .into_par_iter()
            .flat_map_iter(|v| {
                (0..view.width).map(move |u| {
                    let corners = [(-0.25, -0.3), (0.25, -0.1), (-0.1, 0.25), (0.3, 0.3)];
                    let sum: f64 = corners.iter().map(|(du, dv)| self.light(view, look, body, u as f64 + du, v as f64 + dv)).sum();
                    (sum / corners.len() as f64) as f32
                })
            })
            .collect()
    }

    fn light(&self, view: &View, look: &Look, body: &[Limb], u: f64, v: f64) -> f64 {
        let ray = view.ray(u, v);
        let hits = body.iter().filter_map(|l| hit_capsule(&l.from, &l.to, l.radius, &ray.origin, &ray.direction).map(|h| (h, l)));
        if let Some(((_, normal), limb)) = hits.min_by(|a, b| a.0.0.total_cmp(&b.0.0)) {
            return look.matt(limb.brightness, &normal);
        }
        let d = ray.direction;
        let floor = if d.y < -1e-6 { -ray.origin.y / d.y } else { f64::INFINITY };
        let wall = if d.x < -1e-6 { (self.wall_u - ray.origin.x) / d.x } else { f64::INFINITY };
        if floor < wall {
            self.floor(&(ray.origin + d * floor))
        } else if wall.is_finite() {
            self.wall(&(ray.origin + d * wall))
        } else {
            20.0
        }
    }

    fn floor(&self, p: &Point3<f64>) -> f64 {
        let grain = self.noise(p.x * 30.0, p.z * 7.0);
        match self.setting {
            Setting::Lab => 5.5 + 2.0 * grain,
            _ => {
                let line = (p.x - 1.9).abs() < 0.025 || (p.z + 3.1).abs() < 0.03;
                if line { 235.0 } else { 85.0 + 14.0 * grain }
            }
        }
    }

    fn wall(&self, p: &Point3<f64>) -> f64 {
        let (w, v) = (p.z, p.y);
        if self.setting == Setting::Lab {
            // Folds of a curtain.
            let fold = self.noise(w * 4.0, 0.3) + 0.5 * self.noise(w * 11.0, 0.7);
            return (5.0 + 3.5 * fold + 0.6 * self.noise(w * 3.0, v * 1.5)).max(0.5);
        }
        let mut light = 62.0 + 9.0 * self.noise(w * 2.2, v * 2.2) + 4.0 * self.noise(w * 17.0, v * 17.0);
        if v < 0.75 {
            light += 14.0;
        }
        if (w * 0.55 + 0.21).rem_euclid(1.0) < 0.012 {
            light = 24.0;
        }
        for patch in &self.patches {
            let off = (Vector2::new(w, v) - patch.centre).component_div(&patch.half);
            let inside = if patch.round { off.norm_squared() < 1.0 } else { off.x.abs() < 1.0 && off.y.abs() < 1.0 };
            if inside {
                light += patch.opacity * (patch.brightness - light);
            }
        }
        if self.setting == Setting::Hard { 55.0 + 0.55 * light } else { light }
    }

    /// Smooth value noise, -1 to 1.
    fn noise(&self, x: f64, y: f64) -> f64 {
        let (i, j) = (x.floor(), y.floor());
        let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
        let (a, b) = (smooth(x - i), smooth(y - j));
        let at = |di: f64, dj: f64| {
            let mut h = (self.seed ^ 0x9E37_79B9_7F4A_7C15).wrapping_add(((i + di) as i64 as u64).wrapping_mul(0xD6E8_FEB8_6659_FD93));
            h = (h ^ (h >> 32)).wrapping_mul(0xD6E8_FEB8_6659_FD93).wrapping_add(((j + dj) as i64 as u64).wrapping_mul(0xA076_1D64_78BD_642F));
            h = (h ^ (h >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            ((h >> 40) as f64) / f64::from(1 << 23) - 1.0
        };
        (at(0.0, 0.0) * (1.0 - a) + at(1.0, 0.0) * a) * (1.0 - b) + (at(0.0, 1.0) * (1.0 - a) + at(1.0, 1.0) * a) * b
    }
}

/// The thread or cord from which a lab racket hangs, above its butt; global axes.
pub fn thread(butt: &Point3<f64>) -> Limb {
    Limb { from: *butt, to: butt + Vector3::y() * 1.5, radius: 0.0012, brightness: 40.0 }
}
