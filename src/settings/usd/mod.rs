//! Settings on the standard render prims of a USD stage: `hush:` attributes of a `RenderSettings`, a `RenderPass` and its
//! `RenderDenoisePass`, and the frames' file and channel names from `RenderProduct` and `RenderVar`.

mod attributes;
mod gaps;
mod open;
mod opinions;
mod plain_path;
mod prims;
mod products;
mod stage_ref;
mod values;
mod write;

pub use stage_ref::StageRef;
pub use write::write;

use super::layered::Layered;
use crate::error::{Error, Result};

/// Reads the settings of a stage, in this process.
///
/// What openusd panics at becomes an error. A file made to harm can still end the process, by asking for more memory than there
/// is; read files of strangers in a process of their own.
///
/// # Errors
/// [`Error::BadFile`], naming the prim where there is one: the stage, a sublayer or what its render prims refer to cannot be read,
/// layers or references in a circle, no render prim or several, an attribute of the wrong type or out of range, one that openusd
/// resolves otherwise than USD.
pub fn read(stage: &StageRef) -> Result<Layered> {
    let prim = stage.prim.clone();
    open::with_stage(&stage.file, move |open| {
        let chain = prims::choose(open, prim.as_deref())?;
        let mut all = products::read(open, &chain)?;
        for prim in &chain.prims {
            all = attributes::read(open, prim)?.over(all);
        }
        gaps::nothing_lost(open, &chain)?;
        Ok(all)
    })
}

/// What every message about an unreadable stage ends with.
fn unreadable(stage: &std::path::Path, reason: &str) -> Error {
    let advice = "the stage cannot be used; hush.toml beside the frames carries all the settings too";
    Error::bad_file(stage, format!("{reason} ({advice})"))
}
