//! What a mistyped name may have meant.

/// Fewest letters of a part of a name by which it is known.
const SHORTEST_PART: usize = 4;

/// " (did you mean `a`, `b`?)" for the known names nearest to a mistyped one by Levenshtein's distance, or nothing.
pub(crate) fn near_names<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    // Only near names matter, and a distance takes time with the product of both lengths.
    let start: String = wrong.chars().take(64).collect();
    // Half a name is one as well.
    let is_part = |k: &str| start.chars().count() >= SHORTEST_PART && k.contains(&start);
    let mut close: Vec<(usize, &str)> =
        known.into_iter().map(|k| (strsim::levenshtein(&start, k), k)).filter(|(d, k)| *d <= 1 + k.len() / 4 || is_part(k)).collect();
    close.sort_unstable();
    close.dedup();
    let names: Vec<String> = close.iter().take(3).map(|(_, k)| format!("`{k}`")).collect();
    if names.is_empty() { String::new() } else { format!(" (did you mean {}?)", names.join(", ")) }
}
