//! The frames of a shot as they come: each is encoded once, helps those around it, and is let go of.

use std::borrow::Borrow;
use std::collections::VecDeque;
use std::fmt;

use super::{Denoised, EncodedFrame, Engine, FirstPass, SILENT};
use crate::error::Result;
use crate::frame::{FrameView, OwnedDial};
use crate::rules::window::check_window;

/// Denoises the frames of a shot in order, each with the help of those around it.
///
/// A frame comes back once as many frames as the window is wide follow it, twice as many with a [second
/// pass](Engine::has_second_pass) over time. `E` is an [`Engine`] or a reference to one, `T` whatever shall come back with a frame.
/// The results have the same bits as those of [`shot::run`](crate::shot::run()) over files of the same frames.
///
/// Each frame is taken for the one after the last, whose motion vectors lead to it. Where one is missing, as after a push that was
/// refused, or where the picture cuts, [`flush`](Self::flush) first: else vectors lead to the wrong places.
///
/// ```
/// use hush::{Denoiser, Engine, Frame, Settings};
/// use ndarray::Array3;
///
/// let engine = Engine::new(Settings::default())?;
/// let mut denoiser = Denoiser::new(&engine, 1)?;
/// let mut ready = Vec::new();
/// for time in 0..3 {
///     let mut frame = Frame::new(Array3::from_shape_fn((24, 40, 3), |(y, x, c)| ((y * 7 + x * 5 + c + time) % 9) as f32 * 0.1));
///     // Nothing moves. Without a Vector pass neighbours cannot help.
///     frame.vector = Some(Array3::zeros((24, 40, 4)));
///     ready.extend(denoiser.push(&frame.view(), 1.0, time)?);
/// }
/// assert_eq!((ready.len(), denoiser.pending()), (2, 1));
/// ready.extend(denoiser.flush()?);
/// assert!(ready.iter().map(|(time, _)| *time).eq(0..3));
/// # Ok::<(), hush::Error>(())
/// ```
pub struct Denoiser<E, T> {
    engine: E,
    window: usize,
    slots: VecDeque<Slot<T>>,
    /// Those at the front that came back already and stay as neighbours.
    done: usize,
    /// Those at the front whose first pass is done.
    passed: usize,
}

impl<E: fmt::Debug, T> fmt::Debug for Denoiser<E, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Denoiser").field("engine", &self.engine).field("window", &self.window).finish_non_exhaustive()
    }
}

struct Slot<T> {
    /// While the first passes around it need it.
    encoded: Option<EncodedFrame>,
    first: Option<FirstPass>,
    dial: OwnedDial,
    /// Until it comes back.
    tag: Option<T>,
}

impl<E: Borrow<Engine>, T> Denoiser<E, T> {
    /// With `window` frames on each side that help, 0 to 3.
    ///
    /// # Errors
    /// A wider window.
    pub fn new(engine: E, window: usize) -> Result<Self> {
        Ok(Self { engine, window: check_window(window)?, slots: VecDeque::new(), done: 0, passed: 0 })
    }

    /// The engine that it was given.
    pub fn engine(&self) -> &Engine {
        self.engine.borrow()
    }

    /// Frames on each side that help.
    pub fn window(&self) -> usize {
        self.window
    }

    /// Frames that were pushed and have not come back yet.
    pub fn pending(&self) -> usize {
        self.slots.len() - self.done
    }

    /// Takes the next frame, and gives those back that are ready now, in order: none while the window fills, one afterwards.
    ///
    /// # Errors
    /// As [`Engine::encode`] and [`Engine::denoise`]; the frame is not taken then.
    pub fn push(&mut self, frame: &FrameView, dial: impl Into<OwnedDial>, tag: T) -> Result<Vec<(T, Denoised)>> {
        let (engine, dial) = (self.engine.borrow(), dial.into());
        let encoded = engine.encode_view(frame)?;
        engine.checked(dial.borrowed(), &encoded, &[])?;
        self.slots.push_back(Slot { encoded: Some(encoded), first: None, dial, tag: Some(tag) });
        self.advance(false)
    }

    /// Denoises the frames that still wait and gives them back, in order; then forgets all: the next frame begins a new shot.
    ///
    /// # Errors
    /// As [`Engine::denoise`].
    pub fn flush(&mut self) -> Result<Vec<(T, Denoised)>> {
        let ready = self.advance(true);
        (self.slots, self.done, self.passed) = (VecDeque::new(), 0, 0);
        self.engine().release_memory();
        ready
    }

