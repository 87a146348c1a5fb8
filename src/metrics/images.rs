//! The passes that an evaluation needs, read from files.

use std::path::Path;

use ndarray::Array3;

use super::evaluate::EvaluateOptions;
use super::{Pair, Scaling};
use crate::error::Result;
use crate::io::{Guides, Selection, read_frame, read_layout, resolve};

/// Cycles' name of the beauty as rendered, where Combined holds a denoised one.
const NOISY: &str = "Noisy Image";

/// What is read of one file.
pub(crate) struct Passes {
    /// Combined, (rows, columns, 3), as it is: denoised where the file is.
    pub colour: Array3<f32>,
    /// The Vector pass, (rows, columns, 4), if asked for and there.
    pub vector: Option<Array3<f32>>,
    /// Whether a Noisy Image lies beside Combined, which means that Combined was denoised.
    pub denoised: bool,
}

/// The beauty of one frame by the reference and by the denoiser.
pub(super) struct Images {
    pub reference: Array3<f32>,
    pub denoised: Array3<f32>,
}

impl Images {
    pub fn pair(&self, scaling: Scaling) -> Result<Pair<'_>> {
        Pair::new(self.reference.view(), self.denoised.view(), scaling)
    }
}

/// Reads a file's beauty and, if asked, its Vector pass.
pub(crate) fn read(path: &Path, vector: bool, options: &EvaluateOptions) -> Result<Passes> {
    let layout = read_layout(path)?;
    // A file without the layer for vectors is one without vectors.
    let has_layer = |name: &String| layout.layer(name).is_some_and(|l| l.passes.iter().any(|p| p.name == "Vector"));
    let vector = vector && options.vector_layer.as_ref().is_none_or(has_layer);
    let selection = Selection {
        layers: options.layer.iter().cloned().collect(),
        view: options.view.clone(),
        vector_layer: options.vector_layer.clone().filter(|_| vector),
        guides: Guides { albedo: false, normal: false, depth: false, vector },
        denoised_ok: true,
        ..Selection::default()
    };
    let resolved = resolve(&layout, &selection)?;
    let denoised = resolved.colour.pass != NOISY
        && layout.layer(&resolved.layer).is_some_and(|l| l.pass(NOISY, resolved.view.as_deref()).is_some());
    let frame = read_frame(&layout, &resolved)?;
    Ok(Passes { colour: frame.colour, vector: frame.vector, denoised })
}
