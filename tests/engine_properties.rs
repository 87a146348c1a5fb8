//! What must hold for every image, window and λ, whatever the weights; and that neighbours help with the trained ones.

mod engine_support;

use std::sync::LazyLock;

use engine_support::*;
use hush::engine::{Skip, Weights};
use hush::{Denoised, Engine, Error, Frame, Settings};
use ndarray::{Array2, Array3};
use proptest::prelude::*;

static SMALL: LazyLock<Engine> = LazyLock::new(small);

/// A seed, a size, the frames of a run and which of them is denoised.
fn runs() -> impl Strategy<Value = (u64, usize, usize, usize, usize)> {
    (any::<u64>(), 1..20usize, 1..20usize, 1..=7usize)
        .prop_flat_map(|(seed, rows, columns, frames)| (Just(seed), Just(rows), Just(columns), Just(frames), 0..frames))
}

fn lambdas() -> impl Strategy<Value = f32> {
    prop_oneof![Just(1.0f32), Just(64.0), 1.0f32..64.0]
}

/// NaN and infinity at some pixels, none beside another, none in the first row and column.
fn spoil(frame: &mut Frame, seed: u64) {
    let (rows, columns) = frame.size();
    for y in (1..rows).step_by(3) {
        for x in (1..columns).step_by(3) {
            match random(seed ^ 0x99, y, x, 0) {
                v if v < 0.2 => frame.colour[[y, x, 0]] = f32::NAN,
                v if v < 0.4 => frame.colour[[y, x, 2]] = f32::INFINITY,
                _ => {}
            }
        }
    }
}

#[test]
fn alpha_is_filtered_whatever_else_a_frame_has() {
    for (albedo, aov) in [(true, true), (true, false), (false, true), (false, false)] {
        let frame = |seed: u64| {
            let mut frame = if albedo { guided(seed, 24, 40) } else { plain(seed, 24, 40) };
            if aov {
                split(&mut frame, seed, 1);
            }
            frame.alpha = Some(Array2::from_shape_fn((24, 40), |(y, x)| random(seed ^ 0x44, y, x, 0).mul_add(0.5, 0.25)));
            frame
        };
        let frames = encode(&SMALL, (0..3).map(frame));
        let found = denoise(&SMALL, &frames, 1, 1, 1.0).alpha.unwrap();
        assert!(found.iter().all(|a| (0.25 - 1e-5..=0.75 + 1e-5).contains(a)), "albedo {albedo}, light passes {aov}: {found}");
    }
}

#[test]
fn alpha_falls_off_at_an_edge_as_the_albedo_does() {
    // A bright thing of albedo 1 on a transparent film: light is the same all over, albedo and alpha are the coverage.
    let epsilon = Weights::from_bytes("golden", SMALL_MODEL).unwrap().architecture.albedo_epsilon;
    let frame = |seed: u64| {
        let mut frame = guided(seed, 40, 56);
        let cover = Array2::from_shape_fn((40, 56), |(y, x)| {
            (x as f32 / 4.0 - 5.0 + random(seed, y, x, 0) - random(seed ^ 1, y, x, 0)).clamp(0.0, 1.0)
        });
        frame.albedo = Some(Array3::from_shape_fn((40, 56, 3), |(y, x, _)| cover[[y, x]]));
        frame.colour = Array3::from_shape_fn((40, 56, 3), |(y, x, _)| 3.0 * (cover[[y, x]] + epsilon));
        frame.alpha = Some(cover);
        frame
    };
    let frames = encode(&SMALL, (0..5).map(frame));
    let found = denoise(&SMALL, &frames, 2, 2, 1.0);
    let alpha = found.alpha.unwrap();
    assert!(alpha.iter().any(|a| *a > 0.1 && *a < 0.9));
    for ((y, x, c), v) in found.colour.indexed_iter() {
        let expected = 3.0 * (alpha[[y, x]] + epsilon);
        assert!((v - expected).abs() <= 1e-5 * expected, "{y}, {x}, {c}: {v}, expected {expected}");
    }
}

/// The range of each channel over the usable pixels of the frames.
fn hull<'a>(frames: impl IntoIterator<Item = &'a Frame>) -> [(f32, f32); 3] {
    let mut out = [(f32::INFINITY, 0.0f32); 3];
    for frame in frames {
        for pixel in frame.colour.lanes(ndarray::Axis(2)) {
            if pixel.iter().all(|v| v.is_finite()) {
                out.iter_mut().zip(pixel).for_each(|(r, v)| *r = (r.0.min(*v), r.1.max(*v)));
            }
        }
    }
    out
}

