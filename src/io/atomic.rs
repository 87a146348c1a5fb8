//! Files that appear whole or not at all.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::error::{Error, Result};

/// Writes `destination` aside (`.NAME.hush-PID.part` in the same folder), flushes it to disk and renames it into place; an
/// existing file is replaced. On an error, or a panic, nothing is left behind and `destination` is as it was.
pub fn write_atomically(destination: &Path, write: impl FnOnce(&mut BufWriter<File>) -> Result<()>) -> Result<()> {
    let part = part_path(destination)?;
    let file = File::create(&part).map_err(|e| Error::io(destination, e))?;
    let guard = RemoveOnDrop(Some(&part));
    let mut writer = BufWriter::with_capacity(1 << 20, file);
    write(&mut writer)?;
    writer.flush().map_err(|e| Error::io(destination, e))?;
    writer.get_ref().sync_all().map_err(|e| Error::io(destination, e))?;
    drop(writer);
    patiently(|| fs::rename(&part, destination)).map_err(|e| Error::io(destination, in_use(destination, e)))?;
    guard.keep();
    sync_folder(destination);
    Ok(())
}

/// Whether a file name is that of a write that has not finished (or was cut off).
pub fn is_part_file(path: &Path) -> bool {
    path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.starts_with('.') && n.contains(".hush-") && n.ends_with(".part"))
}

fn part_path(destination: &Path) -> Result<PathBuf> {
    let name = destination
        .file_name()
        .ok_or_else(|| Error::BadInput { input: destination.display().to_string(), reason: "is not a file name".into() })?;
    let mut part = OsString::from(".");
    part.push(name);
    part.push(format!(".hush-{}.part", std::process::id()));
    Ok(destination.with_file_name(part))
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

/// Makes the rename itself durable; file systems that cannot sync folders lose nothing by it.
fn sync_folder(destination: &Path) {
    if cfg!(unix) {
        let folder = destination.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if let Ok(folder) = File::open(folder) {
            let _ = folder.sync_all();
        }
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
    fn errors_and_panics_leave_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        assert!(write_atomically(&path, |_| Err(Error::Cancelled)).is_err());
        let panicked = std::panic::catch_unwind(|| write_atomically(&path, |_| panic!("on purpose")));
        assert!(panicked.is_err());
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn a_missing_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(write_atomically(&folder.path().join("no/a.exr"), |_| Ok(())).is_err());
        assert!(write_atomically(Path::new("/"), |_| Ok(())).is_err());
    }
}
