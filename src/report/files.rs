//! A report's files: the page, its numbers as CSV and JSON, its plots as SVG and PNG. The page comes last.

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::Path;

use super::measure::Measured;
use super::page::{MARK, page};
use super::plots::{by_frame, by_stage, error_against_time};
use super::record::Report;
use crate::engine::STAGES;
use crate::error::{Error, Result};
use crate::io::write_atomically;
use crate::picture::drawing::Drawing;
use crate::picture::raster::png;

/// The page's name in the output folder.
pub const PAGE: &str = "index.html";
/// Pixels of a PNG for each unit of a drawing.
const SCALE: f32 = 2.0;

/// Makes sure before anything is measured that a report can be written to a folder, which is created if need be.
///
/// # Errors
/// It cannot be made or written to, or holds a page that is no report of ours.
pub fn prepare(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    let page = folder.join(PAGE);
    match fs::read_to_string(&page) {
        Ok(text) if !text.contains(MARK) => {
            let reason = "is there already and was not written by hush report: choose another output folder".into();
            return Err(Error::BadInput { input: page.display().to_string(), reason });
        }
        _ => {}
    }
    let probe = folder.join(".hush-report");
    write_atomically(&probe, |_| Ok(()))?;
    fs::remove_file(&probe).map_err(|e| Error::io(&probe, e))
}

/// Writes all files, each whole or not at all; a report that is there is replaced.
pub fn write(measured: &Measured, folder: &Path) -> Result<()> {
    let report = &measured.report;
    let put = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        write_atomically(&path, |to| to.write_all(bytes).map_err(|e| Error::io(&path, e)))
    };
    let plots: [(&str, Drawing); 3] =
        [("error-time", error_against_time(report)), ("by-frame", by_frame(report)), ("by-stage", by_stage(report))];
    for (name, drawing) in &plots {
        put(&format!("{name}.svg"), drawing.file().as_bytes())?;
        let picture = png(drawing, SCALE).ok_or_else(|| Error::bad_file(folder.join(name), "cannot be drawn as PNG"))?;
        put(&format!("{name}.png"), &picture)?;
    }
    put("settings.csv", settings_csv(report).as_bytes())?;
    put("frames.csv", frames_csv(report).as_bytes())?;
    if !report.stability.is_empty() {
        put("stability.csv", stability_csv(report).as_bytes())?;
    }
    let json = serde_json::to_vec_pretty(report).map_err(|e| Error::bad_file(folder.join("report.json"), e.to_string()))?;
    put("report.json", &json)?;
    put(PAGE, page(measured).as_bytes())
}

/// Names of the errors' columns.
fn error_names(report: &Report) -> [String; 3] {
    report.basis.titles().map(|t| t.unwrap_or("none").replace(',', "").replace(' ', "_"))
}

fn field(value: Option<f64>) -> String {
    value.map_or(String::new(), |v| v.to_string())
}

/// A row a setting.
fn settings_csv(report: &Report) -> String {
    let names = error_names(report);
    let mut out = String::from("setting,seconds_median,seconds_least,seconds_greatest");
    for name in &names {
        let _ = write!(out, ",{name}_median,{name}_mean,{name}_lower_quartile,{name}_upper_quartile,{name}_front");
    }
    STAGES.iter().for_each(|s| _ = write!(out, ",{}_seconds", s.name().replace(' ', "_")));
    out.push_str(",share_not_computed,window_bytes,tile_bytes,process_peak_bytes\n");
    for row in &report.rows_by_setting {
        let seconds = row.seconds.map(|s| [s.median, s.low, s.high]);
        out.push_str(&row.candidate.name);
        (0..3).for_each(|i| _ = write!(out, ",{}", field(seconds.map(|s| s[i]))));
        for (error, front) in row.errors.iter().zip(row.front) {
            let values = error.map(|e| [e.median, e.mean, e.low, e.high]);
            (0..4).for_each(|i| _ = write!(out, ",{}", field(values.map(|v| v[i]))));
            let _ = write!(out, ",{}", u8::from(front));
        }
        (0..STAGES.len()).for_each(|i| _ = write!(out, ",{}", field(row.stages.map(|s| s[i]))));
        let bytes = [row.window_bytes.map(|b| b as f64), row.tile_bytes.map(|b| b as f64), row.peak_bytes.map(|b| b as f64)];
        let _ = writeln!(out, ",{},{}", field(row.left_out), bytes.map(field).join(","));
    }
    out
}

/// A row a setting and a frame.
fn frames_csv(report: &Report) -> String {
    let mut out = format!("setting,frame,{}\n", error_names(report).join(","));
    for row in &report.rows_by_setting {
        for frame in &row.by_frame {
            let _ = writeln!(out, "{},{},{}", row.candidate.name, frame.frame, frame.errors.map(field).join(","));
        }
    }
    out
}

/// A row a check of a case.
fn stability_csv(report: &Report) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let mut out = String::from("case,check,bound,worst,where,passed\n");
    for r in &report.stability {
        let _ =
            writeln!(out, "{},{},{},{},{},{}", quoted(&r.case), quoted(&r.check), r.bound, r.worst, quoted(&r.place), r.passed);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_tried_before_anything_is_measured() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("a/b");
        prepare(&out).unwrap();
        assert_eq!(fs::read_dir(&out).unwrap().count(), 0, "nothing is left behind");
        fs::write(out.join(PAGE), "someone's own page").unwrap();
        assert!(prepare(&out).unwrap_err().to_string().contains("not written by hush report"));
        fs::write(out.join(PAGE), format!("<html>{MARK}")).unwrap();
        prepare(&out).unwrap();
        fs::write(folder.path().join("file"), "").unwrap();
        assert!(prepare(&folder.path().join("file")).is_err());
    }
}
