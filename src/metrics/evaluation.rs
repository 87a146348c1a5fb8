//! What an evaluation found: a table for people, the same numbers as JSON for machines.

use std::fmt;
use std::path::PathBuf;

use serde::Serialize;

use super::Scaling;

/// The metrics of one frame, or their means.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Scores {
    /// [`super::smape()`], lower is better.
    pub smape: f64,
    /// [`super::relmse()`], lower is better.
    pub relmse: f64,
    /// [`super::psnr()`] in decibels, higher is better; infinite (null in JSON) for equal images.
    pub psnr: f64,
    /// [`super::ssim()`], higher is better.
    pub ssim: f64,
    /// [`super::flip()`], lower is better.
    pub flip: f64,
    /// [`super::flicker()`], lower is better; None where the frame before is not there.
    pub flicker: Option<f64>,
    /// Errors without the references' noise; None without a second reference.
    pub unbiased: Option<UnbiasedScores>,
}

/// Errors without the references' noise, of one frame or their means. They are estimates, and below 0 where the truth is less than
/// their own noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct UnbiasedScores {
    /// [`super::unbiased_relmse()`], lower is better.
    pub relmse: f64,
    /// The root of `flicker_squared`, 0 where that is below 0.
    pub flicker: Option<f64>,
    /// [`super::unbiased_flicker_squared()`]; of means the mean of these, not of the roots.
    pub flicker_squared: Option<f64>,
}

impl UnbiasedScores {
    /// With the root.
    pub fn new(relmse: f64, flicker_squared: Option<f64>) -> Self {
        Self { relmse, flicker: flicker_squared.map(root), flicker_squared }
    }
}

/// How sure the means of the unbiased errors are: standard errors over the frames. Each frame's noise is its own, so they hold the
/// references' noise as well as the differences between frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StandardErrors {
    /// Of the mean relMSE; None for fewer than two frames.
    pub relmse: Option<f64>,
    /// Of the mean of the squares of flicker; None for fewer than two.
    pub flicker_squared: Option<f64>,
}

/// Whose motion vectors warped the frame before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// The file given for vectors.
    Vectors,
    /// The denoised file.
    Denoised,
    /// The reference file.
    Reference,
    /// Nobody's: plain frame differences.
    Plain,
}

/// One frame.
#[derive(Clone, Debug, Serialize)]
pub struct FrameEvaluation {
    /// Its number.
    pub frame: i64,
    /// The files compared.
    pub reference: PathBuf,
    /// None if the frame is missing.
    pub denoised: Option<PathBuf>,
    /// None if the frame could not be compared.
    pub scores: Option<Scores>,
    /// How `scores.flicker` came about.
    pub motion: Option<Motion>,
    /// Pixels with NaN or infinity, which are left out.
    pub non_finite_reference: usize,
    /// The same, of the denoised image.
    pub non_finite_denoised: usize,
    /// Why there are no scores.
    pub error: Option<String>,
}

/// All frames.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// How images were scaled before they were compared.
    pub scaling: Scaling,
    /// By ascending number.
    pub frames: Vec<FrameEvaluation>,
    /// The mean of each metric over the frames that have it; None if no frame could be compared.
    pub mean: Option<Scores>,
    /// Of the means of the unbiased errors, where there are any.
    pub standard_errors: Option<StandardErrors>,
    /// What a reader of the numbers must know, a sentence each.
    pub warnings: Vec<String>,
}

impl Evaluation {
    /// How many frames could not be compared.
    pub fn failed(&self) -> usize {
        self.frames.iter().filter(|f| f.scores.is_none()).count()
    }
}

/// The mean of each metric over the frames that have it.
pub(super) fn mean(frames: &[FrameEvaluation]) -> Option<Scores> {
    let scores: Vec<Scores> = frames.iter().filter_map(|f| f.scores).collect();
    let of = |metric: fn(&Scores) -> f64| average(&scores.iter().map(metric).collect::<Vec<_>>()).unwrap_or(f64::NAN);
    let (relmse, squares) = unbiased(frames);
    (!scores.is_empty()).then(|| Scores {
        smape: of(|s| s.smape),
        relmse: of(|s| s.relmse),
        psnr: of(|s| s.psnr),
        ssim: of(|s| s.ssim),
        flip: of(|s| s.flip),
        flicker: average(&scores.iter().filter_map(|s| s.flicker).collect::<Vec<_>>()),
        unbiased: average(&relmse).map(|relmse| UnbiasedScores::new(relmse, average(&squares))),
    })
}

/// The standard errors of the means of the unbiased errors; None without such errors.
pub(super) fn standard_errors(frames: &[FrameEvaluation]) -> Option<StandardErrors> {
    let (relmse, squares) = unbiased(frames);
    let flicker_squared = deviation_of_mean(&squares).map(|deviation| {
        // Two changes in a row share a frame: ¼ of their variance, as for differences of independent numbers.
        deviation * (1.0 + 0.5 * (squares.len() - 1) as f64 / squares.len() as f64).sqrt()
    });
    (!relmse.is_empty()).then(|| StandardErrors { relmse: deviation_of_mean(&relmse), flicker_squared })
}

