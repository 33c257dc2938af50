//! Results that a newer run contradicts: kept under another name, never measured or shown in the new ones' place.

use super::error::CliError;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Renames `tracks.csv` to `tracks.earlier.csv` (for the word "earlier"), or to `tracks.earlier-2.csv` and so on where that is taken.
/// `None` where there is no such file.
pub fn set_aside(file: &Path, word: &str) -> Result<Option<PathBuf>, CliError> {
    if !file.exists() {
        return Ok(None);
    }
    let part = |of: Option<&std::ffi::OsStr>| of.unwrap_or_default().to_string_lossy().into_owned();
    let (stem, extension) = (part(file.file_stem()), part(file.extension()));
    let numbered = (2..).map(|k| format!("{stem}.{word}-{k}.{extension}"));
    let names = std::iter::once(format!("{stem}.{word}.{extension}")).chain(numbered).map(|name| file.with_file_name(name));
    let Some(kept) = names.into_iter().find(|p| !p.exists()) else { return Ok(None) };
    std::fs::rename(file, &kept).map_err(|e| CliError::output(format!("{}: cannot be renamed ({e})", file.display())))?;
    Ok(Some(kept))
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
}
