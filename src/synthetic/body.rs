//! A rigid body in the laboratory frame: what an impulse at a point does to it, and free motion.

use nalgebra::{Matrix3, Point3, UnitQuaternion, Vector3};

/// State and mass properties of a free rigid body. Laboratory frame throughout, SI.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    pub mass_kg: f64,
    /// Principal inertias about the centre of mass, along the body's own axes, kg m².
    pub inertia_kg_m2: Vector3<f64>,
    /// Centre of mass, m.
    pub position: Point3<f64>,
    /// Body axes to laboratory axes.
    pub attitude: UnitQuaternion<f64>,
    pub velocity: Vector3<f64>,
    /// Angular velocity, rad/s.
    pub rate: Vector3<f64>,
}

impl Body {
    /// A sphere of given inertia at rest attitude.
    pub fn sphere(mass_kg: f64, inertia_kg_m2: f64, position: Point3<f64>, velocity: Vector3<f64>, rate: Vector3<f64>) -> Self {
        Body { mass_kg, inertia_kg_m2: Vector3::repeat(inertia_kg_m2), position, attitude: UnitQuaternion::identity(), velocity, rate }
    }

    /// Inverse inertia tensor along laboratory axes.
    pub fn compliance(&self) -> Matrix3<f64> {
        let r = self.attitude.to_rotation_matrix();
        r.matrix() * Matrix3::from_diagonal(&self.inertia_kg_m2.map(f64::recip)) * r.matrix().transpose()
    }

    /// Velocity of the body's material at `arm` from the centre of mass.
    pub fn velocity_at(&self, arm: &Vector3<f64>) -> Vector3<f64> {
        self.velocity + self.rate.cross(arm)
    }

    /// An impulse (N s) at `arm` from the centre of mass; `compliance` is [`Self::compliance`] at this attitude.
    pub fn kick(&mut self, compliance: &Matrix3<f64>, arm: &Vector3<f64>, impulse: &Vector3<f64>) {
        self.velocity += impulse / self.mass_kg;
        self.rate += compliance * arm.cross(impulse);
    }

    /// An angular impulse (N m s).
    pub fn twist(&mut self, compliance: &Matrix3<f64>, angular_impulse: &Vector3<f64>) {
        self.rate += compliance * angular_impulse;
    }

    /// Moves and turns with the present velocities for `dt` (s).
    pub fn drift(&mut self, dt: f64) {
        self.position += self.velocity * dt;
        self.attitude = UnitQuaternion::from_scaled_axis(self.rate * dt) * self.attitude;
    }

    /// Torque-free precession for `dt` (s): keeps the angular momentum while the attitude turns.
    pub fn precess(&mut self, dt: f64) {
        let local = self.attitude.inverse() * self.rate;
        let momentum = self.inertia_kg_m2.component_mul(&local);
        let turn = momentum.cross(&local).component_div(&self.inertia_kg_m2);
        self.rate = self.attitude * (local + turn * dt);
    }
}
