//! Settings of which each knows where it came from.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::ShotSettings;
use super::keys::{KEYS, each_setting};
use super::names::selected;
use crate::error::{Error, Result};
use crate::io::Selection;
use crate::io::sequence::Sequence;
use crate::shot::{Job, ModelId};

/// Where a value came from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "source", rename_all = "snake_case")]
pub enum Origin {
    /// Nothing was said.
    Default,
    /// A USD stage.
    Usd {
        /// The layer that holds the strongest opinion.
        file: PathBuf,
        /// Path of the prim.
        prim: String,
        /// Name of the attribute.
        attribute: String,
    },
    /// `hush.toml`, `hush.json` or another file of their kind.
    SideFile {
        /// The file.
        file: PathBuf,
        /// The key.
        key: String,
    },
    /// The command line.
    CommandLine {
        /// The option.
        option: String,
    },
    /// A keyword argument in Python.
    Argument {
        /// Its name.
        name: String,
    },
}

impl Display for Origin {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => f.write_str("default"),
            Self::Usd { file, prim, attribute } => write!(f, "{} <{prim}.{attribute}>", file.display()),
            Self::SideFile { file, key } => write!(f, "{}, {key}", file.display()),
            Self::CommandLine { option } => write!(f, "{option}"),
            Self::Argument { name } => write!(f, "{name}"),
        }
    }
}

/// Settings with their origins.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Layered {
    /// The values.
    pub values: ShotSettings,
    /// By the settings' names; those that are not there are defaults.
    origins: BTreeMap<String, Origin>,
    /// What was odd and did no harm, such as an unknown `hush:` attribute.
    pub notes: Vec<String>,
}

macro_rules! said {
    ($($name:literal => $($field:ident).+),+) => {
        /// Names of the settings that have a value.
        fn names_said(values: &ShotSettings) -> Vec<&'static str> {
            let mut names = Vec::new();
            $(if values.$($field).+.is_some() { names.push($name); })+
            names
        }

        /// Moves every value of `stronger` into `values`.
        fn move_over(values: &mut ShotSettings, stronger: ShotSettings) {
            $(if stronger.$($field).+.is_some() { values.$($field).+ = stronger.$($field).+; })+
        }

        /// The value of a setting as JSON; null where nothing was said.
        fn json_of(values: &ShotSettings, name: &str) -> serde_json::Value {
            match name {
                $($name => serde_json::to_value(&values.$($field).+).unwrap_or_default(),)+
                _ => serde_json::Value::Null,
            }
        }
    };
}
each_setting!(said);

impl Layered {
    /// Settings of one source.
    pub fn new(values: ShotSettings, origin: impl Fn(&str) -> Origin) -> Self {
        let origins = names_said(&values).into_iter().map(|name| (name.to_owned(), origin(name))).collect();
        Self { values, origins, notes: Vec::new() }
    }

    /// These settings, and those of `weaker` where these say nothing.
    pub fn over(self, weaker: Self) -> Self {
        let mut all = weaker;
        move_over(&mut all.values, self.values);
        all.origins.extend(self.origins);
        all.notes.extend(self.notes);
        all
    }

    /// Where a setting's value came from, by its name of [`KEYS`].
    pub fn origin(&self, name: &str) -> &Origin {
        self.origins.get(name).unwrap_or(&Origin::Default)
    }

    /// A setting's value as JSON, null for the default.
    pub fn value(&self, name: &str) -> serde_json::Value {
        json_of(&self.values, name)
    }

    /// Names of the settings that some source gave, in the order of [`KEYS`].
    pub fn given(&self) -> impl Iterator<Item = &'static str> + '_ {
        KEYS.iter().map(|k| k.name).filter(|name| self.origins.contains_key(*name))
    }

