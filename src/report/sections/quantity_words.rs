//! Shot characteristics as people read them.

use crate::impact_table::{ColumnWords, column_words};

/// Name in shot.json, words, unit shown, factor from SI; in the order of reading.
pub(super) const QUANTITIES: [(&str, &str, &str, f64); 34] = [
    ("ball_in_speed", "ball speed before", "m/s", 1.0),
    ("ball_out_speed", "ball speed after", "m/s", 1.0),
    ("ball_in_spin_rpm", "ball spin before", "rpm", 1.0),
    ("ball_out_spin_rpm", "ball spin after", "rpm", 1.0),
    ("ball_in_topspin_rpm", "topspin before", "rpm", 1.0),
    ("ball_out_topspin_rpm", "topspin after", "rpm", 1.0),
    ("racket_in_speed", "racket speed before (centre of mass)", "m/s", 1.0),
    ("racket_out_speed", "racket speed after (centre of mass)", "m/s", 1.0),
    ("racket_in_rate", "racket angular speed before", "rad/s", 1.0),
    ("racket_out_rate", "racket angular speed after", "rad/s", 1.0),
    ("tip_in_speed", "tip speed before", "m/s", 1.0),
    ("impact_point_in_speed", "speed of the impact point before", "m/s", 1.0),
    ("impact_frame", "impact, in frames", "", 1.0),
    ("contact_time", "contact time", "ms", 1000.0),
    ("ball_flattening", "ball flattened by the strings", "%", 100.0),
    ("impact_x", "impact from stringbed centre, x", "mm", 1000.0),
    ("impact_y", "impact from stringbed centre, y", "mm", 1000.0),
    ("impact_x_from_com", "impact from centre of mass, x", "mm", 1000.0),
    ("impact_from_butt", "impact from the butt", "mm", 1000.0),
    ("playing_angle_deg", "playing angle", "°", 1.0),
    ("planar_racket_velocity", "planar racket velocity", "m/s", 1.0),
    ("planar_relative_velocity_up", "speed of the face up past the ball", "m/s", 1.0),
    ("apparent_restitution", "apparent restitution", "", 1.0),
    ("restitution", "restitution", "", 1.0),
    ("effective_mass", "effective mass of the impact point", "g", 1000.0),
    ("ideal_point_from_butt", "ideal point from the butt", "mm", 1000.0),
    ("impact_beyond_ideal_point", "impact beyond the ideal point", "mm", 1000.0),
    ("centre_of_percussion_from_butt", "centre of percussion from the butt", "mm", 1000.0),
    ("impact_beyond_centre_of_percussion", "impact beyond the centre of percussion", "mm", 1000.0),
    ("node_point_from_butt", "node point from the butt", "mm", 1000.0),
    ("impact_beyond_node_point", "impact beyond the node point", "mm", 1000.0),
    ("dead_spot_from_butt", "dead spot from the butt", "mm", 1000.0),
    ("impact_success_ratio", "impact success ratio", "", 1.0),
    ("efficiency", "efficiency", "", 1.0),
];

/// Words for a velocity along the global axes, `ball_in_global_vx` and its like.
fn global_words(name: &str) -> Option<String> {
    let (body, side, axis) = match name.split('_').collect::<Vec<_>>().as_slice() {
        [body @ ("ball" | "racket"), side @ ("in" | "out"), "global", axis] => (*body, *side, *axis),
        _ => return None,
    };
    let axis = ["vx", "vy", "vz"].iter().zip(["U", "V", "W"]).find(|(n, _)| **n == axis)?.1;
    Some(format!("{body} velocity {axis} {}", if side == "in" { "before" } else { "after" }))
}

/// Words for a characteristic; the table's own columns and unknown names as [`column_words`] has them.
pub(super) fn quantity_words(name: &str) -> ColumnWords {
    if let Some((_, words, unit, factor)) = QUANTITIES.iter().find(|q| q.0 == name) {
        return ColumnWords { words: (*words).to_owned(), unit, factor: *factor };
    }
    if let Some(words) = global_words(name) {
        return ColumnWords { words, unit: "m/s", factor: 1.0 };
    }
    let w = column_words(name);
    // An unknown name keeps the unit of its own quantity.
    if w.words == name { ColumnWords { unit: "", ..w } } else { w }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_global_velocities_read_as_words() {
        assert_eq!(quantity_words("ball_in_global_vx"), ColumnWords { words: "ball velocity U before".into(), unit: "m/s", factor: 1.0 });
        assert_eq!(quantity_words("racket_out_global_vz").words, "racket velocity W after");
        assert_eq!(quantity_words("tip_in_global_vx").words, "tip_in_global_vx");
    }
}
