//! The tone curve in front of the metrics that model a display: PSNR, SSIM and FLIP.

/// Scaled linear radiance to a display value in [0, 1): x / (1 + x) of each channel (Reinhard et al. 2002, equation 3), then
/// the sRGB transfer function (IEC 61966-2-1). Negative radiance is black.
pub fn display(linear: f64) -> f64 {
    let x = linear.max(0.0);
    srgb(x / (1.0 + x))
}

/// Luma of a display colour with the Rec. 709 weights.
pub fn luma(colour: [f64; 3]) -> f64 {
    0.2126 * colour[0] + 0.7152 * colour[1] + 0.0722 * colour[2]
}

/// The sRGB transfer function (IEC 61966-2-1) of 0…1.
pub fn srgb(x: f64) -> f64 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        assert_eq!(display(0.0), 0.0);
        assert_eq!(display(-3.0), 0.0);
        // x = 1 becomes 0.5, which sRGB encodes as 0.735357.
        assert!((display(1.0) - 0.735_357).abs() < 1e-6);
        // Middle grey.
        assert!((srgb(0.214_041_14) - 0.5).abs() < 1e-7);
        assert!((luma([1.0; 3]) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn rises_and_stays_below_one() {
        let values: Vec<f64> = (0..2000).map(|i| display(1e-5 * 1.01f64.powi(i))).collect();
        assert!(values.windows(2).all(|w| w[1] > w[0]));
        assert!(values.iter().all(|v| (0.0..1.0).contains(v)));
        assert!(display(f64::from(f32::MAX)) <= 1.0);
    }
}
