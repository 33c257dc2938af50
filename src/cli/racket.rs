//! `sweetspot racket`.

use super::Shell;
use super::error::CliError;
use super::racket_photograph::{PhotographArguments, measure_photograph};
use crate::equipment::{BALANCE_M, MASS_KG, Racket, SWINGWEIGHT_AXIS_FROM_BUTT_M, SWINGWEIGHT_KGM2, TWISTWEIGHT_KGM2};
use crate::kinematics::{
    Bifilar, Pendulum, TapePlace, Uncertain, balance_from_scales, from_rdc_kg_cm2, perpendicular_axis_mismatch, swingweight_from_pendulum,
    twistweight_from_bifilar,
};
use std::path::PathBuf;

/// Racket data from bench measurements, and a check of racket.toml
///
/// Gives the lines for racket.toml that follow from what was measured: mass and balance from two scales, swingweight and
/// spinweight from a pendulum or a machine, twistweight from two threads, the markers from a photograph of the racket on a
/// ruled sheet. With a racket.toml, checks it.
// A negative value is refused by name, not taken for an option.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Arguments {
    /// Check this racket.toml; its mass and balance are used where none are given
    pub racket: Option<PathBuf>,
    /// Mass
    #[arg(long, value_name = "KG")]
    pub mass: Option<f64>,
    /// Centre of mass, from the butt
    #[arg(long, value_name = "M")]
    pub balance: Option<f64>,
    /// Standard deviation of the balance
    #[arg(long, value_name = "M", default_value_t = 0.001)]
    pub balance_sd: f64,
    /// Two supports: place from the butt and reading of each
    #[arg(long, num_args = 4, value_names = ["M1", "KG1", "M2", "KG2"], conflicts_with_all = ["mass", "balance"])]
    pub scales: Option<Vec<f64>>,
    /// Pendulum across the face: pivot from the butt, period, its standard deviation
    #[arg(long, num_args = 3, value_names = ["PIVOT_M", "S", "SD_S"])]
    pub swing_pendulum: Option<Vec<f64>>,
    /// Pendulum in the face's plane: pivot from the butt, period, its standard deviation
    #[arg(long, num_args = 3, value_names = ["PIVOT_M", "S", "SD_S"])]
    pub spin_pendulum: Option<Vec<f64>>,
    /// Hung upright from two threads: half distances above and below, thread length, period, its standard deviation
    #[arg(long, num_args = 5, value_names = ["ABOVE_M", "BELOW_M", "THREAD_M", "S", "SD_S"])]
    pub twist_threads: Option<Vec<f64>>,
    /// Swingweight read from a machine (RDC)
    #[arg(long, value_name = "KG_CM2", conflicts_with = "swing_pendulum")]
    pub swing_rdc: Option<f64>,
    /// Twistweight read from a machine (RDC)
    #[arg(long, value_name = "KG_CM2", conflicts_with = "twist_threads")]
    pub twist_rdc: Option<f64>,
    #[command(flatten)]
    pub photograph: PhotographArguments,
}

/// A racket.toml found valid.
#[derive(Debug, serde::Serialize)]
struct Checked {
    name: String,
    /// Principal inertias about the centre of mass.
    inertia_x_kg_m2: f64,
    inertia_y_kg_m2: f64,
    inertia_z_kg_m2: f64,
}

#[derive(Debug, Default, serde::Serialize)]
struct RacketBench {
    /// The racket.toml given.
    #[serde(skip_serializing_if = "Option::is_none")]
    racket: Option<Checked>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mass_kg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    balance_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    swingweight_kgm2: Option<Uncertain>,
    #[serde(skip_serializing_if = "Option::is_none")]
    twistweight_kgm2: Option<Uncertain>,
    #[serde(skip_serializing_if = "Option::is_none")]
    spinweight_kgm2: Option<Uncertain>,
    /// (spin − swing − twist) / spin.
    #[serde(skip_serializing_if = "Option::is_none")]
    perpendicular_axis_mismatch: Option<f64>,
    /// m1 to m5 from a photograph.
    #[serde(skip_serializing_if = "Option::is_none")]
    markers: Option<[TapePlace; 5]>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    remarks: Vec<String>,
}

