//! What stands where a command is told to write: an earlier output of its kind makes room, a file of another kind is somebody's.

use super::error::CliError;
use crate::impact_table::{INPUTS, OUTPUTS};
use crate::limited_file::{LARGEST_TEXT, LimitedFile};
use crate::provenance::is_replaced;
use std::io::Read;
use std::path::Path;

/// Keys that a file of this kind always has, and what it is called.
const SETTINGS: [(&[&str], &str); 3] =
    [(&["mass_kg", "length_m"], "a racket file"), (&["mass_kg", "diameter_m"], "a ball file"), (&["frame_rate_hz", "exposure_s"], "a session file")];

/// What a command is about to write under a name that may be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    Model,
    /// A PNG.
    Picture,
    /// What a model makes of a table, under a name of the program's own.
    Predictions,
}

impl Output {
    fn named(self) -> &'static str {
        match self {
            Output::Model => "a model file",
            Output::Picture => "a PNG picture",
            Output::Predictions => "a table of predictions",
        }
    }

    /// What a file is that such an output must not replace; `None` where it may.
    fn other_kind(self, bytes: &[u8]) -> Option<&'static str> {
        // A name that was taken with nothing in it (`mktemp`) waits for its file.
        if bytes.iter().all(u8::is_ascii_whitespace) {
            return None;
        }
        let kind = Kind::of(bytes);
        let makes_room = match self {
            Output::Model => kind == Kind::Model,
            Output::Picture => kind == Kind::Png,
            // Of all that may stand there (cut off by a power failure, of an earlier version) only what was measured is missed.
            Output::Predictions => kind != Kind::Impacts,
        };
        (!makes_room).then(|| kind.named())
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Model,
    Png,
    Impacts,
    Other(&'static str),
}

impl Kind {
    fn of(bytes: &[u8]) -> Self {
        match image::guess_format(bytes) {
            Ok(image::ImageFormat::Png) => return Kind::Png,
            Ok(_) => return Kind::Other("a picture that is no PNG"),
            Err(_) => {}
        }
        let first = String::from_utf8_lossy(bytes.split(|b| matches!(b, b'\n' | b'\r')).next().unwrap_or_default());
        let header: Vec<&str> = first.trim_start_matches('\u{feff}').split(',').map(str::trim).collect();
        if header.iter().any(|name| INPUTS.contains(name)) {
            return Kind::Impacts;
        }
        if header.iter().any(|name| OUTPUTS.contains(name)) {
            return Kind::Other("a table of impacts' outcomes");
        }
        let Ok(text) = std::str::from_utf8(bytes) else { return Kind::Other("a file of another kind") };
        if let Ok(settings) = text.parse::<toml::Table>() {
            if settings.get("base").is_some_and(toml::Value::is_str) {
                return Kind::Model;
            }
            let named = SETTINGS.iter().find(|(keys, _)| keys.iter().all(|key| settings.contains_key(*key))).map(|(_, named)| *named);
            return Kind::Other(named.unwrap_or("a TOML file without `base`, which every model has"));
        }
        if text.trim_start().starts_with(['{', '[']) && serde_json::from_str::<serde_json::Value>(text).is_ok() {
            Kind::Other("a JSON file")
        } else {
            Kind::Other("a file of another kind")
        }
    }

    fn named(self) -> &'static str {
        match self {
            Kind::Model => "a model file",
            Kind::Png => "a picture",
            Kind::Impacts => "an impacts table",
            Kind::Other(named) => named,
        }
    }
}

/// Refuses a name under which a file of another kind stands.
///
/// # Errors
/// The file is of another kind, or cannot be read to tell.
pub fn refuse_another_kind(path: &Path, output: Output) -> Result<(), CliError> {
    if !is_replaced(path) {
        return Ok(());
    }
    let mut bytes = Vec::new();
    match LimitedFile::open(path, u64::MAX).and_then(|file| file.take(LARGEST_TEXT).read_to_end(&mut bytes)) {
        Ok(_) => {}
        // A link that leads nowhere.
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(CliError::input(format!("{}: is there already and cannot be read ({e})", path.display())).hint(OTHER_NAME)),
    }
    let Some(kind) = output.other_kind(&bytes) else { return Ok(()) };
    let what = format!("{}: is there already and is {kind}; allowed in its place: {}", path.display(), output.named());
    Err(CliError::input(what).hint(OTHER_NAME).hint("or move it away, if it is no longer needed"))
}

const OTHER_NAME: &str = "name another file or folder for the result (-o, --overlay, --out)";

#[cfg(test)]
mod tests {
    use super::*;

    const RACKET: &str = "name = \"r\"\nmass_kg = 0.34\nlength_m = 0.685\n";

    #[test]
    fn fails_what_is_of_another_kind_does_not_make_room() {
        let png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR";
        let jpeg = b"\xff\xd8\xff\xe0\0\x10JFIF";
        for (output, bytes, kind) in [
            (Output::Model, "base = \"rigid\"\n[effects.hand-mass]\n".as_bytes(), None),
            // A model that holds a fault is one all the same.
            (Output::Model, b"# mine\nbase = \"rigidd\"\nmass = 3\n", None),
            (Output::Model, b"", None),
            (Output::Model, b"\n", None),
            (Output::Model, RACKET.as_bytes(), Some("a racket file")),
            (Output::Model, b"name = \"b\"\nmass_kg = 0.0577\ndiameter_m = 0.066\n", Some("a ball file")),
            (Output::Model, b"name = \"s\"\nframe_rate_hz = 1000.0\nexposure_s = 1e-4\n", Some("a session file")),
            (Output::Model, b"shots = 3\n", Some("a TOML file without `base`, which every model has")),
            (Output::Model, b"id,ball_in_vz\na,-20\n", Some("an impacts table")),
            (Output::Model, b"id,ball_out_vz\na,20\n", Some("a table of impacts' outcomes")),
            (Output::Model, b"{\"verdict\": 1}\n", Some("a JSON file")),
            (Output::Model, b"notes of mine\n", Some("a file of another kind")),
            (Output::Model, b"M\xfcller\n", Some("a file of another kind")),
            (Output::Model, png, Some("a picture")),
            (Output::Picture, png, None),
            (Output::Picture, jpeg, Some("a picture that is no PNG")),
            (Output::Picture, RACKET.as_bytes(), Some("a racket file")),
            (Output::Predictions, b"id,ball_out_vz\na,20\n", None),
            (Output::Predictions, b"\0\0\0\0", None),
            (Output::Predictions, b"id,ball_in_vz,ball_out_vz\na,-20,\n", Some("an impacts table")),
        ] {
            assert_eq!(output.other_kind(bytes), kind, "{output:?} {:?}", String::from_utf8_lossy(bytes));
        }
    }

    #[test]
    fn what_stands_there_is_named_with_what_may_be_replaced() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("racket.toml");
        refuse_another_kind(&path, Output::Model).expect("nothing there");
        std::fs::write(&path, RACKET).expect("written");
        let refused = refuse_another_kind(&path, Output::Model).expect_err("a racket");
        assert!(["racket.toml: ", "is a racket file", "a model file"].iter().all(|word| refused.message.contains(word)), "{}", refused.message);
        assert!(refused.exit_code() == 2 && refused.hints[0].contains("-o"));
    }
}
