//! Which of a file's passes feed the denoiser, and which pass receives the result.

use serde::Serialize;

use super::layout::{Channel, Layout, Pass, SampleType, ViewLayer};
use super::lights;
use super::pass_names::{self, PassNames};
use crate::error::{Error, Result};

/// The pass that holds the noisy beauty where Cycles denoised Combined.
pub(crate) const NOISY: &str = "Noisy Image";
/// The view layer that the extension's Prepare Shot adds for motion vectors, where the others have motion blur.
const VECTOR_LAYER: &str = "Hush Vectors";
/// Stands for all view layers.
const ALL: &str = "all";
/// Passes that hold the beauty: Blender's, a File Output node's, a plain image's, other writers'.
const BEAUTY: [&str; 7] = ["Combined", "Image", "", "Beauty", "beauty", "RGBA", "rgba"];

/// Which guides may be used where they are present.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Guides {
    pub albedo: bool,
    pub normal: bool,
    pub depth: bool,
    pub vector: bool,
}

impl Default for Guides {
    fn default() -> Self {
        Self { albedo: true, normal: true, depth: true, vector: true }
    }
}

/// What the user asks for. The default takes the view layer with the most samples, all its views and every guide.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// View layers to denoise, or `all`, which leaves out `vector_layer`. Empty: the one with the most samples. A view layer made
    /// for motion vectors, [`made_for_vectors`], is denoised only where it is named.
    pub layers: Vec<String>,
    /// Stereo view to denoise.
    pub view: Option<String>,
    /// Another view layer to take the Vector pass from (one without motion blur). None: the one [`made_for_vectors`] where the
    /// file holds one, else the layer that is denoised.
    pub vector_layer: Option<String>,
    pub guides: Guides,
    /// Light passes to denoise along with the beauty, by Blender 5's or 4's names, or `all`.
    pub aovs: Vec<String>,
    /// What the passes are called, where not as Blender calls them.
    pub passes: PassNames,
    /// Denoise `Combined` even where the file also holds `Noisy Image`, that is, where `Combined` is denoised already.
    pub denoised_ok: bool,
}

/// Whether a view layer is the one that the extension's Prepare Shot adds for motion vectors: `Hush Vectors`, or `Hush
/// Vectors.001` where there was one of that name.
pub fn made_for_vectors(layer: &str) -> bool {
    let number = |rest: &str| rest.strip_prefix('.').is_some_and(|n| n.len() >= 3 && n.bytes().all(|b| b.is_ascii_digit()));
    layer.strip_prefix(VECTOR_LAYER).is_some_and(|rest| rest.is_empty() || number(rest))
}

/// A pass with the channels that are used of it, in the order that the frame wants.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PassRef {
    pub layer: String,
    pub pass: String,
    pub view: Option<String>,
    pub channels: Vec<Channel>,
}

impl PassRef {
    fn new(layer: &ViewLayer, pass: &Pass, channels: Vec<Channel>) -> Self {
        Self { layer: layer.name.clone(), pass: pass.name.clone(), view: pass.view.clone(), channels }
    }

    /// Such as `ViewLayer.Combined (left)`.
    pub fn label(&self) -> String {
        let names: Vec<&str> = [self.layer.as_str(), self.pass.as_str()].into_iter().filter(|n| !n.is_empty()).collect();
        let name = if names.is_empty() { "RGB".to_owned() } else { names.join(".") };
        self.view.as_ref().map_or(name.clone(), |view| format!("{name} ({view})"))
    }
}

/// A light pass that is denoised along: its contribution to the beauty is `pass`, or `pass` × `colour`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct AovRef {
    /// As the user gave it; the file's own name for `all`.
    pub name: String,
    pub pass: PassRef,
    pub colour: Option<PassRef>,
}

/// A pass that would help and is not there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Missing {
    pub pass: String,
    /// How to get it, in Blender's words.
    pub advice: String,
}

/// What is read, what is written, and what is missing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Resolved {
    pub layer: String,
    pub view: Option<String>,
    /// Of every pass that is used.
    pub columns: usize,
    pub rows: usize,
    /// The noisy beauty, R, G, B.
    pub colour: PassRef,
    /// The alpha channel beside it.
    pub alpha: Option<Channel>,
    /// The pass that is replaced by the denoised beauty, R, G, B; the same as `colour` unless that is `Noisy Image`.
    pub target: PassRef,
    pub target_alpha: Option<Channel>,
    /// Whether `colour` is certain to be noisy: it is `Noisy Image`, or Blender stored its denoising passes without one. Where
    /// false, nothing in the file tells whether Cycles denoised it.
    pub surely_noisy: bool,
    pub albedo: Option<PassRef>,
    pub normal: Option<PassRef>,
    pub depth: Option<PassRef>,
    /// X, Y, Z, W.
    pub vector: Option<PassRef>,
    pub aovs: Vec<AovRef>,
    /// Guides that were asked for and are not there.
    pub missing: Vec<Missing>,
    /// What the user should know about these choices.
    pub notes: Vec<String>,
}

