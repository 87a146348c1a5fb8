//! The output file part by part: what is copied byte for byte, what is encoded anew.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use exr::meta::header::{Header, standard_names};
use half::f16;
use half::slice::HalfFloatSliceExt;
use ndarray::{CowArray, Ix2, s};
use rayon::prelude::*;

use super::codec;
use super::container::{Prologue, RawAttribute, RawChannel};
use super::exr_file::{Chunk, ExrFile, parse_headers};
use super::layout::{Layout, SampleType, ViewLayer};
use super::names;
use super::read::{batch_length, channel_offsets};
use super::recombine::ChannelPlace;
use super::resolved::Resolved;
use super::selection::NOISY;
use crate::error::{Error, Result};

/// Attributes that describe one part.
const PART_OWN: [&[u8]; 10] = [
    b"channels",
    b"chunkCount",
    b"colorInteropID",
    b"compression",
    b"dataWindow",
    b"lineOrder",
    b"name",
    b"tiles",
    b"type",
    b"view",
];
/// Largest finite half.
const HALF_MAX: f32 = 65504.0;

/// Planes (rows, columns) that replace channels of the source.
pub(crate) type Edits<'a> = HashMap<ChannelPlace, CowArray<'a, f32, Ix2>>;

/// Where an output channel's samples come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ChannelSamples {
    /// A channel of the source part, bit for bit.
    Copy(usize),
    /// The edit at this place.
    Edit(ChannelPlace),
}

struct PartDraft {
    /// The part of the source whose chunks these are.
    source: usize,
    /// Not there in the source.
    added: bool,
    channels: Vec<(RawChannel, ChannelSamples)>,
}

/// The output's header, and for each of its parts where the channels come from.
pub(crate) struct OutputParts {
    prologue: Prologue,
    parts: Vec<PartDraft>,
    /// Of each part of the source.
    chunk_counts: Vec<usize>,
    channel_counts: Vec<usize>,
}

/// The output ready to be written.
pub(crate) struct OutputFile {
    prologue: Vec<u8>,
    multipart: bool,
    parts: Vec<OutputPart>,
}

struct OutputPart {
    source: usize,
    added: bool,
    header: Header,
    /// None: the chunks are copied byte for byte.
    samples: Option<Vec<ChannelSamples>>,
}

impl OutputParts {
    /// The source as it is, with `edits` in it.
    pub fn new(source: &ExrFile, edits: &Edits) -> Self {
        let part = |(part, header): (usize, &super::container::RawHeader)| {
            let samples = |index: usize| match edits.contains_key(&(part, index)) {
                true => ChannelSamples::Edit((part, index)),
                false => ChannelSamples::Copy(index),
            };
            let channels = header.channels().unwrap_or_default();
            PartDraft {
                source: part,
                added: false,
                channels: channels.into_iter().enumerate().map(|(i, c)| (c, samples(i))).collect(),
            }
        };
        let parts = source.prologue.headers.iter().enumerate().map(part).collect();
        let chunk_counts = source.headers.iter().map(|h| h.chunk_count).collect();
        let channel_counts = source.headers.iter().map(|h| h.channels.list.len()).collect();
        Self { prologue: source.prologue.clone(), parts, chunk_counts, channel_counts }
    }

    /// Adds the noisy input as a pass, in the file's own style: a part, or channels in the only part.
    pub fn keep_noisy(&mut self, layout: &Layout, resolved: &Resolved) -> Result<()> {
        let there = layout.layer(&resolved.layer).is_some_and(|l| l.pass(NOISY, resolved.view.as_deref()).is_some());
        let Some(part) = resolved.colour.channels.first().map(|c| c.part).filter(|_| !there) else { return Ok(()) };
        let Some(place) = layout.part_list.get(part) else { return Ok(()) };
        // Blender 5 names the only part of a one-pass file after the pass, and then sees that pass alone: it wants a second part.
        let own_part = layout.multipart || place.name.as_ref().is_some_and(|n| !n.is_empty());
        // A part with a view of its own needs none in the names of its channels.
        let view = resolved.view.as_deref().filter(|&view| place.view.as_deref() != Some(view));
        let noisy_name = |component| names::join(&resolved.layer, NOISY, view, component);
        let kept = resolved.colour.channels.iter().chain(&resolved.alpha);
        let mut added = Vec::new();
        for channel in kept.filter(|c| c.part == part) {
            let Some((raw, _)) = self.parts[part].channels.get(channel.index) else { continue };
            let name = noisy_name(&channel.component);
            if name.len() > 255 {
                return Err(Error::bad_file(&layout.path, "has layer names too long for adding the pass Noisy Image"));
            }
            added.push((RawChannel { name: name.into_bytes(), ..raw.clone() }, ChannelSamples::Copy(channel.index)));
        }
        if !own_part {
            self.parts[part].channels.extend(added);
            return Ok(());
        }
        self.prologue.make_multipart(&self.chunk_counts);
        let mut header = self.prologue.headers[part].clone();
        let mut name = noisy_name("");
        if let Some(view) = &place.view {
            name.push_str(&format!("-{view}"));
        }
        header.set("name", "string", name.into_bytes());
        // Texts that not all parts have are the file's, and said once: manifests are long.
        let everywhere = |name: &[u8]| self.prologue.headers.iter().all(|h| h.attributes.iter().any(|a| a.name == name));
        header.attributes.retain(|a| a.kind != b"string" || PART_OWN.contains(&a.name.as_slice()) || everywhere(&a.name));
        self.prologue.headers.push(header);
        self.parts.push(PartDraft { source: part, added: true, channels: added });
        Ok(())
    }

