//! The images of a preview: the frame as rendered and by each combination of settings, and how they flicker.

use std::collections::BTreeSet;
use std::time::Instant;

use ndarray::{Array2, Array3, s};

use super::flicker::Flicker;
use super::region::Region;
use super::window::{PreviewWindow, TargetFrame};
use crate::engine::Engine;
use crate::error::{Error, Result};
use crate::io::Selection;
use crate::io::sequence::Sequence;
use crate::rules::frames::FrameSet;
use crate::shot::{CancelToken, Scope};

/// What to show.
#[derive(Clone, Debug)]
pub struct Request {
    /// Number of the frame.
    pub frame: i64,
    /// Values of λ, 1…64 each.
    pub lambdas: Vec<f32>,
    /// λ of what the mask marks, whatever the others are; None without a mask.
    pub lambda_masked: Option<f32>,
    /// Windows, 0…3 each; none for the one that a run would have.
    pub windows: Vec<usize>,
    /// A part of the frame; None for all of it.
    pub region: Option<Region>,
    /// Whether to compare with the frame before, which is then denoised too.
    pub flicker: bool,
}

/// A frame by several settings.
#[derive(Debug)]
pub struct Preview {
    /// The sequence, such as `frame_####.exr`.
    pub sequence: String,
    /// Number of the frame.
    pub frame: i64,
    /// Height of the whole frame, in pixels.
    pub rows: usize,
    /// Width of the whole frame, in pixels.
    pub columns: usize,
    /// What is shown of it.
    pub region: Region,
    /// One for each view layer and stereo view.
    pub layers: Vec<LayerPreview>,
    /// What is odd about the frames, and what to change in Blender.
    pub notes: Vec<String>,
}

/// One view layer or stereo view.
#[derive(Debug)]
pub struct LayerPreview {
    /// View layer, and stereo view where there are several.
    pub name: String,
    /// The beauty as rendered, (rows, columns, 3), linear.
    pub noisy: Array3<f32>,
    /// Its alpha, where it is not 1 everywhere.
    pub alpha: Option<Array2<f32>>,
    /// How the rendered frame flickers, where that was asked for and can be told.
    pub flicker: Option<Flicker>,
    /// By window, then by λ.
    pub variants: Vec<Variant>,
}

/// The frame by one combination of settings.
#[derive(Debug)]
pub struct Variant {
    /// 1…64.
    pub lambda: f32,
    /// Frames on each side that may help.
    pub window: usize,
    /// Numbers of those that did.
    pub neighbours: Vec<i64>,
    /// (rows, columns, 3), linear.
    pub colour: Array3<f32>,
    /// Where the input has alpha.
    pub alpha: Option<Array2<f32>>,
    /// How it flickers, where that was asked for and can be told.
    pub flicker: Option<Flicker>,
    /// Time spent denoising it.
    pub seconds: f64,
}

