//! What a file holds, what Hush will use of it, and what is missing, in words for an artist.

use std::fmt::{self, Display, Formatter};
use std::path::Path;

use serde::Serialize;

use super::layout::{Layout, SampleType, read_layout};
use super::names;
use super::read::read_frame;
use super::resolved::{Missing, PassRef, Resolved};
use super::select::resolve;
use super::selection::{Selection, made_for_vectors};
use super::validate::is_complete;
use super::write::caveats;
use crate::error::Result;
use crate::frame::{Frame, LambdaMask};

/// A pass and what it is used for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Use {
    /// `colour`, `albedo`, `normal`, `depth`, `vector`, `lambda mask`, `light pass` or `written to`.
    pub purpose: String,
    /// Such as `ViewLayer.Combined`.
    pub pass: String,
}

/// The answer of [`inspect`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Inspection {
    /// What the header says.
    #[serde(flatten)]
    pub layout: Layout,
    /// The passes that Hush will read and write.
    pub uses: Vec<Use>,
    /// Passes worth having that are not there.
    pub missing: Vec<Missing>,
    /// Light passes that could be denoised along, by the file's names.
    pub light_passes: Vec<String>,
    /// What the user should know, a sentence each.
    pub notes: Vec<String>,
    /// Why Hush cannot denoise the file, if it cannot.
    pub problem: Option<String>,
}

/// Inspects a file with the default selection.
///
/// # Errors
/// As [`inspect_with`].
pub fn inspect(path: &Path) -> Result<Inspection> {
    inspect_with(path, &Selection::default())
}

/// Inspects a file: header, completeness, choice of passes, and a look at the pixels of the passes that are used.
///
/// # Errors
/// [`crate::Error::Io`] and [`crate::Error::BadFile`] if the file cannot be read or is damaged. That a pass is missing is no error
/// but `problem`.
pub fn inspect_with(path: &Path, selection: &Selection) -> Result<Inspection> {
    let layout = read_layout(path)?;
    is_complete(path)?;
    let mut found = Inspection { uses: vec![], missing: vec![], light_passes: vec![], notes: vec![], problem: None, layout };
    let resolved = match resolve(&found.layout, selection) {
        Ok(resolved) => resolved,
        Err(problem) => {
            found.problem = Some(problem.to_string());
            return Ok(found);
        }
    };
    let frame = read_frame(&found.layout, &resolved)?;
    found.uses = uses(&resolved);
    found.light_passes = light_passes(&found.layout, &resolved);
    found.notes = resolved.notes.clone();
    found.notes.extend(layer_notes(&found.layout, &resolved));
    found.notes.extend(unused_guides(&found.layout, &resolved));
    found.notes.extend(pixel_notes(&resolved, &frame));
    found.notes.extend(caveats(&found.layout, &resolved));
    found.missing = resolved.missing;
    Ok(found)
}

fn uses(r: &Resolved) -> Vec<Use> {
    let guides = [("colour", Some(&r.colour)), ("albedo", r.albedo.as_ref()), ("normal", r.normal.as_ref())];
    let more = [("depth", r.depth.as_ref()), ("vector", r.vector.as_ref()), ("lambda mask", r.lambda_mask.as_ref())];
    let lights = r.aovs.iter().map(|a| ("light pass", Some(&a.pass)));
    let all = guides.into_iter().chain(more).chain(lights).chain([("written to", Some(&r.target))]);
    let entry = |(purpose, pass): (&str, Option<&PassRef>)| pass.map(|p| Use { purpose: purpose.into(), pass: p.label() });
    all.filter_map(entry).collect()
}

fn light_passes(layout: &Layout, r: &Resolved) -> Vec<String> {
    let passes = layout.layer(&r.layer).map(|l| l.passes.as_slice()).unwrap_or_default();
    let mut found: Vec<String> = Vec::new();
    for pass in passes {
        if (names::light_pass(&pass.name).is_some() || names::is_light_group(&pass.name)) && !found.contains(&pass.name) {
            found.push(pass.name.clone());
        }
    }
    found
}

/// The passes of Denoising Data that are not used, where the layer has any.
fn unused_guides(layout: &Layout, r: &Resolved) -> Option<String> {
    let layer = layout.layer(&r.layer)?;
    let used = |name: &str| r.channels().any(|c| layer.pass(name, r.view.as_deref()).is_some_and(|p| p.channels.contains(c)));
    let there = |name: &&str| layer.pass(name, r.view.as_deref()).is_some() && !used(name);
    let there: Vec<&str> = names::UNUSED_GUIDES.into_iter().filter(there).collect();
    let (pass, is) = if there.len() == 1 { ("a pass", "is") } else { ("passes", "are") };
    (!there.is_empty()).then(|| format!("{} {is} {pass} of Denoising Data that Hush does not use.", there.join(" and ")))
}

