//! A frame as the engine works on it: sanitised, demodulated, padded, interleaved eight floats a pixel.
//!
//! A warp then reads one cache-line half per corner, whatever it samples.

use std::sync::Arc;

use ndarray::{ArrayView2, ArrayView3};
use rayon::prelude::*;

use super::FrameView;
use super::exposure::exposure;
use super::lambda_map::LambdaMask;
use super::pixels::{ALIGNMENT, Pixels};
use super::sanitise::{MAX_RADIANCE, bounded, front, radiance};
use crate::error::Result;
use crate::memory::BufferPool;

/// Lane of the first demodulated colour channel.
pub const COLOUR: usize = 0;
/// Lane of the first modulation channel: the albedo plus ε.
pub const MODULATION: usize = 3;
/// Lane of the depth over the frame's mean depth.
pub const DEPTH: usize = 6;
/// Lane that is 1 where the pixel must not be used: not finite, or padding.
pub const INVALID: usize = 7;

/// One sanitised frame. Pixels are row-major over the padded size; the padding repeats the border and is invalid.
pub struct PackedFrame {
    /// The frame's own size.
    pub rows: usize,
    pub columns: usize,
    /// The size rounded up to [`ALIGNMENT`].
    pub padded_rows: usize,
    pub padded_columns: usize,
    /// The scale that brings the frame to the network's brightness.
    pub exposure: f32,
    /// Group 0 has the lanes above; the others hold eight extra channels each (alpha, then AOVs), zero beyond [`Self::extra`].
    pub groups: Vec<Arc<Pixels<8>>>,
    /// Extra channels.
    pub extra: usize,
    /// Whether extra channel 0 is alpha.
    pub has_alpha: bool,
    /// Whether the colour is divided by an albedo.
    pub has_albedo: bool,
    /// Names of the AOVs, three extra channels each.
    pub aov_names: Vec<String>,
    /// Vector pass X, Y, Z, W; the second pass keeps it longer than the frame.
    pub vectors: Option<Arc<Pixels<4>>>,
    /// Which pixels have another λ.
    pub lambda_mask: Option<LambdaMask>,
}

/// The guides as the encoder sees them, at the frame's own size.
pub struct GuideViews<'a> {
    pub albedo: Option<ArrayView3<'a, f32>>,
    pub normal: Option<ArrayView3<'a, f32>>,
}

/// What the values of a frame are brought to the network's range by; they depend on all of its pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scales {
    /// Brings the log-average luminance to 0.18.
    pub exposure: f32,
    /// One over the mean depth; 0 without depth.
    pub depth: f32,
}

impl Scales {
    /// Those of a whole frame.
    pub fn of(frame: &FrameView) -> Self {
        let depth = frame.depth.as_ref().map_or(0.0, |d| depth_scale(*d, frame.colour));
        Self { exposure: exposure(frame.colour), depth }
    }
}

impl PackedFrame {
    /// Packs a frame for a network that adds `epsilon` to the albedo, in memory from `pool`. Errors when passes differ in size.
    pub fn new(frame: &FrameView, epsilon: f32, pool: &BufferPool) -> Result<Self> {
        frame.check()?;
        Self::scaled(frame, epsilon, Scales::of(frame), pool)
    }

    /// As [`new`](Self::new), with the scales of the frame that this one is a part of.
    pub fn scaled(frame: &FrameView, epsilon: f32, scales: Scales, pool: &BufferPool) -> Result<Self> {
        frame.check()?;
        let (rows, columns) = frame.size();
        let (padded_rows, padded_columns) = (rows.next_multiple_of(ALIGNMENT), columns.next_multiple_of(ALIGNMENT));
        let has_alpha = frame.alpha.is_some();
        let extra = usize::from(has_alpha) + 3 * frame.aovs.len();
        let mut groups: Vec<Pixels<8>> =
            (0..1 + extra.div_ceil(8)).map(|_| Pixels::unspecified(padded_rows * padded_columns, pool)).collect();
        groups[1..].iter_mut().for_each(|group| group.fill([0.0; 8]));
        let (first, more) = groups.split_at_mut(1);
        let (colour, alpha) = (frame.colour, frame.alpha);
        first[0].par_chunks_mut(padded_columns).enumerate().for_each(|(y, row)| {
            let inside_row = y < rows;
            let y = y.min(rows - 1);
            for (x, lanes) in row.iter_mut().enumerate() {
                let inside = inside_row && x < columns;
                let x = x.min(columns - 1);
                let finite = (0..3).all(|c| colour[[y, x, c]].is_finite()) && alpha.is_none_or(|a| a[[y, x]].is_finite());
                for c in 0..3 {
                    let modulation = frame.albedo.as_ref().map_or(1.0, |a| bounded(a[[y, x, c]], 0.0) + epsilon);
                    lanes[MODULATION + c] = modulation;
                    lanes[COLOUR + c] = if finite { radiance(colour[[y, x, c]]) / modulation } else { 0.0 };
                }
                lanes[DEPTH] = frame.depth.as_ref().map_or(0.0, |d| front(d[[y, x]]) * scales.depth);
                lanes[INVALID] = if inside && finite { 0.0 } else { 1.0 };
            }
        });
        for (channel, image) in extra_channels(frame).into_iter().enumerate() {
            let lane = channel % 8;
            let base = &first[0];
            more[channel / 8].par_chunks_mut(padded_columns).enumerate().for_each(|(y, row)| {
                let y = y.min(rows - 1);
                for (x, lanes) in row.iter_mut().enumerate() {
                    let x = x.min(columns - 1);
                    lanes[lane] = match image.1 {
                        // A pixel whose alpha is not finite is not used.
                        None => bounded(image.0[[y, x]], 0.0),
                        Some(c) => {
                            let value = finite_at(image.0, y, x).clamp(-MAX_RADIANCE, MAX_RADIANCE);
                            value / base[y * padded_columns + x][MODULATION + c]
                        }
                    };
                }
            });
        }
        let vectors = frame.vector.as_ref().map(|v| Arc::new(pack_vectors(*v, padded_rows, padded_columns, pool)));
        let exposure = scales.exposure;
        let aov_names = frame.aovs.iter().map(|(name, _)| name.to_string()).collect();
        let lambda_mask = frame.lambda_mask.map(LambdaMask::new);
        Ok(Self {
            rows,
            columns,
            padded_rows,
            padded_columns,
            exposure,
            groups: groups.into_iter().map(Arc::new).collect(),
            extra,
            has_alpha,
            has_albedo: frame.albedo.is_some(),
            aov_names,
            vectors,
            lambda_mask,
        })
    }

