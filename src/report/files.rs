//! A report's files: the page, its numbers as CSV and JSON, its plots as SVG and PNG. The page comes last.

use std::fs;
use std::io::{ErrorKind, Write as _};
use std::path::Path;

use super::measure::Measured;
use super::page::{MARK, page};
use super::plots::{by_frame, by_stage, error_against_time};
use super::record::{FrameErrors, Report, SettingRow};
use crate::engine::STAGES;
use crate::error::{Error, Result};
use crate::io::write_atomically;
use crate::picture::drawing::Drawing;
use crate::picture::raster::png;
use crate::stability::CheckRow;

/// The page's name in the output folder.
pub const PAGE: &str = "index.html";
/// Names of the plots, each as SVG and PNG.
const PLOTS: [&str; 3] = ["error-time", "by-frame", "by-stage"];
const SETTINGS: &str = "settings.csv";
const FRAMES: &str = "frames.csv";
const STABILITY: &str = "stability.csv";
const NUMBERS: &str = "report.json";
/// Pixels of a PNG for each unit of a drawing.
const SCALE: f32 = 2.0;

/// All that [`write`] may write beside the page.
fn names() -> impl Iterator<Item = String> {
    let plots = PLOTS.iter().flat_map(|name| ["svg", "png"].map(|ending| format!("{name}.{ending}")));
    plots.chain([SETTINGS, FRAMES, STABILITY, NUMBERS].map(String::from))
}

/// Makes sure before anything is measured that a report can be written to a folder, which is created if need be.
///
/// # Errors
/// It cannot be made or written to; it holds something else by the name of a file of a report; the page cannot be read.
pub fn prepare(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    let page = folder.join(PAGE);
    let foreign = match fs::read(&page) {
        // Bytes, as a page of others may be in any encoding.
        Ok(bytes) => (!bytes.windows(MARK.len()).any(|part| part == MARK.as_bytes())).then_some(page),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            names().map(|name| folder.join(name)).find(|path| path.symlink_metadata().is_ok())
        }
        Err(error) => return Err(Error::io(&page, error)),
    };
    if let Some(path) = foreign {
        let reason = "is there already and was not written by hush report: choose another output folder".into();
        return Err(Error::BadInput { input: path.display().to_string(), reason });
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
    let plots: [Drawing; 3] = [error_against_time(report), by_frame(report), by_stage(report)];
    for (name, drawing) in PLOTS.iter().zip(&plots) {
        put(&format!("{name}.svg"), drawing.file().as_bytes())?;
        let picture = png(drawing, SCALE).ok_or_else(|| Error::bad_file(folder.join(name), "cannot be drawn as PNG"))?;
        put(&format!("{name}.png"), &picture)?;
    }
    let mut tables = vec![(SETTINGS, settings_csv(report)), (FRAMES, frames_csv(report))];
    if !report.stability.is_empty() {
        tables.push((STABILITY, stability_csv(&report.stability)));
    }
    for (name, table) in tables {
        put(name, &table.map_err(|e| Error::bad_file(folder.join(name), e.to_string()))?)?;
    }
    let json = serde_json::to_vec_pretty(report).map_err(|e| Error::bad_file(folder.join(NUMBERS), e.to_string()))?;
    put(NUMBERS, &json)?;
    put(PAGE, page(measured).as_bytes())
}

/// Names of the errors' columns.
fn error_names(report: &Report) -> [String; 3] {
    report.basis.titles().map(|t| t.unwrap_or("none").replace(',', "").replace(' ', "_"))
}

fn field(value: Option<f64>) -> String {
    value.map_or(String::new(), |v| v.to_string())
}

/// Rows of text as a table.
fn table(rows: impl IntoIterator<Item = Vec<String>>) -> csv::Result<Vec<u8>> {
    let mut out = csv::Writer::from_writer(Vec::new());
    rows.into_iter().try_for_each(|row| out.write_record(row))?;
    out.into_inner().map_err(|e| e.into_error().into())
}

/// A row a setting.
fn settings_csv(report: &Report) -> csv::Result<Vec<u8>> {
    let mut head = ["setting", "seconds_median", "seconds_least", "seconds_greatest"].map(String::from).to_vec();
    for name in error_names(report) {
        head.extend(["median", "mean", "lower_quartile", "upper_quartile", "front"].map(|what| format!("{name}_{what}")));
    }
    head.extend(STAGES.map(|s| format!("{}_seconds", s.name().replace(' ', "_"))));
    head.extend(["share_not_computed", "window_bytes", "tile_bytes", "process_peak_bytes"].map(String::from));
    let row = |row: &SettingRow| {
        let mut out = vec![row.candidate.name.clone()];
        let seconds = row.seconds.map(|s| [s.median, s.low, s.high]);
        out.extend((0..3).map(|i| field(seconds.map(|s| s[i]))));
        for (error, front) in row.errors.iter().zip(row.front) {
            let values = error.map(|e| [e.median, e.mean, e.low, e.high]);
            out.extend((0..4).map(|i| field(values.map(|v| v[i]))));
            out.push(u8::from(front).to_string());
        }
        out.extend((0..STAGES.len()).map(|i| field(row.stages.map(|s| s[i]))));
        let bytes = [row.window_bytes.map(|b| b as f64), row.tile_bytes.map(|b| b as f64), row.peak_bytes.map(|b| b as f64)];
        out.extend([row.left_out].into_iter().chain(bytes).map(field));
        out
    };
    table([head].into_iter().chain(report.rows_by_setting.iter().map(row)))
}

/// A row a setting and a frame.
fn frames_csv(report: &Report) -> csv::Result<Vec<u8>> {
    let head = ["setting", "frame"].map(String::from).into_iter().chain(error_names(report)).collect();
    let row = |(name, frame): (&String, &FrameErrors)| {
        [name.clone(), frame.frame.to_string()].into_iter().chain(frame.errors.map(field)).collect()
    };
    let all = report.rows_by_setting.iter().flat_map(|r| r.by_frame.iter().map(|frame| (&r.candidate.name, frame)));
    table([head].into_iter().chain(all.map(row)))
}

/// A row a check of a case.
fn stability_csv(rows: &[CheckRow]) -> csv::Result<Vec<u8>> {
    let mut out = csv::Writer::from_writer(Vec::new());
    rows.iter().try_for_each(|row| out.serialize(row))?;
    out.into_inner().map_err(|e| e.into_error().into())
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
        fs::write(out.join(PAGE), b"<html><p>caf\xe9").unwrap();
        assert!(prepare(&out).unwrap_err().to_string().contains("not written by hush report"), "in Latin-1");
        fs::write(out.join(PAGE), format!("<html>{MARK}")).unwrap();
        prepare(&out).unwrap();
        for name in names().chain([PAGE.into()]) {
            let out = folder.path().join(&name).join("out");
            fs::create_dir_all(&out).unwrap();
            fs::write(out.join(&name), "mine").unwrap();
            assert!(prepare(&out).unwrap_err().to_string().contains(&name), "{name}");
        }
        fs::write(folder.path().join("file"), "").unwrap();
        assert!(prepare(&folder.path().join("file")).is_err());
    }
}
