//! Where openusd composes less than USD, or otherwise: told in words, as a shot is not denoised with half its settings.

use openusd::pcp::NodeFlags;
use openusd::sdf::Path;
use openusd::usd::{Attribute, Prim, Stage};

use super::open;
use super::opinions::complaint;
use super::prims::{Chain, targets, words};

/// What the settings' prims refer to is there.
///
/// # Errors
/// A reference, payload or class of these prims that cannot be read, or leads in a circle. What other prims miss, such as an
/// asset of the scene, is none of Hush's business.
pub(super) fn nothing_lost(stage: &Stage, chain: &Chain) -> Result<(), String> {
    if stage.composition_errors().is_empty() {
        return Ok(());
    }
    // Which prim an error belongs to is not kept: look at these prims alone.
    let alone = open::open(stage.root_layer().identifier())?;
    for prim in &chain.prims {
        for product in composed(&alone, prim.path(), &["renderSource", "denoise:pass", "products"])? {
            for var in composed(&alone, &product, &["orderedVars"])? {
                composed(&alone, &var, &[])?;
            }
        }
    }
    match alone.composition_errors().first() {
        Some(error) => Err(format!("{error}: the settings would not be whole; mend it, or take it out")),
        None => Ok(()),
    }
}

/// Composes one prim; the targets of its last relationship.
fn composed(stage: &Stage, prim: &Path, relationships: &[&str]) -> Result<Vec<Path>, String> {
    let prim = stage.prim(prim.clone());
    prim.property_names().map_err(words)?;
    relationships.iter().try_fold(Vec::new(), |_, name| targets(&prim, name))
}

/// Value clips would stand between the layers' opinions.
///
/// # Errors
/// The prim, or one that it lies in, has clips.
pub(super) fn no_clips(prim: &Prim) -> Result<(), String> {
    let mut path = Some(prim.path().clone());
    while let Some(here) = path.filter(|path| !path.is_abs_root()) {
        if prim.stage().prim(here.clone()).has_clips().map_err(words)? {
            return Err(format!("<{here}> has value clips, which are not read for settings: author time samples instead"));
        }
        path = here.parent();
    }
    Ok(())
}

/// The time samples that stand at `place` in their layer come at the times that USD gives them.
///
/// # Errors
/// They override a class that a retimed reference brings: openusd retimes them with the reference, USD does not.
pub(super) fn times_hold(attribute: &Attribute, place: &Path) -> Result<(), String> {
    let class = place.prim_path().strip_all_variant_selections();
    let index = attribute.prim().prim_index().graph().map_err(words)?;
    let retimed = index.nodes().any(|node| {
        node.flags().contains(NodeFlags::IMPLIED_CLASS)
            && node.path().strip_all_variant_selections() == class
            && !node.map_to_root().time_offset().is_identity()
    });
    match retimed {
        true => Err(complaint(
            attribute,
            &format!(
                "has its time samples from the class <{class}> beside a retimed reference, which cannot be read: author them on the prim"
            ),
        )),
        false => Ok(()),
    }
}
