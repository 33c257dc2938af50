//! Added weight: where on the frame it helps what.

use super::shot::{Launch, Shot};
use crate::equipment::{Ball, Racket};
use crate::impact::PreparedModel;
use crate::impact::body::Body;
use crate::impact::error::ModelError;
use crate::impact::model::Model;
use nalgebra::Vector2;

/// Where lead tape goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Place {
    Tip,
    /// Half each at 3 and 9 o'clock.
    Sides,
    /// 0.10 m from the butt.
    Handle,
}

/// One racket of the study.
#[derive(Debug, Clone, Copy, serde::Serialize)]
pub struct Weighted {
    pub place: Place,
    pub added_kg: f64,
    /// Impact at the stringbed's centre, 80 mm toward the tip, 50 mm off the axis.
    pub centre: Launch,
    pub tip: Launch,
    pub edge: Launch,
}

/// The body with a mass added; centre of mass and inertias about it follow.
pub fn weighted(body: &Body, place: Place, kg: f64) -> Body {
    let mut b = body.clone();
    let tube = 0.01;
    match place {
        Place::Tip => b.add_mass_on_axis(kg, b.stringbed_centre + b.half_length + tube),
        Place::Handle => b.add_mass_on_axis(kg, 0.10),
        Place::Sides => {
            b.add_mass_on_axis(kg, b.stringbed_centre);
            let y = b.half_width + tube;
            b.racket_inertia.x += kg * y * y;
            b.racket_inertia.z += kg * y * y;
        }
    }
    b.reported_com_x = b.com_x;
    b
}

/// The same swing (speed of the hand's end kept: rate and speed of the original centre of mass) with every weight at every
/// place.
///
/// # Errors
/// A racket that cannot be prepared, an impact without contact.
pub fn study(model: &Model, racket: &Racket, ball: &Ball, shot: &Shot, added_kg: &[f64]) -> Result<Vec<Weighted>, ModelError> {
    let body = Body::new(racket, ball)?;
    let mut all = Vec::new();
    for place in [Place::Tip, Place::Sides, Place::Handle] {
        for &kg in added_kg {
            let heavier = weighted(&body, place, kg);
            // The swing is the same motion: the new centre of mass moves as that point of the racket did.
            let shift = heavier.com_x - body.com_x;
            let moved = Shot { racket_speed: shot.racket_speed - shot.swing_rate * shift, ..*shot };
            let prepared = PreparedModel::new(model.clone(), heavier)?;
            let at = |x: f64, y: f64| Shot { position: Vector2::new(x, y), ..moved }.launch(&prepared);
            all.push(Weighted { place, added_kg: kg, centre: at(0.0, 0.0)?, tip: at(-0.08, 0.0)?, edge: at(0.0, 0.05)? });
        }
    }
    Ok(all)
}