    /// Denoises the frames that enough frames follow, at the `end` all, and lets go of those that help no more.
    fn advance(&mut self, end: bool) -> Result<Vec<(T, Denoised)>> {
        let (window, reach) = (self.window, self.engine().identity().context(self.window) - self.window);
        let ahead = if end { 0 } else { window };
        let mut ready = Vec::new();
        while self.passed + ahead < self.slots.len() {
            let centre = &self.slots[self.passed];
            let Some(own) = &centre.encoded else { break };
            let around = self.around(self.passed, |slot| slot.encoded.as_ref());
            let (first, _) = self.engine().first_pass(own, &around, centre.dial.borrowed(), SILENT)?;
            self.slots[self.passed].first = Some(first);
            self.passed += 1;
            // At the end no further first pass is to come.
            let whole = end && self.passed == self.slots.len();
            while self.done + if whole { 0 } else { reach } < self.passed {
                ready.extend(self.finish(reach));
                self.done += 1;
            }
            for slot in self.slots.iter_mut().take(self.passed.saturating_sub(window)) {
                slot.encoded = None;
            }
            while self.done > reach && self.passed > window {
                self.slots.pop_front();
                (self.done, self.passed) = (self.done - 1, self.passed - 1);
            }
        }
        Ok(ready)
    }

    /// What is kept of the frames of a slot's window, by offset.
    fn around<'a, K>(&'a self, centre: usize, kept: impl Fn(&'a Slot<T>) -> Option<&'a K>) -> Vec<(i32, &'a K)> {
        let near = self.slots.iter().enumerate().filter(|(at, _)| *at != centre && at.abs_diff(centre) <= self.window);
        near.filter_map(|(at, slot)| Some((at as i32 - centre as i32, kept(slot)?))).collect()
    }

    /// The result of the next frame that did not come back yet.
    fn finish(&mut self, reach: usize) -> Option<(T, Denoised)> {
        let at = self.done;
        let denoised = match reach {
            0 => self.slots[at].first.take()?.denoised(),
            _ => self.engine().second_pass(self.slots[at].first.as_ref()?, &self.around(at, |slot| slot.first.as_ref())),
        };
        let slot = &mut self.slots[at];
        slot.first.iter_mut().for_each(FirstPass::averaged);
        Some((slot.tag.take()?, denoised))
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array3};

    use super::*;
    use crate::engine::Settings;
    use crate::frame::{Frame, LambdaMap};

    fn frame(time: usize) -> Frame {
        let colour = Array3::from_shape_fn((16, 24, 3), |(y, x, c)| ((y * 5 + x * 3 + c + 7 * time) % 11) as f32 * 0.1);
        Frame { vector: Some(Array3::zeros((16, 24, 4))), ..Frame::new(colour) }
    }

    #[test]
    fn each_frame_comes_back_as_the_engine_gives_it() {
        let engine = Engine::new(Settings::default()).unwrap();
        let encoded: Vec<EncodedFrame> = (0..6).map(|time| engine.encode(frame(time)).unwrap()).collect();
        for window in 0..=3 {
            let mut denoiser = Denoiser::new(&engine, window).unwrap();
            let mut ready = Vec::new();
            for time in 0..6 {
                ready.extend(denoiser.push(&frame(time).view(), 2.0, time).unwrap());
                assert_eq!((ready.len(), denoiser.pending()), ((time + 1).saturating_sub(window), (time + 1).min(window)));
                assert!(denoiser.slots.len() <= 2 * window, "no more is kept than the window needs");
            }
            ready.extend(denoiser.flush().unwrap());
            assert_eq!(denoiser.pending(), 0);
            for (at, (time, denoised)) in ready.iter().enumerate() {
                let near = encoded.iter().enumerate().map(|(n, frame)| (n as i32 - at as i32, frame));
                let near: Vec<_> = near.filter(|(o, _)| *o != 0 && o.unsigned_abs() as usize <= window).collect();
                let expected = engine.denoise(&encoded[at], &near, 2.0).unwrap();
                assert!(*time == at && denoised.colour == expected.colour, "window {window}, frame {at}");
            }
        }
        assert!(Denoiser::<_, ()>::new(&engine, 4).is_err());
    }

    #[test]
    fn what_is_refused_is_not_taken() {
        let mut denoiser = Denoiser::new(Engine::new(Settings::default()).unwrap(), 1).unwrap();
        let map = LambdaMap::new(Array2::from_shape_fn((8, 8), |(y, _)| 1.0 + y as f32).view(), 1.0).unwrap();
        assert!(denoiser.push(&frame(0).view(), 0.5, 0).is_err());
        assert!(denoiser.push(&frame(0).view(), map, 0).is_err());
        let odd = Frame { albedo: Some(Array3::zeros((4, 4, 3))), ..frame(0) };
        assert!(denoiser.push(&odd.view(), 1.0, 0).is_err());
        assert_eq!(denoiser.pending(), 0);
        assert!(denoiser.push(&frame(1).view(), 1.0, 1).unwrap().is_empty());
        assert_eq!(denoiser.flush().unwrap().len(), 1);
    }
}
