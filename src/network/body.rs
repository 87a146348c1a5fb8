//! The body: residual blocks at half, quarter and eighth resolution and back, then loss specialisation.

use ndarray::{Array2, ArrayView2};

use super::residual::Residual;
use super::specialisation::{Codes, Specialised};
use super::weights::Weights;
use crate::error::Result;
use crate::frame::Dial;
use crate::layers::{Activation, Conv, Epilogue, Source};
use crate::simd::Isa;
use crate::tiles::Rect;

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

    /// Half-, quarter- and eighth-resolution features of a region of a frame, from the temporal extractor's output, which is used up.
    pub fn run(&self, isa: Isa, mut half: Activation, (dial, region): (Dial, Rect)) -> [Activation; 3] {
        let lambda = RegionLambda::new(dial, region);
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
        self.from_eighth.run(isa, &inputs, &mut quarter_out, lambda.quarter());
        self.quarter_out.run(isa, &mut quarter_out, &mut quarter);
        let inputs = [Source::upsampled(&quarter_out), Source::new(&half)];
        self.from_quarter.run(isa, &inputs, &mut scratch, lambda.half());
        self.half_out.iter().for_each(|block| block.run(isa, &mut scratch, &mut half));
        [scratch, quarter_out, eighth]
    }
}

/// λ of a region of a frame at the resolutions where the body takes it.
enum RegionLambda<'a> {
    Constant(f32),
    Pixels { half: ArrayView2<'a, f32>, quarter: Array2<f32> },
}

impl<'a> RegionLambda<'a> {
    fn new(dial: Dial<'a>, region: Rect) -> Self {
        match Codes::half(dial, region) {
            Codes::Constant(lambda) => Self::Constant(lambda),
            Codes::Pixels(half) => {
                let at = |y: usize, x: usize| half[[y, x]];
                let mean = |(y, x)| {
                    ((at(2 * y, 2 * x) + at(2 * y, 2 * x + 1)) + (at(2 * y + 1, 2 * x) + at(2 * y + 1, 2 * x + 1))) * 0.25
                };
                let quarter = Array2::from_shape_fn((region.rows / 2, region.columns / 2), mean);
                Self::Pixels { half, quarter }
            }
        }
    }

    fn half(&self) -> Codes<'_> {
        match self {
            Self::Constant(lambda) => Codes::Constant(*lambda),
            Self::Pixels { half, .. } => Codes::Pixels(half.view()),
        }
    }

    fn quarter(&self) -> Codes<'_> {
        match self {
            Self::Constant(lambda) => Codes::Constant(*lambda),
            Self::Pixels { quarter, .. } => Codes::Pixels(quarter.view()),
        }
    }
}
