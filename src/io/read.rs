//! Decoding a frame: only the parts that hold a needed pass are touched.

use std::path::Path;

use half::f16;
use half::slice::HalfFloatSliceExt;
use ndarray::{Array2, Array3, Axis, Zip};
use rayon::prelude::*;

use super::background;
use super::codec;
use super::exr_file::{Chunk, ExrFile};
use super::layout::{Channel, Layout, SampleType};
use super::names::DENOISING_DEPTH;
use super::resolved::{PassRef, Resolved};
use crate::error::{Error, Result};
use crate::frame::{Aov, Frame};

/// Reads the passes of `resolved`. `alpha` is None where the file has none or it is 1 everywhere; light passes come as
/// contributions to the beauty, multiplied by their Color pass. The background has depth 0 or more than 1e9, whatever the Blender.
///
/// # Errors
/// [`Error::BadFile`] if the file is cut short, damaged, or has changed since its layout was read.
pub fn read_frame(layout: &Layout, resolved: &Resolved) -> Result<Frame> {
    let mut source = open_again(layout)?;
    let r = resolved;
    let optional = |pass: &Option<PassRef>| pass.as_ref().map(|p| p.channels.clone()).unwrap_or_default();
    let mut wanted = vec![
        r.colour.channels.clone(),
        r.alpha.iter().cloned().collect(),
        optional(&r.albedo),
        optional(&r.normal),
        optional(&r.depth),
        optional(&r.vector),
        optional(&r.lambda_mask),
    ];
    for aov in &r.aovs {
        wanted.push(aov.pass.channels.clone());
        wanted.push(optional(&aov.colour));
    }
    let mut images = read_images(&layout.path, &mut source, &wanted, (r.rows, r.columns))?.into_iter();
    let mut next = || images.next().flatten();
    let colour = next().ok_or_else(|| Error::bad_file(&layout.path, "has no colour"))?;
    let plane = |image: Array3<f32>| image.index_axis_move(Axis(2), 0);
    let alpha = next().map(plane).filter(|alpha| alpha.iter().any(|&a| a != 1.0));
    let (albedo, normal, mut depth, vector) = (next(), next(), next().map(plane), next());
    if let (Some(depth), Some(normal), Some(pass)) = (&mut depth, &normal, &r.depth)
        && pass.pass == DENOISING_DEPTH
        && background::ends_at_clipping_plane(layout)
    {
        background::take_out(depth, normal);
    }
    let lambda_mask = next().map(plane);
    let mut aovs = Vec::new();
    for aov in &r.aovs {
        let (pass, colour) = (next(), next());
        let Some(mut image) = pass else { continue };
        if let Some(colour) = colour {
            Zip::from(&mut image).and(&colour).for_each(|light, &c| *light *= c);
        }
        aovs.push(Aov { name: aov.name.clone(), image });
    }
    Ok(Frame { colour, alpha, albedo, normal, depth, vector, aovs, lambda_mask })
}

/// Opens a file whose layout is known, and makes sure that it is still the same file.
pub(crate) fn open_again(layout: &Layout) -> Result<ExrFile> {
    let source = ExrFile::open(&layout.path)?;
    match super::layout::describe(&layout.path, &source) == *layout {
        true => Ok(source),
        false => Err(Error::bad_file(&layout.path, "changed while it was being read")),
    }
}

/// Reads planes, one a channel.
pub(crate) fn read_planes(
    path: &Path,
    source: &mut ExrFile,
    channels: &[Channel],
    size: (usize, usize),
) -> Result<Vec<Array2<f32>>> {
    let wanted: Vec<Vec<Channel>> = channels.iter().map(|c| vec![c.clone()]).collect();
    let images = read_images(path, source, &wanted, size)?;
    Ok(images.into_iter().flatten().map(|image| image.index_axis_move(Axis(2), 0)).collect())
}

