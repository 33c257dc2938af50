//! What made a result: version and input hashes, so that the same inputs give the same bytes and can be found again.

use crate::limited_file::{LARGEST_TABLE, LimitedFile, is_pipe};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::RwLock;
use std::time::{Duration, Instant};

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

    /// Adds the hash of a file under its own name; the second of one name (of two folders) is `name (2)`. Errors name the file.
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

/// SHA-256 of a file, read in blocks. Errors name the file.
pub fn sha256_file(path: &Path) -> io::Result<String> {
    hash_of(path).map_err(|e| io::Error::new(e.kind(), format!("{}: cannot be read ({e})", path.display())))
}

fn hash_of(path: &Path) -> io::Result<String> {
    let mut file = LimitedFile::open(path, LARGEST_TABLE)?;
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
/// Makes the folder when it is missing. Errors name the file. A pipe that stands in its place is refused: opening it waits, for ever where nobody reads
/// from it.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    refuse_pipe(path)?;
    write_whole(path, bytes, true)
}

/// [`write_atomically`] to what the user named on the command line, a pipe too: they know who reads from it.
pub fn write_given(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_whole(path, bytes, true)
}

/// [`write_atomically`] that leaves it to the system when the bytes reach the disk: for tables quickly made again, whose reader
/// finds out after a power cut that they are not whole.
pub fn write_soon(path: &Path, bytes: &[u8]) -> io::Result<()> {
    refuse_pipe(path)?;
    write_whole(path, bytes, false)
}

/// Whether exactly these bytes stand there already. A file of another length is not read.
pub fn holds(path: &Path, bytes: &[u8]) -> bool {
    std::fs::metadata(path).is_ok_and(|m| m.is_file() && m.len() == bytes.len() as u64) && std::fs::read(path).is_ok_and(|there| there == bytes)
}

/// Whether a file ends with a whole line, as every table does; one cut off by a power failure is empty or ends with zeros.
pub fn ends_with_line(path: &Path) -> bool {
    let last = |mut file: std::fs::File| {
        let mut byte = [0];
        file.seek(SeekFrom::End(-1)).and_then(|_| file.read_exact(&mut byte)).is_ok_and(|()| byte == *b"\n")
    };
    // A pipe would be waited for.
    path.is_file() && std::fs::File::open(path).is_ok_and(last)
}

/// Whether a file system answers that it has no way to wait for the disk: the file is written all the same.
fn has_no_sync(e: &io::Error) -> bool {
    matches!(e.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported)
}

/// What a name stands for by which the system lends a process one of its open files (`/dev/stdout`, `/dev/fd/1`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lent {
    Stdout,
    Stderr,
    Other,
}

/// `None` for any other name, that of a file in memory (`/dev/shm`) among them.
fn lent(path: &Path) -> Option<Lent> {
    let folder = std::fs::canonicalize(path.parent()?).ok()?;
    let devices = Path::new("/dev");
    let is_own =
        || folder == devices.join("fd") || folder.ends_with("fd") && std::fs::canonicalize("/proc/self").is_ok_and(|process| folder.starts_with(process));
    match path.file_name()?.to_str() {
        Some("stdout") if folder == devices => Some(Lent::Stdout),
        Some("stderr") if folder == devices => Some(Lent::Stderr),
        Some("1") if is_own() => Some(Lent::Stdout),
        Some("2") if is_own() => Some(Lent::Stderr),
        _ => folder.starts_with("/proc").then_some(Lent::Other),
    }
}

/// Whether a path is another name of this process's stdout.
pub fn is_stdout(path: &Path) -> bool {
    lent(path) == Some(Lent::Stdout)
}

/// Who reads a stream no further (`| head`) has what they wanted; no disk is full.
pub fn read_no_further(written: io::Result<()>) -> io::Result<()> {
    written.or_else(|e| if e.kind() == io::ErrorKind::BrokenPipe { Ok(()) } else { Err(e) })
}

/// Whether a result can have this name: no folder has it, and no file stands where its folder would be. Errors name the file.
///
/// The system's own words for the two, a busy device or a link across devices, tell nobody what to do.
pub fn has_room(path: &Path) -> io::Result<()> {
    let refused = |kind, why: String| Err(io::Error::new(kind, format!("{}: cannot be written ({why})", path.display())));
    if std::fs::symlink_metadata(path).is_ok_and(|m| m.is_dir()) {
        return refused(io::ErrorKind::IsADirectory, "it is a folder; name a file in it".to_owned());
    }
    match folder_of(path).ancestors().find(|p| p.exists()).filter(|p| !p.is_dir()) {
        Some(file) => refused(io::ErrorKind::NotADirectory, format!("{} is a file, not a folder", file.display())),
        None => Ok(()),
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or_else(|| Path::new("."))
}

fn refuse_pipe(path: &Path) -> io::Result<()> {
    if std::fs::symlink_metadata(path).is_ok_and(|m| !m.is_symlink()) && is_pipe(path) && lent(path).is_none() {
        let why = format!("{}: cannot be written (a pipe, not a file, stands there; move it away)", path.display());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, why));
    }
    Ok(())
}

/// Whether what stands under a name goes on there when it is written to. A terminal, a pipe or a device is written to, never replaced by a file; nor is a name
/// by which the system lends one. Any other link is replaced: it may lead out of the folder.
fn goes_on(path: &Path, there: &std::fs::Metadata) -> bool {
    if there.is_symlink() { lent(path).is_some() } else { !there.is_file() && !there.is_dir() }
}

/// Whether [`write_atomically`] would put its file in the place of one that stands there.
pub fn is_replaced(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|there| !there.is_dir() && !goes_on(path, &there))
}

/// Read by everyone who has a temporary file that will be renamed or removed.
static WRITING: RwLock<()> = RwLock::new(());

