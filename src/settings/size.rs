//! Sizes in bytes as people write them: `4G`, `512M`, `1.5GiB`.

/// Parses a size; units are powers of 1024.
///
/// # Errors
/// In words, where it is none or not above 0.
pub fn parse_size(text: &str) -> Result<u64, String> {
    let advice = || format!("'{text}' is no size: write 4G or 512M");
    let lower = text.trim().to_ascii_lowercase();
    let digits = lower.len() - lower.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.').len();
    let (number, unit) = lower.split_at(digits);
    let power = match unit.trim().trim_end_matches('b').trim_end_matches('i') {
        "" => 0,
        "k" => 1,
        "m" => 2,
        "g" => 3,
        "t" => 4,
        _ => return Err(advice()),
    };
    let bytes = number.parse::<f64>().map_err(|_| advice())? * 1024f64.powi(power);
    // A unit that was forgotten, and not a handful of bytes.
    if power == 0 && bytes < 1000.0 {
        return Err(advice());
    }
    if (1.0..1e18).contains(&bytes) { Ok(bytes as u64) } else { Err(advice()) }
}

#[cfg(test)]
mod tests {
    use super::parse_size;

    #[test]
    fn sizes_are_read() {
        for (text, bytes) in
            [("4G", 4 << 30), ("512m", 512 << 20), ("1.5GiB", 3 << 29), ("2 kb", 2048), ("1T", 1 << 40), ("1000", 1000)]
        {
            assert_eq!(parse_size(text), Ok(bytes), "{text}");
        }
        for bad in ["", "G", "4X", "-4G", "0", "4", "512", "4 G 2", "1e9G", "nan", "99999999T"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }
}
