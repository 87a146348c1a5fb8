//! Decoding and encoding of single chunks, guarded against hostile bytes.

use std::panic::{AssertUnwindSafe, catch_unwind};

use exr::compression::Compression;
use exr::meta::attribute::IntegerBounds;
use exr::meta::header::Header;

/// Bytes of a DWA chunk's own header: eleven 64-bit sizes.
const DWA_HEADER_BYTES: usize = 88;

/// Runs foreign code; its errors and its panics become reasons.
pub(crate) fn guarded<T>(work: impl FnOnce() -> exr::error::Result<T>) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(exr::error::Error::Io(e))) => Err(format!("ends too early ({e})")),
        Ok(Err(e)) => Err(format!("is damaged or not supported ({e})")),
        Err(_) => Err("is damaged".into()),
    }
}

/// Decodes a chunk to rows of channels, native-endian: for each row, for each channel of the header, its samples.
pub(crate) fn decode(header: &Header, bounds: IntegerBounds, compressed: Vec<u8>) -> Result<Vec<u8>, String> {
    let expected = bounds.size.area() * header.channels.bytes_per_pixel;
    if compressed.len() > expected {
        return Err("has a chunk larger than its pixels".into());
    }
    check_dwa_sizes(header, bounds, &compressed, expected)?;
    guarded(|| header.compression.decompress_image_section_from_le(header, compressed, bounds, false))
}

/// Encodes rows of channels, as [`decode`] gives them, with the header's compression.
pub(crate) fn encode(header: &Header, bounds: IntegerBounds, rows: Vec<u8>) -> Result<Vec<u8>, String> {
    guarded(|| header.compression.compress_image_section_to_le(header, rows, bounds))
}

/// The decoder allocates what a DWA chunk's header claims, so believe no claim that the pixels cannot justify.
fn check_dwa_sizes(header: &Header, bounds: IntegerBounds, bytes: &[u8], expected: usize) -> Result<(), String> {
    if !matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) || bytes.len() == expected {
        return Ok(());
    }
    let sizes = bytes.get(..DWA_HEADER_BYTES).ok_or("has a chunk that is cut short")?;
    // Blocks are 8×8 at the edges too, and run-length codes can grow the data a little.
    let padded = bounds.size.0.next_multiple_of(8) * bounds.size.1.next_multiple_of(8);
    let most = (padded * header.channels.list.len() * 4 * 2 + 4096) as u64;
    // Version, four pairs of section sizes and counts; the last is a method number.
    match sizes.chunks_exact(8).skip(1).all(|s| s.try_into().is_ok_and(|s| u64::from_le_bytes(s) <= most)) {
        true => Ok(()),
        false => Err("has a chunk that claims more data than its pixels".into()),
    }
}
