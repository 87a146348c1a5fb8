//! Counts and frame numbers as parts of a sentence.

use crate::io::sequence::spans;

/// `1 frame`, `3 frames`.
pub(crate) fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// `frame 3`, `frames 1-2,9`.
pub(crate) fn frames(numbers: &[i64]) -> String {
    format!("frame{} {}", if numbers.len() == 1 { "" } else { "s" }, spans(numbers))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_no_plural() {
        assert_eq!([0, 1, 2].map(|n| counted(n, "frame")), ["0 frames", "1 frame", "2 frames"]);
        assert_eq!((frames(&[3]), frames(&[1, 2, 9])), ("frame 3".into(), "frames 1-2,9".into()));
    }
}
