//! The network: source encoder → warped neighbour features → temporal extractor → loss specialisation → kernel predictors.

pub mod weights;
