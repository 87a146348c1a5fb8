//! Files in and out: Blender's multilayer EXR files, read pass by pass and written back with only the denoised passes changed.
//!
//! [`read_layout`] → [`resolve`] → [`read_frame`] → … → [`write_denoised`]; [`inspect`](inspect()) tells an artist what a file
//! holds. [`resolve_views`] and [`write_views`] do the same for all the views of a stereo file.

mod atomic;
mod background;
mod codec;
mod container;
mod exr_file;
mod guides;
mod inspect;
mod lambda_mask;
mod layout;
mod letter_case;
mod lights;
mod lock;
mod names;
mod numbering;
mod output_parts;
mod pass_names;
mod read;
mod recombine;
mod resolved;
mod same_file;
mod select;
mod selection;
pub mod sequence;
mod sequence_search;
mod validate;
mod view_layers;
mod write;

pub use atomic::{is_part_file, write_atomically};
pub(crate) use atomic::{is_part_of, part_files, part_prefix, process_token, time_in};
pub use inspect::{Inspection, inspect, inspect_with};
pub use lambda_mask::LambdaImages;
pub(crate) use lambda_mask::read_lambda_image;
pub use layout::{Channel, Layout, Part, Pass, SampleType, ViewLayer, read_layout};
pub(crate) use letter_case::numbered_by;
pub(crate) use lock::FileLock;
pub(crate) use numbering::{NumberPattern, other_pattern, split_number};
pub use pass_names::PassNames;
pub use read::read_frame;
pub use resolved::{AovRef, Missing, PassRef, Resolved};
pub(crate) use same_file::{FileId, file_id, is_same_file};
pub use select::{resolve, resolve_views};
pub(crate) use selection::NOISY;
pub use selection::{Guides, Selection, made_for_vectors};
pub use validate::is_complete;
pub use write::{WriteOptions, caveats, write_denoised, write_views};
