//! What tells one state of a file from another: size and date, and where these do not tell, the content.

use std::collections::HashMap;
use std::fs::{File, Metadata};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

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
        std::fs::metadata(path).ok().map(|meta| Self::from(&meta))
    }
}

impl From<&Metadata> for Stamp {
    fn from(meta: &Metadata) -> Self {
        Self { size: meta.len(), modified: meta.modified().map_or(0, milliseconds) }
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

/// One state of a file. With another date the content decides, so that a copy of a folder, or a file that was only touched, counts
/// as unchanged; so it does where the date is the same and the system says that the file was written to or replaced, as by `rsync -a`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileState {
    /// Size and date.
    #[serde(flatten)]
    pub stamp: Stamp,
    /// When the file or what the system notes about it last changed (`ctime`), milliseconds since 1970; None where the system does
    /// not tell. Another one is a reason to look at the content, no more: a new name or new permissions change it too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub changed: Option<u64>,
    /// It changed right before this was noted, on a file system whose dates are whole seconds: one more change may not show in them.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub fresh: bool,
    /// None where it was not read whole, or changed meanwhile.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub content: Option<Content>,
}

impl FileState {
    /// The state of a file without its content; None where there is no such file.
    pub fn of(path: &Path) -> Option<Self> {
        let meta = std::fs::metadata(path).ok()?;
        let (stamp, changed) = (Stamp::from(&meta), changed(&meta));
        Some(Self { stamp, changed, fresh: is_fresh(stamp.modified, changed, milliseconds(SystemTime::now())), content: None })
    }

    /// The state of a file with its content, which is read; None where there is no such file.
    pub fn read(path: &Path) -> Option<Self> {
        let state = Self::of(path)?;
        let content = Content::of(path).ok().filter(|_| Self::of(path).is_some_and(|after| after.is_untouched_since(&state)));
        Some(Self { content, ..state })
    }

    /// Whether nothing that the system tells about the file differs.
    pub(super) fn is_untouched_since(&self, then: &Self) -> bool {
        (self.stamp, self.changed) == (then.stamp, then.changed)
    }

    /// Whether the file may have other content now, though it has the same size and date.
    fn may_differ(&self, now: &Self) -> bool {
        self.fresh || self.changed.zip(now.changed).is_some_and(|(then, now)| then != now)
    }
}

/// Milliseconds since 1970.
fn milliseconds(time: SystemTime) -> u64 {
    time.duration_since(UNIX_EPOCH).map_or(0, |age| age.as_millis() as u64)
}

#[cfg(unix)]
fn changed(meta: &Metadata) -> Option<u64> {
    use std::os::unix::fs::MetadataExt;
    u64::try_from(i128::from(meta.ctime()) * 1000 + i128::from(meta.ctime_nsec()) / 1_000_000).ok()
}

#[cfg(not(unix))]
fn changed(_: &Metadata) -> Option<u64> {
    None
}

/// Whether dates of whole seconds, or of two as on FAT, may hide one more change.
fn is_fresh(modified: u64, changed: Option<u64>, now: u64) -> bool {
    let dates = [Some(modified), changed];
    dates.iter().flatten().all(|date| date % 1000 == 0) && dates.iter().flatten().any(|date| now < date.saturating_add(2000))
}

/// What earlier looks at files found, so that one more look at a file that did not change costs a `stat`.
#[derive(Debug, Default)]
pub(super) struct FileMemory {
    known: HashMap<PathBuf, Known>,
}

#[derive(Debug)]
struct Known {
    /// Without the content, which is known only where it was asked for.
    state: FileState,
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
        let same_date = known.state.stamp == then.stamp;
        if same_date && !then.may_differ(&known.state) {
            return true;
        }
        let Some(content) = then.content else { return same_date };
        if known.state.stamp.size != then.stamp.size {
            return false;
        }
        if known.content.is_none() {
            known.content = Content::of(path).ok();
        }
        known.content.map_or(same_date, |now| now == content)
    }

