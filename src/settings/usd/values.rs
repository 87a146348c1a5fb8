//! Attribute values as Rust ones; a message says what was there and what was expected.

use openusd::sdf::Value;

/// A number; whole ones count too.
pub(super) fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Half(v) => Some(f64::from(v.to_f32())),
        Value::Float(v) => Some(f64::from(*v)),
        Value::Double(v) => Some(*v),
        whole => integer(whole).map(|v| v as f64),
    }
}

/// A whole number.
pub(super) fn integer(value: &Value) -> Option<i64> {
    match value {
        Value::Uchar(v) => Some(i64::from(*v)),
        Value::Int(v) => Some(i64::from(*v)),
        Value::Uint(v) => Some(i64::from(*v)),
        Value::Int64(v) => Some(*v),
        Value::Uint64(v) => i64::try_from(*v).ok(),
        _ => None,
    }
}

pub(super) fn boolean(value: &Value) -> Option<bool> {
    match value {
        Value::Bool(v) => Some(*v),
        _ => None,
    }
}

/// A string, a token or an asset's path.
pub(super) fn text(value: &Value) -> Option<String> {
    match value {
        Value::String(v) => Some(v.clone()),
        Value::Token(v) => Some(v.to_string()),
        Value::AssetPath(v) => Some(v.as_str().to_owned()),
        _ => None,
    }
}

/// Strings or tokens; one counts as a list of one.
pub(super) fn texts(value: &Value) -> Option<Vec<String>> {
    match value {
        Value::StringVec(v) => Some(v.clone()),
        Value::TokenVec(v) => Some(v.iter().map(ToString::to_string).collect()),
        one => text(one).map(|text| vec![text]),
    }
}
