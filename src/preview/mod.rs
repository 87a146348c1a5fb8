//! A preview: one frame denoised in several ways, in seconds, for whoever chooses the settings. No frame is written.
//!
//! [`preview()`] gives the images; [`sheet()`] puts them on one page. Of a [`Region`] only what it needs is computed, at the
//! exposure and mean depth of the whole frames: it agrees with the same part of the whole denoised frame to 1e-3 of each value,
//! but for a few pixels where a motion vector ends exactly between two pixels and rounding takes the other one.
//! Tone: linear light times 2 to the power of the exposure, cut at 1, then the sRGB curve; no view transform.

mod flicker;
mod images;
mod region;
mod sheet;
mod tile;
mod tone;
mod window;
mod wipe;

pub use flicker::{Flicker, MOST_CHANGE};
pub use images::{LayerPreview, Preview, Request, Variant, preview};
pub use region::Region;
pub use sheet::{SheetOptions, check_sheet, sheet, write_sheet};
