//! Frames that no renderer should write: a clear error or a sane image, never a panic.

mod engine_support;

use std::sync::LazyLock;

use engine_support::*;
use hush::engine::Isa;
use hush::engine::Weights;
use hush::{Aov, Denoised, EncodedFrame, Engine, Error, Frame, Settings};
use ndarray::{Array2, Array3};

static SMALL: LazyLock<Engine> = LazyLock::new(small);
/// One engine for each instruction set: they treat NaN in minima and maxima differently.
static ENGINES: LazyLock<Vec<(Isa, Engine)>> =
    LazyLock::new(|| Isa::available().into_iter().map(|isa| (isa, small_with(Some(isa), None))).collect());

fn alone(frame: Frame) -> Denoised {
    SMALL.denoise(&SMALL.encode(frame).unwrap(), &[], 1.0).unwrap()
}

/// Denoises the middle of five frames that `change` has been at, and checks that an image comes out.
fn survives(what: &str, rows: usize, columns: usize, change: impl Fn(usize, &mut Frame)) {
    let frames: Vec<Frame> = (0..5)
        .map(|t| {
            let mut frame = full(t as u64, rows, columns);
            change(t, &mut frame);
            frame
        })
        .collect();
    for (isa, engine) in ENGINES.iter() {
        let frames = encode(engine, frames.iter().cloned());
        for (window, lambda) in [(0, 1.0), (2, 1.0), (2, 64.0)] {
            let what = format!("{what}, window {window}, λ {lambda}, {isa:?}");
            assert_sane(&what, &denoise(engine, &frames, 2, window, lambda), rows, columns);
        }
    }
}

const SIZES: [(usize, usize); 12] =
    [(1, 1), (1, 2), (1, 17), (17, 1), (2, 2), (7, 9), (8, 8), (9, 17), (1, 300), (300, 1), (3, 33), (64, 65)];

#[test]
fn every_size_works() {
    for (rows, columns) in SIZES {
        survives(&format!("{columns}×{rows}"), rows, columns, |_, _| {});
    }
}

/// Whether a frame's pixel, (frame, row, column), is spoilt.
type Pattern = fn(usize, usize, usize) -> bool;
/// Gives a frame a pass of a number of rows and columns.
type Change = fn(&mut Frame, usize, usize);

/// Whose pixels are spoilt: some of all frames, all of the centre, all of the neighbours, all.
fn patterns() -> [(&'static str, Pattern); 4] {
    [
        ("scattered", |t, y, x| random(t as u64 ^ 0xabc, y, x, 0) < 0.3),
        ("centre", |t, _, _| t == 2),
        ("neighbours", |t, _, _| t != 2),
        ("everywhere", |_, _, _| true),
    ]
}

/// Runs every value at every pattern on the image of a frame that `of` picks.
fn spoil_each(what: &str, values: &[f32], of: impl Fn(&mut Frame) -> &mut Array3<f32>) {
    for value in values {
        for (name, at) in patterns() {
            survives(&format!("{what} {value} {name}"), 11, 19, |t, frame| {
                let channels = of(frame).dim().2;
                // One channel of every pixel and all of others.
                of(frame).indexed_iter_mut().filter(|((y, x, c), _)| at(t, *y, *x) && (c + y + x) % channels < 2).for_each(
                    |(_, v)| {
                        *v = *value;
                    },
                );
            });
        }
    }
}

const ODD: [f32; 13] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    -100.0,
    0.0,
    1e30,
    f32::MAX,
    f32::MIN,
    1e-30,
    1e-40,
    f32::MIN_POSITIVE,
    1e4,
    1e9,
];

#[test]
fn odd_colours_give_an_image() {
    spoil_each("colour", &ODD, |f| &mut f.colour);
}

#[test]
fn odd_albedo_gives_an_image() {
    spoil_each("albedo", &ODD, |f| f.albedo.as_mut().unwrap());
}

#[test]
fn odd_normals_give_an_image() {
    spoil_each("normal", &[100.0, -100.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e-40], |f| f.normal.as_mut().unwrap());
}

