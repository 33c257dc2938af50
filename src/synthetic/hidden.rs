//! The effects a synthetic world can hide: one line each, with a strength (1 = as large as it is in the field, or plainly
//! visible in 300 impacts) and the law it changes. Forms differ from the catalogue's on purpose; the last ones are in no
//! catalogue at all.

use super::nature::{ElasticHand, FrameMode, LateralSprings, ModeShape, Nature};
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

/// One effect a world hides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hidden {
    pub effect: String,
    #[serde(default = "full")]
    pub strength: f64,
}

fn full() -> f64 {
    1.0
}

impl Hidden {
    pub fn new(effect: &str, strength: f64) -> Self {
        Hidden { effect: effect.to_owned(), strength }
    }
}

/// Where an effect leaves its trace; a generator uses it to choose impacts that show it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Seen {
    /// Hung racket in the laboratory and on court.
    Everywhere,
    /// Needs a mount with a known torque, or the racket's own motion after impact.
    Lab,
    /// Needs a moving racket.
    Court,
}

/// What is known of a hidden effect.
#[derive(Clone, Copy)]
pub struct Entry {
    pub name: &'static str,
    /// In section 8 of the contract; otherwise a model can only find an expression.
    pub in_catalogue: bool,
    /// Names a careful analyst may also give, because these data cannot tell them apart.
    pub aliases: &'static [&'static str],
    pub seen: Seen,
    /// Root of the non-centrality that strength 1 leaves in 300 impacts (lab, court) once restitution and friction are
    /// refitted; grows about linearly with strength and with the root of the number of impacts. 0: cannot be seen.
    pub signal_in_300: [f64; 2],
    /// The law of this world, in words.
    pub law: &'static str,
    change: fn(&mut Nature, f64),
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HiddenError {
    #[error("hidden effect {name:?} is not known; known: {known}")]
    Unknown { name: String, known: String },
    #[error("hidden effect {name:?} has strength {strength}; allowed: above 0 to 5")]
    Strength { name: String, strength: f64 },
}

/// All effects, in the order of the contract's section 8, then those outside the catalogue.
pub fn entries() -> &'static [Entry] {
    &ENTRIES
}

pub fn entry(name: &str) -> Result<&'static Entry, HiddenError> {
    ENTRIES
        .iter()
        .find(|e| e.name == name)
        .ok_or_else(|| HiddenError::Unknown { name: name.to_owned(), known: ENTRIES.iter().map(|e| e.name).collect::<Vec<_>>().join(", ") })
}

/// Effects that a rendered session of the laboratory shows well enough to be found in some forty shots.
pub fn playable() -> impl Iterator<Item = &'static Entry> {
    let in_pictures = |e: &&Entry| {
        let mut world = Nature::default();
        (e.change)(&mut world, 1.0);
        world.is_measured_rightly()
    };
    // Half of the signal is lost to footage noise, and forty shots have 0.37 of the signal of 300.
    ENTRIES.iter().filter(|e| e.seen == Everywhere && e.signal_in_300[0] >= 30.0).filter(in_pictures)
}

/// The world in which all of `hidden` are in force.
pub fn nature(hidden: &[Hidden]) -> Result<Nature, HiddenError> {
    let mut nature = Nature::default();
    for h in hidden {
        let entry = entry(&h.effect)?;
        if !(h.strength > 0.0 && h.strength <= 5.0) {
            return Err(HiddenError::Strength { name: h.effect.clone(), strength: h.strength });
        }
        (entry.change)(&mut nature, h.strength);
    }
    Ok(nature)
}

const fn listed(
    name: &'static str,
    aliases: &'static [&'static str],
    seen: Seen,
    signal_in_300: [f64; 2],
    law: &'static str,
    change: fn(&mut Nature, f64),
) -> Entry {
    Entry { name, in_catalogue: true, aliases, seen, signal_in_300, law, change }
}

const fn unlisted(name: &'static str, seen: Seen, signal_in_300: [f64; 2], law: &'static str, change: fn(&mut Nature, f64)) -> Entry {
    Entry { name, in_catalogue: false, aliases: &[], seen, signal_in_300, law, change }
}

use Seen::{Court, Everywhere, Lab};

