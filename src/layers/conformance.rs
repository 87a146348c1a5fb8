//! What every back end must do with the layers: each test runs on every instruction set that the CPU has.
//!
//! [`Conv`] and [`Dense`] must have the bits of a plain loop over scalars in the order that they promise, [`Winograd`] must stay
//! near sums in f64; and no bit may depend on how the work is split.

use ndarray::{Array1, Array2, Array3, Array4};

use super::{Activation, Conv, Dense, Epilogue, SEGMENT, Source, Winograd};
use crate::simd::conformance::{is_fused, scalar_fma};
use crate::simd::{Isa, Simd, dispatch};

const SIZES: [(usize, usize); 8] = [(1, 1), (1, 9), (9, 1), (2, 2), (5, 7), (3, 26), (11, 25), (10, 128)];
const CHANNELS: [(usize, usize); 12] =
    [(1, 16), (10, 32), (40, 32), (32, 32), (48, 48), (48, 80), (71, 80), (80, 96), (144, 48), (128, 16), (96, 128), (32, 25)];

/// Runs a case on every back end; those with a fused multiply-add must give the same bits.
fn every_back_end(what: &str, mut case: impl FnMut(Isa) -> Vec<u32>) {
    let mut fused: Option<Vec<u32>> = None;
    for isa in Isa::available() {
        let found = case(isa);
        if is_fused(isa) {
            let wanted = fused.get_or_insert_with(|| found.clone());
            assert!(found == *wanted, "{what}: {isa:?} has other bits than the one before");
        }
    }
}

/// Repeatable noise in −1…1.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }

    fn activation(&mut self, rows: usize, columns: usize, channels: usize) -> Activation {
        let mut a = Activation::new(rows, columns, channels);
        a.as_mut_slice().fill_with(|| self.next());
        a
    }

    /// Noise with what frames and layers had better not have here and there: NaN, infinities, denormals, −0.
    fn wild(&mut self, rows: usize, columns: usize, channels: usize) -> Activation {
        let mut a = self.activation(rows, columns, channels);
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e-40, -1e-40, -0.0, f32::MAX, f32::MIN_POSITIVE];
        let step = (a.as_slice().len() / odd.len()).max(1);
        a.as_mut_slice().iter_mut().skip(step / 2).step_by(step).zip(odd).for_each(|(to, odd)| *to = odd);
        a
    }
}

/// A convolution and its weights.
struct Case {
    weight: Array4<f32>,
    bias: Array1<f32>,
    conv: Conv,
    stride: usize,
}

impl Case {
    fn new(noise: &mut Noise, inputs: usize, outputs: usize, kernel: usize, stride: usize) -> Self {
        let weight = Array4::from_shape_simple_fn((outputs, inputs, kernel, kernel), || noise.next());
        let bias = Array1::from_shape_simple_fn(outputs, || noise.next());
        let conv = Conv::new(weight.view(), Some(bias.view()), stride);
        Self { weight, bias, conv, stride }
    }

    /// The terms of an output before the residual, in the order in which they are summed: input after ReLU, weight. Zero where the
    /// kernel leaves the image.
    fn terms(&self, input: &Activation, relu: bool, (r, c, co): (usize, usize, usize)) -> impl Iterator<Item = (f32, f32)> {
        let (_, inputs, kernel, _) = self.weight.dim();
        let taps = (0..kernel).flat_map(move |ky| (0..kernel).map(move |kx| (ky, kx)));
        taps.flat_map(move |(ky, kx)| {
            let at = ((r * self.stride + ky).checked_sub(kernel / 2), (c * self.stride + kx).checked_sub(kernel / 2));
            let inside = at.0.zip(at.1).filter(|(y, x)| *y < input.rows() && *x < input.columns());
            (0..inputs).map(move |ci| {
                let v = inside.map_or(0.0, |(y, x)| input.row(y)[x * inputs + ci]);
                (if relu { rectified(v) } else { v }, self.weight[[co, ci, ky, kx]])
            })
        })
    }

