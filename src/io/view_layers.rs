//! Which view layers and views of a file are denoised, and the pass in each that holds the beauty.

use super::layout::{Layout, Pass, ViewLayer};
use super::pass_names::{self, PassNames};
use super::selection::{NOISY, Selection, made_for_vectors};
use crate::error::{Error, Result};

/// Stands for all view layers.
const ALL: &str = "all";
/// Passes that hold the beauty: Blender's, a File Output node's, a plain image's, other writers'.
const BEAUTY: [&str; 7] = ["Combined", "Image", "", "Beauty", "beauty", "RGBA", "rgba"];

/// Whether a pass of this name holds the beauty, noisy or not.
pub(super) fn is_beauty(pass: &str, names: &PassNames) -> bool {
    names.beauty.as_deref().map_or_else(|| pass == NOISY || BEAUTY.contains(&pass), |beauty| pass == beauty)
}

/// The pass of a layer and view that holds the beauty.
pub(super) fn beauty<'a>(layer: &'a ViewLayer, view: Option<&str>, names: &PassNames) -> Option<&'a Pass> {
    if let Some(name) = &names.beauty {
        return pass_names::find(layer, name, view).filter(|p| p.rgb().is_some());
    }
    let named = BEAUTY.iter().find_map(|name| layer.pass(name, view).filter(|p| p.rgb().is_some()));
    // A File Output node's layers may have any name: take the only one with colour and alpha.
    named.or_else(|| {
        let mut others = layer.passes.iter().filter(|p| {
            p.view.as_deref() == view
                && p.name != NOISY
                && !p.name.starts_with("Denoising")
                && p.channel("A").is_some()
                && p.rgb().is_some()
        });
        let only = others.next().filter(|_| layer.name.is_empty());
        only.filter(|_| others.next().is_none())
    })
}

/// The layers that hold a beauty.
pub(super) fn candidates<'a>(layout: &'a Layout, names: &PassNames) -> impl Iterator<Item = &'a ViewLayer> {
    layout.layers.iter().filter(|layer| {
        let views = layer.views.iter().map(|v| Some(v.as_str())).chain([None]);
        let noisy = |view| names.beauty.is_none() && layer.pass(NOISY, view).is_some_and(|p| p.rgb().is_some());
        views.into_iter().any(|view| beauty(layer, view, names).is_some() || noisy(view))
    })
}

/// Whether a layer is one that an artist made, and so is denoised without being named.
pub(super) fn is_ordinary(layer: &ViewLayer) -> bool {
    !made_for_vectors(&layer.name) && !layer.is_composite()
}

/// The layers to denoise, each once, in the file's order for `all`, else as they were named.
pub(super) fn pick_layers<'a>(layout: &'a Layout, selection: &Selection) -> Result<Vec<&'a ViewLayer>> {
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

/// The layer to denoise: the first that was named, else the one with the most samples.
pub(super) fn pick_layer<'a>(layout: &'a Layout, selection: &Selection) -> Result<&'a ViewLayer> {
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

/// A layer was named that the file lacks.
pub(super) fn missing_layer(layout: &Layout, name: &str) -> Error {
    let names: Vec<&str> = layout.layers.iter().map(|l| if l.name.is_empty() { "(unnamed)" } else { l.name.as_str() }).collect();
    let advice = format!("its view layers are {}", names.join(", "));
    Error::MissingLayer { path: layout.path.clone(), what: format!("view layer {name}"), advice }
}

/// The view to denoise; None in a file of one view.
pub(super) fn pick_view<'a>(layout: &Layout, layer: &'a ViewLayer, selection: &Selection) -> Result<Option<&'a str>> {
    let Some(name) = &selection.view else {
        return Ok(layer.views.first().map(String::as_str));
    };
    layer.views.iter().find(|v| *v == name).map(|v| Some(v.as_str())).ok_or_else(|| Error::MissingLayer {
        path: layout.path.clone(),
        what: format!("stereo view {name}"),
        advice: match layer.views.is_empty() {
            true => "the file holds one view only; leave the view out".into(),
            false => format!("its views are {}", layer.views.join(", ")),
        },
    })
}

/// A layer has no beauty, and what to do about it.
pub(super) fn no_beauty(layout: &Layout, layer: &ViewLayer, names: &PassNames) -> Error {
    if let Some(name) = &names.beauty {
        let advice = format!("it was named as the beauty, with the channels R, G, B; {}", pass_names::there(layout));
        return Error::MissingPass { path: layout.path.clone(), pass: name.clone(), advice };
    }
    let grey = layer.passes.iter().any(|p| p.channels.len() == 1 && matches!(p.channels[0].component.as_str(), "Y" | "V"));
    if made_for_vectors(&layer.name) {
        let advice = format!("the view layer {} is there for motion vectors only: render the other view layers too", layer.name);
        return Error::MissingPass { path: layout.path.clone(), pass: "Combined".into(), advice };
    }
    let combined = layer.passes.iter().find(|p| p.name == "Combined");
    // As another program saved it: lower-case letters, or whole numbers.
    if let Some(combined) = combined.filter(|p| p.channels.len() >= 3) {
        let letters: Vec<&str> = combined.channels.iter().map(|c| c.component.as_str()).collect();
        let advice = format!("what is called so has the channels {}: save them as R, G and B, half or float", letters.join(", "));
        return Error::MissingPass { path: layout.path.clone(), pass: "Combined".into(), advice };
    }
    let advice = match combined.is_some() || (grey && layer.passes.len() == 1) {
        true => "the image is black and white: render with Output › Color › RGB or RGBA",
        false => "enable View Layer › Passes › Data › Combined, or name a File Output layer Image",
    };
    Error::MissingPass { path: layout.path.clone(), pass: "Combined".into(), advice: advice.into() }
}
