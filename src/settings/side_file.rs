//! `hush.toml` and `hush.json`: the settings beside the frames.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::ShotSettings;
use super::keys::KEYS;
use super::layered::{Layered, Origin};
use super::nearest::hint;
use super::usd::StageRef;
use crate::error::{Error, Result};

/// The side file's names.
pub const SIDE_FILES: [&str; 2] = ["hush.toml", "hush.json"];
/// The key that names a stage.
const USD: &str = "usd";
/// No settings are longer.
const MAX_BYTES: u64 = 1 << 20;

/// What a side file holds.
#[derive(Clone, Debug)]
pub struct SideFile {
    /// The settings; paths are taken from the file's folder.
    pub settings: Layered,
    /// The stage that its key `usd` names.
    pub usd: Option<StageRef>,
}

/// The side file in a folder, if there is one.
///
/// # Errors
/// [`Error::BadInput`] if there are both `hush.toml` and `hush.json`.
pub fn beside(folder: &Path) -> Result<Option<PathBuf>> {
    let mut there = SIDE_FILES.iter().map(|name| folder.join(name)).filter(|path| path.exists());
    match (there.next(), there.next()) {
        (Some(_), Some(_)) => {
            let reason = "holds both hush.toml and hush.json, and nothing tells which one is meant: remove one";
            Err(Error::BadInput { input: folder.display().to_string(), reason: reason.into() })
        }
        (one, _) => Ok(one),
    }
}

