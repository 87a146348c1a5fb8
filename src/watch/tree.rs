//! The watched folder: which files are frames of which shot, and where their outputs go.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::io::sequence::is_exr;
use crate::io::{NumberPattern, numbered_by, split_number};
use crate::shot::{MANIFEST, Stamp, lies_in, real_folder};

/// One sequence in one folder.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct ShotKey {
    /// Below the input folder and, mirrored, below the output folder.
    pub folder: PathBuf,
    prefix: String,
    suffix: String,
}

impl ShotKey {
    /// The file name of a frame; `digits` with the sign.
    pub fn file(&self, number: i64, digits: usize) -> String {
        format!("{}{number:0digits$}{}", self.prefix, self.suffix)
    }

    /// The shot's name below the input folder, such as `beauty/frame_####.exr`.
    pub fn name(&self, digits: usize) -> String {
        self.folder.join(self.pattern(digits)).to_string_lossy().into_owned()
    }

    /// The files' common name, such as `frame_####.exr`.
    pub fn pattern(&self, digits: usize) -> String {
        format!("{}{}{}", self.prefix, "#".repeat(digits), self.suffix)
    }
}

/// A frame's file, by its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct FrameFile {
    pub key: Arc<ShotKey>,
    pub number: i64,
    pub digits: usize,
}

impl FrameFile {
    /// The file's name.
    pub fn name(&self) -> String {
        self.key.file(self.number, self.digits)
    }
}

/// What a scan found.
#[derive(Debug, Default)]
pub(super) struct Scan {
    pub frames: Vec<(FrameFile, Stamp)>,
    /// Files and folders left out, with why.
    pub ignored: Vec<(PathBuf, &'static str)>,
}

/// The folders.
pub(super) struct Tree {
    pub input: PathBuf,
    pub output: PathBuf,
    pattern: Option<NumberPattern>,
    /// The output folder's real path.
    real_output: PathBuf,
}

impl Tree {
    /// `input` is a folder, which need not be there yet, or a pattern such as `shot/frame_####.exr`.
    ///
    /// # Errors
    /// The output folder is the input folder or lies around it, or is a file; a pattern with several places.
    pub fn new(input: &Path, output: &Path) -> Result<Self> {
        let bad = |what: &Path, reason: &str| Error::BadInput { input: what.display().to_string(), reason: reason.into() };
        if output.as_os_str().is_empty() || (output.exists() && !output.is_dir()) {
            return Err(bad(output, "is no folder: name one to write to"));
        }
        let name = input.file_name().unwrap_or_default().to_string_lossy();
        let pattern = match input.is_dir() {
            true => None,
            false => NumberPattern::parse(&name).map_err(|reason| bad(input, &reason))?,
        };
        if pattern.is_none() && input.is_file() {
            return Err(bad(input, "is a file: name the folder to watch, or a pattern such as shot/frame_####.exr"));
        }
        let folder = match &pattern {
            Some(_) => input.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")),
            None => input,
        };
        if lies_in(folder, output) {
            let reason = "is the watched folder or lies around it, so that inputs would be overwritten: choose another folder, \
                          such as a new one inside it";
            return Err(bad(output, reason));
        }
        Ok(Self { input: folder.into(), output: output.into(), pattern, real_output: real_folder(output) })
    }

    /// The input file of a frame.
    pub fn source(&self, key: &ShotKey, number: i64, digits: usize) -> PathBuf {
        self.input.join(&key.folder).join(key.file(number, digits))
    }

    /// The output folder of a shot.
    pub fn output(&self, key: &ShotKey) -> PathBuf {
        if key.folder.as_os_str().is_empty() { self.output.clone() } else { self.output.join(&key.folder) }
    }

    /// The frame that a path is, by its name and its folder.
    pub fn frame_of(&self, path: &Path) -> Option<FrameFile> {
        let folder = path.parent()?;
        if self.leaves_out(folder) || folder.join(MANIFEST).exists() {
            return None;
        }
        self.named(path)
    }