    /// The output as a plain loop over scalars computes it.
    fn scalar(&self, isa: Isa, input: &Activation, epilogue: Epilogue) -> Activation {
        let (rows, columns) = self.conv.output_size(input.rows(), input.columns());
        let mut out = Activation::new(rows, columns, self.bias.len());
        for r in 0..rows {
            for (i, to) in out.row_mut(r).iter_mut().enumerate() {
                let (c, co) = (i / self.bias.len(), i % self.bias.len());
                let terms = self.terms(input, epilogue.relu_input, (r, c, co));
                let sum = terms.fold(self.bias[co], |sum, (v, w)| scalar_fma(isa, v, w, sum));
                let sum = epilogue.add.map_or(sum, |add| sum + add.row(r)[i]);
                *to = if epilogue.relu_output { rectified(sum) } else { sum };
            }
        }
        out
    }

    /// The value of every output and the sum of the magnitudes of its terms, in f64.
    fn exact(&self, input: &Activation, epilogue: Epilogue) -> (Array3<f64>, Array3<f64>) {
        let (rows, columns) = self.conv.output_size(input.rows(), input.columns());
        let mut value = Array3::zeros((rows, columns, self.bias.len()));
        let mut scale = value.clone();
        for ((r, c, co), value) in value.indexed_iter_mut() {
            let terms = self.terms(input, epilogue.relu_input, (r, c, co)).map(|(v, w)| f64::from(v) * f64::from(w));
            let more = [Some(self.bias[co]), epilogue.add.map(|add| add.view()[[r, c, co]])];
            let (sum, magnitude) = terms
                .chain(more.into_iter().flatten().map(f64::from))
                .fold((0.0f64, 0.0f64), |(sum, magnitude), term| (sum + term, magnitude + term.abs()));
            *value = if epilogue.relu_output { sum.max(0.0) } else { sum };
            scale[[r, c, co]] = magnitude;
        }
        (value, scale)
    }
}

fn rectified(v: f32) -> f32 {
    if v > 0.0 { v } else { 0.0 }
}

/// Errors up to `bound` of the sum of the terms' magnitudes.
fn assert_within(bound: f64, found: &Activation, (value, scale): &(Array3<f64>, Array3<f64>), what: &str) {
    assert_eq!(found.view().dim(), value.dim(), "{what}");
    for ((at, wanted), found) in value.indexed_iter().zip(found.as_slice()) {
        let error = (f64::from(*found) - wanted).abs();
        assert!(error <= bound * scale[at] + 1e-7, "{what} at {at:?}: {found}, not {wanted}");
    }
}

/// All bits, those of any NaN alike.
fn bits(a: &Activation) -> Vec<u32> {
    bits_of(a.as_slice())
}

fn bits_of(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| if v.is_nan() { f32::NAN.to_bits() } else { v.to_bits() }).collect()
}

/// Every layer kind on every size, with flags that change from case to case, on odd numbers too.
#[test]
fn convolution_has_the_bits_of_a_plain_loop() {
    let mut noise = Noise(1);
    let mut output = Activation::empty();
    let mut flags = 0;
    for (inputs, outputs) in CHANNELS {
        for (kernel, stride) in [(1, 1), (3, 1), (3, 2)] {
            let case = Case::new(&mut noise, inputs, outputs, kernel, stride);
            for (rows, columns) in SIZES.into_iter().filter(|(rows, columns)| rows * columns < 300 || inputs * outputs < 1600) {
                flags += 1;
                let wild = flags % 4 == 3;
                let input = if wild { noise.wild(rows, columns, inputs) } else { noise.activation(rows, columns, inputs) };
                let size = case.conv.output_size(rows, columns);
                let residual = noise.activation(size.0, size.1, outputs);
                let epilogue = Epilogue {
                    relu_input: flags & 1 != 0,
                    relu_output: flags & 2 != 0,
                    add: (flags % 3 != 0).then_some(&residual),
                };
                let what = format!("{inputs}→{outputs} {kernel}×{kernel}/{stride} on {rows}×{columns}, {flags}");
                every_back_end(&what, |isa| {
                    case.conv.run(isa, &input, &mut output, epilogue);
                    assert!(bits(&output) == bits(&case.scalar(isa, &input, epilogue)), "{isa:?} {what}");
                    bits(&output)
                });
                if !wild {
                    assert_within(1e-6, &output, &case.exact(&input, epilogue), &what);
                }
            }
        }
    }
}

