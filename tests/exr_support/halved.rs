//! A stand-in for the engine, whose results are known: light is halved.

use std::path::Path;

use hush::io::{Selection, WriteOptions, is_complete, read_frame, read_layout, resolve_views, write_views};
use hush::{Aov, Denoised, Frame};

use super::*;

/// A stand-in for the engine with values that half-floats hold exactly.
pub fn halve(frame: &Frame) -> Denoised {
    let half = |a: &ndarray::Array3<f32>| a.mapv(|v| v * 0.5);
    Denoised {
        colour: half(&frame.colour),
        alpha: frame.alpha.as_ref().map(|a| a.mapv(|v| v * 0.5)),
        aovs: frame.aovs.iter().map(|a| Aov { name: a.name.clone(), image: half(&a.image) }).collect(),
    }
}

pub fn denoise(source: &Path, output: &Path, selection: &Selection, options: &WriteOptions) {
    let layout = read_layout(source).unwrap();
    let resolved = resolve_views(&layout, selection).unwrap();
    let denoised: Vec<Denoised> = resolved.iter().map(|r| halve(&read_frame(&layout, r).unwrap())).collect();
    let views: Vec<_> = resolved.iter().zip(&denoised).collect();
    write_views(&layout, &views, options, output).unwrap();
    is_complete(output).unwrap();
}

/// Compares an output with its source: `halved` channels are halved, `kept` ones (name in the output, name in the source) are there
/// as new copies, all others are the same bits.
pub fn compare(source: &Path, output: &Path, halved: impl Fn(&str, &str) -> bool, added: usize, tolerance: f32, what: &str) {
    let ((before, old), (after, new)) = (read(source), read(output));
    let mut changed = 0;
    for ((view, name), (sample, bits)) in &old {
        let (new_sample, new_bits) = &new[&(view.clone(), name.clone())];
        assert_eq!(sample, new_sample, "{what} {name}");
        if !halved(view, name) {
            assert!(bits == new_bits, "{what}: {view} {name} changed");
            continue;
        }
        changed += 1;
        for (&a, &b) in bits.iter().zip(new_bits) {
            let (expected, found) = (float(*sample, a) * 0.5, float(*sample, b));
            assert!((expected - found).abs() <= tolerance, "{what} {name}: {found}, expected {expected}");
        }
    }
    assert!(changed > 0, "{what}: nothing was denoised");
    assert_eq!(new.len(), old.len() + added, "{what}: channels");
    for before in &before.headers {
        // The part for vectors may stand behind the others then.
        let name = &before.own_attributes.layer_name;
        let after = after.headers.iter().find(|h| h.own_attributes.layer_name == *name).expect("a part of that name");
        assert_eq!(before.own_attributes, after.own_attributes, "{what}");
        assert_eq!(before.shared_attributes, after.shared_attributes, "{what}");
        assert_eq!((before.compression, before.line_order, before.blocks), (after.compression, after.line_order, after.blocks));
    }
}

pub fn is_beauty(_: &str, name: &str) -> bool {
    name.contains("Combined")
}
