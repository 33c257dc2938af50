//! Error rates of the diagnosis on seeded tables of the synthetic world.
//!
//! `cargo run --release --example error_rates -- KIND IMPACTS EFFECT[+EFFECT]|nothing STRENGTH TABLES FIRST_SEED [OPTIONS]`
//! with OPTIONS of `understated=1.25`, `outliers=0.05`, `offset=0.3`, `missing=0.1`, `noise=7` (times good footage), `one-axis`, `verbose`, `quiet`,
//! `base=viscoelastic`, and
//! - `signal=12`: the strength is chosen so that each effect alone has this signal in the first table of the world (STRENGTH is
//!   then ignored): the root of its non-centrality, the chi-square that the base model at its best leaves on the impacts of the
//!   fit without noise. Other tables of the same strength have more or less: each one's own signal is on its line, and the rates
//!   of those above 8 stand apart;
//! - `curve`: prints the signal of a range of strengths first;
//! - `right-form`: the held-out error of the world's own law as well, its strength, restitution and friction fitted: what no
//!   method could do better;
//! - `form=catalogue`: the outputs come from the program's own model with the effect at STRENGTH typical sizes, so that its
//!   form is right: intervals of its parameters can be counted.
//!
//! One line per table, then the rates.

use std::io::Write;
use std::path::Path;
use sweetspot::equipment::{Ball, Racket};
use sweetspot::impact::{ImpactInput, Model, effect_card};
use sweetspot::impact_table::{INPUTS, OUTPUTS};
use sweetspot::synthetic::hidden::{Hidden, entry, nature};
use sweetspot::synthetic::impact_world::{Approach, Kind, SyntheticTable, TableSpec, draw, generate_table, meet};
use sweetspot::synthetic::measurement::NoiseOptions;
use sweetspot::synthetic::scenario::FIRST_MODEL;
use sweetspot::validation::diagnose::{DiagnoseOptions, diagnose};
use sweetspot::validation::fit::{FitOptions, fit};
use sweetspot::validation::forward::{Asked, Forward, FreeParameter, Library, Outputs, Prediction};
use sweetspot::validation::heldout::held_out_error;
use sweetspot::validation::model_library::ModelLibrary;
use sweetspot::validation::observation::TableOptions;
use sweetspot::validation::{Diagnosis, Observations, ValidationError, Verdict};

/// What a user would start from with the time-stepped base: ball damping and friction to be fitted.
const VISCOELASTIC: &str = "base = \"viscoelastic\"\n\n[parameters]\nA_C = { value = 1200.0, fit = true }\nmu = { value = 0.45, fit = true }\n";

/// The program's own model with the effects at `strength` typical sizes: its strengths are the truth to recover.
fn own_world(text: &str, effects: &[&str], strength: f64) -> (Model, Vec<(String, f64)>) {
    let mut model = Model::parse(text, Path::new("model.toml")).expect("a model");
    for (name, value) in [("A_C", 1393.0), ("mu", 0.5), ("restitution", 0.83), ("friction", 0.45)] {
        if model.index_of(name).is_ok() {
            model.set(name, value).expect("allowed");
        }
    }
    let mut truth = Vec::new();
    for effect in effects {
        model = model.with_effect(effect).expect("in the catalogue");
        for (_, p) in effect_card(effect).expect("in the catalogue").strengths() {
            let sweetspot::impact::Role::Strength { absent, .. } = p.role else { continue };
            let value = (absent + strength * p.typical).clamp(p.min, p.max);
            let name = format!("{effect}.{}", p.name);
            model.set(&name, value).expect("allowed");
            truth.push((name, value));
        }
    }
    (model, truth)
}

