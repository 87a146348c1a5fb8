//! Settings of which each knows where it came from.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::kind::Unfit;
use super::table::{SETTINGS, ShotSettings};
use crate::error::{Error, Result};

/// Where a value came from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "source", rename_all = "snake_case")]
#[non_exhaustive]
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
    /// `hush.toml` or another file of its kind.
    SettingsFile {
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
            Self::SettingsFile { file, key } => write!(f, "{}, {key}", file.display()),
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

impl Layered {
    /// Settings of one source; `origin` tells that of a setting by its name.
    pub fn new(values: ShotSettings, origin: impl Fn(&str) -> Origin) -> Self {
        let origins = values.said().map(|(setting, _)| (setting.name.to_owned(), origin(setting.name))).collect();
        Self { values, origins, notes: Vec::new() }
    }

    /// Settings of one table such as `hush.toml`, in which `passes` is a table of its own.
    ///
    /// # Errors
    /// The key that is wrong, its value and why.
    pub(crate) fn of_table(
        table: Map<String, Value>,
        origin: impl Fn(&str) -> Origin,
    ) -> std::result::Result<Self, (String, Value, Unfit)> {
        let mut values = ShotSettings::default();
        for (key, value) in table {
            let inner = match value {
                Value::Object(inner) if key == "passes" => {
                    inner.into_iter().map(|(name, value)| (format!("{key}.{name}"), value)).collect()
                }
                value if key == "passes" => {
                    let expected = "a table with a name for each pass, such as beauty";
                    return Err((key, value, Unfit::Type(expected.into())));
                }
                value => vec![(key, value)],
            };
            for (name, value) in inner {
                let shown = value.clone();
                let no_value = || Unfit::Value("no value that can be used: leave the key out, or give it one".into());
                let said = if value.is_null() { Err(no_value()) } else { values.set(&name, value) };
                said.map_err(|unfit| (name, shown, unfit))?;
            }
        }
        Ok(Self::new(values, origin))
    }

    /// These settings, and those of `weaker` where these say nothing.
    pub fn over(self, weaker: Self) -> Self {
        let mut all = weaker;
        all.values.take(self.values);
        all.origins.extend(self.origins);
        all.notes.extend(self.notes);
        all
    }

    /// Where a setting's value came from, by its name.
    pub fn origin(&self, name: &str) -> &Origin {
        self.origins.get(name).unwrap_or(&Origin::Default)
    }

    /// Names of the settings that some source gave, in the order of [`SETTINGS`].
    pub fn given(&self) -> impl Iterator<Item = &'static str> + '_ {
        SETTINGS.iter().map(|s| s.name).filter(|name| self.origins.contains_key(*name))
    }

    /// The files that said something.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = Vec::new();
        for origin in self.origins.values() {
            if let Origin::Usd { file, .. } | Origin::SettingsFile { file, .. } = origin
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
                Origin::Usd { file: f, .. } | Origin::SettingsFile { file: f, .. } => f == file,
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
        let missing = || {
            let advice = "no folder to write to is known: set output to DIR, or write it into hush.toml";
            // One of them may be a misspelt name of this setting.
            let reason = [advice].into_iter().chain(self.notes.iter().map(String::as_str)).collect::<Vec<_>>().join("; ");
            Error::BadSetting { name: "output", reason }
        };
        self.values.output.clone().ok_or_else(missing)
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
    fn without_an_output_what_was_odd_is_told() {
        let noted = Layered { notes: vec!["hush:outputt is unknown: hush:output?".into()], ..Layered::default() };
        assert!(noted.output().unwrap_err().to_string().ends_with("hush.toml; hush:outputt is unknown: hush:output?"));
        assert!(Layered::default().output().unwrap_err().to_string().ends_with("hush.toml"));
    }

    #[test]
    fn later_sources_win_setting_by_setting() {
        let weak = layered(r#"{"lambda": 4, "window": 1, "passes.beauty": "C", "passes.normal": "N"}"#, "weak");
        let strong = layered(r#"{"lambda": [[1, 1], [9, 8]], "aovs": "none", "passes.beauty": "Ci"}"#, "strong");
        let all = strong.over(weak);
        assert_eq!(all.values.lambda.as_ref().unwrap().at(9), 8.0);
        assert_eq!((all.values.window, all.values.aovs.as_deref()), (Some(1), Some([].as_slice())));
        assert_eq!(all.values.passes_beauty.as_deref(), Some("Ci"));
        assert_eq!(all.values.passes_normal.as_deref(), Some("N"));
        assert_eq!(all.origin("lambda").to_string(), "strong lambda");
        assert_eq!(all.origin("passes.normal").to_string(), "weak passes.normal");
        assert_eq!(*all.origin("view"), Origin::Default);
        assert_eq!(all.given().collect::<Vec<_>>(), ["lambda", "window", "aovs", "passes.beauty", "passes.normal"]);
        let back: Layered = serde_json::from_str(&serde_json::to_string(&all).unwrap()).unwrap();
        assert_eq!(back, all);
    }
}
