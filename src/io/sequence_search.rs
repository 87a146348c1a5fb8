//! From what the user names (a folder, a glob, a `####` or `%04d` pattern, files) to one numbered sequence of EXR files.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use super::letter_case::{ignores_case, numbered_by, spelled};
use super::numbering::{NumberPattern, other_pattern, split_number};
use super::sequence::{Sequence, SequenceFrame, file_name, is_exr, parent};
use crate::error::{Error, Result};
use crate::words::spans;

impl Sequence {
    /// Finds the one sequence that `inputs` name: folders (not searched deeper), globs, `####` or `%04d` patterns, files.
    ///
    /// The frame number is the number nearest the extension, unless a pattern says where it stands. Files, named one by one or by
    /// a glob, bring those of the same sequence beside them along, see [`named`](Self::named).
    ///
    /// # Errors
    /// Nothing found, several sequences found (the message names them), a named file that is no EXR or has no number among
    /// several, two files of one number.
    pub fn find<P: AsRef<Path>>(inputs: &[P]) -> Result<Self> {
        let mut found = FoundFiles::default();
        for input in inputs {
            found.add(input.as_ref())?;
        }
        found.into_sequence(inputs.iter().map(|i| i.as_ref().display().to_string()).collect::<Vec<_>>().join(" "))
    }
}

/// Folder, name before the number, name after it.
type GroupKey = (PathBuf, String, String);

#[derive(Default)]
struct FoundFiles {
    groups: BTreeMap<GroupKey, BTreeSet<(i64, usize, PathBuf)>>,
    /// Files without a number, and whether the user named the file itself.
    unnumbered: BTreeMap<PathBuf, bool>,
    /// A folder or a pattern was named, which stands for all its frames.
    whole: bool,
}

impl FoundFiles {
    fn add(&mut self, input: &Path) -> Result<()> {
        let text = input.to_string_lossy();
        if input.is_dir() {
            self.whole = true;
            for path in exr_files(input)? {
                self.add_file(path, false);
            }
            return Ok(());
        }
        if input.is_file() {
            if !is_exr(input) {
                return Err(bad(&text, "is not an .exr file"));
            }
            let beside = || exr_files(parent(input)).unwrap_or_default();
            self.add_file(spelled(input.to_path_buf(), beside), true);
            return Ok(());
        }
        let name = input.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let folder = parent(input);
        let spells = |text: &str| text.contains(['*', '?', '[']);
        let is_glob = spells(&text);
        if !folder.is_dir() && !spells(&folder.to_string_lossy()) {
            return Err(absent(&text, format!("there is no folder {}", folder.display())));
        }
        if let Some(pattern) = NumberPattern::parse(&name).map_err(|reason| bad(&text, reason))? {
            self.whole = true;
            return self.add_pattern(input, &pattern);
        }
        if is_glob {
            return self.add_glob(&text);
        }
        let mut there = FoundFiles::default();
        let alike = exr_files(folder).unwrap_or_default().into_iter().filter(|f| !name.is_empty() && starts_with(f, &name));
        alike.for_each(|f| there.add_file(f, false));
        let hint = match there.groups.iter().next() {
            Some((key, files)) => {
                format!(": for the frames that start with it, name '{}'", input.with_file_name(group_name(key, files)).display())
            }
            None => String::new(),
        };
        Err(absent(&text, format!("no such file or folder{hint}")))
    }

    fn add_pattern(&mut self, input: &Path, pattern: &NumberPattern) -> Result<()> {
        let folder = parent(input);
        let files = exr_files(folder)?;
        let before = self.groups.len();
        for path in &files {
            let Some((_, number, digits, _)) = numbered_by(pattern, path) else { continue };
            let key = (folder.to_path_buf(), pattern.prefix.clone(), pattern.suffix.clone());
            self.groups.entry(key).or_default().insert((number, digits, path.clone()));
        }
        if self.groups.len() > before {
            return Ok(());
        }
        let mut there = FoundFiles::default();
        files.into_iter().for_each(|f| there.add_file(f, false));
        let names = there.names();
        let hint = if names.is_empty() { "the folder holds no EXR files".into() } else { format!("the folder holds {names}") };
        Err(absent(&input.to_string_lossy(), format!("no file matches; {hint}")))
    }

