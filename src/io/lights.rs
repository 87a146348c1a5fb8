//! Finding the light passes that are denoised along with the beauty.

use super::layout::{Layout, Pass, ViewLayer};
use super::names::{self, LIGHT_PASSES, LightPass};
use super::pass_names::PassNames;
use super::resolved::{AovRef, DataWindow, Missing, PassRef};
use super::selection::Selection;
use super::view_layers::is_beauty;
use crate::error::{Error, Result};

/// The light passes of a selection in a layer and view, and what is missing for `all`. A pass that was named and is not there
/// (or whose Color pass is not) is an error, and so is one that was named and is no light; under `all` both are left out.
pub(super) fn find(
    layout: &Layout,
    layer: &ViewLayer,
    view: Option<&str>,
    selection: &Selection,
    window: Option<DataWindow>,
) -> Result<(Vec<AovRef>, Vec<Missing>)> {
    let Selection { aovs: wanted, passes, .. } = selection;
    let finder = Finder { layout, layer, view, window, passes };
    let (mut found, mut missing): (Vec<AovRef>, Vec<Missing>) = Default::default();
    for name in wanted {
        if !name.eq_ignore_ascii_case("all") {
            if let Some(why) = finder.why_no_light(name) {
                let reason = format!("{name} is {why}: leave it out");
                return Err(Error::BadSetting { name: "aovs", reason });
            }
            let aov = finder.named(name).map_err(|m| error(layout, m))?;
            found.push(aov);
            continue;
        }
        for light in &LIGHT_PASSES {
            let Some(pass) = finder.pass(&[light.full, light.short]) else { continue };
            match finder.light(&pass.name, pass, light) {
                Ok(aov) => found.push(aov),
                Err(m) => missing.push(m),
            }
        }
        let groups = layer.passes.iter().filter(|p| p.view.as_deref() == view && names::is_light_group(&p.name));
        for pass in groups {
            match finder.reference(pass) {
                Ok(reference) => found.push(AovRef { name: pass.name.clone(), pass: reference, colour: None }),
                Err(m) => missing.push(m),
            }
        }
    }
    if found.is_empty() && !wanted.is_empty() {
        let advice = "enable View Layer › Passes › Light, such as Diffuse Direct, Indirect and Color, or set aovs to none";
        missing.push(Missing { pass: "light".into(), advice: advice.into() });
    }
    // The same pass twice would be divided twice.
    let mut unique: Vec<AovRef> = Vec::new();
    for aov in found {
        if !unique.iter().any(|u| u.pass == aov.pass) {
            unique.push(aov);
        }
    }
    Ok((unique, missing))
}

fn error(layout: &Layout, missing: Missing) -> Error {
    Error::MissingPass { path: layout.path.clone(), pass: missing.pass, advice: missing.advice }
}

struct Finder<'a> {
    layout: &'a Layout,
    layer: &'a ViewLayer,
    view: Option<&'a str>,
    window: Option<DataWindow>,
    passes: &'a PassNames,
}

impl<'a> Finder<'a> {
    fn pass(&self, names: &[&str]) -> Option<&'a Pass> {
        names.iter().find_map(|name| self.layer.pass(name, self.view))
    }

    /// What a pass is that was named and cannot be denoised with the beauty's kernels.
    fn why_no_light(&self, name: &str) -> Option<String> {
        const STAYS: &str = "which stays as it was rendered";
        if names::is_factor(name) {
            return Some(format!(
                "no light of the image but a factor, which these kernels would take out of its range and {STAYS}"
            ));
        }
        if is_beauty(name, self.passes) {
            return Some("the image itself, which is denoised in any case".into());
        }
        if name.starts_with(names::DENOISING) {
            return Some(format!("no light of the image but a guide, {STAYS}"));
        }
        let pass = self.pass(&[name]).filter(|pass| pass.rgb().is_none())?;
        let channels: Vec<&str> = pass.channels.iter().map(|c| c.component.as_str()).collect();
        Some(format!("no light of the image but data (its channels are {}, not R, G, B), {STAYS}", channels.join(", ")))
    }

    fn named(&self, name: &str) -> Result<AovRef, Missing> {
        if let Some(light) = names::light_pass(name) {
            let advice = format!("enable View Layer › Passes › Light › {}", light.place);
            let pass = self.pass(&[light.full, light.short]).ok_or(Missing { pass: light.full.into(), advice })?;
            return self.light(name, pass, light);
        }
        // Light groups and shader AOVs add to the beauty as they are.
        let pass = self.pass(&[name]).ok_or_else(|| {
            let passes: Vec<&str> = self.layer.passes.iter().map(|p| p.name.as_str()).collect();
            Missing { pass: name.into(), advice: format!("the passes of {} are {}", self.layer.name, passes.join(", ")) }
        })?;
        Ok(AovRef { name: name.into(), pass: self.reference(pass)?, colour: None })
    }

    fn light(&self, name: &str, pass: &Pass, light: &LightPass) -> Result<AovRef, Missing> {
        let colour = light.colour.map(|names| {
            let group = light.place.split(" › ").next().unwrap_or_default();
            let advice = format!(
                "{} can only be denoised along with it: enable View Layer › Passes › Light › {group} › Color",
                light.full
            );
            let colour = self.pass(&names).ok_or(Missing { pass: names[0].into(), advice })?;
            self.reference(colour)
        });
        Ok(AovRef { name: name.into(), pass: self.reference(pass)?, colour: colour.transpose()? })
    }

    fn reference(&self, pass: &Pass) -> Result<PassRef, Missing> {
        let missing = |advice: &str| Missing { pass: pass.name.clone(), advice: advice.into() };
        let channels = pass.rgb().ok_or_else(|| missing("the pass is there, but not with the channels R, G, B"))?;
        let reference = PassRef::new(self.layer, pass, channels);
        match reference.data_window(self.layout) == self.window {
            true => Ok(reference),
            false => Err(missing("the pass is there, but in another size than the image")),
        }
    }
}
