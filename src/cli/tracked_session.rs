//! What `track`, `shots` and `explore frame-rate` share: a session with its calibration, and how its shots are measured.

use super::Shell;
use super::error::CliError;
use crate::calibration::{CalibrationError, StereoRig};
use crate::equipment::Racket;
use crate::kinematics::{AirSeen, BalanceSeen, MeasureSettings, SHOT_FILE, ShotMotion, TapeErrors, evenly, measure_motion};
use crate::provenance::sha256_file;
use crate::session::{Session, ShotFolder};
use crate::tracking::spin::SPIN_FILE;
use crate::tracking::{RacketFigure, TRACK_FILE, Throat, TrackRecord, TrackingError, Tracks};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The rig of an earlier `sweetspot calibrate`, checked.
pub fn read_rig(file: &Path) -> Result<StereoRig, CliError> {
    StereoRig::read(file).map_err(hinted)
}

/// The same without the file's reports, which tracking has no use for.
pub fn rig_to_measure_with(file: &Path) -> Result<StereoRig, CliError> {
    StereoRig::read_to_measure_with(file).map_err(hinted)
}

/// Says when session.toml is not the one that the calibration was made from. Which of its lines changed nobody has written down: board, arms or only a name.
pub fn warn_of_old_calibration(session: &Session, rig: &StereoRig, file: &Path, shell: &Shell) {
    let settings = session.root.join("session.toml");
    let made_from = rig.more.get("provenance").and_then(|p| p.get("inputs")?.get("session.toml")?.as_str());
    if let (Some(then), Ok(now)) = (made_from, sha256_file(&settings))
        && then != now
    {
        shell.warn(format_args!(
            "note: {} has changed since the calibration ({}); if it was the board or the axes' frame, run `sweetspot calibrate SESSION` first",
            settings.display(),
            file.display()
        ));
    }
}

fn hinted(e: CalibrationError) -> CliError {
    CliError::from(e).hint("run `sweetspot calibrate SESSION` first; with --force it writes the file anew")
}

/// Refuses what stands where a shot's folder of results belongs and is no folder, or where a file in it belongs and is none (a folder, a pipe): that shot
/// has no place, the others have theirs.
pub fn refuse_no_place(place: &Path) -> Result<(), TrackingError> {
    let Ok(folder) = std::fs::symlink_metadata(place) else { return Ok(()) };
    if !folder.is_dir() && !place.is_dir() {
        return Err(TrackingError::NoPlace { path: place.to_path_buf() });
    }
    // A link is replaced, whatever it leads to. Tracks may be somebody's work, and are read first.
    let taken = |path: &PathBuf| std::fs::symlink_metadata(path).is_ok_and(|m| !m.is_file() && !m.is_symlink());
    match ["points.csv", SPIN_FILE, TRACK_FILE, SHOT_FILE].map(|name| place.join(name)).into_iter().find(taken) {
        Some(path) => Err(TrackingError::NoFile { path }),
        None => Ok(()),
    }
}

/// Shots per racket that are asked what all share.
const FIRST_LOOKS: usize = 96;

/// A session whose shots have been tracked.
pub struct TrackedSession {
    pub session: Session,
    pub results: PathBuf,
    pub rig: StereoRig,
    /// By the racket's name.
    tapes: BTreeMap<String, TapeErrors>,
    pub balances: BTreeMap<String, BalanceSeen>,
    air: AirSeen,
}

impl TrackedSession {
    pub fn open(folder: &Path, shell: &Shell) -> Result<Self, CliError> {
        let session = Session::open(folder)?;
        let results = shell.results_of_session(folder);
        let rig_file = results.join("calibration.json");
        let rig = read_rig(&rig_file)?;
        warn_of_old_calibration(&session, &rig, &rig_file, shell);
        let tapes = tapes(&session, &rig, &results);
        for (name, tape) in &tapes {
            let throat = tape.throat.map_or_else(String::new, |t| format!(", throat at {:.1}° from the axis", t.angle_deg));
            shell.say(format_args!("tape of {name}: seen {:.2} px off in one shot, {:.2} px in all{throat}", tape.shot_px, tape.shared_px));
        }
        let mut tracked = TrackedSession { session, results, rig, tapes, balances: BTreeMap::new(), air: AirSeen::default() };
        tracked.look_first(shell);
        Ok(tracked)
    }

