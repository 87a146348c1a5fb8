//! The options that say what a frame shall look like, and what it may take; shared by `hush denoise` and `hush watch`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::setting_args::{SettingArgs, SourceArgs, folder_of};
use super::skip_args::SkipArgs;
use crate::engine::{Engine, Settings};
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;
use crate::network::renderers::DEFAULT_RENDERER;
use crate::network::weights::Weights;
use crate::rules::frames::FrameSet;
use crate::rules::skip::Skip;
use crate::settings::{Layered, ShotSettings};
use crate::shot::Job;

/// The sequence that `inputs` name, or the settings where there are none; and its settings, which `settings` finds for a folder.
pub(super) fn find_shot(inputs: &[PathBuf], settings: &dyn Fn(Option<&Path>) -> Result<Layered>) -> Result<(Sequence, Layered)> {
    let sequence = if inputs.is_empty() {
        let input = settings(None)?.values.input.ok_or_else(|| Error::BadInput {
            input: "INPUT".into(),
            reason: "is missing: name the frames, or a stage or settings file that names them (--usd, --settings)".into(),
        })?;
        Sequence::find(&[input])?
    } else {
        Sequence::find(inputs)?
    };
    let settings = settings(sequence.frames.first().map(|f| folder_of(&f.path)))?;
    Ok((sequence, settings))
}

/// Everything of a job but its inputs.
#[derive(Args)]
pub(super) struct JobArgs {
    /// Folder to write to; never the one with the inputs [default: what the shot's settings say]
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Frames to write, such as 1-48,60; frames beside them still help [default: all]
    #[arg(short, long, allow_hyphen_values = true)]
    pub frames: Option<FrameSet>,
    #[command(flatten)]
    settings: SettingArgs,
    #[command(flatten)]
    sources: SourceArgs,
    /// Threads for computing [default: all cores]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=4096))]
    threads: Option<u16>,
    #[command(flatten)]
    skip: SkipArgs,
}

impl JobArgs {
    /// The settings for the frames in a folder (None: those that need no folder), from all sources.
    pub fn settings(&self, folder: Option<&Path>) -> Result<Layered> {
        Ok(self.settings.without_guides(self.sources.gather(folder, self.given()?)?))
    }

    /// What may be left out.
    pub fn skip(&self) -> Result<Skip> {
        self.skip.skip()
    }

    /// As [`settings`](Self::settings), with a stage or a settings file that was named without its option.
    pub fn settings_with(&self, stage: Option<&Path>, file: Option<&Path>) -> Result<Layered> {
        let twice = |name| Err(Error::BadSetting { name, reason: "is given twice: name one file".into() });
        let mut sources = self.sources.clone();
        if let Some(stage) = stage {
            let stage = stage.to_string_lossy().parse()?;
            if sources.usd.replace(stage).is_some() {
                return twice("usd");
            }
        }
        if let Some(file) = file
            && sources.settings.replace(file.to_owned()).is_some()
        {
            return twice("settings");
        }
        Ok(self.settings.without_guides(sources.gather(None, self.given()?)?))
    }

    fn given(&self) -> Result<ShotSettings> {
        Ok(ShotSettings { output: self.output.clone(), frames: self.frames.clone(), ..self.settings.given()? })
    }

    /// The settings for a sequence: also from the side file beside its frames.
    pub fn settings_of(&self, sequence: &Sequence) -> Result<Layered> {
        self.settings(sequence.frames.first().map(|f| folder_of(&f.path)))
    }

    /// The sequence that `inputs` name, or the settings where there are none; and its settings.
    pub fn shot(&self, inputs: &[PathBuf]) -> Result<(Sequence, Layered)> {
        find_shot(inputs, &|folder| self.settings(folder))
    }

    /// The job for a sequence, with the settings beside its frames, for an engine that was made by `engine`.
    ///
    /// # Errors
    /// The settings beside the frames name other weights or another renderer than the engine has.
    pub fn job_with(&self, sequence: Sequence, engine: &Layered) -> Result<Job> {
        let settings = self.settings_of(&sequence)?;
        if settings.values.model != engine.values.model {
            let reason = format!("{} names other weights, and one run has one kind: pass --model", settings.origin("model"));
            return Err(Error::BadSetting { name: "model", reason });
        }
        let renderer = |s: &Layered| s.values.renderer.as_deref().unwrap_or(DEFAULT_RENDERER).to_ascii_lowercase();
        if renderer(&settings) != renderer(engine) {
            let by = settings.origin("renderer");
            let reason = format!("{by} names another renderer, and one run has one encoder: pass --renderer");
            return Err(Error::BadSetting { name: "renderer", reason });
        }
        Ok(Job { skip: self.skip()?, ..settings.job(sequence, engine.values.output.clone())? })
    }

    /// The engine with the weights and the memory that the settings say.
    pub fn engine_for(&self, settings: &ShotSettings) -> Result<Engine> {
        let threads = self.threads.map(usize::from);
        let engine = Settings { memory: settings.memory, skip: self.skip()?, threads, ..Settings::default() };
        Engine::from_weights(&Weights::open(settings.model.as_deref(), settings.renderer.as_deref())?, engine)
    }
}
