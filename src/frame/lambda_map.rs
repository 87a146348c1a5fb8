//! λ that differs from pixel to pixel of a frame, as the network takes it: its logarithm at half resolution.

use ndarray::{Array2, ArrayView2};

use super::pixels::ALIGNMENT;
use crate::error::{Error, Result};
use crate::rules::window::LAMBDA_RANGE;
use crate::words::counted;

/// Masks may be off by this much, as filters leave them, before anybody is told.
const ROUNDING: f32 = 1e-3;

/// λ of a frame.
#[derive(Clone, Copy, Debug)]
pub enum Dial<'a> {
    /// The same for all pixels: 1…64; greater is clamped, less or NaN refused.
    Constant(f32),
    /// One for each pixel of the frame.
    Map(&'a LambdaMap),
}

impl<'a> Dial<'a> {
    /// The map where there is one, else `lambda` everywhere.
    pub(crate) fn new(lambda: f32, map: Option<&'a LambdaMap>) -> Self {
        map.map_or(Self::Constant(lambda), Self::Map)
    }
}

impl From<f32> for Dial<'static> {
    fn from(lambda: f32) -> Self {
        Self::Constant(lambda)
    }
}

impl<'a> From<&'a LambdaMap> for Dial<'a> {
    fn from(map: &'a LambdaMap) -> Self {
        Self::Map(map)
    }
}

/// λ of a frame that waits for its turn.
#[derive(Clone, Debug)]
pub enum OwnedDial {
    /// As [`Dial::Constant`].
    Constant(f32),
    /// As [`Dial::Map`].
    Map(LambdaMap),
}

impl OwnedDial {
    /// As the engine takes it.
    pub fn borrowed(&self) -> Dial<'_> {
        match self {
            Self::Constant(lambda) => Dial::Constant(*lambda),
            Self::Map(map) => Dial::Map(map),
        }
    }
}

impl From<f32> for OwnedDial {
    fn from(lambda: f32) -> Self {
        Self::Constant(lambda)
    }
}

impl From<LambdaMap> for OwnedDial {
    fn from(map: LambdaMap) -> Self {
        Self::Map(map)
    }
}

/// λ for each pixel of a frame.
///
/// The network computes at half and quarter resolution, where it takes the mean of log₂ λ over the pixels. A map that has one
/// value everywhere gives what the constant gives, bit for bit.
#[derive(Clone, Debug)]
pub struct LambdaMap {
    size: (usize, usize),
    /// log₂ λ over log₂ 64, 0…1, at half resolution, padded as the frame is.
    codes: Array2<f32>,
    /// λ where it is the same everywhere.
    constant: Option<f32>,
    /// How many of the values that it was made from were no λ: NaN, less than 1 or more than 64.
    changed: usize,
}

impl LambdaMap {
    /// λ (rows, columns) as it is: less than 1 counts as 1, more than 64 as 64, NaN as `otherwise`.
    ///
    /// ```
    /// # use hush::{Engine, Frame, LambdaMap, Settings};
    /// # use ndarray::{Array2, Array3};
    /// // Grain is kept in the right half.
    /// let lambda = Array2::from_shape_fn((16, 16), |(_, x)| if x < 8 { 1.0 } else { 16.0 });
    /// let engine = Engine::new(Settings::default())?;
    /// let frame = engine.encode(Frame::new(Array3::from_elem((16, 16, 3), 0.5)))?;
    /// engine.denoise(&frame, &[], &LambdaMap::new(lambda.view(), 1.0)?)?;
    /// # Ok::<(), hush::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::BadSetting`] where `otherwise` is less than 1 or NaN.
    pub fn new(lambda: ArrayView2<f32>, otherwise: f32) -> Result<Self> {
        let otherwise = in_range(otherwise)?;
        let bounded = |v: f32| if v.is_nan() { otherwise } else { v.clamp(LAMBDA_RANGE.0, LAMBDA_RANGE.1) };
        let constant = uniform(lambda.iter().map(|v| bounded(*v)));
        let changed = lambda.iter().filter(|v| bounded(**v) != **v).count();
        Ok(Self { size: lambda.dim(), codes: halved(lambda, |v| code(bounded(v))), constant, changed })
    }

    /// Of a frame's mask and λ of what it marks, where there are both: [`LambdaMask::mix`].
    pub(crate) fn of_mask(mask: Option<&LambdaMask>, lambda: f32, masked: Option<f32>) -> Result<Option<Self>> {
        mask.zip(masked).map(|(mask, masked)| mask.mix(lambda, masked)).transpose()
    }

