//! The second pass over time: what it depends on, that it stays an average, and that a shot in parts gives what the whole one gives.

mod common;
mod engine_support;

use std::path::PathBuf;

use common::{Look, Shot, name, write_mask};
use engine_support::{SMALL_MODEL, around, bits, denoise, encode, full, noise, plain, small, small_of, small_skipping};
use hush::engine::{SILENT, Skip, Weights};
use hush::io::Selection;
use hush::io::sequence::Sequence;
use hush::preview::{Request, preview};
use hush::settings::{Guide, Lambda};
use hush::shot::{CancelToken, FrameState, Job, Scope, SequenceCheck, StaleKind, Status};
use hush::{Denoised, EncodedFrame, Engine, FirstPass, Frame, Settings};
use ndarray::{Array2, Array3};

/// A shot with an engine whose weights have a second pass.
fn shot(numbers: std::ops::RangeInclusive<i64>) -> Shot {
    let mut shot = Shot::new(numbers, Look::default());
    std::fs::write(weights(&shot), SMALL_MODEL).unwrap();
    shot.engine = Engine::from_file(&weights(&shot), Settings { second_pass: true, ..Settings::default() }).unwrap();
    assert!(shot.engine.has_second_pass());
    shot
}

fn weights(shot: &Shot) -> PathBuf {
    shot.dir.path().join("second.safetensors")
}

fn job(shot: &Shot) -> Job {
    shot.job().with(|s| (s.model, s.second_pass) = (Some(weights(shot)), Some(true)))
}

/// The job for some frames of which only some files are there, with an output folder of its own.
fn part(shot: &Shot, label: &str, frames: &str, files: std::ops::RangeInclusive<i64>) -> Job {
    let folder = shot.dir.path().join(label);
    std::fs::create_dir(&folder).unwrap();
    files.for_each(|n| _ = std::fs::copy(shot.input(n), folder.join(name(n))).unwrap());
    let job = Job::new(Sequence::find(&[folder]).unwrap(), shot.dir.path().join(format!("{label} out")));
    job.with(|s| {
        (s.model, s.frames, s.second_pass) = (Some(weights(shot)), Some(frames.parse().unwrap()), Some(true));
    })
}

/// The bytes of a job's output of a frame.
fn made(job: &Job, number: i64) -> Vec<u8> {
    std::fs::read(job.output.join(name(number))).unwrap()
}

/// The first passes of a run of frames.
fn passes(engine: &Engine, frames: &[EncodedFrame], window: usize) -> Vec<FirstPass> {
    let pass = |n: usize| engine.first_pass(&frames[n], &around(frames, n, window), 2.0, SILENT).unwrap().0;
    (0..frames.len()).map(pass).collect()
}

/// The second pass of one of a run of frames.
fn second(engine: &Engine, passes: &[FirstPass], centre: usize, window: usize) -> Denoised {
    let near = passes.iter().enumerate().map(|(n, pass)| (n as i32 - centre as i32, pass));
    let near: Vec<(i32, &FirstPass)> = near.filter(|(o, _)| *o != 0 && o.unsigned_abs() as usize <= window).collect();
    engine.second_pass(&passes[centre], &near)
}

