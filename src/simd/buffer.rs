//! Memory for f32 on 64-byte boundaries that grows and never shrinks.

use std::alloc::{Layout, alloc_zeroed, dealloc, handle_alloc_error};
use std::ptr::NonNull;

/// `len` floats on a 64-byte boundary; fresh memory is zero.
pub(super) struct Buffer {
    start: NonNull<f32>,
    len: usize,
    capacity: usize,
}

// SAFETY: the buffer owns plain floats; sharing and sending follow the borrow rules of &self and &mut self.
unsafe impl Send for Buffer {}
// SAFETY: as above.
unsafe impl Sync for Buffer {}

impl Buffer {
    pub const fn empty() -> Self {
        Self { start: NonNull::dangling(), len: 0, capacity: 0 }
    }

    pub fn zeroed(len: usize) -> Self {
        let mut buffer = Self::empty();
        buffer.reset(len);
        buffer
    }

    /// Makes it `len` floats long. What they hold is unspecified where the memory is reused, zero where it is fresh.
    pub fn reset(&mut self, len: usize) {
        if len > self.capacity {
            *self = Self::empty();
            let layout = Self::layout(len);
            // SAFETY: len > capacity ≥ 0, so the layout is not empty.
            let memory = unsafe { alloc_zeroed(layout) };
            self.start = NonNull::new(memory.cast()).unwrap_or_else(|| handle_alloc_error(layout));
            self.capacity = len;
        }
        self.len = len;
    }

    pub fn as_slice(&self) -> &[f32] {
        // SAFETY: `len` ≤ `capacity` initialised floats, or none behind the dangling, aligned pointer.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.len) }
    }

    pub fn as_mut_slice(&mut self) -> &mut [f32] {
        // SAFETY: as in `as_slice`, and &mut self makes it the only borrow.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr(), self.len) }
    }

    fn layout(len: usize) -> Layout {
        Layout::array::<f32>(len).and_then(|layout| layout.align_to(64)).expect("an image of more bytes than can be addressed")
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        if self.capacity > 0 {
            // SAFETY: allocated in `reset` with this very layout.
            unsafe { dealloc(self.start.as_ptr().cast(), Self::layout(self.capacity)) }
        }
    }
}

impl Clone for Buffer {
    fn clone(&self) -> Self {
        let mut copy = Self::zeroed(self.len);
        copy.as_mut_slice().copy_from_slice(self.as_slice());
        copy
    }
}