    /// Leaves a layer out. Metadata that only its parts have goes to the first of the others.
    pub fn leave_out(&mut self, layer: &ViewLayer) {
        let channels = || layer.passes.iter().flat_map(|p| &p.channels);
        for (index, part) in self.parts.iter_mut().enumerate().filter(|(_, part)| !part.added) {
            part.channels.retain(|(raw, _)| !channels().any(|c| c.part == index && c.name.as_bytes() == raw.name));
        }
        let headers = std::mem::take(&mut self.prologue.headers);
        let parts = std::mem::take(&mut self.parts).into_iter().zip(headers);
        let (kept, empty): (Vec<_>, Vec<_>) = parts.partition(|(part, _)| !part.channels.is_empty());
        (self.parts, self.prologue.headers) = kept.into_iter().unzip();
        self.give_to_first(empty.into_iter().flat_map(|(_, header)| header.attributes));
    }

    /// Adds what the first part lacks of another one's metadata: there Blender writes the metadata of a file, and looks for it.
    fn give_to_first(&mut self, attributes: impl IntoIterator<Item = RawAttribute>) {
        let Some(first) = self.prologue.headers.first_mut() else { return };
        for attribute in attributes {
            if !PART_OWN.contains(&attribute.name.as_slice()) && !first.attributes.iter().any(|a| a.name == attribute.name) {
                first.attributes.push(attribute);
            }
        }
    }

    /// Puts the parts that hold nothing but this layer behind all others. The part that comes first then has the metadata too.
    pub fn put_last(&mut self, layer: &ViewLayer) {
        let channels = || layer.passes.iter().flat_map(|p| &p.channels);
        let within = |part: &PartDraft| {
            part.channels.iter().all(|(raw, _)| channels().any(|c| c.part == part.source && c.name.as_bytes() == raw.name))
        };
        let headers = std::mem::take(&mut self.prologue.headers);
        let metadata = headers.first().map(|first| first.attributes.clone()).unwrap_or_default();
        let parts = std::mem::take(&mut self.parts).into_iter().zip(headers);
        let (last, first): (Vec<_>, Vec<_>) = parts.partition(|(part, _)| within(part));
        (self.parts, self.prologue.headers) = first.into_iter().chain(last).unzip();
        self.give_to_first(metadata);
    }

    /// Adds a text attribute to every part, or replaces it.
    pub fn set_attribute(&mut self, name: &str, value: &str) -> Result<()> {
        let reserved = standard_names::ALL.contains(&name.as_bytes());
        let taken =
            |h: &super::container::RawHeader| h.attributes.iter().any(|a| a.name == name.as_bytes() && a.kind != b"string");
        if reserved || name.is_empty() || name.len() > 255 || name.contains('\0') || self.prologue.headers.iter().any(taken) {
            return Err(Error::BadSetting {
                name: "attributes",
                reason: format!("{name:?} cannot be used as an attribute's name"),
            });
        }
        for header in &mut self.prologue.headers {
            header.set(name, "string", value.as_bytes().to_vec());
        }
        Ok(())
    }

    /// Sorts the channels as the format demands and finds the parts that can be copied byte for byte.
    pub fn finish(mut self) -> Result<OutputFile, String> {
        for (part, header) in self.parts.iter_mut().zip(&mut self.prologue.headers) {
            part.channels.sort_by(|a, b| a.0.name.cmp(&b.0.name));
            header.set_channels(part.channels.iter().map(|(raw, _)| raw.clone()).collect());
        }
        let prologue = self.prologue.to_bytes();
        let headers = parse_headers(&prologue)?;
        let parts = self.parts.iter().zip(headers).map(|(part, header)| {
            let samples: Vec<ChannelSamples> = part.channels.iter().map(|(_, samples)| *samples).collect();
            let same = self.channel_counts.get(part.source) == Some(&samples.len())
                && samples.iter().enumerate().all(|(i, from)| *from == ChannelSamples::Copy(i));
            OutputPart { source: part.source, added: part.added, header, samples: (!same).then_some(samples) }
        });
        Ok(OutputFile { multipart: self.prologue.is_multipart(), parts: parts.collect(), prologue })
    }
}

