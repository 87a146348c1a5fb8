//! What the operating system says about a folder, where it says anything: that a path may have changed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

use notify_debouncer_full::notify::event::{AccessKind, AccessMode, CreateKind, EventKind, ModifyKind, RemoveKind};
use notify_debouncer_full::notify::{self, Config, RecommendedWatcher, RecursiveMode};
use notify_debouncer_full::{DebounceEventResult, DebouncedEvent, Debouncer, NoCache, new_debouncer_opt};

use crate::io::sequence::is_exr;

/// Events on one path are put together for this long.
const DEBOUNCE: Duration = Duration::from_millis(100);

/// What may have changed; bounded by the names in the folder.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Changes {
    /// EXR files, and whether their writer has closed them.
    pub files: BTreeMap<PathBuf, bool>,
    /// Folders to scan.
    pub folders: BTreeSet<PathBuf>,
    /// Events were lost: scan everything.
    pub all: bool,
}

type Shared = Arc<(Mutex<Changes>, Condvar)>;

/// The watch on a folder.
pub(super) struct FolderEvents {
    shared: Shared,
    debouncer: Option<Debouncer<RecommendedWatcher, NoCache>>,
}

impl FolderEvents {
    /// Of no folder.
    pub fn off() -> Self {
        Self { shared: Shared::default(), debouncer: None }
    }

    /// Watches a folder and everything below it.
    ///
    /// # Errors
    /// What to tell the user: the system refuses, such as for too many watches. The folder must then be scanned.
    pub fn start(&mut self, folder: &Path) -> Result<(), String> {
        let shared = self.shared.clone();
        let watch = || {
            let handler = move |result: DebounceEventResult| take(&shared, result);
            let mut debouncer =
                new_debouncer_opt::<_, RecommendedWatcher, _>(DEBOUNCE, None, handler, NoCache, Config::default())?;
            debouncer.watch(folder, RecursiveMode::Recursive)?;
            Ok(debouncer)
        };
        self.debouncer = None;
        self.debouncer = Some(watch().map_err(|e| refusal(folder, &e))?);
        Ok(())
    }

    /// Stops watching.
    pub fn stop(&mut self) {
        self.debouncer = None;
    }

    /// Whether a folder is watched.
    pub fn are_on(&self) -> bool {
        self.debouncer.is_some()
    }

    /// The changes since the last call; waits for some up to `timeout`.
    pub fn changes(&self, timeout: Duration) -> Changes {
        let (changes, bell) = &*self.shared;
        let nothing = |changes: &mut Changes| *changes == Changes::default();
        let guard = changes.lock().unwrap_or_else(PoisonError::into_inner);
        let (mut guard, _) = bell.wait_timeout_while(guard, timeout, nothing).unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut guard)
    }
}

/// Why the system refuses, with what to do.
fn refusal(folder: &Path, error: &notify::Error) -> String {
    let full = "the limit of watched folders is reached (sysctl fs.inotify.max_user_watches, fs.inotify.max_user_instances)";
    let reason = match &error.kind {
        notify::ErrorKind::MaxFilesWatch => full.to_string(),
        notify::ErrorKind::Io(e) if is_at_the_limit(e) => full.to_string(),
        _ => error.to_string(),
    };
    format!("{}: {reason}: the folder is scanned every few seconds instead", folder.display())
}

#[cfg(unix)]
fn is_at_the_limit(error: &std::io::Error) -> bool {
    use rustix::io::Errno;
    matches!(Errno::from_io_error(error), Some(Errno::MFILE | Errno::NOSPC))
}

#[cfg(not(unix))]
fn is_at_the_limit(_: &std::io::Error) -> bool {
    false
}

fn take(shared: &Shared, result: DebounceEventResult) {
    let (changes, bell) = &**shared;
    let mut changes = changes.lock().unwrap_or_else(PoisonError::into_inner);
    match result {
        Ok(events) => events.iter().for_each(|e| changes.add(e)),
        Err(_) => changes.all = true,
    }
    if *changes != Changes::default() {
        bell.notify_all();
    }
}

