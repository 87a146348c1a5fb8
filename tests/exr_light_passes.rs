//! Light passes: read as contributions to the beauty, written so that pass × Color is the denoised contribution again.

mod exr_support;

use exr::prelude::{Compression, SampleType};
use exr_support::*;
use hush::io::{PassNames, Selection, WriteOptions, read_frame, read_layout, resolve, write_denoised};
use hush::{Aov, Denoised, Error};
use ndarray::Array3;

const FULL: [&str; 5] = ["Diffuse Direct", "Diffuse Indirect", "Diffuse Color", "Emission", "Combined_Key"];
const SHORT: [&str; 5] = ["DiffDir", "DiffInd", "DiffCol", "Emit", "Combined_Key"];

/// A render with light passes; Color has every awkward value there is.
fn lit(names: [&str; 5], sample: SampleType, multipart: bool) -> Vec<Part> {
    let mut passes = vec![("Combined", pass("ViewLayer.Combined", "RGBA", sample, SIZE, 1))];
    for (i, name) in names.into_iter().enumerate() {
        passes.push((name, pass(&format!("ViewLayer.{name}"), "RGB", sample, SIZE, 10 + i as u64)));
    }
    for channel in &mut passes[3].1 {
        for (i, b) in channel.bits.iter_mut().enumerate().filter(|(i, _)| i % 3 == 0) {
            let awkward = [0.0, 1e-6, 5e-5, 9.9e-5, 1e-4, f32::NAN, f32::INFINITY, -0.25, 30.0];
            *b = bits(sample, awkward[i / 3 % awkward.len()]);
        }
    }
    split(passes, vec![], multipart)
}

/// Contributions as the kernels may leave them: spread into pixels where Color is black, zero elsewhere.
fn spread(image: &Array3<f32>, scale: f32) -> Array3<f32> {
    let mut out = image.mapv(|v| if v.is_finite() { v * 0.7 } else { 0.0 });
    for (i, v) in out.iter_mut().enumerate() {
        *v = if i % 7 == 0 { 0.0 } else { (*v + 0.2) * scale };
    }
    out
}

#[test]
fn contributions_recombine() {
    // Largest relative error: a few roundings of the type that holds the passes.
    for (sample, bound) in [(SampleType::F32, 2.0e-7), (SampleType::F16, 1.0e-3)] {
        for names in [FULL, SHORT] {
            for (multipart, scale) in [(true, 1.0), (false, 1.0), (true, 40.0)] {
                let (_folder, source, output) = folder();
                write(&source, lit(names, sample, multipart), Style::new(Compression::ZIP16));
                let layout = read_layout(&source).unwrap();
                let wanted = ["Diffuse Direct", "DiffInd", "emission", "Combined_Key"].map(String::from).to_vec();
                let resolved = resolve(&layout, &Selection { aovs: wanted.clone(), ..Selection::default() }).unwrap();
                assert_eq!(resolved.aovs.iter().map(|a| a.name.clone()).collect::<Vec<_>>(), wanted);
                let frame = read_frame(&layout, &resolved).unwrap();
                let all = resolve(&layout, &Selection { aovs: vec!["all".into()], ..Selection::default() }).unwrap();
                assert_eq!(
                    all.aovs.iter().map(|a| a.name.as_str()).collect::<Vec<_>>(),
                    [names[0], names[1], names[3], names[4]]
                );

                let aovs: Vec<Aov> =
                    frame.aovs.iter().map(|a| Aov { name: a.name.clone(), image: spread(&a.image, scale) }).collect();
                let denoised = Denoised { colour: frame.colour.clone(), alpha: frame.alpha.clone(), aovs };
                write_denoised(&layout, &resolved, &denoised, &WriteOptions::default(), &output).unwrap();

                let (old, new) = (read(&source).1, read(&output).1);
                let values = |pixels: &Pixels, name: &str, letter: &str| -> Vec<f32> {
                    let (sample, bits) = &pixels[&(String::new(), format!("ViewLayer.{name}.{letter}"))];
                    bits.iter().map(|&b| float(*sample, b)).collect()
                };
                for (k, letter) in ["R", "G", "B"].into_iter().enumerate() {
                    let colour = values(&new, names[2], letter);
                    for (aov, name) in denoised.aovs.iter().zip([names[0], names[1], names[3], names[4]]) {
                        let pass = values(&new, name, letter);
                        for (i, &wanted) in aov.image.index_axis(ndarray::Axis(2), k).iter().enumerate() {
                            let factor = if name == names[0] || name == names[1] { colour[i] } else { 1.0 };
                            let found = f64::from(pass[i]) * f64::from(factor);
                            let error = (found - f64::from(wanted)).abs();
                            let context = format!("{name} {letter} {i}: {found}, expected {wanted}, Color {factor}");
                            assert!(error <= bound * f64::from(wanted.abs()), "{context}");
                        }
                    }
                    // Color changes only where it could not be divided by.
                    for (i, (&a, &b)) in values(&old, names[2], letter).iter().zip(&colour).enumerate() {
                        let lit = denoised.aovs[..2].iter().any(|aov| aov.image[[i / SIZE.0, i % SIZE.0, k]] != 0.0);
                        let largest = denoised.aovs[..2].iter().map(|a| a.image[[i / SIZE.0, i % SIZE.0, k]]).fold(0.0, f32::max);
                        let overflows = sample == SampleType::F16 && largest / 6.0e4 > a;
                        if a >= 1.01e-4 && a.is_finite() && !overflows || (!lit && a.is_finite()) {
                            assert_eq!(a.to_bits(), b.to_bits(), "Color {letter} {i}");
                        } else {
                            assert!(b >= 0.99e-4 && b.is_finite(), "Color {letter} {i}: {a} became {b}");
                        }
                    }
                }
            }
        }
    }
}

