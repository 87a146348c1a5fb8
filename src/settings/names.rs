//! Lists of names as people write them: one text, or a list.

use serde::{Deserialize, Deserializer, Serialize};

use crate::error::{Error, Result};
use crate::io::Guides;

/// A pass that guides the denoiser.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Guide {
    /// Denoising Albedo.
    Albedo,
    /// Denoising Normal.
    Normal,
    /// Denoising Depth or Depth.
    Depth,
    /// Motion vectors; without them no neighbour helps.
    Vector,
}

impl std::str::FromStr for Guide {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text.trim().to_ascii_lowercase().as_str() {
            "albedo" => Ok(Self::Albedo),
            "normal" => Ok(Self::Normal),
            "depth" => Ok(Self::Depth),
            "vector" => Ok(Self::Vector),
            _ => {
                let reason = format!("'{text}' is none: there are albedo, normal, depth, vector; or write none");
                Err(Error::BadSetting { name: "guides", reason })
            }
        }
    }
}

/// The guides of a list; `none` for no guide at all.
pub(super) fn parse_guides<S: AsRef<str>>(names: &[S]) -> Result<Vec<Guide>> {
    let named = names.iter().filter(|n| !n.as_ref().eq_ignore_ascii_case("none"));
    named.map(|n| n.as_ref().parse()).collect()
}

/// The guides as the selection wants them.
pub(super) fn selected(guides: Option<&[Guide]>) -> Guides {
    let Some(guides) = guides else { return Guides::default() };
    let has = |guide| guides.contains(&guide);
    Guides { albedo: has(Guide::Albedo), normal: has(Guide::Normal), depth: has(Guide::Depth), vector: has(Guide::Vector) }
}

/// Names without `none`, which stands for an empty list.
pub(super) fn without_none(names: Vec<String>) -> Vec<String> {
    names.into_iter().filter(|n| !n.eq_ignore_ascii_case("none")).collect()
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a name or a list of names")]
enum OneOrSeveral {
    One(String),
    Several(Vec<String>),
}

impl OneOrSeveral {
    fn list(self) -> Vec<String> {
        match self {
            Self::One(name) => vec![name],
            Self::Several(names) => names,
        }
    }
}

pub(super) fn several<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<String>>, D::Error> {
    Ok(Some(without_none(OneOrSeveral::deserialize(from)?.list())))
}

pub(super) fn guides<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<Guide>>, D::Error> {
    let names = OneOrSeveral::deserialize(from)?.list();
    parse_guides(&names).map(Some).map_err(serde::de::Error::custom)
}
