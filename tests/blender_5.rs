//! Frames as Blender 5.2 and 5.3 write them: their background, their environment, their new passes.
//!
//! `data/blender_5_2.exr` and `blender_5_3.exr` are the scene of tests/blender/cases/guides.py in Blender 5.2.3 and 5.3.0: 32 × 24 pixels of
//! 4 samples.

mod engine_support;

use std::path::Path;
use std::sync::LazyLock;

use engine_support::*;
use hush::io::{Selection, inspect, read_frame, read_layout, resolve};
use hush::{Engine, Frame, Settings};
use ndarray::{Array3, Axis};

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/blender_5_2.exr");
const FILE_5_3: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/blender_5_3.exr");
const SAMPLES: f32 = 4.0;
const ENVIRONMENT: [f32; 3] = [0.4, 1.0, 2.0];

static ENGINE: LazyLock<Engine> = LazyLock::new(|| Engine::new(Settings::default()).unwrap());

fn read(file: &str, selection: &Selection) -> Frame {
    let layout = read_layout(Path::new(file)).unwrap();
    read_frame(&layout, &resolve(&layout, selection).unwrap()).unwrap()
}

fn rendered() -> Frame {
    read(FILE, &Selection::default())
}

fn denoised(frame: &Frame) -> Array3<f32> {
    denoise(&ENGINE, &encode(&ENGINE, [frame.clone(), frame.clone(), frame.clone()]), 1, 1, 1.0).colour
}

#[test]
fn its_new_passes_are_told_and_left_alone() {
    let inspection = inspect(Path::new(FILE)).unwrap();
    let used = |purpose: &str| inspection.uses.iter().find(|u| u.purpose == purpose).map(|u| u.pass.as_str());
    assert_eq!(used("albedo"), Some("ViewLayer.Denoising Albedo"));
    assert_eq!(used("normal"), Some("ViewLayer.Denoising Normal"));
    assert_eq!(used("depth"), Some("ViewLayer.Denoising Depth"));
    assert_eq!(inspection.light_passes, ["Environment"]);
    let expected = "Denoising Specular Albedo and Denoising Roughness are passes of Denoising Data that Hush does not use.";
    assert!(inspection.notes.iter().any(|note| note == expected), "{:?}", inspection.notes);
    let layout = read_layout(Path::new(FILE)).unwrap();
    let lights = resolve(&layout, &Selection { aovs: vec!["all".into()], ..Selection::default() }).unwrap().aovs;
    assert_eq!(lights.iter().map(|l| l.name.as_str()).collect::<Vec<_>>(), ["Environment"]);
}

#[test]
fn its_background_is_as_far_as_that_of_older_versions() {
    let frame = rendered();
    let depth = frame.depth.as_ref().unwrap();
    let far = |z: f32| z == f32::MAX / SAMPLES;
    assert!(depth.row(0).iter().all(|&z| far(z)), "the sky is {:?}", depth.row(0));
    // A pixel is background as a whole where one of its samples was, and all others have the depth of what they show.
    assert!(depth.iter().all(|&z| far(z) || (z > 0.0 && z < 100.0)));
    let (sky, ground) = (depth.iter().filter(|z| far(**z)).count(), depth.iter().filter(|z| !far(**z)).count());
    assert!(sky > 100 && ground > 100, "{sky} pixels of sky, {ground} of ground");
    let mut older = frame.clone();
    older.depth.as_mut().unwrap().mapv_inplace(|z| if far(z) { 0.0 } else { z });
    assert_eq!(denoised(&frame), denoised(&older));
    // It is looked at all the same.
    older.depth.as_mut().unwrap().mapv_inplace(|z| if z > 4.0 { 0.1 * z } else { z });
    assert_ne!(denoised(&frame), denoised(&older));
}

#[test]
fn the_environment_is_in_its_albedo_and_the_sky_stays() {
    let frame = rendered();
    let result = denoised(&frame);
    for (image, tolerance) in [(frame.albedo.as_ref().unwrap(), 1e-5), (&result, 0.02)] {
        for ((_, c), &value) in image.index_axis(Axis(0), 0).indexed_iter() {
            assert!((value - ENVIRONMENT[c]).abs() < tolerance * ENVIRONMENT[c], "{value} in channel {c}");
        }
    }
}

#[test]
fn the_background_of_5_3_is_that_of_5_2() {
    let depth = |file: &str, selection: &Selection| read(file, selection).depth.unwrap();
    let before = depth(FILE, &Selection::default()).mapv(|z| if z > 1e9 { 0.0 } else { z });
    let now = depth(FILE_5_3, &Selection::default());
    // What 5.2 takes for the background is it in 5.3 too, and next to it a few pixels more. All else is farther by the near clipping plane.
    let mut more = 0;
    for (before, now) in before.iter().zip(&now) {
        match (*before == 0.0, *now == 0.0) {
            (true, is_background) => assert!(is_background, "{now}"),
            (false, true) => more += 1,
            (false, false) => assert!((now - before - 0.1).abs() < 0.02, "{before} and {now}"),
        }
    }
    assert!(more < 10, "{more}");
    // As it is written: the far clipping plane of 1000, and the mean with it on edges. So the normals are needed.
    let mut alone = Selection::default();
    alone.guides.normal = false;
    let written = depth(FILE_5_3, &alone);
    assert!(written.row(0).iter().all(|z| *z > 1000.0) && written.iter().any(|z| (100.0..900.0).contains(z)));
}
