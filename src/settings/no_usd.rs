//! Stands in for the USD reader in a build without the feature `usd`.

#[path = "usd/stage_ref.rs"]
mod stage_ref;

use std::path::Path;

pub use stage_ref::StageRef;

use super::layered::Layered;
use crate::error::{Error, Result};

const ADVICE: &str = "this build of hush reads and writes no USD (it was built without the feature usd): put the settings into \
                      hush.toml beside the frames, which carries all of them";

/// Reads no stage.
///
/// # Errors
/// Always, saying what to do instead.
pub fn read(stage: &StageRef) -> Result<Layered> {
    Err(Error::bad_file(&stage.file, ADVICE))
}

/// Writes no layer.
///
/// # Errors
/// Always, saying what to do instead.
pub fn write(path: &Path, _: &Layered, _: Option<&str>, _: Option<&Path>) -> Result<String> {
    Err(Error::bad_file(path, ADVICE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_says_where_the_settings_can_go() {
        let message = read(&"shot.usda".parse().unwrap()).unwrap_err().to_string();
        assert!(message.contains("shot.usda") && message.contains("hush.toml"), "{message}");
    }
}
