use std::time::Duration;

use super::landing::{FileCheck, Made};
use super::ready::{FrameCounts, Frames};
use super::ready_rules::ReadyRules;
use crate::shot::Stamp;

const NONE: [i64; 0] = [];

/// A shot whose frames land when a test says so; the time is in seconds.
struct Play {
    frames: Frames,
    rules: ReadyRules,
}

fn at(second: u64) -> Duration {
    Duration::from_secs(second)
}

fn stamp(modified: u64) -> Stamp {
    Stamp { size: 1000, modified }
}

impl Play {
    fn new(change: impl FnOnce(&mut ReadyRules)) -> Self {
        let mut rules = ReadyRules { vectors: true, redo: true, settle: Some(at(100)), quiet: at(1), ..ReadyRules::default() };
        change(&mut rules);
        Self { frames: Frames::default(), rules }
    }

    /// A closed, whole file of that time.
    fn land(&mut self, number: i64, second: u64) {
        self.frames.seen(number, stamp(second), true, at(second));
        assert!(self.frames.due(&self.rules, at(second)).contains(&number));
        assert!(self.frames.looked(number, stamp(second), FileCheck::Whole { vector: true }, at(second)));
    }

    /// The frames that are ready; they are made right away.
    fn make(&mut self, second: u64) -> Vec<i64> {
        let ready = self.frames.ready(&self.rules, at(second));
        for &number in &ready {
            let window = self.frames.window(&self.rules);
            let reach = window as i64 * if self.rules.second_pass { 2 } else { 1 };
            let around: Vec<i64> = self.frames.whole(number - reach, number + reach).filter(|n| *n != number).collect();
            let around = around.iter().map(|n| ((n - number) as i32, self.frames.stamp(*n).unwrap())).collect();
            let made = Made { stamp: self.frames.stamp(number), around, window, failed: false };
            self.frames.set_made(number, Some(made));
        }
        assert_eq!(self.frames.ready(&self.rules, at(second)), NONE, "what was made is not made again");
        ready
    }
}

#[test]
fn frames_come_out_two_behind_the_render() {
    let mut play = Play::new(|_| {});
    let mut made = Vec::new();
    for n in 1..=6 {
        play.land(n, n as u64);
        made.push(play.make(n as u64));
    }
    let none: &[i64] = &[];
    assert_eq!(made, [none, none, &[1], &[2], &[3], &[4]]);
    assert_eq!(play.make(105), NONE, "one hundred seconds without a newcomer are not over");
    assert_eq!(play.make(106), [5, 6]);
}

#[test]
fn with_a_second_pass_frames_come_out_four_behind_the_render() {
    let mut play = Play::new(|r| r.second_pass = true);
    let mut made = Vec::new();
    for n in 1..=7 {
        play.land(n, n as u64);
        made.push(play.make(n as u64));
    }
    let none: &[i64] = &[];
    assert_eq!(made, [none, none, none, none, &[1], &[2], &[3]]);
    assert_eq!(play.make(107), [4, 5, 6, 7], "nothing more is to come");
    play.frames.seen(10, stamp(108), true, at(108));
    assert!(play.frames.looked(10, stamp(108), FileCheck::Whole { vector: true }, at(108)));
    assert_eq!(play.make(300), [6, 7, 10], "a neighbour's neighbour came");
}

#[test]
fn with_the_range_known_nothing_waits_at_its_ends() {
    let mut play = Play::new(|r| r.frames = Some("3-5".parse().unwrap()));
    play.land(5, 1);
    assert_eq!(play.make(1), NONE);
    play.land(4, 2);
    play.land(3, 3);
    assert_eq!(play.make(3), [3, 4, 5]);
}

#[test]
fn frames_outside_the_range_help_and_are_not_made() {
    let mut play = Play::new(|r| r.frames = Some("2-3".parse().unwrap()));
    for n in 1..=3 {
        play.land(n, n as u64);
    }
    assert_eq!(play.make(3), [2, 3]);
    play.land(4, 4);
    assert_eq!(play.make(4), [2, 3], "a helper that comes late");
    assert_eq!(play.frames.counts(&play.rules), FrameCounts { landed: 2, done: 2, ..FrameCounts::default() });
}

