//! What is left out changes nothing, or no more than its rule says.

mod engine_support;

use engine_support::*;
use hush::engine::{LeftOut, RULES, Rule, SILENT, Skip};
use hush::{Denoised, Engine, Frame};
use ndarray::{Array2, Array3, s};

const CENTRE: usize = 2;

/// The middle frame of five.
fn run(engine: &Engine, frames: &[Frame]) -> (Denoised, LeftOut) {
    let encoded = encode(engine, frames.iter().cloned());
    engine.denoise_with(&encoded[CENTRE], &around(&encoded, CENTRE, 2), 3.0, engine.skip(), SILENT).unwrap()
}

/// With one rule alone, with none, and what was left out.
fn with_and_without(rule: Rule, frames: &[Frame]) -> (Denoised, Denoised, LeftOut) {
    let (with, left_out) = run(&small_skipping(Skip::NONE.with(rule, true)), frames);
    let (without, nothing) = run(&small_skipping(Skip::NONE), frames);
    assert_eq!(nothing, LeftOut::default());
    (with, without, left_out)
}

fn assert_equal(what: &str, a: &Denoised, b: &Denoised) {
    assert!(a.colour == b.colour && a.alpha == b.alpha, "{what}");
    assert!(a.aovs.iter().zip(&b.aovs).all(|(a, b)| a.image == b.image), "{what}: AOVs");
}

/// The largest difference, in steps of float16 at the greater value.
fn half_steps(a: &Denoised, b: &Denoised) -> f32 {
    let values = |d: &Denoised| -> Vec<f32> {
        d.colour.iter().chain(d.alpha.iter().flatten()).chain(d.aovs.iter().flat_map(|a| a.image.iter())).copied().collect()
    };
    let step = |v: f32| if v == 0.0 { f32::MIN_POSITIVE } else { (v.abs().log2().floor() - 10.0).exp2() };
    greatest(values(a).iter().zip(&values(b)).map(|(a, b)| (a - b).abs() / step(a.abs().max(b.abs()))))
}

/// Five frames of a small noisy square on a ground of one colour, which moves by `motion` columns a frame.
fn on_ground(ground: [f32; 3], motion: f32) -> Vec<Frame> {
    let (rows, columns, at) = (280, 420, s![120..150, 60..90, ..]);
    (0..5)
        .map(|t| {
            let mut frame = full(t, rows, columns);
            let noisy = frame.colour.slice(at).to_owned();
            frame.colour = Array3::from_shape_fn((rows, columns, 3), |(_, _, c)| ground[c]);
            frame.colour.slice_mut(at).assign(&noisy);
            frame.albedo = Some(Array3::from_elem((rows, columns, 3), 0.25));
            let mut alpha = Array2::from_elem((rows, columns), f32::from(ground[0] > 0.0));
            alpha.slice_mut(s![120..150, 60..90]).fill(0.7);
            frame.alpha = Some(alpha);
            split(&mut frame, 9, 1);
            frame.vector = Some(Array3::from_shape_fn((rows, columns, 4), |(_, _, c)| [motion, 0.0, -motion, 0.0][c]));
            frame
        })
        .collect()
}

#[test]
fn flat_ground_keeps_its_pixels() {
    for (ground, motion) in [([0.0; 3], 0.0), ([0.0; 3], 5.5), ([0.3, 0.02, 7.0], -2.25)] {
        let (with, without, left_out) = with_and_without(Rule::Constant, &on_ground(ground, motion));
        assert!(left_out.constant > 0.3, "{left_out:?}");
        let steps = half_steps(&with, &without);
        assert!(steps <= 0.5, "{ground:?}: {steps} steps");
        assert!(ground[0] > 0.0 || with.colour.slice(s![.., 300.., ..]).iter().all(|v| *v == 0.0));
        assert!(
            with.colour.slice(s![120..150, 60..90, ..]) == without.colour.slice(s![120..150, 60..90, ..]),
            "what is computed"
        );
    }
}

#[test]
fn a_frame_without_anything_is_not_computed() {
    let frames = vec![Frame::new(Array3::zeros((70, 90, 3))); 5];
    let (with, without, left_out) = with_and_without(Rule::Constant, &frames);
    assert_eq!(left_out.constant, 1.0);
    assert_equal("black", &with, &without);
}

#[test]
fn what_a_moving_neighbour_brings_is_seen_from_afar() {
    // Only the next frame has a light, and the vectors lead to it.
    let mut frames = vec![Frame::new(Array3::from_elem((280, 420, 3), 0.5)); 5];
    frames.iter_mut().for_each(|f| f.vector = Some(Array3::from_shape_fn((280, 420, 4), |(_, _, c)| [0.0, 0.0, -200.0, 0.0][c])));
    frames[CENTRE + 1].colour.slice_mut(s![140..150, 300..310, ..]).fill(50.0);
    let (with, without, left_out) = with_and_without(Rule::Constant, &frames);
    assert!((0.2..1.0).contains(&left_out.constant), "{left_out:?}");
    assert!(half_steps(&with, &without) <= 0.5);
    assert!(without.colour.slice(s![140..150, 100..110, ..]).iter().any(|v| *v > 0.51), "the light is found where it was");
}

