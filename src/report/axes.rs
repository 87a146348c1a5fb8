//! Panels with axes: scales, ticks, and labels that keep off each other.

use crate::picture::drawing::{Anchor, Ink, Shape};
use crate::picture::raster::text_width;

/// The size of labels and ticks.
pub const SMALL: f64 = 12.0;

/// What an axis stands for from one end to the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    pub low: f64,
    pub high: f64,
    /// Whether equal ratios are equally far apart.
    logarithmic: bool,
}

impl Scale {
    /// From one number to another, equal differences equally far apart.
    pub fn between(low: f64, high: f64) -> Self {
        Self { low, high, logarithmic: false }
    }

    /// Holds all values with some room around them; logarithmic where they are above 0 and some are more than twice as large as others.
    pub fn of(values: impl Iterator<Item = f64>) -> Self {
        Self::around(values, 2.0)
    }

    /// As [`of`](Self::of), logarithmic however near the values are to each other.
    pub fn of_ratios(values: impl Iterator<Item = f64>) -> Self {
        Self::around(values, 1.0)
    }

    /// Logarithmic from this ratio of the greatest to the least value on.
    fn around(values: impl Iterator<Item = f64>, ratio: f64) -> Self {
        let (low, high) =
            values.filter(|v| v.is_finite()).fold((f64::INFINITY, f64::NEG_INFINITY), |a, v| (a.0.min(v), a.1.max(v)));
        if low > high {
            return Self::between(0.0, 1.0);
        }
        // Beyond that ratio the least is 0 but for rounding.
        if low > 0.0 && (ratio..1e12).contains(&(high / low)) {
            let room = (high / low).powf(0.08).max(1.02);
            return Self { low: low / room, high: high * room, logarithmic: true };
        }
        let room = 0.08 * (high - low).max(1e-3 * high.abs()).max(1e-12);
        Self::between(low - room, high + room)
    }

    /// Where a value lies, 0…1.
    fn share(&self, value: f64) -> f64 {
        let place = |v: f64| if self.logarithmic { v.ln() } else { v };
        let (low, high) = (place(self.low), place(self.high));
        if high > low { (place(value) - low) / (high - low) } else { 0.5 }
    }

    /// Round values, about `count` where it is not a matter of decades.
    fn ticks(&self, count: usize, whole: bool) -> Vec<(f64, String)> {
        let (low, high) = (self.low, self.high);
        if self.logarithmic && high >= 10.0 * low { decades(low, high) } else { ticks((low, high), count, whole) }
    }

    /// What is added to the axis' name.
    fn note(&self) -> &'static str {
        if self.logarithmic { " (logarithmic)" } else { "" }
    }
}

/// A rectangle of a drawing with a scale on each side.
#[derive(Clone, Copy, Debug)]
pub struct Panel {
    pub left: f64,
    pub top: f64,
    pub width: f64,
    pub height: f64,
    /// From the left to the right end, and from the lower to the upper one.
    pub x: Scale,
    pub y: Scale,
}

impl Panel {
    /// Where a value lies.
    pub fn at(&self, x: f64, y: f64) -> (f64, f64) {
        (self.left + self.x.share(x) * self.width, self.top + (1.0 - self.y.share(y)) * self.height)
    }

