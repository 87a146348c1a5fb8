//! A frame's file once its header was read: what it holds and what will be read from it.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ndarray::Axis;

use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::io::{Layout, Resolved, Selection, caveats, read_frame, read_layout, resolve_views};
use crate::rules::checks::Header;
use crate::rules::window::Availability;

/// A readable file of the sequence.
#[derive(Debug)]
pub(super) struct InputFile {
    pub path: PathBuf,
    pub layout: Arc<Layout>,
    /// The stereo views to denoise; one where there is one image.
    pub views: Vec<Resolved>,
    pub header: Header,
    passes: u64,
}

/// Each pass that is missing, with how to get it, and where it is missing in some of the view layers only, with their names.
fn missing(views: &[Resolved]) -> Vec<(String, String)> {
    let mut found: BTreeMap<(&str, &str), BTreeSet<&str>> = BTreeMap::new();
    for (view, m) in views.iter().flat_map(|v| v.missing.iter().map(move |m| (v, m))) {
        found.entry((&m.pass, &m.advice)).or_default().insert(&view.layer);
    }
    let all = views.iter().map(|v| v.layer.as_str()).collect::<BTreeSet<_>>().len();
    let told = |((pass, advice), layers): ((&str, &str), BTreeSet<&str>)| {
        let names = layers.iter().copied().collect::<Vec<_>>().join(", ");
        let lacks = if layers.len() == 1 { "in the view layer" } else { "in the view layers" };
        let of = if layers.len() < all { format!("{lacks} {names}: ") } else { String::new() };
        (pass.to_owned(), format!("{of}{advice}"))
    };
    found.into_iter().map(told).collect()
}

impl InputFile {
    /// Reads the header and picks the passes.
    pub fn open(number: i64, path: &Path, selection: &Selection) -> Result<Self> {
        Self::new(number, Arc::new(read_layout(path)?), selection)
    }

    /// Picks the passes of a file whose header was read.
    pub fn new(number: i64, layout: Arc<Layout>, selection: &Selection) -> Result<Self> {
        let views = resolve_views(&layout, selection)?;
        let first = views.first();
        let mut notes: Vec<String> = views.iter().flat_map(|v| v.notes.clone().into_iter().chain(caveats(&layout, v))).collect();
        notes.sort();
        notes.dedup();
        let origin = first.map_or([0, 0], |v| v.colour.origin(&layout));
        let header = Header {
            number,
            columns: first.map_or(layout.columns, |v| v.columns),
            rows: first.map_or(layout.rows, |v| v.rows),
            origin,
            vector: !views.is_empty() && views.iter().all(|v| v.vector.is_some()),
            noisy_image: views.iter().any(|v| v.colour != v.target),
            unsure: views.iter().any(|v| !v.surely_noisy),
            missing: missing(&views),
            notes,
        };
        let mut hasher = DefaultHasher::new();
        // Vectors lead from pixel to pixel of the picture, not of what is cropped from it.
        origin.hash(&mut hasher);
        for view in &views {
            (view.columns, view.rows, &view.layer, &view.view, view.albedo.is_some()).hash(&mut hasher);
            view.aovs.iter().for_each(|a| a.name.hash(&mut hasher));
        }
        Ok(Self { path: layout.path.clone(), layout, views, header, passes: hasher.finish() })
    }

    /// The view layer that the motion vectors come from.
    pub fn vector_layer(&self) -> Option<&str> {
        self.views.first()?.vector.as_ref().map(|pass| pass.layer.as_str())
    }

    /// For the window.
    pub fn known(&self) -> Availability {
        let Header { columns, rows, vector, .. } = self.header;
        Availability::Good { columns, rows, vector, passes: self.passes }
    }

    /// Decodes the views.
    ///
    /// # Errors
    /// The file is damaged, or a view holds nothing but NaN and infinities.
    pub fn read(&self) -> Result<Vec<Frame>> {
        let read = |view| {
            let frame = read_frame(&self.layout, view)?;
            let finite = frame.colour.lanes(Axis(2)).into_iter().any(|pixel| pixel.iter().all(|v| v.is_finite()));
            let bad = || Error::bad_file(&self.path, format!("{} holds no finite pixel: render it again", view.colour.label()));
            if finite { Ok(frame) } else { Err(bad()) }
        };
        self.views.iter().map(read).collect()
    }

    /// Decodes one of the views.
    pub fn read_image(&self, index: usize) -> Result<Frame> {
        let view =
            self.views.get(index).ok_or_else(|| Error::bad_file(&self.path, "lacks a view layer of the frames beside it"))?;
        read_frame(&self.layout, view)
    }

    /// About the bytes of the decoded frame.
    pub fn bytes(&self) -> usize {
        let channels = |v: &Resolved| 14 + 3 * v.aovs.len();
        self.views.iter().map(|v| v.columns * v.rows * channels(v) * size_of::<f32>()).sum()
    }
}

/// Whether a frame will have motion vectors.
pub(crate) fn has_vector(path: &Path, selection: &Selection) -> Result<bool> {
    InputFile::open(0, path, selection).map(|source| source.header.vector)
}

#[cfg(test)]
mod tests {
    use exr::prelude::*;

    use super::*;

    #[test]
    fn what_only_some_view_layers_lack_is_told_with_their_names() {
        let passes = ["A.Combined", "A.Denoising Albedo", "B.Combined"];
        let names = passes.into_iter().flat_map(|pass| ["R", "G", "B"].map(|c| format!("{pass}.{c}")));
        let channels = names.map(|name| AnyChannel::new(name.as_str(), FlatSamples::F32(vec![0.5; 4]))).collect();
        let layer = Layer::new((2, 2), LayerAttributes::default(), Encoding::FAST_LOSSLESS, AnyChannels::sort(channels));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f_0001.exr");
        Image::from_layer(layer).write().to_file(&path).unwrap();
        let missing = |layers: &[&str]| {
            let layers = layers.iter().map(|l| l.to_string()).collect();
            InputFile::open(1, &path, &Selection { layers, ..Selection::default() }).unwrap().header.missing
        };
        let advice = |missing: &[(String, String)], pass: &str| missing.iter().find(|(p, _)| p == pass).map(|(_, a)| a.clone());
        let both = missing(&["all"]);
        assert!(advice(&both, "Denoising Albedo").unwrap().starts_with("in the view layer B: enable"), "{both:?}");
        assert!(advice(&both, "Denoising Normal").unwrap().starts_with("enable"), "{both:?}");
        assert!(advice(&missing(&["B"]), "Denoising Albedo").unwrap().starts_with("enable"));
        assert_eq!(advice(&missing(&["A"]), "Denoising Albedo"), None);
    }
}
