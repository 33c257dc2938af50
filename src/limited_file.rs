//! Files that users name, read no further than a limit: a name may lead to a device or a pipe that never ends.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

/// Largest text with settings, a model or a calibration, bytes.
pub const LARGEST_TEXT: u64 = 64 << 20;
/// Largest table, and largest result read back, bytes.
pub const LARGEST_TABLE: u64 = 1 << 30;

/// Most characters shown of a line of a file.
const LONGEST_LINE: usize = 200;

/// A file that ends in an error where it is larger than it may be.
pub struct LimitedFile {
    file: BufReader<File>,
    most: u64,
    left: u64,
}

impl LimitedFile {
    /// Opens a file, or what the system lends under a name (`/dev/stdin`, `<(...)`).
    ///
    /// A pipe that stands in a folder is refused: opening it waits, for ever where nobody writes to it.
    pub fn open(path: &Path, most: u64) -> io::Result<Self> {
        if is_pipe(path) && !lends_streams(path) {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "a pipe, not a file; put the file itself there"));
        }
        LimitedFile::open_given(path, most)
    }

    /// Opens what the user named on the command line, a pipe too: they know who writes to it.
    pub fn open_given(path: &Path, most: u64) -> io::Result<Self> {
        Ok(LimitedFile { file: BufReader::new(File::open(path)?), most, left: most })
    }
}

/// Whether a pipe stands under this name.
#[cfg(unix)]
pub fn is_pipe(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    std::fs::metadata(path).is_ok_and(|m| m.file_type().is_fifo())
}

#[cfg(not(unix))]
pub fn is_pipe(_: &Path) -> bool {
    false
}

/// Whether a name is one of those under which the system lends a process its open streams.
fn lends_streams(path: &Path) -> bool {
    let folder = path.parent().and_then(|folder| folder.canonicalize().ok());
    folder.is_some_and(|folder| folder == Path::new("/dev") || folder == Path::new("/dev/fd") || folder.starts_with("/proc"))
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
    // An umlaut saved in another encoding: whoever reads of an invalid stream looks for a broken disk.
    let encoding = |e: io::Error| match e.kind() {
        io::ErrorKind::InvalidData => io::Error::new(e.kind(), "not a text in UTF-8; save it in that encoding"),
        _ => e,
    };
    LimitedFile::open(path, most)?.read_to_string(&mut text).map_err(encoding)?;
    Ok(text)
}

/// What parsers call things, and what those are called who write the files.
const PLAIN_WORDS: [(&str, &str); 16] = [
    ("missing field", "missing"),
    ("unknown field", "unknown key"),
    ("duplicate field", "a second"),
    ("unknown variant", "unknown word"),
    ("invalid type:", "not as it should be:"),
    ("invalid value:", "not as it should be:"),
    ("floating point `", "`"),
    ("integer `", "`"),
    ("boolean `", "`"),
    ("string \"", "\""),
    ("expected a map", "expected a table"),
    ("expected a sequence", "expected a list"),
    ("be: sequence,", "be: a list,"),
    ("be: map,", "be: a table,"),
    ("expected f64", "expected a number"),
    ("expected a string", "expected a text in quotes"),
];
/// Number types of the code, by their beginning.
const WHOLE_NUMBERS: [(&str, &str); 2] = [("expected u", "expected a whole number from 0 on"), ("expected i", "expected a whole number")];

/// A parser's words for those who write files.
pub fn plain_words(told: &str) -> String {
    let plain = PLAIN_WORDS.iter().fold(told.to_owned(), |words, (theirs, ours)| words.replace(theirs, ours));
    WHOLE_NUMBERS
        .iter()
        .fold(plain, |words, (theirs, ours)| ["8", "16", "32", "64", "size"].iter().fold(words, |words, bits| words.replace(&format!("{theirs}{bits}"), ours)))
}

