//! Residual block: x + conv(relu(conv(relu(x)))).

use super::weights::Weights;
use crate::error::Result;
use crate::simd::{Activation, Conv, Epilogue, Isa, Winograd};

/// Two 3×3 convolutions around which the input is added.
pub enum Residual {
    Direct([Conv; 2]),
    /// Cheaper; the image must begin at an even row and column of the frame's, lest tiles change its bits.
    Winograd([Winograd; 2]),
}

impl Residual {
    /// Takes `{key}.first` and `{key}.second` of the weights, for images that may begin anywhere.
    pub fn direct(weights: &Weights, key: &str, channels: usize) -> Result<Self> {
        let layer = |name: &str| weights.layer(&format!("{key}.{name}"), channels, channels, 1);
        Ok(Self::Direct([layer("first")?, layer("second")?]))
    }

    /// Takes `{key}.first` and `{key}.second` of the weights, for images that begin at even rows and columns.
    pub fn winograd(weights: &Weights, key: &str, channels: usize) -> Result<Self> {
        let layer = |name: &str| weights.winograd(&format!("{key}.{name}"), channels, channels);
        Ok(Self::Winograd([layer("first")?, layer("second")?]))
    }

    /// Adds the block's residual to `x`; `scratch` is overwritten.
    pub fn run(&self, isa: Isa, x: &mut Activation, scratch: &mut Activation) {
        let both = Epilogue { relu_input: true, relu_output: true, add: None };
        match self {
            Self::Direct([first, second]) => {
                first.run(isa, x, scratch, both);
                second.run_onto(isa, scratch, x, Epilogue::default());
            }
            Self::Winograd([first, second]) => {
                first.run(isa, x, scratch, both);
                second.run_onto(isa, scratch, x, Epilogue::default());
            }
        }
    }
}
