//! Which of a file's passes feed the denoiser, and which pass receives the result.

use super::guides::{self, FoundGuides};
use super::lambda_mask;
use super::layout::{Layout, Pass};
use super::lights;
use super::resolved::{PassRef, Resolved};
use super::selection::{NOISY, Selection};
use super::view_layers::{beauty, candidates, is_ordinary, no_beauty, pick_layer, pick_layers, pick_view};
use crate::error::Result;

/// Decides what is read and written.
///
/// # Errors
/// [`Error::MissingPass`](crate::Error::MissingPass) if the file has no beauty, or lacks a layer, view, light pass or mask of λ
/// that was asked for; [`Error::SizeMismatch`](crate::Error::SizeMismatch) if that mask has another size.
pub fn resolve(layout: &Layout, selection: &Selection) -> Result<Resolved> {
    let layer = pick_layer(layout, selection)?;
    let view = pick_view(layout, layer, selection)?;
    let names = &selection.passes;
    let beauty = beauty(layer, view, names);
    let noisy = layer.pass(NOISY, view).filter(|p| p.rgb().is_some() && (!selection.denoised_ok || beauty.is_none()));
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
    let rgb_ref = |pass: &Pass| {
        pass.rgb().map(|channels| PassRef::new(layer, pass, channels)).ok_or_else(|| no_beauty(layout, layer, names))
    };
    let colour_ref = rgb_ref(colour)?;
    let part = colour_ref.channels.first().and_then(|c| layout.part_list.get(c.part));
    let (columns, rows) = part.map_or((layout.columns, layout.rows), |p| (p.columns, p.rows));

    let window = colour_ref.data_window(layout);
    let found = guides::find(layout, layer, view, selection, window)?;
    let (aovs, missing_lights) = lights::find(layout, layer, view, selection, window)?;

    let lambda_pass = selection.lambda_pass.as_deref().filter(|_| selection.lambda_images.is_none());
    let lambda_mask = lambda_pass.map(|name| lambda_mask::find(layout, layer, view, name, window)).transpose()?;

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
    if found.are_lossy(layout) {
        notes.push(
            "The guides went through lossy compression (DWA or B44), which blurs edges: save with ZIP or PIZ for a better result."
                .into(),
        );
    }
    let FoundGuides { albedo, normal, depth, vector, missing } = found;
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
        lambda_mask,
        missing: missing.into_iter().chain(missing_lights).collect(),
        notes,
    })
}

/// As [`resolve`], once for each view layer that the selection names, and for each stereo view where it names none, so that a
/// file is denoised as a whole.
///
/// # Errors
/// As [`resolve`]; [`Error::MissingPass`](crate::Error::MissingPass) if `all` finds no view layer with a beauty.
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