fn assert_inside(denoised: &Denoised, hull: [(f32, f32); 3]) {
    for ((y, x, c), v) in denoised.colour.indexed_iter() {
        let (low, high) = hull[c];
        assert!(*v >= low * (1.0 - 1e-5) && *v <= high * (1.0 + 1e-5), "{v} at {y}, {x}, {c} is not in {low}…{high}");
    }
}

/// The largest difference of two results relative to each value.
fn relative(a: &Array3<f32>, b: &Array3<f32>) -> f32 {
    greatest(a.iter().zip(b).map(|(a, b)| (a - b).abs() / a.abs().max(b.abs()).max(f32::MIN_POSITIVE)))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..Default::default() })]

    #[test]
    fn the_output_never_leaves_the_range_of_the_window(
        (seed, rows, columns, count, centre) in runs(), window in 0..=3usize, lambda in lambdas(),
        albedo in proptest::option::of(0.0f32..1.0),
    ) {
        let frames: Vec<Frame> = (0..count as u64).map(|t| {
            let mut frame = plain(seed.wrapping_add(t), rows, columns);
            frame.albedo = albedo.map(|a| Array3::from_elem((rows, columns, 3), a));
            spoil(&mut frame, seed.wrapping_add(t));
            frame
        }).collect();
        let encoded = encode(&SMALL, frames.iter().cloned());
        let denoised = denoise(&SMALL, &encoded, centre, window, lambda);
        assert_sane("convex", &denoised, rows, columns);
        let seen = &frames[centre.saturating_sub(window)..count.min(centre + window + 1)];
        assert_inside(&denoised, hull(seen));
    }

    #[test]
    fn a_constant_stays_constant(
        (seed, rows, columns, count, centre) in runs(), lambda in lambdas(), value in prop::array::uniform3(1e-3f32..1e3),
        albedo in proptest::option::of(0.0f32..1.0),
    ) {
        let frames = (0..count as u64).map(|t| {
            let mut frame = guided(seed.wrapping_add(t), rows, columns);
            frame.colour = Array3::from_shape_fn((rows, columns, 3), |(_, _, c)| value[c]);
            frame.albedo = albedo.map(|a| Array3::from_elem((rows, columns, 3), a));
            frame
        });
        let denoised = denoise(&SMALL, &encode(&SMALL, frames), centre, 3, lambda);
        assert_inside(&denoised, value.map(|v| (v, v)));
    }

    #[test]
    fn brightness_passes_through((seed, rows, columns, count, centre) in runs(), lambda in lambdas(), k in -10..=10i32) {
        let scale = 2.0f32.powi(k);
        let frames: Vec<Frame> = (0..count as u64).map(|t| full(seed.wrapping_add(t), rows, columns)).collect();
        let brighter = frames.iter().cloned().map(|mut f| {
            f.colour *= scale;
            f.aovs.iter_mut().for_each(|a| a.image *= scale);
            f
        });
        let base = denoise(&SMALL, &encode(&SMALL, frames.iter().cloned()), centre, 2, lambda);
        let other = denoise(&SMALL, &encode(&SMALL, brighter), centre, 2, lambda);
        let off = relative(&(&base.colour * scale), &other.colour);
        prop_assert!(off <= 1e-5, "colour off by {off}");
        for (a, b) in base.aovs.iter().zip(&other.aovs) {
            let off = relative(&(&a.image * scale), &b.image);
            prop_assert!(off <= 1e-5, "{} off by {off}", a.name);
        }
    }

    #[test]
    fn alpha_stays_alpha((seed, rows, columns, count, centre) in runs(), lambda in lambdas(), opaque in any::<bool>()) {
        let frames = (0..count as u64).map(|t| {
            let mut frame = full(seed.wrapping_add(t), rows, columns);
            if opaque {
                frame.alpha = Some(Array2::ones((rows, columns)));
            }
            frame
        });
        let denoised = denoise(&SMALL, &encode(&SMALL, frames), centre, 3, lambda);
        assert_sane("alpha", &denoised, rows, columns);
        let alpha = denoised.alpha.unwrap();
        prop_assert_eq!(alpha.dim(), (rows, columns));
        prop_assert!(!opaque || alpha.iter().all(|a| *a > 1.0 - 1e-5));
    }

    #[test]
    fn light_passes_recombine((seed, rows, columns, count, centre) in runs(), lambda in lambdas(), parts in 1..=5usize) {
        let frames = (0..count as u64).map(|t| {
            let mut frame = guided(seed.wrapping_add(t), rows, columns);
            split(&mut frame, seed, parts);
            frame
        });
        let denoised = denoise(&SMALL, &encode(&SMALL, frames), centre, 2, lambda);
        prop_assert_eq!(denoised.aovs.len(), parts);
        for (at, v) in denoised.colour.indexed_iter() {
            let (y, x, _) = at;
            let magnitude = denoised.colour.slice(ndarray::s![y, x, ..]).iter().fold(0.0f32, |m, v| m.max(*v));
            let sum: f32 = denoised.aovs.iter().map(|a| a.image[at]).sum();
            prop_assert!((sum - v).abs() <= 1e-4 * magnitude, "{sum} and {v} at {at:?}");
        }
    }

    #[test]
    fn any_lambda_gives_an_image((seed, rows, columns, count, centre) in runs(), lambda in 1.0f32..=64.0) {
        let frames = (0..count as u64).map(|t| full(seed.wrapping_add(t), rows, columns));
        assert_sane("lambda", &denoise(&SMALL, &encode(&SMALL, frames), centre, 3, lambda), rows, columns);
    }
}

