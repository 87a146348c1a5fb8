//! A shot's settings as options, and the files to take others from.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::error::Result;
use crate::rules::lambda::Lambda;
use crate::settings::size::parse_size;
use crate::settings::{Guide, Layered, Origin, ShotSettings, Sources, StageRef, gather, read_apart};

/// The settings that every command on shots takes alike.
#[derive(Args)]
pub(super) struct SettingArgs {
    #[command(flatten)]
    dial: DialArgs,
    #[command(flatten)]
    look: LookArgs,
}

/// The settings that a preview tries several of.
#[derive(Args)]
struct DialArgs {
    /// From 1 (cleanest) to 64 (keeps grain and the detail hidden in it); 1:1,24:8 goes from 1 at frame 1 to 8 at frame 24
    /// [default: 1]
    #[arg(short, long, allow_hyphen_values = true)]
    lambda: Option<Lambda>,
    /// Frames on each side that help, 0 to 3 [default: 2 where there is a Vector pass, else 0]
    #[arg(short, long)]
    window: Option<usize>,
}

/// The other settings: what is read, and with what.
#[derive(Args)]
pub(super) struct LookArgs {
    /// View layer to denoise; may be given several times [default: the one with the most samples]
    #[arg(long = "layer", value_name = "NAME|all")]
    layers: Vec<String>,
    /// Stereo view to denoise [default: all]
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// View layer to take the Vector pass from, such as one without motion blur [default: Hush Vectors where the file holds it, else
    /// the layer denoised]
    #[arg(long, value_name = "NAME")]
    vector_layer: Option<String>,
    /// Light pass to denoise along, such as "Diffuse Direct", or all, or none; may be given several times
    #[arg(long = "aov", value_name = "NAME|all|none")]
    aovs: Vec<String>,
    /// Guides that may be used, such as albedo,normal, or none [default: albedo,normal,depth,vector]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    guides: Vec<String>,
    /// Do without the Denoising Albedo
    #[arg(long)]
    no_albedo: bool,
    /// Do without the Denoising Normal
    #[arg(long)]
    no_normal: bool,
    /// Do without depth
    #[arg(long)]
    no_depth: bool,
    /// Do without motion vectors, and so without neighbours
    #[arg(long)]
    no_vector: bool,
    /// Keep the input beside the result as "Noisy Image"
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    keep_noisy: Option<bool>,
    /// Memory for the frames in the window and the computing, such as 4G; reading and writing come on top [default: 3.1G]
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    memory: Option<u64>,
    /// Other weights, a safetensors file
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Renderer that made the frames, one that the weights have an encoder for: cycles or mitsuba [default: cycles]
    #[arg(long, value_name = "NAME")]
    renderer: Option<String>,
    /// Denoise although the shot's settings switch it off
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    enable: Option<bool>,
}

impl SettingArgs {
    /// What the options say.
    pub fn given(&self) -> Result<ShotSettings> {
        let DialArgs { lambda, window } = &self.dial;
        Ok(ShotSettings { lambda: lambda.clone(), window: *window, ..self.look.given()? })
    }

    /// Takes out of the guides what `--no-…` says, whoever named them.
    pub fn without_guides(&self, settings: Layered) -> Layered {
        self.look.without_guides(settings)
    }
}

impl LookArgs {
    /// What the options say.
    pub fn given(&self) -> Result<ShotSettings> {
        let list = |names: &[String]| {
            let kept = names.iter().filter(|n| !n.eq_ignore_ascii_case("none")).cloned();
            (!names.is_empty()).then(|| kept.collect::<Vec<_>>())
        };
        let guides = list(&self.guides).map(|names| names.iter().map(|n| n.parse()).collect()).transpose()?;
        Ok(ShotSettings {
            enable: self.enable,
            layers: list(&self.layers),
            view: self.view.clone(),
            vector_layer: self.vector_layer.clone(),
            aovs: list(&self.aovs),
            guides,
            keep_noisy: self.keep_noisy,
            model: self.model.clone(),
            renderer: self.renderer.clone(),
            memory: self.memory,
            ..ShotSettings::default()
        })
    }

    /// Takes out of the guides what `--no-…` says, whoever named them.
    pub fn without_guides(&self, settings: Layered) -> Layered {
        let switches = [
            (self.no_albedo, Guide::Albedo, "--no-albedo"),
            (self.no_normal, Guide::Normal, "--no-normal"),
            (self.no_depth, Guide::Depth, "--no-depth"),
            (self.no_vector, Guide::Vector, "--no-vector"),
        ];
        let off: Vec<_> = switches.iter().filter(|(off, ..)| *off).collect();
        if off.is_empty() {
            return settings;
        }
        let mut guides = settings.values.guides.clone().unwrap_or_else(|| switches.map(|(_, guide, _)| guide).to_vec());
        guides.retain(|guide| !off.iter().any(|(_, without, _)| without == guide));
        let option = off.iter().map(|(.., option)| *option).collect::<Vec<_>>().join(" ");
        let left = ShotSettings { guides: Some(guides), ..ShotSettings::default() };
        Layered::new(left, |_| Origin::CommandLine { option: option.clone() }).over(settings)
    }
}

/// Files with settings.
#[derive(Args, Clone)]
pub(super) struct SourceArgs {
    /// USD stage to take settings from, perhaps with the render prim to start from
    #[arg(long, value_name = "FILE[@/PRIM]")]
    pub usd: Option<StageRef>,
    /// Settings file to take instead of the hush.toml or hush.json beside the frames
    #[arg(long, value_name = "FILE", conflicts_with = "no_settings")]
    pub settings: Option<PathBuf>,
    /// Leave the hush.toml or hush.json beside the frames alone
    #[arg(long)]
    pub no_settings: bool,
}

impl SourceArgs {
    /// The settings from all sources, for the frames in `folder` if that is known.
    pub fn gather(&self, folder: Option<&Path>, given: ShotSettings) -> Result<Layered> {
        let sources =
            Sources { usd: self.usd.clone(), file: self.settings.clone(), look_beside: !self.no_settings, read_usd: &read_apart };
        gather(folder, &sources, given)
    }
}

/// The folder that a file lies in.
pub(super) fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
