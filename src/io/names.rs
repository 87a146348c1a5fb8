//! Channel names of Blender's EXR files: `Layer.Pass.View.Component`, read from the right because layer names may hold dots.

/// A channel name taken apart.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChannelName {
    /// View layer; empty for File Output layers without prefix and for plain images.
    pub layer: String,
    /// Pass; empty for plain images (`R`, `G`, `B`).
    pub pass: String,
    pub view: Option<String>,
    /// `R`, `X`, `V`, …
    pub component: String,
}

/// Takes a channel name apart. `part_name` and `part_view` are the part's `name` and `view` attributes, `views` the file's
/// `multiView` list; `multipart` says whether the part's name stands for a missing prefix.
pub(crate) fn parse(
    channel: &str,
    multipart: bool,
    part_name: Option<&str>,
    part_view: Option<&str>,
    views: &[String],
) -> ChannelName {
    let (mut rest, component) = channel.rsplit_once('.').unwrap_or(("", channel));
    if rest.is_empty() && multipart {
        rest = strip_view_suffix(part_name.unwrap_or(""), part_view);
    }
    let mut view = part_view.map(str::to_owned);
    let (before, last) = rest.rsplit_once('.').unwrap_or(("", rest));
    if views.iter().any(|v| v == last) {
        view = Some(last.to_owned());
        rest = before;
    }
    let (layer, pass) = rest.rsplit_once('.').unwrap_or(("", rest));
    ChannelName { layer: layer.into(), pass: pass.into(), view, component: component.into() }
}

/// Blender 5 names a stereo part `Layer.Pass-view`, others `Layer.Pass.view`.
fn strip_view_suffix<'a>(part_name: &'a str, view: Option<&str>) -> &'a str {
    view.and_then(|v| part_name.strip_suffix(v)).and_then(|s| s.strip_suffix(['-', '.'])).unwrap_or(part_name)
}

/// The name of a channel, `Layer.Pass.View.Component`, without the fields that are empty.
pub(crate) fn join(layer: &str, pass: &str, view: Option<&str>, component: &str) -> String {
    let fields = [layer, pass, view.unwrap_or(""), component];
    fields.into_iter().filter(|f| !f.is_empty()).collect::<Vec<_>>().join(".")
}

/// A light pass that Cycles writes: contributions to the beauty, or factors of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightPass {
    /// Blender 5 name.
    pub full: &'static str,
    /// Blender 4 name.
    pub short: &'static str,
    /// The Color pass to multiply by, both names.
    pub colour: Option<[&'static str; 2]>,
    /// Where to switch it on, below View Layer › Passes › Light.
    pub place: &'static str,
}

const DIFFUSE: Option<[&str; 2]> = Some(["Diffuse Color", "DiffCol"]);
const GLOSSY: Option<[&str; 2]> = Some(["Glossy Color", "GlossCol"]);
const TRANSMISSION: Option<[&str; 2]> = Some(["Transmission Color", "TransCol"]);
const SUBSURFACE: Option<[&str; 2]> = Some(["Subsurface Color", "SubsurfaceCol"]);

/// The additive light passes, in the order of Blender's panel.
pub(crate) const LIGHT_PASSES: [LightPass; 12] = [
    LightPass { full: "Diffuse Direct", short: "DiffDir", colour: DIFFUSE, place: "Diffuse › Direct" },
    LightPass { full: "Diffuse Indirect", short: "DiffInd", colour: DIFFUSE, place: "Diffuse › Indirect" },
    LightPass { full: "Glossy Direct", short: "GlossDir", colour: GLOSSY, place: "Glossy › Direct" },
    LightPass { full: "Glossy Indirect", short: "GlossInd", colour: GLOSSY, place: "Glossy › Indirect" },
    LightPass { full: "Transmission Direct", short: "TransDir", colour: TRANSMISSION, place: "Transmission › Direct" },
    LightPass { full: "Transmission Indirect", short: "TransInd", colour: TRANSMISSION, place: "Transmission › Indirect" },
    LightPass { full: "Subsurface Direct", short: "SubsurfaceDir", colour: SUBSURFACE, place: "Subsurface › Direct" },
    LightPass { full: "Subsurface Indirect", short: "SubsurfaceInd", colour: SUBSURFACE, place: "Subsurface › Indirect" },
    LightPass { full: "Volume Direct", short: "VolumeDir", colour: None, place: "Volume › Direct" },
    LightPass { full: "Volume Indirect", short: "VolumeInd", colour: None, place: "Volume › Indirect" },
    LightPass { full: "Emission", short: "Emit", colour: None, place: "Emission" },
    LightPass { full: "Environment", short: "Env", colour: None, place: "Environment" },
];

