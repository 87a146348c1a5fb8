//! `hush shot`: what a shot's settings are, and writing them into a USD layer.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::{Map, Value, json};

use super::advice::with_options;
use super::job_args::JobArgs;
use super::setting_args::{SettingArgs, SourceArgs};
use super::{Exit, print, print_json, say};
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;
use crate::io::write_atomically;
use crate::rules::frames::FrameSet;
use crate::settings::{KEYS, Key, Layered, ShotSettings, usd};

/// A shot's settings: where each comes from, and writing them into a USD layer
#[derive(Args)]
pub(super) struct ShotArgs {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Show(Box<ShowArgs>),
    Write(Box<WriteArgs>),
}

/// Prints the settings that a run would use, each with the file and prim, the key or the option it comes from
#[derive(Args)]
struct ShowArgs {
    /// The frames as for denoise, a USD stage, or a settings file
    #[arg(value_name = "INPUT|FILE")]
    input: Option<PathBuf>,
    #[command(flatten)]
    job: JobArgs,
    /// One JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// Writes settings into a .usda layer, over an existing stage or for other stages to take in
///
/// Over a stage (--sublayer) they become opinions on its render prim. Where there is no stage, or none with a render prim, a
/// new RenderPass is written, /Render/Denoise.
#[derive(Args)]
struct WriteArgs {
    /// The layer to write, a .usda file
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Existing stage that the layer lies over
    #[arg(long, value_name = "FILE")]
    sublayer: Option<PathBuf>,
    /// Render prim that gets the settings [default: the only one of the sublayer]
    #[arg(long, value_name = "/PATH")]
    prim: Option<String>,
    /// The frames, as hush:input
    #[arg(long, value_name = "INPUT")]
    input: Option<PathBuf>,
    /// The folder for the denoised frames, as hush:output
    #[arg(long, value_name = "DIR")]
    to: Option<PathBuf>,
    /// Frames to write, as hush:frames
    #[arg(short, long, allow_hyphen_values = true)]
    frames: Option<FrameSet>,
    #[command(flatten)]
    settings: SettingArgs,
    #[command(flatten)]
    sources: SourceArgs,
    /// Replace the layer if it is there
    #[arg(long)]
    overwrite: bool,
}

/// Runs the subcommand.
pub(super) fn shot(args: &ShotArgs) -> Result<Exit> {
    match &args.command {
        Command::Show(args) => show(args),
        Command::Write(args) => write(args),
    }
}

fn show(args: &ShowArgs) -> Result<Exit> {
    let extension = args.input.as_deref().and_then(Path::extension).map(|e| e.to_string_lossy().to_ascii_lowercase());
    let settings = match (&args.input, extension.as_deref()) {
        (None, _) => args.job.settings(None)?,
        (Some(stage), Some("usd" | "usda" | "usdc" | "usdz")) => args.job.settings_with(Some(stage), None)?,
        (Some(text), _) if text.to_string_lossy().contains("@/") => args.job.settings_with(Some(text), None)?,
        (Some(file), Some("toml" | "json")) => args.job.settings_with(None, Some(file))?,
        (Some(input), _) => args.job.settings_of(&Sequence::find(&[input])?)?,
    };
    match args.json {
        true => print_json(&as_json(&settings)),
        false => print(as_table(&settings).trim_end()),
    }
    settings.notes.iter().for_each(|note| say(format_args!("warning: {}", with_options(note))));
    Ok(Exit::Good)
}

fn as_json(settings: &Layered) -> Value {
    let entry = |key: &Key| {
        let mut entry = serde_json::to_value(settings.origin(key.name)).ok()?;
        entry.as_object_mut()?.insert("value".into(), settings.value(key.name));
        Some((key.name.to_owned(), entry))
    };
    json!({ "settings": KEYS.iter().filter_map(entry).collect::<Map<_, _>>(), "notes": settings.notes })
}

fn as_table(settings: &Layered) -> String {
    let text = |key: &Key| match (settings.value(key.name), &settings.values.lambda) {
        (Value::Null, _) => key.default.to_owned(),
        (_, Some(lambda)) if key.name == "lambda" => lambda.to_string(),
        (Value::String(text), _) => text,
        (Value::Array(items), _) if items.is_empty() => "none".into(),
        (Value::Array(items), _) => {
            items.iter().map(|v| v.as_str().map_or_else(|| v.to_string(), str::to_owned)).collect::<Vec<_>>().join(", ")
        }
        (other, _) => other.to_string(),
    };
    let rows: Vec<(&str, String, String)> =
        KEYS.iter().map(|key| (key.name, text(key), settings.origin(key.name).to_string())).collect();
    let width = rows.iter().map(|(_, value, _)| value.chars().count()).max().unwrap_or(0).min(60);
    let mut table = String::new();
    for (name, value, origin) in rows {
        let _ = writeln!(table, "{name:<14} {value:<width$}  {origin}");
    }
    table
}

fn write(args: &WriteArgs) -> Result<Exit> {
    if !args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("usda")) {
        return Err(Error::bad_file(&args.output, "is no .usda file: layers are written as text"));
    }
    if args.output.exists() && !args.overwrite {
        return Err(Error::bad_file(&args.output, "is there already: pass --overwrite to replace it"));
    }
    let (input, output) = (args.input.clone(), args.to.clone());
    let given = ShotSettings { input, output, frames: args.frames.clone(), ..args.settings.given()? };
    let settings = args.settings.without_guides(args.sources.gather(None, given)?);
    if settings.given().next().is_none() {
        let reason = "there is nothing to write: give settings, such as --lambda 4, or --settings hush.toml";
        return Err(Error::BadInput { input: "hush shot write".into(), reason: reason.into() });
    }
    settings
        .notes
        .iter()
        .chain(&settings.values.lambda.as_ref().and_then(|l| l.note()))
        .for_each(|note| say(format_args!("warning: {}", with_options(note))));
    let text = usd::write(&args.output, &settings, args.prim.as_deref(), args.sublayer.as_deref())?;
    write_atomically(&args.output, |file| {
        std::io::Write::write_all(file, text.as_bytes()).map_err(|e| Error::io(&args.output, e))
    })?;
    Ok(Exit::Good)
}
