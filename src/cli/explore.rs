//! `sweetspot explore`.

mod findings;
mod frame_rate;
mod models;
mod published;

use super::Shell;
use super::error::CliError;
use std::path::PathBuf;

/// What-if studies of the model: added weight, swing, impact position, accuracy, strings, grip; published numbers; older models
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Which study
    #[arg(value_enum, default_value = "findings")]
    pub study: Study,
    /// Racket file (for `findings`)
    #[arg(long, value_name = "F")]
    pub racket: Option<PathBuf>,
    /// Ball file (for `findings`); without it an ITF ball of 57.7 g
    #[arg(long, value_name = "F")]
    pub ball: Option<PathBuf>,
    /// Model file (for `findings`); without it the visco-elastic base at its defaults
    #[arg(long, value_name = "F")]
    pub model: Option<PathBuf>,
    /// Number of shots in the accuracy study
    #[arg(long, default_value_t = 2000)]
    pub shots: usize,
    /// Session of the frame-rate study
    #[arg(long, value_name = "DIR")]
    pub session: Option<PathBuf>,
    /// Only this shot of the frame-rate study (may be given more than once)
    #[arg(long = "shot", value_name = "ID")]
    pub only: Vec<String>,
    /// Seed of the accuracy study
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Study {
    /// The published numbers against the visco-elastic model
    Published,
    /// All what-ifs in one report
    Findings,
    /// The older ball, string and bounce models beside the default one
    Models,
    /// What a slower camera would have got wrong on a session's own tracks (needs --session)
    FrameRate,
}

/// Name of the files, numbers, page.
type Outcome = (&'static str, serde_json::Value, String);

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let folder = shell.args.out.clone().unwrap_or_default();
    if arguments.study != Study::Findings {
        let given = [("--racket", &arguments.racket), ("--ball", &arguments.ball), ("--model", &arguments.model)];
        for (option, _) in given.iter().filter(|(_, file)| file.is_some()) {
            shell.say(format_args!("{option} is for `explore findings`; this study has its own and does not use it"));
        }
    }
    let (name, json, page) = match arguments.study {
        Study::Published => published::published()?,
        Study::Findings => findings::findings(&arguments)?,
        Study::Models => models::models()?,
        Study::FrameRate => {
            let session = arguments.session.as_deref().ok_or_else(|| CliError::input("`explore frame-rate` needs --session DIR"))?;
            return frame_rate::study_session(session, &arguments.only, shell);
        }
    };
    let text = serde_json::to_string_pretty(&json).map_err(CliError::output)?;
    shell.write(&folder.join(format!("{name}.json")), text.as_bytes())?;
    let path = folder.join(format!("{name}.html"));
    shell.write(&path, page.as_bytes())?;
    shell.say(format_args!("written: {}", path.display()));
    shell.print_json(&json)
}
