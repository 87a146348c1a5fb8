//! `hush eval`: how close a denoised shot is to its reference.

use std::path::PathBuf;

use clap::Args;

use super::{Exit, print, print_json};
use crate::error::Result;
use crate::metrics::{EvaluateOptions, ImageChoice, Scaling, UnbiasedOptions, evaluate};

/// Compares a denoised shot with its reference: SMAPE, relMSE, PSNR, SSIM, FLIP and flicker
#[derive(Args)]
pub(super) struct EvalArgs {
    /// The reference: a folder, a pattern such as ref/frame_####.exr, or a file
    reference: PathBuf,
    /// The denoised shot, named alike; frames are paired by number
    denoised: PathBuf,
    /// Where flicker takes the Vector pass from, such as the noisy shot [default: the denoised files, then the reference]
    #[arg(long, value_name = "INPUT")]
    vectors: Option<PathBuf>,
    /// A second reference, rendered with another seed: also relMSE and flicker without the references' noise
    #[arg(long, value_name = "INPUT", requires = "brightness")]
    reference_b: Option<PathBuf>,
    /// What those errors are relative to: images as bright as the truth that share no noise with either reference, the same for all
    /// shots that are compared, such as another denoiser's or a third reference
    #[arg(long, value_name = "INPUT", requires = "reference_b")]
    brightness: Option<PathBuf>,
    /// View layer to compare [default: the one with the most samples]
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Stereo view to compare
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// View layer that holds the Vector pass
    #[arg(long, value_name = "NAME")]
    vector_layer: Option<String>,
    /// Compare radiance as it is, instead of scaled to a reference mean of 0.4
    #[arg(long)]
    no_scaling: bool,
    /// JSON instead of a table
    #[arg(long)]
    json: bool,
}

/// Runs the subcommand; frames that cannot be compared show in the exit code.
pub(super) fn eval(args: &EvalArgs) -> Result<Exit> {
    let scaling = if args.no_scaling { Scaling::None } else { Scaling::ReferenceMean };
    let images = ImageChoice { layer: args.layer.clone(), view: args.view.clone(), vector_layer: args.vector_layer.clone() };
    let unbiased = args.reference_b.clone().zip(args.brightness.clone());
    let unbiased = unbiased.map(|(reference, brightness)| UnbiasedOptions { reference, brightness });
    let options = EvaluateOptions { scaling, vectors: args.vectors.clone(), unbiased, images };
    let evaluation = evaluate(&args.reference, &args.denoised, &options)?;
    if args.json {
        print_json(&evaluation)
    } else {
        print(evaluation.to_string().trim_end())
    }
    Ok(match evaluation.failed() {
        0 => Exit::Good,
        n if n < evaluation.frames.len() => Exit::Partly,
        _ => Exit::Nothing,
    })
}