#[inline(always)]
fn run_dense<S: Simd>(s: S, layer: &Dense, x: &[f32], start: Option<&[f32]>, relu: bool, out: &mut [f32]) {
    layer.run(s, x, start, relu, out);
}

dispatch! {
    fn dense_on(layer: &Dense, x: &[f32], start: Option<&[f32]>, relu: bool, out: &mut [f32]) = run_dense
}

#[test]
fn dense_has_the_bits_of_a_plain_loop() {
    let mut noise = Noise(8);
    for (i, (outputs, inputs)) in [(1, 1), (12, 48), (43, 39), (172, 48), (49, 32), (13, 7)].into_iter().enumerate() {
        let weight = Array2::from_shape_simple_fn((outputs, inputs), || noise.next());
        let bias = Array1::from_shape_simple_fn(outputs, || noise.next());
        let layer = Dense::new(weight.view(), Some(bias.view()));
        for wild in [false, true] {
            let x = if wild { noise.wild(1, SEGMENT, inputs) } else { noise.activation(1, SEGMENT, inputs) };
            let x = x.as_slice();
            let start: Vec<f32> = (0..layer.output_len()).map(|_| noise.next()).collect();
            let (start, relu) = ((i % 2 == 1).then_some(&start[..]), i % 3 == 0);
            every_back_end(&format!("{inputs}→{outputs}"), |isa| {
                let mut out = vec![f32::NAN; layer.output_len()];
                dense_on(isa, &layer, x, start, relu, &mut out);
                let wanted: Vec<f32> = (0..outputs * SEGMENT)
                    .map(|at| {
                        let (o, p) = (at / SEGMENT, at % SEGMENT);
                        let first = start.map_or(bias[o], |start| start[at]);
                        let sum = (0..inputs).fold(first, |sum, i| scalar_fma(isa, weight[[o, i]], x[i * SEGMENT + p], sum));
                        if relu { rectified(sum) } else { sum }
                    })
                    .collect();
                assert!(bits_of(&out[..wanted.len()]) == bits_of(&wanted), "{isa:?} {inputs}→{outputs}, odd numbers: {wild}");
                bits_of(&out)
            });
        }
    }
}

#[test]
fn no_bias_is_zero() {
    let weight = Array4::from_elem((16, 1, 1, 1), 2.0);
    let conv = Conv::new(weight.view(), None, 1);
    let mut input = Activation::new(1, 1, 1);
    input.as_mut_slice()[0] = 3.0;
    every_back_end("2 · 3", |isa| {
        let mut output = Activation::empty();
        conv.run(isa, &input, &mut output, Epilogue::default());
        assert!(output.as_slice().iter().all(|v| *v == 6.0), "{isa:?}");
        bits(&output)
    });
}

/// Threads, splits into rows and the memory's past change no bit.
#[test]
fn no_bit_depends_on_the_split() {
    let mut noise = Noise(2);
    for (inputs, outputs, kernel, stride) in [(40, 32, 3, 1), (48, 80, 3, 2), (71, 25, 1, 1), (10, 96, 3, 1)] {
        let case = Case::new(&mut noise, inputs, outputs, kernel, stride);
        let input = noise.activation(37, 131, inputs);
        let (rows, columns) = case.conv.output_size(37, 131);
        let residual = noise.activation(rows, columns, outputs);
        let epilogue = Epilogue { relu_input: true, relu_output: true, add: Some(&residual) };
        every_back_end(&format!("{inputs}→{outputs}"), |isa| {
            let mut whole = Activation::empty();
            case.conv.run(isa, &input, &mut whole, epilogue);
            for threads in [1, 2, 5] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
                let mut output = Activation::new(50, 50, 50);
                output.as_mut_slice().fill(f32::NAN);
                pool.install(|| case.conv.run(isa, &input, &mut output, epilogue));
                assert_eq!(bits(&output), bits(&whole), "{isa:?} {inputs}→{outputs} on {threads} threads");
            }
            for range in [0..0, 0..1, 0..rows, 3..4, 5..rows - 2, rows - 1..rows] {
                let mut output = noise.activation(3, 200, outputs);
                case.conv.run_rows(isa, &input, &mut output, epilogue, range.clone());
                assert_eq!(output.shape(), (range.len(), columns, outputs));
                let width = columns * outputs;
                assert_eq!(bits(&output), bits(&whole)[range.start * width..range.end * width], "{isa:?} rows {range:?}");
            }
            bits(&whole)
        });
    }
}

