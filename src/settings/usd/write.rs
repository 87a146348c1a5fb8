//! A layer that says a shot's settings, to lie over an existing stage or to stand by itself.

use std::path::{Component, Path};

use openusd::sdf::{self, AttributeSpec, FieldKey, PrimSpec, SpecType, Specifier, Value, Variability};
use openusd::usd::Stage;
use openusd::usda::TextWriter;

use super::attributes::frames_per_time_code;
use super::open::with_stage;
use super::prims::{self, PASS, words};
use super::values::escaped;
use crate::error::{Error, Result};
use crate::io::is_same_file;
use crate::rules::lambda::Lambda;
use crate::settings::Kind;
use crate::settings::layered::Layered;

/// The applied schema.
const API: &str = "HushAPI";
/// Where settings go that lie over no stage.
const OWN_PRIM: &str = "/Render/Denoise";
/// Metadata of a stage's root layer that do not come through a sublayer.
const KEPT: [&str; 9] = [
    "defaultPrim",
    "expressionVariables",
    "startTimeCode",
    "endTimeCode",
    "timeCodesPerSecond",
    "framesPerSecond",
    "metersPerUnit",
    "upAxis",
    "renderSettingsPrimPath",
];

/// What the layer needs to know of the stage below.
struct Below {
    /// None: it has no render prim.
    prim: Option<String>,
    metadata: Vec<(&'static str, Value)>,
    frames_per_time_code: f64,
    /// The files that the stage is made of.
    layers: Vec<String>,
}

/// The text of a `.usda` layer to be saved at `path`, with `settings` on the prim, over `sublayer` if there is one. Without a prim
/// it is the stage's only render prim, and a new `RenderPass` where there is none.
///
/// # Errors
/// The sublayer is or includes the file at `path`, cannot be read, or has no such prim or several to choose from; a prim path that is none.
pub fn write(path: &Path, settings: &Layered, prim: Option<&str>, sublayer: Option<&Path>) -> Result<String> {
    let below = sublayer.map(|file| with_stage(file, |stage| look_below(stage, prim))).transpose()?;
    if below.iter().flat_map(|below| &below.layers).any(|layer| is_same_file(Path::new(layer), path)) {
        return Err(Error::bad_file(
            path,
            "is a part of the stage that the layer is to lie over, and would be lost: name another file",
        ));
    }
    let (there, metadata, rate) = match below {
        Some(below) => (below.prim, below.metadata, below.frames_per_time_code),
        None => (prim.map(str::to_owned), Vec::new(), 1.0),
    };
    let own = there.is_none();
    let prim = there.unwrap_or_else(|| OWN_PRIM.into());
    author(path, settings, &prim, own, sublayer, &metadata, rate).map_err(|reason| Error::bad_file(path, reason))
}

fn look_below(stage: &Stage, prim: Option<&str>) -> Result<Below, String> {
    let bare = prim.is_none() && prims::is_bare(stage)?;
    let strongest = match bare {
        true => None,
        false => prims::choose(stage, prim)?.prims.last().map(|p| p.path().to_string()),
    };
    let mut metadata = Vec::new();
    for name in KEPT {
        metadata.extend(stage.stage_metadata(name).map_err(words)?.map(|value| (name, value)));
    }
    Ok(Below { prim: strongest, metadata, frames_per_time_code: frames_per_time_code(stage)?, layers: stage.layer_identifiers() })
}

fn author(
    path: &Path,
    settings: &Layered,
    prim: &str,
    own: bool,
    sublayer: Option<&Path>,
    metadata: &[(&'static str, Value)],
    frames_per_time_code: f64,
) -> Result<String, String> {
    let bad_prim = |e: String| format!("<{prim}> is no prim path: {e}");
    let place = sdf::Path::new(prim).map_err(|e| bad_prim(words(e)))?;
    if !place.is_abs() || place.is_abs_root() || place.is_property_path() || place.contains_prim_variant_selection() {
        return Err(bad_prim("write /Render/Pass".into()));
    }
    let mut data = sdf::Data::new();
    let root = data.create_spec(sdf::Path::abs_root(), SpecType::PseudoRoot);
    metadata.iter().for_each(|(name, value)| root.add(*name, value.clone()));
    if let Some(below) = sublayer {
        let name = relative(below, path);
        // Neither has an escape that openusd writes and USD reads.
        if name.contains("@@@") || name.contains('\n') || name.contains(":SDF_FORMAT_ARGS:") {
            return Err(format!("a layer cannot name {name:?} as one below it: rename that file or folder"));
        }
        root.add(FieldKey::SubLayers, Value::StringVec(vec![name]));
    }
    if own {
        let parent = place.parent().ok_or_else(|| bad_prim("it has no parent".into()))?;
        PrimSpec::new(&mut data, parent, Specifier::Def, "Scope").map_err(words)?;
        PrimSpec::new(&mut data, place.clone(), Specifier::Def, PASS).map_err(words)?;
    }
    PrimSpec::over(&mut data, place.clone()).map_err(words)?.add_applied_schema(API).map_err(words)?;
    for (setting, value) in settings.values.said() {
        let attribute = place.append_property(setting.usd).map_err(words)?;
        let lambda = (setting.kind == Kind::Lambda).then(|| serde_json::from_value::<Lambda>(value.clone()).ok()).flatten();
        let varying = if lambda.is_some() { Variability::Varying } else { Variability::Uniform };
        let mut spec = AttributeSpec::new(&mut data, attribute, setting.kind.usd_type(), varying, false).map_err(words)?;
        match lambda.as_ref().map(Lambda::keys) {
            Some([(_, value)]) => spec.set_default(Value::Float(*value)),
            Some(keys) => {
                keys.iter().for_each(|(frame, value)| spec.set_time_sample(frame / frames_per_time_code, Value::Float(*value)));
            }
            None => {
                let mut value = value;
                if let (Kind::Path, Some(file)) = (setting.kind, value.as_str().map(Path::new))
                    && file.is_relative()
                {
                    // What is relative to this folder becomes relative to the layer.
                    value = relative(file, path).into();
                }
                spec.set_default(value_of(&value, setting.kind.usd_type()));
            }
        }
    }
    let text = TextWriter::write_to_string(&data).map_err(words)?;
    // openusd leaves the brackets of a list of one away, and USD does not read that.
    Ok(text.replace(&format!("prepend apiSchemas = \"{API}\""), &format!("prepend apiSchemas = [\"{API}\"]")))
}

/// A setting as a value of a USD type.
fn value_of(value: &serde_json::Value, usd_type: &str) -> Value {
    let text = |v: &serde_json::Value| v.as_str().map_or_else(|| v.to_string(), escaped);
    match usd_type {
        "bool" => Value::Bool(value.as_bool().unwrap_or_default()),
        "int" => Value::Int(value.as_i64().and_then(|v| i32::try_from(v).ok()).unwrap_or_default()),
        "token" => Value::token(text(value)),
        "token[]" => Value::TokenVec(value.as_array().into_iter().flatten().map(|v| text(v).into()).collect()),
        _ => Value::String(text(value)),
    }
}

/// The path of `file` as a layer at `layer` names it: relative where they share a folder, so that both can be moved together.
fn relative(file: &Path, layer: &Path) -> String {
    let absolute = |p: &Path| std::path::absolute(p).unwrap_or_else(|_| p.to_owned());
    let (file, layer) = (absolute(file), absolute(layer));
    let folder = layer.parent().unwrap_or(Path::new(""));
    let shared = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let named = |c: &Component<'_>| matches!(c, Component::Normal(_));
    if !folder.components().take(shared).any(|c| named(&c)) {
        return file.to_string_lossy().into_owned();
    }
    let up = folder.components().skip(shared).map(|_| "..");
    let down: Vec<String> = file.components().skip(shared).map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
    let path = up.map(str::to_owned).chain(down).collect::<Vec<_>>().join("/");
    if path.starts_with("..") { path } else { format!("./{path}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_relative_where_folders_are_shared() {
        let mut cases = vec![
            ("/a/b/base.usda", "/a/b/over.usda", "./base.usda"),
            ("/a/b/c/base.usda", "/a/b/over.usda", "./c/base.usda"),
            ("/a/base.usda", "/a/b/over.usda", "../base.usda"),
        ];
        if cfg!(windows) {
            cases.push((r"D:\x\base.usda", r"C:\x\over.usda", r"D:\x\base.usda"));
            cases.push((r"D:\a\c\base.usda", r"D:\a\b\over.usda", "../c/base.usda"));
        } else {
            cases.push(("/x/base.usda", "/a/b/over.usda", "/x/base.usda"));
        }
        for (file, layer, expected) in cases {
            assert_eq!(relative(Path::new(file), Path::new(layer)), expected);
        }
    }
}
