//! Made-up results for the report's tests: shaped like real ones, every text settable, so that hostile names reach every
//! corner.

use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use std::collections::BTreeMap;
use sweetspot::impact_table::{INPUTS, OUTPUTS, unit};
use sweetspot::provenance::Provenance;
use sweetspot::validation::comparison::{
    Adequacy, FaceMap, ImpactPoint, LeftOut, Outlier, OutputPoint, OutputSummary, ParameterValue, ResidualCurve, SessionOffset,
};
use sweetspot::validation::diagnosis::{CandidateReport, Estimate, NextExperiment, NotVisible, Place, SuggestedExpression, Together};
use sweetspot::validation::polynomial::{HeldEffect, PolynomialFit};
use sweetspot::validation::smooth::{face_map, smooth};
use sweetspot::validation::structure::StructureTest;
use sweetspot::validation::{Comparison, Diagnosis, LedgerEntry, Verdict};

/// A comparison of `n` impacts; `miss` scales a residual of the ball's normal velocity that grows toward the tip.
pub fn comparison(n: usize, miss: f64, name: &str) -> Comparison {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
    let mut noise = |sd: f64| sd * rng.sample::<f64, _>(StandardNormal);
    let impacts: Vec<ImpactPoint> = (0..n)
        .map(|i| {
            let mut inputs: Vec<f64> = INPUTS.iter().map(|c| if c.starts_with("impact") { noise(0.04) } else { noise(8.0) }).collect();
            inputs[14] = 0.0;
            let outputs = (0..OUTPUTS.len() - 1)
                .map(|k| {
                    let sd = if OUTPUTS[k].contains("_w") { 3.0 } else { 0.15 };
                    let predicted = 10.0 * k as f64 + noise(5.0);
                    let lost = if k == 2 { miss * (-inputs[12]).max(0.0) * 30.0 } else { 0.0 };
                    OutputPoint { output: k, measured: predicted - lost + noise(sd), predicted, sd }
                })
                .collect();
            ImpactPoint { id: format!("{name}-{i}"), held_out: i % 3 == 0, inputs, outputs }
        })
        .collect();
    let outputs: Vec<OutputSummary> = (0..OUTPUTS.len() - 1)
        .map(|k| {
            let r: Vec<f64> = impacts.iter().map(|i| i.outputs[k].residual()).collect();
            let rmse = (r.iter().map(|x| x * x).sum::<f64>() / n as f64).sqrt();
            let noise_sd = impacts[0].outputs[k].sd;
            OutputSummary {
                name: OUTPUTS[k].to_owned(),
                unit: unit(OUTPUTS[k]).to_owned(),
                n,
                rmse,
                bias: r.iter().sum::<f64>() / n as f64,
                noise_sd,
                chi2_reduced: (rmse / noise_sd).powi(2),
                p_value: if rmse > 1.3 * noise_sd { 1e-9 } else { 0.4 },
            }
        })
        .collect();
    let varied: Vec<usize> = (0..14).collect();
    let mut residual_curves = Vec::new();
    for (k, output) in OUTPUTS.iter().enumerate().take(OUTPUTS.len() - 1) {
        for &j in &varied {
            let points: Vec<(f64, f64)> = impacts.iter().map(|i| (i.inputs[j], i.outputs[k].residual())).collect();
            if let Some(curve) = smooth(&points, 31) {
                residual_curves.push(ResidualCurve { output: (*output).to_owned(), input: INPUTS[j].to_owned(), curve });
            }
        }
    }
    let face_maps = (0..OUTPUTS.len() - 1)
        .map(|k| {
            let points: Vec<(f64, f64, f64)> = impacts.iter().map(|i| (i.inputs[12], i.inputs[13], i.outputs[k].residual())).collect();
            FaceMap { output: OUTPUTS[k].to_owned(), cell_m: 0.02, cells: face_map(&points, 0.02) }
        })
        .collect();
    let x: Vec<f64> = (0..21).map(|i| -0.1 + 0.01 * f64::from(i)).collect();
    let mean: Vec<f64> = x.iter().map(|x| 30.0 - 200.0 * x * x).collect();
    let held = HeldEffect { input: "impact_x".into(), low: mean.iter().map(|m| m - 0.3).collect(), high: mean.iter().map(|m| m + 0.3).collect(), x, mean };
    let parameter = |value, sd| ParameterValue { name: name.to_owned(), value, sd, at_limit: true, undetermined: false };
    Comparison {
        verdict: if miss > 0.0 { Adequacy::Inadequate } else { Adequacy::Adequate },
        false_alarm_rate: 0.01,
        structure: structure(if miss > 0.0 { 1e-6 } else { 0.4 }),
        model: name.to_owned(),
        n_impacts: n,
        n_held_out: n / 3,
        outputs,
        heldout_error: 1.0 + miss,
        fit_error: 1.0 + miss,
        heldout_error_refitted: 1.0 + 0.8 * miss,
        noise_floor: 1.01,
        parameters_as_stated: vec![parameter(0.85, 0.0)],
        parameters_refitted: vec![parameter(0.81, 0.004)],
        input_names: INPUTS.iter().map(|s| (*s).to_owned()).collect(),
        output_names: OUTPUTS.iter().map(|s| (*s).to_owned()).collect(),
        impacts,
        residual_curves,
        face_maps,
        polynomials: vec![PolynomialFit {
            output: "ball_out_vz".into(),
            rmse: 0.2,
            rmse_heldout: 0.25,
            r2_heldout: 0.98,
            n_terms: 40,
            terms: vec![],
            effects: vec![held],
        }],
        outliers: vec![Outlier { id: name.to_owned(), column: name.to_owned(), standardised: -6.3 }],
        session_offsets: vec![SessionOffset { session: name.to_owned(), input: "impact_x".into(), value: 1e-4, sd: 2e-4, prior_sd: 6e-4, unit: "m".into() }],
        left_out: vec![LeftOut { id: name.to_owned(), reason: name.to_owned() }],
        doubts: vec![name.to_owned()],
        notes: vec![name.to_owned()],
        provenance: Some(provenance(name)),
    }
}

