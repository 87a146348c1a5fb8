//! How a process is started from Python that reads a USD stage.

use std::ffi::OsString;

use pyo3::prelude::*;

use crate::settings::{StageReader, set_stage_reader};

/// Says how Hush's command line is started in a process of its own: a program and the arguments in front of the command's own; or,
/// where `command` is empty, why it cannot be.
#[pyfunction]
pub fn read_stages_with(command: Vec<OsString>, reason: String) {
    let mut words = command.into_iter();
    set_stage_reader(match words.next() {
        Some(program) => StageReader::Command { program: program.into(), arguments: words.collect() },
        None => StageReader::Unavailable(reason),
    });
}
