//! Open Image Denoise, where it is installed: its own command-line tool, fed with PFM files.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use ndarray::Array3;

use super::candidates::OidnMode;
use super::machine::peak_of;
use super::pfm;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::metrics::pair::has_finite_pixel;

/// The tool's file name.
const TOOL: &str = if cfg!(windows) { "oidnDenoise.exe" } else { "oidnDenoise" };
/// How often the running tool is looked at.
const POLL: Duration = Duration::from_millis(10);
/// Prints the folder of the tool that the Python package brings along.
const ASK_PYTHON: &str = "import importlib.util as u, pathlib as p; print(p.Path(u.find_spec('pyoidn').origin).parent / 'oidn')";

/// An installed tool.
#[derive(Clone, Debug)]
pub struct Oidn {
    program: PathBuf,
    /// Where its libraries lie, if beside it.
    libraries: Option<PathBuf>,
}

/// One denoised frame.
pub struct OidnRun {
    /// (rows, columns, 3).
    pub colour: Array3<f32>,
    /// Seconds that the filters took, guides' included, by the tool's own clock, each the second time in a row.
    pub seconds: f64,
    /// Such as `2.5.1`.
    pub version: Option<String>,
    /// Most bytes resident in the tool's process, where the system tells.
    pub peak: Option<u64>,
}

/// What the tool told of one filter.
struct FilterRun {
    seconds: f64,
    version: Option<String>,
    peak: Option<u64>,
}

impl Oidn {
    /// Finds the tool: at `given` (the file or a folder with it), else on the PATH, else in Python's package pyoidn.
    ///
    /// # Errors
    /// [`Error::BadSetting`] if there is none at `given`. Ok(None) if none is installed.
    pub fn find(given: Option<&Path>) -> Result<Option<Self>> {
        if let Some(given) = given {
            let places = [given.to_path_buf(), given.join(TOOL), given.join("bin").join(TOOL)];
            let found = places.into_iter().find(|p| p.is_file()).map(Self::at);
            let reason = format!("there is no {TOOL} at {}", given.display());
            return found.map(Some).ok_or(Error::BadSetting { name: "oidn", reason });
        }
        let path = std::env::var_os("PATH").unwrap_or_default();
        let on_path = std::env::split_paths(&path).map(|folder| folder.join(TOOL)).find(|p| p.is_file());
        Ok(on_path.or_else(from_python).map(Self::at))
    }

    fn at(program: PathBuf) -> Self {
        let beside = program.parent().and_then(Path::parent).map(|root| root.join("lib"));
        Self { program, libraries: beside.filter(|lib| lib.is_dir()) }
    }

    /// Denoises one frame with the albedo and normal that it has, on as many threads as Hush. Files lie in `scratch` meanwhile.
    ///
    /// # Errors
    /// The files cannot be written, or the tool fails or says what nobody understands.
    pub fn run(&self, frame: &Frame, mode: OidnMode, threads: usize, scratch: &Path) -> Result<OidnRun> {
        let name = |what: &str| scratch.join(format!("{what}.pfm"));
        let quality = if mode == OidnMode::Fast { "fast" } else { "high" };
        let mut guides: Vec<(&str, PathBuf)> = Vec::new();
        if let Some(albedo) = &frame.albedo {
            pfm::write(&name("albedo"), albedo.view(), |v| if v.is_nan() { 0.0 } else { v.clamp(0.0, 1.0) })?;
            guides.push(("--alb", name("albedo")));
        }
        if let (Some(normal), true) = (&frame.normal, frame.albedo.is_some()) {
            pfm::write(&name("normal"), normal.view(), |v| if v.is_nan() { 0.0 } else { v.clamp(-1.0, 1.0) })?;
            guides.push(("--nrm", name("normal")));
        }
        let (mut before, mut peak) = (0.0, None);
        if mode == OidnMode::Cycles {
            for (option, path) in &mut guides {
                let clean = path.with_extension("clean.pfm");
                let found = self.filter(&[(*option, path.clone())], &clean, quality, false, threads, scratch)?;
                (before, peak) = (before + found.seconds, peak.max(found.peak));
                *path = clean;
            }
        }
        let has_clean_guides = mode == OidnMode::Cycles && !guides.is_empty();
        pfm::write(&name("colour"), frame.colour.view(), |v| if v.is_finite() { v.max(0.0) } else { 0.0 })?;
        guides.insert(0, ("--hdr", name("colour")));
        let found = self.filter(&guides, &name("result"), quality, has_clean_guides, threads, scratch)?;
        let colour = pfm::read(&name("result"))?;
        if colour.dim() != frame.colour.dim() {
            return Err(self.failed("gave an image of another size"));
        }
        if !has_finite_pixel(colour.view()) {
            return Err(self.failed("gave an image without a finite pixel"));
        }
        Ok(OidnRun { colour, seconds: before + found.seconds, version: found.version, peak: peak.max(found.peak) })
    }

