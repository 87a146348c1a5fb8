//! Whether two paths lead to one file or folder, by more than their names.

use std::path::Path;

pub(crate) use file_id::FileId;
use file_id::get_file_id;

/// Whether both paths lead to the same file or folder: through links, under another mount path, in other letter case. False where
/// one of them is not there.
pub(crate) fn is_same_file(a: &Path, b: &Path) -> bool {
    let known = |path: &Path| file_id(path).filter(is_known);
    match known(a).zip(known(b)) {
        Some((a, b)) => a == b,
        None => a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b)),
    }
}

/// What tells a file or folder from another that is put in its place; None where there is none.
pub(crate) fn file_id(path: &Path) -> Option<FileId> {
    get_file_id(path).ok()
}

/// Whether a number is one: some network file systems have 0 for every file.
fn is_known(id: &FileId) -> bool {
    match *id {
        FileId::Inode { inode_number, .. } => inode_number != 0,
        FileId::LowRes { file_index, .. } => file_index != 0,
        FileId::HighRes { file_id, .. } => file_id != 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_do_not_matter() {
        let dir = tempfile::tempdir().unwrap();
        let file = |name: &str| dir.path().join(name);
        std::fs::create_dir(file("sub")).unwrap();
        std::fs::write(file("a"), b"").unwrap();
        std::fs::write(file("b"), b"").unwrap();
        std::fs::hard_link(file("a"), file("sub/c")).unwrap();
        assert!(is_same_file(&file("a"), &file("sub/../a")) && is_same_file(&file("a"), &file("sub/c")));
        assert!(is_same_file(dir.path(), &file("sub/..")) && !is_same_file(dir.path(), &file("sub")));
        assert!(!is_same_file(&file("a"), &file("b")) && !is_same_file(&file("no"), &file("no")));
    }
}
