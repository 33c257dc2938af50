//! The fixed split: which impacts a fit never sees is decided by the SHA-256 of the id, for ever.
//!
//! 70 % to fit, 30 % held out. A reshuffled or extended table keeps every impact on its side, so nobody can tune by
//! reshuffling. With a grouping column the group's name is hashed instead, which keeps a player or session together.

use sha2::{Digest, Sha256};

/// Share of impacts held out.
pub const HELD_OUT_SHARE: f64 = 0.3;

/// Whether this id (or group) is held out: the first eight bytes of its SHA-256, as a fraction, lie below 0.3.
pub fn is_held_out(key: &str) -> bool {
    hash_fraction(key) < HELD_OUT_SHARE
}

/// The first eight bytes of the SHA-256 of a key, as a fraction of their range.
pub fn hash_fraction(key: &str) -> f64 {
    let digest = Sha256::digest(key.as_bytes());
    let head = digest.iter().take(8).fold(0u64, |sum, &byte| (sum << 8) | u64::from(byte));
    (head as f64) / (u64::MAX as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_first_hash_bytes_decide() {
        // SHA-256("a") begins ca97…: 0.79, to fit; SHA-256("abc") begins ba78…; SHA-256("hello") begins 2cf2…: 0.176.
        assert!(!is_held_out("a"));
        assert!(!is_held_out("abc"));
        assert!(is_held_out("hello"));
    }

    #[test]
    fn law_about_three_in_ten_are_held_out() {
        let held = (0..10_000).filter(|i| is_held_out(&format!("lab-{i:04}"))).count();
        assert!((2860..3140).contains(&held), "{held}: three binomial deviations are 137");
    }
}
