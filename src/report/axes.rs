//! Panels with axes: scales, ticks, and labels that keep off each other.

use crate::picture::drawing::{Anchor, Ink, Shape};
use crate::picture::raster::text_width;

/// The size of labels and ticks.
pub const SMALL: f64 = 12.0;

/// A rectangle of a drawing with a scale on each side.
#[derive(Clone, Copy, Debug)]
pub struct Panel {
    pub left: f64,
    pub top: f64,
    pub width: f64,
    pub height: f64,
    /// What the left and the right end, and the lower and the upper end, stand for.
    pub x: (f64, f64),
    pub y: (f64, f64),
}

impl Panel {
    /// Whether equal ratios are equally far apart: where the values lie far apart and above 0.
    fn is_logarithmic(&self) -> bool {
        self.y.0 > 0.0 && self.y.1 > 2.0 * self.y.0
    }

    /// Where a value lies.
    pub fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let share = |v: f64, (low, high): (f64, f64)| if high > low { (v - low) / (high - low) } else { 0.5 };
        let up = if self.is_logarithmic() { share(y.ln(), (self.y.0.ln(), self.y.1.ln())) } else { share(y, self.y) };
        (self.left + share(x, self.x) * self.width, self.top + (1.0 - up) * self.height)
    }

    /// Grid lines, numbers, and what the axes are called.
    pub fn frame(&self, across: &str, up: &str, whole: bool) -> Vec<Shape> {
        let mut out = Vec::new();
        let text = |x: f64, y: f64, text: String, anchor: Anchor, ink: Ink| Shape::Text { x, y, text, size: SMALL, anchor, ink };
        let (mut before, logarithmic) = (f64::INFINITY, self.is_logarithmic());
        for (value, label) in ticks(self.y, if logarithmic { 14 } else { 6 }, false) {
            let (_, y) = self.at(self.x.0, value);
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
        for (value, label) in ticks(self.x, 8, whole) {
            let (x, _) = self.at(value, self.y.0);
            out.push(Shape::Line { points: vec![(x, bottom), (x, bottom + 4.0)], ink: Ink::Muted, width: 1.0, dashed: false });
            out.push(text(x, bottom + 18.0, label, Anchor::Middle, Ink::Muted));
        }
        let points = vec![(self.left, bottom), (self.left + self.width, bottom)];
        out.push(Shape::Line { points, ink: Ink::Muted, width: 1.0, dashed: false });
        let scale = if logarithmic { " (logarithmic)" } else { "" };
        out.push(text(self.left, self.top - 10.0, format!("{up}{scale}"), Anchor::Start, Ink::Text));
        out.push(text(self.left + self.width, bottom + 34.0, across.into(), Anchor::End, Ink::Muted));
        out
    }
}

/// A range that holds all values, with some room around them; `zero` lets it begin at 0.
pub fn range(values: impl Iterator<Item = f64>, zero: bool) -> (f64, f64) {
    let (low, high) = values.filter(|v| v.is_finite()).fold((f64::INFINITY, f64::NEG_INFINITY), |a, v| (a.0.min(v), a.1.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let room = 0.08 * (high - low).max(1e-3 * high.abs()).max(1e-12);
    (if zero { low.min(0.0) } else { low - room }, high + room)
}

/// Round values within a range, about `count`, as written; `whole` ones only for numbers of frames.
pub fn ticks((low, high): (f64, f64), count: usize, whole: bool) -> Vec<(f64, String)> {
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
        let panel = |y: (f64, f64)| Panel { left: 0.0, top: 0.0, width: 100.0, height: 100.0, x: (0.0, 1.0), y };
        assert!((panel((1.0, 100.0)).at(0.0, 10.0).1 - 50.0).abs() < 1e-9);
        assert!((panel((1.0, 2.0)).at(0.0, 1.5).1 - 50.0).abs() < 1e-9);
        assert!((panel((-1.0, 3.0)).at(0.0, 1.0).1 - 50.0).abs() < 1e-9, "below 0 there are no ratios");
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.0, 1234.5, 0.04567, 2e-5, 1.5].map(number), ["0", "1234", "0.0457", "2.0e-5", "1.50"]);
    }

    #[test]
    fn ranges_have_room() {
        assert_eq!(range([].into_iter(), false), (0.0, 1.0));
        let (low, high) = range([1.0, 2.0, f64::NAN].into_iter(), false);
        assert!(low < 1.0 && high > 2.0 && low > 0.8);
        assert_eq!(range([1.0].into_iter(), true).0, 0.0);
    }
}