    /// Rows and columns of the frame.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// λ where it is the same everywhere.
    pub fn constant(&self) -> Option<f32> {
        self.constant
    }

    /// What is odd about the values that it was made from, if anything.
    pub fn note(&self) -> Option<String> {
        let (least, most) = LAMBDA_RANGE;
        (self.changed > 0).then(|| format!("holds values outside {least}…{most} or NaN, in {}", counted(self.changed, "pixel")))
    }

    /// log₂ λ over log₂ 64 at half resolution.
    pub(crate) fn codes(&self) -> ArrayView2<'_, f32> {
        self.codes.view()
    }
}

/// Which pixels of a frame have another λ, 0…1, at half resolution.
///
/// Between 0 and 1, where a filter mixed what is inside the mask and what is outside, log₂ λ is mixed alike.
#[derive(Clone, Debug)]
pub struct LambdaMask {
    size: (usize, usize),
    shares: Array2<f32>,
    /// The value where it is the same everywhere.
    constant: Option<f32>,
    not_numbers: usize,
    /// The least and the greatest value, where they lie outside 0…1.
    beyond: Option<(f32, f32)>,
}

impl LambdaMask {
    /// A mask (rows, columns): less than 0 and NaN count as 0, more than 1 as 1.
    pub fn new(mask: ArrayView2<f32>) -> Self {
        let bounded = |v: f32| if v.is_nan() { 0.0 } else { v.clamp(0.0, 1.0) };
        let (mut least, mut greatest, mut not_numbers) = (0.0f32, 1.0f32, 0);
        for v in mask {
            (least, greatest) = (least.min(*v), greatest.max(*v));
            not_numbers += usize::from(v.is_nan());
        }
        let constant = uniform(mask.iter().map(|v| bounded(*v)));
        let beyond = (least < -ROUNDING || greatest > 1.0 + ROUNDING).then_some((least, greatest));
        Self { size: mask.dim(), shares: halved(mask, bounded), constant, not_numbers, beyond }
    }

    /// `lambda` where the mask is 0, `masked` where it is 1.
    ///
    /// # Errors
    /// [`Error::BadSetting`] where one is less than 1 or NaN; greater than 64 is clamped.
    pub fn mix(&self, lambda: f32, masked: f32) -> Result<LambdaMap> {
        let (lambda, masked) = (in_range(lambda)?, in_range(masked)?);
        let (low, high) = (code(lambda), code(masked));
        let constant = match self.constant {
            _ if lambda == masked => Some(lambda),
            Some(0.0) => Some(lambda),
            Some(1.0) => Some(masked),
            _ => None,
        };
        Ok(LambdaMap { size: self.size, codes: self.shares.mapv(|share| low + share * (high - low)), constant, changed: 0 })
    }

    /// What is odd about its values, if anything.
    pub fn note(&self) -> Option<String> {
        let nan =
            (self.not_numbers > 0).then(|| format!("is no number in {}, which counts as 0", counted(self.not_numbers, "pixel")));
        let beyond = self.beyond.map(|(least, greatest)| {
            let value = if greatest > 1.0 + ROUNDING { greatest } else { least };
            format!("holds values outside 0 to 1, such as {value}, which are clamped: 0 means lambda, 1 lambda masked")
        });
        match (nan, beyond) {
            (Some(nan), Some(beyond)) => Some(format!("{nan}, and {beyond}")),
            (nan, beyond) => nan.or(beyond),
        }
    }

    /// Bytes that it holds.
    pub(super) fn bytes(&self) -> usize {
        self.shares.len() * size_of::<f32>()
    }
}

/// A λ of at most 64; an error below 1.
pub(crate) fn in_range(lambda: f32) -> Result<f32> {
    let (least, most) = LAMBDA_RANGE;
    match lambda >= least {
        true => Ok(lambda.min(most)),
        false => Err(Error::BadSetting { name: "lambda", reason: format!("{lambda} is not in {least}…{most}") }),
    }
}

/// A λ of 1…64 as the network takes it, 0…1.
pub(crate) fn code(lambda: f32) -> f32 {
    lambda.log2() / LAMBDA_RANGE.1.log2()
}

/// The value that all have, if they have one.
fn uniform(mut values: impl Iterator<Item = f32>) -> Option<f32> {
    let first = values.next()?;
    values.all(|v| v == first).then_some(first)
}

