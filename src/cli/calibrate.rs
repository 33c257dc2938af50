//! `sweetspot calibrate`.

use super::Shell;
use super::error::{CliError, existing};
use super::set_aside::set_aside;
use crate::calibration::{
    AxesFrame, CalibrationError, CalibrationOptions, Checkerboard, PairViews, StereoRig, ViewFault, calibrate_views, dltdv_csv, find_corners, global_axes,
};
use crate::footage::{last_digits, numbered_images, read_grey};
use crate::provenance::Provenance;
use crate::report::{Report, sections};
use crate::session::Session;
use crate::short_list::short_list;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Checkerboard pairs to calibration.json, calibration.yml and calibration.html
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The session folder (holds session.toml)
    pub session: PathBuf,
    /// Also calibrate with the direct linear transform and its variants on the same pictures, and compare the errors
    #[arg(long)]
    pub compare_methods: bool,
    /// Take the cameras from an OpenCV FileStorage (M1 D1 M2 D2 R T image_size; T in m) instead of the checkerboards
    #[arg(long, value_name = "FILE", conflicts_with = "compare_methods")]
    pub import: Option<PathBuf>,
    /// Also write the DLT coefficients of both cameras for DLTdv and easyWand (undistorted pixels)
    #[arg(long)]
    pub dlt: bool,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let session = Session::open(existing(&arguments.session, "session folder")?)?;
    let out = shell.results_of_session(&arguments.session);
    let json = out.join("calibration.json");
    let provenance = inputs(&session, arguments.import.as_deref())?;
    if !shell.args.force
        && !arguments.compare_methods
        && !arguments.dlt
        && let Ok(rig) = StereoRig::read(&json)
        && rig.more.get("provenance").is_some_and(|p| serde_json::to_value(&provenance).is_ok_and(|q| *p == q))
    {
        shell.say(format!("{} is up to date (--force calibrates again)", json.display()));
        write_forms(&out, &session, &rig, |path| !path.exists(), shell)?;
        return shell.print_json(&rig);
    }
    let (mut rig, without_axes) = match &arguments.import {
        Some(file) => imported(&session, file, shell)?,
        None => calibrate(&session, &arguments, &provenance, shell)?,
    };
    if let Some(why) = without_axes.or_else(|| session.axes_missing.then(|| NO_FRAME_PICTURES.to_owned())) {
        advise_on_axes(&why, &mut rig);
    }
    rig.more.insert("provenance".into(), serde_json::to_value(provenance).map_err(CliError::output)?);
    shell.write(&json, rig.to_json().map_err(CliError::output)?.as_bytes())?;
    write_forms(&out, &session, &rig, |_| true, shell)?;
    if arguments.dlt {
        let text = dltdv_csv(&rig).ok_or_else(|| CliError::input("no DLT coefficients: the origin of the axes lies in a camera's own plane, where their form has none (without pictures of the three-sphere frame the origin is the left camera)").hint("give [axes] in session.toml with pictures of the frame, or use calibration.yml"))?;
        shell.write(&out.join(DLT_FILE), text.as_bytes())?;
    } else if let Some(kept) = set_aside(&out.join(DLT_FILE), "earlier")? {
        shell.say(format_args!("of the calibration before (--dlt makes them anew), kept as {}", kept.display()));
    }
    summarise(&rig, &json, shell);
    shell.print_json(&rig)
}

const DLT_FILE: &str = "dlt-coefficients.csv";

/// The calibration's other forms, for OpenCV and to look at, where they are wanted.
fn write_forms(out: &Path, session: &Session, rig: &StereoRig, wanted: impl Fn(&Path) -> bool, shell: &Shell) -> Result<(), CliError> {
    let forms: [(&str, &dyn Fn() -> String); 2] = [("calibration.yml", &|| rig.to_opencv_yaml()), ("calibration.html", &|| page(session, rig))];
    for (name, text) in forms {
        let path = out.join(name);
        if wanted(&path) {
            shell.write(&path, text().as_bytes())?;
        }
    }
    Ok(())
}

