//! `sweetspot track`.

use super::Shell;
use super::error::{CliError, with_reasons};
use super::set_aside::{listed, remove_if_there, set_all_aside, set_aside};
use super::tracked_session::{refuse_no_place, rig_to_measure_with, warn_of_old_calibration};
use crate::calibration::{CameraId, StereoRig};
use crate::equipment::Markers;
use crate::footage::{Clip, FrameBuffer, FrameSource, Rows};
use crate::kinematics::{SHOT_FILE, ShotRecord};
use crate::limited_file::{LARGEST_TABLE, LimitedFile};
use crate::provenance::{Provenance, ends_with_line, holds, sha256_file, sha256_hex};
use crate::session::{Session, ShotFolder};
use crate::short_list::short_list;
use crate::tracking::spin::{SPIN_FILE, spin_to_json};
use crate::tracking::{
    Overlay, PointState, ShotSetup, ShotSummary, SyncMode, TRACK_FILE, TrackExport, TrackRecord, TrackingError, Tracks, c3d_bytes, dltdv_tables, measure_spin,
    points_to_csv, read_points, track_in_step,
};
use indicatif::ProgressBar;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{LazyLock, Mutex};

/// Footage to tracks.csv, points.csv and spin.json
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The session folder (holds session.toml)
    pub session: PathBuf,
    /// Only this shot (may be given more than once)
    #[arg(long, value_name = "ID")]
    pub shot: Vec<String>,
    /// Write the tracks for other programs too: DLTdv's CSV tables, a C3D file
    #[arg(long, value_name = "FORMAT", value_delimiter = ',')]
    pub export: Vec<ExportFormat>,
    /// Write PNG contact sheets with the tracks drawn in, of every N-th frame (default: about 20 frames in all)
    #[arg(long, value_name = "N", num_args = 0..=1, require_equals = true, default_missing_value = "0")]
    pub overlay: Option<usize>,
    /// What to do about cameras that are whole frames out of step
    #[arg(long, value_enum, default_value = "report")]
    pub sync: Sync,
    /// Leave the ball's spin out
    #[arg(long)]
    pub no_spin: bool,
}

const C3D_FILE: &str = "points.c3d";

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum ExportFormat {
    /// dltdv_xypts.csv, dltdv_xyzpts.csv, dltdv_xyzres.csv, dltdv_offsets.csv
    Dltdv,
    /// points.c3d
    C3d,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Sync {
    /// Say so
    Report,
    /// Pair the pictures anew
    Auto,
}

/// What `--export` and `--overlay` write of a shot.
const EXPORTS: [&str; 7] = ["dltdv_xypts.csv", "dltdv_xyzpts.csv", "dltdv_xyzres.csv", "dltdv_offsets.csv", C3D_FILE, "overlay_left.png", "overlay_right.png"];
/// Most shots tracked at a time: each holds some tens of megabytes.
const MOST_AT_ONCE: usize = 16;
/// Pairs of pictures of which something is read to tell one recording from another, and how much of each, bytes.
const SAMPLED: usize = 5;
const SAMPLED_BYTES: u64 = 512;

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    // On one of the threads that share the work: each of a score of shared steps would have to wake one first.
    rayon::scope(|_| track(arguments, shell))
}