/// Replaces what the world did by what the model does; the noise of every cell stays.
fn by_model(made: &mut SyntheticTable, model: &Model, racket: &Racket, ball: &Ball) {
    let ready = model.prepare(racket, ball).expect("prepared");
    for row in &mut made.table.rows {
        let truth = &made.truth.rows[&row.id];
        let inputs: [f64; INPUTS.len()] = std::array::from_fn(|i| truth.get(INPUTS[i]).copied().unwrap_or(0.0));
        let Ok(out) = ready.predict(&ImpactInput::from_columns(&inputs, row.sequence)) else {
            row.outputs.fill(None);
            continue;
        };
        for (k, value) in out.as_columns().into_iter().enumerate() {
            if let (Some(cell), Some(before), Some(now)) = (row.outputs[k].as_mut(), truth.get(OUTPUTS[k]), value) {
                cell.value += now - before;
            }
        }
    }
}

/// Bar of the issue: rates are of tables with more signal than this.
const ENOUGH: f64 = 8.0;

/// Root of the chi-square that the first model leaves on the noiseless impacts of table `seed` that the fit sees, and how many
/// impacts carry it: (sum of their parts)² / sum of the squares.
fn signal(kind: Kind, impacts: usize, name: &str, strength: f64, own_form: bool, first_model: &str, seed: u64) -> (f64, f64) {
    let hidden = if own_form { vec![] } else { vec![Hidden::new(name, strength)] };
    const FAINT: f64 = 1e-3;
    let noise = NoiseOptions { scale: FAINT, ..NoiseOptions::default() };
    let mut made = generate_table(&TableSpec { kind, impacts, hidden, seed, noise }).expect("a table");
    if own_form || first_model == VISCOELASTIC {
        let (model, _) = own_world(first_model, if own_form { std::slice::from_ref(&name) } else { &[] }, strength);
        let (racket, ball) = (made.racket.clone(), made.ball.clone());
        by_model(&mut made, &model, &racket, &ball);
    }
    for m in made.table.rows.iter_mut().flat_map(|r| r.inputs.iter_mut().chain(r.outputs.iter_mut())).flatten() {
        m.sd = m.sd.map(|sd| sd / FAINT);
    }
    let mut observations =
        Observations::new(&made.table, std::slice::from_ref(&made.racket), std::slice::from_ref(&made.ball), &TableOptions::default()).expect("usable");
    observations.keeps_outliers = true;
    let library = ModelLibrary::new(Model::parse(first_model, Path::new("model.toml")).expect("a model"), &observations.gear);
    let left = fit(library.current(), &observations, &observations.side(false), &FitOptions::default(), None).expect("a fit");
    let (sum, squares) = left.impacts.iter().map(|l| l.z.norm_squared()).fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
    ((left.chi2 + left.prior_residual().norm_squared()).sqrt(), sum * sum / squares)
}

/// The strength with this signal, by a few secant steps on the logarithms.
fn strength_with(wanted: f64, signal_at: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.02f64, 4.0f64);
    for _ in 0..7 {
        let middle = (low * high).sqrt();
        if signal_at(middle) < wanted { low = middle } else { high = middle }
    }
    (low * high).sqrt()
}

/// The world's own law as a model: restitution, friction and the strength of what is hidden are free.
struct WorldLaw {
    /// Attitude and place of the face, which no measured input tells.
    like: Approach,
    gear: (Racket, Ball),
    hidden: String,
    free: Vec<FreeParameter>,
}

struct WorldNow<'a> {
    law: &'a WorldLaw,
    nature: sweetspot::synthetic::nature::Nature,
}

impl WorldLaw {
    fn new(kind: Kind, hidden: &Hidden, racket: &Racket, ball: &Ball) -> Self {
        let mut any = <rand_chacha::ChaCha8Rng as rand::SeedableRng>::seed_from_u64(1);
        let free = |name: &str, value: f64, max: f64| FreeParameter { name: name.to_owned(), value, min: 0.01 * max, max, typical: 0.05, prior: None };
        WorldLaw {
            like: draw(kind, 0.0, &mut any),
            gear: (racket.clone(), ball.clone()),
            hidden: hidden.effect.clone(),
            free: vec![
                free("restitution", 0.82, 1.0),
                free("friction", 0.45, 1.5),
                FreeParameter {
                    value: hidden.strength,
                    min: 0.25 * hidden.strength,
                    max: (4.0 * hidden.strength).min(5.0),
                    typical: 0.2 * hidden.strength,
                    ..free("strength", 1.0, 1.0)
                },
            ],
        }
    }
}

