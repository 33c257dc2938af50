//! The laws in force in one synthetic world. The default holds nothing but the plain contact; each hidden effect changes
//! one field ([`super::hidden`]). No field is named or shaped after the catalogue of `impact`.

use super::contact::REFERENCE_DEPTH_M;
use nalgebra::Vector2;

/// One elastic mode of the frame, excited by the contact force across the face.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameMode {
    pub modal_mass_kg: f64,
    pub frequency_hz: f64,
    pub damping_ratio: f64,
    pub shape: ModeShape,
}

/// Displacement of the string plane per unit modal coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ModeShape {
    /// First bending mode of a free beam: the exact hyperbolic shape, stretched so that its head node lies at
    /// `node_from_butt_m`; 1 at the tip.
    Bending { node_from_butt_m: f64, length_m: f64 },
    /// Twist of the head about the handle line: proportional to the offset, growing toward the tip.
    Torsion { reference_m: f64 },
}

/// A mass held to the handle by a spring and a damper in all three directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElasticHand {
    pub mass_kg: f64,
    pub from_butt_m: f64,
    pub stiffness_n_m: f64,
    pub damping_n_s_m: f64,
}

/// Strings that give way sideways: springs along two perpendicular directions in the face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LateralSprings {
    /// Stiffness along the soft and the hard direction, N/m.
    pub stiffness_n_m: [f64; 2],
    pub damping_n_s_m: [f64; 2],
    /// Angle of the soft direction from racket x toward y, rad.
    pub soft_direction_rad: f64,
}

/// Share of the peak energy that the contact gives back, as modified by where, how fast and with what spin the ball came.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EnergyReturn {
    /// Exponent of the peak compression: the returned share falls as `(peak / 27 mm)^-p`.
    pub compression_exponent: f64,
    /// Share of the loss that the local bed stiffness commands, 0 to 1 (stiffer near the rim, more ball, more loss).
    pub rim: f64,
    /// Loss that builds up exponentially with the order of impacts: final size of ln e.
    pub wear: f64,
    /// ln e per (incoming spin across the face / 200 rad/s)^1.5.
    pub spin: f64,
    /// Rise of ln e at high grip torque, saturating.
    pub grip: f64,
    /// ln e lost at the middle of a local spot.
    pub spot: f64,
    /// ln e lost per squared tangent of incidence, saturating.
    pub oblique: f64,
    /// ln e gained on one side of the face and lost on the other.
    pub side: f64,
}

/// Every law of the world. All lengths m, SI.
#[derive(Debug, Clone, PartialEq)]
pub struct Nature {
    /// Coefficient of restitution of the plain contact.
    pub restitution: f64,
    pub friction: f64,
    /// Force (N) at which traction saturates; infinite for Coulomb's law.
    pub traction_ceiling_n: f64,
    pub energy_return: EnergyReturn,
    /// Momentum of shell mass landing on the bed: force per (mass / radius) × speed².
    pub flux: f64,
    pub modes: Vec<FrameMode>,
    pub hand: Option<ElasticHand>,
    /// Share of the recorded grip torque that really acts against twist.
    pub grip_share: f64,
    pub lateral: Option<LateralSprings>,
    /// Distance by which the pressure centre trails the ball centre at high slip, m.
    pub trailing_m: f64,
    /// Shortening of the ball's arm per unit compression.
    pub flattening: f64,
    /// Loss of the ball's inertia per metre of compression.
    pub inertia_loss_per_m: f64,
    /// Force of the player's arm at peak contact, N, along the hand's motion.
    pub drive_n: f64,
    /// The geometry moves during contact (the face turns, the contact point creeps and sinks).
    pub moving_geometry: bool,
    /// Contact time and depth relative to the plain contact's.
    pub softness: f64,
    /// Tilt of the pocket toward the middle at reference depth near the rim, rad.
    pub pocket_tilt_rad: f64,
    /// Mass added at the tip that the data sheet does not know, kg.
    pub unknown_tip_mass_kg: f64,
    /// Radius over which the bed brakes rotation about the normal, m (0: none).
    pub pivot_radius_m: f64,
    pub measurement: MeasurementFaults,
}

/// What goes wrong between the impact and the table.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeasurementFaults {
    pub length_scale: f64,
    pub time_scale: f64,
    /// The marked plane lies this far above the strings, m.
    pub plane_offset_m: f64,
    pub centre_bias_m: Vector2<f64>,
    /// Delay of one camera, s.
    pub camera_delay_s: f64,
    /// Racket velocities belong to this long before the impact, s.
    pub racket_early_s: f64,
    /// Ball velocities belong to this long before and after the contact, with drag and gravity in between, s.
    pub ball_flight_s: f64,
}

impl Default for Nature {
    fn default() -> Self {
        Nature {
            restitution: 0.82,
            friction: 0.45,
            traction_ceiling_n: f64::INFINITY,
            energy_return: EnergyReturn::default(),
            flux: 0.0,
            modes: Vec::new(),
            hand: None,
            grip_share: 0.0,
            lateral: None,
            trailing_m: 0.0,
            flattening: 0.0,
            inertia_loss_per_m: 0.0,
            drive_n: 0.0,
            moving_geometry: false,
            softness: 1.0,
            pocket_tilt_rad: 0.0,
            unknown_tip_mass_kg: 0.0,
            pivot_radius_m: 0.0,
            measurement: MeasurementFaults::default(),
        }
    }
}

