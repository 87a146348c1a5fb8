//! Shots on disk: the run on a thread of its own, while the calling thread serves Python.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;

use super::errors::HushError;
use super::settings::{check_lam, check_window, engine};
use crate::engine::Engine;
use crate::error::Result;
use crate::io::sequence::Sequence;
use crate::io::{Guides, Selection};
use crate::plan::lambda::Lambda;
use crate::shot::{CancelToken, Event, Job, ModelId, Plan, Summary, run};
use crate::simd::release_memory;

/// How often `cancel` and signals are looked at.
const POLL: Duration = Duration::from_millis(50);

/// What a file holds and what Hush would use, as JSON.
#[pyfunction]
pub fn inspect(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    to_json(&py.detach(|| crate::io::inspect(&path))?)
}

/// The plan of a shot as JSON; `options` are the keywords of `denoise_sequence`.
#[pyfunction]
pub fn plan_sequence(py: Python<'_>, options: &Bound<'_, PyDict>) -> PyResult<String> {
    let job = job(options)?;
    // Weights, memory and threads are refused here as they would be by the run.
    engine_of(py, options)?;
    to_json(&py.detach(|| Plan::new(&job))?)
}

/// Denoises a shot. `progress` gets each event as JSON; returns the last event's fields as JSON.
#[pyfunction]
pub fn denoise_sequence(
    py: Python<'_>,
    options: &Bound<'_, PyDict>,
    progress: Option<Py<PyAny>>,
    cancel: Option<Py<PyAny>>,
) -> PyResult<String> {
    let job = job(options)?;
    let engine = engine_of(py, options)?;
    let calls = Calls { progress, cancel, token: CancelToken::new(), failed: None };
    let (summary, failed) = py.detach(move || run_beside(&job, &engine, calls));
    failed.map_or(Ok(()), Err)?;
    to_json::<Summary>(&summary?)
}

/// The engine that the keywords describe.
fn engine_of(py: Python<'_>, options: &Bound<'_, PyDict>) -> PyResult<Engine> {
    let renderer: Option<String> = get(options, "renderer")?;
    engine(py, get(options, "model")?, renderer.as_deref(), get(options, "memory")?, get(options, "threads")?)
}

/// Runs the job on another thread and serves Python on this one; also what Python raised.
fn run_beside(job: &Job, engine: &Engine, calls: Calls) -> (Result<Summary>, Option<PyErr>) {
    let (events_in, events) = channel();
    let (seen_in, seen) = channel();
    let (told, token) = (calls.progress.is_some(), calls.token.clone());
    thread::scope(|scope| {
        let worker = scope.spawn(move || {
            let report = |event: Event<'_>| {
                // The run waits until Python has dealt with the event, so that it can stop the run before the next frame.
                if told && events_in.send(to_json(&event)).is_ok() {
                    let _ = seen.recv();
                }
            };
            run(job, engine, &report, &token)
        });
        let failed = calls.serve(&events, &seen_in);
        let summary = worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        release_memory();
        (summary, failed)
    })
}

/// What Python wants to hear and say during a run.
struct Calls {
    progress: Option<Py<PyAny>>,
    cancel: Option<Py<PyAny>>,
    token: CancelToken,
    /// The first exception that Python raised.
    failed: Option<PyErr>,
}

impl Calls {
    /// Serves Python until the run is over; whatever Python raises stops the run.
    fn serve(mut self, events: &Receiver<PyResult<String>>, seen: &Sender<()>) -> Option<PyErr> {
        let mut event = None;
        loop {
            let waits = event.is_some();
            if self.failed.is_none()
                && let Err(error) = Python::attach(|py| self.call(py, event))
            {
                self.token.cancel();
                self.failed = Some(error);
            }
            if waits {
                let _ = seen.send(());
            }
            event = match events.recv_timeout(POLL) {
                Ok(event) => Some(event),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => return self.failed,
            };
        }
    }

    fn call(&self, py: Python<'_>, event: Option<PyResult<String>>) -> PyResult<()> {
        if let (Some(progress), Some(event)) = (&self.progress, event) {
            progress.call1(py, (event?,))?;
        }
        if let Some(cancel) = &self.cancel
            && !self.token.is_cancelled()
            && cancel.bind(py).call0()?.is_truthy()?
        {
            self.token.cancel();
        }
        py.check_signals()
    }
}

/// The job that the keywords describe.
fn job(options: &Bound<'_, PyDict>) -> PyResult<Job> {
    let inputs: Vec<PathBuf> = get(options, "inputs")?;
    if inputs.is_empty() {
        return Err(PyValueError::new_err("inputs: names no file or folder"));
    }
    let output: PathBuf = get(options, "output")?;
    let frames: Option<String> = get(options, "frames")?;
    let window: Option<i64> = get(options, "window")?;
    let model: Option<PathBuf> = get(options, "model")?;
    let renderer: Option<String> = get(options, "renderer")?;
    let guides = Guides {
        albedo: get(options, "albedo")?,
        normal: get(options, "normal")?,
        depth: get(options, "depth")?,
        vector: get(options, "vector")?,
    };
    let selection = Selection {
        layers: get(options, "layers")?,
        view: get(options, "view")?,
        vector_layer: get(options, "vector_layer")?,
        guides,
        aovs: get(options, "aovs")?,
        ..Selection::default()
    };
    let lambda = lambda(get(options, "lam")?)?;
    let keep_noisy = get(options, "keep_noisy")?;
    let (overwrite, strict) = (get(options, "overwrite")?, get(options, "strict")?);
    let window = window.map(check_window).transpose()?;
    let made = |sequence| -> Result<Job> {
        Ok(Job {
            frames: frames.map(|f| f.parse()).transpose()?,
            lambda,
            window,
            selection,
            keep_noisy,
            overwrite,
            strict,
            renderer,
            model: model.as_deref().map_or(Ok(ModelId::embedded()), ModelId::of_file)?,
            ..Job::new(sequence, output)
        })
    };
    let sequence = options.py().detach(|| Sequence::find(&inputs))?;
    Ok(made(sequence)?)
}

/// λ from its keys (frame, value); a single value comes as one key.
fn lambda(keys: Vec<(f64, f64)>) -> PyResult<Lambda> {
    let keys: Vec<(f64, f32)> = keys.into_iter().map(|(frame, lam)| Ok((frame, check_lam(lam)?))).collect::<PyResult<_>>()?;
    Ok(Lambda::keyed(keys)?)
}

/// A keyword's value; one of another type is a TypeError that names it.
pub(super) fn get<'py, T: FromPyObjectOwned<'py>>(options: &Bound<'py, PyDict>, name: &str) -> PyResult<T> {
    let value = options.get_item(name)?.unwrap_or_else(|| options.py().None().into_bound(options.py()));
    value.extract().map_err(|e: T::Error| {
        let error: PyErr = e.into();
        PyTypeError::new_err(format!("{name}: {}", error.value(options.py())))
    })
}

fn to_json<T: Serialize>(value: &T) -> PyResult<String> {
    serde_json::to_string(value).map_err(|e| HushError::new_err(format!("a name cannot be told: {e}")))
}