#[test]
fn a_chunk_with_twice_the_window_around_it_is_bit_equal_to_one_run() {
    let shot = shot(1..=14);
    let keyed = |job: Job| job.with(|s| s.lambda = Some(Lambda::keyed([(1.0, 1.0), (14.0, 20.0)]).unwrap()));
    let whole = keyed(job(&shot));
    assert!(shot.run(&whole).summary().is_complete());
    let chunk = keyed(part(&shot, "chunk", "6-8", 2..=12));
    let outcome = shot.run(&chunk);
    assert_eq!((outcome.log.with(Status::Denoised), outcome.log.neighbours(7)), (vec![6, 7, 8], vec![3, 4, 5, 6, 8, 9, 10, 11]));
    (6..=8).for_each(|n| assert!(made(&chunk, n) == made(&whole, n), "frame {n}"));
    let narrow = keyed(part(&shot, "narrow", "6-8", 4..=10));
    assert!(shot.run(&narrow).summary().is_complete());
    assert!(made(&narrow, 6) != made(&whole, 6), "the frames beyond the window have no say");
    // One frame alone, and frames in two goes.
    let single = keyed(part(&shot, "single", "7", 3..=11));
    shot.run(&single);
    assert!(made(&single, 7) == made(&whole, 7));
    let gaps = keyed(part(&shot, "gaps", "1,4,9,14", 1..=14));
    shot.run(&gaps);
    [1, 4, 9, 14].into_iter().for_each(|n| assert!(made(&gaps, n) == made(&whole, n), "frame {n}"));
}

#[test]
fn runs_one_after_another_give_what_one_run_gives() {
    let shot = shot(1..=9);
    shot.run(&job(&shot));
    let mut runner = hush::shot::Runner::new(&shot.engine);
    let one_by_one = part(&shot, "one by one", "1-9", 1..=9);
    for n in [1, 2, 3, 5, 4, 6, 7, 8, 9] {
        let job = one_by_one.clone().with(|s| s.frames = Some(n.to_string().parse().unwrap()));
        let summary = runner.run(&job, &|_| {}, &CancelToken::new()).unwrap();
        assert_eq!(summary.written, 1);
        assert!(made(&one_by_one, n) == std::fs::read(shot.output(n)).unwrap(), "frame {n}");
    }
}

#[test]
fn what_changed_between_two_runs_is_read_again() {
    let shot = shot(1..=9);
    let mut runner = hush::shot::Runner::new(&shot.engine);
    let kept = job(&shot).with(|s| s.frames = Some("5".parse().unwrap()));
    runner.run(&kept, &|_| {}, &CancelToken::new()).unwrap();
    let before = made(&kept, 5);
    shot.render_again(7);
    assert_eq!(runner.run(&kept, &|_| {}, &CancelToken::new()).unwrap().written, 1);
    let fresh = |job: &Job| {
        let job = Job { output: shot.dir.path().join("fresh"), ..job.clone() };
        assert!(shot.run(&job).summary().is_complete());
        made(&job, 5)
    };
    let again = made(&kept, 5);
    assert!(again == fresh(&kept) && again != before);
    let unguided = kept.clone().with(|s| s.guides = Some(vec![Guide::Vector]));
    assert_eq!(runner.run(&unguided, &|_| {}, &CancelToken::new()).unwrap().written, 1);
    assert!(made(&unguided, 5) == fresh(&unguided) && made(&unguided, 5) != again);
}

#[test]
fn a_change_anywhere_in_the_two_windows_makes_a_frame_stale() {
    let shot = shot(1..=12);
    let usual = job(&shot);
    shot.run(&usual);
    let stale = |job: &Job| -> Vec<i64> {
        let checked = SequenceCheck::new().check(job).unwrap();
        checked.frames.iter().filter(|f| f.state == FrameState::Stale).map(|f| f.frame).collect()
    };
    assert_eq!(stale(&usual), [0; 0]);
    // λ of frame 5 alone: its own pass, and those of the frames that its result helps.
    let keyed = Lambda::keyed([(4.0, 1.0), (5.0, 3.0), (6.0, 1.0)]).unwrap();
    let other = usual.clone().with(|s| s.lambda = Some(keyed.clone()));
    assert_eq!(stale(&other), [3, 4, 5, 6, 7]);
    shot.render_again(3);
    assert_eq!(stale(&usual), [1, 2, 3, 4, 5, 6, 7]);
    let again = shot.run(&usual);
    assert_eq!(again.log.with(Status::Denoised), [1, 2, 3, 4, 5, 6, 7]);
    assert_eq!(stale(&usual), [0; 0]);
    let entry = &shot.manifest().frames[&name(6)];
    assert_eq!(entry.neighbours.iter().map(|n| n.offset).collect::<Vec<_>>(), [-4, -3, -2, -1, 1, 2, 3, 4]);
    let dials: Vec<Option<f32>> = entry.neighbours.iter().map(|n| n.dial.as_ref().map(|d| d.lambda)).collect();
    assert_eq!(dials, [None, None, Some(1.0), Some(1.0), Some(1.0), Some(1.0), None, None]);
}