    /// Grid lines, numbers, and what the axes are called.
    pub fn frame(&self, across: &str, up: &str, whole: bool) -> Vec<Shape> {
        let mut out = Vec::new();
        let text = |x: f64, y: f64, text: String, anchor: Anchor, ink: Ink| Shape::Text { x, y, text, size: SMALL, anchor, ink };
        let mut before = f64::INFINITY;
        for (value, label) in self.y.ticks(if self.y.logarithmic { 14 } else { 6 }, false) {
            let (_, y) = self.at(self.x.low, value);
            // On a logarithmic scale the upper ones come too close.
            if before - y < 18.0 {
                continue;
            }
            before = y;
            let points = vec![(self.left, y), (self.left + self.width, y)];
            out.push(Shape::Line { points, ink: Ink::Grid, width: 1.0, dashed: false });
            out.push(text(self.left - 8.0, y + 4.0, label, Anchor::End, Ink::Muted));
        }
        let bottom = self.top + self.height;
        let mut before = f64::NEG_INFINITY;
        for (value, label) in self.x.ticks(8, whole) {
            let (x, _) = self.at(value, self.y.low);
            if x - before < 40.0 {
                continue;
            }
            before = x;
            out.push(Shape::Line { points: vec![(x, bottom), (x, bottom + 4.0)], ink: Ink::Muted, width: 1.0, dashed: false });
            out.push(text(x, bottom + 18.0, label, Anchor::Middle, Ink::Muted));
        }
        let points = vec![(self.left, bottom), (self.left + self.width, bottom)];
        out.push(Shape::Line { points, ink: Ink::Muted, width: 1.0, dashed: false });
        out.push(text(self.left, self.top - 10.0, format!("{up}{}", self.y.note()), Anchor::Start, Ink::Text));
        out.push(text(self.left + self.width, bottom + 34.0, format!("{across}{}", self.x.note()), Anchor::End, Ink::Muted));
        out
    }
}

/// 1, 2 and 5 times the powers of ten within a range, as written; the powers alone where there are many.
fn decades(low: f64, high: f64) -> Vec<(f64, String)> {
    let factors: &[f64] = if high / low > 1e4 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let written = |power: i32, v: f64| match power {
        -6..6 => format!("{v:.0$}", power.min(0).unsigned_abs() as usize),
        _ => format!("{v:.0e}"),
    };
    let powers = low.log10().floor() as i32..=high.log10().floor() as i32;
    let all = powers.flat_map(|power| factors.iter().map(move |f| (power, f * 10f64.powi(power))));
    all.filter(|(_, v)| (low..=high).contains(v)).map(|(power, v)| (v, written(power, v))).collect()
}

/// Round values within a range, about `count`, as written; `whole` ones only for numbers of frames.
fn ticks((low, high): (f64, f64), count: usize, whole: bool) -> Vec<(f64, String)> {
    let rough = (high - low) / count as f64;
    if !(rough.is_finite() && rough > 0.0) {
        return vec![(low, number(low))];
    }
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 2.5, 5.0, 10.0].into_iter().map(|f| f * power).find(|s| *s >= rough * 0.999).unwrap_or(10.0 * power);
    let step = if whole { step.max(1.0).round() } else { step };
    let fine = usize::from((step / power - 2.5).abs() < 1e-9);
    let digits = (-(step.log10().floor())).clamp(0.0, 9.0) as usize + if whole { 0 } else { fine };
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last.min(first + 50)).map(|i| i as f64 * step).map(|v| (v, format!("{v:.digits$}"))).collect()
}

/// A number in a few digits.
pub fn number(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        v if v >= 100.0 => format!("{value:.0}"),
        v if v >= 10.0 => format!("{value:.1}"),
        v if v >= 1.0 => format!("{value:.2}"),
        v if v >= 0.1 => format!("{value:.3}"),
        v if v >= 1e-4 => format!("{value:.4}"),
        _ => format!("{value:.1e}"),
    }
}

/// A label beside a place.
#[derive(Clone, Debug)]
pub struct Label {
    pub at: (f64, f64),
    pub text: String,
    pub ink: Ink,
}

