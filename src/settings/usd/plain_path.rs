//! Paths of layers as people and other programs write them.

use std::path::{Path, PathBuf};

/// The path of a layer without the `\\?\` that real paths begin with on Windows and most other programs refuse.
pub(super) fn plain(layer: impl AsRef<Path>) -> PathBuf {
    let path = layer.as_ref();
    let Some(rest) = path.to_str().and_then(|text| text.strip_prefix(r"\\?\")) else { return path.into() };
    match rest.strip_prefix(r"UNC\") {
        Some(share) => format!(r"\\{share}").into(),
        None if rest.as_bytes().get(1..3) == Some(br":\") => rest.into(),
        None => path.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_drives_and_shares_have_another_name() {
        for (real, expected) in [
            (r"\\?\D:\shots\a b.usda", r"D:\shots\a b.usda"),
            (r"\\?\UNC\server\share\shot.usda", r"\\server\share\shot.usda"),
            (r"\\?\Volume{b75e2c83}\shot.usda", r"\\?\Volume{b75e2c83}\shot.usda"),
            (r"\\server\share\shot.usda", r"\\server\share\shot.usda"),
            (r"D:\shot.usda", r"D:\shot.usda"),
            ("/shots/Ærø/shot.usda", "/shots/Ærø/shot.usda"),
            ("", ""),
        ] {
            assert_eq!(plain(real), Path::new(expected));
        }
    }
}
