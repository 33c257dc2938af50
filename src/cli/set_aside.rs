//! Results that a newer run contradicts: kept under another name, never measured or shown in the new ones' place.

use super::error::CliError;
use crate::limited_file::{LARGEST_TEXT, LimitedFile};
use crate::provenance::is_replaced;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

/// Renames `tracks.csv` to `tracks.earlier.csv` (for the word "earlier"), or to `tracks.earlier-2.csv` and so on where that is taken.
/// `None` where there is no such file.
pub fn set_aside(file: &Path, word: &str) -> Result<Option<PathBuf>, CliError> {
    if !file.exists() {
        return Ok(None);
    }
    let Some(kept) = names_aside(file, word).find(|p| !p.exists()) else { return Ok(None) };
    std::fs::rename(file, &kept).map_err(|e| CliError::output(format!("{}: cannot be renamed ({e})", file.display())))?;
    Ok(Some(kept))
}

/// The names under which a file is kept, in the order in which they are taken.
fn names_aside(file: &Path, word: &str) -> impl Iterator<Item = PathBuf> {
    let part = |of: Option<&std::ffi::OsStr>| of.unwrap_or_default().to_string_lossy().into_owned();
    let (stem, extension) = (part(file.file_stem()), part(file.extension()));
    // A folder's name has no extension.
    let extension = if extension.is_empty() { extension } else { format!(".{extension}") };
    let numbered = (2..).map(|k| format!("-{k}"));
    let (file, word) = (file.to_path_buf(), word.to_owned());
    std::iter::once(String::new()).chain(numbered).map(move |number| file.with_file_name(format!("{stem}.{word}{number}{extension}")))
}

/// Sets aside a model that stands where another one, `new`, is to be written: it may be somebody's. One that `read` names is replaced by its own fit, as
/// was asked for. A model that is kept already is not kept twice, so that a script may be run again and again.
pub fn set_model_aside(file: &Path, read: &Path, new: &str) -> Result<Option<PathBuf>, CliError> {
    let same = |a: &Path, b: &Path| a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
    if !is_replaced(file) || same(file, read) {
        return Ok(None);
    }
    // Whether it is one was asked before (`Shell::check_output`).
    let Some(earlier) = text_of(file).filter(|text| text != new.as_bytes() && !text.iter().all(u8::is_ascii_whitespace)) else { return Ok(None) };
    let kept = names_aside(file, "earlier").take_while(|kept| kept.exists()).find(|kept| text_of(kept).as_ref() == Some(&earlier));
    if kept.is_some() { Ok(kept) } else { set_aside(file, "earlier") }
}

fn text_of(file: &Path) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    LimitedFile::open(file, LARGEST_TEXT).and_then(|mut file| file.read_to_end(&mut bytes)).ok().map(|_| bytes)
}

/// What `predict`, `compare` and `diagnose` make of the impacts table.
const OF_THE_IMPACTS: [&str; 5] = ["predictions.csv", "predictions_sd.csv", "sensitivities.csv", "compare.json", "diagnosis.json"];

/// Sets aside what an earlier run made of the session's shots as a whole: the impacts table with all that goes by it. Gives the names it has now.
pub fn set_session_aside(results: &Path) -> Result<Vec<PathBuf>, CliError> {
    let impacts = set_aside(&results.join("impacts.csv"), "earlier")?;
    let mut kept = set_all_aside(results, &["season.csv", "season.json", "season"])?;
    kept.extend(set_judgements_aside(results)?);
    // Without a table of its own the report is one on failures, which need not be kept.
    if let Some(impacts) = impacts {
        kept.insert(0, impacts);
        kept.extend(set_aside(&results.join("report.html"), "earlier")?);
    }
    Ok(kept)
}

/// What stands among the results that models and the report made of the impacts table.
pub fn made_of_the_impacts(results: &Path) -> Vec<PathBuf> {
    OF_THE_IMPACTS.iter().copied().chain(["report.html"]).map(|name| results.join(name)).filter(|file| file.exists()).collect()
}

/// Sets aside what models made of an impacts table that is another now.
pub fn set_judgements_aside(results: &Path) -> Result<Vec<PathBuf>, CliError> {
    set_all_aside(results, &OF_THE_IMPACTS)
}

