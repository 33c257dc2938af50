//! The report: well-formed, self-contained, safe with hostile names, small.

use super::report_mock::{comparison, diagnosis, ledger_entry};
use sweetspot::equipment::{Head, Racket, Strings};
use sweetspot::report::chart::{Chart, Colour, Line, Points, Scene, Symbol};
use sweetspot::report::{Report, Section, Table, comparison_report, diagnosis_report};
use sweetspot::validation::Verdict;

/// A name as an unkind user might write it.
pub const HOSTILE: &str = "</title><script>alert('x')</script>\"&<svg onload=x>\u{0}\u{202e}]]>%s{{x}}";

pub fn racket(name: &str) -> Racket {
    Racket {
        name: name.to_owned(),
        mass_kg: 0.340,
        length_m: 0.685,
        balance_m: 0.330,
        stringbed_centre_m: 0.4975,
        swingweight_kgm2: 0.0325,
        twistweight_kgm2: 0.0015,
        spinweight_kgm2: None,
        head: Head { inner_length_m: 0.335, inner_width_m: 0.255, tube_radius_m: 0.010 },
        strings: Strings { tension_lb: 60.0 },
        markers: None,
    }
}

/// Well-formed, no script, nothing fetched, every figure named, below 5 MB.
pub fn assert_page(page: &str) {
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let tree = roxmltree::Document::parse_with_options(page, options).unwrap_or_else(|e| panic!("not well-formed: {e}"));
    let mut ids = std::collections::BTreeSet::new();
    for node in tree.descendants().filter(roxmltree::Node::is_element) {
        let tag = node.tag_name().name();
        assert!(!["script", "iframe", "object", "embed", "link", "foreignObject", "use", "base", "form"].contains(&tag), "<{tag}> in the report");
        for a in node.attributes() {
            assert!(!a.name().to_lowercase().starts_with("on"), "event handler {}", a.name());
            if ["href", "src", "action", "data"].contains(&a.name()) {
                assert!(a.value().starts_with('#') || a.value().starts_with("data:image/png;base64,"), "{} = {:.60}", a.name(), a.value());
            }
        }
        if let Some(id) = node.attribute("id") {
            assert!(ids.insert(id.to_owned()), "id {id} stands twice");
        }
        if tag == "svg" {
            assert!(node.first_element_child().is_some_and(|c| c.tag_name().name() == "title"), "a figure without title");
            assert_eq!(node.attribute("role"), Some("img"));
        }
    }
    for link in tree.descendants().filter_map(|n| n.attribute("href")).filter(|l| l.starts_with('#')) {
        assert!(ids.contains(link.trim_start_matches('#')), "{link} leads nowhere");
    }
    assert!(!page.contains("url(") && !page.contains("@import"), "the style fetches something");
    for bad in ["NaN", "inf ", ">inf<", "\"inf\""] {
        assert!(!page.contains(bad), "{bad} in the report");
    }
    assert!(page.len() < 5_000_000, "{} bytes", page.len());
}

#[test]
fn law_hostile_text_stays_text_everywhere() {
    let chart = Chart::new(HOSTILE).describe(HOSTILE).x(HOSTILE, HOSTILE).y(HOSTILE, HOSTILE).note(HOSTILE);
    let chart = chart.add(Points::new(&[(f64::NAN, 1.0), (1.0, f64::INFINITY), (2.0, 3.0)]).name(HOSTILE).labels(&vec![HOSTILE.to_owned(); 3]));
    let chart = chart.x_categories(&[HOSTILE.to_owned()]);
    let scene = Scene::new(HOSTILE).axis_names([HOSTILE; 3]).text(nalgebra::Point3::new(0.0, f64::NAN, 1.0), HOSTILE).text(nalgebra::Point3::origin(), HOSTILE);
    let section = Section::new(HOSTILE, HOSTILE)
        .paragraph(HOSTILE)
        .code(HOSTILE)
        .list(&[HOSTILE.to_owned()])
        .figure(&chart.to_svg(), HOSTILE)
        .figure(&scene.to_svg(), HOSTILE)
        .table(Table::new(HOSTILE).column(HOSTILE).row(&[HOSTILE]));
    let page = Report::new(HOSTILE).subtitle(HOSTILE).section(section.clone()).section(section.clone()).section(section).finish();
    assert_page(&page);
    assert!(!page.contains("<script") && !page.contains("onload=x>"));
}