    /// The frame that a path is, by its name alone.
    fn named(&self, path: &Path) -> Option<FrameFile> {
        let below = path.strip_prefix(&self.input).ok()?;
        let (folder, name) = (below.parent()?, path.file_name()?.to_str()?);
        if below.iter().any(is_hidden) || !is_exr(path) {
            return None;
        }
        let (prefix, number, digits, suffix) = match &self.pattern {
            Some(pattern) => numbered_by(pattern, path).filter(|_| folder.as_os_str().is_empty())?,
            None => split_number(name)?,
        };
        Some(FrameFile { key: Arc::new(ShotKey { folder: folder.into(), prefix, suffix }), number, digits })
    }

    /// Whether a folder is the output folder or below it, or reached by a link that is not followed.
    fn leaves_out(&self, folder: &Path) -> bool {
        let below = folder.ancestors().take_while(|a| *a != self.input);
        real_folder(folder).starts_with(&self.real_output)
            || below.into_iter().any(|a| a.is_symlink() && self.is_seen_otherwise(a))
    }

    /// Whether what a link leads to is found without it: in the watched folder, or around the link, in a circle.
    fn is_seen_otherwise(&self, link: &Path) -> bool {
        let real = real_folder(link);
        let around = link.ancestors().skip(1).take_while(|a| a.starts_with(&self.input));
        real.starts_with(real_folder(&self.input)) || around.into_iter().any(|a| real_folder(a).starts_with(&real))
    }

    /// Finds the frames in a folder and below it, links followed. Folders that cannot be read are left out, as they may be on their way.
    pub fn scan(&self, from: &Path) -> Scan {
        let mut found = Scan::default();
        let mut folders = BTreeSet::from([from.to_path_buf()]);
        while let Some(folder) = folders.pop_first() {
            if !folder.starts_with(&self.input) || self.leaves_out(&folder) {
                continue;
            }
            let Ok(entries) = fs::read_dir(&folder) else { continue };
            let paths: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
            let own = paths.iter().any(|p| p.file_name() == Some(OsStr::new(MANIFEST)));
            if own {
                found.ignored.push((folder.clone(), "is an output folder of Hush"));
            }
            for path in paths {
                if path.is_dir() && self.pattern.is_none() {
                    if path.file_name().is_some_and(is_hidden) {
                        continue;
                    }
                    match path.is_symlink() && self.is_seen_otherwise(&path) {
                        true => found.ignored.push((path, "is a link to a folder that is watched without it")),
                        false => _ = folders.insert(path),
                    }
                } else if !own && is_exr(&path) {
                    self.take_file(path, &mut found);
                }
            }
        }
        found
    }

