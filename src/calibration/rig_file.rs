//! `calibration.json` and `calibration.yml` (contract, section 3): reading, checking and writing a rig.

use super::distortion::SHARED;
use super::{CalibrationError, Camera, RigidTransform, StereoRig};
use crate::footage::MAX_PIXELS;
use crate::limited_file::{LARGEST_TEXT, read_text};
use crate::provenance::write_atomically;
use nalgebra::Matrix3;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::fmt::Write;
use std::path::Path;

const MOST_CENTRE_PX: f64 = 1e6;
const MOST_DISTORTION: f64 = 1e12;
const MOST_SHIFT_M: f64 = 1e4;
/// By how much a covariance may be off symmetry, or a correlation beyond 1, from rounding.
const ROUNDING: f64 = 1e-6;

impl StereoRig {
    /// Reads and checks `calibration.json`.
    pub fn read(path: &Path) -> Result<Self, CalibrationError> {
        let rig: StereoRig = parsed(path)?;
        rig.check(path)?;
        Ok(rig)
    }

    /// [`Self::read`] of what measuring needs: cameras, axes, their uncertainty and what they were made from. The reports, nearly all of the file, are passed
    /// over.
    pub fn read_to_measure_with(path: &Path) -> Result<Self, CalibrationError> {
        let file: Measuring = parsed(path)?;
        let reference = file.volume.and_then(|v| v.reference_points_m).map(|points| ("volume".to_owned(), serde_json::json!({ "reference_points_m": points })));
        let rig = StereoRig {
            image_size: file.image_size,
            left: file.left,
            right: file.right,
            r: file.r,
            t: file.t,
            rms_stereo_px: file.rms_stereo_px,
            pairs: Vec::new(),
            square_mm: None,
            global_from_left: file.global_from_left,
            more: [("covariance", file.covariance), ("provenance", file.provenance)]
                .into_iter()
                .filter_map(|(k, v)| Some((k.to_owned(), v?)))
                .chain(reference)
                .collect(),
        };
        rig.check(path)?;
        Ok(rig)
    }

    /// Writes `calibration.json` whole or not at all.
    pub fn write(&self, path: &Path) -> std::io::Result<()> {
        write_atomically(path, self.to_json()?.as_bytes())
    }

    /// The text of `calibration.json`.
    pub fn to_json(&self) -> std::io::Result<String> {
        let mut text = serde_json::to_string_pretty(self).map_err(std::io::Error::other)?;
        text.push('\n');
        Ok(text)
    }

