//! Bilinear samples of an image of which some pixels may not count.

/// The colour at column `x` and row `y`, in pixels, of an image of (rows, columns); None outside the image's area, where its rim is
/// half a pixel around the outer pixels' middles, and where a pixel that is needed is None.
pub(crate) fn sample(
    (rows, columns): (usize, usize),
    x: f64,
    y: f64,
    colour: impl Fn(usize, usize) -> Option<[f64; 3]>,
) -> Option<[f64; 3]> {
    let (wide, high) = (columns as f64, rows as f64);
    // Written so that NaN is outside.
    if !(x >= -0.5 && x <= wide - 0.5 && y >= -0.5 && y <= high - 0.5) {
        return None;
    }
    let (x, y) = (x.clamp(0.0, wide - 1.0), y.clamp(0.0, high - 1.0));
    let (left, top) = (x.floor(), y.floor());
    let (fx, fy) = (x - left, y - top);
    let mut sum = [0.0; 3];
    for (dy, wy) in [(0, 1.0 - fy), (1, fy)] {
        for (dx, wx) in [(0, 1.0 - fx), (1, fx)] {
            // A weight of zero also marks the column or row beyond the last one.
            if wx * wy > 0.0 {
                let here = colour(top as usize + dy, left as usize + dx)?;
                sum.iter_mut().zip(here).for_each(|(sum, v)| *sum += wx * wy * v);
            }
        }
    }
    Some(sum)
}
