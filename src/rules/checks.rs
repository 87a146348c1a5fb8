//! Checks on a shot that tell an artist what is wrong with the render and what to change, once per shot.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::frame::Frame;
use crate::words;

/// What a warning is about; the names are stable (`missing_frames`, `no_vector`, …).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WarningKind {
    /// Frames of the range have no file.
    MissingFrames,
    /// Only every second frame, or fewer, is there, so that neighbours cannot help.
    FrameStep,
    /// The frames are not all of one resolution.
    Resolution,
    /// Frames have no Vector pass.
    NoVector,
    /// The Vector pass is zero everywhere in every frame.
    ZeroVector,
    /// Consecutive frames have the same noise.
    RepeatedNoise,
    /// The files hold a Noisy Image, so Combined may have been denoised.
    NoisyImage,
    /// The files do not tell whether Combined was denoised.
    MaybeDenoised,
    /// Frames lack a guide that would help.
    MissingGuide,
    /// Something to know about the files: several layers or views, lossy compression.
    Note,
    /// A setting was changed or contradicts the shot.
    Setting,
    /// Files beside the sequence were left out.
    Ignored,
    /// Existing output is made again.
    Redone,
    /// The manifest cannot be read.
    Manifest,
}

/// Something to tell the user once.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Warning {
    /// What it is about.
    pub kind: WarningKind,
    /// One sentence with what to do.
    pub message: String,
}

impl Warning {
    /// A warning.
    pub fn new(kind: WarningKind, message: impl Into<String>) -> Self {
        Self { kind, message: message.into() }
    }
}

/// What the header of a frame's file says.
#[derive(Clone, Debug)]
pub struct Header {
    /// Frame number.
    pub number: i64,
    /// Pixels.
    pub columns: usize,
    /// Pixels.
    pub rows: usize,
    /// A Vector pass will be read.
    pub vector: bool,
    /// The beauty is `Noisy Image`, and there is a Combined beside it.
    pub noisy_image: bool,
    /// Nothing tells whether Cycles denoised the beauty already.
    pub unsure: bool,
    /// Guides that may be used and are not there, with how to get them.
    pub missing: Vec<(String, String)>,
    /// What else there is to know about the file.
    pub notes: Vec<String>,
}

/// Frames of the range without a file.
pub fn missing_frames(missing: &[(i64, i64)]) -> Option<Warning> {
    let one = matches!(missing, [(first, last)] if first == last);
    let (frames, rest) = match one {
        true => ("frame", "it cannot be written and the frames beside it do without; render it and run again"),
        false => ("frames", "they cannot be written and the frames beside them do without; render them and run again"),
    };
    let message = || format!("missing {frames} {}: {rest}", words::ranges(missing));
    (!missing.is_empty()).then(|| Warning::new(WarningKind::MissingFrames, message()))
}

/// The distance between frames where it is the same all over and at most every second of them is missing; else 1.
pub fn frame_step(numbers: &[i64]) -> i64 {
    let gcd = |mut a: i64, mut b: i64| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let step = numbers.windows(2).fold(0, |step, pair| gcd(step, pair[1] - pair[0]));
    let (Some(first), Some(last)) = (numbers.first(), numbers.last()) else { return 1 };
    // Of two frames nobody knows whether one is missing between them.
    if numbers.len() < 3 || step < 2 || (last - first) / step >= 2 * numbers.len() as i64 { 1 } else { step }
}

/// Frames that are not right beside each other.
pub fn apart(step: i64) -> Option<Warning> {
    let message = format!(
        "the frames are {step} apart, and motion vectors reach only to the frame right beside, so neighbours cannot help: set Output › \
         Frame Range › Step to 1 and render the frames between"
    );
    (step > 1).then(|| Warning::new(WarningKind::FrameStep, message))
}

/// Frames of another resolution than most.
pub fn resolution(headers: &[Header]) -> Option<Warning> {
    let mut sizes: BTreeMap<(usize, usize), Vec<i64>> = BTreeMap::new();
    for h in headers {
        sizes.entry((h.columns, h.rows)).or_default().push(h.number);
    }
    if sizes.len() < 2 {
        return None;
    }
    let show = |((c, r), n): (&(usize, usize), &Vec<i64>)| format!("{c}×{r} in {}", words::frames(n));
    let list = sizes.iter().map(show).collect::<Vec<_>>().join(", ");
    let advice = "frames of different sizes do not help each other; render the shot again at one resolution";
    Some(Warning::new(WarningKind::Resolution, format!("the resolution changes: {list}: {advice}")))
}

