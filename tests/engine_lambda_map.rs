//! λ for each pixel: the constants' results where it is constant, the same bits whatever the tiles, and no surprise from bad values.

mod engine_support;

use engine_support::*;
use hush::engine::{Isa, Skip, Weights};
use hush::internals::{Body, kernel_reach};
use hush::{Denoised, Dial, EncodedFrame, Engine, Error, LambdaMap, LambdaMask};
use ndarray::{Array2, ArrayView3, s};

/// How far a map's result may be off the constant's, relative to the brightest of the values compared in each channel's pixel: the
/// order of roundings differs before the kernels' softmax.
const BOUND: f32 = 2e-4;

fn map(rows: usize, columns: usize, lambda: impl Fn(usize, usize) -> f32) -> LambdaMap {
    LambdaMap::new(Array2::from_shape_fn((rows, columns), |(y, x)| lambda(y, x)).view(), 1.0).unwrap()
}

fn by<'d>(engine: &Engine, frames: &[EncodedFrame], centre: usize, lambda: impl Into<Dial<'d>>) -> Denoised {
    engine.denoise(&frames[centre], &around(frames, centre, 2), lambda).unwrap()
}

/// Pixels around a pixel in which another λ may change it, at most.
fn reach() -> usize {
    let weights = Weights::from_bytes("golden", SMALL_MODEL).unwrap();
    let a = &weights.architecture;
    let kernels = kernel_reach([a.centre_taps, a.neighbour_taps, a.coarse_taps, a.albedo_taps], a.levels);
    2 * Body::new(&weights).unwrap().halo(kernels)
}

/// The largest difference relative to the greater value.
fn apart(a: ArrayView3<f32>, b: ArrayView3<f32>) -> f32 {
    greatest(a.iter().zip(b).map(|(a, b)| (a - b).abs() / a.abs().max(b.abs()).max(1e-6)))
}

#[test]
fn a_constant_map_gives_the_constants_bits() {
    let engine = small();
    let frames = encode(&engine, (0..3).map(|t| full(t, 37, 51)));
    for lambda in [1.0, 3.7, 64.0] {
        assert_eq!(bits(&by(&engine, &frames, 1, &map(37, 51, |_, _| lambda))), bits(&by(&engine, &frames, 1, lambda)));
    }
}

#[test]
fn each_side_of_a_border_is_as_its_own_constant_would_have_it() {
    let (rows, columns, border) = (40, 520, 260);
    let reach = reach();
    assert!(reach < border - 60, "{reach}");
    let engine = small();
    let frames = encode(&engine, (0..3).map(|t| full(t, rows, columns)));
    for (left, right) in [(1.0, 64.0), (64.0, 1.0), (2.5, 2.6)] {
        let both = by(&engine, &frames, 1, &map(rows, columns, |_, x| if x < border { left } else { right }));
        let [of_left, of_right] = [left, right].map(|lambda| by(&engine, &frames, 1, lambda));
        let (near, far) = (s![.., ..border - reach, ..], s![.., border + reach.., ..]);
        let worst = apart(both.colour.slice(near), of_left.colour.slice(near))
            .max(apart(both.colour.slice(far), of_right.colour.slice(far)));
        assert!(worst <= BOUND, "{left} and {right}: {worst}");
        // The two sides do differ: the comparison above says something.
        let other = apart(both.colour.slice(near), of_right.colour.slice(near));
        assert!(other > if left == 2.5 { 10.0 * worst } else { 0.01 }, "{left} and {right}: {other}");
    }
}

#[test]
fn the_embedded_weights_keep_to_the_bound_too() {
    let engine = Engine::new(hush::Settings::default()).unwrap();
    let (rows, columns) = (24, 560);
    let frames = encode(&engine, (0..3).map(|t| guided(t, rows, columns)));
    let near = s![.., ..columns - 300, ..];
    for lambda in [1.0, 5.0, 64.0] {
        // One pixel far away keeps the map from being taken for a constant.
        let mapped = by(&engine, &frames, 1, &map(rows, columns, |_, x| if x + 1 == columns { 20.0 } else { lambda }));
        let worst = apart(mapped.colour.slice(near), by(&engine, &frames, 1, lambda).colour.slice(near));
        assert!(worst > 0.0 && worst <= BOUND, "λ {lambda}: {worst}");
    }
}

