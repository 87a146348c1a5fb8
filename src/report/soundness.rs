//! The table of numerical soundness on the page: the worst case of each check.

use std::fmt::Write;

use crate::picture::drawing::escape;
use crate::stability::{CHECKS, CheckRow, summary};

/// The section's body.
pub fn soundness(rows: &[CheckRow]) -> String {
    let failed = rows.iter().filter(|r| !r.passed).count();
    let verdict = if failed == 0 { "none failed".to_string() } else { format!("<strong>{failed} failed</strong>") };
    let mut out = format!(
        "<p>{} checks of hard cases on this machine, with the weights used here: {verdict}. The worst case of each check; all rows lie in \
         <code>stability.csv</code>.</p>\n<div class=\"wide\"><table class=\"words\">\n<tr><th>promise</th><th>at most</th><th>worst found</th>\
         <th>case</th><th>holds</th></tr>\n",
        rows.len()
    );
    for row in summary(rows) {
        let check = CHECKS.iter().find(|c| c.name == row.check);
        let (promise, unit) = check.map_or((row.check.as_str(), ""), |c| (c.promise, c.unit));
        let worst = if row.worst == f64::MAX { "no number".to_string() } else { short(row.worst) };
        let place = if row.place.is_empty() { String::new() } else { format!("<small>{}</small>", escape(&row.place)) };
        let _ = writeln!(
            out,
            "<tr><td>{}<small>{}</small></td><td>{}<small>{unit}</small></td><td>{worst}</td><td>{}{place}</td><td>{}</td></tr>",
            escape(&row.check),
            escape(promise),
            short(row.bound),
            escape(&row.case),
            if row.passed { "yes" } else { "<strong>no</strong>" }
        );
    }
    out.push_str("</table></div>\n");
    out
}

fn short(value: f64) -> String {
    if value == 0.0 || (0.01..1000.0).contains(&value) { super::axes::number(value) } else { format!("{value:.1e}") }
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
        let good = soundness(&[row("exposure", 1e-7), row("range", 0.0)]);
        assert!(good.contains("2 checks") && good.contains("none failed") && good.contains("one &lt;lit&gt; pixel"));
        let bad = soundness(&[row("exposure", 1e-7), row("exposure", f64::MAX), row("range", 0.0)]);
        assert!(
            bad.contains("<strong>1 failed</strong>")
                && bad.contains("no number")
                && bad.matches("<strong>no</strong>").count() == 1
        );
    }
}
