//! Light beyond what a picture can hold.

/// Grey from which on more light is cut off.
pub const WHITE: f32 = 255.0;

/// Whether a pixel shows as much of what is expected there as a picture can: that there is at least so much is all it says.
#[inline(always)]
pub fn is_cut_off(grey: f32, expected: f32) -> bool {
    grey >= WHITE && expected > grey
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_white_says_something_only_where_less_is_expected() {
        assert!(is_cut_off(255.0, 300.0));
        assert!(!is_cut_off(255.0, 200.0) && !is_cut_off(254.0, 300.0));
    }
}
