//! The frames' file from a `RenderProduct`, and the passes' names from its `RenderVar`s, as other renderers name them.

use std::path::{Path, PathBuf};

use openusd::usd::{Prim, Stage};

use super::attributes::{samples, value};
use super::opinions::place;
use super::plain_path::plain;
use super::prims::{Chain, targets, type_of};
use super::values::text;
use crate::settings::layered::{Layered, Origin};

const NAME: &str = "productName";
/// The EXR layer name where a renderer's driver is told one.
const AOV_NAME: &str = "driver:parameters:aov:name";
const SOURCE_NAME: &str = "sourceName";

/// A guide or the beauty, as `passes` names them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Beauty,
    Albedo,
    Normal,
    Depth,
    Vector,
}

/// What renderers call each pass, without case and signs: in its name or as the source that it is made from.
const NAMES: [(Kind, &[&str]); 5] = [
    (Kind::Beauty, &["beauty", "combined", "rgba", "ci", "c", "color", "colour", "clo", "lpeclo"]),
    (Kind::Albedo, &["albedo", "denoisingalbedo", "denoisealbedo", "diffusealbedo", "basecolor"]),
    (Kind::Normal, &["normal", "normals", "n", "nn", "denoisingnormal", "denoisenormal", "rayhitn", "hitn", "worldnormal"]),
    (Kind::Depth, &["depth", "z", "denoisingdepth", "rayhitpz", "hitpz", "zdepth", "pz"]),
    (Kind::Vector, &["vector"]),
];

/// What Blender calls them; these need no mapping.
const BLENDER: [&str; 8] =
    ["Combined", "Image", "RGBA", "Denoising Albedo", "Denoising Normal", "Denoising Depth", "Depth", "Vector"];

fn kind_of(name: &str) -> Option<Kind> {
    let plain: String = name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect();
    NAMES.iter().find(|(_, names)| names.contains(&plain.as_str())).map(|(kind, _)| *kind)
}

/// The settings that the products of a chain imply; the first product of pixels with a name or a known variable counts.
pub(super) fn read(stage: &Stage, chain: &Chain) -> Result<Layered, String> {
    let Some(settings) = &chain.settings else { return Ok(Layered::default()) };
    let mut all = Layered::default();
    let mut named: Vec<String> = Vec::new();
    for path in targets(settings, "products")? {
        let product = stage.prim(path);
        if type_of(&product)? != "RenderProduct" || said(&product, "productType")?.is_some_and(|kind| kind != "raster") {
            continue;
        }
        let one = product_settings(stage, &product)?;
        named.extend(one.values.input.iter().map(|_| product.path().to_string()));
        // Earlier products win.
        all = all.over(one);
    }
    if named.len() > 1 {
        let others = named[1..].iter().map(|p| format!("<{p}>")).collect::<Vec<_>>().join(", ");
        let file = plain(stage.root_layer().identifier()).display().to_string();
        all.notes
            .push(format!("{file}: the frames are those of <{}>, the first of several products; left out: {others}", named[0]));
    }
    Ok(all)
}

fn product_settings(stage: &Stage, product: &Prim) -> Result<Layered, String> {
    let mut one = Layered::default();
    if let Some(input) = product_pattern(product)? {
        let (file, _) = place(&product.attribute(NAME))?;
        let folder = file.parent().map(PathBuf::from).unwrap_or_default();
        one.values.input = Some(folder.join(input));
        one = with_origin(one, product, NAME, file);
    }
    for path in targets(product, "orderedVars")? {
        let var = stage.prim(path);
        if type_of(&var)? == "RenderVar" {
            // Earlier variables win.
            one = one.over(var_settings(&var)?);
        }
    }
    Ok(one)
}

fn with_origin(settings: Layered, prim: &Prim, attribute: &str, file: PathBuf) -> Layered {
    let prim = prim.path().to_string();
    Layered::new(settings.values, |_| Origin::Usd { file: file.clone(), prim: prim.clone(), attribute: attribute.into() })
}

