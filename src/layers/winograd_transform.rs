//! The transforms of Winograd's minimal filtering F(2×2, 3×3): sums and differences before and after the products.

#![allow(clippy::needless_range_loop, reason = "a tile is an index space; i and j are its coordinates")]

use super::register_tile::Add;
use crate::simd::{LANES, Simd};

/// Rows and columns of a tile of outputs.
pub(super) const SIDE: usize = 2;
/// Points of a transformed tile.
pub(super) const POINTS: usize = 16;
/// Tiles that are multiplied at a time, so that they stay in L2 beside the weights.
pub(super) const TILES: usize = 48;
/// Floats between the points' tiles beyond those that they need: sixteen streams a power of two apart would share few lines of L1.
const SPREAD: usize = 5 * LANES;

/// Floats from point to point.
pub(super) const fn point_of(channels: usize) -> usize {
    TILES * channels + SPREAD
}

/// A point of G g Gᵀ for one pair of channels, G the transform of F(2, 3).
pub(super) fn weight_at(weight: impl Fn(usize, usize) -> f32, point: usize) -> f32 {
    const G: [[f64; 3]; 4] = [[1.0, 0.0, 0.0], [0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0.0, 0.0, 1.0]];
    let (i, j) = (point / 4, point % 4);
    let mut sum = 0.0;
    for y in 0..3 {
        for x in 0..3 {
            sum += G[i][y] * f64::from(weight(y, x)) * G[j][x];
        }
    }
    sum as f32
}

/// Bᵀ d B of each tile of four rows of `line` values: [point][tile][channel], TILES tiles from point to point.
///
/// # Panics
/// Where the rows do not hold the tiles, `out` not the points, or the channels are no whole vectors.
#[inline(always)]
pub(super) fn to_points<S: Simd>(s: S, rows: &[f32], line: usize, channels: usize, tiles: usize, out: &mut [f32]) {
    assert!(tiles <= TILES && channels.is_multiple_of(LANES));
    assert!(rows.len() >= 4 * line && line >= (SIDE * tiles + 2) * channels && out.len() >= POINTS * point_of(channels));
    for tile in 0..tiles {
        for c in (0..channels).step_by(LANES) {
            // SAFETY: the assertions: each of four rows holds 2 · tiles + 2 pixels of whole vectors, of which a tile reads four from
            // 2 · tile on, and each of sixteen points has room for TILES tiles.
            unsafe {
                let from = SIDE * tile * channels + c;
                let mut half = [[s.load_unchecked(rows, from); 4]; 4];
                for x in 0..4 {
                    let [a, b, c, d] = [
                        s.load_unchecked(rows, from + x * channels),
                        s.load_unchecked(rows, from + line + x * channels),
                        s.load_unchecked(rows, from + 2 * line + x * channels),
                        s.load_unchecked(rows, from + 3 * line + x * channels),
                    ];
                    [half[0][x], half[1][x], half[2][x], half[3][x]] = [s.sub(a, c), s.add(b, c), s.sub(c, b), s.sub(b, d)];
                }
                let to = tile * channels + c;
                for i in 0..4 {
                    let [a, b, c, d] = half[i];
                    let points = [s.sub(a, c), s.add(b, c), s.sub(c, b), s.sub(b, d)];
                    for j in 0..4 {
                        s.store_unchecked(points[j], out, to + (4 * i + j) * point_of(channels));
                    }
                }
            }
        }
    }
}

/// Where the pixels of tiles go.
pub(super) struct Target<'a> {
    /// The two rows of the tiles, or the image's last one; `channels` values a pixel.
    pub rows: &'a mut [f32],
    /// Columns of a row.
    pub columns: usize,
    /// The first tile's first column.
    pub column: usize,
    /// An image's rows as the output's.
    pub add: Add<'a>,
    pub relu: bool,
}

/// Aᵀ m A of each tile, with bias, residual and ReLU.
///
/// # Panics
/// Where the products or the target do not hold the tiles, or the bias is no whole vectors.
#[inline(always)]
pub(super) fn from_points<S: Simd>(s: S, products: &[f32], bias: &[f32], tiles: usize, target: &mut Target) {
    let channels = bias.len();
    assert!(tiles <= TILES && channels.is_multiple_of(LANES) && products.len() >= POINTS * point_of(channels));
    let whole = target.rows.len() == SIDE * target.columns * channels;
    for tile in 0..tiles {
        let column = target.column + SIDE * tile;
        // SAFETY: `tile` is one of TILES, and the assertion covers the points of all of them.
        unsafe {
            match (whole, target.columns - column >= SIDE) {
                (true, true) => tile_from_points::<S, SIDE, SIDE>(s, products, bias, tile, target),
                (true, false) => tile_from_points::<S, SIDE, 1>(s, products, bias, tile, target),
                (false, true) => tile_from_points::<S, 1, SIDE>(s, products, bias, tile, target),
                (false, false) => tile_from_points::<S, 1, 1>(s, products, bias, tile, target),
            }
        }
    }
}

/// The first ROWS × COLUMNS pixels of a tile.
///
/// # Safety
/// `products` holds all points of the tile, and the bias is whole vectors.
#[inline(always)]
unsafe fn tile_from_points<S: Simd, const ROWS: usize, const COLUMNS: usize>(
    s: S,
    products: &[f32],
    bias: &[f32],
    tile: usize,
    target: &mut Target,
) {
    let channels = bias.len();
    for c in (0..channels).step_by(LANES) {
        let from = tile * channels + c;
        let bias = s.load(bias, c);
        let mut half = [[bias; 4]; SIDE];
        for j in 0..4 {
            // SAFETY: the caller's promise.
            let [a, b, m, d] = unsafe {
                [
                    s.load_unchecked(products, from + j * point_of(channels)),
                    s.load_unchecked(products, from + (4 + j) * point_of(channels)),
                    s.load_unchecked(products, from + (8 + j) * point_of(channels)),
                    s.load_unchecked(products, from + (12 + j) * point_of(channels)),
                ]
            };
            [half[0][j], half[1][j]] = [s.add(s.add(a, b), m), s.sub(s.sub(b, m), d)];
        }
        for y in 0..ROWS {
            let [a, b, m, d] = half[y];
            let pair = [s.add(s.add(s.add(a, b), m), bias), s.add(s.sub(s.sub(b, m), d), bias)];
            for x in 0..COLUMNS {
                let at = (y * target.columns + target.column + SIDE * tile + x) * channels + c;
                let mut sum = pair[x];
                match target.add {
                    Add::Nothing => {}
                    Add::Output => sum = s.add(sum, s.load(target.rows, at)),
                    Add::Image(image) => sum = s.add(sum, s.load(image, at)),
                }
                if target.relu {
                    sum = s.relu(sum);
                }
                s.store(sum, target.rows, at);
            }
        }
    }
}