impl Forward for WorldLaw {
    fn parameters(&self) -> &[FreeParameter] {
        &self.free
    }

    fn prepare(&self, values: &[f64]) -> Result<Box<dyn Prediction + '_>, ValidationError> {
        let mut law = nature(&[Hidden::new(&self.hidden, values[2])]).expect("a known effect");
        (law.restitution, law.friction) = (values[0], values[1]);
        Ok(Box::new(WorldNow { law: self, nature: law }))
    }

    fn costly(&self) -> bool {
        true
    }
}

impl Prediction for WorldNow<'_> {
    fn predict(&self, asked: &Asked) -> Option<Outputs> {
        let x = &asked.inputs;
        let v = |i: usize| nalgebra::Vector3::new(x[i], x[i + 1], x[i + 2]);
        let approach = Approach {
            ball: v(0),
            ball_spin: v(3),
            racket: v(6),
            racket_rate: v(9),
            place: nalgebra::Vector2::new(x[12], x[13]),
            grip_torque: x[14],
            order: asked.order,
            ..self.law.like
        };
        let (_, out) = meet(&self.law.gear.0, &self.law.gear.1, &approach, &self.nature).ok()?.truth.columns();
        Some(out.map(|o| o.unwrap_or(f64::NAN)))
    }
}

fn share_gone(before: f64, after: f64) -> f64 {
    if before > 1.0 { (before * before - after * after) / (before * before - 1.0) } else { f64::NAN }
}

