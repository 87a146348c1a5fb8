//! View layers, views and parts of the files that Blender writes, denoised (here: halved) and written: what other programs find in them.

mod exr_support;

use exr::prelude::{Compression, SampleType};
use exr_support::halved::*;
use exr_support::*;
use hush::io::{Selection, WriteOptions, read_layout, resolve};

const KEEP: WriteOptions = WriteOptions { keep_noisy: true, attributes: Vec::new() };

#[test]
fn stereo_files_of_both_kinds_are_denoised_in_both_views() {
    let views = ["left", "right"];
    for multipart in [true, false] {
        let (_folder, source, output) = folder();
        let mut parts = Vec::new();
        for (i, view) in views.iter().enumerate() {
            for (name, letters) in [("Combined", "RGBA"), ("Vector", "XYZW")] {
                let prefix = if multipart { format!("ViewLayer.{name}") } else { format!("ViewLayer.{name}.{view}") };
                let channels = pass(&prefix, letters, SampleType::F32, SIZE, i as u64 + 1);
                let name = Some(format!("ViewLayer.{name}-{view}"));
                parts.push(Part { name, view: Some(view.to_string()), channels, ..Part::default() });
            }
        }
        if !multipart {
            let channels = parts.into_iter().flat_map(|p| p.channels).collect();
            parts = vec![Part { channels, multi_view: views.map(String::from).to_vec(), ..Part::default() }];
        }
        write(&source, parts, Style::new(Compression::ZIP16));
        let layout = read_layout(&source).unwrap();
        assert_eq!((layout.layers.len(), &layout.layers[0].views[..]), (1, &views.map(String::from)[..]));
        denoise(&source, &output, &Selection::default(), &KEEP);
        compare(&source, &output, is_beauty, 8, 0.0, &format!("stereo, multipart {multipart}"));
        let written = read_layout(&output).unwrap();
        for view in views {
            assert!(written.layers[0].pass("Noisy Image", Some(view)).is_some_and(|p| p.channels.len() == 4), "{view}");
        }
        // One view alone leaves the other as it is.
        let right = Selection { view: Some("right".into()), ..Selection::default() };
        denoise(&source, &output, &right, &WriteOptions::default());
        compare(&source, &output, |v, n| is_beauty(v, n) && (v == "right" || n.contains(".right.")), 0, 0.0, "right view");
    }
}

#[test]
fn the_part_of_the_noisy_image_does_not_repeat_the_metadata_of_the_file() {
    let (_folder, source, output) = folder();
    let mut parts = render(SampleType::F16, true, SIZE);
    let texts = |names: &[&str]| names.iter().map(|n| (n.to_string(), "data".to_string())).collect::<Vec<_>>();
    parts.iter_mut().for_each(|part| part.attributes = texts(&["everywhere"]));
    parts[0].attributes = texts(&["everywhere", "colorInteropID", "cryptomatte/542cafa/manifest"]);
    write(&source, parts, Style::new(Compression::ZIP16));
    denoise(&source, &output, &Selection::default(), &KEEP);
    let (before, after) = (read(&source).0.headers, read(&output).0.headers);
    assert_eq!(before[0].own_attributes, after[0].own_attributes);
    let mut told: Vec<String> = after[before.len()].own_attributes.other.keys().map(|name| name.to_string()).collect();
    told.sort();
    assert_eq!(told, ["colorInteropID", "everywhere"]);
}

