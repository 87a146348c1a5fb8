//! The bytes of an EXR header, kept verbatim so that whatever Hush does not change is written back bit for bit.

use std::io::Read;

/// Longest header block that is believed; Blender's largest (Cryptomatte manifests in every part) stay far below.
const MAX_HEADER_BYTES: u64 = 256 << 20;
/// Most parts, channels and attributes of a file that are believed. Blender's largest have hundreds of parts, with dozens of
/// attributes each; what reads them takes time and memory that grow faster than their number.
const MAX_PARTS: usize = 1024;
const MAX_CHANNELS: usize = 4096;
const MAX_ATTRIBUTES: usize = 1 << 16;
const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
/// Version-field flag: the only part is tiled.
const TILED: u32 = 1 << 9;
/// Version-field flag: names may be up to 255 bytes.
const LONG_NAMES: u32 = 1 << 10;
/// Version-field flag: several parts.
const MULTIPART: u32 = 1 << 12;

/// One attribute as it stands in the file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RawAttribute {
    pub name: Vec<u8>,
    pub kind: Vec<u8>,
    pub value: Vec<u8>,
}

/// One part's attributes, in the file's order.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RawHeader {
    pub attributes: Vec<RawAttribute>,
}

/// A channel description: its name and the 16 bytes behind it (type, linearity, sampling).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RawChannel {
    pub name: Vec<u8>,
    pub description: [u8; 16],
}

/// Everything in front of the chunk tables.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Prologue {
    /// Version number and flags.
    pub version: u32,
    pub headers: Vec<RawHeader>,
}

impl Prologue {
    /// Reads the magic number, the version and every header. The error is a reason without the path.
    pub fn read(read: &mut impl Read, file_bytes: u64) -> Result<Self, String> {
        let mut read = Limited { read, left: file_bytes.min(MAX_HEADER_BYTES), attributes: 0 };
        if read.array::<4>().ok() != Some(MAGIC) {
            return Err("is not an EXR file".into());
        }
        let version = u32::from_le_bytes(read.array()?);
        let mut headers = Vec::new();
        let mut channels = 0;
        loop {
            let header = read.header()?;
            channels += header.channel_count();
            check_count(channels, MAX_CHANNELS, "channels")?;
            check_count(headers.len(), MAX_PARTS, "parts")?;
            if version & MULTIPART == 0 {
                headers.push(header);
                break;
            }
            if header.attributes.is_empty() {
                break;
            }
            headers.push(header);
        }
        Ok(Self { version, headers })
    }

    /// Whether chunks carry part numbers.
    pub fn is_multipart(&self) -> bool {
        self.version & MULTIPART != 0
    }

    /// Turns a single-part file into one of the multi-part kind, which demands each part's chunk count and type.
    pub fn make_multipart(&mut self, chunk_counts: &[usize]) {
        let kind = if self.version & TILED != 0 { "tiledimage" } else { "scanlineimage" };
        for (header, &count) in self.headers.iter_mut().zip(chunk_counts).filter(|_| self.version & MULTIPART == 0) {
            header.set("chunkCount", "int", (count as i32).to_le_bytes().to_vec());
            header.set("type", "string", kind.into());
        }
        self.version = (self.version | MULTIPART) & !TILED;
    }

    /// The bytes of the file up to the chunk tables. Raises the long-names flag where a name needs it.
    pub fn to_bytes(&self) -> Vec<u8> {
        let long = |h: &RawHeader| {
            h.attributes.iter().any(|a| a.name.len() > 31 || a.kind.len() > 31)
                || h.channels().is_some_and(|channels| channels.iter().any(|c| c.name.len() > 31))
        };
        let flag = if self.headers.iter().any(long) { LONG_NAMES } else { 0 };
        let mut bytes = MAGIC.to_vec();
        bytes.extend((self.version | flag).to_le_bytes());
        for header in &self.headers {
            for a in &header.attributes {
                bytes.extend(a.name.iter().chain(&[0]).chain(&a.kind).chain(&[0]));
                bytes.extend((a.value.len() as u32).to_le_bytes());
                bytes.extend(&a.value);
            }
            bytes.push(0);
        }
        if self.is_multipart() {
            bytes.push(0);
        }
        bytes
    }
}

impl RawHeader {
    /// An attribute's value.
    pub fn get(&self, name: &str) -> Option<&[u8]> {
        self.attributes.iter().find(|a| a.name == name.as_bytes()).map(|a| a.value.as_slice())
    }

    /// Sets an attribute's value, in place where it exists.
    pub fn set(&mut self, name: &str, kind: &str, value: Vec<u8>) {
        match self.attributes.iter_mut().find(|a| a.name == name.as_bytes()) {
            Some(a) => (a.kind, a.value) = (kind.into(), value),
            None => self.attributes.push(RawAttribute { name: name.into(), kind: kind.into(), value }),
        }
    }

    /// The data window's corners x0, y0, x1, y1, both inclusive.
    pub fn data_window(&self) -> Option<[i32; 4]> {
        let value = self.get("dataWindow")?;
        let mut corners = [0; 4];
        for (corner, bytes) in corners.iter_mut().zip(value.chunks_exact(4)) {
            *corner = i32::from_le_bytes(bytes.try_into().ok()?);
        }
        (value.len() == 16).then_some(corners)
    }

