//! From the kernels' interleaved result to an image, its alpha and its light passes.

use ndarray::{Array2, Array3, Axis, s};
use rayon::prelude::*;

use super::Denoised;
use crate::frame::Aov;
use crate::frame::packed::{MODULATION, PackedFrame};
use crate::kernels::Channels;

/// Cuts the padding off and tells the channels apart; `alpha`: whether the frame has one, and whether it is among the values.
pub(super) fn unpack(image: Array3<f32>, size: (usize, usize), alpha: (bool, bool), aov_names: &[String]) -> Denoised {
    let ones = (alpha.0 && !alpha.1).then(|| Array2::ones(size));
    if image.dim() == (size.0, size.1, 3) {
        return Denoised { colour: image, alpha: ones, aovs: Vec::new() };
    }
    let image = image.slice(s![..size.0, ..size.1, ..]);
    let found = alpha.1.then(|| image.slice(s![.., .., 3]).mapv(|a| a.clamp(0.0, 1.0))).or(ones);
    let first = 3 + usize::from(alpha.1);
    let aov = |(i, name): (usize, &String)| Aov {
        name: name.clone(),
        image: image.slice(s![.., .., first + 3 * i..first + 3 * i + 3]).to_owned(),
    };
    let aovs = aov_names.iter().enumerate().map(aov).collect();
    Denoised { colour: image.slice(s![.., .., ..3]).to_owned(), alpha: found, aovs }
}

/// The frame's own pixels in the layout of the result, (rows, columns, values), padding included.
pub(super) fn own_pixels(packed: &PackedFrame, channels: &Channels) -> Array3<f32> {
    let sources: Vec<_> = (0..channels.values).map(|c| (channels.source(c), channels.modulated_by(c))).collect();
    let mut out = Array3::zeros((packed.padded_rows, packed.padded_columns, channels.values));
    out.axis_iter_mut(Axis(0)).into_par_iter().enumerate().for_each(|(y, mut row)| {
        for x in 0..packed.padded_columns {
            let pixel = y * packed.padded_columns + x;
            for (c, ((group, lane), modulation)) in sources.iter().enumerate() {
                let value = packed.groups[*group][pixel][*lane];
                row[[x, c]] = modulation.map_or(value, |m| value * packed.groups[0][pixel][MODULATION + m]);
            }
        }
    });
    out
}
