//! The options that say what a frame shall look like, and what it may take; shared by `hush denoise` and `hush watch`.

use std::path::PathBuf;

use clap::Args;

use super::size::parse_size;
use super::skip_args::SkipArgs;
use crate::engine::{Engine, Settings};
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;
use crate::io::{Guides, Selection};
use crate::plan::frames::FrameSet;
use crate::plan::lambda::Lambda;
use crate::shot::{Job, ModelId};

/// Everything of a job but its inputs.
#[derive(Args)]
pub(super) struct JobArgs {
    /// Folder to write to; never the one with the inputs
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// From 1 (cleanest) to 64 (keeps grain and the detail hidden in it); 1:1,24:8 goes from 1 at frame 1 to 8 at frame 24
    #[arg(short, long, default_value_t, allow_hyphen_values = true)]
    lambda: Lambda,
    /// Frames on each side that help, 0 to 3 [default: 2 where there is a Vector pass, else 0]
    #[arg(short, long)]
    window: Option<usize>,
    /// Frames to write, such as 1-48,60; frames beside them still help [default: all]
    #[arg(short, long, allow_hyphen_values = true)]
    pub frames: Option<FrameSet>,
    /// View layer to denoise; may be given several times [default: the one with the most samples]
    #[arg(long = "layer", value_name = "NAME|all")]
    layers: Vec<String>,
    /// Stereo view to denoise [default: all]
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// View layer to take the Vector pass from, such as one without motion blur
    #[arg(long, value_name = "NAME")]
    vector_layer: Option<String>,
    /// Light pass to denoise along, such as "Diffuse Direct", or all; may be given several times
    #[arg(long = "aov", value_name = "NAME|all")]
    aovs: Vec<String>,
    /// Do without the Denoising Albedo
    #[arg(long)]
    no_albedo: bool,
    /// Do without the Denoising Normal
    #[arg(long)]
    no_normal: bool,
    /// Do without depth
    #[arg(long)]
    no_depth: bool,
    /// Do without motion vectors, and so without neighbours
    #[arg(long)]
    no_vector: bool,
    /// Keep the input beside the result as "Noisy Image"
    #[arg(long)]
    keep_noisy: bool,
    /// Memory for the frames in the window and the computing, such as 4G; reading and writing come on top [default: 3.1G]
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    memory: Option<u64>,
    /// Threads for computing [default: all cores]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=4096))]
    threads: Option<u16>,
    /// Other weights, a safetensors file
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    #[command(flatten)]
    skip: SkipArgs,
}

impl JobArgs {
    /// The job for a sequence.
    pub fn job(&self, sequence: Sequence) -> Result<Job> {
        let guides = Guides { albedo: !self.no_albedo, normal: !self.no_normal, depth: !self.no_depth, vector: !self.no_vector };
        let selection = Selection {
            layers: self.layers.clone(),
            view: self.view.clone(),
            vector_layer: self.vector_layer.clone(),
            guides,
            aovs: self.aovs.clone(),
            ..Selection::default()
        };
        Ok(Job {
            frames: self.frames.clone(),
            lambda: self.lambda.clone(),
            window: self.window,
            selection,
            keep_noisy: self.keep_noisy,
            skip: self.skip.skip()?,
            model: self.model.as_deref().map_or(Ok(ModelId::embedded()), ModelId::of_file)?,
            ..Job::new(sequence, &self.output)
        })
    }

    /// The engine with its weights; sets the number of threads, so it is called once.
    pub fn engine(&self) -> Result<Engine> {
        if let Some(threads) = self.threads {
            let built = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads)).build_global();
            built.map_err(|e| Error::BadSetting { name: "threads", reason: e.to_string() })?;
        }
        let settings = Settings { memory: self.memory, skip: self.skip.skip()?, ..Settings::default() };
        match &self.model {
            Some(path) => Engine::from_file(path, settings),
            None => Engine::new(settings),
        }
    }
}
