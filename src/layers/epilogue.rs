//! What happens around the products of a convolution.

use super::activation::Activation;

/// What is done to the input as it is read and to the output before it is written.
#[derive(Clone, Copy, Debug, Default)]
pub struct Epilogue<'a> {
    /// ReLU on the input as it is read.
    pub relu_input: bool,
    /// ReLU on the output, after `add`.
    pub relu_output: bool,
    /// Added to the output: the same size as the whole output.
    pub add: Option<&'a Activation>,
}
