//! Image quality against a reference: [`smape()`], [`relmse()`], [`psnr()`], [`ssim()`], [`flip()`] and [`flicker()`], one a file;
//! [`unbiased_relmse()`] and [`unbiased_flicker_squared()`], which take the references' noise out; and [`evaluate()`], which applies them
//! to the frames of a shot.
//!
//! Every metric takes a [`Pair`]: two images (rows, columns, 3) of scene-linear radiance, scaled so that the reference's mean
//! is 0.4, and looks at the pixels that are finite in both. Sums run in f64 by rows and rows are added from top to bottom, so
//! a result is the same for any number of threads.

pub mod evaluate;
#[cfg(test)]
mod evaluate_tests;
pub mod evaluation;
pub mod flicker;
pub mod flip;
pub(crate) mod images;
pub mod pair;
mod pairing;
pub mod psnr;
pub mod relmse;
mod remarks;
pub(crate) mod sample;
pub mod smape;
pub mod ssim;
pub mod tonemap;
pub mod unbiased;

pub use evaluate::{EvaluateOptions, UnbiasedOptions, evaluate};
pub use flicker::flicker;
pub use flip::flip;
pub use images::ImageChoice;
pub use pair::{Pair, Scaling};
pub use psnr::psnr;
pub use relmse::relmse;
pub(crate) use remarks::denoised_references;
pub use smape::smape;
pub use ssim::ssim;
pub use unbiased::{TwoReferences, unbiased_flicker_squared, unbiased_relmse};
