//! Medians, spreads and the Pareto front.

use serde::Serialize;

/// Where some numbers lie.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// The middle one; between the middle two of an even count.
    pub median: f64,
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
    /// The mean.
    pub mean: f64,
}

impl Spread {
    /// From the least to the greatest; None for no numbers.
    pub fn range(values: &[f64]) -> Option<Self> {
        Self::between(values, 0.0)
    }

    /// From the lower to the upper quartile; None for no numbers.
    pub fn quartiles(values: &[f64]) -> Option<Self> {
        Self::between(values, 0.25)
    }

    fn between(values: &[f64], share: f64) -> Option<Self> {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        if sorted.is_empty() {
            return None;
        }
        sorted.sort_by(f64::total_cmp);
        let mean = sorted.iter().sum::<f64>() / sorted.len() as f64;
        Some(Self { median: quantile(&sorted, 0.5), low: quantile(&sorted, share), high: quantile(&sorted, 1.0 - share), mean })
    }
}

/// Of ascending numbers, at least one; straight lines between them.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = share * (sorted.len() - 1) as f64;
    let (below, above) = (at.floor() as usize, at.ceil() as usize);
    sorted[below] + (at - at.floor()) * (sorted[above] - sorted[below])
}

/// Which points no other one beats: none is at most as slow and at most as wrong, and better in one of the two. A point
/// without numbers is on no front.
pub fn pareto(points: &[Option<(f64, f64)>]) -> Vec<bool> {
    let beats = |a: (f64, f64), b: (f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    let beaten = |p: (f64, f64)| points.iter().flatten().any(|other| beats(*other, p));
    points.iter().map(|p| p.is_some_and(|p| !beaten(p))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_known_by_hand() {
        let five = [5.0, 1.0, 4.0, 2.0, 3.0];
        assert_eq!(Spread::range(&five), Some(Spread { median: 3.0, low: 1.0, high: 5.0, mean: 3.0 }));
        assert_eq!(Spread::quartiles(&five), Some(Spread { median: 3.0, low: 2.0, high: 4.0, mean: 3.0 }));
        assert_eq!(Spread::range(&[1.0, 4.0]).map(|s| s.median), Some(2.5));
        assert_eq!(Spread::range(&[7.0, f64::NAN]), Some(Spread { median: 7.0, low: 7.0, high: 7.0, mean: 7.0 }));
        assert_eq!(Spread::quartiles(&[f64::INFINITY]), None);
    }

    #[test]
    fn the_front_holds_what_nothing_beats() {
        let points =
            [Some((1.0, 9.0)), Some((2.0, 5.0)), Some((2.0, 6.0)), None, Some((3.0, 5.0)), Some((4.0, 1.0)), Some((1.0, 9.0))];
        assert_eq!(pareto(&points), [true, true, false, false, false, true, true]);
        assert_eq!(pareto(&[]), Vec::<bool>::new());
    }
}