/// One part a view layer, with both views in its channels' names; also a single part that has a name.
#[test]
fn views_in_the_channel_names_of_named_parts_get_parts_of_their_own() {
    for layers in [&["Near", "Far"][..], &["Near"]] {
        let (_folder, source, output) = folder();
        let part = |layer: &&str| Part {
            name: Some(layer.to_string()),
            multi_view: ["left", "right"].map(String::from).to_vec(),
            channels: ["left", "right"]
                .iter()
                .flat_map(|view| pass(&format!("{layer}.Combined.{view}"), "RGBA", SampleType::F16, SIZE, 3))
                .collect(),
            ..Part::default()
        };
        write(&source, layers.iter().map(part).collect(), Style::new(Compression::ZIP16));
        denoise(&source, &output, &Selection::default(), &KEEP);
        let written = read_layout(&output).unwrap();
        let names: Vec<&str> = written.part_list.iter().filter_map(|p| p.name.as_deref()).collect();
        assert_eq!(names, [layers, &["Near.Noisy Image.left", "Near.Noisy Image.right"]].concat());
        for view in ["left", "right"] {
            let kept = written.layers[0].passes.iter().filter(|p| p.name == "Noisy Image" && p.view.as_deref() == Some(view));
            assert_eq!(kept.map(|p| p.channels.len()).collect::<Vec<_>>(), [4], "{view}");
        }
    }
}

#[test]
fn layer_names_may_hold_dots_and_spaces() {
    for multipart in [false, true] {
        let (_folder, source, output) = folder();
        let mut channels = pass("My layer.v2 x.Combined", "RGBA", SampleType::F16, SIZE, 1);
        channels.extend(pass("ViewLayer.Combined", "RGBA", SampleType::F16, SIZE, 2));
        channels.extend(pass("My layer.v2 x.Vector", "XYZW", SampleType::F32, SIZE, 3));
        let part = |name: &str, channels| Part { name: Some(name.into()), channels, ..Part::default() };
        let parts = match multipart {
            false => vec![Part { channels, ..Part::default() }],
            true => {
                let rest = channels.split_off(4);
                vec![part("My layer.v2 x.Combined", channels), part("everything else", rest)]
            }
        };
        write(&source, parts, Style::new(Compression::PIZ));
        let selection = Selection { layers: vec!["My layer.v2 x".into()], ..Selection::default() };
        let layout = read_layout(&source).unwrap();
        let resolved = resolve(&layout, &selection).unwrap();
        assert_eq!(resolved.vector.as_ref().map(|v| v.channels[0].name.as_str()), Some("My layer.v2 x.Vector.X"));
        denoise(&source, &output, &selection, &KEEP);
        compare(&source, &output, |_, n| n.starts_with("My layer.v2 x.Combined"), 4, 0.0, "dots and spaces");
        // The other layer has no vectors of its own, but can borrow them.
        let other = Selection { layers: vec!["ViewLayer".into()], ..Selection::default() };
        let resolved = resolve(&layout, &other).unwrap();
        assert!(resolved.missing.iter().any(|m| m.pass == "Vector" && m.advice.contains("My layer.v2 x")));
        let borrowed = Selection { vector_layer: Some("My layer.v2 x".into()), ..other };
        assert!(resolve(&layout, &borrowed).unwrap().vector.is_some());
    }
}

#[test]
fn file_output_layers_have_no_prefix() {
    for multipart in [false, true] {
        let (_folder, source, output) = folder();
        let passes = [("Image", "RGBA"), ("Denoising Depth", "V"), ("Denoising Albedo", "RGBA"), ("Vector", "XYZW")];
        let mut parts: Vec<Part> = passes
            .iter()
            .map(|(name, letters)| Part {
                name: Some(name.to_string()),
                attributes: vec![("Frame".into(), "2".into())],
                channels: pass(name, letters, SampleType::F32, SIZE, 9),
                ..Part::default()
            })
            .collect();
        if !multipart {
            let attributes = std::mem::take(&mut parts[0].attributes);
            let channels = parts.into_iter().flat_map(|p| p.channels).collect();
            parts = vec![Part { channels, attributes, ..Part::default() }];
        }
        write(&source, parts, Style::new(Compression::ZIP16));
        let layout = read_layout(&source).unwrap();
        assert_eq!((layout.layers.len(), layout.layers[0].name.as_str(), layout.frame), (1, "", Some(2)));
        let resolved = resolve(&layout, &Selection::default()).unwrap();
        assert!(resolved.depth.is_some() && resolved.albedo.is_some() && resolved.vector.is_some());
        assert_eq!(resolved.missing.len(), 1);
        denoise(&source, &output, &Selection::default(), &KEEP);
        compare(&source, &output, |_, n| n.starts_with("Image."), 4, 0.0, "File Output");
        assert!(read(&output).1.contains_key(&(String::new(), "Noisy Image.R".into())));
    }
}