    /// Refuses numbers no camera can have, so that later rooms need not look again.
    pub(crate) fn check(&self, path: &Path) -> Result<(), CalibrationError> {
        let bad = |key: &str, seen: String, allowed: &'static str| CalibrationError::Value { path: path.into(), key: key.into(), seen, allowed };
        if self.image_size.iter().any(|s| !(1..=65_536).contains(s)) {
            return Err(bad("image_size", format!("{:?}", self.image_size), "1 to 65536 px a side"));
        }
        if self.image_size.iter().map(|s| *s as u64).product::<u64>() > MAX_PIXELS {
            return Err(bad("image_size", format!("{:?}", self.image_size), "67108864 px in all"));
        }
        for (name, c) in [("left", &self.left), ("right", &self.right)] {
            if !(c.fx > 0.0 && c.fy > 0.0 && c.fx < 1e9 && c.fy < 1e9) {
                return Err(bad(&format!("{name}.fx, fy"), format!("{}, {}", c.fx, c.fy), "above 0 and below 1e9, px"));
            }
            // Wide limits: of a long lens the centre is uncertain by a picture's width, and high terms are large.
            if !(c.cx.abs() < MOST_CENTRE_PX && c.cy.abs() < MOST_CENTRE_PX) {
                return Err(bad(&format!("{name}.cx, cy"), format!("{}, {}", c.cx, c.cy), "below 1e6 either way, px"));
            }
            if !c.distortion.iter().all(|k| k.abs() < MOST_DISTORTION) {
                return Err(bad(&format!("{name}.distortion"), format!("{:?}", c.distortion), "k1 k2 p1 p2 k3, each below 1e12 either way"));
            }
        }
        for (name, r, t) in [("R", &self.r, &self.t), ("global_from_left", &self.global_from_left.r, &self.global_from_left.t)] {
            let m = Matrix3::from_fn(|i, j| r[i][j]);
            let off = (m.transpose() * m - Matrix3::identity()).norm();
            if !(off < 1e-3 && m.determinant() > 0.0) {
                return Err(bad(name, format!("{r:?}"), "a rotation matrix"));
            }
            if !t.iter().all(|v| v.abs() <= MOST_SHIFT_M) {
                return Err(bad(name, format!("{t:?}"), "shifts of up to 10 km, m"));
            }
        }
        for (key, sd) in &self.global_from_left.sd {
            if !sd.iter().all(|v| (0.0..=MOST_SHIFT_M).contains(v)) {
                return Err(bad(&format!("global_from_left.sd.{key}"), format!("{sd:?}"), "deviations, 0 to 1e4"));
            }
        }
        // Cameras of another program come without; one that is spoilt would be passed over, and every interval too narrow.
        if let Some(fault) = self.more.get("covariance").filter(|c| !c.is_null()).and_then(covariance_fault) {
            let allowed =
                "a symmetric matrix of 24 rows and columns, nothing below 0 on its diagonal and no correlation beyond 1, as `sweetspot calibrate` writes it";
            return Err(bad("covariance.matrix", fault, allowed));
        }
        let apart = self.t.iter().map(|v| v * v).sum::<f64>().sqrt();
        if !(apart > 0.0 && apart <= 100.0) {
            let allowed = "m: two cameras at different places, up to 100 m apart; OpenCV gives T in the unit of the board's squares, so divide mm by 1000";
            return Err(bad("T", format!("{:?}", self.t), allowed));
        }
        Ok(())
    }

    /// The cameras as an OpenCV FileStorage: `M1 D1 M2 D2 R T E F image_size`.
    pub fn to_opencv_yaml(&self) -> String {
        let camera = |c: &Camera| Matrix3::new(c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0);
        let (k1, k2) = (camera(&self.left), camera(&self.right));
        let r = Matrix3::from_fn(|i, j| self.r[i][j]);
        let t = nalgebra::Vector3::from(self.t);
        let essential = t.cross_matrix() * r;
        let inverse = |c: &Camera| Matrix3::new(1.0 / c.fx, 0.0, -c.cx / c.fx, 0.0, 1.0 / c.fy, -c.cy / c.fy, 0.0, 0.0, 1.0);
        let mut fundamental = inverse(&self.right).transpose() * essential * inverse(&self.left);
        if fundamental[(2, 2)].abs() > 1e-12 * fundamental.norm() {
            fundamental /= fundamental[(2, 2)];
        }
        let mut out = String::from("%YAML:1.0\n---\n");
        let _ = writeln!(out, "image_size: [ {}, {} ]", self.image_size[0], self.image_size[1]);
        let rows = |m: &Matrix3<f64>| m.transpose().iter().copied().collect::<Vec<f64>>();
        for (name, rows_count, columns, values) in [
            ("M1", 3, 3, rows(&k1)),
            ("D1", 1, 5, self.left.distortion.to_vec()),
            ("M2", 3, 3, rows(&k2)),
            ("D2", 1, 5, self.right.distortion.to_vec()),
            ("R", 3, 3, rows(&r)),
            ("T", 3, 1, self.t.to_vec()),
            ("E", 3, 3, rows(&essential)),
            ("F", 3, 3, rows(&fundamental)),
        ] {
            // `{:?}` of an f64 keeps every digit and always looks like a real number, as the reader wants it.
            let list: Vec<String> = values.iter().map(|v| format!("{v:?}")).collect();
            let _ = write!(out, "{name}: !!opencv-matrix\n   rows: {rows_count}\n   cols: {columns}\n   dt: d\n   data: [ {} ]\n", list.join(",\n       "));
        }
        out
    }

