//! Frames in memory: one alone, or a window that slides over a shot.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ndarray::Array3;
use numpy::PyArray3;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{Given, Out, Passes, color_of, dial_of, to_numpy};
use super::errors::HushError;
use super::settings::{check_lam, check_window, make_engine};
use crate::engine::{self, Engine};
use crate::error::Result;
use crate::rules::window::LAMBDA_RANGE;

/// An engine that is kept for the next call.
struct Kept {
    /// The process that made it: a forked one has not the threads of its parent's.
    process: u32,
    renderer: Option<String>,
    memory: Option<i64>,
    threads: Option<i64>,
    engine: Arc<Engine>,
}

/// The engine of the last call.
static KEPT: Mutex<Option<Kept>> = Mutex::new(None);

/// The engine of the last call, where that had the same settings, else a new one; with the embedded weights.
fn kept_engine(py: Python<'_>, renderer: Option<&str>, memory: Option<i64>, threads: Option<i64>) -> PyResult<Arc<Engine>> {
    let kept = || KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    let is_same =
        |kept: &Kept| (kept.process, kept.renderer.as_deref(), kept.memory, kept.threads) == (process, renderer, memory, threads);
    if let Some(kept) = kept().as_ref().filter(|kept| is_same(kept)) {
        return Ok(Arc::clone(&kept.engine));
    }
    let engine = Arc::new(make_engine(py, None, renderer, memory, threads, false)?);
    let new = Kept { process, renderer: renderer.map(str::to_owned), memory, threads, engine: Arc::clone(&engine) };
    let old = kept().replace(new);
    match old {
        // The threads of a pool from before a fork are not there to be waited for.
        Some(old) if old.process != process => std::mem::forget(old),
        old => py.detach(|| drop(old)),
    }
    Ok(engine)
}

/// Denoises one image by itself.
///
/// Args:
///     color: Noisy image, (height, width, 3), or (height, width, 4) with alpha: scene-linear radiance. NaN and Inf are filled in,
///         negative values read as 0.
///     albedo: (height, width, 3), 0…1.
///     normal: (height, width, 3), −1…1, camera space.
///     depth: (height, width), 0 or 1e9 and more for the background.
///     vector: (height, width, 4), pixels, as Cycles' Vector pass. It is checked and not used: a frame alone has no neighbours.
///     lam: λ from 1 (cleanest) to 64 (keeps grain and the detail hidden in it), or an array of (height, width)
///         with one for each pixel; in an array less than 1 counts as 1, more than 64 as 64, NaN as 1, with a UserWarning.
///     out: Where to put the result, a C-contiguous float32 array of color's shape; it may be color itself.
///     memory: Bytes for the frame and the computing, some hundred million at least; None for 3.1 GiB. Less is slower and gives the
///         same bits.
///     threads: Threads, 1 to 4096; None for all cores. Any number gives the same bits.
///     model: Other weights, a safetensors file. They are read at every call; a Denoiser reads them once.
///     renderer: What made the image, one that the weights have an encoder for: "cycles" or "mitsuba"; None for the first, Cycles.
///
/// Returns:
///     The denoised image, float32, of color's shape; `out` where it was given.
///
/// float32 arrays are read where they lie, whatever their strides; float16 and float64 are converted, which copies them. The GIL is
/// released while it works: leave the arrays as they are until it returns.
///
/// Raises:
///     TypeError: No numpy array, or one of integers.
///     ValueError: An array of the wrong shape, a setting out of range.
///     OSError, HushError: The weights file cannot be read, or used.
#[pyfunction]
#[pyo3(signature = (color, albedo=None, normal=None, depth=None, vector=None, *, lam=None, out=None, memory=None, threads=None, model=None, renderer=None),
       text_signature = "(color, albedo=None, normal=None, depth=None, vector=None, *, lam=1.0, out=None, memory=None, threads=None, model=None, renderer=None)")]
