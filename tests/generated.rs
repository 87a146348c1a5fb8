//! What follows from the table of settings outside of Rust. `HUSH_UPDATE=1 cargo test --test generated` writes it anew.

use std::fmt::Write;
use std::path::Path;

use hush::settings::{Kind, NOT_OF_A_PREVIEW, SETTINGS, Setting};

/// Compares a file with what it should hold, or writes it.
fn check(file: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    if std::env::var_os("HUSH_UPDATE").is_some() {
        std::fs::write(&path, text).unwrap();
    }
    let there = std::fs::read_to_string(&path).unwrap();
    assert!(there == text, "{file} is not what src/settings/table.rs says: HUSH_UPDATE=1 cargo test --test generated");
}

/// A text between quotes, as Python and USD write it.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

#[test]
fn the_table_in_the_docs_is_current() {
    const BEGIN: &str = "<!-- settings table: generated -->\n";
    const END: &str = "<!-- end -->";
    let mut table =
        String::from("| `hush.toml` | Command line | Python | USD | Default | What it does |\n|---|---|---|---|---|---|\n");
    for setting in SETTINGS {
        let option = match (setting.option, setting.short, setting.argument) {
            (None, ..) if setting.argument.is_empty() => "–".into(),
            (None, _, argument) => format!("`{argument}`"),
            (Some(option), Some(short), _) => format!("`{option}`, `-{short}`"),
            (Some(option), ..) => format!("`{option}`"),
        };
        let python = match setting.name.split_once('.') {
            Some((table, key)) => format!("`{table}={{\"{key}\": …}}`"),
            None if setting.name == "input" => "`inputs`".into(),
            None => format!("`{}`", setting.python()),
        };
        let (default, help) = (setting.default, setting.help());
        let usd = format!("`{} {}`", setting.kind.usd_type(), setting.usd);
        writeln!(table, "| `{}` | {option} | {python} | {usd} | {default} | {help}. |", setting.name).unwrap();
    }
    let file = "docs/settings.md";
    let page = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap();
    let (before, rest) = page.split_once(BEGIN).unwrap();
    let (_, after) = rest.split_once(END).unwrap();
    check(file, &format!("{before}{BEGIN}{table}{END}{after}"));
}

#[test]
fn the_usd_schema_is_current() {
    let mut attributes = String::new();
    for setting in SETTINGS.iter().filter(|s| s.usd.starts_with("hush:")) {
        let uniform = if setting.kind == Kind::Lambda { "" } else { "uniform " };
        let more = match setting.kind {
            Kind::Lambda => "; time samples are joined by straight lines",
            Kind::Path => "; relative to the layer",
            _ => "",
        };
        let doc = quoted(&format!("{}{more}. Default: {}.", setting.help(), setting.default));
        let (kind, name) = (setting.kind.usd_type(), setting.usd);
        writeln!(attributes, "\n    {uniform}{kind} {name} (\n        doc = {doc}\n    )").unwrap();
    }
    let class = |head: &str| {
        format!(
            "class \"HushAPI\" (\n{head}    doc = \"How Hush denoises the frames of a render pass. denoise:enable of the RenderPass switches \
             it off.\"\n    customData = {{\n        token apiSchemaType = \"singleApply\"\n        token[] apiSchemaCanOnlyApplyTo = \
             [\"RenderSettings\", \"RenderPass\", \"RenderDenoisePass\"]\n    }}\n)\n{{{}}}\n",
            attributes.strip_prefix('\n').map(|rest| format!("\n{rest}")).unwrap_or_default()
        )
    };
    let schema = "#usda 1.0\n(\n    \"\"\"The settings of Hush as an applied API schema, for UsdRender prims. Hush reads the attributes with or \
                  without it; register\n    it (folder of plugInfo.json in PXR_PLUGINPATH_NAME) so that usdview, Solaris and other tools \
                  show and check them. It has no\n    code. Generated from src/settings/table.rs.\"\"\"\n    subLayers = [\n        \
                  @usd/schema.usda@\n    ]\n)\n\nover \"GLOBAL\" (\n    customData = {\n        string libraryName = \"hush\"\n        string \
                  libraryPath = \".\"\n        bool skipCodeGeneration = true\n    }\n)\n{\n}\n\n";
    check("farm/usd/schema.usda", &format!("{schema}{}", class("    inherits = </APISchemaBase>\n")));
    let generated = "#usda 1.0\n(\n    \"The schema of schema.usda in the form that USD loads.\"\n)\n\n";
    check("farm/usd/generatedSchema.usda", &format!("{generated}{}", class("")));
}

