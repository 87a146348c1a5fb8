//! What an EXR file holds, from its header alone.

use std::path::{Path, PathBuf};

use exr::compression::Compression;
use serde::Serialize;

use super::container::RawHeader;
use super::exr_file::ExrFile;
use super::names::{self, ChannelName};
use crate::error::Result;

/// How a channel stores its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SampleType {
    /// 16-bit float.
    Half,
    /// 32-bit float.
    Float,
    /// 32-bit unsigned integer.
    Uint,
}

impl SampleType {
    /// Bytes of one sample.
    pub fn bytes(self) -> usize {
        if self == Self::Half { 2 } else { 4 }
    }
}

impl From<exr::meta::attribute::SampleType> for SampleType {
    fn from(sample: exr::meta::attribute::SampleType) -> Self {
        match sample {
            exr::meta::attribute::SampleType::F16 => Self::Half,
            exr::meta::attribute::SampleType::F32 => Self::Float,
            exr::meta::attribute::SampleType::U32 => Self::Uint,
        }
    }
}

/// One channel of a pass and where it lies in the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Channel {
    /// `R`, `G`, `B`, `A`, `X`, `Y`, `Z`, `W`, `V`, …
    pub component: String,
    /// The whole name in the file, such as `ViewLayer.Combined.R`.
    pub name: String,
    /// Index of the part.
    pub part: usize,
    /// Index in the part's channel list.
    pub index: usize,
    /// How its numbers are stored.
    pub sample: SampleType,
}

/// One pass (in one view) of a layer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Pass {
    /// Blender's name, such as `Combined`; empty for plain images.
    pub name: String,
    /// Its stereo view; None where it serves every view.
    pub view: Option<String>,
    /// In the file's order.
    pub channels: Vec<Channel>,
}

impl Pass {
    /// The channel of a component.
    pub fn channel(&self, component: &str) -> Option<&Channel> {
        self.channels.iter().find(|c| c.component == component)
    }

    /// The channels of these components in this order, or None where one is missing.
    pub fn components(&self, components: &[&str]) -> Option<Vec<Channel>> {
        components.iter().map(|c| self.channel(c).cloned()).collect()
    }

    /// The channels R, G, B, if they are numbers with a fraction.
    pub(super) fn rgb(&self) -> Option<Vec<Channel>> {
        self.components(&["R", "G", "B"]).filter(|channels| channels.iter().all(|c| c.sample != SampleType::Uint))
    }
}

/// A view layer, or a File Output node's layers where `name` is empty.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ViewLayer {
    /// Such as `ViewLayer`.
    pub name: String,
    /// Stereo views; empty if there is one view only.
    pub views: Vec<String>,
    /// One for each view that has it.
    pub passes: Vec<Pass>,
    /// Samples per pixel, where Cycles noted them.
    pub samples: Option<u32>,
}

impl ViewLayer {
    /// The pass of this name in this view; a pass without view serves every view.
    pub fn pass(&self, name: &str, view: Option<&str>) -> Option<&Pass> {
        let of_view = |v: Option<&str>| self.passes.iter().find(|p| p.name == name && p.view.as_deref() == v);
        of_view(view).or_else(|| of_view(None))
    }
}

/// One part (one header) of the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Part {
    /// The `name` attribute.
    pub name: Option<String>,
    /// The `view` attribute.
    pub view: Option<String>,
    /// Width of the data window, in pixels.
    pub columns: usize,
    /// Height of the data window, in pixels.
    pub rows: usize,
    /// The data window's top left corner.
    pub origin: [i32; 2],
    /// As [`Layout::compression`].
    pub compression: String,
    /// Whether the compression may change the numbers it stores.
    pub lossy: bool,
}

/// What a file holds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Layout {
    /// The file.
    pub path: PathBuf,
    /// Of the first part's data window.
    pub columns: usize,
    /// As `columns`: the height.
    pub rows: usize,
    /// `NONE`, `RLE`, `ZIPS`, `ZIP`, `PIZ`, `PXR24`, `B44`, `B44A`, `DWAA` or `DWAB`; that of the first part.
    pub compression: String,
    /// Whether any part's compression may change the numbers it stores.
    pub lossy: bool,
    /// How many parts there are.
    pub parts: usize,
    /// The parts, in the order of the file.
    pub part_list: Vec<Part>,
    /// Whether the file is of the multi-part kind, where each pass has a part of its own (Blender 5's default).
    pub multipart: bool,
    /// The view layers, in the order of the file.
    pub layers: Vec<ViewLayer>,
    /// Blender's `Frame` metadata.
    pub frame: Option<i32>,
    /// Samples per pixel of the first layer that has them noted.
    pub spp: Option<u32>,
    /// Such as `Blender 5.0.1`; Blender 4 notes none.
    pub software: Option<String>,
    /// The file's size.
    pub file_bytes: u64,
}

impl Layout {
    /// The layer of this name.
    pub fn layer(&self, name: &str) -> Option<&ViewLayer> {
        self.layers.iter().find(|l| l.name == name)
    }
}

/// The layer that Blender writes beside the view layers.
const COMPOSITE: &str = "Composite";

