//! The three pictures of a report: error against time, error by frame, where the time goes.

use super::axes::{Label, Panel, SMALL, Scale, number, place, stack};
use super::candidates::{Candidate, CandidateKind, Method, OidnMode};
use super::record::{Basis, ERRORS, Report, SettingRow};
use crate::engine::STAGES;
use crate::picture::drawing::{Anchor, Drawing, Group, Ink, Shape};
use crate::picture::raster::text_width;
use crate::words::counted;

/// Everything is drawn this wide.
const WIDTH: f64 = 900.0;
const LEFT: f64 = 70.0;
/// What the title and the lines under it take.
const HEAD: f64 = 82.0;
/// The inks of stages.
const STAGE_INKS: [usize; STAGES.len()] = [0, 5, 7, 1, 8, 10, 11, 4];

/// The colour of a candidate.
pub fn ink(candidate: &Candidate) -> Ink {
    Ink::Series(match (candidate.kind, candidate.method) {
        (CandidateKind::Noisy, _) => 0,
        (CandidateKind::Window, Method::Hush { window: 0, .. }) if !candidate.default => 2,
        (CandidateKind::Window, Method::Hush { window: 1, .. }) => 3,
        (CandidateKind::Window, Method::Hush { window: 3, .. }) => 4,
        (CandidateKind::Window, _) => 1,
        (CandidateKind::SecondPass, _) => 11,
        (CandidateKind::Skipping, _) => 7,
        (CandidateKind::Lambda, Method::Hush { lambda, .. }) if lambda > 8.0 => 9,
        (CandidateKind::Lambda, _) => 8,
        (CandidateKind::Oidn, Method::Oidn { mode: OidnMode::RawGuides }) => 5,
        (CandidateKind::Oidn, Method::Oidn { mode: OidnMode::Fast }) => 6,
        (CandidateKind::Oidn, _) => 10,
    })
}

/// What a drawing is about, under its title.
fn heading(report: &Report, title: &str, more: &str) -> Vec<Shape> {
    let (frames, repeats) = (counted(report.frames.len(), "frame"), counted(report.repeats, "repeat"));
    let size = format!(", {}×{}, {frames} × {repeats}.", report.columns, report.rows);
    let what = shortened(&report.sequence, WIDTH - 40.0 - text_width(&size, SMALL)) + &size;
    let text = |y: f64, size: f64, text: String, ink: Ink| Shape::Text { x: 20.0, y, text, size, anchor: Anchor::Start, ink };
    let lines = [(46.0, what), (62.0, more.into())].map(|(y, line)| text(y, SMALL, line, Ink::Muted));
    [text(26.0, 17.0, title.into(), Ink::Text)].into_iter().chain(lines).collect()
}

/// A text, or as much of its beginning as is no wider than this.
fn shortened(text: &str, width: f64) -> String {
    if text_width(text, SMALL) <= width {
        return text.into();
    }
    let mut kept: Vec<char> = text.chars().collect();
    let with_dots = |kept: &[char]| kept.iter().chain(&['…']).collect::<String>();
    while !kept.is_empty() && text_width(&with_dots(&kept), SMALL) > width {
        kept.pop();
    }
    with_dots(&kept)
}

/// The errors that there is anything to show of.
fn shown(report: &Report) -> Vec<(usize, &'static str)> {
    let titles = report.basis.titles();
    let has = |e: &usize| report.rows_by_setting.iter().any(|r| r.point(*e, report.basis).is_some());
    (0..ERRORS).filter(has).filter_map(|e| Some((e, titles[e]?))).collect()
}

/// A row in one line, for pointing at.
fn tip(row: &SettingRow, report: &Report) -> String {
    let mut parts = vec![row.candidate.name.clone()];
    parts.extend(row.seconds.map(|s| format!("{} s a frame ({}–{})", number(s.median), number(s.low), number(s.high))));
    for (e, title) in shown(report) {
        parts.extend(row.error(e, report.basis).map(|v| format!("{title} {}", number(v))));
    }
    parts.join(" · ")
}

