//! Texts of the command line and of settings: frame numbers, λ with keys, a stage with a prim.

use std::fmt::{Debug, Display};
use std::path::Path;
use std::str::FromStr;

use hush::settings::FrameSet;
use hush::settings::Lambda;
use hush::settings::StageRef;
use hush::{Error, Result};

/// Frames that a set is tried on.
const NUMBERS: [i64; 6] = [i64::MIN, -1, 0, 1, 24, i64::MAX];

/// The input is one of these texts.
pub fn check(_folder: &Path, bytes: &[u8]) -> Result<()> {
    let text = String::from_utf8_lossy(bytes);
    let lambda = read_again::<Lambda>(&text).map(|lambda| {
        assert!(NUMBERS.iter().all(|n| (1.0..=64.0).contains(&lambda.at(*n))), "λ leaves its range");
    });
    let frames = read_again::<FrameSet>(&text).map(|set| {
        let (first, last) = set.ends().expect("a set is not empty");
        assert!(set.contains(first) && set.contains(last) && set.count() > 0);
        assert!(set.iter().take(100).all(|n| set.contains(n)));
        assert!(set.missing(&NUMBERS).iter().all(|(a, b)| a <= b && set.contains(*a) && set.contains(*b)));
    });
    // Any text but an empty one names a file.
    let stage = read_again::<StageRef>(&text);
    assert!(stage.is_ok() || text.is_empty() || text.starts_with("@/"));
    lambda.or(frames)
}

/// Reads a text; what is shown of it reads as the same.
fn read_again<T: FromStr<Err = Error> + Display + Debug + PartialEq>(text: &str) -> Result<T> {
    let value: T = text.parse()?;
    assert_eq!(value.to_string().parse::<T>().expect("what is shown can be read"), value);
    Ok(value)
}
