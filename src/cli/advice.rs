//! What the library advises in settings, said in options: `set window to 0` is `pass --window 0` here.

use std::ffi::OsString;

use crate::settings::SETTINGS;

/// Settings that are no shot's, and those whose option has another name where they are switched off.
const MORE: [(&str, &str); 4] = [
    ("overwrite to true", "--overwrite"),
    ("oidn to false", "--no-oidn"),
    ("usd to ", "--usd "),
    ("settings to ", "--settings "),
];

/// The text with options in place of settings.
pub(super) fn with_options(text: &str) -> String {
    let more = MORE.iter().map(|(setting, option)| (format!("set {setting}"), format!("pass {option}")));
    let options = SETTINGS.iter().filter_map(|setting| Some((setting.label(), setting.option?))).flat_map(|(name, option)| {
        [(format!("set {name} to true"), format!("pass {option}")), (format!("set {name} to "), format!("pass {option} "))]
    });
    more.chain(options).fold(text.to_owned(), |text, (setting, option)| text.replace(&setting, &option))
}

/// What to say beside an error where an argument swallowed those behind it: to Windows' programs the `\"` in `"C:\shots\" -o out` is a
/// quote inside the argument and not its end, and no path there has one.
pub(super) fn swallowed_quote(args: &[OsString]) -> Option<String> {
    let shown = args.iter().map(|arg| arg.to_string_lossy()).find(|arg| arg.contains('"'))?;
    let path = shown.split('"').next().unwrap_or_default();
    Some(format!("the \\ before a closing quote made the quote a part of the path in '{shown}': write \"{path}\" without it"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swallowed_quote_is_told() {
        let args = ["hush", "denoise", "C:\\my shots\" -o out"].map(OsString::from);
        let told = swallowed_quote(&args).unwrap();
        assert!(told.contains(r#"'C:\my shots" -o out'"#) && told.ends_with(r#"write "C:\my shots" without it"#), "{told}");
        assert_eq!(swallowed_quote(&args[..2]), None);
    }

    #[test]
    fn every_setting_has_its_option() {
        for (neutral, said) in [
            ("no Vector pass: enable it, or set window to 0", "no Vector pass: enable it, or pass --window 0"),
            ("set vector layer to 'A b', or set aovs to none", "pass --vector-layer 'A b', or pass --aov none"),
            ("set enable to true to go on", "pass --enable to go on"),
            ("set overwrite to true to replace it", "pass --overwrite to replace it"),
            ("set oidn to false", "pass --no-oidn"),
            ("set the sail to windward", "set the sail to windward"),
        ] {
            assert_eq!(with_options(neutral), said);
        }
    }

    /// What an artist reads in Blender comes from the library too, and there are no options there.
    #[test]
    fn the_library_names_no_options() {
        fn files(folder: &std::path::Path, found: &mut Vec<std::path::PathBuf>) {
            for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
                match path.is_dir() {
                    true if !path.ends_with("cli") => files(&path, found),
                    false if path.extension().is_some_and(|e| e == "rs") => found.push(path),
                    _ => {}
                }
            }
        }
        let mut all = Vec::new();
        files(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut all);
        assert!(all.len() > 100);
        for path in all {
            // The table of options, and the arguments of another program.
            if path.ends_with("settings/table.rs") || path.ends_with("report/oidn.rs") {
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap();
            for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//")) {
                let option = |rest: &str| rest.starts_with(|c: char| c.is_ascii_lowercase());
                let named = line.split([' ', '(', '"', '\'', '>']).any(|word| word.strip_prefix("--").is_some_and(option));
                assert!(!named, "{}:{}: {line}", path.display(), number + 1);
            }
        }
    }
}