/// DWA would round a Color of 1e-4 away, and the light with it.
#[test]
fn light_on_black_survives_dwa() {
    for compression in [Compression::DWAA(None), Compression::DWAB(None)] {
        let (_folder, source, output) = folder();
        let mut parts = lit(FULL, SampleType::F16, true);
        // Black beside bright: a block of one value would keep it.
        for channel in &mut parts[3].channels {
            channel.bits.iter_mut().enumerate().for_each(|(i, b)| *b = bits(SampleType::F16, if i % 4 == 0 { 0.8 } else { 0.0 }));
        }
        write(&source, parts, Style::new(compression));
        let layout = read_layout(&source).unwrap();
        let resolved = resolve(&layout, &Selection { aovs: vec!["Diffuse Direct".into()], ..Selection::default() }).unwrap();
        let frame = read_frame(&layout, &resolved).unwrap();
        let aovs = vec![Aov { name: frame.aovs[0].name.clone(), image: Array3::from_elem(frame.colour.dim(), 0.5) }];
        let denoised = Denoised { colour: frame.colour.clone(), alpha: frame.alpha.clone(), aovs };
        write_denoised(&layout, &resolved, &denoised, &WriteOptions::default(), &output).unwrap();
        let written = read_layout(&output).unwrap();
        let again =
            resolve(&written, &Selection { aovs: vec!["Diffuse Direct".into()], denoised_ok: true, ..Selection::default() });
        let light = read_frame(&written, &again.unwrap()).unwrap().aovs.remove(0).image;
        let off = light.iter().map(|v| (v - 0.5).abs()).sum::<f32>() / light.len() as f32;
        assert!(off < 0.02, "{compression:?}: {off}");
    }
}

#[test]
fn reading_multiplies_by_colour() {
    let (_folder, source, _) = folder();
    write(&source, lit(SHORT, SampleType::F32, false), Style::new(Compression::ZIP16));
    let layout = read_layout(&source).unwrap();
    let resolved = resolve(&layout, &Selection { aovs: vec!["DiffDir".into(), "Emit".into()], ..Selection::default() }).unwrap();
    let frame = read_frame(&layout, &resolved).unwrap();
    let pixels = read(&source).1;
    let at = |name: &str, i: usize| f32::from_bits(pixels[&(String::new(), format!("ViewLayer.{name}"))].1[i]);
    for i in [1, 2, 100, 1001] {
        let place = [i / SIZE.0, i % SIZE.0, 1];
        assert_eq!(frame.aovs[0].image[place], at("DiffDir.G", i) * at("DiffCol.G", i));
        assert_eq!(frame.aovs[1].image[place], at("Emit.G", i));
    }
}

