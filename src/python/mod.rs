//! The Python module's private half, `hush._hush`; the public half is `python/hush`. It translates and decides nothing.

mod arrays;
mod command;
mod denoiser;
mod errors;
mod job;
mod preview;
mod sequence;
mod settings;
mod stage_reader;

use pyo3::prelude::*;

use crate::rules::window::{LAMBDA_RANGE, MAX_WINDOW};

#[pymodule]
fn _hush(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("LAMBDA_RANGE", LAMBDA_RANGE)?;
    m.add("MAX_WINDOW", MAX_WINDOW)?;
    m.add("HushError", m.py().get_type::<errors::HushError>())?;
    m.add_class::<denoiser::Denoiser>()?;
    m.add_class::<denoiser::Denoised>()?;
    m.add_class::<sequence::SequenceCheck>()?;
    m.add_function(wrap_pyfunction!(denoiser::denoise, m)?)?;
    m.add_function(wrap_pyfunction!(command::main, m)?)?;
    m.add_function(wrap_pyfunction!(preview::preview, m)?)?;
    m.add_function(wrap_pyfunction!(preview::preview_sheet, m)?)?;
    m.add_function(wrap_pyfunction!(stage_reader::read_stages_with, m)?)?;
    m.add_function(wrap_pyfunction!(sequence::inspect, m)?)?;
    m.add_function(wrap_pyfunction!(sequence::dry_run_sequence, m)?)?;
    m.add_function(wrap_pyfunction!(sequence::survey_sequence, m)?)?;
    m.add_function(wrap_pyfunction!(sequence::denoise_sequence, m)?)
}
