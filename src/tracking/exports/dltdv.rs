//! The CSV tables of DLTdv, the digitising program of many biomechanics laboratories (Hedrick 2008, Bioinspiration &
//! Biomimetics 3, 034001): one row per frame, points in columns, NaN where nothing was measured.
//!
//! Pixels are those of version 8 (2019), whose calibration program and readers leave pictures as they lie in MATLAB: from
//! (1, 1) in the upper left corner, x = u + 1 and y = v + 1 for a pixel (u, v) of ours. That is what
//! [`crate::calibration::dltdv_csv`]'s coefficients mean too. Versions 3 to 7 turn every picture over (`flipud`, `axis xy`)
//! and count y from the lower edge: height + 1 - y. Camera 1 is the left one; points 1 to 5 are m1 to m5, point 6 is the ball.

use crate::calibration::CameraId;
use crate::tracking::exports::export::{ExportError, TrackExport};
use crate::tracking::track_file::Target;
use std::fmt::Write;

/// Rows that a spreadsheet still opens.
const MOST_FRAMES: u64 = 1_000_000;

/// The four tables that DLTdv opens together, by the end of their names.
pub fn dltdv_tables(shot: &TrackExport) -> Result<[(&'static str, String); 4], ExportError> {
    shot.length("DLTdv", MOST_FRAMES)?;
    let names = |what: &dyn Fn(usize) -> String| (1..=Target::ALL.len()).map(what).collect::<Vec<_>>().join(",") + "\n";
    let mut xypts = names(&|k| format!("pt{k}_cam1_X,pt{k}_cam1_Y,pt{k}_cam2_X,pt{k}_cam2_Y"));
    let mut xyzpts = names(&|k| format!("pt{k}_X,pt{k}_Y,pt{k}_Z"));
    let mut xyzres = names(&|k| format!("pt{k}_dltres"));
    let mut offsets = String::from("cam1_offset,cam2_offset\n");
    for frame in shot.frames.clone() {
        let [mut xy, mut xyz, mut res] = [const { String::new() }; 3];
        for target in Target::ALL {
            for camera in CameraId::BOTH {
                // Writing into a string cannot fail.
                let _ = match shot.tracks.get(frame, camera, target) {
                    Some(p) => write!(xy, ",{:.4},{:.4}", p.uv.x + 1.0, p.uv.y + 1.0),
                    None => write!(xy, ",NaN,NaN"),
                };
            }
            let _ = match shot.point(frame, target) {
                Some(p) => write!(xyz, ",{:.7},{:.7},{:.7}", p.position.x, p.position.y, p.position.z).and_then(|()| write!(res, ",{:.4}", p.residual_px)),
                None => write!(xyz, ",NaN,NaN,NaN").and_then(|()| write!(res, ",NaN")),
            };
        }
        for (table, row) in [(&mut xypts, &xy), (&mut xyzpts, &xyz), (&mut xyzres, &res)] {
            table.push_str(&row[1..]);
            table.push('\n');
        }
        offsets.push_str("0,0\n");
    }
    Ok([("xypts.csv", xypts), ("xyzpts.csv", xyzpts), ("xyzres.csv", xyzres), ("offsets.csv", offsets)])
}
