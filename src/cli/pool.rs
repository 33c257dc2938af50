//! `sweetspot pool`.

use super::Shell;
use super::error::{CliError, with_reasons};
use super::impacts_input::hint_at_faults;
use crate::equipment::{Ball, EquipmentError, Racket};
use crate::impact_table::ImpactTable;
use crate::provenance::{holds, is_replaced};
use crate::session::Session;
use std::path::{Path, PathBuf};

/// The impacts of several sessions as one table, to judge one model by all of them
///
/// Ids become `SESSION/id`, and a column `session` tells compare, diagnose and fit whose offsets are whose. Give them every racket and ball file of the
/// sessions; a row's columns `racket` and `ball` pick by name.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Impacts tables, or session folders measured by `sweetspot shots`, in the order in which they were filmed
    #[arg(required = true, num_args = 2.., value_name = "SESSION")]
    pub sessions: Vec<PathBuf>,
    /// Where the table goes
    #[arg(short = 'o', long = "output", value_name = "F")]
    pub output: PathBuf,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let files: Vec<PathBuf> = arguments.sessions.iter().map(|given| table_of(given)).collect::<Result<_, _>>()?;
    shell.keep(&files);
    let names = names_of(&files)?;
    let gear = gear_of(&files)?;
    let tables: Vec<ImpactTable> = files.iter().map(|file| ImpactTable::read_given(file)).collect::<Result<_, _>>()?;
    let rows: Vec<(&String, usize)> = names.iter().zip(tables.iter().map(|table| table.rows.len())).collect();
    let told = rows.iter().map(|(name, n)| format!("{name} {n}")).collect::<Vec<_>>().join(", ");
    let all = ImpactTable::pooled(names.iter().cloned().zip(tables).collect());
    let faulty: Vec<(String, String)> = all.rows.iter().filter_map(|row| Some((row.id.clone(), row.fault.clone()?.into()))).collect();
    let sound = ImpactTable { rows: all.rows.iter().filter(|row| row.fault.is_none()).cloned().collect(), ..ImpactTable::default() };
    let text = sound.to_csv();
    let output = &arguments.output;
    // A table of impacts is what was measured: no other makes room for this one unasked.
    if is_replaced(output) && !shell.args.force && !holds(output, text.as_bytes()) {
        let what = format!("{}: is there already and holds something else", output.display());
        return Err(CliError::input(what).hint("name another file (-o), or say --force if this table may replace it"));
    }
    shell.write(output, text.as_bytes())?;
    shell.print_json(&serde_json::json!({ "impacts": sound.rows.len(), "left_out": faulty.len(), "table": output.to_string_lossy() }))?;
    shell.say(format_args!("{}: {} impacts of {} sessions ({told})", output.display(), sound.rows.len(), names.len()));
    if !gear.options.is_empty() {
        let and = if gear.unknown.is_empty() { String::new() } else { format!(" and the racket and ball files of {}", gear.unknown.join(", ")) };
        shell.say(format_args!("for predict, compare, diagnose and fit: --impacts {} {}{and}", output.display(), gear.options));
    }
    if faulty.is_empty() {
        return Ok(());
    }
    let failed = format!("{} of {} impacts are left out:\n  {}", faulty.len(), all.rows.len(), with_reasons(&faulty, "\n  "));
    Err(hint_at_faults(CliError::some_failed(failed), &all))
}

/// The table that was given, or that of the session folder that was given.
fn table_of(given: &Path) -> Result<PathBuf, CliError> {
    if !given.is_dir() {
        return Ok(given.to_path_buf());
    }
    let places = [given.join("results/impacts.csv"), given.join("impacts.csv")];
    let Some(found) = places.into_iter().find(|table| table.is_file()) else {
        let what = format!("{}: holds neither results/impacts.csv nor impacts.csv", given.display());
        return Err(CliError::input(what).hint("measure the session first (`sweetspot shots`), or name its table"));
    };
    Ok(found)
}

/// What racket and ball files the commands that take the pooled table need.
struct Gear {
    /// Those that are known, as options.
    options: String,
    /// Tables beside which none stand.
    unknown: Vec<String>,
}

