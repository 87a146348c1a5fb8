//! Neighbouring frames seen from the centre frame: chained motion vectors, trust, warped pixels (`training/data/geometry.py`).

use rayon::prelude::*;

use super::motion::{AGREEMENT_LIMIT, Motion, Place};
use crate::frame::packed::{DEPTH, INVALID, MODULATION, PackedFrame};
use crate::kernels::keys;
use crate::kernels::planes::Planes;
use crate::kernels::{Channels, FULL_PHASES};
use crate::layers::Activation;
use crate::memory::BufferPool;
use crate::simd::Isa;
use crate::simd::math::ln_1p_each;
use crate::simd::{Simd, dispatch};
use crate::tiles::Rect;

/// Maps that tell the network how far to trust a neighbour: trust, albedo 3, depth, agreement of vectors, distance in time.
pub const EXTRAS: usize = 7;

/// What the network gets of one neighbour over a region.
pub struct Warped {
    /// Where each half-resolution pixel samples the neighbour's features.
    pub corners: Vec<Corners>,
    /// EXTRAS channels at half resolution.
    pub extras: Activation,
    /// Whether nothing moves, so that pixels are copied instead of sampled.
    pub still: bool,
    /// Whether any pixel may be used.
    pub trusted: bool,
}

/// Frames from the centre to the neighbour, one step of motion each.
struct Path<'a> {
    frames: &'a [&'a PackedFrame],
    motion: Motion<'a>,
    columns: usize,
    rows: usize,
    still: bool,
    groups: usize,
}

impl<'a> Path<'a> {
    fn new(frames: &'a [&'a PackedFrame], (offset, still): (i32, bool), groups: usize) -> Self {
        let (rows, columns) = (frames[0].padded_rows, frames[0].padded_columns);
        let vectors = frames.iter().map(|frame| frame.vectors.as_deref()).collect();
        Self { frames, motion: Motion { vectors, later: offset > 0, rows, columns }, columns, rows, still, groups }
    }
}

/// The four pixels around a position, clamped to the image: the first, then its right, lower and lower right neighbour.
#[derive(Clone, Copy)]
pub struct Corners {
    /// Of the first, in pixels, row-major.
    pub index: usize,
    /// How far towards the right and the lower neighbour.
    pub fraction: [f32; 2],
}

impl Corners {
    /// Around (column, row) in an image of `rows` × `columns`, at least two each.
    #[inline(always)]
    pub fn new(column: f32, row: f32, rows: usize, columns: usize) -> Self {
        let x = column.clamp(0.0, (columns - 1) as f32);
        let y = row.clamp(0.0, (rows - 1) as f32);
        let (x0, y0) = ((x as usize).min(columns - 2), (y as usize).min(rows - 2));
        Self { index: y0 * columns + x0, fraction: [x - x0 as f32, y - y0 as f32] }
    }

    /// Their weights.
    #[inline(always)]
    pub fn weights([fx, fy]: [f32; 2]) -> [f32; 4] {
        [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy]
    }

    #[inline(always)]
    fn sample(&self, image: &[[f32; 8]], columns: usize, out: &mut [f32; 8]) {
        let weights = Self::weights(self.fraction);
        let (upper, lower) = (&image[self.index..][..2], &image[self.index + columns..][..2]);
        for c in 0..8 {
            out[c] = weights[0] * upper[0][c] + weights[1] * upper[1][c] + weights[2] * lower[0][c] + weights[3] * lower[1][c];
        }
    }
}

/// Half-resolution columns whose pixels go to all planes before the next are read: they stay in L1.
const BLOCK: usize = 64;