/// The pictures of one camera; a missing folder is an input error that names it.
fn pictures(folder: &Path, camera: &'static str) -> Result<BTreeMap<u64, PathBuf>, CliError> {
    let path = folder.join(camera);
    let list = numbered_images(existing(&path, "folder of checkerboard pictures")?)?;
    if list.is_empty() {
        return Err(CalibrationError::NoPictures { path, camera }.into());
    }
    Ok(list.into_iter().collect())
}

/// Pictures without a partner that an error names.
const NAMED: usize = 8;

/// Both folders hold the same number of pictures (contract, section 2): a lost or a stray picture shifts nothing, because
/// pairs go by number, but nobody should calibrate without knowing. Numbers that differ at equal counts are gaps.
fn same_number(folder: &Path, left: &BTreeMap<u64, PathBuf>, right: &BTreeMap<u64, PathBuf>) -> Result<(), CliError> {
    if left.len() == right.len() {
        return Ok(());
    }
    let alone = |these: &BTreeMap<u64, PathBuf>, others: &BTreeMap<u64, PathBuf>| -> Vec<String> {
        these.iter().filter(|(n, _)| !others.contains_key(n)).map(|(_, p)| p.display().to_string()).collect()
    };
    let mut without = alone(left, right);
    without.extend(alone(right, left));
    let counts = format!("{}: {} pictures in left/, {} in right/; allowed: the same number", folder.display(), left.len(), right.len());
    Err(CliError::input(format!("{counts}. Without a partner: {}", short_list(&without, NAMED, ", ")))
        .hint("copy the missing pictures from the camera, or move those without a partner out of the folder"))
}

fn axes_picture(folder: &Path, camera: &str) -> Result<PathBuf, CliError> {
    let unreadable = |e| CliError::input(format!("{}: cannot be read ({e})", folder.display()));
    let all = std::fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>).map_err(unreadable)?;
    let mut found: Vec<PathBuf> = all.into_iter().map(|e| e.path()).filter(|p| p.is_file() && p.file_stem().is_some_and(|s| s == camera)).collect();
    found.sort();
    match found.len() {
        1 => Ok(found.remove(0)),
        0 => Err(CliError::input(format!("{}: no picture named `{camera}`; the three-sphere frame needs left and right", folder.display()))),
        n => Err(CliError::input(format!("{}: {n} pictures named `{camera}`; keep one", folder.display()))),
    }
}

/// The calibration's own report; the session's report holds the same section.
fn page(session: &Session, rig: &StereoRig) -> String {
    Report::new(&session.name).command("calibrate").subtitle("Calibration").section(sections::calibration(rig, rig.axes_known())).finish()
}

/// Hashes of everything the calibration reads.
fn inputs(session: &Session, import: Option<&Path>) -> Result<Provenance, CliError> {
    let mut provenance = Provenance::new("calibrate").with_file(&session.root.join("session.toml")).map_err(CliError::input)?;
    if let Some(file) = import {
        provenance = provenance.with_file(existing(file, "calibration to import")?).map_err(CliError::input)?;
    }
    let boards: &[&str] = if import.is_some() { &[] } else { &["left", "right"] };
    for &camera in boards {
        for path in pictures(&session.board.images, camera)?.values() {
            // One that cannot be read is told with its pair: the others need none of it.
            let Ok(hash) = crate::provenance::sha256_file(path) else { continue };
            provenance.inputs.insert(format!("calib/{camera}/{}", path.file_name().unwrap_or_default().to_string_lossy()), hash);
        }
    }
    if let Some(axes) = &session.axes {
        for camera in ["left", "right"] {
            // What is wrong with a picture is told once the boards are done: they need none.
            let Ok(hash) = axes_picture(&axes.images, camera).and_then(|path| crate::provenance::sha256_file(&path).map_err(CliError::input)) else { continue };
            provenance.inputs.insert(format!("axes/{camera}"), hash);
        }
    }
    Ok(provenance)
}

