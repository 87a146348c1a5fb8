//! `hush.toml`: the settings beside the frames.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::kind::{Kind, Unfit};
use super::layered::{Layered, Origin};
use super::setting::Setting;
use super::usd::StageRef;
use crate::error::{Error, Result};

/// The settings file's name beside the frames.
pub const SETTINGS_FILE: &str = "hush.toml";
/// The key that names a stage.
const USD: &str = "usd";
/// No settings are longer.
const MAX_BYTES: u64 = 1 << 20;

/// What a settings file holds.
#[derive(Clone, Debug)]
pub struct SettingsFile {
    /// The settings; paths are taken from the file's folder.
    pub settings: Layered,
    /// The stage that its key `usd` names.
    pub usd: Option<StageRef>,
}

/// The settings file in a folder, if there is one; also where it cannot be read.
pub(super) fn beside(folder: &Path) -> Option<PathBuf> {
    let is_absent = |path: &Path| std::fs::symlink_metadata(path).is_err_and(|e| e.kind() == ErrorKind::NotFound);
    Some(folder.join(SETTINGS_FILE)).filter(|path| !is_absent(path))
}

/// Reads a settings file.
///
/// # Errors
/// [`Error::Io`]; [`Error::BadFile`] naming the key: syntax, an unknown key (with the nearest valid one), a value of the wrong
/// type or out of range.
pub fn read_settings_file(path: &Path) -> Result<SettingsFile> {
    let bad = |reason: String| Error::bad_file(path, reason);
    let size = match std::fs::metadata(path) {
        Ok(about) => about.len(),
        Err(_) if path.is_symlink() => return Err(bad("is a link to a file that cannot be reached: mend or remove it".into())),
        Err(e) => return Err(Error::io(path, e)),
    };
    if size > MAX_BYTES {
        return Err(bad(format!("is {size} bytes long, which no settings are")));
    }
    let text = std::fs::read_to_string(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::InvalidData => bad("is no UTF-8: save it with that encoding".into()),
        _ => Error::io(path, e),
    })?;
    let mut table: Map<String, Value> = toml::from_str(&text).map_err(|e| {
        let backslash = if text.contains('\\') { "; paths of Windows stand in single quotes, or are written with /" } else { "" };
        bad(format!("is no TOML: {}{backslash}", e.to_string().trim_end()))
    })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let usd = match table.remove(USD) {
        None => None,
        Some(Value::String(stage)) => Some(stage.parse::<StageRef>().map_err(|e| bad(format!("{USD}: {e}")))?.from(folder)),
        Some(other) => return Err(bad(format!("{USD}: {other} is no file name"))),
    };
    for (name, value) in &mut table {
        let read: Option<Value> = match (Setting::named(name), &*value) {
            (Ok(Setting { kind: Kind::Path, .. }), Value::String(file)) => Some(folder.join(file).to_string_lossy().into()),
            // A number that a person wrote is read as a text is: 4 is no size.
            (Ok(Setting { kind: Kind::Size, .. }), Value::Number(size)) => Some(size.to_string().into()),
            _ => None,
        };
        if let Some(read) = read {
            *value = read;
        }
    }
    let origin = |key: &str| Origin::SettingsFile { file: path.into(), key: key.into() };
    let settings = Layered::of_table(table, origin).map_err(|(key, value, unfit)| match unfit {
        Unfit::Unknown(reason) => bad(reason),
        unfit => bad(format!("{key} = {value}: {unfit}")),
    })?;
    Ok(SettingsFile { settings, usd })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<SettingsFile> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join(SETTINGS_FILE), text).unwrap();
        read_settings_file(&dir.path().join(SETTINGS_FILE))
    }

    fn message(text: &str) -> String {
        read(text).expect_err(text).to_string()
    }

    #[test]
    fn settings_are_read_with_where_they_stand() {
        let file = read(
            "lambda = [[1, 1], [24.5, 8]]\nwindow = 1\nframes = \"1-48,60\"\nlayers = \"all\"\nmemory = \"4G\"\n\
             guides = [\"albedo\", \"depth\"]\naovs = [\"Diffuse Direct\"]\nskip = \"none\"\n[passes]\nbeauty = \"C\"\n",
        );
        let settings = file.unwrap().settings;
        assert_eq!(settings.values.lambda.as_ref().unwrap().to_string(), "1:1,24.5:8");
        assert_eq!((settings.values.memory, settings.values.skip.as_deref()), (Some(4 << 30), Some([].as_slice())));
        assert_eq!(settings.values.layers.as_deref(), Some(["all".to_owned()].as_slice()));
        assert!(settings.origin("passes.beauty").to_string().ends_with("hush.toml, passes.beauty"));
    }

    #[test]
    fn only_a_file_that_is_not_there_is_absent() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(beside(dir.path()), None);
        let path = dir.path().join(SETTINGS_FILE);
        std::fs::create_dir(&path).unwrap();
        assert!(beside(dir.path()).is_some() && read_settings_file(&path).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn a_dead_link_is_no_absent_file() {
        let dir = tempfile::tempdir().unwrap();
        let (path, real) = (dir.path().join(SETTINGS_FILE), dir.path().join("shared.toml"));
        std::os::unix::fs::symlink(&real, &path).unwrap();
        assert_eq!(beside(dir.path()), Some(path.clone()));
        let error = read_settings_file(&path).unwrap_err().to_string();
        assert!(error.contains(SETTINGS_FILE) && error.contains("is a link"), "{error}");
        std::fs::write(real, "window = 1").unwrap();
        assert_eq!(read_settings_file(&path).unwrap().settings.values.window, Some(1));
    }

    #[test]
    fn paths_are_taken_from_the_files_folder() {
        let file = read("output = \"../clean\"\nmodel = \"/abs/m.safetensors\"\nusd = \"a/shot.usda@/Render/Pass\"").unwrap();
        let values = file.settings.values;
        assert!(values.output.as_ref().is_some_and(|p| p.is_absolute() && p.ends_with("../clean")));
        // On the file's drive where there are drives.
        let root = std::env::temp_dir().ancestors().last().map(Path::to_owned);
        assert_eq!(values.model, root.map(|root| root.join("abs/m.safetensors")));
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
            ("window = -1", ["window = -1", "out of range"]),
            ("frames = \"9-1\"", ["frames", "backwards"]),
            ("layers = 3", ["layers = 3", "a name or a list of names"]),
            ("guides = [\"colour\"]", ["guides", "albedo, normal, depth, vector"]),
            ("memory = \"much\"", ["memory", "no size"]),
            ("memory = 4", ["memory = \"4\"", "'4' is no size: write 4G"]),
            ("output = \"D:\\shots\"", ["is no TOML", "single quotes"]),
            ("passes = 3", ["passes = 3", "a table with a name for each pass"]),
            ("usd = 3", ["usd", "no file name"]),
            ("lambda 4", ["hush.toml", "line 1"]),
        ] {
            let message = message(text);
            assert!(parts.iter().all(|part| message.contains(part)) && message.contains("hush.toml"), "{text}: {message}");
        }
        assert!(message(&"#".repeat(2 << 20)).contains("bytes long"));
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(SETTINGS_FILE);
        std::fs::write(&path, b"\xff\xfew\0i\0").unwrap();
        assert!(read_settings_file(&path).unwrap_err().to_string().contains("no UTF-8: save it with that encoding"));
    }
}
