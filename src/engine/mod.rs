//! The denoiser on frames in memory: encode each frame once, denoise it with the encoded frames around it.

use clock::Clock;
pub use clock::{STAGES, Stage};
pub use identity::{Identity, ModelId};
use ndarray::{Array3, s};
use paths::{Path, paths};
pub use settings::Settings;
pub use steps::Listener;
use steps::{Mark, Steps, UNHEARD};
use unpack::{own_pixels, unpack};

use crate::error::{Error, Result};
pub use crate::frame::Denoised;
use crate::frame::packed::PackedFrame;
pub use crate::frame::packed::Scales;
use crate::frame::ranges::Ranges;
use crate::kernels::Channels;
use crate::kernels::planes::Planes;
use crate::layers::Activation;
use crate::memory::BufferPool;
use crate::network::body::Body;
use crate::network::encoder::Encoder;
use crate::network::features::Features;
use crate::network::gathered::Gathered;
use crate::network::levels::{Level, Levels, Margins, Pyramid, kernel_reach, pyramid_of};
use crate::network::pairs::Neighbour;
use crate::network::predictor::Predictor;
use crate::network::temporal::Temporal;
use crate::network::warp::{EXTRAS, Warped, any_trusted, centre_planes, warp};
pub use crate::network::weights::Weights;
pub use crate::rules::skip::{LeftOut, RULES, Rule, Skip};
use crate::rules::window::LAMBDA_RANGE;
pub use crate::simd::Isa;
use crate::tiles::active::{RangePath, active_blocks};
use crate::tiles::cover::cover;
use crate::tiles::{Rect, Tile, tiles};

/// What the frames in the window and one tile may take together where nothing is said.
const MEMORY: u64 = 3200 << 20;
/// What one tile takes at most and at least, whatever is allowed: a whole 1080p frame with a ±2 window takes about the most.
const TILE_MEMORY: (u64, u64) = (320 << 20, 1200 << 20);

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
    features: Features,
}

