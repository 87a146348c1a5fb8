//! The denoiser on frames in memory: encode each frame once, denoise it with the encoded frames around it.

use std::fmt;
use std::sync::{Arc, OnceLock};

use clock::Clock;
pub use clock::{STAGES, Stage};
pub use denoiser::Denoiser;
pub use first_pass::FirstPass;
pub use identity::{Identity, ModelId, REVISION};
use paths::Path;
pub use settings::Settings;
pub use steps::{Listener, SILENT};

use crate::error::{Error, Result};
use crate::frame::lambda_map::in_range;
use crate::frame::packed::PackedFrame;
pub use crate::frame::packed::Scales;
use crate::frame::ranges::Ranges;
pub use crate::frame::{Denoised, Dial, LambdaMask};
use crate::memory::BufferPool;
use crate::network::body::Body;
use crate::network::encoder::Encoder;
use crate::network::features::Features;
use crate::network::levels::kernel_reach;
use crate::network::predictor::Predictor;
use crate::network::temporal::Temporal;
use crate::network::variance::VARIANCES;
use crate::network::warp::any_trusted;
pub use crate::network::weights::Weights;
pub use crate::rules::skip::{LeftOut, RULES, Rule, Skip};
pub use crate::simd::Isa;

/// What one frame's denoising holds, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Footprint {
    /// The frames of the window.
    pub window: usize,
    /// The buffers of the largest tile.
    pub tile: usize,
}

/// A frame as the engine keeps it while it is in the window.
pub struct EncodedFrame {
    packed: PackedFrame,
    ranges: Ranges,
    features: Arc<Features>,
}

impl fmt::Debug for EncodedFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = (self.packed.rows, self.packed.columns);
        f.debug_struct("EncodedFrame").field("size", &size).field("exposure", &self.packed.exposure).finish_non_exhaustive()
    }
}

impl EncodedFrame {
    /// Bytes that this frame holds.
    pub fn bytes(&self) -> usize {
        self.packed.bytes() + self.ranges.bytes() + self.features.bytes()
    }

    /// Which pixels have another λ, where the frame came with a mask.
    pub fn lambda_mask(&self) -> Option<&LambdaMask> {
        self.packed.lambda_mask.as_ref()
    }

    /// Whether the frame came with an alpha.
    pub fn has_alpha(&self) -> bool {
        self.packed.has_alpha
    }

    /// Whether the frame came with motion vectors.
    pub fn has_vectors(&self) -> bool {
        self.packed.vectors.is_some()
    }
}

/// The network with its weights, ready to run. Shared between threads.
///
/// A frame that helps its neighbours is encoded once and used for each of them:
///
/// ```
/// use hush::{Engine, Frame, Settings};
/// use ndarray::Array3;
///
/// let engine = Engine::new(Settings::default())?;
/// let encoded = (0..3).map(|time| {
///     let mut frame = Frame::new(Array3::from_shape_fn((24, 40, 3), |(y, x, c)| ((y * 7 + x * 5 + c + time) % 9) as f32 * 0.1));
///     // Nothing moves. Without a Vector pass neighbours cannot help.
///     frame.vector = Some(Array3::zeros((24, 40, 4)));
///     engine.encode(frame)
/// });
/// let encoded = encoded.collect::<hush::Result<Vec<_>>>()?;
/// let neighbours = [(-1, &encoded[0]), (1, &encoded[2])];
/// let together = engine.denoise(&encoded[1], &neighbours, 1.0)?;
/// let alone = engine.denoise(&encoded[1], &[], 1.0)?;
/// assert_ne!(together.colour, alone.colour);
/// # Ok::<(), hush::Error>(())
/// ```
pub struct Engine {
    settings: Settings,
    identity: Identity,
    isa: Isa,
    pool: Option<rayon::ThreadPool>,
    buffers: BufferPool,
    encoder: Encoder,
    temporal: Temporal,
    body: Body,
    predictor: Predictor,
    levels: usize,
    features: usize,
    widths: [usize; 4],
    epsilon: f32,
    channels_per_pixel: usize,
    clock: Clock,
}

impl fmt::Debug for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Engine").field("identity", &self.identity).field("isa", &self.isa).finish_non_exhaustive()
    }
}

/// Whether this process was forked from one that made an engine: it has rayon's pool of all cores, but not that pool's threads.
fn is_forked() -> bool {
    static FIRST: OnceLock<u32> = OnceLock::new();
    *FIRST.get_or_init(std::process::id) != std::process::id()
}

impl Engine {
    /// An engine with the embedded weights.
    ///
    /// ```
    /// use hush::{Engine, Settings};
    ///
    /// let engine = Engine::new(Settings { threads: Some(1), ..Settings::default() })?;
    /// assert_eq!(engine.threads(), 1);
    /// # Ok::<(), hush::Error>(())
    /// ```
    pub fn new(settings: Settings) -> Result<Self> {
        Self::from_weights(&Weights::embedded()?, settings)
    }

