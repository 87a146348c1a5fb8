//! What decides an engine's results besides its inputs: a frame that another one made is out of date.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
pub use crate::network::model_id::ModelId;
use crate::network::renderers::DEFAULT_RENDERER;
use crate::network::weights::{embedded_second_pass, has_second_pass};
use crate::rules::skip::{RULES, Rule, Skip};

/// Counted up with every change of the code that makes another frame of the same input, weights and settings: how a file is read, what is
/// left out, the engine. `tests/engine_revision.rs` notices it.
pub const REVISION: u32 = 2;

/// What an engine is made of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// [`REVISION`] of the code.
    pub revision: u32,
    /// The weights.
    pub model: ModelId,
    /// The renderer whose encoder is used; None for Cycles and where nothing was said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub renderer: Option<String>,
    /// The rules by which work is left out.
    pub skip: Vec<Rule>,
    /// Whether a second pass over time follows the first.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub second_pass: bool,
}

impl Identity {
    /// That of an engine with these weights (None: the embedded ones), for this renderer, before there is one. `second_pass`: whether one is
    /// to follow, where the weights have it.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) where the weights cannot be read.
    pub fn of(model: Option<&Path>, renderer: Option<&str>, skip: Skip, second_pass: bool) -> Result<Self> {
        let (model, has_second_pass) = match model {
            None => (ModelId::embedded(), embedded_second_pass()),
            Some(path) => {
                let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
                (ModelId::of_bytes(path, &bytes), has_second_pass(&bytes))
            }
        };
        Ok(Self::new(model, renderer, skip, second_pass && has_second_pass))
    }

    pub(super) fn new(model: ModelId, renderer: Option<&str>, skip: Skip, second_pass: bool) -> Self {
        let renderer = renderer.map(str::to_ascii_lowercase).filter(|name| name != DEFAULT_RENDERER);
        Self {
            revision: REVISION,
            model,
            renderer,
            skip: RULES.into_iter().filter(|rule| skip.has(*rule)).collect(),
            second_pass,
        }
    }

    /// Frames on each side that a frame depends on, with a window of so many: after a second pass on those of its neighbours too.
    pub fn context(&self, window: usize) -> usize {
        window * (1 + usize::from(self.second_pass))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usual_renderer_is_not_told_apart_from_none() {
        let with = |renderer| Identity::of(None, renderer, Skip::default(), false).unwrap();
        assert_eq!(with(Some("Cycles")), with(None));
        assert_eq!(with(Some("Mitsuba")).renderer.as_deref(), Some("mitsuba"));
        assert_ne!(Identity::of(None, None, Skip::NONE, false).unwrap(), with(None));
    }
}
