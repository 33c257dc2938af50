//! A C3D file, the binary exchange format of motion laboratories (c3d.org, "The C3D File Format"): space points as 32-bit
//! floats, m, global axes, with frame rate, residuals and the cameras that saw each point.

use crate::calibration::CameraId;
use crate::tracking::exports::export::{ExportError, TrackExport};
use crate::tracking::track_file::Target;

/// Frame counts are 16-bit.
const MOST_FRAMES: u64 = 65_535;
const BLOCK: usize = 512;
/// Processor type 1 (Intel byte order), as the format counts it.
const INTEL: u8 = 84;
/// Marks header and parameters as C3D.
const MAGIC: u8 = 0x50;
/// Smallest step of a stored residual, m.
const LEAST_RESIDUAL_STEP_M: f64 = 1e-6;

/// The shot as the bytes of a C3D file. A point that no camera and no pose gives has residual -1, as the format wants. The
/// group SWEETSPOT holds the (fractional) frame of t = 0 in points.csv: first contact, where one was found; and how many frames that is after the
/// first one, which single precision holds exactly however high the frames are numbered.
pub fn c3d_bytes(shot: &TrackExport) -> Result<Vec<u8>, ExportError> {
    let n = shot.length("C3D", MOST_FRAMES)?;
    let (first, last) = (*shot.frames.start(), *shot.frames.end());
    if last > u64::from(u32::MAX) {
        return Err(ExportError::TooHigh { format: "C3D", last, most: u32::MAX.into() });
    }
    // Residuals are stored as up to 255 steps; the format keeps them in the points' unit, so px become m at the point's place.
    let residual_m = |p: &crate::tracking::SpacePoint| p.residual_px / shot.px_per_m(&p.position);
    let largest = shot.points.iter().map(residual_m).filter(|r| r.is_finite()).fold(0.0, f64::max);
    let step = (largest / 255.0).max(LEAST_RESIDUAL_STEP_M) as f32;
    let rate = shot.frame_rate_hz as f32;
    let zero = shot.points.first().map(|p| p.frame as f64 - p.t * shot.frame_rate_hz);
    // Where the data begin is itself a parameter: its size does not depend on its value.
    let sized = parameters(first, n, rate, step, zero, 0);
    let data_block = 2 + (sized.len() / BLOCK) as u16;
    let mut out = header(first, n, rate, step, data_block);
    out.extend(parameters(first, n, rate, step, zero, data_block));
    for frame in shot.frames.clone() {
        for target in Target::ALL {
            let words: [f32; 4] = match shot.point(frame, target) {
                Some(p) => {
                    let steps = (residual_m(p) / f64::from(step)).round().clamp(0.0, 255.0);
                    let cameras: u16 = CameraId::BOTH.iter().filter(|c| shot.tracks.get(frame, **c, target).is_some()).map(|c| 1 << c.index()).sum();
                    [p.position.x as f32, p.position.y as f32, p.position.z as f32, f32::from(cameras << 8) + steps as f32]
                }
                None => [0.0, 0.0, 0.0, -1.0],
            };
            out.extend(words.iter().flat_map(|w| w.to_le_bytes()));
        }
    }
    pad(&mut out);
    Ok(out)
}

/// Fills the last block.
fn pad(out: &mut Vec<u8>) {
    out.resize(out.len().next_multiple_of(BLOCK), 0);
}

fn header(first: u64, n: u64, rate: f32, step: f32, data_block: u16) -> Vec<u8> {
    let mut out = vec![2, MAGIC]; // parameters begin in block 2
    let clamp = |v: u64| v.min(MOST_FRAMES) as u16;
    let longest_gap = 0u16; // nothing is interpolated
    for word in [Target::ALL.len() as u16, 0, clamp(first), clamp(first.saturating_add(n - 1)), longest_gap] {
        out.extend(word.to_le_bytes());
    }
    out.extend((-step).to_le_bytes()); // below zero: the data are floats
    out.extend(data_block.to_le_bytes());
    out.extend(0u16.to_le_bytes()); // analog samples per frame
    out.extend(rate.to_le_bytes());
    pad(&mut out);
    out
}

/// One value of a parameter.
enum Value<'a> {
    Words(&'a [u16]),
    Float(f32),
    /// All padded to the longest.
    Texts(&'a [&'a str]),
}

/// Parameter section: groups and their parameters, whole blocks.
struct Section {
    bytes: Vec<u8>,
    groups: i8,
}

impl Section {
    fn group(&mut self, name: &str) {
        self.groups += 1;
        self.bytes.push(name.len() as u8);
        self.bytes.push((-self.groups) as u8);
        self.bytes.extend(name.bytes());
        self.bytes.extend(3u16.to_le_bytes()); // to the next record: these two bytes and the length of no description
        self.bytes.push(0);
    }