/// The unbiased errors of the frames that have them: relMSE, squares of flicker.
fn unbiased(frames: &[FrameEvaluation]) -> (Vec<f64>, Vec<f64>) {
    let found: Vec<UnbiasedScores> = frames.iter().filter_map(|f| f.scores?.unbiased).collect();
    (found.iter().map(|u| u.relmse).collect(), found.iter().filter_map(|u| u.flicker_squared).collect())
}

fn average(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The standard error of a mean; None for fewer than two numbers.
fn deviation_of_mean(values: &[f64]) -> Option<f64> {
    let (count, mean) = (values.len() as f64, average(values)?);
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (values.len() > 1).then(|| (squares / (count - 1.0) / count).sqrt())
}

/// Of an estimated square, which may be below 0.
fn root(square: f64) -> f64 {
    square.max(0.0).sqrt()
}

/// A table with a row a frame and a row of means, what the unbiased errors are worth in words, then the warnings.
impl fmt::Display for Evaluation {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let width = self.frames.iter().map(|r| r.frame.to_string().len()).max().unwrap_or(0).max("frame".len());
        let head = ["SMAPE", "relMSE", "PSNR", "SSIM", "FLIP", "flicker"];
        let is_unbiased = self.mean.is_some_and(|m| m.unbiased.is_some());
        write!(f, "{:>width$}", "frame")?;
        head.iter().try_for_each(|h| write!(f, "  {h:>8}"))?;
        if is_unbiased {
            UNBIASED_HEAD.iter().try_for_each(|h| write!(f, "  {h}"))?;
        }
        writeln!(f)?;
        let line = |f: &mut fmt::Formatter, name: &dyn fmt::Display, scores: &Scores| {
            write!(f, "{name:>width$}{scores}")?;
            if is_unbiased {
                let cells = [scores.unbiased.map(|u| u.relmse), scores.unbiased.and_then(|u| u.flicker)];
                UNBIASED_HEAD.iter().zip(cells).try_for_each(|(h, value)| write!(f, "  {:>1$}", cell_or_none(value), h.len()))?;
            }
            writeln!(f)
        };
        for row in &self.frames {
            match (&row.scores, &row.error) {
                (Some(scores), _) => line(f, &row.frame, scores)?,
                (None, error) => writeln!(f, "{:>width$}  {}", row.frame, error.as_deref().unwrap_or("not compared"))?,
            }
        }
        if let Some(scores) = &self.mean {
            line(f, &"mean", scores)?;
        }
        self.in_words().iter().try_for_each(|text| writeln!(f, "{text}"))?;
        self.warnings.iter().try_for_each(|w| writeln!(f, "{w}"))
    }
}

/// The columns of the unbiased errors.
const UNBIASED_HEAD: [&str; 2] = ["unbiased relMSE", "unbiased flicker"];

impl Evaluation {
    /// What the unbiased errors are, and how far that can be trusted.
    fn in_words(&self) -> Option<String> {
        let (mean, errors) = (self.mean?.unbiased?, self.standard_errors?);
        let short = |value: f64| cell(value).trim_start().to_string();
        let mut text = format!("Without the references' noise, with one standard error: relMSE {}", short(mean.relmse));
        text += &errors.relmse.map_or(", of one frame".into(), |e| format!(" ± {}", short(e)));
        if let Some((square, flicker)) = mean.flicker_squared.zip(mean.flicker) {
            text += &format!(", flicker {}", short(flicker));
            text += &match errors.flicker_squared {
                Some(e) if square + e <= 0.0 => " (nothing above the noise)".into(),
                Some(e) => format!(" ({} to {})", short(root(square - e)), short(root(square + e))),
                None => " (of two frames)".into(),
            };
        }
        Some(text + ".")
    }
}

/// The numbers in the table's columns.
impl fmt::Display for Scores {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "  {}  {}  {:>8.2}  {:>8.4}  {}", cell(self.smape), cell(self.relmse), self.psnr, self.ssim, cell(self.flip))?;
        write!(f, "  {:>8}", cell_or_none(self.flicker))
    }
}

fn cell_or_none(value: Option<f64>) -> String {
    value.map_or_else(|| "–".into(), cell)
}

