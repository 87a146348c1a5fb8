//! The command line: turns arguments into calls of the library and results into words and exit codes.

mod advice;
mod check;
mod denoise;
mod estimate;
mod eval;
mod inspect;
mod preview;
mod progress;
mod read_stage;
mod report;
mod setting_args;
mod shot;
mod signals;
mod status;
mod survey;
mod watch;

use std::ffi::OsString;
use std::io::{ErrorKind as IoErrorKind, Write};
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};

use crate::error::{Error, Result};
use crate::settings::READ_STAGE;
use crate::simd::Isa;
use read_stage::ReadStageArgs;

const EXIT_CODES: &str = "Exit codes:
  0    every frame asked for is there, written now or before
  1    nothing was done: wrong usage, unusable input, or no frame could be written
  2    some frames failed, are missing, or were done without a neighbour whose file is bad
  3    nothing was done, because the shot's settings switch denoising off
  130  stopped by Ctrl-C, SIGTERM or SIGHUP; run the same command again to continue";

/// Takes the noise out of Blender Cycles animations, with less flicker than frame by frame.
#[derive(Parser)]
#[command(name = "hush", version, after_help = EXIT_CODES, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Denoise(Box<denoise::DenoiseArgs>),
    Check(Box<check::CheckArgs>),
    Watch(Box<watch::WatchArgs>),
    Inspect(inspect::InspectArgs),
    Eval(eval::EvalArgs),
    Shot(shot::ShotSubcommands),
    /// Parsed apart from the others, for none of which clap is to suggest it.
    #[command(skip)]
    ReadStage(ReadStageArgs),
    Survey(Box<survey::SurveyArgs>),
    Preview(Box<preview::PreviewArgs>),
    Report(Box<report::ReportArgs>),
}

/// Why the process ends as it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Exit {
    Good = 0,
    Nothing = 1,
    Partly = 2,
    SwitchedOff = 3,
    Stopped = 130,
}

/// What a signal does.
pub type Handler = Box<dyn FnMut() + Send>;

/// Has a handler called at every signal that asks the process to end.
pub type CatchSignals<'a> = &'a dyn Fn(Handler) -> Result<()>;

/// Runs the command with these arguments (the first is the program's name).
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    ExitCode::from(run(args, &signals::catch))
}

/// As [`main`], for a caller that catches signals in its own way; returns the exit code.
pub fn run(args: impl IntoIterator<Item = OsString>, catch_signals: CatchSignals) -> u8 {
    let args: Vec<OsString> = args.into_iter().collect();
    let exit = parse_and_run(&args, catch_signals);
    if cfg!(windows) && exit == Exit::Nothing as u8 {
        advice::swallowed_quote(&args).iter().for_each(say);
    }
    exit
}

fn parse(args: &[OsString]) -> clap::error::Result<Command> {
    match args {
        [_, name, ..] if name == READ_STAGE => ReadStageArgs::try_parse_from(&args[1..]).map(Command::ReadStage),
        _ => Cli::try_parse_from(args).map(|cli| cli.command),
    }
}

fn parse_and_run(args: &[OsString], catch_signals: CatchSignals) -> u8 {
    let command = match parse(args) {
        Ok(command) => command,
        Err(error) => {
            let _ = error.print();
            let asked = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
            return if asked { Exit::Good } else { Exit::Nothing } as u8;
        }
    };
    // Machines of a farm that round in another way than the others are not to go unnoticed.
    if let Err(error) = Isa::check_wish() {
        say_error(&error);
        return Exit::Nothing as u8;
    }
    let exit = match command {
        Command::Denoise(args) => denoise::denoise(&args, catch_signals),
        Command::Check(args) => check::check(&args),
        Command::Watch(args) => watch::watch_folder(&args, catch_signals),
        Command::Inspect(args) => inspect::inspect_files(&args),
        Command::Eval(args) => eval::eval(&args),
        Command::Shot(args) => shot::shot(&args),
        Command::ReadStage(args) => read_stage::read_stage(&args),
        Command::Survey(args) => survey::show_survey(&args, catch_signals),
        Command::Preview(args) => preview::show_preview(&args, catch_signals),
        Command::Report(args) => report::report(&args, catch_signals),
    };
    let exit = exit.unwrap_or_else(|error| {
        say_error(&error);
        if matches!(error, Error::SwitchedOff { .. }) { Exit::SwitchedOff } else { Exit::Nothing }
    });
    match LOST.lock().unwrap_or_else(PoisonError::into_inner).take() {
        Some(reason) => {
            say_error(&format_args!("standard output: {reason}: not all was printed"));
            Exit::Nothing as u8
        }
        None => exit as u8,
    }
}

/// Why a part of what the command was to print is lost.
static LOST: Mutex<Option<String>> = Mutex::new(None);

fn lose(reason: &dyn std::fmt::Display) {
    LOST.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(|| reason.to_string());
}

/// What the command was asked for, as a line on standard output. Where it cannot be written, as on a full disk, the command fails; a
/// reader that is gone has read enough.
fn print(text: impl std::fmt::Display) {
    match write_line(&text) {
        Err(error) if error.kind() != IoErrorKind::BrokenPipe => lose(&error),
        _ => {}
    }
}

/// What is told beside the files that a command writes, as a line on standard output. Its loss is no error.
fn tell(text: impl std::fmt::Display) {
    let _ = write_line(&text);
}

fn write_line(text: &dyn std::fmt::Display) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{text}").and_then(|()| out.flush())
}

/// One line on standard error.
fn say(text: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

fn say_error(error: &dyn std::fmt::Display) {
    say(format_args!("error: {}", advice::with_options(&error.to_string())));
}

/// As [`print`], a value as one line of JSON.
fn print_json(value: &impl serde::Serialize) {
    match serde_json::to_string(value) {
        Ok(text) => print(text),
        Err(error) => lose(&error),
    }
}

/// As [`tell`], a value as one line of JSON.
fn tell_json(value: &impl serde::Serialize) {
    match serde_json::to_string(value) {
        Ok(text) => tell(text),
        Err(error) => say_error(&error),
    }
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

    #[test]
    fn what_is_not_for_users_is_never_suggested() {
        let wrong = |name: &str| parse(&["hush".into(), name.into()]).err().expect("no such subcommand").to_string();
        assert!(wrong("read-stag").contains("unrecognized subcommand") && !wrong("read-stag").contains("'read-stage'"));
        assert!(wrong("denoize").contains("'denoise'"));
    }
}
