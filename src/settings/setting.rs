//! One setting: all that is said about it anywhere.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value, json};

use super::kind::{Kind, Unfit};
use super::nearest::hint;
use super::table::{Guide, SETTINGS, ShotSettings};
use crate::io::{Guides, LambdaImages, PassNames, Selection};

/// What a setting changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Which frames are made, or how: never their pixels.
    Nothing,
    /// A frame's pixels or its file; a frame that was made with another value is out of date.
    Pixels,
    /// As [`Effect::Pixels`], through the engine, which knows it as a part of its identity.
    Engine,
}

/// A setting of a shot.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// In `hush.toml`; with a dot for a key of a table.
    pub name: &'static str,
    /// The kind of its values.
    pub kind: Kind,
    /// What it changes.
    pub effect: Effect,
    /// The attribute of a render prim.
    pub usd: &'static str,
    /// On the command line.
    pub option: Option<&'static str>,
    /// On the command line, in short.
    pub short: Option<char>,
    /// What the option's help calls the value.
    pub argument: &'static str,
    /// The keyword in Python, where it is not the name.
    pub(super) python: Option<&'static str>,
    /// What holds where nobody says it, in words.
    pub default: &'static str,
    /// What it does, as the command's help has it; see [`help`](Self::help).
    pub(super) help: &'static str,
}

impl Setting {
    pub(super) const fn new(name: &'static str, help: &'static str) -> Self {
        Self {
            name,
            kind: Kind::Text,
            effect: Effect::Nothing,
            usd: "",
            option: None,
            short: None,
            argument: "",
            python: None,
            default: "",
            help,
        }
    }

    /// The setting of a name.
    ///
    /// # Errors
    /// [`Unfit::Unknown`] with the nearest name.
    pub fn named(name: &str) -> Result<&'static Self, Unfit> {
        let unknown = || Unfit::Unknown(format!("unknown key {name}{}", hint(name, SETTINGS.iter().map(|s| s.name))));
        SETTINGS.iter().find(|s| s.name == name).ok_or_else(unknown)
    }

    /// What it does, in one sentence without its full stop.
    pub fn help(&self) -> &'static str {
        self.help.trim().trim_end_matches('.')
    }

    /// Its name in sentences.
    pub fn label(&self) -> String {
        self.name.replace('_', " ")
    }

    /// Its name; for a key of a table the table's.
    pub fn table(&self) -> &'static str {
        self.name.split('.').next().unwrap_or(self.name)
    }

    /// The keyword in Python; for a key of a table the table's.
    pub fn python(&self) -> &'static str {
        self.python.unwrap_or_else(|| self.table())
    }

    /// A value that is not the default; None for the default and where nothing is said.
    pub(crate) fn unusual(&self, value: Value) -> Option<Value> {
        let default = match self.kind {
            Kind::Flag => json!(self.default == "true"),
            Kind::Names => json!([]),
            Kind::Choices(all) => json!(all),
            _ => Value::Null,
        };
        Some(value).filter(|value| !value.is_null() && *value != default)
    }
}

impl ShotSettings {
    /// The settings that were said, in the order of [`SETTINGS`].
    pub(crate) fn said(&self) -> impl Iterator<Item = (&'static Setting, Value)> {
        let all = SETTINGS.iter().map(|setting| (setting, self.get(setting.name)));
        all.filter(|(_, value)| !value.is_null())
    }

    /// What to read of a file.
    pub fn selection(&self) -> Selection {
        let guides = self.guides.as_ref().map_or_else(Guides::default, |guides| {
            let has = |guide| guides.contains(&guide);
            Guides {
                albedo: has(Guide::Albedo),
                normal: has(Guide::Normal),
                depth: has(Guide::Depth),
                vector: has(Guide::Vector),
            }
        });
        let passes = PassNames {
            beauty: self.passes_beauty.clone(),
            albedo: self.passes_albedo.clone(),
            normal: self.passes_normal.clone(),
            depth: self.passes_depth.clone(),
            vector: self.passes_vector.clone(),
        };
        Selection {
            layers: self.layers.clone().unwrap_or_default(),
            view: self.view.clone(),
            vector_layer: self.vector_layer.clone(),
            guides,
            aovs: self.aovs.clone().unwrap_or_default(),
            lambda_pass: self.lambda_pass.clone().filter(|name| !name.is_empty()),
            lambda_images: self.lambda_images.clone().map(LambdaImages::new),
            passes,
            ..Selection::default()
        }
    }
}

impl Serialize for ShotSettings {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_map(self.said().map(|(setting, value)| (setting.name, value)))
    }
}

impl<'de> Deserialize<'de> for ShotSettings {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let mut settings = Self::default();
        for (name, value) in Map::deserialize(from)? {
            settings.set(&name, value).map_err(|e| D::Error::custom(format!("{name}: {e}")))?;
        }
        Ok(settings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_has_names_and_a_field() {
        for setting in SETTINGS {
            assert!(!setting.usd.is_empty() && !setting.default.is_empty() && setting.help.len() > 20, "{}", setting.name);
            assert!(matches!(setting.kind, Kind::Flag | Kind::Text) || !setting.argument.is_empty(), "{}", setting.name);
            assert_eq!(Setting::named(setting.name).unwrap().usd, setting.usd);
            let value = match setting.kind {
                Kind::Flag => json!(true),
                Kind::Whole { least, .. } => json!(least),
                Kind::Lambda => json!(4.0),
                Kind::Frames => json!("1-3"),
                Kind::Size => json!(1024),
                Kind::Names => json!(["a"]),
                Kind::Choices(all) => json!(all[..1]),
                Kind::Path | Kind::Name | Kind::Text => json!("text"),
            };
            let mut settings = ShotSettings::default();
            assert_eq!(settings.get(setting.name), Value::Null);
            settings.set(setting.name, value.clone()).unwrap();
            assert_eq!(settings.get(setting.name), value, "{}", setting.name);
            assert_eq!(serde_json::from_value::<ShotSettings>(json!(settings)).unwrap(), settings);
        }
    }

    #[test]
    fn a_name_that_is_none_is_told_the_nearest() {
        let unknown = ShotSettings::default().set("lamda", json!(1)).unwrap_err().to_string();
        assert_eq!(unknown, "unknown key lamda; did you mean lambda?");
    }
}
