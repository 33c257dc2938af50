//! The sample session that the program carries: the files of `footage-samples/`, rendered once by `sweetspot synth` from
//! the scenario that stands beside them.

/// Path below `footage-samples/` and bytes.
static FILES: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/footage_samples.rs"));

/// Every file of the sample session: path below the session folder, bytes.
pub fn files() -> impl Iterator<Item = (&'static str, &'static [u8])> {
    FILES.iter().filter_map(|(name, bytes)| name.strip_prefix("session/").map(|n| (n, *bytes)))
}
