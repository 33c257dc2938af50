use super::differences::{self, COARSE, FINE, Fineness};
use super::*;
use crate::impact::rigid::Sliding;
use crate::impact::rigid::tests::{reference_equipment, reference_input};
use nalgebra::{Vector2, Vector3};
use rand::Rng;

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

/// A seeded impact as courts have them, from either side.
fn random(rng: &mut rand_chacha::ChaCha8Rng) -> ImpactInput {
    let mut u = |size: f64| rng.random_range(-size..size);
    let side = u(1.0).signum();
    ImpactInput {
        ball_velocity: Vector3::new(u(6.0), u(12.0), side * (-24.0 + u(8.0))),
        ball_spin: Vector3::new(u(200.0), u(200.0), u(50.0)),
        racket_velocity: Vector3::new(u(2.0), u(4.0), side * (6.0 + u(4.0))),
        racket_rate: Vector3::new(u(5.0), side * (15.0 + u(10.0)), u(8.0)),
        position: Vector2::new(u(0.08), u(0.06)),
        grip_torque: 3.0 + u(2.0),
        order: 40.0 + u(30.0).round(),
        own: Default::default(),
    }
}

/// Compares all derivatives at one impact with differences and returns the largest difference as a share of a typical change, how
/// many were compared and how many were not: at an edge, or where differences do not settle.
fn compare(s: &SensitivityModel, input: &ImpactInput, fineness: Fineness) -> (f64, usize, usize) {
    let exact = s.at(input).expect("contact");
    let numerical = differences::all(s, input, fineness).expect("contact");
    let (mut worst, mut compared, mut left) = (0.0f64, 0, 0);
    for (n, (a, b)) in exact.by_input.iter().chain(&exact.by_parameter).zip(&numerical).enumerate() {
        match b {
            Some(b) if !exact.edges.iter().any(|e| e == s.name(n)) => {
                let error = differences::apart(s, n, a, b);
                if error > 1e-6 {
                    eprintln!("{}: {error:.1e} {a:?} {b:?}", s.name(n));
                }
                worst = worst.max(error);
                compared += 1;
            }
            _ => left += 1,
        }
    }
    (worst, compared, left)
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
                let (worst, _, left) = compare(&s, &input, FINE);
                assert!(worst < 1e-8 && left == 0, "{worst:e}, {left} left");
            }
        }
    }
}

/// Puts an effect's parameters at random places of their ranges around what is typical.
fn scatter(model: &mut Model, effect: &str, rng: &mut rand_chacha::ChaCha8Rng) {
    for i in model.effect_parameters(effect) {
        let p = &model.parameters()[i];
        let value = (p.value + rng.random_range(-1.0..1.0) * p.typical).clamp(p.min, p.max);
        // Away from the kinks that a strength of 0 may be.
        let value = if p.min == 0.0 { value.max(0.1 * p.typical) } else { value };
        model.set_at(i, value).expect("finite");
    }
}

/// Every effect of the catalogue in base rigid, and all of them at once, at seeded random impacts and parameters.
#[test]
fn agrees_rigid_effects_with_differences() {
    use rand::SeedableRng;
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
    let names: Vec<&str> = crate::impact::catalogue().iter().map(|c| c.name).collect();
    let alone: Vec<Vec<&str>> = names.iter().map(|n| vec![*n]).collect();
    let (mut compared, mut left, mut most) = (0, 0, 0.0f64);
    for group in alone.iter().chain([&names, &vec!["frame-vibration", "hand-mass"]]) {
        let mut worst = 0.0f64;
        for k in 0..12 {
            let mut model = group.iter().try_fold(rigid(rng.random_range(0.1..0.8)), |m, e| m.with_effect(e)).expect("known");
            group.iter().for_each(|e| scatter(&mut model, e, &mut rng));
            if k % 4 == 3 {
                model.set_sliding(Sliding::Exact);
            }
            let (error, some, none) = compare(&sensitivity(&model), &random(&mut rng), FINE);
            worst = worst.max(error);
            (compared, left) = (compared + some, left + none);
        }
        eprintln!("{:<22} {worst:.1e}", if group.len() == 1 { group[0] } else { "several" });
        most = most.max(worst);
    }
    eprintln!("{compared} derivatives compared, {left} not");
    assert!(most < 1e-7 && left * 50 < compared, "{most:e}, {left} left of {compared}");
}