/// Denoises a frame by every combination of a request. Only the frames that can help are read, each once. `progress` hears how far
/// it is, 0…1.
///
/// # Errors
/// The frame is not there or cannot be read, a setting is out of range, the region reaches beyond the frame, a window is asked for
/// without motion vectors; [`Error::Cancelled`].
pub fn preview(
    (sequence, selection): (&Sequence, &Selection),
    request: &Request,
    engine: &Engine,
    progress: &dyn Fn(f64),
    cancel: &CancelToken,
) -> Result<Preview> {
    let (frame, frames) = (request.frame, FrameSet::of(&[request.frame]));
    let most = request.windows.iter().copied().max();
    // The frame before needs its own window.
    let context = |window: usize| engine.identity().context(window);
    let reach = context(most.unwrap_or(crate::rules::window::DEFAULT_WINDOW)) + usize::from(request.flicker);
    let scope = Scope::open(sequence, selection, Some(&frames), most, reach)?;
    let windows = if request.windows.is_empty() { vec![scope.window] } else { request.windows.clone() };
    let most = windows.iter().copied().max().unwrap_or_default();
    let own = TargetFrame::new(&scope, frame, context(most));
    let can_flicker = scope.around(frame, 1).iter().any(|(offset, _)| *offset == -1);
    let mut notes: Vec<String> = scope.warnings().into_iter().map(|w| w.message).collect();
    notes.extend(scope.bad.iter().map(|(number, reason)| format!("frame {number}: {reason}")));
    let before = (request.flicker && can_flicker).then(|| TargetFrame::new(&scope, frame - 1, context(most)));
    if request.flicker && !can_flicker {
        notes.push(format!("flicker cannot be shown: it wants frame {}, and motion vectors", frame - 1));
    }
    let (_, images) = scope
        .about(frame)
        .ok_or_else(|| Error::BadInput { input: scope.name.clone(), reason: format!("has no readable frame {frame}") })?;
    let names: Vec<String> =
        images.iter().map(|r| [Some(r.layer.clone()), r.view.clone()].into_iter().flatten()).map(join).collect();
    let targets: Vec<&TargetFrame> = [&own].into_iter().chain(&before).collect();
    let reads: BTreeSet<i64> = targets.iter().flat_map(|t| t.around.iter().map(|(_, n)| *n).chain([t.number])).collect();
    let steps = names.len() * (reads.len() + windows.len() * request.lambdas.len() * targets.len());
    let done = std::cell::Cell::new(0usize);
    let step = || {
        done.set(done.get() + 1);
        progress((done.get() as f64 / steps as f64).min(1.0));
    };
    let mut shown = None;
    let mut layers = Vec::new();
    for (index, name) in names.into_iter().enumerate() {
        let window = PreviewWindow::open((&scope, index), engine, (&targets, most), request.region, (cancel, &step))?;
        notes.extend(window.notes.iter().cloned());
        let mut variants = Vec::new();
        for &radius in &windows {
            for &lambda in &request.lambdas {
                let made = |target: &TargetFrame| -> Result<_> {
                    cancel.check()?;
                    let made = window.denoise(engine, target, radius, (lambda, request.lambda_masked))?;
                    step();
                    Ok(made)
                };
                let began = Instant::now();
                let (here, neighbours) = made(&own)?;
                let seconds = began.elapsed().as_secs_f64();
                // The frame before may have turned out to be bad.
                let last = before.as_ref().filter(|t| window.colours.contains_key(&t.number)).map(made).transpose()?;
                variants.push(Variant {
                    lambda,
                    window: radius,
                    neighbours,
                    colour: window.shown(here.colour.view()),
                    alpha: here.alpha.as_ref().map(|a| plane(&window, a)),
                    flicker: last.and_then(|(last, _)| flicker(&window, frame, &here.colour, &last.colour)),
                    seconds,
                });
            }
        }
        let rendered = |number: i64| window.colours.get(&number);
        let here = rendered(frame).ok_or_else(|| Error::BadInput { input: scope.name.clone(), reason: "has no image".into() })?;
        let last = rendered(frame - 1).map(|f| &f.colour);
        layers.push(LayerPreview {
            name,
            noisy: window.shown(here.colour.view()),
            alpha: here.alpha.as_ref().map(|a| plane(&window, a)),
            flicker: last.and_then(|last| flicker(&window, frame, &here.colour, last)),
            variants,
        });
        shown = Some((window.size, window.region));
    }
    // Frames that turned out to be bad took no steps.
    if done.get() < steps {
        progress(1.0);
    }
    notes.dedup();
    let ((rows, columns), region) = shown.unwrap_or(((0, 0), Region::whole((0, 0))));
    Ok(Preview { sequence: scope.name.clone(), frame, rows, columns, region, layers, notes })
}

/// The region's flicker; both images are cut as the frames are.
fn flicker(window: &PreviewWindow, frame: i64, now: &Array3<f32>, last: &Array3<f32>) -> Option<Flicker> {
    let vectors = window.colours.get(&frame)?.vector.as_ref()?;
    let place = window.region.inside(window.cut);
    let all = Flicker::new(now.view(), last.view(), vectors.view(), window.exposure);
    Some(all.part(place.rows(), place.columns()))
}

fn plane(window: &PreviewWindow, image: &Array2<f32>) -> Array2<f32> {
    let place = window.region.inside(window.cut);
    image.slice(s![place.rows(), place.columns()]).to_owned()
}

fn join(names: impl Iterator<Item = String>) -> String {
    names.filter(|n| !n.is_empty()).collect::<Vec<_>>().join(" ")
}
