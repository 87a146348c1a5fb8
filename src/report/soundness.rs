//! The table of numerical soundness on the page: the worst case of each check.

use maud::{Markup, html};

use super::axes::number;
use crate::picture::drawing::printable;
use crate::stability::{CHECKS, CheckRow, summary};

/// The section's body.
pub fn soundness(rows: &[CheckRow]) -> Markup {
    let failed = rows.iter().filter(|r| !r.passed).count();
    let about = |row: &CheckRow| CHECKS.iter().find(|c| c.name == row.check).map_or(("", ""), |c| (c.promise, c.unit));
    html! {
        p {
            (rows.len()) " checks of hard cases on this machine, with the weights used here: "
            @if failed == 0 { "none failed" } @else { strong { (failed) " failed" } }
            ". The worst case of each check; all rows lie in " code { "stability.csv" } "."
        }
        div.wide {
            table.words {
                tr { th { "promise" } th { "at most" } th { "worst found" } th { "case" } th { "holds" } }
                @for (row, (promise, unit)) in summary(rows).iter().map(|row| (row, about(row))) {
                    tr {
                        td { (row.check) small { (promise) } }
                        td { (short(row.bound)) small { (unit) } }
                        td { @if row.worst == f64::MAX { "no number" } @else { (short(row.worst)) } }
                        td { (printable(&row.case)) @if !row.place.is_empty() { small { (printable(&row.place)) } } }
                        td { @if row.passed { "yes" } @else { strong { "no" } } }
                    }
                }
            }
        }
    }
}

fn short(value: f64) -> String {
    if value == 0.0 || (0.01..1000.0).contains(&value) { number(value) } else { format!("{value:.1e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_that_fails_is_seen() {
        let row = |check: &str, worst: f64| CheckRow {
            case: "one <lit> pixel".into(),
            check: check.into(),
            bound: 1e-5,
            worst,
            place: "row 3".into(),
            passed: worst <= 1e-5,
        };
        let good = soundness(&[row("exposure", 1e-7), row("range", 0.0)]).into_string();
        assert!(good.contains("2 checks") && good.contains("none failed") && good.contains("one &lt;lit&gt; pixel"));
        let bad = soundness(&[row("exposure", 1e-7), row("exposure", f64::MAX), row("range", 0.0)]).into_string();
        assert!(
            bad.contains("<strong>1 failed</strong>")
                && bad.contains("no number")
                && bad.matches("<strong>no</strong>").count() == 1
        );
    }
}
