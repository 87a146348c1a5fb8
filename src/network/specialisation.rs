//! Loss specialisation: λ scales and shifts features (Vogels et al. 2018, section 6, with λ an input of the network).

use ndarray::{Array1, Array2, Array4, ArrayView2, Axis, s};
use rayon::prelude::*;

use super::weights::Weights;
use crate::error::Result;
use crate::frame::Dial;
use crate::frame::lambda_map::code;
use crate::layers::{Activation, Conv, Epilogue, Source};
use crate::simd::{Isa, LANES, Simd, dispatch};
use crate::tiles::Rect;

/// A 1×1 layer whose output λ scales and shifts; both fold into the layer's weights.
pub struct Specialised {
    weight: Array4<f32>,
    bias: Array1<f32>,
    hidden: (Array2<f32>, Array1<f32>),
    scale: (Array2<f32>, Array1<f32>),
    shift: (Array2<f32>, Array1<f32>),
}

impl Specialised {
    /// Takes the 1×1 layer `{layer}` and the specialisation `{key}` of the weights.
    pub fn new(weights: &Weights, layer: &str, key: &str, outputs: usize, inputs: usize) -> Result<Self> {
        let hidden = weights.architecture.lambda_hidden;
        let (weight, bias) = weights.conv(layer, outputs, inputs, 1, true)?;
        Ok(Self {
            weight,
            bias: bias.unwrap_or_else(|| Array1::zeros(outputs)),
            hidden: weights.linear(&format!("{key}.hidden"), hidden, 1)?,
            scale: weights.linear(&format!("{key}.scale"), outputs, hidden)?,
            shift: weights.linear(&format!("{key}.shift"), outputs, hidden)?,
        })
    }

    /// The layer on the inputs' channels joined, scaled and shifted by a λ in 1…64, or by what each pixel's code says.
    pub fn run(&self, isa: Isa, inputs: &[Source], output: &mut Activation, lambda: Codes) {
        match lambda {
            Codes::Constant(lambda) => self.at(lambda).run_concat(isa, inputs, output, Epilogue::default()),
            Codes::Pixels(codes) => {
                let layer = Conv::new(self.weight.view(), Some(self.bias.view()), 1);
                layer.run_concat(isa, inputs, output, Epilogue::default());
                self.pieces().run(isa, output, codes);
            }
        }
    }

    /// The layer for a λ in 1…64.
    fn at(&self, lambda: f32) -> Conv {
        let hidden = (&self.hidden.0.index_axis(Axis(1), 0) * code(lambda) + &self.hidden.1).mapv(|v| v.max(0.0));
        let scale = self.scale.0.dot(&hidden) + &self.scale.1 + 1.0;
        let shift = self.shift.0.dot(&hidden) + &self.shift.1;
        let weight = &self.weight * &scale.view().insert_axis(Axis(1)).insert_axis(Axis(2)).insert_axis(Axis(3));
        let bias = &self.bias * &scale + shift;
        Conv::new(weight.view(), Some(bias.view()), 1)
    }

    /// Scale and shift as functions of the code: ReLUs of one number are straight between the codes where a unit switches.
    fn pieces(&self) -> Pieces {
        let (slope, offset) = (self.hidden.0.index_axis(Axis(1), 0), &self.hidden.1);
        let mut knots: Vec<f32> = slope.iter().zip(offset).map(|(w, b)| -b / w).filter(|k| *k > 0.0 && *k < 1.0).collect();
        knots.sort_by(f32::total_cmp);
        let mut lines = Vec::with_capacity((knots.len() + 1) * 4 * self.bias.len());
        for piece in 0..=knots.len() {
            let from = piece.checked_sub(1).map_or(0.0, |before| knots[before]);
            let middle = 0.5 * (from + knots.get(piece).copied().unwrap_or(1.0));
            let is_on = slope.mapv(|w| w * middle) + offset;
            let on = |values: &Array1<f32>| Array1::from_shape_fn(values.len(), |i| if is_on[i] > 0.0 { values[i] } else { 0.0 });
            let (slope, offset) = (on(&slope.to_owned()), on(offset));
            lines.extend(self.scale.0.dot(&slope));
            lines.extend(self.scale.0.dot(&offset) + &self.scale.1 + 1.0);
            lines.extend(self.shift.0.dot(&slope));
            lines.extend(self.shift.0.dot(&offset) + &self.shift.1);
        }
        Pieces { knots, lines }
    }
}

/// What the specialisation is told of λ.
#[derive(Clone, Copy)]
pub enum Codes<'a> {
    /// λ of all pixels, 1…64.
    Constant(f32),
    /// log₂ λ over log₂ 64 of each pixel of the output.
    Pixels(ArrayView2<'a, f32>),
}

impl<'a> Codes<'a> {
    /// Of a region at half resolution.
    pub fn half(dial: Dial<'a>, region: Rect) -> Self {
        match dial {
            Dial::Constant(lambda) => Self::Constant(lambda),
            Dial::Map(map) => {
                let rows = region.row..region.row + region.rows;
                Self::Pixels(map.codes().slice_move(s![rows, region.column..region.column + region.columns]))
            }
        }
    }

