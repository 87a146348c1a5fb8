//! The `hush` command.

use hush::settings::{StageReader, set_stage_reader};

fn main() -> std::process::ExitCode {
    // This program is Hush, so it can be started once more to read a stage.
    if let Ok(program) = std::env::current_exe() {
        set_stage_reader(StageReader::Command { program, arguments: Vec::new() });
    }
    hush::cli::main(std::env::args_os())
}
