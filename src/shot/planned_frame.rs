//! A frame of the range, and what is to be done with it.

use std::path::PathBuf;

use serde::Serialize;

use crate::rules::window::WindowFrame;

/// What is to be done with a frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "action", content = "reason", rename_all = "snake_case")]
pub enum Action {
    /// Denoise it; with the reason where it is made again.
    Denoise(Option<String>),
    /// Its output is there and good.
    Skip,
    /// Its file cannot be used.
    Fail(String),
}

/// A frame of the range.
#[derive(Clone, Debug, Serialize)]
pub struct PlannedFrame {
    /// Frame number.
    pub frame: i64,
    /// The input file.
    pub source: PathBuf,
    /// The output file.
    pub output: PathBuf,
    /// The dial.
    pub lambda: f32,
    /// The dial of what the mask marks; None without a mask.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lambda_masked: Option<f32>,
    /// The image that is the mask.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lambda_image: Option<PathBuf>,
    /// What to do.
    #[serde(flatten)]
    pub action: Action,
    /// The frames around it that it depends on, by what the headers say.
    #[serde(serialize_with = "used_numbers")]
    pub neighbours: Vec<WindowFrame>,
}

fn used_numbers<S: serde::Serializer>(window: &[WindowFrame], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(window.iter().filter(|n| n.unused.is_none()).map(|n| n.number))
}
