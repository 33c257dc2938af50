//! Tracks and points as files (contract, section 3): `tracks.csv` in pixels, `points.csv` in global metres.

use crate::calibration::CameraId;
use crate::footage::LARGEST_FRAME_NUMBER;
use crate::limited_file::{LARGEST_TABLE, LimitedFile, TableFile, plain_words};
use crate::quantity::as_written;
use nalgebra::{Point3, Vector2, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Furthest a point may lie from the first pixel, px: some pictures' widths beyond the largest picture's border. Deviations reach as far.
const FURTHEST_PX: f64 = 1e5;
const SDS_PX: std::ops::RangeInclusive<f64> = 1e-5..=FURTHEST_PX;

#[derive(Debug, thiserror::Error)]
pub enum TrackFileError {
    #[error("{path}: cannot be read ({source}); run `sweetspot track` first", path = .path.display())]
    Unreadable { path: PathBuf, source: csv::Error },
    #[error("{path}, line {line}: {what}", path = .path.display())]
    Row { path: PathBuf, line: u64, what: String },
    #[error("{path}: frame {frame} has two rows of {what}; keep one of them", path = .path.display())]
    Twice { path: PathBuf, frame: u64, what: String },
}

/// What is tracked: the five tape markers and the ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Target {
    M1,
    M2,
    M3,
    M4,
    M5,
    Ball,
}

impl Target {
    pub const MARKERS: [Target; 5] = [Target::M1, Target::M2, Target::M3, Target::M4, Target::M5];
    pub const ALL: [Target; 6] = [Target::M1, Target::M2, Target::M3, Target::M4, Target::M5, Target::Ball];

    /// 0 to 4 for the markers, 5 for the ball.
    pub fn index(self) -> usize {
        self as usize
    }

    pub fn name(self) -> &'static str {
        ["m1", "m2", "m3", "m4", "m5", "ball"][self.index()]
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PointState {
    Measured,
    Manual,
    Occluded,
}

/// A point in an image, px; the centre of the top-left pixel is (0, 0). `sd` is one standard deviation per axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagePoint {
    pub uv: Vector2<f64>,
    pub sd: Vector2<f64>,
}

/// One target in one image. A marker's point is the centroid of the visible tape, the ball's its projected centre.
/// `point` is `None` exactly when `state` is `Occluded`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPoint {
    pub frame: u64,
    pub camera: CameraId,
    pub target: Target,
    pub point: Option<ImagePoint>,
    pub state: PointState,
}

/// All points of a shot, sorted by frame, camera, target.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tracks {
    pub points: Vec<TrackPoint>,
}

#[derive(Serialize, Deserialize)]
struct TrackRow {
    frame: u64,
    camera: CameraId,
    target: Target,
    u: Option<f64>,
    v: Option<f64>,
    u_sd: Option<f64>,
    v_sd: Option<f64>,
    state: PointState,
}

impl Tracks {
    pub fn read(path: &Path) -> Result<Self, TrackFileError> {
        let mut points = Vec::new();
        each_row(path, |row: TrackRow| {
            let bad = |what: &str| Err(what.to_owned());
            check_frame(row.frame)?;
            let point = match (row.state, row.u, row.v) {
                (PointState::Occluded, None, None) => None,
                (PointState::Occluded, _, _) => return bad("an occluded point has u, v; leave them empty, or write `manual`"),
                (_, Some(u), Some(v)) => {
                    // A point clicked by hand rarely comes with its own deviation: half a pixel (thesis, chapter 3).
                    let sd = Vector2::new(row.u_sd.unwrap_or(0.5), row.v_sd.unwrap_or(0.5));
                    if ![u, v].iter().all(|w| w.abs() <= FURTHEST_PX) {
                        return Err(format!("u, v are {}, {}; allowed: up to 1e5 px either way", as_written(u), as_written(v)));
                    }
                    if !sd.iter().all(|s| SDS_PX.contains(s)) {
                        return Err(format!("u_sd, v_sd are {}, {}; allowed: 1e-5 to 1e5 px", as_written(sd.x), as_written(sd.y)));
                    }
                    Some(ImagePoint { uv: Vector2::new(u, v), sd })
                }
                _ => return bad("a measured point lacks u or v; give both, or write `occluded`"),
            };
            points.push(TrackPoint { frame: row.frame, camera: row.camera, target: row.target, point, state: row.state });
            Ok(())
        })?;
        let key = |p: &TrackPoint| (p.frame, p.camera, p.target);
        points.sort_by_key(key);
        if let Some(twice) = points.windows(2).find(|two| key(&two[0]) == key(&two[1])) {
            let (frame, camera, target) = (twice[0].frame, twice[0].camera.name(), twice[0].target.name());
            return Err(TrackFileError::Twice { path: path.into(), frame, what: format!("{camera} {target}") });
        }
        Ok(Tracks { points })
    }