#[test]
fn in_random_order_each_frame_waits_for_its_own_window() {
    let mut play = Play::new(|_| {});
    let mut made = Vec::new();
    for (second, n) in [7, 3, 5, 6, 4, 9, 8].into_iter().enumerate() {
        play.land(n, second as u64);
        made.extend(play.make(second as u64));
    }
    assert_eq!(made, [5, 6, 7], "the lowest is not the oldest, so more may come below it");
    assert_eq!(play.make(200), [3, 4, 8, 9]);
}

#[test]
fn a_late_neighbour_makes_the_frames_again_that_lacked_it() {
    for redo in [true, false] {
        let mut play = Play::new(|r| r.redo = redo);
        for n in [1, 2, 3, 5, 6, 7, 8] {
            play.land(n, 1);
        }
        assert_eq!(play.make(200), [1, 2, 3, 5, 6, 7, 8], "given up after a while");
        play.land(4, 300);
        let again: &[i64] = if redo { &[2, 3, 4, 5, 6] } else { &[4] };
        assert_eq!(play.make(300), again, "redo {redo}");
    }
}

#[test]
fn a_frame_rendered_again_takes_its_window_along() {
    for redo in [true, false] {
        let mut play = Play::new(|r| (r.frames, r.redo) = (Some("1-9".parse().unwrap()), redo));
        (1..=9).for_each(|n| play.land(n, n as u64));
        assert_eq!(play.make(9).len(), 9);
        play.frames.seen(5, stamp(20), false, at(20));
        assert_eq!(play.make(20), NONE, "the file is open");
        play.frames.seen(5, stamp(21), true, at(21));
        assert!(play.frames.is_again(5));
        play.frames.looked(5, stamp(21), FileCheck::Whole { vector: true }, at(21));
        let again: &[i64] = if redo { &[3, 4, 5, 6, 7] } else { &[5] };
        assert_eq!(play.make(21), again, "redo {redo}");
    }
}

#[test]
fn a_file_that_is_not_whole_holds_its_neighbours_up_until_all_is_quiet() {
    let mut play = Play::new(|r| r.frames = Some("1-3".parse().unwrap()));
    play.land(1, 1);
    play.land(3, 1);
    play.frames.seen(2, stamp(2), true, at(2));
    assert!(!play.frames.looked(2, stamp(2), FileCheck::Partial("is cut short".into()), at(2)));
    assert_eq!(play.frames.partial().map(|(n, why, _)| (n, why)).collect::<Vec<_>>(), [(2, "is cut short")]);
    assert_eq!(play.make(50), NONE);
    assert_eq!(play.make(102), [1, 3]);
    play.land(2, 110);
    assert_eq!(play.make(110), [1, 2, 3]);
}

#[test]
fn growing_files_are_news() {
    let mut play = Play::new(|_| {});
    play.land(1, 1);
    for second in (10..500).step_by(10) {
        play.frames.seen(2, stamp(second), false, at(second));
        assert_eq!(play.make(second + 9), NONE, "second {second}");
    }
    assert_eq!(play.make(590), [1]);
}

#[test]
fn files_that_nobody_closed_must_be_stable() {
    let mut play = Play::new(|_| {});
    play.frames.seen(1, stamp(1), false, at(1));
    assert_eq!(play.frames.due(&play.rules, at(1)), NONE);
    play.frames.seen(1, stamp(2), false, at(2));
    assert_eq!(play.frames.due(&play.rules, at(2)), NONE);
    play.frames.seen(1, stamp(2), false, at(3));
    assert_eq!(play.frames.due(&play.rules, at(3)), [1]);
    assert!(!play.frames.looked(1, stamp(1), FileCheck::Whole { vector: true }, at(3)), "it has changed since the look");
}

