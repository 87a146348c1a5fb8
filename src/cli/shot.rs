//! `hush shot`: what a shot's settings are, and writing them into a USD layer.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::{Map, Value, json};

use super::advice::with_options;
use super::setting_args::{OfLayers, OfRuns, QueryArgs};
use super::{Exit, print, print_json, say};
use crate::error::{Error, Result};
use crate::io::write_atomically;
use crate::settings::{Layered, Origin, SETTINGS, Setting, ShotQuery, ShotSettings, in_words, usd};

/// A shot's settings: where each comes from, and writing them into a USD layer
#[derive(Args)]
pub(super) struct ShotSubcommands {
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
    shot: QueryArgs<OfRuns>,
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
    #[command(flatten)]
    shot: QueryArgs<OfLayers>,
    /// Replace the layer if it is there
    #[arg(long)]
    overwrite: bool,
}

/// Runs the subcommand.
pub(super) fn shot(args: &ShotSubcommands) -> Result<Exit> {
    match &args.command {
        Command::Show(args) => show(args),
        Command::Write(args) => write(args),
    }
}

fn show(args: &ShowArgs) -> Result<Exit> {
    let extension = args.input.as_deref().and_then(Path::extension).map(|e| e.to_string_lossy().to_ascii_lowercase());
    let query = args.shot.query(&[]);
    let twice = |name| Err(Error::BadSetting { name, reason: "is given twice: name one file".into() });
    let settings = match (&args.input, extension.as_deref()) {
        (None, _) => query.settings(None)?,
        (Some(stage), extension) if matches!(extension, Some("usd" | "usda" | "usdc" | "usdz")) || is_prim(stage) => {
            match &query.usd {
                None => ShotQuery { usd: Some(stage.to_string_lossy().parse()?), ..query }.settings(None)?,
                Some(_) => return twice("usd"),
            }
        }
        (Some(file), Some("toml")) => match &query.file {
            None => ShotQuery { file: Some(file.clone()), ..query }.settings(None)?,
            Some(_) => return twice("settings"),
        },
        (Some(input), _) => ShotQuery { inputs: vec![input.clone()], ..query }.find()?.1,
    };
    match args.json {
        true => print_json(&as_json(&settings)),
        false => print(as_table(&settings).trim_end()),
    }
    settings.notes.iter().for_each(|note| say(format_args!("warning: {}", with_options(note))));
    Ok(Exit::Good)
}

fn is_prim(stage: &Path) -> bool {
    stage.to_string_lossy().contains("@/")
}

fn as_json(settings: &Layered) -> Value {
    let entry = |setting: &Setting| {
        let mut entry = serde_json::to_value(settings.origin(setting.name)).ok()?;
        entry.as_object_mut()?.insert("value".into(), settings.values.get(setting.name));
        Some((setting.name.to_owned(), entry))
    };
    json!({ "settings": SETTINGS.iter().filter_map(entry).collect::<Map<_, _>>(), "notes": settings.notes })
}

fn as_table(settings: &Layered) -> String {
    let text = |setting: &Setting| match settings.values.get(setting.name) {
        Value::Null => setting.default.to_owned(),
        value => in_words(&value),
    };
    let rows: Vec<(&str, String, String)> =
        SETTINGS.iter().map(|setting| (setting.name, text(setting), settings.origin(setting.name).to_string())).collect();
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
    let mut query = args.shot.query(&[]);
    let places = ShotSettings { input: args.input.clone(), output: args.to.clone(), ..ShotSettings::default() };
    query.given = Layered::new(places, |name| Origin::CommandLine { option: name.into() }).over(query.given);
    let settings = query.settings(None)?;
    if settings.given().next().is_none() {
        let reason = "there is nothing to write: give settings, such as --lambda 4, or --settings hush.toml";
        return Err(Error::BadInput { input: "hush shot write".into(), reason: reason.into() });
    }
    settings
        .notes
        .iter()
        .chain(&settings.values.lambda_notes())
        .for_each(|note| say(format_args!("warning: {}", with_options(note))));
    let text = usd::write(&args.output, &settings, args.prim.as_deref(), args.sublayer.as_deref())?;
    write_atomically(&args.output, |file| {
        std::io::Write::write_all(file, text.as_bytes()).map_err(|e| Error::io(&args.output, e))
    })?;
    Ok(Exit::Good)
}
