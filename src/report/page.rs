//! The page: one HTML file that needs nothing beside it.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::axes::number;
use super::candidates::CandidateKind;
use super::crops::{CropSet, ERROR_SCALE_END};
use super::measure::Measured;
use super::plots::{by_frame, by_stage, error_against_time, ink};
use super::record::{Basis, ERRORS, Report, SettingRow};
use super::soundness::soundness;
use super::statistics::Spread;
use crate::picture::drawing::{Ink, printable, styles};
use crate::picture::false_colour::false_colour;
use crate::words::counted;

/// Marks a page of ours, which may be written over.
pub const MARK: &str = "<meta name=\"generator\" content=\"hush report\">";
/// What the estimate was found to be worth where references tell; `estimate_on_the_sample_shot` in `tests/report.rs` measures it again.
const SAMPLE_CHECK: &str = "On Hush's sample shot (two frames in its middle, 12 samples a pixel), where there are good references, the estimates \
    of six settings were too low by 0.0071 to 0.0077, at errors from 0.008 to 0.015: they see noise and blur, and not what the frames before \
    and after lack, too, such as reflections that move otherwise than their surfaces. So compare settings by it, and do not quote it.";

/// The whole page.
pub fn page(measured: &Measured) -> String {
    let report = &measured.report;
    let title = format!("Hush report: {}", printable(&report.sequence));
    let failed = report.failed.iter().map(|(frame, why)| format!("Frame {frame} was not measured: {why}."));
    let remarks: Vec<String> = report.remarks.iter().cloned().chain(failed).collect();
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                (PreEscaped(MARK))
                meta name="viewport" content="width=device-width,initial-scale=1";
                title { (title) }
                style { (PreEscaped(include_str!("page.css"))) (PreEscaped(styles())) }
            }
            body {
                main {
                    h1 { (title) }
                    p.muted { (printable(&facts(report))) }
                    @if !remarks.is_empty() {
                        div.note { ul { @for text in &remarks { li { (printable(text)) } } } }
                    }
                    (section("Error against time", html! { (basis(report)) (error_against_time(report).inline()) }))
                    (section("Settings", table(report)))
                    (section("Tiles", tiles(&measured.crops)))
                    (section("Frame by frame", by_frame(report).inline()))
                    (section("Time by stage", by_stage(report).inline()))
                    (section("Memory", memory(report)))
                    @if !report.checks.is_empty() { (section("How far off an estimate would have been", checks(report))) }
                    @if !report.stability.is_empty() { (section("Numerical soundness", soundness(&report.stability))) }
                    (section("How it was measured", method(report)))
                }
                script { (PreEscaped(include_str!("page.js"))) }
            }
        }
    };
    page.into_string()
}

fn section(title: &str, body: Markup) -> Markup {
    html! { section { h2 { (title) } (body) } }
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
        Some(name) => format!("{name}, {}, {}", m.instructions, counted(m.threads, "thread")),
        None => format!("{}, {}", m.instructions, counted(m.threads, "thread")),
    });
    if let (Some(before), Some(after)) = (m.load_before, m.load_after) {
        parts.push(format!("load {before:.1} before, {after:.1} after on {}", counted(m.cores, "core")));
    }
    parts.push(format!("{}, Hush {}", m.system, report.hush));
    parts.join(" · ")
}

/// What the errors stand on.
fn basis(report: &Report) -> Markup {
    let change = "The change along the motion holds what really changes in the light, too: only its differences between settings tell \
                  something.";
    match (report.basis, &report.estimate) {
        (Basis::Reference, _) => html! {
            p {
                "Errors are against the references in " (printable(report.reference.as_deref().unwrap_or_default()))
                ". Their own noise, if they have any, is in every number."
            }
        },
        (Basis::Estimate, Some(note)) => html! {
            p {
                strong { "There are no references, so the error is an estimate." }
                " Each frame was judged by the noisy frames " (note.distance) " before and " (note.distance) " after it, carried to it \
                 along the motion vectors: " (counted(note.frames, "frame")) ", " (format!("{:.0}", 100.0 * note.share)) " % of their \
                 pixels, those that can be followed both ways. They are the easier ones: the error of whole frames is higher. The \
                 standard error of a setting's mean is up to " (number(note.deviation)) ". " (SAMPLE_CHECK) " " (change)
            }
        },
        (Basis::Estimate, None) => html! { p { "There are no references, and the error could not be estimated. " (change) } },
    }
}