/// The keyword argument of a setting in Python, with its type and what it does.
fn keyword(setting: &Setting) -> Option<(String, &'static str, String)> {
    let kind = match setting.kind {
        // The keys of a table are one keyword; the first speaks for all.
        Kind::Text if setting.name != "passes.beauty" => return None,
        Kind::Text => "Mapping[str, str]",
        Kind::Flag => "bool",
        Kind::Whole { .. } => "int",
        Kind::Lambda => "float | Mapping[int, float]",
        Kind::Frames => "str | Iterable[int]",
        Kind::Size => "int | str",
        Kind::Path => "Path",
        Kind::Name => "str",
        Kind::Names | Kind::Choices(_) => "str | Sequence[str]",
    };
    let help = match setting.kind {
        Kind::Text => {
            let known: Vec<&str> = SETTINGS.iter().filter_map(|s| s.name.strip_prefix("passes.")).collect();
            format!("What the passes are called where not as Blender calls them, by {}", known.join(", "))
        }
        Kind::Lambda if setting.name != "lambda" => format!("{}: a number, or a mapping from frame number to it", setting.help()),
        Kind::Lambda => {
            "How much noise and hidden detail to keep, from 1 (cleanest) to 64, or a mapping from frame number to it: linear \
                         between its keys, constant before the first and after the last"
                .into()
        }
        _ => setting.help().to_owned(),
    };
    let default = if setting.kind == Kind::Text { "Blender's names" } else { setting.default };
    Some((setting.python().to_owned(), kind, format!("{help}. Default: {default}.")))
}

#[test]
fn the_keywords_of_python_are_current() {
    let mut text = String::from(
        "\"\"\"The keyword arguments that are settings of a shot. Generated from src/settings/table.rs.\"\"\"\n\nfrom __future__ import \
         annotations\n\nimport os\nfrom collections.abc import Iterable, Mapping, Sequence\nfrom typing import Literal, TypedDict\n\n\
         Path = str | os.PathLike[str]\n\n\nclass ShotSettings(TypedDict, total=False):\n    \"\"\"What to read of a shot and how to \
         compute: the keyword arguments of every function that takes a shot.\n\n    What is not given, or None, is what the shot's own \
         settings say: `hush.toml` beside the frames, and the USD stage that it names;\n    else the default. What is given here \
         wins.\n    \"\"\"\n\n    settings: Path | Literal[False] | None\n    \"\"\"Another settings file than the one beside the frames; \
         False for none.\"\"\"\n    usd: Path | None\n    \"\"\"A USD stage to take settings from, `shot.usda` or \
         `shot.usda@/Render/Pass`, in place of the one that the settings file names.\"\"\"\n",
    );
    let wrapped = |help: &str| {
        // Lines of at most 140 letters, as ruff has it.
        let mut lines = vec![String::from("    \"\"\"")];
        for word in help.split(' ') {
            let last = lines.last_mut().unwrap();
            if last.chars().count() + word.chars().count() + 4 > 135 {
                lines.push(format!("    {word}"));
            } else {
                let space = if last.ends_with("\"\"\"") { "" } else { " " };
                write!(last, "{space}{word}").unwrap();
            }
        }
        lines.join("\n").replace('\\', "\\\\") + "\"\"\"\n"
    };
    let entries = |only: &dyn Fn(&Setting) -> bool, text: &mut String| {
        for setting in SETTINGS.iter().filter(|s| !["input", "output"].contains(&s.name) && only(s)) {
            if let Some((name, kind, help)) = keyword(setting) {
                write!(text, "    {name}: {kind} | None\n{}", wrapped(&help)).unwrap();
            }
        }
    };
    entries(&|s| !NOT_OF_A_PREVIEW.contains(&s.name), &mut text);
    text.push_str(
        "\n\nclass SequenceSettings(ShotSettings, total=False):\n    \"\"\"How a shot is denoised: `ShotSettings`, and which frames are \
         made how.\"\"\"\n\n",
    );
    entries(&|s| NOT_OF_A_PREVIEW.contains(&s.name), &mut text);
    text.push_str(
        "    overwrite: bool\n    \"\"\"Write every frame again, also over files that Hush did not write; default False.\"\"\"\n    \
         strict: bool\n    \"\"\"Stop at the first bad or missing frame; default False.\"\"\"\n",
    );
    check("python/hush/_settings.py", &text);
}

#[test]
fn the_table_of_the_extension_is_current() {
    let mut text = String::from(
        "# SPDX-FileCopyrightText: 2026 Hush authors\n# SPDX-License-Identifier: GPL-3.0-or-later\n\"\"\"The settings of a shot, by their names in \
         hush.toml. Generated from src/settings/table.rs: not changed by hand.\"\"\"\n\nfrom typing import NamedTuple\n\n\nclass \
         Setting(NamedTuple):\n    \"\"\"A setting: what it does; its default, None where that is not one value; the least and the most, \
         None where it is no number.\"\"\"\n\n    help: str\n    default: object\n    least: float | None\n    most: float | \
         None\n\n\nSETTINGS: dict[str, Setting] = {\n",
    );
    for setting in SETTINGS {
        let default = match setting.kind {
            Kind::Flag => if setting.default == "true" { "True" } else { "False" }.to_owned(),
            _ => setting.default.parse::<f64>().map_or("None".into(), |number| number.to_string()),
        };
        let end = |end: Option<f64>| end.map_or("None".into(), |end| end.to_string());
        let (least, most) = (end(setting.kind.range().map(|r| r.0)), end(setting.kind.range().map(|r| r.1)));
        let help = if setting.help().contains('"') { format!("'{}'", setting.help()) } else { quoted(setting.help()) };
        let name = setting.name;
        writeln!(text, "    \"{name}\": Setting(\n        {help},\n        default={default},\n        least={least},\n        most={most},\n    ),")
            .unwrap();
    }
    text.push_str("}\n");
    check("blender_addon/settings.py", &text);
}
