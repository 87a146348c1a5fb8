//! Numerical soundness: hard frames, what must hold for them, and the worst that was found.
//!
//! The same rows are tests (`tests/stability.rs`) and a table in the report.

mod bench;
mod cases;
mod checks;
mod dial;
mod layer;
mod reference;
mod row;
mod scene;
mod symmetry;

pub use cases::{Case, HAZARDS, Hazard};
pub use dial::rendered;
pub use row::Row;

use crate::Result;
use crate::network::weights::Weights;
use bench::Bench;

/// Every check: its name, the unit of its bound and worst, and what it promises.
pub const CHECKS: [(&str, &str, &str); 15] = [
    ("image", "values", "colour is finite and not negative, alpha is 0…1, light passes are finite"),
    ("range", "relative", "every value lies between the least and greatest that its taps could give"),
    ("float64", "relative", "the kernel stage agrees with one in float64 from the same logits"),
    ("left out", "float16 steps", "what the plan leaves out changes no more than half a step"),
    ("threads and tiles", "values", "the same bits on one thread, on all, and in the smallest tiles"),
    ("AVX2 and AVX-512", "values", "the same bits"),
    ("portable", "relative", "the portable path agrees"),
    ("exposure", "relative", "2ᵏ times the light in, 2ᵏ times the light out, k from −10 to 10"),
    ("filled", "values", "holes of bad pixels up to 20 pixels wide are filled"),
    ("shift by 8", "relative", "a frame moved by a multiple of 8 pixels gives the result, moved, away from the borders"),
    ("mirrored left to right", "share of the noise", "differs little; the same is not promised"),
    ("mirrored top to bottom", "share of the noise", "differs little; the same is not promised"),
    ("red and blue swapped", "share of the noise", "differs little; the same is not promised"),
    ("refused or clamped", "values", "λ below 1 and NaN are refused, above 64 is 64"),
    ("noise falls as λ rises", "share of the noise at λ 1", "never"),
];

/// Runs every case of the table and `made_up` random ones. `progress` gets how many are done, how many there are, and the next.
///
/// # Errors
/// Weights that make no engine.
pub fn run(weights: &Weights, made_up: u64, progress: &dyn Fn(usize, usize, &str)) -> Result<Vec<Row>> {
    let bench = Bench::new(weights)?;
    let cases: Vec<Case> = Case::all().into_iter().chain((0..made_up).map(Case::random)).collect();
    let all = cases.len() + 2;
    let mut out = Vec::new();
    for (i, case) in cases.iter().enumerate() {
        progress(i, all, &case.name);
        out.extend(checks::case_rows(&bench, case));
    }
    progress(cases.len(), all, "shifted and mirrored");
    out.extend(symmetry::rows(&bench)?);
    progress(cases.len() + 1, all, "λ");
    out.extend(dial::rows(&bench)?);
    progress(all, all, "");
    Ok(out)
}

/// The rows of one case.
///
/// # Errors
/// Weights that make no engine.
pub fn run_case(weights: &Weights, case: &Case) -> Result<Vec<Row>> {
    Ok(checks::case_rows(&Bench::new(weights)?, case))
}

/// The worst row of each check, in the order of [`CHECKS`]: by how far it is over its bound, or how close to it.
pub fn summary(rows: &[Row]) -> Vec<Row> {
    let share = |row: &Row| if row.bound > 0.0 { row.worst / row.bound } else { row.worst };
    let worst = |check: &str| rows.iter().filter(|r| r.check == check).max_by(|a, b| share(a).total_cmp(&share(b)));
    CHECKS.iter().filter_map(|(check, _, _)| worst(check).cloned()).collect()
}