/// Held-out error with everything recommended added.
fn after_adding(d: &Diagnosis) -> Option<f64> {
    match &d.together {
        Some(t) if t.effects == d.recommended => Some(t.heldout_error_after),
        _ => d.candidates.iter().find(|c| d.recommended.first() == Some(&c.effect)).map(|c| c.heldout_error_after),
    }
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize| args[i].parse::<f64>().expect("a number");
    let kind = if args[0] == "court" { Kind::Court } else { Kind::Lab };
    let (impacts, tables, first) = (number(1) as usize, number(4) as u64, number(5) as u64);
    let option = |key: &str| args.iter().find_map(|a| a.strip_prefix(&format!("{key}=")).map(|v| v.parse::<f64>().expect("a number")));
    let flag = |name: &str| args.iter().any(|a| a == name);
    let noise = NoiseOptions {
        understated: option("understated").unwrap_or(1.0),
        outliers: option("outliers").unwrap_or(0.0),
        outlier_sd: 5.0,
        session_offset_sd: option("offset").unwrap_or(0.0),
        missing: option("missing").unwrap_or(0.0),
        one_axis_spin: flag("one-axis"),
        scale: option("noise").unwrap_or(1.0),
        ..NoiseOptions::default()
    };
    let names: Vec<&str> = if args[2] == "nothing" { vec![] } else { args[2].split('+').collect() };
    let own_form = flag("form=catalogue");
    let visco = flag("base=viscoelastic");
    let first_model = if visco { VISCOELASTIC } else { FIRST_MODEL };
    let strength_of = |name: &str| match option("signal") {
        Some(wanted) => strength_with(wanted, |s| signal(kind, impacts, name, s, own_form, first_model, 1).0),
        None => number(3),
    };
    if flag("curve") {
        for strength in [0.02, 0.03, 0.045, 0.06, 0.08, 0.12, 0.2, 0.35, 0.6, 1.0, 1.5] {
            let at = |name: &&str| {
                let (signal, carried_by) = signal(kind, impacts, name, strength, own_form, first_model, 1);
                format!("{name} {signal:.1} (carried by {carried_by:.0} impacts)")
            };
            writeln!(std::io::stdout(), "strength {strength}: {}", names.iter().map(at).collect::<Vec<_>>().join(", ")).expect("stdout");
        }
    }
    let strengths: Vec<f64> = names.iter().map(|n| strength_of(n)).collect();
    let hidden: Vec<Hidden> = if own_form { vec![] } else { names.iter().zip(&strengths).map(|(e, s)| Hidden::new(e, *s)).collect() };
    let mut count = [0usize; 6];
    let (mut before, mut after, mut with_formula, mut floor) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut gone_well, mut formulas, mut all_named) = (0usize, 0usize, 0usize);
    let (mut covered, mut intervals) = (0usize, 0usize);
    // Of tables whose own signal is above the bar: how many, named first, among the aliases.
    let mut strong = [0usize; 3];
    let mut out = std::io::stdout();
    let (mut right_form, mut gone_of_right) = (Vec::new(), 0usize);
    let start = std::time::Instant::now();
    for seed in first..first + tables {
        let mut made = generate_table(&TableSpec { kind, impacts, hidden: hidden.clone(), seed, noise: noise.clone() }).expect("a table");
        let mut truth = Vec::new();
        if own_form || visco {
            let (model, strengths) = own_world(first_model, &names, strengths.first().copied().unwrap_or(1.0));
            let (racket, ball) = (made.racket.clone(), made.ball.clone());
            by_model(&mut made, &model, &racket, &ball);
            truth = strengths;
        }
        let observations =
            Observations::new(&made.table, std::slice::from_ref(&made.racket), std::slice::from_ref(&made.ball), &TableOptions::default()).expect("usable");
        let library = ModelLibrary::new(Model::parse(first_model, Path::new("model.toml")).expect("a model"), &observations.gear);
        let d = diagnose(&library, &observations, &DiagnoseOptions { seed, ..DiagnoseOptions::default() }).expect("a diagnosis");
        let top = d.candidates.first();
        let alias = |name: &str| names.iter().any(|h| *h == name || entry(h).is_ok_and(|e| e.aliases.contains(&name)));
        count[match d.verdict {
            Verdict::Adequate => 0,
            Verdict::EffectMissing => 1,
            Verdict::Unexplained => 2,
        }] += 1;
        if let (true, Some(h)) = (flag("right-form"), hidden.first()) {
            let law = WorldLaw::new(kind, h, &made.racket, &made.ball);
            let fitted = fit(&law, &observations, &observations.side(false), &FitOptions::default(), None).expect("a fit");
            let error = held_out_error(&law, &fitted, &observations).expect("a prediction");
            writeln!(out, "{seed} the world's own law: held-out error {:.3} to {error:.3}, fitted {:.3?}", d.heldout_error, fitted.values).expect("stdout");
            right_form.push(error);
            if let Some(e) = &d.suggested_expression {
                let (first, formula) = (d.heldout_error.powi(2), e.heldout_error_after.powi(2));
                gone_of_right += usize::from(first - formula >= 0.7 * (first - error * error).max(0.0));
            }
        }
        let failing = d.verdict != Verdict::Adequate;
        let named_first = failing && top.is_some_and(|t| names.contains(&t.effect.as_str()));
        let among_aliases = failing && top.is_some_and(|t| names.iter().any(|h| *h == t.effect || t.aliases.iter().any(|a| a == h)));
        count[3] += usize::from(named_first);
        count[4] += usize::from(among_aliases);
        let own_signal = match (names.as_slice(), option("signal")) {
            ([name], Some(_)) => signal(kind, impacts, name, strengths[0], own_form, first_model, seed).0,
            _ => 0.0,
        };
        if own_signal > ENOUGH {
            [true, named_first, among_aliases].iter().zip(&mut strong).for_each(|(is, n)| *n += usize::from(*is));
        }
        count[5] += usize::from(d.candidates.iter().any(|t| t.probability > 0.9 && !alias(&t.effect)));
        all_named += usize::from(!names.is_empty() && names.iter().all(|h| d.recommended.iter().any(|r| r == h)));
        before.push(d.heldout_error);
        floor.push(d.noise_floor);
        if let Some(e) = after_adding(&d) {
            after.push(e);
        }
        if let Some(e) = &d.suggested_expression {
            formulas += 1;
            with_formula.push(e.heldout_error_after);
            gone_well += usize::from(share_gone(d.heldout_error, e.heldout_error_after) >= 0.7);
        }
        let fitted = d
            .together
            .as_ref()
            .filter(|t| t.effects == d.recommended)
            .map(|t| &t.parameters)
            .or_else(|| d.candidates.iter().find(|c| d.recommended.len() == 1 && d.recommended[0] == c.effect).map(|c| &c.parameters));
        for (name, value) in &truth {
            if let Some(e) = fitted.and_then(|f| f.get(name)) {
                intervals += 1;
                covered += usize::from((e.value - value).abs() <= 1.96 * e.sd);
            }
        }
        if flag("quiet") {
            continue;
        }
        let tops: Vec<String> = d
            .candidates
            .iter()
            .take(if flag("verbose") { 5 } else { 2 })
            .map(|t| {
                format!(
                    "{} p={:.2} lnB={:.0} g={:.0} E={:.3} share={:.2} {:?}",
                    t.effect, t.probability, t.log_evidence_gain, t.chi2_gain, t.heldout_error_after, t.share_removed, t.aliases
                )
            })
            .collect();
        writeln!(
            out,
            "{seed} signal={own_signal:.1} {} lib={:.1e} str={:.1e} ({:.0}/{}) c={:.3} E0={:.3} rec={:?} pair={} after={:.1e}/{:.0} other={:?} {:?} | {}",
            d.verdict,
            d.library_p_value,
            d.structure.p_value,
            d.structure.statistic / d.structure.noise_scale,
            d.structure.rank,
            d.structure.noise_scale,
            d.heldout_error,
            d.recommended,
            d.together.as_ref().map_or("-".into(), |t| format!("{:?} E={:.3}", t.effects, t.heldout_error_after)),
            d.structure_after.as_ref().map_or(1.0, |s| s.p_value),
            d.structure_after.as_ref().map_or(0.0, |s| s.excess),
            d.suggested_expression.as_ref().map(|e| format!("{} -> {} E={:.3} share={:.2}", e.replaces, e.expression, e.heldout_error_after, e.share_removed)),
            d.notes,
            tops.join(if flag("verbose") { "\n      " } else { " ; " })
        )
        .expect("stdout");
    }
    let mean = |v: &[f64]| if v.is_empty() { f64::NAN } else { v.iter().sum::<f64>() / v.len() as f64 };
    let square = |v: &[f64]| (v.iter().map(|x| x * x).sum::<f64>() / v.len().max(1) as f64).sqrt();
    writeln!(
        out,
        "# {} {} n={impacts} x{strengths:.2?} {}: of {tables} adequate {} missing {} unexplained {} | first {} alias {} both {all_named} wrong>0.9 {} | E0 {:.3} added {:.3} (gone {:.2}) formula {formulas}, {:.3}, 70 % gone in {gone_well} | floor {:.3} | covered {covered} of {intervals} | {:.2} s/table",
        args[0],
        args[2],
        args[3..].iter().filter(|a| a.contains('=')).cloned().collect::<Vec<_>>().join(" "),
        count[0],
        count[1],
        count[2],
        count[3],
        count[4],
        count[5],
        square(&before),
        square(&after),
        share_gone(square(&before), square(&after)),
        square(&with_formula),
        mean(&floor),
        start.elapsed().as_secs_f64() / tables as f64
    )
    .expect("stdout");
    if names.len() == 1 && option("signal").is_some() {
        writeln!(out, "# own signal above {ENOUGH}: {} tables, first {}, alias {}", strong[0], strong[1], strong[2]).expect("stdout");
    }
    if !right_form.is_empty() {
        writeln!(
            out,
            "# the world's own law: {:.3}, gone {:.2}; a formula takes 70 % of what it takes in {gone_of_right}",
            square(&right_form),
            share_gone(square(&before), square(&right_form))
        )
        .expect("stdout");
    }
}
