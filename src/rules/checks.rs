//! Checks on a shot's headers that tell an artist what is wrong with the render and what to change, once per shot.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::words;

/// What a warning is about; the names are stable (`missing_frames`, `no_vector`, …).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum WarningKind {
    /// Frames of the range have no file.
    MissingFrames,
    /// Only every second frame, or fewer, is there, so that neighbours cannot help.
    FrameStep,
    /// The frames are not all of one resolution, or their crop moves.
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
    /// The mask of λ holds values that are none for a mask.
    LambdaMask,
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
    /// Where the upper left corner lies in the picture: not at 0, 0 where the frame is cropped.
    pub origin: [i32; 2],
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

/// Frames of another resolution than most, or cropped at another place.
pub fn resolution(headers: &[Header]) -> Option<Warning> {
    let mut sizes: BTreeMap<(usize, usize), Vec<i64>> = BTreeMap::new();
    for h in headers {
        sizes.entry((h.columns, h.rows)).or_default().push(h.number);
    }
    if sizes.len() < 2 {
        let first = headers.first()?;
        let moved = headers.iter().find(|h| h.origin != first.origin)?;
        let at = |h: &Header| format!("{}, {} in frame {}", h.origin[0], h.origin[1], h.number);
        let message = format!(
            "the crop moves: the data window begins at {} and at {}: such frames do not help each other; render the shot again with one \
             crop",
            at(first),
            at(moved)
        );
        return Some(Warning::new(WarningKind::Resolution, message));
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
    frames_by(headers, missing).into_iter().map(|m| Warning::new(WarningKind::MissingGuide, text(m))).collect()
}

/// What the files' notes say.
pub fn notes(headers: &[Header]) -> Vec<Warning> {
    let text = |(note, numbers): (String, Vec<i64>)| match numbers.len() == headers.len() {
        true => note,
        false => format!("{}: {note}", words::frames(&numbers)),
    };
    frames_by(headers, |h| h.notes.clone()).into_iter().map(|n| Warning::new(WarningKind::Note, text(n))).collect()
}

/// The frames that have each of the things that `of` finds.
fn frames_by<T: Ord>(headers: &[Header], of: impl Fn(&Header) -> Vec<T>) -> BTreeMap<T, Vec<i64>> {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn header(number: i64) -> Header {
        Header {
            number,
            columns: 8,
            rows: 4,
            origin: [0, 0],
            vector: true,
            noisy_image: false,
            unsure: false,
            missing: vec![],
            notes: vec![],
        }
    }

    #[test]
    fn a_sound_shot_gets_no_warning() {
        let headers = [header(1), header(2)];
        assert_eq!(resolution(&headers), None);
        let moved = Header { origin: [3, -1], ..header(2) };
        assert!(resolution(&[header(1), moved]).unwrap().message.contains("0, 0 in frame 1 and at 3, -1 in frame 2"));
        assert_eq!(no_vector(&headers), None);
        assert_eq!(noisy_image(&headers), None);
        assert_eq!(maybe_denoised(&headers), None);
        let told = maybe_denoised(&[header(1), Header { unsure: true, ..header(2) }]).unwrap().message;
        assert!(told.starts_with("frame 2 does not tell whether"), "{told}");
        assert!(missing_guides(&headers).is_empty() && notes(&headers).is_empty());
        assert_eq!(missing_frames(&[]), None);
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
}