    pub fn to_csv(&self) -> String {
        let row = |out: &mut String, p: &TrackPoint| {
            let state = match p.state {
                PointState::Measured => "measured",
                PointState::Manual => "manual",
                PointState::Occluded => "occluded",
            };
            let (frame, camera, target) = (p.frame, p.camera.name(), p.target.name());
            write!(out, "{frame},")?;
            [camera, ",", target, ","].iter().for_each(|word| out.push_str(word));
            match &p.point {
                Some(ImagePoint { uv, sd }) => [uv.x, uv.y, sd.x, sd.y].iter().for_each(|v| push_fixed(out, *v, 4)),
                None => out.push_str(",,,,"),
            }
            [state, "\n"].iter().for_each(|word| out.push_str(word));
            Ok(())
        };
        table("frame,camera,target,u,v,u_sd,v_sd,state", &self.points, row)
    }

    /// The measured or manual point of a target in one image.
    pub fn get(&self, frame: u64, camera: CameraId, target: Target) -> Option<ImagePoint> {
        let at = self.points.binary_search_by_key(&(frame, camera, target), |p| (p.frame, p.camera, p.target)).ok()?;
        self.points[at].point
    }

    /// Frame numbers, ascending, without repeats.
    pub fn frames(&self) -> Vec<u64> {
        let mut f: Vec<u64> = self.points.iter().map(|p| p.frame).collect();
        f.dedup();
        f
    }
}

/// A reconstructed point, global axes, m; t = 0 at first contact, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpacePoint {
    pub frame: u64,
    pub t: f64,
    pub target: Target,
    pub position: Point3<f64>,
    /// One standard deviation per axis, without that of the global axes themselves.
    pub sd: Vector3<f64>,
    pub residual_px: f64,
}

/// `points.csv`.
pub fn points_to_csv(points: &[SpacePoint]) -> String {
    let row = |out: &mut String, p: &SpacePoint| {
        let (x, s) = (p.position, p.sd);
        write!(out, "{},", p.frame)?;
        push_fixed(out, p.t, 9);
        [p.target.name(), ","].iter().for_each(|word| out.push_str(word));
        for v in [x.x, x.y, x.z, s.x, s.y, s.z] {
            push_fixed(out, v, 7);
        }
        push_fixed(out, p.residual_px, 4);
        // The last number ends the line, not with a comma.
        out.pop();
        out.push('\n');
        Ok(())
    };
    table("frame,t,target,x,y,z,x_sd,y_sd,z_sd,residual_px", points, row)
}

