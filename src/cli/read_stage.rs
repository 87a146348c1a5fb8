//! `hush read-stage`: reads a stage for the process that started this one.

use clap::Args;

use super::{Exit, print_json};
use crate::error::Result;
use crate::settings::{READ_STAGE, StageRef, stage_answer};

/// The subcommand's name; it is not for users.
pub(super) const NAME: &str = READ_STAGE;

/// Prints a stage's settings as JSON, for the process that started this one.
#[derive(Args)]
pub(super) struct ReadStageArgs {
    stage: StageRef,
}

/// Runs the subcommand.
pub(super) fn read_stage(args: &ReadStageArgs) -> Result<Exit> {
    print_json(&stage_answer(&args.stage));
    Ok(Exit::Good)
}