    /// Reads the cameras of an OpenCV FileStorage (`M1 D1 M2 D2 R T`, and `image_size` or `image_size: [w, h]`).
    ///
    /// The names of OpenCV's stereo samples; a distortion list shorter than five is filled with zeros.
    pub fn read_opencv_yaml(path: &Path) -> Result<Self, CalibrationError> {
        let text = read_limited(path)?;
        let wrong = |what: String| CalibrationError::Format { path: path.into(), what };
        if text.trim_start().starts_with("<?xml") {
            return Err(wrong("a FileStorage in XML; allowed: YAML (write it under a name that ends with .yml)".into()));
        }
        let matrix = |name: &str| {
            let list = opencv_matrix(&text, name).ok_or_else(|| {
                wrong(match entry(&text, name) {
                    Some((_, block)) => {
                        format!("`{name}` is {:?}; allowed: a matrix of finite numbers; write the file anew with the program it is from", shown(&block))
                    }
                    None => format!("no matrix `{name}`; needed: M1 D1 M2 D2 R T image_size"),
                })
            })?;
            match entry(&text, name).and_then(|(_, block)| shape(&block)) {
                Some([rows, columns]) if rows * columns != list.len() as f64 => Err(wrong(format!(
                    "`{name}` has {} numbers for {rows:?} rows and {columns:?} columns; write the file anew with the program it is from",
                    list.len()
                ))),
                _ => Ok(list),
            }
        };
        let camera = |m: &str, d: &str| -> Result<Camera, CalibrationError> {
            let (k, list) = (matrix(m)?, matrix(d)?);
            // Scaled or turned on its side it would be read as another camera.
            if k.len() != 9 || [k[1], k[3], k[6], k[7]] != [0.0; 4] || k[8] != 1.0 {
                return Err(wrong(format!("`{m}` is {k:?}; allowed: fx 0 cx, 0 fy cy, 0 0 1, a camera matrix without skew, row by row")));
            }
            if list.len() > 5 && list[5..].iter().any(|v| *v != 0.0) {
                return Err(wrong(format!("`{d}` has {} terms; allowed: k1 k2 p1 p2 k3", list.len())));
            }
            let mut distortion = [0.0; 5];
            for (to, from) in distortion.iter_mut().zip(&list) {
                *to = *from;
            }
            Ok(Camera { fx: k[0], fy: k[4], cx: k[2], cy: k[5], distortion, rms_px: 0.0, sd: Default::default() })
        };
        let (left, right) = (camera("M1", "D1")?, camera("M2", "D2")?);
        let (r, t) = (matrix("R")?, matrix("T")?);
        if r.len() != 9 || t.len() != 3 {
            return Err(wrong("`R` must be 3x3 and `T` 3x1".into()));
        }
        let size = opencv_matrix(&text, "image_size")
            .or_else(|| sequence(&text, "image_size"))
            .filter(|s| s.len() == 2)
            .ok_or_else(|| wrong("no `image_size: [ width, height ]`".into()))?;
        if size.iter().any(|s| s.fract() != 0.0 || *s < 1.0) {
            return Err(wrong(format!("`image_size` is {size:?}; allowed: whole numbers of pixels, 1 or more")));
        }
        let rig = StereoRig {
            image_size: [size[0] as usize, size[1] as usize],
            left,
            right,
            r: [[r[0], r[1], r[2]], [r[3], r[4], r[5]], [r[6], r[7], r[8]]],
            t: [t[0], t[1], t[2]],
            rms_stereo_px: 0.0,
            pairs: Vec::new(),
            square_mm: None,
            global_from_left: RigidTransform::from_isometry(&nalgebra::Isometry3::identity()),
            more: Default::default(),
        };
        rig.check(path)?;
        Ok(rig)
    }
}

/// The part of `calibration.json` that measuring needs; names as in [`StereoRig`].
#[derive(Deserialize)]
struct Measuring {
    image_size: [usize; 2],
    left: Camera,
    right: Camera,
    #[serde(rename = "R")]
    r: [[f64; 3]; 3],
    #[serde(rename = "T")]
    t: [f64; 3],
    rms_stereo_px: f64,
    global_from_left: RigidTransform,
    covariance: Option<serde_json::Value>,
    volume: Option<Volume>,
    provenance: Option<serde_json::Value>,
}

#[derive(Deserialize)]
struct Volume {
    reference_points_m: Option<serde_json::Value>,
}

