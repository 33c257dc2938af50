//! What made a result: version and input hashes, so that the same inputs give the same bytes and can be found again.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Version of the program and, after the plus, which source it was built from: written into every result, so that what
/// another build computed is computed again.
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "+", env!("SWEETSPOT_SOURCE"));

/// The program version, the command and the SHA-256 of each input, by name.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    pub version: String,
    pub command: String,
    pub inputs: std::collections::BTreeMap<String, String>,
}

impl Provenance {
    pub fn new(command: &str) -> Self {
        Provenance { version: VERSION.to_owned(), command: command.to_owned(), inputs: Default::default() }
    }

    /// Adds the hash of a file under its own name; the second of one name (of two folders) is `name (2)`.
    pub fn with_file(self, path: &Path) -> io::Result<Self> {
        let hash = sha256_file(path)?;
        Ok(self.with_hash(path, hash))
    }

    /// The same of a file that has been read: what is read twice need not be the same (a pipe, a file written meanwhile).
    pub fn with_hash(mut self, path: &Path, hash: String) -> Self {
        let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let numbered = (2..).map(|k| format!("{name} ({k})"));
        let free = std::iter::once(name.clone()).chain(numbered).find(|key| !self.inputs.contains_key(key)).unwrap_or_default();
        self.inputs.insert(free, hash);
        self
    }
}

/// SHA-256 of bytes, as lowercase hex.
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// SHA-256 of a file, read in blocks.
pub fn sha256_file(path: &Path) -> io::Result<String> {
    let mut file = std::fs::File::open(path)?;
    let mut hash = Sha256::new();
    let mut block = vec![0u8; 1 << 16];
    loop {
        let n = file.read(&mut block)?;
        if n == 0 {
            return Ok(hex(&hash.finalize()));
        }
        hash.update(&block[..n]);
    }
}

fn hex(digest: &[u8]) -> String {
    digest.iter().map(|b| format!("{b:02x}")).collect()
}

/// Writes a result file so that it is either whole or absent: temporary file in the same folder, then rename.
///
/// Makes the folder when it is missing. Errors name the file.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_whole(path, bytes, true)
}

/// [`write_atomically`] that leaves it to the system when the bytes reach the disk: for tables quickly made again, whose reader
/// finds out after a power cut that they are not whole.
pub fn write_soon(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_whole(path, bytes, false)
}

/// Whether a file ends with a whole line, as every table does; one cut off by a power failure is empty or ends with zeros.
pub fn ends_with_line(path: &Path) -> bool {
    let last = |mut file: std::fs::File| {
        let mut byte = [0];
        file.seek(SeekFrom::End(-1)).and_then(|_| file.read_exact(&mut byte)).is_ok_and(|()| byte == *b"\n")
    };
    std::fs::File::open(path).is_ok_and(last)
}

fn write_whole(path: &Path, bytes: &[u8], to_the_disk: bool) -> io::Result<()> {
    let named = |e: io::Error| io::Error::new(e.kind(), format!("{}: cannot be written ({e})", path.display()));
    // A terminal, a pipe or a device is written to, never replaced by a file; nor is a name by which the system lends one. Any other link is replaced:
    // it may lead out of the folder.
    let lent = ["/dev", "/proc"].iter().any(|folder| path.starts_with(folder));
    if lent || std::fs::symlink_metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir() && !m.is_symlink()) {
        return std::fs::OpenOptions::new().write(true).open(path).and_then(|mut file| file.write_all(bytes)).map_err(named);
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or_else(|| Path::new("."));
    std::fs::create_dir_all(folder).map_err(named)?;
    let mut file = tempfile::Builder::new().prefix(".sweetspot-").suffix(".tmp").tempfile_in(folder).map_err(named)?;
    file.write_all(bytes).map_err(named)?;
    if to_the_disk {
        file.as_file().sync_data().map_err(named)?;
    }
    // A named temporary file is private (0600); results are for everybody who may read the folder.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(file.path(), std::fs::Permissions::from_mode(0o644)).map_err(named)?;
    }
    file.persist(path).map_err(|e| named(e.error))?;
    Ok(())
}
