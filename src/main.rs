//! The `hush` command.

fn main() -> std::process::ExitCode {
    hush::cli::main(std::env::args_os())
}
