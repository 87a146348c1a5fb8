//! The table: every check with its promise, every case, and the worst of each.

use super::cases::Case;
use super::row::CheckRow;
use super::suite::Suite;
use super::{checks, dial, firefly, symmetry};
use crate::Result;
use crate::network::weights::Weights;

/// Told how many cases are done, how many there are, and what comes next.
pub type Progress<'a> = dyn Fn(usize, usize, &str) -> Result<()> + 'a;

impl Suite {
    /// What must hold whatever the frames and the weights are: the rows of one case.
    pub fn case(&self, case: &Case) -> Vec<CheckRow> {
        checks::rows(self, case)
    }

    /// Every case of the table and `made_up` random ones, then what trained weights must do. `progress` gets how many are done,
    /// how many there are, and what comes next; its error ends the run.
    ///
    /// # Errors
    /// An engine that refuses a frame that is not odd at all; what `progress` returns.
    pub fn table(&self, made_up: u64, progress: &Progress<'_>) -> Result<Vec<CheckRow>> {
        let cases: Vec<Case> = Case::all().into_iter().chain((0..made_up).map(Case::random)).collect();
        let all = cases.len() + 1;
        let mut out = Vec::new();
        for (i, case) in cases.iter().enumerate() {
            progress(i, all, &case.name)?;
            out.extend(self.case(case));
        }
        progress(cases.len(), all, "noisy scene")?;
        out.push(firefly::row(self)?);
        out.extend(symmetry::rows(self)?);
        out.extend(dial::rows(self)?);
        progress(all, all, "")?;
        Ok(out)
    }
}

/// What a check is about.
pub struct Check {
    pub name: &'static str,
    /// Of its bound and its worst.
    pub unit: &'static str,
    pub promise: &'static str,
}

const fn check(name: &'static str, unit: &'static str, promise: &'static str) -> Check {
    Check { name, unit, promise }
}

/// Every check, in the table's order.
pub const CHECKS: [Check; 16] = [
    check("image", "values", "colour is finite and not negative, alpha is 0…1, light passes are finite"),
    check("range", "relative", "every value lies between the least and the greatest that its taps could give"),
    check("float64", "relative", "the kernel stage agrees with one in float64 from the same logits"),
    check("left out", "float16 steps", "what the plan leaves out changes no more than half a step"),
    check("threads and tiles", "values", "the same bits on one thread, on all, and in the smallest tiles"),
    check("AVX2 and AVX-512", "values", "the same bits"),
    check("portable", "relative", "the portable path agrees"),
    check(
        "exposure",
        "relative",
        "2ᵏ times the light in, 2ᵏ times the light out, k from −10 to 10, where the light that sets a frame's exposure is above 1e-27",
    ),
    check("filled", "values", "holes of bad pixels up to 31 pixels wide are filled, whatever the neighbours have"),
    check("shift by 8", "relative", "a frame moved by a multiple of 8 pixels gives the result, moved, away from the borders"),
    check("one pixel of 1e30", "share of the noise", "changes little outside its kernels' reach, more than 44 pixels away"),
    check("mirrored left to right", "share of the noise", "differs little; the same is not promised"),
    check("mirrored top to bottom", "share of the noise", "differs little; the same is not promised"),
    check("red and blue swapped", "share of the noise", "differs little; the same is not promised"),
    check("refused or clamped", "values", "λ below 1 and NaN are refused, above 64 is 64"),
    check("noise falls as λ rises", "share of the noise at λ 1", "never"),
];

/// Runs the whole table on one set of weights; see [`Suite::table`].
///
/// # Errors
/// Weights that make no engine; what `progress` returns.
pub fn run(weights: &Weights, made_up: u64, progress: &Progress<'_>) -> Result<Vec<CheckRow>> {
    Suite::new(weights)?.table(made_up, progress)
}

/// The worst row of each check, in the order of [`CHECKS`]: by how far it is over its bound, or how close to it.
pub fn summary(rows: &[CheckRow]) -> Vec<CheckRow> {
    let share = |row: &CheckRow| if row.bound > 0.0 { row.worst / row.bound } else { row.worst };
    let worst = |name: &str| rows.iter().filter(|r| r.check == name).max_by(|a, b| share(a).total_cmp(&share(b)));
    CHECKS.iter().filter_map(|check| worst(check.name).cloned()).collect()
}
