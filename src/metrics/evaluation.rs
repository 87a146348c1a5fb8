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
    let of = |metric: fn(&Scores) -> f64| scores.iter().map(metric).sum::<f64>() / scores.len() as f64;
    let flicker: Vec<f64> = scores.iter().filter_map(|s| s.flicker).collect();
    (!scores.is_empty()).then(|| Scores {
        smape: of(|s| s.smape),
        relmse: of(|s| s.relmse),
        psnr: of(|s| s.psnr),
        ssim: of(|s| s.ssim),
        flip: of(|s| s.flip),
        flicker: (!flicker.is_empty()).then(|| flicker.iter().sum::<f64>() / flicker.len() as f64),
    })
}

/// A table with a row a frame and a row of means, then the warnings.
impl fmt::Display for Evaluation {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let width = self.frames.iter().map(|r| r.frame.to_string().len()).max().unwrap_or(0).max("frame".len());
        let head = ["SMAPE", "relMSE", "PSNR", "SSIM", "FLIP", "flicker"];
        write!(f, "{:>width$}", "frame")?;
        head.iter().try_for_each(|h| write!(f, "  {h:>8}"))?;
        writeln!(f)?;
        for row in &self.frames {
            match (&row.scores, &row.error) {
                (Some(scores), _) => writeln!(f, "{:>width$}{scores}", row.frame)?,
                (None, error) => writeln!(f, "{:>width$}  {}", row.frame, error.as_deref().unwrap_or("not compared"))?,
            }
        }
        if let Some(scores) = &self.mean {
            writeln!(f, "{:>width$}{scores}", "mean")?;
        }
        self.warnings.iter().try_for_each(|w| writeln!(f, "{w}"))
    }
}

/// The numbers in the table's columns.
impl fmt::Display for Scores {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "  {}  {}  {:>8.2}  {:>8.4}  {}", cell(self.smape), cell(self.relmse), self.psnr, self.ssim, cell(self.flip))?;
        write!(f, "  {}", self.flicker.map_or_else(|| format!("{:>8}", "–"), cell))
    }
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
        let first = Scores { smape: 0.04, relmse: 12345.0, psnr: 30.0, ssim: 0.9, flip: 0.05, flicker: None };
        let second = Scores { smape: 0.06, relmse: 0.00002, psnr: 40.0, ssim: 1.0, flip: 0.07, flicker: Some(0.02) };
        let frames = vec![row(9, Some(first)), row(10, Some(second)), row(11, None)];
        let mean = mean(&frames);
        Evaluation { scaling: Scaling::ReferenceMean, frames, mean, warnings: vec!["Look out.".into()] }
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
    }
}
