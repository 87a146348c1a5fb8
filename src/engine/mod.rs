//! The denoiser on frames in memory: encode each frame once, denoise it with the encoded frames around it.

use ndarray::{Array2, Array3, s};

use crate::error::{Error, Result};
use crate::frame::packed::{Guides, PackedFrame};
use crate::frame::{Aov, Frame, FrameView};
use crate::kernels::Channels;
use crate::kernels::planes::Planes;
use crate::network::body::Body;
use crate::network::encoder::Encoder;
use crate::network::features::Features;
use crate::network::levels::{Levels, Margins, kernel_reach, pyramid_of};
use crate::network::pairs::Neighbour;
use crate::network::predictor::Predictor;
use crate::network::temporal::Temporal;
use crate::network::warp::{EXTRAS, Warped, centre_planes, warp};
use crate::network::weights::Weights;
use crate::plan::tiles::{Tile, tiles};
use crate::plan::window::{LAMBDA_RANGE, MAX_WINDOW};
use crate::simd::{Activation, Isa, keep_at_most};

/// What the frames in the window and one tile may take together where nothing is said.
const MEMORY: u64 = 3200 << 20;
/// What one tile takes at most and at least, whatever is allowed: a whole 1080p frame with a ±2 window takes about the most.
const TILE_MEMORY: (u64, u64) = (320 << 20, 1 << 30);

/// How to denoise.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// Bytes that the frames in the window and the buffers of one tile may take together; None is 3.1 GiB, and 320 MiB for a tile
    /// in any case. Less memory means more and smaller tiles, and the same bits.
    pub memory: Option<u64>,
    /// The instruction set; None is the fastest. AVX2 and AVX-512 give the same bits, the portable path agrees to 1e-4.
    pub isa: Option<Isa>,
    /// Threads that compute; None is rayon's pool of all cores. Any number gives the same bits.
    pub threads: Option<usize>,
}

/// A frame as the engine keeps it while it is in the window.
pub struct EncodedFrame {
    packed: PackedFrame,
    features: Features,
}

impl EncodedFrame {
    /// Bytes that this frame holds.
    pub fn bytes(&self) -> usize {
        self.packed.bytes() + self.features.bytes()
    }

    /// Whether the frame came with motion vectors.
    pub fn has_vectors(&self) -> bool {
        self.packed.vectors.is_some()
    }
}

/// One denoised frame, the same sizes and passes as the input.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// (rows, columns, 3), linear.
    pub colour: Array3<f32>,
    /// (rows, columns) where the input had alpha.
    pub alpha: Option<Array2<f32>>,
    /// In the input's order.
    pub aovs: Vec<Aov>,
}

/// The network with its weights, ready to run. Shared between threads.
pub struct Engine {
    settings: Settings,
    isa: Isa,
    pool: Option<rayon::ThreadPool>,
    encoder: Encoder,
    temporal: Temporal,
    body: Body,
    predictor: Predictor,
    features: usize,
    widths: [usize; 4],
    epsilon: f32,
    channels_per_pixel: usize,
}

impl Engine {
    /// An engine with the embedded weights.
    pub fn new(settings: Settings) -> Result<Self> {
        Self::from_weights(&Weights::embedded()?, settings)
    }

    /// An engine with the weights of a safetensors file.
    pub fn from_file(path: &std::path::Path, settings: Settings) -> Result<Self> {
        Self::from_weights(&Weights::from_file(path)?, settings)
    }

    /// An engine with weights in memory. Errors name the tensor that is missing or misshapen.
    pub fn from_weights(weights: &Weights, settings: Settings) -> Result<Self> {
        let a = &weights.architecture;
        let bad_threads = |e: rayon::ThreadPoolBuildError| Error::BadSetting { name: "threads", reason: e.to_string() };
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(bad_threads);
        Ok(Self {
            pool: settings.threads.map(pool).transpose()?,
            isa: settings.isa.unwrap_or_else(Isa::detect),
            settings,
            encoder: Encoder::new(weights)?,
            temporal: Temporal::new(weights)?,
            body: Body::new(weights)?,
            predictor: Predictor::new(weights)?,
            features: a.features,
            widths: [a.centre_taps, a.neighbour_taps, a.coarse_taps, a.albedo_taps],
            epsilon: a.albedo_epsilon,
            channels_per_pixel: 3 * a.half + a.quarter + a.eighth / 2,
        })
    }