impl EncodedFrame {
    /// Bytes that this frame holds.
    pub fn bytes(&self) -> usize {
        self.packed.bytes() + self.ranges.bytes() + self.features.bytes()
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

impl Engine {
    /// An engine with the embedded weights.
    ///
    /// ```
    /// use hush::{Engine, Error, Settings};
    ///
    /// let engine = Engine::new(Settings { threads: Some(1), ..Settings::default() })?;
    /// assert_eq!(engine.threads(), 1);
    /// let wrong = Engine::new(Settings { levels: 9, ..Settings::default() });
    /// assert!(matches!(wrong, Err(Error::BadSetting { name: "levels", .. })));
    /// # Ok::<(), Error>(())
    /// ```
    pub fn new(settings: Settings) -> Result<Self> {
        Self::from_weights(&Weights::embedded()?, settings)
    }

    /// An engine with the weights of a safetensors file.
    pub fn from_file(path: &std::path::Path, settings: Settings) -> Result<Self> {
        Self::from_weights(&Weights::from_file(path)?, settings)
    }

    /// An engine with weights in memory, and with the encoder of their first renderer or of the one that
    /// [`Weights::for_renderer`] chose. Errors name the tensor that is missing or misshapen, or a setting out of its range.
    pub fn from_weights(weights: &Weights, settings: Settings) -> Result<Self> {
        let a = &weights.architecture;
        let bad_threads = |e: rayon::ThreadPoolBuildError| Error::BadSetting { name: "threads", reason: e.to_string() };
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(bad_threads);
        Ok(Self {
            pool: settings.threads.map(pool).transpose()?,
            buffers: BufferPool::default(),
            isa: settings.isa.unwrap_or_else(Isa::detect),
            identity: Identity::new(weights.id.clone(), weights.renderer.as_deref(), settings.skip),
            settings,
            encoder: Encoder::new(weights)?,
            temporal: Temporal::new(weights)?,
            body: Body::new(weights)?,
            predictor: Predictor::new(weights)?,
            levels: a.levels,
            features: a.features,
            widths: [a.centre_taps, a.neighbour_taps, a.coarse_taps, a.albedo_taps],
            epsilon: a.albedo_epsilon,
            channels_per_pixel: 3 * a.half + a.quarter + a.eighth / 2,
            clock: Clock::default(),
        })
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

    /// Denoises `centre`.
    ///
    /// `neighbours` are (offset, frame) with offset −3…3 except 0, in any order; a neighbour farther than one frame needs those
    /// between, to chain motion vectors through, and is left out without them, as is one of another size or with other AOVs.
    /// `lambda` is in 1…64: greater is clamped, less or NaN refused. Frames encoded for a network of another width are refused.
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
    pub fn denoise(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)], lambda: f32) -> Result<Denoised> {
        self.denoise_and_tell(centre, neighbours, lambda).map(|(denoised, _)| denoised)
    }

    /// As [`denoise`](Self::denoise); tells what was left out, too.
    pub fn denoise_and_tell(
        &self,
        centre: &EncodedFrame,
        neighbours: &[(i32, &EncodedFrame)],
        lambda: f32,
    ) -> Result<(Denoised, LeftOut)> {
        self.denoise_with(centre, neighbours, lambda, self.settings.skip)
    }

    /// As [`denoise_and_tell`](Self::denoise_and_tell); `listener` hears how far it is, 0…1 and rising, between the stages of each
    /// tile, on a thread that computes.
    pub fn denoise_heard(
        &self,
        centre: &EncodedFrame,
        neighbours: &[(i32, &EncodedFrame)],
        lambda: f32,
        listener: Listener<'_>,
    ) -> Result<(Denoised, LeftOut)> {
        self.denoise_checked(centre, neighbours, lambda, self.settings.skip, listener)
    }

    /// As [`denoise_and_tell`](Self::denoise_and_tell), leaving out what `skip` says instead of what the settings say.
    pub fn denoise_with(
        &self,
        centre: &EncodedFrame,
        neighbours: &[(i32, &EncodedFrame)],
        lambda: f32,
        skip: Skip,
    ) -> Result<(Denoised, LeftOut)> {
        self.denoise_checked(centre, neighbours, lambda, skip, UNHEARD.listener)
    }

    fn denoise_checked(
        &self,
        centre: &EncodedFrame,
        neighbours: &[(i32, &EncodedFrame)],
        lambda: f32,
        skip: Skip,
        listener: Listener<'_>,
    ) -> Result<(Denoised, LeftOut)> {
        let (least, most) = LAMBDA_RANGE;
        if lambda.is_nan() || lambda < least {
            return Err(Error::BadSetting { name: "lambda", reason: format!("{lambda} is not in {least}…{most}") });
        }
        let lambda = lambda.min(most);
        if neighbours.iter().map(|n| n.1).chain([centre]).any(|f| f.features.shape().2 != self.features) {
            return Err(Error::BadInput {
                input: "frame".into(),
                reason: "was only looked at, or encoded for another network: encode it".into(),
            });
        }
        Ok(self.in_pool(|| self.run(&self.plan(centre, neighbours, skip), lambda, listener)))
    }

    /// What `skip` leaves out of `centre`; arguments as for [`denoise`](Self::denoise), and frames that were only
    /// [looked at](Self::look) do. A neighbour counts as untrusted if no pixel of the whole frame may use it.
    pub fn left_out(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)], skip: Skip) -> LeftOut {
        self.in_pool(|| {
            let plan = self.plan(centre, neighbours, skip);
            let used = |path: &Path| {
                let frames: Vec<&PackedFrame> = path.frames.iter().map(|f| &f.packed).collect();
                !skip.untrusted || any_trusted(&frames, (path.offset, path.is_still()))
            };
            plan.told(&plan.paths.iter().map(used).collect::<Vec<_>>())
        })
    }

    /// What denoising `centre` holds in memory besides the images; arguments as for [`denoise`](Self::denoise).
    pub fn footprint(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)]) -> Footprint {
        let plan = self.plan(centre, neighbours, self.settings.skip);
        let area = self.tiles(&plan).0.iter().map(|t| t.region.area()).max().unwrap_or(0);
        Footprint { window: plan.window_bytes(), tile: area * self.bytes_per_pixel(&plan.channels, plan.paths.len()) }
    }

    fn plan<'a>(&self, centre: &'a EncodedFrame, neighbours: &[(i32, &'a EncodedFrame)], skip: Skip) -> FramePlan<'a> {
        let packed = &centre.packed;
        let mut left_out = LeftOut::default();
        let mut channels = Channels::new(packed.extra, packed.has_alpha);
        let paths = paths(centre, neighbours);
        let window = || paths.iter().map(Path::neighbour).chain([centre]);
        if skip.opaque && channels.alpha && window().all(|f| f.ranges.opaque) {
            channels = channels.opaque();
            left_out.alpha = true;
        }
        let (rows, columns) = (packed.padded_rows / 2, packed.padded_columns / 2);
        let whole = Rect { row: 0, column: 0, rows, columns };
        let mut parts = vec![whole];
        if skip.constant {
            let ranges =
                |path: &Path<'a>| RangePath { frames: path.frames.iter().map(|f| &f.ranges).collect(), later: path.offset > 0 };
            let paths: Vec<RangePath> = paths.iter().map(ranges).collect();
            let active = active_blocks(&centre.ranges, &paths, 2 * self.kernel_reach());
            parts = cover(&active, rows, columns, self.halo());
            let kept: usize = parts.iter().map(|p| p.grown(self.halo(), rows, columns).area()).sum();
            left_out.constant = 1.0 - (kept as f64 / whole.area() as f64).min(1.0);
        }
        left_out.still = if skip.still { paths.iter().filter(|p| p.is_still()).count() } else { 0 };
        FramePlan { centre, paths, channels, parts, skip, left_out }
    }

    fn run(&self, plan: &FramePlan, lambda: f32, listener: Listener<'_>) -> (Denoised, LeftOut) {
        let FramePlan { centre, paths, channels, .. } = plan;
        let packed = &centre.packed;
        let (half_rows, half_columns) = (packed.padded_rows / 2, packed.padded_columns / 2);
        let (tiles, tile) = self.tiles(plan);
        // Tiles of several sizes leave buffers behind that fit nothing; a single one is the same size frame after frame.
        self.buffers.keep_at_most(if tiles.len() == 1 { TILE_MEMORY.1 as usize } else { tile / 4 });
        let covered = tiles.iter().map(|t| t.core.area()).sum::<usize>() == half_rows * half_columns;
        if let ([whole], true) = (&tiles[..], covered) {
            let stages = self.tile(plan, *whole, lambda, Steps { listener, ..UNHEARD });
            return (self.clock.time(Stage::Unpack, || unpack(stages.image, packed, channels)), plan.told(&stages.used));
        }
        let size = (packed.padded_rows, packed.padded_columns, channels.values);
        let mut out = if covered { Array3::zeros(size) } else { own_pixels(packed, channels) };
        let mut used = vec![tiles.is_empty(); paths.len()];
        let (all, mut done) = (tiles.iter().map(|t| t.region.area()).sum::<usize>() as f64, 0.0);
        for tile in tiles {
            let steps = Steps { listener, before: done, share: tile.region.area() as f64 / all };
            let stages = self.tile(plan, tile, lambda, steps);
            done += steps.share;
            let c = tile.core;
            out.slice_mut(s![2 * c.row..2 * (c.row + c.rows), 2 * c.column..2 * (c.column + c.columns), ..])
                .assign(&stages.image);
            used.iter_mut().zip(stages.used).for_each(|(all, one)| *all |= one);
        }
        (self.clock.time(Stage::Unpack, || unpack(out, packed, channels)), plan.told(&used))
    }

    /// The tiles of what is to be computed, and what one may take in bytes.
    fn tiles(&self, plan: &FramePlan) -> (Vec<Tile>, usize) {
        let packed = &plan.centre.packed;
        let (half_rows, half_columns) = (packed.padded_rows / 2, packed.padded_columns / 2);
        let left = |allowed: u64| allowed.saturating_sub(plan.window_bytes() as u64).min(TILE_MEMORY.1);
        let tile = self.settings.memory.map_or(left(MEMORY).max(TILE_MEMORY.0), left) as usize;
        let area = tile / self.bytes_per_pixel(&plan.channels, plan.paths.len());
        (plan.parts.iter().flat_map(|p| tiles(*p, half_rows, half_columns, self.halo(), area)).collect(), tile)
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

    /// Bytes that one half-resolution pixel of a tile takes.
    fn bytes_per_pixel(&self, channels: &Channels, neighbours: usize) -> usize {
        let images = (1 + neighbours) * (4 * channels.full() + 2 * channels.coarse());
        let gathered = neighbours * (self.features + EXTRAS) * 5 / 16;
        4 * (self.channels_per_pixel + images + neighbours * (EXTRAS + 4) + gathered + 4 * channels.values)
    }

    fn tile(&self, plan: &FramePlan, tile: Tile, lambda: f32, steps: Steps<'_>) -> Stages {
        let (centre, channels, skip, region) = (plan.centre, plan.channels, plan.skip, tile.region);
        let margins = Margins::new(self.widths[0].max(self.widths[1]).max(self.widths[3]), self.widths[2]);
        let seen = plan.paths.iter().enumerate().map(|(index, path)| {
            let frames: Vec<&PackedFrame> = path.frames.iter().map(|f| &f.packed).collect();
            let still = skip.still && path.is_still();
            let offset = (path.offset, still);
            let warped =
                self.clock.time(Stage::Warp, || warp(self.isa, &frames, offset, region, &channels, margins.full, &self.buffers));
            steps.reached(Mark::WARPED.part(index + 1, plan.paths.len()));
            (path, warped)
        });
        let mut used = Vec::with_capacity(plan.paths.len());
        let seen = seen.filter(|(_, (_, warped))| {
            used.push(warped.trusted || !skip.untrusted);
            warped.trusted || !skip.untrusted
        });
        let (paths, (images, warped)): (Vec<&Path>, (Vec<Planes>, Vec<Warped>)) = seen.unzip();
        let pyramid = self.clock.time(Stage::Coarse, || {
            let own = centre_planes(self.isa, &centre.packed, region, &channels, margins.full, &self.buffers);
            let full = Level { centre: own, neighbours: images };
            pyramid_of(self.isa, full, &channels, margins, (self.levels, centre.packed.exposure))
        });
        steps.reached(Mark::PYRAMID);
        let neighbours: Vec<Neighbour> =
            paths.iter().zip(&warped).map(|(path, warped)| Neighbour { features: &path.neighbour().features, warped }).collect();
        let (mixed, gathered) = self.clock.time(Stage::Temporal, || {
            let (mixed, quarter) = self.temporal.run(self.isa, &centre.features, &neighbours, region, &self.buffers);
            let eighth = quarter.halved();
            (mixed, [quarter, eighth])
        });
        steps.reached(Mark::TEMPORAL);
        let features = self.clock.time(Stage::Body, || self.body.run(self.isa, mixed, lambda));
        steps.reached(Mark::BODY);
        let levels = Levels {
            isa: self.isa,
            predictor: &self.predictor,
            channels,
            margins,
            pyramid: &pyramid,
            features: &features,
            neighbours: &neighbours,
            gathered: &gathered,
            tile,
            widths: self.widths,
        };
        let coarse = self.clock.time(Stage::Coarse, || levels.coarse());
        steps.reached(Mark::COARSE);
        let image = self.clock.time(Stage::Full, || levels.full(coarse.last()));
        steps.reached(Mark::FULL);
        Stages { features, gathered, pyramid, coarse, image, used }
    }

    #[cfg(test)]
    fn stages(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)], lambda: f32) -> Stages {
        let plan = self.plan(centre, neighbours, self.settings.skip);
        let whole = Rect { row: 0, column: 0, rows: centre.packed.padded_rows / 2, columns: centre.packed.padded_columns / 2 };
        self.tile(&plan, Tile { core: whole, region: whole }, lambda, UNHEARD)
    }
}

