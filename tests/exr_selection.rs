//! Which passes are chosen, and what is said about those that are missing.

mod exr_support;

use exr::prelude::{Compression, SampleType};
use exr_support::*;
use hush::Error;
use hush::io::{Guides, Layout, Selection, inspect, read_layout, resolve, resolve_views};

fn layout_of(passes: &[(&str, &str)], attributes: &[(&str, &str)], compression: Compression) -> (tempfile::TempDir, Layout) {
    let (folder, source, _) = folder();
    let channels = passes.iter().flat_map(|(prefix, letters)| pass(prefix, letters, SampleType::F16, SIZE, 1)).collect();
    let attributes = attributes.iter().map(|(a, b)| (a.to_string(), b.to_string())).collect();
    write(&source, vec![Part { channels, attributes, ..Part::default() }], Style::new(compression));
    let layout = read_layout(&source).unwrap();
    (folder, layout)
}

const FULL: [(&str, &str); 5] = [
    ("ViewLayer.Combined", "RGBA"),
    ("ViewLayer.Denoising Albedo", "RGB"),
    ("ViewLayer.Denoising Normal", "XYZ"),
    ("ViewLayer.Denoising Depth", "Z"),
    ("ViewLayer.Vector", "XYZW"),
];

#[test]
fn the_layer_with_the_most_samples_wins() {
    let mut passes = vec![("A vectors.Combined", "RGBA"), ("A vectors.Vector", "XYZW")];
    passes.extend(FULL);
    passes.push(("Composite.Combined", "RGBA"));
    let samples = [("cycles.A vectors.samples", "1"), ("cycles.ViewLayer.samples", "64")];
    let (_folder, layout) = layout_of(&passes, &samples, Compression::ZIP16);
    let resolved = resolve(&layout, &Selection::default()).unwrap();
    assert_eq!(resolved.layer, "ViewLayer");
    assert!(resolved.notes[0].contains("A vectors stays as it is"), "{:?}", resolved.notes);
    let borrowed = Selection { vector_layer: Some("A vectors".into()), ..Selection::default() };
    assert_eq!(resolve(&layout, &borrowed).unwrap().vector.unwrap().layer, "A vectors");
    let unknown = Selection { layers: vec!["Nope".into()], ..Selection::default() };
    assert!(resolve(&layout, &unknown).unwrap_err().to_string().contains("A vectors, Composite, ViewLayer"));
    let view = Selection { view: Some("left".into()), ..Selection::default() };
    assert!(resolve(&layout, &view).unwrap_err().to_string().contains("has no stereo view left: the file holds one view only"));
}

#[test]
fn several_layers_are_denoised_in_one_go() {
    let passes = [
        ("A.Combined", "RGBA"),
        ("Vectors.Combined", "RGBA"),
        ("Vectors.Vector", "XYZW"),
        ("B.Combined", "RGBA"),
        ("Data.Mist", "Z"),
    ];
    let (_folder, layout) = layout_of(&passes, &[], Compression::ZIP16);
    let found = |layers: &[&str], vectors: Option<&str>| {
        let layers = layers.iter().map(|l| l.to_string()).collect();
        let selection = Selection { layers, vector_layer: vectors.map(Into::into), ..Selection::default() };
        let views = resolve_views(&layout, &selection)?;
        Ok::<_, Error>(views.iter().map(|v| (v.layer.clone(), v.vector.is_some())).collect::<Vec<_>>())
    };
    let on = |layers: &[(&str, bool)]| layers.iter().map(|(l, v)| (l.to_string(), *v)).collect::<Vec<_>>();
    assert_eq!(found(&["all"], Some("Vectors")).unwrap(), on(&[("A", true), ("B", true)]));
    assert_eq!(found(&["B", "A", "B"], None).unwrap(), on(&[("B", false), ("A", false)]));
    assert_eq!(found(&["all"], None).unwrap().len(), 3);
    assert_eq!(
        found(&["A", "C"], None).unwrap_err().to_string().split(" has ").last(),
        Some("no view layer C: its view layers are A, B, Data, Vectors")
    );
}