    /// Measures some shots to learn what all of them share: how the rackets are balanced, and whether there is air.
    fn look_first(&mut self, shell: &Shell) {
        let mut by_racket: BTreeMap<&str, Vec<&ShotFolder>> = BTreeMap::new();
        for shot in &self.session.shots {
            by_racket.entry(&shot.racket.name).or_default().push(shot);
        }
        let (mut balances, mut all) = (BTreeMap::new(), Vec::new());
        for (name, shots) in by_racket {
            let some: Vec<&ShotFolder> = evenly(shots.len(), FIRST_LOOKS).map(|i| shots[i]).collect();
            let motions: Vec<(&str, ShotMotion)> = some.par_iter().filter_map(|shot| Some((shot.id.as_str(), self.first_motion(shot, shell)?))).collect();
            let seen = BalanceSeen::of(motions.iter().filter_map(|(_, m)| m.racket_out.as_ref()));
            if seen.flights > 0 {
                let [x, y, z] = (seen.shift_m * 1e3).into();
                let sd = seen.sd_m * 1e3;
                shell.say(format_args!(
                    "balance of {name}: {} free flights put the centre of mass {x:+.2} ± {:.2}, {y:+.2} ± {:.2}, {z:+.2} ± {:.2} mm (x, y, z) from the stated one",
                    seen.flights, sd.x, sd.y, sd.z
                ));
            }
            balances.insert(name.to_owned(), seen);
            all.extend(motions);
        }
        let air = AirSeen::of(all.iter().map(|(id, motion)| (*id, motion)));
        (self.balances, self.air) = (balances, air);
    }

    fn first_motion(&self, shot: &ShotFolder, shell: &Shell) -> Option<ShotMotion> {
        shell.check_cancelled().ok()?;
        let tracks = Tracks::read(&self.place(shot).join("tracks.csv")).ok()?;
        let settings = MeasureSettings { first_look: true, ..self.settings(shot) };
        measure_motion(&self.rig, &tracks, &shot.racket, &shot.ball, &settings).ok()
    }

    /// Where a shot's results are.
    pub fn place(&self, shot: &ShotFolder) -> PathBuf {
        self.results.join("shots").join(&shot.id)
    }

    /// How a shot is measured.
    pub fn settings(&self, shot: &ShotFolder) -> MeasureSettings {
        MeasureSettings {
            impact_frame: shot.impact_frame,
            axes_known: self.rig.axes_known(),
            tape: self.tapes.get(&shot.racket.name).copied().unwrap_or_else(TapeErrors::expected),
            air_odds: self.air.odds(&shot.id),
            balance: self.balances.get(&shot.racket.name).copied().unwrap_or_else(BalanceSeen::expected),
            ..MeasureSettings::new(self.session.frame_rate_hz, self.session.exposure_s)
        }
    }
}

/// What the tracks of the session say about each racket's tape. Damaged tracks are named when their shot is measured.
fn tapes(session: &Session, rig: &StereoRig, results: &Path) -> BTreeMap<String, TapeErrors> {
    let mut by_racket: BTreeMap<&str, (&Racket, Vec<Tracks>, Vec<Throat>)> = BTreeMap::new();
    for shot in &session.shots {
        let place = results.join("shots").join(&shot.id);
        let Ok(tracks) = Tracks::read(&place.join("tracks.csv")) else { continue };
        let (_, all, throats) = by_racket.entry(&shot.racket.name).or_insert((&shot.racket, Vec::new(), Vec::new()));
        all.push(tracks);
        throats.extend(TrackRecord::read(&place).and_then(|t| t.throat()));
    }
    let of = |(racket, tracks, throats): (&Racket, Vec<Tracks>, Vec<Throat>)| {
        Some(TapeErrors::of(rig, &RacketFigure::of(racket)?, &tracks.iter().collect::<Vec<_>>(), &throats))
    };
    by_racket.into_iter().filter_map(|(name, racket)| Some((name.to_owned(), of(racket)?))).collect()
}
