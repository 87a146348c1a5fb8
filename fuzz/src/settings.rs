//! The settings of a shot, in `hush.toml` and in a USD stage.

use std::path::Path;

use hush::settings::{Layered, StageRef, read_settings_file, usd};

use super::{named, put};

/// The input is a `hush.toml`.
pub fn check_file(folder: &Path, bytes: &[u8]) -> hush::Result<()> {
    let path = folder.join("hush.toml");
    put(&path, bytes);
    named(&path, read_settings_file(&path)).map(|file| assert_passed_on(&file.settings))
}

/// The input is a layer: `.usdc` or `.usdz` where it begins as one, else text.
pub fn check_stage(folder: &Path, bytes: &[u8]) -> hush::Result<()> {
    let file = folder.join(match bytes {
        [b'P', b'X', b'R', ..] => "stage.usdc",
        [b'P', b'K', ..] => "stage.usdz",
        _ => "stage.usda",
    });
    put(&file, bytes);
    named(&file, usd::read(&StageRef { file: file.clone(), prim: None })).map(|settings| assert_passed_on(&settings))
}

/// The process that reads a stage passes the settings on as JSON.
fn assert_passed_on(settings: &Layered) {
    let text = serde_json::to_string(settings).expect("settings are JSON");
    assert_eq!(serde_json::from_str::<Layered>(&text).expect("and can be read again"), *settings);
    assert!(settings.given().all(|name| !settings.values.get(name).is_null()));
}
