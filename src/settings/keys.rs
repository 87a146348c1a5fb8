//! The settings by name: in the side file, in USD, on the command line, and what holds where none says anything.

/// A setting's names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key {
    /// In `hush.toml`; with a dot for a key of a table.
    pub name: &'static str,
    /// The attribute of a render prim.
    pub usd: &'static str,
    /// The attribute's type, as `hush shot write` authors it.
    pub usd_type: &'static str,
    /// On the command line; empty where there is none.
    pub option: &'static str,
    /// In words.
    pub default: &'static str,
}

const fn key(name: &'static str, usd: &'static str, usd_type: &'static str, option: &'static str, default: &'static str) -> Key {
    Key { name, usd, usd_type, option, default }
}

/// All settings, in the order that `hush shot show` prints them.
pub const KEYS: [Key; 20] = [
    key("enable", "denoise:enable", "bool", "--enable", "true"),
    key("input", "hush:input", "string", "INPUT", "the folder or pattern named"),
    key("output", "hush:output", "string", "--output", "none"),
    key("frames", "hush:frames", "string", "--frames", "all"),
    key("lambda", "hush:lambda", "float", "--lambda", "1"),
    key("window", "hush:window", "int", "--window", "2 with a Vector pass, else 0"),
    key("layers", "hush:layers", "token[]", "--layer", "the one with the most samples"),
    key("view", "hush:view", "token", "--view", "all"),
    key("vector_layer", "hush:vectorLayer", "token", "--vector-layer", "Hush Vectors where it is there, else the layer denoised"),
    key("aovs", "hush:aovs", "token[]", "--aov", "none"),
    key("guides", "hush:guides", "token[]", "--guides", "albedo, normal, depth, vector"),
    key("passes.beauty", "hush:passes:beauty", "string", "", "Combined"),
    key("passes.albedo", "hush:passes:albedo", "string", "", "Denoising Albedo"),
    key("passes.normal", "hush:passes:normal", "string", "", "Denoising Normal"),
    key("passes.depth", "hush:passes:depth", "string", "", "Denoising Depth, Depth"),
    key("passes.vector", "hush:passes:vector", "string", "", "Vector"),
    key("keep_noisy", "hush:keepNoisy", "bool", "--keep-noisy", "false"),
    key("model", "hush:model", "string", "--model", "in the binary"),
    key("renderer", "hush:renderer", "token", "--renderer", "cycles"),
    key("memory", "hush:memory", "string", "--memory", "3.1G"),
];

/// Does something for each setting, by its name and its place in [`ShotSettings`](super::ShotSettings).
macro_rules! each_setting {
    ($do:ident) => {
        $do! {
            "enable" => enable, "input" => input, "output" => output, "frames" => frames, "lambda" => lambda,
            "window" => window, "layers" => layers, "view" => view, "vector_layer" => vector_layer, "aovs" => aovs,
            "guides" => guides, "passes.beauty" => passes.beauty, "passes.albedo" => passes.albedo,
            "passes.normal" => passes.normal, "passes.depth" => passes.depth, "passes.vector" => passes.vector,
            "keep_noisy" => keep_noisy, "model" => model, "renderer" => renderer, "memory" => memory
        }
    };
}
pub(super) use each_setting;