/// Reads a side file: JSON if its name ends so, else TOML.
///
/// # Errors
/// [`Error::Io`]; [`Error::BadFile`] naming the key: syntax, an unknown key (with the nearest valid one), a value of the wrong
/// type or out of range.
pub fn read_side_file(path: &Path) -> Result<SideFile> {
    let bad = |reason: String| Error::bad_file(path, reason);
    let size = std::fs::metadata(path).map_err(|e| Error::io(path, e))?.len();
    if size > MAX_BYTES {
        return Err(bad(format!("is {size} bytes long, which no settings are")));
    }
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    let json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    let mut table: Map<String, Value> = match json {
        true => serde_json::from_str(&text).map_err(|e| bad(format!("is no JSON object: {e}")))?,
        false => toml::from_str(&text).map_err(|e| bad(format!("is no TOML: {}", e.to_string().trim_end())))?,
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    let usd = match table.remove(USD) {
        None => None,
        Some(Value::String(stage)) => Some(stage.parse::<StageRef>().map_err(|e| bad(format!("{USD}: {e}")))?.from(folder)),
        Some(other) => return Err(bad(format!("{USD}: {other} is no file name"))),
    };
    let mut settings = values_of(table, path).map_err(bad)?;
    let values = &mut settings.values;
    for place in [&mut values.input, &mut values.output, &mut values.model].into_iter().flatten() {
        *place = folder.join(&*place);
    }
    Ok(SideFile { settings, usd })
}

/// Key by key, so that a message can name the key.
fn values_of(table: Map<String, Value>, path: &Path) -> Result<Layered, String> {
    let mut flat: Vec<(String, Value)> = Vec::new();
    for (key, value) in table {
        match value {
            Value::Object(inner) if key == "passes" => flat.extend(inner.into_iter().map(|(k, v)| (format!("passes.{k}"), v))),
            value if key == "passes" => return Err(format!("passes: {value} is no table: write passes.beauty = \"…\"")),
            value => flat.push((key, value)),
        }
    }
    let mut all = Layered::default();
    for (key, value) in flat {
        if !KEYS.iter().any(|k| k.name == key) {
            return Err(format!("unknown key {key}{}", hint(&key, KEYS.iter().map(|k| k.name).chain([USD]))));
        }
        if value.is_null() {
            return Err(format!("{key} has no value that can be used: leave the key out, or give it one"));
        }
        let shown = value.to_string();
        let one = match key.strip_prefix("passes.") {
            Some(pass) => json!({ "passes": { pass: value } }),
            None => json!({ &key: value }),
        };
        let one: ShotSettings = serde_json::from_value(one).map_err(|e| format!("{key} = {shown}: {e}"))?;
        all = Layered::new(one, |key| Origin::SideFile { file: path.into(), key: key.into() }).over(all);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, text: &str) -> Result<SideFile> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join(name), text).unwrap();
        read_side_file(&dir.path().join(name))
    }

    fn message(name: &str, text: &str) -> String {
        read(name, text).expect_err(text).to_string()
    }

    #[test]
    fn toml_and_json_say_the_same() {
        let toml = "lambda = [[1, 1], [24.5, 8]]\nwindow = 1\nframes = \"1-48,60\"\nlayers = \"all\"\nmemory = \"4G\"\n\
                    guides = [\"albedo\", \"depth\"]\naovs = [\"Diffuse Direct\"]\n[passes]\nbeauty = \"C\"\n";
        let json = r#"{"lambda": [[1, 1], [24.5, 8]], "window": 1, "frames": "1-48,60", "layers": ["all"], "memory": 4294967296,
            "guides": ["albedo", "depth"], "aovs": "Diffuse Direct", "passes": {"beauty": "C"}}"#;
        let (toml, json) = (read("hush.toml", toml).unwrap(), read("hush.json", json).unwrap());
        assert_eq!(toml.settings.values, json.settings.values);
        assert_eq!(toml.settings.values.lambda.as_ref().unwrap().to_string(), "1:1,24.5:8");
        assert!(toml.settings.origin("passes.beauty").to_string().ends_with("hush.toml, passes.beauty"));
    }

    #[test]
    fn paths_are_taken_from_the_files_folder() {
        let file = read("hush.toml", "output = \"../clean\"\nmodel = \"/abs/m.safetensors\"\nusd = \"a/shot.usda@/Render/Pass\"")
            .unwrap();
        let values = file.settings.values;
        assert!(values.output.as_ref().is_some_and(|p| p.is_absolute() && p.ends_with("../clean")));
        assert_eq!(values.model.as_deref(), Some(Path::new("/abs/m.safetensors")));
        let stage = file.usd.unwrap();
        assert!(stage.file.is_absolute() && stage.file.ends_with("a/shot.usda"));
        assert_eq!(stage.prim.as_deref(), Some("/Render/Pass"));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_key() {
        for (text, parts) in [
            ("lamda = 4", ["unknown key lamda", "did you mean lambda?"]),
            ("passes.normals = \"N\"", ["unknown key passes.normals", "did you mean passes.normal?"]),
            ("lambda = \"4\"", ["lambda = \"4\"", "expected a number"]),
            ("lambda = 0.5", ["lambda = 0.5", "out of range"]),
            ("lambda = nan", ["lambda", "no value"]),
            ("lambda = [[1, 2], [1, 3]]", ["lambda", "two values"]),
            ("window = \"two\"", ["window", "two"]),
            ("window = -1", ["window = -1", "expected"]),
            ("frames = \"9-1\"", ["frames", "backwards"]),
            ("layers = 3", ["layers = 3", "a name or a list of names"]),
            ("guides = [\"colour\"]", ["guides", "albedo, normal, depth, vector"]),
            ("memory = \"much\"", ["memory", "no size"]),
            ("passes = 3", ["passes", "no table"]),
            ("usd = 3", ["usd", "no file name"]),
            ("lambda 4", ["hush.toml", "line 1"]),
        ] {
            let message = message("hush.toml", text);
            assert!(parts.iter().all(|part| message.contains(part)) && message.contains("hush.toml"), "{text}: {message}");
        }
        assert!(message("hush.json", "[1]").contains("hush.json: is no JSON object"));
        assert!(message("hush.json", "{\"lambda\": null}").contains("lambda has no value"));
        assert!(message("hush.toml", &"#".repeat(2 << 20)).contains("bytes long"));
    }

    #[test]
    fn two_side_files_contradict_each_other() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(beside(dir.path()).unwrap(), None);
        std::fs::write(dir.path().join("hush.json"), "{}").unwrap();
        assert_eq!(beside(dir.path()).unwrap(), Some(dir.path().join("hush.json")));
        std::fs::write(dir.path().join("hush.toml"), "").unwrap();
        let message = beside(dir.path()).unwrap_err().to_string();
        assert!(message.contains("hush.toml") && message.contains("hush.json"), "{message}");
    }
}
