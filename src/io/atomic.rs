//! Files that appear whole or not at all.

use std::fs::{self, File};
use std::hash::{BuildHasher, RandomState};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

use crate::error::{Error, Result};

/// Writes `destination` aside (`.NAME.hush-TOKEN.part` in the same folder), flushes it to disk and renames it into place; an
/// existing file is replaced. Where somebody else removed what was written aside, it is written once more. On an error, or a panic,
/// nothing is left behind and `destination` is as it was.
pub fn write_atomically(destination: &Path, mut write: impl FnMut(&mut BufWriter<File>) -> Result<()>) -> Result<()> {
    for _ in 0..TRIES {
        if write_once(destination, &mut write)? {
            return Ok(());
        }
    }
    let reason = "another program removed it while it was written";
    Err(Error::io(destination, io::Error::other(reason)))
}

/// How often a file is written where what was written aside is removed.
const TRIES: usize = 2;

/// Whether what was written aside was still there when it was to be renamed.
fn write_once(destination: &Path, write: &mut impl FnMut(&mut BufWriter<File>) -> Result<()>) -> Result<bool> {
    let part = part_path(destination)?;
    let file = File::create_new(&part).map_err(|e| Error::io(destination, folder_gone(destination, e)))?;
    let guard = RemoveOnDrop(Some(&part));
    let mut writer = BufWriter::with_capacity(1 << 20, file);
    write(&mut writer)?;
    writer.flush().map_err(|e| Error::io(destination, e))?;
    writer.get_ref().sync_all().map_err(|e| Error::io(destination, e))?;
    drop(writer);
    match patiently(|| fs::rename(&part, destination)) {
        Ok(()) => guard.keep(),
        Err(e) if e.kind() == io::ErrorKind::NotFound && folder_of(destination).is_dir() => return Ok(false),
        Err(e) => return Err(Error::io(destination, in_use(destination, e))),
    }
    sync_folder(destination);
    Ok(true)
}

/// What the names of this process's unfinished files hold, on whichever machine or in whichever container it runs.
pub fn process_token() -> String {
    static RANDOM: LazyLock<u64> = LazyLock::new(|| RandomState::new().hash_one(SystemTime::now()));
    // A process that was forked has the same random number.
    format!("{:016x}-{}", *RANDOM, std::process::id())
}

/// Whether a file name is that of a write that has not finished (or was cut off).
pub fn is_part_file(path: &Path) -> bool {
    path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.starts_with('.') && n.contains(".hush-") && n.ends_with(".part"))
}

/// The unfinished files in a folder.
pub fn part_files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| is_part_file(path)).collect()
}

/// How the unfinished files of one output begin that the process with this token writes. Of a long name only the end is in it: file
/// systems take 255 bytes, and an output may have all of them.
pub fn part_prefix(name: &str, token: &str) -> String {
    let begin = (name.len().saturating_sub(LONGEST)..=name.len()).find(|at| name.is_char_boundary(*at));
    format!(".{}.hush-{token}-", &name[begin.unwrap_or_default()..])
}

/// Bytes of an output's name in the name of its unfinished file; the rest of that takes up to 70.
const LONGEST: usize = 180;

/// Whether an unfinished file is one of the process with this token.
pub fn is_part_of(path: &Path, token: &str) -> bool {
    path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.contains(&format!(".hush-{token}-")))
}

/// What the clock of a folder's file system says now, which need not be this machine's.
pub fn time_in(folder: &Path) -> io::Result<SystemTime> {
    let mut probe = tempfile::Builder::new().prefix(".clock.hush-").suffix(".part").tempfile_in(folder)?;
    probe.write_all(b"\n")?;
    probe.as_file().sync_all()?;
    probe.as_file().metadata()?.modified()
}

fn part_path(destination: &Path) -> Result<PathBuf> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let name = destination
        .file_name()
        .ok_or_else(|| Error::BadInput { input: destination.display().to_string(), reason: "is not a file name".into() })?;
    let prefix = part_prefix(&name.to_string_lossy(), &process_token());
    Ok(destination.with_file_name(format!("{prefix}{}.part", COUNT.fetch_add(1, Ordering::Relaxed))))
}

/// What Windows says while another program has a file open: access denied, a sharing violation, a lock violation.
const IN_USE: [i32; 3] = [5, 32, 33];

/// Does it again for two seconds where Windows says that another program has the file open, as viewers and virus scanners do.
pub(super) fn patiently<T>(mut action: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    let mut pause = Duration::from_millis(10);
    loop {
        match action() {
            Err(e)
                if cfg!(windows) && e.raw_os_error().is_some_and(|code| IN_USE.contains(&code)) && pause.as_millis() < 1500 =>
            {
                std::thread::sleep(pause);
                pause *= 2;
            }
            done => return done,
        }
    }
}

