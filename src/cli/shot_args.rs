//! The options of commands that look at a shot and write no frames: `hush plan` and `hush report`.

use std::path::PathBuf;

use clap::Args;

use crate::engine::{Engine, Settings};
use crate::error::Result;
use crate::io::Selection;
use crate::io::sequence::Sequence;
use crate::network::weights::Weights;
use crate::rules::frames::FrameSet;
use crate::rules::skip::Skip;
use crate::settings::size::parse_size;

/// The shot, what of it to look at, and with what.
#[derive(Args)]
pub(super) struct ShotArgs {
    /// A folder, a glob, a pattern such as shot/frame_####.exr or shot/frame_%04d.exr, or files
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Frames to look at, such as 1-48,60; frames beside them still help
    #[arg(short, long, allow_hyphen_values = true)]
    pub frames: Option<FrameSet>,
    /// View layer [default: the one with the most samples]
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,
    /// Stereo view
    #[arg(long, value_name = "NAME")]
    pub view: Option<String>,
    /// View layer to take the Vector pass from, such as one without motion blur
    #[arg(long, value_name = "NAME")]
    vector_layer: Option<String>,
    /// Memory for the frames in the window and the computing, such as 4G [default: 3.1G]
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    memory: Option<u64>,
    /// Threads for computing [default: all cores]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=4096))]
    threads: Option<u16>,
    /// Other weights, a safetensors file
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Renderer that made the frames, one that the weights have an encoder for: cycles or mitsuba [default: cycles]
    #[arg(long, value_name = "NAME")]
    renderer: Option<String>,
}

impl ShotArgs {
    /// The files.
    pub fn sequence(&self) -> Result<Sequence> {
        Sequence::find(&self.inputs)
    }

    /// What is read of them, with these light passes.
    pub fn selection(&self, aovs: &[String]) -> Selection {
        Selection {
            layers: self.layer.iter().cloned().collect(),
            view: self.view.clone(),
            vector_layer: self.vector_layer.clone(),
            aovs: aovs.to_vec(),
            ..Selection::default()
        }
    }

    /// The engine with its weights.
    pub fn engine(&self, skip: Skip) -> Result<Engine> {
        let threads = self.threads.map(usize::from);
        Engine::from_weights(&self.weights()?, Settings { memory: self.memory, skip, threads, ..Settings::default() })
    }

    /// The weights.
    pub fn weights(&self) -> Result<Weights> {
        Weights::open(self.model.as_deref(), self.renderer.as_deref())
    }
}