/// A crop equals the whole image where its border is out of reach, wherever its pixels fall in the register tiles.
#[test]
fn a_crop_equals_the_whole() {
    let mut noise = Noise(3);
    let case = Case::new(&mut noise, 32, 48, 3, 1);
    let input = noise.activation(20, 150, 32);
    for isa in Isa::available() {
        let mut whole = Activation::empty();
        case.conv.run(isa, &input, &mut whole, Epilogue::default());
        for (top, left, rows, columns) in [(3, 5, 9, 31), (0, 77, 20, 13), (7, 100, 3, 50)] {
            let (crop, mut output) = (crop_of(&input, top, left, rows, columns), Activation::empty());
            case.conv.run(isa, &crop, &mut output, Epilogue::default());
            let wanted = crop_of(&whole, top + 1, left + 1, rows - 2, columns - 2);
            assert_eq!(bits(&crop_of(&output, 1, 1, rows - 2, columns - 2)), bits(&wanted), "{isa:?} from {top},{left}");
        }
    }
}

/// Joined inputs, one of them at half the resolution, give the bits of the joined image.
#[test]
fn joining_equals_the_joined_image() {
    let mut noise = Noise(4);
    for (coarse_channels, fine_channels, outputs, kernel) in [(96, 80, 80, 1), (32, 48, 48, 1), (7, 3, 20, 3)] {
        let inputs = coarse_channels + fine_channels;
        let case = Case::new(&mut noise, inputs, outputs, kernel, 1);
        let coarse = noise.activation(6, 65, coarse_channels);
        let fine = noise.activation(12, 130, fine_channels);
        let mut joined = Activation::new(12, 130, inputs);
        for r in 0..12 {
            for (c, pixel) in joined.row_mut(r).chunks_exact_mut(inputs).enumerate() {
                pixel[..coarse_channels].copy_from_slice(&coarse.row(r / 2)[c / 2 * coarse_channels..][..coarse_channels]);
                pixel[coarse_channels..].copy_from_slice(&fine.row(r)[c * fine_channels..][..fine_channels]);
            }
        }
        for isa in Isa::available() {
            for relu_input in [false, true] {
                let epilogue = Epilogue { relu_input, ..Epilogue::default() };
                let (mut wanted, mut found) = (Activation::empty(), Activation::empty());
                case.conv.run(isa, &joined, &mut wanted, epilogue);
                let sources = [Source::upsampled(&coarse), Source::new(&fine)];
                case.conv.run_concat(isa, &sources, &mut found, epilogue);
                assert_eq!(bits(&found), bits(&wanted), "{isa:?} {inputs}→{outputs} relu {relu_input}");
            }
        }
    }
}

#[test]
fn adding_onto_the_output_equals_adding() {
    let mut noise = Noise(5);
    let case = Case::new(&mut noise, 32, 40, 3, 1);
    let input = noise.activation(9, 30, 32);
    let residual = noise.activation(9, 30, 40);
    for isa in Isa::available() {
        let mut wanted = Activation::empty();
        case.conv.run(isa, &input, &mut wanted, Epilogue { add: Some(&residual), ..Epilogue::default() });
        let mut found = residual.clone();
        case.conv.run_onto(isa, &input, &mut found, Epilogue::default());
        assert_eq!(bits(&found), bits(&wanted), "{isa:?}");
    }
}

