//! `cli`: a thin shell. A command = one file here with its arguments and `run`, and one line in `commands!`.
//!
//! A command parses and checks everything, loads, makes one library call, writes (temporary file, then rename) and
//! summarises on stderr; `--json` puts the result on stdout.

mod earlier_output;
pub mod error;
mod impacts_input;
mod ledger_file;
mod plain_text;
mod racket_photograph;
mod same_reasons;
mod set_aside;
mod threads;
mod today;
mod tracked_session;

use clap::{Args, Parser};
use earlier_output::{Output, refuse_another_kind};
use error::CliError;
use plain_text::plain;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// High-speed stereo footage of ball impacts: calibrate, track, measure, predict, and find the physics a model is
/// missing.
#[derive(Debug, Parser)]
#[command(name = "sweetspot", version, max_term_width = 100)]
struct Cli {
    #[command(flatten)]
    shell: ShellArgs,
    #[command(subcommand)]
    command: Command,
}

/// Options of every command.
#[derive(Debug, Clone, Args)]
pub struct ShellArgs {
    /// Print the result as JSON on stdout; messages go to stderr
    #[arg(long, global = true)]
    pub json: bool,
    /// Threads to use (default: all cores)
    #[arg(short = 'j', long = "threads", global = true, value_name = "N")]
    pub threads: Option<usize>,
    /// Do again what an earlier run has already written
    #[arg(long, global = true)]
    pub force: bool,
    /// Folder for the results (default: beside the input); what -o names goes where -o says
    #[arg(long, global = true, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// What a command gets from the shell: its options, a cancel flag and a way to speak.
pub struct Shell {
    pub args: ShellArgs,
    /// Whether the user chose the place of the results. `--out` of a step also says where its chain keeps them by itself.
    out_was_asked: bool,
    /// Whether stdout is for a result: the JSON of this command or of the one that runs it as a step, or the file that `-o /dev/stdout` asks for.
    stdout_is_taken: bool,
    /// Whether another command runs this one and goes on from what it writes.
    is_step: bool,
    /// What the user measured and gave to this command: no result takes its place.
    given: Mutex<Vec<PathBuf>>,
    cancelled: Arc<AtomicBool>,
}

impl Shell {
    /// A line for the person at the terminal: stdout, so that a result can be kept or searched; stderr where programs read stdout.
    pub fn say(&self, line: impl std::fmt::Display) {
        let line = plain(&line.to_string());
        // Who reads no further (`| head`) does not stop the work.
        let _ = if self.stdout_is_taken { writeln!(std::io::stderr(), "{line}") } else { writeln!(std::io::stdout(), "{line}") };
    }

    /// A line that nobody should miss: stderr, also where what is said is kept in a file.
    pub fn warn(&self, line: impl std::fmt::Display) {
        let _ = writeln!(std::io::stderr(), "{}", plain(&line.to_string()));
    }

    /// The result for programs (stdout), when `--json` was given.
    pub fn print_json(&self, result: &impl serde::Serialize) -> Result<(), CliError> {
        if self.args.json {
            let text = serde_json::to_string_pretty(result).map_err(CliError::output)?;
            crate::provenance::read_no_further(writeln!(std::io::stdout(), "{text}")).map_err(CliError::output)?;
        }
        Ok(())
    }

    /// `Err` once Ctrl-C was pressed; ask between shots.
    pub fn check_cancelled(&self) -> Result<(), CliError> {
        if self.cancelled.load(Ordering::Relaxed) { Err(CliError::interrupted()) } else { Ok(()) }
    }

    /// The flag itself, for library calls that take one.
    pub fn cancel_flag(&self) -> &AtomicBool {
        &self.cancelled
    }

    /// Where results go: `--out`, else `<input>/results` for a session folder.
    pub fn results_of_session(&self, session: &Path) -> PathBuf {
        self.args.out.clone().unwrap_or_else(|| session.join("results"))
    }

    /// Where results go: `--out`, else beside the input file.
    pub fn results_beside(&self, input: &Path) -> PathBuf {
        self.args.out.clone().unwrap_or_else(|| input.parent().map_or_else(PathBuf::new, Path::to_path_buf))
    }

    /// Where the user wants the ledger of models, when it is not to stand beside the model.
    pub fn ledger_folder(&self) -> Option<&Path> {
        self.args.out.as_deref().filter(|_| self.out_was_asked)
    }

