//! Names that differ in letter case alone, which Windows and macOS take for one.

use std::path::{Path, PathBuf};

use super::numbering::NumberPattern;
use super::same_file::is_same_file;
use super::sequence::file_name;

/// Whether the file system has a file under its name in another letter case too.
pub(crate) fn ignores_case(file: &Path) -> bool {
    let Some(name) = file_name(file) else { return false };
    let others = [name.to_ascii_uppercase(), name.to_ascii_lowercase()];
    others.iter().find(|other| **other != name).is_some_and(|other| is_same_file(file, &file.with_file_name(other)))
}

/// What stands before and behind the number of a file that a pattern names, with the number and its digits; in another letter case where
/// the file system takes that for the same.
pub(crate) fn numbered_by(pattern: &NumberPattern, file: &Path) -> Option<(String, i64, usize, String)> {
    let name = file_name(file)?;
    let (before, number, digits, behind) = pattern.number_in_any_case(&name)?;
    ((before, behind) == (&pattern.prefix, &pattern.suffix) || ignores_case(file))
        .then(|| (before.into(), number, digits, behind.into()))
}

/// A file under the name that its folder has for it, of those in `beside`: named in another letter case, or short as in old Windows, it would
/// be another one to whom goes by names.
pub(super) fn spelled(file: PathBuf, beside: impl FnOnce() -> Vec<PathBuf>) -> PathBuf {
    if file.canonicalize().is_ok_and(|real| real.file_name() == file.file_name()) {
        return file;
    }
    let beside = beside();
    if beside.iter().any(|other| other.file_name() == file.file_name()) {
        return file;
    }
    let same = beside.iter().find(|other| is_same_file(other, &file));
    same.and_then(|same| same.file_name()).map_or(file.clone(), |name| file.with_file_name(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_file_has_the_name_of_its_folder() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::write(at("Frame_0001.exr"), b"").unwrap();
        // Stands for the other letter case that this file system may not take.
        std::fs::hard_link(at("Frame_0001.exr"), at("FRAME_0001.EXR")).unwrap_or_default();
        let pattern = NumberPattern::parse("frame_####.EXR").unwrap().unwrap();
        let found = Some(("Frame_".into(), 1, 4, ".exr".into()));
        assert!(ignores_case(&at("Frame_0001.exr")) && numbered_by(&pattern, &at("Frame_0001.exr")) == found);
        assert_eq!(spelled(at("Frame_0001.exr"), || panic!("it is the folder's own")), at("Frame_0001.exr"));
        std::fs::write(at("a_0001.exr"), b"").unwrap();
        let pattern = NumberPattern::parse("A_####.exr").unwrap().unwrap();
        assert_eq!(numbered_by(&pattern, &at("a_0001.exr")).is_some(), at("A_0001.exr").exists());
    }

    #[cfg(unix)]
    #[test]
    fn a_name_that_the_folder_does_not_list_becomes_one_that_it_does() {
        let dir = tempfile::tempdir().unwrap();
        let (listed, link) = (dir.path().join("Frame_0001.exr"), dir.path().join("FRAME~1.EXR"));
        std::fs::write(&listed, b"").unwrap();
        std::os::unix::fs::symlink(&listed, &link).unwrap();
        assert_eq!(spelled(link.clone(), || vec![listed.clone()]), listed);
        assert_eq!(spelled(link.clone(), || vec![listed.clone(), link.clone()]), link, "a link of that name");
        assert_eq!(spelled(link.clone(), Vec::new), link);
    }
}