#[test]
fn bad_and_missing_frames_do_not_stop_the_others() {
    let shot = shot(1..=9);
    shot.truncate(5);
    std::fs::remove_file(shot.input(8)).unwrap();
    let outcome = shot.run(&job(&shot));
    assert_eq!(outcome.log.with(Status::Denoised), [1, 2, 3, 4, 6, 7, 9]);
    assert_eq!(outcome.log.neighbours(4), [1, 2, 3], "what lies behind a bad frame is out of reach");
    assert_eq!((outcome.log.neighbours(6), outcome.log.neighbours(9)), (vec![7], vec![]));
    // As if the frames behind the bad one were not there.
    let without = part(&shot, "without", "1-4", 1..=4);
    shot.run(&without);
    (1..=4).for_each(|n| assert!(made(&without, n) == std::fs::read(shot.output(n)).unwrap(), "frame {n}"));
}

#[test]
fn a_frame_that_only_helps_needs_no_mask_and_is_told_where_one_does_not_fit() {
    let shot = shot(1..=7);
    let masks = shot.dir.path().join("masks");
    std::fs::create_dir(&masks).unwrap();
    let mask = |n: i64| masks.join(format!("m_{n:04}.exr"));
    let right = |_: usize, x: usize| if x > 11 { 1.0 } else { 0.0 };
    write_mask(&mask(4), Look::default(), false, right);
    let masked = |job: Job| job.with(|s| s.lambda_images = Some(masks.join("m_####.exr")));
    let alone = masked(part(&shot, "alone", "4", 1..=7));
    let outcome = shot.run(&alone);
    assert!(outcome.summary().is_complete() && outcome.log.errors.is_empty(), "{:?}", outcome.log);
    // The frames beside it have a mask that marks nothing, which is the same.
    let even = masked(part(&shot, "even", "4", 1..=7));
    (1..=7).filter(|n| *n != 4).for_each(|n| write_mask(&mask(n), Look::default(), false, |_, _| 0.0));
    let stale = |job: &Job| SequenceCheck::new().check(job).unwrap().frames[0].kind;
    assert_eq!(stale(&alone), Some(StaleKind::Neighbours), "a mask that came later counts");
    assert!(shot.run(&even).summary().is_complete());
    assert!(made(&even, 4) == made(&alone, 4));
    assert_eq!(stale(&even), None);
    // One that does not fit: the frame is made without that result, says so, and is made again once it fits.
    let small = Look { columns: 12, ..Look::default() };
    write_mask(&mask(5), small, false, right);
    for _ in 0..2 {
        let outcome = shot.run(&even);
        assert_eq!((outcome.summary().failed.len(), outcome.summary().degraded.as_slice()), (0, &[4][..]));
    }
    assert_eq!(stale(&even), None, "nothing is gained by trying again");
    write_mask(&mask(5), Look::default(), false, |_, _| 0.0);
    assert_eq!(stale(&even), Some(StaleKind::Neighbours));
    assert!(shot.run(&even).summary().is_complete());
    assert!(made(&even, 4) == made(&alone, 4));
    // A frame that fails for want of its mask helps the others all the same.
    std::fs::remove_file(mask(5)).unwrap();
    let both = masked(part(&shot, "both", "4-5", 1..=7));
    let outcome = shot.run(&both);
    assert_eq!((outcome.summary().failed.as_slice(), outcome.log.neighbours(4).contains(&5)), (&[5][..], true));
    assert_eq!(outcome.log.errors.iter().filter(|(n, text)| *n == Some(5) && text.contains("m_0005.exr")).count(), 1);
    assert!(made(&both, 4) == made(&alone, 4));
}

