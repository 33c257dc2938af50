//! The part of `sweetspot racket` that measures markers from a photograph on a ruled sheet.

use super::Shell;
use super::earlier_output::Output;
use super::error::CliError;
use crate::equipment::Racket;
use crate::footage::{GreyImage, read_grey};
use crate::kinematics::{GridPhotograph, TapePlace, markers_of, tape_places};
use crate::limited_file::{LARGEST_TEXT, read_text};
use crate::provenance::write_atomically;
use image::{ImageFormat, Rgb, RgbImage};
use nalgebra::Vector2;
use std::path::{Path, PathBuf};

#[derive(Debug, Clone, clap::Args)]
pub struct PhotographArguments {
    /// Photograph of the racket lying on a sheet ruled in squares: gives the marker positions
    #[arg(long, value_name = "F", requires_all = ["tape", "camera_height"])]
    pub photo: Option<PathBuf>,
    /// A pixel near the middle of a tape; five times, m1 to m5
    #[arg(long, value_name = "U,V", value_parser = parse_pixel, num_args = 1)]
    pub tape: Vec<Vector2<f64>>,
    /// Height of the camera's lens above the sheet
    #[arg(long, value_name = "M")]
    pub camera_height: Option<f64>,
    /// Side of the sheet's squares
    #[arg(long, value_name = "M", default_value_t = 0.01)]
    pub square: f64,
    /// Writes the photograph with everything found drawn in (PNG)
    #[arg(long, value_name = "F", requires = "photo")]
    pub overlay: Option<PathBuf>,
    /// Writes the markers into racket.toml (the rest of the file stays as it is)
    #[arg(long, requires = "photo")]
    pub write: bool,
}

fn parse_pixel(text: &str) -> Result<Vector2<f64>, String> {
    let parts: Vec<f64> =
        text.split(',').map(|p| p.trim().parse::<f64>()).collect::<Result<_, _>>().map_err(|e| format!("{text:?}: {e}; give U,V in pixels"))?;
    match parts[..] {
        [u, v] if (0.0..1e5).contains(&u) && (0.0..1e5).contains(&v) => Ok(Vector2::new(u, v)),
        _ => Err(format!("{text:?}; give U,V in pixels from the top left")),
    }
}

pub fn measure_photograph(photograph: &Path, a: &PhotographArguments, racket: &Racket, path: &Path, shell: &Shell) -> Result<[TapePlace; 5], CliError> {
    let [m1, m2, m3, m4, m5] = a.tape[..] else {
        return Err(CliError::input(format!("--tape is given {} times; allowed: five times, m1 to m5", a.tape.len())));
    };
    let height = a.camera_height.filter(|h| (0.2..=20.0).contains(h)).ok_or_else(|| {
        CliError::input(format!("--camera-height is {:?}; allowed: 0.2 to 20 m", a.camera_height)).hint("measure it from the sheet to the lens")
    })?;
    if let Some(overlay) = &a.overlay {
        shell.keep([photograph, path]);
        shell.check_output(overlay, Output::Picture)?;
    }
    let image = read_grey(photograph)?;
    let sheet = GridPhotograph::find(&image, a.square)?;
    shell.say(format_args!(
        "{}: {} squares, {:.2} px/mm, off the map by {:.2} px",
        photograph.display(),
        sheet.squares.len(),
        1e-3 * sheet.px_per_m,
        sheet.rms_px
    ));
    let places = tape_places(&image, &sheet, &[m1, m2, m3, m4, m5], height, racket)?;
    for (k, p) in places.iter().enumerate() {
        let [x, y] = [p.local[0], p.local[1]].map(|v| (1e5 * v).round() / 1e5 + 0.0); // no minus before a zero
        shell.say(format_args!("m{} = [{x:.5}, {y:.5}, 0.0]    # ± {:.5}", k + 1, p.sd));
    }
    if let Some(stated) = &racket.markers {
        for (k, (p, s)) in places.iter().zip(stated.points()).enumerate() {
            let off = 1e3 * (p.local[0] - s.x).hypot(p.local[1] - s.y);
            shell.say(format_args!("m{}: {off:.2} mm from racket.toml's ({:.1} standard deviations)", k + 1, 1e-3 * off / p.sd));
        }
    }
    if let Some(overlay) = &a.overlay {
        let mut bytes = std::io::Cursor::new(Vec::new());
        drawn(&image, &sheet, &places).write_to(&mut bytes, ImageFormat::Png).map_err(CliError::output)?;
        shell.write_output(overlay, Output::Picture, bytes.get_ref())?;
    }
    if a.write {
        let text = read_text(path, LARGEST_TEXT).map_err(|e| CliError::input(format!("{}: cannot be read ({e})", path.display())))?;
        // The one file that a command is given to change.
        write_atomically(path, with_markers(&text, &places, path)?.as_bytes()).map_err(CliError::output)?;
        shell.say(format_args!("{}: [markers] written", path.display()));
    }
    Ok(places)
}

/// racket.toml with the markers measured, everything else as it was; deviations stand as comments.
fn with_markers(text: &str, places: &[TapePlace; 5], path: &Path) -> Result<String, CliError> {
    let mut document: toml_edit::DocumentMut = text.parse().map_err(|e| CliError::input(format!("{}: {e}", path.display())))?;
    let markers = markers_of(places);
    let table = document.entry("markers").or_insert(toml_edit::table()).as_table_mut();
    let table = table.ok_or_else(|| CliError::input(format!("{}: `markers` is not a table", path.display())).hint("write it as [markers]"))?;
    for (name, at, place) in [("m1", markers.m1, 0), ("m2", markers.m2, 1), ("m3", markers.m3, 2), ("m4", markers.m4, 3), ("m5", markers.m5, 4)] {
        let mut value = toml_edit::Value::Array(at.into_iter().collect());
        value.decor_mut().set_prefix(" ");
        value.decor_mut().set_suffix(format!("  # ± {:.5}, from a photograph", places[place].sd));
        table.insert(name, toml_edit::Item::Value(value));
    }
    Ok(document.to_string())
}

/// The photograph with a dot on every square used and a cross on every tape.
fn drawn(image: &GreyImage, sheet: &GridPhotograph, places: &[TapePlace; 5]) -> RgbImage {
    let mut out = RgbImage::from_fn(image.width as u32, image.height as u32, |x, y| {
        let g = image.get(x as usize, y as usize).unwrap_or(0);
        Rgb([g, g, g])
    });
    let mut dot = |x: f64, y: f64, colour: [u8; 3]| {
        if x >= 0.0 && y >= 0.0 && (x as u32) < out.width() && (y as u32) < out.height() {
            out.put_pixel(x as u32, y as u32, Rgb(colour));
        }
    };
    for s in &sheet.squares {
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)] {
            dot(s.x.round() + f64::from(dx), s.y.round() + f64::from(dy), [0, 170, 0]);
        }
    }
    for p in places {
        for k in -14..=14 {
            for w in -1..=1 {
                dot(p.uv[0].round() + f64::from(k), p.uv[1].round() + f64::from(w), [230, 0, 0]);
                dot(p.uv[0].round() + f64::from(w), p.uv[1].round() + f64::from(k), [230, 0, 0]);
            }
        }
    }
    out
}
