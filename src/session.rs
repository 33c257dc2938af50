//! A session on disk (contract, section 2): the folder a laboratory fills, read once into valid values.
//!
//! Comes in: a folder with `session.toml`. Goes out: [`Session`], every path checked to stay below the folder.
//! Units are SI. Nothing here opens an image.

use crate::equipment::{Ball, EquipmentError, Named, Racket, read_all};
use crate::impact_table::{LONGEST_NAME, is_own_column};
use crate::limited_file::{LARGEST_TEXT, parser_words, read_text};
use crate::quantity::as_written;
use serde::Deserialize;
use std::ffi::OsString;
use std::path::{Component, Path, PathBuf};

/// Torques a mount may hold a handle with, N m: a firm hand has some 5 to 10.
const GRIP_TORQUES: std::ops::RangeInclusive<f64> = 0.0..=100.0;

/// Why a session cannot be read. Every variant names the file, what was seen and what is allowed.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    #[error("{path}: cannot be read ({source}); give the folder that holds session.toml", path = .path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error("{path}: cannot be read ({source}); mend shot.toml, or remove it where the shot needs none", path = .path.display())]
    UnreadableShot { path: PathBuf, source: std::io::Error },
    #[error("{path}: the shot's folder cannot be read ({source}); mend the link, or remove it", path = .path.display())]
    LostShot { path: PathBuf, source: std::io::Error },
    #[error("{path}: the folder's name is not UTF-8, in which results are named; rename it", path = .path.display())]
    ShotName { path: PathBuf },
    #[error("{path}: the folder's name {id:?} begins or ends with a space, which a table does not keep; rename it", path = .path.display())]
    SpacedShot { path: PathBuf, id: String },
    #[error("{path}: {key:?} begins or ends with a space, which a table does not keep; write it without", path = .path.display())]
    SpacedKey { path: PathBuf, key: String },
    #[error("{path}: a grouping column's name has {length} bytes (it begins {begins:?}); allowed: {LONGEST_NAME}", path = .path.display())]
    LongKey { path: PathBuf, begins: String, length: usize },
    #[error("{path}: shot {id:?} cannot be used: {reason}", path = .path.display())]
    BrokenShot { path: PathBuf, id: String, reason: String },
    #[error("{path}: {message}", path = .path.display())]
    Toml { path: PathBuf, message: String },
    #[error("{path}: `{key}` is {seen}; allowed: {allowed}", path = .path.display())]
    Value { path: PathBuf, key: &'static str, seen: String, allowed: &'static str },
    #[error("{path}: `{key}` is {seen}; allowed: one text, number or date per grouping column (player = \"A\")", path = .path.display())]
    Grouping { path: PathBuf, key: String, seen: String },
    #[error("{path}: `{key}` is a column of the impacts table that is measured, not given; call the grouping column something else", path = .path.display())]
    Taken { path: PathBuf, key: String },
    #[error("{path}: `{key}` has no meaning, and would be a grouping column; if it is `{meant}`, write it so, else name it otherwise", path = .path.display())]
    Misspelt { path: PathBuf, key: String, meant: &'static str },
    #[error("{path}: `{key}` names {named:?}, which leaves the session folder; use a relative path without `..`", path = .path.display())]
    Escapes { path: PathBuf, key: &'static str, named: String },
    #[error("{path}: shot {id:?} is not there; the session has: {known}", path = .path.display())]
    UnknownShot { path: PathBuf, id: String, known: String },
    #[error(transparent)]
    Equipment(#[from] EquipmentError),
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct SessionFile {
    name: String,
    frame_rate_hz: f64,
    exposure_s: f64,
    racket: String,
    ball: String,
    calibration: CalibrationTable,
    axes: Option<AxesTable>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct CalibrationTable {
    board_columns: usize,
    board_rows: usize,
    square_m: f64,
    images: String,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct AxesTable {
    images: String,
    arm_u_m: f64,
    arm_w_m: f64,
}

#[derive(Debug, Clone, Default, Deserialize)]
struct ShotFile {
    racket: Option<String>,
    ball: Option<String>,
    impact_frame: Option<i64>,
    note: Option<String>,
    grip_torque: Option<f64>,
    /// Anything else (player, sex, ...) becomes a grouping column of the impacts table.
    #[serde(flatten)]
    groups: std::collections::BTreeMap<String, toml::Value>,
}

/// The checkerboard and where its pictures are.
#[derive(Debug, Clone)]
pub struct BoardSettings {
    /// Inner corners along the longer side.
    pub columns: usize,
    /// Inner corners along the shorter side.
    pub rows: usize,
    pub square_m: f64,
    /// Folder that holds `left/` and `right/`.
    pub images: PathBuf,
}

/// The three-sphere L-frame that defines the global axes.
#[derive(Debug, Clone)]
pub struct AxesSettings {
    /// Folder that holds one image per camera, named `left` and `right`.
    pub images: PathBuf,
    pub arm_u_m: f64,
    pub arm_w_m: f64,
}

/// One shot's folder with the racket and ball that were used.
#[derive(Debug, Clone)]
pub struct ShotFolder {
    pub id: String,
    /// Its place among all shots of the session, in the order of time, 0 first.
    pub order: usize,
    pub path: PathBuf,
    pub racket: Racket,
    pub ball: Ball,
    /// Frame number near the impact, if the user gave one.
    pub impact_frame: Option<u64>,
    pub note: Option<String>,
    /// Torque with which the mount holds the handle, about the long axis, N m, where it was recorded (no picture shows it).
    pub grip_torque_n_m: Option<f64>,
    /// Grouping values (player, sex, ...) carried into `impacts.csv`.
    pub groups: Vec<(String, String)>,
}

impl ShotFolder {
    /// Folder of the images of one camera, `left` or `right`.
    pub fn camera(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }
}

/// A valid session. Shots are sorted by id, numbers in it by size (`s2` before `s10`), which is the order of time; a shot whose `shot.toml` is broken stands in `broken_shots`.
#[derive(Debug, Clone)]
pub struct Session {
    pub root: PathBuf,
    pub name: String,
    pub frame_rate_hz: f64,
    pub exposure_s: f64,
    pub racket: Racket,
    pub ball: Ball,
    /// Every racket file that the session or one of its shots names, without repeats; the session's own first.
    pub racket_files: Vec<PathBuf>,
    /// Likewise for balls.
    pub ball_files: Vec<PathBuf>,
    pub board: BoardSettings,
    /// `None` also where session.toml names pictures of the frame and there are none (`axes_missing`).
    pub axes: Option<AxesSettings>,
    pub axes_missing: bool,
    pub shots: Vec<ShotFolder>,
    pub broken_shots: Vec<(String, String)>,
}

impl Session {
    /// Reads `session.toml`, the racket, the ball and the list of shots.
    pub fn open(root: &Path) -> Result<Self, SessionError> {
        let file = root.join("session.toml");
        let text = read_text(&file, LARGEST_TEXT).map_err(|source| SessionError::Unreadable { path: file.clone(), source })?;
        let table: SessionFile = toml::from_str(&text).map_err(|e| SessionError::Toml { path: file.clone(), message: parser_words(&e) })?;
        let check = |ok: bool, key: &'static str, seen: String, allowed: &'static str| {
            if ok { Ok(()) } else { Err(SessionError::Value { path: file.clone(), key, seen, allowed }) }
        };
        check((1.0..=1e7).contains(&table.frame_rate_hz), "frame_rate_hz", as_written(table.frame_rate_hz), "pictures a second, 1 to 1e7")?;
        check(table.exposure_s >= 0.0 && table.exposure_s * table.frame_rate_hz <= 1.0, "exposure_s", as_written(table.exposure_s), "0 to one frame period")?;
        let c = &table.calibration;
        check((3..=100).contains(&c.board_columns), "calibration.board_columns", c.board_columns.to_string(), "3 to 100 inner corners")?;
        check((3..=100).contains(&c.board_rows), "calibration.board_rows", c.board_rows.to_string(), "3 to 100 inner corners")?;
        check((1e-4..10.0).contains(&c.square_m), "calibration.square_m", as_written(c.square_m), "0.0001 m or more, below 10 m")?;
        if let Some(a) = &table.axes {
            for (key, v) in [("axes.arm_u_m", a.arm_u_m), ("axes.arm_w_m", a.arm_w_m)] {
                check((1e-3..100.0).contains(&v), key, as_written(v), "0.001 m or more, below 100 m")?;
            }
            check(
                (a.arm_u_m - a.arm_w_m).abs() > 0.01 * a.arm_u_m.max(a.arm_w_m),
                "axes.arm_w_m",
                as_written(a.arm_w_m),
                "a length that differs from arm_u_m by more than 1 %, so that the arms tell themselves apart",
            )?;
        }
        let inside = |key: &'static str, named: &str| inside(root, &file, key, named);
        let racket_files = vec![inside("racket", &table.racket)?];
        let ball_files = vec![inside("ball", &table.ball)?];
        let racket = Racket::read(&racket_files[0])?;
        let ball = Ball::read(&ball_files[0])?;
        let board = BoardSettings { columns: c.board_columns, rows: c.board_rows, square_m: c.square_m, images: inside("calibration.images", &c.images)? };
        let axes = match &table.axes {
            // Without the frame's pictures the global axes are the left camera's (contract, section 2).
            Some(a) if !inside("axes.images", &a.images)?.exists() => None,
            Some(a) => Some(AxesSettings { images: inside("axes.images", &a.images)?, arm_u_m: a.arm_u_m, arm_w_m: a.arm_w_m }),
            None => None,
        };
        let axes_missing = table.axes.is_some() && axes.is_none();
        let mut session = Session {
            root: root.to_path_buf(),
            name: table.name,
            frame_rate_hz: table.frame_rate_hz,
            exposure_s: table.exposure_s,
            racket,
            ball,
            racket_files,
            ball_files,
            board,
            axes,
            axes_missing,
            shots: Vec::new(),
            broken_shots: Vec::new(),
        };
        session.list_shots()?;
        Ok(session)
    }

    fn list_shots(&mut self) -> Result<(), SessionError> {
        let folder = self.root.join("shots");
        if !folder.is_dir() {
            return Ok(()); // a session may hold a calibration only
        }
        let unreadable = |source| SessionError::Unreadable { path: folder.clone(), source };
        let shown = |name: &OsString| name.to_string_lossy().into_owned();
        let mut found: Vec<(OsString, std::io::Result<()>)> = Vec::new();
        for entry in std::fs::read_dir(&folder).map_err(unreadable)? {
            let entry = entry.map_err(unreadable)?;
            match std::fs::metadata(entry.path()) {
                Ok(m) if !m.is_dir() => {}
                // A link that leads nowhere (a disk that is not there) is a shot that is missing, not none.
                seen => found.push((entry.file_name(), seen.map(|_| ()))),
            }
        }
        // What other programs put beside people's folders is no shot.
        found.retain(|(name, _)| !shown(name).starts_with('.') && !NO_SHOTS.contains(&shown(name).as_str()));
        found.sort_by_key(|(name, _)| by_number(&shown(name)));
        for (order, (name, seen)) in found.into_iter().enumerate() {
            let (id, path) = (shown(&name), folder.join(&name));
            let read = match seen {
                Err(source) => Err(SessionError::LostShot { path, source }),
                Ok(()) if name.to_str().is_none() => Err(SessionError::ShotName { path }),
                Ok(()) => self.read_shot(&id, order),
            };
            match read {
                Ok(shot) => self.shots.push(shot),
                Err(e) => self.broken_shots.push((id, e.to_string())),
            }
        }
        Ok(())
    }

    fn read_shot(&mut self, id: &str, order: usize) -> Result<ShotFolder, SessionError> {
        let path = self.root.join("shots").join(id);
        if is_spaced(id) {
            return Err(SessionError::SpacedShot { path, id: id.to_owned() });
        }
        let file = path.join("shot.toml");
        // Only what is not there is left out: a link that leads nowhere, or a folder that may not be looked into, is a fault.
        let absent = std::fs::symlink_metadata(&file).is_err_and(|e| e.kind() == std::io::ErrorKind::NotFound);
        let own: ShotFile = if absent {
            ShotFile::default()
        } else {
            let text = read_text(&file, LARGEST_TEXT).map_err(|source| SessionError::UnreadableShot { path: file.clone(), source })?;
            toml::from_str(&text).map_err(|e| SessionError::Toml { path: file.clone(), message: parser_words(&e) })?
        };
        let racket = match &own.racket {
            Some(name) => named(&inside(&self.root, &file, "racket", name)?, &mut self.racket_files, Racket::read)?,
            None => self.racket.clone(),
        };
        let ball = match &own.ball {
            Some(name) => named(&inside(&self.root, &file, "ball", name)?, &mut self.ball_files, Ball::read)?,
            None => self.ball.clone(),
        };
        if let Some((key, value)) = own.groups.iter().find(|(_, v)| v.is_table() || v.is_array()) {
            let seen = value.to_string();
            return Err(SessionError::Grouping { path: file, key: key.clone(), seen });
        }
        // What the table's own reader would refuse, or take for another name, is refused before it is written.
        if let Some(key) = own.groups.keys().find(|k| is_spaced(k)) {
            return Err(SessionError::SpacedKey { path: file, key: key.clone() });
        }
        if let Some(key) = own.groups.keys().find(|k| k.len() > LONGEST_NAME) {
            return Err(SessionError::LongKey { path: file, begins: key.chars().take(40).collect(), length: key.len() });
        }
        if let Some(key) = own.groups.keys().find(|k| is_own_column(k)) {
            return Err(SessionError::Taken { path: file, key: key.clone() });
        }
        if let Some((key, meant)) = own.groups.keys().find_map(|k| Some((k.clone(), meant(k)?))) {
            return Err(SessionError::Misspelt { path: file, key, meant });
        }
        let frame_number = |n: i64| {
            u64::try_from(n).map_err(|_| SessionError::Value {
                path: file.clone(),
                key: "impact_frame",
                seen: n.to_string(),
                allowed: "a frame number, 0 or more",
            })
        };
        let impact_frame = own.impact_frame.map(frame_number).transpose()?;
        if let Some(torque) = own.grip_torque.filter(|t| !GRIP_TORQUES.contains(t)) {
            return Err(SessionError::Value { path: file, key: "grip_torque", seen: as_written(torque), allowed: "0 to 100 N m" });
        }
        let groups = own.groups.iter().map(|(k, v)| (k.clone(), v.as_str().map_or_else(|| v.to_string(), str::to_owned))).collect();
        Ok(ShotFolder { id: id.to_owned(), order, path, racket, ball, impact_frame, note: own.note, grip_torque_n_m: own.grip_torque, groups })
    }

    /// The shots asked for, or all of them when `ids` is empty.
    pub fn select(&self, ids: &[String]) -> Result<Vec<&ShotFolder>, SessionError> {
        if ids.is_empty() {
            return Ok(self.shots.iter().collect());
        }
        let missing = |id: &String| {
            let (path, id) = (self.root.clone(), id.clone());
            match self.broken_shots.iter().find(|(broken, _)| *broken == id) {
                Some((_, reason)) => SessionError::BrokenShot { path, id, reason: reason.clone() },
                None => SessionError::UnknownShot { path, id, known: self.shots.iter().map(|s| s.id.as_str()).collect::<Vec<_>>().join(", ") },
            }
        };
        let mut chosen: Vec<&ShotFolder> = Vec::new();
        for id in ids {
            let shot = self.shots.iter().find(|s| &s.id == id).ok_or_else(|| missing(id))?;
            // One named twice is one shot.
            if !chosen.iter().any(|s| s.id == shot.id) {
                chosen.push(shot);
            }
        }
        Ok(chosen)
    }
}

/// Whether a table's reader, which takes the spaces around a cell away, would read another name.
fn is_spaced(name: &str) -> bool {
    name.trim_matches(|c: char| c.is_whitespace() || c == '\u{feff}') != name || name.is_empty()
}

/// What ids sort by: their text with numbers compared by size; the id itself last, so that no two are alike.
fn by_number(id: &str) -> (Vec<(String, u64)>, String) {
    let mut parts = Vec::new();
    let mut rest = id;
    while !rest.is_empty() {
        let text_ends = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let (text, after) = rest.split_at(text_ends);
        let digits_end = after.find(|c: char| !c.is_ascii_digit()).unwrap_or(after.len());
        let (digits, after) = after.split_at(digits_end);
        let number = if digits.is_empty() { 0 } else { digits.parse().unwrap_or(u64::MAX) };
        parts.push((text.to_owned(), number));
        rest = after;
    }
    (parts, id.to_owned())
}

/// Folders that file servers, archives and disks make on their own.
const NO_SHOTS: [&str; 7] = ["@eaDir", "#recycle", "#snapshot", "$RECYCLE.BIN", "System Volume Information", "__MACOSX", "lost+found"];

/// Keys of `shot.toml` with a meaning.
const SHOT_KEYS: [&str; 5] = ["racket", "ball", "impact_frame", "note", "grip_torque"];

/// The key meant, where one has a letter too many or too few, or two exchanged, or other capitals.
fn meant(key: &str) -> Option<&'static str> {
    let key = key.to_lowercase();
    let without = |text: &str, at: usize| text.char_indices().filter(|(i, _)| *i != at).map(|(_, c)| c).collect::<String>();
    let shortened = |long: &str, short: &str| long.char_indices().any(|(i, _)| without(long, i) == short);
    let exchanged = |a: &str, b: &str| {
        let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
        a.len() == b.len() && (1..a.len()).any(|i| a[i - 1] == b[i] && a[i] == b[i - 1] && a[..i - 1] == b[..i - 1] && a[i + 1..] == b[i + 1..])
    };
    SHOT_KEYS.into_iter().find(|known| *known == key || shortened(&key, known) || shortened(known, &key) || exchanged(&key, known))
}

/// Reads a file that a shot names and remembers it.
fn named<T: Named>(path: &Path, files: &mut Vec<PathBuf>, read: impl Fn(&Path) -> Result<T, EquipmentError> + Copy) -> Result<T, EquipmentError> {
    if files.iter().any(|f| f == path) {
        return read(path);
    }
    let with_it: Vec<PathBuf> = files.iter().cloned().chain([path.to_path_buf()]).collect();
    // The impacts table will name it, and must not mean another.
    let mut all = read_all(&with_it, read)?;
    *files = with_it;
    Ok(all.swap_remove(files.len() - 1))
}

/// Joins a user's relative path to the session folder; refuses anything that would leave it.
fn inside(root: &Path, file: &Path, key: &'static str, named: &str) -> Result<PathBuf, SessionError> {
    let relative = Path::new(named);
    if named.is_empty() || !relative.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir)) {
        return Err(SessionError::Escapes { path: file.to_path_buf(), key, named: named.to_owned() });
    }
    Ok(root.join(relative))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn fails_no_shot_folder_is_left_out_in_silence() {
        use std::os::unix::ffi::OsStrExt;
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path();
        let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("footage-samples/session");
        for file in ["session.toml", "racket.toml", "ball.toml"] {
            std::fs::copy(sample.join(file), root.join(file)).expect("copied");
        }
        for name in [&b"s1"[..], b"s2", b"s3\xe4", b".cache", b"@eaDir"] {
            std::fs::create_dir_all(root.join("shots").join(std::ffi::OsStr::from_bytes(name))).expect("made");
        }
        std::os::unix::fs::symlink("nowhere.toml", root.join("shots/s2/shot.toml")).expect("linked");
        std::os::unix::fs::symlink("nowhere", root.join("shots/s4")).expect("linked");
        std::fs::write(root.join("shots/notes.txt"), "windy").expect("written");
        let session = Session::open(root).expect("a session");
        assert_eq!(session.shots.iter().map(|s| s.id.as_str()).collect::<Vec<_>>(), ["s1"]);
        let [(linked, no_file), (misnamed, not_utf8), (lost, no_folder)] = &session.broken_shots[..] else { panic!("{:?}", session.broken_shots) };
        assert!(linked == "s2" && no_file.contains("s2/shot.toml: cannot be read") && misnamed.starts_with("s3") && not_utf8.contains("UTF-8"));
        assert!(lost == "s4" && no_folder.contains("shots/s4: the shot's folder cannot be read"), "{no_folder}");
        let asked = session.select(&["s2".to_owned()]).expect_err("broken").to_string();
        assert!(asked.contains(no_file.as_str()) && !asked.contains("is not there"), "{asked}");
        assert!(session.select(&["s9".to_owned()]).expect_err("unknown").to_string().contains("is not there"));
        // Tracked twice at once, a shot would be written twice at once.
        assert_eq!(session.select(&["s1".to_owned(), "s1".to_owned()]).expect("there").len(), 1);
    }

    #[test]
    fn fails_names_that_the_impacts_table_would_not_keep() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path();
        let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("footage-samples/session");
        for file in ["session.toml", "racket.toml", "ball.toml"] {
            std::fs::copy(sample.join(file), root.join(file)).expect("copied");
        }
        let long = "n".repeat(300);
        let keys = [("a", "\" player\" = 1"), ("b", "\"\" = 1"), ("c", "\"grip size\" = 3"), (" ", ""), ("s1 ", ""), ("d", &format!("{long} = 1"))];
        for (id, text) in keys {
            let place = root.join("shots").join(id);
            std::fs::create_dir_all(&place).expect("made");
            std::fs::write(place.join("shot.toml"), text).expect("written");
        }
        let session = Session::open(root).expect("a session");
        assert_eq!(session.shots.iter().map(|s| s.id.as_str()).collect::<Vec<_>>(), ["c"]);
        let why = |id: &str| session.broken_shots.iter().find(|(broken, _)| broken == id).map_or("", |(_, why)| why);
        assert!(why("a").contains("\" player\" begins or ends with a space") && why("b").contains("\"\""), "{:?}", session.broken_shots);
        assert!(why(" ").contains("rename it") && why("s1 ").contains("rename it") && why("d").contains("300 bytes"), "{:?}", session.broken_shots);
    }

    #[test]
    fn fails_rates_and_boards_with_which_no_camera_sees_an_impact() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path();
        let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("footage-samples/session");
        for file in ["racket.toml", "ball.toml"] {
            std::fs::copy(sample.join(file), root.join(file)).expect("copied");
        }
        let settings = std::fs::read_to_string(sample.join("session.toml")).expect("read");
        let line = settings.lines().find(|l| l.starts_with("frame_rate_hz")).expect("has a rate");
        for (rate, seen) in [("1e-4", "0.0001"), ("5e-324", "5e-324"), ("inf", "inf"), ("nan", "NaN"), ("-1000.0", "-1000")] {
            std::fs::write(root.join("session.toml"), settings.replace(line, &format!("frame_rate_hz = {rate}"))).expect("written");
            let told = Session::open(root).expect_err("no rate").to_string();
            assert!(told.contains(&format!("`frame_rate_hz` is {seen}; allowed: pictures a second, 1 to 1e7")), "{told}");
        }
        std::fs::write(root.join("session.toml"), settings.replace("square_m = ", "square_m = 1e-9 # ")).expect("written");
        let told = Session::open(root).expect_err("no board").to_string();
        assert!(told.contains("`calibration.square_m` is 1e-9; allowed: 0.0001 m or more"), "{told}");
        // More may be said after a parser's message.
        std::fs::write(root.join("session.toml"), "name = nan").expect("written");
        let told = Session::open(root).expect_err("no text").to_string();
        assert!(told.contains("session.toml: ") && !told.ends_with('\n'), "{told:?}");
    }

    #[test]
    fn law_shots_come_in_the_order_of_their_numbers() {
        let mut ids = ["s10", "s2", "s1", "day2-s1", "day10-s1", "day2", "s02"].map(str::to_owned);
        ids.sort_by_key(|id| by_number(id));
        assert_eq!(ids, ["day2", "day2-s1", "day10-s1", "s1", "s02", "s2", "s10"]);
    }

    #[test]
    fn truth_a_key_with_a_letter_wrong_is_not_taken_for_a_group() {
        for (key, known) in [("rackt", "racket"), ("rackets", "racket"), ("Racket", "racket"), ("impact_farme", "impact_frame"), ("notes", "note")] {
            assert_eq!(meant(key), Some(known), "{key}");
        }
        for key in ["player", "hall", "sex", "day", "session", "hand"] {
            assert_eq!(meant(key), None, "{key}");
        }
    }
}