/// Every effect of the catalogue, and formulae, in the visco-elastic base: what each makes of an impact before the contact is stepped (start, bodies,
/// laws) and after. The contact between them has its own test.
#[test]
fn agrees_viscoelastic_effects_with_differences() {
    use crate::impact::dual::Dual;
    use crate::impact::viscoelastic::Ended;
    use rand::SeedableRng;
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(13);
    let (mut compared, mut most) = (0, 0.0f64);
    let mut models: Vec<(&str, Model)> = Vec::new();
    for card in crate::impact::catalogue().iter().chain(crate::impact::catalogue()) {
        let mut model = Model::new(Base::Viscoelastic).with_effect(card.name).expect("known");
        scatter(&mut model, card.name, &mut rng);
        models.push((card.name, model));
    }
    for (replaces, text) in [
        ("restitution", "restitution * (1 - k * impact_y / half_width)"),
        ("friction", "friction * (1 + k * impact_x / half_length)"),
        ("string_stiffness", "string_stiffness * (1 + k * approach_speed / 25)"),
        ("normal_impulse", "normal_impulse * (1 + 0.1 * k * restitution)"),
        ("impulse_turn", "k * obliqueness"),
    ] {
        let own = vec![crate::impact::Parameter::own("k", 0.3)];
        models.push((replaces, Model::new(Base::Viscoelastic).with_expression("own", replaces, text, own).expect(text)));
    }
    for (name, model) in models {
        let (s, input) = (sensitivity(&model), random(&mut rng));
        let output = ImpactOutput::from_columns(&std::array::from_fn(|k| 5.0 + (7 * k % 5) as f64));
        let after = Ended { output, handle: nalgebra::Vector3::new(0.9, -0.3, 0.2) };
        let dual_output = ImpactOutput::from_columns(&output.as_columns().map(|c| Dual::constant(c.expect("all"))));
        let dual_after = Ended { output: dual_output, handle: after.handle.map(Dual::constant) };
        let mut worst = 0.0f64;
        for n in 0..INPUTS.len() + model.parameters().len() {
            let numbers = |by: f64| -> Vec<f64> {
                let (mut columns, mut moved) = (input.as_columns(), model.clone());
                match n.checked_sub(INPUTS.len()) {
                    None => columns[n] += by,
                    Some(i) => moved.set_at(i, model.values()[i] + by).expect("finite"),
                }
                let prepared = PreparedModel::new(moved, s.body.clone()).expect("valid");
                let staged = prepared.stage(&ImpactInput::from_columns(&columns, input.order)).expect("contact");
                let seen = prepared.conclude(&staged, after).expect("finite");
                [&staged.laws.numbers()[..], &staged.contact.as_columns(), &seen.as_columns().map(|c| c.expect("all"))].concat()
            };
            let pass = n / TOGETHER;
            let dual = ImpactInput::from_columns(&std::array::from_fn(|j| varied(input.as_columns()[j], j, pass)), input.order);
            let staged = s.passes[pass].stage(&dual).expect("contact");
            let seen = s.passes[pass].conclude(&staged, dual_after).expect("finite");
            let exact = [&staged.laws.numbers()[..], &staged.contact.as_columns(), &seen.as_columns().map(|c| c.expect("all"))].concat();
            let h = 1e-3 * s.scale(n);
            let [a, b, c, d] = [h, -h, 0.5 * h, -0.5 * h].map(numbers);
            for (k, exact) in exact.iter().enumerate() {
                let (whole, half) = ((a[k] - b[k]) / (2.0 * h), (c[k] - d[k]) / h);
                let (slope, expected) = (exact.slope[n % TOGETHER], half + (half - whole) / 3.0);
                // As a share of the number itself and of what a typical change makes of it.
                let error = (slope - expected).abs() * s.scale(n) / (1e-9 + exact.value.abs() + expected.abs() * s.scale(n));
                assert!(error < 1e-7, "{name} by {}, number {k}: {slope} against {expected}", s.name(n));
                worst = worst.max(error);
                compared += usize::from(slope != 0.0);
            }
        }
        eprintln!("{name:<22} {worst:.1e}");
        most = most.max(worst);
    }
    eprintln!("{compared} derivatives compared, worst {most:.1e}");
    assert!(compared > 2000);
}

