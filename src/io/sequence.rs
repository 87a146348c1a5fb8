//! The numbered files of one shot.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// One file of a sequence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SequenceFrame {
    /// The frame number in the file's name; 1 for a lone file without a number.
    pub number: i64,
    /// The file, as it was found.
    pub path: PathBuf,
}

/// The numbered files of one shot.
#[derive(Clone, Debug)]
pub struct Sequence {
    /// The files' common name with the number as `#`, such as `frame_####.exr`.
    pub name: String,
    /// Ascending, each number once, never empty.
    pub frames: Vec<SequenceFrame>,
    /// EXR files without a number that lay beside the sequence and were left out.
    pub ignored: Vec<PathBuf>,
    /// The frames whose files were named, where those were not all: the others only help.
    pub named: Option<BTreeSet<i64>>,
}

impl Sequence {
    /// The sequence that `inputs` would name if its frames were there: without frames.
    pub fn unrendered<P: AsRef<Path>>(inputs: &[P]) -> Self {
        let last = inputs.last().map(AsRef::as_ref).filter(|input| is_exr(input));
        Self { name: last.and_then(file_name).unwrap_or_default(), frames: Vec::new(), ignored: Vec::new(), named: None }
    }

    /// The folder that the frames lie in, or would lie in.
    pub fn folder<P: AsRef<Path>>(inputs: &[P], found: &Self) -> Option<PathBuf> {
        let first = found.frames.first().map(|frame| parent(&frame.path).to_path_buf());
        let named =
            || inputs.first().map(AsRef::as_ref).map(|input| if input.is_dir() { input } else { parent(input) }.to_path_buf());
        first.or_else(named).filter(|folder| folder.is_dir())
    }

    /// The numbers, ascending.
    pub fn numbers(&self) -> Vec<i64> {
        self.frames.iter().map(|f| f.number).collect()
    }

    /// Whether a frame's file was named; others only help.
    pub fn is_named(&self, number: i64) -> bool {
        self.named.as_ref().is_none_or(|named| named.contains(&number))
    }

    /// The frames whose files were named.
    pub fn named_frames(&self) -> impl Iterator<Item = &SequenceFrame> {
        self.frames.iter().filter(|f| self.is_named(f.number))
    }

    /// The file of a frame.
    pub fn path(&self, number: i64) -> Option<&Path> {
        self.frames.binary_search_by_key(&number, |f| f.number).ok().map(|i| self.frames[i].path.as_path())
    }
}

/// Whether a name is that of an EXR file.
pub(crate) fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
}

/// The name of a file, as text.
pub(super) fn file_name(path: &Path) -> Option<String> {
    path.file_name().map(|n| n.to_string_lossy().into_owned())
}

/// The folder of a path, `.` for a bare name.
pub(super) fn parent(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