/// Error against time, a panel for each error; with nothing to compare with, times alone.
pub fn error_against_time(report: &Report) -> Drawing {
    let panels = shown(report);
    let height = 250.0;
    let spread =
        if report.basis == Basis::Estimate { "Error: estimated mean. " } else { "Error: median and quartiles over the frames. " };
    let about = format!("{spread}Time: median, least and greatest of the repeats.");
    let mut drawing = Drawing::new(WIDTH, HEAD + (height + 70.0) * panels.len().max(1) as f64, "Error against time a frame");
    drawing.add(heading(report, "Error against time: lower and further left is better", &about));
    let times = report.rows_by_setting.iter().filter_map(|r| r.seconds);
    // OIDN with clean guides takes ten times as long as Hush.
    let x = Scale::of_ratios(times.flat_map(|s| [s.low, s.high]));
    if panels.is_empty() {
        let text = "There is no error to show; the table has the times.".to_string();
        drawing.add([Shape::Text { x: 20.0, y: HEAD + 24.0, text, size: SMALL, anchor: Anchor::Start, ink: Ink::Muted }]);
    }
    for (n, (e, title)) in panels.into_iter().enumerate() {
        let bars = report.basis == Basis::Reference || e != 1;
        let of = |row: &SettingRow| {
            let (seconds, error) = (row.seconds?, row.errors[e]?);
            Some((seconds, error, row.error(e, report.basis)?))
        };
        let rows: Vec<(usize, &SettingRow)> =
            report.rows_by_setting.iter().enumerate().filter(|(_, r)| of(r).is_some()).collect();
        let values = rows.iter().filter_map(|(_, r)| of(r)).flat_map(|(_, s, v)| if bars { [s.low, s.high] } else { [v, v] });
        let top = HEAD + 30.0 + (height + 70.0) * n as f64;
        let panel = Panel { left: LEFT, top, width: WIDTH - LEFT - 30.0, height, x, y: Scale::of(values) };
        drawing.add(panel.frame("seconds a frame", title, false));
        drawing.add(front(report, e, &panel));
        let spots: Vec<(f64, f64)> = rows.iter().filter_map(|(_, r)| of(r).map(|(t, _, v)| panel.at(t.median, v))).collect();
        let labels: Vec<Label> = rows
            .iter()
            .zip(&spots)
            .map(|((_, row), at)| Label { at: *at, text: row.candidate.name.clone(), ink: Ink::Text })
            .collect();
        let words = place(&labels, WIDTH - 20.0, (top - 4.0, top + height));
        // Spreads, then words, then discs: a word's halo may cover another's line, never its disc.
        for (i, row) in &rows {
            let (Some((time, error, value)), ink) = (of(row), ink(&row.candidate)) else { continue };
            let line = |from, to| Shape::Line { points: vec![from, to], ink, width: 1.5, dashed: false };
            let mut shapes = vec![line(panel.at(time.low, value), panel.at(time.high, value))];
            if bars {
                shapes.push(line(panel.at(time.median, error.low), panel.at(time.median, error.high)));
            }
            drawing.groups.push(Group { row: Some(*i), title: None, shapes });
        }
        drawing.groups.extend(rows.iter().zip(words).map(|((i, _), shapes)| Group { row: Some(*i), title: None, shapes }));
        for ((i, row), (x, y)) in rows.into_iter().zip(spots) {
            let (ink, mut shapes) = (ink(&row.candidate), Vec::new());
            shapes.push(Shape::Disc { x, y, radius: 5.0, ink, hollow: false });
            if row.candidate.default {
                shapes.push(Shape::Disc { x, y, radius: 8.5, ink, hollow: true });
            }
            drawing.groups.push(Group { row: Some(i), title: Some(tip(row, report)), shapes });
        }
    }
    drawing
}

/// The front as steps, and what it is called.
fn front(report: &Report, e: usize, panel: &Panel) -> Vec<Shape> {
    let on = report.rows_by_setting.iter().filter(|r| r.front[e]);
    let mut points: Vec<(f64, f64)> = on.filter_map(|r| r.point(e, report.basis)).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (Some(first), Some(last)) = (points.first().copied(), points.last().copied()) else { return Vec::new() };
    let mut steps = vec![panel.at(first.0, panel.y.high)];
    for (i, p) in points.iter().enumerate() {
        if i > 0 {
            steps.push(panel.at(p.0, points[i - 1].1));
        }
        steps.push(panel.at(p.0, p.1));
    }
    steps.push(panel.at(panel.x.high, last.1));
    let (x, y) = (panel.left + panel.width, panel.top - 10.0);
    let text = "Pareto front: nothing is both faster and better".to_string();
    vec![
        Shape::Line { points: steps, ink: Ink::Front, width: 2.0, dashed: true },
        Shape::Line {
            points: vec![(x - text_width(&text, SMALL) - 40.0, y - 4.0), (x - text_width(&text, SMALL) - 8.0, y - 4.0)],
            ink: Ink::Front,
            width: 2.0,
            dashed: true,
        },
        Shape::Text { x, y, text, size: SMALL, anchor: Anchor::End, ink: Ink::Muted },
    ]
}

