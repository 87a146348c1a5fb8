//! Uniform 2×2 down-sampling over the usable pixels, and nearest up-sampling (Vogels et al. 2018, section 5.2).

use rayon::prelude::*;

use super::planes::Planes;
use super::{Channels, FULL_PHASES, keys};
use crate::simd::Isa;

/// Full-resolution planes (four phases a channel) to half resolution; a pixel is usable where any of its four is. `exposure` is the
/// centre frame's, for the keys.
pub fn down_from_full(isa: Isa, full: &Planes, channels: &Channels, margin: usize, exposure: f32) -> Planes {
    let mut out = full.same_pool(channels.coarse(), full.rows(), full.columns(), margin);
    out.rows_mut().enumerate().for_each(|(y, mut row)| {
        let phase = |channel: usize, p: usize| full.row(channel * FULL_PHASES + p, y);
        let four = |channel: usize| [phase(channel, 0), phase(channel, 1), phase(channel, 2), phase(channel, 3)];
        let masks = four(channels.mask());
        let columns = full.columns();
        for channel in channels.averaged() {
            let ([a, b, c, d], [ma, mb, mc, md]) = (four(channel), masks);
            let to = &mut row.plane(channel)[..columns];
            for x in 0..columns {
                let sum = a[x] * ma[x] + b[x] * mb[x] + c[x] * mc[x] + d[x] * md[x];
                to[x] = sum / (ma[x] + mb[x] + mc[x] + md[x]).max(1.0);
            }
        }
        let to = row.plane(channels.mask());
        for (x, to) in to.iter_mut().enumerate() {
            *to = masks[0][x].max(masks[1][x]).max(masks[2][x]).max(masks[3][x]);
        }
        keys::fill(isa, &mut row, channels, 1, exposure);
    });
    out
}

/// Half-resolution planes to quarter resolution.
pub fn down(isa: Isa, half: &Planes, channels: &Channels, margin: usize, exposure: f32) -> Planes {
    let (rows, columns) = (half.rows() / 2, half.columns() / 2);
    let mut out = half.same_pool(channels.coarse(), rows, columns, margin);
    out.rows_mut().enumerate().for_each(|(y, mut row)| {
        let mask = [half.row(channels.mask(), 2 * y), half.row(channels.mask(), 2 * y + 1)];
        let four = |rows: [&[f32]; 2], x: usize| [rows[0][2 * x], rows[0][2 * x + 1], rows[1][2 * x], rows[1][2 * x + 1]];
        for channel in channels.averaged() {
            let from = [half.row(channel, 2 * y), half.row(channel, 2 * y + 1)];
            for (x, to) in row.plane(channel).iter_mut().enumerate() {
                let (v, m) = (four(from, x), four(mask, x));
                let sum: f32 = v.iter().zip(m).map(|(v, m)| v * m).sum();
                *to = sum / m.iter().sum::<f32>().max(1.0);
            }
        }
        for (x, to) in row.plane(channels.mask()).iter_mut().enumerate() {
            *to = four(mask, x).into_iter().fold(0.0, f32::max);
        }
        keys::fill(isa, &mut row, channels, 1, exposure);
    });
    out
}

/// Each pixel of `coarse` four times: planes of twice the size.
pub fn up(coarse: &Planes, margin: usize) -> Planes {
    let mut out = coarse.same_pool(coarse.planes(), 2 * coarse.rows(), 2 * coarse.columns(), margin);
    out.rows_mut().enumerate().for_each(|(y, mut row)| {
        for plane in 0..coarse.planes() {
            let from = coarse.row(plane, y / 2);
            row.plane(plane).iter_mut().enumerate().for_each(|(x, to)| *to = from[x / 2]);
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn down_sampling_averages_what_is_usable() {
        let channels = Channels::new(0, false);
        let mut half = Planes::new(channels.coarse(), 4, 4, 0, &crate::memory::BufferPool::default());
        half.rows_mut().enumerate().for_each(|(y, mut row)| {
            for x in 0..4 {
                row.plane(0)[x] = (4 * y + x) as f32;
                row.plane(3)[x] = if (y < 2 && x < 2 && (y, x) != (0, 0)) || x == 3 { 0.0 } else { 1.0 };
            }
        });
        let out = down(Isa::detect(), &half, &channels, 1, 3.0);
        assert_eq!(out.row(0, 0), [0.0, 4.0]);
        assert_eq!(out.row(3, 0), [1.0, 1.0]);
        assert_eq!(out.row(0, 1), [(8 + 9 + 12 + 13) as f32 / 4.0, 12.0]);
        assert!((out.row(channels.key(), 0)[1] - 5f32.ln()).abs() < 1e-6, "{:?}", out.row(channels.key(), 0));
        let wide = up(&out, 0);
        assert_eq!(wide.row(0, 1), [0.0, 0.0, 4.0, 4.0]);
    }
}
