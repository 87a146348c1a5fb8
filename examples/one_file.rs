//! One EXR file to a denoised one: the same layers, passes, metadata and compression, with only the beauty's pixels changed.
//!
//!     cargo run --release --example one_file -- [INPUT.exr OUTPUT.exr]

use std::path::PathBuf;

use hush::io::{Selection, WriteOptions, is_complete, read_frame, read_layout, resolve, write_denoised};
use hush::{Engine, Settings};

fn main() -> hush::Result<()> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let sample = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("samples/shot/frame_0004.exr");
    let input = arguments.next().unwrap_or_else(sample);
    let output = arguments.next().unwrap_or_else(|| std::env::temp_dir().join("hush_one_file.exr"));

    // The header says what is there; `resolve` decides what is used of it, and an error names what is missing.
    let layout = read_layout(&input)?;
    let passes = resolve(&layout, &Selection::default())?;
    println!("{}: {}×{}, denoising {}", input.display(), layout.columns, layout.rows, passes.colour.label());
    for guide in &passes.missing {
        println!("without {}: {}", guide.pass, guide.advice);
    }

    // Only the passes that are used are decoded.
    let frame = read_frame(&layout, &passes)?;
    let engine = Engine::new(Settings::default())?;
    let denoised = engine.denoise(&engine.encode(frame)?, &[], 1.0)?;

    // The rendered file is never written to. The new one stands there whole or not at all.
    let options = WriteOptions { keep_noisy: true, ..WriteOptions::default() };
    write_denoised(&layout, &passes, &denoised, &options, &output)?;
    is_complete(&output)?;
    println!("wrote {}, with the noisy beauty beside the denoised one", output.display());
    Ok(())
}
