//! One network under every setting that must not change its result.

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::network::weights::{Architecture, Weights};
use crate::rules::skip::Skip;
use crate::simd::Isa;
use crate::{Engine, Error, Result, Settings};

/// Engines of one set of weights.
pub struct Suite {
    pub(super) architecture: Architecture,
    /// As users run it.
    pub(super) product: Engine,
    /// With nothing left out.
    pub(super) exact: Engine,
    /// The same in the smallest tiles.
    pub(super) tiled: Engine,
    /// The same on the other instruction sets.
    pub(super) others: Vec<(Isa, Engine)>,
    pub(super) one_thread: ThreadPool,
}

impl Suite {
    /// Engines of these weights.
    ///
    /// # Errors
    /// Weights that make no engine.
    pub fn new(weights: &Weights) -> Result<Self> {
        let engine = |skip, memory, isa| Engine::from_weights(weights, Settings { skip, memory, isa, ..Settings::default() });
        let own = Isa::detect();
        let others = Isa::available().into_iter().filter(|isa| *isa != own);
        let pool = ThreadPoolBuilder::new().num_threads(1).build();
        Ok(Self {
            architecture: weights.architecture.clone(),
            product: engine(Skip::default(), None, None)?,
            exact: engine(Skip::NONE, None, None)?,
            tiled: engine(Skip::NONE, Some(0), None)?,
            others: others.map(|isa| Ok((isa, engine(Skip::NONE, None, Some(isa))?))).collect::<Result<_>>()?,
            one_thread: pool.map_err(|e| Error::BadSetting { name: "threads", reason: e.to_string() })?,
        })
    }
}
