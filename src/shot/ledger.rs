//! A folder's manifest as it was last read or written; the file is read again only where another process changed it.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::manifest::{DAMAGED, MANIFEST, Manifest};
use crate::error::{Error, Result};
use crate::io::{FileId, FileLock, file_id, write_atomically};

/// The manifest of one output folder.
#[derive(Debug, Default)]
pub struct Ledger {
    folder: PathBuf,
    manifest: Manifest,
    /// The file that `manifest` is the content of; none where there was no file or it is not known.
    mark: Option<Mark>,
}

/// Tells one state of the file from the next: each is a file of its own, renamed into place.
#[derive(Debug, PartialEq)]
struct Mark {
    bytes: u64,
    modified: Option<SystemTime>,
    id: Option<FileId>,
}

impl Ledger {
    /// For an output folder; nothing is read yet.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into(), ..Self::default() }
    }

    /// What the manifest says now; an empty one where there is none.
    ///
    /// # Errors
    /// As [`Manifest::load`].
    pub fn read(&mut self) -> Result<&Manifest> {
        let mark = Mark::of(&self.path());
        if mark.is_none() || mark != self.mark {
            self.mark = None;
            self.manifest = Manifest::default();
            self.manifest = Manifest::load(&self.folder)?;
            self.mark = mark;
        }
        Ok(&self.manifest)
    }

    /// Adds frames and their settings to the manifest, keeping what other processes put there in the meantime. A damaged file is put
    /// aside as `hush-manifest.json.damaged` first.
    ///
    /// # Errors
    /// The file cannot be read or written, or is of a later version; then it stays as it is.
    pub fn merge(&mut self, ours: &Manifest) -> Result<()> {
        // Several processes may share the folder, each with its own frames; where locks do not work the last one wins.
        let lock = FileLock::beside(&self.path()).ok();
        match self.read() {
            Err(Error::BadFile { .. }) => self.put_aside()?,
            other => _ = other?,
        }
        self.manifest.settings.extend(ours.settings.clone());
        self.manifest.frames.extend(ours.frames.clone());
        self.manifest.forget_unused_settings();
        let path = self.path();
        self.mark = None;
        let manifest = &self.manifest;
        write_atomically(&path, |to| {
            serde_json::to_writer_pretty(&mut *to, manifest).map_err(|e| Error::io(&path, e.into()))?;
            to.write_all(b"\n").map_err(|e| Error::io(&path, e))
        })?;
        self.mark = Mark::of(&path);
        drop(lock);
        Ok(())
    }

    /// Keeps a damaged manifest for whoever can mend it.
    fn put_aside(&self) -> Result<()> {
        let path = self.path();
        match std::fs::rename(&path, self.folder.join(DAMAGED)) {
            // Where locks do not work another process may have been faster.
            Err(e) if e.kind() != ErrorKind::NotFound => Err(Error::io(path, e)),
            _ => Ok(()),
        }
    }

    fn path(&self) -> PathBuf {
        self.folder.join(MANIFEST)
    }
}

impl Mark {
    fn of(path: &Path) -> Option<Self> {
        let about = std::fs::metadata(path).ok()?;
        Some(Self { bytes: about.len(), modified: about.modified().ok(), id: file_id(path) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shot::{Entry, FrameSettings, Job, Status};

    fn entry(frame: i64) -> (Manifest, FrameSettings) {
        let sequence = crate::io::sequence::Sequence { name: "a".into(), frames: Vec::new(), ignored: Vec::new(), named: None };
        let job = Job::new(sequence, "out");
        let settings = job.frame_settings(2, frame, &job.settings.identity().unwrap()).unwrap();
        let mut manifest = Manifest::default();
        let key = manifest.settings_key(&settings);
        let entry = Entry {
            frame,
            source: "a.exr".into(),
            stamp: None,
            lambda_image: None,
            output: None,
            status: Status::Denoised,
            reason: None,
            settings: key,
            hush: "0".into(),
            neighbours: Vec::new(),
            warnings: Vec::new(),
            left_out: Vec::new(),
            seconds: 0.0,
        };
        manifest.frames.insert(format!("f_{frame}.exr"), entry);
        (manifest, settings)
    }

    #[test]
    fn what_others_add_is_seen_and_kept() {
        let dir = tempfile::tempdir().unwrap();
        let (mut one, mut two) = (Ledger::new(dir.path()), Ledger::new(dir.path()));
        assert!(one.read().unwrap().frames.is_empty());
        one.merge(&entry(1).0).unwrap();
        two.merge(&entry(2).0).unwrap();
        assert_eq!(one.read().unwrap().frames.len(), 2);
        one.merge(&entry(3).0).unwrap();
        assert_eq!(two.read().unwrap().frames.len(), 3);
        assert_eq!(Manifest::load(dir.path()).unwrap().frames.len(), 3);
    }

    #[test]
    fn a_manifest_that_is_gone_or_damaged_is_not_remembered() {
        let dir = tempfile::tempdir().unwrap();
        let mut ledger = Ledger::new(dir.path());
        ledger.merge(&entry(1).0).unwrap();
        std::fs::write(dir.path().join(MANIFEST), b"{ half").unwrap();
        assert!(ledger.read().is_err());
        std::fs::remove_file(dir.path().join(MANIFEST)).unwrap();
        assert!(ledger.read().unwrap().frames.is_empty());
    }
}