    fn add_glob(&mut self, text: &str) -> Result<()> {
        // Windows' own programs take any letter case, and no shell expands globs there.
        let options = glob::MatchOptions { case_sensitive: !cfg!(windows), ..Default::default() };
        let entries = glob::glob_with(text, options).map_err(|e| bad(text, format!("is not a valid glob: {}", e.msg)))?;
        let mut any = false;
        for entry in entries {
            let path = entry.map_err(|e| Error::io(e.path().to_path_buf(), std::io::Error::from(e.error().kind())))?;
            if is_exr(&path) && !is_hidden(&path) && is_file(&path) {
                self.add_file(path, false);
                any = true;
            }
        }
        if any { Ok(()) } else { Err(absent(text, "no .exr file matches")) }
    }

    fn add_file(&mut self, path: PathBuf, explicit: bool) {
        let split = file_name(&path).and_then(|n| split_number(&n));
        match split {
            Some((prefix, number, digits, suffix)) => {
                let key = (parent(&path).to_path_buf(), prefix, suffix);
                self.groups.entry(key).or_default().insert((number, digits, path));
            }
            None => *self.unnumbered.entry(path).or_default() |= explicit,
        }
    }

    /// The sequences found, for messages: at most five.
    fn names(&self) -> String {
        let mut names: Vec<String> = self
            .groups
            .iter()
            .take(5)
            .map(|(key, files)| {
                let numbers: Vec<i64> = files.iter().map(|f| f.0).collect();
                format!("{} ({})", key.0.join(group_name(key, files)).display(), spans(&numbers))
            })
            .collect();
        if self.groups.len() > 5 {
            names.push(format!("{} more", self.groups.len() - 5));
        }
        names.join(", ")
    }

    /// Where each file would be a sequence of its own: the pattern that makes one of them, by another number in their names.
    fn other_pattern(&self) -> Option<PathBuf> {
        let folder = &self.groups.keys().next()?.0;
        let single = |(key, files): (&GroupKey, &BTreeSet<_>)| key.0 == *folder && files.len() == 1;
        if !self.groups.iter().all(single) {
            return None;
        }
        let names: Vec<String> = self.groups.values().flatten().filter_map(|(_, _, path)| file_name(path)).collect();
        other_pattern(names.iter().map(String::as_str)).map(|(pattern, _)| folder.join(pattern))
    }

    /// Adds the files of the one sequence that were not named; returns the numbers of those that were, if those are not all.
    fn add_those_beside(&mut self) -> Option<BTreeSet<i64>> {
        let (key, files) = self.groups.iter_mut().next().filter(|_| !self.whole)?;
        let named: BTreeSet<i64> = files.iter().map(|f| f.0).collect();
        for path in exr_files(&key.0).unwrap_or_default() {
            let split = file_name(&path).and_then(|n| split_number(&n));
            let Some((prefix, number, digits, suffix)) = split else { continue };
            let (same, alike) =
                (prefix == key.1 && suffix == key.2, in_one_case(&prefix, &suffix) == in_one_case(&key.1, &key.2));
            // Of two files with one number the one that was named is meant; of others, one is as good as the other.
            if (same || alike && ignores_case(&path)) && !files.iter().any(|f| f.0 == number) {
                files.insert((number, digits, path));
            }
        }
        (files.len() > named.len()).then_some(named)
    }