impl RacketBench {
    /// Refuses what no racket can have: another unit, or a slip of the pen. `at`: balance point and mass, for the moment of inertia about
    /// the centre of mass.
    fn check(&self, at: Option<(f64, f64)>) -> Result<(), CliError> {
        let value = |u: Option<Uncertain>| u.map(|u| u.value);
        for (key, seen, (low, high), unit) in [
            ("mass_kg", self.mass_kg, MASS_KG, "kg"),
            ("balance_m", self.balance_m, BALANCE_M, "m"),
            ("swingweight_kgm2", value(self.swingweight_kgm2), SWINGWEIGHT_KGM2, "kg m²"),
            ("twistweight_kgm2", value(self.twistweight_kgm2), TWISTWEIGHT_KGM2, "kg m²"),
            ("spinweight_kgm2", value(self.spinweight_kgm2), SWINGWEIGHT_KGM2, "kg m²"),
        ] {
            if let Some(seen) = seen.filter(|v| !(low..=high).contains(v)) {
                return Err(CliError::input(format!("{key} comes out as {seen:.6}; allowed: {low} to {high} {unit}"))
                    .hint("kilograms, metres, seconds; RDC readings in kg cm², as the machine shows them"));
            }
        }
        if let (Some(swing), Some((balance, mass))) = (value(self.swingweight_kgm2), at) {
            let least = mass * (balance - SWINGWEIGHT_AXIS_FROM_BUTT_M).powi(2);
            if swing <= least {
                return Err(CliError::input(format!(
                    "swingweight_kgm2 comes out as {swing:.6}; allowed: above {least:.6}, what the mass at the balance point alone has about the axis 0.10 m from the butt"
                )));
            }
        }
        Ok(())
    }

    /// Says where the measurement and the racket file differ.
    fn compare_with(&mut self, file: Option<&Racket>) {
        let Some(r) = file else { return };
        let exact = |v: Option<f64>| v.map(|value| Uncertain { value, sd: 0.0 });
        for (key, measured, stated) in [
            ("mass_kg", exact(self.mass_kg), Some(r.mass_kg)),
            ("balance_m", exact(self.balance_m), Some(r.balance_m)),
            ("swingweight_kgm2", self.swingweight_kgm2, Some(r.swingweight_kgm2)),
            ("twistweight_kgm2", self.twistweight_kgm2, Some(r.twistweight_kgm2)),
            ("spinweight_kgm2", self.spinweight_kgm2, r.spinweight_kgm2),
        ] {
            let Some((m, stated)) = measured.zip(stated) else { continue };
            let off = m.value / stated - 1.0;
            if off.abs() > DIFFERENT.max(2.0 * m.sd / stated) {
                self.remarks.push(format!("{key} is measured {:+.1} % off the file's {stated}", 100.0 * off));
            }
        }
    }
}

