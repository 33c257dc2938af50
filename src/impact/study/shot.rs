//! A typical shot to vary, and what a player sees of its outcome.

use crate::impact::PreparedModel;
use crate::impact::error::ModelError;
use crate::impact::input::{ImpactInput, ImpactOutput};
use nalgebra::{Vector2, Vector3};

/// A forehand in the racket's axes: the ball comes from +z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// Incoming ball speed along −z, m/s.
    pub ball_speed: f64,
    /// Incoming spin about x, rad/s: backspin where positive (the ball flies along −z), topspin where negative.
    pub ball_spin: f64,
    /// Speed of the racket's centre of mass along z, m/s.
    pub racket_speed: f64,
    /// Upward speed of the face across itself (brush, "chop"), m/s along y.
    pub brush_speed: f64,
    /// Swing rate about y, rad/s.
    pub swing_rate: f64,
    /// Impact position from the stringbed's centre, m.
    pub position: Vector2<f64>,
    pub grip_torque: f64,
}

/// Means of table 5.27, without the obliqueness (the face's attitude is not in the table).
pub const TYPICAL: Shot =
    Shot { ball_speed: 9.3, ball_spin: 0.0, racket_speed: 15.96, brush_speed: 6.2, swing_rate: 30.5, position: Vector2::new(-0.05, 0.0), grip_torque: 0.0 };

/// What leaves the racket.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Launch {
    /// m/s.
    pub speed: f64,
    /// About x, positive when the racket's upward brush makes it, rad/s.
    pub spin_rad_s: f64,
    /// In the plane of the normal and y, from the normal, rad.
    pub launch_angle_rad: f64,
    /// In the plane of the normal and x, rad.
    pub side_angle_rad: f64,
    /// Normal rebound speed over approach speed.
    pub apparent_restitution: f64,
}

impl Shot {
    pub fn input(&self) -> ImpactInput {
        ImpactInput {
            ball_velocity: Vector3::new(0.0, 0.0, -self.ball_speed),
            ball_spin: Vector3::new(self.ball_spin, 0.0, 0.0),
            racket_velocity: Vector3::new(0.0, self.brush_speed, self.racket_speed),
            racket_rate: Vector3::new(0.0, self.swing_rate, 0.0),
            position: self.position,
            grip_torque: self.grip_torque,
            order: 0.0,
            own: Default::default(),
        }
    }

    /// The shot's launch on a prepared model.
    ///
    /// # Errors
    /// As [`PreparedModel::predict`].
    pub fn launch(&self, model: &PreparedModel) -> Result<Launch, ModelError> {
        let input = self.input();
        let output = model.predict(&input)?;
        Ok(launch(model, &input, &output))
    }
}

fn launch(model: &PreparedModel, input: &ImpactInput, output: &ImpactOutput) -> Launch {
    let strings = input.racket_velocity.z + input.racket_rate.cross(&model.body().lever(&input.position)).z;
    let v = output.ball_velocity;
    Launch {
        speed: v.norm(),
        // A brush along +y turns the ball's near side upward: spin about +x, which is topspin for a ball moving along +z.
        spin_rad_s: output.ball_spin.x,
        launch_angle_rad: v.y.atan2(v.z),
        side_angle_rad: v.x.atan2(v.z),
        apparent_restitution: (v.z - strings) / (strings - input.ball_velocity.z),
    }
}
