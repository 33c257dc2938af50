//! Files that users name, read no further than a limit: a name may lead to a device or a pipe that never ends.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

/// Largest text with settings, a model or a calibration, bytes.
pub const LARGEST_TEXT: u64 = 64 << 20;
/// Largest table, and largest result read back, bytes.
pub const LARGEST_TABLE: u64 = 1 << 30;

/// A file that ends in an error where it is larger than it may be.
pub struct LimitedFile {
    file: BufReader<File>,
    most: u64,
    left: u64,
}

impl LimitedFile {
    pub fn open(path: &Path, most: u64) -> io::Result<Self> {
        Ok(LimitedFile { file: BufReader::new(File::open(path)?), most, left: most })
    }
}

impl Read for LimitedFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.file.read(buffer)?;
        self.left = self.left.checked_sub(n as u64).ok_or_else(|| io::Error::other(format!("larger than {} MB, the most allowed", self.most >> 20)))?;
        Ok(n)
    }
}

/// A whole text of at most `most` bytes.
pub fn read_text(path: &Path, most: u64) -> io::Result<String> {
    let mut text = String::new();
    LimitedFile::open(path, most)?.read_to_string(&mut text)?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_file_larger_than_allowed_is_an_error_and_is_not_cut() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("model.toml");
        std::fs::write(&path, "base = \"rigid\"").expect("write");
        assert_eq!(read_text(&path, 14).expect("fits"), "base = \"rigid\"");
        assert!(read_text(&path, 13).is_err());
        assert!(read_text(Path::new("/dev/zero"), 1 << 20).is_err_and(|e| e.to_string().contains("larger than 1 MB")));
    }
}
