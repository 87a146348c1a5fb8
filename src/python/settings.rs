//! Settings that all parts of the module take.

use std::path::PathBuf;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::engine::{Engine, Settings};
use crate::network::weights::Weights;
use crate::rules::window::{LAMBDA_RANGE, MAX_WINDOW};

/// λ as the engine takes it; outside of its range a ValueError.
pub fn check_lam(lam: f64) -> PyResult<f32> {
    let (least, most) = LAMBDA_RANGE;
    match (f64::from(least)..=f64::from(most)).contains(&lam) {
        true => Ok(lam as f32),
        false => Err(PyValueError::new_err(format!(
            "lam: {lam} is out of range: {least} (cleanest) to {most} (keeps grain and the detail hidden in it)"
        ))),
    }
}

/// A whole number within bounds, else a ValueError that names it.
pub fn check_number(name: &str, value: i64, least: i64, most: i64) -> PyResult<i64> {
    match (least..=most).contains(&value) {
        true => Ok(value),
        false if most == i64::MAX => Err(PyValueError::new_err(format!("{name}: {value} is out of range: {least} or more"))),
        false => Err(PyValueError::new_err(format!("{name}: {value} is out of range: {least} to {most}"))),
    }
}

/// Frames on each side.
pub fn check_window(window: i64) -> PyResult<usize> {
    Ok(check_number("window", window, 0, MAX_WINDOW as i64)? as usize)
}

/// An engine; `memory` in bytes, `renderer` one that the weights have an encoder for.
pub fn engine(
    py: Python<'_>,
    model: Option<PathBuf>,
    renderer: Option<&str>,
    memory: Option<i64>,
    threads: Option<i64>,
) -> PyResult<Engine> {
    let memory = memory.map(|m| check_number("memory", m, 1, i64::MAX)).transpose()?.map(|m| m as u64);
    let threads = threads.map(|t| check_number("threads", t, 1, 4096)).transpose()?.map(|t| t as usize);
    let settings = Settings { memory, threads, ..Settings::default() };
    let made = || Engine::from_weights(&Weights::open(model.as_deref(), renderer)?, settings);
    Ok(py.detach(made)?)
}
