//! Columns of the impacts table as people read them: words, unit and scale.

use crate::impact_table::{INPUTS, OUTPUTS, SHARED, unit};

/// A column's name in words, the unit it is shown in, and the factor from SI to that unit.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnWords {
    pub words: String,
    pub unit: &'static str,
    pub factor: f64,
}

/// What follows a column's name when its error in proportion is meant ([`crate::validation::comparison::SessionOffset`]).
const RELATIVE: &str = " (relative)";

/// Words for a column of the impacts table; an unknown column keeps its own name.
pub fn column_words(column: &str) -> ColumnWords {
    let plain = |words: &str, unit, factor| ColumnWords { words: words.to_owned(), unit, factor };
    match column {
        "impact_x" => return plain("impact position x", "mm", 1000.0),
        "impact_y" => return plain("impact position y", "mm", 1000.0),
        "face_turn_x" => return plain("turn of the face about x", "mrad", 1000.0),
        "face_turn_y" => return plain("turn of the face about y", "mrad", 1000.0),
        "face_turn_z" => return plain("turn of the face about z", "mrad", 1000.0),
        "face_shift_x" => return plain("shift of the stringbed centre along x", "mm", 1000.0),
        "face_shift_y" => return plain("shift of the stringbed centre along y", "mm", 1000.0),
        "face_shift_z" => return plain("shift of the string plane along z", "mm", 1000.0),
        "grip_torque" => return plain("grip torque", "N m", 1.0),
        "order" => return plain("order of the impacts", "", 1.0),
        "contact_time" => return plain("contact time", "ms", 1000.0),
        "contact_time_shift" => return plain("shift of the contact's end", "ms", 1000.0),
        "balance_shift" => return plain("shift of the balance point along x", "mm", 1000.0),
        _ => {}
    }
    if let Some(whole) = column.strip_suffix(RELATIVE) {
        return plain(&format!("{}, in proportion", column_words(whole).words), "%", 100.0);
    }
    let parts: Vec<&str> = column.split('_').collect();
    let is_measured = INPUTS.contains(&column) || OUTPUTS.contains(&column);
    let (body, side, kind) = match parts.as_slice() {
        [body, side, kind] if is_measured => (*body, *side, *kind),
        // A column of the user's own has a unit that only the user knows.
        _ => return plain(column, if SHARED.contains(&column) { unit(column) } else { "" }, 1.0),
    };
    let when = if side == "in" { "before" } else { "after" };
    let quantity = match (body, kind.starts_with('w')) {
        ("ball", true) => "ball spin",
        ("ball", false) => "ball velocity",
        (_, true) => "racket rate",
        (_, false) => "racket velocity",
    };
    plain(&format!("{quantity} {} {when}", &kind[1..]), unit(column), 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_columns_read_as_words() {
        assert_eq!(column_words("ball_out_vz").words, "ball velocity z after");
        assert_eq!(column_words("racket_in_wy").unit, "rad/s");
        assert_eq!(column_words("impact_x").factor, 1000.0);
        assert_eq!(column_words("ball_out_wy (relative)"), ColumnWords { words: "ball spin y after, in proportion".into(), unit: "%", factor: 100.0 });
        for own in ["player", "ball_in_é", "racket_in_no", "ball_out_", "racket_in_vw"] {
            assert_eq!(column_words(own), ColumnWords { words: own.into(), unit: "", factor: 1.0 });
        }
    }
}
