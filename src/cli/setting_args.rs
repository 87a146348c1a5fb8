//! A shot's settings as options, and the files to take others from: what the table of settings says, for clap.

use std::marker::PhantomData;
use std::path::PathBuf;

use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};

use crate::report::FRAMES;
use crate::settings::{Kind, NOT_OF_A_PREVIEW, SETTINGS, Setting, ShotQuery, ShotSettings, StageRef};

/// What says how frames are denoised and written, where none is.
const NOT_OF_A_SURVEY: [&str; 8] =
    ["enable", "output", "lambda", "lambda_masked", "lambda_pass", "lambda_images", "keep_noisy", "second_pass"];

/// Which settings a command leaves out of its options.
pub(super) trait Offered {
    /// By name, in lists.
    const WITHOUT: &'static [&'static [&'static str]];

    /// What the help says of a setting's default.
    fn default(setting: &Setting) -> String {
        setting.default.into()
    }
}

/// Of `hush denoise`, `hush check` and `hush watch`.
pub(super) struct OfRuns;
/// Of `hush preview`.
pub(super) struct OfPreviews;
/// Of `hush survey`.
pub(super) struct OfSurveys;
/// Of `hush report`.
pub(super) struct OfReports;
/// Of `hush shot write`, whose output is the layer.
pub(super) struct OfLayers;

impl Offered for OfRuns {
    const WITHOUT: &'static [&'static [&'static str]] = &[];
}
impl Offered for OfPreviews {
    const WITHOUT: &'static [&'static [&'static str]] = &[&NOT_OF_A_PREVIEW];
}
impl Offered for OfSurveys {
    const WITHOUT: &'static [&'static [&'static str]] = &[&NOT_OF_A_SURVEY];
}
impl Offered for OfReports {
    const WITHOUT: &'static [&'static [&'static str]] = &[&NOT_OF_A_SURVEY, &["window", "aovs", "skip"]];

    fn default(setting: &Setting) -> String {
        match setting.name {
            "frames" => format!("at most {FRAMES} in the middle of the shot"),
            _ => setting.default.into(),
        }
    }
}
impl Offered for OfLayers {
    const WITHOUT: &'static [&'static [&'static str]] = &[&["output"]];
}

/// The settings that a command takes.
pub(super) struct SettingArgs<L> {
    /// What the options say.
    pub given: ShotSettings,
    offered: PhantomData<L>,
}

impl<L: Offered> SettingArgs<L> {
    fn offered() -> impl Iterator<Item = (&'static Setting, &'static str)> {
        let with_option = SETTINGS.iter().filter_map(|setting| Some((setting, setting.option?.trim_start_matches('-'))));
        with_option.filter(|(setting, _)| !L::WITHOUT.iter().any(|names| names.contains(&setting.name)))
    }
}

impl<L: Offered> Args for SettingArgs<L> {
    fn augment_args(command: Command) -> Command {
        Self::offered().fold(command, |command, (setting, option)| command.arg(argument(setting, option, &L::default(setting))))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<L: Offered> FromArgMatches for SettingArgs<L> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut given = ShotSettings::default();
        for (setting, _) in Self::offered() {
            if let Some(words) = matches.get_many::<String>(setting.name) {
                let words: Vec<String> = words.cloned().collect();
                let said = setting.kind.of_words(&words).and_then(|v| given.set(setting.name, v).map_err(|e| e.to_string()));
                said.map_err(|reason| clap::Error::raw(ErrorKind::ValueValidation, format!("{}: {reason}\n", setting.name)))?;
            }
        }
        Ok(Self { given, offered: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// The option of a setting.
fn argument(setting: &'static Setting, option: &'static str, default: &str) -> Arg {
    let kind = setting.kind;
    let several = matches!(kind, Kind::Names);
    let more = if several { "; may be given several times" } else { "" };
    let help = format!("{}{more} [default: {default}]", setting.help());
    let arg = Arg::new(setting.name).long(option).help(help).allow_hyphen_values(matches!(kind, Kind::Lambda | Kind::Frames));
    let arg = arg.value_parser(move |word: &str| kind.of_words(&[word.to_owned()]).map(|_| word.to_owned()));
    let arg = setting.short.map_or(arg.clone(), |short| arg.short(short));
    match kind {
        Kind::Flag => arg.value_name("BOOL").num_args(0..=1).require_equals(true).default_missing_value("true"),
        Kind::Names => arg.value_name(setting.argument).action(ArgAction::Append),
        Kind::Choices(_) => arg.value_name(setting.argument).action(ArgAction::Append).value_delimiter(','),
        _ => arg.value_name(setting.argument),
    }
}

/// Files with settings.
#[derive(Args, Clone)]
pub(super) struct SourceArgs {
    /// USD stage to take settings from, perhaps with the render prim to start from
    #[arg(long, value_name = "FILE[@/PRIM]")]
    pub usd: Option<StageRef>,
    /// Settings file to take instead of the hush.toml beside the frames
    #[arg(long, value_name = "FILE", conflicts_with = "no_settings")]
    pub settings: Option<PathBuf>,
    /// Leave the hush.toml beside the frames alone
    #[arg(long)]
    pub no_settings: bool,
}

/// A shot's settings from everywhere.
#[derive(Args)]
pub(super) struct QueryArgs<L: Offered> {
    #[command(flatten)]
    settings: SettingArgs<L>,
    #[command(flatten)]
    pub sources: SourceArgs,
}

impl<L: Offered> QueryArgs<L> {
    /// What the options say about a shot.
    pub fn query(&self, inputs: &[PathBuf]) -> ShotQuery {
        let SourceArgs { usd, settings, no_settings } = self.sources.clone();
        ShotQuery { usd, file: settings, look_beside: !no_settings, ..ShotQuery::new(inputs, self.settings.given.clone()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn given(words: &[&str]) -> Result<ShotSettings, clap::Error> {
        let command = QueryArgs::<OfRuns>::augment_args(Command::new("hush"));
        let matches = command.try_get_matches_from([&["hush"], words].concat())?;
        Ok(QueryArgs::<OfRuns>::from_arg_matches(&matches)?.settings.given)
    }

    #[test]
    fn options_say_what_the_table_names() {
        let said = given(&[
            "-l",
            "1:1,24:8",
            "--layer",
            "A, B",
            "--layer",
            "C",
            "--guides",
            "albedo,vector",
            "--keep-noisy",
            "-f",
            "-3--1",
        ]);
        let said = said.unwrap();
        assert_eq!(said.lambda.unwrap().at(24), 8.0);
        assert_eq!(said.layers.unwrap(), ["A, B", "C"]);
        assert_eq!((said.guides.unwrap().len(), said.keep_noisy, said.enable), (2, Some(true), None));
        assert_eq!(said.frames.unwrap().to_string(), "-3--1");
        assert_eq!(given(&["--enable=false", "--aov", "none"]).unwrap().enable, Some(false));
    }

    #[test]
    fn what_is_no_value_is_refused_with_its_option() {
        for (words, part) in [
            (["--window", "4"], "0 to 3"),
            (["--lambda", "0.5"], "out of range"),
            (["--skip", "fog"], "constant"),
            (["--memory", "much"], "4G"),
        ] {
            let said = given(&words).unwrap_err().to_string();
            assert!(said.contains(words[0]) && said.contains(part), "{said}");
        }
    }

    #[test]
    fn what_is_left_out_is_a_setting() {
        for name in [OfPreviews::WITHOUT, OfSurveys::WITHOUT, OfReports::WITHOUT, OfLayers::WITHOUT].concat().concat() {
            assert!(Setting::named(name).is_ok(), "{name}");
        }
    }
}