/// A room that is high and narrow has its floor drawn small: numbers that would run into each other or into a name are left out.
#[test]
fn law_no_two_texts_of_a_room_run_into_each_other() {
    // A digit's height and width, px, both on the small side.
    const HEIGHT: f64 = 6.0;
    const WIDTH: f64 = 5.0;
    for (u, w) in [(1.6, 1.6), (0.6, 0.6), (1.0, 0.4), (3.0, 1.0)] {
        let corner = nalgebra::Point3::new(u, 1.8, w);
        let scene = Scene::new("").path(&[nalgebra::Point3::origin(), corner], "", Colour::GREY);
        let drawn = scene.text(nalgebra::Point3::new(u, 0.1, 0.5 * w), "left").to_svg();
        let number = |tag: &str, name: &str| -> f64 { tag.split(name).nth(1).unwrap().split('"').next().unwrap().parse().unwrap() };
        let texts = drawn.split("<text").skip(1).map(|piece| {
            let (tag, rest) = piece.split_once('>').unwrap();
            let width = WIDTH * rest.split('<').next().unwrap().chars().count() as f64;
            let before = if tag.contains("\"middle\"") { 0.5 * width } else { f64::from(u8::from(tag.contains("\"end\""))) * width };
            (number(tag, " x=\"") - before, number(tag, " y=\""), width)
        });
        let texts: Vec<(f64, f64, f64)> = texts.collect();
        assert!(texts.len() > 6, "{texts:?}");
        for (i, (x, y, width)) in texts.iter().enumerate() {
            let met = texts[..i].iter().find(|(a, b, wide)| (y - b).abs() < HEIGHT && *a < x + width && *x < a + wide);
            assert!(met.is_none(), "{:?} and {met:?} in {u} by {w} m", texts[i]);
        }
    }
}

#[test]
fn law_empty_charts_and_sections_do_no_harm() {
    let page = Report::new("")
        .section(Section::new("", "nothing"))
        .section(Section::new("a", "b").figure(&Chart::new("").to_svg(), "").figure(&Scene::new("").to_svg(), ""));
    let page = page.finish();
    assert_page(&page);
    assert!(!page.contains("nothing"), "a section without content is left out");
}

#[test]
fn law_heavy_scatter_stays_small() {
    let many: Vec<(f64, f64)> = (0..900).map(|i| (f64::from(i).sin() * 30.0, f64::from(i).cos() * 3.0)).collect();
    let svg = Chart::new("900 points").add(Points::new(&many).x_error(&vec![0.2; 900]).y_error(&vec![0.2; 900])).to_svg();
    // 12 outputs against 14 inputs must fit in 5 MB.
    assert!(svg.len() * 12 * 14 < 5_000_000, "{} bytes", svg.len());
}

/// A session's report holds some twenty series of thirty frames per shot: each mark is paid for three hundred times.
#[test]
fn law_marks_cost_few_bytes_and_none_where_nothing_moves() {
    // A target that rests for half of the time and then moves off, as markers do.
    let at: Vec<(f64, f64)> = (0..100).map(|k| (f64::from(k), f64::from((k - 50).max(0)).powi(2))).collect();
    let resting: Vec<(f64, f64)> = at.iter().map(|p| (p.0.max(50.0), p.1)).collect();
    let bytes = |at: &[(f64, f64)], symbol: Symbol| {
        let drawn = |at: &[(f64, f64)]| Chart::new("").add(Points::new(at).symbol(symbol)).to_svg().len();
        (drawn(at) - drawn(&[at[0], at[99]])) as f64 / 98.0
    };
    for (symbol, most) in
        [(Symbol::Circle, 10.0), (Symbol::Square, 14.0), (Symbol::Diamond, 16.0), (Symbol::Triangle, 22.0), (Symbol::Plus, 26.0), (Symbol::Cross, 32.0)]
    {
        let (moving, half) = (bytes(&at, symbol), bytes(&resting, symbol));
        assert!(moving < most && half < 0.6 * moving, "{symbol:?}: {moving} and {half} bytes a mark");
    }
    let path = |at: &[(f64, f64)]| Chart::new("").add(Line::new(at)).to_svg().len();
    let line = path(&at) - path(&[at[0], at[99]]);
    assert!(line < 8 * 98, "{line} bytes for 98 points");
    // In a page the style says once what each figure says where it stands alone.
    let (own, page) = (Chart::new("").to_svg(), Report::new("").section(Section::new("a", "b").figure(&Chart::new("").to_svg(), "")).finish());
    assert!(own.contains("font-size=\"11\"") && !page.contains("font-size=\"11\"") && page.contains("font-size: 11px"));
}

pub fn keep(name: &str, page: &str) {
    std::fs::write(std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(name), page).unwrap();
}

