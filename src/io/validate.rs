//! Whether a file is whole.

use std::path::Path;

use super::exr_file::ExrFile;
use crate::error::Result;

/// Checks a file's header, its chunk table, and that every chunk lies in it as a whole, without decoding pixels. Used to decide
/// whether an output of an earlier run is good.
///
/// # Errors
/// [`crate::Error::Io`] if the file cannot be read, [`crate::Error::BadFile`] with the reason why it is not whole.
pub fn is_complete(path: &Path) -> Result<()> {
    let mut source = ExrFile::open(path)?;
    for (part, table) in source.tables()?.iter().enumerate() {
        for (index, &at) in table.iter().enumerate() {
            source.check_chunk(part, index, at)?;
        }
    }
    Ok(())
}