#[test]
fn a_preview_shows_both_passes() {
    let shot = shot(1..=9);
    let sequence = Sequence::find(&[shot.folder()]).unwrap();
    let scope = Scope::open(&sequence, &Selection::default(), None, Some(2), 0).unwrap();
    let frames = encode(&shot.engine, (1..=9).map(|n| scope.read(n).unwrap().remove(0)));
    let expected = second(&shot.engine, &passes(&shot.engine, &frames, 2), 4, 2);
    let request =
        Request { frame: 5, lambdas: vec![2.0], lambda_masked: None, windows: vec![0, 2], region: None, flicker: false };
    let found = preview((&sequence, &Selection::default()), &request, &shot.engine, &|_| (), &CancelToken::new()).unwrap();
    let [alone, both] = &found.layers[0].variants[..] else { panic!("two windows") };
    assert!(both.colour == expected.colour && both.neighbours == [1, 2, 3, 4, 6, 7, 8, 9]);
    assert!(alone.colour == denoise(&shot.engine, &frames, 4, 0, 2.0).colour && alone.neighbours.is_empty());
}

#[test]
fn a_frame_alone_and_a_window_of_0_have_one_pass() {
    let shot = shot(1..=5);
    let alone = part(&shot, "alone", "3", 3..=3);
    shot.run(&alone);
    let zero = job(&shot).with(|s| s.window = Some(0));
    let outcome = shot.run(&zero);
    assert_eq!(outcome.log.neighbours(3), [0; 0]);
    assert!(shot.manifest().frames[&name(3)].neighbours.is_empty());
    let engine = small();
    let frames = encode(&engine, [plain(3, 21, 35)]);
    let pass = || passes(&engine, &frames, 0).remove(0);
    let one = denoise(&engine, &frames, 0, 0, 2.0);
    assert_eq!(bits(&pass().denoised()), bits(&one));
    assert_eq!(bits(&engine.second_pass(&pass(), &[])), bits(&one));
}

#[test]
fn weights_that_do_not_say_so_have_one_pass() {
    let mut model = SMALL_MODEL.to_vec();
    let said = b"\\\"second_pass\\\":1";
    let at = model.windows(said.len()).position(|w| w == said).unwrap();
    model[at + said.len() - 1] = b'0';
    let engine = Engine::from_weights(
        &Weights::from_bytes("one pass", &model).unwrap(),
        Settings { second_pass: true, ..Settings::default() },
    )
    .unwrap();
    assert!(!engine.has_second_pass());
    let frames = encode(&engine, (0..3).map(|t| plain(t, 24, 40)));
    let passes = passes(&engine, &frames, 1);
    assert_eq!(bits(&second(&engine, &passes, 1, 1)), bits(&denoise(&engine, &frames, 1, 1, 2.0)));
}

#[test]
fn threads_tiles_and_what_is_left_out_exactly_change_no_bit() {
    let exact = Skip { constant: false, ..Skip::default() };
    let run = |memory, threads, skip| {
        let engine = small_of(Settings { memory, threads, skip, ..Settings::default() });
        let frames = (0..5).map(|t| {
            let mut frame = full(t, 61, 403);
            // Film that is opaque in some frames only.
            frame.alpha.iter_mut().for_each(|alpha| {
                if t < 3 {
                    alpha.fill(1.0)
                }
            });
            frame
        });
        let frames = encode(&engine, frames);
        (1..4).flat_map(|n| bits(&second(&engine, &passes(&engine, &frames, 1), n, 1))).collect::<Vec<u32>>()
    };
    let one = run(None, Some(1), exact);
    assert!(one == run(None, Some(3), exact), "threads");
    assert!(one == run(Some(0), Some(2), exact), "tiles");
    let still = Skip { opaque: false, ..exact };
    assert!(run(None, Some(2), still) == run(None, Some(2), Skip { still: false, untrusted: false, ..still }), "rules");
}

