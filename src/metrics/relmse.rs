//! Relative mean squared error.

use super::Pair;

/// Keeps dark pixels from ruling the mean.
pub const EPSILON: f64 = 1e-2;

/// Relative mean squared error, mean (d − r)² / (r² + ε) over pixels and channels, ε = 0.01: 0 for equal images, unbounded.
/// Rousselle et al. 2011, "Adaptive Sampling and Reconstruction using Greedy Error Minimization". Nothing is trimmed: where a
/// paper leaves out the worst 0.1 % of the pixels, fireflies count here and not there.
pub fn relmse(pair: &Pair) -> f64 {
    pair.mean_error(|r, d| (d - r).powi(2) / (r * r + EPSILON))
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::super::pair::samples::{check_promises, formula, score};
    use super::super::{Pair, Scaling};
    use super::*;

    #[test]
    fn known_by_hand() {
        let r = array![[[1.0, 0.0, 3.0]]];
        let d = array![[[0.5, 0.1, 3.0]]];
        let pair = Pair::new(r.view(), d.view(), Scaling::None).unwrap();
        let expected = (0.25 / 1.01 + 0.01 / 0.01) / 3.0;
        assert!((relmse(&pair) - expected).abs() < 1e-7);
    }

    #[test]
    fn scales_both_images() {
        let r = array![[[4.0, 4.0, 4.0]]];
        let d = array![[[2.0, 2.0, 2.0]]];
        assert!((score(relmse, &r, &d) - 0.04 / 0.17).abs() < 1e-7);
    }

    #[test]
    fn agrees_with_numpy() {
        let (r, d) = formula(48, 64);
        assert!((score(relmse, &r, &d) - 0.003_256_169_098).abs() < 1e-9);
    }

    #[test]
    fn keeps_the_promises() {
        check_promises(relmse, 0.0, true);
    }
}
