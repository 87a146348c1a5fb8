//! Before and after in one image.

use ndarray::{Array3, ArrayView3, s};

/// The column where `position`, 0…1 of the width, lies.
pub fn line(position: f64, columns: usize) -> usize {
    (position.clamp(0.0, 1.0) * columns as f64).round() as usize
}

/// `before` left of a place, 0…1 of the width, and `after` right of it; (rows, columns, channels), of one size.
pub fn wipe(before: ArrayView3<f32>, after: ArrayView3<f32>, position: f64) -> Array3<f32> {
    let at = line(position, after.dim().1);
    let mut out = after.to_owned();
    out.slice_mut(s![.., ..at, ..]).assign(&before.slice(s![.., ..at, ..]));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn left_is_before_and_right_is_after() {
        let (before, after) = (Array3::zeros((2, 10, 3)), Array3::ones((2, 10, 3)));
        let share = |at: f64| wipe(before.view(), after.view(), at).sum() / 60.0;
        assert_eq!([share(0.0), share(0.3), share(1.0), share(9.0)], [1.0, 0.7, 0.0, 0.0]);
        assert_eq!(wipe(before.view(), after.view(), 0.3)[(1, 2, 0)], 0.0);
    }
}