#[test]
fn the_result_is_an_average_of_rendered_pixels() {
    let engine = small();
    let image = |t: u64| noise(t, 40, 56, 3).mapv(|v| 0.5 + 0.2 * v);
    let frames = (0..9).map(|t| Frame { vector: Some(Array3::zeros((40, 56, 4))), ..Frame::new(image(t)) });
    let frames = encode(&engine, frames);
    let passes = passes(&engine, &frames, 2);
    let (result, first) = (second(&engine, &passes, 4, 2), denoise(&engine, &frames, 4, 2, 2.0));
    assert!(result.colour.iter().all(|v| (0.499..=0.701).contains(v)));
    let moved = result.colour.iter().zip(&first.colour).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(moved > 1e-3, "the second pass does something");
    let firsts: Vec<Denoised> = (2..=6).map(|n| denoise(&engine, &frames, n, 2, 2.0)).collect();
    // Every value lies between the least and the greatest first result that its pixel can see.
    for ((y, x, c), value) in result.colour.indexed_iter() {
        let (low, high) = firsts.iter().map(|f| f.colour[[y, x, c]]).fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(v), h.max(v)));
        assert!((low - 1e-5..=high + 1e-5).contains(value), "{value} is not in {low}…{high}");
    }
}

#[test]
fn a_frame_without_alpha_is_one_with_an_alpha_of_1() {
    let engine = small();
    let frames = |opaque: Option<f32>| {
        let frame = |t: u64| {
            let mut frame = full(t, 24, 40);
            if t < 4 {
                frame.alpha = opaque.map(|a| Array2::from_elem((24, 40), a));
            }
            frame
        };
        encode(&engine, (0..5).map(frame))
    };
    let of = |frames: &[EncodedFrame], centre| bits(&second(&engine, &passes(&engine, frames, 1), centre, 1));
    let (without, with) = (frames(None), frames(Some(1.0)));
    // Frame 3 sees through the last one in its first pass, frame 2 in its second only.
    (2..=4).for_each(|centre| assert!(of(&without, centre) == of(&with, centre), "{centre}"));
}

#[test]
fn flat_parts_keep_their_pixels_though_frames_beyond_the_first_window_differ() {
    let engine = small();
    // Frame 2 sees frames of one value. Frame 3 sees the last, which is brighter, and so is its result.
    let frame = |t: usize| {
        let colour = Array3::from_elem((24, 40, 3), if t < 4 { 0.4 } else { 0.44 });
        Frame { vector: Some(Array3::zeros((24, 40, 4))), ..Frame::new(colour) }
    };
    let frames = encode(&engine, (0..5).map(frame));
    let passes = passes(&engine, &frames, 1);
    assert!(second(&engine, &passes, 3, 1).colour.iter().any(|v| *v > 0.401));
    assert!(second(&engine, &passes, 2, 1).colour.iter().all(|v| *v == 0.4));
}

#[test]
fn what_is_left_out_does_not_decide_whether_there_is_an_alpha() {
    // Frame 2 lacks vectors: frame 1 sees no alpha but 1, beside one that is not.
    let frame = |t: u64| {
        let mut frame = full(t, 24, 40);
        if t < 3 {
            frame.alpha = None;
        }
        if t == 2 {
            frame.vector = None;
        }
        frame
    };
    let of = |skip| {
        let engine = small_skipping(skip);
        let frames = encode(&engine, (0..4).map(frame));
        second(&engine, &passes(&engine, &frames, 1), 1, 1).alpha
    };
    let (with, without) = (of(Skip::default()), of(Skip { opaque: false, ..Skip::default() }));
    assert!(with.unwrap().iter().zip(&without.unwrap()).all(|(a, b)| *a == 1.0 && (a - b).abs() < 1e-6));
}
