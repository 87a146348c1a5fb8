//! The options that force rules of the plan on or off; shared by the commands that denoise.

use std::str::FromStr;

use clap::Args;

use crate::error::{Error, Result};
use crate::rules::skip::{RULES, Rule, Skip};

/// What may be left out.
#[derive(Args, Clone, Debug, Default)]
pub(super) struct SkipArgs {
    /// Leave out what this rule allows, on top of the rules that are on by default; may be given several times
    #[arg(long, value_name = "RULE|all")]
    skip: Vec<Which>,
    /// Compute what this rule would leave out; may be given several times; --skip turns single rules on again
    #[arg(long, value_name = "RULE|all")]
    no_skip: Vec<Which>,
}

/// One rule or all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Which {
    All,
    One(Rule),
}

impl FromStr for Which {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        if text == "all" { Ok(Self::All) } else { text.parse().map(Self::One) }
    }
}

impl Which {
    fn holds(self, rule: Rule) -> bool {
        self == Self::All || self == Self::One(rule)
    }
}

impl SkipArgs {
    /// The defaults, changed: a rule named alone goes before `all`.
    ///
    /// # Errors
    /// [`Error::BadSetting`] where both options name the same.
    pub fn skip(&self) -> Result<Skip> {
        if let Some(both) = self.skip.iter().find(|w| self.no_skip.contains(w)) {
            let name = if let Which::One(rule) = both { rule.name() } else { "all" };
            return Err(Error::BadSetting { name: "skip", reason: format!("'{name}' stands in --skip and in --no-skip") });
        }
        let switch = |skip: Skip, list: &[Which], on: bool, all: bool| {
            let named = |rule: &Rule| list.iter().any(|which| which.holds(*rule) && (*which == Which::All) == all);
            RULES.into_iter().filter(named).fold(skip, |skip, rule| skip.with(rule, on))
        };
        let all = switch(switch(Skip::default(), &self.skip, true, true), &self.no_skip, false, true);
        Ok(switch(switch(all, &self.skip, true, false), &self.no_skip, false, false))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn skip(on: &[&str], off: &[&str]) -> Result<Skip> {
        let parse = |names: &[&str]| names.iter().map(|n| n.parse().unwrap()).collect();
        SkipArgs { skip: parse(on), no_skip: parse(off) }.skip()
    }

    #[test]
    fn single_rules_go_before_all() {
        assert_eq!(skip(&[], &[]).unwrap(), Skip::default());
        assert_eq!(skip(&[], &["all"]).unwrap(), Skip::NONE);
        assert_eq!(skip(&["still"], &["all"]).unwrap(), Skip::NONE.with(Rule::Still, true));
        assert_eq!(skip(&["still"], &["constant"]).unwrap(), Skip::default().with(Rule::Constant, false));
        assert_eq!(skip(&["all"], &["opaque"]).unwrap(), Skip::default().with(Rule::Opaque, false));
    }

    #[test]
    fn contradictions_and_unknown_rules_are_refused() {
        assert!(skip(&["still"], &["still"]).unwrap_err().to_string().contains("'still' stands in"));
        assert!(skip(&["all"], &["all"]).is_err());
        assert!("fog".parse::<Which>().unwrap_err().to_string().contains("constant"));
    }
}