    /// An integer attribute.
    pub fn int(&self, name: &str) -> Option<i32> {
        Some(i32::from_le_bytes(self.get(name)?.try_into().ok()?))
    }

    /// How many channels it lists, sound or not.
    fn channel_count(&self) -> usize {
        let lists = self.attributes.iter().filter(|a| a.name == b"channels");
        let count = |list: &RawAttribute| {
            let (mut bytes, mut count) = (list.value.as_slice(), 0);
            while let Some(end) = bytes.iter().position(|&b| b == 0).filter(|&end| end > 0) {
                bytes = bytes.get(end + 17..).unwrap_or_default();
                count += 1;
            }
            count
        };
        lists.map(count).sum()
    }

    /// The channel list; None where it is damaged or not in alphabetical order, which the format demands.
    pub fn channels(&self) -> Option<Vec<RawChannel>> {
        let mut bytes = self.get("channels")?;
        let mut channels: Vec<RawChannel> = Vec::new();
        loop {
            let end = bytes.iter().position(|&b| b == 0)?;
            if end == 0 {
                return Some(channels);
            }
            let name = bytes[..end].to_vec();
            let description = bytes.get(end + 1..end + 17)?.try_into().ok()?;
            if channels.last().is_some_and(|previous| previous.name >= name) {
                return None;
            }
            bytes = &bytes[end + 17..];
            channels.push(RawChannel { name, description });
        }
    }

    /// Replaces the channel list, sorting it.
    pub fn set_channels(&mut self, mut channels: Vec<RawChannel>) {
        channels.sort_by(|a, b| a.name.cmp(&b.name));
        let mut value = Vec::new();
        for c in &channels {
            value.extend(c.name.iter().chain(&[0]).chain(&c.description));
        }
        value.push(0);
        self.set("channels", "chlist", value);
    }
}

fn check_count(count: usize, most: usize, what: &str) -> Result<(), String> {
    if count > most { Err(format!("has more than {most} {what}, which Hush does not read")) } else { Ok(()) }
}

/// A reader that never takes more than the file can hold.
struct Limited<'a, R> {
    read: &'a mut R,
    left: u64,
    /// Read so far.
    attributes: usize,
}

impl<R: Read> Limited<'_, R> {
    fn take(&mut self, into: &mut [u8]) -> Result<(), String> {
        let cut = || "ends inside its header".to_string();
        self.left = self.left.checked_sub(into.len() as u64).ok_or_else(cut)?;
        self.read.read_exact(into).map_err(|_| cut())
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let mut bytes = [0; N];
        self.take(&mut bytes)?;
        Ok(bytes)
    }

    fn text(&mut self) -> Result<Vec<u8>, String> {
        let mut text = Vec::new();
        loop {
            match self.array::<1>()?[0] {
                0 => return Ok(text),
                _ if text.len() == 255 => return Err("has a damaged header".into()),
                byte => text.push(byte),
            }
        }
    }

    fn header(&mut self) -> Result<RawHeader, String> {
        let mut attributes = Vec::new();
        loop {
            let name = self.text()?;
            if name.is_empty() {
                return Ok(RawHeader { attributes });
            }
            let kind = self.text()?;
            let size = u32::from_le_bytes(self.array()?);
            if u64::from(size) > self.left {
                return Err("has a damaged header".into());
            }
            let mut value = vec![0; size as usize];
            self.take(&mut value)?;
            attributes.push(RawAttribute { name, kind, value });
            self.attributes += 1;
            check_count(self.attributes, MAX_ATTRIBUTES, "attributes")?;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prologue(multipart: bool) -> Prologue {
        let mut header = RawHeader { attributes: vec![] };
        let channel = |name: &str| RawChannel { name: name.into(), description: [1; 16] };
        header.set_channels(vec![channel("b"), channel("a")]);
        header.set("dataWindow", "box2i", [-1i32, -2, 3, 4].iter().flat_map(|v| v.to_le_bytes()).collect());
        Prologue { version: 2 | if multipart { MULTIPART } else { 0 }, headers: vec![header; if multipart { 2 } else { 1 }] }
    }

    #[test]
    fn bytes_round_trip() {
        for multipart in [false, true] {
            let p = prologue(multipart);
            let bytes = p.to_bytes();
            assert_eq!(Prologue::read(&mut bytes.as_slice(), bytes.len() as u64), Ok(p.clone()));
            assert_eq!(p.headers[0].data_window(), Some([-1, -2, 3, 4]));
            assert_eq!(p.headers[0].channels().map(|c| c[0].name.clone()), Some(b"a".to_vec()));
            for cut in 0..bytes.len() {
                assert!(Prologue::read(&mut &bytes[..cut], cut as u64).is_err(), "{cut}");
            }
        }
    }

    #[test]
    fn a_huge_attribute_size_is_refused_before_allocation() {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(2u32.to_le_bytes());
        bytes.extend(b"a\0string\0\xff\xff\xff\xff");
        assert_eq!(Prologue::read(&mut bytes.as_slice(), bytes.len() as u64), Err("has a damaged header".into()));
    }

    #[test]
    fn long_names_raise_the_flag() {
        let mut p = prologue(false);
        p.headers[0].set(&"x".repeat(40), "string", b"y".to_vec());
        assert_eq!(u32::from_le_bytes(p.to_bytes()[4..8].try_into().unwrap()), 2 | LONG_NAMES);
    }
}
