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

/// USD's escapes: those of C, of which `\x` takes two digits and an unknown one is the letter itself. They name bytes of UTF-8.
fn unescaped(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut plain = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while let Some(byte) = bytes.get(at) {
        at += 1;
        let Some(next) = bytes.get(at).filter(|_| *byte == b'\\') else {
            plain.push(*byte);
            continue;
        };
        let (radix, start, most) = match next {
            b'x' => (16, at + 1, 2),
            b'0'..=b'7' => (8, at, 3),
            _ => (0, at + 1, 0),
        };
        let digits = bytes[start..].iter().take(most).map_while(|b| char::from(*b).to_digit(radix));
        let (count, code) = digits.fold((0, 0), |(count, code), digit| (count + 1, code * radix + digit));
        at = start + count;
        plain.push(match next {
            b'n' => b'\n',
            b'r' => b'\r',
            b't' => b'\t',
            b'a' => 7,
            b'b' => 8,
            b'v' => 11,
            b'f' => 12,
            b'x' | b'0'..=b'7' => code as u8,
            other => *other,
        });
    }
    String::from_utf8_lossy(&plain).into_owned()
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
        for (written, meant) in [
            ("C:\\dir\\x41", "C:dirA"),
            ("\\q \\x4 \\xé \\8", "q \u{4} \0é 8"),
            ("\\x414 \\1014 \\60", "A4 A4 0"),
            ("\\a\\b\\f\\v", "\u{7}\u{8}\u{c}\u{b}"),
            ("Gr\\xc3\\xbc\\303\\237e", "Grüße"),
            ("é\\é \\", "éé \\"),
        ] {
            assert_eq!(unescaped(written), meant, "{written}, as usd-core has it");
        }
    }
}
