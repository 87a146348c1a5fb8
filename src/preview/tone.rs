//! Linear light as a display shows it.

use crate::metrics::tonemap::srgb;

/// Linear radiance, 2 to the power of `exposure` brighter, as sRGB, 0…255: cut at 1, no view transform. NaN and negative are black.
#[allow(clippy::manual_clamp, reason = "clamp would leave NaN as it is")]
pub fn shown(linear: [f64; 3], exposure: f64) -> [f64; 3] {
    let gain = exposure.exp2();
    linear.map(|v| 255.0 * srgb((v * gain).max(0.0).min(1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposure_counts_in_stops_and_nothing_leaves_the_range() {
        let near = |a: f64, b: f64| (a - b).abs() < 0.01;
        let [grey, one, more] = shown([0.214_041, 1.0, 7.0], 0.0);
        assert!(near(grey, 127.5) && near(one, 255.0) && near(more, 255.0));
        assert!(near(shown([0.107_020_5; 3], 1.0)[0], 127.5));
        assert_eq!(shown([f64::NAN, -1.0, f64::NEG_INFINITY], 3.0), [0.0; 3]);
        assert_eq!(shown([f64::INFINITY; 3], 0.0), shown([1.0; 3], 0.0));
    }
}