#[allow(clippy::too_many_arguments, reason = "keywords in Python")]
pub fn denoise<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    albedo: Option<&Bound<'py, PyAny>>,
    normal: Option<&Bound<'py, PyAny>>,
    depth: Option<&Bound<'py, PyAny>>,
    vector: Option<&Bound<'py, PyAny>>,
    lam: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
    memory: Option<i64>,
    threads: Option<i64>,
    model: Option<PathBuf>,
    renderer: Option<&str>,
) -> PyResult<Py<PyAny>> {
    let passes = Passes::new(&Given { color, albedo, normal, depth, vector, aovs: None })?;
    let engine = match model {
        None => kept_engine(py, renderer, memory, threads)?,
        model => Arc::new(make_engine(py, model, renderer, memory, threads, false)?),
    };
    let frame = passes.view()?;
    let lam = dial_of(lam, frame.size(), LAMBDA_RANGE.0)?;
    let channels = if frame.alpha.is_some() { 4 } else { 3 };
    let shape = [frame.size().0, frame.size().1, channels];
    let work = move || -> Result<Array3<f32>> {
        let denoised = engine.denoise(&engine.encode_view(&frame)?, &[], lam.borrowed());
        engine.release_memory();
        Ok(color_of(denoised?).0)
    };
    match out {
        None => Ok(to_numpy(py, py.detach(work)?).into_any()),
        Some(out) => {
            Out::check(out, &shape, out.is(color))?;
            let image = py.detach(work)?;
            // The input may be the output: its memory is given back first.
            drop(passes);
            Out::new(out, &shape)?.view()?.assign(&image);
            Ok(out.clone().unbind())
        }
    }
}

/// One denoised frame.
#[pyclass(frozen, module = "hush", get_all)]
pub struct Denoised {
    /// float32, of the input's shape, with an alpha where a frame around it came with one.
    color: Py<PyArray3<f32>>,
    /// Light passes by name, each (height, width, 3), float32.
    aovs: Py<PyDict>,
    /// What `push` was given; without, the frame's place among all that the denoiser was given, from 0.
    tag: Py<PyAny>,
}

#[pymethods]
impl Denoised {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("<hush.Denoised tag={}>", self.tag.bind(py).repr()?))
    }
}

/// Denoises the frames of a shot as they come, each with the help of those around it.
///
/// Give every frame to `push`, in order; each comes back once as many frames as the window is wide follow it, twice as many with a second
/// pass over time. `flush` gives the rest at the end of the shot or at a cut. The results have the same bits as those
/// of `denoise_sequence` over the same frames.
///
/// A neighbour helps where it has color's size and the same light passes, and where every frame from the one to be denoised to it came
/// with motion vectors. It can be used from several threads; calls wait for each other. The GIL is released while it works.
///
/// Args:
///     window: Frames on each side that help, 0 to 3.
///     lam: λ where `push` says nothing else, from 1 (cleanest) to 64 (keeps grain and the detail hidden in it).
///     model: Other weights, a safetensors file.
///     renderer: What made the frames, one that the weights have an encoder for: "cycles" or "mitsuba"; None for the first, Cycles.
///     memory: Bytes for the frames in the window and the computing; None for 3.1 GiB. Less is slower and gives the same bits.
///     threads: Threads, 1 to 4096; None for all cores. Any number gives the same bits.
///     second_pass: Average each result with those around it, which flickers less; where the weights have a second pass over time.
///
/// Raises:
///     ValueError: A setting out of range.
///     OSError, HushError: The weights file cannot be read, or used.
#[pyclass(frozen, module = "hush")]
pub struct Denoiser {
    state: Mutex<State>,
    /// The process that made it: after a fork its threads are not there.
    process: u32,
    /// Frames on each side that help.
    #[pyo3(get)]
    window: usize,
    /// λ where `push` says nothing else.
    #[pyo3(get)]
    lam: f32,
}

struct State {
    denoiser: engine::Denoiser<Engine, Tag>,
    pushed: u64,
}

/// What `push` was given, else the frame's place among all.
enum Tag {
    Given(Py<PyAny>),
    Number(u64),
}

