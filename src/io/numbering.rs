//! Frame numbers in file names: the number nearest the extension, or where a `####` or `%04d` stands.

use std::collections::BTreeMap;

/// A file name with the place of the number: `frame_####.exr` or `frame_%04d.exr`.
pub(crate) struct NumberPattern {
    pub prefix: String,
    pub suffix: String,
    /// At least this many digits.
    digits: usize,
}

impl NumberPattern {
    /// None where the name has no such place; the error is a reason.
    pub fn parse(name: &str) -> Result<Option<Self>, String> {
        let mut places = Vec::new();
        let mut at = 0;
        while let Some(rest) = name.get(at..).filter(|r| !r.is_empty()) {
            let hashes = rest.len() - rest.trim_start_matches('#').len();
            let (length, digits) = if hashes > 0 { (hashes, hashes) } else { printf(rest) };
            if length > 0 {
                places.push((at, length, digits));
            }
            at += match length {
                0 if rest.starts_with("%%") => 2,
                0 => rest.chars().next().map_or(1, char::len_utf8),
                _ => length,
            };
        }
        match places.as_slice() {
            [] => Ok(None),
            [(start, length, digits)] => Ok(Some(Self {
                prefix: name[..*start].replace("%%", "%"),
                suffix: name[start + length..].replace("%%", "%"),
                digits: *digits,
            })),
            _ => Err("has several places for the frame number: use #### or %04d once".into()),
        }
    }

    /// The name of a number's file.
    pub fn name(&self, number: i64) -> String {
        // The sign counts towards the width, as printf and Blender have it.
        format!("{}{number:0width$}{}", self.prefix, self.suffix, width = self.digits)
    }

    /// The number of a file that matches, and its digits.
    pub fn number(&self, name: &str) -> Option<(i64, usize)> {
        self.digits_of(name.strip_prefix(self.prefix.as_str())?.strip_suffix(self.suffix.as_str())?)
    }

    /// As [`number`](Self::number), of a name in any letter case, with what stands before and behind its number.
    pub fn number_in_any_case<'a>(&self, name: &'a str) -> Option<(&'a str, i64, usize, &'a str)> {
        let place = |count: usize| name.char_indices().map(|(at, _)| at).chain([name.len()]).nth(count);
        let start = place(self.prefix.chars().count())?;
        let end = place(name.chars().count().checked_sub(self.suffix.chars().count())?)?;
        let (prefix, middle, suffix) = (&name[..start], name.get(start..end)?, &name[end..]);
        let (number, digits) = self.digits_of(middle)?;
        let alike = |a: &str, b: &str| a.to_lowercase() == b.to_lowercase();
        (alike(prefix, &self.prefix) && alike(suffix, &self.suffix)).then_some((prefix, number, digits, suffix))
    }

    /// The number that stands in a name where the pattern has its own.
    fn digits_of(&self, middle: &str) -> Option<(i64, usize)> {
        let digits = middle.strip_prefix('-').unwrap_or(middle);
        // The sign counts towards the width, as printf and Blender have it.
        let wide_enough = middle.len() >= self.digits && (1..=18).contains(&digits.len());
        let all_digits = digits.bytes().all(|b| b.is_ascii_digit());
        (wide_enough && all_digits).then(|| middle.parse().ok()).flatten().map(|n| (n, middle.len()))
    }
}

/// Length and digits of a `%d`, `%4d` or `%04d` at the start of `text`; zeros where there is none.
fn printf(text: &str) -> (usize, usize) {
    let Some(rest) = text.strip_prefix('%') else { return (0, 0) };
    let width = rest.bytes().take_while(u8::is_ascii_digit).count();
    match (rest.as_bytes().get(width), rest.get(..width).unwrap_or_default()) {
        (Some(b'd'), "") => (2, 1),
        (Some(b'd'), w) => w.parse().ok().filter(|w| (1..=18).contains(w)).map_or((0, 0), |w| (width + 2, w)),
        _ => (0, 0),
    }
}

/// Splits a name at the number nearest the extension: prefix, number, digits (with the sign), suffix.
pub(crate) fn split_number(name: &str) -> Option<(String, i64, usize, String)> {
    let stem = &name[..name.rfind('.').unwrap_or(name.len())];
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let mut start = stem[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |i| {
        // Step over the whole character, which may be longer than a byte.
        i + stem[i..].chars().next().map_or(1, char::len_utf8)
    });
    if end - start > 18 {
        return None;
    }
    // A minus is a sign only where no word is before it: `shot_-001` but not `shot-001`.
    let before = stem[..start].strip_suffix('-');
    if before.is_some_and(|b| !b.chars().next_back().is_some_and(char::is_alphanumeric)) {
        start -= 1;
    }
    let number = name[start..end].parse().ok()?;
    Some((name[..start].into(), number, end - start, name[end..].into()))
}

