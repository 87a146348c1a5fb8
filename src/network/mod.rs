//! The network: source encoder → warped neighbour features → temporal extractor → loss specialisation → kernel predictors.

pub mod body;
pub mod encoder;
pub mod features;
pub mod gathered;
pub mod levels;
pub(crate) mod logits;
pub mod model_id;
pub(crate) mod motion;
pub mod pairs;
pub mod predictor;
pub mod renderers;
pub mod residual;
pub(crate) mod second_pass;
pub mod specialisation;
pub mod temporal;
pub mod variance;
pub mod warp;
pub mod weights;