#[test]
fn law_model_reports_hold_every_section_with_plain_and_hostile_names() {
    let racket = racket("r");
    for (file, name) in [("plain", "frame-vibration"), ("hostile", HOSTILE)] {
        let (before, after) = (comparison(60, 0.8, name), comparison(60, 0.0, name));
        let steps = [ledger_entry("first model", 1.8, name), ledger_entry(&format!("added {name}"), 1.05, name), ledger_entry("fitted", 1.01, name)];
        let path: Vec<_> = steps.iter().collect();
        let page = comparison_report(name, &after, Some(&racket), &path, Some(&before));
        assert_page(&page);
        keep(&format!("compare-{file}.html"), &page);
        for verdict in [Verdict::Adequate, Verdict::EffectMissing, Verdict::Unexplained] {
            let d = diagnosis(verdict, name);
            let page = diagnosis_report(name, &d, Some(&before), &[before.clone(), after.clone()], Some(&racket), &path);
            assert_page(&page);
            assert_eq!(page, diagnosis_report(name, &d, Some(&before), &[before.clone(), after.clone()], Some(&racket), &path));
            keep(&format!("diagnose-{file}-{verdict}.html"), &page);
            assert_page(&diagnosis_report(name, &d, None, &[], None, &[]));
        }
        assert_page(&comparison_report(name, &before, None, &[], None));
    }
}

#[test]
fn law_a_report_of_900_impacts_stays_below_5_mb() {
    let page = comparison_report("large", &comparison(900, 0.5, "rigid"), Some(&racket("r")), &[], None);
    assert_page(&page);
    keep("compare-900.html", &page);
}

#[test]
fn truth_the_title_tells_command_model_and_table() {
    let c = comparison(60, 0.0, "rigid");
    let page = comparison_report("model.toml against lab/impacts.csv", &c, None, &[], None);
    assert!(page.contains("<title>model.toml against lab/impacts.csv – sweetspot compare</title>"), "{:.400}", page);
    let page = diagnosis_report("model.toml against lab/impacts.csv", &diagnosis(Verdict::Adequate, "rigid"), None, &[], None, &[]);
    assert!(page.contains("<title>model.toml against lab/impacts.csv – sweetspot diagnose</title>"), "{:.400}", page);
}

#[test]
fn truth_noise_floors_that_differ_are_told_apart() {
    let why = "is the least that any model tried leaves; <code>compare</code>, which knows this model alone";
    let mut c = comparison(60, 0.8, "rigid");
    let d = diagnosis(Verdict::EffectMissing, "rigid");
    c.noise_floor = 1.13;
    let page = diagnosis_report("t", &d, Some(&c), &[], None, &[]);
    assert!(page.contains(why) && page.contains("puts it at 1.13"), "the reader of both reports wonders which is right");
    c.noise_floor = d.noise_floor;
    assert!(!diagnosis_report("t", &d, Some(&c), &[], None, &[]).contains(why), "nothing to explain where they agree");
    // A failing model only bounds the floor; a sound one gives it.
    let page = comparison_report("t", &c, None, &[], None);
    assert!(page.contains("upper bound of the noise floor") && page.contains("a model without fault would have at most"));
    let page = comparison_report("t", &comparison(60, 0.0, "rigid"), None, &[], None);
    assert!(!page.contains("upper bound of the noise floor") && !page.contains("would have at most"));
}

#[test]
fn truth_parameters_are_listed_with_their_units() {
    let mut c = comparison(60, 0.0, "frame-vibration.frequency_hz");
    c.parameters_refitted[0].at_limit = false;
    let page = comparison_report(
        "t",
        &c,
        None,
        &[&ledger_entry("first model", 1.8, "string-tension.excess_lb"), &ledger_entry("fitted", 1.0, "string-tension.excess_lb")],
        None,
    );
    assert!(page.contains("<td>frame-vibration.frequency_hz</td><td>Hz</td>"), "the table of parameters");
    assert!(page.contains("string-tension.excess_lb 0.800 ± 0.010 lb"), "the versions of the model");
}

#[test]
fn law_long_words_break_and_numbers_do_not() {
    let long = "a sentence that explains what a parameter of the model means";
    let table = Table::new("").column("name").column("meaning").numbers("value").row(&["amount", long, "0.330 ± 0.010"]);
    let page = Report::new("t").section(Section::new("a", "b").table(table)).finish();
    assert!(page.contains(&format!("<td>amount</td><td class=\"long\">{long}</td><td class=\"n\">0.330 ±\u{a0}0.010</td>")), "{page}");
}
