//! The median of measured values.

/// The median, and of an even number the greater of the middle two, so that it is one of the values; `None` of nothing.
pub(crate) fn upper_median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The median, and of an even number the mean of the middle two; `None` of nothing.
pub(crate) fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let n = values.len();
    (n > 0).then(|| (values[(n - 1) / 2] + values[n / 2]) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_of_an_even_number_it_is_the_mean_of_the_middle_two() {
        assert_eq!([median([3.0, 1.0, 2.0]), median([4.0, 1.0, 3.0, 2.0]), median([])], [Some(2.0), Some(2.5), None]);
    }

    #[test]
    fn truth_the_upper_one_is_one_of_the_values() {
        assert_eq!([upper_median([3.0, 1.0, 2.0]), upper_median([4.0, 1.0, 3.0, 2.0]), upper_median([])], [Some(2.0), Some(3.0), None]);
    }
}