/// Reads images of (rows, columns, channels), one for each non-empty list of channels; each part is decoded once.
fn read_images(
    path: &Path,
    source: &mut ExrFile,
    wanted: &[Vec<Channel>],
    size: (usize, usize),
) -> Result<Vec<Option<Array3<f32>>>> {
    let tables = source.tables()?;
    wanted.iter().flatten().try_for_each(|channel| check_channel(path, source, channel))?;
    let mut parts: Vec<usize> = wanted.iter().flatten().map(|c| c.part).collect();
    parts.sort_unstable();
    parts.dedup();
    let sound = |part: &usize| source.headers.get(*part).is_some_and(|h| (h.layer_size.1, h.layer_size.0) == size);
    if !parts.iter().all(sound) {
        return Err(Error::bad_file(path, "has passes of different sizes"));
    }
    let mut images: Vec<Option<Array3<f32>>> =
        wanted.iter().map(|channels| (!channels.is_empty()).then(|| Array3::zeros((size.0, size.1, channels.len())))).collect();
    for part in parts {
        let header = source.headers[part].clone();
        let mut order: Vec<(u64, usize)> = tables[part].iter().enumerate().map(|(index, &at)| (at, index)).collect();
        order.sort_unstable();
        for batch in order.chunks(batch_length()) {
            let chunks: Vec<Chunk> = batch.iter().map(|&(at, index)| source.chunk(part, index, at)).collect::<Result<_>>()?;
            let decoded: Vec<(Chunk, Vec<u8>)> = chunks
                .into_par_iter()
                .map(|mut chunk| {
                    let rows = codec::decode(&header, chunk.bounds, std::mem::take(&mut chunk.data))?;
                    Ok((chunk, rows))
                })
                .collect::<Result<_, String>>()
                .map_err(|reason| Error::bad_file(path, reason))?;
            images.par_iter_mut().zip(wanted).for_each(|(image, channels)| {
                let Some(image) = image.as_mut().and_then(|i| i.as_slice_mut()) else { return };
                for (chunk, rows) in &decoded {
                    scatter(image, size.1, channels, part, &header, chunk, rows);
                }
            });
        }
    }
    Ok(images)
}

/// Makes sure that a channel is where its layout says.
pub(crate) fn check_channel(path: &Path, source: &ExrFile, channel: &Channel) -> Result<()> {
    let there = source.headers.get(channel.part).and_then(|h| h.channels.list.get(channel.index));
    match there.is_some_and(|c| c.name.bytes() == channel.name.as_bytes() && SampleType::from(c.sample_type) == channel.sample) {
        true => Ok(()),
        false => {
            Err(Error::bad_file(path, format!("has no channel {} where it was expected: resolve each file anew", channel.name)))
        }
    }
}

/// Chunks that are held at a time: enough to keep every thread busy, few enough to bound the memory.
pub(crate) fn batch_length() -> usize {
    4 * rayon::current_num_threads()
}

/// Byte offset of each channel in a row of a chunk that is one pixel wide, and the bytes of all of them.
pub(crate) fn channel_offsets(header: &exr::meta::header::Header) -> (Vec<usize>, usize) {
    let mut offset = 0;
    let offsets = header.channels.list.iter().map(|c| {
        let at = offset;
        offset += SampleType::from(c.sample_type).bytes();
        at
    });
    (offsets.collect(), offset)
}

fn scatter(
    image: &mut [f32],
    columns: usize,
    channels: &[Channel],
    part: usize,
    header: &exr::meta::header::Header,
    chunk: &Chunk,
    rows: &[u8],
) {
    let (offsets, pixel_bytes) = channel_offsets(header);
    let (width, height) = (chunk.bounds.size.0, chunk.bounds.size.1);
    let (x, y) = (chunk.bounds.position.0 as usize, chunk.bounds.position.1 as usize);
    let mut line = vec![0.0; width];
    for (k, channel) in channels.iter().enumerate().filter(|(_, c)| c.part == part) {
        for row in 0..height {
            let from = (row * pixel_bytes + offsets[channel.index]) * width;
            to_floats(&rows[from..from + width * channel.sample.bytes()], channel.sample, &mut line);
            let to = ((y + row) * columns + x) * channels.len() + k;
            for (pixel, &value) in image[to..].iter_mut().step_by(channels.len()).zip(&line) {
                *pixel = value;
            }
        }
    }
}

/// Converts native-endian samples.
fn to_floats(bytes: &[u8], sample: SampleType, floats: &mut [f32]) {
    match sample {
        SampleType::Half => {
            let halves: Vec<f16> = bytes.chunks_exact(2).map(|b| f16::from_ne_bytes([b[0], b[1]])).collect();
            halves.convert_to_f32_slice(floats);
        }
        SampleType::Float => {
            for (f, b) in floats.iter_mut().zip(bytes.chunks_exact(4)) {
                *f = f32::from_ne_bytes([b[0], b[1], b[2], b[3]]);
            }
        }
        SampleType::Uint => {
            for (f, b) in floats.iter_mut().zip(bytes.chunks_exact(4)) {
                *f = u32::from_ne_bytes([b[0], b[1], b[2], b[3]]) as f32;
            }
        }
    }
}