/// Labels to the right of their places, or to the left where `right` is too near, moved up and down so that they cover neither
/// each other nor a place. The shapes of each, in the same order.
pub fn place(labels: &[Label], right: f64, (top, bottom): (f64, f64)) -> Vec<Vec<Shape>> {
    let mut taken: Vec<[f64; 4]> = labels.iter().map(|l| [l.at.0 - 5.0, l.at.0 + 5.0, l.at.1 - 5.0, l.at.1 + 5.0]).collect();
    let mut order: Vec<usize> = (0..labels.len()).collect();
    order.sort_by(|a, b| labels[*a].at.1.total_cmp(&labels[*b].at.1));
    let mut out = vec![Vec::new(); labels.len()];
    for i in order {
        let Label { at: (x, y), text, ink } = &labels[i];
        let width = text_width(text, SMALL);
        let leftwards = x + 12.0 + width > right;
        let offsets = (0..60).map(|n| f64::from((n + 1) / 2) * if n % 2 == 0 { 7.0 } else { -7.0 });
        let space = |down: f64, aside: f64| {
            let start = if leftwards { x - 10.0 - aside - width } else { x + 10.0 + aside };
            [start - 2.0, start + width + 2.0, y + down - 6.0, y + down + 6.0]
        };
        let is_free = |s: &[f64; 4]| {
            s[2] >= top && s[3] <= bottom && !taken.iter().any(|t| s[0] < t[1] && t[0] < s[1] && s[2] < t[3] && t[2] < s[3])
        };
        let mut tries = offsets.map(|down| (down, if down == 0.0 { 0.0 } else { 8.0 }));
        let (down, aside) = tries.find(|(down, aside)| is_free(&space(*down, *aside))).unwrap_or((0.0, 0.0));
        let found = space(down, aside);
        taken.push(found);
        if down != 0.0 {
            let end = if leftwards { found[1] } else { found[0] };
            let points = vec![(*x, *y), (end, y + down)];
            out[i].push(Shape::Line { points, ink: Ink::Front, width: 1.0, dashed: false });
        }
        let (start, text) = (found[0] + 2.0, text.clone());
        out[i].push(Shape::Text { x: start, y: y + down + 4.0, text, size: SMALL, anchor: Anchor::Start, ink: *ink });
    }
    out
}

