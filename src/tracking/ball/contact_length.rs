//! How long ball and strings touch: no frame within it shows a ball in free flight (3 to 7 ms, 4 to 6 ms at the speeds of play:
//! docs/impact.md, base visco-elastic).

use std::ops::RangeInclusive;

/// The strings hold the ball at least this long; until then its outline is no circle.
pub const SHORTEST_CONTACT_S: f64 = 4.0e-3;
/// From here on it is surely free and round.
pub const LONGEST_CONTACT_S: f64 = 6.5e-3;

/// Frames that may show the contact, if it begins at `first`, and the one before; none without a contact.
pub fn frames_of_contact(first: Option<f64>, frame_rate_hz: f64) -> RangeInclusive<f64> {
    first.map_or(f64::INFINITY..=f64::INFINITY, |first| first - 1.0..=first + 1.0 + LONGEST_CONTACT_S * frame_rate_hz)
}
