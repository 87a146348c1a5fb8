//! The source encoders of a weights file: one for each renderer, and one chosen.
//!
//! `encoder.*` is the first renderer's, `encoders.NAME.*` are the others'; `hush.encoders` in the header lists the names in that
//! order. A file without the list has one encoder, for Cycles.

use std::collections::HashMap;

use ndarray::ArrayD;

use crate::error::{Error, Result};

/// The header key with the renderers' names, a JSON list.
pub(super) const ENCODERS_KEY: &str = "hush.encoders";
/// The renderer of a file that says nothing.
pub const DEFAULT_RENDERER: &str = "cycles";
/// More encoders than this have no place in a file.
const MOST: usize = 64;

/// Where the first renderer's tensors stand.
const FIRST: &str = "encoder.";
/// Before the names of the other renderers.
const OTHERS: &str = "encoders.";

/// The renderers that the header names, the one of `encoder.*` first; what is wrong with the list, in words.
pub(super) fn named(text: Option<&str>) -> std::result::Result<Vec<String>, String> {
    let Some(text) = text else { return Ok(vec![DEFAULT_RENDERER.into()]) };
    let names: Vec<String> = serde_json::from_str(text).map_err(|e| format!("{ENCODERS_KEY}: {e}"))?;
    if names.is_empty() || names.len() > MOST {
        return Err(format!("{ENCODERS_KEY} names {} renderers, expected 1 to {MOST}", names.len()));
    }
    for (k, name) in names.iter().enumerate() {
        let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-' || c == '_';
        if name.is_empty() || name.len() > 64 || !name.chars().all(plain) {
            return Err(format!("{ENCODERS_KEY}: {name:?} must be made of a to z, 0 to 9, - and _"));
        }
        if names[..k].contains(name) {
            return Err(format!("{ENCODERS_KEY} names {name} twice"));
        }
    }
    Ok(names)
}

/// Checks that every other renderer has the first one's tensors, shape by shape, and that none belongs to nobody.
pub(super) fn check(tensors: &HashMap<String, ArrayD<f32>>, names: &[String]) -> std::result::Result<(), String> {
    let layers: Vec<&str> = tensors.keys().filter_map(|key| key.strip_prefix(FIRST)).collect();
    for name in names.iter().skip(1) {
        for layer in &layers {
            let (key, first) = (format!("{OTHERS}{name}.{layer}"), &tensors[&format!("{FIRST}{layer}")]);
            let tensor = tensors.get(&key).ok_or_else(|| format!("tensor {key} is missing, and {ENCODERS_KEY} lists {name}"))?;
            if tensor.shape() != first.shape() {
                return Err(format!("tensor {key} has shape {:?}, {FIRST}{layer} has {:?}", tensor.shape(), first.shape()));
            }
        }
    }
    let owned = |rest: &str| {
        let owner = names.iter().skip(1).find_map(|name| rest.strip_prefix(name.as_str())?.strip_prefix('.'));
        owner.is_some_and(|layer| layers.contains(&layer))
    };
    match tensors.keys().find(|key| key.strip_prefix(OTHERS).is_some_and(|rest| !owned(rest))) {
        Some(key) => Err(format!("tensor {key} is part of no encoder that {ENCODERS_KEY} lists ({})", names.join(", "))),
        None => Ok(()),
    }
}

/// Puts the chosen renderer's tensors where the network looks for them, and drops the others'. Returns the renderer's name;
/// None chooses the first.
pub(super) fn choose(
    tensors: &mut HashMap<String, ArrayD<f32>>,
    names: &[String],
    renderer: Option<&str>,
    model: &str,
) -> Result<String> {
    let chosen = match renderer {
        None => 0,
        Some(asked) => names.iter().position(|name| name.eq_ignore_ascii_case(asked)).ok_or_else(|| Error::BadSetting {
            name: "renderer",
            reason: format!("the weights ({model}) have no encoder for {asked:?}, they have: {}", names.join(", ")),
        })?,
    };
    let name = names[chosen].clone();
    if chosen > 0 {
        let prefix = format!("{OTHERS}{name}.");
        let keys: Vec<String> = tensors.keys().filter(|key| key.starts_with(&prefix)).cloned().collect();
        for key in keys {
            if let Some(tensor) = tensors.remove(&key) {
                tensors.insert(format!("{FIRST}{}", &key[prefix.len()..]), tensor);
            }
        }
    }
    tensors.retain(|key, _| !key.starts_with(OTHERS));
    Ok(name)
}