fn track(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let session = Session::open(&arguments.session)?;
    let shots = session.select(&arguments.shot)?;
    if shots.is_empty() && session.broken_shots.is_empty() {
        return Err(CliError::no_shots(&arguments.session));
    }
    let results = shell.results_of_session(&arguments.session);
    let rig_file = results.join("calibration.json");
    let list = |shot: &ShotFolder| Clip::list(&shot.camera("left"), &shot.camera("right"));
    let hash = || sha256_file(&rig_file).map_err(CliError::input);
    // The first shot's folders are listed meanwhile.
    let (rig, (rig_hash, listed)) = rayon::join(|| rig_to_measure_with(&rig_file), || rayon::join(hash, || shots.first().map(|shot| list(shot))));
    let (rig, rig_hash) = (rig?, rig_hash?);
    warn_of_old_calibration(&session, &rig, &rig_file, shell);
    let bar = shell.progress(0, "tracking");
    let (next, stop, listed) = (AtomicUsize::new(0), AtomicBool::new(false), Mutex::new(listed));
    let outcomes = Mutex::new(Outcomes::default());
    // Each of several shots mostly keeps to one core; whoever has no shot left helps with those of the others.
    let lane = || {
        while !stop.load(Ordering::Relaxed) && shell.check_cancelled().is_ok() {
            let at = next.fetch_add(1, Ordering::Relaxed);
            let Some(shot) = shots.get(at) else { break };
            let folder = results.join("shots").join(&shot.id);
            let first = listed.lock().ok().filter(|_| at == 0).and_then(|mut listed| listed.take());
            let clip = first.unwrap_or_else(|| list(shot));
            let mut said = Said::default();
            let made = clip.map_err(Failure::from).and_then(|clip| {
                let summary = one(&arguments, &session, shot, clip, (&rig, &rig_hash), &folder, (shell, &bar, &mut said))?;
                Ok((for_others(&arguments, &session, shot, &rig, summary.right_shift, &folder, shell), summary))
            });
            if matches!(made, Err(Failure::All(_))) {
                stop.store(true, Ordering::Relaxed);
            }
            if let Ok(mut outcomes) = outcomes.lock() {
                bar.suspend(|| outcomes.add(at, &shot.id, made, said, shell));
            }
        }
    };
    rayon::scope(|threads| {
        (1..shots.len().min(rayon::current_num_threads()).min(MOST_AT_ONCE)).for_each(|_| threads.spawn(|_| lane()));
        lane();
    });
    bar.finish_and_clear();
    shell.check_cancelled()?;
    let outcomes = outcomes.into_inner().unwrap_or_default();
    if let Some(e) = outcomes.ended {
        return Err(e);
    }
    let (summaries, failed): (Vec<ShotSummary>, Vec<Vec<(String, String)>>) = outcomes.done.into_values().unzip();
    let broken = session.broken_shots.iter().filter(|_| arguments.shot.is_empty()).cloned();
    let failed: Vec<(String, String)> = broken.chain(failed.into_iter().flatten()).collect();
    shell.print_json(&summaries)?;
    if failed.is_empty() {
        return Ok(());
    }
    Err(CliError::some_failed(with_reasons(&failed, "\n")).of_shots(failed))
}

/// What is to be said of a shot.
#[derive(Default)]
struct Said {
    /// What nobody should miss.
    warnings: Vec<String>,
    lines: Vec<String>,
}

impl Said {
    fn push(&mut self, line: String) {
        self.lines.push(line);
    }
}

/// What became of the shots, by their place in the session.
#[derive(Default)]
struct Outcomes {
    /// Summaries, and what failed, by the shot's id, to be said in the end.
    done: BTreeMap<usize, (ShotSummary, Vec<(String, String)>)>,
    /// What was said of shots before which others are not done yet.
    waiting: BTreeMap<usize, Said>,
    /// Shots of which everything was said.
    said: usize,
    /// Why the command ends early.
    ended: Option<CliError>,
}

impl Outcomes {
    /// Notes what became of a shot, and says what can be said in the session's order.
    fn add(&mut self, at: usize, id: &str, made: Result<(Result<(), CliError>, ShotSummary), Failure>, mut said: Said, shell: &Shell) {
        match made {
            Ok((for_others, summary)) => {
                let failed = for_others.err().map(|e| e.message);
                said.lines.extend(failed.iter().map(|why| format!("{id}: {why}")));
                // The shot is measured all the same, but nobody should find out by chance that a picture is broken.
                let unreadable = summary.unreadable.iter().map(|why| format!("{why}; it counts as missing until it is mended"));
                let failed = failed.into_iter().chain(unreadable).map(|why| (id.to_owned(), why)).collect();
                self.done.insert(at, (summary, failed));
            }
            Err(Failure::Shot(TrackingError::Cancelled)) => self.ended = Some(CliError::interrupted()),
            Err(Failure::Shot(e)) => {
                said.push(format!("{id}: {e}"));
                let summary = ShotSummary { id: id.to_owned(), error: Some(e.to_string()), ..ShotSummary::default() };
                self.done.insert(at, (summary, vec![(id.to_owned(), e.to_string())]));
            }
            Err(Failure::All(e)) => self.ended = Some(e),
        }
        self.waiting.insert(at, said);
        while let Some(said) = self.waiting.remove(&self.said) {
            said.warnings.iter().for_each(|line| shell.warn(line));
            said.lines.iter().for_each(|line| shell.say(line));
            self.said += 1;
        }
    }
}

/// A shot that cannot be tracked leaves the others to go on; results that cannot be written end the command.
enum Failure {
    Shot(TrackingError),
    All(CliError),
}

