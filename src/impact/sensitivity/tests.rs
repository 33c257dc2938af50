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
            let soft_sideways = base == Base::Rigid || card.name == "lateral-strings";
            assert_eq!(s.edges.len(), usize::from(!soft_sideways), "{} {}", base.name(), card.name);
            assert!(base == Base::Rigid || s.exact, "{}", card.name);
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

/// What `compare`, `fit` and `diagnose` gain from differences over one deviation of each input: the variance that inputs carry
/// into an outcome, against the scatter of 4000 draws, where the scatter crosses from sticking to sliding and where it does not.
#[test]
fn agrees_with_scatter_across_the_edge_of_sticking() {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    const SD: [f64; INPUTS.len()] = [0.1, 0.1, 0.1, 8.0, 8.0, 8.0, 0.08, 0.08, 0.08, 0.6, 0.6, 0.6, 0.0015, 0.0015, 0.0];
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    // Sum of ln(variance told / variance seen) and of its square, and how many, by derivative and by difference.
    let mut tally = [[[0.0f64; 3]; 2]; 2];
    for share in [0.9, 0.97, 1.0, 1.03, 1.1, 2.0] {
        for k in 0..20 {
            let input = oblique(f64::from(k) - 20.5);
            // `share` of the friction with which this impact just sticks.
            let gripping = sensitivity(&rigid(5.0)).centre.predict(&input).expect("contact");
            let change = gripping.ball_velocity - input.ball_velocity;
            let friction = share * change.xy().norm() / change.z;
            let s = sensitivity(&rigid(friction));
            let columns = input.as_columns();
            let moved = |by: &dyn Fn(usize) -> f64| {
                let c: [f64; INPUTS.len()] = std::array::from_fn(|j| columns[j] + by(j));
                s.centre.predict(&ImpactInput::from_columns(&c, 0.0)).expect("contact").as_vector()
            };
            let told = [
                s.at(&input).expect("contact").output_sd(&SD).map(|sd| sd * sd),
                (0..INPUTS.len()).fold([0.0; OUTPUTS.len()], |sum, j| {
                    let (up, down) = (moved(&|i| if i == j { SD[j] } else { 0.0 }), moved(&|i| if i == j { -SD[j] } else { 0.0 }));
                    std::array::from_fn(|n| sum[n] + if n < 12 { (0.5 * (up[n] - down[n])).powi(2) } else { 0.0 })
                }),
            ];
            // The ball's spin across the flight is what tells sticking from sliding.
            let column = 3;
            let mut draws = Vec::new();
            let mut stuck = 0;
            for _ in 0..4000 {
                let by: [f64; INPUTS.len()] = std::array::from_fn(|j| {
                    let z: f64 = StandardNormal.sample(&mut rng);
                    z * SD[j]
                });
                let out = moved(&|j| by[j]);
                let c: [f64; INPUTS.len()] = std::array::from_fn(|j| columns[j] + by[j]);
                let at = crate::impact::rigid::Contact::new(s.centre.body(), &ImpactInput::from_columns(&c, 0.0)).expect("contact");
                let body = s.centre.body();
                let laws = crate::impact::rigid::Laws::new(0.8, friction, Sliding::FirstTouch, body.ball_radius, body.ball_inertia);
                stuck += usize::from(crate::impact::rigid::collide(&at, &laws, &|_, _, _| {}).0.regime == crate::impact::rigid::Regime::Stick);
                draws.push(out[column]);
            }
            let mean = draws.iter().sum::<f64>() / 4000.0;
            let seen = draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / 3999.0;
            let edge = usize::from((400..3600).contains(&stuck));
            for (method, t) in told.iter().enumerate() {
                let ratio = (t[column] / seen).ln();
                let sum = &mut tally[edge][method];
                *sum = [sum[0] + ratio, sum[1] + ratio * ratio, sum[2] + 1.0];
            }
        }
    }
    for (edge, name) in ["away from the edge", "across the edge"].into_iter().enumerate() {
        let [a, b] = tally[edge].map(|t| ((t[0] / t[2]).exp(), (t[1] / t[2]).sqrt(), t[2]));
        eprintln!("{name}: {} impacts; told over seen variance, mean and scatter: derivative {:.3}, {:.3}; difference {:.3}, {:.3}", a.2, a.0, a.1, b.0, b.1);
        assert!(a.2 > 30.0 && (b.0 - 1.0).abs() < 0.08 && b.1 < if edge == 0 { 0.1 } else { 0.6 * a.1 }, "{name}: {a:?} {b:?}");
    }
}

/// Through the visco-elastic contact in dual numbers, against extrapolated differences of finely stepped contacts.
#[test]
fn agrees_dual_contact_with_differences() {
    let rich = ["frame-vibration", "grip-torque", "string-tilt", "stringbed-edge", "offset-normal-force", "swing-drive", "hand-mass", "scale-error"];
    let rich = rich.iter().try_fold(Model::new(Base::Viscoelastic), |m, e| m.with_effect(e)).expect("known");
    let springs = Model::new(Base::Viscoelastic).with_effect("lateral-strings").expect("known");
    let mut worst = 0.0f64;
    for model in [Model::new(Base::Viscoelastic), rich, springs] {
        for across in [-12.0, 2.0, 9.0, 19.0] {
            let input = ImpactInput { grip_torque: 3.0, ..oblique(across) };
            let mut s = sensitivity(&model);
            let exact = s.at(&input).expect("contact");
            s.centre.set_steps(600.0);
            let numerical = s.numerically(&input).expect("contact");
            for (n, (a, b)) in exact.by_input.iter().zip(&numerical.by_input).enumerate() {
                for k in 0..OUTPUTS.len() {
                    worst = worst.max((a[k] - b[k]).abs() * INPUT_SCALE[n] / OUTPUT_SCALE[k]);
                }
            }
            for ((a, b), p) in exact.by_parameter.iter().zip(&numerical.by_parameter).zip(model.parameters()) {
                if exact.edges.contains(&p.name) || numerical.edges.contains(&p.name) {
                    continue;
                }
                for k in 0..OUTPUTS.len() {
                    let error = (a[k] - b[k]).abs() * p.typical / OUTPUT_SCALE[k];
                    assert!(error < 1e-3, "{} output {k}, {across} m/s across: {} against {}", p.name, a[k], b[k]);
                    worst = worst.max(error);
                }
            }
            eprintln!("{across} m/s across: worst so far {worst:.1e}, edges {:?}, exact {}", exact.edges, exact.exact);
        }
    }
    assert!(worst < 3e-4, "{worst:e}");
}
