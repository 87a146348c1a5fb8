//! Which frames around a frame help to denoise it, and why the others do not.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// The widest window, in frames on each side.
pub const MAX_WINDOW: usize = 3;
/// The window where motion vectors exist and none was asked for.
pub const DEFAULT_WINDOW: usize = 2;
/// The dial's range: 1 is the symmetric loss (cleanest), 64 keeps most grain and detail.
pub const LAMBDA_RANGE: (f32, f32) = (1.0, 64.0);

/// Why a frame of the window is not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Unused {
    /// The shot starts or ends before it.
    EndOfShot,
    /// A gap in the sequence.
    Missing,
    /// Its file could not be read, or its first pass not be done, as with a mask of λ that does not fit.
    Bad,
    /// It has another resolution.
    OtherSize,
    /// It has other views or other light passes, an albedo where the frame has none, or none where it has one, or it is cropped at
    /// another place.
    OtherPasses,
    /// The frame itself has no Vector pass to find its neighbours with.
    NoVector,
    /// A frame between the two is not used or has no Vector pass, so the motion cannot be followed.
    BrokenChain,
}

/// A frame of the window around a centre frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WindowFrame {
    /// −3…3, −6…6 of what a second pass depends on; never 0.
    pub offset: i32,
    /// Its frame number.
    pub number: i64,
    /// None where it is used.
    pub unused: Option<Unused>,
}

/// What is known of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Availability {
    /// Before the first or after the last frame.
    Outside,
    /// No such file.
    Missing,
    /// The file cannot be read.
    Bad,
    /// Readable. `passes` differs where the views, the light passes or the places of the crop differ, or one has an albedo.
    Good { columns: usize, rows: usize, vector: bool, passes: u64 },
}

/// The window of `radius` frames on each side of `centre`, ordered by offset. `known` tells about any frame number.
///
/// What a second pass depends on is the window of twice the radius: a frame beyond the radius helps those that the motion leads through.
///
/// A frame is used if it is readable, of the centre's size, and every step from the centre to it has motion vectors: the step
/// from frame a to the next one outward is made with a's Vector pass.
pub fn neighbours(centre: i64, radius: usize, known: impl Fn(i64) -> Availability) -> Vec<WindowFrame> {
    let here = known(centre);
    let mut window = Vec::with_capacity(2 * radius);
    for direction in [-1i64, 1] {
        let mut inner = here;
        let mut broken = false;
        for step in 1..=radius as i64 {
            let number = centre + direction * step;
            let outer = known(number);
            let unused = match (here, inner, outer) {
                (_, _, Availability::Outside) => Some(Unused::EndOfShot),
                (_, _, Availability::Missing) => Some(Unused::Missing),
                (_, _, Availability::Bad) => Some(Unused::Bad),
                (Availability::Good { vector: false, .. }, ..) => Some(Unused::NoVector),
                (Availability::Good { columns: c, rows: r, .. }, _, Availability::Good { columns, rows, .. })
                    if (c, r) != (columns, rows) =>
                {
                    Some(Unused::OtherSize)
                }
                (Availability::Good { passes: a, .. }, _, Availability::Good { passes: b, .. }) if a != b => {
                    Some(Unused::OtherPasses)
                }
                (_, Availability::Good { vector: true, .. }, _) if !broken => None,
                _ => Some(Unused::BrokenChain),
            };
            broken |= unused.is_some();
            inner = outer;
            window.push(WindowFrame { offset: (direction * step) as i32, number, unused });
        }
    }
    window.sort_by_key(|n| n.offset);
    window
}

/// Checks a window that was asked for.
pub fn check_window(window: usize) -> Result<usize> {
    if window > MAX_WINDOW {
        return Err(Error::BadSetting {
            name: "window",
            reason: format!("{window} is too wide: 0 to {MAX_WINDOW} frames a side"),
        });
    }
    Ok(window)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Availability = Availability::Good { columns: 8, rows: 4, vector: true, passes: 0 };

    fn reasons(centre: i64, radius: usize, shot: &[Availability]) -> Vec<(i32, Option<Unused>)> {
        let known = |n: i64| usize::try_from(n).ok().and_then(|n| shot.get(n)).copied().unwrap_or(Availability::Outside);
        neighbours(centre, radius, known).iter().map(|n| (n.offset, n.unused)).collect()
    }

    #[test]
    fn the_ends_of_the_shot_narrow_the_window() {
        let shot = [GOOD; 4];
        assert_eq!(reasons(1, 1, &shot), [(-1, None), (1, None)]);
        assert_eq!(reasons(0, 2, &shot), [(-2, Some(Unused::EndOfShot)), (-1, Some(Unused::EndOfShot)), (1, None), (2, None)]);
        assert_eq!(reasons(2, 0, &shot), []);
    }

    #[test]
    fn a_frame_behind_a_gap_or_a_bad_one_is_out_of_reach() {
        for (state, reason) in [(Availability::Missing, Unused::Missing), (Availability::Bad, Unused::Bad)] {
            let shot = [GOOD, GOOD, state, GOOD, GOOD];
            assert_eq!(reasons(1, 2, &shot)[2..], [(1, Some(reason)), (2, Some(Unused::BrokenChain))]);
            assert_eq!(reasons(0, 3, &shot)[3..], [(1, None), (2, Some(reason)), (3, Some(Unused::BrokenChain))]);
        }
    }

    #[test]
    fn sizes_and_vectors_decide() {
        let still = Availability::Good { columns: 8, rows: 4, vector: false, passes: 0 };
        let other = Availability::Good { columns: 4, rows: 4, vector: true, passes: 0 };
        let stereo = Availability::Good { columns: 8, rows: 4, vector: true, passes: 1 };
        assert_eq!(reasons(0, 1, &[GOOD, stereo])[1], (1, Some(Unused::OtherPasses)));
        assert_eq!(reasons(0, 1, &[still, GOOD])[1], (1, Some(Unused::NoVector)));
        assert_eq!(reasons(0, 2, &[GOOD, still, GOOD])[2..], [(1, None), (2, Some(Unused::BrokenChain))]);
        assert_eq!(reasons(0, 2, &[GOOD, other, GOOD])[2..], [(1, Some(Unused::OtherSize)), (2, Some(Unused::BrokenChain))]);
    }

    #[test]
    fn settings_are_checked() {
        assert!(check_window(3).is_ok() && check_window(4).is_err());
    }
}
