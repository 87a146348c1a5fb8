//! The settings that a frame is made with: those of the table that change pixels, and the engine's identity.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value, json};

use crate::engine::{Identity, ModelId};
use crate::settings::{Effect, Kind, SETTINGS, Setting, ShotSettings, in_words};

/// The settings that a frame was made with; a frame is made again where they differ.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameSettings {
    /// 1…64.
    pub lambda: f32,
    /// λ of what the mask marks, 1…64; None without a mask.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lambda_masked: Option<f32>,
    /// Frames on each side.
    pub window: usize,
    /// The engine's.
    #[serde(flatten)]
    pub engine: Identity,
    /// The others by name, where they are not as by default.
    #[serde(flatten)]
    pub others: BTreeMap<String, Value>,
}

impl FrameSettings {
    /// Those of a shot without a mask, once the frame's λ and window are known.
    pub(super) fn new(settings: &ShotSettings, lambda: f32, window: usize, engine: Identity) -> Self {
        let others = others().filter_map(|s| Some((s.name.to_owned(), named(s, s.unusual(settings.get(s.name))?)))).collect();
        Self { lambda, lambda_masked: None, window, engine, others }
    }

    /// A short key that differs where the settings differ.
    pub(crate) fn key(&self) -> String {
        format!("{:016x}", xxhash_rust::xxh3::xxh3_64(serde_json::to_string(self).unwrap_or_default().as_bytes()))
    }

    /// Frames on each side that a frame depends on.
    pub(super) fn context(&self) -> usize {
        self.engine.context(self.window)
    }

    /// Frames on each side whose first passes the second one takes; 0 where there is none.
    pub(super) fn second_reach(&self) -> usize {
        self.context() - self.window
    }

    /// The view layer that the motion vectors came from, where one was named.
    pub(super) fn vector_layer(&self) -> Option<&str> {
        self.others.get("vector_layer")?.as_str()
    }

    /// What changed since `old`.
    pub(super) fn changes_since(&self, old: &Self) -> Vec<Change> {
        // That there is a mask now, or none any more, is told by the setting that names it.
        let masks = self.lambda_masked.is_some() && old.lambda_masked.is_some();
        let counts = |setting: &&Setting| setting.effect != Effect::Nothing && (masks || setting.name != "lambda_masked");
        let all = SETTINGS.iter().filter(counts);
        let change = |setting: &'static Setting| {
            let (old, new) = (old.in_words(setting), self.in_words(setting));
            (old != new).then_some(Change { setting, old, new })
        };
        all.filter_map(change).collect()
    }

    fn in_words(&self, setting: &Setting) -> String {
        let ModelId { name, hash } = &self.engine.model;
        let said = match setting.name {
            "lambda" => json!(self.lambda),
            "lambda_masked" => json!(self.lambda_masked),
            "window" => json!(self.window),
            "model" => hash.as_ref().map_or(name.clone(), |hash| format!("{name} ({hash})")).into(),
            "renderer" => json!(self.engine.renderer),
            "skip" => json!(self.engine.skip),
            "second_pass" => json!(self.engine.second_pass),
            other => self.others.get(other).cloned().unwrap_or_default(),
        };
        if said.is_null() { setting.default.to_owned() } else { in_words(&said) }
    }
}

/// The settings of [`FrameSettings::others`].
fn others() -> impl Iterator<Item = &'static Setting> {
    SETTINGS.iter().filter(|s| s.effect == Effect::Pixels && !["lambda", "lambda_masked", "window"].contains(&s.name))
}

/// Of a path only the last name: a shot may lie anywhere, and the files' contents are compared by themselves.
fn named(setting: &Setting, value: Value) -> Value {
    let name = value.as_str().filter(|_| setting.kind == Kind::Path).and_then(|path| Path::new(path).file_name());
    name.map_or(value.clone(), |name| name.to_string_lossy().into())
}

/// Also as Hush 0.1 wrote them at first: every setting, guides and rules as flags, passes as a table.
impl<'de> Deserialize<'de> for FrameSettings {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        struct Written {
            lambda: f32,
            #[serde(default)]
            lambda_masked: Option<f32>,
            window: usize,
            #[serde(default = "first_revision")]
            revision: u32,
            model: ModelId,
            #[serde(default)]
            renderer: Option<String>,
            #[serde(default)]
            skip: Option<Value>,
            #[serde(default)]
            second_pass: bool,
            #[serde(flatten)]
            others: Map<String, Value>,
        }
        let flags = |value: Value| match value {
            Value::Object(flags) => flags.into_iter().filter(|(_, on)| *on == Value::Bool(true)).map(|(name, _)| name).collect(),
            list => list,
        };
        let Written { lambda, lambda_masked, window, revision, model, renderer, skip, second_pass, others: written } =
            Written::deserialize(from)?;
        let mut rules = skip.map_or_else(|| json!(crate::rules::skip::RULES), flags);
        if let Some(rules) = rules.as_array_mut() {
            // A rule without a bound is gone; whatever it made is another frame now.
            rules.retain(|rule| rule != "repeated");
        }
        let skip = ordered("skip", rules).ok_or_else(|| D::Error::custom("skip: no list of rules"))?;
        let skip = serde_json::from_value(skip).map_err(D::Error::custom)?;
        let mut others = BTreeMap::new();
        for setting in self::others() {
            let (table, key) = setting.name.split_once('.').unwrap_or((setting.name, ""));
            let value = match written.get(setting.name).or(written.get(table).filter(|v| v.is_object())) {
                Some(Value::Object(inner)) if !key.is_empty() => inner.get(key).cloned().unwrap_or_default(),
                Some(value) => flags(value.clone()),
                None => Value::Null,
            };
            let value = ordered(setting.name, value).and_then(|value| setting.unusual(value));
            others.extend(value.map(|value| (setting.name.to_owned(), value)));
        }
        Ok(Self { lambda, lambda_masked, window, engine: Identity { revision, model, renderer, skip, second_pass }, others })
    }
}