#[test]
fn a_layer_made_for_vectors_gives_them_and_is_not_denoised() {
    let passes = [
        ("Hush Vectors.Combined", "RGBA"),
        ("Hush Vectors.Vector", "XYZW"),
        ("Hush Vectors.001.Combined", "RGBA"),
        ("Hush Vectorscope.Combined", "RGBA"),
        ("ViewLayer.Combined", "RGBA"),
        ("ViewLayer.Vector", "XYZW"),
    ];
    // More samples than the others would win, were it a layer like them.
    let samples = [("cycles.Hush Vectors.samples", "64"), ("cycles.ViewLayer.samples", "4")];
    let (_folder, layout) = layout_of(&passes, &samples, Compression::ZIP16);
    let found = |layers: &[&str], vectors: Option<&str>| {
        let layers = layers.iter().map(|l| l.to_string()).collect();
        let selection = Selection { layers, vector_layer: vectors.map(Into::into), ..Selection::default() };
        let views = resolve_views(&layout, &selection).unwrap();
        views.into_iter().map(|v| (v.layer, v.vector.unwrap().layer)).collect::<Vec<_>>()
    };
    let pairs = |pairs: &[(&str, &str)]| pairs.iter().map(|(a, b)| (a.to_string(), b.to_string())).collect::<Vec<_>>();
    assert_eq!(found(&[], None), pairs(&[("ViewLayer", "Hush Vectors")]));
    let all = pairs(&[("Hush Vectorscope", "Hush Vectors"), ("ViewLayer", "Hush Vectors")]);
    assert_eq!(found(&["all"], None), all);
    assert_eq!(found(&["ViewLayer"], Some("ViewLayer")), pairs(&[("ViewLayer", "ViewLayer")]), "what is named goes first");
    assert_eq!(found(&["Hush Vectors"], None), pairs(&[("Hush Vectors", "Hush Vectors")]));
    let off = Selection { guides: Guides { vector: false, ..Guides::default() }, ..Selection::default() };
    assert_eq!(resolve(&layout, &off).unwrap().vector, None);
    let text = inspect(&layout.path).unwrap().describe();
    assert!(text.contains("vector                   Hush Vectors.Vector"), "{text}");
    assert!(text.contains("The motion vectors come from the view layer Hush Vectors, which Prepare Shot made"), "{text}");
    assert!(text.contains("ViewLayer is denoised, Hush Vectorscope stays as it is."), "{text}");
}

#[test]
fn a_file_with_nothing_but_the_layer_made_for_vectors_says_so() {
    let passes = [("Hush Vectors.001.Combined", "RGBA"), ("Hush Vectors.001.Vector", "XYZW")];
    let (_folder, layout) = layout_of(&passes, &[], Compression::ZIP16);
    let refused = resolve(&layout, &Selection::default()).unwrap_err().to_string();
    assert!(refused.contains("Hush Vectors.001 is there for motion vectors only"), "{refused}");
    // One without vectors is no help, and the layer's own stay.
    let passes = [("Hush Vectors.Combined", "RGBA"), ("V.Combined", "RGBA"), ("V.Vector", "XYZW")];
    let (_folder, layout) = layout_of(&passes, &[], Compression::ZIP16);
    assert_eq!(resolve(&layout, &Selection::default()).unwrap().vector.unwrap().layer, "V");
    let (_folder, layout) = layout_of(&passes[..2], &[], Compression::ZIP16);
    let resolved = resolve(&layout, &Selection::default()).unwrap();
    assert_eq!(resolved.missing.iter().filter(|m| m.pass == "Vector").count(), 1);
}

#[test]
fn what_came_out_of_the_compositor_is_no_view_layer() {
    let passes = [("Composite.Combined", "RGBA"), ("ViewLayer.Combined", "RGBA"), ("Z.Combined", "RGBA")];
    let (_folder, layout) = layout_of(&passes, &[], Compression::ZIP16);
    assert_eq!(resolve(&layout, &Selection::default()).unwrap().layer, "ViewLayer");
    let layers = |name: &str| {
        let selection = Selection { layers: vec![name.into()], ..Selection::default() };
        resolve_views(&layout, &selection).unwrap().into_iter().map(|v| v.layer).collect::<Vec<_>>()
    };
    assert_eq!((layers("all"), layers("Composite")), (vec!["ViewLayer".into(), "Z".into()], vec!["Composite".to_string()]));
    assert!(inspect(&layout.path).unwrap().describe().contains("the denoised file is written without it"));
    // Alone it is all there is; with samples or other passes it is an artist's layer of that name.
    let (_folder, alone) = layout_of(&passes[..1], &[], Compression::ZIP16);
    assert_eq!(resolve(&alone, &Selection::default()).unwrap().layer, "Composite");
    let (_folder, own) = layout_of(&passes, &[("cycles.Composite.samples", "9")], Compression::ZIP16);
    assert_eq!(resolve(&own, &Selection::default()).unwrap().layer, "Composite");
}