/// The mean of each 2×2 pixels, of a frame padded by repeating its border.
fn halved(image: ArrayView2<f32>, value: impl Fn(f32) -> f32) -> Array2<f32> {
    let (rows, columns) = image.dim();
    let size = (rows.next_multiple_of(ALIGNMENT) / 2, columns.next_multiple_of(ALIGNMENT) / 2);
    let at = |y: usize, x: usize| value(image[[y.min(rows - 1), x.min(columns - 1)]]);
    let mean = |(y, x)| ((at(2 * y, 2 * x) + at(2 * y, 2 * x + 1)) + (at(2 * y + 1, 2 * x) + at(2 * y + 1, 2 * x + 1))) * 0.25;
    Array2::from_shape_fn(size, mean)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_values_become_sound_ones() {
        let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -3.0, 0.0, 0.5, 1.0, 8.0, 64.0, 1e30];
        for v in values {
            let map = LambdaMap::new(Array2::from_elem((3, 5), v).view(), 4.0).unwrap();
            assert_eq!((map.size(), map.codes().dim()), ((3, 5), (4, 4)));
            let expected = if v.is_nan() { 4.0 } else { v.clamp(1.0, 64.0) };
            assert_eq!(map.constant(), Some(expected), "{v}");
            assert!(map.codes().iter().all(|c| *c == expected.log2() / 6.0), "{v}");
            assert_eq!(map.note().is_some(), v != expected, "{v}");
        }
        for bad in [f32::NAN, 0.5, -1.0] {
            assert!(LambdaMap::new(Array2::zeros((1, 1)).view(), bad).is_err());
            assert!(LambdaMask::new(Array2::zeros((1, 1)).view()).mix(bad, 4.0).is_err());
            assert!(LambdaMask::new(Array2::zeros((1, 1)).view()).mix(4.0, bad).is_err());
        }
    }

    #[test]
    fn a_mask_mixes_logarithms() {
        // A column of each: outside, half, inside, and beyond it.
        let mask = Array2::from_shape_fn((8, 8), |(_, x)| [0.0, 0.5, 1.0, 7.0][x / 2]);
        let map = LambdaMask::new(mask.view()).mix(1.0, 64.0).unwrap();
        assert_eq!(map.constant(), None);
        assert_eq!(map.codes().row(0).to_vec(), [0.0, 0.5, 1.0, 1.0]);
        let edge = Array2::from_shape_fn((8, 8), |(_, x)| f32::from(x > 2));
        assert_eq!(LambdaMask::new(edge.view()).mix(1.0, 64.0).unwrap().codes().row(3).to_vec(), [0.0, 0.5, 1.0, 1.0]);
        let values = LambdaMap::new(edge.mapv(|m| 64f32.powf(m)).view(), 1.0).unwrap();
        assert_eq!(values.codes().row(3).to_vec(), [0.0, 0.5, 1.0, 1.0]);
    }

    #[test]
    fn a_mask_that_is_the_same_everywhere_is_a_constant() {
        let constant = |value: f32| LambdaMask::new(Array2::from_elem((4, 4), value).view()).mix(3.0, 24.0).unwrap().constant();
        assert_eq!(
            [0.0, 1.0, f32::NAN, -1.0, f32::INFINITY, 0.5].map(constant),
            [Some(3.0), Some(24.0), Some(3.0), Some(3.0), Some(24.0), None]
        );
        let mixed = Array2::from_shape_fn((4, 4), |(y, _)| y as f32 / 3.0);
        assert_eq!(LambdaMask::new(mixed.view()).mix(7.0, 7.0).unwrap().constant(), Some(7.0));
    }

    #[test]
    fn what_is_odd_is_told() {
        let note =
            |values: &[f32]| LambdaMask::new(Array2::from_shape_vec((1, values.len()), values.to_vec()).unwrap().view()).note();
        assert_eq!(note(&[0.0, 0.3, 1.0005]), None);
        assert!(note(&[0.0, f32::NAN]).unwrap().contains("no number in 1 pixel"));
        assert!(note(&[0.0, 16.0]).unwrap().contains("such as 16"));
        let both = note(&[f32::NAN, f32::NAN, f32::NEG_INFINITY]).unwrap();
        assert!(both.contains("2 pixels") && both.contains("such as -inf"), "{both}");
    }
}