fn cell(spread: Option<Spread>, middle: Option<f64>, front: bool) -> Markup {
    match spread.zip(middle) {
        Some((s, middle)) => {
            html! { td class=[front.then_some("front")] { (number(middle)) small { (number(s.low)) "–" (number(s.high)) } } }
        }
        None => html! { td { "–" } },
    }
}

fn name_cell(row: &SettingRow) -> Markup {
    let colour = match ink(&row.candidate) {
        Ink::Series(i) => format!("b i-{i}"),
        _ => String::new(),
    };
    html! {
        td { i class={ "dot " (colour) } {} (row.candidate.name) @if row.candidate.default { " " small { "default" } } }
    }
}

fn table(report: &Report) -> Markup {
    let rows = &report.rows_by_setting;
    let base = rows.iter().find(|r| r.candidate.default).and_then(|r| r.seconds).map(|s| s.median);
    let titles = report.basis.titles();
    let which: Vec<usize> = (0..ERRORS).filter(|e| titles[*e].is_some() && rows.iter().any(|r| r.errors[*e].is_some())).collect();
    let share = |row: &SettingRow| row.seconds.zip(base).map(|(s, base)| format!("{:.2}×", s.median / base.max(1e-12)));
    let left_out = |row: &SettingRow| row.left_out.map(|l| format!("{:.1} %", 100.0 * l));
    let or_none = |text: Option<String>| text.unwrap_or_else(|| "–".into());
    let middle = if report.basis == Basis::Estimate { "the estimated mean" } else { "the median over the frames" };
    html! {
        div.wide {
            table {
                tr {
                    th { "setting" } th { "seconds a frame" } th { "of default" }
                    @for e in &which { th { (titles[*e].unwrap_or_default()) } }
                    th { "not computed" }
                }
                @for (i, row) in rows.iter().enumerate() {
                    tr data-row=(i) {
                        (name_cell(row))
                        (cell(row.seconds, row.seconds.map(|s| s.median), false))
                        td { (or_none(share(row))) }
                        @for e in &which { (cell(row.errors[*e], row.error(*e, report.basis), row.front[*e])) }
                        td { (or_none(left_out(row))) }
                    }
                }
            }
        }
        p.muted {
            "Time: the median of the repeats, then the least and the greatest. Error: " (middle) ", then the quartiles over the frames. \
             ● on the Pareto front: nothing is both faster and better."
        }
    }
}

fn tiles(sets: &[CropSet]) -> Markup {
    let stops: Vec<String> = (0..=10)
        .map(|i| false_colour(f64::from(i) / 10.0).map(|v| (v.round() as u8).to_string()).join(","))
        .map(|rgb| format!("rgb({rgb})"))
        .collect();
    let heading = |set: &CropSet| match (set.which, set.against_reference) {
        ("worst", true) => "Where the default is worst",
        ("worst", false) => "Where settings differ most",
        (_, true) => "Where the default's error is the median",
        (_, false) => "Where settings differ as they mostly do",
    };
    let source = |png: &[u8]| format!("data:image/png;base64,{}", STANDARD.encode(png));
    html! {
        p.muted {
            "Below each picture its error in false colour, SMAPE by pixel: 0 "
            span.scale style={ "background:linear-gradient(90deg," (stops.join(",")) ")" } {}
            " " (ERROR_SCALE_END) " and more."
        }
        @for set in sets {
            h3 {
                (heading(set)) ": frame " (set.frame) ", " (set.columns) "×" (set.rows) " pixels from column " (set.column) ", row " (set.row) "."
                @if !set.against_reference { " Without references false colours show the difference to the default." }
            }
            div.tiles {
                @for picture in &set.pictures {
                    figure {
                        img alt=(picture.name) src=(source(&picture.image));
                        @if let Some((_, image)) = &picture.error { img alt={ "error of " (picture.name) } src=(source(image)); }
                        figcaption { (picture.name) @if let Some((error, _)) = &picture.error { br; (number(*error)) } }
                    }
                }
            }
        }
    }
}

