//! `hush inspect`: what a file holds, what Hush will use and what is missing.

use std::path::PathBuf;

use clap::Args;

use super::advice::with_options;
use super::{Exit, print, print_json, say_error};
use crate::error::Result;
use crate::io::inspect;

/// Prints what a file holds, what Hush will use and what is missing
#[derive(Args)]
pub(super) struct InspectArgs {
    /// EXR files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// One JSON object a line instead of text
    #[arg(long)]
    json: bool,
}

/// Inspects every file; a bad one does not keep the others from being shown.
pub(super) fn inspect_files(args: &InspectArgs) -> Result<Exit> {
    let mut good = 0;
    for file in &args.files {
        match inspect(file) {
            Ok(found) if args.json => {
                good += 1;
                print_json(&found);
            }
            Ok(found) => {
                good += 1;
                print(with_options(&found.to_string()));
            }
            Err(error) => say_error(&error),
        }
    }
    Ok(if good == args.files.len() {
        Exit::Good
    } else if good > 0 {
        Exit::Partly
    } else {
        Exit::Nothing
    })
}
