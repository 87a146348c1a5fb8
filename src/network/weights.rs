//! The weights file: safetensors with the architecture, the training record and the measured numbers in its header.

use std::collections::HashMap;
use std::path::Path;
use std::sync::LazyLock;

use ndarray::{Array1, Array4, ArrayD, Ix1, Ix4, s};
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};

pub use super::model_id::EMBEDDED;
use super::model_id::ModelId;
use super::renderers;
use crate::error::{Error, Result};
use crate::layers::{Conv, Dense, Winograd};

/// The description of architectures that this build reads.
const VERSION: u32 = 2;
/// Pyramid levels at most.
pub const LEVELS: usize = 4;
/// The header key under which the architecture stands, as JSON.
const ARCHITECTURE_KEY: &str = "hush.architecture";
/// The largest weights file that is read, in bytes.
const SIZE_LIMIT: u64 = 256 << 20;

/// Everything that the network needs to build itself (`Architecture` in `training/network/model.py`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Architecture {
    /// Of this description; this build reads version 2.
    pub version: u32,
    /// Channels of the source encoder's features, at half resolution.
    pub features: usize,
    /// Channels of the body at half resolution.
    pub half: usize,
    /// Channels of the body at quarter resolution.
    pub quarter: usize,
    /// Channels of the body at eighth resolution.
    pub eighth: usize,
    /// Residual blocks of the source encoder.
    pub blocks_encoder: usize,
    /// Residual blocks on the way down at half resolution.
    pub blocks_half: usize,
    /// Residual blocks on the way down at quarter resolution.
    pub blocks_quarter: usize,
    /// Residual blocks at eighth resolution.
    pub blocks_eighth: usize,
    /// Residual blocks before the kernel predictors at half resolution.
    pub blocks_out: usize,
    /// Channels of the kernel predictor's layer for one neighbour.
    pub pair: usize,
    /// Hidden units between λ and the loss specialisation.
    pub lambda_hidden: usize,
    /// Width of the centre frame's kernels, in taps.
    pub centre_taps: usize,
    /// Width of a neighbour's kernels, in taps.
    pub neighbour_taps: usize,
    /// Width of the kernels that take in the coarser pyramid level, in taps.
    pub coarse_taps: usize,
    /// Width of the albedo's kernels in the centre frame, in taps.
    pub albedo_taps: usize,
    /// Levels on which the albedo is filtered, from full resolution down, 1 or 3; 1 in files that do not say.
    #[serde(default = "one")]
    pub albedo_levels: usize,
    /// Pyramid levels.
    pub levels: usize,
    /// What is added to the albedo before dividing by it.
    pub albedo_epsilon: f32,
    /// Whether the temporal extractor is told how noisy a pixel is, 0 or 1; 0 in files that do not say.
    #[serde(default)]
    pub variance: usize,
    /// Whether a second pass averages the results of the frames around, 0 or 1; 0 in files that do not say.
    #[serde(default)]
    pub second_pass: usize,
}

fn one() -> usize {
    1
}

impl Architecture {
    fn check(&self) -> std::result::Result<(), String> {
        if self.version != VERSION {
            return Err(format!("architecture version {} is not {VERSION}: use a Hush that knows it", self.version));
        }
        if !(3..=LEVELS).contains(&self.levels) {
            return Err(format!("{} pyramid levels, this build computes 3 or {LEVELS}", self.levels));
        }
        if ![1, 3].contains(&self.albedo_levels) {
            return Err(format!("the albedo on {} levels, this build filters it on 1 or 3", self.albedo_levels));
        }
        if self.variance > 1 {
            return Err(format!("variance {} must be 0 or 1", self.variance));
        }
        if self.second_pass > 1 {
            return Err(format!("second_pass {} must be 0 or 1", self.second_pass));
        }
        let widths = [self.features, self.half, self.quarter, self.eighth, self.pair];
        if widths.iter().any(|w| *w == 0 || w % 16 != 0 || *w > 256) {
            return Err(format!("channel widths {widths:?} must be multiples of 16 up to 256"));
        }
        let taps = [self.centre_taps, self.neighbour_taps, self.coarse_taps, self.albedo_taps];
        if taps.iter().any(|t| t % 2 == 0 || *t > 9) {
            return Err(format!("kernel widths {taps:?} must be odd, up to 9"));
        }
        let blocks = [self.blocks_encoder, self.blocks_half, self.blocks_quarter, self.blocks_eighth, self.blocks_out];
        if blocks.iter().any(|count| *count > 16) || self.lambda_hidden == 0 || self.lambda_hidden > 1024 {
            return Err("more layers than any sound model has".into());
        }
        if !(self.albedo_epsilon > 0.0 && self.albedo_epsilon <= 1.0) {
            return Err(format!("albedo_epsilon {} must be in (0, 1]", self.albedo_epsilon));
        }
        Ok(())
    }
}

