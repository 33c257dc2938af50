//! The chain on footage as a user runs it: broken pictures are named, other shots go on, a second run keeps what stands.

use super::cli::{MODEL, refused, said, sweetspot, text};
use std::path::{Path, PathBuf};

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() { copy(&entry.path(), &target) } else { std::fs::copy(entry.path(), target).map(|_| ()).unwrap() }
    }
}

/// The sample session with its first shots only.
fn sample(shots: usize) -> (tempfile::TempDir, PathBuf, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("session");
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("footage-samples/session");
    for part in ["calib", "axes"] {
        copy(&sample.join(part), &session.join(part));
    }
    for file in ["session.toml", "racket.toml", "ball.toml"] {
        std::fs::copy(sample.join(file), session.join(file)).unwrap();
    }
    let mut ids: Vec<String> = std::fs::read_dir(sample.join("shots")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    ids.sort();
    ids.truncate(shots);
    for id in &ids {
        copy(&sample.join("shots").join(id), &session.join("shots").join(id));
    }
    (folder, session, ids)
}

/// The k-th picture of a camera.
fn picture(folder: &Path, k: usize) -> PathBuf {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    files.swap_remove(k)
}

#[test]
fn fails_unequal_calibration_pictures_are_named() {
    let (_keep, session, _) = sample(0);
    let lost = picture(&session.join("calib/right"), 2);
    std::fs::remove_file(&lost).unwrap();
    let alone = session.join("calib/left").join(picture(&session.join("calib/left"), 2).file_name().unwrap());
    refused(&["calibrate", &text(&session)], &["left/", "right/", "allowed: the same number", &text(&alone), "try:"]);
    assert!(!session.join("results/calibration.json").exists());
}

/// Enlarges a picture in place.
fn enlarge(path: &Path, times: f64) {
    let picture = image::open(path).unwrap().into_luma8();
    let [width, height] = [picture.width(), picture.height()].map(|side| (f64::from(side) * times) as u32);
    image::imageops::resize(&picture, width, height, image::imageops::FilterType::Triangle).save(path).unwrap();
}

#[test]
fn cli_a_calibration_picture_of_another_size_is_left_out_with_its_reason() {
    let (_keep, session, _) = sample(0);
    let place = text(&session);
    // The very first one: which size is the usual one does not hang on the order.
    enlarge(&picture(&session.join("calib/left"), 0), 1.5);
    let output = sweetspot(&["calibrate", &place]);
    assert!(output.status.code() == Some(0) && said(&output).contains("px where most pictures are"), "{}", said(&output));
    let rig: serde_json::Value = serde_json::from_slice(&std::fs::read(session.join("results/calibration.json")).unwrap()).unwrap();
    let pairs = rig["pairs"].as_array().unwrap();
    assert!(pairs[0]["used"] == false && pairs.iter().filter(|p| p["used"] == true).count() >= 8, "{pairs:?}");

    // One camera set otherwise than the other: neither size is the usual one.
    for k in 0..pairs.len() {
        enlarge(&picture(&session.join("calib/right"), k), 1.5);
    }
    enlarge(&picture(&session.join("calib/left"), 0), 1.0 / 1.5);
    refused(&["calibrate", &place], &["both cameras must give pictures of one size"]);
}

/// What cannot be read costs its own pair.
#[cfg(target_os = "linux")]
#[test]
fn cli_a_calibration_picture_that_the_disk_does_not_give_is_left_out_with_its_reason() {
    let (_keep, session, _) = sample(0);
    let lost = picture(&session.join("calib/left"), 1);
    std::fs::remove_file(&lost).unwrap();
    // A file that is there and whose first byte cannot be had, as on a broken disk.
    std::os::unix::fs::symlink("/proc/self/mem", &lost).unwrap();
    let output = sweetspot(&["calibrate", &text(&session)]);
    assert!(output.status.code() == Some(0) && said(&output).contains(&format!("{}: cannot be read", text(&lost))), "{}", said(&output));
}

#[test]
fn cli_an_axes_frame_that_is_not_seen_leaves_the_boards_calibration() {
    let (_keep, session, _) = sample(0);
    let (place, left) = (text(&session), session.join("axes/left.png"));
    let rig = || -> serde_json::Value { serde_json::from_slice(&std::fs::read(session.join("results/calibration.json")).unwrap()).unwrap() };
    let calibrate = || {
        let output = sweetspot(&["calibrate", &place]);
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert_eq!(calibrate(), "");
    let framed = rig();
    let advised = |rig: &serde_json::Value| rig["advice"].as_array().unwrap().iter().any(|a| a.as_str().unwrap().contains("nothing knows what is up"));
    assert!(!advised(&framed));
    let picture = image::open(&left).unwrap().into_luma8();
    // Nothing to be seen, no picture, none at all.
    let blind = image::GrayImage::from_pixel(picture.width(), picture.height(), image::Luma([90]));
    blind.save(&left).unwrap();
    let told = calibrate();
    assert!(told.contains("warning: no global axes") && told.contains("arm_u_m"), "{told}");
    let seen = rig();
    assert!(advised(&seen) && seen["left"] == framed["left"] && seen["T"] == framed["T"] && seen["axes"].is_null());
    assert_eq!(seen["global_from_left"]["R"][0], serde_json::json!([1.0, 0.0, 0.0]));
    std::fs::write(&left, "no picture").unwrap();
    assert!(calibrate().contains("not a picture by its content"));
    std::fs::remove_file(&left).unwrap();
    assert!(calibrate().contains("no picture named `left`"));
    // Taken again, the frame counts.
    picture.save(&left).unwrap();
    assert_eq!(calibrate(), "");
    assert_eq!(rig()["global_from_left"], framed["global_from_left"]);
}

#[test]
fn cli_a_lost_form_of_the_calibration_is_written_again_from_its_numbers() {
    let (_keep, session, _) = sample(0);
    let results = session.join("results");
    let calibrate = || assert_eq!(sweetspot(&["calibrate", &text(&session)]).status.code(), Some(0));
    calibrate();
    let before: Vec<Vec<u8>> = ["calibration.json", "calibration.yml"].map(|f| std::fs::read(results.join(f)).unwrap()).into();
    std::fs::remove_file(results.join("calibration.yml")).unwrap();
    std::fs::remove_file(results.join("calibration.html")).unwrap();
    calibrate();
    assert!(results.join("calibration.html").exists());
    assert_eq!(before, ["calibration.json", "calibration.yml"].map(|f| std::fs::read(results.join(f)).unwrap()));
}

#[test]
fn fails_a_grouping_value_that_is_a_table_is_named() {
    let (_keep, session, ids) = sample(1);
    let file = session.join("shots").join(&ids[0]).join("shot.toml");
    std::fs::write(&file, "[groups]\nplayer = \"A\"\n").unwrap();
    let calibrated = sweetspot(&["calibrate", &text(&session)]);
    assert_eq!(calibrated.status.code(), Some(0), "{}", said(&calibrated));
    let output = sweetspot(&["track", &text(&session)]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    for word in [text(&file).as_str(), "`groups`", "player = \"A\""] {
        assert!(said(&output).contains(word), "{}", said(&output));
    }
}

/// No picture shows how tightly the mount holds the handle: it is recorded beside the pictures, and stands in the table.
#[test]
fn cli_a_recorded_grip_torque_stands_in_the_table_and_measured_columns_are_not_given() {
    let (_keep, session, ids) = sample(3);
    let results = session.join("results");
    for (id, line) in ids.iter().zip(["grip_torque = 4.5\nstrings = \"gut\"\n", "grip_torque = -1.0\n", "impact_x = 0.01\n"]) {
        std::fs::write(session.join("shots").join(id).join("shot.toml"), line).unwrap();
    }
    assert_eq!(sweetspot(&["calibrate", &text(&session)]).status.code(), Some(0));
    let tracked = sweetspot(&["track", &text(&session)]);
    assert_eq!(tracked.status.code(), Some(1), "{}", said(&tracked));
    for word in ["`grip_torque` is -1; allowed: 0 to 100 N m", "`impact_x` is a column of the impacts table"] {
        assert!(said(&tracked).contains(word), "{}", said(&tracked));
    }
    assert_eq!(sweetspot(&["shots", &text(&session)]).status.code(), Some(1));
    let table = sweetspot::impact_table::ImpactTable::read(&results.join("impacts.csv")).unwrap();
    let [row] = &table.rows[..] else { panic!("{} rows", table.rows.len()) };
    assert_eq!(row.inputs[14].map(|m| m.value), Some(4.5));
    assert_eq!(row.groups["strings"], "gut");
}

/// A stand carries a hung racket through the contact, which is no hand that interferes; and a black curtain is no dark picture.
#[test]
fn cli_a_hung_racket_before_a_black_curtain_raises_no_alarm() {
    let (_keep, session, ids) = sample(6);
    assert_eq!(sweetspot(&["calibrate", &text(&session)]).status.code(), Some(0));
    let tracked = sweetspot(&["track", "--no-spin", &text(&session)]);
    assert!(tracked.status.success() && !said(&tracked).contains("dark"), "{}", said(&tracked));
    assert!(sweetspot(&["shots", &text(&session)]).status.success());
    let interferes = |id: &String| {
        let shot = std::fs::read_to_string(session.join("results/shots").join(id).join("shot.json")).unwrap();
        serde_json::from_str::<serde_json::Value>(&shot).unwrap()["momentum"]["hand_interferes"].as_bool().unwrap()
    };
    let flagged = ids.iter().filter(|id| interferes(id)).count();
    assert!(flagged <= 1, "{flagged} of {}", ids.len());
}

/// One good shot, one with a picture cut off and one of text among its frames, one that is text throughout.
#[test]
fn cli_broken_pictures_in_shots_are_named_and_the_others_go_on() {
    let (_keep, session, ids) = sample(3);
    let shots = session.join("shots");
    let (cut, prose) = (picture(&shots.join(&ids[1]).join("left"), 3), picture(&shots.join(&ids[1]).join("right"), 5));
    let mut bytes = Vec::new();
    image::open(&cut).unwrap().into_luma8().write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Bmp).unwrap();
    bytes.truncate(bytes.len() / 2);
    std::fs::write(&cut, bytes).unwrap();
    std::fs::write(&prose, "this is not a picture").unwrap();
    for camera in ["left", "right"] {
        for entry in std::fs::read_dir(shots.join(&ids[2]).join(camera)).unwrap() {
            std::fs::write(entry.unwrap().path(), "nor is this").unwrap();
        }
    }
    let run = |arguments: &[&str]| {
        let output = sweetspot(arguments);
        let message = said(&output);
        assert!(!message.contains("panicked"), "{message}");
        (output.status.code(), message)
    };
    let place = text(&session);
    let (code, message) = run(&["calibrate", &place]);
    assert_eq!(code, Some(0), "{message}");

    // The broken shots stay broken however often the command runs; the good one is tracked once.
    for again in [false, true] {
        let (code, message) = run(&["track", &place]);
        assert_eq!(code, Some(1), "{message}");
        assert_eq!(message.contains(&format!("{}: already tracked", ids[0])), again, "{message}");
        for word in [&text(&cut), &text(&prose), &ids[2]] {
            assert!(message.contains(word.as_str()), "expected {word} in: {message}");
        }
    }
    let tracks = |id: &str| session.join("results/shots").join(id).join("tracks.csv");
    assert!(tracks(&ids[0]).exists() && tracks(&ids[1]).exists() && !tracks(&ids[2]).exists());

    // A picture mended later makes its shot stale, and only that one.
    let mended = picture(&shots.join(&ids[1]).join("left"), 4);
    std::fs::copy(&mended, &cut).unwrap();
    std::fs::File::options().append(true).open(&cut).unwrap().set_modified(std::time::SystemTime::now()).unwrap();
    let (_, message) = run(&["track", &place]);
    assert!(!message.contains(&text(&cut)) && message.contains(&text(&prose)), "{message}");

    // Points corrected by hand are not lost to a second run.
    let by_hand = std::fs::read_to_string(tracks(&ids[1])).unwrap().replacen(",measured", ",manual", 1);
    std::fs::write(tracks(&ids[1]), &by_hand).unwrap();
    std::fs::remove_file(tracks(&ids[1]).with_file_name("track.json")).unwrap();
    let (_, message) = run(&["track", &place]);
    assert!(message.contains("1 points corrected by hand"), "{message}");
    assert_eq!(std::fs::read_to_string(tracks(&ids[1])).unwrap(), by_hand);
    // Nor to one that is told to track anew.
    let kept = tracks(&ids[1]).with_file_name("tracks.manual.csv");
    let forced = sweetspot(&["track", &place, "--force", "--no-spin", "--shot", &ids[1]]);
    assert!(String::from_utf8_lossy(&forced.stderr).contains(&text(&kept)), "{}", said(&forced));
    assert_eq!(std::fs::read_to_string(&kept).unwrap(), by_hand);
    assert!(!std::fs::read_to_string(tracks(&ids[1])).unwrap().contains("manual"));

    let model = session.join("model.toml");
    std::fs::write(&model, MODEL).unwrap();
    let (code, message) = run(&["validate", &place, "--model", &text(&model)]);
    assert_eq!(code, Some(1), "{message}");
    assert!(message.contains(&ids[2]) && session.join("results/report.html").exists(), "{message}");
    let impacts = std::fs::read_to_string(session.join("results/impacts.csv")).unwrap();
    assert!(impacts.contains(&ids[0]) && impacts.contains(&ids[1]) && !impacts.contains(&ids[2]), "{impacts}");
}

/// A shot that one camera alone saw is told so, not that the racket is not there.
#[test]
fn cli_a_camera_of_which_no_picture_can_be_read_is_named() {
    let (_keep, session, ids) = sample(2);
    let right = session.join("shots").join(&ids[0]).join("right");
    let pictures = std::fs::read_dir(&right).unwrap().map(|e| std::fs::write(e.unwrap().path(), "no picture").unwrap()).count();
    assert_eq!(sweetspot(&["calibrate", &text(&session)]).status.code(), Some(0));
    let output = sweetspot(&["track", &text(&session), "--no-spin"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let told = format!("{}: right camera: none of its {pictures} pictures can be read, the first: {}", ids[0], text(&picture(&right, 0)));
    assert!(said(&output).contains(&told) && !said(&output).contains("no racket found"), "{}", said(&output));
    assert!(session.join("results/shots").join(&ids[1]).join("tracks.csv").exists());
}

/// Of several sessions one whose results cannot be written leaves the others to go on.
#[test]
fn cli_a_session_whose_results_have_no_place_leaves_the_others_to_go_on() {
    let (keep, first, _) = sample(1);
    let second = keep.path().join("second");
    copy(&first, &second);
    std::fs::write(first.join("results"), "a file where the folder belongs").unwrap();
    let output = sweetspot(&["validate", &text(&first), &text(&second), "--json"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let outcomes: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((outcomes[0]["shots_measured"].as_u64(), outcomes[1]["shots_measured"].as_u64()), (Some(0), Some(1)), "{outcomes}");
    assert!(outcomes[0]["failed"].to_string().contains("cannot be written") && second.join("results/report.html").exists(), "{outcomes}");
    assert!(said(&output).contains("try: check the free space"), "{}", said(&output));
    // Alone it is as it was.
    assert_eq!(sweetspot(&["validate", &text(&first)]).status.code(), Some(2));
}

/// Whatever stands in the place of one shot's results is that shot's fault alone.
#[test]
fn cli_a_shot_whose_results_have_no_place_fails_and_the_others_go_on() {
    let (_keep, session, ids) = sample(3);
    let (place, results) = (text(&session), session.join("results/shots"));
    std::fs::create_dir_all(results.join(&ids[1]).join("tracks.csv")).unwrap();
    std::fs::write(results.join(&ids[0]), "no folder").unwrap();
    assert_eq!(sweetspot(&["calibrate", &place]).status.code(), Some(0));
    for command in ["track", "shots"] {
        let output = sweetspot(&[command, &place]);
        let told = said(&output);
        assert_eq!(output.status.code(), Some(1), "{told}");
        assert!(told.contains(&format!("{}: is no folder", text(&results.join(&ids[0])))), "{told}");
    }
    let told = said(&sweetspot(&["track", &place]));
    assert!(told.contains("tracks.csv: cannot be read") && told.contains("make it readable, or move it away"), "{told}");
    assert!(results.join(&ids[2]).join("shot.json").exists());
    assert_eq!(std::fs::read_to_string(results.join(&ids[0])).unwrap(), "no folder");
    std::fs::remove_dir(results.join(&ids[1]).join("tracks.csv")).unwrap();
    std::fs::create_dir(results.join(&ids[1]).join("points.csv")).unwrap();
    let told = said(&sweetspot(&["track", &place, "--force", "--no-spin"]));
    assert!(told.contains("points.csv: is no file") && told.contains(&format!("{}: ", ids[2])), "{told}");
    assert!(results.join(&ids[2]).join("tracks.csv").exists());
}

/// Shots that are tracked at the same time, the first of them refused at once: what is said, and written, is as if they had come one by one.
#[test]
fn cli_shots_tracked_at_a_time_are_told_in_the_sessions_order() {
    let (_keep, session, ids) = sample(4);
    for camera in ["left", "right"] {
        for entry in std::fs::read_dir(session.join("shots").join(&ids[1]).join(camera)).unwrap() {
            std::fs::write(entry.unwrap().path(), "no picture").unwrap();
        }
    }
    let place = text(&session);
    assert_eq!(sweetspot(&["calibrate", &place]).status.code(), Some(0));
    let track = |threads: &str| {
        let output = sweetspot(&["track", &place, "--force", "--no-spin", "--json", "-j", threads]);
        assert_eq!(output.status.code(), Some(1), "{}", said(&output));
        let tables: Vec<Vec<u8>> = [0, 2, 3].map(|k| std::fs::read(session.join("results/shots").join(&ids[k]).join("tracks.csv")).unwrap()).into();
        (said(&output), output.stdout, tables)
    };
    let (said, json, tables) = track("1");
    let at: Vec<usize> = ids.iter().map(|id| said.find(&format!("{id}: ")).unwrap()).collect();
    assert!(at.is_sorted(), "{said}");
    for _ in 0..2 {
        let (said_too, json_too, tables_too) = track("4");
        assert_eq!(said_too, said);
        assert!(json_too == json && tables_too == tables);
    }
}

/// A folder may be called as an option is.
#[test]
fn cli_a_session_whose_name_begins_with_a_dash_is_worked_on() {
    let (keep, session, _) = sample(1);
    std::fs::rename(session, keep.path().join("-dash")).unwrap();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_sweetspot")).current_dir(keep.path()).args(["validate", "--", "-dash"]).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert!(keep.path().join("-dash/results/predictions.csv").exists(), "{}", said(&output));
}

/// A demonstration that was broken off, in the pictures or after them, goes on when the same command is given again.
#[test]
fn cli_a_hidden_world_goes_on_where_it_was_broken_off() {
    let folder = tempfile::tempdir().unwrap();
    let place = text(folder.path());
    let arguments = ["demo", &place, "--hidden-effect", "none", "--shots", "1"];
    let run = || {
        let output = sweetspot(&arguments);
        assert!(output.status.success(), "{}", said(&output));
        said(&output)
    };
    let seed = |said: &str| said.split("A world with seed ").nth(1).unwrap().split(|c: char| !c.is_ascii_digit()).next().unwrap().to_owned();
    let chosen = seed(&run());
    let again = run();
    assert!(again.contains("rendered by an earlier run"), "{again}");
    let session = folder.path().join("session");
    let truth: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(session.join("truth.json")).unwrap()).unwrap();
    std::fs::write(session.join("rendering.json"), truth["rendered_from"].to_string()).unwrap();
    for lost in ["truth.json", "session.toml"] {
        std::fs::remove_file(session.join(lost)).unwrap();
    }
    let anew = run();
    assert!(!anew.contains("rendered by an earlier run") && seed(&anew) == chosen && seed(&again) == chosen, "{anew}");
    // Another world in its place is asked for with --force.
    refused(&["demo", &place, "--hidden-effect", "none", "--shots", "2"], &["there is a session already", "--force"]);
}

/// When a shot fails that an earlier run measured, nothing of that run stays under its name.
#[test]
fn cli_results_of_an_earlier_run_are_set_aside_when_shots_fail() {
    let (_keep, session, ids) = sample(1);
    let (place, results) = (text(&session), session.join("results"));
    let shot = results.join("shots").join(&ids[0]);
    let validated = sweetspot(&["validate", &place, "--point", "-0.05,0.03"]);
    assert_eq!(validated.status.code(), Some(0), "{}", said(&validated));
    // A point of the face that is asked for is measured as `shots` does.
    let measured = std::fs::read_to_string(shot.join("shot.json")).unwrap();
    assert!(measured.contains("point_-50_30_mm"), "{measured}");
    for camera in ["left", "right"] {
        for entry in std::fs::read_dir(session.join("shots").join(&ids[0]).join(camera)).unwrap() {
            std::fs::write(entry.unwrap().path(), "no picture").unwrap();
        }
    }
    // One more session, which cannot be opened: it stops no other.
    let lacking = session.with_file_name("lacking");
    std::fs::create_dir(&lacking).unwrap();
    std::fs::copy(session.join("session.toml"), lacking.join("session.toml")).unwrap();
    let validated = sweetspot(&["validate", &text(&lacking), &place]);
    assert_eq!(validated.status.code(), Some(1), "{}", said(&validated));
    assert!(said(&validated).contains(&text(&lacking.join("racket.toml"))), "{}", said(&validated));
    // In the end every session stands in a line of its own, with what ended it.
    let all = said(&validated);
    let last: Vec<&str> = all.lines().skip_while(|l| !l.ends_with("held-out error  verdict")).skip(1).take(2).map(str::trim_end).collect();
    assert!(matches!(last[..], [first, second] if first.ends_with("failed: open") && second.contains("failed: track")), "{all}");
    let files = [(&shot, "tracks", "csv"), (&shot, "points", "csv")].into_iter();
    let files = files.chain([("impacts", "csv"), ("predictions", "csv"), ("season", "csv"), ("season", "json")].map(|(stem, kind)| (&results, stem, kind)));
    for (folder, stem, kind) in files {
        let (name, kept) = (folder.join(format!("{stem}.{kind}")), folder.join(format!("{stem}.earlier.{kind}")));
        assert!(!name.exists() && kept.exists(), "{stem}.{kind}: {}", said(&validated));
    }
}

/// A calibration is of the session.toml it was made from: steps that use it after a change say so, and go on.
#[test]
fn cli_a_session_file_changed_since_the_calibration_is_told() {
    let (_keep, session, _) = sample(1);
    let place = text(&session);
    assert_eq!(sweetspot(&["calibrate", &place]).status.code(), Some(0));
    let file = session.join("session.toml");
    let told = |command: &[&str]| {
        let output = sweetspot(&[command, &[place.as_str()]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        stderr.contains(&text(&file)) && stderr.contains("has changed since the calibration") && stderr.contains("sweetspot calibrate")
    };
    let commands = [&["track", "--no-spin"][..], &["shots"]];
    assert!(commands.iter().all(|command| !told(command)));
    let changed = std::fs::read_to_string(&file).unwrap().replace("square_m = 0.0", "square_m = 0.1");
    std::fs::write(&file, changed).unwrap();
    assert!(commands.iter().all(|command| told(command)));
}
