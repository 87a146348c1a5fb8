//! An EXR file opened for reading: its header checked before anything is allocated, its chunks read one by one.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use exr::block::chunk::TileCoordinates;
use exr::math::Vec2;
use exr::meta::attribute::{IntegerBounds, LevelMode};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};

use super::codec::guarded;
use super::container::Prologue;
use crate::error::{Error, Result};

/// Most pixels of an image that Hush opens: 16384².
const MAX_PIXELS: u64 = 1 << 28;
const MAX_SIDE: i64 = 1 << 20;
/// Most bytes that one chunk may decode to.
const MAX_CHUNK_BYTES: u64 = 1 << 31;
/// No codec of the format packs pixels tighter than this (DWA of a flat image comes closest).
const MAX_RATIO: u64 = 1 << 17;

/// An open file with a believable header.
pub(crate) struct ExrFile {
    path: PathBuf,
    file: BufReader<File>,
    bytes: u64,
    pub prologue: Prologue,
    /// The same headers as the codecs want them, one a part.
    pub headers: Vec<Header>,
    tables_at: u64,
}

/// Remembers what the system refused, which is no fault of the file.
struct Refusals<'a> {
    file: &'a mut BufReader<File>,
    last: Option<std::io::Error>,
}

impl Read for Refusals<'_> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let read = self.file.read(into);
        self.last =
            read.as_ref().err().map(|e| e.raw_os_error().map_or_else(|| e.kind().into(), std::io::Error::from_raw_os_error));
        read
    }
}

/// One chunk as it lies in the file.
#[derive(Clone, Debug)]
pub(crate) struct Chunk {
    /// What stands in front of the chunk's size, without the part number.
    pub location: Vec<u8>,
    pub bounds: IntegerBounds,
    pub data: Vec<u8>,
}

impl ExrFile {
    /// Opens a file and checks its header, without touching the pixels.
    pub fn open(path: &Path) -> Result<Self> {
        // Looked up before, because opening a pipe waits for somebody who writes into it.
        let about = path.metadata().map_err(|e| Error::io(path, e))?;
        if !about.is_file() {
            let folder = about.is_dir();
            return Err(Error::bad_file(path, if folder { "is a folder: name a file in it" } else { "is not a file" }));
        }
        let file = File::open(path).map_err(|e| Error::io(path, e))?;
        let bytes = about.len();
        if bytes == 0 {
            return Err(Error::bad_file(path, "is empty (0 bytes)"));
        }
        let mut file = BufReader::with_capacity(1 << 16, file);
        let bad = |reason: String| Error::bad_file(path, reason);
        let mut header = Refusals { file: &mut file, last: None };
        let prologue = Prologue::read(&mut header, bytes);
        let prologue = prologue.map_err(|reason| header.last.map_or_else(|| bad(reason), |e| Error::io(path, e)))?;
        check_windows(&prologue).map_err(bad)?;
        check_kinds(&prologue).map_err(bad)?;
        let raw = prologue_bytes(path, &mut file)?;
        let headers = parse_headers(&raw).map_err(bad)?;
        check_headers(&prologue, &headers, bytes).map_err(bad)?;
        Ok(Self { path: path.into(), file, bytes, prologue, headers, tables_at: raw.len() as u64 })
    }

    /// The file's size in bytes.
    pub fn file_bytes(&self) -> u64 {
        self.bytes
    }

    /// Where each chunk of each part begins, in order of rising y. Every position is inside the file.
    pub fn tables(&mut self) -> Result<Vec<Vec<u64>>> {
        let path = self.path.clone();
        self.seek(self.tables_at)?;
        let mut tables = Vec::with_capacity(self.headers.len());
        let total: u64 = self.headers.iter().map(|h| h.chunk_count as u64).sum();
        let first = self.tables_at + total * 8;
        for part in 0..self.headers.len() {
            let mut bytes = vec![0; self.headers[part].chunk_count * 8];
            self.take(&mut bytes)?;
            let table: Vec<u64> = bytes.chunks_exact(8).map(|b| u64::from_le_bytes(std::array::from_fn(|i| b[i]))).collect();
            if table.contains(&0) {
                return Err(Error::bad_file(path, "is not finished: pixels are missing (was the render interrupted?)"));
            }
            if table.iter().any(|&at| at < first || at >= self.bytes) {
                return Err(Error::bad_file(path, "is cut short or has a damaged chunk table"));
            }
            tables.push(table);
        }
        Ok(tables)
    }