/// What most of some names have in common if another number than the one nearest the extension is the frame's, such as
/// `frame_####_v02.exr`; None where no two do.
pub(crate) fn other_pattern<'a>(names: impl Iterator<Item = &'a str>) -> Option<(String, usize)> {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    names.flat_map(other_patterns).for_each(|pattern| *counts.entry(pattern).or_default() += 1);
    counts.into_iter().filter(|(_, count)| *count > 1).max_by_key(|(_, count)| *count)
}

/// A name with `####` for each of its numbers but the one nearest the extension.
fn other_patterns(name: &str) -> Vec<String> {
    let Some((prefix, ..)) = split_number(name) else { return Vec::new() };
    let mut patterns = Vec::new();
    let mut end = prefix.len();
    while let Some(last) = prefix[..end].rfind(|c: char| c.is_ascii_digit()) {
        end = prefix[..=last].trim_end_matches(|c: char| c.is_ascii_digit()).len();
        patterns.push(format!("{}{}{}", &name[..end], "#".repeat(last + 1 - end), &name[last + 1..]));
    }
    patterns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_behind_the_frame_number_is_found_out() {
        let found = |names: &[&str]| other_pattern(names.iter().copied());
        let pattern = Some(("frame_####_v02.exr".into(), 3));
        assert_eq!(found(&["frame_0001_v02.exr", "frame_0002_v02.exr", "other_0007_v01.exr", "frame_0010_v02.exr"]), pattern);
        assert_eq!(found(&["a_1_é2_3.exr", "a_1_é7_3.exr"]), Some(("a_1_é#_3.exr".into(), 2)));
        assert_eq!(found(&["a_0001.exr", "b_0002.exr", "c.exr"]), None);
    }

    #[test]
    fn two_percent_signs_are_one() {
        let pattern = NumberPattern::parse("50%%d_%04d.exr").unwrap().unwrap();
        assert_eq!((pattern.name(7), pattern.number("50%d_0012.exr")), ("50%d_0007.exr".into(), Some((12, 4))));
        assert!(NumberPattern::parse("%d_%04d.exr").is_err() && NumberPattern::parse("a%%d.exr").unwrap().is_none());
    }

    #[test]
    fn letter_case_is_let_be_where_that_is_asked_for() {
        let pattern = NumberPattern::parse("Ærø_####.exr").unwrap().unwrap();
        for (name, expected) in [
            ("æRØ_0012.EXR", Some(("æRØ_", 12, 4, ".EXR"))),
            ("Ærø_0012.exr", Some(("Ærø_", 12, 4, ".exr"))),
            ("Ærø_-012.exr", Some(("Ærø_", -12, 4, ".exr"))),
            ("Ærø_12.exr", None),
            ("Ære_0012.exr", None),
            ("Ærø_0012.ex", None),
            ("ø.exr", None),
            ("", None),
        ] {
            assert_eq!(pattern.number_in_any_case(name), expected, "{name}");
        }
        assert_eq!(pattern.number("æRØ_0012.EXR"), None);
    }

    #[test]
    fn the_number_nearest_the_extension_counts() {
        let split = |n: &str| split_number(n).map(|(p, n, d, s)| format!("{p}|{n}|{d}|{s}"));
        for (name, expected) in [
            ("shot01_v002_0012.exr", "shot01_v002_|12|4|.exr"),
            ("frame.0012.exr", "frame.|12|4|.exr"),
            ("0012.exr", "|12|4|.exr"),
            ("frame_0012_L.exr", "frame_|12|4|_L.exr"),
            ("shot-0012.exr", "shot-|12|4|.exr"),
            ("shot_-012.exr", "shot_|-12|4|.exr"),
            ("-012.exr", "|-12|4|.exr"),
            ("día7.exr", "día|7|1|.exr"),
            ("é12é.exr", "é|12|2|é.exr"),
        ] {
            assert_eq!(split(name).as_deref(), Some(expected), "{name}");
        }
        assert_eq!(split("beauty.exr"), None);
        assert_eq!(split("f_12345678901234567890.exr"), None);
    }
}
