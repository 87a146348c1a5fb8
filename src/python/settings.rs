//! Settings of the functions that work on arrays, held to what the table says.

use std::path::PathBuf;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::Value;

use crate::engine::Engine;
use crate::rules::window::LAMBDA_RANGE;
use crate::settings::ShotSettings;

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

/// Frames on each side.
pub fn check_window(window: i64) -> PyResult<usize> {
    let mut settings = ShotSettings::default();
    say(&mut settings, "window", window)?;
    Ok(settings.window.unwrap_or_default())
}

/// An engine; `memory` in bytes, `renderer` one that the weights have an encoder for.
pub fn make_engine(
    py: Python<'_>,
    model: Option<PathBuf>,
    renderer: Option<&str>,
    memory: Option<i64>,
    threads: Option<i64>,
    second_pass: bool,
) -> PyResult<Engine> {
    let renderer = renderer.map(str::to_owned);
    let mut settings = ShotSettings { model, renderer, second_pass: Some(second_pass), ..ShotSettings::default() };
    for (name, value) in [("memory", memory), ("threads", threads)] {
        value.map(|value| say(&mut settings, name, value)).transpose()?;
    }
    Ok(py.detach(|| settings.engine())?)
}

/// Says a number; one out of range is a ValueError that names it.
fn say(settings: &mut ShotSettings, name: &str, value: i64) -> PyResult<()> {
    settings.set(name, Value::from(value)).map_err(|e| PyValueError::new_err(format!("{name}: {e}")))
}
