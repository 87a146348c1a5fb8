//! The same bits whatever the threads, the tiles, the order of neighbours, and what was denoised before.

mod engine_support;

use engine_support::*;
use hush::engine::Isa;
use hush::engine::Weights;
use hush::internals::Body;
use hush::internals::kernel_reach;
use hush::internals::{Rect, Tile, tiles};
use hush::{Denoised, Engine, Frame};
use ndarray::{Array3, Axis, ShapeBuilder};

/// A frame with every pass, and with bad colours and wild vectors here and there.
fn damaged(seed: u64, rows: usize, columns: usize) -> Frame {
    let mut frame = full(seed, rows, columns);
    let chance = |y, x| (random(seed ^ 0x88, y, x, 0) * 200.0) as usize;
    frame.colour.indexed_iter_mut().for_each(|((y, x, _), v)| match chance(y, x) {
        0 => *v = f32::NAN,
        1 => *v = 1e6,
        _ => {}
    });
    frame.vector.iter_mut().flat_map(|v| v.indexed_iter_mut()).for_each(|((y, x, c), v)| match chance(y, x) {
        2 => *v = f32::NAN,
        3 => *v = f32::INFINITY,
        4 => *v = 300.0 * (c as f32 - 1.5),
        _ => {}
    });
    frame
}

fn sequence(rows: usize, columns: usize, count: u64) -> Vec<Frame> {
    (0..count).map(|t| damaged(t, rows, columns)).collect()
}

fn middle(engine: &Engine, rows: usize, columns: usize, window: usize) -> Denoised {
    denoise(engine, &encode(engine, sequence(rows, columns, 2 * window as u64 + 1)), window, window, 3.0)
}

fn assert_same(what: &str, a: &Denoised, b: &Denoised) {
    let (a, b) = (bits(a), bits(b));
    assert_eq!(a.len(), b.len(), "{what}");
    let differing = a.iter().zip(&b).filter(|(a, b)| a != b).count();
    assert_eq!(differing, 0, "{what}: {differing} of {} values differ", a.len());
}

/// The smallest tiles that the small model's engine can cut a frame into.
fn smallest_tiles(rows: usize, columns: usize) -> Vec<Tile> {
    let weights = Weights::from_bytes("golden", SMALL_MODEL).unwrap();
    let a = &weights.architecture;
    let reach = kernel_reach([a.centre_taps, a.neighbour_taps, a.coarse_taps, a.albedo_taps], a.levels);
    let halo = Body::new(&weights).unwrap().halo(reach);
    let (rows, columns) = (rows.next_multiple_of(8) / 2, columns.next_multiple_of(8) / 2);
    tiles(Rect { row: 0, column: 0, rows, columns }, rows, columns, halo, 0)
}

#[test]
fn threads_do_not_change_the_result() {
    let engine = small();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| middle(&engine, 61, 83, 2))
    };
    let one = on(1);
    for threads in [2, 5] {
        assert_same(&format!("{threads} threads"), &one, &on(threads));
    }
}

#[test]
fn tiles_do_not_change_the_result() {
    for (rows, columns, window, at_least) in
        [(232, 280, 1, 2), (40, 520, 3, 3), (520, 40, 1, 3), (333, 555, 1, 6), (9, 1001, 0, 4)]
    {
        let cut = smallest_tiles(rows, columns);
        assert!(cut.len() >= at_least, "{columns}×{rows}: {} tiles", cut.len());
        let whole = middle(&small(), rows, columns, window);
        for memory in [0, 1 << 20, 12 << 20] {
            let tiled = middle(&small_with(None, Some(memory)), rows, columns, window);
            assert_same(&format!("{columns}×{rows}, {memory} bytes a tile"), &whole, &tiled);
        }
    }
    // Without a tile whose region is less than the frame the comparison above would say nothing.
    assert!(smallest_tiles(40, 520).iter().all(|t| t.region.columns < 260));
    assert!(smallest_tiles(333, 555).iter().all(|t| t.region.area() < 168 * 280));
}

#[test]
fn tiles_do_not_change_the_result_of_the_embedded_model() {
    let engine = |memory| Engine::new(hush::Settings { memory, ..Default::default() }).unwrap();
    assert_same("one tile and many", &middle(&engine(None), 40, 520, 1), &middle(&engine(Some(0)), 40, 520, 1));
}

