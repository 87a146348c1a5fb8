//! What kinds of values settings have: how each is read from files, words and Python, and shown.

use serde_json::{Number, Value, json};

use super::size::parse_size;
use crate::error::Error;
use crate::rules::frames::FrameSet;
use crate::rules::lambda::Lambda;
use crate::rules::window::LAMBDA_RANGE;

/// The guides' names.
pub(super) static GUIDES: [&str; 4] = ["albedo", "normal", "depth", "vector"];
/// The names of the rules by which work is left out.
pub(super) static SKIP: [&str; 4] = ["constant", "opaque", "untrusted", "still"];

/// The kind of a setting's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Yes or no.
    Flag,
    /// A whole number within bounds, both included.
    Whole {
        /// The least.
        least: u64,
        /// The most.
        most: u64,
    },
    /// λ: a number, or keys (frame, value).
    Lambda,
    /// Frame numbers.
    Frames,
    /// Bytes: a number, or a text such as `4G`.
    Size,
    /// A file or a folder; in files relative to where the file lies.
    Path,
    /// A name that Blender or a renderer gives.
    Name,
    /// Names; one alone may be a text, `none` is an empty list.
    Names,
    /// Some of these names; one alone may be a text, `none` is an empty list.
    Choices(&'static [&'static str]),
    /// A text.
    Text,
}

/// Why a value is none for a setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unfit {
    /// There is no such setting.
    Unknown(String),
    /// It is of another type than this.
    Type(String),
    /// It is of the type, but out of range or no sound text.
    Value(String),
}

impl std::fmt::Display for Unfit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unknown(reason) | Self::Value(reason) => f.write_str(reason),
            Self::Type(expected) => write!(f, "expected {expected}"),
        }
    }
}

impl Kind {
    /// The value in the one form that is kept and compared.
    pub(crate) fn canonical(self, value: Value) -> Result<Value, Unfit> {
        let other = || Err(Unfit::Type(self.expected()));
        let reason = |e: Error| Unfit::Value(if let Error::BadSetting { reason, .. } = e { reason } else { e.to_string() });
        match (self, value) {
            (Self::Flag, Value::Bool(flag)) => Ok(flag.into()),
            (Self::Whole { least, most }, Value::Number(n)) if n.as_f64().is_some_and(|n| n.fract() == 0.0) && !n.is_f64() => {
                match n.as_u64().filter(|n| (least..=most).contains(n)) {
                    Some(n) => Ok(n.into()),
                    None => Err(Unfit::Value(format!("{n} is out of range: {least} to {most}"))),
                }
            }
            (Self::Lambda, value) => match pairs(&value) {
                Some(keys) => Lambda::keyed(keys).map(|_| value).map_err(reason),
                None => other(),
            },
            (Self::Frames, value) => match frames(&value) {
                Some(text) => text.parse::<FrameSet>().map(|set| json!(set)).map_err(reason),
                None => other(),
            },
            (Self::Size, Value::String(text)) => parse_size(&text).map(Value::from).map_err(Unfit::Value),
            (Self::Size, Value::Number(n)) if !n.is_f64() => n
                .as_u64()
                .filter(|n| *n > 0)
                .map(Value::from)
                .ok_or_else(|| Unfit::Value(format!("{n} is out of range: 1 or more"))),
            (Self::Path | Self::Name | Self::Text, Value::String(text)) => match text.is_empty() && self == Self::Path {
                true => Err(Unfit::Value("is empty".into())),
                false => Ok(text.into()),
            },
            (Self::Names, value) => names(value).map_or_else(other, |names| Ok(names.into())),
            (Self::Choices(all), value) => match names(value) {
                Some(names) => choice(all, &names).map(Value::from).map_err(Unfit::Value),
                None => other(),
            },
            _ => other(),
        }
    }

    /// The value that words on the command line mean.
    pub(crate) fn of_words(self, words: &[String]) -> Result<Value, String> {
        let first = words.first().map(String::as_str).unwrap_or_default().trim();
        let value = match self {
            Self::Flag => json!(first.parse::<bool>().map_err(|_| format!("'{first}' is neither true nor false"))?),
            Self::Whole { .. } => first.parse::<i64>().map(Value::from).unwrap_or(Value::Null),
            Self::Lambda => lambda_words(first)?,
            Self::Names | Self::Choices(_) => words.into(),
            Self::Frames | Self::Size | Self::Path | Self::Name | Self::Text => words.first().cloned().unwrap_or_default().into(),
        };
        self.canonical(value).map_err(|e| e.to_string())
    }