/// The Vector pass's name.
pub const VECTOR: &str = "Vector";

/// How to get a Vector pass, or do without.
pub fn vector_advice(header: &Header) -> String {
    let advice = header.missing.iter().find(|(pass, _)| pass == VECTOR).map(|(_, advice)| advice.as_str());
    format!("{}, or set window to 0", advice.unwrap_or("enable View Layer › Passes › Data › Vector"))
}

/// Frames without a Vector pass.
pub fn no_vector(headers: &[Header]) -> Option<Warning> {
    let without: Vec<i64> = headers.iter().filter(|h| !h.vector).map(|h| h.number).collect();
    let advice = vector_advice(headers.iter().find(|h| !h.vector)?);
    let which = which(&without, headers, "has", "have");
    let message = format!("{which} no Vector pass, so neighbours cannot help there: {advice}");
    Some(Warning::new(WarningKind::NoVector, message))
}

/// Guides other than Vector that would help.
pub fn missing_guides(headers: &[Header]) -> Vec<Warning> {
    let missing = |h: &Header| h.missing.iter().filter(|(pass, _)| pass != VECTOR).cloned().collect();
    let text = |((pass, advice), numbers): ((String, String), Vec<i64>)| {
        format!("{} no {pass} pass, which would help: {advice}", which(&numbers, headers, "has", "have"))
    };
    gather(headers, missing).into_iter().map(|m| Warning::new(WarningKind::MissingGuide, text(m))).collect()
}

/// What the files' notes say.
pub fn notes(headers: &[Header]) -> Vec<Warning> {
    let text = |(note, numbers): (String, Vec<i64>)| match numbers.len() == headers.len() {
        true => note,
        false => format!("{}: {note}", words::frames(&numbers)),
    };
    gather(headers, |h| h.notes.clone()).into_iter().map(|n| Warning::new(WarningKind::Note, text(n))).collect()
}

/// The frames that have each of the things that `of` finds.
fn gather<T: Ord>(headers: &[Header], of: impl Fn(&Header) -> Vec<T>) -> BTreeMap<T, Vec<i64>> {
    let mut found: BTreeMap<T, Vec<i64>> = BTreeMap::new();
    for h in headers {
        of(h).into_iter().for_each(|thing| found.entry(thing).or_default().push(h.number));
    }
    found
}

/// The frames as the subject of a sentence.
fn which(numbers: &[i64], headers: &[Header], one: &str, many: &str) -> String {
    match numbers {
        [number] => format!("frame {number} {one}"),
        _ if numbers.len() == headers.len() => format!("the frames {many}"),
        _ => format!("frames {} {many}", words::spans(numbers)),
    }
}

/// Files with a Noisy Image beside Combined.
pub fn noisy_image(headers: &[Header]) -> Option<Warning> {
    let with: Vec<i64> = headers.iter().filter(|h| h.noisy_image).map(|h| h.number).collect();
    let which = which(&with, headers, "holds", "hold");
    let message = format!("{which} a Noisy Image: it is denoised, not Combined, which Cycles may have denoised already");
    (!with.is_empty()).then(|| Warning::new(WarningKind::NoisyImage, message))
}

/// Files that have neither a Noisy Image nor the Denoising Data that come with it.
pub fn maybe_denoised(headers: &[Header]) -> Option<Warning> {
    let unsure: Vec<i64> = headers.iter().filter(|h| h.unsure).map(|h| h.number).collect();
    let which = which(&unsure, headers, "does not tell", "do not tell");
    let message = format!(
        "{which} whether Cycles denoised Combined already: if it did, switch Render › Sampling › Denoise off, or enable View Layer › \
         Passes › Data › Denoising Data, which keeps the noisy image"
    );
    (!unsure.is_empty()).then(|| Warning::new(WarningKind::MaybeDenoised, message))
}

/// What the pixel checks need to know of a decoded frame; a few hundred kilobytes.
#[derive(Debug)]
pub struct Glance {
    size: (usize, usize),
    /// Colours at the sample points, as bits, and whether the colour differs from the pixel to the right.
    samples: Vec<([u32; 3], bool)>,
    /// None without a Vector pass.
    vector_zero: Option<bool>,
}

/// Sample points of a glance, at most about this many.
const SAMPLES: usize = 16_384;