    /// Sanitises a frame and computes its features (source encoder). Done once a frame.
    ///
    /// Errors where passes differ in size or the frame is empty.
    pub fn encode(&self, frame: Frame) -> Result<EncodedFrame> {
        let packed = self.pack(&frame.view())?;
        // Of the frame only the guides are needed from here on: large frames want the memory.
        let Frame { albedo, normal, .. } = frame;
        let guides = Guides { albedo: albedo.as_ref().map(|a| a.view()), normal: normal.as_ref().map(|n| n.view()) };
        Ok(self.finish_encoding(packed, &guides))
    }

    /// As [`Engine::encode`], for passes that lie elsewhere, in any layout; none of them is copied.
    pub fn encode_view(&self, frame: &FrameView) -> Result<EncodedFrame> {
        let guides = Guides { albedo: frame.albedo, normal: frame.normal };
        Ok(self.finish_encoding(self.pack(frame)?, &guides))
    }

    fn pack(&self, frame: &FrameView) -> Result<PackedFrame> {
        let (rows, columns) = frame.size();
        if rows == 0 || columns == 0 {
            return Err(Error::BadInput { input: "frame".into(), reason: format!("{columns}×{rows} has no pixels") });
        }
        self.in_pool(|| PackedFrame::new(frame, self.epsilon))
    }

    fn finish_encoding(&self, packed: PackedFrame, guides: &Guides) -> EncodedFrame {
        let features = self.in_pool(|| self.encoder.run(self.isa, &packed, guides));
        EncodedFrame { packed, features }
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
    pub fn denoise(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)], lambda: f32) -> Result<Denoised> {
        self.in_pool(|| self.denoise_here(centre, neighbours, lambda))
    }

    fn denoise_here(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)], lambda: f32) -> Result<Denoised> {
        let (least, most) = LAMBDA_RANGE;
        if lambda.is_nan() || lambda < least {
            return Err(Error::BadSetting { name: "lambda", reason: format!("{lambda} is not in {least}…{most}") });
        }
        let lambda = lambda.min(most);
        if neighbours.iter().map(|n| n.1).chain([centre]).any(|f| f.features.shape().2 != self.features) {
            return Err(Error::BadInput {
                input: "frame".into(),
                reason: "was encoded for another network: encode it again".into(),
            });
        }
        let paths = paths(centre, neighbours);
        let packed = &centre.packed;
        let (half_rows, half_columns) = (packed.padded_rows / 2, packed.padded_columns / 2);
        let channels = Channels::new(packed.extra, packed.has_alpha);
        let halo = self.body.halo(kernel_reach(self.widths));
        let window: usize = neighbours.iter().map(|n| n.1.bytes()).sum::<usize>() + centre.bytes();
        let left = |allowed: u64| allowed.saturating_sub(window as u64).min(TILE_MEMORY.1);
        let tile = self.settings.memory.map_or(left(MEMORY).max(TILE_MEMORY.0), left) as usize;
        let area = tile / self.bytes_per_pixel(&channels, paths.len());
        let tiles = tiles(half_rows, half_columns, halo, area);
        // Tiles of several sizes leave buffers behind that fit nothing; a single one is the same size frame after frame.
        keep_at_most(if tiles.len() == 1 { TILE_MEMORY.1 as usize } else { tile / 4 });
        if let [whole] = tiles[..] {
            return Ok(unpack(self.tile(centre, &paths, whole, channels, lambda).image, packed));
        }
        let mut out = Array3::zeros((packed.padded_rows, packed.padded_columns, channels.values));
        for tile in tiles {
            let image = self.tile(centre, &paths, tile, channels, lambda).image;
            let c = tile.core;
            out.slice_mut(s![2 * c.row..2 * (c.row + c.rows), 2 * c.column..2 * (c.column + c.columns), ..]).assign(&image);
        }
        Ok(unpack(out, packed))
    }

    /// Bytes that one half-resolution pixel of a tile takes.
    fn bytes_per_pixel(&self, channels: &Channels, neighbours: usize) -> usize {
        let images = (1 + neighbours) * (4 * channels.full() + 2 * channels.coarse());
        4 * (self.channels_per_pixel + images + neighbours * (EXTRAS + 4) + 4 * channels.values)
    }

    fn tile(&self, centre: &EncodedFrame, paths: &[Path], tile: Tile, channels: Channels, lambda: f32) -> Stages {
        let region = tile.region;
        let margins = Margins::new(self.widths[0].max(self.widths[1]).max(self.widths[3]), self.widths[2]);
        let (images, warped): (Vec<Planes>, Vec<Warped>) = paths
            .iter()
            .map(|path| {
                let frames: Vec<&PackedFrame> = path.frames.iter().map(|f| &f.packed).collect();
                warp(self.isa, &frames, path.offset, region, &channels, margins.full)
            })
            .unzip();
        let pyramid = pyramid_of(centre_planes(&centre.packed, region, &channels, margins.full), images, &channels, margins);
        let neighbours: Vec<Neighbour> =
            paths.iter().zip(&warped).map(|(path, warped)| Neighbour { features: &path.neighbour().features, warped }).collect();
        let mut mixed = Activation::empty();
        self.temporal.run(self.isa, &centre.features, &neighbours, region, &mut mixed);
        let (half_features, quarter_features) = self.body.run(self.isa, mixed, lambda);
        let levels = Levels {
            isa: self.isa,
            predictor: &self.predictor,
            channels,
            margins,
            pyramid: &pyramid,
            half: &half_features,
            quarter: &quarter_features,
            neighbours: &neighbours,
            tile,
            widths: self.widths,
        };
        let (quarter, half, image) = levels.run();
        Stages { half_features, quarter_features, quarter, half, image }
    }

    #[cfg(test)]
    fn stages(&self, centre: &EncodedFrame, neighbours: &[(i32, &EncodedFrame)], lambda: f32) -> Stages {
        let channels = Channels::new(centre.packed.extra, centre.packed.has_alpha);
        let size = (centre.packed.padded_rows / 2, centre.packed.padded_columns / 2);
        self.tile(centre, &paths(centre, neighbours), tiles(size.0, size.1, 0, usize::MAX)[0], channels, lambda)
    }
}