fn memory(report: &Report) -> Markup {
    let mib = |bytes: Option<u64>| bytes.map_or("–".into(), |b| format!("{:.0} MiB", b as f64 / f64::from(1 << 20)));
    let peak = match report.machine.peak_bytes {
        Some(_) => format!(
            "The peak of this whole process, which held all settings' pictures at once, was {}.",
            mib(report.machine.peak_bytes)
        ),
        None => "This system does not tell a process's peak.".into(),
    };
    html! {
        div.wide {
            table {
                tr { th { "setting" } th { "frames of the window" } th { "buffers of a tile" } th { "whole process" } }
                @for (i, row) in report.rows_by_setting.iter().enumerate().filter(|(_, r)| r.seconds.is_some()) {
                    tr data-row=(i) {
                        (name_cell(row))
                        @for bytes in [row.window_bytes.map(|b| b as u64), row.tile_bytes.map(|b| b as u64), row.peak_bytes] {
                            td { (mib(bytes)) }
                        }
                    }
                }
            }
        }
        p.muted { "For Hush by its own account, the most of any frame; for OIDN its process's peak, pictures included. " (peak) }
    }
}

fn checks(report: &Report) -> Markup {
    html! {
        p {
            "Without references the relMSE would have been estimated from noisy frames before and after. Both, on the pixels that can be \
             followed both ways; the references' noise, if they have any, is in the second:"
        }
        div.wide {
            table {
                tr {
                    th { "setting" } th { "estimated" } th { "against the references" } th { "estimate − measured" }
                }
                @for check in &report.checks {
                    tr {
                        td { (check.name) }
                        td { (number(check.estimated)) small { "±" (number(check.deviation)) } }
                        td { (number(check.measured)) }
                        td { (format!("{:+.4}", check.estimated - check.measured)) }
                    }
                }
            }
        }
    }
}

fn method(report: &Report) -> Markup {
    let times = if report.repeats == 1 { "once,".into() } else { format!("{} times", report.repeats) };
    html! {
        p {
            "Every frame was denoised with every setting, " (times) " in turn and in changing order, so that what else the machine did \
             met all of them. A setting's time is that of encoding the frame once and denoising it, in memory; reading and writing files \
             overlap with it in a run and are not in it. "
            @match report.basis {
                Basis::Reference => { "SMAPE, relMSE and flicker are those of " code { "hush eval" } "." }
                Basis::Estimate => { "With a reference the page shows errors instead of an estimate." }
            }
            " Each setting differs from the default in what its name says: " em { "window" } ", frames on each side; " em { "second pass" }
            ", each result averaged with those around it; " em { "no skipping" } ", nothing left out; " em { "λ" } ", the dial, 1 by default."
        }
        @if report.rows_by_setting.iter().any(|r| r.candidate.kind == CandidateKind::Oidn) {
            p {
                "OIDN ran on the CPU, though it can on a GPU as well, with the settings that Cycles has by default: at quality high, with \
                 albedo and normal where the frames have them, each of them filtered by itself first. Its time is its filters', these \
                 two included. " em { "raw" } " takes the guides as they were rendered, " em { "fast" } " too, at quality fast. Times are by OIDN's own clock, of the second run in a row \
                 of each filter, with as many threads; starting it and its files are not in them."
            }
        }
    }
}