    /// An engine with the weights of a safetensors file.
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be read; [`Error::BadModel`] where it holds no sound weights; as [`from_weights`](Self::from_weights).
    ///
    /// ```
    /// # use hush::{Engine, Error, Settings};
    /// let error = Engine::from_file("no-such.safetensors".as_ref(), Settings::default()).unwrap_err();
    /// assert!(matches!(error, Error::Io { .. }));
    /// ```
    pub fn from_file(path: &std::path::Path, settings: Settings) -> Result<Self> {
        Self::from_weights(&Weights::from_file(path)?, settings)
    }

    /// An engine with weights in memory, and with the encoder of their first renderer or of the one that
    /// [`Weights::for_renderer`] chose. Errors name the tensor that is missing or misshapen, or a setting out of its range.
    pub fn from_weights(weights: &Weights, settings: Settings) -> Result<Self> {
        let a = &weights.architecture;
        let second_pass = a.second_pass > 0 && settings.second_pass;
        let bad_threads = |e: rayon::ThreadPoolBuildError| Error::BadSetting { name: "threads", reason: e.to_string() };
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(bad_threads);
        let every = || std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Self {
            pool: settings.threads.or(is_forked().then(every)).map(pool).transpose()?,
            buffers: BufferPool::default(),
            isa: settings.isa.unwrap_or_else(Isa::detect),
            identity: Identity::new(weights.id.clone(), weights.renderer.as_deref(), settings.skip, second_pass),
            settings,
            encoder: Encoder::new(weights)?,
            temporal: Temporal::new(weights)?,
            body: Body::new(weights)?,
            predictor: Predictor::new(weights)?,
            levels: a.levels,
            features: a.features,
            widths: [a.centre_taps, a.neighbour_taps, a.coarse_taps, a.albedo_taps],
            epsilon: a.albedo_epsilon,
            channels_per_pixel: 3 * a.half + a.quarter + a.eighth / 2 + a.variance * VARIANCES,
            clock: Clock::default(),
        })
    }

    /// What it leaves out.
    pub fn skip(&self) -> Skip {
        self.settings.skip
    }

    /// What decides its results besides the frames.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The instruction set of the kernels.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Threads that compute.
    pub fn threads(&self) -> usize {
        self.in_pool(rayon::current_num_threads)
    }

    /// Seconds spent in each stage since the engine was made, in the order of [`STAGES`].
    pub fn stage_seconds(&self) -> [f64; STAGES.len()] {
        self.clock.seconds()
    }

    /// Gives the memory that is kept for the next frame back to the system.
    pub fn release_memory(&self) {
        self.buffers.release();
    }

    /// Does some work with the threads that the settings allow.
    pub fn in_pool<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// Denoises `centre` in one pass; where a [second one](Self::has_second_pass) follows the results of the frames around
    /// can then be averaged: [`first_pass`](Self::first_pass) and [`second_pass`](Self::second_pass).
    ///
    /// `neighbours` are (offset, frame) with offset −3…3 except 0, in any order; a neighbour farther than one frame needs those
    /// between, to chain motion vectors through, and is left out without them, as is one of another size, with other AOVs, or with an
    /// albedo where `centre` has none, or the other way round. Where one frame has an alpha, those without have 1 all over, and so has the
    /// result one. `lambda` is in 1…64, greater is clamped, less or NaN refused; or a [`LambdaMap`](crate::LambdaMap) of `centre`'s size. Frames
    /// encoded for a network of another width are refused.
    ///
    /// ```
    /// # use hush::{Engine, Error, Frame, Settings};
    /// # use ndarray::Array3;
    /// # let engine = Engine::new(Settings::default())?;
    /// let frame = engine.encode(Frame::new(Array3::from_elem((8, 8, 3), 0.5)))?;
    /// assert!(engine.denoise(&frame, &[], 1000.0).is_ok());
    /// assert!(matches!(engine.denoise(&frame, &[], 0.5), Err(Error::BadSetting { name: "lambda", .. })));
    /// # Ok::<(), Error>(())
    /// ```
    pub fn denoise<'d>(
        &self,
        centre: &EncodedFrame,
        neighbours: &[(i32, &EncodedFrame)],
        lambda: impl Into<Dial<'d>>,
    ) -> Result<Denoised> {
        self.denoise_with(centre, neighbours, lambda, self.settings.skip, SILENT).map(|(denoised, _)| denoised)
    }

    /// As [`denoise`](Self::denoise), leaving out what `skip` says instead of what the settings say; also what that came to.
    /// `listener` hears how far it is, 0…1 and rising, between the stages of each tile, on a thread that computes.
    pub fn denoise_with<'d>(
        &self,
        centre: &EncodedFrame,
        neighbours: &[(i32, &EncodedFrame)],
        lambda: impl Into<Dial<'d>>,
        skip: Skip,
        listener: Listener<'_>,
    ) -> Result<(Denoised, LeftOut)> {
        let dial = self.checked(lambda.into(), centre, neighbours)?;
        Ok(self.with_window(centre, neighbours, |centre, neighbours| {
            let (first, left_out) = self.run(&self.work(centre, neighbours, skip), dial, listener);
            (self.clock.time(Stage::Unpack, || first.denoised()), left_out)
        }))
    }

    /// As [`denoise_with`](Self::denoise_with), with what the settings leave out, to be kept for the [second
    /// pass](Self::second_pass) of this frame and those around it.
    ///
    /// # Errors
    /// As [`denoise`](Self::denoise).
    pub fn first_pass<'d>(
        &self,
        centre: &EncodedFrame,
        neighbours: &[(i32, &EncodedFrame)],
        lambda: impl Into<Dial<'d>>,
        listener: Listener<'_>,
    ) -> Result<(FirstPass, LeftOut)> {
        let dial = self.checked(lambda.into(), centre, neighbours)?;
        Ok(self.with_window(centre, neighbours, |centre, neighbours| {
            self.run(&self.then_second(self.work(centre, neighbours, self.settings.skip)), dial, listener)
        }))
    }

    /// The dial in its range, for frames that this engine encoded.
    fn checked<'d>(&self, dial: Dial<'d>, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)]) -> Result<Dial<'d>> {
        let dial = checked(dial, centre)?;
        if neighbours.iter().map(|n| n.1).chain([centre]).any(|f| f.features.shape().2 != self.features) {
            return Err(Error::BadInput {
                input: "frame".into(),
                reason: "was only looked at, or encoded for another network: encode it".into(),
            });
        }
        Ok(dial)
    }

    /// What `skip` leaves out of `centre`; arguments as for [`denoise`](Self::denoise), and frames that were only
    /// [looked at](Self::look) do. A neighbour counts as untrusted if no pixel of the whole frame may use it.
    pub fn left_out(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)], skip: Skip) -> LeftOut {
        self.with_window(centre, neighbours, |centre, neighbours| {
            let work = self.work(centre, neighbours, skip);
            let used = |path: &Path| {
                let frames: Vec<&PackedFrame> = path.frames.iter().map(|f| &f.packed).collect();
                !skip.untrusted || any_trusted(&frames, (path.offset, path.is_still()))
            };
            work.left_out(&work.paths.iter().map(used).collect::<Vec<_>>())
        })
    }

    /// What denoising `centre` holds in memory besides the images; arguments as for [`denoise`](Self::denoise).
    pub fn footprint(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)]) -> Footprint {
        self.with_window(centre, neighbours, |centre, neighbours| {
            let work = self.work(centre, neighbours, self.settings.skip);
            let area = self.tiles(&work).0.iter().map(|t| t.region.area()).max().unwrap_or(0);
            Footprint { window: work.window_bytes(), tile: area * self.bytes_per_pixel(&work.channels, work.paths.len()) }
        })
    }

    /// Half-resolution pixels around a part of the frame that its result depends on.
    fn halo(&self) -> usize {
        self.body.halo(self.kernel_reach())
    }

    /// Pixels around a pixel whose motion, features and colours its result depends on.
    pub(crate) fn kernel_and_body_reach(&self) -> usize {
        2 * self.halo()
    }

    /// Pixels around a pixel that its features depend on.
    pub(crate) fn encoder_reach(&self) -> usize {
        2 * self.encoder.halo()
    }

    fn kernel_reach(&self) -> usize {
        kernel_reach(self.widths, self.levels)
    }
}

/// The dial in its range, for a frame; a map with one value is that value, which costs nothing for each pixel.
fn checked<'d>(dial: Dial<'d>, centre: &EncodedFrame) -> Result<Dial<'d>> {
    let map = match dial {
        Dial::Constant(lambda) => return in_range(lambda).map(Dial::Constant),
        Dial::Map(map) => map,
    };
    let (rows, columns) = (centre.packed.rows, centre.packed.columns);
    let (found_rows, found_columns) = map.size();
    if (found_rows, found_columns) != (rows, columns) {
        return Err(Error::SizeMismatch { what: "the map of lambda".into(), columns, rows, found_columns, found_rows });
    }
    Ok(map.constant().map_or(dial, Dial::Constant))
}

mod clock;
mod denoiser;
mod encode;
mod first_pass;
#[cfg(test)]
mod golden_tests;
mod identity;
#[cfg(test)]
mod memory_tests;
mod paths;
pub(crate) mod probe;
mod second_pass;
mod settings;
mod stand_ins;
mod steps;
mod tile;
mod unpack;
mod work;
