//! `kinematics` against worlds with known truth that do not share its laws of motion.

use super::kinematics_world::{Difficulty, FRAME_S, true_shot};
use rayon::prelude::*;
use std::collections::BTreeMap;
use sweetspot::kinematics::{MeasureSettings, ShotInput, ShotSpin, measure_shot};

const COURT: Difficulty = Difficulty { noise_px: 0.10, tape_error_px: 0.08, outliers: 0.004, gaps: 0.03, laboratory: false, air: true, drive: 1.0 };
const LABORATORY: Difficulty = Difficulty { laboratory: true, ..COURT };
const HARD: Difficulty = Difficulty { noise_px: 0.22, tape_error_px: 0.15, outliers: 0.015, gaps: 0.12, ..COURT };

#[derive(Default)]
struct Score {
    /// Errors and stated deviations by column.
    errors: BTreeMap<&'static str, Vec<(f64, f64)>>,
}

impl Score {
    fn rms(&self, columns: &[&str]) -> f64 {
        let all: Vec<f64> = self.errors.iter().filter(|(c, _)| columns.iter().any(|p| c.starts_with(p))).flat_map(|(_, e)| e.iter().map(|e| e.0)).collect();
        (all.iter().map(|e| e * e).sum::<f64>() / all.len() as f64).sqrt()
    }

    fn coverage(&self, columns: &[&str]) -> f64 {
        let all: Vec<bool> = self
            .errors
            .iter()
            .filter(|(c, _)| columns.iter().any(|p| c.starts_with(p)))
            .flat_map(|(_, e)| e.iter().map(|(e, sd)| e.abs() < 1.96 * sd))
            .collect();
        all.iter().filter(|i| **i).count() as f64 / all.len() as f64
    }
}

fn score(difficulty: &Difficulty, seeds: std::ops::Range<u64>) -> Score {
    let shots: Vec<Vec<(&'static str, f64, f64)>> = seeds
        .into_par_iter()
        .map(|seed| {
            let truth = true_shot(seed, difficulty);
            let spin = ShotSpin::default();
            let input = ShotInput {
                id: "s",
                rig: &truth.rig,
                tracks: &truth.tracks,
                racket: &truth.racket,
                ball: &truth.ball,
                spin: &spin,
                groups: &[],
                asked_points: &[],
            };
            let measured = measure_shot(&input, &MeasureSettings::new(1.0 / FRAME_S, 1e-4)).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
            let quantity = |name: &str| measured.shot.quantities.get(name).unwrap_or_else(|| panic!("seed {seed}: no {name}: {:?}", measured.shot.remarks));
            let mut out: Vec<_> = truth.row.iter().map(|(name, v)| (*name, quantity(name).value - v, quantity(name).sd)).collect();
            let frame = quantity("impact_frame");
            out.push(("instant", (frame.value - truth.impact_frame) * FRAME_S, frame.sd * FRAME_S));
            if std::env::var_os("SWEETSPOT_SHOW").is_some() {
                for (name, e, sd) in out.iter().filter(|(_, e, sd)| e.abs() > 3.5 * sd) {
                    eprintln!(
                        "seed {seed} {name}: error {e:.4} sd {sd:.4} {:.2?}",
                        if name.contains("in") { Some(&measured.shot.windows.racket_in) } else { measured.shot.windows.racket_out.as_ref() }
                    );
                }
            }
            out
        })
        .collect();
    let mut score = Score::default();
    for (name, e, sd) in shots.into_iter().flatten() {
        score.errors.entry(name).or_default().push((e, sd));
    }
    score
}

const BALL: [&str; 2] = ["ball_in_v", "ball_out_v"];
const RACKET: [&str; 2] = ["racket_in_v", "racket_out_v"];
const RATE: [&str; 2] = ["racket_in_w", "racket_out_w"];
const POSITION: [&str; 1] = ["impact_"];
const INSTANT: [&str; 1] = ["instant"];

fn report(name: &str, s: &Score) {
    eprintln!(
        "{name}: ball {:.3} m/s, racket {:.3} m/s, rate {:.3} rad/s, position {:.3} mm, instant {:.4} ms, contact time {:.3} ms",
        s.rms(&BALL),
        s.rms(&RACKET),
        s.rms(&RATE),
        1e3 * s.rms(&POSITION),
        1e3 * s.rms(&INSTANT),
        1e3 * s.rms(&["contact_time"])
    );
    for group in ["ball_in_v", "ball_out_v", "racket_in_v", "racket_out_v", "racket_in_w", "racket_out_w", "impact_", "instant", "contact_time"] {
        eprintln!("   {group:14} rms {:.4} inside 95 % {:.1} %", s.rms(&[group]), 100.0 * s.coverage(&[group]));
    }
    eprintln!("   all inside 95 %: {:.1} %", 100.0 * s.coverage(&[""]));
}

/// Issue 6: bars of the shot characteristics on laboratory and court, twice as wide where pictures are hard.
fn within_bars(s: &Score, times: f64) {
    assert!(s.rms(&BALL) < 0.10 * times);
    assert!(s.rms(&RACKET) < 0.08 * times);
    assert!(s.rms(&RATE) < 0.6 * times);
    assert!(s.rms(&POSITION) < 1.5e-3 * times);
    assert!(s.rms(&INSTANT) < 0.15e-3 * times);
}

/// Measured on 2 cores: see docs/kinematics.md. The bars are for motions like the practice sessions' (a racket that turns
/// steadily before contact and is let go); intervals must cover on every kind, a hard-driven swing and a gripping hand too.
#[test]
fn truth_errors_stay_within_the_bars_and_intervals_cover_on_210_simulated_shots() {
    let mut all = Score::default();
    for (name, difficulty, seeds, bars) in [
        ("court", Difficulty { drive: 0.0, ..COURT }, 0..50, Some(1.0)),
        ("laboratory", LABORATORY, 1000..1040, Some(1.0)),
        ("hard", Difficulty { drive: 0.0, ..HARD }, 2000..2040, Some(2.0)),
        ("court, driven hard and held", COURT, 3000..3060, None),
        ("hard, driven hard and held", HARD, 4000..4020, None),
    ] {
        let s = score(&difficulty, seeds);
        report(name, &s);
        if let Some(times) = bars {
            within_bars(&s, times);
        }
        for (name, e) in s.errors {
            all.errors.entry(name).or_default().extend(e);
        }
    }
    let coverage = all.coverage(&[""]);
    assert!((0.92..=0.98).contains(&coverage), "{:.1} % of the true values inside 95 % intervals", 100.0 * coverage);
}