/// [`set_judgements_aside`] with the report, of a table that stands outside a session.
pub fn set_made_of_table_aside(folder: &Path) -> Result<Vec<PathBuf>, CliError> {
    set_all_aside(folder, &[&OF_THE_IMPACTS[..], &["report.html"]].concat())
}

/// [`set_aside`] of several files of a folder, as "earlier"; the names of those that were there.
pub fn set_all_aside(folder: &Path, names: &[&str]) -> Result<Vec<PathBuf>, CliError> {
    names.iter().filter_map(|name| set_aside(&folder.join(name), "earlier").transpose()).collect()
}

/// The names of files for a message.
pub fn listed(files: &[PathBuf]) -> String {
    files.iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", ")
}

/// Removes a file that need not be there.
pub fn remove_if_there(file: &Path) -> Result<(), CliError> {
    match std::fs::remove_file(file) {
        Err(e) if e.kind() != ErrorKind::NotFound => Err(CliError::output(format!("{}: cannot be removed ({e})", file.display()))),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_nothing_set_aside_is_lost() {
        let folder = tempfile::tempdir().expect("folder");
        let file = folder.path().join("tracks.csv");
        assert_eq!(set_aside(&file, "earlier").expect("nothing to do"), None);
        for (k, name) in ["tracks.earlier.csv", "tracks.earlier-2.csv", "tracks.earlier-3.csv"].iter().enumerate() {
            std::fs::write(&file, k.to_string()).expect("written");
            assert_eq!(set_aside(&file, "earlier").expect("renamed"), Some(folder.path().join(name)));
        }
        assert_eq!(std::fs::read_to_string(folder.path().join("tracks.earlier.csv")).expect("kept"), "0");
        remove_if_there(&file).expect("is not there");
    }

    #[test]
    fn law_a_model_is_kept_once_and_in_place_it_is_replaced() {
        let folder = tempfile::tempdir().expect("folder");
        let (model, kept) = (folder.path().join("mine.toml"), folder.path().join("mine.earlier.toml"));
        let read = folder.path().join("model.toml");
        std::fs::write(&read, "the one read").expect("written");
        let write = |text: &str| {
            let aside = set_model_aside(&model, &read, text).expect("room made");
            std::fs::write(&model, text).expect("written");
            aside
        };
        assert_eq!([write("mine"), write("mine")], [None, None]);
        assert_eq!(write("fitted"), Some(kept.clone()));
        assert_eq!(write("fitted"), None);
        // A script that writes both in turn.
        assert_eq!(
            (write("mine"), write("fitted"), write("mine")),
            (Some(folder.path().join("mine.earlier-2.toml")), Some(kept.clone()), Some(folder.path().join("mine.earlier-2.toml")))
        );
        assert_eq!(std::fs::read_to_string(&kept).expect("kept"), "mine");
        assert_eq!(std::fs::read_dir(folder.path()).expect("listed").count(), 4);
        assert_eq!(set_model_aside(&read, &folder.path().join("./model.toml"), "fitted in place").expect("asked for"), None);
    }

    #[test]
    fn law_nothing_of_an_earlier_session_stays_under_its_name() {
        let folder = tempfile::tempdir().expect("folder");
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("season")).expect("made");
        for name in ["impacts.csv", "season.csv", "season.json", "predictions.csv", "diagnosis.json", "report.html", "model.toml", "season/histograms.csv"] {
            std::fs::write(at(name), "of an earlier run").expect("written");
        }
        assert_eq!(set_session_aside(folder.path()).expect("renamed").len(), 7);
        let mut left: Vec<String> =
            std::fs::read_dir(folder.path()).expect("listed").map(|e| e.expect("entry").file_name().to_string_lossy().into_owned()).collect();
        left.sort();
        let kept = [
            "diagnosis.earlier.json",
            "impacts.earlier.csv",
            "model.toml",
            "predictions.earlier.csv",
            "report.earlier.html",
            "season.earlier",
            "season.earlier.csv",
            "season.earlier.json",
        ];
        assert_eq!(left, kept);
        assert!(at("season.earlier/histograms.csv").exists());
        // A report on failures is not kept.
        std::fs::write(at("report.html"), "of no shot").expect("written");
        assert!(set_session_aside(folder.path()).expect("nothing to do").is_empty());
    }
}
