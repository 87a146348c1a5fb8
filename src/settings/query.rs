//! A shot as somebody names it, and its settings from all sources together: the one door of the command line, Python and Blender.

use std::path::{Path, PathBuf};

use super::apart::read_apart;
use super::file::{SettingsFile, beside, read_settings_file};
use super::layered::{Layered, Origin};
use super::setting::Setting;
use super::table::ShotSettings;
use super::usd::StageRef;
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;

/// What is said about a shot, and where more is to be looked for.
#[derive(Clone, Debug)]
pub struct ShotQuery {
    /// The frames: folders, patterns or files. None: those that the settings name.
    pub inputs: Vec<PathBuf>,
    /// Settings that go before those of files.
    pub given: Layered,
    /// A stage; in place of the one that the settings file names.
    pub usd: Option<StageRef>,
    /// A settings file; in place of the one beside the frames.
    pub file: Option<PathBuf>,
    /// Whether to look for a settings file beside the frames.
    pub look_beside: bool,
}

impl ShotQuery {
    /// The frames that `inputs` name, with settings as from the command line over those of the files beside them.
    pub fn new<P: AsRef<Path>>(inputs: &[P], given: ShotSettings) -> Self {
        let option = |name: &str| Setting::named(name).ok().and_then(|s| s.option).unwrap_or(name).to_owned();
        let given = Layered::new(given, |name| Origin::CommandLine { option: option(name) });
        let inputs = inputs.iter().map(|input| input.as_ref().to_owned()).collect();
        Self { inputs, given, usd: None, file: None, look_beside: true }
    }

    /// The shot: its frames and its settings.
    ///
    /// # Errors
    /// Frames that nobody names or that are not there; settings that cannot be read or are wrong.
    pub fn find(&self) -> Result<(Sequence, Layered)> {
        let inputs = self.inputs()?;
        self.with_settings(&inputs, Sequence::find(&inputs)?)
    }

    /// As [`find`](Self::find); where no frames are on disk, the sequence is empty.
    ///
    /// # Errors
    /// Frames that nobody names; settings that cannot be read or are wrong.
    pub fn find_even_unrendered(&self) -> Result<(Sequence, Layered)> {
        let inputs = self.inputs()?;
        let sequence = match Sequence::find(&inputs) {
            Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => Sequence::unrendered(&inputs),
            found => found?,
        };
        self.with_settings(&inputs, sequence)
    }

    fn with_settings(&self, inputs: &[PathBuf], sequence: Sequence) -> Result<(Sequence, Layered)> {
        let settings = self.settings(Sequence::folder(inputs, &sequence).as_deref())?;
        Ok((sequence, settings))
    }

    /// The settings for the frames in a folder (None: not known yet): the stage's, over them the settings file's, over them those
    /// given.
    ///
    /// # Errors
    /// A source that cannot be read or is wrong, named with the file and the key or prim.
    pub fn settings(&self, folder: Option<&Path>) -> Result<Layered> {
        let near = || folder.filter(|_| self.look_beside).and_then(beside);
        let file = self.file.clone().or_else(near);
        let file = file.as_deref().map(read_settings_file).transpose()?;
        let (file, named) = file.map_or_else(Default::default, |SettingsFile { settings, usd }| (settings, usd));
        let stage = self.usd.as_ref().or(named.as_ref()).map(read_apart).transpose()?.unwrap_or_default();
        Ok(self.given.clone().over(file.over(stage)))
    }

    fn inputs(&self) -> Result<Vec<PathBuf>> {
        if !self.inputs.is_empty() {
            return Ok(self.inputs.clone());
        }
        let reason =
            "is missing: name the frames, or a stage or settings file that names them (set usd to FILE, set settings to FILE)";
        let missing = || Error::BadInput { input: "inputs".into(), reason: reason.into() };
        Ok(vec![self.settings(None)?.values.input.ok_or_else(missing)?])
    }
}
