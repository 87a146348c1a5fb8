//! FLIP, the difference that a viewer sees when flipping between two images on a display.

use flip_rs::{DEFAULT_PPD, FlipError, RgbImage, ldr_flip};
use rayon::prelude::*;

use super::Pair;
use super::tonemap::display;
use crate::error::{Error, Result};

/// Rows that are compared at a time, which bounds memory.
const BAND: usize = 128;
/// Rows around a band that its filters reach: ⌈3·√(0.04 / 2π²)·67⌉ for colour, one less for edges and points.
const HALO: usize = 10;

/// Mean LDR-FLIP of the tone-mapped images ([`display`]) at 67 pixels per degree (0.7 m from a 0.7 m wide 4K monitor), 0 for
/// equal images, at most 1. Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images"; the `flip-rs` crate
/// ports version 1.7 of the authors' code. A pixel that is not finite in one image is shown alike in both, and does not count.
pub fn flip(pair: &Pair) -> Result<f64> {
    let (rows, _) = pair.size();
    let starts: Vec<usize> = (0..rows).step_by(BAND).collect();
    let bands: Vec<Vec<(f64, usize)>> = starts.into_par_iter().map(|start| band(pair, start)).collect::<Result<_>>()?;
    let (sum, count) = bands.into_iter().flatten().fold((0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    Ok(sum / count as f64)
}

/// Sum and count of each row of the band that starts at `start`.
fn band(pair: &Pair, start: usize) -> Result<Vec<(f64, usize)>> {
    let (rows, columns) = pair.size();
    let end = (start + BAND).min(rows);
    let (first, last) = (start.saturating_sub(HALO), (end + HALO).min(rows));
    let (mut reference, mut denoised) = (Vec::new(), Vec::new());
    for row in first..last {
        for column in 0..columns {
            let (r, d) = pair.pixel(row, column).unwrap_or_default();
            reference.extend(r.map(|v| display(v) as f32));
            denoised.extend(d.map(|v| display(v) as f32));
        }
    }
    let image = |pixels| RgbImage::new(columns, last - first, pixels);
    let map = ldr_flip(&image(reference).map_err(refused)?, &image(denoised).map_err(refused)?, DEFAULT_PPD).map_err(refused)?;
    let lines = map.pixels().chunks_exact(columns).skip(start - first).zip(start..end);
    Ok(lines
        .map(|(line, row)| {
            let counted = line.iter().enumerate().filter(|&(column, _)| pair.raw(row, column).is_some());
            counted.fold((0.0, 0), |(sum, count), (_, &v)| (sum + f64::from(v), count + 1))
        })
        .collect())
}

fn refused(error: FlipError) -> Error {
    Error::BadInput { input: "image for FLIP".into(), reason: error.to_string() }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array3, s};

    use super::super::pair::samples::{check_promises, formula, score};
    use super::super::{Pair, Scaling};
    use super::*;

    fn value(pair: &Pair) -> f64 {
        flip(pair).unwrap()
    }

    #[test]
    fn agrees_with_the_authors_code() {
        // flip-evaluator 1.7; 5e-11 apart where this was written, the rest is room for other powf.
        let (r, d) = formula(48, 64);
        let error = score(value, &r, &d) - 0.020_352_901_3;
        assert!(error.abs() < 1e-7, "{error:e}");
    }

    #[test]
    fn green_against_blue_is_the_largest_difference() {
        let plain = |c: usize| Array3::from_shape_fn((24, 24, 3), |(_, _, i)| if i == c { 1e9 } else { 0.0 });
        let pair = |r: &Array3<f32>, d: &Array3<f32>| value(&Pair::new(r.view(), d.view(), Scaling::None).unwrap());
        assert!((pair(&plain(1), &plain(2)) - 1.0).abs() < 1e-5);
        assert!(pair(&plain(1), &plain(0)) < 1.0);
    }

    #[test]
    fn bands_leave_no_trace() {
        let (r, d) = formula(2 * BAND + 40, 24);
        let pair = Pair::new(r.view(), d.view(), Scaling::None).unwrap();
        let image = |a: &Array3<f32>| {
            let pixels = a.iter().map(|&v| display(f64::from(v)) as f32).collect();
            RgbImage::new(24, 2 * BAND + 40, pixels).unwrap()
        };
        let whole = ldr_flip(&image(&r), &image(&d), DEFAULT_PPD).unwrap();
        let rows: Vec<f64> = whole.pixels().chunks_exact(24).map(|l| l.iter().map(|&v| f64::from(v)).sum()).collect();
        let banded: Vec<f64> =
            [0, BAND, 2 * BAND].iter().flat_map(|&start| band(&pair, start).unwrap()).map(|(sum, _)| sum).collect();
        assert_eq!(rows, banded);
        let upper = s![..BAND, .., ..];
        assert!(
            rows[BAND - 1] != band(&Pair::new(r.slice(upper), d.slice(upper), Scaling::None).unwrap(), 0).unwrap()[BAND - 1].0
        );
    }

    #[test]
    fn keeps_the_promises() {
        check_promises(value, 0.0, true);
    }
}
