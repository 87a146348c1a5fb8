//! The passes' names where another renderer than Blender gave them.

use serde::{Deserialize, Serialize};

use super::layout::{Layout, Pass, ViewLayer};

/// Names of passes as the file has them: the part of the channel names before the last dot, such as `N` of `N.X`; `Layer.Pass`
/// where several layers hold the name. None: Blender's name. A name that the file lacks is an error for the beauty, and counts
/// as a missing guide for the others.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PassNames {
    /// R, G, B and perhaps A.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beauty: Option<String>,
    /// R, G, B: what `Denoising Albedo` holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub albedo: Option<String>,
    /// X, Y, Z or R, G, B.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal: Option<String>,
    /// One channel: Z, V, R, X, Y or T.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth: Option<String>,
    /// Four channels as Cycles has them: pixels from the previous frame to this one, and from this one to the next.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vector: Option<String>,
}

impl PassNames {
    /// Whether all names are Blender's.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// The pass called `name` or `Layer.name` in a layer.
pub(crate) fn find<'a>(layer: &'a ViewLayer, name: &str, view: Option<&str>) -> Option<&'a Pass> {
    let short = name.strip_prefix(layer.name.as_str()).and_then(|rest| rest.strip_prefix('.'));
    layer.pass(name, view).or_else(|| layer.pass(short?, view))
}

/// As [`find`], in this layer and then in all the others: renderers whose pass names hold dots seem to have layers. A plain
/// channel such as `Z` counts as a pass of that name.
pub(crate) fn anywhere<'a>(layout: &'a Layout, layer: &'a ViewLayer, name: &str, view: Option<&str>) -> Option<&'a Pass> {
    let plain = || layer.pass("", view).filter(|p| p.channel(name).is_some());
    find(layer, name, view).or_else(|| layout.layers.iter().find_map(|l| find(l, name, view))).or_else(plain)
}

/// `its passes are …`, for messages.
pub(crate) fn there(layout: &Layout) -> String {
    let mut names: Vec<String> = Vec::new();
    for (layer, pass) in layout.layers.iter().flat_map(|l| l.passes.iter().map(move |p| (l, p))) {
        let parts = [layer.name.as_str(), pass.name.as_str()];
        let name = parts.into_iter().filter(|n| !n.is_empty()).collect::<Vec<_>>().join(".");
        let name = if name.is_empty() { "(plain RGB)".into() } else { name };
        if !names.contains(&name) {
            names.push(name);
        }
    }
    format!("its passes are {}", names.join(", "))
}