/// What an energy law may look at: the state at first touch.
#[derive(Debug, Clone, Copy)]
pub struct FirstTouch {
    /// Contact point from the stringbed centre, racket axes, m.
    pub place: Vector2<f64>,
    /// Half axes of the string bed, m.
    pub half_axes: Vector2<f64>,
    pub approach_m_s: f64,
    pub slip_m_s: f64,
    /// Incoming ball spin in the plane of the face, rad/s.
    pub spin_across_rad_s: f64,
    pub grip_torque_n_m: f64,
    pub order: f64,
}

impl Nature {
    /// Whether nothing goes wrong between the impact and the table.
    pub fn is_measured_rightly(&self) -> bool {
        self.measurement == MeasurementFaults::default()
    }

    /// Share of the energy stored at `peak_m` compression that comes back.
    pub fn returned_share(&self, touch: &FirstTouch, peak_m: f64) -> f64 {
        let law = &self.energy_return;
        let (x, y) = (touch.place.x / touch.half_axes.x, touch.place.y / touch.half_axes.y);
        let mut log_e = self.restitution.ln();
        if law.compression_exponent != 0.0 {
            log_e -= 0.5 * law.compression_exponent * (peak_m.max(1e-4) / REFERENCE_DEPTH_M).ln();
        }
        if law.rim != 0.0 {
            // Bed and ball in series: the stiffer the bed, the larger the ball's share of energy and of loss. The bed is a
            // membrane: its stiffness grows as 1/(1 - rho^2) toward the rim.
            let rho2 = (x * x + y * y).min(0.9);
            let bed = 1.0 / (1.0 - 0.85 * rho2);
            let share = 2.0 * bed / (1.0 + bed); // 1 at the centre
            let loss = 1.0 - self.restitution * self.restitution;
            log_e += 0.5 * ((1.0 - loss * (1.0 + law.rim * (share - 1.0))).max(0.05) / (1.0 - loss)).ln();
        }
        log_e -= law.wear * (1.0 - (-touch.order / 60.0).exp());
        log_e -= law.spin * (touch.spin_across_rad_s / 200.0).powf(1.5);
        log_e += law.grip * (touch.grip_torque_n_m / (touch.grip_torque_n_m + 3.0));
        log_e -= law.spot * (-((touch.place - Vector2::new(-0.045, 0.030)).norm() / 0.028).powi(2)).exp();
        let obliqueness = (touch.slip_m_s / touch.approach_m_s.max(0.1)).powi(2);
        log_e -= law.oblique * obliqueness / (1.0 + 0.5 * obliqueness);
        log_e += law.side * (1.5 * y).tanh();
        (2.0 * log_e).exp().clamp(0.01, 1.0)
    }

    /// Largest tangential force under a normal load.
    pub fn traction_limit(&self, load_n: f64) -> f64 {
        let coulomb = self.friction * load_n.max(0.0);
        if self.traction_ceiling_n.is_finite() { self.traction_ceiling_n * (1.0 - (-coulomb / self.traction_ceiling_n).exp()) } else { coulomb }
    }
}

impl ModeShape {
    /// Displacement at (x toward the handle from the stringbed centre, y), m, with that centre `centre_from_butt_m` along.
    pub fn at(&self, place: Vector2<f64>, centre_from_butt_m: f64) -> f64 {
        match *self {
            ModeShape::Bending { node_from_butt_m, length_m } => {
                // Exact first free-free mode on [0, 1]; its node at 0.77584 is moved by a power of the coordinate.
                const ROOT: f64 = 4.730_040_744_862_704;
                const SHIFT: f64 = 0.982_502_214_576_238;
                let stretch = 0.775_836_f64.ln() / (node_from_butt_m / length_m).ln();
                let s = ((centre_from_butt_m - place.x) / length_m).clamp(1e-6, 1.0).powf(stretch);
                let shape = |s: f64| (ROOT * s).cosh() + (ROOT * s).cos() - SHIFT * ((ROOT * s).sinh() + (ROOT * s).sin());
                shape(s) / shape(1.0)
            }
            ModeShape::Torsion { reference_m } => place.y / reference_m * (1.0 - place.x / 0.25),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_bending_shape_is_one_at_the_tip_and_zero_at_its_node() {
        let shape = ModeShape::Bending { node_from_butt_m: 0.545, length_m: 0.685 };
        assert!((shape.at(Vector2::new(0.5 - 0.685, 0.0), 0.5) - 1.0).abs() < 1e-9);
        assert!(shape.at(Vector2::new(0.5 - 0.545, 0.0), 0.5).abs() < 1e-4);
        assert!(shape.at(Vector2::new(0.1, 0.0), 0.5) < -0.3, "the throat moves against the tip");
    }

    #[test]
    fn truth_with_nothing_hidden_the_returned_share_is_the_square_of_the_restitution() {
        let touch = FirstTouch {
            place: Vector2::new(0.1, -0.05),
            half_axes: Vector2::new(0.17, 0.13),
            approach_m_s: 30.0,
            slip_m_s: 20.0,
            spin_across_rad_s: 300.0,
            grip_torque_n_m: 8.0,
            order: 500.0,
        };
        let nature = Nature::default();
        assert!((nature.returned_share(&touch, 0.04) - nature.restitution.powi(2)).abs() < 1e-12);
    }
}