#[test]
fn odd_vectors_give_an_image() {
    let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e9, -1e9, f32::MAX, 40.0, -40.0, 0.49999997, -0.5, 1e-40];
    spoil_each("vector", &values, |f| f.vector.as_mut().unwrap());
}

#[test]
fn odd_light_passes_give_an_image() {
    spoil_each("light pass", &ODD, |f| &mut f.aovs[1].image);
}

#[test]
fn odd_depth_and_alpha_give_an_image() {
    for value in ODD.into_iter().chain([1e10, -1.0, 9.99e8, f32::from_bits(1)]) {
        for (name, at) in patterns() {
            let put = |t: usize, image: &mut Array2<f32>| {
                image.indexed_iter_mut().filter(|((y, x), _)| at(t, *y, *x)).for_each(|(_, v)| *v = value);
            };
            survives(&format!("depth {value} {name}"), 11, 19, |t, f| put(t, f.depth.as_mut().unwrap()));
            survives(&format!("alpha {value} {name}"), 11, 19, |t, f| put(t, f.alpha.as_mut().unwrap()));
        }
    }
}

#[test]
fn everything_odd_at_once_gives_an_image() {
    survives("everything", 13, 22, |t, f| {
        let seed = t as u64 ^ 0xdef;
        let odd = |y, x, c: usize, salt: usize| ODD[(random(seed, y, x, c + 10 * salt) * 12.99) as usize];
        f.colour.indexed_iter_mut().for_each(|((y, x, c), v)| *v = odd(y, x, c, 0));
        for (salt, image) in [&mut f.albedo, &mut f.normal, &mut f.vector].into_iter().flatten().enumerate() {
            image.indexed_iter_mut().for_each(|((y, x, c), v)| *v = odd(y, x, c, 1 + salt));
        }
        for (salt, image) in [&mut f.depth, &mut f.alpha].into_iter().flatten().enumerate() {
            image.indexed_iter_mut().for_each(|((y, x), v)| *v = odd(y, x, 0, 5 + salt));
        }
        f.aovs.iter_mut().for_each(|a| a.image.indexed_iter_mut().for_each(|((y, x, c), v)| *v = odd(y, x, c, 7)));
    });
}

#[test]
fn black_and_bad_frames_stay_black() {
    for value in [0.0, f32::NAN, f32::NEG_INFINITY, -5.0] {
        let image = alone(Frame::new(Array3::from_elem((21, 13, 3), value))).colour;
        assert!(image.iter().all(|v| *v == 0.0), "{value}");
    }
}

#[test]
fn a_lone_light_stays_where_it_is() {
    let mut colour = Array3::zeros((120, 120, 3));
    colour[[60, 60, 1]] = 50.0;
    let image = alone(Frame::new(colour)).colour;
    assert_sane("lone light", &Denoised { colour: image.clone(), alpha: None, aovs: Vec::new() }, 120, 120);
    assert!(image.sum() > 0.0);
    assert!(image.indexed_iter().all(|((_, _, c), v)| c == 1 || *v == 0.0), "light in another channel");
    assert!(image.indexed_iter().all(|((y, x, _), v)| *v == 0.0 || (y.abs_diff(60).max(x.abs_diff(60)) <= 37)), "too far");
}

#[test]
fn a_bad_pixel_matters_nowhere_else() {
    // Where the first blocks are constant, the exposure is the same with and without the pixel, to the last bit.
    let image = |bad: Option<f32>| {
        let mut frame = guided(3, 24, 320);
        frame.colour.slice_mut(ndarray::s![.., ..32, ..]).fill(0.5);
        frame.depth = Some(Array2::from_elem((24, 320), 4.0));
        if let Some(bad) = bad {
            frame.colour[[5, 6, 1]] = bad;
        }
        alone(frame).colour
    };
    let clean = image(None);
    let infinite = image(Some(f32::INFINITY));
    assert_eq!(infinite, image(Some(f32::NAN)));
    assert_eq!(infinite, image(Some(f32::NEG_INFINITY)));
    let far = ndarray::s![.., 128.., ..];
    assert_eq!(infinite.slice(far), clean.slice(far), "the network's reach is less than 96 pixels");
    let worst = infinite.slice(ndarray::s![.., ..20, ..]).iter().fold(0.0f32, |m, v| m.max(*v));
    assert!(worst < 1000.0 && infinite.iter().all(|v| v.is_finite()));
}