impl Resolved {
    /// Every channel that is read.
    pub fn channels(&self) -> impl Iterator<Item = &Channel> {
        let guides = [&self.albedo, &self.normal, &self.depth, &self.vector].into_iter().flatten();
        let lights = self.aovs.iter().flat_map(|a| [Some(&a.pass), a.colour.as_ref()]).flatten();
        [&self.colour].into_iter().chain(guides).chain(lights).flat_map(|p| &p.channels).chain(&self.alpha)
    }
}

/// Decides what is read and written.
///
/// # Errors
/// [`Error::MissingPass`] if the file has no beauty, or lacks a layer, view or light pass that was asked for.
pub fn resolve(layout: &Layout, selection: &Selection) -> Result<Resolved> {
    let layer = pick_layer(layout, selection)?;
    let view = pick_view(layout, layer, selection)?;
    let names = &selection.passes;
    let beauty = beauty(layer, view, names);
    let noisy = layer.pass(NOISY, view).filter(|p| rgb(p).is_some() && (!selection.denoised_ok || beauty.is_none()));
    // Who names the beauty means that pass and no other.
    let noisy = noisy.filter(|_| names.beauty.is_none());
    let Some(colour) = noisy.or(beauty) else {
        return Err(no_beauty(layout, layer, names));
    };
    let target = beauty.unwrap_or(colour);
    let mut notes = Vec::new();
    if noisy.is_some() && beauty.is_none() {
        notes.push("The file holds Noisy Image but no Combined: Noisy Image itself is replaced.".into());
    }
    let pass_ref = |pass: &Pass, channels| PassRef::new(layer, pass, channels);
    let rgb_ref = |pass: &Pass| rgb(pass).map(|channels| pass_ref(pass, channels)).ok_or_else(|| no_beauty(layout, layer, names));
    let colour_ref = rgb_ref(colour)?;
    let part = colour_ref.channels.first().and_then(|c| layout.part_list.get(c.part));
    let (columns, rows) = part.map_or((layout.columns, layout.rows), |p| (p.columns, p.rows));

    let mut guides = GuideFinder { layout, layer, view, window: window_of(layout, &colour_ref), missing: Vec::new() };
    let wanted = selection.guides;
    let mut find = |wanted: bool, own: &Option<String>, names: &[&str], letters: &[&[&str]]| {
        wanted.then(|| guides.find(own.as_deref(), names, letters, DENOISING_DATA)).flatten()
    };
    let albedo = find(wanted.albedo, &names.albedo, &["Denoising Albedo"], &[&["R", "G", "B"]]);
    let normal = find(wanted.normal, &names.normal, &["Denoising Normal"], &[&["X", "Y", "Z"], &["R", "G", "B"]]);
    let depth_letters: &[&[&str]] = &[&["Z"], &["V"], &["R"], &["X"], &["Y"], &["T"]];
    let depth = find(wanted.depth, &names.depth, &["Denoising Depth", "Depth"], depth_letters);
    let vector = match wanted.vector {
        true => vector(layout, selection, &mut guides)?,
        false => None,
    };
    let missing_guides = std::mem::take(&mut guides.missing);
    let (aovs, missing_lights) = lights::find(layout, layer, view, &selection.aovs, guides.window)?;

    let others = candidates(layout, names).filter(|l| is_ordinary(l)).map(|l| l.name.as_str());
    let others: Vec<&str> = others.filter(|n| *n != layer.name).collect();
    if selection.layers.is_empty() && !others.is_empty() {
        notes.push(format!(
            "The file holds several view layers; {} is denoised, {} stays as it is.",
            layer.name,
            others.join(", ")
        ));
    }
    let other_views: Vec<&str> = layer.views.iter().map(String::as_str).filter(|v| Some(*v) != view).collect();
    if let (None, Some(view), false) = (&selection.view, view, other_views.is_empty()) {
        notes.push(format!("The file holds several views; this is {view}, beside {}.", other_views.join(", ")));
    }
    if [&albedo, &normal, &depth, &vector].iter().any(|guide| lossy(layout, guide)) {
        notes.push(
            "The guides went through lossy compression (DWA or B44), which blurs edges: save with ZIP or PIZ for a better result."
                .into(),
        );
    }
    Ok(Resolved {
        layer: layer.name.clone(),
        view: view.map(str::to_owned),
        columns,
        rows,
        alpha: colour.channel("A").cloned(),
        target_alpha: target.channel("A").cloned(),
        target: rgb_ref(target)?,
        surely_noisy: noisy.is_some()
            || names.beauty.is_some()
            || (layer.pass(NOISY, view).is_none() && layer.pass("Denoising Albedo", view).is_some()),
        colour: colour_ref,
        albedo,
        normal,
        depth,
        vector,
        aovs,
        missing: missing_guides.into_iter().chain(missing_lights).collect(),
        notes,
    })
}

