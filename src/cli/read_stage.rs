//! Reads a stage in a process of its own, so that a file made to harm ends in an error and not in the end of the run.

use std::process::{Command, Stdio};

use clap::Args;
use serde::{Deserialize, Serialize};

use super::{Exit, print_json};
use crate::error::{Error, Result};
use crate::settings::usd::read;
use crate::settings::{Layered, StageRef};

/// The subcommand's name; it is not for users.
pub(super) const NAME: &str = "read-stage";
/// What the reading process may take.
#[cfg(unix)]
const MEMORY: u64 = 8 << 30;
#[cfg(unix)]
const SECONDS: u32 = 120;

/// Prints a stage's settings as JSON, for the process that started this one.
#[derive(Args)]
pub(super) struct ReadStageArgs {
    stage: StageRef,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Answer {
    Settings(Box<Layered>),
    /// Without the stage's path.
    Refused(String),
}

/// Runs the subcommand.
pub(super) fn read_stage(args: &ReadStageArgs) -> Result<Exit> {
    limit();
    print_json(&match read(&args.stage) {
        Ok(settings) => Answer::Settings(Box::new(settings)),
        Err(Error::BadFile { reason, .. }) => Answer::Refused(reason),
        Err(Error::Io { source, .. }) => Answer::Refused(source.to_string()),
        Err(other) => Answer::Refused(other.to_string()),
    });
    Ok(Exit::Good)
}

/// As [`read`], by starting this program once more.
pub(super) fn read_apart(stage: &StageRef) -> Result<Layered> {
    let Ok(program) = std::env::current_exe() else { return read(stage) };
    let mut command = Command::new(program);
    command.args([NAME, "--", &stage.to_string()]).stdin(Stdio::null()).stderr(Stdio::null());
    let answer = command.output().map_err(|e| Error::io(&stage.file, e))?;
    match serde_json::from_slice(&answer.stdout) {
        Ok(Answer::Settings(settings)) => Ok(*settings),
        Ok(Answer::Refused(reason)) => Err(Error::bad_file(&stage.file, reason)),
        Err(_) => {
            let reason = format!(
                "the USD reader broke down on it ({}): the file is damaged or too large; hush.toml beside the frames carries all the \
                 settings too",
                answer.status
            );
            Err(Error::bad_file(&stage.file, reason))
        }
    }
}

/// Bounds the memory and the time of this process.
#[cfg(unix)]
fn limit() {
    let to = |most: u64| libc::rlimit { rlim_cur: most as libc::rlim_t, rlim_max: most as libc::rlim_t };
    // SAFETY: plain system calls on this process; the structs outlive them. A refusal leaves things as they are.
    unsafe {
        libc::setrlimit(libc::RLIMIT_AS, &to(MEMORY));
        libc::setrlimit(libc::RLIMIT_CORE, &to(0));
        libc::alarm(SECONDS);
    }
}

#[cfg(not(unix))]
fn limit() {}
