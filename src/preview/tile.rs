//! One tile of the sheet: an image at a whole number of pixels a pixel, larger or smaller.

use ndarray::{ArrayView2, ArrayView3};
use resvg::tiny_skia::Pixmap;

use super::flicker::MOST_CHANGE;
use super::tone::shown;
use crate::picture::false_colour::false_colour;
use crate::picture::pixels::pixmap;

/// Where nothing of the last frame is.
pub const NOWHERE: [f64; 3] = [96.0, 104.0, 116.0];

/// How large an image is shown: every pixel so many times, or the mean of so many.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scale {
    pub up: usize,
    pub down: usize,
}

impl Scale {
    /// The one that brings a width between `least` and `most` pixels.
    pub fn for_width(columns: usize, least: usize, most: usize) -> Self {
        let columns = columns.max(1);
        let down = columns.div_ceil(most.max(1)).max(1);
        Self { up: if down > 1 { 1 } else { least.div_ceil(columns).min((most / columns).max(1)).max(1) }, down }
    }

    /// A side of the shown image.
    pub fn side(self, pixels: usize) -> usize {
        (pixels / self.down).max(1) * self.up
    }

    /// In words; none at one to one.
    pub fn text(self) -> Option<String> {
        match (self.up, self.down) {
            (1, 1) => None,
            (1, down) => Some(format!("1:{down}")),
            (up, _) => Some(format!("{up}:1")),
        }
    }

    /// Mean of the finite values among the image's pixels under a shown one; None where there are none.
    fn mean(self, (rows, columns): (usize, usize), y: usize, x: usize, value: impl Fn(usize, usize) -> f64) -> Option<f64> {
        let range = |at: usize, most: usize| {
            let first = (at / self.up * self.down).min(most - 1);
            first..(first + self.down).min(most)
        };
        let (mut sum, mut count) = (0.0, 0);
        for row in range(y, rows) {
            for column in range(x, columns) {
                let v = value(row, column);
                if v.is_finite() {
                    (sum, count) = (sum + v, count + 1);
                }
            }
        }
        (count > 0).then(|| sum / f64::from(count))
    }
}

/// An image of linear light, (rows, columns, 3); what is averaged is averaged as light.
pub fn light(image: ArrayView3<f32>, scale: Scale, exposure: f64) -> Option<Pixmap> {
    let (rows, columns, _) = image.dim();
    pixmap(scale.side(rows), scale.side(columns), |y, x| {
        let mean = |c: usize| scale.mean((rows, columns), y, x, |row, column| f64::from(image[(row, column, c)])).unwrap_or(0.0);
        shown([mean(0), mean(1), mean(2)], exposure)
    })
}

/// A map of change, (rows, columns), in false colours.
pub fn change(map: ArrayView2<f32>, scale: Scale) -> Option<Pixmap> {
    let (rows, columns) = map.dim();
    pixmap(scale.side(rows), scale.side(columns), |y, x| {
        let mean = scale.mean((rows, columns), y, x, |row, column| f64::from(map[(row, column)]));
        mean.map_or(NOWHERE, |v| false_colour(v / MOST_CHANGE))
    })
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array3};

    use super::*;

    #[test]
    fn widths_are_brought_between_bounds() {
        let scale = |columns| Scale::for_width(columns, 240, 960);
        assert_eq!(
            [scale(1920), scale(1921), scale(500), scale(60), scale(1)].map(|s| (s.up, s.down)),
            [(1, 2), (1, 3), (1, 1), (4, 1), (240, 1)]
        );
        assert_eq!((scale(1920).side(1080), scale(60).side(10), scale(1920).text()), (540, 40, Some("1:2".into())));
    }

    #[test]
    fn light_is_averaged_before_it_is_shown() {
        let mut image = Array3::zeros((2, 4, 3));
        image[(0, 0, 0)] = 4.0 * 0.214_041;
        image[(1, 3, 1)] = f32::NAN;
        let made = light(image.view(), Scale { up: 1, down: 2 }, 0.0).unwrap();
        assert_eq!((made.width(), made.height()), (2, 1));
        // A quarter of the four pixels' light is middle grey.
        assert!((127..=128).contains(&made.data()[0]));
        assert_eq!(made.data()[1..], [0, 0, 255, 0, 0, 0, 255]);
        let large = light(image.view(), Scale { up: 3, down: 1 }, 0.0).unwrap();
        assert_eq!((large.width(), large.height(), large.data()[4 * 2], large.data()[4 * 3]), (12, 6, 238, 0));
    }

    #[test]
    fn what_has_no_past_is_grey() {
        let map = Array2::from_shape_vec((1, 2), vec![f32::NAN, 0.0]).unwrap();
        let made = change(map.view(), Scale { up: 1, down: 1 }).unwrap();
        assert_eq!(made.data(), [96, 104, 116, 255, 0, 0, 4, 255]);
    }
}