impl<E: Into<TrackingError>> From<E> for Failure {
    fn from(e: E) -> Self {
        Failure::Shot(e.into())
    }
}

/// Why a shot cannot be tracked: what stopped it, with the pictures of either camera that cannot be read, if any.
fn with_unreadable(clip: &Clip, without: TrackingError) -> TrackingError {
    let mut buffer = FrameBuffer::default();
    let (mut lines, mut blind) = (Vec::new(), false);
    for camera in CameraId::BOTH {
        let (name, place) = (camera.name(), camera.index());
        let there = clip.pairs.iter().filter(|pair| pair.files[place].is_some()).count();
        let whys: Vec<String> = (0..clip.len()).filter_map(|index| clip.read(index, place, Rows::ALL, &mut buffer).err()).map(|e| e.to_string()).collect();
        let Some(first) = whys.first() else { continue };
        lines.push(if whys.len() == there {
            format!("{name} camera: none of its {there} pictures can be read, the first: {first}")
        } else {
            format!("{name} camera: {} of its {there} pictures cannot be read, the first: {first}", whys.len())
        });
        blind |= whys.len() == there;
    }
    match lines.join("; ") {
        none if none.is_empty() => without,
        // What no pair of pictures shows says nothing of the racket.
        pictures if blind => TrackingError::NoCamera { pictures },
        pictures => TrackingError::Unreadable { pictures, without: without.to_string() },
    }
}

/// Tracks one shot and writes what was found, unless an earlier run has done so from the same input.
fn one(
    arguments: &Arguments,
    session: &Session,
    shot: &ShotFolder,
    clip: Clip,
    rig: (&StereoRig, &str),
    folder: &Path,
    (shell, bar, said): (&Shell, &ProgressBar, &mut Said),
) -> Result<ShotSummary, Failure> {
    refuse_no_place(folder)?;
    let provenance = LazyLock::new(|| provenance(session, shot, rig.1, &clip));
    if !shell.args.force {
        let record = TrackRecord::read(folder);
        if record.as_ref().is_some_and(|r| still_holds(r, arguments, folder, &provenance, &clip)) {
            said.push(format!("{}: already tracked (--force tracks again)", shot.id));
            return Ok(record.map(|r| r.summary).unwrap_or_default());
        }
        if let Some(summary) = by_hand(&shot.id, record, folder) {
            said.push(format!("{}: {}", shot.id, summary.notes.join("; ")));
            return Ok(summary);
        }
    }
    bar.inc_length(clip.pairs.len() as u64);
    let setup = ShotSetup { rig: rig.0, racket: &shot.racket, ball: &shot.ball, frame_rate_hz: session.frame_rate_hz };
    let mode = if arguments.sync == Sync::Auto { SyncMode::Auto } else { SyncMode::Report };
    let (made, manual) =
        rayon::join(|| track_in_step(&clip, &setup, mode, shell.cancel_flag(), &|n| bar.inc(n as u64)), || look_at_earlier(&shot.id, folder, said));
    let manual = manual?;
    let mut made = match made {
        Ok(made) => made,
        Err(TrackingError::Cancelled) => return Err(TrackingError::Cancelled.into()),
        Err(e) => {
            set_earlier_aside(&shot.id, folder, said).map_err(Failure::All)?;
            return Err(with_unreadable(&clip, e).into());
        }
    };
    let spin = if arguments.no_spin { None } else { Some(measure_spin(&made.clip, &setup, &mut made.tracked)?) };
    let tracked = &made.tracked;
    let summary = ShotSummary::of(&shot.id, &setup, &made, [clip.gap_notes(), clip.depth_notes()].concat());
    said.push(format!("{}: {} points measured, {} occluded, in {} frames", shot.id, summary.measured, summary.occluded, summary.frames));
    said.lines.extend(summary.notes.iter().map(|note| format!("{}: {note}", shot.id)));
    if spin.is_none() {
        // An earlier run's spin does not belong to these tracks.
        remove_if_there(&folder.join(SPIN_FILE)).map_err(Failure::All)?;
    }
    keep_by_hand(&shot.id, manual, folder, said).map_err(Failure::All)?;
    let spin = spin.map(|s| (SPIN_FILE, spin_to_json(&s)));
    let write = |name: &str, text: &str| shell.write_soon(&folder.join(name), text.as_bytes()).map_err(Failure::All);
    let (points, (tracks, provenance)) = rayon::join(
        || write("points.csv", &points_to_csv(&tracked.points)),
        || {
            let tracks = || {
                let text = tracked.tracks.to_csv();
                set_exports_aside(arguments, &shot.id, folder, &text, said).map_err(Failure::All)?;
                write("tracks.csv", &text).and_then(|()| spin.map_or(Ok(()), |(name, text)| write(name, &text)))
            };
            rayon::join(tracks, || (*provenance).clone())
        },
    );
    points.and(tracks)?;
    let record = TrackRecord { summary, provenance };
    let json = serde_json::to_string_pretty(&record).map_err(|e| Failure::All(CliError::output(e)))? + "\n";
    // track.json last: it says that the others are whole.
    write(TRACK_FILE, &json)?;
    Ok(record.summary)
}

