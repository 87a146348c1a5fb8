//! Which frames of a shot to write: `1-48,60`.

use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::words;

/// A set of frame numbers, kept as ranges. In files a text such as `1-48,60`, or one number.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "WrittenFrames", into = "WrittenFrames")]
pub struct FrameSet {
    /// Sorted, disjoint, both ends included.
    ranges: Vec<(i64, i64)>,
}

/// As files hold it.
#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "expected frames such as \"1-48,60\"")]
enum WrittenFrames {
    Number(i64),
    Text(String),
}

impl TryFrom<WrittenFrames> for FrameSet {
    type Error = Error;

    fn try_from(written: WrittenFrames) -> Result<Self, Error> {
        match written {
            WrittenFrames::Number(number) => number.to_string().parse(),
            WrittenFrames::Text(text) => text.parse(),
        }
    }
}

impl From<FrameSet> for WrittenFrames {
    fn from(set: FrameSet) -> Self {
        Self::Text(set.to_string())
    }
}

impl Display for FrameSet {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&words::ranges(&self.ranges))
    }
}

impl FrameSet {
    /// Whether the set holds a frame.
    pub fn contains(&self, number: i64) -> bool {
        self.ranges.iter().any(|&(first, last)| (first..=last).contains(&number))
    }

    /// The numbers of the set that are not in `have` (ascending), as ranges with both ends included.
    pub fn missing(&self, have: &[i64]) -> Vec<(i64, i64)> {
        let mut gaps = Vec::new();
        for &(first, last) in &self.ranges {
            let mut next = first;
            for &n in have.iter().filter(|n| (first..=last).contains(*n)) {
                if n > next {
                    gaps.push((next, n - 1));
                }
                next = n + 1;
            }
            if next <= last {
                gaps.push((next, last));
            }
        }
        gaps
    }

    /// How many numbers it holds.
    pub fn count(&self) -> usize {
        self.ranges.iter().map(|&(first, last)| last.abs_diff(first) as usize + 1).sum()
    }

    /// The numbers, ascending.
    pub fn iter(&self) -> impl Iterator<Item = i64> + '_ {
        self.ranges.iter().flat_map(|&(first, last)| first..=last)
    }

    /// The first and the last number.
    pub fn ends(&self) -> Option<(i64, i64)> {
        Some((self.ranges.first()?.0, self.ranges.last()?.1))
    }

    /// The set of these numbers.
    pub fn of(numbers: &[i64]) -> Self {
        let mut ranges: Vec<(i64, i64)> = numbers.iter().map(|n| (*n, *n)).collect();
        ranges.sort_unstable();
        ranges.dedup();
        Self { ranges }
    }

    /// The set of every `step`th number from the first to the last of `numbers` (ascending); empty for none.
    pub fn every(step: i64, numbers: &[i64]) -> Self {
        match numbers.first().zip(numbers.last()) {
            Some((first, last)) if step > 1 => Self::of(&(*first..=*last).step_by(step as usize).collect::<Vec<_>>()),
            _ => Self::hull(numbers),
        }
    }

    /// The set of every number from the first to the last of `numbers` (ascending); empty for none.
    pub fn hull(numbers: &[i64]) -> Self {
        Self { ranges: numbers.first().zip(numbers.last()).map(|(a, b)| (*a, *b)).into_iter().collect() }
    }
}

/// `1-48,60`; `1..48` is taken too; a minus before a number is its sign.
impl FromStr for FrameSet {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let mut ranges = Vec::new();
        for item in text.split(',').map(str::trim) {
            let bad = |why: &str| Error::BadSetting { name: "frames", reason: format!("'{item}' {why}: write 1-48,60") };
            let number = |t: &str| t.trim().parse::<i64>().ok().filter(|n| n.abs() < 1_000_000_000_000);
            // The first minus after the first character separates; one at the start is a sign.
            let dash = item.char_indices().skip(1).find(|(_, c)| *c == '-').map(|(i, _)| (i, 1));
            let (first, last) = match item.find("..").map(|i| (i, 2)).or(dash) {
                Some((at, length)) => (number(&item[..at]), number(&item[at + length..])),
                None => (number(item), number(item)),
            };
            let (Some(first), Some(last)) = (first, last) else { return Err(bad("is no frame or range")) };
            if first > last {
                return Err(bad("runs backwards"));
            }
            ranges.push((first, last));
        }
        ranges.sort_unstable();
        let mut merged: Vec<(i64, i64)> = Vec::new();
        for (first, last) in ranges {
            match merged.last_mut() {
                Some(open) if first <= open.1 + 1 => open.1 = open.1.max(last),
                _ => merged.push((first, last)),
            }
        }
        Ok(Self { ranges: merged })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Vec<(i64, i64)> {
        text.parse::<FrameSet>().unwrap().ranges
    }

    #[test]
    fn ranges_are_read_and_merged() {
        assert_eq!(parse("1-48,60"), [(1, 48), (60, 60)]);
        assert_eq!(parse("60, 1..48"), [(1, 48), (60, 60)]);
        assert_eq!(parse("1-4,3-8,9"), [(1, 9)]);
        assert_eq!(parse("-5--2,-1-3"), [(-5, 3)]);
        assert_eq!(parse("7"), [(7, 7)]);
        for bad in ["", "a", "1-", "5-1", "1,,2", "1-2-3", "é-3", "9999999999999999999"] {
            assert!(bad.parse::<FrameSet>().is_err(), "{bad}");
        }
    }

    #[test]
    fn files_hold_a_text_or_a_number() {
        let set: FrameSet = "60,-3-48".parse().unwrap();
        assert_eq!(serde_json::to_string(&set).unwrap(), "\"-3-48,60\"");
        for text in ["\"-3-48, 60\"", "\"-3-20,21-48,60\""] {
            assert_eq!(serde_json::from_str::<FrameSet>(text).unwrap(), set);
        }
        assert_eq!(serde_json::from_str::<FrameSet>("7").unwrap(), "7".parse().unwrap());
        for bad in ["\"5-1\"", "1.5", "[1, 2]", "true"] {
            assert!(serde_json::from_str::<FrameSet>(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn what_is_missing_is_found_without_counting_up() {
        let set: FrameSet = "1-10,20".parse().unwrap();
        assert!(set.contains(10) && set.contains(20) && !set.contains(11));
        assert_eq!(set.missing(&[0, 1, 2, 5, 10, 11]), [(3, 4), (6, 9), (20, 20)]);
        assert_eq!(set.missing(&(1..=20).collect::<Vec<_>>()), []);
        let wide: FrameSet = "1-99999999999".parse().unwrap();
        assert_eq!(words::ranges(&wide.missing(&[1, 3])), "2,4-99999999999");
        assert_eq!(FrameSet::hull(&[3, 5, 9]).missing(&[3, 5, 9]), [(4, 4), (6, 8)]);
        assert_eq!(FrameSet::hull(&[]).missing(&[]), []);
    }
}
