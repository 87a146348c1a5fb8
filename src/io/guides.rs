//! Finding the guides: albedo, normal, depth and motion vectors.

use super::layout::{Layout, ViewLayer};
use super::names::DENOISING_DEPTH;
use super::pass_names;
use super::resolved::{DataWindow, Missing, PassRef};
use super::selection::{Selection, made_for_vectors};
use super::view_layers::missing_layer;
use crate::error::{Error, Result};

const DENOISING_DATA: &str = "enable View Layer › Passes › Data › Denoising Data";
const ALBEDO_LETTERS: &[&[&str]] = &[&["R", "G", "B"]];
const NORMAL_LETTERS: &[&[&str]] = &[&["X", "Y", "Z"], &["R", "G", "B"]];
const DEPTH_LETTERS: &[&[&str]] = &[&["Z"], &["V"], &["R"], &["X"], &["Y"], &["T"]];
const VECTOR_LETTERS: &[&[&str]] = &[&["X", "Y", "Z", "W"], &["R", "G", "B", "A"]];
const VECTOR: &str = "enable View Layer › Passes › Data › Vector (it needs Motion Blur switched off)";

/// The guides of a layer and view, those that were wanted and are not there.
pub(super) struct FoundGuides {
    pub albedo: Option<PassRef>,
    pub normal: Option<PassRef>,
    pub depth: Option<PassRef>,
    pub vector: Option<PassRef>,
    pub missing: Vec<Missing>,
}

/// Finds the guides that a selection wants, with the beauty's data window.
///
/// # Errors
/// [`Error::MissingPass`] if the view layer named for the vectors is not there or has none.
pub(super) fn find(
    layout: &Layout,
    layer: &ViewLayer,
    view: Option<&str>,
    selection: &Selection,
    window: Option<DataWindow>,
) -> Result<FoundGuides> {
    let mut finder = GuideFinder { layout, layer, view, window, missing: Vec::new() };
    let (wanted, names) = (selection.guides, &selection.passes);
    let mut find = |wanted: bool, own: &Option<String>, names: &[&str], letters: &[&[&str]]| {
        wanted.then(|| finder.find(own.as_deref(), names, letters, DENOISING_DATA)).flatten()
    };
    let albedo = find(wanted.albedo, &names.albedo, &["Denoising Albedo"], ALBEDO_LETTERS);
    let normal = find(wanted.normal, &names.normal, &["Denoising Normal"], NORMAL_LETTERS);
    let depth = find(wanted.depth, &names.depth, &[DENOISING_DEPTH, "Depth"], DEPTH_LETTERS);
    let vector = if wanted.vector { vector(layout, selection, &mut finder)? } else { None };
    Ok(FoundGuides { albedo, normal, depth, vector, missing: finder.missing })
}

impl FoundGuides {
    /// Whether the compression of any changed its numbers by much.
    pub fn are_lossy(&self, layout: &Layout) -> bool {
        let passes = [&self.albedo, &self.normal, &self.depth, &self.vector].into_iter().flatten();
        let mut parts = passes.filter_map(|pass| layout.part_list.get(pass.channels.first()?.part));
        parts.any(|part| part.lossy && part.compression != "PXR24")
    }
}

struct GuideFinder<'a> {
    layout: &'a Layout,
    layer: &'a ViewLayer,
    view: Option<&'a str>,
    window: Option<DataWindow>,
    missing: Vec<Missing>,
}

impl GuideFinder<'_> {
    /// The pass that the user calls `own`, else the first of `names`, that has one of the sets of `letters`.
    fn find(&mut self, own: Option<&str>, names: &[&str], letters: &[&[&str]], advice: &str) -> Option<PassRef> {
        let mut reason = own.map_or_else(|| advice.to_owned(), |_| pass_names::there(self.layout));
        let names = if own.is_some() { own.as_slice() } else { names };
        for name in names {
            let pass = self.layer.pass(name, self.view);
            let Some(pass) = pass.or_else(|| own.and_then(|n| pass_names::anywhere(self.layout, self.layer, n, self.view)))
            else {
                continue;
            };
            let Some(channels) = letters.iter().find_map(|set| pass.components(set)) else {
                reason = format!("the pass is there, but not with the channels {}", letters[0].join(", "));
                continue;
            };
            let found = PassRef::new(self.layer, pass, channels);
            if found.data_window(self.layout) == self.window {
                return Some(found);
            }
            reason = "the pass is there, but in another size than the image".into();
        }
        let pass = names.first().copied().unwrap_or_default().to_owned();
        self.missing.push(Missing { pass, advice: reason });
        None
    }
}

fn vector<'a>(layout: &'a Layout, selection: &Selection, guides: &mut GuideFinder<'a>) -> Result<Option<PassRef>> {
    let own_layer = guides.layer;
    if selection.vector_layer.is_none() && selection.passes.vector.is_none() {
        for layer in layout.layers.iter().filter(|l| made_for_vectors(&l.name)) {
            guides.layer = layer;
            let (missing, found) = (guides.missing.len(), guides.find(None, &["Vector"], VECTOR_LETTERS, VECTOR));
            guides.layer = own_layer;
            guides.missing.truncate(missing);
            if found.is_some() {
                return Ok(found);
            }
        }
    }
    if let Some(name) = &selection.vector_layer {
        guides.layer = layout.layer(name).ok_or_else(|| missing_layer(layout, name))?;
    }
    let found = guides.find(selection.passes.vector.as_deref(), &["Vector"], VECTOR_LETTERS, VECTOR);
    let searched = std::mem::replace(&mut guides.layer, own_layer);
    let (None, Some(missing)) = (&found, guides.missing.last_mut()) else {
        return Ok(found);
    };
    if searched.pass("Vector", guides.view).is_some_and(|p| p.channel("X").is_some() && p.channel("W").is_none()) {
        missing.advice = "the pass is there, but without W: give the File Output node's Vector input four dimensions".into();
    }
    if selection.vector_layer.is_some() {
        let path = layout.path.clone();
        return Err(Error::MissingPass { path, pass: format!("{}.Vector", searched.name), advice: missing.advice.clone() });
    }
    let elsewhere = layout.layers.iter().find(|l| l.pass("Vector", guides.view).is_some() && l.name != searched.name);
    if let Some(layer) = elsewhere {
        missing.advice.push_str(&format!("; the view layer {0} has one: set vector layer to '{0}'", layer.name));
    }
    Ok(found)
}
