//! One frame by several settings, as arrays or as a sheet.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use ndarray::{Array2, Array3, s};
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::to_numpy;
use super::job::{Keywords, get};
use super::settings::{check_lam, check_window};
use crate::error::Error;
use crate::preview::{
    Flicker, LayerPreview, Preview, Region, Request, SheetOptions, Variant, check_sheet, preview as make, write_sheet,
};
use crate::shot::CancelToken;

/// The first layer of a preview by its first setting; `options` are the keywords of `hush.preview`.
#[pyfunction]
pub fn preview(
    py: Python<'_>,
    options: &Bound<'_, PyDict>,
    progress: Option<Py<PyAny>>,
    cancel: Option<Py<PyAny>>,
) -> PyResult<Py<PyDict>> {
    let mut made = made(py, options, Calls::new(progress, cancel), None)?;
    let found = PyDict::new(py);
    about(&made, &found)?;
    if made.layers.is_empty() {
        return Ok(found.unbind());
    }
    let LayerPreview { name, noisy, alpha, flicker, variants } = made.layers.swap_remove(0);
    found.set_item("layer", name)?;
    found.set_item("noisy", to_numpy(py, with_alpha(noisy, alpha)))?;
    found.set_item("noisy_flicker", flicker.map(|f| map_of(py, f.change)))?;
    if let Some(variant) = variants.into_iter().next() {
        about_variant(&variant, &found)?;
        found.set_item("denoised", to_numpy(py, with_alpha(variant.colour, variant.alpha)))?;
        let (previous, change) = match variant.flicker {
            Some(Flicker { previous, change, .. }) => (Some(to_numpy(py, previous)), Some(map_of(py, change))),
            None => (None, None),
        };
        found.set_item("previous", previous)?;
        found.set_item("flicker", change)?;
    }
    Ok(found.unbind())
}

/// Writes a sheet; `options` are the keywords of `hush.preview_sheet`.
#[pyfunction]
pub fn preview_sheet(
    py: Python<'_>,
    options: &Bound<'_, PyDict>,
    progress: Option<Py<PyAny>>,
    cancel: Option<Py<PyAny>>,
) -> PyResult<Py<PyDict>> {
    let output: PathBuf = get(options, "sheet")?;
    let before_after: Option<f64> = get(options, "before_after")?;
    if before_after.is_some_and(|at| !(0.0..=1.0).contains(&at)) {
        let reason = "is not in 0 (all denoised) to 1 (all noisy)".into();
        return Err(Error::BadSetting { name: "before_after", reason }.into());
    }
    let shown = SheetOptions { exposure: get(options, "exposure")?, before_after };
    let made = made(py, options, Calls::new(progress, cancel), Some(&output))?;
    py.detach(|| write_sheet(&made, &shown, &output))?;
    let found = PyDict::new(py);
    about(&made, &found)?;
    let mut tiles = Vec::new();
    for layer in &made.layers {
        for variant in &layer.variants {
            let tile = PyDict::new(py);
            tile.set_item("layer", &layer.name)?;
            tile.set_item("noisy_change", layer.flicker.as_ref().and_then(|f| f.mean))?;
            about_variant(variant, &tile)?;
            tiles.push(tile);
        }
    }
    found.set_item("tiles", tiles)?;
    Ok(found.unbind())
}

/// What Python wants to hear and say in between.
struct Calls {
    progress: Option<Py<PyAny>>,
    cancel: Option<Py<PyAny>>,
    token: CancelToken,
    /// The first exception that Python raised.
    failed: Mutex<Option<PyErr>>,
}

impl Calls {
    fn new(progress: Option<Py<PyAny>>, cancel: Option<Py<PyAny>>) -> Self {
        Self { progress, cancel, token: CancelToken::new(), failed: Mutex::new(None) }
    }

    /// Asks and tells; whatever Python raises stops the work.
    fn step(&self, fraction: f64) {
        let call = |py: Python<'_>| -> PyResult<()> {
            self.progress.as_ref().map(|progress| progress.call1(py, (fraction,))).transpose()?;
            if let Some(cancel) = &self.cancel
                && cancel.bind(py).call0()?.is_truthy()?
            {
                self.token.cancel();
            }
            py.check_signals()
        };
        if let Err(error) = Python::attach(call) {
            self.token.cancel();
            self.failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }
    }
}

/// `sheet` is where one will be written.
fn made(py: Python<'_>, options: &Bound<'_, PyDict>, calls: Calls, sheet: Option<&Path>) -> PyResult<Preview> {
    let keywords = Keywords::new(options)?;
    let lams: Vec<f64> = get(options, "lams")?;
    let lambdas: Vec<f32> = lams.into_iter().map(check_lam).collect::<PyResult<_>>()?;
    let windows: Vec<i64> = get(options, "windows")?;
    let windows: Vec<usize> = windows.into_iter().map(check_window).collect::<PyResult<_>>()?;
    let region: Option<(usize, usize, usize, usize)> = get(options, "region")?;
    let region = region.map(|(x, y, width, height)| format!("{x},{y},{width},{height}").parse::<Region>()).transpose()?;
    let (frame, flicker): (i64, bool) = (get(options, "frame")?, get(options, "flicker")?);
    let job = py.detach(|| keywords.job_without_output())?;
    sheet.map(|sheet| check_sheet(sheet, &job.sequence)).transpose()?;
    let engine = py.detach(|| job.settings.engine())?;
    let request = Request {
        frame,
        lambdas: if lambdas.is_empty() { vec![job.lambda().at(frame)] } else { lambdas },
        lambda_masked: job.lambda_masked(frame),
        windows: if windows.is_empty() { job.settings.window.into_iter().collect() } else { windows },
        region,
        flicker,
    };
    let (made, calls) = py.detach(move || {
        calls.step(0.0);
        let made = make((&job.sequence, &job.selection()), &request, &engine, &|fraction| calls.step(fraction), &calls.token);
        (made, calls)
    });
    match calls.failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(error) => Err(error),
        None => Ok(made?),
    }
}

fn about(made: &Preview, found: &Bound<'_, PyDict>) -> PyResult<()> {
    let Region { x, y, width, height } = made.region;
    found.set_item("frame", made.frame)?;
    found.set_item("region", (x, y, width, height))?;
    found.set_item("columns", made.columns)?;
    found.set_item("rows", made.rows)?;
    found.set_item("notes", &made.notes)
}

fn about_variant(variant: &Variant, found: &Bound<'_, PyDict>) -> PyResult<()> {
    found.set_item("lam", variant.lambda)?;
    found.set_item("window", variant.window)?;
    found.set_item("neighbours", &variant.neighbours)?;
    found.set_item("seconds", variant.seconds)?;
    found.set_item("change", variant.flicker.as_ref().and_then(|f| f.mean))
}

fn map_of(py: Python<'_>, map: Array2<f32>) -> Py<PyArray2<f32>> {
    PyArray2::from_owned_array(py, map).unbind()
}

/// (rows, columns, 3), or 4 with alpha.
fn with_alpha(colour: Array3<f32>, alpha: Option<Array2<f32>>) -> Array3<f32> {
    let Some(alpha) = alpha else { return colour };
    let (rows, columns, _) = colour.dim();
    let mut image = Array3::zeros((rows, columns, 4));
    image.slice_mut(s![.., .., ..3]).assign(&colour);
    image.slice_mut(s![.., .., 3]).assign(&alpha);
    image
}
