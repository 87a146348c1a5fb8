//! The settings worth choosing between.

use serde::Serialize;

use crate::rules::skip::Skip;
use crate::rules::window::{DEFAULT_WINDOW, MAX_WINDOW};

/// How a frame is denoised.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "by", rename_all = "snake_case")]
pub enum Method {
    /// Not at all: the picture as it was rendered.
    Noisy,
    /// Hush.
    Hush {
        /// Frames on each side.
        window: usize,
        /// The dial.
        lambda: f32,
        /// Whether the default rules leave work out.
        skipping: bool,
    },
    /// Open Image Denoise, with albedo and normal.
    Oidn {
        /// How it is run.
        mode: OidnMode,
    },
}

/// How Open Image Denoise is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OidnMode {
    /// As Cycles runs it by default: each guide is filtered by itself first, then the colour with the clean guides; quality high.
    Cycles,
    /// Guides as rendered, quality high.
    RawGuides,
    /// Guides as rendered, quality fast.
    Fast,
}

impl OidnMode {
    /// All, the one to compare with first.
    pub const ALL: [Self; 3] = [Self::Cycles, Self::RawGuides, Self::Fast];

    /// What a candidate of this version is called, where the version is known.
    pub fn name(self, version: Option<&str>) -> String {
        let more = match self {
            Self::Cycles => None,
            Self::RawGuides => Some("raw"),
            Self::Fast => Some("fast"),
        };
        ["OIDN"].into_iter().chain(version).chain(more).collect::<Vec<_>>().join(" ")
    }
}

/// Candidates of one kind differ in one setting; they share a colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CandidateKind {
    Noisy,
    Window,
    Skipping,
    Lambda,
    Oidn,
}

/// One setting to measure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Candidate {
    /// Short, unique.
    pub name: String,
    /// What it differs in from the default.
    pub kind: CandidateKind,
    /// Whether it is the default setting.
    pub default: bool,
    /// What to do.
    pub method: Method,
}

impl Candidate {
    /// The frames that it looks at on each side.
    pub fn window(&self) -> usize {
        if let Method::Hush { window, .. } = self.method { window } else { 0 }
    }

    /// What Hush leaves out for it.
    pub fn skip(&self) -> Skip {
        if matches!(self.method, Method::Hush { skipping: false, .. }) { Skip::NONE } else { Skip::default() }
    }
}

/// All candidates for a shot with or without motion vectors: the noisy picture first, then the default.
pub fn candidates(vectors: bool, oidn: bool) -> Vec<Candidate> {
    let base = if vectors { DEFAULT_WINDOW } else { 0 };
    let hush = |name: String, kind: CandidateKind, window: usize, lambda: f32, skipping: bool| Candidate {
        name,
        kind,
        default: (window, lambda, skipping) == (base, 1.0, true),
        method: Method::Hush { window, lambda, skipping },
    };
    let plain = |name: &str, kind: CandidateKind, method: Method| Candidate { name: name.into(), kind, default: false, method };
    let mut out = vec![plain("noisy", CandidateKind::Noisy, Method::Noisy)];
    out.push(hush(format!("window {base}"), CandidateKind::Window, base, 1.0, true));
    let others = (0..=if vectors { MAX_WINDOW } else { 0 }).filter(|w| *w != base);
    out.extend(others.map(|w| hush(format!("window {w}"), CandidateKind::Window, w, 1.0, true)));
    out.push(hush("no skipping".into(), CandidateKind::Skipping, base, 1.0, false));
    out.extend([4.0, 16.0].map(|lambda| hush(format!("λ {lambda}"), CandidateKind::Lambda, base, lambda, true)));
    if oidn {
        out.extend(OidnMode::ALL.map(|mode| plain(&mode.name(None), CandidateKind::Oidn, Method::Oidn { mode })));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_there_once() {
        let all = candidates(true, true);
        let names: Vec<&str> = all.iter().map(|c| c.name.as_str()).collect();
        let expected = [
            "noisy",
            "window 2",
            "window 0",
            "window 1",
            "window 3",
            "no skipping",
            "λ 4",
            "λ 16",
            "OIDN",
            "OIDN raw",
            "OIDN fast",
        ];
        assert_eq!(names, expected);
        assert_eq!(OidnMode::ALL.map(|mode| mode.name(Some("3.0.0"))), ["OIDN 3.0.0", "OIDN 3.0.0 raw", "OIDN 3.0.0 fast"]);
        assert_eq!(all.iter().filter(|c| c.default).count(), 1);
        assert!(all[1].default && all[4].window() == 3 && all[5].skip() == Skip::NONE);
    }

    #[test]
    fn without_vectors_no_window_is_wider_than_none() {
        let all = candidates(false, false);
        assert!(all.iter().all(|c| c.window() == 0 && c.kind != CandidateKind::Oidn));
        assert!(all[1].default && all[1].name == "window 0");
    }
}