/// Warps the last frame of `frames` (centre first, one a step) to the centre frame over `region`. `offset` is the neighbour's;
/// `still` says that all their vectors are zero. Memory comes from `pool`.
///
/// The planes are at full resolution, four phases a channel: values, trust, keys, modulation (see [`Channels`]).
pub fn warp(
    isa: Isa,
    frames: &[&PackedFrame],
    (offset, still): (i32, bool),
    region: Rect,
    channels: &Channels,
    margin: usize,
    pool: &BufferPool,
) -> (Planes, Warped) {
    let groups = channels.groups();
    let path = Path::new(frames, (offset, still), groups);
    let mut planes = Planes::new(channels.full() * FULL_PHASES, region.rows, region.columns, margin, pool);
    let mut corners = vec![Corners { index: 0, fraction: [0.0; 2] }; region.area()];
    let mut extras = Activation::in_pool(pool);
    extras.reset(region.rows, region.columns, EXTRAS);
    let distance = offset.unsigned_abs() as f32 / 2.0;
    let rows_of_corners = corners.par_chunks_mut(region.columns);
    let maps = extras.as_mut_slice().par_chunks_mut(region.columns * EXTRAS);
    planes.rows_mut().zip(rows_of_corners).zip(maps).enumerate().for_each(|(y, ((mut row, corners), extras))| {
        let mut pixels = vec![[0.0; 8]; 2 * region.columns * groups];
        let mut maps = vec![[0.0; EXTRAS]; 2 * region.columns];
        extras.fill(0.0);
        for dy in 0..2 {
            warp_row(isa, &path, region, 2 * (region.row + y) + dy, &mut pixels, &mut maps, corners);
            for (x, from) in maps.iter().enumerate() {
                let to = &mut extras[x / 2 * EXTRAS..][..EXTRAS];
                to.iter_mut().zip(from).for_each(|(to, from)| *to += 0.25 * from);
            }
            for x in (0..region.columns).step_by(BLOCK) {
                let end = (x + BLOCK).min(region.columns);
                for channel in channels.packed() {
                    let (group, lane) = channels.source(channel);
                    for dx in 0..2 {
                        let to = &mut row.plane(channel * FULL_PHASES + 2 * dy + dx)[x..end];
                        if channel == channels.mask() {
                            to.iter_mut().zip(maps[2 * x + dx..].iter().step_by(2)).for_each(|(to, m)| *to = m[0]);
                        } else {
                            let from = pixels[group * 2 * region.columns + 2 * x + dx..].iter().step_by(2);
                            to.iter_mut().zip(from).for_each(|(to, p)| *to = p[lane]);
                        }
                    }
                }
            }
        }
        extras.chunks_exact_mut(EXTRAS).for_each(|e| e[EXTRAS - 1] = distance);
        keys::fill(isa, &mut row, channels, FULL_PHASES, frames[0].exposure);
    });
    let trusted = extras.as_slice().par_chunks(EXTRAS).any(|e| e[0] > 0.0);
    (planes, Warped { corners, extras, still, trusted })
}

/// Whether any pixel of the centre frame may use the last of `frames`; arguments as for [`warp`].
pub fn any_trusted(frames: &[&PackedFrame], (offset, still): (i32, bool)) -> bool {
    let (rows, columns) = (frames[0].padded_rows, frames[0].padded_columns);
    let path = Path::new(frames, (offset, still), 1);
    let pixels = &frames[frames.len() - 1].groups[0];
    let is_trusted = |y: usize, x: usize| {
        if still {
            return pixels[y * columns + x][INVALID] == 0.0;
        }
        let (place, mut sampled) = (path.motion.place(y, x), [0.0; 8]);
        Corners::new(place.column, place.row, rows, columns).sample(pixels, columns, &mut sampled);
        place.trusted && sampled[INVALID] == 0.0
    };
    (0..rows).into_par_iter().any(|y| (0..columns).any(|x| is_trusted(y, x)))
}

/// One full-resolution row: warped pixels of every group, the maps, and (from even rows) where the features are sampled.
#[inline(always)]
fn warp_row_body<S: Simd>(
    s: S,
    path: &Path,
    region: Rect,
    y: usize,
    pixels: &mut [[f32; 8]],
    maps: &mut [[f32; EXTRAS]],
    half_corners: &mut [Corners],
) {
    let neighbour = path.frames[path.frames.len() - 1];
    let width = 2 * region.columns;
    let here = &path.frames[0].groups[0][y * path.columns + 2 * region.column..][..width];
    let mut depths = vec![0.0; 2 * width];
    for (i, map) in maps.iter_mut().enumerate() {
        let x = 2 * region.column + i;
        let place = if path.still { Place::of(y, x) } else { path.motion.place(y, x) };
        let corners = Corners::new(place.column, place.row, path.rows, path.columns);
        let sampled = &mut pixels[i];
        if path.still {
            *sampled = neighbour.groups[0][y * path.columns + x];
        } else {
            corners.sample(&neighbour.groups[0], path.columns, sampled);
        }
        let trust = if place.trusted && sampled[INVALID] == 0.0 { 1.0 } else { 0.0 };
        sampled.iter_mut().for_each(|v| *v *= trust);
        depths[i] = sampled[DEPTH];
        depths[width + i] = here[i][DEPTH];
        *map = [trust, 0.0, 0.0, 0.0, 0.0, place.miss / AGREEMENT_LIMIT * trust, 0.0];
        for c in 0..3 {
            map[1 + c] = (sampled[MODULATION + c] - here[i][MODULATION + c]).abs() * trust;
        }
        for (group, image) in neighbour.groups.iter().enumerate().take(path.groups).skip(1) {
            let more = &mut pixels[group * width + i];
            if path.still {
                *more = image[y * path.columns + x];
            } else {
                corners.sample(image, path.columns, more);
            }
            more.iter_mut().for_each(|v| *v *= trust);
        }
        if y.is_multiple_of(2) && i.is_multiple_of(2) {
            let column = (region.column + i / 2) as f32 + (place.column - x as f32) * 0.5;
            let row = (y / 2) as f32 + (place.row - y as f32) * 0.5;
            half_corners[i / 2] = Corners::new(column, row, path.rows / 2, path.columns / 2);
        }
    }
    ln_1p_each(s, &mut depths);
    for (i, map) in maps.iter_mut().enumerate() {
        map[4] = (depths[i] - depths[width + i]).abs().min(1.0) * map[0];
    }
}