#[test]
fn a_frame_is_the_same_twice_and_in_a_chunk() {
    let engine = small();
    let run = encode(&engine, sequence(29, 45, 9));
    let first = denoise(&engine, &run, 4, 2, 1.0);
    denoise(&engine, &run, 5, 3, 40.0);
    // Buffers that larger, smaller and brighter frames leave behind have no say either.
    for (rows, columns) in [(90, 110), (3, 5), (29, 45)] {
        let other = (0..3).map(|t| {
            let mut frame = full(100 + t, rows, columns);
            frame.colour.fill(1e35);
            frame.depth = None;
            frame
        });
        denoise(&engine, &encode(&engine, other), 1, 1, 64.0);
    }
    assert_same("again", &first, &denoise(&engine, &run, 4, 2, 1.0));
    let chunk = encode(&small(), sequence(29, 45, 9).into_iter().skip(2).take(5));
    assert_same("in a chunk", &first, &denoise(&engine, &chunk, 2, 2, 1.0));
}

#[test]
fn one_engine_serves_several_threads() {
    let engine = small();
    let run = encode(&engine, sequence(37, 41, 5));
    let expected: Vec<Denoised> = (0..5).map(|t| denoise(&engine, &run, t, 2, 1.0)).collect();
    std::thread::scope(|scope| {
        for thread in 0..3 {
            let (engine, run, expected) = (&engine, &run, &expected);
            scope.spawn(move || {
                for t in (0..5).map(|t| (t + 2 * thread) % 5) {
                    assert_same("beside others", &expected[t], &denoise(engine, run, t, 2, 1.0));
                }
            });
        }
    });
}

#[test]
fn neighbours_come_in_any_order() {
    let engine = small();
    let run = encode(&engine, sequence(21, 34, 7));
    let mut neighbours = around(&run, 3, 3);
    assert_eq!(neighbours.len(), 6);
    let expected = engine.denoise(&run[3], &neighbours, 1.0).unwrap();
    for turn in 0..6 {
        neighbours.rotate_left(1);
        if turn % 2 == 0 {
            neighbours.reverse();
        }
        assert_same("turned", &expected, &engine.denoise(&run[3], &neighbours, 1.0).unwrap());
    }
}

#[test]
fn strides_do_not_matter() {
    let engine = small();
    let frame = full(5, 18, 27);
    let columns_first = |image: &Array3<f32>| {
        let mut out = Array3::zeros(image.dim().f());
        out.assign(image);
        out
    };
    let mut other = frame.clone();
    other.colour = columns_first(&frame.colour);
    other.albedo = frame.albedo.as_ref().map(columns_first);
    other.vector = frame.vector.as_ref().map(|v| {
        let mut backwards = v.clone();
        backwards.invert_axis(Axis(0));
        let mut out = backwards.as_standard_layout().to_owned();
        out.invert_axis(Axis(0));
        out
    });
    other.aovs.iter_mut().for_each(|a| a.image = columns_first(&a.image));
    assert_eq!(frame.vector, other.vector);
    let neighbour = engine.encode(full(6, 18, 27)).unwrap();
    let run = |frame: Frame| engine.denoise(&engine.encode(frame).unwrap(), &[(1, &neighbour)], 1.0).unwrap();
    assert_same("strides", &run(frame), &run(other));
}

#[test]
fn instruction_sets_agree() {
    let on = |isa| middle(&small_with(Some(isa), None), 43, 75, 2);
    let portable = on(Isa::Portable);
    let available = Isa::available();
    for isa in &available {
        let found = on(*isa);
        for (a, b) in portable.colour.iter().zip(&found.colour) {
            assert!((a - b).abs() <= 1e-4 * a.abs().max(b.abs()), "{isa:?}: {a} and {b}");
        }
    }
    if available.contains(&Isa::Avx512) {
        assert_same("AVX2 and AVX-512", &on(Isa::Avx2), &on(Isa::Avx512));
    }
    if available.contains(&Isa::Neon) {
        assert_same("the portable path, which has FMA there, and NEON", &portable, &on(Isa::Neon));
    }
}
