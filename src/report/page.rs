//! The page: one HTML file that needs nothing beside it.

use std::fmt::Write;

use super::axes::number;
use super::candidates::Kind;
use super::crops::{CropSet, ERROR_SCALE_END};
use super::measure::Measured;
use super::plots::{by_frame, by_stage, error_against_time, ink};
use super::record::{Basis, ERRORS, Report, Row};
use super::soundness::soundness;
use super::statistics::Spread;
use crate::picture::drawing::{Ink, escape, styles};
use crate::picture::false_colour::false_colour;
use crate::words::counted;

/// Marks a page of ours, which may be written over.
pub const MARK: &str = "<meta name=\"generator\" content=\"hush report\">";
/// What the estimate was found to be worth where the truth was known better; `estimate_on_the_sample_shot` in `tests/report.rs`
/// measures it again.
const SAMPLE_CHECK: &str = "On Hush's sample shot (8 frames, 12 samples a pixel), where references exist, the estimates of nine settings and OIDN \
    were between 0.0019 too low and 0.0007 too high once the references' own noise was taken off, at true errors from 0.003 to 0.015.";

/// The whole page.
pub fn page(measured: &Measured) -> String {
    let report = &measured.report;
    let mut out = String::from("<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n");
    let name = escape(&report.sequence);
    let css = include_str!("page.css");
    let _ = writeln!(out, "{MARK}\n<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">");
    let _ = writeln!(out, "<title>Hush report: {name}</title>\n<style>\n{css}{}\n</style>\n</head>\n<body>\n<main>", styles());
    let _ = writeln!(out, "<h1>Hush report: {name}</h1>\n<p class=\"muted\">{}</p>", escape(&facts(report)));
    let remarks: Vec<String> = report
        .remarks
        .iter()
        .cloned()
        .chain(report.failed.iter().map(|(frame, why)| format!("Frame {frame} was not measured: {why}.")))
        .map(|text| format!("<li>{}</li>", escape(&text)))
        .collect();
    if !remarks.is_empty() {
        let _ = writeln!(out, "<div class=\"note\"><ul>{}</ul></div>", remarks.join(""));
    }
    section(&mut out, "Error against time", &format!("{}{}", basis(report), error_against_time(report).inline()));
    section(&mut out, "Settings", &table(report));
    section(&mut out, "Tiles", &tiles(&measured.crops));
    section(&mut out, "Frame by frame", &by_frame(report).inline());
    section(&mut out, "Time by stage", &by_stage(report).inline());
    section(&mut out, "Memory", &memory(report));
    if !report.checks.is_empty() {
        section(&mut out, "How far off an estimate would have been", &checks(report));
    }
    if !report.stability.is_empty() {
        section(&mut out, "Numerical soundness", &soundness(&report.stability));
    }
    section(&mut out, "How it was measured", &method(report));
    let _ = writeln!(out, "</main>\n<script>\n{}</script>\n</body>\n</html>", include_str!("page.js"));
    out
}

fn section(out: &mut String, title: &str, body: &str) {
    let _ = writeln!(out, "<section>\n<h2>{title}</h2>\n{body}</section>");
}

/// The shot and the machine in one line.
fn facts(report: &Report) -> String {
    let m = &report.machine;
    let mut parts = vec![format!("{}×{}", report.columns, report.rows)];
    parts.push(match report.frames.len() {
        n if n < report.of_frames => format!("{n} of {}", counted(report.of_frames, "frame")),
        n => counted(n, "frame"),
    });
    parts.push(if report.repeats == 1 { "timed once".into() } else { format!("timed {} times", report.repeats) });
    parts.push(match &m.processor {
        Some(name) => format!("{name}, {}, {} threads", m.instructions, m.threads),
        None => format!("{}, {} threads", m.instructions, m.threads),
    });
    if let (Some(before), Some(after)) = (m.load_before, m.load_after) {
        parts.push(format!("load {before:.1} before, {after:.1} after on {} cores", m.cores));
    }
    parts.push(format!("{}, Hush {}", m.system, report.hush));
    parts.join(" · ")
}

/// What the errors stand on.
fn basis(report: &Report) -> String {
    match (report.basis, &report.estimate) {
        (Basis::Reference, _) => {
            let path = escape(report.reference.as_deref().unwrap_or_default());
            format!("<p>Errors are against the references in {path}. Their own noise, if they have any, is in every number.</p>")
        }
        (Basis::Estimate, Some(note)) => format!(
            "<p><strong>There are no references, so the error is an estimate.</strong> Each frame was judged by the noisy frames {} before \
             and {} after it, carried to it along the motion vectors: {}, {:.0} % of their pixels, those that can be followed both \
             ways. They are the easier ones: the error of whole frames is higher. The standard error of a setting's mean is up to {}. \
             {SAMPLE_CHECK} The change along the motion holds what really changes in the light, too: only its differences between \
             settings tell something.</p>",
            note.distance,
            note.distance,
            counted(note.frames, "frame"),
            100.0 * note.share,
            number(note.deviation)
        ),
        (Basis::Estimate, None) => {
            "<p>There are no references, and the error could not be estimated. The change along the motion holds \
             what really changes in the light, too: only its differences between settings tell something.</p>"
                .into()
        }
    }
}

fn cell(spread: Option<Spread>, middle: Option<f64>, front: bool) -> String {
    let class = if front { " class=\"front\"" } else { "" };
    match (spread, middle) {
        (Some(s), Some(middle)) => {
            format!("<td{class}>{}<small>{}–{}</small></td>", number(middle), number(s.low), number(s.high))
        }
        _ => "<td>–</td>".into(),
    }
}

fn name_cell(row: &Row) -> String {
    let class = match ink(&row.candidate) {
        Ink::Series(i) => format!("b i-{i}"),
        _ => String::new(),
    };
    let default = if row.candidate.default { " <small>default</small>" } else { "" };
    format!("<td><i class=\"dot {class}\"></i>{}{default}</td>", escape(&row.candidate.name))
}

fn table(report: &Report) -> String {
    let rows = &report.rows_by_setting;
    let base = rows.iter().find(|r| r.candidate.default).and_then(|r| r.seconds).map(|s| s.median);
    let titles = report.basis.titles();
    let which: Vec<usize> = (0..ERRORS).filter(|e| titles[*e].is_some() && rows.iter().any(|r| r.errors[*e].is_some())).collect();
    let heads: String = which.iter().filter_map(|e| titles[*e]).map(|t| format!("<th>{t}</th>")).collect();
    let mut out = format!(
        "<div class=\"wide\"><table>\n<tr><th>setting</th><th>seconds a frame</th><th>of default</th>{heads}<th>not computed</th></tr>\n"
    );
    for (i, row) in rows.iter().enumerate() {
        let front = row.front.iter().any(|f| *f);
        let time = cell(row.seconds, row.seconds.map(|s| s.median), false);
        let share = row.seconds.zip(base).map_or("–".into(), |(s, base)| format!("{:.2}×", s.median / base.max(1e-12)));
        let errors: String =
            which.iter().map(|e| cell(row.errors[*e], row.error(*e, report.basis), front && row.front[*e])).collect();
        let left = row.left_out.map_or("–".into(), |l| format!("{:.1} %", 100.0 * l));
        let _ = writeln!(out, "<tr data-row=\"{i}\">{}{time}<td>{share}</td>{errors}<td>{left}</td></tr>", name_cell(row));
    }
    let middle = if report.basis == Basis::Estimate { "the estimated mean" } else { "the median over the frames" };
    let _ = write!(
        out,
        "</table></div>\n<p class=\"muted\">Time: the median of the repeats, then the least and the greatest. Error: {middle}, then the \
         quartiles over the frames. ● on the Pareto front: nothing is both faster and better.</p>\n"
    );
    out
}

fn tiles(sets: &[CropSet]) -> String {
    let stops: Vec<String> = (0..=10)
        .map(|i| false_colour(f64::from(i) / 10.0).map(|v| (v.round() as u8).to_string()).join(","))
        .map(|rgb| format!("rgb({rgb})"))
        .collect();
    let mut out = format!(
        "<p class=\"muted\">Below each picture its error in false colour, SMAPE by pixel: 0 \
         <span class=\"scale\" style=\"background:linear-gradient(90deg,{})\"></span> {ERROR_SCALE_END} and more.</p>\n",
        stops.join(",")
    );
    for set in sets {
        let kind = match (set.which, set.against_reference) {
            ("worst", true) => "Where the default is worst",
            ("worst", false) => "Where settings differ most",
            (_, true) => "Where the default's error is the median",
            (_, false) => "Where settings differ as they mostly do",
        };
        let against =
            if set.against_reference { "" } else { " Without references false colours show the difference to the default." };
        let _ = writeln!(
            out,
            "<h3>{kind}: frame {}, {}×{} pixels from column {}, row {}.{against}</h3>\n<div class=\"tiles\">",
            set.frame, set.columns, set.rows, set.column, set.row
        );
        for picture in &set.pictures {
            let (name, data) = (escape(&picture.name), base64(&picture.image));
            let _ = write!(out, "<figure><img alt=\"{name}\" src=\"data:image/png;base64,{data}\">");
            if let Some((_, image)) = &picture.error {
                let _ = write!(out, "<img alt=\"error of {name}\" src=\"data:image/png;base64,{}\">", base64(image));
            }
            let error = picture.error.as_ref().map(|(e, _)| format!("<br>{}", number(*e))).unwrap_or_default();
            let _ = writeln!(out, "<figcaption>{name}{error}</figcaption></figure>");
        }
        out.push_str("</div>\n");
    }
    out
}

fn memory(report: &Report) -> String {
    let mib = |bytes: Option<u64>| bytes.map_or("–".into(), |b| format!("{:.0} MiB", b as f64 / f64::from(1 << 20)));
    let mut out = String::from(
        "<div class=\"wide\"><table>\n<tr><th>setting</th><th>frames of the window</th><th>buffers of a tile</th><th>whole process</th></tr>\n",
    );
    for (i, row) in report.rows_by_setting.iter().enumerate().filter(|(_, r)| r.seconds.is_some()) {
        let (window, tile) = (row.window_bytes.map(|b| b as u64), row.tile_bytes.map(|b| b as u64));
        let cells = [mib(window), mib(tile), mib(row.peak_bytes)].map(|c| format!("<td>{c}</td>")).join("");
        let _ = writeln!(out, "<tr data-row=\"{i}\">{}{cells}</tr>", name_cell(row));
    }
    let peak = match report.machine.peak_bytes {
        Some(_) => format!(
            "The peak of this whole process, which held all settings' pictures at once, was {}. ",
            mib(report.machine.peak_bytes)
        ),
        None => "This system does not tell a process's peak. ".into(),
    };
    let _ = write!(
        out,
        "</table></div>\n<p class=\"muted\">For Hush by its own account, the most of any frame; for OIDN its process's peak, pictures \
         included. {peak}</p>\n"
    );
    out
}

fn checks(report: &Report) -> String {
    let mut out = String::from(
        "<p>Without references the relMSE would have been estimated from noisy frames before and after. Both, on the pixels that can be \
         followed both ways:</p>\n<div class=\"wide\"><table>\n<tr><th>setting</th><th>estimated</th><th>against the references</th>\
         <th>the references' own noise</th><th>estimate − (measured − noise)</th></tr>\n",
    );
    for check in &report.checks {
        let noise = check.reference_noise.map_or("–".into(), number);
        let off = check.reference_noise.map_or("–".into(), |n| format!("{:+.4}", check.estimated - (check.measured - n)));
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{}<small>±{}</small></td><td>{}</td><td>{noise}</td><td>{off}</td></tr>",
            escape(&check.name),
            number(check.estimated),
            number(check.deviation),
            number(check.measured)
        );
    }
    out.push_str("</table></div>\n");
    out
}