    /// What the value shall be.
    pub fn expected(self) -> String {
        match self {
            Self::Flag => "true or false".into(),
            Self::Whole { least, most } => format!("a whole number from {least} to {most}"),
            Self::Lambda => {
                let (least, most) = LAMBDA_RANGE;
                format!("a number from {least} to {most}, or keys such as [[1, 1], [24, 8]] (frame, value)")
            }
            Self::Frames => "frames such as \"1-48,60\"".into(),
            Self::Size => "a size such as \"4G\"".into(),
            Self::Path => "the name of a file or folder".into(),
            Self::Name => "a name".into(),
            Self::Names => "a name or a list of names".into(),
            Self::Choices(all) => format!("some of {}, or none", all.join(", ")),
            Self::Text => "a text".into(),
        }
    }

    /// The type of the USD attribute.
    pub fn usd_type(self) -> &'static str {
        match self {
            Self::Flag => "bool",
            Self::Whole { .. } => "int",
            Self::Lambda => "float",
            Self::Name => "token",
            Self::Names | Self::Choices(_) => "token[]",
            Self::Frames | Self::Size | Self::Path | Self::Text => "string",
        }
    }

    /// The least and the most of a number.
    pub fn range(self) -> Option<(f64, f64)> {
        match self {
            Self::Whole { least, most } => Some((least as f64, most as f64)),
            Self::Lambda => Some((LAMBDA_RANGE.0.into(), LAMBDA_RANGE.1.into())),
            _ => None,
        }
    }
}

/// A setting's value as people read it.
pub fn in_words(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(items) if items.is_empty() => "none".into(),
        Value::Array(items) if items.iter().all(Value::is_array) => {
            let key = |key: &Value| format!("{}:{}", plain(&key[0]), plain(&key[1]));
            items.iter().map(key).collect::<Vec<_>>().join(",")
        }
        Value::Array(items) => items.iter().map(in_words).collect::<Vec<_>>().join(", "),
        other => plain(other),
    }
}

/// A number without a fraction that says nothing.
fn plain(value: &Value) -> String {
    // λ is a float32: as one it has the fewest digits.
    value.as_f64().filter(|_| value.is_f64()).map_or_else(|| value.to_string(), |n| (n as f32).to_string())
}

fn pairs(value: &Value) -> Option<Vec<(f64, f32)>> {
    match value {
        Value::Number(n) => Some(vec![(0.0, n.as_f64()? as f32)]),
        Value::Array(keys) => {
            let key = |key: &Value| match key.as_array()?.as_slice() {
                [frame, value] => Some((frame.as_f64()?, value.as_f64()? as f32)),
                _ => None,
            };
            keys.iter().map(key).collect()
        }
        _ => None,
    }
}

fn frames(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Number(n) if !n.is_f64() => Some(n.to_string()),
        Value::Array(numbers) => {
            let number = |n: &Value| n.as_i64().map(|n| n.to_string());
            Some(numbers.iter().map(number).collect::<Option<Vec<_>>>()?.join(","))
        }
        _ => None,
    }
}

fn names(value: Value) -> Option<Vec<String>> {
    let text = |value| if let Value::String(text) = value { Some(text) } else { None };
    let names = match value {
        Value::Array(names) => names.into_iter().map(text).collect::<Option<Vec<_>>>()?,
        one => vec![text(one)?],
    };
    Some(names.into_iter().filter(|n| !n.eq_ignore_ascii_case("none")).collect())
}

fn choice(all: &[&str], names: &[String]) -> Result<Vec<String>, String> {
    let same = |one: &str, other: &str| one.trim().eq_ignore_ascii_case(other);
    if let Some(wrong) = names.iter().find(|name| !all.iter().any(|known| same(name, known))) {
        return Err(format!("'{wrong}' is none: there are {}; or write none", all.join(", ")));
    }
    let chosen = all.iter().filter(|known| names.iter().any(|name| same(name, known)));
    Ok(chosen.map(|known| (*known).to_owned()).collect())
}

