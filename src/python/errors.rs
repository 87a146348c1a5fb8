//! Errors as Python exceptions.

use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyOSError, PyValueError};
use pyo3::prelude::*;

use crate::error::Error;

create_exception!(
    hush,
    HushError,
    PyException,
    "What is neither a TypeError, a ValueError nor an OSError: a damaged file, a missing pass, unusable weights, too little memory."
);

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        match error {
            Error::Io { path, source } => match source.raw_os_error() {
                Some(code) => {
                    let text = source.to_string();
                    // As a string: a path object would be told as PosixPath(…).
                    let path = path.into_os_string();
                    let text = text.split(" (os error").next().unwrap_or_default().to_string();
                    // Python picks FileNotFoundError and the like by the code.
                    if cfg!(windows) { PyOSError::new_err((0, text, path, code)) } else { PyOSError::new_err((code, text, path)) }
                }
                None => std::io::Error::new(source.kind(), format!("{}: {source}", path.display())).into(),
            },
            Error::BadInput { .. } | Error::BadSetting { .. } | Error::SizeMismatch { .. } => {
                PyValueError::new_err(error.to_string())
            }
            other => HushError::new_err(other.to_string()),
        }
    }
}
