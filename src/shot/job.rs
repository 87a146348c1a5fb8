//! What to denoise and how: everything a run needs besides the engine.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use super::currency::StaleKind;
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;
use crate::io::{Guides, PassNames, Selection};
use crate::network::renderers::DEFAULT_RENDERER;
use crate::network::weights::EMBEDDED;
use crate::rules::frames::FrameSet;
use crate::rules::lambda::Lambda;
use crate::rules::skip::{RULES, Rule, Skip};
use crate::rules::window::{DEFAULT_WINDOW, check_window};

/// A shot to denoise.
#[derive(Clone, Debug)]
pub struct Job {
    /// The input files.
    pub sequence: Sequence,
    /// The output folder; created if it is not there. Never the input folder.
    pub output: PathBuf,
    /// The shot that the sequence is only a part of; None where the sequence is all of it.
    pub whole: Option<WholeShot>,
    /// The frames to write; None for all. Neighbours outside are still used.
    pub frames: Option<FrameSet>,
    /// The dial, the same or another for each frame.
    pub lambda: Lambda,
    /// Frames on each side, 0 to 3. None: 2 where there are motion vectors, else 0. A number above 0 demands vectors.
    pub window: Option<usize>,
    /// Which layer, view, guides and light passes to read.
    pub selection: Selection,
    /// Keep the input beside the result as `Noisy Image`.
    pub keep_noisy: bool,
    /// Write every frame again and replace files that Hush did not write.
    pub overwrite: bool,
    /// Stop at the first bad or missing frame instead of going on without it.
    pub strict: bool,
    /// What the engine may leave out, for the manifest: the engine has its own.
    pub skip: Skip,
    /// What the engine's weights are, for the manifest.
    pub model: ModelId,
    /// The renderer whose encoder the engine has, for the manifest; None for the weights' first.
    pub renderer: Option<String>,
    /// What is odd about the settings themselves; told once.
    pub notes: Vec<String>,
}

/// What is known of a shot beyond the files that a job is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WholeShot {
    /// The first frame's number.
    pub first: i64,
    /// The last frame's number.
    pub last: i64,
    /// Whether some frame has motion vectors.
    pub vector: bool,
}

impl Job {
    /// A job with the default settings and the embedded weights.
    pub fn new(sequence: Sequence, output: impl Into<PathBuf>) -> Self {
        Self {
            sequence,
            output: output.into(),
            whole: None,
            frames: None,
            lambda: Lambda::default(),
            window: None,
            selection: Selection::default(),
            keep_noisy: false,
            overwrite: false,
            strict: false,
            skip: Skip::default(),
            model: ModelId::embedded(),
            renderer: None,
            notes: Vec::new(),
        }
    }

    /// Whether a frame is to be written; others only help.
    pub(crate) fn wants(&self, number: i64) -> bool {
        self.frames.as_ref().is_none_or(|set| set.contains(number)) && self.sequence.is_named(number)
    }

    /// Frames on each side that may help, before it is known whether there are motion vectors.
    ///
    /// # Errors
    /// A window that is too wide, or that needs the vectors that are switched off.
    pub(crate) fn reach(&self) -> Result<usize> {
        let reach = self.window.map(check_window).transpose()?.unwrap_or(DEFAULT_WINDOW);
        if self.selection.guides.vector {
            return Ok(reach);
        }
        if self.window.is_some_and(|w| w > 0) {
            let reason = "needs motion vectors, which are switched off: set window to 0 or leave the Vector pass on";
            return Err(Error::BadSetting { name: "window", reason: reason.into() });
        }
        Ok(0)
    }

    /// The settings that decide what a frame looks like, once the window is known; λ is that of `frame`.
    pub(crate) fn settings(&self, window: usize, frame: i64) -> Result<FrameSettings> {
        if let Some(asked) = self.window {
            check_window(asked)?;
        }
        let s = &self.selection;
        Ok(FrameSettings {
            lambda: self.lambda.at(frame),
            window,
            layers: s.layers.clone(),
            view: s.view.clone(),
            vector_layer: s.vector_layer.clone(),
            guides: GuideSettings::from(&s.guides),
            passes: s.passes.clone(),
            aovs: s.aovs.clone(),
            keep_noisy: self.keep_noisy,
            skip: self.skip,
            model: self.model.clone(),
            renderer: self.renderer.as_ref().map(|r| r.to_ascii_lowercase()).filter(|r| r != DEFAULT_RENDERER),
        })
    }
}

