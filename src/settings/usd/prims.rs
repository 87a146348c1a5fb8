//! Which prims of a stage hold a shot's settings.

use openusd::sdf::Path;
use openusd::usd::{Prim, PrimPredicate, Stage};

pub(super) const SETTINGS: &str = "RenderSettings";
pub(super) const PASS: &str = "RenderPass";
pub(super) const DENOISE_PASS: &str = "RenderDenoisePass";
/// More are named as "… and others".
const NAMED: usize = 6;

/// The prims that hold settings.
pub(super) struct Chain {
    /// Weakest first: `RenderSettings`, `RenderPass`, `RenderDenoisePass`, as far as they are there.
    pub prims: Vec<Prim>,
    /// The `RenderSettings` whose products are the frames.
    pub settings: Option<Prim>,
}

/// Any error of openusd in words.
pub(super) fn words(error: impl std::fmt::Display) -> String {
    format!("{error:#}")
}

/// The chain that a prim belongs to; without a prim the only one of the stage.
///
/// # Errors
/// No such prim, no render prim at all, or several to choose from; in words, with the prims' paths.
pub(super) fn choose(stage: &Stage, prim: Option<&str>) -> Result<Chain, String> {
    let found = RenderPrims::find(stage)?;
    let Some(wanted) = prim else { return found.chain_of(found.only(stage)?) };
    let path = Path::new(wanted).map_err(|e| format!("<{wanted}> is no prim path: {}", words(e)))?;
    if path.contains_prim_variant_selection() {
        return Err(format!("<{wanted}> selects a variant: select it in the stage, and name the prim alone"));
    }
    let prim = stage.prim(path);
    if prim.is_valid().map_err(words)? {
        return found.chain_of(prim);
    }
    let all: Vec<&Prim> = found.passes.iter().chain(&found.settings).chain(&found.denoise).collect();
    Err(format!("has no prim <{wanted}>{}", if all.is_empty() { String::new() } else { format!("; there are {}", list(&all)) }))
}

/// Whether a stage has no render prim at all, as those that Blender exports.
pub(super) fn is_bare(stage: &Stage) -> Result<bool, String> {
    Ok(RenderPrims::find(stage)?.is_empty())
}

/// The render prims of a stage.
#[derive(Default)]
struct RenderPrims {
    passes: Vec<Prim>,
    settings: Vec<Prim>,
    denoise: Vec<Prim>,
}

impl RenderPrims {
    /// Below `/Render`, where they belong; elsewhere only if there is none.
    fn find(stage: &Stage) -> Result<Self, String> {
        let mut found = Self::default();
        let mut open = vec![stage.prim(Path::new("/Render").map_err(words)?)];
        while let Some(prim) = open.pop() {
            if is_in_scene(&prim)? {
                open.extend(prim.children().map_err(words)?.into_iter().rev());
                found.add(prim)?;
            }
        }
        if found.is_empty() {
            let mut paths = Vec::new();
            stage.traverse(PrimPredicate::DEFAULT, |path| paths.push(path.clone())).map_err(words)?;
            paths.into_iter().try_for_each(|path| found.add(stage.prim(path)))?;
        }
        Ok(found)
    }

    fn is_empty(&self) -> bool {
        self.passes.is_empty() && self.settings.is_empty() && self.denoise.is_empty()
    }

    fn add(&mut self, prim: Prim) -> Result<(), String> {
        match type_of(&prim)?.as_str() {
            PASS => self.passes.push(prim),
            SETTINGS => self.settings.push(prim),
            DENOISE_PASS => self.denoise.push(prim),
            _ => {}
        }
        Ok(())
    }

    /// The prim to start from where the user named none.
    fn only(&self, stage: &Stage) -> Result<Prim, String> {
        let mut speaking: Vec<&Prim> = Vec::new();
        for pass in &self.passes {
            if self.speaks_of_denoising(pass)? {
                speaking.push(pass);
            }
        }
        let passes: Vec<&Prim> = if speaking.is_empty() { self.passes.iter().collect() } else { speaking };
        match (passes.as_slice(), self.settings.as_slice(), self.denoise.as_slice()) {
            ([one], ..) => Ok((*one).clone()),
            ([], [], []) => Err(format!("has no {PASS} and no {SETTINGS} prim: author one, such as with hush shot write")),
            ([], [], [one]) => Ok(one.clone()),
            ([], all, _) => {
                let default = default_settings(stage, all)?.or_else(|| only_one(all));
                default.ok_or_else(|| several(&all.iter().collect::<Vec<_>>()))
            }
            (many, ..) => Err(several(many)),
        }
    }

