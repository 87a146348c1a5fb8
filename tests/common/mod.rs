//! Small synthetic shots for the tests of the runner.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, WritableImage,
};
use hush::shot::{CancelToken, Event, Job, Manifest, Status, Summary, run};
use hush::{Engine, Settings, io::sequence::Sequence};

/// What a synthetic frame looks like.
#[derive(Clone, Copy)]
pub struct Look {
    pub columns: usize,
    pub rows: usize,
    /// Noise seed; the frame number if None.
    pub seed: Option<u32>,
    /// The Vector pass's value everywhere, no pass if None.
    pub vector: Option<f32>,
    /// A Noisy Image beside Combined.
    pub noisy_image: bool,
    pub compression: Compression,
    pub layers: &'static [&'static str],
    /// The data window's upper left corner.
    pub origin: (i32, i32),
    /// A shader AOV `Hush Lambda`, by row and column.
    pub mask: Option<fn(usize, usize) -> f32>,
    /// Combined's alpha, by row and column.
    pub alpha: Option<fn(usize, usize) -> f32>,
}

impl Look {
    /// What most tests want.
    pub const PLAIN: Self = Self {
        columns: 24,
        rows: 16,
        seed: None,
        vector: Some(0.25),
        noisy_image: false,
        compression: Compression::ZIP16,
        layers: &["ViewLayer"],
        origin: (0, 0),
        mask: None,
        alpha: None,
    };
}

impl Default for Look {
    fn default() -> Self {
        Self::PLAIN
    }
}

/// Writes a frame as Blender 4 does: one part, `ViewLayer.Pass.Component`.
pub fn write_frame(path: &Path, number: i64, look: Look) {
    let size = look.columns * look.rows;
    let seed = look.seed.unwrap_or(number as u32 + 1);
    let noise = |channel: u32| -> Vec<f32> {
        let mut state = seed.wrapping_mul(747_796_405) ^ channel.wrapping_mul(2_891_336_453) | 1;
        let mut next = || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            (state >> 8) as f32 / (1 << 24) as f32
        };
        (0..size).map(|_| next()).collect()
    };
    let mut channels = Vec::new();
    for (index, layer) in look.layers.iter().enumerate() {
        let mut add = |name: &str, values: Vec<f32>| {
            channels.push(AnyChannel::new(format!("{layer}.{name}").as_str(), FlatSamples::F32(values)))
        };
        for (i, c) in (100 * index as u32..).zip(["R", "G", "B"]) {
            add(&format!("Combined.{c}"), noise(i));
            add(&format!("Denoising Albedo.{c}"), vec![0.5; size]);
            if look.noisy_image {
                add(&format!("Noisy Image.{c}"), noise(10 + i));
            }
        }
        for (c, v) in [("X", 0.0), ("Y", 0.0), ("Z", -1.0)] {
            add(&format!("Denoising Normal.{c}"), vec![v; size]);
        }
        add("Denoising Depth.Z", vec![3.0; size]);
        if let Some(alpha) = look.alpha {
            add("Combined.A", plane(look, alpha));
        }
        if let Some(mask) = look.mask {
            add("Hush Lambda.X", plane(look, mask));
        }
        for c in ["X", "Y", "Z", "W"] {
            if let Some(v) = look.vector {
                add(&format!("Vector.{c}"), vec![v; size]);
            }
        }
    }
    let list = AnyChannels::sort(SmallVec::from_vec(channels));
    let encoding = Encoding { compression: look.compression, ..Encoding::FAST_LOSSLESS };
    let place = LayerAttributes { layer_position: look.origin.into(), ..LayerAttributes::default() };
    let layer = Layer::new((look.columns, look.rows), place, encoding, list);
    Image::from_layer(layer).write().to_file(path).unwrap();
}

/// A plane of a frame's size.
fn plane(look: Look, value: fn(usize, usize) -> f32) -> Vec<f32> {
    (0..look.rows * look.columns).map(|i| value(i / look.columns, i % look.columns)).collect()
}

/// Writes a mask image of one channel, or of grey R, G, B.
pub fn write_mask(path: &Path, look: Look, grey: bool, value: fn(usize, usize) -> f32) {
    let names: &[&str] = if grey { &["R", "G", "B"] } else { &["V"] };
    let channel = |name: &&str| AnyChannel::new(*name, FlatSamples::F32(plane(look, value)));
    let list = AnyChannels::sort(SmallVec::from_vec(names.iter().map(channel).collect()));
    let layer = Layer::new((look.columns, look.rows), LayerAttributes::default(), Encoding::FAST_LOSSLESS, list);
    Image::from_layer(layer).write().to_file(path).unwrap();
}

