//! False colours for maps of errors and of change.

/// From 0 to 1, matplotlib's `inferno` at eight places.
const COLOURS: [[f64; 3]; 8] = [
    [0.0, 0.0, 4.0],
    [40.0, 11.0, 84.0],
    [101.0, 21.0, 110.0],
    [159.0, 42.0, 99.0],
    [212.0, 72.0, 66.0],
    [245.0, 125.0, 21.0],
    [250.0, 193.0, 39.0],
    [252.0, 255.0, 164.0],
];

/// The colour of 0…1, 0…255 each.
pub fn false_colour(share: f64) -> [f64; 3] {
    let at = share.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
    let below = (at as usize).min(COLOURS.len() - 2);
    std::array::from_fn(|c| COLOURS[below][c] + (at - below as f64) * (COLOURS[below + 1][c] - COLOURS[below][c]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn false_colours_run_from_dark_to_bright() {
        let sums: Vec<f64> = (0..=10).map(|i| false_colour(f64::from(i) / 10.0).iter().sum()).collect();
        assert!(sums.windows(2).all(|w| w[1] > w[0]));
        assert_eq!(false_colour(9.0), [252.0, 255.0, 164.0]);
        assert_eq!(false_colour(f64::NAN.max(0.0)), [0.0, 0.0, 4.0]);
    }
}