#[pymethods]
impl Denoiser {
    #[new]
    #[pyo3(signature = (window=2, lam=1.0, *, model=None, renderer=None, memory=None, threads=None, second_pass=false))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        py: Python<'_>,
        window: i64,
        lam: f64,
        model: Option<PathBuf>,
        renderer: Option<&str>,
        memory: Option<i64>,
        threads: Option<i64>,
        second_pass: bool,
    ) -> PyResult<Self> {
        let (window, lam) = (check_window(window)?, check_lam(lam)?);
        let engine = make_engine(py, model, renderer, memory, threads, second_pass)?;
        let state = State { denoiser: engine::Denoiser::new(engine, window)?, pushed: 0 };
        Ok(Self { state: Mutex::new(state), process: std::process::id(), window, lam })
    }

    /// Takes the next frame.
    ///
    /// Args:
    ///     color: Noisy image, (height, width, 3), or (height, width, 4) with alpha: scene-linear radiance.
    ///     albedo: (height, width, 3), 0…1.
    ///     normal: (height, width, 3), −1…1, camera space.
    ///     depth: (height, width), 0 or 1e9 and more for the background.
    ///     vector: (height, width, 4), pixels, y up, as Cycles' Vector pass. X, Y: a point's place in the previous frame minus its
    ///         place here; Z, W: its place here minus its place in the next frame.
    ///     aovs: Light passes by name, each (height, width, 3), linear: parts of color that get its kernels.
    ///     lam: λ of this frame, or an array of (height, width) with one for each pixel, as `denoise` takes it; there NaN is the
    ///         denoiser's.
    ///     tag: Anything; it comes back with the result.
    ///
    /// float32 arrays are read where they lie and not kept; float16 and float64 are converted. The frame is taken for the one after the
    /// last: where one is missing, as after a push that was refused, call `flush` first, as at a cut.
    ///
    /// Returns:
    ///     The frames that are ready now, in order: none while the window fills, one afterwards.
    ///
    /// Raises:
    ///     TypeError, ValueError: As `denoise`; the frame is not taken.
    #[pyo3(signature = (color, albedo=None, normal=None, depth=None, vector=None, *, aovs=None, lam=None, tag=None))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    fn push<'py>(
        &self,
        py: Python<'py>,
        color: &Bound<'py, PyAny>,
        albedo: Option<&Bound<'py, PyAny>>,
        normal: Option<&Bound<'py, PyAny>>,
        depth: Option<&Bound<'py, PyAny>>,
        vector: Option<&Bound<'py, PyAny>>,
        aovs: Option<&Bound<'py, PyDict>>,
        lam: Option<&Bound<'py, PyAny>>,
        tag: Option<Py<PyAny>>,
    ) -> PyResult<Vec<Denoised>> {
        self.check_process()?;
        let passes = Passes::new(&Given { color, albedo, normal, depth, vector, aovs })?;
        let frame = passes.view()?;
        let lam = dial_of(lam, frame.size(), self.lam)?;
        let ready = py.detach(move || {
            let mut state = self.state();
            let tag = tag.map_or(Tag::Number(state.pushed), Tag::Given);
            let ready = state.denoiser.push(&frame, lam, tag)?;
            state.pushed += 1;
            Ok(ready.into_iter().map(ready_of).collect())
        });
        to_python(py, ready)
    }

    /// Denoises the frames that still wait, and forgets all: the next frame begins a new shot.
    ///
    /// Returns:
    ///     The frames, in order; as many as `pending` says.
    fn flush(&self, py: Python<'_>) -> PyResult<Vec<Denoised>> {
        self.check_process()?;
        let ready = py.detach(|| Ok(self.state().denoiser.flush()?.into_iter().map(ready_of).collect()));
        to_python(py, ready)
    }

    /// Frames that were pushed and have not come back yet.
    #[getter]
    fn pending(&self, py: Python<'_>) -> usize {
        py.detach(|| self.state().denoiser.pending())
    }
}

impl Denoiser {
    fn check_process(&self) -> PyResult<()> {
        match self.process == std::process::id() {
            true => Ok(()),
            false => Err(HushError::new_err("this Denoiser was made before the process was forked: make one in each process")),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A result before it is Python's.
type Ready = (Tag, Array3<f32>, Vec<(String, Array3<f32>)>);

fn ready_of((tag, denoised): (Tag, engine::Denoised)) -> Ready {
    let (color, aovs) = color_of(denoised);
    (tag, color, aovs)
}

fn to_python(py: Python<'_>, ready: Result<Vec<Ready>>) -> PyResult<Vec<Denoised>> {
    let one = |(tag, color, images): Ready| -> PyResult<Denoised> {
        let aovs = PyDict::new(py);
        for (name, image) in images {
            aovs.set_item(name, to_numpy(py, image))?;
        }
        let tag = match tag {
            Tag::Given(tag) => tag,
            Tag::Number(number) => number.into_pyobject(py)?.into_any().unbind(),
        };
        Ok(Denoised { color: to_numpy(py, color), aovs: aovs.unbind(), tag })
    };
    ready?.into_iter().map(one).collect()
}