/// The rig, and why the global axes are not the frame's where its pictures do not give them.
type RigAndAxes = (StereoRig, Option<String>);

fn calibrate(session: &Session, arguments: &Arguments, provenance: &Provenance, shell: &Shell) -> Result<RigAndAxes, CliError> {
    let board = Checkerboard { columns: session.board.columns, rows: session.board.rows, square_m: session.board.square_m };
    let (left, right) = (pictures(&session.board.images, "left")?, pictures(&session.board.images, "right")?);
    same_number(&session.board.images, &left, &right)?;
    let mut numbers: Vec<u64> = left.keys().chain(right.keys()).copied().collect();
    numbers.sort_unstable();
    numbers.dedup();

    let jobs: Vec<(&'static str, &PathBuf)> =
        numbers.iter().flat_map(|n| [("left", left.get(n)), ("right", right.get(n))]).filter_map(|(camera, path)| Some((camera, path?))).collect();
    let copies = copies(&jobs, provenance);
    let progress = shell.progress(jobs.len() as u64, "corners");
    let found = jobs
        .par_iter()
        .map(|(_, path)| {
            shell.check_cancelled()?;
            let view = match read_grey(path) {
                _ if copies.contains_key(path.as_path()) => (None, Err(ViewFault::SamePicture(copies[path.as_path()].clone()))),
                Ok(image) => (Some([image.width, image.height]), find_corners(&image, &board)?),
                Err(e) => (None, Err(ViewFault::Unreadable(e.to_string()))),
            };
            progress.inc(1);
            Ok((path.as_path(), view))
        })
        .collect::<Result<Vec<_>, CliError>>()?;
    progress.finish_and_clear();

    // One size for all: that of most readable pictures.
    let image_size = usual_size(found.iter().filter_map(|(path, (size, _))| Some((*path, (*size)?))))?.ok_or_else(|| {
        let why: Vec<String> = found.iter().filter_map(|(_, (_, view))| view.as_ref().err().map(ToString::to_string)).take(3).collect();
        CliError::input(format!("no checkerboard picture can be read: {}", why.join("; "))).hint("copy the pictures again from the cameras")
    })?;
    let by_path: BTreeMap<&Path, _> = found
        .into_iter()
        .map(|(path, (size, view))| match size.filter(|size| *size != image_size) {
            Some(size) => (path, Err(ViewFault::AnotherSize { size, usual: image_size })),
            None => (path, view),
        })
        .collect();
    let view = |path: Option<&PathBuf>| path.and_then(|p| by_path.get(p.as_path()).cloned()).unwrap_or(Err(ViewFault::NoPicture));
    let pairs: Vec<PairViews> =
        numbers.iter().map(|n| PairViews { name: pair_name(*n, left.get(n).or(right.get(n))), left: view(left.get(n)), right: view(right.get(n)) }).collect();

    let calibration = calibrate_views(&board, image_size, &pairs, &CalibrationOptions::default())?;
    let mut rig = calibration.rig();
    rig.more.insert(crate::calibration::BOARDS_KEY.into(), serde_json::to_value(calibration.board_reports()).map_err(CliError::output)?);
    rig.more.extend(calibration.details().map_err(CliError::output)?);
    let without_axes = lay_axes(session, &mut rig, shell);
    calibration.add_quality(&mut rig).map_err(CliError::output)?;
    if arguments.compare_methods {
        let methods = calibration.compare_methods();
        shell.say("lengths on boards held out (mm):              mean     max   in the pictures (px)");
        for m in &methods {
            shell.say(format!("  {:42} {:7.3} {:7.3}   {:.3}", m.method, m.mean_error_mm, m.max_error_mm, m.rms_px));
        }
        rig.more.insert("methods".into(), serde_json::to_value(methods).map_err(CliError::output)?);
    }
    Ok((rig, without_axes))
}

/// The size that most pictures have. A stray one is left out with its reason; where no size has more than half of them, which are the
/// strays would be a guess.
fn usual_size<'a>(pictures: impl Iterator<Item = (&'a Path, [usize; 2])> + Clone) -> Result<Option<[usize; 2]>, CalibrationError> {
    let mut counts: BTreeMap<[usize; 2], usize> = BTreeMap::new();
    pictures.clone().for_each(|(_, size)| *counts.entry(size).or_default() += 1);
    let all: usize = counts.values().sum();
    let Some((&usual, &most)) = counts.iter().max_by_key(|(_, count)| **count) else { return Ok(None) };
    if 2 * most > all {
        return Ok(Some(usual));
    }
    let first = pictures.clone().next().map_or(usual, |(_, size)| size);
    let Some((path, [width, height])) = pictures.clone().find(|(_, size)| *size != first) else { return Ok(Some(usual)) };
    Err(CalibrationError::PictureSize { name: path.display().to_string(), width, height, expected_width: first[0], expected_height: first[1] })
}

