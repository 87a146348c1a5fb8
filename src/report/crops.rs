//! Tiles to look at: where the default setting is worst, and where it is as it mostly is.

use ndarray::{Array3, ArrayView3, s};

use super::candidates::{Candidate, Method};
use crate::metrics::pair::REFERENCE_MEAN;
use crate::metrics::smape;
use crate::metrics::tonemap::display;
use crate::picture::false_colour::false_colour;
use crate::picture::pixels::{pixmap, png};

/// The sides of a tile.
const TILE: usize = 64;
/// The error that has the brightest false colour.
pub const ERROR_SCALE_END: f64 = 0.25;

/// One tile by every candidate.
#[derive(Clone)]
pub struct CropSet {
    /// `worst` or `median`.
    pub which: &'static str,
    pub frame: i64,
    /// The upper left corner, and the sides, in pixels.
    pub row: usize,
    pub column: usize,
    pub rows: usize,
    pub columns: usize,
    /// Whether the errors are against a reference; else they are differences to the default setting.
    pub against_reference: bool,
    pub pictures: Vec<Picture>,
}

/// One picture of a tile.
#[derive(Clone)]
pub struct Picture {
    pub name: String,
    /// PNG.
    pub image: Vec<u8>,
    /// The mean error over the tile (SMAPE), and a PNG of it in false colours; none for the reference itself.
    pub error: Option<(f64, Vec<u8>)>,
}

/// Looks for the tiles frame by frame.
#[derive(Default)]
pub struct Crops {
    scores: Vec<f64>,
    worst: Option<(f64, CropSet)>,
    /// Of each frame the tile in the middle.
    medians: Vec<(f64, CropSet)>,
}

impl Crops {
    /// Takes the next frame's pictures, (rows, columns, 3) each. Without a reference the tiles are those where the default
    /// setting and the next one of Hush differ.
    pub fn take(&mut self, frame: i64, pictures: &[(&Candidate, &Array3<f32>)], reference: Option<&Array3<f32>>) {
        let Some(own) = pictures.iter().find(|(c, _)| c.default).map(|(_, image)| *image) else { return };
        let other = pictures.iter().find(|(c, _)| !c.default && matches!(c.method, Method::Hush { .. })).map(|(_, i)| *i);
        let Some(against) = reference.or(other) else { return };
        let gain = gain_of(reference.unwrap_or(own).view());
        let (rows, columns, _) = own.dim();
        let (high, wide) = (TILE.min(rows), TILE.min(columns));
        let mut tiles: Vec<(f64, usize, usize)> = Vec::new();
        for row in (0..=rows - high).step_by(high) {
            for column in (0..=columns - wide).step_by(wide) {
                let cut = s![row..row + high, column..column + wide, ..];
                tiles.push((mean_error(own.slice(cut), against.slice(cut), gain), row, column));
            }
        }
        tiles.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.scores.extend(tiles.iter().map(|t| t.0));
        let set = |which: &'static str, (_, row, column): (f64, usize, usize)| {
            let cut = s![row..row + high, column..column + wide, ..];
            let truth = reference.unwrap_or(own).slice(cut);
            let mut made: Vec<Picture> = Vec::new();
            if let Some(reference) = reference {
                made.push(Picture { name: "reference".into(), image: shown(reference.slice(cut), gain), error: None });
            }
            for (candidate, image) in pictures {
                let tile = image.slice(cut);
                let same = reference.is_none() && candidate.default;
                let error = (!same).then(|| (mean_error(tile, truth, gain), false_colours(tile, truth, gain)));
                made.push(Picture { name: candidate.name.clone(), image: shown(tile, gain), error });
            }
            let against_reference = reference.is_some();
            CropSet { which, frame, row, column, rows: high, columns: wide, against_reference, pictures: made }
        };
        if let Some(worst) = tiles.last().copied()
            && self.worst.as_ref().is_none_or(|(score, _)| worst.0 > *score)
        {
            self.worst = Some((worst.0, set("worst", worst)));
        }
        if let Some(median) = tiles.get(tiles.len() / 2).copied() {
            self.medians.push((median.0, set("median", median)));
        }
    }

    /// The worst tile of all frames, and of the frames' middle ones the one nearest to the middle of all.
    pub fn finish(mut self) -> Vec<CropSet> {
        self.scores.sort_by(f64::total_cmp);
        let middle = self.scores.get(self.scores.len() / 2).copied().unwrap_or(0.0);
        let distance = |score: f64| (score - middle).abs();
        let median = self.medians.into_iter().min_by(|a, b| distance(a.0).total_cmp(&distance(b.0)));
        self.worst.into_iter().chain(median).map(|(_, set)| set).collect()
    }
}