#[test]
fn a_partial_file_is_looked_at_again_when_it_is_closed_or_after_a_while() {
    let mut play = Play::new(|_| {});
    let partial = || FileCheck::Partial("is cut short".into());
    play.frames.seen(1, stamp(1), true, at(1));
    play.frames.looked(1, stamp(1), partial(), at(1));
    assert_eq!(play.frames.due(&play.rules, at(5)), NONE);
    assert_eq!(play.frames.due(&play.rules, at(6)), [1]);
    play.frames.looked(1, stamp(1), partial(), at(6));
    play.frames.seen(1, stamp(1), true, at(7));
    assert_eq!(play.frames.due(&play.rules, at(7)), [1], "closed within the same tick of the file's clock");
    play.frames.looked(1, stamp(1), partial(), at(90));
    assert_eq!(play.frames.due(&play.rules, at(9000)), NONE, "an old stub is not read for ever");
    play.frames.seen(1, stamp(9001), true, at(9001));
    play.frames.looked(1, stamp(9001), FileCheck::Unreadable("permission denied".into()), at(9100));
    assert_eq!(play.frames.due(&play.rules, at(9105)), [1], "what could not be read may be allowed later");
}

#[test]
fn what_is_gone_is_no_reason_to_make_anything_again() {
    let mut play = Play::new(|_| {});
    (1..=5).for_each(|n| play.land(n, n as u64));
    assert_eq!(play.make(200), [1, 2, 3, 4, 5]);
    (4..=5).for_each(|n| play.frames.gone(n));
    let counts = FrameCounts { landed: 3, done: 5, of_gone: 2, ..FrameCounts::default() };
    assert_eq!(play.frames.counts(&play.rules), counts);
    (1..=3).for_each(|n| play.frames.gone(n));
    assert_eq!(play.make(300), NONE);
    assert_eq!((play.frames.there().count(), play.frames.ends()), (0, None));
    play.frames.seen(3, stamp(3), true, at(400));
    play.frames.looked(3, stamp(3), FileCheck::Whole { vector: true }, at(400));
    assert_eq!(play.make(400), NONE, "the same file is back");
    play.land(4, 401);
    assert_eq!(play.make(600), [3, 4], "another one is new, and helps");
}

#[test]
fn a_denoised_frame_that_is_gone_is_made_again() {
    let mut play = Play::new(|r| r.frames = Some("1-3".parse().unwrap()));
    (1..=3).for_each(|n| play.land(n, n as u64));
    assert_eq!(play.make(4), [1, 2, 3]);
    assert!(!play.frames.forget_lost(|_| true) && play.frames.has_all(&play.rules, at(4)));
    assert!(play.frames.forget_lost(|n| n != 2) && !play.frames.has_all(&play.rules, at(4)));
    assert_eq!(play.make(5), [2]);
}

#[test]
fn without_vectors_no_frame_waits() {
    let mut play = Play::new(|_| {});
    play.frames.seen(1, stamp(1), true, at(1));
    play.frames.looked(1, stamp(1), FileCheck::Whole { vector: false }, at(1));
    assert_eq!(play.make(1), [1]);
    let mut play = Play::new(|r| r.window = Some(0));
    play.land(1, 1);
    assert_eq!(play.make(1), [1]);
    let mut play = Play::new(|r| r.vectors = false);
    play.land(1, 1);
    assert_eq!(play.make(1), [1]);
}

#[test]
fn failed_frames_are_left_alone_until_they_change() {
    let mut play = Play::new(|r| r.frames = Some("1-2".parse().unwrap()));
    play.land(1, 1);
    play.land(2, 1);
    let failed = Made { stamp: Some(stamp(1)), around: Box::default(), window: 2, failed: true };
    play.frames.set_made(1, Some(failed));
    assert_eq!(play.make(1), [2]);
    assert_eq!(play.frames.failed().collect::<Vec<_>>(), [1]);
    play.land(1, 5);
    assert_eq!(play.make(5), [1, 2]);
}