/// Pictures that are byte for byte an earlier one, and which: a copy is no evidence, and a right picture that is the left one shows no depth.
fn copies<'a>(pictures: &[(&'static str, &'a PathBuf)], provenance: &Provenance) -> BTreeMap<&'a Path, String> {
    let mut first: BTreeMap<&str, String> = BTreeMap::new();
    let mut copies = BTreeMap::new();
    for (camera, path) in pictures {
        let name = format!("{camera}/{}", path.file_name().unwrap_or_default().to_string_lossy());
        let Some(hash) = provenance.inputs.get(&format!("calib/{name}")) else { continue };
        match first.entry(hash) {
            std::collections::btree_map::Entry::Occupied(earlier) => {
                copies.insert(path.as_path(), earlier.get().clone());
            }
            std::collections::btree_map::Entry::Vacant(place) => {
                place.insert(name);
            }
        }
    }
    copies
}

const NO_FRAME_PICTURES: &str = "no pictures of the three-sphere frame where session.toml has them";

/// The global axes from the three-sphere frame, where the session has pictures of it. Pictures that do not give them leave the axes the left
/// camera's, as no pictures do (contract, section 2): what the boards gave is not lost. Says why.
fn lay_axes(session: &Session, rig: &mut StereoRig, shell: &Shell) -> Option<String> {
    let why = found_axes(session, rig).err()?.message;
    shell.warn(format_args!("warning: no global axes: {why}"));
    Some(why)
}

fn found_axes(session: &Session, rig: &mut StereoRig) -> Result<(), CliError> {
    if let Some(axes) = &session.axes {
        let images = [read_grey(&axes_picture(&axes.images, "left")?)?, read_grey(&axes_picture(&axes.images, "right")?)?];
        let frame = AxesFrame { arm_u_m: axes.arm_u_m, arm_w_m: axes.arm_w_m };
        let (global_from_left, report) =
            global_axes(rig, &images[0], &images[1], &frame).map_err(|e| CliError::input(format!("{}: {e}", axes.images.display())))?;
        let report = serde_json::to_value(report).map_err(CliError::output)?;
        rig.global_from_left = global_from_left;
        rig.more.insert("axes".into(), report);
    }
    Ok(())
}

/// Says in the calibration's advice why the global axes are not the frame's.
fn advise_on_axes(why: &str, rig: &mut StereoRig) {
    if let Some(list) = rig.more.entry("advice".to_owned()).or_insert_with(|| serde_json::json!([])).as_array_mut() {
        list.push(format!("{why}: the global axes are the left camera's, and nothing knows what is up").into());
    }
}

/// Cameras of another program: without covariance, so that points carry the pixels' uncertainty only.
fn imported(session: &Session, file: &Path, shell: &Shell) -> Result<RigAndAxes, CliError> {
    let mut rig = StereoRig::read_opencv_yaml(existing(file, "calibration to import")?)?;
    let without_axes = lay_axes(session, &mut rig, shell);
    let advice = "cameras imported from another program: their own uncertainty is not known, and no interval holds it";
    rig.more.insert("advice".into(), serde_json::json!([advice]));
    Ok((rig, without_axes))
}