/// Whether weights of which only the header is looked at have a second pass; false for what are none.
pub(crate) fn has_second_pass(bytes: &[u8]) -> bool {
    let architecture = || -> Option<Architecture> {
        let (_, metadata) = SafeTensors::read_metadata(bytes).ok()?;
        serde_json::from_str(metadata.metadata().as_ref()?.get(ARCHITECTURE_KEY)?).ok()
    };
    architecture().is_some_and(|a| a.second_pass > 0)
}

/// Whether the weights that this build carries have a second pass.
pub(crate) fn embedded_second_pass() -> bool {
    static EMBEDDED_HAVE: LazyLock<bool> = LazyLock::new(|| has_second_pass(EMBEDDED));
    *EMBEDDED_HAVE
}

/// A weights file in memory.
#[derive(Clone, Debug)]
pub struct Weights {
    /// The file's name, or "embedded".
    pub name: String,
    /// What tells them apart from others.
    pub id: ModelId,
    /// What the network is built from.
    pub architecture: Architecture,
    /// The renderers that the file has a source encoder for, the default first.
    pub renderers: Vec<String>,
    /// The renderer that was asked for, if one was.
    pub renderer: Option<String>,
    /// The rest of the header: training data, steps, validation numbers.
    pub record: HashMap<String, String>,
    tensors: HashMap<String, ArrayD<f32>>,
}

impl Weights {
    /// The weights that this build carries.
    pub fn embedded() -> Result<Self> {
        Self::from_bytes("embedded", EMBEDDED)
    }

    /// Reads a weights file. Refuses, with the reason, whatever is not a sound Hush model.
    pub fn from_file(path: &Path) -> Result<Self> {
        let size = std::fs::metadata(path).map_err(|e| Error::io(path, e))?.len();
        if size > SIZE_LIMIT {
            return Err(bad(&path.display().to_string(), format!("{} MiB is more than a Hush model has", size >> 20)));
        }
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        Self::from_bytes(&path.display().to_string(), &bytes)
    }