#[test]
fn brightness_passes_through_the_embedded_model_and_so_does_distance() {
    let engine = Engine::new(Settings::default()).unwrap();
    let run = |scale: f32, depth: f32| {
        let frames = (0..5).map(|t| {
            let mut frame = guided(t, 24, 40);
            frame.colour *= scale;
            frame.depth = frame.depth.map(|d| d * depth);
            frame
        });
        denoise(&engine, &encode(&engine, frames), 2, 2, 1.0).colour
    };
    let base = run(1.0, 1.0);
    for k in [-10, -3, 5, 10] {
        let off = relative(&(&base * 2.0f32.powi(k)), &run(2.0f32.powi(k), 1.0));
        assert!(off <= 1e-5, "2^{k}: off by {off}");
    }
    for k in [-40, -10, 3, 20] {
        let off = relative(&base, &run(1.0, 2.0f32.powi(k)));
        assert!(off <= 1e-5, "depth 2^{k}: off by {off}");
    }
}

#[test]
fn lambda_outside_its_range_is_refused_below_and_clamped_above() {
    let frames = encode(&SMALL, (0..3).map(|t| full(t, 13, 21)));
    for lambda in [f32::NAN, 0.5, -1.0, 0.0, f32::NEG_INFINITY, 1.0 - f32::EPSILON] {
        let refused = SMALL.denoise(&frames[1], &around(&frames, 1, 1), lambda);
        assert!(matches!(refused, Err(Error::BadSetting { name: "lambda", .. })), "{lambda}");
    }
    let most = bits(&denoise(&SMALL, &frames, 1, 1, 64.0));
    assert_eq!(bits(&denoise(&SMALL, &frames, 1, 1, 1000.0)), most);
    assert_eq!(bits(&denoise(&SMALL, &frames, 1, 1, f32::INFINITY)), most);
    assert_ne!(bits(&denoise(&SMALL, &frames, 1, 1, 1.0)), most);
}

/// Vectors of an image that moves `step` pixels (right, down) a frame.
fn moving(step: (f32, f32), rows: usize, columns: usize) -> Array3<f32> {
    // Cycles: where the point was, then where it came from in the next frame, y up.
    Array3::from_shape_fn((rows, columns, 4), |(_, _, c)| [-step.0, step.1, -step.0, step.1][c])
}

/// Mean relative error of the inside of an image.
fn error(image: &Array3<f32>, clean: &Array3<f32>) -> f32 {
    let (rows, columns, _) = clean.dim();
    let inside = ndarray::s![12..rows - 12, 12..columns - 12, ..];
    let (image, clean) = (image.slice(inside), clean.slice(inside));
    let sum: f32 = image.iter().zip(&clean).map(|(a, b)| (a - b).abs() / (a.abs() + b.abs() + 0.01)).sum();
    sum / image.len() as f32
}

