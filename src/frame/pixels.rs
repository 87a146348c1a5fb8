//! Interleaved pixels in memory that is kept for the next frame, and how frames are padded.

use std::ops::{Deref, DerefMut};

use crate::memory::{Buffer, BufferPool};

/// Frames are padded to a multiple of this in both directions: three 2×2 down-samplings.
pub const ALIGNMENT: usize = 8;

/// A run of pixels of `N` floats each.
pub struct Pixels<const N: usize>(Buffer);

impl<const N: usize> Pixels<N> {
    /// `count` pixels whose values are unspecified, in memory from `pool`.
    pub fn unspecified(count: usize, pool: &BufferPool) -> Self {
        let mut buffer = Buffer::in_pool(pool);
        buffer.reset(count * N);
        Self(buffer)
    }
}

impl<const N: usize> Deref for Pixels<N> {
    type Target = [[f32; N]];
    fn deref(&self) -> &Self::Target {
        self.0.as_slice().as_chunks().0
    }
}

impl<const N: usize> DerefMut for Pixels<N> {
    fn deref_mut(&mut self) -> &mut Self::Target {
        self.0.as_mut_slice().as_chunks_mut().0
    }
}
