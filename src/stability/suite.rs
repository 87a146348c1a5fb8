//! One network under every setting that must not change its result, and the checks that it goes through.

use rayon::{ThreadPool, ThreadPoolBuilder};

use super::cases::Case;
use super::row::Row;
use super::{checks, dial, firefly, symmetry};
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

    /// What must hold whatever the frames and the weights are: the rows of one case.
    pub fn case(&self, case: &Case) -> Vec<Row> {
        checks::rows(self, case)
    }

    /// Every case of the table and `made_up` random ones, then what trained weights must do. `progress` gets how many are done,
    /// how many there are, and what comes next.
    ///
    /// # Errors
    /// An engine that refuses a frame that is not odd at all.
    pub fn table(&self, made_up: u64, progress: &dyn Fn(usize, usize, &str)) -> Result<Vec<Row>> {
        let cases: Vec<Case> = Case::all().into_iter().chain((0..made_up).map(Case::random)).collect();
        let all = cases.len() + 1;
        let mut out = Vec::new();
        for (i, case) in cases.iter().enumerate() {
            progress(i, all, &case.name);
            out.extend(self.case(case));
        }
        progress(cases.len(), all, "noisy scene");
        out.push(firefly::row(self)?);
        out.extend(symmetry::rows(self)?);
        out.extend(dial::rows(self)?);
        progress(all, all, "");
        Ok(out)
    }
}
