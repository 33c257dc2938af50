//! The player: a body that stands still and an arm that follows the racket.

use nalgebra::{Isometry3, Point3, Vector3};

/// A limb or garment, global axes.
#[derive(Debug, Clone, Copy)]
pub struct Limb {
    pub from: Point3<f64>,
    pub to: Point3<f64>,
    pub radius: f64,
    pub brightness: f64,
}

#[derive(Debug, Clone)]
pub struct Player {
    pub feet: Point3<f64>,
    skin: f64,
}

impl Player {
    pub fn new(feet: Point3<f64>, skin: f64) -> Player {
        Player { feet, skin }
    }

    fn at(&self, u: f64, v: f64, w: f64) -> Point3<f64> {
        self.feet + Vector3::new(u, v, w)
    }

    /// What does not move: head, shirt, shorts, legs, shoes.
    pub fn body(&self) -> Vec<Limb> {
        let limb = |from, to, radius, brightness| Limb { from, to, radius, brightness };
        vec![
            limb(self.at(0.0, 1.02, 0.0), self.at(0.0, 1.38, 0.0), 0.17, 0.9 * self.skin + 30.0),
            limb(self.at(0.0, 0.82, 0.0), self.at(0.0, 0.92, 0.0), 0.165, 190.0),
            limb(self.at(0.0, 1.68, 0.0), self.at(0.0, 1.72, 0.0), 0.105, self.skin),
            limb(self.at(0.0, 1.76, 0.0), self.at(0.03, 1.77, 0.0), 0.10, 215.0),
            limb(self.at(0.0, 0.85, 0.09), self.at(0.05, 0.48, 0.16), 0.085, 205.0),
            limb(self.at(0.0, 0.85, -0.09), self.at(-0.05, 0.48, -0.16), 0.085, 205.0),
            limb(self.at(0.05, 0.46, 0.16), self.at(0.0, 0.09, 0.17), 0.055, self.skin),
            limb(self.at(-0.05, 0.46, -0.16), self.at(-0.1, 0.09, -0.17), 0.055, self.skin),
            limb(self.at(0.0, 0.05, 0.17), self.at(0.16, 0.05, 0.19), 0.05, 230.0),
            limb(self.at(-0.1, 0.05, -0.17), self.at(0.06, 0.05, -0.19), 0.05, 230.0),
            limb(self.at(0.0, 1.40, -0.2), self.at(0.15, 1.10, -0.32), 0.055, self.skin),
        ]
    }

    /// Hand, wristband, forearm, upper arm and sleeve for a racket pose; `hand` in racket axes.
    pub fn arm(&self, racket: &Isometry3<f64>, hand: &Vector3<f64>) -> Vec<Limb> {
        let grip = racket * Point3::from(*hand);
        let butt = racket * Point3::from(hand + Vector3::x() * 0.05);
        let shoulder = self.at(0.02, 1.40, 0.20);
        let elbow = grip + (shoulder - grip) * 0.5 + Vector3::new(-0.03, -0.10, 0.0);
        let wrist = grip + (elbow - grip) * 0.22;
        let limb = |from, to, radius, brightness| Limb { from, to, radius, brightness };
        vec![
            limb(grip - (butt - grip) * 0.6, butt, 0.036, self.skin),
            limb(grip, elbow, 0.036, self.skin),
            limb(wrist, wrist + (elbow - wrist) * 0.22, 0.043, 225.0),
            limb(elbow, shoulder, 0.05, self.skin),
            limb(elbow + (shoulder - elbow) * 0.55, shoulder, 0.068, 0.9 * self.skin + 30.0),
        ]
    }
}
