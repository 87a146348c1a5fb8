//! What to denoise and how: everything a run needs besides the engine.

use std::path::PathBuf;

use super::frame_settings::FrameSettings;
use crate::engine::{Engine, Identity, Settings};
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;
use crate::io::{LambdaImages, Selection};
use crate::network::weights::Weights;
use crate::rules::lambda::Lambda;
use crate::rules::skip::Skip;
use crate::rules::window::{DEFAULT_WINDOW, check_window};
use crate::settings::{Guide, Layered, ShotSettings};

/// A shot to denoise.
#[derive(Clone, Debug)]
pub struct Job {
    /// The input files.
    pub sequence: Sequence,
    /// The output folder; created if it is not there. Never the input folder.
    pub output: PathBuf,
    /// The shot that the sequence is only a part of; None where the sequence is all of it.
    pub whole: Option<WholeShot>,
    /// What is read of the files, which frames are written and how; `input`, `output` and `enable` are not looked at.
    pub settings: ShotSettings,
    /// Write every frame again and replace files that Hush did not write.
    pub overwrite: bool,
    /// Stop at the first bad or missing frame instead of going on without it.
    pub strict: bool,
    /// What is odd about the settings themselves; said once, as a warning.
    pub notes: Vec<String>,
    /// The files that the settings are from.
    pub settings_files: Vec<PathBuf>,
}

/// What is known of a shot beyond the files that a job is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WholeShot {
    /// The first frame's number.
    pub first: i64,
    /// The last frame's number.
    pub last: i64,
    /// Whether some frame has motion vectors.
    pub vector: bool,
}

impl Job {
    /// A job with the default settings.
    pub fn new(sequence: Sequence, output: impl Into<PathBuf>) -> Self {
        let settings = ShotSettings::default();
        let (notes, settings_files) = Default::default();
        Self { sequence, output: output.into(), whole: None, settings, overwrite: false, strict: false, notes, settings_files }
    }

    /// The job for a sequence with these settings. `output` is where to write, whatever they say.
    ///
    /// # Errors
    /// [`Error::SwitchedOff`] where the shot is not to be denoised; [`Error::BadSetting`] without an output folder.
    pub fn of(settings: &Layered, sequence: Sequence, output: Option<PathBuf>) -> Result<Self> {
        if settings.values.enable == Some(false) {
            return Err(Error::SwitchedOff { by: settings.origin("enable").to_string() });
        }
        let output = output.map_or_else(|| settings.output(), Ok)?;
        let (values, notes, settings_files) = (settings.values.clone(), settings.notes.clone(), settings.files());
        Ok(Self { settings: values, notes, settings_files, ..Self::new(sequence, output) })
    }

    /// This job with other settings.
    pub fn with(mut self, change: impl FnOnce(&mut ShotSettings)) -> Self {
        change(&mut self.settings);
        self
    }

    /// What is read of the files.
    pub(crate) fn selection(&self) -> Selection {
        self.settings.selection()
    }

    /// The dial.
    pub(crate) fn lambda(&self) -> Lambda {
        self.settings.lambda.clone().unwrap_or_default()
    }

    /// λ of what the mask marks in a frame; None without a mask.
    pub(crate) fn lambda_masked(&self, frame: i64) -> Option<f32> {
        let masked = || self.settings.lambda_masked.as_ref().map_or_else(|| Lambda::of_masked().at(frame), |said| said.at(frame));
        self.settings.has_lambda_mask().then(masked)
    }

    /// The image that is the mask of a frame's λ.
    pub(crate) fn lambda_image(&self, frame: i64) -> Option<PathBuf> {
        self.settings.lambda_images.as_ref().map(|images| LambdaImages::new(images).path(frame))
    }

    /// What is odd about λ and its mask.
    pub(crate) fn lambda_notes(&self) -> Vec<String> {
        let mut notes = self.settings.lambda_notes();
        if self.settings.lambda_masked.is_some() && !self.settings.has_lambda_mask() {
            notes.push(
                "lambda masked does nothing without a mask: set lambda pass to NAME, or set lambda images to PATTERN".into(),
            );
        }
        if self.settings.lambda_images.is_some() && self.selection().lambda_pass.is_some() {
            notes.push("lambda pass is not looked at: lambda images are the mask".into());
        }
        notes
    }

