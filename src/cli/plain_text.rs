//! What is said to a person at a terminal: it quotes names and cells of files that others wrote.

/// Most letters of a line that are shown, from its beginning and from its end; none of the program's own is as long.
const BEGINNING: usize = 3000;
const END: usize = 600;

/// The text with the signs that steer a terminal written out (`\u{1b}`), and without the middle of lines that nobody would read.
pub fn plain(text: &str) -> String {
    text.split('\n').map(|l| line(l.trim_end_matches('\r'))).collect::<Vec<_>>().join("\n")
}

fn line(text: &str) -> String {
    let letters = text.chars().count();
    if letters <= BEGINNING + END {
        return written_out(text.chars());
    }
    let end = written_out(text.chars().skip(letters - END));
    format!("{} [... {} letters left out ...] {end}", written_out(text.chars().take(BEGINNING)), letters - BEGINNING - END)
}

fn written_out(text: impl Iterator<Item = char>) -> String {
    let mut out = String::new();
    for c in text {
        // Beside control characters those that turn the direction of writing.
        if c.is_control() && c != '\t' || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}') {
            out.extend(c.escape_unicode());
        } else {
            out.push(c);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_nothing_that_is_said_steers_the_terminal() {
        for (said, shown) in [
            ("a.csv, line 2:\n\t`Größe` is 3", "a.csv, line 2:\n\t`Größe` is 3"),
            ("\u{1b}[2Jgone\u{7}", "\\u{1b}[2Jgone\\u{7}"),
            ("over\rwritten\u{9b}31m", "over\\u{d}written\\u{9b}31m"),
            ("\u{202e}vsc.stcapmi", "\\u{202e}vsc.stcapmi"),
        ] {
            assert_eq!(plain(said), shown);
        }
        let long = plain(&format!("begins {}\nthe next line", "ö".repeat(3_000_000)));
        assert!(long.starts_with("begins ö") && long.ends_with("\nthe next line") && long.len() < 10_000, "{} bytes", long.len());
        assert!(long.contains("[... 2996407 letters left out ...]"));
    }
}
