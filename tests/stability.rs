//! The stability table: no row may fail, for the embedded weights and for random ones.

mod engine_support;

use hush::network::weights::Weights;
use hush::stability::{Row, run, summary};

fn failing(rows: &[Row]) -> Vec<String> {
    let line = |r: &Row| format!("{} | {} | {:.3e} of {:.1e} | {}", r.case, r.check, r.worst, r.bound, r.place);
    summary(rows).iter().for_each(|r| println!("{}", line(r)));
    rows.iter().filter(|r| !r.passed).map(line).collect()
}

#[test]
fn no_row_fails_with_the_embedded_weights() {
    let started = std::time::Instant::now();
    let rows = run(&Weights::embedded().unwrap(), 6, &|i, n, name| println!("{i}/{n} {name} {:?}", started.elapsed())).unwrap();
    let failing = failing(&rows);
    assert!(failing.is_empty(), "{} of {} rows:\n{}", failing.len(), rows.len(), failing.join("\n"));
}
