//! `hush-manifest.json` as a run and a check read it, beside outputs that it may or may not describe.

use std::path::Path;

use hush::io::sequence::Sequence;
use hush::shot::{Job, MANIFEST, Manifest, Plan, SequenceCheck};

use super::{named, put};

/// A rendered frame of a few pixels.
const FRAME: &[u8] = include_bytes!("../../tests/corpus/frame_file/valid/one_pass.exr");

/// The input is the manifest.
pub fn check(folder: &Path, bytes: &[u8]) -> hush::Result<()> {
    let (shot, output) = (folder.join("shot"), folder.join("out"));
    for frame in [shot.join("f_0001.exr"), shot.join("f_0002.exr"), output.join("f_0001.exr")] {
        if !frame.exists() {
            std::fs::create_dir_all(frame.parent().expect("it is in a folder")).expect("the folder can be written to");
            put(&frame, FRAME);
        }
    }
    let path = output.join(MANIFEST);
    put(&path, bytes);
    let job = Job::new(Sequence::find(&[&shot])?, &output);
    if let Ok(plan) = Plan::new(&job) {
        serde_json::to_string(&plan).expect("a plan is JSON");
    }
    let checked = named(&path, SequenceCheck::new().check(&job));
    let manifest = named(&path, Manifest::load(&output))?;
    serde_json::to_string(&checked?).expect("a check is JSON");
    let text = serde_json::to_string(&manifest).expect("a manifest is JSON");
    let again: Manifest = serde_json::from_str(&text).expect("and can be read again");
    assert_eq!(serde_json::to_string(&again).expect("a manifest is JSON"), text);
    Ok(())
}
