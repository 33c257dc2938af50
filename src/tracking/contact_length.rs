//! How long ball and strings touch: no frame within it shows a ball in free flight (physics.md E.2: 3 to 7 ms, 4 to 6 ms at the speeds of play).

/// The strings hold the ball at least this long; until then its outline is no circle.
pub const SHORTEST_CONTACT_S: f64 = 4.0e-3;
/// From here on it is surely free and round.
pub const LONGEST_CONTACT_S: f64 = 6.5e-3;