/// Heights at least `gap` apart, as near to those given as may be, in their order; between `top` and `bottom` while they fit.
pub fn stack(heights: &[f64], gap: f64, (top, bottom): (f64, f64)) -> Vec<f64> {
    let mut order: Vec<usize> = (0..heights.len()).collect();
    order.sort_by(|a, b| heights[*a].total_cmp(&heights[*b]));
    let mut out = heights.to_vec();
    let mut least = top;
    for &i in &order {
        out[i] = out[i].max(least);
        least = out[i] + gap;
    }
    let mut most = bottom;
    for &i in order.iter().rev() {
        out[i] = out[i].min(most);
        most = out[i] - gap;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        let texts = |range, whole| ticks(range, 5, whole).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(texts((0.0, 1.0), false), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(texts((0.0371, 0.0449), false), ["0.038", "0.040", "0.042", "0.044"]);
        assert_eq!(texts((0.0, 0.011), false), ["0.0000", "0.0025", "0.0050", "0.0075", "0.0100"]);
        assert_eq!(texts((4.0, 5.0), true), ["4", "5"]);
        assert_eq!(texts((2.0, 2.0), false), ["2.00"]);
        assert_eq!(texts((-0.001, 0.004), false).len(), 6);
    }

    #[test]
    fn labels_do_not_cover_each_other() {
        let label = |x: f64, y: f64| Label { at: (x, y), text: "window 2".into(), ink: Ink::Text };
        let labels: Vec<Label> =
            [(50.0, 50.0), (51.0, 52.0), (50.0, 51.0), (290.0, 50.0), (52.0, 95.0)].map(|(x, y)| label(x, y)).into();
        let placed = place(&labels, 300.0, (0.0, 100.0));
        let boxes: Vec<(f64, f64)> = placed
            .iter()
            .flatten()
            .filter_map(|s| if let Shape::Text { x, y, .. } = s { Some((*x, *y)) } else { None })
            .collect();
        assert_eq!(boxes.len(), 5);
        for (i, a) in boxes.iter().enumerate() {
            for b in &boxes[i + 1..] {
                assert!((a.0 - b.0).abs() > 40.0 || (a.1 - b.1).abs() >= 12.0, "{a:?} {b:?}");
            }
        }
        assert!(boxes[3].0 + text_width("window 2", SMALL) < 290.0, "to the left of a place at the right edge");
    }

    #[test]
    fn stacked_heights_keep_their_order_and_distance() {
        assert_eq!(stack(&[50.0, 10.0, 51.0], 13.0, (0.0, 100.0)), [50.0, 10.0, 63.0]);
        assert_eq!(stack(&[98.0, 99.0, 97.0], 13.0, (0.0, 100.0)), [87.0, 100.0, 74.0]);
    }

    #[test]
    fn far_apart_values_are_drawn_by_ratio() {
        let up = |values: &[f64], v: f64| {
            let (x, y) = (Scale::between(0.0, 1.0), Scale::of(values.iter().copied()));
            Panel { left: 0.0, top: 0.0, width: 100.0, height: 100.0, x, y }.at(0.0, v).1
        };
        // However far: room around them leads to no value below 0.
        assert!((up(&[1.0, 4.0], 2.0) - 50.0).abs() < 1e-9 && (up(&[1e-4, 1.0], 1e-2) - 50.0).abs() < 1e-9);
        assert!((up(&[1.0, 1.8], 1.4) - 50.0).abs() < 1e-9);
        assert!((up(&[-1.0, 3.0], 1.0) - 50.0).abs() < 1e-9, "below 0 there are no ratios");
        assert!((up(&[0.0, 3.0], 1.5) - 50.0).abs() < 1e-9 && (up(&[1e-300, 3.0], 1.5) - 50.0).abs() < 1e-9);
        let times = Scale::of_ratios([1.0, 1.21].into_iter());
        assert!((times.share(1.1) - 0.5).abs() < 1e-9 && times.note() == " (logarithmic)" && times.low > 0.9);
    }

    #[test]
    fn ticks_by_ratio_are_round_in_every_decade() {
        let texts = |low: f64, high: f64| decades(low, high).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(texts(0.06, 13.0), ["0.1", "0.2", "0.5", "1", "2", "5", "10"]);
        assert_eq!(texts(0.0019, 0.025), ["0.002", "0.005", "0.01", "0.02"]);
        assert_eq!(texts(1e-7, 0.5), ["1e-7", "0.000001", "0.00001", "0.0001", "0.001", "0.01", "0.1"]);
        let panel = Panel {
            left: 0.0,
            top: 0.0,
            width: 300.0,
            height: 100.0,
            x: Scale::of_ratios([0.06, 13.0].into_iter()),
            y: Scale::between(0.0, 1.0),
        };
        let words: Vec<f64> = panel
            .frame("seconds", "error", false)
            .iter()
            .filter_map(|s| match s {
                Shape::Text { x, anchor: Anchor::Middle, .. } => Some(*x),
                _ => None,
            })
            .collect();
        assert!(words.len() >= 4 && words.windows(2).all(|w| w[1] - w[0] >= 40.0), "{words:?}");
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.0, 1234.5, 0.04567, 2e-5, 1.5].map(number), ["0", "1234", "0.0457", "2.0e-5", "1.50"]);
    }

    #[test]
    fn scales_have_room() {
        assert_eq!(Scale::of([].into_iter()), Scale::between(0.0, 1.0));
        for values in [[1.0, 1.9, f64::NAN], [1.0, 2.1, f64::INFINITY]] {
            let Scale { low, high, .. } = Scale::of(values.into_iter());
            assert!(low < 1.0 && high > values[1] && low > 0.8 && high < 1.2 * values[1]);
        }
        let Scale { low, high, .. } = Scale::of_ratios([0.5].into_iter());
        assert!(low < 0.5 && high > 0.5);
    }
}
