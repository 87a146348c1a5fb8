//! `hush read-stage`: reads a stage for the process that started this one.

use clap::Parser;

use super::{Exit, print_json};
use crate::error::Result;
use crate::settings::{StageRef, stage_answer};

/// Prints a stage's settings as JSON, for the process that started this one.
#[derive(Parser)]
pub(super) struct ReadStageArgs {
    stage: StageRef,
}

/// Runs the subcommand.
pub(super) fn read_stage(args: &ReadStageArgs) -> Result<Exit> {
    print_json(&stage_answer(&args.stage));
    Ok(Exit::Good)
}