    /// The same frame with an alpha of 1 all over, where it came without one; what does not change is shared.
    pub fn with_opaque_alpha(&self, pool: &BufferPool) -> Self {
        let lane_of = |channel: usize| (1 + channel / 8, channel % 8);
        let extra = self.extra + 1;
        let group = |group: usize| {
            let mut pixels: Pixels<8> = Pixels::unspecified(self.padded_rows * self.padded_columns, pool);
            let from: [Option<(usize, usize)>; 8] =
                std::array::from_fn(|lane| (8 * group + lane).checked_sub(1).filter(|c| *c < self.extra).map(lane_of));
            pixels.par_iter_mut().enumerate().for_each(|(i, to)| {
                *to = from.map(|from| from.map_or(0.0, |(group, lane)| self.groups[group][i][lane]));
                if group == 0 {
                    to[0] = 1.0;
                }
            });
            Arc::new(pixels)
        };
        Self {
            groups: std::iter::once(self.groups[0].clone()).chain((0..extra.div_ceil(8)).map(group)).collect(),
            extra,
            has_alpha: true,
            aov_names: self.aov_names.clone(),
            vectors: self.vectors.clone(),
            lambda_mask: self.lambda_mask.clone(),
            ..*self
        }
    }

    /// Bytes that this frame holds.
    pub fn bytes(&self) -> usize {
        let pixels = self.padded_rows * self.padded_columns;
        let mask = self.lambda_mask.as_ref().map_or(0, LambdaMask::bytes);
        pixels * (32 * self.groups.len() + if self.vectors.is_some() { 16 } else { 0 }) + mask
    }
}

/// Extra channels in order, with the modulation channel that demodulates them (none for alpha).
fn extra_channels<'a>(frame: &FrameView<'a>) -> Vec<(ArrayView2<'a, f32>, Option<usize>)> {
    let alpha = frame.alpha.iter().map(|a| (*a, None));
    let aovs = frame.aovs.iter().flat_map(|(_, image)| (0..3).map(move |c| (image.slice_move(ndarray::s![.., .., c]), Some(c))));
    alpha.chain(aovs).collect()
}

/// A pixel's value, or the mean of the finite ones in the 5×5 pixels around it: one bad pixel of a light pass shall not make the beauty's
/// unusable. 0 where there are none.
fn finite_at(image: ArrayView2<f32>, y: usize, x: usize) -> f32 {
    let value = image[[y, x]];
    if value.is_finite() {
        return value;
    }
    let (rows, columns) = image.dim();
    let near = |at: usize, most: usize| at.saturating_sub(2)..(at + 3).min(most);
    let around = image.slice(ndarray::s![near(y, rows), near(x, columns)]);
    let (sum, count) = around.iter().filter(|v| v.is_finite()).fold((0.0, 0u32), |(s, n), v| (s + f64::from(*v), n + 1));
    if count == 0 { 0.0 } else { (sum / f64::from(count)) as f32 }
}

fn pack_vectors(v: ArrayView3<f32>, padded_rows: usize, padded_columns: usize, pool: &BufferPool) -> Pixels<4> {
    let (rows, columns, _) = v.dim();
    let mut out = Pixels::unspecified(padded_rows * padded_columns, pool);
    out.par_chunks_mut(padded_columns).enumerate().for_each(|(y, row)| {
        for (x, to) in row.iter_mut().enumerate() {
            *to = std::array::from_fn(|c| v[[y.min(rows - 1), x.min(columns - 1), c]]);
        }
    });
    out
}

