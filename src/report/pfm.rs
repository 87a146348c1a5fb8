//! Portable float maps: three floats a pixel, rows from the bottom up.

use std::io::Write;
use std::path::Path;

use ndarray::{Array3, ArrayView3};

use crate::error::{Error, Result};

/// Writes (rows, columns, 3), each value through `change`.
pub fn write(path: &Path, image: ArrayView3<f32>, change: impl Fn(f32) -> f32) -> Result<()> {
    let (rows, columns, _) = image.dim();
    let mut bytes = format!("PF\n{columns} {rows}\n-1.0\n").into_bytes();
    for row in image.outer_iter().rev() {
        row.iter().for_each(|v| bytes.extend(change(*v).to_le_bytes()));
    }
    let file = std::fs::File::create(path).and_then(|mut f| f.write_all(&bytes));
    file.map_err(|e| Error::io(path, e))
}

/// Reads (rows, columns, 3).
///
/// # Errors
/// The file cannot be read or is no little-endian colour map.
pub fn read(path: &Path) -> Result<Array3<f32>> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    parse(&bytes).ok_or_else(|| Error::bad_file(path, "is no little-endian PFM of three channels"))
}

fn parse(bytes: &[u8]) -> Option<Array3<f32>> {
    let mut lines = bytes.splitn(4, |b| *b == b'\n').map(|line| std::str::from_utf8(line).ok());
    let magic = lines.next()??.trim();
    let mut sides = lines.next()??.split_whitespace().map(str::parse::<usize>);
    let (columns, rows) = (sides.next()?.ok()?, sides.next()?.ok()?);
    let scale: f32 = lines.next()??.trim().parse().ok()?;
    let length = rows.checked_mul(columns)?.checked_mul(12)?;
    let body = bytes.splitn(4, |b| *b == b'\n').nth(3)?;
    if magic != "PF" || scale >= 0.0 || body.len() != length || length == 0 {
        return None;
    }
    let values: Vec<f32> = body.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let mut image = Array3::from_shape_vec((rows, columns, 3), values).ok()?;
    image.invert_axis(ndarray::Axis(0));
    Some(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pfm");
        let image = Array3::from_shape_fn((3, 5, 3), |(y, x, c)| (y * 100 + x * 10 + c) as f32 - 50.0);
        write(&path, image.view(), |v| v.max(0.0)).unwrap();
        assert_eq!(read(&path).unwrap(), image.mapv(|v| v.max(0.0)));
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes.starts_with(b"PF\n5 3\n-1.0\n") && bytes[bytes.len() - 4..] == 0.0f32.to_le_bytes()[..]);
    }

    #[test]
    fn other_bytes_are_refused() {
        for bytes in [
            &b""[..],
            b"PF\n1 1\n-1\n",
            b"Pf\n1 1\n-1\n012345678901",
            b"PF\n1 1\n1\n012345678901",
            b"PF\n9999999999 9999999999\n-1\n",
        ] {
            assert!(parse(bytes).is_none(), "{bytes:?}");
        }
        assert!(parse(b"PF\n1 1\n-1\n012345678901").is_some());
    }
}