#[test]
fn a_hole_of_bad_pixels_is_filled_as_deep_as_the_coarsest_kernels_reach() {
    for (wide, filled) in [(20, true), (31, true), (60, false)] {
        for at in 30..34 {
            let mut frame = Frame::new(Array3::from_elem((124, 124, 3), 0.25));
            let hole = at..at + wide;
            frame.colour.slice_mut(ndarray::s![at..at + wide, at..at + wide, ..]).fill(f32::NAN);
            for ((y, x, _), v) in alone(frame).colour.indexed_iter() {
                let inside = hole.contains(&y) && hole.contains(&x);
                let depth = if inside { (y + 1 - at).min(at + wide - y).min(x + 1 - at).min(at + wide - x) } else { 0 };
                let deep = !filled && depth > 14;
                assert!((v - 0.25).abs() < 1e-5 || (deep && *v == 0.0), "{v} at {y}, {x} in a hole of {wide} from {at}");
            }
        }
    }
}

fn at<'a>(offsets: &[i32], frames: &'a [EncodedFrame]) -> Vec<(i32, &'a EncodedFrame)> {
    offsets.iter().copied().zip(frames).collect()
}

#[test]
fn neighbours_that_do_not_fit_are_left_out() {
    let (rows, columns) = (19, 26);
    let centre = SMALL.encode(full(0, rows, columns)).unwrap();
    let expected = bits(&SMALL.denoise(&centre, &[], 1.0).unwrap());
    let same = |what: &str, frame: Frame| {
        let pair = encode(&SMALL, [frame.clone(), frame]);
        let found = SMALL.denoise(&centre, &at(&[-1, 1], &pair), 1.0).unwrap();
        assert_eq!(bits(&found), expected, "{what}");
    };
    same("another size", full(1, rows, columns + 1));
    same("another size, the same padded", full(1, rows + 1, columns));
    same("turned", full(1, columns, rows));
    let changed = |change: &dyn Fn(&mut Frame)| {
        let mut frame = full(1, rows, columns);
        change(&mut frame);
        frame
    };
    same("a light pass less", changed(&|f| f.aovs.truncate(1)));
    same("light passes in another order", changed(&|f| f.aovs.reverse()));
    same("another light pass", changed(&|f| f.aovs[0].name = "Other".into()));
    let two = encode(&SMALL, [full(1, rows, columns), full(2, rows, columns)]);
    for offsets in [[0, 0], [-2, 2], [4, -4], [3, -3], [i32::MIN, i32::MAX]] {
        let found = SMALL.denoise(&centre, &at(&offsets, &two), 1.0).unwrap();
        assert_eq!(bits(&found), expected, "offsets {offsets:?}");
    }
    let used = SMALL.denoise(&centre, &at(&[-1, 1], &two), 1.0).unwrap();
    assert_ne!(bits(&used), expected, "neighbours that fit are used");
}

#[test]
fn without_vectors_there_is_no_way_to_a_neighbour() {
    let still = |seed| {
        let mut frame = full(seed, 15, 15);
        frame.vector = None;
        frame
    };
    let others = encode(&SMALL, [full(1, 15, 15), full(2, 15, 15), full(3, 15, 15)]);
    let centre = SMALL.encode(still(0)).unwrap();
    assert!(!centre.has_vectors());
    let expected = bits(&SMALL.denoise(&centre, &[], 1.0).unwrap());
    assert_eq!(bits(&SMALL.denoise(&centre, &at(&[-1, 1, 2], &others), 1.0).unwrap()), expected);
    // A frame between without vectors ends the chain.
    let centre = SMALL.encode(full(0, 15, 15)).unwrap();
    let between = SMALL.encode(still(4)).unwrap();
    let near = SMALL.denoise(&centre, &[(1, &between)], 1.0).unwrap();
    let far = SMALL.denoise(&centre, &[(1, &between), (2, &others[0]), (3, &others[1])], 1.0).unwrap();
    assert_eq!(bits(&near), bits(&far));
}

