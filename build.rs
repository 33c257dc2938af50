//! Lists the files of `footage-samples/` so that the program carries them and `sweetspot demo` works anywhere, offline;
//! and gives the program a name of its own source, so that results of another build are not taken for this one's.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A sample beyond this would make the program unwieldy; the demo's is a few megabytes.
const MOST_BYTES: u64 = 15 << 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let package = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR")?);
    println!("cargo:rustc-env=SWEETSPOT_SOURCE={:08x}", source_hash(&package)?);
    println!("cargo:rerun-if-changed=src");
    println!("cargo:rerun-if-changed=Cargo.lock");
    let root = package.join("footage-samples");
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

/// FNV-1a (32 bits, Fowler, Noll and Vo) over names and contents of `src/` and the locked dependencies: it tells builds
/// apart, it guards nothing.
fn source_hash(package: &Path) -> std::io::Result<u32> {
    let mut files = vec![package.join("Cargo.lock")];
    list(&package.join("src"), &mut files)?;
    files.sort();
    let mut hash = 0x811c_9dc5_u32;
    for file in files {
        let name = file.strip_prefix(package).unwrap_or(&file).to_string_lossy().replace('\\', "/");
        for byte in name.bytes().chain(std::fs::read(&file)?) {
            hash = (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193);
        }
    }
    Ok(hash)
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