static ENTRIES: [Entry; 30] = [
    listed(
        "frame-vibration",
        &["stringbed-edge"],
        Everywhere,
        [147.0, 60.0],
        "one lightly damped mode with the exact free-beam shape, head node at 0.795 of the length",
        |n, s| {
            n.modes.push(FrameMode {
                modal_mass_kg: 0.068 / s,
                frequency_hz: 138.0,
                damping_ratio: 0.015,
                shape: ModeShape::Bending { node_from_butt_m: 0.545, length_m: 0.685 },
            });
        },
    ),
    listed(
        "frame-torsion",
        &["stringbed-edge", "racket-inertia", "grip-torque"],
        Everywhere,
        [63.0, 27.0],
        "a twisting mode of the head, displacement growing toward the tip",
        |n, s| {
            n.modes.push(FrameMode { modal_mass_kg: 0.12 / s, frequency_hz: 190.0, damping_ratio: 0.02, shape: ModeShape::Torsion { reference_m: 0.13 } });
        },
    ),
    listed(
        "hand-mass",
        &["racket-inertia", "swing-drive"],
        Everywhere,
        [219.0, 15.0],
        "a mass on a spring and damper at the handle, in three directions",
        |n, s| {
            n.hand = Some(ElasticHand { mass_kg: 0.22 * s, from_butt_m: 0.065, stiffness_n_m: 2.0e5 * s, damping_n_s_m: 60.0 * s });
        },
    ),
    listed(
        "grip-torque",
        &["racket-inertia"],
        Lab,
        [142.0, 0.0],
        "friction of the mount against twist, smooth in the twist rate, in proportion to the recorded torque",
        |n, s| {
            n.grip_share = 0.9 * s;
        },
    ),
    listed(
        "ball-damping",
        &["momentum-flux", "string-stiffening", "ball-stiffening"],
        Everywhere,
        [39.0, 11.0],
        "the returned share of the energy falls as a power of the peak compression",
        |n, s| n.energy_return.compression_exponent = 0.14 * s,
    ),
    listed(
        "momentum-flux",
        &["ball-damping", "string-stiffening", "ball-stiffening"],
        Everywhere,
        [29.0, 11.0],
        "shell mass laid on the bed takes its momentum along while the ball is compressed",
        |n, s| n.flux = 0.10 * s,
    ),
    listed(
        "stringbed-edge",
        &["frame-vibration", "racket-inertia"],
        Everywhere,
        [35.0, 17.0],
        "bed stiffness of a membrane, 1/(1 - rho^2), in series with the ball",
        |n, s| {
            n.energy_return.rim = 0.55 * s;
        },
    ),
    listed("lateral-strings", &[], Everywhere, [114.0, 49.0], "strings stretch sideways as springs, softer across than along, and snap back", |n, s| {
        let soft = 1.0 / s;
        n.lateral = Some(LateralSprings {
            stiffness_n_m: [28e3 * soft, 45e3 * soft],
            damping_n_s_m: [22.0 * soft, 30.0 * soft],
            soft_direction_rad: std::f64::consts::FRAC_PI_2,
        });
    }),
    listed(
        "offset-normal-force",
        &["ball-deformation"],
        Everywhere,
        [68.0, 76.0],
        "the pressure centre trails the ball's centre, saturating with the sliding speed",
        |n, s| n.trailing_m = 0.0013 * s,
    ),
    listed(
        "ball-deformation",
        &["offset-normal-force"],
        Everywhere,
        [44.0, 29.0],
        "the ball's arm shortens with the compression of this very impact, and so does its inertia",
        |n, s| {
            n.flattening = 0.22 * s;
            n.inertia_loss_per_m = 3.0 * s;
        },
    ),
    listed("friction-law", &["lateral-strings"], Everywhere, [18.0, 0.0], "traction saturates exponentially with the load", |n, s| {
        n.traction_ceiling_n = 420.0 / s
    }),
    listed("ball-wear", &[], Everywhere, [26.0, 19.0], "restitution falls with the order of impacts and settles after some sixty", |n, s| {
        n.energy_return.wear = 0.05 * s
    }),
    listed("swing-drive", &["hand-mass", "window-bias"], Court, [0.0, 28.0], "the arm pushes along the hand's motion while it feels the load", |n, s| {
        n.drive_n = 130.0 * s
    }),
    listed(
        "finite-contact",
        &["string-tilt", "face-plane-offset"],
        Everywhere,
        [229.0, 194.0],
        "the face turns, the contact point creeps across it and sinks with it, for as long as the contact lasts",
        |n, s| {
            n.moving_geometry = true;
            n.softness = 0.8 * s.min(1.6);
        },
    ),
    listed("string-tilt", &["finite-contact"], Everywhere, [59.0, 55.0], "the pocket's normal leans to the middle as the root of the depth", |n, s| {
        n.pocket_tilt_rad = 0.030 * s
    }),
    listed("racket-inertia", &["hand-mass", "stringbed-edge"], Everywhere, [116.0, 14.0], "a lump at the tip that the data sheet does not know", |n, s| {
        n.unknown_tip_mass_kg = 0.009 * s
    }),
    listed(
        "air-flight",
        &["scale-error", "window-bias"],
        Everywhere,
        [20.0, 16.0],
        "ball velocities belong to 9 ms before and after, with drag and gravity between",
        |n, s| n.measurement.ball_flight_s = 0.009 * s,
    ),
    listed("scale-error", &["time-base-error"], Everywhere, [34.0, 9.0], "all lengths too long by one factor", |n, s| n.measurement.length_scale = 0.02 * s),
    listed("time-base-error", &["scale-error"], Everywhere, [0.0, 0.0], "all rates too high by one factor", |n, s| n.measurement.time_scale = 0.02 * s),
    listed(
        "face-plane-offset",
        &["finite-contact", "ball-centre-bias"],
        Everywhere,
        [54.0, 13.0],
        "the marked plane lies above the strings: first contact is placed too early",
        |n, s| n.measurement.plane_offset_m = 0.007 * s,
    ),
    listed("ball-centre-bias", &["face-plane-offset"], Everywhere, [31.0, 11.0], "the ball's centre is seen toward the lit side", |n, s| {
        n.measurement.centre_bias_m = Vector2::new(0.0030, -0.0022) * s
    }),
    listed(
        "camera-skew",
        &["face-plane-offset", "ball-centre-bias"],
        Everywhere,
        [35.0, 11.0],
        "one camera is late: the ball is seen displaced along its path",
        |n, s| n.measurement.camera_delay_s = 2.4e-4 * s,
    ),
    listed("window-bias", &["swing-drive"], Court, [0.0, 65.0], "racket velocities belong to the middle of the fitted window", |n, s| {
        n.measurement.racket_early_s = 0.003 * s
    }),
    unlisted("spin-restitution", Everywhere, [87.0, 40.0], "restitution falls with the 1.5th power of the incoming spin across the face", |n, s| {
        n.energy_return.spin = 0.07 * s
    }),
    unlisted("grip-restitution", Lab, [51.0, 0.0], "restitution rises with the mount's torque and saturates", |n, s| n.energy_return.grip = 0.09 * s),
    unlisted("diagonal-strings", Everywhere, [182.0, 75.0], "strings give way along one diagonal of the face", |n, s| {
        n.lateral = Some(LateralSprings { stiffness_n_m: [30e3 / s, 4e6], damping_n_s_m: [20.0 / s, 500.0], soft_direction_rad: std::f64::consts::FRAC_PI_4 });
    }),
    unlisted("pivot-spin-loss", Everywhere, [34.0, 107.0], "friction over the contact patch brakes the ball's spin about the normal", |n, s| {
        n.pivot_radius_m = 0.012 * s
    }),
    unlisted("dead-spot", Everywhere, [61.0, 81.0], "restitution is low within 3 cm of one place on the face", |n, s| n.energy_return.spot = 0.22 * s),
    unlisted("oblique-loss", Everywhere, [63.0, 13.0], "restitution falls with the squared tangent of incidence and saturates", |n, s| {
        n.energy_return.oblique = 0.09 * s
    }),
    unlisted("one-sided-bed", Everywhere, [47.0, 19.0], "restitution is higher on one side of the face than on the other", |n, s| {
        n.energy_return.side = 0.045 * s
    }),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_every_effect_changes_the_world() {
        for e in entries() {
            let world = nature(&[Hidden::new(e.name, 1.0)]).expect("known");
            assert_ne!(world, Nature::default(), "{}", e.name);
            for alias in e.aliases {
                assert_ne!(*alias, e.name);
            }
        }
    }

    #[test]
    fn fails_an_unknown_name_or_strength_is_refused_with_the_known_ones() {
        assert!(nature(&[Hidden::new("moon", 1.0)]).expect_err("unknown").to_string().contains("frame-vibration"));
        assert!(nature(&[Hidden::new("ball-wear", 0.0)]).expect_err("zero").to_string().contains("above 0"));
    }
}
