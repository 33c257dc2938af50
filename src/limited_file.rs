//! Files that users name, read no further than a limit: a name may lead to a device or a pipe that never ends.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
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

/// A table whose lines end as they do on another system, \r\n, read as if they ended in \n: line numbers then count right.
pub struct TableFile<R> {
    file: BufReader<R>,
    /// A carriage return that may belong to a line's end.
    held: bool,
}

impl<R: Read> TableFile<R> {
    pub fn new(file: R) -> Self {
        TableFile { file: BufReader::new(file), held: false }
    }
}

impl<R: Read> Read for TableFile<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut written = 0;
        while written == 0 && !buffer.is_empty() {
            let available = self.file.fill_buf()?;
            if available.is_empty() {
                if std::mem::take(&mut self.held) {
                    buffer[0] = b'\r';
                    return Ok(1);
                }
                return Ok(0);
            }
            let mut taken = 0;
            for &byte in available {
                if self.held && byte != b'\n' {
                    if written == buffer.len() {
                        break;
                    }
                    buffer[written] = b'\r';
                    written += 1;
                }
                self.held = false;
                if byte == b'\r' {
                    self.held = true;
                } else if written == buffer.len() {
                    break;
                } else {
                    buffer[written] = byte;
                    written += 1;
                }
                taken += 1;
            }
            self.file.consume(taken);
        }
        Ok(written)
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
    fn law_lines_end_alike_whatever_system_wrote_them() {
        for (text, read) in [("a\r\nb\r\n", "a\nb\n"), ("a\nb", "a\nb"), ("a\rb\r", "a\rb\r"), ("a\r\r\nb", "a\r\nb"), ("\r\n", "\n"), ("", "")] {
            let mut all = String::new();
            TableFile::new(text.as_bytes()).read_to_string(&mut all).expect("text");
            assert_eq!(all, read, "{text:?}");
            let mut file = TableFile::new(text.as_bytes());
            let mut by_bytes = Vec::new();
            let mut one = [0u8; 1];
            while file.read(&mut one).expect("text") == 1 {
                by_bytes.push(one[0]);
            }
            assert_eq!(by_bytes, read.as_bytes(), "{text:?} byte by byte");
        }
    }

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