/// Which weights made a frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelId {
    /// A file name, or `embedded`.
    pub name: String,
    /// FNV-1a of the file's bytes (64 bits, hexadecimal).
    pub hash: Option<String>,
}

impl ModelId {
    /// The weights in this binary.
    pub fn embedded() -> Self {
        static HASH: LazyLock<String> = LazyLock::new(|| fnv(EMBEDDED));
        Self { name: "embedded".into(), hash: Some(HASH.clone()) }
    }

    /// A weights file.
    pub fn of_file(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        Ok(Self { name, hash: Some(fnv(&bytes)) })
    }
}

/// The settings that a frame was made with; a frame is made again where they differ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameSettings {
    /// 1…64.
    pub lambda: f32,
    /// Frames on each side.
    pub window: usize,
    /// View layers, as they were asked for; none for the one with the most samples.
    #[serde(default)]
    pub layers: Vec<String>,
    /// Stereo view.
    pub view: Option<String>,
    /// View layer that the vectors come from.
    pub vector_layer: Option<String>,
    /// Guides that may be used.
    pub guides: GuideSettings,
    /// Names of the passes, where they are not Blender's.
    #[serde(default, skip_serializing_if = "PassNames::is_default")]
    pub passes: PassNames,
    /// Light passes, as they were asked for.
    pub aovs: Vec<String>,
    /// The input was kept as `Noisy Image`.
    pub keep_noisy: bool,
    /// What was left out where it was found.
    #[serde(default)]
    pub skip: Skip,
    /// The weights.
    pub model: ModelId,
    /// The renderer whose encoder was used; None for Cycles and where nothing was said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub renderer: Option<String>,
}

/// Guides that may be used where the files hold them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct GuideSettings {
    /// Denoising Albedo.
    pub albedo: bool,
    /// Denoising Normal.
    pub normal: bool,
    /// Denoising Depth or Depth.
    pub depth: bool,
    /// Vector.
    pub vector: bool,
}

impl From<&Guides> for GuideSettings {
    fn from(g: &Guides) -> Self {
        Self { albedo: g.albedo, normal: g.normal, depth: g.depth, vector: g.vector }
    }
}

impl FrameSettings {
    /// A short key that differs where the settings differ.
    pub(crate) fn key(&self) -> String {
        fnv(serde_json::to_string(self).unwrap_or_default().as_bytes())
    }

    /// What changed since `old`.
    pub(super) fn changes_since(&self, old: &Self) -> Vec<Change> {
        let list = |names: &[String], none: &str| if names.is_empty() { none.to_owned() } else { names.join("+") };
        let layers = |s: &Self| list(&s.layers, "the one with the most samples");
        let opt = |o: &Option<String>, none: &str| o.clone().unwrap_or_else(|| none.into());
        let model = |m: &ModelId| m.hash.as_ref().map_or(m.name.clone(), |h| format!("{} ({h})", m.name));
        let guides = |g: &GuideSettings| {
            let on = [("albedo", g.albedo), ("normal", g.normal), ("depth", g.depth), ("vector", g.vector)];
            list(&on.iter().filter(|(_, on)| *on).map(|(name, _)| name.to_string()).collect::<Vec<_>>(), "none")
        };
        let passes = |p: &PassNames| {
            let named =
                [("beauty", &p.beauty), ("albedo", &p.albedo), ("normal", &p.normal), ("depth", &p.depth), ("vector", &p.vector)];
            let named = named.iter().filter_map(|(pass, name)| Some(format!("{pass} {}", name.as_ref()?)));
            Some(named.collect::<Vec<_>>().join("+")).filter(|all| !all.is_empty()).unwrap_or_else(|| "default".into())
        };
        let rules = |skip: Skip| match RULES.into_iter().filter(|r| skip.has(*r)).map(Rule::name).collect::<Vec<_>>() {
            none if none.is_empty() => "nothing".to_string(),
            some => some.join("+"),
        };
        let change = |kind, name, old, new| Change { kind, name, old, new };
        let vectors = |s: &Self| opt(&s.vector_layer, "as the file has it");
        let renderer = |s: &Self| opt(&s.renderer, DEFAULT_RENDERER);
        let all = [
            change(StaleKind::Lambda, "lambda", old.lambda.to_string(), self.lambda.to_string()),
            change(StaleKind::Window, "window", old.window.to_string(), self.window.to_string()),
            change(StaleKind::Layers, "layers", layers(old), layers(self)),
            change(StaleKind::View, "view", opt(&old.view, "all"), opt(&self.view, "all")),
            change(StaleKind::VectorLayer, "vector layer", vectors(old), vectors(self)),
            change(StaleKind::Guides, "guides", guides(&old.guides), guides(&self.guides)),
            change(StaleKind::Passes, "pass names", passes(&old.passes), passes(&self.passes)),
            change(StaleKind::Aovs, "AOVs", list(&old.aovs, "none"), list(&self.aovs, "none")),
            change(StaleKind::KeepNoisy, "keep noisy", old.keep_noisy.to_string(), self.keep_noisy.to_string()),
            change(StaleKind::Skip, "left out", rules(old.skip), rules(self.skip)),
            change(StaleKind::Model, "model", model(&old.model), model(&self.model)),
            change(StaleKind::Renderer, "renderer", renderer(old), renderer(self)),
        ];
        all.into_iter().filter(|c| c.old != c.new).collect()
    }
}