/// As [`resolve`], once for each view layer that the selection names, and for each stereo view where it names none, so that a
/// file is denoised as a whole.
///
/// # Errors
/// As [`resolve`]; [`Error::MissingPass`] if `all` finds no view layer with a beauty.
pub fn resolve_views(layout: &Layout, selection: &Selection) -> Result<Vec<Resolved>> {
    let mut found: Vec<Resolved> = Vec::new();
    for layer in pick_layers(layout, selection)? {
        let views = layer.views.iter().map(|v| Some(v.clone())).collect::<Vec<_>>();
        let views = if selection.view.is_some() || views.is_empty() { vec![selection.view.clone()] } else { views };
        // Only where no layer was named does `resolve` tell of the others.
        let layers = if selection.layers.is_empty() { Vec::new() } else { vec![layer.name.clone()] };
        for view in views {
            found.push(resolve(layout, &Selection { layers: layers.clone(), view, ..selection.clone() })?);
        }
    }
    Ok(found)
}

const DENOISING_DATA: &str = "enable View Layer › Passes › Data › Denoising Data";
const VECTOR_LETTERS: &[&[&str]] = &[&["X", "Y", "Z", "W"], &["R", "G", "B", "A"]];
const VECTOR: &str = "enable View Layer › Passes › Data › Vector (it needs Motion Blur switched off)";

/// The channels R, G, B of a pass, if they are numbers with a fraction.
pub(crate) fn rgb(pass: &Pass) -> Option<Vec<Channel>> {
    pass.components(&["R", "G", "B"]).filter(|channels| channels.iter().all(|c| c.sample != SampleType::Uint))
}

fn beauty<'a>(layer: &'a ViewLayer, view: Option<&str>, names: &PassNames) -> Option<&'a Pass> {
    if let Some(name) = &names.beauty {
        return pass_names::find(layer, name, view).filter(|p| rgb(p).is_some());
    }
    let named = BEAUTY.iter().find_map(|name| layer.pass(name, view).filter(|p| rgb(p).is_some()));
    // A File Output node's layers may have any name: take the only one with colour and alpha.
    named.or_else(|| {
        let mut others = layer.passes.iter().filter(|p| {
            p.view.as_deref() == view
                && p.name != NOISY
                && !p.name.starts_with("Denoising")
                && p.channel("A").is_some()
                && rgb(p).is_some()
        });
        let only = others.next().filter(|_| layer.name.is_empty());
        only.filter(|_| others.next().is_none())
    })
}

/// The layers that hold a beauty.
fn candidates<'a>(layout: &'a Layout, names: &PassNames) -> impl Iterator<Item = &'a ViewLayer> {
    layout.layers.iter().filter(|layer| {
        let views = layer.views.iter().map(|v| Some(v.as_str())).chain([None]);
        let noisy = |view| names.beauty.is_none() && layer.pass(NOISY, view).is_some_and(|p| rgb(p).is_some());
        views.into_iter().any(|view| beauty(layer, view, names).is_some() || noisy(view))
    })
}

/// Whether a layer is one that an artist made, and so is denoised without being named.
fn is_ordinary(layer: &ViewLayer) -> bool {
    !made_for_vectors(&layer.name) && !layer.is_composite()
}

/// The layers to denoise, each once, in the file's order for `all`, else as they were named.
fn pick_layers<'a>(layout: &'a Layout, selection: &Selection) -> Result<Vec<&'a ViewLayer>> {
    if selection.layers.is_empty() {
        return Ok(vec![pick_layer(layout, selection)?]);
    }
    let mut picked: Vec<&ViewLayer> = Vec::new();
    for name in &selection.layers {
        let named: Vec<&ViewLayer> = match layout.layer(name) {
            Some(layer) => vec![layer],
            None if name == ALL => {
                let for_vectors = selection.vector_layer.as_ref();
                candidates(layout, &selection.passes).filter(|l| is_ordinary(l) && Some(&l.name) != for_vectors).collect()
            }
            None => return Err(missing_layer(layout, name)),
        };
        let new = named.into_iter().filter(|l| !picked.iter().any(|p| p.name == l.name)).collect::<Vec<_>>();
        picked.extend(new);
    }
    let first = layout.layers.first().filter(|_| picked.is_empty());
    first.map_or(Ok(picked), |layer| Err(no_beauty(layout, layer, &selection.passes)))
}