    /// The same shell with its results where they are by default.
    pub fn with_default_results(&self) -> Shell {
        Shell { out_was_asked: false, ..self.with(ShellArgs { out: None, ..self.args.clone() }) }
    }

    /// A shell for a step of this one, to which the user gave nothing yet.
    fn with(&self, args: ShellArgs) -> Shell {
        Shell {
            args,
            out_was_asked: self.out_was_asked,
            stdout_is_taken: self.stdout_is_taken,
            is_step: self.is_step,
            given: Mutex::default(),
            cancelled: self.cancelled.clone(),
        }
    }

    /// Runs another command as if typed, with this shell's `--force` and cancel flag, its results going to `out`.
    ///
    /// For commands that chain others (`validate`, `demo`): they stay thin, and a step behaves exactly as it does by hand.
    pub fn run_step(&self, arguments: &[&std::ffi::OsStr], out: &Path) -> Result<(), CliError> {
        let words = std::iter::once(std::ffi::OsStr::new("sweetspot")).chain(arguments.iter().copied());
        let cli = Cli::try_parse_from(words).map_err(|e| CliError::input(format!("this program cannot run that step: {e}")))?;
        let args = ShellArgs { json: false, threads: None, force: self.args.force, out: Some(out.to_path_buf()) };
        dispatch(cli.command, &Shell { is_step: true, ..self.with(args) })
    }

    /// A progress bar on stderr, hidden when stderr is not a terminal.
    pub fn progress(&self, total: u64, what: &'static str) -> indicatif::ProgressBar {
        if !std::io::stderr().is_terminal() {
            return indicatif::ProgressBar::hidden();
        }
        let style = indicatif::ProgressStyle::with_template("{msg} {bar:30} {pos}/{len} {eta}").unwrap_or_else(|_| indicatif::ProgressStyle::default_bar());
        indicatif::ProgressBar::new(total).with_style(style).with_message(what)
    }

    /// Names files that the user gave: [`Self::write`] refuses to replace them.
    pub fn keep(&self, given: impl IntoIterator<Item = impl AsRef<Path>>) {
        if let Ok(mut kept) = self.given.lock() {
            kept.extend(given.into_iter().filter_map(|path| path.as_ref().canonicalize().ok()));
        }
    }

    fn refuse_given(&self, path: &Path) -> Result<(), CliError> {
        let given = path.canonicalize().is_ok_and(|path| self.given.lock().is_ok_and(|kept| kept.contains(&path)));
        if !given {
            return Ok(());
        }
        let what = format!("{}: is what this command was given to read; its result would replace it", path.display());
        Err(CliError::input(what).hint("name another file or folder for the result (-o, --out)"))
    }

    /// Writes a result whole or not at all.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<(), CliError> {
        self.refuse_given(path)?;
        crate::provenance::write_atomically(path, bytes).map_err(CliError::output)
    }

    /// Refuses a name that is not free for such an output, or one that [`Self::write`] would refuse: asked before the work whose result it is for.
    pub fn check_output(&self, path: &Path, output: Output) -> Result<(), CliError> {
        self.refuse_given(path)?;
        crate::provenance::has_room(path).map_err(CliError::output)?;
        refuse_another_kind(path, output)
    }

    /// [`Self::write`] where an earlier output of the kind may stand, and nothing else. A pipe that the user named is written to; they know who reads it.
    pub fn write_output(&self, path: &Path, output: Output, bytes: &[u8]) -> Result<(), CliError> {
        self.check_output(path, output)?;
        match output {
            Output::Predictions => self.write(path, bytes),
            Output::Model | Output::Picture => crate::provenance::write_given(path, bytes).map_err(CliError::output),
        }
    }

    /// Says where the model is that stood under a result's name, if there was one.
    pub fn say_kept(&self, output: &Path, kept: Option<&Path>) {
        if let Some(kept) = kept {
            self.say(format_args!("{} held another model; it is kept as {}", output.display(), kept.display()));
        }
    }

    /// [`Self::write`] without waiting for the disk ([`crate::provenance::write_soon`]).
    pub fn write_soon(&self, path: &Path, bytes: &[u8]) -> Result<(), CliError> {
        crate::provenance::write_soon(path, bytes).map_err(CliError::output)
    }
}

/// A path that no step run as if typed takes for an option, whatever its name begins with.
pub fn undashed(path: PathBuf) -> PathBuf {
    if path.as_os_str().as_encoded_bytes().starts_with(b"-") { Path::new(".").join(path) } else { path }
}

