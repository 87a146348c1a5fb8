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
        /// Whether the second pass over time follows.
        second_pass: bool,
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
    SecondPass,
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

/// How Hush denoises a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HushSetting {
    pub window: usize,
    pub lambda: f32,
    /// What the first pass leaves out where no second one follows; with one it is what the engine's own settings say.
    pub skip: Skip,
    pub second_pass: bool,
}

impl Candidate {
    /// How Hush denoises for it, where it is Hush that does.
    pub fn hush(&self) -> Option<HushSetting> {
        let Method::Hush { window, lambda, skipping, second_pass } = self.method else { return None };
        Some(HushSetting { window, lambda, skip: if skipping { Skip::default() } else { Skip::NONE }, second_pass })
    }

    /// The frames on each side that its result depends on.
    pub fn reach(&self) -> usize {
        self.hush().map_or(0, |hush| hush.window * (1 + usize::from(hush.second_pass)))
    }
}

/// All candidates for a shot with or without motion vectors, for weights with or without a second pass over time: the noisy picture first,
/// then the default.
pub fn candidates(vectors: bool, second_pass: bool, oidn: bool) -> Vec<Candidate> {
    let base = if vectors { DEFAULT_WINDOW } else { 0 };
    let hush = |name: String, kind: CandidateKind, window: usize, lambda: f32, skipping: bool| Candidate {
        name,
        kind,
        default: (window, lambda, skipping) == (base, 1.0, true),
        method: Method::Hush { window, lambda, skipping, second_pass: false },
    };
    let plain = |name: &str, kind: CandidateKind, method: Method| Candidate { name: name.into(), kind, default: false, method };
    let mut out = vec![plain("noisy", CandidateKind::Noisy, Method::Noisy)];
    out.push(hush(format!("window {base}"), CandidateKind::Window, base, 1.0, true));
    let others = (0..=if vectors { MAX_WINDOW } else { 0 }).filter(|w| *w != base);
    out.extend(others.map(|w| hush(format!("window {w}"), CandidateKind::Window, w, 1.0, true)));
    if vectors && second_pass {
        let method = Method::Hush { window: base, lambda: 1.0, skipping: true, second_pass };
        out.push(plain("second pass", CandidateKind::SecondPass, method));
    }
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
        let all = candidates(true, true, true);
        let names: Vec<&str> = all.iter().map(|c| c.name.as_str()).collect();
        let expected = [
            "noisy",
            "window 2",
            "window 0",
            "window 1",
            "window 3",
            "second pass",
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
        assert_eq!(all.iter().map(Candidate::reach).max(), Some(4));
        assert!(all[1].default && all[4].reach() == 3 && all[6].hush().unwrap().skip == Skip::NONE);
        let one_pass = candidates(true, false, true);
        assert!(one_pass.len() == all.len() - 1 && one_pass.iter().all(|c| c.reach() <= MAX_WINDOW));
    }

    #[test]
    fn without_vectors_no_window_is_wider_than_none() {
        let all = candidates(false, true, false);
        assert!(all.iter().all(|c| c.reach() == 0 && c.kind != CandidateKind::Oidn));
        assert!(all[1].default && all[1].name == "window 0");
    }
}
