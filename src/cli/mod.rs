//! The command line: turns arguments into calls of the library and results into words and exit codes.

mod denoise;
mod eval;
mod inspect;
mod job_args;
mod plan;
mod progress;
mod report;
mod shot_args;
mod size;
mod skip_args;

use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};

use crate::error::{Error, Result};
use crate::shot::{CancelToken, remove_unfinished};

const EXIT_CODES: &str = "Exit codes:
  0    every frame asked for is there, written now or before
  1    nothing was done: wrong usage, unusable input, or no frame could be written
  2    some frames failed, are missing, or were done without a neighbour whose file is bad
  130  stopped by Ctrl-C or SIGTERM; run the same command again to continue";

/// Takes the noise out of Blender Cycles animations without flicker.
#[derive(Parser)]
#[command(name = "hush", version, after_help = EXIT_CODES, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Denoise(Box<denoise::DenoiseArgs>),
    Inspect(inspect::InspectArgs),
    Eval(eval::EvalArgs),
    Plan(Box<plan::PlanArgs>),
    Report(Box<report::ReportArgs>),
}

/// Why the process ends as it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Exit {
    Good = 0,
    Nothing = 1,
    Partly = 2,
    Stopped = 130,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        ExitCode::from(exit as u8)
    }
}

/// Runs the command with these arguments (the first is the program's name).
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) => {
            let _ = error.print();
            let asked = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
            return if asked { Exit::Good } else { Exit::Nothing }.into();
        }
    };
    let exit = match cli.command {
        Command::Denoise(args) => denoise::denoise(&args),
        Command::Inspect(args) => inspect::inspect_files(&args),
        Command::Eval(args) => eval::eval(&args),
        Command::Plan(args) => plan::plan(&args),
        Command::Report(args) => report::report(&args),
    };
    exit.unwrap_or_else(|error| {
        say_error(&error);
        Exit::Nothing
    })
    .into()
}

/// One line on standard output; a closed pipe is not an error.
fn print(text: impl std::fmt::Display) {
    let mut out = std::io::stdout().lock();
    let _ = writeln!(out, "{text}").and_then(|()| out.flush());
}

/// One line on standard error.
fn say(text: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

fn say_error(error: &dyn std::fmt::Display) {
    say(format_args!("error: {error}"));
}

/// A value as one line of JSON on standard output.
fn print_json(value: &impl serde::Serialize) {
    match serde_json::to_string(value) {
        Ok(text) => print(text),
        Err(error) => say_error(&error),
    }
}

/// The first signal lets what is in hand be finished, the second removes what `output` holds unfinished and ends the process.
fn stop_on_signal(cancel: &CancelToken, output: Option<&Path>) -> Result<()> {
    let (cancel, output) = (cancel.clone(), output.map(Path::to_path_buf));
    let handler = move || {
        if cancel.is_cancelled() {
            output.iter().for_each(|folder| remove_unfinished(folder));
            std::process::exit(Exit::Stopped as i32);
        }
        cancel.cancel();
        say("stopping after the frame in hand; once more stops at once");
    };
    ctrlc::set_handler(handler).map_err(|e| Error::BadInput { input: "signal handler".into(), reason: e.to_string() })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_definition_is_sound_and_tells_the_exit_codes() {
        Cli::command().debug_assert();
        let help = Cli::command().render_long_help().to_string();
        assert!(help.contains("130") && help.contains("Exit codes"));
    }
}
