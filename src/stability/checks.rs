//! What must hold for every case, whatever is in its frames.

use ndarray::Array3;

use super::cases::{Case, HOLE, Hazard, values};
use super::reference::Reference;
use super::row::{CheckRow, Worst};
use super::suite::Suite;
use crate::frame::exposure::exposure;
use crate::simd::Isa;
use crate::{EncodedFrame, Engine, Frame};

/// The dial's ends.
const LAMBDAS: [f32; 2] = [1.0, 64.0];
/// Rounding of float32 over the taps of four levels, relative to the taps.
const ROUNDING: f64 = 1e-5;
/// What the portable path promises.
const PORTABLE: f64 = 1e-4;
/// Radiance below this may round to zero.
const DARK: f64 = 1e-30;
/// Radiance beyond this is not promised to scale.
const BRIGHT: f32 = 1e30;
/// Pixels from which on a case goes through the checks once, on the fastest instruction set.
const LARGE: usize = 50_000;
/// Stops by which the exposure changes: twenty in all.
const STOPS: [i32; 4] = [-10, -3, 4, 10];

/// Whether a frame's light may be made darker by all stops and still counts: the light that sets its exposure, not its brightest.
fn may_be_darker(frame: &Frame) -> bool {
    f64::from(exposure(frame.colour.view())) < 2f64.powi(STOPS[0]) / DARK
}

/// Whether the frame has light to set its exposure by; that of a black one is 1, however bright its neighbours are.
fn is_lit(frame: &Frame) -> bool {
    frame.colour.iter().any(|v| v.is_finite() && *v > 0.0)
}

fn place(lambda: f32, (y, x, c): (usize, usize, usize)) -> String {
    format!("λ {lambda}, row {y}, column {x}, channel {c}")
}

/// All checks of a case.
pub(super) fn rows(suite: &Suite, case: &Case) -> Vec<CheckRow> {
    let frames = case.build();
    let names =
        ["image", "range", "float64", "left out", "threads and tiles", "AVX2 and AVX-512", "portable", "exposure", "filled"];
    let bounds = [0.0, ROUNDING, ROUNDING, 0.5, 0.0, 0.0, PORTABLE, ROUNDING, 0.0];
    let mut worst = names.map(|_| Worst::new());
    let thorough = case.rows * case.columns <= LARGE;
    for lambda in LAMBDAS.into_iter().take(if thorough { 2 } else { 1 }) {
        let found = CaseRun { suite, case, frames: &frames, lambda };
        let [image, range, float64, left_out, same, avx, portable, exposure, filled] = &mut worst;
        let (product, exact) = (found.on(&suite.product, &frames), found.on(&suite.exact, &frames));
        let reference = found.reference();
        image_of(&product, lambda, image);
        found.within(&product, &reference, range);
        found.within(&exact, &reference, range);
        found.apart(&exact, |i| reference.cells[i].value, &reference, float64);
        half_steps(&product, &exact, lambda, left_out);
        differing(&exact, &suite.one_thread.install(|| found.on(&suite.exact, &frames)), lambda, same);
        differing(&exact, &found.on(&suite.tiled, &frames), lambda, same);
        found.black_holes(&product, filled);
        for (isa, engine) in suite.others.iter().filter(|_| thorough) {
            let other = found.on(engine, &frames);
            if *isa == Isa::Portable {
                found.apart(&other, |i| f64::from(exact[i]), &reference, portable);
            } else {
                differing(&exact, &other, lambda, avx);
            }
        }
        found.exposed(if thorough { &STOPS } else { &STOPS[..1] }, &reference, exposure);
    }
    let is_promised = |name: &str| match name {
        "AVX2 and AVX-512" => thorough && suite.others.iter().any(|(isa, _)| *isa != Isa::Portable),
        "portable" => thorough && suite.others.iter().any(|(isa, _)| *isa == Isa::Portable),
        "exposure" => frames.iter().all(may_be_darker) && (is_lit(&frames[case.centre]) || !frames.iter().any(is_lit)),
        "filled" => case.has_a_hole(),
        _ => true,
    };
    let rows = names.into_iter().zip(bounds).zip(worst).filter(|((name, _), _)| is_promised(name));
    rows.map(|((name, bound), worst)| worst.row(&case.name, name, bound)).collect()
}

