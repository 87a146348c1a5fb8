//! Numerical soundness: hard frames, what must hold for them, and the worst that was found.
//!
//! The same rows are tests (`tests/stability.rs`) and a table in the report.

mod cases;
mod checks;
mod dial;
mod firefly;
mod level_image;
mod reference;
mod row;
mod scene;
mod suite;
mod symmetry;
mod table;

#[cfg(feature = "internals")]
pub use cases::{Case, HAZARDS};
#[cfg(feature = "internals")]
pub use dial::rendered;
pub use row::CheckRow;
#[cfg(feature = "internals")]
pub use suite::Suite;
pub use table::{CHECKS, run, summary};
