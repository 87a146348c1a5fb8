//! Fewer pyramid levels: still weighted averages, and the same whatever is left out.

mod engine_support;

use engine_support::*;
use hush::rules::skip::Skip;
use hush::{Engine, Frame, Settings};

const CENTRE: usize = 2;

fn frames() -> Vec<Frame> {
    (0..5)
        .map(|t| {
            let mut frame = full(t, 61, 83);
            (frame.albedo, frame.alpha) = (None, None);
            frame.aovs.clear();
            frame
        })
        .collect()
}

#[test]
fn every_number_of_levels_stays_within_the_pixels_range() {
    let engine = small();
    let frames = frames();
    let all = || frames.iter().flat_map(|f| f.colour.iter().copied());
    let (low, high) = (all().fold(f32::INFINITY, f32::min), all().fold(0.0f32, f32::max));
    let encoded = encode(&engine, frames.iter().cloned());
    let by_levels: Vec<_> = (1..=4)
        .map(|levels| {
            let around = around(&encoded, CENTRE, 2);
            let (out, _) = engine.denoise_with(&encoded[CENTRE], &around, 2.0, (Skip::NONE, levels)).unwrap();
            assert!(out.colour.iter().all(|v| *v >= low * 0.9999 && *v <= high * 1.0001), "{levels} levels leave the range");
            out
        })
        .collect();
    assert!(by_levels.windows(2).all(|two| two[0].colour != two[1].colour));
    let full = small_skipping(Skip::NONE).denoise(&encoded[CENTRE], &around(&encoded, CENTRE, 2), 2.0).unwrap();
    assert!(full.colour == by_levels[3].colour, "four levels are the default");
}

#[test]
fn a_flat_frame_stays_flat_at_every_level() {
    let engine = small();
    let flat = Frame::new(ndarray::Array3::from_elem((40, 56, 3), 0.37));
    let encoded = engine.encode(flat).unwrap();
    for levels in 1..=4 {
        let (out, _) = engine.denoise_with(&encoded, &[], 1.0, (Skip::NONE, levels)).unwrap();
        assert!(out.colour.iter().all(|v| (v / 0.37 - 1.0).abs() < 1e-5), "{levels}");
    }
}

#[test]
fn other_numbers_are_refused_and_frames_that_were_looked_at_too() {
    for levels in [0, 5] {
        let error = Engine::new(Settings { levels, ..Settings::default() }).err().unwrap().to_string();
        assert!(error.contains("levels"), "{error}");
    }
    let engine = small();
    let frame = frames().remove(0);
    let looked = engine.look(&frame).unwrap();
    let encoded = engine.encode(frame).unwrap();
    assert!(engine.denoise_with(&encoded, &[], 1.0, (Skip::NONE, 0)).is_err());
    assert!(engine.denoise(&looked, &[], 1.0).unwrap_err().to_string().contains("looked at"));
    assert!(engine.denoise(&encoded, &[(1, &looked)], 1.0).is_err());
    assert_eq!(engine.left_out(&looked, &[], Skip::default()), engine.left_out(&encoded, &[], Skip::default()));
    assert!(engine.footprint(&encoded, &[]).window >= looked.bytes());
}

#[test]
fn neighbours_without_a_pixel_are_counted_before_anything_is_computed() {
    let mut frames = frames();
    frames.iter_mut().for_each(|f| f.vector.as_mut().unwrap().fill(1e9));
    let engine = small();
    let encoded = encode(&engine, frames);
    let around = around(&encoded, CENTRE, 2);
    let before = engine.left_out(&encoded[CENTRE], &around, Skip::default());
    assert_eq!(before.untrusted, 4);
    assert_eq!(engine.denoise_and_tell(&encoded[CENTRE], &around, 1.0).unwrap().1, before);
}
