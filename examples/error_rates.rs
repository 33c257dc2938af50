//! Error rates of the diagnosis on seeded tables of the synthetic world.
//!
//! `cargo run --release --example error_rates -- KIND IMPACTS EFFECT[+EFFECT]|nothing STRENGTH TABLES FIRST_SEED [OPTIONS]`
//! with OPTIONS of `understated=1.25`, `outliers=0.05`, `offset=0.3`, `verbose`. One line per table, then the rates.

use std::io::Write;
use sweetspot::impact::Model;
use sweetspot::synthetic::hidden::{Hidden, entry};
use sweetspot::synthetic::impact_world::{Kind, TableSpec, generate_table};
use sweetspot::synthetic::measurement::NoiseOptions;
use sweetspot::synthetic::scenario::FIRST_MODEL;
use sweetspot::validation::diagnose::{DiagnoseOptions, diagnose};
use sweetspot::validation::model_library::ModelLibrary;
use sweetspot::validation::observation::TableOptions;
use sweetspot::validation::{Observations, Verdict};

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize| args[i].parse::<f64>().expect("a number");
    let kind = if args[0] == "court" { Kind::Court } else { Kind::Lab };
    let (impacts, strength, tables, first) = (number(1) as usize, number(3), number(4) as u64, number(5) as u64);
    let option = |key: &str| args.iter().find_map(|a| a.strip_prefix(&format!("{key}=")).map(|v| v.parse::<f64>().expect("a number")));
    let noise = NoiseOptions {
        understated: option("understated").unwrap_or(1.0),
        outliers: option("outliers").unwrap_or(0.0),
        outlier_sd: 5.0,
        session_offset_sd: option("offset").unwrap_or(0.0),
        ..NoiseOptions::default()
    };
    let hidden: Vec<Hidden> = if args[2] == "nothing" { vec![] } else { args[2].split('+').map(|e| Hidden::new(e, strength)).collect() };
    let verbose = args.iter().any(|a| a == "verbose");
    let mut count = [0usize; 6];
    let mut out = std::io::stdout();
    let start = std::time::Instant::now();
    for seed in first..first + tables {
        let made = generate_table(&TableSpec { kind, impacts, hidden: hidden.clone(), seed, noise: noise.clone() }).expect("a table");
        let observations =
            Observations::new(&made.table, std::slice::from_ref(&made.racket), std::slice::from_ref(&made.ball), &TableOptions::default()).expect("usable");
        let model = Model::parse(FIRST_MODEL, std::path::Path::new("model.toml")).expect("a model");
        let library = ModelLibrary::new(model, &observations.gear);
        let d = diagnose(&library, &observations, &DiagnoseOptions { seed, ..DiagnoseOptions::default() }).expect("a diagnosis");
        let top = d.candidates.first();
        let right = |name: &str| hidden.iter().any(|h| h.effect == name || entry(&h.effect).expect("known").aliases.contains(&name));
        count[match d.verdict {
            Verdict::Adequate => 0,
            Verdict::EffectMissing => 1,
            Verdict::Unexplained => 2,
        }] += 1;
        let named = top.is_some_and(|t| hidden.iter().any(|h| h.effect == t.effect));
        count[3] += usize::from(named && d.verdict != Verdict::Adequate);
        count[4] +=
            usize::from(top.is_some_and(|t| hidden.iter().any(|h| h.effect == t.effect || t.aliases.contains(&h.effect))) && d.verdict != Verdict::Adequate);
        count[5] += usize::from(d.candidates.iter().any(|t| t.probability > 0.9 && !right(&t.effect)));
        let tops: Vec<String> = d
            .candidates
            .iter()
            .take(if verbose { 5 } else { 2 })
            .map(|t| {
                format!(
                    "{} p={:.2} lnB={:.0} E={:.3} share={:.2} {:?}",
                    t.effect, t.probability, t.log_evidence_gain, t.heldout_error_after, t.share_removed, t.aliases
                )
            })
            .collect();
        writeln!(
            out,
            "{seed} {} lib={:.1e} str={:.1e} ({:.0}/{}) c={:.3} E0={:.3} rec={:?} pair={} after={:.1e}/{:.0} other={:?} | {}",
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
            d.suggested_expression.as_ref().map(|e| format!("{} E={:.3} share={:.2}", e.expression, e.heldout_error_after, e.share_removed)),
            tops.join(if verbose { "\n      " } else { " ; " })
        )
        .expect("stdout");
    }
    writeln!(
        out,
        "# {} n={impacts} x{strength}: adequate {} missing {} unexplained {} | first {} alias {} wrong>0.9 {} of {tables} | {:.2} s/table",
        args[2],
        count[0],
        count[1],
        count[2],
        count[3],
        count[4],
        count[5],
        start.elapsed().as_secs_f64() / tables as f64
    )
    .expect("stdout");
}