/// What is wrong with the covariance of both cameras' parameters, as a message shows it.
fn covariance_fault(covariance: &serde_json::Value) -> Option<String> {
    let Some(rows) = covariance.get("matrix").and_then(|m| serde_json::from_value::<Vec<Vec<f64>>>(m.clone()).ok()) else {
        return Some("no matrix of numbers".to_owned());
    };
    if let Some(odd) = rows.iter().map(Vec::len).chain([rows.len()]).find(|n| *n != SHARED) {
        return Some(format!("a matrix with {odd} rows or columns"));
    }
    // The variances first: the rest is measured by them.
    let mut pairs = (0..SHARED).map(|i| (i, i)).chain((0..SHARED).flat_map(|i| (0..SHARED).map(move |j| (i, j))));
    pairs.find_map(|(i, j)| {
        let most = (rows[i][i] * rows[j][j]).sqrt();
        // Not a number where a variance is below 0.
        let sound = rows[i][j].abs() <= most * (1.0 + ROUNDING) && (rows[i][j] - rows[j][i]).abs() <= most * ROUNDING && rows[i][i] >= 0.0;
        (!sound)
            .then(|| format!("{:e} in row {}, column {} ({:e} across, variances {:e} and {:e})", rows[i][j], i + 1, j + 1, rows[j][i], rows[i][i], rows[j][j]))
    })
}

fn read_limited(path: &Path) -> Result<String, CalibrationError> {
    read_text(path, LARGEST_TEXT).map_err(|source| CalibrationError::Unreadable { path: path.into(), source })
}

fn parsed<T: DeserializeOwned>(path: &Path) -> Result<T, CalibrationError> {
    serde_json::from_str(&read_limited(path)?).map_err(|e| CalibrationError::Format { path: path.into(), what: e.to_string() })
}

/// The numbers after `name: !!opencv-matrix ... data: [ ... ]`.
fn opencv_matrix(text: &str, name: &str) -> Option<Vec<f64>> {
    let (_, block) = entry(text, name)?;
    let data = block.split_once("data:")?.1;
    numbers(data)
}

/// How many rows and columns a matrix has, where its block says so.
fn shape(block: &str) -> Option<[f64; 2]> {
    let count = |key: &str| block.lines().find_map(|l| l.trim().strip_prefix(key))?.trim().parse().ok();
    Some([count("rows:")?, count("cols:")?])
}

/// What stands in a block where numbers belong, for a message.
fn shown(block: &str) -> String {
    let data = block.split_once("data:").map_or(block, |(_, data)| data);
    data.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(120).collect()
}

/// The numbers of `name: [ a, b ]`.
fn sequence(text: &str, name: &str) -> Option<Vec<f64>> {
    let (line, block) = entry(text, name)?;
    numbers(&format!("{line}\n{block}"))
}

/// The rest of the line of a top-level key, and the indented lines below it.
fn entry<'a>(text: &'a str, name: &str) -> Option<(&'a str, String)> {
    let mut lines = text.lines();
    let first = lines.by_ref().find_map(|l| l.strip_prefix(name)?.strip_prefix(':'))?;
    let block: Vec<&str> = lines.take_while(|l| l.is_empty() || l.starts_with(' ') || l.starts_with('\t') || l.starts_with('-')).collect();
    Some((first, block.join("\n")))
}

