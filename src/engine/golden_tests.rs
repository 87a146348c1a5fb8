//! Agreement with the PyTorch model, stage by stage (`training/network/golden.py` writes the files).

use std::collections::HashMap;

use ndarray::{Array, Array3, ArrayD, ArrayView, Dimension, Ix2, Ix3, Ix4, s};
use safetensors::SafeTensors;

use super::*;
use crate::frame::{Frame, LambdaMap};
use crate::kernels::planes::Planes;
use crate::network::features::Stored;

const MODEL: &[u8] = include_bytes!("../../tests/data/golden_model.safetensors");
const CASES: &[u8] = include_bytes!("../../tests/data/golden_cases.safetensors");

/// The largest difference allowed, relative to the stage's largest value.
const TOLERANCE: f32 = 1e-4;

struct Case(HashMap<String, ArrayD<f32>>);

impl Case {
    fn read(name: &str) -> Self {
        let file = SafeTensors::deserialize(CASES).unwrap();
        let mut out = HashMap::new();
        for (key, view) in file.iter() {
            if let Some(key) = key.strip_prefix(&format!("{name}.")) {
                let values = view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
                out.insert(key.to_string(), ArrayD::from_shape_vec(view.shape(), values).unwrap());
            }
        }
        assert!(!out.is_empty(), "no case {name}");
        Self(out)
    }

    fn get<D: Dimension>(&self, key: &str) -> Array<f32, D> {
        self.0[key].clone().into_dimensionality::<D>().unwrap()
    }

    /// The frame at an index, planes to (rows, columns, channels).
    fn frame(&self, index: usize) -> Frame {
        let image = |key: &str| self.get::<Ix4>(key).slice_move(s![index, .., .., ..]).permuted_axes([1, 2, 0]);
        let mut frame = Frame::new(image("colour"));
        frame.albedo = Some(image("albedo"));
        frame.normal = Some(image("normal"));
        frame.depth = Some(image("depth").slice_move(s![.., .., 0]));
        frame.vector = Some(image("vector"));
        frame
    }
}

/// The small network; as an `older` one with the same weights but for what it has not.
fn engine(isa: Isa, older: bool) -> Engine {
    let mut weights = Weights::from_bytes("golden", MODEL).unwrap();
    if older {
        weights.make_older();
    }
    Engine::from_weights(&weights, Settings { isa: Some(isa), second_pass: true, ..Settings::default() }).unwrap()
}

/// Compares (rows, columns, channels) with PyTorch's (channels, rows, columns).
fn compare(what: &str, found: ArrayView<f32, Ix3>, expected: Array<f32, Ix3>) {
    let expected = expected.permuted_axes([1, 2, 0]);
    let (rows, columns, _) = expected.dim();
    let found = found.slice(s![..rows, ..columns, ..]);
    let scale = expected.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    let worst = found
        .indexed_iter()
        .map(|(i, v)| ((v - expected[i]).abs(), i))
        .fold((0.0, (0, 0, 0)), |a, b| if b.0 > a.0 || b.0.is_nan() { b } else { a });
    assert_eq!(found.dim(), expected.dim(), "{what}");
    assert!(worst.0 <= TOLERANCE * scale, "{what}: off by {} of {scale} at {:?}", worst.0, worst.1);
}

fn image_of(planes: &Planes) -> Array3<f32> {
    Array3::from_shape_fn((planes.rows(), planes.columns(), 3), |(y, x, c)| planes.row(c, y)[x])
}

fn image_of_features(features: &Features) -> Array3<f32> {
    let Stored::Full(values) = features.stored() else { panic!("small frames keep full floats") };
    Array3::from_shape_vec(features.shape(), values.to_vec()).unwrap()
}

#[test]
fn the_second_pass_agrees_with_pytorch_on_every_isa() {
    for isa in Isa::available() {
        let engine = engine(isa, false);
        for name in ["second", "second_map"] {
            let case = Case::read(name);
            let window = case.0["window"][0] as i32;
            let what = |stage: &str| format!("{name} {stage} on {isa:?}");
            let frames: Vec<EncodedFrame> = (0..=2 * window as usize).map(|i| engine.encode(case.frame(i)).unwrap()).collect();
            let map =
                case.0.contains_key("lambda_map").then(|| LambdaMap::new(case.get::<Ix2>("lambda_map").view(), 1.0).unwrap());
            let dial = Dial::new(case.0["lambda"][0], map.as_ref());
            let first = |centre: i32| {
                let near = (0..=2 * window).filter(|n| *n != centre && (n - centre).abs() <= window);
                let near: Vec<(i32, &EncodedFrame)> = near.map(|n| (n - centre, &frames[n as usize])).collect();
                engine.first_pass(&frames[centre as usize], &near, dial, SILENT).unwrap().0
            };
            let firsts: Vec<FirstPass> = (0..=2 * window).map(first).collect();
            let centre = &firsts[window as usize];
            compare(&what("first pass"), centre.image.view(), case.get("first_image"));
            let near = firsts.iter().enumerate().map(|(n, f)| (n as i32 - window, f));
            let near: Vec<(i32, &FirstPass)> = near.filter(|n| n.0 != 0).collect();
            compare(&what("image"), engine.second_pass(centre, &near).colour.view(), case.get("image"));
        }
    }
}

#[test]
fn every_stage_agrees_with_pytorch_on_every_isa() {
    for isa in Isa::available() {
        let [plain, deep] = [true, false].map(|older| engine(isa, older));
        for name in ["window2", "odd", "window0", "uneven", "window3", "older", "lambda_map"] {
            let engine = if name == "older" { &plain } else { &deep };
            let case = Case::read(name);
            let what = |stage: &str| format!("{name} {stage} on {isa:?}");
            let centre = case.0["centre"][0] as usize;
            let frames: Vec<EncodedFrame> = (0..=2 * centre).map(|i| engine.encode(case.frame(i)).unwrap()).collect();
            let offsets: Vec<i32> = case.0["offsets"].iter().map(|o| *o as i32).filter(|o| *o != 0).collect();
            let at = |offset: i32| &frames[centre.checked_add_signed(offset as isize).unwrap()];
            let neighbours: Vec<(i32, &EncodedFrame)> = offsets.iter().map(|o| (*o, at(*o))).collect();
            let map =
                case.0.contains_key("lambda_map").then(|| LambdaMap::new(case.get::<Ix2>("lambda_map").view(), 1.0).unwrap());
            let dial = Dial::new(case.0["lambda"][0], map.as_ref());
            compare(&what("features"), image_of_features(&frames[centre].features).view(), case.get("features"));
            let stages = engine.stages(&frames[centre], &neighbours, dial);
            for (features, name) in stages.features.iter().zip(["half_features", "quarter_features", "eighth_features"]).rev() {
                compare(&what(name), features.view(), case.get(name));
            }
            for (planes, name) in stages.coarse.iter().zip(["eighth", "quarter", "half"]) {
                compare(&what(name), image_of(planes).view(), case.get(name));
            }
            assert_eq!(stages.coarse.len(), 3);
            let denoised = engine.denoise(&frames[centre], &neighbours, dial).unwrap();
            compare(&what("image"), denoised.colour.view(), case.get("image"));
        }
    }
}