#[test]
fn what_is_missing_is_named_with_the_way_to_switch_it_on() {
    let (_folder, source, _) = folder();
    let mut parts = lit(FULL, SampleType::F16, true);
    parts.remove(3);
    write(&source, parts, Style::new(Compression::ZIP16));
    let layout = read_layout(&source).unwrap();
    for (name, pass, advice) in [
        ("Glossy Direct", "Glossy Direct", "Passes › Light › Glossy › Direct"),
        ("Diffuse Direct", "Diffuse Color", "Passes › Light › Diffuse › Color"),
        ("Nonsense", "Nonsense", "Emission"),
    ] {
        match resolve(&layout, &Selection { aovs: vec![name.into()], ..Selection::default() }) {
            Err(Error::MissingPass { pass: found, advice: given, .. }) => {
                assert_eq!(found, pass);
                assert!(given.contains(advice), "{given}");
            }
            other => panic!("{other:?}"),
        }
    }
    // Under `all`, what cannot be denoised is left out and said.
    let all = resolve(&layout, &Selection { aovs: vec!["all".into()], ..Selection::default() }).unwrap();
    assert_eq!(all.aovs.len(), 2);
    assert!(all.missing.iter().any(|m| m.pass == "Diffuse Color"));
}

#[test]
fn factors_are_no_light() {
    let (_folder, source, _) = folder();
    for names in [["Ambient Occlusion", "Shadow Catcher"], ["AO", "Shadow Catcher"]] {
        let mut passes = vec![("Combined", pass("ViewLayer.Combined", "RGBA", SampleType::F32, SIZE, 1))];
        passes.extend(names.map(|name| (name, pass(&format!("ViewLayer.{name}"), "RGB", SampleType::F32, SIZE, 2))));
        write(&source, split(passes, vec![], true), Style::new(Compression::ZIP16));
        let layout = read_layout(&source).unwrap();
        let found = |name: &str| resolve(&layout, &Selection { aovs: vec![name.into()], ..Selection::default() });
        for name in names {
            match found(name) {
                Err(Error::BadSetting { name: "aovs", reason }) => assert!(reason.contains("factor"), "{reason}"),
                other => panic!("{other:?}"),
            }
        }
        assert!(found("all").unwrap().aovs.is_empty());
    }
}

#[test]
fn the_beauty_guides_and_data_are_no_light() {
    let (_folder, source, _) = folder();
    let passes = [("Combined", "RGBA"), ("Denoising Albedo", "RGB"), ("Mist", "Z"), ("Position", "XYZ"), ("Rim", "RGBA")];
    let passes = passes.map(|(name, channels)| (name, pass(&format!("ViewLayer.{name}"), channels, SampleType::F32, SIZE, 1)));
    write(&source, split(passes.into(), vec![], true), Style::new(Compression::ZIP16));
    let layout = read_layout(&source).unwrap();
    let found = |name: &str, names: &PassNames| {
        let selection = Selection { aovs: vec![name.into()], passes: names.clone(), ..Selection::default() };
        resolve(&layout, &selection).map(|found| found.aovs.len())
    };
    let refused = [
        ("Combined", "the image itself"),
        ("Denoising Albedo", "a guide"),
        ("Mist", "its channels are Z, not R, G, B"),
        ("Position", "its channels are X, Y, Z, not R, G, B"),
    ];
    for (name, why) in refused {
        match found(name, &PassNames::default()) {
            Err(Error::BadSetting { name: "aovs", reason }) => assert!(reason.contains(name) && reason.contains(why), "{reason}"),
            other => panic!("{name}: {other:?}"),
        }
    }
    assert!(matches!(found("Rim", &PassNames::default()), Ok(1)));
    // Where another pass is the beauty, Combined is a pass as any other.
    let rim = PassNames { beauty: Some("Rim".into()), ..PassNames::default() };
    assert!(matches!(found("Combined", &rim), Ok(1)));
    assert!(matches!(found("Rim", &rim), Err(Error::BadSetting { name: "aovs", .. })));
}