/// What was exported of other tracks, and is not made anew now, is an earlier run's.
fn set_exports_aside(arguments: &Arguments, id: &str, folder: &Path, tracks: &str, said: &mut Said) -> Result<(), CliError> {
    let asked = |name: &str| {
        let of = |format| arguments.export.contains(&format);
        match name {
            C3D_FILE => of(ExportFormat::C3d),
            _ if name.starts_with("dltdv_") => of(ExportFormat::Dltdv),
            _ => arguments.overlay.is_some(),
        }
    };
    let left: Vec<&str> = EXPORTS.into_iter().filter(|name| !asked(name) && folder.join(name).exists()).collect();
    if left.is_empty() || holds(&folder.join("tracks.csv"), tracks.as_bytes()) {
        return Ok(());
    }
    let kept = set_all_aside(folder, &left)?;
    let names: Vec<String> = kept.iter().filter_map(|file| Some(file.file_name()?.to_string_lossy().into_owned())).collect();
    said.push(format!("{id}: exported from the tracks before, kept as {}", short_list(&names, 2, ", ")));
    Ok(())
}

/// Points in space follow a correction by hand only once `shots` has measured it.
fn points_are_of_tracks(folder: &Path) -> Result<(), CliError> {
    let [tracks, points] = ["tracks.csv", "points.csv"].map(|name| folder.join(name));
    let by_hand = points_by_hand(&Tracks::read(&tracks)?) > 0;
    let hash = |path: &Path| sha256_file(path).map_err(CliError::input);
    if !by_hand {
        return Ok(());
    }
    let (of_tracks, of_points) = (hash(&tracks)?, hash(&points)?);
    let measured = ShotRecord::read(&folder.join(SHOT_FILE)).is_ok_and(|r| r.provenance.inputs.get("tracks.csv") == Some(&of_tracks) && r.points == of_points);
    if measured {
        return Ok(());
    }
    Err(CliError::input(format!("{}: from before the correction by hand in tracks.csv", points.display()))
        .hint("run `sweetspot shots` first, then export again"))
}

/// Writes what `--export` and `--overlay` ask for, from the tables on disk: a fresh run's or an earlier one's.
fn for_others(
    arguments: &Arguments,
    session: &Session,
    shot: &ShotFolder,
    rig: &StereoRig,
    right_shift: i64,
    folder: &Path,
    shell: &Shell,
) -> Result<(), CliError> {
    if arguments.export.is_empty() && arguments.overlay.is_none() {
        return Ok(());
    }
    if !arguments.export.is_empty() {
        points_are_of_tracks(folder)?;
    }
    let tracks = Tracks::read(&folder.join("tracks.csv")).map_err(CliError::input)?;
    let points = read_points(&folder.join("points.csv")).map_err(CliError::input)?;
    let clip = Clip::list(&shot.camera("left"), &shot.camera("right")).map_err(CliError::input)?.shifted(right_shift);
    let (Some(first), Some(last)) = (clip.pairs.first(), clip.pairs.last()) else { return Ok(()) };
    let export = TrackExport { tracks: &tracks, points: &points, rig, frame_rate_hz: session.frame_rate_hz, frames: first.number..=last.number };
    for format in &arguments.export {
        match format {
            ExportFormat::Dltdv => {
                for (name, table) in dltdv_tables(&export).map_err(CliError::input)? {
                    shell.write(&folder.join(format!("dltdv_{name}")), table.as_bytes())?;
                }
            }
            ExportFormat::C3d => shell.write(&folder.join(C3D_FILE), &c3d_bytes(&export).map_err(CliError::input)?)?,
        }
    }
    if let Some(every) = arguments.overlay {
        let overlay = Overlay { tracks: &tracks, points: &points, rig, markers: shot.racket.markers.as_ref().map(Markers::points) };
        for camera in CameraId::BOTH {
            let Some(sheet) = overlay.sheet(&clip, camera, every).map_err(CliError::input)? else { continue };
            let mut png = std::io::Cursor::new(Vec::new());
            sheet.write_to(&mut png, image::ImageFormat::Png).map_err(CliError::output)?;
            shell.write(&folder.join(format!("overlay_{}.png", camera.name())), png.get_ref())?;
        }
    }
    Ok(())
}