    fn take_file(&self, path: PathBuf, found: &mut Scan) {
        if !path.is_file() || path.file_name().is_some_and(is_hidden) {
            return;
        }
        match (self.named(&path), Stamp::of(&path)) {
            (Some(mut frame), Some(stamp)) => {
                // One key for all the frames of a shot: there may be thousands.
                if let Some((last, _)) = found.frames.last().filter(|(last, _)| last.key == frame.key) {
                    frame.key = last.key.clone();
                }
                found.frames.push((frame, stamp));
            }
            (None, Some(_)) if self.pattern.is_none() => {
                let text = path.file_name().is_some_and(|name| name.to_str().is_some());
                found.ignored.push((path, if text { "has no frame number in its name" } else { "has a name that is not UTF-8" }));
            }
            _ => {}
        }
    }
}

fn is_hidden(name: &OsStr) -> bool {
    name.as_encoded_bytes().starts_with(b".")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for name in names {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, b"").unwrap();
        }
        dir
    }

    /// A path with the same separators on every system.
    fn with_slashes(path: &impl std::fmt::Display) -> String {
        path.to_string().replace(std::path::MAIN_SEPARATOR, "/")
    }

    fn names(found: &Scan) -> Vec<String> {
        let mut names: Vec<String> = found
            .frames
            .iter()
            .map(|(p, _)| with_slashes(&p.key.folder.join(p.key.file(p.number, p.digits)).display()))
            .collect();
        names.sort();
        names
    }

    #[test]
    fn shots_are_found_in_subfolders_without_outputs_and_hidden_files() {
        let dir = folder(&[
            "in/f_0001.exr",
            "in/f_0002.EXR",
            "in/.f_0003.exr",
            "in/a/b/s-12.exr",
            "in/.cache/x_1.exr",
            "in/out/f_0001.exr",
            "in/old/f_0001.exr",
            "in/old/hush-manifest.json",
            "in/still.exr",
            "in/f_1.png",
            "in/g_-001.exr",
        ]);
        let tree = Tree::new(&dir.path().join("in"), &dir.path().join("in/out")).unwrap();
        let found = tree.scan(&tree.input);
        assert_eq!(names(&found), ["a/b/s-12.exr", "f_0001.exr", "f_0002.EXR", "g_-001.exr"]);
        let mut ignored: Vec<_> = found.ignored.iter().map(|(p, _)| p.file_name().unwrap().to_str().unwrap()).collect();
        ignored.sort_unstable();
        assert_eq!(ignored, ["old", "still.exr"]);
        assert_eq!(names(&tree.scan(&tree.input.join("a"))), ["a/b/s-12.exr"]);
        assert!(names(&tree.scan(&tree.input.join("out"))).is_empty() && names(&tree.scan(dir.path())).is_empty());
        let frame = tree.frame_of(&dir.path().join("in/a/b/s-12.exr")).unwrap();
        assert_eq!((with_slashes(&frame.key.name(frame.digits)), frame.number), ("a/b/s-##.exr".into(), 12));
        assert_eq!(tree.output(&frame.key), dir.path().join("in/out/a/b"));
    }

    #[cfg(unix)]
    #[test]
    fn links_to_folders_are_followed_where_they_lead_out_and_not_in_circles() {
        use std::os::unix::fs::symlink;
        let dir = folder(&["in/v1/f_0001.exr", "far/g_0001.exr", "far/deep/h_0001.exr", "other/i_0001.exr"]);
        let at = |path: &str| dir.path().join(path);
        symlink("../far", at("in/link")).unwrap();
        symlink("v1", at("in/latest")).unwrap();
        symlink("..", at("far/deep/up")).unwrap();
        symlink(at("other"), at("far/other")).unwrap();
        symlink(at("far"), at("other/back")).unwrap();
        let tree = Tree::new(&at("in"), &at("out")).unwrap();
        let found = tree.scan(&tree.input);
        let four = ["link/deep/h_0001.exr", "link/g_0001.exr", "link/other/i_0001.exr", "v1/f_0001.exr"];
        assert_eq!(names(&found), four);
        let mut ignored: Vec<_> =
            found.ignored.iter().map(|(p, _)| with_slashes(&p.strip_prefix(at("in")).unwrap().display())).collect();
        ignored.sort();
        assert_eq!(ignored, ["latest", "link/deep/up", "link/other/back"]);
        assert!(names(&tree.scan(&at("in/latest"))).is_empty() && tree.frame_of(&at("in/latest/f_0001.exr")).is_none());
        assert_eq!(names(&tree.scan(&at("in/link/deep"))), ["link/deep/h_0001.exr"]);
        assert!(tree.frame_of(&at("in/link/g_0001.exr")).is_some());
    }

    #[test]
    fn a_pattern_picks_one_sequence_of_one_folder() {
        let dir = folder(&["in/f_0001.exr", "in/g_0001.exr", "in/a/f_0001.exr"]);
        let tree = Tree::new(&dir.path().join("in/f_####.exr"), &dir.path().join("out")).unwrap();
        assert_eq!(names(&tree.scan(&tree.input)), ["f_0001.exr"]);
    }

    #[test]
    fn an_output_folder_around_the_input_is_refused() {
        let dir = folder(&["in/f_0001.exr"]);
        let (input, root) = (dir.path().join("in"), dir.path());
        for output in [input.clone(), root.into(), input.join("x/.."), input.join("f_0001.exr")] {
            assert!(Tree::new(&input, &output).is_err(), "{}", output.display());
        }
        assert!(Tree::new(&input.join("f_0001.exr"), &root.join("out")).is_err());
        assert!(Tree::new(&root.join("not/yet"), &root.join("out")).is_ok());
        assert!(Tree::new(&root.join("not/####_%d.exr"), &root.join("out")).is_err());
    }
}