#[test]
fn wrong_sizes_and_channels_are_refused() {
    let refused = |what: &str, frame: Frame| match SMALL.encode(frame) {
        Err(error) => error,
        Ok(_) => panic!("{what} was taken"),
    };
    for size in [(0, 0), (0, 5), (5, 0)] {
        let error = refused("nothing", Frame::new(Array3::zeros((size.0, size.1, 3))));
        assert!(matches!(error, Error::BadInput { .. }), "{error}");
    }
    for channels in [0, 1, 2, 4] {
        let error = refused("colour", Frame::new(Array3::zeros((4, 4, channels))));
        assert!(matches!(&error, Error::BadInput { input, .. } if input == "colour"), "{error}");
    }
    let changes: [(&str, Change); 6] = [
        ("albedo", |f, r, c| f.albedo = Some(Array3::zeros((r, c, 3)))),
        ("normal", |f, r, c| f.normal = Some(Array3::zeros((r, c, 3)))),
        ("vector", |f, r, c| f.vector = Some(Array3::zeros((r, c, 4)))),
        ("depth", |f, r, c| f.depth = Some(Array2::zeros((r, c)))),
        ("alpha", |f, r, c| f.alpha = Some(Array2::zeros((r, c)))),
        ("Emission", |f, r, c| f.aovs.push(Aov { name: "Emission".into(), image: Array3::zeros((r, c, 3)) })),
    ];
    for (pass, change) in changes {
        for (rows, columns) in [(0, 0), (7, 8), (8, 7), (16, 16), (1, 64)] {
            let mut frame = Frame::new(Array3::zeros((8, 8, 3)));
            change(&mut frame, rows, columns);
            let error = refused(pass, frame);
            assert!(matches!(&error, Error::SizeMismatch { what, .. } if what == pass), "{error}");
        }
    }
    let mut frame = Frame::new(Array3::zeros((8, 8, 3)));
    frame.vector = Some(Array3::zeros((8, 8, 2)));
    let error = refused("vector of two channels", frame);
    assert!(matches!(&error, Error::BadInput { input, .. } if input == "vector"), "{error}");
}

#[test]
fn every_mix_of_guides_works() {
    let with = |seed: u64, mix: usize| {
        let mut frame = full(seed, 9, 17);
        frame.albedo = frame.albedo.filter(|_| mix & 1 != 0);
        frame.normal = frame.normal.filter(|_| mix & 2 != 0);
        frame.depth = frame.depth.filter(|_| mix & 4 != 0);
        frame.vector = frame.vector.filter(|_| mix & 8 != 0);
        frame
    };
    let mut seen = std::collections::HashSet::new();
    for mix in 0..16 {
        let alike = denoise(&SMALL, &encode(&SMALL, (0..5).map(|t| with(t, mix))), 2, 2, 1.0);
        assert_sane(&format!("guides {mix:04b}"), &alike, 9, 17);
        seen.insert(bits(&alike));
        let unlike = encode(&SMALL, (0..5).map(|t| with(t, if t == 2 { mix } else { 15 - mix } | 8)));
        assert_sane(&format!("guides {mix:04b} between others"), &denoise(&SMALL, &unlike, 2, 2, 1.0), 9, 17);
    }
    assert_eq!(seen.len(), 16, "each guide has a say");
}

#[test]
fn a_frame_encoded_for_another_network_is_refused() {
    let other = Engine::from_weights(&Weights::embedded().unwrap(), Settings::default()).unwrap();
    let (own, foreign) = (SMALL.encode(full(0, 9, 9)).unwrap(), other.encode(full(1, 9, 9)).unwrap());
    assert!(matches!(SMALL.denoise(&foreign, &[], 1.0), Err(Error::BadInput { .. })));
    assert!(matches!(SMALL.denoise(&own, &[(1, &foreign)], 1.0), Err(Error::BadInput { .. })));
}