/// Passes below View Layer › Passes › Light that are multiplied with an image, Blender 5's name and 4's. Their noise has nothing to do with
/// the albedo that all light is divided by.
const FACTORS: [[&str; 2]; 2] = [["Ambient Occlusion", "AO"], ["Shadow Catcher"; 2]];

/// What the passes of Blender's Denoising Data begin with.
pub(super) const DENOISING: &str = "Denoising ";
/// The depth among them.
pub(super) const DENOISING_DEPTH: &str = "Denoising Depth";
/// What Blender 5.2 writes with them beside the guides. They are no light passes.
pub(crate) const UNUSED_GUIDES: [&str; 2] = ["Denoising Specular Albedo", "Denoising Roughness"];

/// The light pass of either name, whatever its case.
pub(crate) fn light_pass(name: &str) -> Option<&'static LightPass> {
    LIGHT_PASSES.iter().find(|l| l.full.eq_ignore_ascii_case(name) || l.short.eq_ignore_ascii_case(name))
}

/// Whether a pass, given by either name, whatever its case, is a factor.
pub(super) fn is_factor(name: &str) -> bool {
    FACTORS.iter().flatten().any(|n| n.eq_ignore_ascii_case(name))
}

/// Whether a pass holds one light group's share of the beauty (`Combined_Key`).
pub(crate) fn is_light_group(pass: &str) -> bool {
    pass.strip_prefix("Combined_").is_some_and(|group| !group.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(channel: &str, part: Option<&str>, view: Option<&str>, views: &[&str], expected: (&str, &str, Option<&str>, &str)) {
        let views: Vec<String> = views.iter().map(|v| v.to_string()).collect();
        let n = parse(channel, part.is_some(), part, view, &views);
        assert_eq!((n.layer.as_str(), n.pass.as_str(), n.view.as_deref(), n.component.as_str()), expected, "{channel}");
    }

    #[test]
    fn names_parse_from_the_right() {
        check("ViewLayer.Combined.R", None, None, &[], ("ViewLayer", "Combined", None, "R"));
        check("My layer.v2 x.Noisy Image.A", None, None, &[], ("My layer.v2 x", "Noisy Image", None, "A"));
        check("Image.R", None, None, &[], ("", "Image", None, "R"));
        check("Denoising Depth.V", None, None, &[], ("", "Denoising Depth", None, "V"));
        check("R", None, None, &[], ("", "", None, "R"));
    }

    #[test]
    fn views_come_from_the_part_or_the_name() {
        let part = Some("ViewLayer.Combined-left");
        check("ViewLayer.Combined.R", part, Some("left"), &[], ("ViewLayer", "Combined", Some("left"), "R"));
        check("ViewLayer.Combined.left.R", None, None, &["left", "right"], ("ViewLayer", "Combined", Some("left"), "R"));
        check("left.R", None, None, &["left", "right"], ("", "", Some("left"), "R"));
        // A layer called like a view is no view where the file has no views.
        check("left.Combined.R", None, None, &[], ("left", "Combined", None, "R"));
    }

    #[test]
    fn a_part_name_stands_in_for_the_prefix() {
        check("R", Some("fg.beauty"), None, &[], ("fg", "beauty", None, "R"));
        check("R", Some("fg.beauty.right"), Some("right"), &[], ("fg", "beauty", Some("right"), "R"));
    }

    #[test]
    fn joining_leaves_out_what_is_empty() {
        assert_eq!(join("A b.c", "Noisy Image", None, "R"), "A b.c.Noisy Image.R");
        assert_eq!(join("V", "Noisy Image", Some("left"), "R"), "V.Noisy Image.left.R");
        assert_eq!(join("", "Noisy Image", None, "R"), "Noisy Image.R");
        assert_eq!(join("V", "Noisy Image", None, ""), "V.Noisy Image");
    }

    #[test]
    fn light_passes_have_two_names() {
        assert_eq!(light_pass("DiffDir").map(|l| l.full), Some("Diffuse Direct"));
        assert_eq!(light_pass("glossy indirect").map(|l| l.short), Some("GlossInd"));
        assert!(light_pass("Mist").is_none());
        assert!(is_light_group("Combined_Key") && !is_light_group("Combined"));
    }
}