/// What one tile's pass leaves behind; all but the image is for the comparison with PyTorch.
#[cfg_attr(not(test), allow(dead_code))]
struct Stages {
    half_features: Activation,
    quarter_features: Activation,
    quarter: Planes,
    half: Planes,
    /// The core, (rows, columns, values).
    image: Array3<f32>,
}

/// The frames from the centre to a neighbour, one step of motion each.
struct Path<'a> {
    offset: i32,
    frames: Vec<&'a EncodedFrame>,
}

impl<'a> Path<'a> {
    fn neighbour(&self) -> &'a EncodedFrame {
        self.frames[self.frames.len() - 1]
    }
}

/// For each usable neighbour the frames from the centre to it, nearest neighbours first.
fn paths<'a>(centre: &'a EncodedFrame, neighbours: &[(i32, &'a EncodedFrame)]) -> Vec<Path<'a>> {
    let size = |f: &EncodedFrame| (f.packed.rows, f.packed.columns);
    let fits = |f: &EncodedFrame| {
        size(f) == size(centre) && f.packed.aov_names == centre.packed.aov_names && f.packed.has_alpha == centre.packed.has_alpha
    };
    let at = |offset: i32| neighbours.iter().find(|(o, f)| *o == offset && fits(f)).map(|(_, f)| *f);
    let mut out = Vec::new();
    for distance in 1..=MAX_WINDOW as i32 {
        for sign in [-1, 1] {
            let path: Option<Vec<&EncodedFrame>> = (1..=distance).map(|d| at(sign * d)).collect();
            let Some(path) = path else { continue };
            let frames: Vec<&EncodedFrame> = std::iter::once(centre).chain(path).collect();
            if frames[..frames.len() - 1].iter().all(|f| f.has_vectors()) {
                out.push(Path { offset: sign * distance, frames });
            }
        }
    }
    out
}

/// Cuts the padding off and tells the channels apart.
fn unpack(image: Array3<f32>, packed: &PackedFrame) -> Denoised {
    if image.dim() == (packed.rows, packed.columns, 3) {
        return Denoised { colour: image, alpha: None, aovs: Vec::new() };
    }
    let image = image.slice(s![..packed.rows, ..packed.columns, ..]);
    let alpha = packed.has_alpha.then(|| image.slice(s![.., .., 3]).mapv(|a| a.clamp(0.0, 1.0)));
    let first = 3 + usize::from(packed.has_alpha);
    let aov = |(i, name): (usize, &String)| Aov {
        name: name.clone(),
        image: image.slice(s![.., .., first + 3 * i..first + 3 * i + 3]).to_owned(),
    };
    let aovs = packed.aov_names.iter().enumerate().map(aov).collect();
    Denoised { colour: image.slice(s![.., .., ..3]).to_owned(), alpha, aovs }
}

#[cfg(test)]
mod golden_tests;