/// Writes `points.c3d` anew, if there is one, when `shots` has measured the shot's points and its first contact better.
pub(super) fn renew_c3d(session: &Session, shot: &ShotFolder, rig: &StereoRig, folder: &Path, shell: &Shell) -> Result<(), CliError> {
    let file = folder.join(C3D_FILE);
    if !file.exists() {
        return Ok(());
    }
    let (tracks, points) =
        (Tracks::read(&folder.join("tracks.csv")).map_err(CliError::input)?, read_points(&folder.join("points.csv")).map_err(CliError::input)?);
    // The pictures may have been put away since.
    let clip = Clip::list(&shot.camera("left"), &shot.camera("right"));
    let shift = TrackRecord::read(folder).map_or(0, |record| record.summary.right_shift);
    let frames = clip.map_or_else(|_| tracks.frames().into_iter().collect(), |clip| clip.shifted(shift).pairs.iter().map(|p| p.number).collect::<Vec<_>>());
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else { return Ok(()) };
    let export = TrackExport { tracks: &tracks, points: &points, rig, frame_rate_hz: session.frame_rate_hz, frames: *first..=*last };
    shell.write(&file, &c3d_bytes(&export).map_err(CliError::input)?)
}

/// What tracking depends on. Pictures stand by name and size: reading them all again would cost more than tracking does
/// ([`still_holds`] looks at their times as well).
fn provenance(session: &Session, shot: &ShotFolder, rig_hash: &str, clip: &Clip) -> Provenance {
    let mut provenance = Provenance::new("track");
    let mut frames = String::new();
    for (index, pair) in clip.pairs.iter().enumerate() {
        for (camera, path) in pair.files.iter().enumerate().filter_map(|(camera, path)| Some((camera, path.as_ref()?))) {
            let size = clip.known_length(index, camera).unwrap_or_else(|| std::fs::metadata(path).map_or(0, |m| m.len()));
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let camera = path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
            // Writing to a string does not fail.
            writeln!(frames, "{camera}/{name} {size}").unwrap_or_default();
        }
    }
    // Recordings of one length have files of one size under one and the same name: what stands in some of them tells two apart.
    let spread = |k: usize| clip.pairs.get(k * clip.pairs.len().saturating_sub(1) / (SAMPLED - 1));
    for path in (0..SAMPLED).filter_map(spread).flat_map(|pair| pair.files.iter().flatten()) {
        let bytes = middle_of(path).unwrap_or_default();
        writeln!(frames, "{}", sha256_hex(&bytes)).unwrap_or_default();
    }
    let settings = format!("{:?}", (&shot.racket, &shot.ball, session.frame_rate_hz));
    provenance.inputs.insert("calibration.json".into(), rig_hash.to_owned());
    provenance.inputs.insert("names and sizes of the pictures, and some of their bytes".into(), sha256_hex(frames.as_bytes()));
    provenance.inputs.insert("settings".into(), sha256_hex(settings.as_bytes()));
    provenance
}

