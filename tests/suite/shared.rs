//! Where the practice data stand. CI has them, so there a missing folder fails; elsewhere the tests that need them are
//! left out with a word on stderr.

use std::path::PathBuf;

/// The folder of practice data below `SWEETSPOT_SHARED` (default: `../shared`), or `None` outside CI when it is missing.
#[allow(dead_code)]
pub fn shared(below: &str) -> Option<PathBuf> {
    let root = std::env::var_os("SWEETSPOT_SHARED").map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = root.join(below);
    if path.exists() {
        return Some(path);
    }
    assert!(std::env::var_os("CI").is_none(), "{} is missing, and CI must have it", path.display());
    eprintln!("left out: {} is missing", path.display());
    None
}