#[test]
fn neighbours_of_a_moving_pattern_help_and_only_with_the_right_vectors() {
    let engine = Engine::new(Settings::default()).unwrap();
    let (rows, columns, step) = (80, 96, (3.0f32, -2.0f32));
    let clean = |t: i32| {
        Array3::from_shape_fn((rows, columns, 3), |(y, x, c)| {
            let (u, v) = (x as f32 - step.0 * t as f32, y as f32 - step.1 * t as f32);
            let checker = if ((u / 7.0).floor() + (v / 5.0).floor()).rem_euclid(2.0) > 0.5 { 0.8 } else { 0.15 };
            checker * (1.0 + 0.3 * (0.4 * u + c as f32).sin() * (0.3 * v).cos())
        })
    };
    // Independent exponential noise: what one or two samples of a light give.
    let noisy = |t: i32, c: &Array3<f32>| {
        let seed = 1000 + t as u64;
        let light = |y, x| -0.5 * (random(seed, y, x, 0).max(1e-6).ln() + random(seed, y, x, 1).max(1e-6).ln());
        Array3::from_shape_fn(c.dim(), |(y, x, ch)| c[[y, x, ch]] * light(y, x))
    };
    let run = |vectors: Array3<f32>| {
        encode(
            &engine,
            (0..5).map(|t| {
                let mut frame = Frame::new(noisy(t, &clean(t)));
                frame.vector = Some(vectors.clone());
                frame
            }),
        )
    };
    let frames = run(moving(step, rows, columns));
    let truth = clean(2);
    let at = |frames: &[hush::EncodedFrame], window| error(&denoise(&engine, frames, 2, window, 1.0).colour, &truth);
    let (noise, alone, with) = (error(&noisy(2, &truth), &truth), at(&frames, 0), at(&frames, 2));
    let wrong = at(&run(-moving(step, rows, columns)), 2);
    let upside_down = at(&run(moving((step.0, -step.1), rows, columns)), 2);
    let mirrored = at(&run(moving((-step.0, step.1), rows, columns)), 2);
    println!("noisy {noise} window 0 {alone} window 2 {with} wrong {wrong} upside down {upside_down} mirrored {mirrored}");
    assert!(with < alone && alone < noise, "window 2 {with}, window 0 {alone}, noisy {noise}");
    for (what, other) in [("negated", wrong), ("upside down", upside_down), ("mirrored", mirrored)] {
        assert!(with < other, "right {with}, {what} {other}");
    }
}

#[test]
fn a_neighbour_with_an_albedo_is_left_out_where_the_frame_has_none_and_the_other_way_round() {
    let engine = small();
    let frames = |albedos: [bool; 3]| {
        let frame = |(k, has): (usize, bool)| {
            let mut frame = full(7 + k as u64, 24, 32);
            frame.albedo = frame.albedo.filter(|_| has);
            frame
        };
        encode(&engine, albedos.into_iter().enumerate().map(frame))
    };
    let all = frames([true; 3]);
    let of = |albedos: [bool; 3], window: usize| bits(&denoise(&engine, &frames(albedos), 1, window, 1.0));
    assert_ne!(bits(&denoise(&engine, &all, 1, 1, 1.0)), bits(&denoise(&engine, &all, 1, 0, 1.0)));
    assert_eq!(of([false, true, false], 1), of([true, true, true], 0));
    assert_eq!(of([true, false, true], 1), of([false, false, false], 0));
    assert_eq!(of([true, true, false], 1), bits(&engine.denoise(&all[1], &[(-1, &all[0])], 1.0).unwrap()));
}

#[test]
fn a_frame_without_alpha_is_one_with_an_alpha_of_1() {
    for (parts, skip) in [(0, Skip::NONE), (1, Skip::default()), (2, Skip::NONE), (3, Skip::NONE), (5, Skip::default())] {
        let engine = small_skipping(skip);
        // Film that only one of three frames is seen through.
        let frames = |seen_through: usize, opaque: Option<f32>| {
            let frame = |k: usize| {
                let mut frame = guided(31 + k as u64, 24, 40);
                split(&mut frame, 31 + k as u64, parts);
                frame.alpha = opaque.map(|a| Array2::from_elem((24, 40), a));
                if k == seen_through {
                    frame.alpha = Some(Array2::from_shape_fn((24, 40), |(y, x)| random(5, y, x, 0)));
                }
                frame
            };
            encode(&engine, (0..3).map(frame))
        };
        for seen_through in 0..3 {
            let made = denoise(&engine, &frames(seen_through, None), 1, 1, 1.0);
            assert_eq!(bits(&made), bits(&denoise(&engine, &frames(seen_through, Some(1.0)), 1, 1, 1.0)), "{parts} light passes");
            assert_ne!(made.colour, denoise(&engine, &frames(seen_through, None), 1, 0, 1.0).colour, "neighbours help");
        }
        assert!(denoise(&engine, &frames(3, None), 1, 1, 1.0).alpha.is_none());
    }
}
