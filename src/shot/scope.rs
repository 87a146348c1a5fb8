//! The files of a shot opened for looking: which frames there are, what is around each, and their pixels. Nothing is written.

use std::collections::BTreeMap;

use super::input_file::InputFile;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::io::sequence::Sequence;
use crate::io::{LambdaImages, Layout, Resolved, Selection, read_lambda_image};
use crate::rules::checks;
use crate::rules::frames::FrameSet;
use crate::rules::window::{Availability, DEFAULT_WINDOW, check_window, neighbours};
use crate::words;

/// A shot whose headers were read.
#[derive(Debug)]
pub struct Scope {
    /// The sequence's name, such as `frame_####.exr`.
    pub name: String,
    /// The frames asked for that can be read, ascending; never empty.
    pub frames: Vec<i64>,
    /// Frames on each side: what was asked for, else 2 where there is a Vector pass.
    pub window: usize,
    /// Frames asked for or near them that cannot be read, and why.
    pub bad: BTreeMap<i64, String>,
    lambda_images: Option<LambdaImages>,
    numbers: Vec<i64>,
    good: BTreeMap<i64, InputFile>,
}

impl Scope {
    /// Reads the headers of the frames asked for (None for all) and of `reach` frames around them.
    ///
    /// # Errors
    /// A window out of range or asked for without a Vector pass; no frame asked for is there or can be read.
    pub fn open(
        sequence: &Sequence,
        selection: &Selection,
        frames: Option<&FrameSet>,
        window: Option<usize>,
        reach: usize,
    ) -> Result<Self> {
        let numbers = sequence.numbers();
        let wanted: Vec<i64> =
            numbers.iter().copied().filter(|n| sequence.is_named(*n) && frames.is_none_or(|set| set.contains(*n))).collect();
        let asked = window.map(check_window).transpose()?;
        let reach = asked.unwrap_or(DEFAULT_WINDOW).max(reach) as u64;
        let (mut good, mut bad, mut first_error) = (BTreeMap::new(), BTreeMap::new(), None);
        for frame in sequence.frames.iter().filter(|f| wanted.iter().any(|w| w.abs_diff(f.number) <= reach)) {
            match InputFile::open(frame.number, &frame.path, selection) {
                Ok(source) => _ = good.insert(frame.number, source),
                Err(error) => {
                    bad.insert(frame.number, error.to_string());
                    first_error.get_or_insert(error);
                }
            }
        }
        let frames: Vec<i64> = wanted.into_iter().filter(|n| good.contains_key(n)).collect();
        if frames.is_empty() {
            let reason = format!("none of the frames asked for is there; the sequence has {}", words::spans(&numbers));
            return Err(first_error.unwrap_or(Error::BadInput { input: sequence.name.clone(), reason }));
        }
        let without = frames.iter().filter_map(|n| good.get(n)).find(|s| !s.header.vector);
        let any = frames.iter().filter_map(|n| good.get(n)).any(|s| s.header.vector);
        let window = match (asked, without) {
            (Some(window), Some(source)) if window > 0 => {
                let (path, advice) = (source.path.clone(), checks::vector_advice(&source.header));
                return Err(Error::MissingPass { path, pass: checks::VECTOR.into(), advice });
            }
            (Some(window), _) => window,
            (None, _) => {
                if any {
                    DEFAULT_WINDOW
                } else {
                    0
                }
            }
        };
        let lambda_images = selection.lambda_images.clone();
        Ok(Self { name: sequence.name.clone(), frames, window, bad, lambda_images, numbers, good })
    }

    /// Whether every frame asked for has a Vector pass.
    pub fn has_vectors(&self) -> bool {
        self.frames.iter().filter_map(|n| self.good.get(n)).all(|s| s.header.vector)
    }

    /// The frames around one that can help it, as (offset, number).
    pub fn around(&self, number: i64, window: usize) -> Vec<(i32, i64)> {
        let known = |n: i64| match self.good.get(&n) {
            Some(source) => source.known(),
            None if self.bad.contains_key(&n) => Availability::Bad,
            None if self.numbers.first().is_none_or(|f| n < *f) || self.numbers.last().is_none_or(|l| n > *l) => {
                Availability::Outside
            }
            None => Availability::Missing,
        };
        neighbours(number, window, known).into_iter().filter(|n| n.unused.is_none()).map(|n| (n.offset, n.number)).collect()
    }

    /// Decodes a frame: one image for each view layer and stereo view.
    ///
    /// # Errors
    /// The file is damaged, or the frame is none of this shot's.
    pub fn read(&self, number: i64) -> Result<Vec<Frame>> {
        let missing = || Error::BadInput { input: self.name.clone(), reason: format!("has no readable frame {number}") };
        self.good.get(&number).ok_or_else(missing)?.read()
    }

    /// Decodes one of a frame's images, by its place among those that [`about`](Self::about) tells.
    ///
    /// # Errors
    /// As [`read`](Self::read), and where there is no such image, or no mask of λ for one that is a `target`.
    pub fn read_image(&self, number: i64, index: usize, target: bool) -> Result<Frame> {
        let missing = || Error::BadInput { input: self.name.clone(), reason: format!("has no readable frame {number}") };
        let mut frame = self.good.get(&number).ok_or_else(missing)?.read_image(index)?;
        if let (Some(images), true) = (&self.lambda_images, target) {
            frame.lambda_mask = Some(read_lambda_image(&images.path(number), frame.size())?);
        }
        Ok(frame)
    }

    /// What is odd about the files whose headers were read, and what to change in Blender.
    pub fn warnings(&self) -> Vec<checks::Warning> {
        let headers: Vec<checks::Header> = self.good.values().map(|s| s.header.clone()).collect();
        let first = [checks::resolution(&headers), checks::noisy_image(&headers), checks::maybe_denoised(&headers)];
        let mut all: Vec<_> = first.into_iter().chain([checks::no_vector(&headers)]).flatten().collect();
        all.extend(checks::missing_guides(&headers).into_iter().chain(checks::notes(&headers)));
        all
    }

    /// What a frame's file holds, and what is read of it.
    pub fn about(&self, number: i64) -> Option<(&Layout, &[Resolved])> {
        self.good.get(&number).map(|s| (&*s.layout, &s.views[..]))
    }
}
