//! Every setting of a shot, declared once: its type, range, default, help, and its names in `hush.toml`, in USD, on the command line
//! and in Python. The command's options, the readers and writers of files, what makes a frame out of date, the schema, the Python
//! types, the extension's table and the table in the docs all follow from here (`tests/generated.rs` writes the last four).

use std::path::PathBuf;

use super::Effect::{Engine, Pixels};
use super::declare::settings;
use super::kind::{GUIDES, Kind, SKIP};
use crate::rules::frames::FrameSet;
use crate::rules::lambda::Lambda;
use crate::rules::skip::Rule;
use crate::rules::window::MAX_WINDOW;

settings! {
    /// Denoise the shot at all; true denoises also where other settings of the shot say false.
    enable: bool { kind: Kind::Flag, usd: "denoise:enable", option: "--enable", default: "true" }

    /// The frames: a folder, a pattern such as render/frame_####.exr, a glob or a file.
    input: PathBuf { kind: Kind::Path, usd: "hush:input", argument: "INPUT", default: "the folder or pattern named" }

    /// Folder for the denoised frames; never the one with the inputs.
    output: PathBuf { kind: Kind::Path, usd: "hush:output", option: "--output", short: 'o', argument: "DIR", default: "none" }

    /// Frames, such as 1-48,60; those beside them still help.
    frames: FrameSet { kind: Kind::Frames, usd: "hush:frames", option: "--frames", short: 'f', argument: "FRAMES", default: "all" }

    /// How much noise and hidden detail to keep, from 1 (cleanest) to 64; 1:1,24:8 goes from 1 at frame 1 to 8 at frame 24.
    lambda: Lambda {
        kind: Kind::Lambda, effect: Pixels, usd: "hush:lambda", option: "--lambda", short: 'l', argument: "LAMBDA", python: "lam",
        default: "1",
    }

    /// The lambda of what a mask marks, where lambda pass or lambda images name one; may change over the shot as lambda does.
    lambda_masked: Lambda {
        kind: Kind::Lambda, effect: Pixels, usd: "hush:lambdaMasked", option: "--lambda-masked", argument: "LAMBDA", default: "16",
    }

    /// The pass that is the mask, such as a shader AOV: 0 keeps lambda, 1 has lambda masked, between them both are mixed.
    lambda_pass: String { kind: Kind::Name, effect: Pixels, usd: "hush:lambdaPass", option: "--lambda-pass", argument: "NAME", default: "none" }

    /// Images that are the mask, such as masks/mask_####.exr, instead of a pass.
    lambda_images: PathBuf {
        kind: Kind::Path, effect: Pixels, usd: "hush:lambdaImages", option: "--lambda-images", argument: "PATTERN", default: "none",
    }

    /// Frames on each side that help, 0 to 3.
    window: usize {
        kind: Kind::Whole { least: 0, most: MAX_WINDOW as u64 }, effect: Pixels, usd: "hush:window", option: "--window", short: 'w',
        argument: "FRAMES", default: "2 with a Vector pass, else 0",
    }

    /// View layers to denoise, or all.
    layers: Vec<String> {
        kind: Kind::Names, effect: Pixels, usd: "hush:layers", option: "--layer", argument: "NAME|all",
        default: "the one with the most samples",
    }

    /// Stereo view to denoise.
    view: String { kind: Kind::Name, effect: Pixels, usd: "hush:view", option: "--view", argument: "NAME", default: "all" }

    /// View layer to take the Vector pass from, such as one without motion blur.
    vector_layer: String {
        kind: Kind::Name, effect: Pixels, usd: "hush:vectorLayer", option: "--vector-layer", argument: "NAME",
        default: "Hush Vectors where the file holds it, else the layer denoised",
    }

    /// Light passes to denoise along, such as "Diffuse Direct", or all, or none.
    aovs: Vec<String> {
        kind: Kind::Names, effect: Pixels, usd: "hush:aovs", option: "--aov", argument: "NAME|all|none", default: "none",
    }

    /// Guides that may be used, of albedo, normal, depth, vector, or none; without vector no neighbour helps.
    guides: Vec<Guide> {
        kind: Kind::Choices(&GUIDES), effect: Pixels, usd: "hush:guides", option: "--guides", argument: "LIST",
        default: "albedo, normal, depth, vector",
    }

    /// The beauty's name in the files: R, G, B and perhaps A.
    passes_beauty: String { name: "passes.beauty", kind: Kind::Text, effect: Pixels, usd: "hush:passes:beauty", default: "Combined" }

    /// The albedo's name in the files: R, G, B.
    passes_albedo: String {
        name: "passes.albedo", kind: Kind::Text, effect: Pixels, usd: "hush:passes:albedo", default: "Denoising Albedo",
    }

    /// The normals' name in the files: X, Y, Z or R, G, B.
    passes_normal: String {
        name: "passes.normal", kind: Kind::Text, effect: Pixels, usd: "hush:passes:normal", default: "Denoising Normal",
    }

    /// The depth's name in the files: one channel.
    passes_depth: String {
        name: "passes.depth", kind: Kind::Text, effect: Pixels, usd: "hush:passes:depth", default: "Denoising Depth, Depth",
    }

    /// The motion vectors' name in the files: X, Y, Z, W as Cycles has them.
    passes_vector: String { name: "passes.vector", kind: Kind::Text, effect: Pixels, usd: "hush:passes:vector", default: "Vector" }

    /// Keep the input beside the result as Noisy Image.
    keep_noisy: bool { kind: Kind::Flag, effect: Pixels, usd: "hush:keepNoisy", option: "--keep-noisy", default: "false" }

    /// The rules by which work may be left out, of constant, opaque, untrusted, still, or none.
    skip: Vec<Rule> {
        kind: Kind::Choices(&SKIP), effect: Engine, usd: "hush:skip", option: "--skip", argument: "LIST",
        default: "constant, opaque, untrusted, still",
    }

    /// A second pass over time, which averages each result with those around it: a little less flicker, from twice the frames around.
    second_pass: bool { kind: Kind::Flag, effect: Engine, usd: "hush:secondPass", option: "--second-pass", default: "false" }

    /// Other weights, a safetensors file.
    model: PathBuf { kind: Kind::Path, effect: Engine, usd: "hush:model", option: "--model", argument: "FILE", default: "in the program" }

    /// What made the frames, one that the weights have an encoder for: cycles or mitsuba.
    renderer: String { kind: Kind::Name, effect: Engine, usd: "hush:renderer", option: "--renderer", argument: "NAME", default: "cycles" }

    /// Memory for the frames in the window and the computing, such as 4G; less is slower and gives the same pixels.
    memory: u64 { kind: Kind::Size, usd: "hush:memory", option: "--memory", argument: "SIZE", default: "3.1G" }

    /// Threads for computing; any number gives the same pixels.
    threads: usize {
        kind: Kind::Whole { least: 1, most: 4096 }, usd: "hush:threads", option: "--threads", argument: "NUMBER",
        default: "all cores",
    }
}

/// A pass that guides the denoiser.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Guide {
    /// Denoising Albedo.
    Albedo,
    /// Denoising Normal.
    Normal,
    /// Denoising Depth or Depth.
    Depth,
    /// Motion vectors; without them no neighbour helps.
    Vector,
}

/// The settings that a preview takes in its own way or not at all.
pub const NOT_OF_A_PREVIEW: [&str; 5] = ["output", "frames", "lambda", "window", "keep_noisy"];
