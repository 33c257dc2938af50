//! Columns of the impacts table as people read them: as labels, with unit and scale, and as the subject of a sentence.

use super::{INPUTS, OUTPUTS, SHARED, unit};

/// A column's name in words, the unit it is shown in, and the factor from SI to that unit.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnWords {
    pub words: String,
    pub unit: &'static str,
    pub factor: f64,
}

/// What follows a column's name when its error in proportion is meant.
pub const RELATIVE: &str = " (relative)";
/// The same when its mean over the impacts that lack it is meant.
pub const MEAN: &str = " (mean where not measured)";

/// What a column of three parts (`ball_in_vx`) holds.
struct Motion {
    of_ball: bool,
    is_rate: bool,
    before: bool,
    axis: char,
}

impl Motion {
    /// `None` for any other column of the table, and for one of the user's own, whatever it is called.
    fn of(column: &str) -> Option<Self> {
        if !INPUTS.contains(&column) && !OUTPUTS.contains(&column) {
            return None;
        }
        match column.split('_').collect::<Vec<_>>().as_slice() {
            [body, side, kind] => Some(Motion { of_ball: *body == "ball", is_rate: kind.starts_with('w'), before: *side == "in", axis: kind.chars().last()? }),
            _ => None,
        }
    }
}

/// A column as the label of an axis or a row ("ball velocity z after"); an unknown column keeps its own name.
pub fn column_words(column: &str) -> ColumnWords {
    let plain = |words: &str, unit, factor| ColumnWords { words: words.to_owned(), unit, factor };
    if let Some(Motion { of_ball, is_rate, before, axis }) = Motion::of(column) {
        let quantity = match (of_ball, is_rate) {
            (true, true) => "ball spin",
            (true, false) => "ball velocity",
            (false, true) => "racket rate",
            (false, false) => "racket velocity",
        };
        return plain(&format!("{quantity} {axis} {}", if before { "before" } else { "after" }), unit(column), 1.0);
    }
    if let Some(whole) = column.strip_suffix(RELATIVE) {
        return plain(&format!("{}, in proportion", column_words(whole).words), "%", 100.0);
    }
    if let Some(lacked) = column.strip_suffix(MEAN) {
        let of = column_words(lacked);
        return ColumnWords { words: format!("{}, mean where not measured", of.words), ..of };
    }
    match column {
        "impact_x" => plain("impact position x", "mm", 1000.0),
        "impact_y" => plain("impact position y", "mm", 1000.0),
        "face_turn_x" => plain("turn of the face about x", "mrad", 1000.0),
        "face_turn_y" => plain("turn of the face about y", "mrad", 1000.0),
        "face_turn_z" => plain("turn of the face about z", "mrad", 1000.0),
        "face_shift_x" => plain("shift of the stringbed centre along x", "mm", 1000.0),
        "face_shift_y" => plain("shift of the stringbed centre along y", "mm", 1000.0),
        "face_shift_z" => plain("shift of the string plane along z", "mm", 1000.0),
        "grip_torque" => plain("grip torque", "N m", 1.0),
        "order" => plain("order of the impacts", "", 1.0),
        "contact_time" => plain("contact time", "ms", 1000.0),
        "contact_time_shift" => plain("shift of the contact's end", "ms", 1000.0),
        "balance_shift" => plain("shift of the balance point along x", "mm", 1000.0),
        // A column of the user's own has a unit that only the user knows.
        _ => plain(column, if SHARED.contains(&column) { unit(column) } else { "" }, 1.0),
    }
}

/// A column as the subject of a sentence that says of which side of the contact it speaks ("ball speed normal to the strings").
pub fn column_subject(column: &str) -> String {
    let Some(Motion { of_ball, is_rate, axis, .. }) = Motion::of(column) else { return column_words(column).words };
    let along = match axis {
        'x' => "along the racket",
        'y' => "across the face",
        _ => "normal to the strings",
    };
    match (of_ball, is_rate, axis) {
        (true, false, _) => format!("ball speed {along}"),
        (true, true, 'x') => "ball spin about the racket's long axis".to_owned(),
        (true, true, 'y') => "ball spin about the axis across the face".to_owned(),
        (true, true, _) => "ball spin about the normal".to_owned(),
        (false, true, 'x') => "the racket's twist rate".to_owned(),
        (false, true, 'y') => "the racket's swing rate".to_owned(),
        (false, true, _) => "the racket's rate in its own plane".to_owned(),
        (false, false, _) => format!("racket speed {along}"),
    }
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

    #[test]
    fn truth_columns_are_subjects_of_sentences() {
        assert_eq!(column_subject("ball_out_vz"), "ball speed normal to the strings");
        assert_eq!(column_subject("ball_in_wx"), "ball spin about the racket's long axis");
        assert_eq!(column_subject("racket_out_wy"), "the racket's swing rate");
        assert_eq!(column_subject("racket_in_vx"), "racket speed along the racket");
        assert_eq!(column_subject("contact_time"), "contact time");
        // A column of the user's own is what its name says.
        assert_eq!(column_subject("racket_age"), "racket_age");
    }
}
