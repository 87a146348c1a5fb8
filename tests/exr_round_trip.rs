//! Every kind of file that Blender writes: read, denoised (here: halved), written, and compared bit for bit.

mod exr_support;

use exr::prelude::{Compression, LineOrder, SampleType};
use exr_support::halved::*;
use exr_support::*;
use hush::Denoised;
use hush::io::{Selection, WriteOptions, read_frame, read_layout, resolve, write_denoised};

const KEEP: WriteOptions = WriteOptions { keep_noisy: true, attributes: Vec::new() };

#[test]
fn lossless_files_change_in_nothing_but_the_beauty() {
    for compression in LOSSLESS {
        for sample in [SampleType::F16, SampleType::F32] {
            for multipart in [false, true] {
                let what = format!("{compression:?} {sample:?} multipart {multipart}");
                let (_folder, source, output) = folder();
                write(&source, render(sample, multipart, SIZE), Style::new(compression));
                denoise(&source, &output, &Selection::default(), &KEEP);
                compare(&source, &output, is_beauty, 4, 0.0, &what);
                let (old, new) = (read(&source).1, read(&output).1);
                for letter in ["R", "G", "B", "A"] {
                    let key = |pass: &str| (String::new(), format!("ViewLayer.{pass}.{letter}"));
                    assert!(old[&key("Combined")] == new[&key("Noisy Image")], "{what}: kept {letter}");
                }
            }
        }
    }
}

#[test]
fn lossy_files_keep_every_other_part_bit_for_bit() {
    for compression in LOSSY {
        for sample in [SampleType::F16, SampleType::F32] {
            let what = format!("{compression:?} {sample:?}");
            let (_folder, source, output) = folder();
            write(&source, render(sample, true, SIZE), Style::new(compression));
            denoise(&source, &output, &Selection::default(), &KEEP);
            compare(&source, &output, is_beauty, 4, 0.02, &what);
            let (old, new) = (read(&source).1, read(&output).1);
            let key = |pass: &str| (String::new(), format!("ViewLayer.{pass}.G"));
            assert!(old[&key("Combined")] == new[&key("Noisy Image")], "{what}: kept input");
        }
    }
}

#[test]
fn lossy_single_part_files_keep_cryptomatte_under_dwa_and_say_what_they_do() {
    for compression in LOSSY {
        let (_folder, source, output) = folder();
        write(&source, render(SampleType::F16, false, SIZE), Style::new(compression));
        denoise(&source, &output, &Selection::default(), &KEEP);
        let layout = read_layout(&source).unwrap();
        assert_eq!(hush::io::caveats(&layout, &resolve(&layout, &Selection::default()).unwrap()).len(), 1);
        let (old, new) = (read(&source).1, read(&output).1);
        for (key, (sample, bits)) in &old {
            let (_, found) = &new[key];
            if key.1.contains("Crypto") || key.1.contains("IndexOB") {
                assert!(bits == found, "{compression:?}: {} changed", key.1);
            } else if !is_beauty("", &key.1) {
                let worst =
                    bits.iter().zip(found).map(|(&a, &b)| (float(*sample, a) - float(*sample, b)).abs()).fold(0.0, f32::max);
                assert!(worst < 0.02, "{compression:?} {}: {worst}", key.1);
            }
        }
    }
}

#[test]
fn data_windows_with_an_offset_tiles_and_decreasing_lines_are_kept() {
    let mut offset = Style::new(Compression::ZIP16);
    offset.origin = (-13, 600);
    let mut decreasing = offset;
    decreasing.line_order = LineOrder::Decreasing;
    let mut tiled = offset;
    tiled.tiles = Some(16);
    for (style, what) in [(offset, "offset"), (decreasing, "decreasing"), (tiled, "tiles")] {
        for multipart in [false, true] {
            let (_folder, source, output) = folder();
            write(&source, render(SampleType::F16, multipart, SIZE), style);
            denoise(&source, &output, &Selection::default(), &KEEP);
            compare(&source, &output, is_beauty, 4, 0.0, what);
            assert_eq!(read_layout(&output).unwrap().part_list[0].origin, [-13, 600], "{what}");
        }
    }
}

#[test]
fn sizes_down_to_one_pixel_work() {
    for size in [(1, 1), (1, 40), (40, 1), (3, 33)] {
        for compression in LOSSLESS.into_iter().chain(LOSSY) {
            let (_folder, source, output) = folder();
            let mut style = Style::new(compression);
            style.size = size;
            write(&source, render(SampleType::F16, true, size), style);
            denoise(&source, &output, &Selection::default(), &KEEP);
            compare(&source, &output, is_beauty, 4, 0.02, &format!("{size:?} {compression:?}"));
        }
    }
}