/// The pass that a variable is, by the layer's name in the file, by its own, or by its source.
fn var_settings(var: &Prim) -> Result<Layered, String> {
    let own = var.path().name().unwrap_or_default().to_owned();
    let (aov, source) = (said(var, AOV_NAME)?, said(var, SOURCE_NAME)?);
    let attribute = if aov.is_some() { AOV_NAME } else { SOURCE_NAME };
    let layer = aov.unwrap_or_else(|| own.clone());
    let kind = kind_of(&layer).or_else(|| kind_of(&own)).or_else(|| source.as_deref().and_then(kind_of));
    let Some(kind) = kind.filter(|_| !BLENDER.contains(&layer.as_str())) else { return Ok(Layered::default()) };
    let mut one = Layered::default();
    let values = &mut one.values;
    *match kind {
        Kind::Beauty => &mut values.passes_beauty,
        Kind::Albedo => &mut values.passes_albedo,
        Kind::Normal => &mut values.passes_normal,
        Kind::Depth => &mut values.passes_depth,
        Kind::Vector => &mut values.passes_vector,
    } = Some(layer);
    let (file, _) = place(&var.attribute(attribute))?;
    let file = if file.as_os_str().is_empty() { plain(var.stage().root_layer().identifier()) } else { file };
    Ok(with_origin(one, var, attribute, file))
}

/// A text attribute's value, if it has one.
fn said(prim: &Prim, attribute: &str) -> Result<Option<String>, String> {
    Ok(value(&prim.attribute(attribute))?.as_ref().and_then(text).filter(|t| !t.is_empty()))
}

/// The frames that a product's name stands for, as a pattern; the name may be one for all frames, with a placeholder or with one
/// frame's number in it, or there may be a sample for each.
fn product_pattern(product: &Prim) -> Result<Option<String>, String> {
    let attribute = product.attribute(NAME);
    let name = samples(&attribute)?.first().and_then(|(_, value)| text(value));
    Ok(name.or(said(product, NAME)?).filter(|n| !n.is_empty()).map(|name| pattern(&name)))
}

/// `$F4`, `<F4>` and a number before the extension become `####`.
fn pattern(name: &str) -> String {
    let (folder, file) = match Path::new(name).file_name().and_then(|f| f.to_str()) {
        Some(file) => (&name[..name.len() - file.len()], file),
        None => return name.into(),
    };
    for (start, end) in [("<F", ">"), ("<f", ">"), ("${F", "}"), ("$F", "")] {
        let Some(at) = file.find(start) else { continue };
        let rest = &file[at + start.len()..];
        let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        let Some(after) = rest[digits..].strip_prefix(end) else { continue };
        let width = rest[..digits].parse::<usize>().unwrap_or(1).clamp(1, 12);
        return format!("{folder}{}{}{after}", &file[..at], "#".repeat(width));
    }
    if file.contains(['#', '%', '*', '?']) {
        return name.into();
    }
    let stem = file.len() - Path::new(file).extension().map_or(0, |e| e.len() + 1);
    let digits = file[..stem].len() - file[..stem].trim_end_matches(|c: char| c.is_ascii_digit()).len();
    format!("{folder}{}{}{}", &file[..stem - digits], "#".repeat(digits), &file[stem..])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_products_become_patterns() {
        for (name, expected) in [
            ("/r/shot.$F4.exr", "/r/shot.####.exr"),
            ("shot_<F4>.exr", "shot_####.exr"),
            ("a/${F}.exr", "a/#.exr"),
            ("a/shot.####.exr", "a/shot.####.exr"),
            ("a/shot_%04d.exr", "a/shot_%04d.exr"),
            ("v2/shot.1001.exr", "v2/shot.####.exr"),
            ("still.exr", "still.exr"),
            ("1001/take3.exr", "1001/take#.exr"),
            ("$F", "#"),
            ("/", "/"),
        ] {
            assert_eq!(pattern(name), expected, "{name}");
        }
    }

    #[test]
    fn passes_are_known_by_what_renderers_call_them() {
        for (name, kind) in [
            ("C", Some(Kind::Beauty)),
            ("Ci", Some(Kind::Beauty)),
            ("lpe:C.*[LO]", Some(Kind::Beauty)),
            ("ray:hitN", Some(Kind::Normal)),
            ("diffuse_albedo", Some(Kind::Albedo)),
            ("Z", Some(Kind::Depth)),
            ("directdiffuse", None),
            ("motionvector", None),
        ] {
            assert_eq!(kind_of(name), kind, "{name}");
        }
    }
}
