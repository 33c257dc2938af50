//! What a mistyped name may have meant.

/// " (did you mean `a`, `b`?)" for the known names nearest to a mistyped one by Levenshtein's distance, or nothing.
pub(crate) fn near_names<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    // Only near names matter, and a distance takes time with the product of both lengths.
    let start: String = wrong.chars().take(64).collect();
    let mut close: Vec<(usize, &str)> = known.into_iter().map(|k| (strsim::levenshtein(&start, k), k)).filter(|(d, k)| *d <= 1 + k.len() / 4).collect();
    close.sort_unstable();
    close.dedup();
    let names: Vec<String> = close.iter().take(3).map(|(_, k)| format!("`{k}`")).collect();
    if names.is_empty() { String::new() } else { format!(" (did you mean {}?)", names.join(", ")) }
}