    /// What is known of a file as it is now; None where there is none.
    fn known(&mut self, path: &Path) -> Option<&mut Known> {
        let Some(state) = FileState::of(path) else {
            self.known.remove(path);
            return None;
        };
        let fresh = || Known { state, layout: None, complete: None, content: None };
        let known = self.known.entry(path.to_path_buf()).or_insert_with(fresh);
        if known.state.fresh || !state.is_untouched_since(&known.state) {
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
    fn other_content_of_the_same_size_and_date_is_seen() {
        let dir = tempfile::tempdir().unwrap();
        let (path, aside) = (dir.path().join("a.exr"), dir.path().join("b.exr"));
        let date = SystemTime::now() - Duration::from_secs(1000);
        let mut last = None;
        let mut write = |path: &Path, text: &str| {
            // The system's own dates are some milliseconds apart, more where it is busy.
            for _ in 0..1000 {
                std::fs::write(path, text).unwrap();
                File::options().write(true).open(path).unwrap().set_modified(date).unwrap();
                let made = changed(&path.metadata().unwrap());
                std::thread::sleep(Duration::from_millis(5));
                if last.is_none() || made != last {
                    last = made;
                    return;
                }
            }
            panic!("the system's clock stands still");
        };
        write(&path, "noise");
        let then = FileState::read(&path);
        let mut files = FileMemory::default();
        assert!(files.is_same(Some(&path), then));
        // As `rsync -a` replaces a file and `cp -p` writes over one.
        for replace in [true, false] {
            write(if replace { &aside } else { &path }, "noisy");
            if replace {
                std::fs::rename(&aside, &path).unwrap();
            }
            assert_eq!(Stamp::of(&path), then.map(|then| then.stamp));
            for files in [&mut files, &mut FileMemory::default()] {
                assert_eq!(files.is_same(Some(&path), then), cfg!(not(unix)), "replaced: {replace}");
            }
            write(&path, "noise");
            assert!(files.is_same(Some(&path), then), "another time of change alone is no change");
        }
        let unread = then.map(|then| FileState { content: None, ..then });
        assert!(files.is_same(Some(&path), unread), "without its content the date decides");
        write(&path, "noisy");
        let before = then.map(|then| FileState { changed: None, ..then });
        assert!(FileMemory::default().is_same(Some(&path), before), "manifests of before know size and date alone");
        let fresh = then.map(|then| FileState { changed: None, fresh: true, ..then });
        assert!(!FileMemory::default().is_same(Some(&path), fresh));
    }

    #[test]
    fn only_coarse_dates_hide_a_change_and_only_at_first() {
        assert!(is_fresh(5000, None, 6999) && is_fresh(5000, Some(8000), 9000) && is_fresh(5000, Some(5000), 1000));
        assert!(!is_fresh(5000, None, 7000) && !is_fresh(5000, Some(5000), 7000));
        assert!(!is_fresh(5001, None, 5001) && !is_fresh(5000, Some(5001), 5001));
    }

    #[test]
    fn manifests_hold_the_content_as_text() {
        let state =
            FileState { stamp: Stamp { size: 7, modified: 9 }, changed: None, fresh: false, content: Some(Content(0xab)) };
        let json = serde_json::to_string(&state).unwrap();
        assert_eq!(json, r#"{"size":7,"modified":9,"content":"00000000000000ab"}"#);
        assert_eq!(serde_json::from_str::<FileState>(&json).unwrap(), state);
        let before = serde_json::from_str::<FileState>(r#"{"size":7,"modified":9}"#).unwrap();
        assert_eq!(before, FileState { content: None, ..state });
        assert!(serde_json::from_str::<FileState>(r#"{"size":7,"modified":9,"content":"none"}"#).is_err());
        let more = FileState { changed: Some(11), fresh: true, ..before };
        let json = serde_json::to_string(&more).unwrap();
        assert_eq!(json, r#"{"size":7,"modified":9,"changed":11,"fresh":true}"#);
        assert_eq!(serde_json::from_str::<FileState>(&json).unwrap(), more);
    }
}
