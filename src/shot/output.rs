//! The output folder: never the inputs' own, never foreign files, no leftovers.

use std::fs;
use std::path::{Component, Path, PathBuf};
use std::time::{Duration, SystemTime};

use super::job::Job;
use crate::error::{Error, Result};
use crate::io::is_part_file;

/// Where a frame of the job goes: the output folder, the input's name.
pub(super) fn output_path(job: &Job, source: &Path) -> PathBuf {
    job.output.join(source.file_name().unwrap_or(source.as_os_str()))
}

/// Refuses an output folder that would write over the inputs, or that is no folder.
pub(super) fn check_output(job: &Job) -> Result<()> {
    let bad = |reason: String| Err(Error::BadInput { input: format!("output {}", job.output.display()), reason });
    if job.output.as_os_str().is_empty() {
        return bad("no folder is named".into());
    }
    if job.output.exists() && !job.output.is_dir() {
        return bad("is a file: name a folder".into());
    }
    let folder = real_folder(&job.output);
    for frame in &job.sequence.frames {
        let own_folder = frame.path.parent().map(real_folder);
        // Through a link an input may lie elsewhere than its name says.
        let real = fs::canonicalize(&frame.path).unwrap_or_else(|_| frame.path.clone());
        let target = folder.join(frame.path.file_name().unwrap_or_default());
        if own_folder.as_deref() == Some(folder.as_path()) || real == target {
            let advice = "choose another folder, such as a new one inside it";
            return bad(format!("is where the input {} lies, which would be overwritten: {advice}", frame.path.display()));
        }
    }
    Ok(())
}

/// The real path of a folder that may not exist yet.
pub(crate) fn real_folder(folder: &Path) -> PathBuf {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.into());
    for ancestor in absolute.ancestors() {
        let (Ok(mut real), Ok(rest)) = (fs::canonicalize(ancestor), absolute.strip_prefix(ancestor)) else { continue };
        // What is not there yet holds no links, so its dots mean what they say.
        for component in rest.components() {
            match component {
                Component::ParentDir => _ = real.pop(),
                Component::Normal(name) => real.push(name),
                _ => {}
            }
        }
        return real;
    }
    absolute
}

/// Creates the folder and clears what a killed run left in it.
pub(super) fn prepare_folder(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    // A file still being written changes all the time; another process may be at work in the same folder.
    let stale = |age: Duration| age > Duration::from_secs(60);
    remove_parts(folder, |path| {
        let modified = fs::metadata(path).and_then(|m| m.modified()).ok();
        modified.and_then(|t| SystemTime::now().duration_since(t).ok()).is_some_and(stale)
    });
    Ok(())
}

/// Removes the files that this process has not finished writing; for use right before the process ends.
pub fn remove_unfinished(folder: &Path) {
    let own = format!(".hush-{}.part", std::process::id());
    remove_parts(folder, |path| path.to_string_lossy().ends_with(&own));
}

fn remove_parts(folder: &Path, which: impl Fn(&Path) -> bool) {
    for path in fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()) {
        if is_part_file(&path) && which(&path) {
            let _ = fs::remove_file(&path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::sequence::Sequence;

    #[test]
    fn the_input_folder_is_refused_under_any_name() {
        let dir = tempfile::tempdir().unwrap();
        let shot = dir.path().join("shot");
        fs::create_dir_all(shot.join("sub")).unwrap();
        fs::write(shot.join("f_1.exr"), b"").unwrap();
        let sequence = Sequence::find(&[&shot]).unwrap();
        let check = |output: PathBuf| check_output(&Job::new(sequence.clone(), output));
        for same in [shot.clone(), shot.join("."), shot.join("sub/.."), shot.join("new").join("..")] {
            assert!(check(same.clone()).is_err(), "{}", same.display());
        }
        for other in [shot.join("sub"), shot.join("new"), dir.path().join("shot2/a/b")] {
            assert!(check(other.clone()).is_ok(), "{}", other.display());
        }
        assert!(check(shot.join("f_1.exr")).is_err());
        assert!(check(PathBuf::new()).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn links_do_not_hide_the_inputs() {
        let dir = tempfile::tempdir().unwrap();
        let (real, links) = (dir.path().join("real"), dir.path().join("links"));
        fs::create_dir_all(&real).unwrap();
        fs::create_dir_all(&links).unwrap();
        fs::write(real.join("f_1.exr"), b"").unwrap();
        std::os::unix::fs::symlink(real.join("f_1.exr"), links.join("f_1.exr")).unwrap();
        std::os::unix::fs::symlink(&real, dir.path().join("alias")).unwrap();
        let sequence = Sequence::find(&[&links]).unwrap();
        assert!(check_output(&Job::new(sequence.clone(), &real)).is_err());
        assert!(check_output(&Job::new(sequence, dir.path().join("alias"))).is_err());
    }

    #[test]
    fn only_old_or_own_leftovers_are_removed() {
        let dir = tempfile::tempdir().unwrap();
        let file = |name: &str| {
            let path = dir.path().join(name);
            fs::write(&path, b"x").unwrap();
            path
        };
        let (old, new) = (file(".a.exr.hush-1.part"), file(".b.exr.hush-2.part"));
        let (own, other) = (file(&format!(".c.exr.hush-{}.part", std::process::id())), file(".d.part"));
        let hour_ago = SystemTime::now() - Duration::from_secs(3600);
        for path in [&old, &other] {
            fs::File::options().write(true).open(path).unwrap().set_modified(hour_ago).unwrap();
        }
        prepare_folder(dir.path()).unwrap();
        assert!(!old.exists() && new.exists() && own.exists() && other.exists());
        remove_unfinished(dir.path());
        assert!(new.exists() && !own.exists());
    }
}
