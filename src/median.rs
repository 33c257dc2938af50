//! The median of measured values.

/// The median, and of an even number the greater of the middle two, so that it is one of the values; `None` of nothing.
pub(crate) fn upper_median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_it_is_one_of_the_values() {
        assert_eq!([upper_median([3.0, 1.0, 2.0]), upper_median([4.0, 1.0, 3.0, 2.0]), upper_median([])], [Some(2.0), Some(3.0), None]);
    }
}