    /// Reads one chunk; `index` is its place in its part's table, `at` its position in the file.
    pub fn chunk(&mut self, part: usize, index: usize, at: u64) -> Result<Chunk> {
        let (location, bounds, size) = self.chunk_head(part, index, at)?;
        let mut data = vec![0; size];
        self.take(&mut data)?;
        Ok(Chunk { location, bounds, data })
    }

    /// Checks that a chunk is the one that belongs there and lies in the file as a whole, without reading its pixels.
    pub fn check_chunk(&mut self, part: usize, index: usize, at: u64) -> Result<()> {
        self.chunk_head(part, index, at).map(drop)
    }

    fn chunk_head(&mut self, part: usize, index: usize, at: u64) -> Result<(Vec<u8>, IntegerBounds, usize)> {
        let path = self.path.clone();
        let bad = |reason: &str| Error::bad_file(&path, reason);
        self.seek(at)?;
        if self.prologue.is_multipart() && self.int()? != part as i32 {
            return Err(bad("has a chunk of another part where one of its own belongs"));
        }
        let tiled = self.headers.get(part).is_some_and(|h| matches!(h.blocks, BlockDescription::Tiles(_)));
        let mut location = vec![0; if tiled { 16 } else { 4 }];
        self.take(&mut location)?;
        let size = self.int()?;
        let header = self.headers.get(part);
        let bounds =
            header.and_then(|h| chunk_bounds(h, index, &location)).ok_or_else(|| bad("has a chunk with a damaged position"))?;
        let most = bounds.size.area() * header.map_or(0, |h| h.channels.bytes_per_pixel);
        let size = usize::try_from(size).ok().filter(|&s| s <= most).ok_or_else(|| bad("has a chunk of an impossible size"))?;
        let position = self.file.stream_position().map_err(|e| Error::io(&path, e))?;
        if position + size as u64 > self.bytes {
            return Err(bad("is cut short"));
        }
        Ok((location, bounds, size))
    }

    fn seek(&mut self, at: u64) -> Result<()> {
        // Small steps stay inside the buffer.
        let here = self.file.stream_position().map_err(|e| Error::io(&self.path, e))?;
        self.file.seek_relative(at as i64 - here as i64).map_err(|e| Error::io(&self.path, e))
    }

    fn take(&mut self, bytes: &mut [u8]) -> Result<()> {
        self.file.read_exact(bytes).map_err(|e| match e.kind() {
            std::io::ErrorKind::UnexpectedEof => Error::bad_file(&self.path, "is cut short"),
            _ => Error::io(&self.path, e),
        })
    }

    fn int(&mut self) -> Result<i32> {
        let mut bytes = [0; 4];
        self.take(&mut bytes)?;
        Ok(i32::from_le_bytes(bytes))
    }
}

/// The headers as the codecs want them.
pub(crate) fn parse_headers(prologue: &[u8]) -> Result<Vec<Header>, String> {
    guarded(|| {
        let meta = MetaData::read_from_buffered(prologue, false)?;
        MetaData::validate(&meta.headers, false)?;
        Ok(meta.headers.into_vec())
    })
}

/// A chunk's rectangle inside its part's data window, checked against its place in the table.
fn chunk_bounds(header: &Header, index: usize, location: &[u8]) -> Option<IntegerBounds> {
    let int = |i: usize| Some(i32::from_le_bytes(location.get(i * 4..i * 4 + 4)?.try_into().ok()?));
    let coordinates = match header.blocks {
        BlockDescription::ScanLines => {
            let lines = header.compression.scan_lines_per_block();
            let y = i64::from(header.own_attributes.layer_position.1) + (index * lines) as i64;
            (i64::from(int(0)?) == y).then_some(TileCoordinates { tile_index: Vec2(0, index), level_index: Vec2(0, 0) })?
        }
        BlockDescription::Tiles(tiles) => {
            let across = header.layer_size.0.div_ceil(tiles.tile_size.0);
            let (x, y) = (index % across, index / across);
            let expected = [x as i32, y as i32, 0, 0];
            (0..4).all(|i| int(i) == Some(expected[i])).then_some(())?;
            TileCoordinates { tile_index: Vec2(x, y), level_index: Vec2(0, 0) }
        }
    };
    guarded(|| header.get_absolute_block_pixel_coordinates(coordinates)).ok()
}