impl ViewLayer {
    /// Whether this is no view layer but what came out of the compositor while the frame was rendered. Cycles notes no samples
    /// for it, and it has the one pass Combined.
    pub fn is_composite(&self) -> bool {
        self.name == COMPOSITE && self.samples.is_none() && self.passes.iter().all(|p| p.name == "Combined")
    }
}

/// Reads a file's header. Sizes are checked against the file's length and fixed bounds before anything is allocated.
///
/// # Errors
/// [`crate::Error::Io`] if the file cannot be opened; [`crate::Error::BadFile`] if it is no EXR file, is cut short in its header,
/// claims an impossible size, or is of a kind that Hush does not read (deep, subsampled, mipmapped, HTJ2K, LJ2K, ZSTD).
pub fn read_layout(path: &Path) -> Result<Layout> {
    Ok(describe(path, &ExrFile::open(path)?))
}

pub(crate) fn describe(path: &Path, source: &ExrFile) -> Layout {
    let raw = &source.prologue.headers;
    let text = |name: &str| raw.iter().find_map(|h| text_attribute(h, name));
    let views = raw.iter().find_map(|h| h.get("multiView")).map(text_vector).unwrap_or_default();
    let multipart = source.prologue.is_multipart();
    let mut layers: Vec<ViewLayer> = Vec::new();
    let mut part_list = Vec::new();
    for (part, (raw, header)) in raw.iter().zip(&source.headers).enumerate() {
        let (name, view) = (text_attribute(raw, "name"), text_attribute(raw, "view"));
        for (index, channel) in header.channels.list.iter().enumerate() {
            let full = String::from_utf8_lossy(channel.name.bytes()).into_owned();
            let parsed = names::parse(&full, multipart, name.as_deref(), view.as_deref(), &views);
            let component = parsed.component.clone();
            add(&mut layers, parsed, Channel { component, name: full, part, index, sample: channel.sample_type.into() });
        }
        part_list.push(Part {
            name,
            view,
            columns: header.layer_size.0,
            rows: header.layer_size.1,
            origin: [header.own_attributes.layer_position.0, header.own_attributes.layer_position.1],
            compression: compression_name(header.compression).into(),
            lossy: header.compression.may_loose_data(),
        });
    }
    for layer in &mut layers {
        layer.samples = text(&format!("cycles.{}.samples", layer.name)).and_then(|s| s.trim().parse().ok());
    }
    let first = part_list.first();
    Layout {
        path: path.into(),
        columns: first.map_or(0, |p| p.columns),
        rows: first.map_or(0, |p| p.rows),
        compression: first.map(|p| p.compression.clone()).unwrap_or_default(),
        lossy: part_list.iter().any(|p| p.lossy),
        parts: part_list.len(),
        multipart,
        frame: text("Frame").and_then(|s| s.trim().parse().ok()),
        spp: layers.iter().find_map(|l| l.samples),
        software: text("Software").or_else(|| text("software")),
        file_bytes: source.file_bytes(),
        layers,
        part_list,
    }
}

fn add(layers: &mut Vec<ViewLayer>, name: ChannelName, channel: Channel) {
    let at = layers.iter().position(|l| l.name == name.layer).unwrap_or_else(|| {
        layers.push(ViewLayer { name: name.layer, views: vec![], passes: vec![], samples: None });
        layers.len() - 1
    });
    let layer = &mut layers[at];
    if let Some(view) = name.view.as_ref().filter(|v| !layer.views.contains(v)) {
        layer.views.push(view.clone());
    }
    match layer.passes.iter_mut().find(|p| p.name == name.pass && p.view == name.view) {
        Some(pass) => pass.channels.push(channel),
        None => layer.passes.push(Pass { name: name.pass, view: name.view, channels: vec![channel] }),
    }
}

fn text_attribute(header: &RawHeader, name: &str) -> Option<String> {
    let text = String::from_utf8_lossy(header.get(name)?);
    Some(text.trim_end_matches('\0').to_owned())
}

/// A `stringvector` attribute: each string with its length in front.
fn text_vector(mut bytes: &[u8]) -> Vec<String> {
    let mut texts = Vec::new();
    while let Some((length, rest)) = bytes.split_first_chunk::<4>() {
        let Some((text, rest)) = rest.split_at_checked(u32::from_le_bytes(*length) as usize) else { break };
        texts.push(String::from_utf8_lossy(text).into_owned());
        bytes = rest;
    }
    texts
}

fn compression_name(compression: Compression) -> &'static str {
    match compression {
        Compression::Uncompressed => "NONE",
        Compression::RLE => "RLE",
        Compression::ZIP1 => "ZIPS",
        Compression::ZIP16 => "ZIP",
        Compression::PIZ => "PIZ",
        Compression::PXR24 => "PXR24",
        Compression::B44 => "B44",
        Compression::B44A => "B44A",
        Compression::DWAA(_) => "DWAA",
        Compression::DWAB(_) => "DWAB",
        Compression::HTJ2K32 | Compression::HTJ2K256 => "HTJ2K",
    }
}
