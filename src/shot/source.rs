//! A frame's file once its header was read: what it holds and what will be read from it.

use std::path::{Path, PathBuf};

use crate::error::Result;
use crate::io::layout::{Layout, read_layout};
use crate::io::select::{Resolved, Selection, resolve};
use crate::plan::checks::Header;
use crate::plan::window::Known;

/// A readable file of the sequence.
pub(super) struct Source {
    pub path: PathBuf,
    pub layout: Layout,
    pub resolved: Resolved,
    pub header: Header,
}

impl Source {
    /// Reads the header and picks the passes.
    pub fn open(number: i64, path: &Path, selection: &Selection) -> Result<Self> {
        let layout = read_layout(path)?;
        let resolved = resolve(&layout, selection)?;
        let header = Header {
            number,
            columns: layout.columns,
            rows: layout.rows,
            vector: resolved.vector.is_some(),
            noisy_image: resolved.from_noisy_image,
            lossy: None,
        };
        Ok(Self { path: path.into(), layout, resolved, header })
    }

    /// For the window.
    pub fn known(&self) -> Known {
        Known::Good { columns: self.header.columns, rows: self.header.rows, vector: self.header.vector }
    }
}
