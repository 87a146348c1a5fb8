//! Reads a stage in a process of its own, so that a file made to harm ends in an error and not in the end of the run.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

use super::layered::Layered;
use super::table::ShotSettings;
use super::usd::{StageRef, read};
use crate::error::{Error, Result, plain};
use crate::rules::lambda::Lambda;

/// The subcommand that reads a stage for the process that started it; it is not for users.
pub const READ_STAGE: &str = "read-stage";
/// What the reading process may take.
#[cfg(unix)]
const MEMORY: u64 = 8 << 30;
const SECONDS: u32 = 120;
const INSTEAD: &str = "hush.toml beside the frames carries all the settings too";

static READER: OnceLock<StageReader> = OnceLock::new();

/// How the reading process is started.
#[derive(Clone, Debug)]
pub enum StageReader {
    /// A program that is known to be Hush with these arguments in front of `read-stage -- STAGE`.
    Command {
        /// The program.
        program: PathBuf,
        /// Its arguments before the subcommand.
        arguments: Vec<OsString>,
    },
    /// There is no such program, for this reason.
    Unavailable(String),
}

/// Says how the reading process is started, for the whole of this process; the first to say so is heard. The program `hush` and the
/// Python module do.
pub fn set_stage_reader(reader: StageReader) {
    let _ = READER.set(reader);
}

/// As [`usd::read`](super::usd::read), in a process of its own. Where nobody has said how that is started, in this process.
///
/// # Errors
/// As [`usd::read`](super::usd::read); [`Error::Io`] where there is no such file; [`Error::BadFile`] where the process cannot be started, or ends on the stage.
pub fn read_apart(stage: &StageRef) -> Result<Layered> {
    std::fs::File::open(&stage.file).map_err(|e| Error::io(&stage.file, e))?;
    let bad = |reason: String| Error::bad_file(&stage.file, format!("{reason}; {INSTEAD}"));
    let (program, arguments) = match READER.get() {
        None => return read(stage),
        Some(StageReader::Unavailable(reason)) => return Err(bad(reason.clone())),
        Some(StageReader::Command { program, arguments }) => (program, arguments),
    };
    let mut command = Command::new(program);
    command.args(arguments).args([READ_STAGE, "--", &stage.to_string()]).stdin(Stdio::null()).stderr(Stdio::null());
    #[cfg(windows)]
    {
        // In Blender no console window may open for it.
        const NO_WINDOW: u32 = 0x0800_0000;
        std::os::windows::process::CommandExt::creation_flags(&mut command, NO_WINDOW);
    }
    let answer =
        command.output().map_err(|e| bad(format!("the USD reader cannot be started ({}: {})", program.display(), plain(&e))))?;
    // Other lines may come from what a Python interpreter runs at its start.
    let last = answer.stdout.trim_ascii_end().rsplit(|byte| *byte == b'\n').next().unwrap_or_default();
    match serde_json::from_slice(last) {
        Ok(Answer::Settings(settings)) => Ok(*settings),
        Ok(Answer::Refused(reason)) => Err(Error::bad_file(&stage.file, reason)),
        Err(_) => Err(bad(format!("the USD reader broke down on it ({}): the file is damaged or too large", answer.status))),
    }
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Answer {
    Settings(Box<Layered>),
    /// Without the stage's path.
    Refused(String),
}

/// What the reading process prints: the stage's settings, or why there are none. Bounds the memory and the time of this process.
pub fn answer(stage: &StageRef) -> impl Serialize {
    limit();
    match read(stage) {
        Ok(mut settings) => {
            // That λ was clamped does not show in the numbers that are passed on.
            let ShotSettings { lambda, lambda_masked, .. } = &settings.values;
            let note =
                |(name, lambda): (_, &Option<Lambda>)| Some(format!("{}: {}", settings.origin(name), lambda.as_ref()?.note()?));
            let clamped: Vec<String> =
                [("lambda", lambda), ("lambda_masked", lambda_masked)].into_iter().filter_map(note).collect();
            settings.notes.extend(clamped);
            Answer::Settings(Box::new(settings))
        }
        Err(Error::BadFile { reason, .. }) => Answer::Refused(reason),
        Err(Error::Io { source, .. }) => Answer::Refused(plain(&source)),
        Err(other) => Answer::Refused(other.to_string()),
    }
}

#[cfg(unix)]
fn limit() {
    use rustix::process::{Resource, Rlimit, setrlimit};
    for (resource, most) in [(Resource::As, MEMORY), (Resource::Core, 0)] {
        // A refusal leaves things as they are.
        let _ = setrlimit(resource, Rlimit { current: Some(most), maximum: Some(most) });
    }
    // SAFETY: a plain number; the signal's default is to end the process.
    unsafe { libc::alarm(SECONDS) };
}

/// Only the time: the memory of a process cannot be bounded here.
#[cfg(not(unix))]
fn limit() {
    std::thread::spawn(|| {
        std::thread::sleep(std::time::Duration::from_secs(SECONDS.into()));
        std::process::exit(1);
    });
}
