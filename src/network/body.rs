//! The body: residual blocks at half, quarter and eighth resolution and back, then loss specialisation.

use super::residual::Residual;
use super::specialisation::Specialised;
use super::weights::Weights;
use crate::error::Result;
use crate::layers::{Activation, Conv, Epilogue, Source};
use crate::simd::Isa;

/// Layers between the temporal extractor and the kernel predictors.
pub struct Body {
    half_in: Vec<Residual>,
    to_quarter: Conv,
    quarter_in: Vec<Residual>,
    to_eighth: Conv,
    eighth: Vec<Residual>,
    from_eighth: Specialised,
    quarter_out: Residual,
    from_quarter: Specialised,
    half_out: Vec<Residual>,
}

impl Body {
    /// Takes the body's layers of the weights.
    pub fn new(weights: &Weights) -> Result<Self> {
        let a = &weights.architecture;
        let blocks = |key: &str, count: usize, channels: usize| -> Result<Vec<Residual>> {
            (0..count).map(|i| Residual::winograd(weights, &format!("{key}.{i}"), channels)).collect()
        };
        // Tiles begin at multiples of four half-resolution pixels: any pixel at eighth resolution.
        let eighth = (0..a.blocks_eighth).map(|i| Residual::direct(weights, &format!("eighth.{i}"), a.eighth));
        Ok(Self {
            half_in: blocks("half_in", a.blocks_half, a.half)?,
            to_quarter: weights.layer("to_quarter", a.quarter, a.half, 2)?,
            quarter_in: blocks("quarter_in", a.blocks_quarter, a.quarter)?,
            to_eighth: weights.layer("to_eighth", a.eighth, a.quarter, 2)?,
            eighth: eighth.collect::<Result<_>>()?,
            from_eighth: Specialised::new(weights, "from_eighth", "lambda_quarter", a.quarter, a.eighth + a.quarter)?,
            quarter_out: Residual::winograd(weights, "quarter_out", a.quarter)?,
            from_quarter: Specialised::new(weights, "from_quarter", "lambda_half", a.half, a.quarter + a.half)?,
            half_out: blocks("half_out", a.blocks_out, a.half)?,
        })
    }

    /// Half-resolution pixels around a tile's core that its result depends on, `reach` of them for the kernels themselves.
    pub fn halo(&self, reach: usize) -> usize {
        let half = 2 * (self.half_in.len() + self.half_out.len()) + 1;
        let quarter = 2 * (2 * (self.quarter_in.len() + 1) + 1);
        let eighth = 4 * (2 * self.eighth.len() + 1);
        reach + half + quarter + eighth
    }

    /// Half-, quarter- and eighth-resolution features for a λ, from the temporal extractor's output, which is used up.
    pub fn run(&self, isa: Isa, mut half: Activation, lambda: f32) -> [Activation; 3] {
        let mut scratch = half.same_pool();
        self.half_in.iter().for_each(|block| block.run(isa, &mut half, &mut scratch));
        let relu_input = Epilogue { relu_input: true, ..Default::default() };
        let (mut quarter, mut eighth, mut small) = (half.same_pool(), half.same_pool(), half.same_pool());
        self.to_quarter.run(isa, &half, &mut quarter, relu_input);
        self.quarter_in.iter().for_each(|block| block.run(isa, &mut quarter, &mut small));
        self.to_eighth.run(isa, &quarter, &mut eighth, relu_input);
        self.eighth.iter().for_each(|block| block.run(isa, &mut eighth, &mut small));
        let mut quarter_out = half.same_pool();
        let inputs = [Source::upsampled(&eighth), Source::new(&quarter)];
        self.from_eighth.at(lambda).run_concat(isa, &inputs, &mut quarter_out, Epilogue::default());
        self.quarter_out.run(isa, &mut quarter_out, &mut quarter);
        let inputs = [Source::upsampled(&quarter_out), Source::new(&half)];
        self.from_quarter.at(lambda).run_concat(isa, &inputs, &mut scratch, Epilogue::default());
        self.half_out.iter().for_each(|block| block.run(isa, &mut scratch, &mut half));
        [scratch, quarter_out, eighth]
    }
}
