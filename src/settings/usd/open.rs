//! Opening a stage so that a bad file ends in an error.

use std::io::{self, Read};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use openusd::ar::{Asset, DefaultResolver, ResolvedPath, Resolver};
use openusd::usd::Stage;

use super::unreadable;
use crate::error::{Error, Result};

/// Of one layer. Render settings belong into layers of their own; this one is read whole into memory.
const MAX_BYTES: u64 = 2 << 30;
/// Of brackets in a text layer; each level takes stack.
const MAX_DEPTH: usize = 500;
/// Of the reading thread: enough for `MAX_DEPTH` levels many times over.
const STACK: usize = 256 << 20;

/// Opens the stage and calls `work` with it. `work`'s error is about the stage: the message names the file.
pub(super) fn with_stage<T: Send>(path: &Path, work: impl FnOnce(&Stage) -> Result<T, String> + Send) -> Result<T> {
    std::fs::File::open(path).map_err(|e| Error::io(path, e))?;
    let name = path.to_str().ok_or_else(|| unreadable(path, "the name is not UTF-8"))?;
    let read = || {
        let stage = open(name).map_err(|reason| unreadable(path, &reason))?;
        if let Some(error) = stage.composition_errors().first() {
            return Err(unreadable(path, &advised(error.to_string())));
        }
        work(&stage).map_err(|reason| Error::bad_file(path, reason))
    };
    let panicked = |_| unreadable(path, "the USD reader broke down on it");
    std::thread::scope(|scope| {
        let builder = std::thread::Builder::new().name("usd".into()).stack_size(STACK);
        let thread = builder.spawn_scoped(scope, || catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|e| Err(panicked(e))));
        let thread = thread.map_err(|e| Error::io(path, e))?;
        thread.join().unwrap_or_else(|e| Err(panicked(e)))
    })
}

/// The stage of a file, with bounds on its layers.
pub(super) fn open(name: &str) -> Result<Stage, String> {
    let opened = Stage::builder().resolver(Bounded(DefaultResolver::new())).open(name);
    opened.map_err(|e| advised(format!("{e:#}")))
}

/// openusd reads crate files whole, but not all of the text format, such as attributes with letters beyond ASCII in their names.
fn advised(reason: String) -> String {
    match reason.contains("parse USDA") {
        true => reason + "; a .usdc of this layer, as usdcat -o writes it, may be read where its text is not",
        false => reason,
    }
}

/// Looks at each layer before openusd takes it in.
struct Bounded(DefaultResolver);

impl Resolver for Bounded {
    fn create_identifier(&self, asset_path: &str, anchor: Option<&ResolvedPath>) -> String {
        self.0.create_identifier(asset_path, anchor)
    }

    fn resolve(&self, asset_path: &str) -> Option<ResolvedPath> {
        self.0.resolve(asset_path)
    }

    fn resolve_for_new_asset(&self, asset_path: &str) -> Option<ResolvedPath> {
        self.0.resolve_for_new_asset(asset_path)
    }

    fn open_asset(&self, resolved: &ResolvedPath) -> io::Result<Box<dyn Asset>> {
        let mut asset = self.0.open_asset(resolved)?;
        let size = asset.size()?;
        if size > MAX_BYTES {
            return Err(io::Error::other(format!("{resolved} is {} MiB, a layer may have {}", size >> 20, MAX_BYTES >> 20)));
        }
        let mut bytes = Vec::new();
        asset.read_to_end(&mut bytes)?;
        let text = bytes.starts_with(b"#usda");
        if text && depth(&bytes) > MAX_DEPTH {
            return Err(io::Error::other(format!("{resolved} nests brackets more than {MAX_DEPTH} deep")));
        }
        Ok(Box::new(io::Cursor::new(bytes)))
    }
}

/// How deep the brackets of a text layer are nested, without those in strings, asset paths and comments.
fn depth(text: &[u8]) -> usize {
    let (mut depth, mut deepest, mut at) = (0_usize, 0, 0);
    while let Some(byte) = text.get(at) {
        match byte {
            b'{' | b'(' | b'[' => {
                depth += 1;
                deepest = deepest.max(depth);
            }
            b'}' | b')' | b']' => depth = depth.saturating_sub(1),
            b'/' if text[at..].starts_with(b"/*") => at = end_of_comment(text, at),
            b'#' => at = end_of_line(text, at),
            b'/' if text[at..].starts_with(b"//") => at = end_of_line(text, at),
            b'"' | b'\'' | b'@' => at = end_of_string(text, at),
            _ => {}
        }
        at += 1;
    }
    deepest
}

fn end_of_line(text: &[u8], start: usize) -> usize {
    start + text[start..].iter().take_while(|b| **b != b'\n').count()
}

/// The last byte of the comment that starts with `/*`.
fn end_of_comment(text: &[u8], start: usize) -> usize {
    let inner = text.get(start + 2..).unwrap_or_default();
    inner.windows(2).position(|pair| pair == b"*/").map_or(text.len(), |length| start + length + 3)
}

/// The last byte of the string or asset path that starts at a quote or an `@`.
fn end_of_string(text: &[u8], start: usize) -> usize {
    let quote = [text[start]; 3];
    let quote = if text[start..].starts_with(&quote) { &quote[..] } else { &quote[..1] };
    let mut at = start + quote.len();
    while at < text.len() && !text[at..].starts_with(quote) {
        at += 1 + usize::from(text[at] == b'\\');
    }
    at + quote.len() - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_counts_brackets_outside_strings_and_comments() {
        for (text, expected) in [
            ("", 0),
            ("def \"a\" { int[] x = [1, (2)] }", 3),
            ("((( # (((((\n)))", 3),
            ("string a = \"(((\" '(((' \"\"\" \"((( \"\"\" (", 1),
            ("\"\\\"((\" (", 1),
            ("/* \" */ ((( /* ((((( */", 3),
            ("( // ' ((\n(", 2),
            ("@it's (((@ ( @@@ a@b ((( @@@ (", 2),
            ("/* unfinished (", 0),
            ("\"unfinished (", 0),
            ("\"\"\"unfinished \\", 0),
            (")))(", 1),
        ] {
            assert_eq!(depth(text.as_bytes()), expected, "{text}");
        }
    }
}