/// A user's expressions, kinks among them, each with its own parameters.
#[test]
fn agrees_expressions_with_differences() {
    use crate::impact::Parameter;
    use rand::SeedableRng;
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(17);
    let (mut compared, mut left) = (0, 0);
    for (replaces, text) in [
        ("restitution", "restitution * (1 - k * abs(impact_y / 0.13)) - 0.01 * max(approach_speed / 25 - 1, 0) ^ 2"),
        ("restitution", "min(restitution, 0.9 - k * sqrt(approach_speed / 40))"),
        ("restitution", "clamp(restitution - k * tanh(node_distance / 0.1) ^ 2, 0.2, 0.9)"),
        ("friction", "friction * exp(-k * slip_speed / 20) + 0.05 * step(impact_x) * cos(incidence)"),
        ("friction", "friction + k * 0.2 * sign(impact_y) * ln(1 + hypot(slip_x, slip_y) / 10)"),
        ("torque_arm_x", "0.002 * k * sin(spin_ratio) + 0.01 * atan2(impact_y, half_width)"),
        ("tangential_restitution_y", "k * atan(obliqueness) * effective_mass / racket_mass"),
        ("tangential_restitution_diagonal", "k + 0.1 * tangential_restitution_antidiagonal"),
        ("impulse_antidiagonal", "impulse_antidiagonal * (1 + 0.3 * k)"),
        ("swing_inertia", "swing_inertia * (1 + 0.3 * k * tan(impact_x / half_length))"),
        ("hand_mass", "0.1 * k * (1 + order / 100)"),
        ("impulse_y", "impulse_y * (1 + k * spin_across / 500) + 0.001 * k * normal_impulse"),
        ("impulse_turn", "k * (1 + impact_x / half_length)"),
        ("spin_impulse_turn", "0.3 * k * obliqueness"),
        ("spin_turn", "k * approach_speed / 25"),
        ("spin_impulse_x", "spin_impulse_x + 0.001 * k * tangential_impulse * ball_radius / 0.01"),
        ("ball_out_vz", "ball_out_vz * (1 - 0.1 * k * mod(impact_distance / 0.03, 7)) + 0.01 * ball_out_wx * ball_radius"),
    ] {
        let mut worst = 0.0f64;
        for _ in 0..6 {
            let mut model = rigid(0.45).with_expression("own", replaces, text, vec![Parameter::own("k", 0.3)]).expect(text);
            model.set("own.k", rng.random_range(0.1..0.5)).expect("known");
            let (error, some, none) = compare(&sensitivity(&model), &random(&mut rng), FINE);
            worst = worst.max(error);
            (compared, left) = (compared + some, left + none);
        }
        assert!(worst < 1e-7, "{text}: {worst:e}");
    }
    assert!(left * 50 < compared, "{left} left of {compared}");
    // The branch taken: at rest across the middle line neither side's slope is taken.
    let model = rigid(0.45).with_expression("own", "restitution", "restitution - k * abs(impact_y / 0.13)", vec![Parameter::own("k", 0.3)]).expect("valid");
    for (y, sign) in [(1e-9, -1.0), (-1e-9, 1.0)] {
        let input = ImpactInput { position: Vector2::new(0.0, y), ..oblique(0.0) };
        let s = sensitivity(&model).at(&input).expect("contact");
        assert!(s.edges.is_empty() && s.by_input[13][2] * sign > 1.0, "{:?}", s.by_input[13]);
    }
}

/// Strings rigid sideways are written as a stiffness of 0: a derivative by it does not exist, and that is said; nor by a mode's
/// strength of 0.
#[test]
fn fails_parts_that_appear_are_named() {
    for card in crate::impact::catalogue() {
        let model = Model::new(Base::Viscoelastic).with_effect(card.name).expect("known");
        let edges = sensitivity(&model).at(&ImpactInput { grip_torque: 3.0, order: 40.0, ..oblique(9.0) }).expect("contact").edges;
        let soft_sideways = card.name == "lateral-strings";
        assert!(edges.iter().all(|e| e == "k_t") && edges.len() == usize::from(!soft_sideways), "{}: {edges:?}", card.name);
    }
    let mut still = Model::new(Base::Viscoelastic).with_effect("frame-vibration").expect("known");
    still.set("frame-vibration.amount", 0.0).expect("known");
    assert_eq!(sensitivity(&still).at(&oblique(9.0)).expect("contact").edges, ["k_t", "frame-vibration.amount"]);
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

/// Through visco-elastic contacts with many effects in dual numbers, against extrapolated differences of finely stepped contacts.
#[test]
fn agrees_dual_contact_with_differences() {
    let rich = ["frame-vibration", "grip-torque", "string-tilt", "stringbed-edge", "offset-normal-force", "swing-drive", "hand-mass", "scale-error"];
    let rich = rich.iter().try_fold(Model::new(Base::Viscoelastic), |m, e| m.with_effect(e)).expect("known");
    let springs = Model::new(Base::Viscoelastic).with_effect("lateral-strings").expect("known");
    let mut worst = 0.0f64;
    for model in [Model::new(Base::Viscoelastic), rich, springs] {
        for across in [-12.0, 2.0, 9.0, 19.0] {
            let mut s = sensitivity(&model);
            s.centre.set_steps(600.0);
            worst = worst.max(compare(&s, &ImpactInput { grip_torque: 3.0, ..oblique(across) }, COARSE).0);
            eprintln!("{across} m/s across: worst so far {worst:.1e}");
        }
    }
    assert!(worst < 3e-4, "{worst:e}");
}
