use super::*;
use crate::impact::rigid::tests::{reference_equipment, reference_input};
use nalgebra::Vector3;

fn rigid(friction: f64) -> Model {
    let mut model = Model::new(Base::Rigid);
    model.set("friction", friction).expect("known");
    model
}

fn sensitivity(model: &Model) -> SensitivityModel {
    let (racket, ball) = reference_equipment();
    SensitivityModel::new(model, &racket, &ball).expect("valid")
}

fn oblique(across: f64) -> ImpactInput {
    ImpactInput { ball_velocity: Vector3::new(1.0, across, -28.0), ..reference_input() }
}

fn difference(a: &[Column], b: &[Column]) -> f64 {
    a.iter().zip(b).flat_map(|(x, y)| x.iter().zip(y).map(|(x, y)| (x - y).abs() / (1.0 + x.abs()))).fold(0.0, f64::max)
}

/// Dual numbers against differences, sticking and sliding, both sides of the strings.
#[test]
fn agrees_exact_with_extrapolated_differences() {
    for friction in [0.05, 0.45] {
        let s = sensitivity(&rigid(friction));
        for across in [-15.0, -4.0, 0.5, 9.0, 20.0] {
            for side in [1.0, -1.0] {
                let mut input = oblique(across);
                input.ball_velocity.z *= side;
                input.racket_velocity.z *= side;
                let (exact, numerical) = (s.at(&input).expect("contact"), s.numerically(&input).expect("contact"));
                assert!(exact.exact && !numerical.exact && numerical.edges.is_empty(), "{:?}", numerical.edges);
                assert!(difference(&exact.by_input, &numerical.by_input) < 1e-7, "{}", difference(&exact.by_input, &numerical.by_input));
                assert!(difference(&exact.by_parameter, &numerical.by_parameter) < 1e-7);
            }
        }
    }
}

/// By the bodies' numbers: against central differences of the effect that mis-states them.
#[test]
fn agrees_bodies_with_racket_inertia() {
    let (racket, _) = reference_equipment();
    let by_body = sensitivity(&rigid(0.45)).by_body(&oblique(9.0)).expect("contact");
    let stated = rigid(0.45).with_effect("racket-inertia").expect("known");
    let numerical = sensitivity(&stated).at(&oblique(9.0)).expect("contact");
    let index = |name: &str| stated.index_of(name).expect("known");
    let inertia = racket.inertia_kg_m2();
    for (name, row, scale) in [
        ("racket-inertia.mass", 0, racket.mass_kg),
        ("racket-inertia.twist", 1, inertia.x),
        ("racket-inertia.swing", 2, inertia.y),
        ("racket-inertia.chop", 3, inertia.z),
    ] {
        let exact: Column = by_body[row].map(|d| scale * d);
        assert!(difference(&[exact], &[numerical.by_parameter[index(name)]]) < 1e-7, "{name}");
    }
    assert!(sensitivity(&stated).by_body(&oblique(9.0)).is_err());
}

/// Every effect in both bases: extrapolated differences against plain central ones with another step.
#[test]
fn agrees_effects_with_central_differences() {
    let (racket, ball) = reference_equipment();
    for base in [Base::Rigid, Base::Viscoelastic] {
        for card in crate::impact::catalogue() {
            let model = Model::new(base).with_effect(card.name).expect("known");
            let input = ImpactInput { grip_torque: 3.0, order: 40.0, ..oblique(9.0) };
            let s = sensitivity(&model).at(&input).expect("contact");
            // Strings rigid sideways are written as a stiffness of 0: no derivative there, and that is said.
            assert!(s.edges.iter().all(|e| e == "k_t"), "{} {}: {:?}", base.name(), card.name, s.edges);
            assert_eq!(s.edges.len(), usize::from(base == Base::Viscoelastic), "{} {}", base.name(), card.name);
            for index in model.effect_parameters(card.name) {
                let h = 3e-3 * model.parameters()[index].typical;
                let at = |by: f64| {
                    let mut moved = model.clone();
                    moved.set_at(index, model.values()[index] + by).expect("finite");
                    moved.prepare(&racket, &ball).expect("valid").predict(&input).expect("contact").as_columns().map(|c| c.unwrap_or(0.0))
                };
                let (up, down) = (at(h), at(-h));
                for k in 0..12 {
                    let scale = model.parameters()[index].typical / OUTPUT_SCALE[k];
                    let central = (up[k] - down[k]) / (2.0 * h);
                    let seen = s.by_parameter[index][k];
                    assert!((seen - central).abs() * scale < 2e-3, "{} {}: {seen} against {central}", base.name(), model.parameters()[index].name);
                }
            }
        }
    }
}

/// At the edge between sticking and sliding there is no derivative, and that is said.
#[test]
fn fails_an_edge_is_named() {
    let s = sensitivity(&rigid(0.0));
    let mut model = rigid(0.2).with_effect("ball-damping").expect("known");
    // The friction with which this impact just sticks: bisect on whether friction still matters.
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        model.set("friction", middle).expect("known");
        let at = sensitivity(&model).centre.predict(&oblique(9.0)).expect("contact");
        model.set("friction", 5.0).expect("known");
        let sticking = sensitivity(&model).centre.predict(&oblique(9.0)).expect("contact");
        if (at.ball_spin - sticking.ball_spin).norm() < 1e-12 { high = middle } else { low = middle }
    }
    model.set("friction", high).expect("known");
    let edge = sensitivity(&model).at(&oblique(9.0)).expect("contact");
    assert!(edge.edges.iter().any(|e| e == "friction"), "{:?}", edge.edges);
    assert!(s.at(&oblique(9.0)).is_ok());
}

/// First-order standard deviations against the spread of many impacts with scattered inputs.
#[test]
fn agrees_output_sd_with_monte_carlo() {
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};
    let sd = [0.2, 0.2, 0.2, 5.0, 5.0, 5.0, 0.1, 0.1, 0.1, 0.3, 0.3, 0.3, 0.002, 0.002, 0.0];
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let unit = Normal::new(0.0, 1.0).expect("valid");
    for model in [rigid(0.45), Model::new(Base::Viscoelastic)] {
        let s = sensitivity(&model);
        let predicted = s.at(&oblique(6.0)).expect("contact").output_sd(&sd);
        let columns = oblique(6.0).as_columns();
        let inputs: Vec<ImpactInput> =
            (0..4000).map(|_| ImpactInput::from_columns(&std::array::from_fn(|j| columns[j] + sd[j] * unit.sample(&mut rng)), 0.0)).collect();
        let outputs: Vec<Column> = s.centre.predict_all(&inputs).into_iter().map(|o| o.expect("contact").as_columns().map(|c| c.unwrap_or(0.0))).collect();
        for k in 0..12 {
            let mean = outputs.iter().map(|o| o[k]).sum::<f64>() / 4000.0;
            let spread = (outputs.iter().map(|o| (o[k] - mean).powi(2)).sum::<f64>() / 3999.0).sqrt();
            assert!((predicted[k] / spread - 1.0).abs() < 0.06, "{} output {k}: {} against {spread}", model.base().name(), predicted[k]);
        }
    }
}
