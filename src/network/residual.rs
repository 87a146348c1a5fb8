//! Residual block: x + conv(relu(conv(relu(x)))).

use super::weights::Weights;
use crate::error::Result;
use crate::simd::{Activation, Conv, Epilogue, Isa};

/// Two 3×3 convolutions around which the input is added.
pub struct Residual {
    first: Conv,
    second: Conv,
}

impl Residual {
    /// Takes `{key}.first` and `{key}.second` of the weights.
    pub fn new(weights: &Weights, key: &str, channels: usize) -> Result<Self> {
        let layer = |name: &str| weights.layer(&format!("{key}.{name}"), channels, channels, 1);
        Ok(Self { first: layer("first")?, second: layer("second")? })
    }

    /// Adds the block's residual to `x`; `scratch` is overwritten.
    pub fn run(&self, isa: Isa, x: &mut Activation, scratch: &mut Activation) {
        self.first.run(isa, x, scratch, Epilogue { relu_input: true, relu_output: true, add: None });
        self.second.run_onto(isa, scratch, x, Epilogue::default());
    }
}
