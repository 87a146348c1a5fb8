//! The passes that an evaluation needs, read from files.

use std::path::Path;

use ndarray::Array3;

use super::{Pair, Scaling, TwoReferences};
use crate::error::Result;
use crate::io::{Guides, NOISY, Selection, read_frame, read_layout, resolve};

/// Which images to read of every file.
#[derive(Clone, Debug, Default)]
pub struct ImageChoice {
    /// View layer; by default the one with the most samples.
    pub layer: Option<String>,
    /// Stereo view; by default the first.
    pub view: Option<String>,
    /// View layer to take the Vector pass from, if not the same.
    pub vector_layer: Option<String>,
}

/// What is read of one file.
pub(crate) struct FilePasses {
    /// Combined, (rows, columns, 3), as it is: denoised where the file is.
    pub colour: Array3<f32>,
    /// The Vector pass, (rows, columns, 4), if asked for and there.
    pub vector: Option<Array3<f32>>,
    /// Where the upper left corner lies in the picture: not at 0, 0 where the file is cropped.
    pub origin: [i32; 2],
    /// Whether a Noisy Image lies beside Combined, which means that Combined was denoised.
    pub denoised: bool,
}

/// The beauty of one frame by the reference and by the denoiser.
pub(super) struct Images {
    pub reference: Array3<f32>,
    pub denoised: Array3<f32>,
    /// For the unbiased errors.
    pub independent: Option<Independent>,
}

/// Images whose noise has nothing to do with the reference's.
pub(super) struct Independent {
    pub second: Array3<f32>,
    pub brightness: Array3<f32>,
}

impl Images {
    pub fn pair(&self, scaling: Scaling) -> Result<Pair<'_>> {
        Pair::new(self.reference.view(), self.denoised.view(), scaling)
    }

    /// Whether two images that should be independent are the same.
    pub fn has_twins(&self) -> bool {
        let same = |i: &Independent| self.reference == i.second || self.reference == i.brightness || i.second == i.brightness;
        self.independent.as_ref().is_some_and(same)
    }

    /// The denoised image between its two references, where there are two.
    pub fn between(&self, scaling: Scaling) -> Option<Result<TwoReferences<'_>>> {
        let independent = self.independent.as_ref()?;
        let pair = self.pair(scaling);
        Some(pair.and_then(|pair| TwoReferences::new(pair, independent.second.view(), independent.brightness.view())))
    }
}

/// Reads a file's beauty and, if asked, its Vector pass.
pub(crate) fn read(path: &Path, vector: bool, choice: &ImageChoice) -> Result<FilePasses> {
    let layout = read_layout(path)?;
    // A file without the layer for vectors is one without vectors.
    let has_layer = |name: &String| layout.layer(name).is_some_and(|l| l.passes.iter().any(|p| p.name == "Vector"));
    let vector = vector && choice.vector_layer.as_ref().is_none_or(has_layer);
    let selection = Selection {
        layers: choice.layer.iter().cloned().collect(),
        view: choice.view.clone(),
        vector_layer: choice.vector_layer.clone().filter(|_| vector),
        guides: Guides { albedo: false, normal: false, depth: false, vector },
        denoised_ok: true,
        ..Selection::default()
    };
    let resolved = resolve(&layout, &selection)?;
    let denoised = resolved.colour.pass != NOISY
        && layout.layer(&resolved.layer).is_some_and(|l| l.pass(NOISY, resolved.view.as_deref()).is_some());
    let frame = read_frame(&layout, &resolved)?;
    Ok(FilePasses { colour: frame.colour, vector: frame.vector, origin: resolved.colour.origin(&layout), denoised })
}