#[test]
fn tiles_threads_and_instruction_sets_do_not_change_the_bits() {
    let (rows, columns) = (40, 520);
    let wild = |y: usize, x: usize| 64f32.powf(random(5, y / 3, x / 7, 0));
    let whole = |engine: &Engine| {
        let frames = encode(engine, (0..3).map(|t| full(t, rows, columns)));
        bits(&by(engine, &frames, 1, &map(rows, columns, wild)))
    };
    let expected = whole(&small());
    for memory in [0, 1 << 20, 12 << 20] {
        assert!(whole(&small_with(None, Some(memory))) == expected, "{memory} bytes a tile");
    }
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool.install(|| whole(&small())) == expected, "{threads} threads");
    }
    for isa in Isa::available().into_iter().filter(|isa| *isa != Isa::Portable && small().isa() != Isa::Portable) {
        assert!(whole(&small_with(Some(isa), None)) == expected, "{isa:?}");
    }
}

#[test]
fn a_map_of_another_size_is_refused() {
    let engine = small();
    let frame = engine.encode(plain(1, 20, 30)).unwrap();
    for (rows, columns) in [(20, 31), (30, 20), (24, 32), (1, 1)] {
        let found = engine.denoise(&frame, &[], &map(rows, columns, |_, x| 1.0 + x as f32));
        assert!(matches!(found, Err(Error::SizeMismatch { rows: 20, columns: 30, .. })), "{columns}×{rows}");
    }
}

#[test]
fn a_map_changes_nothing_where_all_pixels_are_alike() {
    let (rows, columns) = (280, 420);
    let mut frames: Vec<_> = (0..3).map(|t| plain(t, rows, columns)).collect();
    for frame in &mut frames {
        frame.colour.slice_mut(s![.., 60.., ..]).fill(0.25);
        frame.vector.as_mut().unwrap().fill(0.0);
    }
    let wild = map(rows, columns, |y, x| 64f32.powf(random(5, y, x, 0)));
    let run = |skip| {
        let engine = small_skipping(skip);
        let frames = encode(&engine, frames.iter().cloned());
        engine.denoise_with(&frames[1], &around(&frames, 1, 1), &wild, skip, hush::engine::SILENT).unwrap()
    };
    let ((with, left_out), (without, _)) = (run(Skip::default()), run(Skip::NONE));
    assert!(left_out.constant > 0.2, "{left_out:?}");
    // Half a step of float16 is what the rule may be off.
    assert!(apart(with.colour.view(), without.colour.view()) <= 1.0 / 2048.0);
    assert!(with.colour.slice(s![.., 300.., ..]).iter().all(|v| *v == 0.25));
}

#[test]
fn a_mask_travels_with_its_frame() {
    let (rows, columns) = (45, 67);
    let engine = small();
    let mask = Array2::from_shape_fn((rows, columns), |(y, x)| [0.0, 0.25, 1.0, f32::NAN][(y / 4 + x / 5) % 4]);
    let frames = encode(
        &engine,
        (0..3).map(|t| {
            let mut frame = full(t, rows, columns);
            frame.lambda_mask = Some(mask.clone());
            frame
        }),
    );
    let found = by(&engine, &frames, 1, &frames[1].lambda_mask().unwrap().mix(2.0, 32.0).unwrap());
    let values = |y: usize, x: usize| 2.0 * 16f32.powf(if mask[[y, x]].is_nan() { 0.0 } else { mask[[y, x]] });
    let mapped = by(&engine, &frames, 1, &map(rows, columns, values));
    assert!(apart(found.colour.view(), mapped.colour.view()) <= BOUND);
    // Nothing marked is the constant, to the last bit.
    let nothing = LambdaMask::new(Array2::zeros((rows, columns)).view()).mix(2.0, 32.0).unwrap();
    assert_eq!(bits(&by(&engine, &frames, 1, &nothing)), bits(&by(&engine, &frames, 1, 2.0)));
    let mut other = full(1, rows, columns);
    other.lambda_mask = Some(Array2::zeros((rows, columns + 1)));
    assert!(matches!(engine.encode(other), Err(Error::SizeMismatch { .. })));
}

#[test]
fn hostile_maps_and_masks_give_an_image() {
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 0.0, 0.5, 1e30, f32::MIN_POSITIVE, 64.0, 1.0];
    for isa in Isa::available() {
        let engine = small_with(Some(isa), None);
        for (rows, columns) in [(1, 1), (1, 17), (17, 1), (7, 9), (33, 40)] {
            let frames = encode(&engine, (0..3).map(|t| full(t, rows, columns)));
            let any = |y: usize, x: usize| bad[(random(3, y, x, rows) * 10.0) as usize % bad.len()];
            assert_sane("map", &by(&engine, &frames, 1, &map(rows, columns, any)), rows, columns);
            let mask = LambdaMask::new(Array2::from_shape_fn((rows, columns), |(y, x)| any(y, x)).view());
            assert_sane("mask", &by(&engine, &frames, 1, &mask.mix(1.0, 64.0).unwrap()), rows, columns);
        }
    }
}