#[test]
fn the_frame_holds_the_values_of_the_file() {
    let (_folder, source, _) = folder();
    write(&source, render(SampleType::F16, true, SIZE), Style::new(Compression::ZIP16));
    let layout = read_layout(&source).unwrap();
    assert_eq!((layout.columns, layout.rows, layout.parts), (SIZE.0, SIZE.1, 7));
    assert_eq!((layout.frame, layout.spp, layout.software.as_deref()), (Some(7), Some(4), Some("Blender 5.0.1")));
    let frame = read_frame(&layout, &resolve(&layout, &Selection::default()).unwrap()).unwrap();
    frame.check().unwrap();
    let pixels = read(&source).1;
    let value = |name: &str, row: usize, column: usize| {
        let (sample, bits) = &pixels[&(String::new(), format!("ViewLayer.{name}"))];
        float(*sample, bits[row * SIZE.0 + column])
    };
    for (row, column) in [(0, 0), (69, 36), (15, 16), (33, 5)] {
        for (k, (rgb, xyzw)) in [("R", "X"), ("G", "Y"), ("B", "Z"), ("A", "W")].into_iter().enumerate() {
            assert_eq!(frame.vector.as_ref().unwrap()[[row, column, k]], value(&format!("Vector.{xyzw}"), row, column));
            if k == 3 {
                assert_eq!(frame.alpha.as_ref().unwrap()[[row, column]], value("Combined.A", row, column));
                continue;
            }
            assert_eq!(frame.colour[[row, column, k]], value(&format!("Combined.{rgb}"), row, column));
            assert_eq!(frame.albedo.as_ref().unwrap()[[row, column, k]], value(&format!("Denoising Albedo.{rgb}"), row, column));
            assert_eq!(frame.normal.as_ref().unwrap()[[row, column, k]], value(&format!("Denoising Normal.{xyzw}"), row, column));
        }
        assert_eq!(frame.depth.as_ref().unwrap()[[row, column]], value("Denoising Depth.Z", row, column));
    }
}

#[test]
fn alpha_of_one_everywhere_is_none_and_stays() {
    let (_folder, source, output) = folder();
    let mut parts = render(SampleType::F16, true, SIZE);
    parts[0].channels[3].bits.fill(bits(SampleType::F16, 1.0));
    assert!(parts[0].channels[3].name.ends_with(".A"));
    write(&source, parts, Style::new(Compression::ZIP16));
    let layout = read_layout(&source).unwrap();
    assert!(read_frame(&layout, &resolve(&layout, &Selection::default()).unwrap()).unwrap().alpha.is_none());
    denoise(&source, &output, &Selection::default(), &WriteOptions::default());
    compare(&source, &output, |_, n| is_beauty("", n) && !n.ends_with(".A"), 0, 0.0, "opaque");
}

#[test]
fn half_floats_are_clamped_and_attributes_added() {
    let (_folder, source, output) = folder();
    write(&source, render(SampleType::F16, true, SIZE), Style::new(Compression::ZIP16));
    let layout = read_layout(&source).unwrap();
    let resolved = resolve(&layout, &Selection::default()).unwrap();
    let mut denoised = halve(&read_frame(&layout, &resolved).unwrap());
    denoised.colour.fill(1e9);
    denoised.colour[[0, 0, 0]] = -1e9;
    let options = WriteOptions { attributes: vec![("hush.lambda".into(), "4".into())], ..WriteOptions::default() };
    write_denoised(&layout, &resolved, &denoised, &options, &output).unwrap();
    let (meta, pixels) = read(&output);
    let red = &pixels[&(String::new(), "ViewLayer.Combined.R".to_string())].1;
    assert_eq!(float(SampleType::F16, red[0]), -65504.0);
    assert!(red[1..].iter().all(|&b| float(SampleType::F16, b) == 65504.0));
    let added = |h: &exr::meta::header::Header| h.own_attributes.other.keys().any(|k| k.eq("hush.lambda"));
    assert!(meta.headers.iter().all(added));
    for name in ["", "compression", "name"] {
        let options = WriteOptions { attributes: vec![(name.into(), "x".into())], ..WriteOptions::default() };
        assert!(write_denoised(&layout, &resolved, &denoised, &options, &output).is_err(), "{name:?}");
    }
}

#[test]
fn the_source_is_never_overwritten_and_errors_leave_nothing() {
    let (folder, source, output) = folder();
    write(&source, render(SampleType::F16, true, SIZE), Style::new(Compression::ZIP16));
    let before = std::fs::read(&source).unwrap();
    let layout = read_layout(&source).unwrap();
    let resolved = resolve(&layout, &Selection::default()).unwrap();
    let denoised = halve(&read_frame(&layout, &resolved).unwrap());
    let options = WriteOptions::default();
    let roundabout = folder.path().join(".").join("in.exr");
    for destination in [&source, &roundabout] {
        let refused = write_denoised(&layout, &resolved, &denoised, &options, destination);
        assert!(refused.unwrap_err().to_string().contains("never overwritten"));
    }
    let small = Denoised { colour: ndarray::Array3::zeros((2, 2, 3)), ..denoised.clone() };
    assert!(write_denoised(&layout, &resolved, &small, &options, &output).is_err());
    let missing = folder.path().join("no folder").join("out.exr");
    assert!(write_denoised(&layout, &resolved, &denoised, &options, &missing).is_err());
    assert_eq!(std::fs::read(&source).unwrap(), before);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}