/// The number as the file name shows it, leading zeros included.
fn pair_name(number: u64, path: Option<&PathBuf>) -> String {
    let stem = path.and_then(|p| p.file_stem()).map(|s| s.to_string_lossy());
    let shown = stem.as_deref().and_then(last_digits).filter(|shown| shown.parse() == Ok(number));
    shown.map_or_else(|| number.to_string(), str::to_owned)
}

fn summarise(rig: &StereoRig, json: &Path, shell: &Shell) {
    let used = rig.pairs.iter().filter(|p| p.used).count();
    if !rig.pairs.is_empty() {
        shell.say(format!("{used} of {} pairs used; {:.3} px left, {:.3} px right", rig.pairs.len(), rig.left.rms_px, rig.right.rms_px));
    }
    if let Some(s) = &rig.square_mm {
        shell.say(format!("squares on boards held out: {:.3} mm, sd {:.3} mm ({} sides)", s.mean, s.sd, s.n));
    }
    let number = |key: &str| rig.more.get("volume").and_then(|v| v.get(key)).and_then(serde_json::Value::as_f64);
    if let (Some(rms), Some(worst)) = (number("rms_calibration_mm"), number("worst_calibration_mm")) {
        shell.say(format!("a point in the 2 m cube around the boards' middle: {rms:.2} mm rms from the calibration alone, {worst:.2} mm at worst"));
    }
    let texts = |value: Option<&serde_json::Value>| value.and_then(|a| serde_json::from_value::<Vec<String>>(a.clone()).ok()).unwrap_or_default();
    for line in texts(rig.more.get("axes").and_then(|a| a.get("warnings"))) {
        shell.say(format!("  warning: axes: {line}"));
    }
    for line in texts(rig.more.get("advice")) {
        shell.say(format!("  advice: {line}"));
    }
    for p in rig.pairs.iter().filter(|p| !p.used) {
        shell.say(format!("  pair {}: {}", p.name, p.reason));
    }
    shell.say(format!("written: {}", json.display()));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_stray_size_is_left_out_and_of_two_as_frequent_ones_none_is_usual() {
        let of = |sizes: &[[usize; 2]]| usual_size(sizes.iter().map(|size| (Path::new("left/a_1.bmp"), *size)));
        let (small, large) = ([512, 512], [1024, 512]);
        assert_eq!(of(&[large, small, small]).expect("most are small"), Some(small));
        assert_eq!(of(&[small]).expect("one"), Some(small));
        assert_eq!(of(&[]).expect("none"), None);
        let refused = of(&[small, large]).expect_err("a guess").to_string();
        assert!(refused.contains("1024x512") && refused.contains("512x512"), "{refused}");
        assert!(of(&[small, large, [512, 1024]]).is_err(), "no size has more than half");
    }

    #[test]
    fn law_a_picture_of_the_same_bytes_as_an_earlier_one_is_its_copy() {
        let files: Vec<PathBuf> = ["left/a_1.bmp", "right/a_1.bmp", "left/a_2.bmp", "right/a_2.bmp"].map(PathBuf::from).into();
        let pictures: Vec<(&'static str, &PathBuf)> = ["left", "right", "left", "right"].into_iter().zip(&files).collect();
        let mut provenance = Provenance::new("calibrate");
        for (file, hash) in files.iter().zip(["one", "two", "one", "three"]) {
            provenance.inputs.insert(format!("calib/{}", file.display()), hash.to_owned());
        }
        assert_eq!(copies(&pictures, &provenance), BTreeMap::from([(files[2].as_path(), "left/a_1.bmp".to_owned())]));
    }

    #[test]
    fn truth_a_pair_is_called_by_its_number_as_the_file_shows_it() {
        let name = |number: u64, file: &str| pair_name(number, Some(&PathBuf::from(file)));
        assert_eq!((name(7, "board_007.bmp"), name(7, "cam2_7.tif"), name(7, "x.0007")), ("007".to_owned(), "7".to_owned(), "7".to_owned()));
        assert_eq!(pair_name(12, None), "12");
    }
}