#[test]
fn relu_takes_nan_and_minus_zero_to_zero() {
    let mut weight = Array4::zeros((16, 17, 1, 1));
    weight[[0, 16, 0, 0]] = 1.0;
    weight[[1, 0, 0, 0]] = 1.0;
    let conv = Conv::new(weight.view(), None, 1);
    for (value, wanted) in [(f32::NAN, 0.0f32), (-0.0, 0.0), (-1.0, 0.0), (2.0, 2.0), (f32::INFINITY, f32::NAN)] {
        let mut input = Activation::new(1, 1, 17);
        input.as_mut_slice().fill(value);
        for isa in Isa::available() {
            let mut output = Activation::empty();
            conv.run(isa, &input, &mut output, Epilogue { relu_input: true, ..Epilogue::default() });
            let found = &output.as_slice()[..2];
            assert!(
                found.iter().all(|v| v.to_bits() == wanted.to_bits() || v.is_nan() && wanted.is_nan()),
                "{isa:?} {value}: {found:?}"
            );
        }
    }
}

#[test]
fn an_empty_image_stays_empty() {
    let conv = Conv::new(Array4::zeros((16, 4, 3, 3)).view(), None, 1);
    let mut output = Activation::new(3, 3, 3);
    conv.run(Isa::detect(), &Activation::new(0, 7, 4), &mut output, Epilogue::default());
    assert_eq!(output.shape(), (0, 7, 16));
}

/// Winograd's convolution on every size, with every flag; no bit depends on threads.
#[test]
fn winograd_agrees_with_sums_in_f64() {
    let mut noise = Noise(6);
    for (i, (inputs, outputs)) in [(16, 16), (32, 32), (48, 48), (80, 80), (32, 64), (96, 16)].into_iter().enumerate() {
        let case = Case::new(&mut noise, inputs, outputs, 3, 1);
        let winograd = Winograd::new(case.weight.view(), case.bias.view());
        for (rows, columns) in SIZES.into_iter().filter(|(rows, columns)| rows * columns < 300 || inputs < 48) {
            let (input, residual) = (noise.activation(rows, columns, inputs), noise.activation(rows, columns, outputs));
            let add = (i % 2 == 0).then_some(&residual);
            let epilogue = Epilogue { relu_input: i % 3 != 0, relu_output: i % 3 == 2, add };
            let exact = case.exact(&input, epilogue);
            let mut output = Activation::empty();
            every_back_end(&format!("{inputs}→{outputs} on {rows}×{columns}"), |isa| {
                let what = format!("{isa:?} {inputs}→{outputs} on {rows}×{columns}");
                winograd.run(isa, &input, &mut output, epilogue);
                assert_within(4e-6, &output, &exact, &what);
                let whole = bits(&output);
                for threads in [1, 3] {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
                    pool.install(|| winograd.run(isa, &input, &mut output, epilogue));
                    assert_eq!(bits(&output), whole, "{what} on {threads} threads");
                }
                let mut onto = residual.clone();
                winograd.run_onto(isa, &input, &mut onto, Epilogue { add: None, ..epilogue });
                if add.is_some() {
                    assert_eq!(bits(&onto), whole, "{what}, onto");
                }
                whole
            });
        }
    }
}

/// A crop from an even corner equals the whole image where its border is out of reach.
#[test]
fn a_crop_of_winograds_equals_the_whole() {
    let mut noise = Noise(7);
    let case = Case::new(&mut noise, 32, 48, 3, 1);
    let winograd = Winograd::new(case.weight.view(), case.bias.view());
    let input = noise.activation(20, 150, 32);
    for isa in Isa::available() {
        let mut whole = Activation::empty();
        winograd.run(isa, &input, &mut whole, Epilogue::default());
        for (top, left, rows, columns) in [(2, 6, 9, 31), (0, 76, 20, 13), (8, 100, 3, 50)] {
            let (crop, mut output) = (crop_of(&input, top, left, rows, columns), Activation::empty());
            winograd.run(isa, &crop, &mut output, Epilogue::default());
            let wanted = crop_of(&whole, top + 1, left + 1, rows - 2, columns - 2);
            assert_eq!(bits(&crop_of(&output, 1, 1, rows - 2, columns - 2)), bits(&wanted), "{isa:?} from {top},{left}");
        }
    }
}

fn crop_of(image: &Activation, top: usize, left: usize, rows: usize, columns: usize) -> Activation {
    let channels = image.channels();
    let mut crop = Activation::new(rows, columns, channels);
    for r in 0..rows {
        crop.row_mut(r).copy_from_slice(&image.row(top + r)[left * channels..(left + columns) * channels]);
    }
    crop
}