/// Appends a number with so many decimals (up to nine) and a comma. A table holds thousands, and exact decimal expansion takes longer
/// than the rest of its writing; the last digit may differ from it where the value is halfway between two.
fn push_fixed(out: &mut String, value: f64, decimals: u32) {
    let one = 10u64.pow(decimals);
    let scaled = (value.abs() * one as f64).round();
    if scaled.is_nan() || scaled > 9e15 {
        // Writing to a string does not fail.
        write!(out, "{value:.0$},", decimals as usize).unwrap_or_default();
        return;
    }
    // Sign, sixteen digits, point, and the comma.
    let mut text = [b','; 24];
    let (mut rest, mut at) = (scaled as u64, text.len() - 1);
    for k in 0.. {
        if k == decimals && k > 0 {
            at -= 1;
            text[at] = b'.';
        }
        if rest == 0 && k > decimals {
            break;
        }
        at -= 1;
        text[at] = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    if value.is_sign_negative() {
        at -= 1;
        text[at] = b'-';
    }
    out.push_str(std::str::from_utf8(&text[at..]).unwrap_or_default());
}

/// A table's text: its head and a line of every item, written side by side.
fn table<T: Sync>(head: &str, items: &[T], row: impl Fn(&mut String, &T) -> std::fmt::Result + Sync) -> String {
    let lines = |items: &[T]| {
        let mut out = String::with_capacity(80 * items.len());
        // Writing to a string does not fail.
        items.iter().for_each(|item| row(&mut out, item).unwrap_or_default());
        out
    };
    let parts: Vec<String> = items.par_chunks(256).map(lines).collect();
    format!("{head}\n{}", parts.concat())
}

/// Hands every row of a table on, and names the line of one that cannot be read or is refused.
fn each_row<R: serde::de::DeserializeOwned>(path: &Path, mut take: impl FnMut(R) -> Result<(), String>) -> Result<(), TrackFileError> {
    let unreadable = |source: csv::Error| TrackFileError::Unreadable { path: path.into(), source };
    let file = LimitedFile::open(path, LARGEST_TABLE).map_err(|e| unreadable(e.into()))?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(TableFile::new(file));
    let header = reader.headers().map_err(unreadable)?.clone();
    if header.len() == 1 && header.get(0).is_some_and(|all| all.contains(';')) {
        return Err(TrackFileError::Row {
            path: path.into(),
            line: 1,
            what: "columns are parted by semicolons; save it with commas, and points in the numbers".to_owned(),
        });
    }
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).map_err(unreadable)? {
        let line = record.position().map_or(0, csv::Position::line);
        let refused = |what: String| TrackFileError::Row { path: path.into(), line, what };
        let row: R = record.deserialize(Some(&header)).map_err(|e| match e.kind() {
            csv::ErrorKind::Deserialize { err, .. } => refused(cell_words(err, &header, &record)),
            _ => refused(e.to_string()),
        })?;
        take(row).map_err(refused)?;
    }
    Ok(())
}

/// What is wrong with one cell of a row, or with the whole row.
fn cell_words(e: &csv::DeserializeError, header: &csv::StringRecord, record: &csv::StringRecord) -> String {
    use csv::DeserializeErrorKind::{Message, ParseFloat, ParseInt, UnexpectedEndOfRow};
    let why = match e.kind() {
        ParseInt(_) => "no whole number from 0 on".to_owned(),
        ParseFloat(_) => "no number".to_owned(),
        UnexpectedEndOfRow => format!("{} columns; allowed: more", record.len()),
        Message(told) => match (told.strip_prefix("missing field"), told.split_once(", expected ")) {
            (Some(name), _) => format!("missing column{name}"),
            (None, Some((_, words))) => format!("expected {words}"),
            (None, None) => plain_words(told),
        },
        other => other.to_string(),
    };
    // Of a word out of a few the reader tells the word alone.
    let of_word = || match e.kind() {
        Message(told) => record.iter().position(|cell| told.split('`').nth(1) == Some(cell)),
        _ => None,
    };
    let cell = e.field().map(|k| k as usize).or_else(of_word).and_then(|k| Some((header.get(k)?, record.get(k)?)));
    cell.map_or(why.clone(), |(column, seen)| format!("`{column}` is `{}`: {why}", seen.chars().take(40).collect::<String>()))
}

fn check_frame(frame: u64) -> Result<(), String> {
    if frame > LARGEST_FRAME_NUMBER { Err(format!("frame {frame}; allowed: up to {LARGEST_FRAME_NUMBER}")) } else { Ok(()) }
}

