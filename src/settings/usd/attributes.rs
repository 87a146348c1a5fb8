//! The `hush:` attributes of one prim, and `denoise:enable`.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use openusd::sdf::{Value, expr};
use openusd::usd::{Attribute, Prim, Stage};
use serde_json::json;

use super::gaps;
use super::opinions::{Opinion, complaint, opinion, place};
use super::prims::words;
use super::values::{as_json, as_meant, number, text};
use crate::settings::layered::{Layered, Origin};
use crate::settings::nearest::hint;
use crate::settings::{Kind, SETTINGS, Setting, ShotSettings, Unfit};

const OURS: &str = "hush:";

/// The settings of a prim. Attributes in the `hush:` namespace that no setting has become notes.
pub(super) fn read(stage: &Stage, prim: &Prim) -> Result<Layered, String> {
    let mut all = Layered::default();
    let names = prim.property_names().map_err(words)?;
    let setting_of = |name: &str| SETTINGS.iter().find(|s| s.usd == name);
    if names.iter().any(|name| setting_of(name).is_some()) {
        gaps::no_clips(prim)?;
    }
    for name in names {
        let setting = setting_of(&name);
        if setting.is_none() && !name.starts_with(OURS) {
            continue;
        }
        let attribute = prim.attribute(&*name);
        let Some(setting) = setting else {
            let valid = SETTINGS.iter().map(|s| s.usd).filter(|n| n.starts_with(OURS));
            let (file, where_) = place(&attribute)?;
            all.notes.push(format!("{}: <{where_}> is no setting of Hush{}", file.display(), hint(&name, valid)));
            continue;
        };
        let mut one = Layered::default();
        if set(stage, &attribute, setting, &mut one.values)? {
            let (file, _) = place(&attribute)?;
            let origin = || Origin::Usd { file: file.clone(), prim: prim.path().to_string(), attribute: name.to_string() };
            all = Layered::new(one.values, |_| origin()).over(all);
        }
    }
    Ok(all)
}

/// The time samples of an attribute, none where a stronger layer has a constant value.
pub(super) fn samples(attribute: &Attribute) -> Result<Vec<(f64, Value)>, String> {
    let Some(Opinion { layer, path, samples, spline }) = opinion(attribute)? else { return Ok(Vec::new()) };
    if !samples {
        let curve = || complaint(attribute, "is a spline, which is not evaluated here: bake it to time samples, one a frame");
        return if spline { Err(curve()) } else { Ok(Vec::new()) };
    }
    gaps::times_hold(attribute, &path)?;
    let samples = attribute.time_samples().map_err(words)?.unwrap_or_default();
    Ok(samples.into_iter().map(|(time, value)| (time, as_meant(value, &layer))).collect())
}

/// The value of an attribute that stays the same over time; None where nothing is authored.
pub(super) fn constant(attribute: &Attribute) -> Result<Option<Value>, String> {
    if !samples(attribute)?.is_empty() {
        return Err(complaint(
            attribute,
            "has time samples, and only hush:lambda and hush:lambdaMasked may change over the shot",
        ));
    }
    value(attribute)
}

/// The default value of an attribute; None where there is none, or where it is blocked.
pub(super) fn value(attribute: &Attribute) -> Result<Option<Value>, String> {
    // openusd panics at an empty string[] of a crate file.
    let got = catch_unwind(AssertUnwindSafe(|| attribute.get::<Value>())).map_err(|_| {
        let advice = "cannot be read; if it is an empty string[] in a .usdc, make it a token[], or block it";
        complaint(attribute, advice)
    })?;
    let value = got.map_err(words)?.filter(|v| !matches!(v, Value::ValueBlock));
    if let Some(Value::AssetPath(path)) = &value
        && expr::is_expression(path.as_str())
    {
        return Err(complaint(attribute, "is a variable expression, which is not evaluated here: write the path itself"));
    }
    let layer = opinion(attribute)?.map(|o| o.layer).unwrap_or_default();
    Ok(value.map(|value| as_meant(value, &layer)))
}

/// Reads one attribute into the settings; false where it has no value.
fn set(stage: &Stage, attribute: &Attribute, setting: &Setting, into: &mut ShotSettings) -> Result<bool, String> {
    let samples = if setting.kind == Kind::Lambda { samples(attribute)? } else { Vec::new() };
    let (value, shown) = if samples.is_empty() {
        let Some(value) = constant(attribute)? else { return Ok(false) };
        (as_json(&value), shown(attribute, &value))
    } else {
        let frames = frames_per_time_code(stage)?;
        let key = |(time, value): &(f64, Value)| json!([time * frames, as_json(value)]);
        (samples.iter().map(key).collect(), "time samples".into())
    };
    let value = match value.as_str() {
        Some(path) if setting.kind == Kind::Path => anchored(attribute, path)?.to_string_lossy().into(),
        _ => value,
    };
    into.set(setting.name, value).map_err(|unfit| match unfit {
        Unfit::Type(expected) => complaint(attribute, &format!("is {shown}, expected {expected}")),
        other => complaint(attribute, &other.to_string()),
    })?;
    Ok(true)
}

/// Time codes are frames, unless the stage says both how many frames and how many time codes a second has.
pub(super) fn frames_per_time_code(stage: &Stage) -> Result<f64, String> {
    let rate = |name: &str| Ok::<_, String>(stage.stage_metadata(name).map_err(words)?.as_ref().and_then(number));
    let sound = |rate: &f64| rate.is_finite() && *rate > 0.0;
    match (rate("framesPerSecond")?.filter(sound), rate("timeCodesPerSecond")?.filter(sound)) {
        (Some(frames), Some(codes)) => Ok(frames / codes),
        _ => Ok(1.0),
    }
}

/// A path as it is meant: relative to the layer that says it.
fn anchored(attribute: &Attribute, path: &str) -> Result<PathBuf, String> {
    let (file, _) = place(attribute)?;
    if path.is_empty() {
        return Err(complaint(attribute, "is empty"));
    }
    if Path::new(path).is_absolute() {
        return Ok(path.into());
    }
    // The path of an asset is absolute by now, unless its layer lies in a package.
    let packaged = file.to_string_lossy().contains('[') || file.extension().is_some_and(|e| e.eq_ignore_ascii_case("usdz"));
    if packaged {
        return Err(complaint(attribute, "is a relative path in a usdz package, where no frames can be: make it absolute"));
    }
    Ok(file.parent().unwrap_or(Path::new("")).join(path))
}

/// A value and its type, for messages.
fn shown(attribute: &Attribute, value: &Value) -> String {
    let kind = attribute.type_name().ok().flatten().map(|t| t.to_string()).unwrap_or_default();
    let value = text(value).map(|t| format!("{t:?}")).or_else(|| number(value).map(|n| n.to_string()));
    format!("{kind} {}", value.unwrap_or_else(|| "value".into())).trim().to_owned()
}