/// The racket and ball files of the sessions in whose folders the tables stand, or beside the tables.
///
/// # Errors
/// Two of them have one name and not the same values: a row's `racket` or `ball` could mean either.
fn gear_of(files: &[PathBuf]) -> Result<Gear, CliError> {
    let (mut rackets, mut balls, mut unknown) = (Vec::new(), Vec::new(), Vec::new());
    for table in files {
        let beside = |name: &str| Some(table.parent()?.join(name)).filter(|file| file.is_file());
        let (of_rackets, of_balls) = match session_of(table) {
            Some(folder) => {
                let session = Session::open(folder)?;
                (session.racket_files, session.ball_files)
            }
            None => (Vec::from_iter(beside("racket.toml")), Vec::from_iter(beside("ball.toml"))),
        };
        if of_rackets.is_empty() || of_balls.is_empty() {
            unknown.push(table.display().to_string());
        }
        of_rackets.iter().try_for_each(|file| add(&mut rackets, file, Racket::read, |r| &r.name))?;
        of_balls.iter().try_for_each(|file| add(&mut balls, file, Ball::read, |b| &b.name))?;
    }
    let options = rackets.iter().map(|(file, _)| format!("--racket {}", file.display()));
    let options = options.chain(balls.iter().map(|(file, _)| format!("--ball {}", file.display()))).collect::<Vec<_>>().join(" ");
    Ok(Gear { options, unknown })
}

/// The session folder in which a table stands, itself or its results.
fn session_of(file: &Path) -> Option<&Path> {
    let folder = file.parent()?;
    let folder = if folder.ends_with("results") { folder.parent()? } else { folder };
    folder.join("session.toml").is_file().then_some(folder)
}

fn add<T: PartialEq>(known: &mut Vec<(PathBuf, T)>, file: &Path, read: fn(&Path) -> Result<T, EquipmentError>, name: fn(&T) -> &str) -> Result<(), CliError> {
    let one = read(file)?;
    match known.iter().find(|(_, other)| name(other) == name(&one)) {
        None => known.push((file.to_path_buf(), one)),
        Some((_, other)) if *other == one => {}
        Some((other, _)) => {
            let what = format!("{}: has the name {:?}, and so has {}, with other values; a row could mean either", file.display(), name(&one), other.display());
            return Err(CliError::input(what).hint("give one of them a name of its own and measure its session again (`sweetspot shots`: its tracks stay)"));
        }
    }
    Ok(())
}

/// A name for each table: its session's folder, or the file's own where it has one; with as many folders before it as it takes to tell them apart.
fn names_of(files: &[PathBuf]) -> Result<Vec<String>, CliError> {
    let ways: Vec<Vec<String>> = files.iter().map(|file| way_to(file)).collect();
    let deepest = ways.iter().map(Vec::len).max().unwrap_or(0);
    for depth in 1..=deepest {
        let names: Vec<String> = ways.iter().map(|way| way[way.len().saturating_sub(depth)..].join("/")).collect();
        if names.iter().all(|name| names.iter().filter(|other| *other == name).count() == 1) {
            return Ok(names);
        }
    }
    let twice = files.iter().enumerate().find(|(i, _)| ways[..*i].contains(&ways[*i])).map_or_else(String::new, |(_, file)| file.display().to_string());
    Err(CliError::input(format!("{twice}: is given twice; its impacts would count twice")).hint("name every session once"))
}

/// The folders to a table, its own name left out where it says nothing, and so that of the results.
fn way_to(file: &Path) -> Vec<String> {
    let whole = file.canonicalize().unwrap_or_else(|_| file.to_path_buf());
    let mut way: Vec<String> = whole.with_extension("").components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
    for said in ["impacts", "results"] {
        if way.len() > 1 && way.last().is_some_and(|last| last == said) {
            way.pop();
        }
    }
    way
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sessions_are_told_apart_by_as_little_of_their_way_as_it_takes() {
        let names = |files: &[&str]| names_of(&files.iter().map(PathBuf::from).collect::<Vec<_>>());
        let told = |files: &[&str], expected: &[&str]| assert_eq!(names(files).expect("told apart"), expected);
        told(&["/lab/mon/results/impacts.csv", "/lab/fri/impacts.csv", "/lab/wed.csv"], &["mon", "fri", "wed"]);
        told(&["/a/court/results/impacts.csv", "/b/court/results/impacts.csv"], &["a/court", "b/court"]);
        assert!(names(&["/a/x.csv", "/a/y.csv", "/a/x.csv"]).is_err_and(|e| e.message.starts_with("/a/x.csv: is given twice")));
    }
}
