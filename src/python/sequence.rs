//! Shots on disk: the run on a thread of its own, while the calling thread serves Python.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;

use super::errors::HushError;
use super::job::Keywords;
use crate::engine::Engine;
use crate::error::Result;
use crate::shot::{self, CancelToken, Event, Job, Plan, Scope, Summary, run, survey};

/// How often `cancel` and signals are looked at.
const POLL: Duration = Duration::from_millis(50);

/// What a file holds and what Hush would use, as JSON.
#[pyfunction]
pub fn inspect(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    to_json(&py.detach(|| crate::io::inspect(&path))?)
}

/// The plan of a shot as JSON; `options` are the keywords of `denoise_sequence`.
#[pyfunction]
pub fn dry_run_sequence(py: Python<'_>, options: &Bound<'_, PyDict>) -> PyResult<String> {
    let keywords = Keywords::new(options)?;
    let plan = py.detach(|| {
        // Weights, memory and threads are refused here as they would be by the run.
        let job = keywords.job()?;
        job.settings.engine()?;
        Plan::new(&job)
    });
    to_json(&plan?)
}

/// What is left out of a shot as JSON; `options` are the keywords of `denoise_sequence`.
#[pyfunction]
pub fn survey_sequence(py: Python<'_>, options: &Bound<'_, PyDict>, timing: bool) -> PyResult<String> {
    let keywords = Keywords::new(options)?;
    let found = py.detach(|| {
        let (sequence, settings) = keywords.shot()?;
        let values = &settings.values;
        let scope = Scope::open(&sequence, &values.selection(), values.frames.as_ref(), values.window, 0)?;
        survey(&scope, &values.engine()?, timing, &|_| (), &CancelToken::new())
    });
    to_json(&found?)
}

/// What is known of a shot's files from one check to the next.
#[pyclass(module = "hush._hush", frozen)]
pub struct SequenceCheck(Mutex<shot::SequenceCheck>);

#[pymethods]
impl SequenceCheck {
    #[new]
    fn new() -> Self {
        Self(Mutex::default())
    }

    /// How the frames stand, as JSON; `options` are the keywords of `denoise_sequence`.
    fn check(&self, py: Python<'_>, options: &Bound<'_, PyDict>) -> PyResult<String> {
        let keywords = Keywords::new(options)?;
        let checked = py.detach(|| {
            let job = keywords.job_even_unrendered()?;
            self.0.lock().unwrap_or_else(PoisonError::into_inner).check(&job)
        });
        to_json(&checked?)
    }
}

/// Denoises a shot. `progress` gets each event as JSON; returns the last event's fields as JSON.
#[pyfunction]
pub fn denoise_sequence(
    py: Python<'_>,
    options: &Bound<'_, PyDict>,
    progress: Option<Py<PyAny>>,
    cancel: Option<Py<PyAny>>,
) -> PyResult<String> {
    let keywords = Keywords::new(options)?;
    let job = py.detach(|| keywords.job())?;
    let engine = py.detach(|| job.settings.engine())?;
    let calls = Calls { progress, cancel, token: CancelToken::new(), failed: None };
    let (summary, failed) = py.detach(move || run_beside(&job, &engine, calls));
    failed.map_or(Ok(()), Err)?;
    to_json::<Summary>(&summary?)
}

/// Runs the job on another thread and serves Python on this one; also what Python raised.
fn run_beside(job: &Job, engine: &Engine, calls: Calls) -> (Result<Summary>, Option<PyErr>) {
    let (events_in, events) = channel();
    let (seen_in, seen) = channel();
    let (with_progress, token) = (calls.progress.is_some(), calls.token.clone());
    thread::scope(|scope| {
        let worker = scope.spawn(move || {
            let report = |event: Event<'_>| {
                // The run waits until Python has dealt with the event, so that it can stop the run before the next frame.
                if with_progress && events_in.send(to_json(&event)).is_ok() {
                    let _ = seen.recv();
                }
            };
            run(job, engine, &report, &token)
        });
        let failed = calls.serve(&events, &seen_in);
        let summary = worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
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

fn to_json<T: Serialize>(value: &T) -> PyResult<String> {
    serde_json::to_string(value).map_err(|e| HushError::new_err(format!("a name cannot be told: {e}")))
}
