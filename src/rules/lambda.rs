//! The dial over a shot: one value, or keys at frames with straight lines between them.

use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::window::LAMBDA_RANGE;
use crate::error::{Error, Result};

/// λ for every frame of a shot, each value in 1…64: 1 is cleanest, 64 keeps most grain and detail.
///
/// As text `8`, or `1:1,24:8`: frame 1 has 1, frame 24 has 8, frames between have what lies between, frames outside what the
/// nearest key has. As JSON or TOML a number, or a list of pairs `[[1, 1], [24, 8]]`. Frames of keys may have fractions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "WrittenLambda", into = "WrittenLambda")]
pub struct Lambda {
    /// Frame and value, ascending, at least one.
    keys: Vec<(f64, f32)>,
    /// Values above the range that were brought down: how many, and the highest.
    clamped: Option<(usize, f32)>,
}

/// As files hold it.
#[derive(Clone, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number from 1 to 64, or keys such as [[1, 1], [24, 8]] (frame, value)")]
enum WrittenLambda {
    Constant(f32),
    Keys(Vec<(f64, f32)>),
}

impl Default for Lambda {
    fn default() -> Self {
        Self { keys: vec![(0.0, LAMBDA_RANGE.0)], clamped: None }
    }
}

impl Lambda {
    /// λ of what a mask marks, where nothing is said.
    pub fn of_masked() -> Self {
        Self { keys: vec![(0.0, 16.0)], clamped: None }
    }

    /// The same value for all frames.
    ///
    /// # Errors
    /// [`Error::BadSetting`] below 1 and for NaN. Above 64 is clamped, see [`note`](Self::note).
    pub fn constant(value: f32) -> Result<Self> {
        Self::keyed([(0.0, value)])
    }

    /// Keys in any order, (frame, value).
    ///
    /// # Errors
    /// [`Error::BadSetting`] without keys, with two keys at one frame, and as [`constant`](Self::constant).
    pub fn keyed(keys: impl IntoIterator<Item = (f64, f32)>) -> Result<Self> {
        let bad = |reason: String| Err(Error::BadSetting { name: "lambda", reason });
        let (low, high) = LAMBDA_RANGE;
        let (mut sorted, mut clamped) = (Vec::new(), None);
        for (frame, value) in keys {
            if !frame.is_finite() {
                return bad(format!("{frame} is no frame"));
            }
            if value.is_nan() || value < low {
                return bad(format!("{value} is out of range: 1 (cleanest) to 64 (keeps grain and hidden detail)"));
            }
            if value > high {
                clamped = Some(clamped.map_or((1, value), |(count, high): (usize, f32)| (count + 1, high.max(value))));
            }
            sorted.push((frame, value.min(high)));
        }
        sorted.sort_by(|a: &(f64, f32), b| a.0.total_cmp(&b.0));
        if let Some(pair) = sorted.windows(2).find(|p| p[0].0 == p[1].0) {
            return bad(format!("there are two values for frame {}", pair[0].0));
        }
        match sorted.is_empty() {
            true => bad("there are no keys: write 8, or 1:1,24:8".into()),
            false => Ok(Self { keys: sorted, clamped }),
        }
    }

    /// λ at a frame.
    pub fn at(&self, frame: i64) -> f32 {
        let (frame, after) = (frame as f64, self.keys.partition_point(|k| k.0 <= frame as f64));
        match (after.checked_sub(1).and_then(|i| self.keys.get(i)), self.keys.get(after)) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * ((frame - a.0) / (b.0 - a.0)) as f32,
            (Some(only), None) | (None, Some(only)) => only.1,
            (None, None) => LAMBDA_RANGE.0,
        }
    }

    /// Frame and value, ascending, at least one; the frame means nothing where there is one key.
    pub fn keys(&self) -> &[(f64, f32)] {
        &self.keys
    }

    /// What to tell the user where a value was clamped.
    pub fn note(&self) -> Option<String> {
        let most = LAMBDA_RANGE.1;
        self.clamped.map(|(count, high)| match count {
            1 => format!("lambda {high} is beyond the range, {most} is used"),
            _ => format!("lambda is beyond the range in {count} keys, up to {high}; {most} is used"),
        })
    }
}