    /// One filter, run twice.
    fn filter(
        &self,
        inputs: &[(&str, PathBuf)],
        output: &Path,
        quality: &str,
        has_clean_guides: bool,
        threads: usize,
        scratch: &Path,
    ) -> Result<FilterRun> {
        let mut command = Command::new(&self.program);
        command.args(["-d", "cpu", "-q", quality, "--affinity", "0", "-n", "2", "--threads"]).arg(threads.to_string());
        inputs.iter().for_each(|(option, path)| _ = command.arg(option).arg(path));
        command.args(has_clean_guides.then_some("--clean_aux")).arg("-o").arg(output);
        if let Some(libraries) = &self.libraries {
            let own = std::env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
            let all = std::env::join_paths(std::iter::once(libraries.clone()).chain(std::env::split_paths(&own)));
            command.env("LD_LIBRARY_PATH", all.unwrap_or_else(|_| libraries.into()));
        }
        let (text, peak) = self.finish(command, scratch)?;
        let seconds = milliseconds(&text).ok_or_else(|| self.failed("printed no time"))? / 1000.0;
        Ok(FilterRun { seconds, version: version(&text), peak })
    }

    /// Runs the tool to its end: what it printed, and its peak memory.
    fn finish(&self, mut command: Command, scratch: &Path) -> Result<(String, Option<u64>)> {
        let log = |name: &str| {
            let path = scratch.join(name);
            File::create(&path).map_err(|e| Error::io(&path, e))
        };
        command.stdin(Stdio::null()).stdout(log("printed")?).stderr(log("complained")?);
        let mut child = command.spawn().map_err(|e| Error::io(&self.program, e))?;
        let mut peak = None;
        let status = loop {
            match child.try_wait().map_err(|e| Error::io(&self.program, e))? {
                Some(status) => break status,
                // What the system tells of a child that has ended counts this process's memory, too.
                None => peak = peak_of(&child.id().to_string()).or(peak),
            }
            std::thread::sleep(POLL);
        };
        let read =
            |name: &str| std::fs::read(scratch.join(name)).map(|b| String::from_utf8_lossy(&b).into_owned()).unwrap_or_default();
        if !status.success() {
            return Err(self.failed(format!("failed ({status}): {}", read("complained").trim())));
        }
        Ok((read("printed"), peak))
    }

    fn failed(&self, reason: impl Into<String>) -> Error {
        Error::bad_file(&self.program, reason)
    }
}

fn from_python() -> Option<PathBuf> {
    ["python3", "python"].into_iter().find_map(|python| {
        let printed = Command::new(python).args(["-c", ASK_PYTHON]).stdin(Stdio::null()).stderr(Stdio::null()).output().ok()?;
        let folder = PathBuf::from(String::from_utf8(printed.stdout).ok()?.trim());
        Some(folder.join("bin").join(TOOL)).filter(|p| printed.status.success() && p.is_file())
    })
}

/// The last time that the tool printed for its filter.
fn milliseconds(text: &str) -> Option<f64> {
    let after = &text[text.rfind("Denoising")?..];
    let number = after.split("msec=").nth(1)?;
    let end = number.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(number.len());
    number[..end].parse().ok()
}

fn version(text: &str) -> Option<String> {
    let after = text.split("version=").nth(1)?;
    after.split([',', '\n', ' ']).next().map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRINTED: &str = "Initializing device\n  device=CPU, version=2.5.1, msec=91.7\nLoading input\nInitializing filter\n  \
        filter=RT, msec=28.5\nDenoising 0% Denoising 100% \n  msec=1141.27, hash=1\nDenoising 0% Denoising 100% \n  \
        msec=1129.97, hash=c46521e4\nSaving output\n";

    #[test]
    fn the_time_is_the_second_run_of_the_filter() {
        assert_eq!(milliseconds(PRINTED), Some(1129.97));
        assert_eq!(version(PRINTED).as_deref(), Some("2.5.1"));
        assert_eq!(milliseconds("Initializing device msec=5"), None);
        assert_eq!(milliseconds("Denoising 0%"), None);
    }

    #[test]
    fn a_path_without_the_tool_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Oidn::find(Some(folder.path())).unwrap_err().to_string().contains("oidnDenoise"));
        std::fs::create_dir(folder.path().join("bin")).unwrap();
        std::fs::create_dir(folder.path().join("lib")).unwrap();
        std::fs::write(folder.path().join("bin").join(TOOL), "").unwrap();
        let found = Oidn::find(Some(folder.path())).unwrap().unwrap();
        assert!(found.libraries.is_some_and(|l| l.ends_with("lib")));
    }
}