#[test]
fn noise_a_bad_pixel_and_a_strange_neighbour_are_not_taken_for_flat() {
    type Change = fn(&mut [Frame]);
    let changes: [Change; 5] = [
        |f| f[CENTRE].colour[[100, 300, 1]] = 0.51,
        |f| f[CENTRE].colour[[100, 300, 1]] = f32::NAN,
        |f| f[CENTRE + 2].colour[[100, 300, 1]] = f32::INFINITY,
        |f| f[CENTRE - 1].albedo.as_mut().unwrap()[[100, 300, 1]] = 0.26,
        |f| f[CENTRE - 1].alpha.as_mut().unwrap()[[100, 300]] = 0.99,
    ];
    for (i, change) in changes.into_iter().enumerate() {
        let mut frames = vec![Frame::new(Array3::from_elem((280, 420, 3), 0.5)); 5];
        for frame in &mut frames {
            frame.albedo = Some(Array3::from_elem((280, 420, 3), 0.25));
            frame.alpha = Some(Array2::ones((280, 420)));
            frame.vector = Some(Array3::zeros((280, 420, 4)));
        }
        change(&mut frames);
        let (with, without, left_out) = with_and_without(Rule::Constant, &frames);
        assert!((0.1..0.95).contains(&left_out.constant), "change {i}: {left_out:?}");
        assert!(half_steps(&with, &without) <= 0.5, "change {i}");
    }
}

#[test]
fn exact_rules_are_exact() {
    let moving: Vec<Frame> = (0..5).map(|t| full(t, 61, 83)).collect();
    let with = |change: &dyn Fn(&mut Frame)| {
        let mut frames = moving.clone();
        frames.iter_mut().for_each(change);
        frames
    };
    let still = with(&|f| f.vector.as_mut().unwrap().fill(0.0));
    let opaque = with(&|f| f.alpha.as_mut().unwrap().fill(1.0));
    let without_aovs = with(&|f| {
        f.alpha.as_mut().unwrap().fill(1.0);
        f.aovs.clear();
    });
    let gone = with(&|f| f.vector.as_mut().unwrap().fill(1e9));
    for (rule, frames, expected) in [
        (Rule::Still, &still, LeftOut { still: 4, ..LeftOut::default() }),
        (Rule::Opaque, &opaque, LeftOut { alpha: true, ..LeftOut::default() }),
        (Rule::Opaque, &without_aovs, LeftOut { alpha: true, ..LeftOut::default() }),
        (Rule::Untrusted, &gone, LeftOut { untrusted: 4, ..LeftOut::default() }),
    ] {
        let (a, mut b, left_out) = with_and_without(rule, frames);
        assert_eq!(left_out, expected);
        if rule == Rule::Opaque {
            // A weighted average of ones is one up to rounding.
            let alpha = b.alpha.as_mut().unwrap();
            assert!(alpha.iter().all(|a| (a - 1.0).abs() < 1e-6));
            alpha.fill(1.0);
        }
        assert_equal(&rule.to_string(), &a, &b);
        let (_, _, nothing) = with_and_without(rule, &moving);
        assert_eq!(nothing, LeftOut::default(), "{rule}: nothing to leave out where everything moves");
    }
}

#[test]
fn the_rules_together_hold_their_bound() {
    let all = RULES.into_iter().fold(Skip::NONE, |skip, rule| skip.with(rule, true));
    assert_eq!(all, Skip::default());
    let frames = on_ground([0.25, 0.5, 1.0], 0.0);
    let (with, left_out) = run(&small_skipping(all), &frames);
    let (without, _) = run(&small_skipping(Skip::NONE), &frames);
    assert!(left_out.constant > 0.3 && left_out.still == 4);
    assert!(half_steps(&with, &without) <= 0.5);
}

#[test]
fn frames_that_were_looked_at_tell_what_may_be_left_out_and_cannot_be_denoised() {
    let frame = full(1, 61, 83);
    let engine = small();
    let looked = engine.look(&frame).unwrap();
    let encoded = engine.encode(frame).unwrap();
    assert!(engine.denoise(&looked, &[], 1.0).unwrap_err().to_string().contains("looked at"));
    assert!(engine.denoise(&encoded, &[(1, &looked)], 1.0).is_err());
    assert_eq!(engine.left_out(&looked, &[], Skip::default()), engine.left_out(&encoded, &[], Skip::default()));
    assert!(engine.footprint(&encoded, &[]).window >= looked.bytes());
}

#[test]
fn neighbours_without_a_pixel_are_counted_before_anything_is_computed() {
    let mut frames: Vec<Frame> = (0..5).map(|t| full(t, 61, 83)).collect();
    frames.iter_mut().for_each(|f| f.vector.as_mut().unwrap().fill(1e9));
    let engine = small();
    let encoded = encode(&engine, frames);
    let around = around(&encoded, CENTRE, 2);
    let before = engine.left_out(&encoded[CENTRE], &around, Skip::default());
    assert_eq!(before.untrusted, 4);
    assert_eq!(engine.denoise_with(&encoded[CENTRE], &around, 1.0, engine.skip(), SILENT).unwrap().1, before);
}

#[test]
fn a_bad_colour_leaves_an_alpha_of_1_as_it_is() {
    let spoilt = |opaque: Option<f32>, alpha: Option<f32>| {
        let frames = (0..5).map(|t| {
            let mut frame = full(t, 61, 83);
            frame.alpha = opaque.map(|a| Array2::from_elem((61, 83), a));
            frame.colour.slice_mut(s![20..24, 30..34, 0]).fill(f32::NAN);
            frame.alpha.iter_mut().zip(alpha).for_each(|(to, alpha)| to[[40, 40]] = alpha);
            frame
        });
        run(&small(), &frames.collect::<Vec<Frame>>())
    };
    let ((with, left_out), (without, _)) = (spoilt(Some(1.0), None), spoilt(None, None));
    assert!(left_out.alpha && with.alpha.unwrap().iter().all(|a| *a == 1.0));
    assert!(with.colour == without.colour, "a frame without alpha is one with an alpha of 1");
    for alpha in [f32::NAN, 0.999] {
        assert!(!spoilt(Some(1.0), Some(alpha)).1.alpha, "{alpha}");
    }
}
