//! A rendered EXR file: described, read, and written again with its own pixels as the denoised ones.

use std::path::Path;

use hush::io::{
    Layout, Resolved, Selection, WriteOptions, inspect, is_complete, read_frame, read_layout, resolve, resolve_views, write_views,
};
use hush::{Denoised, Frame};
use ndarray::Array3;

use super::{named, put};

/// The largest half-float number; what is greater is clamped.
const MOST_HALF: f32 = 65504.0;

/// The input is the file.
pub fn check(folder: &Path, bytes: &[u8]) -> hush::Result<()> {
    let (source, output) = (folder.join("frame.exr"), folder.join("out.exr"));
    let _ = std::fs::remove_file(&output);
    put(&source, bytes);
    let layout = named(&source, read_layout(&source))?;
    let inspection = named(&source, inspect(&source))?;
    assert!(!inspection.describe().is_empty());
    serde_json::to_string(&inspection).expect("an inspection is JSON");
    let written = named(&source, write_again(&layout, &output));
    assert_eq!(written.is_ok(), output.exists(), "an output stands exactly where writing went well");
    let left = std::fs::read_dir(folder).expect("the folder is there").count();
    assert_eq!(left, 1 + usize::from(written.is_ok()), "nothing else is left behind");
    for (resolved, frame) in written? {
        assert_same(&layout, &resolved, &frame, &output);
    }
    Ok(())
}

/// Reads every view layer with all its light passes, or only the default one where that is all that can be read.
fn write_again(layout: &Layout, output: &Path) -> hush::Result<Vec<(Resolved, Frame)>> {
    let all = Selection { layers: vec!["all".into()], aovs: vec!["all".into()], ..Selection::default() };
    let views = resolve_views(layout, &all).or_else(|_| resolve(layout, &Selection::default()).map(|one| vec![one]))?;
    let frames = views.iter().map(|view| read_frame(layout, view)).collect::<hush::Result<Vec<Frame>>>()?;
    let denoised: Vec<Denoised> =
        frames.iter().map(|f| Denoised { colour: f.colour.clone(), alpha: f.alpha.clone(), aovs: f.aovs.clone() }).collect();
    let options = WriteOptions { keep_noisy: true, attributes: vec![("hush.fuzz".into(), "1".into())] };
    write_views(layout, &views.iter().zip(&denoised).collect::<Vec<_>>(), &options, output)?;
    Ok(views.into_iter().zip(frames).collect())
}

/// The output is whole, of the same size, and without lossy compression it has the same pixels.
fn assert_same(layout: &Layout, resolved: &Resolved, frame: &Frame, output: &Path) {
    is_complete(output).expect("an output is whole");
    let written = read_layout(output).expect("an output has a header");
    let selection = Selection { layers: vec![resolved.layer.clone()], view: resolved.view.clone(), ..Selection::default() };
    let again = resolve(&written, &selection).expect("an output has the passes of its source");
    let colour = read_frame(&written, &again).expect("an output can be read").colour;
    assert_eq!(colour.dim(), frame.colour.dim(), "an output has the size of its source");
    if !layout.lossy {
        assert_pixels(&frame.colour, &colour);
    }
}

fn assert_pixels(before: &Array3<f32>, after: &Array3<f32>) {
    for ((at, a), b) in before.indexed_iter().zip(after) {
        assert!(!(a.abs() <= MOST_HALF) || a == b, "{a} became {b} at {at:?}");
    }
}
