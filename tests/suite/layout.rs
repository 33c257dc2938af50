//! The rooms' arrows point one way, and OpenCV stays where it belongs.

use std::path::{Path, PathBuf};

/// Rooms in the order of the data's way; a room may use those before it only. `synthetic` must not see `impact` at all.
const FORBIDDEN: [(&str, &[&str]); 9] = [
    ("footage", &["calibration", "tracking", "reconstruction", "kinematics", "impact", "validation", "report", "synthetic", "cli"]),
    ("calibration", &["tracking", "reconstruction", "kinematics", "impact", "validation", "report", "synthetic", "cli"]),
    ("tracking", &["reconstruction", "kinematics", "impact", "validation", "report", "synthetic", "cli"]),
    ("reconstruction", &["kinematics", "impact", "validation", "report", "synthetic", "cli"]),
    ("kinematics", &["impact", "validation", "report", "synthetic", "cli"]),
    ("impact", &["footage", "calibration", "tracking", "reconstruction", "kinematics", "validation", "report", "synthetic", "cli"]),
    ("validation", &["footage", "calibration", "tracking", "reconstruction", "kinematics", "report", "synthetic", "cli"]),
    ("report", &["synthetic", "cli"]),
    ("synthetic", &["tracking", "reconstruction", "impact", "validation", "kinematics", "report", "cli"]),
];

fn rust_files(folder: &Path, into: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, into);
        } else if path.extension().is_some_and(|e| e == "rs") {
            into.push(path);
        }
    }
}

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// The code of a file before its module of tests, without comments: what the shipped program contains.
fn shipped(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap();
    // A single item may be there for tests alone, and shipped code follow.
    let ends =
        text.match_indices("#[cfg(test)]").find(|(at, mark)| text[at + mark.len()..].trim_start().trim_start_matches("pub(crate) ").starts_with("mod tests"));
    let code = ends.map_or(text.as_str(), |(at, _)| &text[..at]);
    code.lines().filter(|l| !l.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

/// Whether a path such as `crate::impact` stands in the code as whole words (`crate::impact_table` is another room).
fn names(code: &str, path: &str) -> bool {
    let word = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    let ends = |at: usize| path.ends_with(':') || !word(code[at + path.len()..].chars().next());
    code.match_indices(path).any(|(at, _)| !word(code[..at].chars().next_back()) && ends(at))
}

#[test]
fn law_rooms_use_only_the_rooms_before_them() {
    for (room, later) in FORBIDDEN {
        let mut files = Vec::new();
        rust_files(&source().join(room), &mut files);
        for file in files {
            let code = shipped(&file);
            for other in later {
                assert!(!code.contains("crate::{"), "{} names several rooms at once; one `use` for each can be checked", file.display());
                assert!(!names(&code, &format!("crate::{other}")), "{} uses `{other}`, which comes later on the data's way", file.display());
            }
        }
    }
}

#[test]
fn law_opencv_is_named_only_in_its_own_files() {
    let mut files = Vec::new();
    rust_files(&source(), &mut files);
    for file in files {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        if !name.contains("opencv") {
            assert!(!names(&shipped(&file), "opencv::"), "{} names opencv; such code lives in *opencv*.rs", file.display());
        }
    }
}

#[test]
fn law_no_room_without_a_noun() {
    let mut files = Vec::new();
    rust_files(&source(), &mut files);
    for file in files {
        let stem = file.file_stem().unwrap().to_string_lossy().into_owned();
        assert!(!["util", "utils", "common", "helpers", "types", "misc"].contains(&stem.as_str()), "{}", file.display());
    }
}
