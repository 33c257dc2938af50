//! `sweetspot explore published`.

use super::Outcome;
use crate::cli::error::CliError;
use crate::impact::study::campaign::mean_shots;
use crate::impact::study::published::table;
use crate::report::{Report, Section, Table};

pub fn published() -> Result<Outcome, CliError> {
    let (lines, shots) = (table()?, mean_shots()?);
    let mut numbers = Table::new("Published numbers, the reference's prototype, and this program").column("Quantity").column("Published");
    numbers = numbers.numbers("Prototype").numbers("Model").column("Unit");
    for l in &lines {
        let digits = l.digits();
        let reference = match l.reference {
            None => "not printed".into(),
            Some([a, b]) if a == b => format!("{a:.digits$}"),
            Some([a, b]) => format!("{a:.digits$} to {b:.digits$}"),
        };
        numbers = numbers.row(&[l.quantity, l.published, &reference, &format!("{:.digits$}", l.model), l.unit]);
    }
    let mut means = Table::new("Mean shots of tables 5.27 and 5.28").column("Players").column("Sign of the chop rate").numbers("Strings sideways, kN/m");
    means = means.numbers("Forward speed, m/s").numbers("published").numbers("Topspin, rpm").numbers("published").numbers("Face open, deg");
    for s in &shots {
        means = means.row(&[
            s.who,
            if s.chop_as_printed { "as printed" } else { "reversed" },
            &if s.strings_n_m > 0.0 { format!("{:.0}", s.strings_n_m / 1e3) } else { "rigid".into() },
            &format!("{:.2}", s.forward_m_s),
            &format!("{:.2}", s.published_forward_m_s),
            &format!("{:.0}", s.topspin_rpm),
            &format!("{:.0}", s.published_topspin_rpm),
            &format!("{:.1}", s.open_deg),
        ]);
    }
    let page = Report::new("Published numbers against the model")
        .subtitle("Visco-elastic base at its documented defaults")
        .section(Section::new("published", "Single quantities").table(numbers))
        .section(
            Section::new("campaign", "The Wimbledon campaign")
                .paragraph(
                    "The face's attitude is not in the tables: its two angles are solved from the ball's upward and sideways speed. \
                     Forward speed and topspin are predictions. The sign of the chop rate in the tables is not known; both are shown.",
                )
                .table(means),
        )
        .finish();
    Ok(("explore-published", serde_json::json!({ "table": lines, "mean_shots": shots }), page))
}