impl Case {
    /// Whether there is a hole, usable pixels on both its sides, and nothing else that is odd.
    fn has_a_hole(&self) -> bool {
        self.rows.max(self.columns) > 2 * HOLE + 2 && (self.hazards == [Hazard::Hole] || self.hazards == [Hazard::HoleEverywhere])
    }
}

/// A case at a λ.
struct CaseRun<'a> {
    suite: &'a Suite,
    case: &'a Case,
    frames: &'a [Frame],
    lambda: f32,
}

impl CaseRun<'_> {
    /// The result of an engine; an engine that refuses such frames gives NaN, which fails every check.
    fn on(&self, engine: &Engine, frames: &[Frame]) -> Array3<f32> {
        self.case.denoise(engine, frames, self.lambda).map_or_else(|_| Array3::from_elem(self.shape(), f32::NAN), |d| values(&d))
    }

    fn shape(&self) -> (usize, usize, usize) {
        let frame = &self.frames[self.case.centre];
        (frame.size().0, frame.size().1, 3 + usize::from(frame.alpha.is_some()) + 3 * frame.aovs.len())
    }

    fn reference(&self) -> Reference {
        let engine = &self.suite.exact;
        let encoded: Vec<EncodedFrame> = self.frames.iter().filter_map(|f| engine.encode(f.clone()).ok()).collect();
        let probe = engine.probe(&encoded[self.case.centre], &self.case.around(&encoded), self.lambda);
        Reference::new(self.frames, self.case.centre, &probe, &self.suite.architecture)
    }

    /// How far values lie outside the range of their taps, relative to it.
    fn within(&self, found: &Array3<f32>, reference: &Reference, worst: &mut Worst) {
        for (i, v) in found.indexed_iter() {
            let (v, cell) = (f64::from(*v), reference.cells[i]);
            let scale =
                |bound: f64| if cell.low < 0.0 { cell.low.abs().max(cell.high.abs()) } else { bound }.max(DARK * ROUNDING);
            worst.take(((v - cell.high) / scale(cell.high)).max((cell.low - v) / scale(cell.low)), || place(self.lambda, i));
        }
    }

    /// How far values lie from others, relative to the average of their taps' magnitudes.
    fn apart(&self, found: &Array3<f32>, other: impl Fn((usize, usize, usize)) -> f64, reference: &Reference, worst: &mut Worst) {
        for (i, v) in found.indexed_iter() {
            worst.take((f64::from(*v) - other(i)).abs() / reference.cells[i].size.max(DARK), || place(self.lambda, i));
        }
    }

    /// Frames ×2ᵏ against results ×2ᵏ.
    fn exposed(&self, by: &[i32], reference: &Reference, worst: &mut Worst) {
        let scaled = |stops: i32| -> Vec<Frame> {
            let scale = |v: f32| if v.is_finite() { v.clamp(-BRIGHT, BRIGHT) * 2f32.powi(stops) } else { v };
            let one = |frame: &Frame| {
                let mut frame = frame.clone();
                frame.colour.mapv_inplace(scale);
                frame.aovs.iter_mut().for_each(|a| a.image.mapv_inplace(scale));
                frame
            };
            self.frames.iter().map(one).collect()
        };
        let base = self.on(&self.suite.exact, &scaled(0));
        let alpha = self.frames[self.case.centre].alpha.is_some();
        for &stops in by {
            let found = self.on(&self.suite.exact, &scaled(stops));
            for (i, v) in found.indexed_iter() {
                let factor = if alpha && i.2 == 3 { 1.0 } else { 2f64.powi(stops) };
                let (a, b) = (f64::from(base[i]), f64::from(*v) / factor);
                let size = reference.cells[i].size.min(f64::from(BRIGHT)).max(a.abs()).max(DARK);
                worst.take((a - b).abs() / size, || format!("{stops} stops, {}", place(self.lambda, i)));
            }
        }
    }

    /// Pixels of a hole that stayed black.
    fn black_holes(&self, found: &Array3<f32>, worst: &mut Worst) {
        let frame = &self.frames[self.case.centre];
        for ((y, x, c), v) in found.indexed_iter().filter(|((_, _, c), _)| *c < 3) {
            if !frame.colour[[y, x, c]].is_finite() && *v == 0.0 {
                worst.count(|| place(self.lambda, (y, x, c)));
            }
        }
    }
}

