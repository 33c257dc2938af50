//! Failures as a person reads them: of three hundred rows that lack one column, three lines and a list of names.

use std::collections::BTreeMap;

/// Lines of one reason that are shown whole.
const SHOWN: usize = 3;
/// With fewer beyond them nothing is gained by a line that says so.
const FEWEST_MORE: usize = 2;

/// A message whose lines are mostly `name: reason`, with what shares a reason with [`SHOWN`] lines before it named in one line.
///
/// Nothing else is lost of it, and nothing at all in the results and with `--json`.
pub fn grouped(message: &str) -> String {
    let mut names: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for (name, reason) in message.lines().filter_map(named) {
        names.entry(reason).or_default().push(name);
    }
    let mut told: BTreeMap<String, usize> = BTreeMap::new();
    let mut lines = Vec::new();
    for line in message.lines() {
        let shared = named(line).and_then(|(_, reason)| names.get_key_value(&reason)).filter(|(_, all)| all.len() >= SHOWN + FEWEST_MORE);
        let Some((reason, all)) = shared else {
            lines.push(line.to_owned());
            continue;
        };
        let before = told.entry(reason.clone()).or_default();
        *before += 1;
        if *before <= SHOWN {
            lines.push(line.to_owned());
        }
        if *before == SHOWN {
            let indent = &line[..line.len() - line.trim_start().len()];
            lines.push(format!("{indent}and {} more for the same reason: {}", all.len() - SHOWN, all[SHOWN..].join(", ")));
        }
    }
    lines.join("\n")
}

/// Whom a line names, and why it failed; a path through a shot's own folder is the same reason as through another's, and so is a cell of another line.
fn named(line: &str) -> Option<(&str, String)> {
    let (name, reason) = line.split_once(": ")?;
    let name = name.trim_start();
    let name = name.strip_prefix("impact ").unwrap_or(name);
    Some((name, of_any_line(&reason.replace(&format!("/{name}/"), "/*/"))))
}

/// A reason without the number of the line in which a table has it.
fn of_any_line(reason: &str) -> String {
    match reason.split_once(", line ") {
        Some((file, rest)) if !file.contains(": ") => format!("{file}, line *{}", rest.trim_start_matches(|c: char| c.is_ascii_digit())),
        _ => reason.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fails_for_one_reason_is_told_once_and_all_are_named() {
        let lines: Vec<String> = (1..=300).map(|k| format!("  s{k}: no ball was found")).collect();
        let message = format!("302 of 310 shots failed:\n{}\n  t1: /results/t1/tracks.csv: empty\n  t2: the racket was lost", lines.join("\n"));
        let shown = grouped(&message);
        let shown: Vec<&str> = shown.lines().collect();
        assert_eq!(shown[..4], ["302 of 310 shots failed:", "  s1: no ball was found", "  s2: no ball was found", "  s3: no ball was found"]);
        assert!(shown[4].starts_with("  and 297 more for the same reason: s4, s5, ") && shown[4].ends_with(", s300"), "{}", shown[4]);
        assert_eq!(shown[5..], ["  t1: /results/t1/tracks.csv: empty", "  t2: the racket was lost"]);
    }

    #[test]
    fn cells_with_one_fault_in_many_lines_are_told_once() {
        let lines: Vec<String> = (2..=9).map(|k| format!("s{k}: t.csv, line {k}: `impact_x` is \"n/a\"")).collect();
        let told = grouped(&lines.join("\n"));
        assert!(told.starts_with(&lines[..3].join("\n")) && told.ends_with("\nand 5 more for the same reason: s5, s6, s7, s8, s9"), "{told}");
    }

    #[test]
    fn two_reasons_that_alternate_are_told_each_with_its_own() {
        let message: Vec<String> = (1..=12).map(|k| format!("impact {k}: {}", if k % 2 == 0 { "even" } else { "odd" })).collect();
        let told = "impact 1: odd\nimpact 2: even\nimpact 3: odd\nimpact 4: even\nimpact 5: odd\nand 3 more for the same reason: 7, 9, 11\n\
                    impact 6: even\nand 3 more for the same reason: 8, 10, 12";
        assert_eq!(grouped(&message.join("\n")), told);
    }

    #[test]
    fn law_a_few_lines_and_messages_of_another_form_stay_as_they_are() {
        let few = (1..=4).map(|k| format!("s{k}: no ball was found")).collect::<Vec<_>>().join("\n");
        for message in ["", "a.csv: 2 faults", &few, "expression of `mine`: ends\n  1 +\n     ^", "x\n\ny"] {
            assert_eq!(grouped(message), message);
        }
        let paths = (1..=5).map(|k| format!("s{k}: /r/s{k}/tracks.csv: empty")).collect::<Vec<_>>().join("\n");
        assert!(grouped(&paths).ends_with("s3: /r/s3/tracks.csv: empty\nand 2 more for the same reason: s4, s5"));
    }
}