fn numbers(text: &str) -> Option<Vec<f64>> {
    // OpenCV itself writes a sequence with a dash before each number.
    let number = |n: &str| n.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    if text.trim_start().starts_with("- ") {
        return text.split_whitespace().collect::<Vec<_>>().chunks(2).map(|pair| number(pair.get(1)?).filter(|_| pair[0] == "-")).collect();
    }
    let inside = text.split_once('[')?.1.split_once(']')?.0;
    inside.split(',').map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> StereoRig {
        let camera = |fx| Camera { fx, fy: fx - 1.5, cx: 250.25, cy: 260.0, distortion: [-0.6, 3.0, 1e-3, -2e-3, 0.0], rms_px: 0.1, sd: Default::default() };
        let turn = nalgebra::Rotation3::from_euler_angles(0.01, 0.6, -0.02);
        StereoRig {
            image_size: [512, 512],
            left: camera(3000.0),
            right: camera(3100.0),
            r: [0, 1, 2].map(|i| [0, 1, 2].map(|j| turn[(i, j)])),
            t: [-7.0, 0.1, 2.0],
            rms_stereo_px: 0.1,
            pairs: Vec::new(),
            square_mm: None,
            global_from_left: RigidTransform::from_isometry(&nalgebra::Isometry3::identity()),
            more: Default::default(),
        }
    }

    #[test]
    fn law_json_and_yaml_give_the_same_cameras_back() {
        let folder = tempfile::tempdir().expect("folder");
        let (json, yml) = (folder.path().join("calibration.json"), folder.path().join("calibration.yml"));
        rig().write(&json).expect("written");
        assert_eq!(StereoRig::read(&json).expect("read"), rig());
        let one = nalgebra::DMatrix::<f64>::identity(SHARED, SHARED);
        let rows: Vec<Vec<f64>> = one.row_iter().map(|row| row.iter().copied().collect()).collect();
        let (covariance, volume) = (serde_json::json!({ "matrix": rows }), serde_json::json!({ "reference_points_m": [[1.0, 2.0, 3.0]] }));
        let needed: std::collections::BTreeMap<_, _> = [("covariance".to_owned(), covariance), ("volume".to_owned(), volume)].into();
        let reported = needed.clone().into_iter().chain([("boards".to_owned(), serde_json::json!([1, 2]))]).collect();
        StereoRig { more: reported, ..rig() }.write(&json).expect("written");
        assert_eq!(StereoRig::read_to_measure_with(&json).expect("read"), StereoRig { more: needed, ..rig() });
        std::fs::write(&yml, rig().to_opencv_yaml()).expect("written");
        let back = StereoRig::read_opencv_yaml(&yml).expect("read");
        // The size as OpenCV writes a sequence, and as it writes an array of two.
        for size in ["image_size:\n   - 512\n   - 512\n", "image_size: !!opencv-nd-matrix\n   sizes: [ 2 ]\n   dt: i\n   data: [ 512, 512 ]\n"] {
            let other = folder.path().join("other.yml");
            let text = std::fs::read_to_string(&yml).expect("read").replace("image_size: [ 512, 512 ]\n", size);
            std::fs::write(&other, &text).expect("written");
            assert!(text.contains(size) && StereoRig::read_opencv_yaml(&other).expect("read").image_size == [512, 512]);
        }
        assert_eq!((back.left.fx, back.right.cy, back.r, back.t, back.image_size), (3000.0, 260.0, rig().r, rig().t, [512, 512]));
        assert_eq!(back.left.distortion, rig().left.distortion);
    }

    #[test]
    fn law_the_transform_in_the_file_tells_whether_the_axes_are_known() {
        let folder = tempfile::tempdir().expect("folder");
        let json = folder.path().join("calibration.json");
        let framed = RigidTransform::from_isometry(&nalgebra::Isometry3::translation(-0.3, 1.0, 9.0));
        for (global_from_left, known) in [(rig().global_from_left, false), (framed, true)] {
            StereoRig { global_from_left, ..rig() }.write(&json).expect("written");
            for read in [StereoRig::read(&json), StereoRig::read_to_measure_with(&json)] {
                assert_eq!(read.expect("read").axes_known(), known);
            }
        }
    }

    #[test]
    fn fails_a_matrix_with_something_else_than_numbers_is_shown() {
        let folder = tempfile::tempdir().expect("folder");
        let file = folder.path().join("cameras.yml");
        let message = |text: String| {
            std::fs::write(&file, text).expect("written");
            StereoRig::read_opencv_yaml(&file).expect_err("no calibration").to_string()
        };
        let whole = rig().to_opencv_yaml();
        let told = message(whole.replacen("[ 3000.0,", "[ .Nan,", 1));
        assert!(told.contains("cameras.yml") && told.contains("`M1` is \"[ .Nan, 0.0,") && told.contains("finite numbers"), "{told}");
        let told = message(whole.replace("M2:", "K2:"));
        assert!(told.contains("no matrix `M2`; needed:"), "{told}");
        let told = message(whole.replacen("rows: 3", "rows: 30", 1));
        assert!(told.contains("`M1` has 9 numbers for 30.0 rows and 3.0 columns"), "{told}");
        let told = message(whole.replace("image_size: [ 512, 512 ]", "image_size: [ 512.5, -1 ]"));
        assert!(told.contains("`image_size` is [512.5, -1.0]; allowed: whole numbers"), "{told}");
    }

    #[test]
    fn fails_a_camera_matrix_scaled_or_by_columns() {
        let folder = tempfile::tempdir().expect("folder");
        let file = folder.path().join("cameras.yml");
        let of = |k: [f64; 9]| {
            let head = "M1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: ";
            let whole = rig().to_opencv_yaml();
            let (before, after) = whole.split_once(head).expect("has M1");
            let after = after.split_once(']').expect("ends").1;
            std::fs::write(&file, format!("{before}{head}{k:?}{after}")).expect("written");
            StereoRig::read_opencv_yaml(&file).map(|rig| rig.left.cx).map_err(|e| e.to_string())
        };
        assert_eq!(of([3000.0, 0.0, 250.25, 0.0, 2998.5, 260.0, 0.0, 0.0, 1.0]), Ok(250.25));
        for k in [[3000.0, 0.0, 0.0, 0.0, 2998.5, 0.0, 250.25, 260.0, 1.0], [6000.0, 0.0, 500.5, 0.0, 5997.0, 520.0, 0.0, 0.0, 2.0]] {
            assert!(of(k).is_err_and(|e| e.contains("`M1` is [") && e.contains("row by row")), "{k:?}");
        }
    }

    #[test]
    fn fails_a_covariance_that_is_none() {
        let rows = |spoil: fn(&mut Vec<Vec<f64>>)| {
            let mut rows: Vec<Vec<f64>> = (0..SHARED).map(|i| (0..SHARED).map(|j| f64::from(i32::from(i == j))).collect()).collect();
            spoil(&mut rows);
            serde_json::json!({ "matrix": rows })
        };
        let check = |covariance: serde_json::Value| {
            let more = [("covariance".to_owned(), covariance)].into();
            StereoRig { more, ..rig() }.check(Path::new("calibration.json")).map_err(|e| e.to_string())
        };
        for sound in [rows(|_| {}), rows(|c| c[23][23] = 0.0), rows(|c| (c[3][5], c[5][3]) = (0.9, 0.9)), serde_json::Value::Null] {
            assert_eq!(check(sound), Ok(()));
        }
        let spoilt: [(fn(&mut Vec<Vec<f64>>), &str); 6] = [
            (|c| c[2][2] = -1.0, "variances -1e0"),
            (|c| c[5][9] = 0.5, "5e-1 in row 6, column 10 (0e0 across"),
            (|c| (c[3][5], c[5][3]) = (1.1, 1.1), "1.1e0 in row 4, column 6"),
            (|c| c.truncate(3), "3 rows or columns"),
            (|c| c[7].truncate(2), "2 rows or columns"),
            (|c| c[7][7] = f64::NAN, "no matrix of numbers"),
        ];
        for (spoil, told) in spoilt {
            let message = check(rows(spoil)).expect_err(told);
            assert!(message.contains("`covariance.matrix` is ") && message.contains(told), "{told}: {message}");
        }
        assert!(check(serde_json::json!("x")).is_err());
    }

    #[test]
    fn fails_numbers_no_camera_can_have() {
        let path = Path::new("calibration.json");
        let cases: [fn(&mut StereoRig); 10] = [
            |r| r.left.fx = -1.0,
            |r| r.right.cx = f64::NAN,
            |r| r.left.cy = 1e300,
            |r| r.left.distortion[0] = 1e200,
            |r| r.r[0][0] = 5.0,
            |r| r.t = [0.0; 3],
            |r| r.t = [-3000.0, 0.0, 0.0],
            |r| r.image_size = [0, 5],
            |r| r.global_from_left.t = [1e300, 0.0, 0.0],
            |r| r.global_from_left.sd = [("t_m".to_owned(), [0.001, -0.001, 0.001])].into(),
        ];
        for spoil in cases {
            let mut bad = rig();
            spoil(&mut bad);
            assert!(matches!(bad.check(path), Err(CalibrationError::Value { .. })));
        }
    }
}
