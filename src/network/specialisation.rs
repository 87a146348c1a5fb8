//! Loss specialisation: λ scales and shifts features (Vogels et al. 2018, section 6, with λ an input of the network).

use ndarray::{Array1, Array2, Array4, Axis};

use super::weights::Weights;
use crate::error::Result;
use crate::layers::Conv;
use crate::rules::window::LAMBDA_RANGE;

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

    /// The layer for a λ in 1…64.
    pub fn at(&self, lambda: f32) -> Conv {
        let code = lambda.log2() / LAMBDA_RANGE.1.log2();
        let hidden = (&self.hidden.0.index_axis(Axis(1), 0) * code + &self.hidden.1).mapv(|v| v.max(0.0));
        let scale = self.scale.0.dot(&hidden) + &self.scale.1 + 1.0;
        let shift = self.shift.0.dot(&hidden) + &self.shift.1;
        let weight = &self.weight * &scale.view().insert_axis(Axis(1)).insert_axis(Axis(2)).insert_axis(Axis(3));
        let bias = &self.bias * &scale + shift;
        Conv::new(weight.view(), Some(bias.view()), 1)
    }
}
