//! Text into markup: escaping, numbers as people read them, base64. Names in a report come from users' files and are
//! not trusted.

/// Escapes text for HTML and XML, in elements and in quoted attributes. Control characters, which XML forbids, become
/// U+FFFD.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(c),
            // Bidirectional overrides could make one name read as another.
            '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{fffe}' | '\u{ffff}' => out.push('\u{fffd}'),
            c if c.is_control() => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// Escaped text in which what stands between a pair of backticks is typed as it stands: a command, a column, a file.
pub fn prose(text: &str) -> String {
    let escaped = escape(text);
    let mut parts: Vec<&str> = escaped.split('`').collect();
    // One without its fellow is a character like others.
    let last = if parts.len().is_multiple_of(2) { parts.pop() } else { None };
    let mut out: String = parts.iter().enumerate().map(|(i, part)| if i % 2 == 1 { format!("<code>{part}</code>") } else { (*part).to_owned() }).collect();
    out.extend(last.map(|last| format!("`{last}")));
    out
}

/// A number with so many decimals, a true minus sign and no negative zero; a dash when it is not finite.
pub fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|b| b == b'0' || b == b'.') => digits.to_owned(),
        Some(digits) => format!("\u{2212}{digits}"),
        None => text,
    }
}

/// A number with so many significant digits, in plain notation where that is readable.
pub fn significant(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return fixed(value, 0);
    }
    let power = value.abs().log10().floor() as i32;
    if !(-4..6).contains(&power) {
        let mantissa = fixed(value / 10f64.powi(power), digits.saturating_sub(1));
        return format!("{mantissa}×10{}", superscript(power));
    }
    fixed(value, (digits as i32 - 1 - power).max(0) as usize)
}

/// A setting as people type it: up to six significant digits, no needless zeros.
pub fn plain(value: f64) -> String {
    let text = significant(value, 6);
    if text.contains('×') || !text.contains('.') { text } else { text.trim_end_matches('0').trim_end_matches('.').to_owned() }
}

/// `value ± sd`, the deviation to two significant digits and the value to the same place.
pub fn with_sd(value: f64, sd: f64) -> String {
    if !(sd.is_finite() && sd > 0.0) {
        return significant(value, 4);
    }
    let decimals = (1 - sd.log10().floor() as i32).max(0) as usize;
    if decimals > 7 || sd >= 1e6 {
        return format!("{} ± {}", significant(value, 4), significant(sd, 2));
    }
    format!("{} ± {}", fixed(value, decimals), fixed(sd, decimals))
}

/// A value to the place of its deviation's second digit: what [`with_sd`] writes before the sign.
pub fn rounded(value: f64, sd: f64) -> String {
    let text = with_sd(value, sd);
    text.split(" ± ").next().unwrap_or_default().to_owned()
}

/// A probability in per cent, never rounded to certainty.
pub fn percent(p: f64) -> String {
    match p {
        p if !p.is_finite() => "–".to_owned(),
        p if p > 0.0 && p < 0.001 => "< 0.1 %".to_owned(),
        p if p > 0.999 && p < 1.0 => "> 99.9 %".to_owned(),
        p if !(0.1..=0.9).contains(&p) => format!("{} %", fixed(100.0 * p, 1)),
        p => format!("{} %", fixed(100.0 * p, 0)),
    }
}

/// A p-value in a column of them.
pub fn odds(p: f64) -> String {
    if p < 0.001 { "< 0.001".to_owned() } else { fixed(p, 3) }
}

/// A probability that data gave: never certain, however near it comes.
pub fn probability(p: f64) -> String {
    percent(p.clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON))
}

/// Minus signs for the hyphens that stand before numbers in words written for the terminal.
pub fn true_minus(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 8);
    let mut last = ' ';
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        let negative = c == '-' && !last.is_alphanumeric() && rest.peek().is_some_and(char::is_ascii_digit);
        out.push(if negative { '\u{2212}' } else { c });
        last = c;
    }
    out
}

/// An integer as superscript characters.
pub fn superscript(power: i32) -> String {
    power
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            d => char::from_u32(0x2070 + d.to_digit(10).unwrap_or(0)).unwrap_or(d),
        })
        .collect()
}

/// Base64 (RFC 4648, with padding), for pictures inside the page.
pub fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for block in bytes.chunks(3) {
        let word = block.iter().fold(0u32, |w, b| w << 8 | u32::from(*b)) << (8 * (3 - block.len()));
        for k in 0..4 {
            let sextet = (word >> (18 - 6 * k)) & 63;
            out.push(if k <= block.len() { ALPHABET[sextet as usize] as char } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_base64_vectors_of_rfc_4648() {
        for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("fooba", "Zm9vYmE="), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    #[test]
    fn truth_numbers_read_as_in_a_paper() {
        assert_eq!(fixed(-0.0001, 2), "0.00");
        assert_eq!(fixed(-1.5, 1), "\u{2212}1.5");
        assert_eq!(with_sd(21.4567, 0.0432), "21.457 ± 0.043");
        assert_eq!(with_sd(1125.0, 122.0), "1125 ± 122");
        assert_eq!((rounded(0.22512, 0.0286), rounded(-3.0, 0.0)), ("0.225".to_owned(), "\u{2212}3.000".to_owned()));
        assert_eq!(significant(0.00001234, 3), "1.23×10⁻⁵");
        assert_eq!(significant(1234.5, 3), "1234"); // digits left of the point are never blanked
        assert_eq!(percent(0.99999), "> 99.9 %");
        assert_eq!(fixed(f64::NAN, 2), "–");
    }

    #[test]
    fn truth_no_probability_is_certain() {
        assert_eq!((probability(1.0), probability(0.0), probability(0.5)), ("> 99.9 %".to_owned(), "< 0.1 %".to_owned(), "50 %".to_owned()));
        assert_eq!(percent(1.0), "100.0 %", "a share may be the whole");
    }

    #[test]
    fn truth_only_hyphens_before_numbers_become_minus_signs() {
        assert_eq!(
            true_minus("between -45 mm and -14 mm (-3), lab-0003, under-predicted"),
            "between \u{2212}45 mm and \u{2212}14 mm (\u{2212}3), lab-0003, under-predicted"
        );
    }

    #[test]
    fn truth_what_stands_between_backticks_is_code_and_markup_is_not() {
        assert_eq!(prose("run `sweetspot fit` on `<b>`"), "run <code>sweetspot fit</code> on <code>&lt;b&gt;</code>");
        assert_eq!(prose("a ` alone; then `x` and `"), "a <code> alone; then </code>x<code> and </code>");
        assert_eq!(prose("`x` and ` left"), "<code>x</code> and ` left");
        assert_eq!(prose("none"), "none");
    }

    #[test]
    fn law_escaped_text_holds_no_markup() {
        let e = escape("<script>alert(\"x\")</script>&'\u{0}\u{202e}");
        assert!(!e.contains(['<', '>', '"', '\'', '\u{0}', '\u{202e}']));
    }
}