/// What is computed of one frame, and from what.
struct FramePlan<'a> {
    centre: &'a EncodedFrame,
    paths: Vec<Path<'a>>,
    channels: Channels,
    /// In half-resolution pixels; the rest keeps its own pixels.
    parts: Vec<Rect>,
    skip: Skip,
    left_out: LeftOut,
}

impl FramePlan<'_> {
    /// Bytes that the frames of the window hold.
    fn window_bytes(&self) -> usize {
        self.paths.iter().map(|p| p.neighbour().bytes()).sum::<usize>() + self.centre.bytes()
    }

    /// What was left out, once it is known which neighbours had anything to give.
    fn told(&self, used: &[bool]) -> LeftOut {
        LeftOut { untrusted: used.iter().filter(|used| !**used).count(), ..self.left_out }
    }
}

/// What one tile's pass leaves behind; all but the image is for the comparison with PyTorch.
#[cfg_attr(not(test), allow(dead_code))]
struct Stages {
    /// The body's, at half, quarter and eighth resolution.
    features: [Activation; 3],
    gathered: [Gathered; 2],
    pyramid: Pyramid,
    /// The denoised coarser levels, half resolution last.
    coarse: Vec<Planes>,
    /// The core, (rows, columns, values).
    image: Array3<f32>,
    /// For each neighbour whether it had any pixel to give.
    used: Vec<bool>,
}

mod clock;
mod encode;
#[cfg(test)]
mod golden_tests;
mod identity;
#[cfg(test)]
mod memory_tests;
mod paths;
pub(crate) mod probe;
mod settings;
mod steps;
mod unpack;
