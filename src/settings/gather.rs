//! The settings of a shot from all sources together.

use std::path::{Path, PathBuf};

use super::layered::{Layered, Origin};
use super::side_file::{SideFile, beside, read_side_file};
use super::usd::{self, StageRef};
use super::{KEYS, ShotSettings};
use crate::error::Result;

/// How to read a stage.
type Read<'a> = &'a dyn Fn(&StageRef) -> Result<Layered>;

/// Where settings are looked for besides what is given directly.
#[derive(Clone)]
pub struct Sources<'a> {
    /// A stage; in place of the one that the side file names.
    pub usd: Option<StageRef>,
    /// A side file; in place of the one beside the frames.
    pub file: Option<PathBuf>,
    /// Whether to look for a side file beside the frames.
    pub look_beside: bool,
    /// How a stage is read, such as in a process of its own.
    pub read_usd: Read<'a>,
}

impl Default for Sources<'_> {
    /// The side file beside the frames and the stage that it names, which is read in this process.
    fn default() -> Self {
        Self { usd: None, file: None, look_beside: true, read_usd: &usd::read }
    }
}

/// The settings for the frames in `folder` (None: not known yet): the stage's, over them the side file's, over them `given`,
/// which counts as the command line.
///
/// # Errors
/// A source that cannot be read or is wrong, named with the file and the key or prim; two side files in the folder.
pub fn gather(folder: Option<&Path>, sources: &Sources<'_>, given: ShotSettings) -> Result<Layered> {
    let found = match (&sources.file, folder) {
        (None, Some(folder)) if sources.look_beside => beside(folder)?,
        (file, _) => file.clone(),
    };
    let file = found.as_deref().map(read_side_file).transpose()?;
    let (file, named) = file.map_or_else(Default::default, |SideFile { settings, usd }| (settings, usd));
    let stage = sources.usd.as_ref().or(named.as_ref());
    let stage = stage.map(sources.read_usd).transpose()?.unwrap_or_default();
    let option = |name: &str| KEYS.iter().find(|k| k.name == name).map_or(name, |k| k.option).to_owned();
    let given = Layered::new(given, |name| Origin::CommandLine { option: option(name) });
    Ok(given.over(file.over(stage)))
}
