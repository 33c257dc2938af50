//! The program as a whole: exit codes, clear errors, nothing left behind.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub fn sweetspot(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sweetspot")).args(arguments).output().unwrap()
}

/// Everything said to the person at the terminal.
pub fn said(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text)).concat()
}

/// Exit status 2, one error, every word in it, no panic, nothing on stdout.
#[track_caller]
pub fn refused(arguments: &[&str], words: &[&str]) {
    let output = sweetspot(arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(!message.contains("panicked"), "{message}");
    assert!(output.stdout.is_empty(), "{arguments:?} wrote to stdout");
    assert_eq!(message.lines().filter(|l| l.starts_with("error:")).count(), 1, "{arguments:?}: {message}");
    for word in words {
        assert!(message.contains(word), "{arguments:?}: expected {word:?} in: {message}");
    }
}

pub const RACKET: &str = r#"
name = "typical 27 inch"
mass_kg = 0.340
length_m = 0.685
balance_m = 0.330
stringbed_centre_m = 0.4975
swingweight_kgm2 = 0.0325
twistweight_kgm2 = 0.0015
[head]
inner_length_m = 0.335
inner_width_m = 0.255
[strings]
tension_lb = 60.0
[markers]
m1 = [-0.1775, 0.000, 0.0]
m2 = [ 0.000, -0.1375, 0.0]
m3 = [ 0.000,  0.1375, 0.0]
m4 = [ 0.200, -0.045, 0.0]
m5 = [ 0.200,  0.045, 0.0]
"#;
pub const BALL: &str = "name = \"b\"\nmass_kg = 0.0577\ndiameter_m = 0.066\ninertia_factor = 0.55\n";
pub const MODEL: &str = "base = \"rigid\"\n[parameters]\nrestitution = { value = 0.8, fit = true, min = 0.3, max = 1.0 }\nfriction = { value = 0.45, fit = true, min = 0.0, max = 1.5 }\n";
const SESSION: &str = r#"
name = "t"
frame_rate_hz = 1000.0
exposure_s = 1.0e-4
racket = "racket.toml"
ball = "ball.toml"
[calibration]
board_columns = 9
board_rows = 6
square_m = 0.060
images = "calib"
"#;

/// A folder with a valid racket, ball, model, session and a table of two impacts.
pub struct Bench {
    pub folder: tempfile::TempDir,
}

impl Bench {
    pub fn new() -> Self {
        let bench = Bench { folder: tempfile::tempdir().unwrap() };
        bench.write("racket.toml", RACKET);
        bench.write("ball.toml", BALL);
        bench.write("model.toml", MODEL);
        bench.write("session.toml", SESSION);
        bench.write("impacts.csv", "id,ball_in_vx,ball_in_vy,ball_in_vz,impact_x,impact_y,ball_out_vz\na,1,2,-25,0.01,0.02,8\nb,0,4,-20,-0.05,0.0,4\n");
        bench
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    /// The arguments of a command on the table.
    pub fn table(&self, command: &str) -> Vec<String> {
        let mut a = vec![command.to_owned()];
        for (flag, file) in [("--impacts", "impacts.csv"), ("--racket", "racket.toml"), ("--ball", "ball.toml"), ("--model", "model.toml")] {
            a.extend([flag.to_owned(), text(&self.path(file))]);
        }
        if command == "fit" {
            a.extend(["-o".to_owned(), text(&self.path("fitted.toml"))]);
        }
        a.extend(["--out".to_owned(), text(&self.path("out"))]);
        a
    }
}

pub fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

fn refused_table(bench: &Bench, words: &[&str]) {
    for command in ["predict", "compare", "diagnose", "fit"] {
        let arguments = bench.table(command);
        refused(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), words);
        assert!(!bench.path("fitted.toml").exists());
    }
}

#[test]
fn cli_every_command_of_the_contract_has_help() {
    for command in ["demo", "calibrate", "track", "shots", "predict", "compare", "diagnose", "add", "fit", "validate", "explore", "effects", "synth"] {
        if command == "calibrate" && cfg!(not(feature = "vision")) {
            continue;
        }
        let output = sweetspot(&[command, "--help"]);
        assert_eq!(output.status.code(), Some(0), "{command}");
        assert!(String::from_utf8_lossy(&output.stdout).contains("Usage: sweetspot"), "{command}");
    }
}

#[test]
fn fails_bad_usage_is_exit_2() {
    for arguments in [&["no-such-command"][..], &["predict"], &["track"], &["predict", "--no-such-flag"], &["effects", "-j", "0"]] {
        let output = sweetspot(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn fails_a_missing_session_folder_is_named() {
    let mut commands = vec!["track", "shots"];
    if cfg!(feature = "vision") {
        commands.push("calibrate");
    }
    for command in commands {
        refused(&[command, "no/such/session"], &["no/such/session"]);
    }
    let bench = Bench::new();
    refused(&["validate", "no/such/session", "--model", &text(&bench.path("model.toml"))], &["no/such/session"]);
    refused(&["synth", "no/such/scenario.toml", "-o", &text(&bench.path("made"))], &["no/such/scenario.toml"]);
}

#[test]
fn fails_a_wrong_key_in_session_racket_ball_or_model_is_named() {
    let bench = Bench::new();
    bench.write("session.toml", SESSION.replace("exposure_s", "exposure"));
    refused(&["track", &text(bench.folder.path())], &["session.toml", "exposure"]);
    bench.write("racket.toml", RACKET.replace("balance_m", "balance"));
    refused_table(&bench, &["racket.toml", "balance"]);
    bench.write("racket.toml", RACKET);
    bench.write("ball.toml", BALL.replace("mass_kg", "mass"));
    refused_table(&bench, &["ball.toml", "mass"]);
    bench.write("ball.toml", BALL);
    bench.write("model.toml", MODEL.replace("friction", "frictoin"));
    refused_table(&bench, &["model.toml", "frictoin"]);
    bench.write("model.toml", "base = \"rigid\"\n[effects.frame-vibrations]\n");
    refused_table(&bench, &["model.toml", "frame-vibration"]);
    bench.write("model.toml", "base = \"elastic\"\n");
    refused_table(&bench, &["model.toml", "elastic"]);
}

#[test]
fn fails_impossible_values_are_named_with_what_is_allowed() {
    let bench = Bench::new();
    bench.write("racket.toml", RACKET.replace("0.340", "-0.340"));
    refused_table(&bench, &["racket.toml", "mass_kg", "-0.34"]);
    bench.write("racket.toml", RACKET.replace("swingweight_kgm2 = 0.0325", "swingweight_kgm2 = 0.0100"));
    refused_table(&bench, &["racket.toml", "swingweight_kgm2", "0.01"]);
    bench.write("racket.toml", RACKET);
    bench.write("ball.toml", BALL.replace("0.0577", "nan"));
    refused_table(&bench, &["ball.toml", "mass_kg", "NaN"]);
}

#[test]
fn fails_broken_tables_are_named_with_their_line() {
    let bench = Bench::new();
    for (table, words) in [
        ("", &["impacts.csv"][..]),
        ("id,ball_in_vz\n", &["impacts.csv", "no impacts"]),
        ("id,ball_in_vz\na,NaN\n", &["impacts.csv", "line 2", "ball_in_vz", "NaN"]),
        ("id,ball_in_vz\na,-20\nb,fast\n", &["impacts.csv", "line 3", "fast"]),
        ("id,ball_in_vz\na,-20,7\n", &["impacts.csv", "line 2: 3 fields; allowed: 2"]),
        ("id,ball_in_vz\na,NaN\nb,fast\n", &["impacts.csv: 2 faults", "line 2: `ball_in_vz` is \"NaN\"", "line 3: `ball_in_vz` is \"fast\""]),
        ("BM\u{0}\u{1}\u{2}", &["impacts.csv"]),
    ] {
        bench.write("impacts.csv", table);
        refused_table(&bench, words);
    }
    std::fs::remove_file(bench.path("impacts.csv")).unwrap();
    refused_table(&bench, &["impacts.csv"]);
}

#[test]
fn fails_what_a_table_lacks_is_said_of_its_file() {
    let bench = Bench::new();
    for command in ["compare", "diagnose", "fit"] {
        let arguments = bench.table(command);
        let told: Vec<&str> = arguments.iter().map(String::as_str).collect();
        refused(&told, &["impacts.csv: only", "of 2 impacts can be used"]);
        refused(&[&told[..], &["--group", "player"]].concat(), &["impacts.csv: the table has no grouping column `player`; it has: none"]);
    }
}

#[test]
fn fails_a_place_that_cannot_hold_the_result_is_refused_before_the_work() {
    let bench = Bench::new();
    // The table is too short for the work itself: that it is not told of shows what is asked first.
    let (given, within) = (bench.path("impacts.csv"), bench.path("ball.toml/m.toml"));
    let folder = bench.folder.path();
    for (place, why) in [(given.as_path(), "given to read"), (folder, "it is a folder"), (&within, "ball.toml is a file, not a folder")] {
        let place = text(place);
        let words = [place.as_str(), why, "try:"];
        for (command, more) in [("fit", &["-o", &place][..]), ("diagnose", &["--auto", "-o", &place])] {
            let arguments = bench.table(command).into_iter().filter(|a| *a != "-o" && !a.ends_with("fitted.toml")).collect::<Vec<_>>();
            refused(&arguments.iter().map(String::as_str).chain(more.iter().copied()).collect::<Vec<_>>(), &words);
        }
    }
    assert!(!bench.path("out").exists());
}

#[test]
fn fails_a_damaged_ledger_leaves_earlier_results_whole() {
    let bench = Bench::new();
    let rows: String = (0..40).map(|i| format!("i{i},1,2,-{},0,0,0,0,0,0,0.01,0.0{},{}\n", 20 + i % 7, i % 5, 7 + i % 7)).collect();
    let racket = "racket_in_vx,racket_in_vy,racket_in_vz,racket_in_wx,racket_in_wy,racket_in_wz";
    bench.write("impacts.csv", format!("id,ball_in_vx,ball_in_vy,ball_in_vz,{racket},impact_x,impact_y,ball_out_vz\n{rows}"));
    bench.write("out/model-ledger.json", "{");
    for (command, result) in [("compare", "out/compare.json"), ("diagnose", "out/diagnosis.json")] {
        bench.write(result, "of an earlier run");
        refused(&bench.table(command).iter().map(String::as_str).collect::<Vec<_>>(), &["model-ledger.json: not a ledger", "move it away"]);
        assert_eq!(std::fs::read_to_string(bench.path(result)).unwrap(), "of an earlier run");
    }
}

/// A model predicts what no ball meets; who reads it is told.
#[test]
fn cli_impacts_beyond_the_racket_are_remarked() {
    let bench = Bench::new();
    let row = |id: &str, x: f64, y: f64| format!("{id},1,2,-25,0,0,0,0,0,0,{x},{y},8\n");
    let header =
        "id,ball_in_vx,ball_in_vy,ball_in_vz,racket_in_vx,racket_in_vy,racket_in_vz,racket_in_wx,racket_in_wy,racket_in_wz,impact_x,impact_y,ball_out_vz\n";
    let arguments = bench.table("predict");
    let predict = |rows: &[String]| {
        bench.write("impacts.csv", format!("{header}{}", rows.concat()));
        said(&sweetspot(&arguments.iter().map(String::as_str).collect::<Vec<_>>()))
    };
    // The middle, the frame, the throat; then a place beside the head and one in cm.
    let sound = [row("a", 0.0, 0.0), row("b", 0.0, -0.135), row("c", 0.25, 0.03)];
    assert!(!predict(&sound).contains("beyond the racket"), "{}", predict(&sound));
    let told = predict(&[sound.concat(), row("d", 0.0, 0.2005), row("e", 0.45, 0.35)]);
    assert!(told.contains("2 impacts lie beyond the racket (d by 20 mm, e by "), "{told}");
}

/// A ball whose lines could not be read has no spin: `predict` says what it takes instead, as `compare` does.
#[test]
fn cli_what_all_rows_lack_is_told_once_and_json_keeps_all() {
    let bench = Bench::new();
    let rows: String = (1..=300).map(|k| format!("r{k},1,2,-25,0.01\n")).collect();
    bench.write("impacts.csv", format!("id,ball_in_vx,ball_in_vy,ball_in_vz,impact_x\n{rows}"));
    let mut arguments = bench.table("predict");
    let told = |arguments: &[String]| sweetspot(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let shown = told(&arguments);
    assert_eq!(shown.status.code(), Some(1));
    let errors = String::from_utf8_lossy(&shown.stderr).into_owned();
    assert_eq!(errors.lines().filter(|l| l.contains("was not measured")).count(), 3, "{errors}");
    assert!(errors.contains("and 297 more for the same reason: r4, r5, ") && errors.contains(", r300"), "{errors}");
    arguments.push("--json".to_owned());
    let output = told(&arguments);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["failed"].as_array().unwrap().len(), 300);
    assert_eq!(String::from_utf8_lossy(&output.stderr).lines().filter(|l| l.contains("was not measured")).count(), 300);
}

#[test]
fn cli_a_tension_in_kilograms_is_remarked_where_the_model_takes_it() {
    let bench = Bench::new();
    bench.write("racket.toml", RACKET.replace("tension_lb = 60.0", "tension_lb = 27.0"));
    let racket = ["vx", "vy", "vz", "wx", "wy", "wz"].map(|c| format!("racket_in_{c}")).join(",");
    bench.write("impacts.csv", format!("id,ball_in_vx,ball_in_vy,ball_in_vz,impact_x,impact_y,{racket}\na,1,2,-25,0.01,0.02,0,0,0,0,0,0\n"));
    let remarked = |model: &str| {
        bench.write("model.toml", model);
        let output = sweetspot(&bench.table("predict").iter().map(String::as_str).collect::<Vec<_>>());
        assert!(output.status.success(), "{}", said(&output));
        said(&output).contains("`tension_lb` = 27 are loose strings for a racket of 0.34 kg; if that is in kg, write 59.5")
    };
    let models = [MODEL, "base = \"viscoelastic\"\n", "base = \"viscoelastic\"\nparameters = { kS0 = 39e3 }\n"];
    assert_eq!(models.map(remarked), [false, true, false]);
    assert!(said(&sweetspot(&["racket", &text(&bench.path("racket.toml"))])).contains("write 59.5"));
}

#[test]
fn cli_names_and_cells_of_files_are_told_without_what_steers_a_terminal() {
    let bench = Bench::new();
    for table in
        ["id,ball\u{1b}[31m_in_vz,ball_in_vz\na,1,-2\n\u{1b}[2Jb,1,x\n", "id,\u{1b}]0;title\u{7}\n", &format!("id,ball_in_vz\na,{}\n", "9".repeat(3_000_000))]
    {
        bench.write("impacts.csv", table);
        let arguments = bench.table("predict");
        let output = sweetspot(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        let told = said(&output);
        assert!(output.status.code() == Some(2) && told.contains("impacts.csv") && told.len() < 10_000, "{} bytes: {told:.1000}", told.len());
        assert!(!told.contains(|c: char| c.is_control() && c != '\n'), "{told:?}");
    }
}

#[test]
fn cli_predict_names_the_impacts_whose_spin_it_takes_as_zero() {
    let bench = Bench::new();
    let columns = "ball_in_vx,ball_in_vy,ball_in_vz,racket_in_vx,racket_in_vy,racket_in_vz,racket_in_wx,racket_in_wy,racket_in_wz,impact_x,impact_y";
    bench.write(
        "impacts.csv",
        format!("id,{columns},ball_in_wx,ball_in_wy,ball_in_wz\na,1,2,-25,0,0,3,0,0,0,0.01,0.02,,,\nb,1,2,-25,0,0,3,0,0,0,0.01,0.02,0,0,0\n"),
    );
    let mut arguments = bench.table("predict");
    arguments.push("--json".into());
    let output = sweetspot(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert!(said(&output).contains("taken as 0, in 1 impacts: a"), "{}", said(&output));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["spin_taken_as_zero"], serde_json::json!(["a"]));
    assert_eq!(json["predictions"][0]["ball_out_vz"], json["predictions"][1]["ball_out_vz"]);
}

/// Laws that no contact has are no prediction, and an outcome with more energy than there was is told.
#[test]
fn cli_predict_refuses_impossible_laws_and_tells_of_energy_from_nowhere() {
    let bench = Bench::new();
    let columns = "ball_in_vx,ball_in_vy,ball_in_vz,racket_in_vx,racket_in_vy,racket_in_vz,racket_in_wx,racket_in_wy,racket_in_wz,impact_x,impact_y";
    bench.write("impacts.csv", format!("id,{columns}\na,1,2,-25,0,0,3,0,0,0,0.01,0.02\nb,1,2,-25,0,0,3,0,0,0,0.02,0.02\n"));
    let predict = |replaces: &str, expression: &str| {
        bench.write("model.toml", format!("{MODEL}[effects.own]\nreplaces = \"{replaces}\"\nexpression = \"{expression}\"\nk = 0.0\n"));
        let output = sweetspot(&bench.table("predict").iter().map(String::as_str).collect::<Vec<_>>());
        (output.status.code(), said(&output))
    };
    for (replaces, expression, words) in [
        ("ball_inertia", "ball_inertia * (k - 1)", ["`own`", "`ball_inertia` became -", "a positive number"]),
        ("ball_arm", "ball_arm * (k - 3)", ["`own`", "`ball_arm` became -", "a positive number"]),
        ("restitution", "restitution + 1 / k", ["`own`", "`restitution` became inf", "a finite number"]),
        ("restitution", "restitution * sqrt(k - 1)", ["`own`", "`restitution` became NaN", "a finite number"]),
        ("ball_out_vz", "ball_out_vz + k / k", ["`own`", "`an outcome` became NaN", "finite numbers"]),
    ] {
        let (code, message) = predict(replaces, expression);
        assert_eq!(code, Some(1), "{expression}: {message}");
        assert!(words.iter().all(|w| message.contains(w)) && !message.contains("taken as 0 or 1"), "{expression}: {message}");
    }
    // A law that gives one impact a restitution above 1: it is taken as 1, and told.
    let (code, message) = predict("restitution", "restitution + (k + 20) * impact_x");
    assert!(code == Some(0) && message.contains("taken as 0 or 1, in 1 impacts (the first: 1.200 in b)"), "{message}");
    let (code, message) = predict("ball_out_vz", "ball_out_vz * (k + 3)");
    assert_eq!(code, Some(0), "{message}");
    assert!(message.contains("more energy after the impact than before in 2 impacts"), "{message}");
    let (code, message) = predict("ball_out_vz", "ball_out_vz * (k + 1)");
    assert!(code == Some(0) && !message.contains("more energy"), "{message}");
    let (code, message) = predict("friction", "k - friction");
    assert!(code == Some(0) && message.contains("friction below 0, taken as 0, in 2 impacts (the first: -0."), "{message}");
}

#[test]
fn cli_effects_lists_what_an_expression_may_use_and_replace() {
    let output = sweetspot(&["effects", "--quantities", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let find = |list: &str, name: &str| json[list].as_array().unwrap().iter().find(|q| q["name"] == name).cloned().unwrap();
    assert_eq!(find("usable", "slip_x")["unit"], "m/s");
    assert_eq!(find("replaceable", "ball_inertia")["at"], "contact laws");
}

#[test]
fn fails_a_session_file_cannot_lead_outside_its_folder() {
    let bench = Bench::new();
    for path in ["../racket.toml", "/etc/hostname", "shots/../../racket.toml"] {
        bench.write("session.toml", SESSION.replace("\"racket.toml\"", &format!("\"{path}\"")));
        refused(&["track", &text(bench.folder.path())], &["session.toml", "racket", path]);
    }
}

#[test]
fn cli_add_of_an_unknown_effect_names_the_nearest() {
    let bench = Bench::new();
    refused(&["add", "frame-vibrations", "--model", &text(&bench.path("model.toml")), "-o", &text(&bench.path("new.toml"))], &["frame-vibration"]);
    assert!(!bench.path("new.toml").exists());
    bench.write("model.toml", format!("{MODEL}[effects.hand-mass]\n"));
    let (model, new) = (text(&bench.path("model.toml")), text(&bench.path("new.toml")));
    refused(&["add", "hand-mass", "--model", &model, "-o", &new], &["model.toml: effect `hand-mass` is in the model already"]);
}

#[test]
fn fails_no_output_replaces_a_file_of_another_kind() {
    let bench = Bench::new();
    let at = |name: &str| text(&bench.path(name));
    let add = |output: &str| ["add", "hand-mass", "--model", &at("model.toml"), "-o", &at(output)].map(str::to_owned);
    for (file, kind) in
        [("racket.toml", "a racket file"), ("ball.toml", "a ball file"), ("session.toml", "a session file"), ("impacts.csv", "an impacts table")]
    {
        let before = std::fs::read(bench.path(file)).unwrap();
        refused(&add(file).each_ref().map(String::as_str), &[file, "is there already", kind, "allowed in its place: a model file", "try:"]);
        assert_eq!(std::fs::read(bench.path(file)).unwrap(), before);
    }
    // An earlier output makes room, the model that was read too; so does a name with nothing under it.
    bench.write("new.toml", "");
    for output in ["new.toml", "new.toml", "model.toml"] {
        let written = sweetspot(&add(output).each_ref().map(String::as_str));
        assert!(written.status.success(), "{}", said(&written));
    }
    // Nothing that was given, and nothing of another kind, is lost to `fit`, `diagnose --auto` and `predict`.
    bench.write("model.toml", MODEL);
    bench.write("others.toml", RACKET);
    for (command, output) in [("fit", "others.toml"), ("fit", "racket.toml"), ("diagnose", "others.toml")] {
        let mut arguments: Vec<String> = bench.table(command).into_iter().map(|a| if a == at("fitted.toml") { at(output) } else { a }).collect();
        if command == "diagnose" {
            arguments.extend(["--auto".to_owned(), "-o".to_owned(), at(output)]);
        }
        let words = if output == "racket.toml" { "would replace it" } else { "is a racket file" };
        refused(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), &[output, words, "try:"]);
        assert_eq!(std::fs::read_to_string(bench.path(output)).unwrap(), RACKET);
    }
    std::fs::create_dir(bench.path("out")).unwrap();
    std::fs::copy(bench.path("impacts.csv"), bench.path("out/predictions.csv")).unwrap();
    refused(&bench.table("predict").iter().map(String::as_str).collect::<Vec<_>>(), &["predictions.csv", "is an impacts table"]);
}

#[cfg(feature = "vision")]
/// A model of the user's that stands where a new one goes is kept, and a script that is run again leaves the folder as it was.
#[test]
fn cli_another_model_under_the_outputs_name_is_kept() {
    let bench = Bench::new();
    let at = |name: &str| text(&bench.path(name));
    let add = |output: &str| {
        let done = sweetspot(&["add", "hand-mass", "--model", &at("model.toml"), "-o", &at(output)]);
        assert!(done.status.success(), "{}", said(&done));
        said(&done)
    };
    let mine = "# mine, of a long night\nbase = \"rigid\"\n[effects.hand-mass]\n";
    bench.write("mine.toml", mine);
    let told = add("mine.toml");
    assert!(told.contains("held another model") && told.contains("mine.earlier.toml"), "{told}");
    assert_eq!(std::fs::read_to_string(bench.path("mine.earlier.toml")).unwrap(), mine);
    let after = everything(bench.folder.path());
    assert!(!add("mine.toml").contains("another model"));
    // What is kept already is not kept twice.
    bench.write("mine.toml", mine);
    assert!(add("mine.toml").contains("mine.earlier.toml"));
    assert!(everything(bench.folder.path()) == after);
    // In place, as was asked for.
    assert!(!add("model.toml").contains("another model") && !bench.path("model.earlier.toml").exists());
}

#[test]
fn cli_sessions_are_pooled_into_one_table_and_measured_impacts_never_replaced_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let path = |name: &str| at(name).to_str().unwrap().to_owned();
    let head = "id,ball_in_vz,ball_in_wx,ball_in_wy,ball_in_wz,racket_in_vz,impact_x,impact_y";
    std::fs::create_dir_all(at("mon/results")).unwrap();
    std::fs::write(at("mon/results/impacts.csv"), format!("{head}\ns1,-20,0,0,0,15,0.01,0\ns2,-21,0,0,0,15,0.02,0\n")).unwrap();
    std::fs::write(at("tue.csv"), format!("{head}\ns1,-22,0,0,0,15,0.01,0\n")).unwrap();
    let pool = |more: &[&str]| sweetspot(&[&["pool", &path("mon"), &path("tue.csv"), "-o", &path("week.csv")], more].concat());
    let output = pool(&[]);
    assert!(output.status.success() && said(&output).contains("3 impacts of 2 sessions (mon 2, tue 1)"), "{}", said(&output));
    let week = std::fs::read_to_string(at("week.csv")).unwrap();
    assert_eq!(week.lines().skip(1).map(|l| l.split(',').next().unwrap()).collect::<Vec<_>>(), ["mon/s1", "mon/s2", "tue/s1"]);
    assert!(week.lines().next().unwrap().ends_with(",session") && week.lines().last().unwrap().ends_with(",tue"));
    // The same again changes nothing; another one does not take its place unasked, and never that of what it is made of.
    assert!(pool(&[]).status.success());
    std::fs::write(at("tue.csv"), format!("{head}\ns1,-22,0,0,0,15,0.01,0\ns2,-22,0,0,0,15,n/a,0\ns3,-23,0,0,0,15,0.01,0\n")).unwrap();
    refused(&["pool", &path("mon"), &path("tue.csv"), "-o", &path("week.csv")], &["week.csv: is there already", "--force"]);
    refused(&["pool", &path("mon"), &path("tue.csv"), "-o", &path("tue.csv"), "--force"], &["tue.csv: is what this command was given to read"]);
    refused(&["pool", &path("mon"), &path("mon/results/impacts.csv"), "-o", &path("x.csv")], &["impacts.csv: is given twice"]);
    refused(&["pool", &path("mon"), &path(""), "-o", &path("x.csv")], &["holds neither results/impacts.csv nor impacts.csv", "sweetspot shots"]);
    // Two rackets of one name: a row could mean either.
    for (session, racket) in [("mon", RACKET), ("wed", &RACKET.replace("0.340", "0.310"))] {
        std::fs::create_dir_all(at(session).join("shots/s1/left")).unwrap();
        std::fs::write(at(session).join("session.toml"), SESSION).unwrap();
        std::fs::write(at(session).join("racket.toml"), racket).unwrap();
        std::fs::write(at(session).join("ball.toml"), BALL).unwrap();
    }
    std::fs::copy(at("mon/results/impacts.csv"), at("wed/impacts.csv")).unwrap();
    let either = ["wed/racket.toml: has the name \"typical 27 inch\", and so has", "mon/racket.toml", "sweetspot shots"];
    refused(&["pool", &path("mon"), &path("wed"), "-o", &path("x.csv")], &either);
    std::fs::write(at("wed/racket.toml"), RACKET).unwrap();
    let output = sweetspot(&["pool", &path("mon"), &path("wed"), "-o", &path("x.csv")]);
    let gear = format!("--impacts {} --racket {} --ball {}\n", path("x.csv"), path("mon/racket.toml"), path("mon/ball.toml"));
    assert!(output.status.success() && said(&output).contains(&gear), "{}", said(&output));
    let output = pool(&["--force"]);
    let told = said(&output);
    assert_eq!(output.status.code(), Some(1), "{told}");
    for words in ["1 of 5 impacts are left out", "tue/s2: tue.csv, line 3: `impact_x` is \"n/a\"", "correct the cells named"] {
        assert!(told.contains(words), "expected {words:?} in: {told}");
    }
    assert_eq!(std::fs::read_to_string(at("week.csv")).unwrap().lines().count(), 5);
}

#[test]
fn fails_text_and_cut_off_pictures_are_named() {
    let bench = Bench::new();
    bench.write("calib/left/a1.bmp", b"BM\x36\x00\x00\x00");
    bench.write("calib/right/a1.bmp", "hello");
    refused(&["calibrate", &text(bench.folder.path())], &["calib/left/a1.bmp", "calib/right/a1.bmp", "allowed: BMP, PNG, TIFF, JPEG", "try:"]);
    assert!(!bench.path("results").exists());
}

#[cfg(unix)]
#[test]
fn cli_a_pipe_named_as_output_is_written_to_and_stays_a_pipe() {
    use std::os::unix::fs::FileTypeExt;
    let folder = tempfile::tempdir().unwrap();
    let (model, pipe) = (folder.path().join("model.toml"), folder.path().join("pipe"));
    std::fs::write(&model, "base = \"rigid\"\n").unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || std::fs::read_to_string(pipe).unwrap()
    });
    let out = std::process::Command::new(env!("CARGO_BIN_EXE_sweetspot"))
        .args(["add", "hand-mass", "--force", "--model"])
        .arg(&model)
        .arg("-o")
        .arg(&pipe)
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    assert!(std::fs::metadata(&pipe).unwrap().file_type().is_fifo());
    assert!(reader.join().unwrap().contains("[effects.hand-mass]"));
}

/// What a session's folder holds is never waited for; a pipe named on the command line is read.
#[cfg(unix)]
#[test]
fn cli_a_pipe_in_a_sessions_folder_is_refused_and_one_that_is_given_is_read() {
    let bench = Bench::new();
    let pipe = |name: &str| {
        let path = bench.path(name);
        let _ = std::fs::remove_file(&path);
        assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
        path
    };
    let place = text(bench.folder.path());
    let impacts = std::fs::read_to_string(bench.path("impacts.csv")).unwrap();
    pipe("impacts.csv");
    let writer = std::thread::spawn({
        let path = bench.path("impacts.csv");
        move || std::fs::write(path, impacts).unwrap()
    });
    let arguments = bench.table("predict");
    let output = sweetspot(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    writer.join().unwrap();
    assert!(said(&output).contains("impacts predicted") || said(&output).contains("impact a"), "{}", said(&output));
    for name in ["ball.toml", "racket.toml", "session.toml"] {
        pipe(name);
        refused(&["track", &place], &[name, "a pipe, not a file"]);
    }
}

/// A folder named in another encoding than the terminal's is written to, and told, as any other.
#[cfg(target_os = "linux")]
#[test]
fn cli_a_path_that_is_not_unicode_is_shown_in_json() {
    use std::os::unix::ffi::OsStrExt;
    let bench = Bench::new();
    let columns = "ball_in_vx,ball_in_vy,ball_in_vz,racket_in_vx,racket_in_vy,racket_in_vz,racket_in_wx,racket_in_wy,racket_in_wz,impact_x,impact_y";
    bench.write("impacts.csv", format!("id,{columns}\na,1,2,-25,0,0,3,0,0,0,0.01,0.02\n"));
    let out = bench.folder.path().join(std::ffi::OsStr::from_bytes(b"M\xfcnchen"));
    for command in ["predict", "add"] {
        let mut program = Command::new(env!("CARGO_BIN_EXE_sweetspot"));
        if command == "add" {
            program.args(["add", "hand-mass", "--model"]).arg(bench.path("model.toml"));
        } else {
            // Without the options that name the results.
            program.args(bench.table(command).iter().take(9));
        }
        match command {
            "predict" => program.arg("--out").arg(&out),
            _ => program.arg("-o").arg(out.join("new.toml")),
        };
        let output = program.arg("--json").output().unwrap();
        assert!(!said(&output).contains("panicked"), "{command}: {}", said(&output));
        assert_eq!(output.status.code(), Some(0), "{command}: {}", said(&output));
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let place = json.get("file").or(json.get("model")).and_then(serde_json::Value::as_str).unwrap();
        assert!(place.contains("M\u{fffd}nchen"), "{place}");
    }
}

/// Under `nohup` the logout's signal is ignored, and stays so: a batch goes on overnight. Here the program waits for a pipe that nobody has opened.
#[cfg(target_os = "linux")]
#[test]
fn cli_a_signal_ignored_at_the_start_stays_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("impacts.csv");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for (signal, bit) in [("HUP", 1), ("INT", 2)] {
        let script = format!("trap '' {signal}; exec \"$0\" predict --impacts \"$1\" --racket r.toml --ball b.toml --model m.toml");
        let mut child = Command::new("sh").args(["-c", &script, env!("CARGO_BIN_EXE_sweetspot")]).arg(&pipe).spawn().unwrap();
        let process = PathBuf::from(format!("/proc/{}", child.id()));
        // It waits once it sleeps in the opening of the pipe, after the handlers were set.
        let waits = || std::fs::read_to_string(process.join("stat")).is_ok_and(|s| s.contains("(sweetspot) S"));
        let begun = std::time::Instant::now();
        while !waits() && begun.elapsed().as_secs() < 20 {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        std::thread::sleep(std::time::Duration::from_millis(200));
        let status = std::fs::read_to_string(process.join("status")).unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
        let mask = status.lines().find_map(|l| l.strip_prefix("SigIgn:")).unwrap();
        assert!(u64::from_str_radix(mask.trim(), 16).unwrap() & bit != 0, "{signal}: {mask}");
    }
}

const TABLE_SCENARIO: &str = "kind = \"table\"\nsetting = \"lab\"\nimpacts = 12\nseed = 3\n";
const FOOTAGE_SCENARIO: &str =
    "kind = \"footage\"\nsetting = \"lab\"\nseed = 5\nshots = 1\nboards = 2\nframes_before = 6\nframes_after = 6\nsize_px = [128, 128]\n";

/// Every file below a folder with its bytes.
fn everything(folder: &Path) -> std::collections::BTreeMap<PathBuf, Vec<u8>> {
    let mut all = std::collections::BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { all.append(&mut everything(&path)) } else { all.extend([(path.clone(), std::fs::read(path).unwrap())]) }
    }
    all
}

#[test]
fn cli_synth_writes_over_what_it_wrote_and_nothing_else() {
    let bench = Bench::new();
    bench.write("table/scenario.toml", TABLE_SCENARIO);
    bench.write("footage/scenario.toml", FOOTAGE_SCENARIO);
    let scenario = |kind: &str| text(&bench.path(kind).join("scenario.toml"));
    let made = |kind: &str, folder: &str| {
        let output = sweetspot(&["synth", &scenario(kind), "-o", &text(&bench.path(folder))]);
        assert_eq!(output.status.code(), Some(0), "{kind} into {folder}: {}", said(&output));
    };
    for kind in ["table", "footage"] {
        made(kind, kind);
        let first = everything(&bench.path(kind));
        made(kind, kind);
        assert!(first == everything(&bench.path(kind)), "{kind}");
    }
    for (kind, name) in
        [("table", "racket.toml"), ("table", "session.toml"), ("footage", "ball.toml"), ("footage", "calib/left/a1.bmp"), ("footage", "truth.json")]
    {
        bench.write(&format!("own-{kind}-{}/{name}", name.len()), "a laboratory's own");
        let own = bench.path(&format!("own-{kind}-{}", name.len()));
        refused(&["synth", &scenario(kind), "-o", &text(&own)], &["there is", "give another folder"]);
        assert_eq!(everything(&own), std::collections::BTreeMap::from([(own.join(name), b"a laboratory's own".to_vec())]));
    }
    refused(&["synth", &scenario("footage"), "-o", &text(&bench.path("table"))], &["give another folder"]);
    refused(&["synth", &scenario("table"), "-o", &text(&bench.path("footage"))], &["give another folder"]);
}

/// What was made of one table does not stand beside another as if it were of that; the same table again is no other.
#[test]
fn cli_synth_of_another_table_sets_aside_what_was_made_of_the_first() {
    let bench = Bench::new();
    let made = |seed: u32| {
        bench.write("scenario.toml", TABLE_SCENARIO.replace("seed = 3", &format!("seed = {seed}")));
        let done = sweetspot(&["synth", &text(&bench.path("scenario.toml")), "-o", &text(&bench.path("table"))]);
        assert_eq!(done.status.code(), Some(0), "{}", said(&done));
        said(&done)
    };
    made(3);
    let results = ["diagnosis.json", "compare.json", "predictions.csv", "report.html"];
    results.iter().for_each(|name| bench.write(&format!("table/{name}"), "of seed 3"));
    bench.write("table/better.toml", "a model of the user's");
    let before = everything(&bench.path("table"));
    assert!(!made(3).contains("is kept as") && everything(&bench.path("table")) == before);
    let told = made(4);
    for name in results {
        let (stem, extension) = name.split_once('.').unwrap();
        let kept = format!("{stem}.earlier.{extension}");
        assert!(!bench.path("table").join(name).exists() && told.contains(&kept), "{name}: {told}");
        assert_eq!(std::fs::read_to_string(bench.path("table").join(kept)).unwrap(), "of seed 3");
    }
    assert!(bench.path("table/better.toml").exists());
}

/// Pictures of a world that was broken off do not stay among those of the next.
#[test]
fn cli_synth_makes_room_where_it_was_broken_off() {
    let bench = Bench::new();
    bench.write("scenario.toml", FOOTAGE_SCENARIO);
    let (scenario, session) = (text(&bench.path("scenario.toml")), bench.path("made"));
    let output = sweetspot(&["synth", &scenario, "-o", &text(&session), "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(told["shots"] == 1 && told["pictures"].as_u64() > Some(8) && told["session"] == text(&session), "{told}");
    let whole = everything(&session);
    // As it stands amid the pictures: the scenario, no session.toml, no truth; and a picture of another world.
    let spec: serde_json::Value = serde_json::from_slice::<serde_json::Value>(&whole[&session.join("truth.json")]).unwrap()["rendered_from"].clone();
    bench.write("made/rendering.json", spec.to_string());
    bench.write("made/calib/left/077.bmp", "of the world broken off");
    for name in ["session.toml", "truth.json"] {
        std::fs::remove_file(session.join(name)).unwrap();
    }
    assert_eq!(sweetspot(&["synth", &scenario, "-o", &text(&session)]).status.code(), Some(0));
    assert!(everything(&session) == whole);
}

/// A model that goes to stdout is all that stands there, after what a file has already.
#[cfg(target_os = "linux")]
#[test]
fn cli_a_result_on_stdout_stands_there_alone() {
    let bench = Bench::new();
    for name in ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"] {
        bench.write("into", "# of an earlier command\n");
        let file = std::fs::File::options().append(false).write(true).open(bench.path("into")).unwrap();
        std::io::Seek::seek(&mut &file, std::io::SeekFrom::End(0)).unwrap();
        let output = Command::new(env!("CARGO_BIN_EXE_sweetspot"))
            .args(["add", "hand-mass", "--model", &text(&bench.path("model.toml")), "-o", name])
            .stdout(file)
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        let written = std::fs::read_to_string(bench.path("into")).unwrap();
        let model = written.strip_prefix("# of an earlier command\n").unwrap();
        assert!(model.starts_with("base = \"rigid\"") && model.contains("[effects.hand-mass]") && !model.contains("added"), "{written}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("added"));
    }
    refused(&["add", "hand-mass", "--model", &text(&bench.path("model.toml")), "-o", "/dev/stdout", "--json"], &["--json", "stdout"]);
}

/// `sweetspot ... | head -1` has what it wanted: neither an error nor another exit status.
#[test]
fn cli_a_reader_that_stops_early_is_no_full_disk() {
    for words in [&["effects", "--json"][..], &["effects"], &["effects", "hand-mass"], &["effects", "--quantities"]] {
        let mut run = Command::new(env!("CARGO_BIN_EXE_sweetspot"))
            .args(words)
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        drop(run.stdout.take());
        let output = run.wait_with_output().unwrap();
        assert_eq!((output.status.code(), String::from_utf8_lossy(&output.stderr).as_ref()), (Some(0), ""), "{words:?}");
    }
}

#[test]
fn cli_a_bench_measurement_gives_the_files_lines_or_is_refused_and_is_compared_with_the_file() {
    let told = |words: &[&str]| {
        let output = sweetspot(&[&["racket"], words].concat());
        (output.status.code(), said(&output))
    };
    // A machine reads kg cm²; two supports carry 0.2 and 0.14 kg.
    let (code, message) = told(&["--scales", "0.1", "0.2", "0.6", "0.14", "--swing-rdc", "325", "--twist-rdc", "15"]);
    assert_eq!(code, Some(0), "{message}");
    for line in ["mass_kg = 0.34000", "balance_m = 0.30588", "swingweight_kgm2 = 0.032500    # ± 0.000325", "twistweight_kgm2 = 0.001500    # ± 0.000015"] {
        assert!(message.contains(line), "{line}: {message}");
    }
    refused(&["racket", "--swing-rdc", "0.0325"], &["swingweight_kgm2 comes out as", "kg m²"]);
    // What 0.34 kg at 0.45 m from the butt alone have about the axis is more than that.
    refused(&["racket", "--mass", "0.34", "--balance", "0.45", "--swing-rdc", "325"], &["swingweight_kgm2 comes out as 0.032500", "above 0.041650"]);
    refused(&["racket"], &["nothing was measured"]);
    // What has a sign is a number, not an option; a deviation has none.
    refused(&["racket", "--mass", "-0.34"], &["mass_kg comes out as -0.34", "0.05 to 2 kg"]);
    for (name, words) in [
        ("period_sd_s", &["--swing-pendulum", "0.02", "1.3", "nan"][..]),
        ("period_sd_s", &["--twist-threads", "0.1", "0.1", "1", "1.2", "-0.01"]),
        ("balance_sd", &["--balance-sd", "inf", "--swing-pendulum", "0.02", "1.3", "0.01"]),
    ] {
        refused(&[&["racket", "--mass", "0.34", "--balance", "0.33"], words].concat(), &[name, "0 or more"]);
    }
    let bench = Bench::new();
    let (code, message) = told(&[&text(&bench.path("racket.toml")), "--mass", "0.350", "--balance", "0.331"]);
    assert!(code == Some(0) && message.contains("mass_kg is measured +2.9 % off the file's 0.34") && !message.contains("balance_m is measured"), "{message}");
}

#[test]
fn cli_a_checked_racket_is_told_in_json() {
    let bench = Bench::new();
    let output = sweetspot(&["racket", &text(&bench.path("racket.toml")), "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(json["racket"]["name"] == "typical 27 inch" && json["racket"]["inertia_x_kg_m2"] == 0.0015, "{json}");
}