impl FromStr for Lambda {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let bad = |item: &str| Error::BadSetting { name: "lambda", reason: format!("'{item}': write 8, or 1:1,24:8") };
        if let Ok(value) = text.trim().parse() {
            return Self::constant(value);
        }
        let key = |item: &str| {
            let (frame, value) = item.split_once(':').ok_or_else(|| bad(item))?;
            Ok((frame.trim().parse().map_err(|_| bad(item))?, value.trim().parse().map_err(|_| bad(item))?))
        };
        Self::keyed(text.split(',').map(key).collect::<Result<Vec<_>>>()?)
    }
}

impl Display for Lambda {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.keys.as_slice() {
            [(_, value)] => write!(f, "{value}"),
            keys => f.write_str(&keys.iter().map(|(frame, value)| format!("{frame}:{value}")).collect::<Vec<_>>().join(",")),
        }
    }
}

impl TryFrom<WrittenLambda> for Lambda {
    type Error = Error;

    fn try_from(written: WrittenLambda) -> Result<Self> {
        match written {
            WrittenLambda::Constant(value) => Self::constant(value),
            WrittenLambda::Keys(keys) => Self::keyed(keys),
        }
    }
}

impl From<Lambda> for WrittenLambda {
    fn from(lambda: Lambda) -> Self {
        match lambda.keys.as_slice() {
            [(_, value)] => Self::Constant(*value),
            _ => Self::Keys(lambda.keys),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Lambda {
        text.parse().unwrap()
    }

    #[test]
    fn one_value_holds_for_all_frames() {
        assert_eq!(Lambda::default().at(7), 1.0);
        let lambda = read(" 8 ");
        assert!(lambda.at(-1000) == 8.0 && lambda.at(1000) == 8.0 && lambda.note().is_none());
        assert_eq!(lambda.to_string(), "8");
    }

    #[test]
    fn keys_are_joined_by_straight_lines() {
        let lambda = read("24:9, 1.5:1,-4:2");
        assert_eq!([-9, -4, 1, 2, 24, 30].map(|n| lambda.at(n)), [2.0, 2.0, 2.0 - 5.0 / 5.5, 1.0 + 0.5 / 22.5 * 8.0, 9.0, 9.0]);
        assert_eq!(lambda.to_string(), "-4:2,1.5:1,24:9");
        assert_eq!(read(&lambda.to_string()), lambda);
    }

    #[test]
    fn values_out_of_range_are_refused_or_clamped() {
        for bad in ["0.99", "0", "-1", "nan", "-inf", "", "a", "1:2:3", "1:", ":1", "1:2,1:3", "1:2,,3:4", "inf:1", "1:0.5,9:4"] {
            assert!(bad.parse::<Lambda>().is_err(), "{bad}");
        }
        assert!(Lambda::keyed([]).is_err());
        for high in ["1000", "inf", "1:1,9:65"] {
            let lambda = read(high);
            assert!(lambda.at(9) == 64.0 && lambda.note().is_some(), "{high}");
        }
        let note = read("1:100,2:300,3:200,4:8").note().unwrap();
        assert_eq!(note, "lambda is beyond the range in 3 keys, up to 300; 64 is used");
    }

    #[test]
    fn files_hold_a_number_or_pairs() {
        for text in ["8", "1:1,24:8"] {
            let json = serde_json::to_string(&read(text)).unwrap();
            assert_eq!(serde_json::from_str::<Lambda>(&json).unwrap(), read(text), "{json}");
        }
        assert!(serde_json::from_str::<Lambda>("0.5").is_err() && serde_json::from_str::<Lambda>("\"8\"").is_err());
    }
}
