//! The job that keyword arguments describe, over what the shot's own settings say.

use std::path::PathBuf;

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyString};
use serde_json::{Map, Number, Value};

use crate::error::Result;
use crate::io::sequence::Sequence;
use crate::settings::{Layered, Origin, SETTINGS, ShotQuery, StageRef, Unfit};
use crate::shot::Job;

/// What Python's keywords say about a shot.
pub struct Keywords {
    query: ShotQuery,
    overwrite: bool,
    strict: bool,
}

impl Keywords {
    /// Reads `inputs`, `settings`, `usd`, `overwrite`, `strict` and the settings of the table.
    ///
    /// # Errors
    /// A TypeError or a ValueError that names the keyword.
    pub fn new(options: &Bound<'_, PyDict>) -> PyResult<Self> {
        let usd: Option<String> = get(options, "usd")?;
        let (no_settings, file): (bool, Option<PathBuf>) = match options.get_item("settings")? {
            Some(value) if value.extract::<bool>().is_ok_and(|value| !value) => (true, None),
            _ => (false, get(options, "settings")?),
        };
        let flag = |name: &str| PyResult::Ok(get::<Option<bool>>(options, name)?.unwrap_or(false));
        let inputs: Vec<PathBuf> = get(options, "inputs")?;
        let usd = usd.map(|text| text.parse::<StageRef>()).transpose()?;
        let query = ShotQuery { inputs, given: given(options)?, usd, file, look_beside: !no_settings };
        Ok(Self { query, overwrite: flag("overwrite")?, strict: flag("strict")? })
    }

    /// The frames and the settings.
    pub fn shot(&self) -> Result<(Sequence, Layered)> {
        self.query.find()
    }

    /// The job. Without frames on disk an error.
    pub fn job(&self) -> Result<Job> {
        self.job_for(self.shot()?, None)
    }

    /// As [`Keywords::job`]; where no frames are on disk, the sequence is empty.
    pub fn job_even_unrendered(&self) -> Result<Job> {
        self.job_for(self.query.find_even_unrendered()?, None)
    }

    /// A job that is never run: it says what a run would read.
    pub fn job_without_output(&self) -> Result<Job> {
        self.job_for(self.shot()?, Some(PathBuf::new()))
    }

    fn job_for(&self, (sequence, settings): (Sequence, Layered), output: Option<PathBuf>) -> Result<Job> {
        let mut job = Job { overwrite: self.overwrite, strict: self.strict, ..Job::of(&settings, sequence, output)? };
        job.notes.extend(settings.from_files());
        Ok(job)
    }
}

/// The settings among the keywords.
fn given(options: &Bound<'_, PyDict>) -> PyResult<Layered> {
    let keyword =
        |name: &str| SETTINGS.iter().find(|s| s.name == name || s.table() == name).map_or("", |s| s.python()).to_owned();
    let mut table = Map::new();
    for setting in SETTINGS {
        if let Some(value) = options.get_item(setting.python())?.filter(|value| !value.is_none()) {
            let said = as_json(&value, 0).map_err(|e| {
                let reason = format!("{}: {}", setting.python(), e.value(options.py()));
                if e.is_instance_of::<PyValueError>(options.py()) {
                    PyValueError::new_err(reason)
                } else {
                    PyTypeError::new_err(reason)
                }
            })?;
            table.insert(setting.table().to_owned(), said);
        }
    }
    Layered::of_table(table, |name| Origin::Argument { name: keyword(name) }).map_err(|(name, value, unfit)| match unfit {
        Unfit::Type(_) => PyTypeError::new_err(format!("{}: {unfit}, got {value}", keyword(&name))),
        Unfit::Unknown(reason) => PyValueError::new_err(reason),
        Unfit::Value(reason) => PyValueError::new_err(format!("{}: {reason}", keyword(&name))),
    })
}

/// No setting's value is nested deeper; a list that holds itself is.
const DEEPEST: usize = 8;

/// A value as JSON: paths as texts, what can be gone through as a list, a mapping from numbers as a list of pairs.
fn as_json(value: &Bound<'_, PyAny>, depth: usize) -> PyResult<Value> {
    if depth > DEEPEST {
        return Err(PyValueError::new_err("is nested too deep"));
    }
    let inner = |value: &Bound<'_, PyAny>| as_json(value, depth + 1);
    if let Ok(flag) = value.extract::<bool>() {
        return Ok(flag.into());
    }
    if value.is_instance_of::<PyString>() {
        return Ok(value.extract::<String>()?.into());
    }
    if let Ok(number) = value.extract::<i64>() {
        return Ok(number.into());
    }
    if let Ok(number) = value.extract::<f64>() {
        let sound = Number::from_f64(number).map(Value::from);
        return sound.ok_or_else(|| PyValueError::new_err(format!("{number} is no number that can be used")));
    }
    if let Ok(path) = value.extract::<PathBuf>() {
        return path.to_str().map(Value::from).ok_or_else(|| PyValueError::new_err(format!("{} is not UTF-8", path.display())));
    }
    if let Ok(mapping) = value.cast::<PyMapping>() {
        let pairs: Vec<(Bound<'_, PyAny>, Bound<'_, PyAny>)> = mapping.items()?.extract()?;
        if let Ok(named) = pairs.iter().map(|(key, value)| Ok((key.extract()?, inner(value)?))).collect::<PyResult<Map<_, _>>>()
            && !named.is_empty()
        {
            return Ok(named.into());
        }
        return pairs.iter().map(|(key, value)| Ok(Value::Array(vec![inner(key)?, inner(value)?]))).collect();
    }
    value.try_iter()?.map(|item| inner(&item?)).collect()
}

/// A keyword's value; one of another type is a TypeError that names it.
pub(super) fn get<'py, T: FromPyObjectOwned<'py>>(options: &Bound<'py, PyDict>, name: &str) -> PyResult<T> {
    let value = options.get_item(name)?.unwrap_or_else(|| options.py().None().into_bound(options.py()));
    value.extract().map_err(|e: T::Error| {
        let error: PyErr = e.into();
        PyTypeError::new_err(format!("{name}: {}", error.value(options.py())))
    })
}