/// Waits until no temporary file is left, and lets nobody begin another: who ends the process in the midst of a result would leave one behind. After
/// `patience` it is ended all the same (a disk that does not answer).
pub fn end_writing(patience: Duration) {
    let until = Instant::now() + patience;
    while Instant::now() < until {
        if let Ok(held) = WRITING.try_write() {
            std::mem::forget(held);
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn write_whole(path: &Path, bytes: &[u8], to_the_disk: bool) -> io::Result<()> {
    let named = |e: io::Error| io::Error::new(e.kind(), format!("{}: cannot be written ({e})", path.display()));
    // Opened a second time, a file behind such a name is written from its head on, over what it has.
    let whole = |mut stream: Box<dyn Write>| stream.write_all(bytes).and_then(|()| stream.flush()).map_err(named);
    match lent(path) {
        Some(Lent::Stdout) => return read_no_further(whole(Box::new(io::stdout()))),
        Some(Lent::Stderr) => return whole(Box::new(io::stderr())),
        _ => {}
    }
    if std::fs::symlink_metadata(path).is_ok_and(|there| goes_on(path, &there)) {
        return std::fs::OpenOptions::new().write(true).open(path).and_then(|mut file| file.write_all(bytes)).map_err(named);
    }
    has_room(path)?;
    let folder = folder_of(path);
    std::fs::create_dir_all(folder).map_err(named)?;
    let _writing = WRITING.read();
    let mut file = tempfile::Builder::new().prefix(".sweetspot-").suffix(".tmp").tempfile_in(folder).map_err(named)?;
    file.write_all(bytes).map_err(named)?;
    if to_the_disk {
        match file.as_file().sync_data() {
            Err(e) if !has_no_sync(&e) => return Err(named(e)),
            _ => {}
        }
    }
    // A named temporary file is private (0600); results are for everybody who may read the folder. Where modes cannot be set (memory sticks,
    // shares, many FUSE mounts) the mount decides who may read: no reason to lose the result.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let _ = std::fs::set_permissions(file.path(), std::fs::Permissions::from_mode(0o644));
    }
    file.persist(path).map_err(|e| named(e.error))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_file_in_memory_is_a_file() {
        // Where the system keeps files in memory, as fast recordings are put there; elsewhere any folder.
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }.expect("a folder");
        let path = folder.path().join("results/tracks.csv");
        for text in ["long long before\n", "short\n"] {
            write_soon(&path, text.as_bytes()).expect("written");
            assert_eq!(std::fs::read_to_string(&path).expect("readable"), text);
        }
    }

    #[test]
    fn a_file_that_cannot_be_hashed_is_named() {
        let path = Path::new("no/such/tracks.csv");
        for e in [sha256_file(path).err(), Provenance::new("shots").with_file(path).err()] {
            assert!(e.is_some_and(|e| e.kind() == io::ErrorKind::NotFound && e.to_string().starts_with("no/such/tracks.csv: cannot be read (")));
        }
    }

    #[test]
    fn what_stands_in_a_results_place_is_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, within) = (folder.path().join("racket.toml"), folder.path().join("a"));
        write_atomically(&file, b"kept").expect("written");
        std::fs::create_dir(&within).expect("made");
        let told = |path: &Path| write_atomically(path, b"new").expect_err("refused").to_string();
        for path in [folder.path().to_path_buf(), within.clone(), within.join("..")] {
            assert!(told(&path).ends_with("cannot be written (it is a folder; name a file in it)"), "{}", told(&path));
        }
        for path in [file.join("predictions.csv"), file.join("b/predictions.csv")] {
            assert!(told(&path).contains("racket.toml is a file, not a folder"), "{}", told(&path));
        }
        assert_eq!(std::fs::read_to_string(&file).expect("readable"), "kept");
        assert_eq!(std::fs::read_dir(folder.path()).expect("listed").count(), 2);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_disk_that_is_full_or_broken_is_not_one_that_cannot_be_waited_for() {
        let of = |code: i32| has_no_sync(&io::Error::from_raw_os_error(code));
        let (input_output, invalid, full, not_supported) = (5, 22, 28, 95);
        assert!(of(invalid) && of(not_supported) && !of(input_output) && !of(full));
    }

    #[cfg(unix)]
    #[test]
    fn fails_a_pipe_in_a_results_place_is_not_waited_for() {
        let folder = tempfile::tempdir().expect("a folder");
        let pipe = folder.path().join("predictions.csv");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().expect("run").success());
        for write in [write_atomically, write_soon] {
            assert!(write(&pipe, b"id\n").is_err_and(|e| e.to_string().contains("predictions.csv: cannot be written (a pipe, not a file")));
        }
    }

    #[cfg(unix)]
    #[test]
    fn only_the_systems_own_links_are_written_through() {
        let folder = tempfile::tempdir().expect("a folder");
        let (elsewhere, link) = (folder.path().join("elsewhere"), folder.path().join("link"));
        std::fs::write(&elsewhere, "kept").expect("written");
        std::os::unix::fs::symlink(&elsewhere, &link).expect("linked");
        write_atomically(&link, b"new").expect("written");
        assert_eq!(std::fs::read_to_string(&elsewhere).expect("readable"), "kept");
        assert_eq!(std::fs::read_to_string(&link).expect("readable"), "new");
        for (path, is) in [("/dev/stdout", true), ("/dev/fd/1", true), ("/dev/stderr", false), ("/dev/fd/2", false), ("stdout", false), ("1", false)] {
            assert_eq!(is_stdout(Path::new(path)), is && Path::new("/dev/fd").exists(), "{path}");
        }
        assert!(is_stdout(Path::new("/dev/stdout")) || !Path::new("/dev/stdout").exists());
    }
}
