//! Kernel application: predicted logits to weights, weights to pixels, on a pyramid of up to four levels.

pub mod keys;
pub mod planes;
pub mod pyramid;
pub mod weigh;

use std::ops::Range;

use crate::frame::packed::{INVALID, MODULATION};

/// The 2×2 pixels of a half-resolution pixel, each a plane of its own at full resolution.
pub const FULL_PHASES: usize = 4;

/// Which channel of a level's planes is which: values (colour 3, then alpha and AOVs), the mask, the key, and the modulation: at full
/// resolution, and at the coarser levels where the albedo is filtered there too. A denoised level's modulation has a mask of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Channels {
    /// Channels that the kernels filter.
    pub values: usize,
    /// Whether the first value after the colour is alpha.
    pub alpha: bool,
    /// Extra channels of the packed frame that are not filtered, before those that are: an alpha of 1.
    pub skipped: usize,
    /// Whether there is an alpha that is filtered by the modulation's kernels, as it falls off with a pixel's coverage where the albedo does
    /// and the light that is divided by it does not.
    pub alpha_as_modulation: bool,
    /// Whether the coarser levels have the modulation.
    pub coarse_modulation: bool,
}

impl Channels {
    /// For a frame with `extra` channels besides its colour, the first of them alpha or not.
    pub fn new(extra: usize, alpha: bool) -> Self {
        Self { values: 3 + extra, alpha, skipped: 0, alpha_as_modulation: false, coarse_modulation: false }
    }

    /// Without alpha, if there is one.
    pub fn opaque(self) -> Self {
        let alpha = usize::from(self.alpha);
        Self { values: self.values - alpha, alpha: false, alpha_as_modulation: false, skipped: self.skipped + alpha, ..self }
    }

    /// The values that the light's kernels filter, in two parts.
    pub fn light(&self) -> [Range<usize>; 2] {
        if self.alpha_as_modulation { [0..3, 4..self.values] } else { [0..self.values, self.values..self.values] }
    }

    /// What the modulation's kernels filter: the modulation, and alpha where it is among that.
    pub fn modulated(&self) -> [Range<usize>; 2] {
        let alpha = usize::from(self.alpha_as_modulation);
        [self.modulation()..self.modulation() + 3, 3..3 + alpha]
    }

    /// Groups of a packed frame that hold these channels.
    pub fn groups(&self) -> usize {
        match self.values {
            3 => 1,
            values => 1 + (values - 3 + self.skipped).div_ceil(8),
        }
    }

    /// The channel that is 1 where a pixel may be used.
    pub fn mask(&self) -> usize {
        self.values
    }

    /// The channel that logits may depend on, tap by tap: the log of the light.
    pub fn key(&self) -> usize {
        self.values + 1
    }

    /// The first of three modulation channels.
    pub fn modulation(&self) -> usize {
        self.values + 2
    }

    /// The channel of a denoised level that is 1 where its modulation may be used.
    pub fn modulation_mask(&self) -> usize {
        self.values + 5
    }

    /// Channels at full resolution.
    pub fn full(&self) -> usize {
        self.values + 5
    }

    /// Channels at the coarser levels.
    pub fn coarse(&self) -> usize {
        self.values + if self.coarse_modulation { 5 } else { 2 }
    }

    /// Channels of a denoised coarser level: the values and the mask, and what is there of the modulation.
    pub fn denoised(&self) -> usize {
        self.values + if self.coarse_modulation { 6 } else { 1 }
    }

    /// The channels that down-sampling averages.
    pub fn averaged(&self) -> impl Iterator<Item = usize> + use<> {
        let modulation = if self.coarse_modulation { self.modulation()..self.modulation() + 3 } else { 0..0 };
        (0..self.values).chain(modulation)
    }

    /// The modulation channel, 0 to 2, that a value is multiplied by at the end; none for alpha.
    pub fn modulated_by(&self, channel: usize) -> Option<usize> {
        let alpha = usize::from(self.alpha);
        if channel < 3 {
            Some(channel)
        } else if channel < 3 + alpha {
            None
        } else {
            Some((channel - 3 - alpha) % 3)
        }
    }

    /// The channels at full resolution that a packed frame holds: all but the key.
    pub fn packed(&self) -> impl Iterator<Item = usize> + use<> {
        let key = self.key();
        (0..self.full()).filter(move |channel| *channel != key)
    }

    /// The group and lane of a packed frame that one of the [`packed`](Self::packed) channels comes from.
    pub fn source(&self, channel: usize) -> (usize, usize) {
        if channel < 3 {
            (0, channel)
        } else if channel == self.mask() {
            (0, INVALID)
        } else if channel > self.mask() {
            (0, MODULATION + channel - self.modulation())
        } else {
            let extra = channel - 3 + self.skipped;
            (1 + extra / 8, extra % 8)
        }
    }
}