/// One over the mean of the depths in front of the background, where the colour is finite; 1 where there are none.
fn depth_scale(depth: ArrayView2<f32>, colour: ArrayView3<f32>) -> f32 {
    let finite = colour.lanes(ndarray::Axis(2));
    let usable = ndarray::Zip::from(depth)
        .and(finite)
        .par_map_collect(|z, c| if c.iter().all(|v| v.is_finite()) { front(*z) } else { 0.0 });
    let (sum, count) = usable.iter().filter(|z| **z > 0.0).fold((0.0f64, 0u64), |(s, n), z| (s + f64::from(*z), n + 1));
    if count == 0 { 1.0 } else { (count as f64 / sum) as f32 }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array3};

    use super::*;
    use crate::frame::Frame;

    #[test]
    fn bad_pixels_are_marked_and_do_not_spread() {
        let mut colour = Array3::from_elem((3, 5, 3), 0.5);
        colour[[1, 2, 0]] = f32::NAN;
        colour[[2, 4, 1]] = f32::INFINITY;
        colour[[0, 0, 2]] = -7.0;
        let packed = PackedFrame::new(&Frame::new(colour).view(), 0.05, &BufferPool::default()).unwrap();
        assert_eq!((packed.padded_rows, packed.padded_columns), (8, 8));
        let invalid: usize = packed.groups[0].iter().map(|p| p[INVALID] as usize).sum();
        assert_eq!(invalid, 64 - 15 + 2);
        assert_eq!(packed.groups[0][0][COLOUR + 2], 0.0);
        assert!(packed.groups[0].iter().flatten().all(|v| v.is_finite()));
    }

    #[test]
    fn bad_alpha_spoils_its_pixel_and_a_bad_light_pass_is_filled_in() {
        let mut alpha = Array2::from_elem((8, 8), 1.0);
        alpha[[2, 3]] = f32::NAN;
        let mut light = Array3::from_shape_fn((8, 8, 3), |(_, x, _)| x as f32);
        light[[4, 4, 1]] = f32::INFINITY;
        let mut frame = Frame { alpha: Some(alpha), ..Frame::new(Array3::from_elem((8, 8, 3), 0.5)) };
        frame.aovs = vec![crate::frame::Aov { name: "Light".into(), image: light }];
        let packed = PackedFrame::new(&frame.view(), 0.05, &BufferPool::default()).unwrap();
        let invalid: Vec<usize> = (0..64).filter(|i| packed.groups[0][*i][INVALID] > 0.0).collect();
        assert_eq!(invalid, [2 * 8 + 3]);
        // Alpha is the first of the extra channels; the pixels around have a mean of 4 as the pixel itself would.
        assert_eq!(packed.groups[1][4 * 8 + 4][1..4], [4.0, 4.0, 4.0]);
    }

    #[test]
    fn a_sky_keeps_its_albedo_and_has_no_depth() {
        // What was rendered of it: 0 until Blender 5.1, the greatest float over the samples since, 1e10 in the Depth pass.
        for depth in [0.0, f32::MAX, f32::MAX / 4096.0, 1e10] {
            let mut frame = Frame::new(Array3::from_elem((8, 8, 3), 2.0));
            frame.albedo = Some(Array3::from_shape_fn((8, 8, 3), |(_, _, c)| [0.25, 1.0, 2.0][c]));
            frame.depth = Some(Array2::from_shape_fn((8, 8), |(y, _)| if y < 4 { depth } else { 5.0 }));
            let packed = PackedFrame::new(&frame.view(), 0.25, &BufferPool::default()).unwrap();
            let (sky, ground) = (packed.groups[0][0], packed.groups[0][63]);
            assert_eq!(sky[MODULATION..DEPTH], [0.5, 1.25, 1.25]);
            assert_eq!((sky[DEPTH], ground[DEPTH]), (0.0, 1.0), "{depth}");
        }
    }

    #[test]
    fn every_lane_is_finite_whatever_the_depth() {
        for (near, far) in [(1e-40, 1e-40), (1e-38, 1e8), (1e-19, 9.9e8), (f32::NAN, f32::INFINITY), (-1.0, 1e10)] {
            let mut frame = Frame::new(Array3::from_elem((9, 9, 3), 0.5));
            frame.depth = Some(Array2::from_shape_fn((9, 9), |(_, x)| if x == 4 { far } else { near }));
            // Depths at bad colours do not count towards the mean, but are there.
            frame.colour.slice_mut(ndarray::s![.., 4, ..]).fill(f32::NAN);
            let packed = PackedFrame::new(&frame.view(), 0.05, &BufferPool::default()).unwrap();
            assert!(packed.groups[0].iter().flatten().all(|v| v.is_finite()), "{near} and {far}");
        }
    }
}