/// The scale that shows a frame at the metrics' brightness.
fn gain_of(image: ArrayView3<f32>) -> f64 {
    let sum: f64 = image.iter().filter(|v| v.is_finite()).map(|v| f64::from(v.max(0.0))).sum();
    REFERENCE_MEAN / (sum / image.len().max(1) as f64).max(1e-6)
}

fn error_at(a: ArrayView3<f32>, b: ArrayView3<f32>, gain: f64, y: usize, x: usize) -> f64 {
    let channel = |c: usize| {
        let (a, b) = (f64::from(a[[y, x, c]]) * gain, f64::from(b[[y, x, c]]) * gain);
        let error = (a - b).abs() / (a.abs() + b.abs() + smape::EPSILON);
        if error.is_finite() { error } else { 0.0 }
    };
    (channel(0) + channel(1) + channel(2)) / 3.0
}

fn mean_error(a: ArrayView3<f32>, b: ArrayView3<f32>, gain: f64) -> f64 {
    let (rows, columns, _) = a.dim();
    let sum: f64 = (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))).map(|(y, x)| error_at(a, b, gain, y, x)).sum();
    sum / (rows * columns).max(1) as f64
}

fn shown(tile: ArrayView3<f32>, gain: f64) -> Vec<u8> {
    let (rows, columns, _) = tile.dim();
    png(pixmap(rows, columns, |y, x| [0, 1, 2].map(|c| 255.0 * display(f64::from(tile[[y, x, c]]) * gain))))
}

fn false_colours(a: ArrayView3<f32>, b: ArrayView3<f32>, gain: f64) -> Vec<u8> {
    let (rows, columns, _) = a.dim();
    png(pixmap(rows, columns, |y, x| false_colour(error_at(a, b, gain, y, x) / ERROR_SCALE_END)))
}

#[cfg(test)]
mod tests {
    use super::super::candidates::candidates;
    use super::*;

    fn pictures(frames: usize, bad_at: (usize, usize)) -> Vec<CropSet> {
        let all = candidates(true, false, false);
        let clean = Array3::from_elem((150, 200, 3), 0.5f32);
        let mut crops = Crops::default();
        for frame in 0..frames {
            let mut own = clean.mapv(|v| v * 1.02);
            if frame == 1 {
                own.slice_mut(s![bad_at.0..bad_at.0 + 8, bad_at.1..bad_at.1 + 8, ..]).fill(3.0);
            }
            crops.take(frame as i64, &[(&all[0], &clean), (&all[1], &own)], Some(&clean));
        }
        crops.finish()
    }

    #[test]
    fn the_worst_tile_is_found_and_the_middle_one_is_ordinary() {
        let sets = pictures(3, (70, 130));
        assert_eq!(sets.iter().map(|s| s.which).collect::<Vec<_>>(), ["worst", "median"]);
        let worst = &sets[0];
        assert_eq!((worst.frame, worst.row, worst.column), (1, 64, 128));
        assert_eq!(worst.pictures.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["reference", "noisy", "window 2"]);
        assert!(worst.pictures[2].error.as_ref().unwrap().0 > sets[1].pictures[2].error.as_ref().unwrap().0);
        assert_eq!(worst.pictures[1].error.as_ref().unwrap().0, 0.0);
        assert!(worst.pictures[0].error.is_none());
        assert!(worst.pictures.iter().all(|p| p.image.starts_with(b"\x89PNG")));
    }
}