impl Glance {
    /// Looks at a frame.
    pub fn of(frame: &Frame) -> Self {
        let (rows, columns) = frame.size();
        let stride = rows.saturating_mul(columns).div_ceil(SAMPLES).max(1);
        let bits = |i: usize| -> [u32; 3] {
            let at = |c: usize| frame.colour.get((i / columns, i % columns, c)).copied().unwrap_or(0.0).to_bits();
            [at(0), at(1), at(2)]
        };
        // An odd stride in pixels does not keep to one column.
        let samples = (0..rows * columns)
            .step_by(stride | 1)
            .filter(|i| i % columns + 1 < columns)
            .map(|i| (bits(i), bits(i) != bits(i + 1)))
            .collect();
        Self { size: (rows, columns), samples, vector_zero: frame.vector.as_ref().map(|v| v.iter().all(|x| *x == 0.0)) }
    }

    /// Share of the textured or noisy sample points that are bit-identical in both; None where there are too few to tell.
    fn identical(&self, other: &Self) -> Option<f32> {
        if self.size != other.size {
            return None;
        }
        // Flat areas (a plain background) are identical without anything being wrong.
        let pairs = self.samples.iter().zip(&other.samples).filter(|(a, b)| a.1 || b.1);
        let (mut all, mut same) = (0usize, 0usize);
        for (a, b) in pairs {
            all += 1;
            same += usize::from(a.0 == b.0);
        }
        (all >= 16).then(|| same as f32 / all as f32)
    }
}

/// What a frame gave reason to say.
#[derive(Debug, Default)]
pub struct Seen {
    /// About this frame, for the manifest.
    pub note: Option<String>,
    /// About the shot, once.
    pub warning: Option<Warning>,
}

/// The checks that need pixels, fed with the frames in order as they are decoded.
#[derive(Debug, Default)]
pub struct PixelChecks {
    previous: Option<(i64, Glance)>,
    repeated: bool,
    with_vector: usize,
    moving: bool,
    differs: bool,
}

impl PixelChecks {
    /// Takes the next frame; warns at the first pair of frames with the same noise.
    pub fn look(&mut self, number: i64, glance: Glance) -> Seen {
        self.with_vector += usize::from(glance.vector_zero.is_some());
        self.moving |= glance.vector_zero == Some(false);
        let mut seen = Seen::default();
        if let Some((before, last)) = self.previous.as_ref().filter(|(n, _)| n + 1 == number) {
            let identical = last.identical(&glance);
            self.differs |= identical.is_some_and(|share| share < 0.5);
            if identical.is_some_and(|share| share > 0.5) {
                seen.note = Some(format!("the same noise as in frame {before}"));
                let message = format!(
                    "frames {before} and {number} have the same noise, so neighbours add nothing: turn on Render › Sampling › \
                     Advanced › Seed › the clock icon (animated seed) and render again"
                );
                seen.warning = (!self.repeated).then(|| Warning::new(WarningKind::RepeatedNoise, message));
                self.repeated = true;
            }
        }
        self.previous = Some((number, glance));
        seen
    }