    /// Reads a weights file's bytes; `name` is for messages.
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self> {
        let refuse = |reason: String| bad(name, reason);
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| refuse(format!("not a safetensors file: {e}")))?;
        let mut record = metadata.metadata().clone().unwrap_or_default();
        let text = record
            .remove(ARCHITECTURE_KEY)
            .ok_or_else(|| refuse(format!("the header has no {ARCHITECTURE_KEY}: not a Hush model")))?;
        let architecture: Architecture = serde_json::from_str(&text).map_err(|e| refuse(format!("{ARCHITECTURE_KEY}: {e}")))?;
        architecture.check().map_err(refuse)?;
        let renderers = renderers::named(record.remove(renderers::ENCODERS_KEY).as_deref()).map_err(refuse)?;
        let file = SafeTensors::deserialize(bytes).map_err(|e| refuse(format!("damaged: {e}")))?;
        let mut tensors = HashMap::new();
        for (key, view) in file.iter() {
            let values: Vec<f32> = match view.dtype() {
                Dtype::F32 => view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
                Dtype::F16 => view.data().as_chunks::<2>().0.iter().map(|b| half::f16::from_le_bytes(*b).to_f32()).collect(),
                other => return Err(refuse(format!("tensor {key} is {other:?}, expected F32 or F16"))),
            };
            if values.iter().any(|v| !v.is_finite()) {
                return Err(refuse(format!("tensor {key} holds values that are not finite")));
            }
            let array = ArrayD::from_shape_vec(view.shape(), values).map_err(|e| refuse(format!("tensor {key}: {e}")))?;
            tensors.insert(key.to_string(), array);
        }
        renderers::check(&tensors, &renderers).map_err(refuse)?;
        let id = ModelId::of_bytes(Path::new(name), bytes);
        Ok(Self { name: name.into(), id, architecture, renderers, renderer: None, record, tensors })
    }

    /// The weights of a file, or those that this build carries, with the encoder of a renderer; None is the file's first.
    pub fn open(path: Option<&Path>, renderer: Option<&str>) -> Result<Self> {
        path.map_or_else(Self::embedded, Self::from_file)?.for_renderer(renderer)
    }

    /// These weights with the encoder of one of [`renderers`](Self::renderers), whatever its case, and of that one only; None is
    /// the first.
    ///
    /// # Errors
    /// [`Error::BadSetting`], naming those there are, where the weights have no encoder for it.
    pub fn for_renderer(mut self, renderer: Option<&str>) -> Result<Self> {
        let name = renderers::choose(&mut self.tensors, &self.renderers, renderer, &self.name)?;
        self.renderers = vec![name];
        self.renderer = renderer.map(str::to_owned);
        Ok(self)
    }

    /// The same weights as of an architecture without what came later.
    #[cfg(test)]
    pub(crate) fn make_older(&mut self) {
        let inputs = self.architecture.features + self.architecture.half;
        (self.architecture.albedo_levels, self.architecture.variance, self.architecture.second_pass) = (1, 0, 0);
        let mix = &mut self.tensors.get_mut("mix.weight").expect("every network has it");
        **mix = mix.slice_axis(ndarray::Axis(1), (..inputs).into()).to_owned();
    }

    fn take(&self, key: &str, shape: &[usize]) -> Result<ArrayD<f32>> {
        let tensor = self.tensors.get(key).ok_or_else(|| bad(&self.name, format!("tensor {key} is missing")))?;
        if tensor.shape() != shape {
            return Err(bad(
                &self.name,
                format!("tensor {key} has shape {:?}, the architecture wants {shape:?}", tensor.shape()),
            ));
        }
        Ok(tensor.clone())
    }

    /// A convolution's weights (outputs, inputs, size, size) and bias (outputs), or no bias where `biased` is false.
    #[doc(hidden)]
    pub fn conv(
        &self,
        key: &str,
        outputs: usize,
        inputs: usize,
        size: usize,
        biased: bool,
    ) -> Result<(Array4<f32>, Option<Array1<f32>>)> {
        let weight = self.take(&format!("{key}.weight"), &[outputs, inputs, size, size])?;
        let weight = weight.into_dimensionality::<Ix4>().map_err(|e| bad(&self.name, format!("{key}: {e}")))?;
        let bias = if biased { Some(self.vector(&format!("{key}.bias"), outputs)?) } else { None };
        Ok((weight, bias))
    }

    /// A 1×1 layer.
    #[doc(hidden)]
    pub fn dense(&self, key: &str, outputs: usize, inputs: usize, biased: bool) -> Result<Dense> {
        let (weight, bias) = self.conv(key, outputs, inputs, 1, biased)?;
        Ok(Dense::new(weight.slice(s![.., .., 0, 0]), bias.as_ref().map(|b| b.view())))
    }

    /// A 3×3 convolution with bias, ready to run at `stride` 1 or 2.
    #[doc(hidden)]
    pub fn layer(&self, key: &str, outputs: usize, inputs: usize, stride: usize) -> Result<Conv> {
        let (weight, bias) = self.conv(key, outputs, inputs, 3, true)?;
        Ok(Conv::new(weight.view(), bias.as_ref().map(|b| b.view()), stride))
    }

    /// A 3×3 convolution with bias, done after Winograd.
    #[doc(hidden)]
    pub fn winograd(&self, key: &str, outputs: usize, inputs: usize) -> Result<Winograd> {
        let (weight, bias) = self.conv(key, outputs, inputs, 3, true)?;
        Ok(Winograd::new(weight.view(), bias.unwrap_or_else(|| Array1::zeros(outputs)).view()))
    }

    /// A fully connected layer's weights (outputs, inputs) and bias (outputs).
    #[doc(hidden)]
    pub fn linear(&self, key: &str, outputs: usize, inputs: usize) -> Result<(ndarray::Array2<f32>, Array1<f32>)> {
        let weight = self.take(&format!("{key}.weight"), &[outputs, inputs])?;
        let weight = weight.into_dimensionality().map_err(|e| bad(&self.name, format!("{key}: {e}")))?;
        Ok((weight, self.vector(&format!("{key}.bias"), outputs)?))
    }

    fn vector(&self, key: &str, len: usize) -> Result<Array1<f32>> {
        let tensor = self.take(key, &[len])?;
        tensor.into_dimensionality::<Ix1>().map_err(|e| bad(&self.name, format!("{key}: {e}")))
    }
}

fn bad(model: &str, reason: String) -> Error {
    Error::BadModel { model: model.into(), reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedded_model_loads_and_says_how_it_was_trained() {
        let weights = Weights::embedded().unwrap();
        assert_eq!(weights.architecture.version, VERSION);
        assert!(weights.record.contains_key("hush.training"), "{:?}", weights.record);
    }

    #[test]
    fn damaged_files_are_refused_with_a_reason() {
        for cut in [0, 7, 8, 100, EMBEDDED.len() / 2, EMBEDDED.len() - 1] {
            assert!(matches!(Weights::from_bytes("cut", &EMBEDDED[..cut]), Err(Error::BadModel { .. })), "cut at {cut}");
        }
        assert!(Weights::from_bytes("garbage", &[0xff; 4096]).is_err());
        let mut other = EMBEDDED.to_vec();
        let at = other.windows(13).position(|w| w == b"\\\"features\\\":").unwrap();
        other[at + 14] = b'9';
        assert!(matches!(Weights::from_bytes("edited", &other), Err(Error::BadModel { .. })));
    }

    #[test]
    fn a_missing_or_misshapen_tensor_is_named() {
        let weights = Weights::embedded().unwrap();
        let message = weights.conv("no_such_layer", 1, 1, 1, true).unwrap_err().to_string();
        assert!(message.contains("no_such_layer.weight is missing"), "{message}");
        let message = weights.conv("encoder.first", 1, 1, 1, true).unwrap_err().to_string();
        assert!(message.contains("encoder.first.weight has shape"), "{message}");
    }
}
