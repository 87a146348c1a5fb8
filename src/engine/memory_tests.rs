//! Whose memory is whose.

use ndarray::Array3;

use super::*;
use crate::frame::Frame;

fn frame() -> Frame {
    Frame::new(Array3::from_shape_fn((256, 384, 3), |(y, x, c)| ((y * 31 + x * 7 + c) % 17) as f32 / 8.0))
}

#[test]
fn each_engine_keeps_its_own_memory_and_gives_it_back() {
    let (one, other) = (Engine::new(Settings::default()).unwrap(), Engine::new(Settings::default()).unwrap());
    let encoded = one.encode(frame()).unwrap();
    let first = one.denoise(&encoded, &[], 1.0).unwrap();
    let kept = one.buffers.kept_bytes();
    assert!(kept > 0, "a frame leaves its buffers");
    assert_eq!(other.buffers.kept_bytes(), 0, "to the engine that it was made with only");
    // The other engine denoises in memory of its own; the frame stays the first one's.
    assert_eq!(other.denoise(&encoded, &[], 1.0).unwrap().colour, first.colour);
    assert!(other.buffers.kept_bytes() > 0);
    assert_eq!(one.buffers.kept_bytes(), kept);
    drop(encoded);
    assert!(one.buffers.kept_bytes() > kept, "the frame goes back to its engine");
    let kept = other.buffers.kept_bytes();
    one.release_memory();
    assert_eq!((one.buffers.kept_bytes(), other.buffers.kept_bytes()), (0, kept));
}

#[test]
fn what_is_kept_serves_the_next_frame() {
    let engine = Engine::new(Settings::default()).unwrap();
    let run = || {
        let encoded = engine.encode(frame()).unwrap();
        engine.denoise(&encoded, &[], 1.0).unwrap();
        drop(encoded);
        engine.buffers.kept_bytes()
    };
    let kept = run();
    assert_eq!((run(), run()), (kept, kept));
}

#[test]
fn a_frame_outlives_its_engine() {
    let encoded = Engine::new(Settings::default()).unwrap().encode(frame()).unwrap();
    let engine = Engine::new(Settings::default()).unwrap();
    engine.denoise(&encoded, &[], 1.0).unwrap();
}
