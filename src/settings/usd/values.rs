//! Attribute values as Rust ones.

use std::io::Read;
use std::path::Path;

use openusd::sdf::Value;

/// A value as its layer means it: openusd leaves the escapes in the strings of text layers as they are written.
pub(super) fn as_meant(value: Value, layer: &Path) -> Value {
    if !is_text(layer) {
        return value;
    }
    match value {
        Value::String(v) => Value::String(unescaped(&v)),
        Value::Token(v) => Value::token(unescaped(&v)),
        Value::StringVec(v) => Value::StringVec(v.iter().map(|t| unescaped(t)).collect()),
        Value::TokenVec(v) => Value::TokenVec(v.iter().map(|t| unescaped(t).into()).collect()),
        other => other,
    }
}

/// Whether a layer is text: by its name, also inside a package, and by its first bytes where the name leaves it open.
fn is_text(layer: &Path) -> bool {
    let name = layer.to_string_lossy();
    let inner = name.rsplit_once('[').map_or(&*name, |(_, inner)| inner.trim_end_matches(']'));
    match Path::new(inner).extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).as_deref() {
        Some("usda") => true,
        Some("usd") => {
            let mut start = [0; 5];
            std::fs::File::open(layer).and_then(|mut f| f.read_exact(&mut start)).is_ok() && start == *b"#usda"
        }
        _ => false,
    }
}

fn unescaped(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut letters = text.chars();
    while let Some(letter) = letters.next() {
        let next = letters.clone().next().filter(|_| letter == '\\');
        let meant = match next {
            Some(c @ ('\\' | '"' | '\'')) => c,
            Some('n') => '\n',
            Some('r') => '\r',
            Some('t') => '\t',
            Some('x') => match letters.as_str().get(1..3).and_then(|hex| u8::from_str_radix(hex, 16).ok()) {
                Some(code) if code.is_ascii() => {
                    letters.nth(1);
                    char::from(code)
                }
                _ => 'x',
            },
            _ => {
                plain.push(letter);
                continue;
            }
        };
        plain.push(meant);
        letters.next();
    }
    plain
}

/// A text as it has to be written so that USD, which knows escapes, and openusd with [`as_meant`] read it back.
pub(super) fn escaped(text: &str) -> String {
    let plain = text.replace('\\', "\\\\").replace('\n', "\\n").replace('\r', "\\r");
    // Around both kinds of quotes openusd writes three, which it cannot read back.
    if text.contains('"') && text.contains('\'') {
        plain.replace('\'', "\\x27").replace('"', "\\x22")
    } else {
        plain.replace('"', "\\\"")
    }
}

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
fn integer(value: &Value) -> Option<i64> {
    match value {
        Value::Uchar(v) => Some(i64::from(*v)),
        Value::Int(v) => Some(i64::from(*v)),
        Value::Uint(v) => Some(i64::from(*v)),
        Value::Int64(v) => Some(*v),
        Value::Uint64(v) => i64::try_from(*v).ok(),
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

/// A value as JSON: flags, numbers, texts and lists of texts; null for what no setting has.
pub(super) fn as_json(value: &Value) -> serde_json::Value {
    match value {
        Value::Bool(v) => (*v).into(),
        Value::StringVec(v) => v.clone().into(),
        Value::TokenVec(v) => v.iter().map(ToString::to_string).collect(),
        other => match integer(other) {
            Some(whole) => whole.into(),
            None => number(other).map(Into::into).or_else(|| text(other).map(Into::into)).unwrap_or_default(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_are_undone() {
        for text in
            ["", "plain", "back\\slash", "C:\\new\\table", "quo\"te's", "\"", "'", "two\nlines", "ends with \\", "\\\\server"]
        {
            assert_eq!(unescaped(&escaped(text)), text);
        }
        assert_eq!(unescaped("C:\\dir\\x41"), "C:\\dirA");
        assert_eq!(unescaped("\\q \\x4 \\xé"), "\\q x4 xé", "as USD has it");
    }
}
