//! Lists the files of `footage-samples/` so that the program carries them and `sweetspot demo` works anywhere, offline.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A sample beyond this would make the program unwieldy; the demo's is a few megabytes.
const MOST_BYTES: u64 = 15 << 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR")?).join("footage-samples");
    println!("cargo:rerun-if-changed=footage-samples");
    println!("cargo:rerun-if-changed=build.rs");
    let mut files = Vec::new();
    if root.is_dir() {
        list(&root, &mut files)?;
    }
    files.sort();
    let mut bytes = 0;
    let mut code = String::from("&[\n");
    for file in &files {
        bytes += std::fs::metadata(file)?.len();
        let name = file.strip_prefix(&root)?.to_string_lossy().replace('\\', "/");
        writeln!(code, "    ({name:?}, include_bytes!({:?})),", file.to_string_lossy())?;
    }
    if bytes > MOST_BYTES {
        return Err(format!("footage-samples holds {bytes} bytes; allowed: {MOST_BYTES}").into());
    }
    code.push_str("]\n");
    std::fs::write(PathBuf::from(std::env::var("OUT_DIR")?).join("footage_samples.rs"), code)?;
    Ok(())
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        // Results of a run in the checkout are not part of the sample.
        if entry.file_type()?.is_dir() {
            if entry.file_name() != "results" {
                list(&entry.path(), files)?;
            }
        } else {
            files.push(entry.path());
        }
    }
    Ok(())
}
