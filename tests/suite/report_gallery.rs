//! Every kind of chart on one page, from made-up data: drawn for the eye (the page is kept below `target/tmp`) and
//! checked for form.

use super::report::{assert_page, racket};
use nalgebra::{Point3, Vector3};
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use sweetspot::report::chart::{Arrows, Band, Bars, Cells, Chart, Colour, Line, Points, Rule, Scene, Symbol, bin_edges, face, histogram};
use sweetspot::report::{Layout, Report, Section, Table, Tone};

fn gallery() -> String {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let mut noise = |sd: f64| sd * rng.sample::<f64, _>(StandardNormal);
    let truth: Vec<f64> = (0..60).map(|i| 25.0 + 0.25 * f64::from(i) + noise(1.0)).collect();
    let pairs: Vec<(f64, f64)> = truth.iter().map(|t| (t + noise(0.3), t - 0.02 * (t - 25.0).powi(2) / 4.0 + noise(0.2))).collect();
    let predicted = Chart::new("Ball speed after impact")
        .x("measured", "m/s")
        .y("predicted", "m/s")
        .identity_line()
        .add(Points::new(&pairs).x_error(&[0.3; 60]).y_error(&[0.4; 60]))
        .to_svg();
    let many: Vec<(f64, f64)> = (0..900)
        .map(|_| {
            let x = noise(40.0);
            (x, 0.0004 * x * x + noise(1.0))
        })
        .collect();
    let smooth = sweetspot::validation::smooth::smooth(&many, 60).unwrap();
    let line: Vec<(f64, f64)> = smooth.x.iter().copied().zip(smooth.mean.iter().copied()).collect();
    let band: Vec<(f64, f64, f64)> = (0..smooth.x.len()).map(|i| (smooth.x[i], smooth.low[i], smooth.high[i])).collect();
    let residual = Chart::new("Residual against impact position along the racket, a title that needs two lines")
        .x("impact_x", "mm")
        .y("residual", "own sd")
        .y_range(-4.0, 4.0)
        .add(Points::new(&many).name("impacts").colour(Colour::GREY))
        .add(Band::new(&band).name("95 % band").colour(Colour::ORANGE))
        .add(Line::new(&line).name("local mean").colour(Colour::ORANGE))
        .add(Rule::horizontal(0.0).solid())
        .to_svg();
    let groups: Vec<Vec<f64>> = [(16.0, 3.0), (6.2, 4.2), (-4.4, 2.9)].iter().map(|(m, s)| (0..80).map(|_| m + noise(*s)).collect()).collect();
    let edges = bin_edges(groups.iter().flatten());
    let mut histograms = Chart::new("Racket velocity before impact").x("velocity", "m/s").y("shots", "");
    for (g, name) in groups.iter().zip(["U", "V", "W"]) {
        histograms = histograms.add(Bars::new(&histogram(g, &edges)).name(name));
    }
    let racket = racket("typical 27 inch");
    let (at, side) = face::cells(&racket, 28);
    let heat: Vec<(f64, f64, f64)> = at.iter().map(|&(y, x)| (y, x, 33.0 - 0.0003 * (x - 30.0).powi(2) - 0.001 * y * y)).collect();
    let map = face::outline(face::bare("Ball speed over the face", &racket).add(Cells::new(&heat, (side, side), "m/s")), &racket).to_svg();
    let signed: Vec<(f64, f64, f64)> = at.iter().map(|&(y, x)| (y, x, x / 60.0)).collect();
    let map2 = face::outline(face::bare("Residual over the face", &racket).add(Cells::new(&signed, (side, side), "own sd").signed()), &racket).to_svg();
    let impacts: Vec<(f64, f64)> = (0..40).map(|_| (noise(26.0), -50.0 + noise(30.0))).collect();
    let spots =
        [("ideal point", 0.03), ("centre of percussion", -0.02), ("node point", -0.064)].map(|(n, x)| face::Spot { name: n.to_owned(), x_m: x, y_m: 0.0 });
    let positions = face::spots(face::face("Where the ball met the face", &racket).add(Points::new(&impacts).name("impacts")), &spots).to_svg();
    let from: Vec<(f64, f64)> = (0..80).map(|i| (f64::from(i % 10) * 50.0 + 20.0, f64::from(i / 10) * 60.0 + 20.0)).collect();
    let by: Vec<(f64, f64)> = from.iter().map(|_| (noise(0.1), noise(0.1))).collect();
    let quiver = Chart::new("Reprojection error, left camera")
        .x("u", "px")
        .y("v", "px")
        .x_range(0.0, 512.0)
        .y_range(0.0, 512.0)
        .y_reversed()
        .equal_scales()
        .add(Arrows::new(&from, &by, 200.0).name("error × 200"))
        .to_svg();
    let scatter = Chart::new("Reprojection error")
        .x("u error", "px")
        .y("v error", "px")
        .equal_scales()
        .add(Points::new(&by).name("left"))
        .add(Points::new(&by.iter().map(|p| (p.1, -p.0)).collect::<Vec<_>>()).symbol(Symbol::Square).name("right"))
        .to_svg();
    let models = ["base", "+ frame-vibration", "+ stringbed-edge"].map(str::to_owned);
    let staircase = Chart::new("Error on held-out impacts")
        .x_categories(&models)
        .y("error", "noise floor = 1")
        .y_include(0.0)
        .add(Bars::new(&[(-0.3, 0.3, 3.2), (0.7, 1.3, 1.6), (1.7, 2.3, 1.02)]).y_error(&[0.3, 0.15, 0.05]))
        .add(Rule::horizontal(1.0).name("noise floor"))
        .to_svg();
    let mut scene = Scene::new("Cameras and boards").describe("Two cameras look at 12 board positions.");
    let corner = [Vector3::new(0.1, 0.1, 1.0), Vector3::new(-0.1, 0.1, 1.0), Vector3::new(-0.1, -0.1, 1.0), Vector3::new(0.1, -0.1, 1.0)];
    scene = scene.camera(Point3::new(-0.5, 1.2, -4.0), &corner, 0.8, "left").camera(Point3::new(0.9, 1.2, -4.0), &corner, 0.8, "right");
    for k in 0..12 {
        let c = Point3::new(0.4 * f64::from(k % 4) - 0.6, 0.7 + 0.4 * f64::from(k / 4), 0.3 * f64::from(k % 3));
        let b = [(0.0, 0.0), (0.48, 0.05), (0.48, 0.36), (0.0, 0.3)].map(|(x, y)| c + Vector3::new(x, y, 0.1 * x));
        scene = scene.outline(&b, if k == 0 { "boards used" } else { "" }, Colour::of_series(0));
    }
    let path: Vec<Point3<f64>> = (0..30).map(|i| Point3::new(0.05 * f64::from(i), 1.0 + 0.2 * (0.1 * f64::from(i)).sin(), 0.1)).collect();
    let scene = scene.path(&path, "ball", Colour::ORANGE).dots(&path[..5], 4.0, "before impact", Colour::GREEN).to_svg();
    let small: Vec<(String, String)> = (0..6)
        .map(|k| {
            let svg = Chart::new(&format!("ball_out_v{k}")).size(200.0, 160.0).x("predicted", "m/s").y("measured", "m/s").identity_line();
            (svg.add(Points::new(&pairs)).to_svg(), String::new())
        })
        .collect();
    let contact =
        Chart::new("Contact time").x("impact", "").y("contact time", "s").add(Line::new(&[(0.0, 0.0041), (1.0, 0.0043), (2.0, 0.0038)]).steps()).to_svg();
    let figures: Vec<(String, String)> = [
        (predicted, "Predicted against measured, with one standard deviation."),
        (residual, "Points outside the frame stand as rings on its edge."),
        (histograms.to_svg(), "Figure 5.6 style."),
        (map, "Heat map."),
        (map2, "Signed heat map."),
        (positions, "Figure 5.20 style."),
        (quiver, "Quiver."),
        (scatter, "Figure 3.9 style."),
        (staircase, "Ledger."),
        (scene, "Figure 3.10 style."),
        (contact, "Powers of ten go to the axis title."),
    ]
    .map(|(s, c)| (s, c.to_owned()))
    .to_vec();
    let table =
        Table::new("Candidates").column("effect").numbers("probability").row_with_bars(&[("frame-vibration".into(), None), ("93 %".into(), Some(0.93))]);
    Report::new("Gallery of charts")
        .subtitle("made-up data")
        .section(
            Section::new("verdict", "Verdict")
                .verdict(Tone::Bad, &["The model misses an effect.".into(), "Ball speed is over-predicted by 1.9 m/s beyond 60 mm toward the tip.".into()])
                .cards(&[("33.4 ± 0.2 m/s".into(), "ball speed after impact".into()), ("1.9 mm".into(), "something".into())]),
        )
        .section(Section::new("all", "All charts").figures(Layout::Normal, &figures))
        .section(Section::new("small", "Small multiples").figures(Layout::Small, &small).table(table))
        .finish()
}

#[test]
fn law_the_gallery_is_well_formed_and_repeats_byte_for_byte() {
    let page = gallery();
    assert_eq!(page, gallery());
    assert_page(&page);
    let file = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("gallery.html");
    std::fs::write(file, page).unwrap();
}