dispatch! {
    fn warp_row(path: &Path<'_>, region: Rect, y: usize, pixels: &mut [[f32; 8]], maps: &mut [[f32; EXTRAS]], half_corners: &mut [Corners]) = warp_row_body
}

/// The centre frame's own planes over a region, in the layout of [`warp`]'s planes and memory from `pool`.
pub fn centre_planes(
    isa: Isa,
    frame: &PackedFrame,
    region: Rect,
    channels: &Channels,
    margin: usize,
    pool: &BufferPool,
) -> Planes {
    let mut planes = Planes::new(channels.full() * FULL_PHASES, region.rows, region.columns, margin, pool);
    planes.rows_mut().enumerate().for_each(|(y, mut row)| {
        for x in (0..region.columns).step_by(BLOCK) {
            let end = (x + BLOCK).min(region.columns);
            for channel in channels.packed() {
                let (group, lane) = channels.source(channel);
                let mask = channel == channels.mask();
                for phase in 0..FULL_PHASES {
                    let row_start = (2 * (region.row + y) + phase / 2) * frame.padded_columns;
                    let from = frame.groups[group][row_start + 2 * (region.column + x) + phase % 2..].iter().step_by(2);
                    let to = &mut row.plane(channel * FULL_PHASES + phase)[x..end];
                    to.iter_mut().zip(from).for_each(|(to, p)| *to = if mask { 1.0 - p[INVALID] } else { p[lane] });
                }
            }
        }
        keys::fill(isa, &mut row, channels, FULL_PHASES, frame.exposure);
    });
    planes
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::frame::Frame;

    #[test]
    fn a_point_is_looked_for_where_its_vectors_say() {
        let (rows, columns) = (24, 32);
        let pool = BufferPool::default();
        let pack = |colour: Array3<f32>, vector: [f32; 4]| {
            let mut frame = Frame::new(colour);
            frame.vector = Some(Array3::from_shape_fn((rows, columns, 4), |(_, _, c)| vector[c]));
            PackedFrame::new(&frame.view(), 0.05, &pool).unwrap()
        };
        let ramp = Array3::from_shape_fn((rows, columns, 3), |(y, x, c)| [1.0 + x as f32, 1.0 + y as f32, 1.0][c]);
        let (region, channels) = (Rect { row: 0, column: 0, rows: rows / 2, columns: columns / 2 }, Channels::new(0, false));
        for (offset, vector, (dx, dy)) in [
            (-1, [5.0, 7.0, 100.0, 100.0], (5i32, -7i32)),
            (-1, [-6.0, -4.0, 100.0, 100.0], (-6, 4)),
            (1, [100.0, 100.0, 5.0, 7.0], (-5, 7)),
            (1, [100.0, 100.0, -6.0, -4.0], (6, -4)),
        ] {
            let (centre, neighbour) = (pack(Array3::ones((rows, columns, 3)), vector), pack(ramp.clone(), [0.0; 4]));
            let (planes, warped) = warp(Isa::detect(), &[&centre, &neighbour], (offset, false), region, &channels, 1, &pool);
            assert!(warped.trusted && !warped.still);
            let mut seen = 0;
            for (y, x) in (0..rows as i32).flat_map(|y| (0..columns as i32).map(move |x| (y, x))) {
                let at = |channel: usize| {
                    let phase = (y % 2 * 2 + x % 2) as usize;
                    planes.row(channel * FULL_PHASES + phase, y as usize / 2)[x as usize / 2]
                };
                let (px, py) = (x + dx, y + dy);
                let inside = (0..columns as i32).contains(&px) && (0..rows as i32).contains(&py);
                let expected = if inside { [1.0 + px as f32, 1.0 + py as f32, 1.0] } else { [0.0; 3] };
                assert_eq!([at(0), at(1), at(channels.mask())], expected, "{offset}: at {x}, {y}");
                seen += usize::from(inside);
            }
            assert!(seen > 200, "{seen}");
        }
    }
}
