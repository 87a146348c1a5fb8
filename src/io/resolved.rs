//! What is read and written of a file, and what is missing in it.

use serde::Serialize;

use super::layout::{Channel, Layout, Pass, ViewLayer};

/// A pass with the channels that are used of it, in the order that the frame wants.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PassRef {
    /// Its view layer.
    pub layer: String,
    /// Its name.
    pub pass: String,
    /// Its stereo view.
    pub view: Option<String>,
    /// Where they lie in the file.
    pub channels: Vec<Channel>,
}

/// Data window of a pass: columns, rows, origin.
pub(crate) type DataWindow = (usize, usize, [i32; 2]);

impl PassRef {
    /// A pass of a layer with some of its channels.
    pub(super) fn new(layer: &ViewLayer, pass: &Pass, channels: Vec<Channel>) -> Self {
        Self { layer: layer.name.clone(), pass: pass.name.clone(), view: pass.view.clone(), channels }
    }

    /// The data window of its part.
    pub(crate) fn data_window(&self, layout: &Layout) -> Option<DataWindow> {
        let part = layout.part_list.get(self.channels.first()?.part)?;
        Some((part.columns, part.rows, part.origin))
    }

    /// Where its upper left corner lies in the picture: not at 0, 0 where it is cropped.
    pub(crate) fn origin(&self, layout: &Layout) -> [i32; 2] {
        self.data_window(layout).map_or([0, 0], |(_, _, origin)| origin)
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
    /// The light.
    pub pass: PassRef,
    /// The Color pass that it is multiplied by.
    pub colour: Option<PassRef>,
}

/// A pass that would help and is not there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Missing {
    /// Its name in Blender, or `light` for all of them.
    pub pass: String,
    /// How to get it, in Blender's words.
    pub advice: String,
}

/// What is read, what is written, and what is missing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Resolved {
    /// The view layer that is denoised.
    pub layer: String,
    /// The stereo view that is denoised; None in a file of one view.
    pub view: Option<String>,
    /// Width of every pass that is used, in pixels.
    pub columns: usize,
    /// Height of every pass that is used, in pixels.
    pub rows: usize,
    /// The noisy beauty, R, G, B.
    pub colour: PassRef,
    /// The alpha channel beside it.
    pub alpha: Option<Channel>,
    /// The pass that is replaced by the denoised beauty, R, G, B; the same as `colour` unless that is `Noisy Image`.
    pub target: PassRef,
    /// The alpha channel beside the target.
    pub target_alpha: Option<Channel>,
    /// Whether `colour` is certain to be noisy: it is `Noisy Image`, or Blender stored its denoising passes without one. Where
    /// false, nothing in the file tells whether Cycles denoised it.
    pub surely_noisy: bool,
    /// R, G, B.
    pub albedo: Option<PassRef>,
    /// X, Y, Z.
    pub normal: Option<PassRef>,
    /// One channel.
    pub depth: Option<PassRef>,
    /// X, Y, Z, W.
    pub vector: Option<PassRef>,
    /// The light passes that are denoised along.
    pub aovs: Vec<AovRef>,
    /// The mask of λ, one channel.
    pub lambda_mask: Option<PassRef>,
    /// Guides that were asked for and are not there.
    pub missing: Vec<Missing>,
    /// What the user should know about these choices.
    pub notes: Vec<String>,
}

impl Resolved {
    /// Every channel that is read.
    pub fn channels(&self) -> impl Iterator<Item = &Channel> {
        let guides = [&self.albedo, &self.normal, &self.depth, &self.vector, &self.lambda_mask].into_iter().flatten();
        let lights = self.aovs.iter().flat_map(|a| [Some(&a.pass), a.colour.as_ref()]).flatten();
        [&self.colour].into_iter().chain(guides).chain(lights).flat_map(|p| &p.channels).chain(&self.alpha)
    }
}