#[cfg(test)]
mod tests {
    use ndarray::IxDyn;

    use super::*;

    fn tensors(of: &[(&str, usize, f32)]) -> HashMap<String, ArrayD<f32>> {
        of.iter().map(|(key, len, value)| ((*key).to_string(), ArrayD::from_elem(IxDyn(&[*len]), *value))).collect()
    }

    fn both() -> (HashMap<String, ArrayD<f32>>, Vec<String>) {
        let two = [("encoder.a.bias", 2, 1.0), ("encoders.mitsuba.a.bias", 2, 2.0), ("mix.bias", 3, 3.0)];
        (tensors(&two), named(Some(r#"["cycles", "mitsuba"]"#)).unwrap())
    }

    #[test]
    fn a_file_that_says_nothing_is_for_cycles() {
        assert_eq!(named(None).unwrap(), ["cycles"]);
        assert_eq!(named(Some(r#"["arnold"]"#)).unwrap(), ["arnold"]);
    }

    #[test]
    fn lists_that_make_no_sense_are_refused() {
        for (list, why) in [
            ("[]", "0 renderers"),
            ("{}", ENCODERS_KEY),
            ("[1]", ENCODERS_KEY),
            (r#"["a.b"]"#, "a.b"),
            (r#"["Cycles"]"#, "Cycles"),
            (r#"[""]"#, "must be made of"),
            (r#"["x", "x"]"#, "twice"),
        ] {
            let message = named(Some(list)).unwrap_err();
            assert!(message.contains(why), "{list}: {message}");
        }
    }

    #[test]
    fn the_chosen_encoder_takes_the_place_of_the_first() {
        for (renderer, name, value) in [(None, "cycles", 1.0), (Some("cycles"), "cycles", 1.0), (Some("Mitsuba"), "mitsuba", 2.0)]
        {
            let (mut all, names) = both();
            check(&all, &names).unwrap();
            assert_eq!(choose(&mut all, &names, renderer, "m").unwrap(), name);
            assert_eq!(all["encoder.a.bias"][[0]], value);
            assert_eq!(all["mix.bias"][[0]], 3.0);
            assert_eq!(all.len(), 2);
        }
    }

    #[test]
    fn an_unknown_renderer_is_told_those_there_are() {
        let (mut all, names) = both();
        let message = choose(&mut all, &names, Some("arnold"), "m.safetensors").unwrap_err().to_string();
        assert!(["arnold", "cycles, mitsuba", "m.safetensors"].iter().all(|part| message.contains(part)), "{message}");
    }

    #[test]
    fn missing_misshapen_and_stray_tensors_are_named() {
        let two = named(Some(r#"["cycles", "mitsuba"]"#)).unwrap();
        let first = ("encoder.a.bias", 2, 1.0);
        for (others, key) in [
            (vec![], "encoders.mitsuba.a.bias is missing"),
            (vec![("encoders.mitsuba.a.bias", 3, 1.0)], "encoders.mitsuba.a.bias has shape [3]"),
            (
                vec![("encoders.mitsuba.a.bias", 2, 1.0), ("encoders.mitsuba.b.bias", 2, 1.0)],
                "encoders.mitsuba.b.bias is part of no",
            ),
            (
                vec![("encoders.mitsuba.a.bias", 2, 1.0), ("encoders.arnold.a.bias", 2, 1.0)],
                "encoders.arnold.a.bias is part of no",
            ),
        ] {
            let all: Vec<_> = [first].into_iter().chain(others).collect();
            let message = check(&tensors(&all), &two).unwrap_err();
            assert!(message.contains(key), "{message}");
        }
    }
}
