//! Peak signal-to-noise ratio on the display.

use super::Pair;
use super::tonemap::display;

/// −10·log₁₀ of the mean squared error, in decibels, of the tone-mapped images ([`display`], peak 1), over pixels and
/// channels. Infinite for equal images.
pub fn psnr(pair: &Pair) -> f64 {
    let error = pair.mean_error(|r, d| (display(d) - display(r)).powi(2));
    if error > 0.0 { -10.0 * error.log10() } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array3, array};

    use super::super::pair::samples::{check_promises, formula, score};
    use super::super::{Pair, Scaling};
    use super::*;

    #[test]
    fn known_by_hand() {
        // Linear 1 is 0.735357 on the display, against black.
        let r = array![[[1.0, 1.0, 1.0]]];
        let d = Array3::zeros((1, 1, 3));
        let pair = Pair::new(r.view(), d.view(), Scaling::None).unwrap();
        assert!((psnr(&pair) - -20.0 * 0.735_357f64.log10()).abs() < 1e-5);
    }

    #[test]
    fn agrees_with_numpy() {
        let (r, d) = formula(48, 64);
        assert!((score(psnr, &r, &d) - 39.238_239_877_5).abs() < 1e-8);
    }

    #[test]
    fn keeps_the_promises() {
        check_promises(psnr, f64::INFINITY, false);
    }
}
