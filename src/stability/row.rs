//! One line of the table: what was checked where, what was promised, the worst that was found.

use serde::{Deserialize, Serialize};

/// A check of a case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CheckRow {
    /// What the frames were like.
    pub case: String,
    /// What was checked; see [`super::CHECKS`].
    pub check: String,
    /// The most that [`Self::worst`] may be.
    pub bound: f64,
    /// The worst found, in the check's unit; `f64::MAX` stands for what is no number.
    pub worst: f64,
    /// Where that was.
    #[serde(rename = "where")]
    pub place: String,
    /// Whether it held everywhere.
    pub passed: bool,
}

/// Keeps the worst of what it is shown.
pub(super) struct Worst {
    value: f64,
    place: String,
}

impl Worst {
    /// Nothing found yet.
    pub fn new() -> Self {
        Self { value: 0.0, place: String::new() }
    }

    /// Takes a finding; NaN is the worst of all.
    pub fn take(&mut self, value: f64, place: impl FnOnce() -> String) {
        let value = if value.is_finite() { value } else { f64::MAX };
        if value > self.value {
            *self = Self { value, place: place() };
        }
    }

    /// Counts one more finding, and remembers the first place.
    pub fn count(&mut self, place: impl FnOnce() -> String) {
        if self.value == 0.0 {
            self.place = place();
        }
        self.value += 1.0;
    }

    pub fn row(self, case: &str, check: &str, bound: f64) -> CheckRow {
        let Self { value: worst, place } = self;
        CheckRow { case: case.into(), check: check.into(), bound, worst, place, passed: worst <= bound }
    }
}
