//! SMAPE, the paper's loss and first metric.

use super::Pair;

/// Vogels et al. 2018, section 5.
pub const EPSILON: f64 = 1e-2;

/// Symmetric mean absolute percentage error, mean |d − r| / (|d| + |r| + ε) over pixels and channels, ε = 0.01: 0 for equal
/// images, below 1 always. Vogels et al. 2018, "Denoising with Kernel Prediction and Asymmetric Loss Functions", section 5.
pub fn smape(pair: &Pair) -> f64 {
    pair.mean_error(|r, d| (d - r).abs() / (d.abs() + r.abs() + EPSILON))
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::super::pair::samples::{check_promises, formula, score};
    use super::super::{Pair, Scaling};
    use super::*;

    #[test]
    fn known_by_hand() {
        let r = array![[[1.0, 0.0, 0.5]]];
        let d = array![[[0.5, 0.0, 0.99]]];
        let pair = Pair::new(r.view(), d.view(), Scaling::None).unwrap();
        let expected = (0.5 / 1.51 + 0.0 + 0.49 / 1.5) / 3.0;
        assert!((smape(&pair) - expected).abs() < 1e-7);
    }

    #[test]
    fn scales_both_images() {
        let r = array![[[4.0, 4.0, 4.0]]];
        let d = array![[[2.0, 2.0, 2.0]]];
        assert!((score(smape, &r, &d) - 0.2 / 0.61).abs() < 1e-7);
    }

    #[test]
    fn symmetric_without_scaling() {
        let (a, b) = formula(9, 7);
        let of =
            |r: &ndarray::Array3<f32>, d: &ndarray::Array3<f32>| smape(&Pair::new(r.view(), d.view(), Scaling::None).unwrap());
        assert_eq!(of(&a, &b), of(&b, &a));
    }

    #[test]
    fn agrees_with_numpy() {
        let (r, d) = formula(48, 64);
        assert!((score(smape, &r, &d) - 0.026_282_611_414).abs() < 1e-9);
    }

    #[test]
    fn keeps_the_promises() {
        check_promises(smape, 0.0, true);
    }
}