impl Changes {
    fn add(&mut self, event: &DebouncedEvent) {
        self.all |= event.need_rescan();
        let (closed, folder) = match event.kind {
            EventKind::Access(AccessKind::Close(AccessMode::Write)) => (true, false),
            // Our own reading opens files too.
            EventKind::Access(_) => return,
            EventKind::Modify(ModifyKind::Name(_)) => (true, true),
            EventKind::Modify(ModifyKind::Data(_) | ModifyKind::Metadata(_)) => (false, false),
            EventKind::Create(CreateKind::File) | EventKind::Remove(RemoveKind::File) => (false, false),
            _ => (false, true),
        };
        for path in &event.paths {
            if is_exr(path) {
                *self.files.entry(path.clone()).or_default() |= closed;
            } else if folder {
                // Perhaps none of ours, which a scan of nothing finds out.
                self.folders.insert(path.clone());
            }
        }
    }
}

/// Whether a folder lies on a network file system, which tells nothing about what other machines do.
#[cfg(target_os = "linux")]
pub(super) fn is_remote(folder: &Path) -> bool {
    // NFS, SMB, CIFS, SMB 2, FUSE, Coda, 9P.
    const REMOTE: [u64; 7] = [0x6969, 0x517b, 0xff53_4d42, 0xfe53_4d42, 0x6573_5546, 0x7375_7245, 0x0102_1997];
    rustix::fs::statfs(folder).is_ok_and(|about| REMOTE.contains(&(about.f_type as u64 & 0xffff_ffff)))
}

/// Whether a folder lies on a network file system; not known on this system.
#[cfg(not(target_os = "linux"))]
pub(super) fn is_remote(_: &Path) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    fn event(kind: EventKind, path: &str) -> DebouncedEvent {
        DebouncedEvent::new(notify::Event::new(kind).add_path(path.into()), Instant::now())
    }

    #[test]
    fn our_own_reading_is_no_hint_and_closing_is_remembered() {
        let mut changes = Changes::default();
        changes.add(&event(EventKind::Access(AccessKind::Open(AccessMode::Any)), "/a/f_1.exr"));
        changes.add(&event(EventKind::Access(AccessKind::Close(AccessMode::Read)), "/a/f_1.exr"));
        assert_eq!(changes, Changes::default());
        changes.add(&event(EventKind::Create(CreateKind::File), "/a/f_1.exr"));
        changes.add(&event(EventKind::Access(AccessKind::Close(AccessMode::Write)), "/a/f_1.exr"));
        changes.add(&event(EventKind::Modify(ModifyKind::Any), "/a/f_1.exr"));
        changes.add(&event(EventKind::Create(CreateKind::Folder), "/a/b"));
        assert_eq!(changes.files, BTreeMap::from([("/a/f_1.exr".into(), true)]));
        assert_eq!(changes.folders, BTreeSet::from(["/a/b".into()]));
    }

    #[test]
    fn a_refusal_tells_what_is_done_instead() {
        let full = notify::Error::new(notify::ErrorKind::MaxFilesWatch);
        #[cfg(unix)]
        let others = [notify::Error::io(rustix::io::Errno::MFILE.into())];
        #[cfg(not(unix))]
        let others = [];
        for error in [full].into_iter().chain(others) {
            let text = refusal(Path::new("/shot"), &error);
            assert!(text.contains("/shot") && text.contains("max_user_watches") && text.contains("scanned"), "{text}");
        }
        assert!(FolderEvents::off().start(Path::new("/not/there")).unwrap_err().contains("/not/there"));
    }

    #[test]
    fn what_is_written_below_the_folder_is_seen() {
        let dir = tempfile::tempdir().unwrap();
        let mut events = FolderEvents::off();
        events.start(dir.path()).unwrap();
        let file = dir.path().join("f_1.exr");
        std::fs::write(&file, b"x").unwrap();
        let mut seen = false;
        for _ in 0..50 {
            // Only Linux tells that a writer has closed its file.
            seen |= events
                .changes(Duration::from_millis(100))
                .files
                .get(&file)
                .is_some_and(|closed| *closed || !cfg!(target_os = "linux"));
            if seen {
                break;
            }
        }
        assert!(seen);
        std::fs::read(&file).unwrap();
        std::thread::sleep(Duration::from_millis(400));
        assert_eq!(events.changes(Duration::ZERO), Changes::default(), "reading is no hint");
    }
}
