//! What the user wants of a file: view layers, guides, light passes, and what the passes are called.

use super::lambda_mask::LambdaImages;
use super::pass_names::PassNames;

/// The pass that holds the noisy beauty where Cycles denoised Combined.
pub(crate) const NOISY: &str = "Noisy Image";
/// The view layer that the extension's Prepare Shot adds for motion vectors, where the others have motion blur.
const VECTOR_LAYER: &str = "Hush Vectors";

/// Which guides may be used where they are present.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Guides {
    /// Denoising Albedo.
    pub albedo: bool,
    /// Denoising Normal.
    pub normal: bool,
    /// Denoising Depth, else Depth.
    pub depth: bool,
    /// Vector: without it neighbours cannot help.
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
    /// The guides that may be used.
    pub guides: Guides,
    /// Light passes to denoise along with the beauty, by Blender 5's or 4's names, or `all`.
    pub aovs: Vec<String>,
    /// The pass that holds the mask of λ, 0…1, by its name or as `Layer.name`.
    pub lambda_pass: Option<String>,
    /// Images that hold the mask of λ; the pass is not looked at then.
    pub lambda_images: Option<LambdaImages>,
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
