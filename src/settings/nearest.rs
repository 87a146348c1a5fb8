//! The valid name nearest to a mistyped one.

/// The name of `names` that takes the fewest changes to come to, if that is not too many.
pub(super) fn nearest<'a>(wrong: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let plain = |t: &str| t.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect::<Vec<_>>();
    let wrong = plain(wrong);
    let rated = names.into_iter().map(|name| (distance(&wrong, &plain(name)), name));
    rated.min_by_key(|(far, _)| *far).filter(|(far, name)| *far <= 1 + name.len() / 3).map(|(_, name)| name)
}

/// ` (did you mean …?)`, or nothing.
pub(super) fn hint<'a>(wrong: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    nearest(wrong, names).map(|name| format!("; did you mean {name}?")).unwrap_or_default()
}

/// Levenshtein's distance; long texts are cut, as no name is long.
fn distance(a: &[char], b: &[char]) -> usize {
    let (a, b) = (&a[..a.len().min(64)], &b[..b.len().min(64)]);
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut corner = std::mem::replace(&mut row[0], i + 1);
        for (j, y) in b.iter().enumerate() {
            let change = corner + usize::from(x != y);
            corner = row[j + 1];
            row[j + 1] = change.min(row[j] + 1).min(corner + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_names_are_found_and_far_ones_are_not() {
        let names = ["lambda", "window", "layers", "keep_noisy", "passes.beauty"];
        for (wrong, right) in [
            ("lamda", Some("lambda")),
            ("Lambda", Some("lambda")),
            ("keepNoisy", Some("keep_noisy")),
            ("windows", Some("window")),
            ("passes.beaty", Some("passes.beauty")),
            ("colour", None),
            ("", None),
        ] {
            assert_eq!(nearest(wrong, names), right, "{wrong}");
        }
        assert_eq!(hint("layer", names), "; did you mean layers?");
        assert_eq!(nearest(&"x".repeat(100_000), names), None);
    }
}
