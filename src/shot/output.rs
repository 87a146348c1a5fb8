//! The output folder: never the inputs' own, never foreign files, no leftovers.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::time::Duration;

use super::job::Job;
use crate::error::{Error, Result};
use crate::io::{is_part_of, is_same_file, part_files, process_token, time_in};

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
    if job.output.is_symlink() && !job.output.exists() {
        return bad("is a link that leads nowhere: name a folder, or make the one that it leads to".into());
    }
    let folder = real_folder(&job.output);
    let mut others: BTreeSet<&Path> = BTreeSet::new();
    for frame in &job.sequence.frames {
        let own = frame.path.parent().filter(|own| !others.contains(own));
        let is_own = own.is_some_and(|own| real_folder(own) == folder || is_same_file(own, &folder));
        others.extend(own);
        // Through a link an input may lie elsewhere than its name says.
        let target = folder.join(frame.path.file_name().unwrap_or_default());
        if is_own || leads_to(&frame.path, &target) {
            let advice = "choose another folder, such as a new one inside it";
            return bad(format!("is where the input {} lies, which would be overwritten: {advice}", frame.path.display()));
        }
    }
    Ok(())
}

/// Whether a file is another, or a link to it, whether or not that is there.
fn leads_to(path: &Path, target: &Path) -> bool {
    fs::canonicalize(path).is_ok_and(|real| real == target) || is_same_file(path, target)
}

/// Whether a folder is another or lies below it, whatever their names say. Neither need be there yet.
pub(crate) fn lies_in(folder: &Path, around: &Path) -> bool {
    let real = real_folder(folder);
    real.starts_with(real_folder(around)) || real.ancestors().any(|ancestor| is_same_file(ancestor, around))
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

/// Unfinished files that have not changed for this long are leftovers. Each frame's takes seconds to write.
const LEFTOVER: Duration = Duration::from_secs(3600);

/// Creates the folder and clears what a killed run left in it.
pub(super) fn prepare_folder(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    let parts = part_files(folder);
    if parts.is_empty() {
        return Ok(());
    }
    // Another machine may be at work in the same folder; the clock that dates its files is asked for the time.
    if let Ok(now) = time_in(folder) {
        let age = |path: &Path| now.duration_since(fs::metadata(path).ok()?.modified().ok()?).ok();
        remove(parts.iter().filter(|path| age(path).is_some_and(|age| age > LEFTOVER)));
    }
    Ok(())
}

/// Removes the files that this process has not finished writing; for use right before the process ends.
pub fn remove_unfinished(folder: &Path) {
    let own = process_token();
    remove(part_files(folder).iter().filter(|path| is_part_of(path, &own)));
}

fn remove<'a>(files: impl Iterator<Item = &'a PathBuf>) {
    files.for_each(|path| _ = fs::remove_file(path));
}

#[cfg(test)]
mod tests {
    use std::time::SystemTime;

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
        assert!(check_output(&Job::new(sequence.clone(), dir.path().join("alias"))).is_err());
        std::os::unix::fs::symlink("nowhere", dir.path().join("dead")).unwrap();
        assert!(check_output(&Job::new(sequence, dir.path().join("dead"))).is_err());
    }

    #[test]
    fn a_file_of_two_names_is_one() {
        let dir = tempfile::tempdir().unwrap();
        let (shot, out) = (dir.path().join("shot"), dir.path().join("out"));
        fs::create_dir_all(&shot).unwrap();
        fs::create_dir_all(&out).unwrap();
        fs::write(shot.join("f_1.exr"), b"").unwrap();
        let job = Job::new(Sequence::find(&[&shot]).unwrap(), &out);
        assert!(check_output(&job).is_ok());
        fs::hard_link(shot.join("f_1.exr"), out.join("f_1.exr")).unwrap();
        assert!(check_output(&job).is_err());
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
        let own = file(&format!(".c.exr.hush-{}-0.part", process_token()));
        // Of the process with the same number on another machine or in another container.
        let (other, twin) = (file(".d.part"), file(&format!(".c.exr.hush-{}.part", std::process::id())));
        let dated = |path: &Path, minutes: u64| {
            let time = SystemTime::now() - Duration::from_secs(60 * minutes);
            fs::File::options().write(true).open(path).unwrap().set_modified(time).unwrap();
        };
        dated(&old, 61);
        dated(&other, 61);
        dated(&new, 55);
        prepare_folder(dir.path()).unwrap();
        assert!(!old.exists() && new.exists() && own.exists() && other.exists());
        remove_unfinished(dir.path());
        assert!(new.exists() && !own.exists() && twin.exists());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 3, "asking for the time leaves nothing");
    }
}
