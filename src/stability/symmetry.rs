//! What shifting, mirroring, and swapping channels do to a result.

use ndarray::{Array3, Axis, Slice, s};

use super::cases::{Case, values};
use super::row::{CheckRow, Worst};
use super::scene::MOTION;
use super::suite::Suite;
use crate::frame::pixels::ALIGNMENT;
use crate::{Frame, Result};

/// A shift changes no more than rounding.
const SHIFT: f64 = 1e-5;
/// The network is not symmetric. A mirrored or recoloured image may differ by this share of the noise that is taken out.
const MIRROR: f64 = 0.1;

/// All rows about symmetry.
pub(super) fn rows(suite: &Suite) -> Result<Vec<CheckRow>> {
    let mut out = vec![shifts(suite, &[(0, 8), (8, 0), (8, 16), (24, 24)])?.row("noisy scene", "shift by 8", SHIFT)];
    for (name, turn) in TURNS {
        out.push(turned(suite, name, turn)?);
    }
    Ok(out)
}

fn clip(rows: usize, columns: usize) -> Case {
    Case { name: "noisy scene".into(), rows, columns, frames: 3, centre: 1, window: 1, seed: 5, hazards: Vec::new() }
}

/// A large scene seen through windows some pixels (down, across) apart; compared where no border is within reach.
fn shifts(suite: &Suite, steps: &[(usize, usize)]) -> Result<Worst> {
    let reach = suite.exact.reach() + (MOTION.0.abs().max(MOTION.1.abs()).ceil() as usize) + ALIGNMENT;
    let (far, inner) = (3 * ALIGNMENT, 24);
    let side = (2 * reach + inner + far).next_multiple_of(ALIGNMENT);
    let case = clip(side + far, side + far);
    let mut whole = case.build();
    whole.iter_mut().for_each(even_out);
    let seen = |down: usize, across: usize| -> Result<Array3<f32>> {
        let part = |frame: &Frame| {
            let area = s![down..down + side, across..across + side, ..];
            let flat = s![down..down + side, across..across + side];
            let mut out = Frame::new(frame.colour.slice(area).to_owned());
            out.albedo = frame.albedo.as_ref().map(|a| a.slice(area).to_owned());
            out.normal = frame.normal.as_ref().map(|a| a.slice(area).to_owned());
            out.vector = frame.vector.as_ref().map(|a| a.slice(area).to_owned());
            out.depth = frame.depth.as_ref().map(|a| a.slice(flat).mapv(|_| 5.0));
            out
        };
        let frames: Vec<Frame> = whole.iter().map(part).collect();
        Ok(case.denoise(&suite.exact, &frames, 1.0)?.colour)
    };
    let base = seen(0, 0)?;
    let mut worst = Worst::new();
    for &(down, across) in steps {
        let found = seen(down, across)?;
        for y in reach + far..side - reach {
            for x in reach + far..side - reach {
                for c in 0..3 {
                    let (a, b) = (f64::from(base[[y, x, c]]), f64::from(found[[y - down, x - across, c]]));
                    worst.take((a - b).abs() / a.max(b).max(1e-30), || format!("by {across}, {down}: row {y}, column {x}"));
                }
            }
        }
    }
    Ok(worst)
}

/// Gives every 8×8 pixels the same mean luminance, so that the exposure does not depend on where the window lies.
fn even_out(frame: &mut Frame) {
    let size = ALIGNMENT as isize;
    for mut block in frame.colour.axis_chunks_iter_mut(Axis(0), ALIGNMENT) {
        let columns = block.dim().1 as isize;
        for x in (0..columns).step_by(ALIGNMENT) {
            let mut pixels = block.slice_axis_mut(Axis(1), Slice::from(x..(x + size).min(columns)));
            let weights = [0.2126, 0.7152, 0.0722];
            let mean = pixels.indexed_iter().map(|((_, _, c), v)| f64::from(*v) * weights[c]).sum::<f64>();
            let scale = 0.3 / (mean / (pixels.len() / 3) as f64);
            pixels.mapv_inplace(|v| (f64::from(v) * scale) as f32);
        }
    }
}

/// Mirrors, or swaps channels, of every pass; doing it twice (thrice for channels) gives the frame back.
type Turn = fn(&mut Frame);

const TURNS: [(&str, Turn); 3] =
    [("mirrored left to right", mirror_x), ("mirrored top to bottom", mirror_y), ("red and blue swapped", swap)];

fn mirror(frame: &mut Frame, axis: usize) {
    let turn = |image: &mut Array3<f32>| {
        image.invert_axis(Axis(axis));
        *image = image.as_standard_layout().to_owned();
    };
    turn(&mut frame.colour);
    [&mut frame.albedo, &mut frame.normal, &mut frame.vector].into_iter().flatten().for_each(turn);
    frame.aovs.iter_mut().for_each(|a| turn(&mut a.image));
    for flat in [&mut frame.depth, &mut frame.alpha].into_iter().flatten() {
        flat.invert_axis(Axis(axis));
        *flat = flat.as_standard_layout().to_owned();
    }
    // Across is component 0 and 2 of a vector, down 1 and 3; of a normal 0 and 1.
    let component = 1 - axis;
    let negate = |image: &mut Array3<f32>, c: usize| image.slice_mut(s![.., .., c]).mapv_inplace(|v| -v);
    frame.normal.iter_mut().for_each(|n| negate(n, component));
    for v in frame.vector.iter_mut() {
        negate(v, component);
        negate(v, component + 2);
    }
}

fn mirror_x(frame: &mut Frame) {
    mirror(frame, 1);
}

fn mirror_y(frame: &mut Frame) {
    mirror(frame, 0);
}

fn swap(frame: &mut Frame) {
    let turn = |image: &mut Array3<f32>| {
        image.invert_axis(Axis(2));
        *image = image.as_standard_layout().to_owned();
    };
    turn(&mut frame.colour);
    frame.albedo.iter_mut().for_each(turn);
    frame.aovs.iter_mut().for_each(|a| turn(&mut a.image));
}

/// How far the result of turned frames, turned back, lies from the result, as a share of what was taken out of the noisy frame.
fn turned(suite: &Suite, name: &str, turn: Turn) -> Result<CheckRow> {
    let case = clip(96, 128);
    let frames = case.build();
    let mut other = frames.clone();
    other.iter_mut().for_each(turn);
    let mut back = Frame::new(case.denoise(&suite.exact, &other, 1.0)?.colour);
    turn(&mut back);
    let result = values(&case.denoise(&suite.exact, &frames, 1.0)?);
    let noisy = &frames[case.centre].colour;
    let (mut apart, mut removed) = (0.0, 0.0);
    for (i, v) in back.colour.indexed_iter() {
        apart += f64::from((v - result[i]).powi(2));
        removed += f64::from((noisy[i] - result[i]).powi(2));
    }
    let mut worst = Worst::new();
    worst.take((apart / removed.max(1e-30)).sqrt(), || "root mean square over the frame".into());
    Ok(worst.row("noisy scene", name, MIRROR))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::weights::Weights;

    #[test]
    fn shifts_by_less_than_the_pyramid_do_change_the_result() {
        let suite = Suite::new(&Weights::embedded().unwrap()).unwrap();
        assert!(!shifts(&suite, &[(0, 4)]).unwrap().row("", "", SHIFT).passed);
    }
}