/// The layers that are no artist's.
fn layer_notes(layout: &Layout, r: &Resolved) -> Vec<String> {
    let mut notes = Vec::new();
    let vectors = r.vector.iter().map(|v| &v.layer).find(|l| made_for_vectors(l) && **l != r.layer);
    notes.extend(vectors.map(|layer| {
        format!(
            "The motion vectors come from the view layer {layer}, which Prepare Shot made for them; it is not denoised itself."
        )
    }));
    let composite = layout.layers.iter().find(|l| l.is_composite() && l.name != r.layer);
    notes.extend(composite.map(|layer| {
        format!("{} holds what the compositor made of the noisy image; the denoised file is written without it.", layer.name)
    }));
    notes
}

fn pixel_notes(r: &Resolved, frame: &Frame) -> Vec<String> {
    let mut notes = Vec::new();
    if frame.vector.as_ref().is_some_and(|v| v.iter().all(|&x| x == 0.0)) {
        notes.push(
            "The Vector pass is zero everywhere. That is right only if nothing moves; with Motion Blur on, Blender leaves it empty: \
             take the vectors from a second view layer without Motion Blur: set vector layer to NAME."
                .into(),
        );
    }
    if !r.surely_noisy {
        notes.push(
            "Nothing in the file tells whether Cycles denoised it already. If so, switch Render › Denoise off, or enable View Layer › \
             Passes › Data › Denoising Data, which stores the noisy image too."
                .into(),
        );
    }
    let mask = r.lambda_mask.as_ref().zip(frame.lambda_mask.as_ref());
    notes.extend(
        mask.and_then(|(pass, mask)| Some(format!("The lambda pass {} {}.", pass.label(), LambdaMask::new(mask.view()).note()?))),
    );
    let bad = frame.colour.iter().filter(|v| !v.is_finite()).count();
    if bad > 0 {
        notes.push(format!("{bad} colour values are NaN or infinite; they are cleaned before denoising."));
    }
    notes
}

impl Inspection {
    /// The whole answer as text, several lines.
    pub fn describe(&self) -> String {
        self.to_string()
    }
}

impl Display for Inspection {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let l = &self.layout;
        writeln!(f, "{}", l.path.display())?;
        let kind = if l.multipart { format!("{} parts", l.parts) } else { "one part".into() };
        write!(f, "  {}×{} pixels, {} compression, {kind}", l.columns, l.rows, l.compression)?;
        let facts = [l.frame.map(|n| format!("frame {n}")), l.spp.map(|n| format!("{n} samples")), l.software.clone()];
        writeln!(f, "{}", facts.into_iter().flatten().map(|fact| format!(", {fact}")).collect::<String>())?;
        writeln!(f, "Holds")?;
        for layer in &l.layers {
            let name = if layer.name.is_empty() { "passes without view layer" } else { layer.name.as_str() };
            let views = if layer.views.is_empty() { String::new() } else { format!(" (views {})", layer.views.join(", ")) };
            writeln!(f, "  {name}{views}")?;
            for pass in layer.passes.iter().filter(|p| p.view.is_none() || p.view.as_ref() == layer.views.first()) {
                let letters: Vec<&str> = pass.channels.iter().map(|c| c.component.as_str()).collect();
                let bits = match pass.channels.first().map(|c| c.sample) {
                    Some(SampleType::Half) => "half",
                    Some(SampleType::Float) => "float",
                    _ => "whole numbers",
                };
                let name = if pass.name.is_empty() { "colour" } else { pass.name.as_str() };
                writeln!(f, "    {name:<25} {:<8} {bits}", letters.join(""))?;
            }
        }
        if let Some(problem) = &self.problem {
            return writeln!(f, "Hush cannot denoise it: {problem}");
        }
        writeln!(f, "Hush uses")?;
        for entry in &self.uses {
            writeln!(f, "    {:<24} {}", entry.purpose, entry.pass)?;
        }
        if !self.light_passes.is_empty() {
            writeln!(f, "  and can denoise these light passes along (aovs): {}", self.light_passes.join(", "))?;
        }
        if !self.missing.is_empty() {
            writeln!(f, "Missing, and worth having")?;
        }
        for missing in &self.missing {
            writeln!(f, "    {:<24} {}", missing.pass, missing.advice)?;
        }
        for note in &self.notes {
            writeln!(f, "Note: {note}")?;
        }
        Ok(())
    }
}