    /// Where the file system makes no difference between letter cases, sequences whose names differ in nothing else are one.
    fn join_spellings(&mut self) {
        let mut known: HashMap<_, GroupKey> = HashMap::new();
        for (key, files) in std::mem::take(&mut self.groups) {
            let alike = (key.0.to_string_lossy().to_lowercase(), in_one_case(&key.1, &key.2));
            let first = known.get(&alike).filter(|_| files.first().is_some_and(|(_, _, path)| ignores_case(path)));
            let key = first.cloned().unwrap_or(key);
            known.entry(alike).or_insert_with(|| key.clone());
            self.groups.entry(key).or_default().extend(files);
        }
    }

    fn into_sequence(mut self, input: String) -> Result<Sequence> {
        if self.groups.len() > 1 {
            self.join_spellings();
        }
        if self.groups.len() > 1 {
            let pattern = self.other_pattern().or_else(|| self.groups.iter().next().map(|(k, f)| k.0.join(group_name(k, f))));
            let reason = format!(
                "holds {} sequences: {}. Choose one with a pattern, such as '{}'",
                self.groups.len(),
                self.names(),
                pattern.unwrap_or_default().display(),
            );
            return Err(bad(&input, reason));
        }
        let named = self.add_those_beside();
        let Some((key, files)) = self.groups.iter().next() else {
            let mut paths: Vec<PathBuf> = self.unnumbered.into_keys().collect();
            return match paths.len() {
                0 => Err(absent(&input, nothing_in(Path::new(&input)))),
                1 => {
                    let path = paths.remove(0);
                    let name = file_name(&path).unwrap_or_default();
                    Ok(Sequence { name, frames: vec![SequenceFrame { number: 1, path }], ignored: Vec::new(), named: None })
                }
                n => Err(bad(&input, format!("{n} EXR files, none with a frame number in its name: name one at a time"))),
            };
        };
        if let Some((path, _)) = self.unnumbered.iter().find(|(_, explicit)| **explicit) {
            return Err(bad(
                &path.to_string_lossy(),
                "has no frame number in its name, but the other files have: name it by itself",
            ));
        }
        let name = group_name(key, files);
        let frames: Vec<SequenceFrame> =
            files.iter().map(|(number, _, path)| SequenceFrame { number: *number, path: path.clone() }).collect();
        if let Some(pair) = frames.windows(2).find(|p| p[0].number == p[1].number) {
            let names = pair.iter().map(|f| f.path.display().to_string()).collect::<Vec<_>>().join(" and ");
            return Err(bad(&input, format!("{names} are both frame {}: move one away or name a pattern", pair[0].number)));
        }
        Ok(Sequence { name, frames, ignored: self.unnumbered.into_keys().collect(), named })
    }
}

fn in_one_case(prefix: &str, suffix: &str) -> (String, String) {
    (prefix.to_lowercase(), suffix.to_lowercase())
}

fn group_name(key: &GroupKey, files: &BTreeSet<(i64, usize, PathBuf)>) -> String {
    let digits = files.iter().map(|f| f.1).min().unwrap_or(1);
    format!("{}{}{}", key.1, "#".repeat(digits), key.2)
}

/// Why a folder gives nothing, with its subfolders that would.
fn nothing_in(folder: &Path) -> String {
    let holds_exr = |p: &PathBuf| p.is_dir() && exr_files(p).is_ok_and(|f| !f.is_empty());
    let below: Vec<String> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|e| e.path())
        .filter(holds_exr)
        .take(3)
        .map(|p| p.display().to_string())
        .collect();
    match below.is_empty() {
        true => "holds no .exr files".into(),
        false => format!("holds no .exr files itself (subfolders are not searched); try {}", below.join(" or ")),
    }
}

/// The visible EXR files directly in a folder.
fn exr_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| Error::io(folder, e))?.path();
        if is_exr(&path) && !is_hidden(&path) && is_file(&path) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Whether it is a file, or may be one: what a link that leads nowhere or a folder that may not be looked into hides fails as a frame and is
