//! One frame's passes in memory.

pub(crate) mod exposure;
pub(crate) mod lambda_map;
pub(crate) mod packed;
pub(crate) mod pixels;
pub(crate) mod ranges;
pub(crate) mod sanitise;

use std::ops::Range;

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, s};

use crate::error::{Error, Result};
pub use lambda_map::{Dial, LambdaMap, LambdaMask, OwnedDial};

/// An additive light pass (a contribution to the beauty) that is denoised with the beauty's kernels.
#[derive(Clone, Debug)]
pub struct Aov {
    /// The pass's name, as the user gave it.
    pub name: String,
    /// (rows, columns, 3), linear radiance.
    pub image: Array3<f32>,
}

/// The passes of one frame, all of one size. Arrays may have any strides.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Noisy beauty, (rows, columns, 3), scene-linear; NaN, Inf and negative values are sanitised by the engine.
    pub colour: Array3<f32>,
    /// Alpha, (rows, columns), 0…1, by which the beauty is premultiplied. None is 1 everywhere, in less memory.
    pub alpha: Option<Array2<f32>>,
    /// Denoising Albedo, (rows, columns, 3); more than 1 counts as 1.
    pub albedo: Option<Array3<f32>>,
    /// Denoising Normal, camera space, −1…1, (rows, columns, 3).
    pub normal: Option<Array3<f32>>,
    /// Denoising Depth or Depth, (rows, columns), in any unit: 0 and 1e9 or more are background.
    pub depth: Option<Array2<f32>>,
    /// Cycles' Vector pass, (rows, columns, 4), in pixels, y up. X, Y: a point's place in the frame before minus its place here; Z, W: its
    /// place here minus its place in the next frame.
    pub vector: Option<Array3<f32>>,
    /// Light passes that are denoised with the same kernels.
    pub aovs: Vec<Aov>,
    /// Which pixels have another λ, 0…1, (rows, columns); kept with the encoded frame as a [`LambdaMask`].
    pub lambda_mask: Option<Array2<f32>>,
}

impl Frame {
    /// A frame of a beauty alone.
    pub fn new(colour: Array3<f32>) -> Self {
        let (alpha, depth, lambda_mask) = (None, None, None);
        Self { colour, alpha, albedo: None, normal: None, depth, vector: None, aovs: Vec::new(), lambda_mask }
    }

    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        self.view().size()
    }

    /// Checks that every pass has the beauty's size and the right number of channels.
    pub fn check(&self) -> Result<()> {
        self.view().check()
    }

    /// The same passes, borrowed.
    pub fn view(&self) -> FrameView<'_> {
        FrameView {
            colour: self.colour.view(),
            alpha: self.alpha.as_ref().map(|p| p.view()),
            albedo: self.albedo.as_ref().map(|p| p.view()),
            normal: self.normal.as_ref().map(|p| p.view()),
            depth: self.depth.as_ref().map(|p| p.view()),
            vector: self.vector.as_ref().map(|p| p.view()),
            aovs: self.aovs.iter().map(|a| (a.name.as_str(), a.image.view())).collect(),
            lambda_mask: self.lambda_mask.as_ref().map(|p| p.view()),
        }
    }
}

/// One denoised frame, the same sizes and passes as the input.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// (rows, columns, 3), scene-linear.
    pub colour: Array3<f32>,
    /// (rows, columns), 0…1, where the frame or one that helped it had alpha.
    pub alpha: Option<Array2<f32>>,
    /// The light passes, in the input's order.
    pub aovs: Vec<Aov>,
}

/// The passes of one frame where they lie; what each is stands with [`Frame`].
#[derive(Clone, Debug)]
pub struct FrameView<'a> {
    /// Noisy beauty, (rows, columns, 3).
    pub colour: ArrayView3<'a, f32>,
    /// (rows, columns).
    pub alpha: Option<ArrayView2<'a, f32>>,
    /// (rows, columns, 3).
    pub albedo: Option<ArrayView3<'a, f32>>,
    /// (rows, columns, 3).
    pub normal: Option<ArrayView3<'a, f32>>,
    /// (rows, columns).
    pub depth: Option<ArrayView2<'a, f32>>,
    /// (rows, columns, 4).
    pub vector: Option<ArrayView3<'a, f32>>,
    /// Light passes: name, and image (rows, columns, 3).
    pub aovs: Vec<(&'a str, ArrayView3<'a, f32>)>,
    /// (rows, columns).
    pub lambda_mask: Option<ArrayView2<'a, f32>>,
}

impl<'a> FrameView<'a> {
    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        (self.colour.dim().0, self.colour.dim().1)
    }

    /// These rows and columns of every pass; panics where there are no such.
    pub fn part(&self, rows: Range<usize>, columns: Range<usize>) -> Self {
        let plane = |p: &ArrayView2<'a, f32>| p.slice_move(s![rows.clone(), columns.clone()]);
        let image = |p: &ArrayView3<'a, f32>| p.slice_move(s![rows.clone(), columns.clone(), ..]);
        FrameView {
            colour: image(&self.colour),
            alpha: self.alpha.as_ref().map(plane),
            albedo: self.albedo.as_ref().map(image),
            normal: self.normal.as_ref().map(image),
            depth: self.depth.as_ref().map(plane),
            vector: self.vector.as_ref().map(image),
            aovs: self.aovs.iter().map(|(name, pass)| (*name, image(pass))).collect(),
            lambda_mask: self.lambda_mask.as_ref().map(plane),
        }
    }

    /// Checks that every pass has the beauty's size and the right number of channels.
    pub fn check(&self) -> Result<()> {
        let (rows, columns) = self.size();
        let mut shapes = vec![("colour", self.colour.dim(), 3)];
        shapes.extend(self.albedo.as_ref().map(|p| ("albedo", p.dim(), 3)));
        shapes.extend(self.normal.as_ref().map(|p| ("normal", p.dim(), 3)));
        shapes.extend(self.vector.as_ref().map(|p| ("vector", p.dim(), 4)));
        shapes.extend(self.depth.as_ref().map(|p| ("depth", (p.dim().0, p.dim().1, 1), 1)));
        shapes.extend(self.alpha.as_ref().map(|p| ("alpha", (p.dim().0, p.dim().1, 1), 1)));
        shapes.extend(self.lambda_mask.as_ref().map(|p| ("lambda mask", (p.dim().0, p.dim().1, 1), 1)));
        shapes.extend(self.aovs.iter().map(|(name, image)| (*name, image.dim(), 3)));
        for (what, (r, c, channels), expected) in shapes {
            if (r, c) != (rows, columns) {
                return Err(Error::SizeMismatch { what: what.into(), columns, rows, found_columns: c, found_rows: r });
            }
            if channels != expected {
                return Err(Error::BadInput {
                    input: what.into(),
                    reason: format!("has {channels} channels, expected {expected}"),
                });
            }
        }
        Ok(())
    }
}
