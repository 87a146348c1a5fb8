//! The one error type. Every message names the file and the pass where there is one, and says what to do.

use std::path::PathBuf;

/// Shorthand for a result with Hush's [`enum@Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong; user input never panics.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused a file operation.
    #[error("{path}: {}", plain(.source))]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A file is not what it claims to be: truncated, garbage, or a header that cannot be true.
    #[error("{path}: {reason}")]
    BadFile {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong with it, and what to do.
        reason: String,
    },
    /// A file is sound but lacks a pass that was asked for.
    #[error("{path} has no {pass} pass: {advice}")]
    MissingPass {
        /// The file or folder.
        path: PathBuf,
        /// The pass, in Blender's words.
        pass: String,
        /// What to do.
        advice: String,
    },
    /// A file is sound but lacks a view layer or stereo view that was asked for.
    #[error("{path} has no {what}: {advice}")]
    MissingLayer {
        /// The file or folder.
        path: PathBuf,
        /// Such as `view layer Fog`.
        what: String,
        /// What to do.
        advice: String,
    },
    /// The input pattern, folder or list names no usable frames.
    #[error("{input}: {reason}")]
    BadInput {
        /// What was named.
        input: String,
        /// What is wrong with it, and what to do.
        reason: String,
    },
    /// A setting is outside its range or contradicts another.
    #[error("{name}: {reason}")]
    BadSetting {
        /// The setting.
        name: &'static str,
        /// What is wrong with it, and what to do.
        reason: String,
    },
    /// The weights file cannot be used.
    #[error("model {model}: {reason}")]
    BadModel {
        /// The weights file.
        model: String,
        /// What is wrong with it, and what to do.
        reason: String,
    },
    /// Two images or passes that belong together differ in size.
    #[error("{what} is {found_columns}×{found_rows}, expected {columns}×{rows}")]
    SizeMismatch {
        /// The image, pass or piece of work.
        what: String,
        /// Expected.
        columns: usize,
        /// Expected.
        rows: usize,
        /// Found.
        found_columns: usize,
        /// Found.
        found_rows: usize,
    },
    /// The work does not fit into the memory that it may use.
    #[error("{what} needs {needed} MiB, {allowed} MiB are allowed: {advice}")]
    Memory {
        /// The image, pass or piece of work.
        what: String,
        /// MiB.
        needed: u64,
        /// MiB.
        allowed: u64,
        /// What to do.
        advice: String,
    },
    /// The shot's settings say that it is not to be denoised.
    #[error("denoising is switched off for this shot by {by}: nothing was done; set enable to true to denoise it all the same")]
    SwitchedOff {
        /// The file and key, or the option, that says so.
        by: String,
    },
    /// The user stopped the run.
    #[error("stopped")]
    Cancelled,
}

/// An error of the system in words, without its number.
pub(crate) fn plain(error: &std::io::Error) -> String {
    let text = error.to_string();
    match (error.kind(), error.raw_os_error()) {
        (std::io::ErrorKind::NotFound, Some(_)) => "there is no such file or folder".into(),
        _ => text.split(" (os error").next().unwrap_or_default().into(),
    }
}

impl Error {
    /// An [`Error::Io`] for `path`.
    pub fn io(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Self::Io { path: path.into(), source }
    }

    /// An [`Error::BadFile`] for `path`.
    pub fn bad_file(path: impl Into<PathBuf>, reason: impl Into<String>) -> Self {
        Self::BadFile { path: path.into(), reason: reason.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_systems_numbers_are_not_told() {
        let missing = std::fs::read("/no/such/file").unwrap_err();
        assert_eq!(Error::io("a.exr", missing).to_string(), "a.exr: there is no such file or folder");
        let refused = std::fs::read(".").unwrap_err();
        let text = Error::io("a.exr", refused).to_string();
        assert!(text.starts_with("a.exr: ") && !text.contains("os error"), "{text}");
        let told = std::io::Error::new(std::io::ErrorKind::NotFound, "there is no folder a");
        assert_eq!(Error::io("a/b.exr", told).to_string(), "a/b.exr: there is no folder a");
    }
}