fn method(report: &Report) -> String {
    let own = match report.basis {
        Basis::Reference => "SMAPE, relMSE and flicker are those of <code>hush eval</code>.",
        Basis::Estimate => "With a reference the page shows errors instead of an estimate.",
    };
    let peer = match report.rows_by_setting.iter().any(|r| r.candidate.kind == Kind::Oidn) {
        true => {
            "<p>OIDN ran at quality high with albedo and normal where the frames have them. Its time is its filter's alone, by its own \
             clock, the second run in a row, with as many threads; starting it and its files are not in it.</p>\n"
        }
        false => "",
    };
    format!(
        "<p>Every frame was denoised with every setting, {} in turn and in changing order, so that what else the machine did met all \
         of them. A setting's time is that of encoding the frame once and denoising it, in memory; reading and writing files overlap with \
         it in a run and are not in it. {own} Each setting differs from the default in what its name says: <em>window</em>, frames on each \
         side; <em>no skipping</em>, nothing left out; <em>λ</em>, the dial, 1 by \
         default.</p>\n{peer}",
        if report.repeats == 1 { "once,".into() } else { format!("{} times", report.repeats) }
    )
}

/// Bytes as base64 (RFC 4648).
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let all = chunk.iter().fold(0u32, |n, b| n << 8 | u32::from(*b)) << (8 * (3 - chunk.len()));
        for i in 0..4 {
            let letter = LETTERS[(all >> (18 - 6 * i) & 63) as usize] as char;
            out.push(if i <= chunk.len() { letter } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_the_published_one() {
        let cases = [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ];
        cases.into_iter().for_each(|(plain, coded)| assert_eq!(base64(plain.as_bytes()), coded));
        assert_eq!(base64(&[255, 254, 0]), "//4A");
    }
}
