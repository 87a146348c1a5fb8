//! Which layer says what an attribute is, and how that is complained of.

use std::path::PathBuf;

use openusd::sdf::{self, FieldKey};
use openusd::usd::Attribute;

use super::plain_path::plain;
use super::prims::words;

/// The strongest opinion on an attribute.
pub(super) struct Opinion {
    pub(super) layer: PathBuf,
    /// Where it stands in that layer.
    pub(super) path: sdf::Path,
    /// It has time samples; they count more than a default in the same layer.
    pub(super) samples: bool,
    /// It has a curve, which counts less than samples and more than a default.
    pub(super) spline: bool,
}

/// The first layer that says a value. openusd prefers the time samples of any layer, USD those of the strongest layer only.
pub(super) fn opinion(attribute: &Attribute) -> Result<Option<Opinion>, String> {
    let stage = attribute.stage();
    for (name, path) in attribute.property_stack().map_err(words)? {
        let Some(layer) = stage.layer(&name) else { continue };
        let Some(spec) = layer.attribute(path.clone()) else { continue };
        let samples = spec.has_field(FieldKey::TimeSamples.as_str());
        let spline = spec.has_field("spline");
        if samples || spline || spec.has_field(FieldKey::Default.as_str()) {
            return Ok(Some(Opinion { layer: name.into(), path, samples, spline }));
        }
    }
    Ok(None)
}

/// The layer that holds an attribute's strongest opinion, and the attribute's path.
pub(super) fn place(attribute: &Attribute) -> Result<(PathBuf, String), String> {
    let first = || Ok::<_, String>(attribute.property_stack().map_err(words)?.into_iter().next().map(|(layer, _)| layer.into()));
    let layer = opinion(attribute)?.map(|o| o.layer).map_or_else(first, |layer| Ok(Some(layer)))?;
    Ok((plain(layer.unwrap_or_default()), attribute.path().to_string()))
}

/// `FILE: </Prim.attribute> …`, without the file where it is the stage's own, which the error names anyway.
pub(super) fn complaint(attribute: &Attribute, what: &str) -> String {
    let root = plain(attribute.stage().root_layer().identifier());
    let file = place(attribute).map(|(file, _)| file).unwrap_or_default();
    let inside = if file.as_os_str().is_empty() || file == root { String::new() } else { format!(" (in {})", file.display()) };
    format!("<{}> {what}{inside}", attribute.path())
}