impl OutputFile {
    /// Writes the file: header, chunk tables, then the chunks in the source's order, those of added parts last.
    pub fn write(
        &self,
        path: &Path,
        source: &mut ExrFile,
        edits: &Edits,
        file: &mut BufWriter<File>,
        destination: &Path,
    ) -> Result<()> {
        let failed = |e: std::io::Error| Error::io(destination, e);
        let source_tables = source.tables()?;
        let mut tables: Vec<Vec<u64>> = self.parts.iter().map(|p| vec![0; source_tables[p.source].len()]).collect();
        let table_bytes = |tables: &[Vec<u64>]| tables.iter().flatten().flat_map(|at| at.to_le_bytes()).collect::<Vec<u8>>();
        file.write_all(&self.prologue).map_err(failed)?;
        file.write_all(&table_bytes(&tables)).map_err(failed)?;
        let mut position = (self.prologue.len() + tables.iter().map(Vec::len).sum::<usize>() * 8) as u64;

        let mut order: Vec<(bool, u64, usize, usize)> = Vec::new();
        for (part, out) in self.parts.iter().enumerate() {
            order.extend(source_tables[out.source].iter().enumerate().map(|(index, &at)| (out.added, at, part, index)));
        }
        order.sort_unstable();
        for batch in order.chunks(batch_length()) {
            let mut chunks = Vec::with_capacity(batch.len());
            for &(_, at, part, index) in batch {
                chunks.push((part, index, source.chunk(self.parts[part].source, index, at)?));
            }
            let headers = &source.headers;
            let encoded: Vec<(usize, usize, Chunk)> = chunks
                .into_par_iter()
                .map(|(part, index, chunk)| Ok((part, index, self.parts[part].encode(headers, edits, chunk)?)))
                .collect::<Result<_, String>>()
                .map_err(|reason| Error::bad_file(path, reason))?;
            for (part, index, chunk) in encoded {
                tables[part][index] = position;
                let mut bytes = Vec::with_capacity(chunk.data.len() + 24);
                if self.multipart {
                    bytes.extend((part as i32).to_le_bytes());
                }
                bytes.extend(&chunk.location);
                bytes.extend((chunk.data.len() as i32).to_le_bytes());
                bytes.extend(&chunk.data);
                file.write_all(&bytes).map_err(failed)?;
                position += bytes.len() as u64;
            }
        }
        file.seek(SeekFrom::Start(self.prologue.len() as u64)).map_err(failed)?;
        file.write_all(&table_bytes(&tables)).map_err(failed)
    }
}

impl OutputPart {
    /// A chunk of the source as a chunk of this part.
    fn encode(&self, sources: &[Header], edits: &Edits, mut chunk: Chunk) -> Result<Chunk, String> {
        let Some(samples) = &self.samples else { return Ok(chunk) };
        let from = &sources[self.source];
        let (from_offsets, from_bytes) = channel_offsets(from);
        let (_, to_bytes) = channel_offsets(&self.header);
        let (width, height) = (chunk.bounds.size.0, chunk.bounds.size.1);
        let (x, y) = (chunk.bounds.position.0 as usize, chunk.bounds.position.1 as usize);
        let needs_source = samples.iter().any(|o| matches!(o, ChannelSamples::Copy(_)));
        let data = std::mem::take(&mut chunk.data);
        let rows = if needs_source { codec::decode(from, chunk.bounds, data)? } else { Vec::new() };
        let mut out = Vec::with_capacity(to_bytes * width * height);
        for row in 0..height {
            for (origin, channel) in samples.iter().zip(&self.header.channels.list) {
                let sample = SampleType::from(channel.sample_type);
                match origin {
                    ChannelSamples::Copy(index) => {
                        let start = (row * from_bytes + from_offsets[*index]) * width;
                        out.extend_from_slice(&rows[start..start + width * sample.bytes()]);
                    }
                    ChannelSamples::Edit(place) => {
                        let plane = edits.get(place).ok_or("lost a denoised channel")?;
                        let line: Vec<f32> = plane.slice(s![y + row, x..x + width]).to_vec();
                        append(&mut out, &line, sample);
                    }
                }
            }
        }
        chunk.data = codec::encode(&self.header, chunk.bounds, out)?;
        Ok(chunk)
    }
}

/// Appends samples in native byte order, clamped to what the type can hold.
fn append(out: &mut Vec<u8>, line: &[f32], sample: SampleType) {
    match sample {
        SampleType::Half => {
            let clamped: Vec<f32> = line.iter().map(|v| v.clamp(-HALF_MAX, HALF_MAX)).collect();
            let mut halves = vec![f16::ZERO; line.len()];
            halves.convert_from_f32_slice(&clamped);
            out.extend(halves.iter().flat_map(|h| h.to_ne_bytes()));
        }
        SampleType::Float => out.extend(line.iter().flat_map(|v| v.to_ne_bytes())),
        SampleType::Uint => out.extend(line.iter().flat_map(|v| (v.round() as u32).to_ne_bytes())),
    }
}