/// A path in JSON as the system shows it: JSON is Unicode, paths need not be, and no result is refused for its place.
pub fn as_shown<S: serde::Serializer>(path: &Path, to: S) -> Result<S::Ok, S::Error> {
    to.collect_str(&path.display())
}

macro_rules! commands {
    ($($(#[$meta:meta])* $module:ident => $variant:ident),* $(,)?) => {
        $($(#[$meta])* mod $module;)*

        #[derive(Debug, clap::Subcommand)]
        enum Command {
            $($(#[$meta])* $variant($module::Arguments),)*
        }

        fn dispatch(command: Command, shell: &Shell) -> Result<(), CliError> {
            match command {
                $($(#[$meta])* Command::$variant(arguments) => $module::run(arguments, shell),)*
            }
        }
    };
}

commands! {
    demo => Demo,
    #[cfg(feature = "vision")]
    calibrate => Calibrate,
    track => Track,
    shots => Shots,
    racket => Racket,
    pool => Pool,
    predict => Predict,
    compare => Compare,
    diagnose => Diagnose,
    add => Add,
    fit => Fit,
    validate => Validate,
    explore => Explore,
    effects => Effects,
    synth => Synth,
}

impl Command {
    /// The file that the user names for the result.
    fn output(&self) -> Option<&Path> {
        match self {
            Command::Add(a) => Some(&a.output),
            Command::Fit(a) => Some(&a.output),
            Command::Pool(a) => Some(&a.output),
            Command::Diagnose(a) => a.output.as_deref(),
            Command::Racket(a) => a.photograph.overlay.as_deref(),
            _ => None,
        }
    }

    /// Whether it writes one thing after the other, so that Ctrl-C waits for the one in hand; the others have nothing to keep.
    fn keeps_what_is_done(&self) -> bool {
        #[cfg(feature = "vision")]
        if matches!(self, Command::Calibrate(_)) {
            return true;
        }
        matches!(self, Command::Demo(_) | Command::Track(_) | Command::Shots(_) | Command::Validate(_) | Command::Synth(_))
    }
}

/// How long an end that was asked for waits for the result in hand.
const PATIENCE: std::time::Duration = std::time::Duration::from_secs(2);

/// Runs the program on the process's own arguments.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) => {
            let _ = e.print();
            return ExitCode::from(if e.use_stderr() { 2 } else { 0 });
        }
    };
    crate::footage::let_files_stay_open();
    let cancelled = Arc::new(AtomicBool::new(false));
    let flag = cancelled.clone();
    let at_once = !cli.command.keeps_what_is_done();
    // Without a handler Ctrl-C still stops the program; results are whole either way, because writes are atomic.
    // Where the parent has one of its signals ignored (`nohup`, `trap '' INT`), none is installed: the handler would revive it, and is not told which one came.
    let _ = ctrlc::try_set_handler(move || {
        if at_once {
            let e = CliError::interrupted_at_once();
            fail(&e, false);
            crate::provenance::end_writing(PATIENCE);
            std::process::exit(e.exit_code().into());
        }
        if flag.swap(true, Ordering::Relaxed) {
            crate::provenance::end_writing(PATIENCE);
            std::process::exit(2); // second Ctrl-C: at once
        }
    });
    let json = cli.shell.json;
    if let Err(e) = threads::start(cli.shell.threads) {
        return fail(&e, json);
    }
    let to_stdout = cli.command.output().is_some_and(crate::provenance::is_stdout);
    if to_stdout && cli.shell.json {
        return fail(&CliError::input("--json and a file that is stdout: both would stand there").hint("leave one of them out, or name another file"), json);
    }
    let shell = Shell {
        stdout_is_taken: cli.shell.json || to_stdout,
        out_was_asked: cli.shell.out.is_some(),
        args: cli.shell,
        is_step: false,
        given: Mutex::default(),
        cancelled,
    };
    match dispatch(cli.command, &shell) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => fail(&e, json),
    }
}

/// Says what failed; `whole` where a program may read it, line by line.
fn fail(e: &CliError, whole: bool) -> ExitCode {
    let mut err = std::io::stderr();
    let message = e.message.trim_end();
    let _ = writeln!(err, "error: {}", plain(&if whole { message.to_owned() } else { same_reasons::grouped(message) }));
    for hint in &e.hints {
        let _ = writeln!(err, "  try: {}", plain(hint));
    }
    ExitCode::from(e.exit_code())
}