/// Share by which a measurement differs from the file worth telling.
const DIFFERENT: f64 = 0.01;
/// Share by which real rackets leave the perpendicular axis theorem, which holds for flat bodies.
const FLATNESS: f64 = 0.05;
/// A machine's reading error, relative (Spurr et al. 2014: below 1 %).
const RDC_SD: f64 = 0.01;

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let file = arguments.racket.as_deref().map(Racket::read).transpose()?;
    let mut bench = RacketBench::default();
    let (mut mass, mut balance) = (arguments.mass, arguments.balance);
    if let Some([a, p, b, q]) = arguments.scales.as_deref() {
        let (m, c) = balance_from_scales(*a, *p, *b, *q)?;
        (mass, balance) = (Some(m), Some(c));
    }
    (bench.mass_kg, bench.balance_m) = (mass, balance);
    let mass = mass.or(file.as_ref().map(|r| r.mass_kg));
    let balance = balance.or(file.as_ref().map(|r| r.balance_m));
    let missing = |what: &str| CliError::input(format!("no {what}")).hint("give --mass and --balance, or --scales, or a racket.toml that has them");
    let pendulum = |values: &Option<Vec<f64>>| -> Result<Option<Uncertain>, CliError> {
        let Some([pivot, period, sd]) = values.as_deref() else { return Ok(None) };
        let p = Pendulum { pivot_from_butt_m: *pivot, period_s: *period, period_sd_s: *sd };
        let (mass, balance) = (mass.ok_or_else(|| missing("mass"))?, balance.ok_or_else(|| missing("balance"))?);
        Ok(Some(swingweight_from_pendulum(mass, balance, arguments.balance_sd, &p)?))
    };
    let machine = |reading: Option<f64>| reading.map(|r| from_rdc_kg_cm2(r).map(|value| Uncertain { value, sd: RDC_SD * value })).transpose();
    bench.swingweight_kgm2 = pendulum(&arguments.swing_pendulum)?.or(machine(arguments.swing_rdc)?);
    bench.spinweight_kgm2 = pendulum(&arguments.spin_pendulum)?;
    bench.twistweight_kgm2 = machine(arguments.twist_rdc)?;
    if let Some([above, below, thread, period, sd]) = arguments.twist_threads.as_deref() {
        let threads = Bifilar { half_distance_above_m: *above, half_distance_below_m: *below, thread_m: *thread, period_s: *period, period_sd_s: *sd };
        bench.twistweight_kgm2 = Some(twistweight_from_bifilar(mass.ok_or_else(|| missing("mass"))?, &threads)?);
    }
    let of_file = |f: fn(&Racket) -> f64| file.as_ref().map(f);
    let swing = bench.swingweight_kgm2.map(|u| u.value).or(of_file(|r| r.swingweight_kgm2));
    let twist = bench.twistweight_kgm2.map(|u| u.value).or(of_file(|r| r.twistweight_kgm2));
    let spin = bench.spinweight_kgm2.map(|u| u.value).or(file.as_ref().and_then(|r| r.spinweight_kgm2));
    if let (Some(swing), Some(twist), Some(spin)) = (swing, twist, spin) {
        let mismatch = perpendicular_axis_mismatch(swing, twist, spin);
        bench.perpendicular_axis_mismatch = Some(mismatch);
        if mismatch.abs() > FLATNESS {
            bench.remarks.push(format!(
                "spinweight {spin:.5} differs from swing + twist = {:.5} kg m² by {:.1} %; a flat racket keeps within {:.0} %: measure again",
                swing + twist,
                100.0 * mismatch,
                100.0 * FLATNESS
            ));
        }
    }
    bench.check(balance.zip(mass))?;
    bench.compare_with(file.as_ref());
    if file.is_none() && mass.is_none() && swing.is_none() && twist.is_none() && spin.is_none() {
        return Err(CliError::input("nothing was measured").hint("give a racket.toml to check, or measurements; see `sweetspot racket --help`"));
    }
    let number = |v: f64| format!("{v:.5}");
    let uncertain = |u: Uncertain| format!("{:.6}    # ± {:.6}", u.value, u.sd);
    for (key, text) in [
        ("mass_kg", bench.mass_kg.map(number)),
        ("balance_m", bench.balance_m.map(number)),
        ("swingweight_kgm2", bench.swingweight_kgm2.map(uncertain)),
        ("twistweight_kgm2", bench.twistweight_kgm2.map(uncertain)),
        ("spinweight_kgm2", bench.spinweight_kgm2.map(uncertain)),
    ] {
        if let Some(text) = text {
            shell.say(format_args!("{key} = {text}"));
        }
    }
    if let Some(r) = &file {
        bench.remarks.extend(r.tension_doubt());
        let i = r.inertia_kg_m2();
        bench.racket = Some(Checked { name: r.name.clone(), inertia_x_kg_m2: i.x, inertia_y_kg_m2: i.y, inertia_z_kg_m2: i.z });
        shell.say(format_args!("{}: valid; about the centre of mass I_x {:.5}, I_y {:.5}, I_z {:.5} kg m²", r.name, i.x, i.y, i.z));
    }
    if let Some(photograph) = &arguments.photograph.photo {
        let (racket, path) = file.as_ref().zip(arguments.racket.as_deref()).ok_or_else(|| {
            CliError::input("a photograph needs a racket.toml (its tube's radius lifts the tapes off the sheet)")
                .hint("sweetspot racket racket.toml --photo F ...")
        })?;
        bench.markers = Some(measure_photograph(photograph, &arguments.photograph, racket, path, shell)?);
    }
    bench.remarks.iter().for_each(|r| shell.say(r));
    shell.print_json(&bench)
}