/// Re-reads the bytes in front of the chunk tables, whose length is known only after parsing them.
fn prologue_bytes(path: &Path, file: &mut BufReader<File>) -> Result<Vec<u8>> {
    let length = file.stream_position().map_err(|e| Error::io(path, e))?;
    file.rewind().map_err(|e| Error::io(path, e))?;
    let mut bytes = vec![0; length as usize];
    file.read_exact(&mut bytes).map_err(|e| Error::io(path, e))?;
    Ok(bytes)
}

/// Refuses sizes that cannot be true before any code multiplies them.
fn check_windows(prologue: &Prologue) -> Result<(), String> {
    if prologue.headers.is_empty() {
        return Err("holds no image".into());
    }
    for header in &prologue.headers {
        let [x0, y0, x1, y1] = header.data_window().ok_or("has no data window")?.map(i64::from);
        let (columns, rows) = (x1 - x0 + 1, y1 - y0 + 1);
        if columns <= 0 || rows <= 0 {
            return Err(format!("has an empty or inverted data window ({columns}×{rows})"));
        }
        if columns > MAX_SIDE || rows > MAX_SIDE || (columns * rows) as u64 > MAX_PIXELS {
            return Err(format!("claims {columns}×{rows} pixels, more than Hush opens (16384×16384)"));
        }
    }
    Ok(())
}

/// Refuses kinds of files that the codecs lack, in words; of some of them the codecs' own parser would say that they are damaged.
fn check_kinds(prologue: &Prologue) -> Result<(), String> {
    for header in &prologue.headers {
        if header.get("type").is_some_and(|kind| kind.starts_with(b"deep")) {
            return Err("holds deep data, which Hush does not denoise: save it flattened".into());
        }
        let sampling_of_1 = [1, 0, 0, 0, 1, 0, 0, 0];
        if header.channels().is_some_and(|channels| channels.iter().any(|c| c.description[8..] != sampling_of_1)) {
            return Err(
                "has subsampled channels, as luminance and chroma are kept, which Hush does not read: save it as RGB".into()
            );
        }
        let Some(&[compression]) = header.get("compression") else { continue };
        let name = match compression {
            0..=9 => continue,
            10 | 11 => "HTJ2K".into(),
            12 => "LJ2K".into(),
            13 => "ZSTD".into(),
            unknown => format!("method {unknown} of the format"),
        };
        return Err(format!("is compressed with {name}, which Hush does not read: save it with ZIP"));
    }
    Ok(())
}

fn check_headers(prologue: &Prologue, headers: &[Header], file_bytes: u64) -> Result<(), String> {
    if headers.len() != prologue.headers.len() {
        return Err("has a damaged header".into());
    }
    let (mut chunks, mut pixels) = (0, 0);
    for (raw, header) in prologue.headers.iter().zip(headers) {
        let channels = raw.channels().ok_or("has a damaged channel list")?;
        if channels.len() != header.channels.list.len() || channels.is_empty() {
            return Err("has a damaged channel list".into());
        }
        if matches!(header.blocks, BlockDescription::Tiles(t) if t.level_mode != LevelMode::Singular) {
            return Err("has mipmap levels, which Hush does not read: save it with one level".into());
        }
        if raw.int("chunkCount").is_some_and(|count| count as i64 != header.chunk_count as i64) {
            return Err("has a chunk count that does not fit its size".into());
        }
        let pixel_bytes = header.channels.bytes_per_pixel as u64;
        let block = header.max_block_pixel_size();
        let block_pixels = (block.0.min(header.layer_size.0) * block.1.min(header.layer_size.1)) as u64;
        if block_pixels * pixel_bytes > MAX_CHUNK_BYTES {
            return Err("has chunks of more than 2 GiB".into());
        }
        chunks += header.chunk_count as u64;
        pixels += header.layer_size.area() as u64 * pixel_bytes;
    }
    if chunks.saturating_mul(8) > file_bytes || pixels / MAX_RATIO > file_bytes {
        let first = headers.first().map(|h| h.layer_size).unwrap_or(Vec2(0, 0));
        return Err(format!("claims {}×{} pixels, but has only {file_bytes} bytes: cut short or damaged", first.0, first.1));
    }
    Ok(())
}