/// not left out without a word.
fn is_file(path: &Path) -> bool {
    match std::fs::metadata(path) {
        Ok(about) => about.is_file(),
        Err(e) => e.kind() == std::io::ErrorKind::PermissionDenied || path.is_symlink(),
    }
}

fn is_hidden(path: &Path) -> bool {
    file_name(path).is_some_and(|n| n.starts_with('.'))
}

fn starts_with(path: &Path, name: &str) -> bool {
    file_name(path).is_some_and(|n| n.starts_with(name))
}

/// Nothing is there.
fn absent(input: &str, reason: impl Into<String>) -> Error {
    Error::io(input, std::io::Error::new(std::io::ErrorKind::NotFound, reason.into()))
}

fn bad(input: &str, reason: impl Into<String>) -> Error {
    Error::BadInput { input: input.into(), reason: reason.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for name in names {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, b"").unwrap();
        }
        dir
    }

    fn find(dir: &tempfile::TempDir, inputs: &[&str]) -> Result<Sequence> {
        Sequence::find(&inputs.iter().map(|i| dir.path().join(i)).collect::<Vec<_>>())
    }

    fn message(result: Result<Sequence>) -> String {
        result.expect_err("should be refused").to_string()
    }

    #[test]
    fn a_folder_is_sorted_by_number_and_not_searched_deeper() {
        let dir = folder(&["f_9.exr", "f_10.exr", "f_100.EXR", ".f_11.exr", "f_12.png", "notes.exr", "sub/f_13.exr"]);
        let dir2 = folder(&["f_9.exr", "f_10.exr", ".f_11.exr", "f_12.png", "notes.exr", "sub/f_13.exr"]);
        let found = find(&dir2, &[""]).unwrap();
        assert_eq!(found.numbers(), [9, 10]);
        assert_eq!(found.name, "f_#.exr");
        assert_eq!(found.ignored.len(), 1);
        assert_eq!(found.path(10), Some(dir2.path().join("f_10.exr").as_path()));
        assert_eq!(found.path(13), None);
        if ignores_case(&dir.path().join("f_9.exr")) {
            assert_eq!(find(&dir, &[""]).unwrap().numbers(), [9, 10, 100]);
        } else {
            assert!(message(find(&dir, &[""])).contains("2 sequences"), "another case of extension is another sequence");
        }
    }

    #[test]
    fn several_sequences_are_named_and_a_pattern_chooses() {
        let dir = folder(&["a_0001.exr", "a_0002.exr", "b_0001.exr", "shot_0001_v2.exr", "shot_0002_v2.exr"]);
        let text = message(find(&dir, &[""]));
        assert!(text.contains("a_####.exr (1-2)") && text.contains("b_####.exr (1)") && text.contains("pattern"), "{text}");
        for pattern in ["a_####.exr", "a_%04d.exr", "a_%d.exr", "a_#.exr", "a_*.exr", "a_000[12].exr"] {
            assert_eq!(find(&dir, &[pattern]).unwrap().numbers(), [1, 2], "{pattern}");
        }
        assert_eq!(find(&dir, &["shot_####_v2.exr"]).unwrap().numbers(), [1, 2]);
        assert_eq!(find(&dir, &["a_0002.exr", "a_0001.exr", "a_0002.exr"]).unwrap().numbers(), [1, 2]);
        let text = message(find(&dir, &["a_######.exr"]));
        assert!(text.contains("no file matches") && text.contains("a_####.exr"), "{text}");
    }

    #[test]
    fn a_number_behind_the_frame_number_brings_the_right_pattern() {
        let dir = folder(&["frame_0001_v02.exr", "frame_0002_v02.exr", "frame_0003_v02.exr"]);
        let text = message(find(&dir, &[""]));
        assert!(text.contains("3 sequences") && text.contains("frame_####_v02.exr'"), "{text}");
        assert_eq!(find(&dir, &["frame_####_v02.exr"]).unwrap().numbers(), [1, 2, 3]);
    }

    #[test]
    fn patterns_take_longer_and_negative_numbers() {
        let dir = folder(&["f_-001.exr", "f_0000.exr", "f_9999.exr", "f_10000.exr"]);
        for input in ["f_####.exr", "f_%04d.exr", ""] {
            assert_eq!(find(&dir, &[input]).unwrap().numbers(), [-1, 0, 9999, 10000], "{input}");
        }
    }

    #[test]
    fn letter_case_makes_no_difference_where_the_file_system_makes_none() {
        let dir = folder(&["Frame_0001.exr", "Frame_0002.exr", "frame_0003.EXR"]);
        let inputs: [&[&str]; 4] = [&[""], &["FRAME_####.exr"], &["FRAME_0002.EXR"], &["frame_0003.exr", "frame_0001.exr"]];
        for input in inputs {
            match (ignores_case(&dir.path().join("Frame_0001.exr")), find(&dir, input)) {
                (true, found) => {
                    let names = found.unwrap().frames.into_iter().filter_map(|f| file_name(&f.path)).collect::<Vec<_>>();
                    assert_eq!(names, ["Frame_0001.exr", "Frame_0002.exr", "frame_0003.EXR"], "{input:?}");
                }
                (false, found) => assert!(found.is_err(), "{input:?}"),
            }
        }
        assert_eq!(find(&dir, &["FRAME_000[12].exr"]).is_ok(), cfg!(windows));
    }

    #[test]
    fn spellings_of_one_name_are_one_sequence() {
        // Links stand for the names that a file system without letter case would take as well.
        let dir = folder(&["Frame_0001.exr", "frame_0002.exr"]);
        for (name, other) in [("Frame_0001.exr", "FRAME_0001.EXR"), ("frame_0002.exr", "FRAME_0002.EXR")] {
            std::fs::hard_link(dir.path().join(name), dir.path().join(other)).unwrap_or_default();
        }
        let found = find(&dir, &["frame_0002.exr", "Frame_0001.exr"]).unwrap();
        assert_eq!(found.numbers(), [1, 2]);
    }

    #[test]
    fn brackets_in_a_folder_that_exists_are_no_glob() {
        let dir = folder(&["take [1]/f_####/f_0001.exr"]);
        assert_eq!(find(&dir, &["take [1]/f_####"]).unwrap().numbers(), [1]);
        assert_eq!(find(&dir, &["take [1]/f_####/f_####.exr"]).unwrap().numbers(), [1]);
    }

    #[test]
    fn what_cannot_be_used_is_refused_with_advice() {
        let dir = folder(&["f_1.exr", "f_0001.exr", "still.exr", "other.exr", "deep/g_0001.exr", "a.png", "empty/x.txt"]);
        assert!(message(find(&dir, &["f_#.exr"])).contains("both frame 1"));
        assert!(message(find(&dir, &["a.png"])).contains("not an .exr"));
        assert!(message(find(&dir, &["nothing"])).contains("no such file"));
        assert!(message(find(&dir, &["still.exr", "f_1.exr"])).contains("no frame number"));
        assert!(message(find(&dir, &["still.exr", "other.exr"])).contains("one at a time"));
        assert!(message(find(&dir, &["deep/g_"])).contains("g_####.exr"));
        assert!(message(find(&dir, &["empty"])).contains("no .exr files"));
        assert!(message(find(&dir, &["*.tif"])).contains("no .exr file matches"));
        assert!(message(find(&dir, &["f_[.exr"])).contains("glob"));
        assert!(message(find(&dir, &["####_%04d.exr"])).contains("once"));
        let outer = folder(&["deep/g_0001.exr"]);
        assert!(message(find(&outer, &[""])).contains("deep"));
        assert_eq!(find(&dir, &["still.exr"]).unwrap().numbers(), [1]);
    }
}
