//! Keys: what a tap's logit may depend on besides the pixel that it helps (`key_of` in `training/network/model.py`).

use super::Channels;
use super::planes::RowMut;
use crate::simd::Isa;
use crate::simd::math::ln_1p_all;

/// The brightest that the network and the keys tell apart, after exposure (`BRIGHTEST` in `training/data/geometry.py`).
pub const MAX_EXPOSED: f32 = 1e4;

/// Fills a row's key from its colours: ln(1 + the mean of the demodulated colour, exposed as the centre frame is), one plane for each
/// of `phases`.
pub fn fill(isa: Isa, row: &mut RowMut, channels: &Channels, phases: usize, exposure: f32) {
    let mut key = vec![0.0f32; row.plane(0).len()];
    for phase in 0..phases {
        key.fill(0.0);
        for channel in 0..3 {
            key.iter_mut().zip(row.plane(channel * phases + phase)).for_each(|(sum, value)| *sum += *value);
        }
        key.iter_mut().for_each(|key| *key = (*key * (exposure / 3.0)).min(MAX_EXPOSED));
        ln_1p_all(isa, &mut key);
        row.plane(channels.key() * phases + phase).copy_from_slice(&key);
    }
}
