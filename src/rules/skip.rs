//! What a shot does not need computed: rules with a bound on the error of each.

use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::Error;

/// A rule by which work is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Rule {
    /// Blocks where every pixel that could be averaged, in all frames of the window, lies within 2⁻¹² of the others relative to
    /// them: background, flat and converged parts. They keep their own rendered pixels, within half a float16 step of what would
    /// have been computed in the first pass. The second pass leaves them out too, though the frames around it see farther.
    Constant,
    /// Alpha that is 1 all over the window is not filtered. Exact: the sum of the weights may be a rounding, 6e-8, below 1, and is 0
    /// only inside a hole that nothing fills.
    Opaque,
    /// Neighbours that no pixel of a tile may use (they moved out of the frame, or their pixels are bad). Exact.
    Untrusted,
    /// Neighbours whose motion vectors are zero all over are copied, not sampled. Exact.
    Still,
}

/// All rules.
pub const RULES: [Rule; 4] = [Rule::Constant, Rule::Opaque, Rule::Untrusted, Rule::Still];

impl Rule {
    /// Its name on the command line and in the manifest.
    pub fn name(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Opaque => "opaque",
            Self::Untrusted => "untrusted",
            Self::Still => "still",
        }
    }
}

impl Rule {
    /// How far a result may be off by it.
    pub fn bound(self) -> &'static str {
        match self {
            Self::Constant => "half a float16 step",
            Self::Opaque | Self::Untrusted | Self::Still => "exact",
        }
    }

    /// What it leaves out and why that may be.
    pub fn why(self) -> &'static str {
        match self {
            Self::Constant => "pixels whose whole surroundings have one value (background, flat, converged) keep it",
            Self::Opaque => "alpha that is 1 all over the window is not filtered",
            Self::Untrusted => "neighbours that no pixel may use (moved out of the frame, bad pixels)",
            Self::Still => "neighbours without any motion are copied instead of sampled",
        }
    }
}

impl Display for Rule {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Rule {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let names = || RULES.map(Rule::name).join(", ");
        let found = RULES.into_iter().find(|r| r.name() == text);
        found.ok_or_else(|| Error::BadSetting { name: "skip", reason: format!("'{text}' is no rule: {}", names()) })
    }
}

/// Which rules are on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Skip {
    /// [`Rule::Constant`].
    pub constant: bool,
    /// [`Rule::Opaque`].
    pub opaque: bool,
    /// [`Rule::Untrusted`].
    pub untrusted: bool,
    /// [`Rule::Still`].
    pub still: bool,
}

/// Every rule that is exact, or within half a float16 step.
impl Default for Skip {
    fn default() -> Self {
        Self { constant: true, opaque: true, untrusted: true, still: true }
    }
}

impl Skip {
    /// Nothing is left out.
    pub const NONE: Self = Self { constant: false, opaque: false, untrusted: false, still: false };

    /// These rules and no others.
    pub fn of(rules: &[Rule]) -> Self {
        rules.iter().fold(Self::NONE, |skip, rule| skip.with(*rule, true))
    }

    /// Whether a rule is on.
    pub fn has(&self, rule: Rule) -> bool {
        match rule {
            Rule::Constant => self.constant,
            Rule::Opaque => self.opaque,
            Rule::Untrusted => self.untrusted,
            Rule::Still => self.still,
        }
    }

    /// With a rule switched.
    pub fn with(mut self, rule: Rule, on: bool) -> Self {
        match rule {
            Rule::Constant => self.constant = on,
            Rule::Opaque => self.opaque = on,
            Rule::Untrusted => self.untrusted = on,
            Rule::Still => self.still = on,
        }
        self
    }
}

/// What was left out of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LeftOut {
    /// The share of the frame's pixels that was not computed, 0…1; what lies around computed pixels is computed too.
    pub constant: f64,
    /// Alpha was not filtered.
    pub alpha: bool,
    /// Neighbours that were copied instead of sampled.
    pub still: usize,
    /// Neighbours that had no pixel to give.
    pub untrusted: usize,
}

impl LeftOut {
    /// How much a rule left out: the share of pixels for [`Rule::Constant`], 0 or 1 for [`Rule::Opaque`], else neighbours.
    pub fn by(&self, rule: Rule) -> f64 {
        match rule {
            Rule::Constant => self.constant,
            Rule::Opaque => f64::from(u8::from(self.alpha)),
            Rule::Untrusted => self.untrusted as f64,
            Rule::Still => self.still as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_have_names_and_switches() {
        for rule in RULES {
            assert_eq!(rule.name().parse::<Rule>().unwrap(), rule);
            assert!(Skip::NONE.with(rule, true).has(rule) && !Skip::default().with(rule, false).has(rule));
            assert_eq!(serde_json::to_string(&rule).unwrap(), format!("\"{rule}\""));
        }
        assert!("fog".parse::<Rule>().unwrap_err().to_string().contains("untrusted"));
    }
}
