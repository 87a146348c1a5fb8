//! Memory for f32 on 64-byte boundaries that grows and never shrinks, and is kept for the next frame.
//!
//! A frame takes hundreds of MiB in a few dozen buffers; fresh pages for each would cost a tenth of its time.

use std::alloc::{Layout, alloc, dealloc, handle_alloc_error};
use std::ptr::NonNull;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Large buffers start on a boundary of this many bytes, and Linux is asked to back them with pages of this size.
const HUGE_PAGE: usize = 2 << 20;
/// Buffers from this many floats on are kept when they are dropped.
const KEPT_FROM: usize = 1 << 18;
/// Buffers up to this many floats are kept (128 MiB): those of very large frames are worth more as free memory.
const KEPT_TO: usize = 32 << 20;

/// At most this many floats are kept.
static KEPT_TOTAL: AtomicUsize = AtomicUsize::new(256 << 20);
static KEPT: Mutex<Vec<Buffer>> = Mutex::new(Vec::new());

/// Keeps at most this many bytes for the next frame from now on.
pub fn keep_at_most(bytes: usize) {
    KEPT_TOTAL.store(bytes / size_of::<f32>(), Ordering::Relaxed);
}

/// Gives the memory that is kept for the next frame back to the system.
pub fn release_memory() {
    let kept = std::mem::take(&mut *KEPT.lock().unwrap_or_else(PoisonError::into_inner));
    kept.into_iter().for_each(Buffer::free);
}

/// `len` floats on a 64-byte boundary.
pub(crate) struct Buffer {
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
        if !buffer.grow(len) {
            buffer.as_mut_slice().fill(0.0);
        }
        buffer
    }

    /// Makes it `len` floats long; what they hold is unspecified.
    pub fn reset(&mut self, len: usize) {
        self.grow(len);
    }

    /// Makes it `len` floats long. Whether the memory is fresh, and so zero.
    fn grow(&mut self, len: usize) -> bool {
        if len <= self.capacity {
            self.len = len;
            return false;
        }
        *self = Self::empty();
        if let Some(kept) = Self::kept(len) {
            *self = kept;
            self.len = len;
            return false;
        }
        let layout = Self::layout(len);
        // SAFETY: len > capacity ≥ 0, so the layout is not empty.
        let memory = unsafe { alloc(layout) };
        self.start = NonNull::new(memory.cast()).unwrap_or_else(|| handle_alloc_error(layout));
        #[cfg(target_os = "linux")]
        if layout.align() == HUGE_PAGE {
            // SAFETY: advice about memory that was just allocated, whole pages of it; where the kernel refuses, nothing changes.
            unsafe { libc::madvise(memory.cast(), layout.size() / HUGE_PAGE * HUGE_PAGE, libc::MADV_HUGEPAGE) };
        }
        // SAFETY: `len` floats were allocated, and zero bytes are zero floats.
        unsafe { self.start.as_ptr().write_bytes(0, len) };
        (self.capacity, self.len) = (len, len);
        true
    }

    /// The tightest kept buffer that holds `len` floats and is not twice too large.
    fn kept(len: usize) -> Option<Self> {
        if len < KEPT_FROM {
            return None;
        }
        let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = kept.iter().enumerate().filter(|(_, b)| b.capacity >= len && b.capacity / 2 <= len);
        let (best, _) = fits.min_by_key(|(_, b)| b.capacity)?;
        Some(kept.swap_remove(best))
    }

    fn free(self) {
        let buffer = std::mem::ManuallyDrop::new(self);
        if buffer.capacity > 0 {
            // SAFETY: allocated in `grow` with this very layout, and not dropped again.
            unsafe { dealloc(buffer.start.as_ptr().cast(), Self::layout(buffer.capacity)) }
        }
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
        let align = if len >= 2 * HUGE_PAGE / size_of::<f32>() { HUGE_PAGE } else { 64 };
        Layout::array::<f32>(len).and_then(|layout| layout.align_to(align)).expect("an image of more bytes than can be addressed")
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        let buffer = std::mem::replace(self, Self::empty());
        if (KEPT_FROM..=KEPT_TO).contains(&buffer.capacity) {
            let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
            if kept.iter().map(|b| b.capacity).sum::<usize>() + buffer.capacity <= KEPT_TOTAL.load(Ordering::Relaxed) {
                kept.push(buffer);
                return;
            }
        }
        buffer.free();
    }
}

impl Clone for Buffer {
    fn clone(&self) -> Self {
        let mut copy = Self::zeroed(self.len);
        copy.as_mut_slice().copy_from_slice(self.as_slice());
        copy
    }
}