    /// log₂ λ over log₂ 64 at a pixel.
    #[inline(always)]
    pub fn at(&self, y: usize, x: usize) -> f32 {
        match self {
            Self::Constant(lambda) => code(*lambda),
            Self::Pixels(codes) => codes[[y, x]],
        }
    }
}

/// Scale and shift of each channel, straight lines over the code from knot to knot.
struct Pieces {
    /// Ascending, in 0…1.
    knots: Vec<f32>,
    /// For each piece, one more than there are knots: the scales' slopes and values at code 0, then the shifts'.
    lines: Vec<f32>,
}

impl Pieces {
    /// Scales and shifts each pixel by its code.
    fn run(&self, isa: Isa, output: &mut Activation, codes: ArrayView2<f32>) {
        let (rows, columns, channels) = output.shape();
        assert_eq!(codes.dim(), (rows, columns), "one code for each pixel");
        assert!(channels.is_multiple_of(LANES), "{channels} channels are no whole vectors");
        let width = (columns * channels).max(1);
        output.as_mut_slice().par_chunks_mut(width).enumerate().for_each(|(y, pixels)| {
            let codes: Vec<f32> = codes.row(y).to_vec();
            modulate(isa, self, channels, &codes, pixels);
        });
    }
}

#[inline(always)]
fn modulate_row<S: Simd>(s: S, pieces: &Pieces, channels: usize, codes: &[f32], pixels: &mut [f32]) {
    for (pixel, code) in pixels.chunks_exact_mut(channels).zip(codes) {
        let piece = pieces.knots.iter().map(|knot| usize::from(knot <= code)).sum::<usize>();
        let lines = &pieces.lines[piece * 4 * channels..][..4 * channels];
        let code = s.splat(*code);
        for c in (0..channels).step_by(LANES) {
            let line = |k: usize| s.load(lines, k * channels + c);
            let (scale, shift) = (s.fma(line(0), code, line(1)), s.fma(line(2), code, line(3)));
            s.store(s.fma(s.load(pixel, c), scale, shift), pixel, c);
        }
    }
}

dispatch! {
    /// Scales and shifts a row of pixels.
    fn modulate(pieces: &Pieces, channels: usize, codes: &[f32], pixels: &mut [f32]) = modulate_row
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The layers of the embedded weights, with their channels.
    fn layers() -> [(Specialised, usize); 2] {
        let weights = Weights::embedded().unwrap();
        let a = &weights.architecture;
        let quarter = Specialised::new(&weights, "from_eighth", "lambda_quarter", a.quarter, a.eighth + a.quarter).unwrap();
        let half = Specialised::new(&weights, "from_quarter", "lambda_half", a.half, a.quarter + a.half).unwrap();
        [(quarter, a.eighth + a.quarter), (half, a.quarter + a.half)]
    }

    fn input(channels: usize) -> Activation {
        let mut input = Activation::new(3, 37, channels);
        let values = input.as_mut_slice().iter_mut().enumerate();
        values.for_each(|(i, v)| *v = ((i as u32).wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 23) as f32 - 1.0);
        input
    }

    #[test]
    fn each_pixels_code_gives_what_its_constant_gives() {
        let mut knots = 0;
        for (layer, channels) in layers() {
            let (input, pieces) = (input(channels), layer.pieces());
            knots += pieces.knots.len();
            let at_knots = pieces.knots.iter().map(|knot| 64f32.powf(*knot));
            let lambdas: Vec<f32> = [1.0, 1.01, 3.0, 8.0, 40.0, 63.9, 64.0].into_iter().chain(at_knots).collect();
            for isa in Isa::available() {
                let mixed = Array2::from_shape_fn((3, 37), |(y, x)| code(lambdas[(37 * y + x) % lambdas.len()]));
                let mut by_pixel = input.same_pool();
                layer.run(isa, &[Source::new(&input)], &mut by_pixel, Codes::Pixels(mixed.view()));
                for (i, lambda) in lambdas.iter().enumerate() {
                    let mut constant = input.same_pool();
                    layer.run(isa, &[Source::new(&input)], &mut constant, Codes::Constant(*lambda));
                    let scale = constant.as_slice().iter().fold(0.0f32, |most, v| most.max(v.abs()));
                    for pixel in (i..3 * 37).step_by(lambdas.len()) {
                        let (y, x) = (pixel / 37, pixel % 37);
                        let (a, b) = (by_pixel.view(), constant.view());
                        let off = (0..a.dim().2).map(|c| (a[[y, x, c]] - b[[y, x, c]]).abs());
                        let worst = off.fold(0.0, |most: f32, off| if off > most || off.is_nan() { off } else { most });
                        assert!(worst <= 1e-5 * scale, "{isa:?}, λ {lambda}: {worst} of {scale}");
                    }
                }
            }
        }
        assert!(knots > 0, "with one piece alone there is little to compare");
    }
}