fn pick_layer<'a>(layout: &'a Layout, selection: &Selection) -> Result<&'a ViewLayer> {
    if !selection.layers.is_empty() {
        let first = pick_layers(layout, selection)?.into_iter().next();
        return first.ok_or_else(|| Error::bad_file(&layout.path, "holds no layers"));
    }
    // A one-sample layer for the vectors must not win; the first wins among equals.
    let ranked = candidates(layout, &selection.passes)
        .filter(|l| is_ordinary(l) && (Some(&l.name) != selection.vector_layer.as_ref() || layout.layers.len() == 1));
    let best = ranked.reduce(|best, layer| {
        let rank = |l: &ViewLayer| (l.samples.unwrap_or(0), l.passes.len());
        if rank(layer) > rank(best) { layer } else { best }
    });
    let not_for_vectors = |l: &&ViewLayer| !made_for_vectors(&l.name);
    let no_beauty = || match layout.layers.first() {
        Some(for_vectors) => no_beauty(layout, for_vectors, &selection.passes),
        None => Error::bad_file(&layout.path, "holds no layers"),
    };
    best.or(candidates(layout, &selection.passes).find(not_for_vectors))
        .or(layout.layers.iter().find(not_for_vectors))
        .ok_or_else(no_beauty)
}

fn missing_layer(layout: &Layout, name: &str) -> Error {
    let names: Vec<&str> = layout.layers.iter().map(|l| if l.name.is_empty() { "(unnamed)" } else { l.name.as_str() }).collect();
    let advice = format!("its view layers are {}", names.join(", "));
    Error::MissingPass { path: layout.path.clone(), pass: format!("{name} (view layer)"), advice }
}

fn pick_view<'a>(layout: &Layout, layer: &'a ViewLayer, selection: &Selection) -> Result<Option<&'a str>> {
    let Some(name) = &selection.view else {
        return Ok(layer.views.first().map(String::as_str));
    };
    layer.views.iter().find(|v| *v == name).map(|v| Some(v.as_str())).ok_or_else(|| Error::MissingPass {
        path: layout.path.clone(),
        pass: format!("{name} (view)"),
        advice: match layer.views.is_empty() {
            true => "the file holds one view only; leave the view out".into(),
            false => format!("its views are {}", layer.views.join(", ")),
        },
    })
}

fn no_beauty(layout: &Layout, layer: &ViewLayer, names: &PassNames) -> Error {
    if let Some(name) = &names.beauty {
        let advice = format!("it was named as the beauty, with the channels R, G, B; {}", pass_names::there(layout));
        return Error::MissingPass { path: layout.path.clone(), pass: name.clone(), advice };
    }
    let grey = layer.passes.iter().any(|p| p.channels.len() == 1 && matches!(p.channels[0].component.as_str(), "Y" | "V"));
    if made_for_vectors(&layer.name) {
        let advice = format!("the view layer {} is there for motion vectors only: render the other view layers too", layer.name);
        return Error::MissingPass { path: layout.path.clone(), pass: "Combined".into(), advice };
    }
    let advice = match layer.passes.iter().any(|p| p.name == "Combined") || (grey && layer.passes.len() == 1) {
        true => "the image is black and white: render with Output › Color › RGB or RGBA",
        false => "enable View Layer › Passes › Data › Combined, or name a File Output layer Image",
    };
    Error::MissingPass { path: layout.path.clone(), pass: "Combined".into(), advice: advice.into() }
}

/// Data window of a pass: columns, rows, origin.
pub(crate) type Window = (usize, usize, [i32; 2]);

pub(crate) fn window_of(layout: &Layout, pass: &PassRef) -> Option<Window> {
    let part = layout.part_list.get(pass.channels.first()?.part)?;
    Some((part.columns, part.rows, part.origin))
}

fn lossy(layout: &Layout, pass: &Option<PassRef>) -> bool {
    let part = pass.as_ref().and_then(|p| p.channels.first()).and_then(|c| layout.part_list.get(c.part));
    part.is_some_and(|p| p.lossy && p.compression != "PXR24")
}

struct GuideFinder<'a> {
    layout: &'a Layout,
    layer: &'a ViewLayer,
    view: Option<&'a str>,
    window: Option<Window>,
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
            if window_of(self.layout, &found) == self.window {
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