#[test]
fn any_mix_of_guides_is_fine_and_the_rest_is_named() {
    for mask in 0..16 {
        let guides = Guides { albedo: mask & 1 != 0, normal: mask & 2 != 0, depth: mask & 4 != 0, vector: mask & 8 != 0 };
        let there = [guides.albedo, guides.normal, guides.depth, guides.vector];
        let mut passes = vec![FULL[0]];
        passes.extend(FULL[1..].iter().zip(there).filter(|(_, there)| *there).map(|(p, _)| *p));
        let (_folder, layout) = layout_of(&passes, &[], Compression::ZIP16);
        let resolved = resolve(&layout, &Selection::default()).unwrap();
        let found = [&resolved.albedo, &resolved.normal, &resolved.depth, &resolved.vector].map(|g| g.is_some());
        assert_eq!(found, there);
        assert_eq!(resolved.missing.len(), there.iter().filter(|t| !**t).count());
        assert!(resolved.missing.iter().all(|m| m.advice.contains("View Layer › Passes › Data ›")));
        // Guides that are switched off are neither used nor missed.
        let (_folder, full) = layout_of(&FULL, &[], Compression::ZIP16);
        let resolved = resolve(&full, &Selection { guides, ..Selection::default() }).unwrap();
        let found = [&resolved.albedo, &resolved.normal, &resolved.depth, &resolved.vector].map(|g| g.is_some());
        assert_eq!((found, resolved.missing.len()), (there, 0));
    }
}

#[test]
fn vectors_without_w_and_lossy_guides_are_pointed_out() {
    let (_folder, layout) = layout_of(&[FULL[0], ("ViewLayer.Vector", "XYZ")], &[], Compression::ZIP16);
    let resolved = resolve(&layout, &Selection::default()).unwrap();
    assert!(resolved.vector.is_none());
    assert!(resolved.missing.iter().any(|m| m.advice.contains("four dimensions")));
    let (_folder, layout) = layout_of(&FULL, &[], Compression::DWAA(None));
    assert!(resolve(&layout, &Selection::default()).unwrap().notes.iter().any(|n| n.contains("lossy")));
}

#[test]
fn files_without_a_beauty_are_refused_with_advice() {
    for (passes, advice) in [
        (vec![FULL[1], FULL[4]], "Passes › Data › Combined"),
        (vec![("", "Y")], "black and white"),
        (vec![("ViewLayer.Combined", "Y")], "black and white"),
        (vec![("ViewLayer.Combined", "rgba")], "has the channels a, b, g, r: save them as R, G and B"),
        (vec![("ViewLayer.CryptoObject00", "rgba")], "Passes › Data › Combined"),
    ] {
        let (_folder, layout) = layout_of(&passes, &[], Compression::ZIP16);
        match resolve(&layout, &Selection::default()) {
            Err(Error::MissingPass { advice: found, .. }) => assert!(found.contains(advice), "{found}"),
            other => panic!("{other:?}"),
        }
        let inspection = inspect(&layout.path).unwrap();
        assert!(inspection.problem.as_ref().is_some_and(|p| p.contains(advice)));
        assert!(inspection.describe().contains("cannot denoise"));
    }
}

#[test]
fn inspecting_tells_what_is_used_and_what_is_missing() {
    let passes =
        [FULL[0], FULL[1], ("ViewLayer.DiffDir", "RGB"), ("ViewLayer.DiffCol", "RGB"), ("ViewLayer.Combined_Key", "RGB")];
    let (_folder, layout) = layout_of(&passes, &[("Frame", "012")], Compression::DWAB(None));
    let inspection = inspect(&layout.path).unwrap();
    let text = inspection.describe();
    for expected in [
        "37×70 pixels, DWAB compression, one part, frame 12",
        "ViewLayer.Combined\n",
        "Denoising Normal         enable View Layer › Passes › Data › Denoising Data",
        "Vector                   enable View Layer › Passes › Data › Vector",
        "(aovs): Combined_Key, DiffDir",
        "Note: DWAB compression is lossy",
    ] {
        assert!(text.contains(expected), "{expected:?} is not in\n{text}");
    }
    let json = serde_json::to_value(&inspection).unwrap();
    assert_eq!(json["uses"][0]["pass"], "ViewLayer.Combined");
    assert_eq!(json["columns"], 37);
}