/// Error by frame, a line a candidate.
pub fn by_frame(report: &Report) -> Drawing {
    let panels = shown(report);
    let height = 210.0;
    let mut drawing = Drawing::new(WIDTH, HEAD + (height + 70.0) * panels.len().max(1) as f64, "Error by frame");
    drawing.add(heading(report, "Error by frame", "Noisy and no skipping are left out."));
    let frames = report.frames.iter().map(|f| *f as f64);
    let (low, high) = frames.fold((f64::INFINITY, f64::NEG_INFINITY), |a, f| (a.0.min(f), a.1.max(f)));
    for (n, (e, title)) in panels.into_iter().enumerate() {
        let drawn = |row: &SettingRow| !matches!(row.candidate.kind, CandidateKind::Noisy | CandidateKind::Skipping);
        let rows: Vec<(usize, &SettingRow)> = report.rows_by_setting.iter().enumerate().filter(|(_, r)| drawn(r)).collect();
        let values = rows.iter().flat_map(|(_, r)| r.by_frame.iter().filter_map(|f| f.errors[e]));
        let top = HEAD + 30.0 + (height + 70.0) * n as f64;
        let x = if high > low { Scale::between(low, high) } else { Scale::between(low - 1.0, low + 1.0) };
        let panel = Panel { left: LEFT, top, width: WIDTH - LEFT - 130.0, height, x, y: Scale::of(values) };
        drawing.add(panel.frame("frame", title, true));
        let points = |row: &SettingRow| -> Vec<(f64, f64)> {
            row.by_frame.iter().filter_map(|f| Some(panel.at(f.frame as f64, f.errors[e]?))).collect()
        };
        let (rows, ends): (Vec<_>, Vec<_>) =
            rows.into_iter().filter_map(|(i, r)| points(r).last().map(|end| ((i, r), *end))).unzip();
        let heights = stack(&ends.iter().map(|(_, y)| *y).collect::<Vec<_>>(), 14.0, (top - 4.0, top + height + 4.0));
        for (((i, row), (end, y)), height) in rows.into_iter().zip(ends).zip(heights) {
            let (ink, points) = (ink(&row.candidate), points(row));
            let (width, text) = (if row.candidate.default { 3.0 } else { 1.5 }, row.candidate.name.clone());
            let lead = vec![(end, y), (end + 22.0, height)];
            let mut shapes = vec![
                Shape::Line { points: lead, ink: Ink::Front, width: 1.0, dashed: false },
                Shape::Text { x: end + 26.0, y: height + 4.0, text, size: SMALL, anchor: Anchor::Start, ink: Ink::Text },
            ];
            shapes.extend(points.iter().map(|(x, y)| Shape::Disc { x: *x, y: *y, radius: 2.5, ink, hollow: false }));
            shapes.push(Shape::Line { points, ink, width, dashed: false });
            drawing.groups.push(Group { row: Some(i), title: Some(tip(row, report)), shapes });
        }
    }
    drawing
}

/// Seconds a frame by stage, a bar a candidate of Hush.
pub fn by_stage(report: &Report) -> Drawing {
    let rows: Vec<(usize, &SettingRow)> = report.rows_by_setting.iter().enumerate().filter(|(_, r)| r.stages.is_some()).collect();
    let mut drawing = Drawing::new(WIDTH, HEAD + 54.0 + 30.0 * rows.len() as f64, "Seconds a frame in each stage");
    drawing.add(heading(report, "Where the time goes", "Mean seconds a frame."));
    let mut x = 20.0;
    for (stage, ink) in STAGES.into_iter().zip(STAGE_INKS) {
        let text = stage.name().to_string();
        let width = text_width(&text, SMALL);
        drawing.add([
            Shape::Bar { x, y: HEAD - 5.0, width: 12.0, height: 12.0, ink: Ink::Series(ink) },
            Shape::Text { x: x + 17.0, y: HEAD + 5.5, text, size: SMALL, anchor: Anchor::Start, ink: Ink::Text },
        ]);
        x += width + 40.0;
    }
    let total = |row: &SettingRow| row.stages.map_or(0.0, |s| s.iter().sum::<f64>());
    let most = rows.iter().map(|(_, r)| total(r)).fold(1e-12, f64::max);
    let (left, full) = (120.0, WIDTH - 120.0 - 90.0);
    for (n, (i, row)) in rows.into_iter().enumerate() {
        let y = HEAD + 26.0 + 30.0 * n as f64;
        let text =
            |x: f64, text: String, anchor: Anchor, ink: Ink| Shape::Text { x, y: y + 15.0, text, size: SMALL, anchor, ink };
        let mut shapes = vec![text(left - 10.0, row.candidate.name.clone(), Anchor::End, Ink::Text)];
        let (mut x, mut parts) = (left, Vec::new());
        for ((seconds, stage), ink) in row.stages.iter().flatten().zip(STAGES).zip(STAGE_INKS) {
            let width = seconds / most * full;
            shapes.push(Shape::Bar { x, y, width: width.max(0.05), height: 20.0, ink: Ink::Series(ink) });
            parts.push(format!("{} {:.0} %", stage.name(), 100.0 * seconds / total(row).max(1e-12)));
            x += width;
        }
        shapes.push(text(x + 8.0, format!("{} s", number(total(row))), Anchor::Start, Ink::Muted));
        drawing.groups.push(Group { row: Some(i), title: Some(format!("{}: {}", row.candidate.name, parts.join(", "))), shapes });
    }
    drawing
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_name_keeps_its_beginning_and_fits() {
        assert_eq!(shortened("frame_####.exr", 200.0), "frame_####.exr");
        let name = "sh0100_lighting_v003_".repeat(12);
        let short = shortened(&name, 200.0);
        assert!(short.starts_with("sh0100_lighting_") && short.ends_with('…') && text_width(&short, SMALL) <= 200.0, "{short}");
        assert_eq!(shortened("name", 0.0), "…");
    }
}
