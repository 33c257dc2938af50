//! What `track`, `shots` and `explore frame-rate` share: a session with its calibration, and how its shots are measured.

use super::Shell;
use super::error::CliError;
use super::track::seen_throat;
use crate::calibration::{CalibrationError, StereoRig};
use crate::kinematics::{ImageErrors, LastingError, Leftover, MeasureSettings, Survey, Sway, evenly, session_throat, survey};
use crate::session::{Session, ShotFolder};
use crate::tracking::{RacketFigure, Throat, Tracks};
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

fn hinted(e: CalibrationError) -> CliError {
    CliError::from(e).hint("run `sweetspot calibrate SESSION` first; with --force it writes the file anew")
}

/// A session whose shots have been tracked.
pub struct TrackedSession {
    pub session: Session,
    pub results: PathBuf,
    pub rig: StereoRig,
    /// By the racket's name.
    seen: BTreeMap<String, Seen>,
}

/// How the shots with one racket are seen.
#[derive(Clone, Copy)]
struct Seen {
    throat: Option<Throat>,
    image_errors: ImageErrors,
    sway: Sway,
}

/// Shots with one racket whose leftovers are asked how far off things are seen.
const SURVEYED: usize = 16;

impl TrackedSession {
    pub fn open(folder: &Path, shell: &Shell) -> Result<Self, CliError> {
        let session = Session::open(folder)?;
        let results = shell.results_of_session(folder);
        let rig = read_rig(&results.join("calibration.json"))?;
        let mut tracked = TrackedSession { session, results, rig, seen: BTreeMap::new() };
        tracked.seen = tracked.learn(shell)?;
        for (name, seen) in &tracked.seen {
            let throat = seen.throat.map_or_else(String::new, |t| format!("; throat at {:.1}° from the axis", t.angle_deg));
            let words = |e: &LastingError| format!("{:.3} px and {:.3} px that come and go", e.constant_px, e.wander_px);
            let [ball, head, in_throat] = [&seen.image_errors.ball, &seen.image_errors.head, &seen.image_errors.throat].map(words);
            shell.say(format_args!("{name}: bands on the head are seen {head} off, in the throat {in_throat}, the ball {ball}{throat}"));
        }
        Ok(tracked)
    }

    /// Where a shot's results are.
    pub fn place(&self, shot: &ShotFolder) -> PathBuf {
        self.results.join("shots").join(&shot.id)
    }

    /// How a shot is measured.
    pub fn settings(&self, shot: &ShotFolder) -> MeasureSettings {
        let unseen = || Seen { throat: None, image_errors: ImageErrors::expected(), sway: Sway::usual() };
        let Seen { throat, image_errors, sway } = self.seen.get(&shot.racket.name).copied().unwrap_or_else(unseen);
        MeasureSettings {
            impact_frame: shot.impact_frame,
            axes_known: self.session.axes.is_some(),
            image_errors,
            sway,
            throat,
            ..MeasureSettings::new(self.session.frame_rate_hz, self.session.exposure_s)
        }
    }

    /// What the tracks of the session say about each racket's throat, and how far off bands and ball are seen. Damaged tracks, and
    /// shots that cannot be measured, are named when their turn comes.
    fn learn(&self, shell: &Shell) -> Result<BTreeMap<String, Seen>, CliError> {
        let mut by_racket: BTreeMap<&str, Vec<(&ShotFolder, Tracks)>> = BTreeMap::new();
        for shot in &self.session.shots {
            if let Ok(tracks) = Tracks::read(&self.place(shot).join("tracks.csv")) {
                by_racket.entry(&shot.racket.name).or_default().push((shot, tracks));
            }
        }
        let mut seen = BTreeMap::new();
        for (name, shots) in by_racket {
            shell.check_cancelled()?;
            let Some(figure) = shots.first().and_then(|(shot, _)| RacketFigure::of(&shot.racket)) else { continue };
            let throats: Vec<Throat> = shots.iter().filter_map(|(shot, _)| seen_throat(&self.place(shot))).collect();
            let throat = session_throat(&self.rig, &figure, &shots.iter().map(|(_, t)| t).collect::<Vec<_>>(), &throats);
            let asked: Vec<&(&ShotFolder, Tracks)> = evenly(shots.len(), SURVEYED).map(|k| &shots[k]).collect();
            let surveys: Vec<Survey> = asked
                .par_iter()
                .filter_map(|(shot, tracks)| {
                    let settings = MeasureSettings { throat, ..self.settings(shot) };
                    survey(&self.rig, tracks, &shot.racket, &shot.ball, &settings).ok()
                })
                .collect();
            let sway = Sway::learnt(&surveys.iter().filter_map(|s| s.sway).collect::<Vec<_>>());
            let leftovers: Vec<Leftover> = surveys.into_iter().flat_map(|s| s.leftovers).collect();
            seen.insert(name.to_owned(), Seen { throat, image_errors: ImageErrors::learnt(&leftovers), sway });
        }
        Ok(seen)
    }
}