/// Reads `points.csv`.
pub fn read_points(path: &Path) -> Result<Vec<SpacePoint>, TrackFileError> {
    type Row = (u64, f64, Target, f64, f64, f64, f64, f64, f64, f64);
    let mut points: Vec<SpacePoint> = Vec::new();
    each_row(path, |(frame, t, target, x, y, z, x_sd, y_sd, z_sd, residual_px): Row| {
        check_frame(frame)?;
        if ![t, x, y, z, x_sd, y_sd, z_sd, residual_px].iter().all(|v| v.is_finite()) {
            return Err("every number must be finite".to_owned());
        }
        points.push(SpacePoint { frame, t, target, position: Point3::new(x, y, z), sd: Vector3::new(x_sd, y_sd, z_sd), residual_px });
        Ok(())
    })?;
    let key = |p: &SpacePoint| (p.frame, p.target);
    points.sort_by_key(key);
    if let Some(twice) = points.windows(2).find(|two| key(&two[0]) == key(&two[1])) {
        return Err(TrackFileError::Twice { path: path.into(), frame: twice[0].frame, what: twice[0].target.name().to_owned() });
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_table_with_a_point_twice_or_an_impossible_frame_is_refused_and_points_come_in_order() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("t.csv");
        let read = |rows: &str| {
            std::fs::write(&path, format!("frame,camera,target,u,v,u_sd,v_sd,state\n{rows}")).expect("written");
            Tracks::read(&path).map(|t| t.points.len()).map_err(|e| e.to_string())
        };
        let row = |frame: u64| format!("{frame},left,m1,1.0,2.0,0.1,0.1,measured\n");
        assert_eq!(read(&(row(8) + &row(7))), Ok(2));
        assert!(read(&(row(7) + &row(7))).is_err_and(|e| e.contains("frame 7 has two rows of left m1")));
        for (written, told) in [("1.0", "u, v are 1e300, 2; allowed"), ("0.1,0.1", "u_sd, v_sd are 1e300, 1e300; allowed: 1e-5 to 1e5 px")] {
            let wild = if written == "1.0" { "1e300" } else { "1e300,1e300" };
            assert!(read(&row(7).replacen(written, wild, 1)).is_err_and(|e| e.contains("line 2: ") && e.contains(told)), "{told}");
        }
        for (written, wild, told) in [
            ("7,left", "7.5,left", "line 2: `frame` is `7.5`: no whole number from 0 on"),
            ("left", "middle", "line 2: `camera` is `middle`: expected `left` or `right`"),
            (",1.0,", ",one,", "line 2: `u` is `one`: no number"),
            ("measured", "seen", "line 2: `state` is `seen`: expected one of `measured`, `manual`, `occluded`"),
        ] {
            let refused = read(&row(7).replacen(written, wild, 1)).expect_err(told);
            assert!(refused.contains(told), "{refused}");
        }
        std::fs::write(&path, "frame,camera,u,v,u_sd,v_sd,state\n7,left,1.0,2.0,0.1,0.1,measured\n").expect("written");
        assert!(Tracks::read(&path).is_err_and(|e| e.to_string().contains("line 2: missing column `target`")));
        assert!(read(&row(u64::MAX)).is_err_and(|e| e.contains("line 2: frame 18446744073709551615; allowed: up to 9007199254740992")));
        std::fs::write(&path, "frame,t,target,x,y,z,x_sd,y_sd,z_sd,residual_px\n9,0,m2,0,0,0,1,1,1,0\n8,0,ball,0,0,0,1,1,1,0\n8,0,m1,0,0,0,1,1,1,0\n")
            .expect("written");
        let order: Vec<(u64, Target)> = read_points(&path).expect("read").iter().map(|p| (p.frame, p.target)).collect();
        assert_eq!(order, [(8, Target::M1), (8, Target::Ball), (9, Target::M2)]);
    }

    #[test]
    fn agrees_with_exact_decimals() {
        let many = (0..20_000).map(|i| (f64::from(i) * 0.777).sin() * 10f64.powi(i % 12 - 7));
        for v in many.chain([0.0, -0.0, 1.0, -1.0, 0.5, 12.3456, 511.99999, -0.00001, 1e12, -3e20, f64::NAN, f64::INFINITY]) {
            for decimals in [4, 7, 9] {
                let mut out = String::new();
                push_fixed(&mut out, v, decimals);
                let exact = format!("{v:.0$},", decimals as usize);
                // The other neighbour where the value is halfway between two, to what a number of this size can tell.
                let halfway = || (out.trim_end_matches(',').parse::<f64>().unwrap_or(f64::NAN) - v).abs() < 0.505 * 0.1f64.powi(decimals as i32);
                assert!(out == exact || out.len() == exact.len() && halfway(), "{out} {exact}");
            }
        }
    }
}