    /// Whether a pass, or what it points to, has anything to say to Hush.
    fn speaks_of_denoising(&self, pass: &Prim) -> Result<bool, String> {
        let ours = |name: &str| name.starts_with("hush:") || name.starts_with("denoise:");
        Ok(pass.property_names().map_err(words)?.iter().any(|n| ours(n)))
    }

    /// A pass with its settings below and its denoise pass above; any other prim by itself.
    fn chain_of(&self, prim: Prim) -> Result<Chain, String> {
        let stage = prim.stage().clone();
        match type_of(&prim)?.as_str() {
            SETTINGS => Ok(Chain { settings: Some(prim.clone()), prims: vec![prim] }),
            DENOISE_PASS => {
                let mut users = Vec::new();
                for pass in &self.passes {
                    if targets(pass, "denoise:pass")?.contains(prim.path()) {
                        users.push(pass);
                    }
                }
                match users.as_slice() {
                    [] => Ok(Chain { settings: None, prims: vec![prim] }),
                    [pass] => self.chain_of((*pass).clone()),
                    many => Err(format!("<{}> belongs to several passes: name one of {}", prim.path(), list(many))),
                }
            }
            PASS => {
                let source = first_target(&stage, &prim, "renderSource")?;
                let settings = match source.filter(|s| type_of(s).is_ok_and(|t| t == SETTINGS)) {
                    Some(settings) => Some(settings),
                    None => default_settings(&stage, &self.settings)?.or_else(|| only_one(&self.settings)),
                };
                let above = first_target(&stage, &prim, "denoise:pass")?;
                let prims = settings.clone().into_iter().chain([prim]).chain(above).collect();
                Ok(Chain { prims, settings })
            }
            _ => Ok(Chain { settings: None, prims: vec![prim] }),
        }
    }
}

/// Whether a prim is one that renders: not switched off, no class, and more than opinions on what is not there.
fn is_in_scene(prim: &Prim) -> Result<bool, String> {
    let known = [prim.is_valid(), prim.is_active(), prim.is_defined(), prim.is_abstract().map(|class| !class)];
    known.into_iter().try_fold(true, |all, one| Ok(all && one.map_err(words)?))
}

fn only_one(prims: &[Prim]) -> Option<Prim> {
    prims.first().filter(|_| prims.len() == 1).cloned()
}

/// The settings that the stage's metadata name.
fn default_settings(stage: &Stage, all: &[Prim]) -> Result<Option<Prim>, String> {
    let named = stage.stage_metadata("renderSettingsPrimPath").map_err(words)?;
    let named = named.as_ref().and_then(super::values::text);
    Ok(all.iter().find(|p| named.as_deref() == Some(p.path().as_str())).cloned())
}

pub(super) fn type_of(prim: &Prim) -> Result<String, String> {
    Ok(prim.type_name().map_err(words)?.map(|t| t.to_string()).unwrap_or_default())
}

pub(super) fn targets(prim: &Prim, relationship: &str) -> Result<Vec<Path>, String> {
    prim.relationship(relationship).forwarded_targets().map_err(words)
}

/// The first prim that a relationship points to.
///
/// # Errors
/// It points to nothing that is there.
fn first_target(stage: &Stage, prim: &Prim, relationship: &str) -> Result<Option<Prim>, String> {
    let Some(path) = targets(prim, relationship)?.into_iter().next() else { return Ok(None) };
    let target = stage.prim(path);
    match target.is_valid().map_err(words)? {
        true => Ok(Some(target)),
        false => Err(format!("<{}.{relationship}> points to <{}>, which is not there", prim.path(), target.path())),
    }
}

fn several(prims: &[&Prim]) -> String {
    let example = prims.first().map(|p| p.path().to_string()).unwrap_or_default();
    format!("has several render prims to choose from: {}; name one, such as FILE@{example}", list(prims))
}

fn list(prims: &[&Prim]) -> String {
    let mut names: Vec<String> = prims.iter().take(NAMED).map(|p| format!("<{}>", p.path())).collect();
    if prims.len() > NAMED {
        names.push(format!("{} others", prims.len() - NAMED));
    }
    names.join(", ")
}