/// Bytes from the middle of a file: no two pictures of a camera have the same noise there.
fn middle_of(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut file = std::fs::File::open(path)?;
    let middle = file.metadata()?.len() / 2;
    file.seek(std::io::SeekFrom::Start(middle))?;
    let mut bytes = Vec::new();
    file.take(SAMPLED_BYTES).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn points_by_hand(tracks: &Tracks) -> usize {
    tracks.points.iter().filter(|p| p.state == PointState::Manual).count()
}

/// Keeps tracks of which somebody has corrected `manual` points under another name, now that the others are about to take their place (`--force`).
fn keep_by_hand(id: &str, manual: usize, folder: &Path, said: &mut Said) -> Result<(), CliError> {
    if manual > 0
        && let Some(kept) = set_aside(&folder.join("tracks.csv"), "manual")?
    {
        said.warnings
            .push(format!("{id}: the tracks with {manual} points corrected by hand are kept as {}; --force tracked anew without them", kept.display()));
    }
    Ok(())
}

/// Tracks somebody has corrected are not overwritten, whatever has changed since: an hour of digitising is worth more.
/// How their pictures are paired is what an earlier run found.
fn by_hand(id: &str, record: Option<TrackRecord>, folder: &Path) -> Option<ShotSummary> {
    let tracks = Tracks::read(&folder.join("tracks.csv")).ok()?;
    let count = |state: PointState| tracks.points.iter().filter(|p| p.state == state).count();
    let (manual, measured, occluded) = (points_by_hand(&tracks), count(PointState::Measured), count(PointState::Occluded));
    let note = format!("tracks.csv holds {manual} points corrected by hand and is kept (--force tracks again and keeps it under another name)");
    let ShotSummary { right_shift, out_of_step, doubt, .. } = record.map(|r| r.summary).unwrap_or_default();
    let frames = tracks.frames().len();
    (manual > 0).then(|| ShotSummary {
        id: id.to_owned(),
        frames,
        measured: measured + manual,
        occluded,
        right_shift,
        out_of_step,
        doubt,
        notes: vec![note],
        ..ShotSummary::default()
    })
}

/// How many points of the tracks that are there somebody has corrected by hand. A table that cannot be read may be somebody's work of an hour,
/// saved by a program that writes tables otherwise: it is kept under another name. What a power failure left of one, nothing or zeros, is nobody's.
fn look_at_earlier(id: &str, folder: &Path, said: &mut Said) -> Result<usize, Failure> {
    let file = folder.join("tracks.csv");
    let mut bytes = Vec::new();
    match LimitedFile::open(&file, LARGEST_TABLE).and_then(|mut file| file.read_to_end(&mut bytes)) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(0),
        // It may hold points corrected by hand, and would be written over.
        Err(source) => return Err(TrackingError::Earlier { path: file, source }.into()),
        Ok(_) if bytes.iter().all(|b| *b == 0) => return Ok(0),
        Ok(_) => {}
    }
    match Tracks::read(&file) {
        Ok(tracks) => Ok(points_by_hand(&tracks)),
        Err(why) => {
            if let Some(kept) = set_aside(&file, "unreadable").map_err(Failure::All)? {
                said.push(format!("{id}: {why}; it is kept as {}, and the shot is tracked anew", kept.display()));
            }
            Ok(0)
        }
    }
}

/// Tracks of an earlier run are of other pictures or settings than those that just failed, and must not be measured in their place.
fn set_earlier_aside(id: &str, folder: &Path, said: &mut Said) -> Result<(), CliError> {
    let mut kept = set_all_aside(folder, &["tracks.csv", "points.csv"])?;
    kept.extend(set_all_aside(folder, &EXPORTS)?);
    for name in [TRACK_FILE, SPIN_FILE, SHOT_FILE] {
        remove_if_there(&folder.join(name))?;
    }
    if !kept.is_empty() {
        said.push(format!("{id}: the tracks of an earlier run are not this one's; they are kept as {}", listed(&kept)));
    }
    Ok(())
}

/// Whether an earlier run had the same input, wrote what is asked for now, and no picture is younger than its result.
fn still_holds(record: &TrackRecord, arguments: &Arguments, folder: &Path, provenance: &Provenance, clip: &Clip) -> bool {
    let time = |path: &Path| std::fs::metadata(path).and_then(|m| m.modified()).ok();
    let Some(written) = time(&folder.join(TRACK_FILE)) else { return false };
    // A camera's clock that runs ahead of this one makes no picture younger for ever.
    let now = std::time::SystemTime::now();
    let younger = |path: &PathBuf| time(path).is_none_or(|t| t > written && t <= now);
    let whole = [SPIN_FILE, "points.csv", "tracks.csv"].iter().all(|name| *name == SPIN_FILE && arguments.no_spin || ends_with_line(&folder.join(name)));
    let settled = arguments.sync == Sync::Report || !record.summary.out_of_step;
    // A picture that could not be read then may be readable now.
    let all_read = record.summary.unreadable.is_empty();
    whole && settled && all_read && record.provenance == *provenance && !clip.pairs.iter().flat_map(|p| p.files.iter().flatten()).any(younger)
}
