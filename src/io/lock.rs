//! A lock between processes, of one machine or of several, by a file that is there only while somebody holds or wants it.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// How often a lock is tried for that its holder removed in between.
const ATTEMPTS: usize = 1000;

/// Held until dropped, or until its process ends, however it ends.
#[derive(Debug)]
pub struct FileLock {
    path: PathBuf,
    file: Option<File>,
}

impl FileLock {
    /// Waits for the lock `.NAME.lock` beside the file that it guards.
    ///
    /// A file of its own, because Windows opens no folder and NFS locks only what is open for writing.
    ///
    /// # Errors
    /// The folder cannot be written to, or its file system has no locks.
    pub fn beside(guarded: &Path) -> io::Result<Self> {
        let name = guarded.file_name().unwrap_or_default().to_string_lossy();
        let path = guarded.with_file_name(format!(".{name}.lock"));
        // Where files have no lasting numbers none would ever do.
        for _ in 0..ATTEMPTS {
            let file = open(&path)?;
            file.lock().inspect_err(|_| _ = fs::remove_file(&path))?;
            // The one who held it before has removed the file; who comes next makes a new one.
            if is_at(&file, &path) {
                return Ok(Self { path, file: Some(file) });
            }
        }
        Err(io::Error::other("the file system tells no file from another"))
    }
}

impl Drop for FileLock {
    fn drop(&mut self) {
        if cfg!(windows) {
            // The file of a process that waits for it can't be removed; the last one does.
            self.file = None;
        }
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(unix)]
fn open(path: &Path) -> io::Result<File> {
    File::options().write(true).create(true).truncate(false).open(path)
}

#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let key = |about: io::Result<fs::Metadata>| about.ok().map(|about| (about.dev(), about.ino()));
    key(file.metadata()).is_some_and(|ours| key(fs::metadata(path)) == Some(ours))
}

/// Open for reading and writing by others, and not to be removed meanwhile.
#[cfg(windows)]
fn open(path: &Path) -> io::Result<File> {
    use std::os::windows::fs::OpenOptionsExt;
    const SHARE_READ_WRITE: u32 = 3;
    super::atomic::patiently(|| File::options().write(true).create(true).truncate(false).share_mode(SHARE_READ_WRITE).open(path))
}

#[cfg(windows)]
fn is_at(_: &File, _: &Path) -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn one_at_a_time_and_no_file_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let guarded = folder.path().join("a.json");
        fs::write(&guarded, "0").unwrap();
        let inside = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..50 {
                        let lock = FileLock::beside(&guarded).unwrap();
                        assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0);
                        let count: u32 = fs::read_to_string(&guarded).unwrap().parse().unwrap();
                        fs::write(&guarded, (count + 1).to_string()).unwrap();
                        inside.fetch_sub(1, Ordering::SeqCst);
                        drop(lock);
                    }
                });
            }
        });
        assert_eq!(fs::read_to_string(&guarded).unwrap(), "200");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn no_lock_without_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        assert!(FileLock::beside(&folder.path().join("no/a.json")).is_err());
    }
}
