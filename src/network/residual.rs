//! Residual block: x + conv(relu(conv(relu(x)))).

use super::weights::Weights;
use crate::error::Result;
use crate::layers::{Activation, Conv, Epilogue, Winograd};
use crate::simd::Isa;

/// A 3×3 convolution of a block.
enum Layer {
    Direct(Conv),
    Winograd(Winograd),
}

impl Layer {
    fn run(&self, isa: Isa, input: &Activation, output: &mut Activation, epilogue: Epilogue) {
        match self {
            Self::Direct(conv) => conv.run(isa, input, output, epilogue),
            Self::Winograd(conv) => conv.run(isa, input, output, epilogue),
        }
    }

    fn run_onto(&self, isa: Isa, input: &Activation, output: &mut Activation, epilogue: Epilogue) {
        match self {
            Self::Direct(conv) => conv.run_onto(isa, input, output, epilogue),
            Self::Winograd(conv) => conv.run_onto(isa, input, output, epilogue),
        }
    }
}

/// Two 3×3 convolutions around which the input is added.
pub struct Residual {
    first: Layer,
    second: Layer,
}

impl Residual {
    /// Takes `{key}.first` and `{key}.second` of the weights, for images that may begin anywhere.
    pub fn direct(weights: &Weights, key: &str, channels: usize) -> Result<Self> {
        let layer = |name: &str| weights.layer(&format!("{key}.{name}"), channels, channels, 1).map(Layer::Direct);
        Ok(Self { first: layer("first")?, second: layer("second")? })
    }

    /// As [`Residual::direct`], cheaper, for images that begin at even rows and columns of the frame's, lest tiles change their bits.
    pub fn winograd(weights: &Weights, key: &str, channels: usize) -> Result<Self> {
        let layer = |name: &str| weights.winograd(&format!("{key}.{name}"), channels, channels).map(Layer::Winograd);
        Ok(Self { first: layer("first")?, second: layer("second")? })
    }

    /// Adds the block's residual to `x`; `scratch` is overwritten.
    pub fn run(&self, isa: Isa, x: &mut Activation, scratch: &mut Activation) {
        self.first.run(isa, x, scratch, Epilogue { relu_input: true, relu_output: true, add: None });
        self.second.run_onto(isa, scratch, x, Epilogue::default());
    }
}