/// A setting that changed, in words: `lambda 1 → 4`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Change {
    pub kind: StaleKind,
    name: &'static str,
    old: String,
    new: String,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} → {}", self.name, self.old, self.new)
    }
}

/// FNV-1a, 64 bits: tells files apart, guards against nothing.
fn fnv(bytes: &[u8]) -> String {
    let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3));
    format!("{hash:016x}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::sequence::SequenceFrame;

    fn job() -> Job {
        let frames = vec![SequenceFrame { number: 1, path: "a.exr".into() }];
        Job::new(Sequence { name: "a.exr".into(), frames, ignored: Vec::new(), named: None }, "out")
    }

    #[test]
    fn fnv_is_the_published_one() {
        assert_eq!(fnv(b""), "cbf29ce484222325");
        assert_eq!(fnv(b"foobar"), "85944171f73967e8");
    }

    #[test]
    fn settings_tell_what_changed() {
        let a = job().settings(2, 1).unwrap();
        let b = Job { lambda: "1:4,5:8".parse().unwrap(), ..job() }.settings(0, 1).unwrap();
        let words = |new: &FrameSettings| new.changes_since(&a).iter().map(Change::to_string).collect::<Vec<_>>();
        assert_eq!(words(&b), ["lambda 1 → 4", "window 2 → 0"]);
        let c = Job { skip: Skip::NONE, ..job() }.settings(2, 1).unwrap();
        assert_eq!(words(&c), ["left out constant+opaque+untrusted+still → nothing"]);
        let d = Job { renderer: Some("Mitsuba".into()), ..job() }.settings(2, 1).unwrap();
        assert_eq!(words(&d), ["renderer cycles → mitsuba"]);
        let mut all = job();
        all.selection.layers = vec!["all".into()];
        all.selection.aovs = vec!["all".into()];
        all.selection.guides = Guides { albedo: false, normal: false, depth: false, vector: false };
        let since_all = a.changes_since(&all.settings(2, 1).unwrap());
        let told = ["layers all → the one with the most samples", "guides none → albedo+normal+depth+vector", "AOVs all → none"];
        assert_eq!(since_all.iter().map(Change::to_string).collect::<Vec<_>>(), told);
        assert_eq!(Job { renderer: Some("cycles".into()), ..job() }.settings(2, 1).unwrap(), a);
        assert!(!serde_json::to_string(&a).unwrap().contains("renderer"), "manifests of before must keep their keys");
        assert!(a.key() != b.key() && a.key() == job().settings(2, 9).unwrap().key());
        let json = serde_json::to_string(&b).unwrap();
        assert_eq!(serde_json::from_str::<FrameSettings>(&json).unwrap(), b);
    }

    #[test]
    fn a_window_too_wide_is_refused() {
        assert!(Job { window: Some(4), ..job() }.settings(0, 1).is_err());
    }
}
