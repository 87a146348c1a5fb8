//! What tells one state of a file from another: size and date, and where the date differs, the content.

use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3Default;

use crate::error::{Error, Result};
use crate::io::{Layout, is_complete, read_layout};

/// Size and date of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    /// Bytes.
    pub size: u64,
    /// Time of the last change, milliseconds since 1970.
    pub modified: u64,
}

impl Stamp {
    /// The stamp of a file; None where there is none.
    pub fn of(path: &Path) -> Option<Self> {
        let meta = std::fs::metadata(path).ok()?;
        let age = meta.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
        Some(Self { size: meta.len(), modified: age.map_or(0, |d| d.as_millis() as u64) })
    }
}

/// XXH3 of a file's bytes (64 bits, written as 16 hexadecimal digits): tells files apart, guards against nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Content(u64);

impl From<Content> for String {
    fn from(content: Content) -> Self {
        format!("{:016x}", content.0)
    }
}

impl TryFrom<String> for Content {
    type Error = std::num::ParseIntError;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        u64::from_str_radix(&text, 16).map(Self)
    }
}

impl Content {
    /// Reads a file for its content.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn of(path: &Path) -> Result<Self> {
        let mut file = File::open(path).map_err(|e| Error::io(path, e))?;
        let mut hasher = Xxh3Default::new();
        let mut buffer = vec![0; 1 << 20];
        loop {
            match file.read(&mut buffer).map_err(|e| Error::io(path, e))? {
                0 => return Ok(Self(hasher.digest())),
                count => hasher.update(&buffer[..count]),
            }
        }
    }
}

/// One state of a file. The same stamp is the same file; with another date the content decides, so that a copy of a folder, or a
/// file that was only touched, counts as unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileState {
    /// Size and date.
    #[serde(flatten)]
    pub stamp: Stamp,
    /// None where it was not read whole, or changed meanwhile.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub content: Option<Content>,
}

impl FileState {
    /// The state of a file with its content, which is read; None where there is no such file.
    pub fn read(path: &Path) -> Option<Self> {
        let stamp = Stamp::of(path)?;
        let content = Content::of(path).ok().filter(|_| Stamp::of(path) == Some(stamp));
        Some(Self { stamp, content })
    }
}

impl From<Stamp> for FileState {
    fn from(stamp: Stamp) -> Self {
        Self { stamp, content: None }
    }
}

/// What earlier looks at files found, so that one more look at a file that did not change costs a `stat`.
#[derive(Debug, Default)]
pub(super) struct FileMemory {
    known: HashMap<PathBuf, Known>,
}

#[derive(Debug)]
struct Known {
    stamp: Stamp,
    layout: Option<Arc<Layout>>,
    complete: Option<bool>,
    content: Option<Content>,
}

impl FileMemory {
    /// A file's header.
    ///
    /// # Errors
    /// As [`read_layout`].
    pub fn layout(&mut self, path: &Path) -> Result<Arc<Layout>> {
        let Some(known) = self.known(path) else { return read_layout(path).map(Arc::new) };
        if let Some(layout) = &known.layout {
            return Ok(layout.clone());
        }
        let layout = Arc::new(read_layout(path)?);
        known.layout = Some(layout.clone());
        Ok(layout)
    }

    /// Whether a file is there with all its chunks.
    pub fn is_complete(&mut self, path: &Path) -> bool {
        let Some(known) = self.known(path) else { return false };
        *known.complete.get_or_insert_with(|| is_complete(path).is_ok())
    }

    /// Whether a file is as it was `then`; None is no file.
    pub fn is_same(&mut self, path: Option<&Path>, then: Option<FileState>) -> bool {
        let known = path.and_then(|path| Some((path, self.known(path)?)));
        let ((path, known), then) = match (known, then) {
            (None, None) => return true,
            (Some(known), Some(then)) => (known, then),
            _ => return false,
        };
        if known.stamp == then.stamp {
            return true;
        }
        if known.stamp.size != then.stamp.size || then.content.is_none() {
            return false;
        }
        if known.content.is_none() {
            known.content = Content::of(path).ok();
        }
        known.content == then.content
    }

    /// What is known of a file as it is now; None where there is none.
    fn known(&mut self, path: &Path) -> Option<&mut Known> {
        let Some(stamp) = Stamp::of(path) else {
            self.known.remove(path);
            return None;
        };
        let fresh = || Known { stamp, layout: None, complete: None, content: None };
        let known = self.known.entry(path.to_path_buf()).or_insert_with(fresh);
        if known.stamp != stamp {
            *known = fresh();
        }
        Some(known)
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, SystemTime};

    use super::*;

    fn touch(path: &Path, seconds: u64) {
        let file = File::options().write(true).open(path).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(seconds)).unwrap();
    }

    #[test]
    fn a_copy_is_the_same_file_and_a_change_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        std::fs::write(&path, b"noise").unwrap();
        let then = FileState::read(&path);
        let mut files = FileMemory::default();
        let mut same = |path: &Path| files.is_same(Some(path), then);
        assert!(same(&path));
        touch(&path, 100);
        assert!(same(&path), "only the date changed");
        std::fs::write(&path, b"noisy").unwrap();
        touch(&path, 50);
        assert!(!same(&path), "as long, with other bytes");
        std::fs::write(&path, b"noise!").unwrap();
        assert!(!same(&path));
        assert!(!same(&dir.path().join("none")));
        assert!(files.is_same(Some(&dir.path().join("none")), None) && files.is_same(None, None));
        assert!(!files.is_same(Some(&path), None));
        let undated = then.map(|t| FileState { content: None, ..t });
        std::fs::write(&path, b"noise").unwrap();
        touch(&path, 100);
        assert!(!files.is_same(Some(&path), undated), "without its content the date decides");
    }

    #[test]
    fn manifests_hold_the_content_as_text() {
        let state = FileState { stamp: Stamp { size: 7, modified: 9 }, content: Some(Content(0xab)) };
        let json = serde_json::to_string(&state).unwrap();
        assert_eq!(json, r#"{"size":7,"modified":9,"content":"00000000000000ab"}"#);
        assert_eq!(serde_json::from_str::<FileState>(&json).unwrap(), state);
        let before = serde_json::from_str::<FileState>(r#"{"size":7,"modified":9}"#).unwrap();
        assert_eq!(before, FileState { content: None, ..state });
        assert!(serde_json::from_str::<FileState>(r#"{"size":7,"modified":9,"content":"none"}"#).is_err());
    }
}