#[test]
fn frames_that_are_held_come_later() {
    let mut play = Play::new(|r| r.frames = Some("1-2".parse().unwrap()));
    play.land(1, 1);
    play.land(2, 1);
    play.frames.hold(1, at(3));
    assert_eq!(play.make(2), [2]);
    assert_eq!(play.frames.held(at(2)), 1);
    assert_eq!(play.make(3), [1]);
    assert_eq!(play.frames.held(at(3)), 0);
}

#[test]
fn once_waits_for_nothing() {
    let mut play = Play::new(|r| r.once = true);
    play.frames.seen(4, stamp(1), false, at(0));
    assert_eq!(play.frames.due(&play.rules, at(0)), [4]);
    play.land(9, 0);
    play.land(7, 0);
    assert_eq!(play.make(0), [7, 9]);
}

#[test]
fn slow_renders_are_waited_for_longer() {
    let mut play = Play::new(|r| r.settle = None);
    play.land(1, 0);
    assert_eq!(play.make(29), NONE);
    for n in 2..=5 {
        play.land(n, n as u64 * 100);
    }
    assert_eq!(play.make(500), [1, 2, 3]);
    assert_eq!(play.make(799), NONE, "three times the usual hundred seconds");
    assert_eq!(play.make(800), [4, 5]);
}

#[test]
fn many_frames_cost_little() {
    let mut play = Play::new(|r| r.frames = Some("1-20000".parse().unwrap()));
    let began = std::time::Instant::now();
    let mut made = 0;
    for n in 1..=20_000 {
        play.land(n, n as u64);
        if n % 16 == 0 {
            made += play.make(n as u64).len();
        }
    }
    assert_eq!(made, 19_998 + 2);
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
}

#[test]
fn a_frame_that_could_not_be_read_is_made_with_those_around_it_once_it_can_be() {
    let mut play = Play::new(|r| (r.frames, r.settle) = (Some("1-7".parse().unwrap()), Some(at(30))));
    (1..=7).for_each(|n| play.land(n, 1));
    assert_eq!(play.make(1).len(), 7);
    // Frame 4 failed, and those around it were made without it.
    for n in 2..=6 {
        let mut made = play.frames.made(n).unwrap().clone();
        made.around = made.around.iter().copied().filter(|(offset, _)| n + i64::from(*offset) != 4).collect();
        made.failed = n == 4;
        play.frames.set_made(n, Some(made));
    }
    play.frames.set_unread(4, "Input/output error", at(2));
    assert_eq!(play.frames.ready(&play.rules, at(2)), NONE);
    assert_eq!(play.frames.failed().collect::<Vec<_>>(), [4]);
    assert!(!play.frames.has_all(&play.rules, at(3)) && play.frames.due(&play.rules, at(3)).is_empty());
    assert_eq!(play.frames.due(&play.rules, at(7)), [4]);
    play.frames.looked(4, stamp(1), FileCheck::Unreadable("Input/output error".into()), at(7));
    assert!(play.frames.is_unread(4) && play.frames.has_all(&play.rules, at(32)), "it is given up in the end");
    assert_eq!(play.frames.due(&play.rules, at(12)), [4]);
    play.frames.looked(4, stamp(1), FileCheck::Whole { vector: true }, at(12));
    assert!(!play.frames.is_unread(4) && !play.frames.has_all(&play.rules, at(12)));
    assert_eq!(play.make(12), [2, 3, 4, 5, 6]);
    assert!(play.frames.has_all(&play.rules, at(12)));
}

#[test]
fn a_frame_that_failed_holds_the_end_up_only_until_nothing_new_comes() {
    let mut play = Play::new(|r| r.frames = Some("1-2".parse().unwrap()));
    (1..=2).for_each(|n| play.land(n, 1));
    play.make(1);
    let failed = Made { failed: true, ..play.frames.made(2).unwrap().clone() };
    play.frames.set_made(2, Some(failed));
    assert!(!play.frames.has_all(&play.rules, at(100)) && play.frames.has_all(&play.rules, at(101)));
    play.frames.seen(2, stamp(102), true, at(102));
    assert!(!play.frames.has_all(&play.rules, at(300)), "it is rendered again");
}