#[test]
fn plain_images_are_colour_alone() {
    let (_folder, source, output) = folder();
    let channels = pass("", "RGB", SampleType::F16, SIZE, 1);
    write(&source, vec![Part { channels, ..Part::default() }], Style::new(Compression::ZIP16));
    denoise(&source, &output, &Selection::default(), &KEEP);
    compare(&source, &output, |_, _| true, 3, 0.0, "plain");
    let layout = read_layout(&source).unwrap();
    let resolved = resolve(&layout, &Selection::default()).unwrap();
    assert_eq!(resolved.missing.len(), 4);
    assert!(!resolved.surely_noisy);
}

/// Blender 5 names the only part after the pass, and would not see a second pass in it.
#[test]
fn a_named_single_part_gets_a_second_part_for_the_noisy_image() {
    for tiles in [None, Some(16)] {
        let (_folder, source, output) = folder();
        let channels = pass("ViewLayer.Combined", "RGBA", SampleType::F16, SIZE, 1);
        let style = Style { tiles, ..Style::new(Compression::ZIP16) };
        write(&source, vec![Part { name: Some("ViewLayer.Combined".into()), channels, ..Part::default() }], style);
        assert!(!read_layout(&source).unwrap().multipart);
        denoise(&source, &output, &Selection::default(), &KEEP);
        compare(&source, &output, is_beauty, 4, 0.0, "one pass");
        let layout = read_layout(&output).unwrap();
        let names: Vec<_> = layout.part_list.iter().filter_map(|p| p.name.as_deref()).collect();
        assert!(layout.multipart);
        assert_eq!(names, ["ViewLayer.Combined", "ViewLayer.Noisy Image"]);
    }
}

/// As Blender 5 writes with the compositor on and, where `multipart`, each pass in a part of its own.
fn composited(multipart: bool, more: &[(&str, &str)]) -> Vec<Part> {
    let sample = SampleType::F16;
    let mut passes = vec![("Composite.Combined", "RGBA"), ("Hush Vectors.Vector", "XYZW")];
    passes.extend([("ViewLayer.Combined", "RGBA"), ("ViewLayer.Denoising Albedo", "RGB"), ("ViewLayer.Mist", "Z")]);
    passes.extend(more);
    let channels = |(seed, (name, letters)): (usize, &(&str, &str))| pass(name, letters, sample, SIZE, seed as u64);
    match multipart {
        true => {
            let part = |(seed, pass): (usize, &(&str, &str))| Part {
                name: Some(pass.0.to_string()),
                channels: channels((seed, pass)),
                ..Part::default()
            };
            passes.iter().enumerate().map(part).collect()
        }
        false => vec![Part { channels: passes.iter().enumerate().flat_map(channels).collect(), ..Part::default() }],
    }
}