/// That of manifests which do not tell it.
fn first_revision() -> u32 {
    1
}

/// A value in its one form; None where it is none for the setting.
fn ordered(name: &str, value: Value) -> Option<Value> {
    Setting::named(name).ok()?.kind.canonical(value).ok()
}

/// A setting that changed, in words: `lambda 1 → 4`.
#[derive(Clone, Debug)]
pub(super) struct Change {
    pub setting: &'static Setting,
    old: String,
    new: String,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} → {}", self.setting.label(), self.old, self.new)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::skip::Skip;

    fn settings(said: Value, lambda: f32) -> FrameSettings {
        let said: ShotSettings = serde_json::from_value(said).unwrap();
        let skip = said.skip.as_deref().map_or_else(Skip::default, Skip::of);
        FrameSettings::new(&said, lambda, 2, Identity::of(None, said.renderer.as_deref(), skip, false).unwrap())
    }

    #[test]
    fn what_changed_is_told_by_the_names_of_settings() {
        let usual = settings(json!({}), 1.0);
        for (said, words) in [
            (json!({ "skip": "none" }), "skip constant, opaque, untrusted, still → none"),
            (json!({ "renderer": "Mitsuba" }), "renderer cycles → mitsuba"),
            (json!({ "layers": "all" }), "layers the one with the most samples → all"),
            (json!({ "guides": "none" }), "guides albedo, normal, depth, vector → none"),
            (json!({ "passes.beauty": "Ci" }), "passes.beauty Combined → Ci"),
            (json!({ "keep_noisy": true }), "keep noisy false → true"),
        ] {
            let new = settings(said, 1.0);
            assert_eq!(new.changes_since(&usual).iter().map(Change::to_string).collect::<Vec<_>>(), [words]);
            assert_ne!(new.key(), usual.key());
            assert_eq!(serde_json::from_value::<FrameSettings>(json!(new)).unwrap(), new);
        }
        assert_eq!(settings(json!({}), 4.0).changes_since(&usual)[0].to_string(), "lambda 1 → 4");
    }

    #[test]
    fn every_setting_that_changes_pixels_is_a_change_by_its_name() {
        let usual = settings(json!({}), 1.0);
        for setting in others() {
            let value = match setting.kind {
                Kind::Flag => json!(true),
                Kind::Names => json!(["a"]),
                Kind::Choices(all) => json!(all[..1]),
                _ => json!("text"),
            };
            let new = settings(json!({ (setting.name): value }), 1.0);
            let changed: Vec<&str> = new.changes_since(&usual).iter().map(|change| change.setting.name).collect();
            assert!(changed == [setting.name] && new.key() != usual.key(), "{}: {changed:?}", setting.name);
        }
        let rest: Vec<&str> = SETTINGS.iter().map(|s| s.name).filter(|name| others().all(|s| s.name != *name)).collect();
        let of_dials = ["lambda", "lambda_masked", "window"];
        let of_the_engine = ["skip", "second_pass", "model", "renderer"];
        let of_no_pixel = ["enable", "input", "output", "frames", "memory", "threads"];
        let mut known = [&of_dials[..], &of_the_engine, &of_no_pixel].concat();
        known.sort_by_key(|name| SETTINGS.iter().position(|s| s.name == *name));
        assert_eq!(rest, known);
    }

    #[test]
    fn what_is_said_as_it_is_anyway_changes_nothing() {
        let same = json!({ "renderer": "cycles", "guides": ["vector", "depth", "normal", "albedo"], "aovs": "none", "keep_noisy": false,
            "memory": "4G", "frames": "1-2" });
        assert_eq!(settings(same, 1.0), settings(json!({}), 1.0));
    }

    #[test]
    fn manifests_of_before_are_still_understood() {
        let before = json!({ "lambda": 1.0, "window": 2, "layers": [], "view": null, "vector_layer": null,
            "guides": { "albedo": true, "normal": true, "depth": true, "vector": true }, "aovs": [], "keep_noisy": false,
            "skip": { "constant": true, "opaque": true, "untrusted": true, "still": true, "repeated": false },
            "model": ModelId::embedded() });
        let mut changed = before.clone();
        let first = |said| {
            let settings = settings(said, 1.0);
            FrameSettings { engine: Identity { revision: first_revision(), ..settings.engine }, ..settings }
        };
        assert_eq!(serde_json::from_value::<FrameSettings>(before).unwrap(), first(json!({})));
        changed["guides"]["depth"] = false.into();
        changed["skip"]["still"] = false.into();
        changed["passes"] = json!({ "beauty": "C" });
        let said = json!({ "guides": ["albedo", "normal", "vector"], "skip": ["constant", "opaque", "untrusted"], "passes.beauty": "C" });
        assert_eq!(serde_json::from_value::<FrameSettings>(changed).unwrap(), first(said));
    }
}