/// Why a file cannot be replaced, with what to do; Windows says only that access is denied.
fn in_use(path: &Path, error: io::Error) -> io::Error {
    match error.raw_os_error() {
        Some(code) if cfg!(windows) && IN_USE.contains(&code) && path.exists() => {
            let reason = "it cannot be replaced: it is open in another program, or read-only; close it there and run again";
            io::Error::new(error.kind(), reason)
        }
        _ => error,
    }
}

/// The system says only that there is no such file.
fn folder_gone(path: &Path, error: io::Error) -> io::Error {
    match error.kind() {
        io::ErrorKind::NotFound if !folder_of(path).is_dir() => io::Error::new(error.kind(), "its folder is gone"),
        _ => error,
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Makes the rename itself durable; file systems that cannot sync folders lose nothing by it.
fn sync_folder(destination: &Path) {
    if cfg!(unix)
        && let Ok(folder) = File::open(folder_of(destination))
    {
        let _ = folder.sync_all();
    }
}

struct RemoveOnDrop<'a>(Option<&'a Path>);

impl RemoveOnDrop<'_> {
    fn keep(mut self) {
        self.0 = None;
    }
}

impl Drop for RemoveOnDrop<'_> {
    fn drop(&mut self) {
        if let Some(path) = self.0 {
            let _ = fs::remove_file(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn success_leaves_the_file_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        fs::write(&path, b"old").unwrap();
        write_atomically(&path, |w| {
            assert_eq!(fs::read(&path).unwrap(), b"old");
            assert!(names(folder.path()).iter().any(|n| is_part_file(Path::new(n))));
            w.write_all(b"new").map_err(|e| Error::io(&path, e))
        })
        .unwrap();
        assert_eq!(names(folder.path()), ["a.exr"]);
        assert_eq!(fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn a_folder_that_is_gone_is_told_as_such() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_atomically(&folder.path().join("no/a.exr"), |_| Ok(())).unwrap_err().to_string();
        assert!(error.ends_with("a.exr: its folder is gone"), "{error}");
    }

    #[test]
    fn writers_of_one_file_do_not_meet() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let half = |w: &mut BufWriter<File>| w.write_all(b"one").and_then(|()| w.flush()).map_err(|e| Error::io(&path, e));
        write_atomically(&path, |w| {
            half(w)?;
            // Another one, from its beginning to its end.
            write_atomically(&path, |w| w.write_all(b"two").map_err(|e| Error::io(&path, e)))?;
            half(w)
        })
        .unwrap();
        assert_eq!((fs::read(&path).unwrap(), names(folder.path())), (b"oneone".to_vec(), vec!["a.exr".to_owned()]));
    }

    #[test]
    fn what_is_removed_meanwhile_is_written_once_more() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let removed = |times: usize| {
            let mut tries = 0;
            let result = write_atomically(&path, |w| {
                tries += 1;
                w.write_all(b"new").map_err(|e| Error::io(&path, e))?;
                if tries <= times && cfg!(unix) {
                    part_files(folder.path()).iter().for_each(|part| fs::remove_file(part).unwrap());
                }
                Ok(())
            });
            (result, tries)
        };
        assert!(removed(0).0.is_ok());
        // Windows removes no file that is open.
        if cfg!(unix) {
            assert!(matches!(removed(1), (Ok(()), 2)) && fs::read(&path).unwrap() == b"new");
            let (result, tries) = removed(2);
            let Err(Error::Io { source, .. }) = result else { panic!("it was written") };
            assert_eq!((tries, source.kind()), (2, io::ErrorKind::Other));
        }
        assert_eq!(names(folder.path()), ["a.exr"]);
    }

    #[test]
    fn errors_and_panics_leave_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        assert!(write_atomically(&path, |_| Err(Error::Cancelled)).is_err());
        let panicked = std::panic::catch_unwind(|| write_atomically(&path, |_| panic!("on purpose")));
        assert!(panicked.is_err());
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn a_name_may_have_all_the_letters_that_a_file_system_takes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("{}.exr", "ü".repeat(125)));
        write_atomically(&path, |_| {
            part_files(folder.path()).iter().for_each(|part| assert!(is_part_file(part)));
            Ok(())
        })
        .unwrap();
        assert!(path.exists() && part_prefix("0001.exr", "t") == ".0001.exr.hush-t-");
    }

    #[test]
    fn a_missing_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(write_atomically(&folder.path().join("no/a.exr"), |_| Ok(())).is_err());
        assert!(write_atomically(Path::new("/"), |_| Ok(())).is_err());
    }
}
