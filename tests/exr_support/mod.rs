//! EXR files for tests, written and read back with the `exr` crate's block interface, bit for bit.
#![allow(dead_code)]

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};

use exr::block::UncompressedBlock;
use exr::block::reader::ChunksReader;
use exr::block::writer::ChunksWriter;
use exr::prelude::{Compression, IntegerBounds, LineOrder, SampleType, Text, Vec2, f16};

pub mod halved;

/// The test image's columns and rows: odd, and more rows than a chunk of any codec but DWAB has.
pub const SIZE: (usize, usize) = (37, 70);

pub struct Channel {
    pub name: String,
    pub sample: SampleType,
    /// One sample a pixel; half-floats in the low 16 bits.
    pub bits: Vec<u32>,
}

#[derive(Clone, Copy)]
pub struct Style {
    pub compression: Compression,
    pub line_order: LineOrder,
    pub tiles: Option<usize>,
    pub origin: (i32, i32),
    pub size: (usize, usize),
}

impl Style {
    pub fn new(compression: Compression) -> Self {
        Self { compression, line_order: LineOrder::Increasing, tiles: None, origin: (0, 0), size: SIZE }
    }
}

#[derive(Default)]
pub struct Part {
    pub name: Option<String>,
    pub view: Option<String>,
    pub multi_view: Vec<String>,
    pub attributes: Vec<(String, String)>,
    pub channels: Vec<Channel>,
}

/// Numbers in 0…1 that repeat for a seed.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        self.0 >> 33
    }

    pub fn float(&mut self) -> f32 {
        (self.next() & 0xffff) as f32 / 65535.0
    }
}

pub fn bits(sample: SampleType, value: f32) -> u32 {
    match sample {
        SampleType::F16 => f16::from_f32(value).to_bits().into(),
        SampleType::F32 => value.to_bits(),
        SampleType::U32 => value as u32,
    }
}

pub fn float(sample: SampleType, bits: u32) -> f32 {
    match sample {
        SampleType::F16 => f16::from_bits(bits as u16).to_f32(),
        SampleType::F32 => f32::from_bits(bits),
        SampleType::U32 => bits as f32,
    }
}

/// A pass of smooth noise: `prefix.R`, … for the letters of `components`.
pub fn pass(prefix: &str, components: &str, sample: SampleType, size: (usize, usize), seed: u64) -> Vec<Channel> {
    let mut random = Random(seed);
    let channel = |letter: char| {
        let name = if prefix.is_empty() { letter.to_string() } else { format!("{prefix}.{letter}") };
        let value = |i: usize| 0.5 + 0.3 * ((i % size.0) as f32 * 0.2).sin() + 0.1 * random.float();
        let bits = (0..size.0 * size.1).map(value).map(|v| bits(sample, v)).collect();
        Channel { name, sample, bits }
    };
    components.chars().map(channel).collect()
}

/// A Cryptomatte pass: every bit pattern may occur, signalling NaNs and infinities among them.
pub fn cryptomatte(prefix: &str, size: (usize, usize), seed: u64) -> Vec<Channel> {
    let mut channels = pass(prefix, "rgba", SampleType::F32, size, seed);
    let mut random = Random(seed);
    for channel in &mut channels {
        for (i, bits) in channel.bits.iter_mut().enumerate() {
            *bits = match i % 5 {
                0 => 0x7f80_0001 | (random.next() as u32 & 0x003f_ffff),
                1 => 0xffc0_0000 | (random.next() as u32 & 0x003f_ffff),
                _ => random.next() as u32,
            };
        }
    }
    channels
}

/// Writes parts; one part gives a single-part file.
pub fn write(path: &Path, parts: Vec<Part>, style: Style) {
    use exr::math::RoundingMode;
    use exr::meta::BlockDescription;
    use exr::meta::attribute::{ChannelDescription, LevelMode, TileDescription};
    let mut parts = parts;
    let headers = parts.iter_mut().map(|part| {
        part.channels.sort_by(|a, b| a.name.cmp(&b.name));
        let channel = |c: &Channel| ChannelDescription::new(c.name.as_str(), c.sample, true);
        let list = part.channels.iter().map(channel).collect();
        let tile = |side| TileDescription {
            tile_size: Vec2(side, side),
            level_mode: LevelMode::Singular,
            rounding_mode: RoundingMode::Down,
        };
        let blocks = style.tiles.map_or(BlockDescription::ScanLines, |side| BlockDescription::Tiles(tile(side)));
        let mut header = exr::meta::header::Header::new(Text::from(part.name.as_deref().unwrap_or("")), style.size, list)
            .with_encoding(style.compression, blocks, style.line_order)
            .with_position(Vec2(style.origin.0, style.origin.1))
            .with_display_window(IntegerBounds::new((0, 0), (1920, 1080)));
        let own = &mut header.own_attributes;
        own.layer_name = part.name.as_deref().map(Text::from);
        own.view_name = part.view.as_deref().map(Text::from);
        if !part.multi_view.is_empty() {
            own.multi_view_names = Some(part.multi_view.iter().map(|v| Text::from(v.as_str())).collect());
        }
        for (name, value) in &part.attributes {
            own.other.insert(Text::from(name.as_str()), exr::meta::attribute::AttributeValue::Text(Text::from(value.as_str())));
        }
        header
    });
    let headers = headers.collect();
    let file = BufWriter::new(File::create(path).unwrap());
    exr::block::write(file, headers, false, |meta, writer| {
        let blocks: Vec<_> = meta
            .enumerate_ordered_header_block_indices()
            .map(|(index, block)| {
                let channels = &parts[block.layer].channels;
                let list = &meta.headers[block.layer].channels;
                let uncompressed = UncompressedBlock::from_lines(list, block, |line| {
                    let at = line.location;
                    let start = at.position.1 * style.size.0 + at.position.0;
                    let bits = &channels[at.channel].bits[start..start + at.sample_count];
                    for (to, bits) in line.value.chunks_exact_mut(list.list[at.channel].sample_type.bytes_per_sample()).zip(bits)
                    {
                        to.copy_from_slice(&bits.to_le_bytes()[..to.len()]);
                    }
                });
                (index, uncompressed)
            })
            .collect();
        let mut compressor = writer.sequential_blocks_compressor(&meta);
        for (index, block) in blocks {
            compressor.compress_block(index, block)?;
        }
        Ok(())
    })
    .unwrap();
}

