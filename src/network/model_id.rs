//! Which weights made a frame.

use std::path::Path;
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

/// The weights file that this build carries.
pub const EMBEDDED: &[u8] = include_bytes!("../../models/hush.safetensors");

/// Which weights an engine has.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelId {
    /// A file name, or `embedded`.
    pub name: String,
    /// FNV-1a of the file's bytes (64 bits, hexadecimal).
    pub hash: Option<String>,
}

impl ModelId {
    /// The weights in this program.
    pub fn embedded() -> Self {
        static HASH: LazyLock<String> = LazyLock::new(|| fnv(EMBEDDED));
        Self { name: "embedded".into(), hash: Some(HASH.clone()) }
    }

    /// A weights file that was read.
    pub(crate) fn of_bytes(path: &Path, bytes: &[u8]) -> Self {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        Self { name, hash: Some(fnv(bytes)) }
    }
}

/// FNV-1a, 64 bits: tells files apart, guards against nothing.
fn fnv(bytes: &[u8]) -> String {
    let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3));
    format!("{hash:016x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fnv_is_the_published_one() {
        assert_eq!(fnv(b""), "cbf29ce484222325");
        assert_eq!(fnv(b"foobar"), "85944171f73967e8");
    }
}