/// An error, eight wide: four decimals, or an exponent where they would not fit or show nothing.
fn cell(value: f64) -> String {
    let plain = value == 0.0 || (5e-4..1e3).contains(&value.abs());
    if plain { format!("{value:>8.4}") } else { format!("{value:>8.1e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(frame: i64, scores: Option<Scores>) -> FrameEvaluation {
        let error = scores.is_none().then(|| "no denoised frame".to_string());
        let name = PathBuf::from(format!("{frame:04}.exr"));
        let denoised = scores.map(|_| name.clone());
        FrameEvaluation {
            frame,
            reference: name,
            denoised,
            scores,
            motion: None,
            non_finite_reference: 0,
            non_finite_denoised: 0,
            error,
        }
    }

    fn report() -> Evaluation {
        let first = Scores { smape: 0.04, relmse: 12345.0, psnr: 30.0, ssim: 0.9, flip: 0.05, flicker: None, unbiased: None };
        let second =
            Scores { smape: 0.06, relmse: 0.00002, psnr: 40.0, ssim: 1.0, flip: 0.07, flicker: Some(0.02), unbiased: None };
        let frames = vec![row(9, Some(first)), row(10, Some(second)), row(11, None)];
        let mean = mean(&frames);
        Evaluation { scaling: Scaling::ReferenceMean, frames, mean, standard_errors: None, warnings: vec!["Look out.".into()] }
    }

    #[test]
    fn means_leave_out_what_is_not_there() {
        let m = report().mean.unwrap();
        assert!((m.smape - 0.05).abs() < 1e-12);
        assert!((m.psnr - 35.0).abs() < 1e-12);
        assert_eq!(m.flicker, Some(0.02));
        assert_eq!(report().failed(), 1);
        assert_eq!(mean(&[row(1, None)]), None);
    }

    #[test]
    fn table() {
        let expected = "\
frame     SMAPE    relMSE      PSNR      SSIM      FLIP   flicker
    9    0.0400     1.2e4     30.00    0.9000    0.0500         –
   10    0.0600    2.0e-5     40.00    1.0000    0.0700    0.0200
   11  no denoised frame
 mean    0.0500     6.2e3     35.00    0.9500    0.0600    0.0200
Look out.
";
        assert_eq!(report().to_string(), expected);
    }

    #[test]
    fn unbiased_errors_have_columns_and_words() {
        let with = |squares: [Option<f64>; 3]| {
            let rows = squares.iter().zip([0.010, 0.014, 0.012]).zip(9..).map(|((square, relmse), frame)| {
                let unbiased = Some(UnbiasedScores::new(relmse, *square));
                row(frame, Some(Scores { unbiased, ..report().frames[1].scores.unwrap() }))
            });
            let frames: Vec<FrameEvaluation> = rows.collect();
            let (mean, standard_errors) = (mean(&frames), standard_errors(&frames));
            Evaluation { scaling: Scaling::ReferenceMean, frames, mean, standard_errors, warnings: Vec::new() }
        };
        let found = with([None, Some(4e-4), Some(-1e-4)]);
        let mean = found.mean.unwrap().unbiased.unwrap();
        assert!((mean.relmse - 0.012).abs() < 1e-12 && (mean.flicker_squared.unwrap() - 1.5e-4).abs() < 1e-12);
        assert!((mean.flicker.unwrap() - 1.5e-4f64.sqrt()).abs() < 1e-12, "the root of the mean");
        let errors = found.standard_errors.unwrap();
        assert!((errors.relmse.unwrap() - 0.002 / 3f64.sqrt()).abs() < 1e-12);
        // Two values 5e-4 apart have a mean that is known to 2.5e-4, which a shared frame makes √1.25 times as much.
        assert!((errors.flicker_squared.unwrap() - 2.5e-4 * 1.25f64.sqrt()).abs() < 1e-12);
        let text = found.to_string();
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[0].ends_with("flicker  unbiased relMSE  unbiased flicker"), "{text}");
        assert!(lines[1].ends_with("           0.0100                 –"), "{text}");
        assert!(lines[3].ends_with("           0.0120            0.0000"), "{text}");
        assert!(lines.iter().all(|l| l.contains("Without") || l.chars().count() == lines[0].chars().count()), "{text}");
        let said =
            "Without the references' noise, with one standard error: relMSE 0.0120 ± 0.0012, flicker 0.0122 (0.0000 to 0.0207).";
        assert_eq!(lines[5], said);
        assert!(with([None, Some(-4e-4), Some(-3.9e-4)]).to_string().contains("flicker 0.0000 (nothing above the noise)"));
        assert!(with([None, None, Some(4e-4)]).to_string().contains("flicker 0.0200 (of two frames)."));
        assert!(report().in_words().is_none());
    }

    #[test]
    fn json_has_the_numbers() {
        let mut r = report();
        r.frames[0].scores.as_mut().unwrap().psnr = f64::INFINITY;
        let json = serde_json::to_value(&r).unwrap();
        assert_eq!(json["scaling"], "reference_mean");
        assert_eq!(json["frames"][1]["scores"]["smape"], 0.06);
        assert_eq!(json["frames"][1]["scores"]["flicker"], 0.02);
        assert!(json["frames"][0]["scores"]["psnr"].is_null());
        assert!(json["frames"][2]["scores"].is_null());
        assert_eq!(json["frames"][2]["error"], "no denoised frame");
        assert_eq!(json["mean"]["ssim"], 0.95);
        assert!(json["mean"]["unbiased"].is_null() && json["standard_errors"].is_null());
        r.frames[1].scores.as_mut().unwrap().unbiased = Some(UnbiasedScores::new(0.01, Some(-0.5)));
        let json = serde_json::to_value(&r).unwrap();
        let expected = serde_json::json!({"relmse": 0.01, "flicker": 0.0, "flicker_squared": -0.5});
        assert_eq!(json["frames"][1]["scores"]["unbiased"], expected);
    }
}