#[test]
fn denoised_files_open_denoised() {
    for (multipart, compression) in [(true, Compression::ZIP16), (false, Compression::ZIP16), (true, Compression::DWAA(None))] {
        for options in [WriteOptions::default(), KEEP] {
            let what = format!("multipart {multipart}, {compression:?}, keep noisy {}", options.keep_noisy);
            let (_folder, source, output) = folder();
            write(&source, composited(multipart, &[]), Style::new(compression));
            denoise(&source, &output, &Selection::default(), &options);
            let ((_, old), (meta, new)) = (read(&source), read(&output));
            let first = meta.headers[0].channels.list.iter().find(|c| c.name.to_string().contains("Combined")).unwrap();
            assert_eq!(first.name.to_string(), "ViewLayer.Combined.A", "{what}");
            for ((view, name), (sample, bits)) in old.iter().filter(|((_, name), _)| !name.starts_with("Composite.")) {
                let (new_sample, new_bits) = &new[&(view.clone(), name.clone())];
                let same = sample == new_sample && bits == new_bits;
                assert_eq!(same, !name.starts_with("ViewLayer.Combined."), "{what}: {name}");
            }
            let kept = if options.keep_noisy { 4 } else { 0 };
            assert_eq!(new.len(), old.len() - 4 + kept, "{what}: {:?}", new.keys());
            let layers: Vec<String> = read_layout(&output).unwrap().layers.into_iter().map(|l| l.name).collect();
            // The one part's channels are sorted by name, which the format demands.
            let expected = if multipart { ["ViewLayer", "Hush Vectors"] } else { ["Hush Vectors", "ViewLayer"] };
            assert_eq!(layers, expected, "{what}");
        }
    }
    // What only the part in front says, left out or put last, is said by the one that comes first then: there others look for it.
    for without_composite in [false, true] {
        let (_folder, source, output) = folder();
        let mut parts = composited(true, &[]);
        parts.drain(..usize::from(without_composite));
        parts[0].attributes =
            [("Frame", "007"), ("colorInteropID", "data")].map(|(name, text)| (name.into(), text.into())).to_vec();
        write(&source, parts, Style::new(Compression::ZIP16));
        denoise(&source, &output, &Selection::default(), &WriteOptions::default());
        let first = read(&output).0.headers.remove(0).own_attributes;
        assert_eq!(first.layer_name.unwrap().to_string(), "ViewLayer.Combined");
        // What describes the pixels of a part stays with them.
        assert_eq!(first.other.keys().map(|name| name.to_string()).collect::<Vec<_>>(), ["Frame"], "{without_composite}");
    }
    // An artist's own layer of that name is no such thing.
    let (_folder, source, output) = folder();
    write(&source, composited(true, &[("Composite.Mist", "Z")]), Style::new(Compression::ZIP16));
    denoise(&source, &output, &Selection { layers: vec!["ViewLayer".into()], ..Selection::default() }, &KEEP);
    assert_eq!(read(&output).1.len(), read(&source).1.len() + 4);
    // Named, it is what is denoised.
    let (_folder, source, output) = folder();
    write(&source, composited(true, &[]), Style::new(Compression::ZIP16));
    denoise(&source, &output, &Selection { layers: vec!["Composite".into()], ..Selection::default() }, &WriteOptions::default());
    compare(&source, &output, |_, name| name.starts_with("Composite."), 0, 0.0, "Composite, named");
}

#[test]
fn noisy_image_wins_and_stays() {
    for multipart in [false, true] {
        let (_folder, source, output) = folder();
        let passes = vec![
            ("Combined", pass("ViewLayer.Combined", "RGBA", SampleType::F32, SIZE, 1)),
            ("Noisy Image", pass("ViewLayer.Noisy Image", "RGBA", SampleType::F32, SIZE, 2)),
        ];
        write(&source, split(passes, vec![], multipart), Style::new(Compression::ZIP16));
        denoise(&source, &output, &Selection::default(), &KEEP);
        let (old, new) = (read(&source).1, read(&output).1);
        assert_eq!(old.len(), new.len());
        for letter in ["R", "G", "B", "A"] {
            let key = |pass: &str| (String::new(), format!("ViewLayer.{pass}.{letter}"));
            assert!(old[&key("Noisy Image")] == new[&key("Noisy Image")]);
            let noisy = old[&key("Noisy Image")].1.iter().map(|&b| f32::from_bits(b) * 0.5);
            assert!(noisy.eq(new[&key("Combined")].1.iter().map(|&b| f32::from_bits(b))), "{letter}");
        }
        let layout = read_layout(&source).unwrap();
        let combined = Selection { denoised_ok: true, ..Selection::default() };
        assert_eq!(resolve(&layout, &combined).unwrap().colour.pass, "Combined");
        assert!(resolve(&layout, &Selection::default()).unwrap().surely_noisy);
    }
}
