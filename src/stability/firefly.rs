//! What one absurdly bright pixel does to the rest of its frame.

use super::cases::{Case, Hazard};
use super::row::{CheckRow, Worst};
use super::suite::Suite;
use crate::Result;

/// Pixels around it that its light may reach: kernels end after 37.
const NEAR: usize = 40;
/// The rest may change by this share of the noise that is taken out.
const SHARE: f64 = 0.05;

/// How far the result with a pixel of 1e30 in each frame lies from the one without, as a share of what was taken out of the noisy
/// frame, away from the pixel.
pub(super) fn row(suite: &Suite) -> Result<CheckRow> {
    let plain = Case {
        name: "noisy scene".into(),
        rows: 128,
        columns: 160,
        frames: 3,
        centre: 1,
        window: 1,
        seed: 9,
        hazards: Vec::new(),
    };
    let spoilt = Case { hazards: vec![Hazard::OneHuge], ..plain.clone() };
    let frames = plain.build();
    let clean = plain.denoise(&suite.exact, &frames, 1.0)?.colour;
    let found = plain.denoise(&suite.exact, &spoilt.build(), 1.0)?.colour;
    let (mut apart, mut removed) = (0.0, 0.0);
    for (i, v) in found.indexed_iter() {
        // In the neighbours the scene has moved on by a few pixels.
        if i.0.abs_diff(plain.rows / 2).max(i.1.abs_diff(plain.columns / 2)) > NEAR + 4 {
            apart += f64::from((v - clean[i]).powi(2));
            removed += f64::from((frames[plain.centre].colour[i] - clean[i]).powi(2));
        }
    }
    let mut worst = Worst::new();
    worst.take((apart / removed.max(1e-30)).sqrt(), || "root mean square over the rest of the frame".into());
    Ok(worst.row("noisy scene", "one pixel of 1e30", SHARE))
}