    /// A parameter of the group begun last.
    fn parameter(&mut self, name: &str, value: Value) {
        let (kind, dimensions, data): (i8, Vec<u8>, Vec<u8>) = match value {
            Value::Words(w) => (2, if w.len() == 1 { vec![] } else { vec![w.len() as u8] }, w.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Value::Float(v) => (4, vec![], v.to_le_bytes().to_vec()),
            Value::Texts(t) => {
                let width = t.iter().map(|s| s.len()).max().unwrap_or(0);
                let dimensions = if t.len() == 1 { vec![width as u8] } else { vec![width as u8, t.len() as u8] };
                (-1, dimensions, t.iter().flat_map(|s| format!("{s:<width$}").into_bytes()).collect())
            }
        };
        self.bytes.push(name.len() as u8);
        self.bytes.push(self.groups as u8);
        self.bytes.extend(name.bytes());
        self.bytes.extend((2 + 2 + dimensions.len() as u16 + data.len() as u16 + 1).to_le_bytes());
        self.bytes.push(kind as u8);
        self.bytes.push(dimensions.len() as u8);
        self.bytes.extend(dimensions);
        self.bytes.extend(data);
        self.bytes.push(0); // no description
    }
}

fn parameters(first: u64, n: u64, rate: f32, step: f32, zero: Option<f64>, data_block: u16) -> Vec<u8> {
    let mut s = Section { bytes: vec![1, MAGIC, 0, INTEL], groups: 0 };
    let labels = Target::ALL.map(Target::name);
    s.group("POINT");
    s.parameter("USED", Value::Words(&[labels.len() as u16]));
    s.parameter("SCALE", Value::Float(-step));
    s.parameter("RATE", Value::Float(rate));
    s.parameter("DATA_START", Value::Words(&[data_block]));
    s.parameter("FRAMES", Value::Words(&[n as u16]));
    s.parameter("LABELS", Value::Texts(&labels));
    s.parameter("DESCRIPTIONS", Value::Texts(&["tape at the tip", "tape, side 2", "tape, side 3", "tape, throat 4", "tape, throat 5", "centre of the ball"]));
    s.parameter("UNITS", Value::Texts(&["m"]));
    s.parameter("X_SCREEN", Value::Texts(&["+X"]));
    s.parameter("Y_SCREEN", Value::Texts(&["+Y"]));
    s.group("ANALOG");
    s.parameter("USED", Value::Words(&[0]));
    s.parameter("GEN_SCALE", Value::Float(1.0));
    s.parameter("RATE", Value::Float(0.0)); // readers compare it with the header's samples per frame: none
    s.group("FORCE_PLATFORM");
    s.parameter("USED", Value::Words(&[0]));
    // Frame numbers beyond 16 bits: low and high word.
    let last = first.saturating_add(n - 1);
    let words = |v: u64| [v as u16, (v >> 16) as u16];
    s.group("TRIAL");
    s.parameter("ACTUAL_START_FIELD", Value::Words(&words(first)));
    s.parameter("ACTUAL_END_FIELD", Value::Words(&words(last)));
    s.parameter("CAMERA_RATE", Value::Float(rate));
    s.group("SWEETSPOT");
    s.parameter("VERSION", Value::Texts(&[crate::provenance::VERSION]));
    if let Some(frame) = zero {
        s.parameter("TIME_ZERO_FRAME", Value::Float(frame as f32));
        s.parameter("TIME_ZERO_AFTER_START", Value::Float((frame - first as f64) as f32));
    }
    s.bytes.extend([0, 0]); // a name of no letters ends the section
    pad(&mut s.bytes);
    s.bytes[2] = (s.bytes.len() / BLOCK) as u8;
    s.bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::racket::racket_pose::tests::rig;
    use crate::tracking::{SpacePoint, Tracks};
    use nalgebra::{Point3, Vector3};

    #[test]
    fn truth_header_points_to_the_data_and_frames_fill_whole_blocks() {
        let rig = rig();
        let points = [SpacePoint { frame: 8, t: 2e-3, target: Target::Ball, position: Point3::new(0.1, 0.2, -0.3), sd: Vector3::zeros(), residual_px: 0.25 }];
        let shot = TrackExport { tracks: &Tracks::default(), points: &points, rig: &rig, frame_rate_hz: 1000.0, frames: 7..=9 };
        let bytes = c3d_bytes(&shot).expect("short");
        assert_eq!(bytes.len() % BLOCK, 0);
        let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        assert_eq!((word(2), word(6), word(8)), (6, 7, 9));
        let data = (usize::from(word(16)) - 1) * BLOCK;
        assert_eq!(data, BLOCK + BLOCK * usize::from(bytes[BLOCK + 2]));
        let float = |k: usize| f32::from_le_bytes(bytes[data + 4 * k..data + 4 * k + 4].try_into().expect("four"));
        // Second frame, sixth point.
        assert_eq!([float(44), float(45), float(46), float(47)], [0.1, 0.2, -0.3, 255.0]);
        assert_eq!(float(3), -1.0);
        let long = TrackExport { frames: 1..=70_000, ..shot };
        assert!(matches!(c3d_bytes(&long), Err(ExportError::TooLong { most: 65_535, .. })));
        let high = TrackExport { frames: (1 << 33)..=(1 << 33) + 1, ..long };
        assert!(matches!(c3d_bytes(&high), Err(ExportError::TooHigh { most: 4_294_967_295, .. })));
    }
}