    /// Whether motion vectors may be used.
    pub(crate) fn vectors(&self) -> bool {
        self.settings.guides.as_ref().is_none_or(|guides| guides.contains(&Guide::Vector))
    }

    /// Whether a frame is to be written; others only help.
    pub(crate) fn wants(&self, number: i64) -> bool {
        self.settings.frames.as_ref().is_none_or(|set| set.contains(number)) && self.sequence.is_named(number)
    }

    /// Frames on each side that may help, before it is known whether there are motion vectors.
    ///
    /// # Errors
    /// A window that is too wide, or that needs the vectors that are switched off.
    pub(crate) fn reach(&self) -> Result<usize> {
        let window = self.settings.window;
        let reach = window.map(check_window).transpose()?.unwrap_or(DEFAULT_WINDOW);
        if self.vectors() {
            return Ok(reach);
        }
        if window.is_some_and(|w| w > 0) {
            let reason = "needs motion vectors, which are switched off: set window to 0 or leave the Vector pass on";
            return Err(Error::BadSetting { name: "window", reason: reason.into() });
        }
        Ok(0)
    }

    /// The settings that decide what a frame looks like, once the window is known; λ is that of `frame`.
    pub(crate) fn frame_settings(&self, window: usize, frame: i64, engine: &Identity) -> Result<FrameSettings> {
        if let Some(asked) = self.settings.window {
            check_window(asked)?;
        }
        let lambda_masked = self.lambda_masked(frame);
        Ok(FrameSettings { lambda_masked, ..FrameSettings::new(&self.settings, self.lambda().at(frame), window, engine.clone()) })
    }
}

impl ShotSettings {
    /// Whether some pixels have another λ.
    pub(crate) fn has_lambda_mask(&self) -> bool {
        self.lambda_images.is_some() || self.lambda_pass.as_ref().is_some_and(|name| !name.is_empty())
    }

    /// Values of λ that were clamped.
    pub(crate) fn lambda_notes(&self) -> Vec<String> {
        let masked = self.lambda_masked.as_ref().and_then(Lambda::note).map(|note| format!("lambda masked: {note}"));
        self.lambda.as_ref().and_then(Lambda::note).into_iter().chain(masked).collect()
    }

    /// The engine that they ask for.
    ///
    /// # Errors
    /// Weights that cannot be read or used, too little memory.
    pub fn engine(&self) -> Result<Engine> {
        let settings = Settings {
            memory: self.memory,
            threads: self.threads,
            skip: self.rules(),
            second_pass: self.wants_second_pass(),
            ..Settings::default()
        };
        Engine::from_weights(&Weights::open(self.model.as_deref(), self.renderer.as_deref())?, settings)
    }

    /// What [`engine`](Self::engine) would be, without making it.
    ///
    /// # Errors
    /// Weights that cannot be read.
    pub fn identity(&self) -> Result<Identity> {
        Identity::of(self.model.as_deref(), self.renderer.as_deref(), self.rules(), self.wants_second_pass())
    }

    fn wants_second_pass(&self) -> bool {
        self.second_pass.unwrap_or_default()
    }

    fn rules(&self) -> Skip {
        self.skip.as_deref().map_or_else(Skip::default, Skip::of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn job() -> Job {
        let sequence = Sequence { name: "a.exr".into(), frames: Vec::new(), ignored: Vec::new(), named: None };
        Job::new(sequence, "out")
    }

    #[test]
    fn a_window_too_wide_is_refused() {
        let identity = ShotSettings::default().identity().unwrap();
        assert!(job().with(|s| s.window = Some(4)).frame_settings(0, 1, &identity).is_err());
    }

    #[test]
    fn a_shot_switched_off_is_no_job() {
        let said = |json: &str| {
            Layered::new(serde_json::from_str(json).unwrap(), |name| crate::settings::Origin::CommandLine {
                option: format!("x {name}"),
            })
        };
        let off = Job::of(&said(r#"{"enable": false, "output": "out"}"#), job().sequence, None);
        assert!(matches!(off, Err(Error::SwitchedOff { by }) if by == "x enable"));
        let nowhere = Job::of(&said("{}"), job().sequence, None).unwrap_err().to_string();
        assert!(nowhere.contains("set output to") && nowhere.contains("hush.toml"), "{nowhere}");
    }
}