/// `8`, or `1:1,24:8`.
fn lambda_words(text: &str) -> Result<Value, String> {
    let number = |text: &str| {
        let number = text.trim().parse::<f64>().ok();
        number.and_then(Number::from_f64).map(Value::Number)
    };
    if let Some(value) = number(text) {
        return Ok(value);
    }
    let key = |item: &str| {
        let key = item.split_once(':').and_then(|(frame, value)| Some(json!([number(frame)?, number(value)?])));
        key.ok_or_else(|| format!("'{item}': write 8, or 1:1,24:8"))
    };
    Ok(Value::Array(text.split(',').map(key).collect::<Result<_, _>>()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::skip::RULES;

    #[test]
    fn choices_are_those_of_their_types() {
        assert_eq!(RULES.iter().map(|rule| rule.name()).collect::<Vec<_>>(), SKIP);
        for guide in GUIDES {
            assert_eq!(json!(serde_json::from_value::<super::super::Guide>(guide.into()).unwrap()), guide);
        }
    }

    #[test]
    fn every_kind_reads_files_and_words() {
        let whole = Kind::Whole { least: 0, most: 3 };
        let words = |kind: Kind, words: &[&str]| kind.of_words(&words.iter().map(|w| (*w).to_owned()).collect::<Vec<_>>());
        for (kind, from, said, expected) in [
            (Kind::Flag, json!(true), &["true"][..], json!(true)),
            (whole, json!(3), &["3"], json!(3)),
            (Kind::Lambda, json!(4.5), &["4.5"], json!(4.5)),
            (Kind::Lambda, json!([[1.0, 1.0], [24.5, 8.0]]), &["1:1,24.5:8"], json!([[1.0, 1.0], [24.5, 8.0]])),
            (Kind::Frames, json!([1, 2, 3, 9]), &["1,2,3,9"], json!("1-3,9")),
            (Kind::Size, json!(4_294_967_296u64), &["4G"], json!(4_294_967_296u64)),
            (Kind::Names, json!("all"), &["all"], json!(["all"])),
            (Kind::Names, json!(["none"]), &["none"], json!([])),
            (Kind::Choices(&GUIDES), json!(["Vector", "albedo"]), &["vector", "albedo"], json!(["albedo", "vector"])),
            (Kind::Path, json!("a/b"), &["a/b"], json!("a/b")),
        ] {
            assert_eq!(kind.canonical(from.clone()), Ok(expected.clone()), "{kind:?} {from}");
            assert_eq!(words(kind, said), Ok(expected), "{kind:?} {said:?}");
        }
    }

    #[test]
    fn other_types_and_bad_values_are_told_apart() {
        let whole = Kind::Whole { least: 0, most: 3 };
        for (kind, value) in [
            (Kind::Flag, json!(1)),
            (whole, json!(1.5)),
            (whole, json!("two")),
            (Kind::Lambda, json!("4")),
            (Kind::Lambda, json!([[1], [2]])),
            (Kind::Frames, json!(1.5)),
            (Kind::Frames, json!([1.5])),
            (Kind::Size, json!(true)),
            (Kind::Names, json!(3)),
            (Kind::Choices(&GUIDES), json!([3])),
            (Kind::Name, json!(["a"])),
        ] {
            assert!(matches!(kind.canonical(value.clone()), Err(Unfit::Type(_))), "{kind:?} {value}");
        }
        for (kind, value, part) in [
            (whole, json!(4), "out of range: 0 to 3"),
            (whole, json!(-1), "out of range"),
            (Kind::Lambda, json!(0.5), "out of range"),
            (Kind::Lambda, json!([]), "no keys"),
            (Kind::Lambda, json!([[1, 2], [1, 3]]), "two values"),
            (Kind::Frames, json!("9-1"), "backwards"),
            (Kind::Size, json!("much"), "no size"),
            (Kind::Size, json!(-1), "1 or more"),
            (Kind::Choices(&GUIDES), json!("colour"), "albedo, normal, depth, vector"),
            (Kind::Path, json!(""), "empty"),
        ] {
            match kind.canonical(value.clone()) {
                Err(Unfit::Value(reason)) => assert!(reason.contains(part), "{kind:?} {value}: {reason}"),
                other => panic!("{kind:?} {value}: {other:?}"),
            }
        }
        assert!(Kind::Lambda.of_words(&["1:1,x".into()]).unwrap_err().contains("write 8, or 1:1,24:8"));
    }

    #[test]
    fn values_are_shown_as_people_write_them() {
        for (value, words) in [
            (json!(4.0), "4"),
            (json!(1.1f32), "1.1"),
            (json!([[1.0, 1.0], [24.5, 8.0]]), "1:1,24.5:8"),
            (json!([]), "none"),
            (json!(["a", "b"]), "a, b"),
            (json!(true), "true"),
        ] {
            assert_eq!(in_words(&value), words);
        }
    }
}
