//! The command line inside Python: Ctrl-C reaches it through Python's own signal handling.

use std::ffi::OsString;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;

use super::errors::HushError;
use crate::cli::{Handler, run};

/// How often signals are looked at.
const POLL: Duration = Duration::from_millis(50);
/// What main threads have, which the argument parser may need.
const STACK: usize = 8 << 20;

/// What a signal does, once the command has said so.
#[derive(Default)]
struct Signals {
    handler: Option<Handler>,
    /// One came before.
    pending: bool,
}

impl Signals {
    /// Whether the command takes care of it.
    fn raise(&mut self) -> bool {
        self.pending = true;
        self.handler.as_mut().map(|handler| handler()).is_some()
    }

    fn set(&mut self, mut handler: Handler) {
        if self.pending {
            handler();
        }
        self.handler = Some(handler);
    }
}

/// Runs the command line; `args` begins with the program's name. Returns the exit code.
#[pyfunction]
pub fn main(py: Python<'_>, args: Vec<OsString>) -> PyResult<u8> {
    let signals = Arc::new(Mutex::new(Signals::default()));
    let (code_in, code) = channel();
    let shared = Arc::clone(&signals);
    let catch = move |handler| {
        shared.lock().unwrap_or_else(PoisonError::into_inner).set(handler);
        Ok(())
    };
    thread::Builder::new().stack_size(STACK).spawn(move || code_in.send(run(args, &catch)))?;
    py.detach(move || {
        loop {
            match code.recv_timeout(POLL) {
                Ok(code) => return Ok(code),
                Err(RecvTimeoutError::Disconnected) => return Err(HushError::new_err("the command ended unexpectedly")),
                Err(RecvTimeoutError::Timeout) => {}
            }
            let Err(error) = Python::attach(|py| py.check_signals()) else { continue };
            let handled = signals.lock().unwrap_or_else(PoisonError::into_inner).raise();
            let interrupt = Python::attach(|py| error.is_instance_of::<PyKeyboardInterrupt>(py));
            if !(handled && interrupt) {
                return Err(error);
            }
        }
    })
}
