//! Writing a denoised frame: the source file again, with only the denoised channels changed.

use std::collections::HashMap;
use std::path::Path;

use ndarray::Axis;

use super::atomic::write_atomically;
use super::exr_file::ExrFile;
use super::layout::Layout;
use super::output_parts::{Edits, OutputParts};
use super::read::{check_channel, open_again};
use super::recombine::light_planes;
use super::resolved::Resolved;
use super::same_file::is_same_file;
use super::selection::made_for_vectors;
use crate::error::{Error, Result};
use crate::frame::Denoised;

/// What to write besides the denoised passes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WriteOptions {
    /// Keep the noisy input as the pass `Noisy Image`, if the file has none yet.
    pub keep_noisy: bool,
    /// Text attributes to add to the file's metadata, or to replace there: name, value.
    pub attributes: Vec<(String, String)>,
}

/// Writes the source file of `layout` to `destination` with the denoised passes in it.
///
/// Layout, compression, bit depth, metadata and every other channel stay as they are. Parts without a denoised channel are copied
/// byte for byte; in parts with one, lossless compression keeps the other channels' bits, while lossy compression encodes them
/// again (see [`caveats`]). The pass that `resolved.target` names takes the denoised colour, its alpha the denoised alpha where
/// there is one. Light passes are divided by their Color pass again; where Color is below 1e-4 and the contribution is not zero,
/// the written Color is raised to 1e-4 (1/64 under DWA and B44; in half-float files further where the quotient would overflow), so
/// that Color × pass equals the denoised contribution. A Color pass is shared: where it is raised, a light pass that uses it and
/// was not denoised gains by as much. Half-float channels are clamped to ±65504. Written aside and renamed into place.
///
/// Viewers show the first layer, which is to be a denoised one: the layer `Composite`, which holds what the compositor made of the
/// noisy passes while the frame was rendered, is left out, and the parts of a layer made for motion vectors come last.
///
/// # Errors
/// [`Error::BadInput`] if `destination` is the source itself; [`Error::SizeMismatch`] if `denoised` has another size; [`Error::Io`]
/// and [`Error::BadFile`] as reading and writing give them. On an error `destination` is as it was.
pub fn write_denoised(
    layout: &Layout,
    resolved: &Resolved,
    denoised: &Denoised,
    options: &WriteOptions,
    destination: &Path,
) -> Result<()> {
    write_views(layout, &[(resolved, denoised)], options, destination)
}

/// As [`write_denoised`], with several denoised views or view layers of one file.
///
/// # Errors
/// As [`write_denoised`].
pub fn write_views(layout: &Layout, views: &[(&Resolved, &Denoised)], options: &WriteOptions, destination: &Path) -> Result<()> {
    refuse_source(&layout.path, destination)?;
    let mut source = open_again(layout)?;
    let mut edits = HashMap::new();
    for (resolved, denoised) in views {
        collect_edits(layout, &mut source, resolved, denoised, &mut edits)?;
    }
    let mut parts = OutputParts::new(&source, &edits);
    if options.keep_noisy {
        for (resolved, _) in views {
            parts.keep_noisy(layout, resolved)?;
        }
    }
    // What a viewer shows first is to be the denoised image.
    let denoised = |name: &str| views.iter().any(|(resolved, _)| resolved.layer == name);
    let others = || layout.layers.iter().filter(|l| !denoised(&l.name));
    // Left out last, so that the metadata goes to the part that comes first in the end.
    others().filter(|l| made_for_vectors(&l.name)).for_each(|layer| parts.put_last(layer));
    others().filter(|l| l.is_composite()).for_each(|layer| parts.leave_out(layer));
    for (name, value) in &options.attributes {
        parts.set_attribute(name, value)?;
    }
    let output = parts.finish().map_err(|reason| Error::bad_file(&layout.path, reason))?;
    write_atomically(destination, |file| output.write(&layout.path, &mut source, &edits, file, destination))
}

/// What writing will change besides the denoised passes, in words for the user; empty for all lossless files.
pub fn caveats(layout: &Layout, resolved: &Resolved) -> Vec<String> {
    let mut parts: Vec<usize> = resolved.target.channels.iter().map(|c| c.part).collect();
    parts.extend(resolved.aovs.iter().flat_map(|a| a.pass.channels.iter().map(|c| c.part)));
    parts.sort_unstable();
    parts.dedup();
    let lossy = parts.iter().filter_map(|&p| layout.part_list.get(p)).find(|p| p.lossy);
    let mut notes = Vec::new();
    if let Some(part) = lossy {
        let others = if layout.multipart { "in the denoised passes' parts" } else { "in the file" };
        notes.push(format!(
            "{} compression is lossy: the denoised pixels are rounded by it, and other channels {others} are encoded once more \
             (Cryptomatte keeps its values under DWA). Save with ZIP or PIZ to keep every other channel bit for bit.",
            part.compression
        ));
    }
    notes
}

fn refuse_source(source: &Path, destination: &Path) -> Result<()> {
    match source == destination || is_same_file(source, destination) {
        true => Err(Error::BadInput {
            input: destination.display().to_string(),
            reason: "is the rendered file itself, which is never overwritten: choose another folder".into(),
        }),
        false => Ok(()),
    }
}

fn collect_edits<'a>(
    layout: &Layout,
    source: &mut ExrFile,
    resolved: &Resolved,
    denoised: &'a Denoised,
    edits: &mut Edits<'a>,
) -> Result<()> {
    let (rows, columns) = (resolved.rows, resolved.columns);
    let check = |what: &str, found: (usize, usize)| match found == (rows, columns) {
        true => Ok(()),
        false => Err(Error::SizeMismatch { what: what.into(), columns, rows, found_columns: found.1, found_rows: found.0 }),
    };
    let channels = |what: &str, count: usize| match count {
        3 => Ok(()),
        _ => Err(Error::BadInput { input: what.into(), reason: format!("has {count} channels, expected 3") }),
    };
    let (r, c, k) = denoised.colour.dim();
    check("denoised colour", (r, c))?;
    channels("denoised colour", k)?;
    for (k, channel) in resolved.target.channels.iter().enumerate() {
        edits.insert((channel.part, channel.index), denoised.colour.index_axis(Axis(2), k).into());
    }
    if let (Some(alpha), Some(channel)) = (&denoised.alpha, &resolved.target_alpha) {
        check("denoised alpha", alpha.dim())?;
        edits.insert((channel.part, channel.index), alpha.view().into());
    }
    if denoised.aovs.len() != resolved.aovs.len() {
        let reason = format!("{} were denoised, {} were asked for", denoised.aovs.len(), resolved.aovs.len());
        return Err(Error::BadInput { input: "light passes".into(), reason });
    }
    for aov in &denoised.aovs {
        let (r, c, k) = aov.image.dim();
        check(&aov.name, (r, c))?;
        channels(&aov.name, k)?;
    }
    let lights = light_planes(layout, source, resolved, &denoised.aovs)?;
    edits.extend(lights.into_iter().map(|(place, plane)| (place, plane.into())));
    let written = resolved.target.channels.iter().chain(&resolved.target_alpha);
    written.into_iter().try_for_each(|channel| check_channel(&layout.path, source, channel))
}