    /// The files that said something.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = Vec::new();
        for origin in self.origins.values() {
            if let Origin::Usd { file, .. } | Origin::SideFile { file, .. } = origin
                && !files.contains(file)
            {
                files.push(file.clone());
            }
        }
        files
    }

    /// What each file says, in words: settings beside the frames are easily forgotten.
    pub fn from_files(&self) -> Vec<String> {
        let names = |file: &PathBuf| {
            let from_it = |name: &&str| match self.origin(name) {
                Origin::Usd { file: f, .. } | Origin::SideFile { file: f, .. } => f == file,
                _ => false,
            };
            self.given().filter(from_it).collect::<Vec<_>>().join(", ")
        };
        self.files().iter().map(|file| format!("{} says {}", file.display(), names(file))).collect()
    }

    /// The folder to write to.
    ///
    /// # Errors
    /// [`Error::BadSetting`] where no source names one.
    pub fn output(&self) -> Result<PathBuf> {
        let reason = "no folder to write to is known: set output to DIR, or write it into hush.toml";
        self.values.output.clone().ok_or_else(|| Error::BadSetting { name: "output", reason: reason.into() })
    }

    /// The job for a sequence. `output` is where to write, whatever the sources say.
    ///
    /// # Errors
    /// [`Error::SwitchedOff`] where the shot is not to be denoised; [`Error::BadSetting`] without an output folder; the weights
    /// file cannot be read.
    pub fn job(&self, sequence: Sequence, output: Option<PathBuf>) -> Result<Job> {
        let values = &self.values;
        if values.enable == Some(false) {
            return Err(Error::SwitchedOff { by: self.origin("enable").to_string() });
        }
        let output = output.map_or_else(|| self.output(), Ok)?;
        let selection = Selection {
            layers: values.layers.clone().unwrap_or_default(),
            view: values.view.clone(),
            vector_layer: values.vector_layer.clone(),
            guides: selected(values.guides.as_deref()),
            aovs: values.aovs.clone().unwrap_or_default(),
            passes: values.passes.clone(),
            ..Selection::default()
        };
        Ok(Job {
            frames: values.frames.clone(),
            lambda: values.lambda.clone().unwrap_or_default(),
            window: values.window,
            selection,
            keep_noisy: values.keep_noisy.unwrap_or_default(),
            model: values.model.as_deref().map_or(Ok(ModelId::embedded()), ModelId::of_file)?,
            renderer: values.renderer.clone(),
            notes: self.notes.clone(),
            ..Job::new(sequence, output)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layered(json: &str, option: &str) -> Layered {
        let values = serde_json::from_str(json).unwrap();
        Layered::new(values, |name| Origin::CommandLine { option: format!("{option} {name}") })
    }

    #[test]
    fn later_sources_win_setting_by_setting() {
        let weak = layered(r#"{"lambda": 4, "window": 1, "passes": {"beauty": "C", "normal": "N"}}"#, "weak");
        let strong = layered(r#"{"lambda": [[1, 1], [9, 8]], "aovs": "none", "passes": {"beauty": "Ci"}}"#, "strong");
        let all = strong.over(weak);
        assert_eq!(all.values.lambda.as_ref().unwrap().at(9), 8.0);
        assert_eq!((all.values.window, all.values.aovs.as_deref()), (Some(1), Some([].as_slice())));
        assert_eq!(all.values.passes.beauty.as_deref(), Some("Ci"));
        assert_eq!(all.values.passes.normal.as_deref(), Some("N"));
        assert_eq!(all.origin("lambda").to_string(), "strong lambda");
        assert_eq!(all.origin("passes.normal").to_string(), "weak passes.normal");
        assert_eq!(*all.origin("view"), Origin::Default);
        assert_eq!(all.given().collect::<Vec<_>>(), ["lambda", "window", "aovs", "passes.beauty", "passes.normal"]);
        let back: Layered = serde_json::from_str(&serde_json::to_string(&all).unwrap()).unwrap();
        assert_eq!(back, all);
    }

    #[test]
    fn every_key_is_a_field_and_every_field_a_key() {
        let full = r#"{"enable": true, "input": "a", "output": "b", "frames": "1-2", "lambda": 2, "window": 1, "layers": ["A"],
            "view": "left", "vector_layer": "V", "aovs": "all", "guides": "albedo", "keep_noisy": true, "model": "m", "renderer": "r", "memory": "4G",
            "passes": {"beauty": "a", "albedo": "b", "normal": "c", "depth": "d", "vector": "e"}}"#;
        let all = layered(full, "");
        assert_eq!(all.given().collect::<Vec<_>>(), KEYS.map(|k| k.name));
        assert!(KEYS.iter().all(|k| !all.value(k.name).is_null()));
    }

    #[test]
    fn a_shot_switched_off_is_no_job() {
        let sequence = Sequence { name: "f".into(), frames: Vec::new(), ignored: Vec::new(), named: None };
        let off = layered(r#"{"enable": false, "output": "out"}"#, "x").job(sequence.clone(), None);
        assert!(matches!(off, Err(Error::SwitchedOff { by }) if by == "x enable"));
        let nowhere = layered("{}", "x").job(sequence, None).unwrap_err().to_string();
        assert!(nowhere.contains("set output to") && nowhere.contains("hush.toml"), "{nowhere}");
    }
}