pub fn provenance(name: &str) -> Provenance {
    let mut p = Provenance::new(name);
    p.inputs.insert(name.to_owned(), "ab".repeat(32));
    p
}

fn structure(p_value: f64) -> StructureTest {
    StructureTest {
        statistic: 400.0,
        rank: 96,
        p_value,
        noise_scale: 1.02,
        noise_by_group: Vec::new(),
        columns_of_groups: 0,
        by_group: Vec::new(),
        lone_term: None,
        residual_chi2: 2040.0,
        residual_freedom: 2000.0,
        excess: 300.0,
        seed: 1,
    }
}

/// A diagnosis with everything in it.
pub fn diagnosis(verdict: Verdict, name: &str) -> Diagnosis {
    let parameters = BTreeMap::from([(name.to_owned(), Estimate { value: 141.2, sd: 3.1 })]);
    let candidate = |effect: &str, probability: f64, after: f64| CandidateReport {
        effect: effect.to_owned(),
        probability,
        heldout_error_before: 1.8,
        heldout_error_after: after,
        parameters: parameters.clone(),
        aliases: vec![name.to_owned(), "hand-mass".into()],
        kind: "physics".into(),
        log_evidence_gain: 120.0,
        chi2_gain: 260.0,
        p_value: 1e-20,
        share_removed: 0.97,
        alias_cosines: BTreeMap::from([("hand-mass".to_owned(), 0.97)]),
        refitted: true,
    };
    let c = comparison(60, 0.8, name);
    Diagnosis {
        verdict,
        outputs: c.outputs,
        places: vec![Place {
            output: "ball_out_vz".into(),
            input: "impact_x".into(),
            from: -0.12,
            to: -0.05,
            mean_residual: -1.9,
            ci_low: -2.3,
            ci_high: -1.5,
            mean_elsewhere: -0.1,
            n: 14,
            p_value: 1e-6,
            words: format!("ball velocity z after is over-predicted by 1.9 m/s for impacts beyond 50 mm toward the tip, not elsewhere {name}"),
        }],
        candidates: vec![candidate(name, 0.93, 1.02), candidate("hand-mass", 0.06, 1.2), candidate("scale-error", 0.0004, 1.7)],
        suggested_expression: Some(SuggestedExpression {
            replaces: "restitution".into(),
            expression: name.to_owned(),
            heldout_error_after: 1.01,
            nearest: vec![name.to_owned()],
            parameters,
            share_removed: 0.99,
            log_evidence_gain: 10.0,
            words: name.to_owned(),
            model_file_text: format!("[effects.{name}]\nexpression = \"restitution * (1 - k * abs(impact_y))\"\n"),
        }),
        next_experiments: vec![NextExperiment {
            separates: [name.to_owned(), "hand-mass".into()],
            impacts: (0..6)
                .map(|i| BTreeMap::from([("impact_x".to_owned(), 0.02 * f64::from(i) - 0.05), ("impact_y".to_owned(), 0.0), ("ball_in_vz".to_owned(), -25.0)]))
                .collect(),
            why: name.to_owned(),
            repeats: 2,
            expected_log_evidence: 1.9,
        }],
        noise_floor: 1.0,
        recommended: vec![name.to_owned()],
        together: Some(Together {
            effects: vec![name.to_owned(), "hand-mass".into()],
            probability: 0.4,
            heldout_error_before: 1.8,
            heldout_error_after: 1.0,
            log_evidence_gain: 5.0,
            share_removed: 0.99,
            parameters: BTreeMap::new(),
        }),
        other_form: Some(name.to_owned()),
        heldout_error: 1.8,
        n_impacts: 60,
        n_held_out: 20,
        structure: structure(1e-6),
        structure_after: Some(structure(0.5)),
        library_p_value: 1e-9,
        n_tested: 25,
        spot_p_value: 1.0,
        false_alarm_rate: 0.04,
        not_visible: vec![NotVisible { effect: name.to_owned(), reason: name.to_owned() }],
        parameters: c.parameters_refitted,
        outliers: c.outliers,
        session_offsets: c.session_offsets,
        words: vec![name.to_owned()],
        left_out: vec![LeftOut { id: name.to_owned(), reason: name.to_owned() }],
        notes: vec![name.to_owned()],
        model: name.to_owned(),
        seed: 1,
        provenance: Some(provenance(name)),
    }
}

pub fn ledger_entry(step: &str, error: f64, name: &str) -> LedgerEntry {
    LedgerEntry {
        base: "rigid".into(),
        form: String::new(),
        model_hash: step.to_owned(),
        model_file: name.to_owned(),
        parent: None,
        step: step.to_owned(),
        effects: vec![name.to_owned()],
        parameters: vec![ParameterValue { name: name.to_owned(), value: 0.8, sd: 0.01, at_limit: false, undetermined: false }],
        heldout_error: error,
        fit_error: error * 0.97,
        noise_floor: 1.0,
        n_impacts: 60,
        n_held_out: 20,
        data_hash: "d".into(),
        date: "2026-11-21".into(),
        verdict: Adequacy::Inadequate,
        refused: vec![sweetspot::validation::ledger::Refusal {
            effect: name.to_owned(),
            reason: name.to_owned(),
            heldout_error_before: 1.0,
            heldout_error_after: 1.1,
        }],
        program_version: "0".into(),
    }
}
