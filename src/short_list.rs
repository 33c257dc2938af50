//! Lists in a sentence: the first few by name, and how many more there are.

/// "a, b and 3 more": at most `most` of `words`, with `between` standing between them.
pub(crate) fn short_list<S: AsRef<str>>(words: &[S], most: usize, between: &str) -> String {
    let shown = words.iter().take(most).map(AsRef::as_ref).collect::<Vec<&str>>().join(between);
    match words.len().saturating_sub(most) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_first_are_named_and_the_others_counted() {
        assert_eq!(short_list(&["a", "b"], 2, ", "), "a, b");
        assert_eq!(short_list(&["a", "b", "c", "d"], 2, "; "), "a; b and 2 more");
        assert_eq!(short_list::<&str>(&[], 2, ", "), "");
    }
}