/// Counts what no image may hold: NaN, Inf, negative light, alpha outside 0…1.
fn image_of(found: &Array3<f32>, lambda: f32, worst: &mut Worst) {
    let has_alpha = (found.dim().2 - 3) % 3 == 1;
    for (i, v) in found.indexed_iter() {
        let bad = match i.2 {
            0..3 => *v < 0.0,
            3 if has_alpha => !(0.0..=1.0).contains(v),
            _ => false,
        };
        if bad || !v.is_finite() {
            worst.count(|| place(lambda, i));
        }
    }
}

/// Counts values whose bits differ.
fn differing(a: &Array3<f32>, b: &Array3<f32>, lambda: f32, worst: &mut Worst) {
    for (i, v) in a.indexed_iter() {
        if v.to_bits() != b[i].to_bits() || v.is_nan() {
            worst.count(|| place(lambda, i));
        }
    }
}

/// The distance in steps of float16 at the greater value.
fn half_steps(a: &Array3<f32>, b: &Array3<f32>, lambda: f32, worst: &mut Worst) {
    for (i, v) in a.indexed_iter() {
        let (v, w) = (f64::from(*v), f64::from(b[i]));
        if v != w {
            let step = (v.abs().max(w.abs()).log2().floor() - 10.0).exp2();
            worst.take((v - w).abs() / step, || place(lambda, i));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::weights::Weights;

    #[test]
    fn a_result_that_is_off_by_little_fails() {
        let suite = Suite::new(&Weights::embedded().unwrap()).unwrap();
        let case = Case { rows: 17, columns: 21, ..Case::random(1) };
        let case = Case { hazards: Vec::new(), ..case };
        let frames = case.build();
        let run = CaseRun { suite: &suite, case: &case, frames: &frames, lambda: 1.0 };
        let (reference, good) = (run.reference(), run.on(&suite.exact, &frames));
        let passes = |found: &Array3<f32>| {
            let mut worst = [Worst::new(), Worst::new(), Worst::new(), Worst::new(), Worst::new()];
            let [image, range, float64, steps, bits] = &mut worst;
            image_of(found, 1.0, image);
            run.within(found, &reference, range);
            run.apart(found, |i| reference.cells[i].value, &reference, float64);
            half_steps(found, &good, 1.0, steps);
            differing(found, &good, 1.0, bits);
            let bounds = [0.0, ROUNDING, ROUNDING, 0.5, 0.0];
            worst.into_iter().zip(bounds).map(|(worst, bound)| worst.row("", "", bound).passed).collect::<Vec<_>>()
        };
        assert_eq!(passes(&good), [true; 5]);
        let changed = |of: fn(f32) -> f32| {
            let mut found = good.clone();
            found[[3, 4, 0]] = of(found[[3, 4, 0]]);
            passes(&found)
        };
        assert_eq!(changed(f32::next_up), [true, true, true, true, false]);
        assert_eq!(changed(|v| v * 1.0001), [true, true, false, true, false]);
        assert_eq!(changed(|v| v * 50.0 + 100.0), [true, false, false, false, false]);
        assert_eq!(changed(|_| f32::NAN), [false; 5]);
        assert_eq!(changed(|v| -v), [false; 5]);
    }
}