    /// After a run's last frame: a Vector pass that was zero throughout although the colour changed.
    pub fn finish(&self) -> Option<Warning> {
        let message = "the Vector pass is zero in every frame: either nothing moves, or motion blur was on, which empties the pass; \
                       then render Vector in a second view layer without motion blur and set vector layer to NAME";
        (self.with_vector > 1 && !self.moving && self.differs).then(|| Warning::new(WarningKind::ZeroVector, message))
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    fn header(number: i64) -> Header {
        Header { number, columns: 8, rows: 4, vector: true, noisy_image: false, unsure: false, missing: vec![], notes: vec![] }
    }

    /// Noise from a seed, with or without vectors of a value.
    fn frame(seed: u32, vector: Option<f32>) -> Frame {
        let hash = |i: usize| (i as u32).wrapping_mul(2654435761).wrapping_add(seed.wrapping_mul(40503)) >> 9;
        let mut f = Frame::new(Array3::from_shape_fn((20, 30, 3), |(r, c, k)| hash(r * 97 + c * 3 + k) as f32));
        f.vector = vector.map(|v| Array3::from_elem((20, 30, 4), v));
        f
    }

    fn look(frames: &[Frame]) -> (Vec<WarningKind>, Option<WarningKind>) {
        let mut checks = PixelChecks::default();
        let seen =
            frames.iter().enumerate().filter_map(|(n, f)| checks.look(n as i64, Glance::of(f)).warning.map(|w| w.kind)).collect();
        (seen, checks.finish().map(|w| w.kind))
    }

    #[test]
    fn a_sound_shot_gets_no_warning() {
        let headers = [header(1), header(2)];
        assert_eq!(resolution(&headers), None);
        assert_eq!(no_vector(&headers), None);
        assert_eq!(noisy_image(&headers), None);
        assert_eq!(maybe_denoised(&headers), None);
        let told = maybe_denoised(&[header(1), Header { unsure: true, ..header(2) }]).unwrap().message;
        assert!(told.starts_with("frame 2 does not tell whether"), "{told}");
        assert!(missing_guides(&headers).is_empty() && notes(&headers).is_empty());
        assert_eq!(missing_frames(&[]), None);
        assert_eq!(look(&[frame(1, Some(2.0)), frame(2, Some(2.0)), frame(3, Some(0.0))]), (vec![], None));
    }

    #[test]
    fn headers_are_told_apart_by_frame() {
        let small = Header { columns: 4, ..header(3) };
        let text = resolution(&[header(1), header(2), small]).unwrap().message;
        assert!(text.contains("4×4 in frame 3") && text.contains("8×4 in frames 1-2"), "{text}");
        let still = Header { vector: false, missing: vec![("Vector".into(), "do this".into())], ..header(12) };
        let text = no_vector(&[header(1), still.clone()]).unwrap().message;
        assert!(text.starts_with("frame 12 has no Vector pass") && text.ends_with("do this, or set window to 0"), "{text}");
        assert!(no_vector(std::slice::from_ref(&still)).unwrap().message.starts_with("frame 12 has no Vector pass"));
        assert!(no_vector(&[still.clone(), still.clone()]).unwrap().message.starts_with("the frames have no Vector pass"));
        assert!(missing_guides(&[still]).is_empty());
        let bare = |n| Header { missing: vec![("Denoising Albedo".into(), "enable it".into())], ..header(n) };
        let text = missing_guides(&[bare(1), header(2), bare(3)]).remove(0).message;
        assert_eq!(text, "frames 1,3 have no Denoising Albedo pass, which would help: enable it");
        let lossy = |n| Header { notes: vec!["lossy".into()], ..header(n) };
        assert_eq!(notes(&[lossy(1), header(2)])[0].message, "frame 1: lossy");
        assert_eq!(notes(&[lossy(1), lossy(2)])[0].message, "lossy");
        assert!(missing_frames(&[(3, 5), (9, 9)]).unwrap().message.starts_with("missing frames 3-5,9: they cannot"));
        assert!(missing_frames(&[(9, 9)]).unwrap().message.starts_with("missing frame 9: it cannot"));
    }

    #[test]
    fn a_frame_step_is_told_from_missing_frames() {
        let steps: [(&[i64], i64); 8] = [
            (&[1, 3, 5], 2),
            (&[1, 3, 7, 9], 2),
            (&[-4, 0, 4, 12], 4),
            (&[1, 2, 4, 6], 1),
            (&[1, 3], 1),
            (&[5], 1),
            (&[], 1),
            (&[1, 3, 2_000_000_000_001], 1),
        ];
        for (numbers, step) in steps {
            assert_eq!(frame_step(numbers), step, "{numbers:?}");
        }
        assert_eq!(apart(1), None);
        assert_eq!(apart(2).unwrap().kind, WarningKind::FrameStep);
    }

    #[test]
    fn the_same_noise_twice_is_found_once() {
        let shot = [frame(1, None), frame(1, None), frame(1, None)];
        assert_eq!(look(&shot), (vec![WarningKind::RepeatedNoise], None));
    }

    #[test]
    fn a_flat_background_is_no_repeated_noise() {
        let mut shot = [frame(1, None), frame(2, None)];
        for f in &mut shot {
            f.colour.slice_mut(ndarray::s![..18, .., ..]).fill(0.5);
        }
        assert_eq!(look(&shot), (vec![], None));
        let flat = Frame::new(Array3::from_elem((20, 30, 3), 0.5));
        assert_eq!(look(&[flat.clone(), flat]), (vec![], None));
    }

    #[test]
    fn zero_vectors_matter_only_where_the_colour_changes() {
        assert_eq!(look(&[frame(1, Some(0.0)), frame(2, Some(0.0))]).1, Some(WarningKind::ZeroVector));
        assert_eq!(look(&[frame(1, Some(0.0)), frame(1, Some(0.0))]).1, None);
        assert_eq!(look(&[frame(1, Some(0.0))]).1, None);
        assert_eq!(look(&[frame(1, Some(f32::NAN)), frame(2, Some(0.0))]).1, None);
    }

    #[test]
    fn tiny_frames_are_looked_at_without_a_fault() {
        for size in [(1, 1), (1, 7), (7, 1), (0, 0)] {
            let f = Frame::new(Array3::zeros((size.0, size.1, 3)));
            assert!(Glance::of(&f).identical(&Glance::of(&f)).is_none());
        }
    }
}