/// Every channel of a file, by view and name: sample type and bits.
pub type Pixels = BTreeMap<(String, String), (SampleType, Vec<u32>)>;

pub fn read(path: &Path) -> (exr::meta::MetaData, Pixels) {
    let reader = exr::block::read(BufReader::new(File::open(path).unwrap()), false).unwrap();
    let meta = reader.meta_data().clone();
    let mut planes: Vec<Vec<Vec<u32>>> =
        meta.headers.iter().map(|h| vec![vec![0; h.layer_size.area()]; h.channels.list.len()]).collect();
    let chunks = reader.all_chunks(false).unwrap();
    chunks
        .decompress_sequential(false, |meta, block| {
            let header = &meta.headers[block.index.layer];
            for line in block.lines(&header.channels) {
                let at = line.location;
                let bytes = header.channels.list[at.channel].sample_type.bytes_per_sample();
                let start = at.position.1 * header.layer_size.0 + at.position.0;
                for (i, b) in line.value.chunks_exact(bytes).enumerate() {
                    let mut four = [0; 4];
                    four[..bytes].copy_from_slice(b);
                    planes[at.layer][at.channel][start + i] = u32::from_le_bytes(four);
                }
            }
            Ok(())
        })
        .unwrap();
    let mut pixels = Pixels::new();
    for (header, planes) in meta.headers.iter().zip(planes) {
        let view = header.own_attributes.view_name.as_ref().map(|v| v.to_string()).unwrap_or_default();
        for (channel, bits) in header.channels.list.iter().zip(planes) {
            let old = pixels.insert((view.clone(), channel.name.to_string()), (channel.sample_type, bits));
            assert!(old.is_none(), "{} twice", channel.name);
        }
    }
    (meta, pixels)
}

/// A render like Blender's: beauty, guides, Cryptomatte, metadata.
pub fn render(sample: SampleType, multipart: bool, size: (usize, usize)) -> Vec<Part> {
    let passes = vec![
        ("Combined", pass("ViewLayer.Combined", "RGBA", sample, size, 1)),
        ("Denoising Albedo", pass("ViewLayer.Denoising Albedo", "RGB", sample, size, 2)),
        ("Denoising Normal", pass("ViewLayer.Denoising Normal", "XYZ", SampleType::F32, size, 3)),
        ("Denoising Depth", pass("ViewLayer.Denoising Depth", "Z", SampleType::F32, size, 4)),
        ("Vector", pass("ViewLayer.Vector", "XYZW", SampleType::F32, size, 5)),
        ("CryptoObject00", cryptomatte("ViewLayer.CryptoObject00", size, 6)),
        ("IndexOB", pass("ViewLayer.IndexOB", "X", SampleType::U32, size, 7)),
    ];
    let attributes = vec![
        ("Frame".to_string(), "007".to_string()),
        ("cycles.ViewLayer.samples".to_string(), "4".to_string()),
        ("Software".to_string(), "Blender 5.0.1".to_string()),
        ("cryptomatte/542cafa/manifest".to_string(), "{\"Cube\":\"a8fce865\"}".repeat(30)),
    ];
    split(passes, attributes, multipart)
}

/// Passes as parts of their own, or all in one.
pub fn split(passes: Vec<(&str, Vec<Channel>)>, attributes: Vec<(String, String)>, multipart: bool) -> Vec<Part> {
    match multipart {
        true => passes
            .into_iter()
            .map(|(name, channels)| Part {
                name: Some(format!("ViewLayer.{name}")),
                attributes: attributes.clone(),
                channels,
                ..Part::default()
            })
            .collect(),
        false => {
            let channels = passes.into_iter().flat_map(|(_, channels)| channels).collect();
            vec![Part { attributes, channels, ..Part::default() }]
        }
    }
}

/// A folder that goes away, and the paths of a source and an output in it.
pub fn folder() -> (tempfile::TempDir, PathBuf, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let (source, output) = (folder.path().join("in.exr"), folder.path().join("out.exr"));
    (folder, source, output)
}

pub const LOSSLESS: [Compression; 5] =
    [Compression::Uncompressed, Compression::RLE, Compression::ZIP1, Compression::ZIP16, Compression::PIZ];
pub const LOSSY: [Compression; 5] =
    [Compression::PXR24, Compression::B44, Compression::B44A, Compression::DWAA(None), Compression::DWAB(None)];