/// A scratch folder with `shot/` in it; outputs go to `out/`.
pub struct Shot {
    pub dir: tempfile::TempDir,
    pub engine: Engine,
}

impl Shot {
    /// A shot of these frames, all alike.
    pub fn new(numbers: impl IntoIterator<Item = i64>, look: Look) -> Self {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("shot")).unwrap();
        let shot = Self { dir, engine: Engine::new(Settings::default()).unwrap() };
        numbers.into_iter().for_each(|n| write_frame(&shot.input(n), n, look));
        shot
    }

    pub fn folder(&self) -> PathBuf {
        self.dir.path().join("shot")
    }

    pub fn out(&self) -> PathBuf {
        self.dir.path().join("out")
    }

    pub fn input(&self, number: i64) -> PathBuf {
        self.folder().join(name(number))
    }

    pub fn output(&self, number: i64) -> PathBuf {
        self.out().join(name(number))
    }

    /// Cuts a frame's file so that its header is sound and its pixels are not all there.
    pub fn truncate(&self, number: i64) {
        let bytes = std::fs::read(self.input(number)).unwrap();
        std::fs::write(self.input(number), &bytes[..bytes.len() * 3 / 4]).unwrap();
    }

    /// Renders a frame again: other noise, and a date apart from what it was.
    pub fn render_again(&self, number: i64) {
        write_frame(&self.input(number), number, Look { seed: Some(number as u32 + 1000), ..Look::default() });
        let file = std::fs::File::options().write(true).open(self.input(number)).unwrap();
        file.set_modified(std::time::SystemTime::now() - std::time::Duration::from_secs(100)).unwrap();
    }

    pub fn job(&self) -> Job {
        Job::new(Sequence::find(&[self.folder()]).unwrap(), self.out())
    }

    /// A file of the same weights under another name, which makes them other ones.
    pub fn other_weights(&self) -> PathBuf {
        let path = self.dir.path().join("b.safetensors");
        std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/models/hush.safetensors"), &path).unwrap();
        path
    }

    pub fn manifest(&self) -> Manifest {
        Manifest::load(&self.out()).unwrap()
    }

    /// Names in the output folder without the manifest, hidden ones too.
    pub fn written(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.out()).into_iter().flatten();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.retain(|n| n != hush::shot::MANIFEST);
        names.sort();
        names
    }

    pub fn run(&self, job: &Job) -> Outcome {
        self.run_until(job, &CancelToken::new(), |_| {})
    }

    /// Runs with a look at each event.
    pub fn run_until(&self, job: &Job, cancel: &CancelToken, see: impl Fn(&Event<'_>)) -> Outcome {
        let log = RefCell::new(Log::default());
        let report = |event: Event<'_>| {
            see(&event);
            log.borrow_mut().take(&event);
        };
        let summary = run(job, &self.engine, &report, cancel);
        Outcome { summary, log: log.into_inner() }
    }
}

/// `f_0001.exr`.
pub fn name(number: i64) -> String {
    format!("f_{number:04}.exr")
}

/// What a run said.
#[derive(Default, Debug)]
pub struct Log {
    /// Frame, status, neighbours.
    pub frames: Vec<(i64, Status, Vec<i64>)>,
    pub warnings: Vec<(String, String)>,
    pub errors: Vec<(Option<i64>, String)>,
    pub done: usize,
}

impl Log {
    fn take(&mut self, event: &Event<'_>) {
        match event {
            Event::Frame { frame, status, neighbours, .. } => self.frames.push((*frame, *status, neighbours.clone())),
            Event::Warning(w) => {
                let kind = serde_json::to_value(w.kind).unwrap().as_str().unwrap().to_owned();
                self.warnings.push((kind, w.message.clone()));
            }
            Event::Error { frame, message } => self.errors.push((*frame, message.clone())),
            Event::Done(_) => self.done += 1,
            _ => {}
        }
    }

    pub fn with(&self, status: Status) -> Vec<i64> {
        self.frames.iter().filter(|f| f.1 == status).map(|f| f.0).collect()
    }

    pub fn neighbours(&self, number: i64) -> Vec<i64> {
        self.frames.iter().find(|f| f.0 == number).map(|f| f.2.clone()).unwrap_or_default()
    }

    pub fn kinds(&self) -> Vec<&str> {
        self.warnings.iter().map(|w| w.0.as_str()).collect()
    }
}

pub struct Outcome {
    pub summary: hush::Result<Summary>,
    pub log: Log,
}

impl Outcome {
    pub fn summary(&self) -> &Summary {
        self.summary.as_ref().unwrap()
    }

    pub fn error(&self) -> String {
        self.summary.as_ref().expect_err("should be refused").to_string()
    }
}
