//! The job that keyword arguments describe, over what the shot's own settings say.

use std::collections::BTreeMap;
use std::path::PathBuf;

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::settings::{check_lam, check_number, check_window};
use crate::engine::{Engine, Settings};
use crate::error::{Error, Result};
use crate::io::PassNames;
use crate::io::sequence::Sequence;
use crate::network::weights::Weights;
use crate::rules::lambda::Lambda;
use crate::rules::skip::{Rule, Skip};
use crate::settings::{Layered, Origin, ShotSettings, Sources, StageRef, gather, read_apart};
use crate::shot::Job;

/// A shot as Python asked for it: its job, and what the engine for it is made of.
pub struct Asked {
    pub job: Job,
    model: Option<PathBuf>,
    renderer: Option<String>,
    engine: Settings,
}

impl Asked {
    /// The shot that the keywords and its own settings describe. Without frames on disk an error.
    pub fn new(options: &Bound<'_, PyDict>) -> PyResult<Self> {
        let keywords = Keywords::new(options)?;
        Ok(options.py().detach(|| keywords.asked(false))?)
    }

    /// As [`Asked::new`]; where no frames are on disk, the sequence is empty.
    pub fn even_unrendered(options: &Bound<'_, PyDict>) -> PyResult<Self> {
        let keywords = Keywords::new(options)?;
        Ok(options.py().detach(|| keywords.asked(true))?)
    }

    /// The engine for it.
    ///
    /// # Errors
    /// Weights that cannot be used, too little memory.
    pub fn engine(&self) -> Result<Engine> {
        Engine::from_weights(&Weights::open(self.model.as_deref(), self.renderer.as_deref())?, self.engine.clone())
    }
}

/// The keywords in Rust's types.
struct Keywords {
    inputs: Vec<PathBuf>,
    output: Option<PathBuf>,
    given: ShotSettings,
    file: Option<PathBuf>,
    no_settings: bool,
    usd: Option<StageRef>,
    skip: Skip,
    threads: Option<usize>,
    overwrite: bool,
    strict: bool,
}

impl Keywords {
    fn new(options: &Bound<'_, PyDict>) -> PyResult<Self> {
        let number = |name: &str, most: i64| -> PyResult<Option<i64>> {
            get::<Option<i64>>(options, name)?.map(|n| check_number(name, n, 1, most)).transpose()
        };
        let guides: Option<Vec<String>> = get(options, "guides")?;
        let frames: Option<String> = get(options, "frames")?;
        let lam: Option<Vec<(f64, f64)>> = get(options, "lam")?;
        let usd: Option<String> = get(options, "usd")?;
        let given = ShotSettings {
            enable: get(options, "enable")?,
            frames: frames.map(|text| text.parse()).transpose()?,
            lambda: lam.map(lambda).transpose()?,
            window: get::<Option<i64>>(options, "window")?.map(check_window).transpose()?,
            layers: get(options, "layers")?,
            view: get(options, "view")?,
            vector_layer: get(options, "vector_layer")?,
            aovs: get(options, "aovs")?,
            guides: guides.map(|names| names.iter().map(|name| name.parse()).collect::<Result<_>>()).transpose()?,
            passes: passes(get(options, "passes")?)?,
            keep_noisy: get(options, "keep_noisy")?,
            model: get(options, "model")?,
            renderer: get(options, "renderer")?,
            memory: number("memory", i64::MAX)?.map(|bytes| bytes as u64),
            ..ShotSettings::default()
        };
        Ok(Self {
            inputs: get(options, "inputs")?,
            output: get(options, "output")?,
            given,
            file: get(options, "settings")?,
            no_settings: get::<Option<bool>>(options, "no_settings")?.unwrap_or(false),
            usd: usd.map(|text| text.parse()).transpose()?,
            skip: skip(get(options, "skip")?)?,
            threads: number("threads", 4096)?.map(|n| n as usize),
            overwrite: get::<Option<bool>>(options, "overwrite")?.unwrap_or(false),
            strict: get::<Option<bool>>(options, "strict")?.unwrap_or(false),
        })
    }

    fn asked(self, even_unrendered: bool) -> Result<Asked> {
        let inputs = if self.inputs.is_empty() { vec![self.input()?] } else { self.inputs.clone() };
        let sequence = match Sequence::find(&inputs) {
            Err(Error::Io { source, .. }) if even_unrendered && source.kind() == std::io::ErrorKind::NotFound => {
                Sequence::unrendered(&inputs)
            }
            found => found?,
        };
        let folder = Sequence::folder(&inputs, &sequence);
        let settings = self.settings(folder.as_deref())?;
        let mut job = settings.job(sequence, self.output)?;
        job.notes.extend(settings.from_files());
        let values = settings.values;
        let engine = Settings { memory: values.memory, threads: self.threads, skip: self.skip, ..Settings::default() };
        let job = Job { overwrite: self.overwrite, strict: self.strict, skip: self.skip, ..job };
        Ok(Asked { job, model: values.model, renderer: values.renderer, engine })
    }

    /// The frames that the settings name.
    fn input(&self) -> Result<PathBuf> {
        let reason = "is missing: name the frames, or a stage or a settings file that names them";
        let missing = || Error::BadInput { input: "inputs".into(), reason: reason.into() };
        self.settings(None)?.values.input.ok_or_else(missing)
    }

    fn settings(&self, folder: Option<&std::path::Path>) -> Result<Layered> {
        let look_beside = !self.no_settings;
        let sources = Sources { usd: self.usd.clone(), file: self.file.clone(), look_beside, read_usd: &read_apart };
        let keyword = |name: &str| Origin::Argument { name: if name == "lambda" { "lam".into() } else { name.to_owned() } };
        Ok(Layered::new(self.given.clone(), keyword).over(gather(folder, &sources, ShotSettings::default())?))
    }
}

/// λ from its keys (frame, value); a single value comes as one key.
fn lambda(keys: Vec<(f64, f64)>) -> PyResult<Lambda> {
    let keys: Vec<(f64, f32)> = keys.into_iter().map(|(frame, lam)| Ok((frame, check_lam(lam)?))).collect::<PyResult<_>>()?;
    Ok(Lambda::keyed(keys)?)
}

fn passes(names: Option<BTreeMap<String, String>>) -> PyResult<PassNames> {
    let mut found = PassNames::default();
    for (pass, name) in names.unwrap_or_default() {
        *match pass.as_str() {
            "beauty" => &mut found.beauty,
            "albedo" => &mut found.albedo,
            "normal" => &mut found.normal,
            "depth" => &mut found.depth,
            "vector" => &mut found.vector,
            _ => return Err(PyValueError::new_err(format!("passes: {pass:?} is none of beauty, albedo, normal, depth, vector"))),
        } = Some(name);
    }
    Ok(found)
}

fn skip(rules: Option<Vec<String>>) -> PyResult<Skip> {
    let Some(rules) = rules else { return Ok(Skip::default()) };
    let rules: Vec<Rule> = rules.iter().map(|rule| rule.parse()).collect::<Result<_>>()?;
    Ok(rules.into_iter().fold(Skip::NONE, |skip, rule| skip.with(rule, true)))
}

/// A keyword's value; one of another type is a TypeError that names it.
pub(super) fn get<'py, T: FromPyObjectOwned<'py>>(options: &Bound<'py, PyDict>, name: &str) -> PyResult<T> {
    let value = options.get_item(name)?.unwrap_or_else(|| options.py().None().into_bound(options.py()));
    value.extract().map_err(|e: T::Error| {
        let error: PyErr = e.into();
        PyTypeError::new_err(format!("{name}: {}", error.value(options.py())))
    })
}
