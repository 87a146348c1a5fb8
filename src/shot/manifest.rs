//! `hush-manifest.json`: what was done to each frame, with what and why; also how a later run knows what to skip.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::dial::DialEntry;
use super::events::Status;
use super::file_state::FileState;
use super::frame_settings::FrameSettings;
use crate::error::{Error, Result};
use crate::rules::skip::LeftOut;
use crate::rules::window::Unused;

/// The manifest's file name in the output folder.
pub const MANIFEST: &str = "hush-manifest.json";
/// What a damaged manifest is renamed to.
pub(super) const DAMAGED: &str = "hush-manifest.json.damaged";
/// The version of the manifest's form; a higher one is not read.
pub const MANIFEST_VERSION: u32 = 1;

/// The whole manifest.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Manifest {
    /// [`MANIFEST_VERSION`].
    pub version: u32,
    /// The settings that frames were made with, by the key that the frames refer to.
    pub settings: BTreeMap<String, FrameSettings>,
    /// By the output's file name.
    pub frames: BTreeMap<String, Entry>,
}

/// What every form of the manifest has.
#[derive(Deserialize)]
struct Version {
    version: u32,
}

/// One output frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Frame number.
    pub frame: i64,
    /// The input file.
    pub source: PathBuf,
    /// The input as it was.
    pub stamp: Option<FileState>,
    /// The image that was the mask of λ, as it was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lambda_image: Option<FileState>,
    /// The output as it was written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output: Option<FileState>,
    /// What the last run did.
    pub status: Status,
    /// Why it failed or was skipped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Key into [`Manifest::settings`].
    pub settings: String,
    /// The version of Hush that made it.
    pub hush: String,
    /// The frames around it that it depends on, without itself.
    pub neighbours: Vec<NeighbourEntry>,
    /// What was odd about this frame.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// What was not computed, for each view.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<LeftOut>,
    /// Time spent computing it.
    pub seconds: f64,
}

/// A frame of the window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NeighbourEntry {
    /// −3…3; −6…6 after a second pass.
    pub offset: i32,
    /// Frame number.
    pub frame: i64,
    /// Whether it helped.
    pub used: bool,
    /// Why not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<Unused>,
    /// Its file as it was; none where there was no file. With its content, a bad one is damaged; without, it could not be read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stamp: Option<FileState>,
    /// The dial of its own first pass, where the second one took its result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dial: Option<DialEntry>,
}

impl NeighbourEntry {
    /// Whether it was left out only because it could not be read then, so that nobody knows what it holds.
    pub(crate) fn is_unknown(&self) -> bool {
        self.reason == Some(Unused::Bad) && self.stamp.is_none_or(|state| state.content.is_none())
    }
}

impl Default for Manifest {
    fn default() -> Self {
        Self { version: MANIFEST_VERSION, settings: BTreeMap::new(), frames: BTreeMap::new() }
    }
}

impl Manifest {
    /// Reads the manifest of an output folder; an empty one where there is none.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be read, [`Error::BadFile`] where it is damaged, [`Error::BadInput`] where a later version
    /// wrote it.
    pub fn load(folder: &Path) -> Result<Self> {
        let path = folder.join(MANIFEST);
        let text = match std::fs::read(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(e) => return Err(Error::io(path, e)),
        };
        let read = serde_json::from_slice::<Self>(&text);
        // A later version may have another form altogether; only a file that is not understood is looked at twice.
        let version = match &read {
            Ok(manifest) => manifest.version,
            Err(_) => serde_json::from_slice::<Version>(&text).map_or(0, |found| found.version),
        };
        if version > MANIFEST_VERSION {
            let reason = "was written by a later version of Hush: use that version, or choose another output folder";
            return Err(Error::BadInput { input: path.display().to_string(), reason: reason.into() });
        }
        read.map_err(|e| Error::bad_file(&path, format!("damaged manifest: {e}")))
    }

    /// Adds the settings and returns their key.
    pub fn settings_key(&mut self, settings: &FrameSettings) -> String {
        let key = settings.key();
        self.settings.entry(key.clone()).or_insert_with(|| settings.clone());
        key
    }

    /// The entry of an output file.
    pub fn entry(&self, output: &Path) -> Option<&Entry> {
        self.frames.get(&key(output))
    }

    /// The entry of an output file, to be changed.
    pub(super) fn entry_mut(&mut self, output: &Path) -> Option<&mut Entry> {
        self.frames.get_mut(&key(output))
    }

    /// Puts in the entry of an output file, in the place of one that is there.
    pub(super) fn insert(&mut self, output: &Path, entry: Entry) {
        self.frames.insert(key(output), entry);
    }

    /// Forgets the settings that no frame was made with.
    pub(super) fn forget_unused_settings(&mut self) {
        let used: BTreeSet<&String> = self.frames.values().map(|e| &e.settings).collect();
        self.settings.retain(|key, _| used.contains(key));
    }
}

/// What an output file's entry is found by: the last name of its path.
fn key(output: &Path) -> String {
    output.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