/// A parser's message as part of another: in plain words, without the line's end after it, and of a file that is one endless line only as much as anybody reads.
pub fn parser_words(e: &dyn std::fmt::Display) -> String {
    // What it shows of the file itself stays as it is written there.
    let of_file = |line: &str| line.split_once('|').is_some_and(|(number, _)| number.trim().bytes().all(|b| b.is_ascii_digit()));
    let shown = |line: &str| (if of_file(line) { line.to_owned() } else { plain_words(line) }).chars().take(LONGEST_LINE).collect::<String>();
    let mut lines: Vec<String> = e.to_string().trim_end().lines().map(shown).collect();
    if lines.iter().any(|line| has_decimal_comma(line)) {
        lines.push("numbers have a decimal point, not a comma".to_owned());
    }
    lines.join("\n")
}

/// Whether a line of TOML gives a key a number with a decimal comma.
fn has_decimal_comma(line: &str) -> bool {
    let Some((_, value)) = line.split_once('=') else { return false };
    let value = value.split('#').next().unwrap_or_default().trim();
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    value.split_once(',').is_some_and(|(whole, part)| digits(whole.trim_start_matches(['-', '+'])) && digits(part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_parsers_message_is_short_and_ends_with_a_word() {
        let e = toml::from_str::<toml::Table>(&format!("a = {}", "[".repeat(100_000))).expect_err("too deep");
        let words = parser_words(&e);
        assert!(words.len() < 1000 && words.starts_with("TOML parse error at line 1") && !words.ends_with('\n'), "{words}");
    }

    #[test]
    fn truth_a_parsers_message_is_in_the_words_of_who_writes_files() {
        #[derive(Debug, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        #[allow(dead_code)]
        struct Asked {
            seed: u64,
            #[serde(default)]
            place: [f64; 3],
            #[serde(default)]
            word: std::collections::BTreeMap<String, bool>,
        }
        let told = |text: &str| parser_words(&toml::from_str::<Asked>(text).expect_err("wrong"));
        for (text, words) in [
            ("seed = 7.5\n", "not as it should be: `7.5`, expected a whole number from 0 on"),
            ("seed = -1\n", "not as it should be: `-1`, expected a whole number from 0 on"),
            ("seed = \"one\"\n", "not as it should be: \"one\", expected a whole number from 0 on"),
            ("seed = [1]\n", "not as it should be: a list, expected a whole number from 0 on"),
            ("place = [1, 2, 3]\n", "missing `seed`"),
            ("seed = 1\ncolour = 2\n", "unknown key `colour`, expected one of `seed`, `place`, `word`"),
            ("seed = 1\nword = 3\n", "not as it should be: `3`, expected a table"),
            ("seed = 1\nplace = [1, true, 3]\n", "not as it should be: `true`, expected a number"),
        ] {
            let told = told(text);
            assert!(told.contains(words) && (told.contains(&format!("| {}", text.lines().last().unwrap_or_default()))), "{told}");
        }
    }

    #[test]
    fn truth_a_decimal_comma_is_told() {
        let told =
            |text: &str| parser_words(&toml::from_str::<toml::Table>(text).expect_err("no number")).ends_with("numbers have a decimal point, not a comma");
        assert!(told("mass_kg = 0,3453\n") && told("x = -12,5 # mm\n"));
        assert!(!told("mass_kg = 0.3.4\n") && !told("list = [1, 2\n") && !told("a = 1, b = 2\n"));
    }

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

    #[cfg(unix)]
    #[test]
    fn fails_a_pipe_in_a_files_place_is_not_waited_for() {
        let folder = tempfile::tempdir().expect("folder");
        let (pipe, link) = (folder.path().join("session.toml"), folder.path().join("racket.toml"));
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().expect("run").success());
        std::os::unix::fs::symlink(&pipe, &link).expect("linked");
        for path in [&pipe, &link] {
            assert!(read_text(path, 100).is_err_and(|e| e.to_string().contains("a pipe, not a file")));
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
        std::fs::write(&path, b"name = \"M\xfcller\"").expect("written");
        assert!(read_text(&path, 100).is_err_and(|e| e.to_string() == "not a text in UTF-8; save it in that encoding"));
    }
}
