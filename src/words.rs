//! Counts and frame numbers as parts of a sentence.

use std::collections::BTreeSet;

/// `1 frame`, `3 frames`.
pub(crate) fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// `frame 3`, `frames 1-2,9`.
pub(crate) fn frames(numbers: &[i64]) -> String {
    format!("frame{} {}", if numbers.len() == 1 { "" } else { "s" }, spans(numbers))
}

/// Sorted or unsorted numbers as spans: `1-48,60`.
pub(crate) fn spans(numbers: &[i64]) -> String {
    let sorted: BTreeSet<i64> = numbers.iter().copied().collect();
    let mut runs: Vec<(i64, i64)> = Vec::new();
    for n in sorted {
        match runs.last_mut() {
            Some((_, last)) if *last + 1 == n => *last = n,
            _ => runs.push((n, n)),
        }
    }
    ranges(&runs)
}

/// Ranges as `3-5,9`.
pub(crate) fn ranges(ranges: &[(i64, i64)]) -> String {
    let show = |&(a, b): &(i64, i64)| if a == b { a.to_string() } else { format!("{a}-{b}") };
    ranges.iter().map(show).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_no_plural() {
        assert_eq!([0, 1, 2].map(|n| counted(n, "frame")), ["0 frames", "1 frame", "2 frames"]);
        assert_eq!((frames(&[3]), frames(&[1, 2, 9])), ("frame 3".into(), "frames 1-2,9".into()));
    }

    #[test]
    fn numbers_are_shown_as_spans() {
        assert_eq!(spans(&[]), "");
        assert_eq!(spans(&[3, 1, 2, 7, 9, 10]), "1-3,7,9-10");
        assert_eq!(spans(&[-2, -1, 0]), "-2-0");
    }
}
