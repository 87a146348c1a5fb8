//! Memory of an engine: large buffers of f32 that are kept for the next frame.
//!
//! A frame takes hundreds of MiB in a few dozen buffers; fresh pages for each would cost a tenth of its time. Each engine has a
//! [`BufferPool`] of its own, which keeps what its buffers leave behind when they are dropped.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use aligned_vec::{AVec, RuntimeAlign};

/// What buffers start on at least, in bytes: a line of the cache.
const CACHE_LINE: usize = 64;
/// Large buffers start on a boundary of this many bytes, and Linux is asked to back them with pages of this size.
const HUGE_PAGE: usize = 2 << 20;
/// Buffers from this many floats on are kept when they are dropped.
const KEPT_FROM: usize = 1 << 18;
/// Buffers up to this many floats are kept (128 MiB): those of very large frames are worth more as free memory.
const KEPT_TO: usize = 32 << 20;
/// Bytes that a pool keeps at most unless told otherwise.
const KEPT_TOTAL: usize = 1 << 30;

type Floats = AVec<f32, RuntimeAlign>;

/// Where buffers take their memory from and leave it when they are dropped. Clones are the same pool.
#[derive(Clone, Debug, Default)]
pub struct BufferPool(Arc<Mutex<Kept>>);

/// The free memory of a pool.
#[derive(Debug)]
struct Kept {
    free: Vec<Floats>,
    /// Bytes of `free` at most.
    limit: usize,
}

impl Default for Kept {
    fn default() -> Self {
        Self { free: Vec::new(), limit: KEPT_TOTAL }
    }
}

impl Kept {
    fn bytes(&self) -> usize {
        self.free.iter().map(|floats| size_of_val(&floats[..])).sum()
    }
}

impl BufferPool {
    /// Keeps at most this many bytes for the next frame from now on.
    pub fn keep_at_most(&self, bytes: usize) {
        Self::with(&self.0, |kept| kept.limit = bytes);
    }

    /// Bytes that are kept for the next frame and not in use.
    pub fn kept_bytes(&self) -> usize {
        Self::with(&self.0, |kept| kept.bytes())
    }

    /// Gives the memory that is kept for the next frame back to the system.
    pub fn release(&self) {
        // Freed after the lock is gone: giving hundreds of MiB back takes a while.
        drop(Self::with(&self.0, |kept| std::mem::take(&mut kept.free)));
    }

    fn with<T>(kept: &Mutex<Kept>, change: impl FnOnce(&mut Kept) -> T) -> T {
        change(&mut kept.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// A run of floats on a 64-byte boundary that grows and never shrinks.
///
/// Its memory comes from a pool, where it has one, and goes back there when it is dropped, if the pool is still there.
pub struct Buffer {
    /// As long as it was ever asked to be.
    floats: Floats,
    len: usize,
    pool: Weak<Mutex<Kept>>,
}

impl Buffer {
    /// No floats and no pool.
    pub fn empty() -> Self {
        Self::of(Weak::new())
    }

    /// No floats yet; memory from and to `pool`.
    pub fn in_pool(pool: &BufferPool) -> Self {
        Self::of(Arc::downgrade(&pool.0))
    }

    /// No floats yet; memory from and to this one's pool.
    pub fn same_pool(&self) -> Self {
        Self::of(self.pool.clone())
    }

    fn of(pool: Weak<Mutex<Kept>>) -> Self {
        Self { floats: Floats::new(CACHE_LINE), len: 0, pool }
    }

    /// `len` zeros without a pool.
    pub fn zeroed(len: usize) -> Self {
        let mut buffer = Self::empty();
        buffer.reset(len);
        buffer
    }

    /// Makes it `len` floats long; what they hold is unspecified.
    pub fn reset(&mut self, len: usize) {
        if len > self.floats.len() {
            let pool = self.pool.upgrade();
            // What it has is given back first: at no time are both there.
            self.give_back();
            self.floats = pool.and_then(|pool| taken(&pool, len)).unwrap_or_else(|| fresh(len));
        }
        self.len = len;
    }

    /// The floats.
    pub fn as_slice(&self) -> &[f32] {
        &self.floats[..self.len]
    }

    /// The floats for writing.
    pub fn as_mut_slice(&mut self) -> &mut [f32] {
        &mut self.floats[..self.len]
    }

    fn give_back(&mut self) {
        let floats = std::mem::replace(&mut self.floats, Floats::new(CACHE_LINE));
        let Some(pool) = self.pool.upgrade().filter(|_| (KEPT_FROM..=KEPT_TO).contains(&floats.len())) else { return };
        BufferPool::with(&pool, |kept| {
            if kept.bytes() + size_of_val(&floats[..]) <= kept.limit {
                kept.free.push(floats);
            }
        });
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        self.give_back();
    }
}

impl Clone for Buffer {
    fn clone(&self) -> Self {
        let mut copy = self.same_pool();
        copy.reset(self.len);
        copy.as_mut_slice().copy_from_slice(self.as_slice());
        copy
    }
}

/// The tightest memory of a pool that holds `len` floats and is not twice too large.
fn taken(pool: &Mutex<Kept>, len: usize) -> Option<Floats> {
    if len < KEPT_FROM {
        return None;
    }
    BufferPool::with(pool, |kept| {
        let fits = kept.free.iter().enumerate().filter(|(_, floats)| floats.len() >= len && floats.len() / 2 <= len);
        let (best, _) = fits.min_by_key(|(_, floats)| floats.len())?;
        Some(kept.free.swap_remove(best))
    })
}

/// `len` zeros in memory of their own.
fn fresh(len: usize) -> Floats {
    let huge = len >= 2 * HUGE_PAGE / size_of::<f32>();
    let mut floats = Floats::with_capacity(if huge { HUGE_PAGE } else { CACHE_LINE }, len);
    #[cfg(target_os = "linux")]
    if huge {
        let whole_pages = len * size_of::<f32>() / HUGE_PAGE * HUGE_PAGE;
        // SAFETY: the range was just allocated and lies within the capacity; the advice changes how its pages are backed, not what
        // they hold, and a refusal changes nothing.
        let _ = unsafe { rustix::mm::madvise(floats.as_mut_ptr().cast(), whole_pages, rustix::mm::Advice::LinuxHugepage) };
    }
    floats.resize(len, 0.0);
    floats
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(pool: &BufferPool, len: usize) -> Buffer {
        let mut buffer = Buffer::in_pool(pool);
        buffer.reset(len);
        buffer
    }

    #[test]
    fn a_dropped_buffer_serves_the_next_one_of_about_its_size() {
        let pool = BufferPool::default();
        let first = of(&pool, 3 * KEPT_FROM);
        let start = first.as_slice().as_ptr();
        assert_eq!(pool.kept_bytes(), 0);
        drop(first);
        assert_eq!(pool.kept_bytes(), 12 * KEPT_FROM);
        let small = of(&pool, KEPT_FROM);
        assert_ne!(small.as_slice().as_ptr(), start, "it is more than twice too large");
        assert_eq!(of(&pool, 2 * KEPT_FROM).as_slice().as_ptr(), start);
        pool.release();
        assert_eq!(pool.kept_bytes(), 0);
    }

    #[test]
    fn pools_share_nothing() {
        let (one, other) = (BufferPool::default(), BufferPool::default());
        drop(of(&one, KEPT_FROM));
        drop(of(&other, KEPT_FROM / 2));
        assert_eq!((one.kept_bytes(), other.kept_bytes()), (4 * KEPT_FROM, 0));
        other.release();
        assert_eq!(one.clone().kept_bytes(), 4 * KEPT_FROM);
    }

    #[test]
    fn only_so_much_is_kept_and_nothing_without_the_pool() {
        let pool = BufferPool::default();
        pool.keep_at_most(8 * KEPT_FROM);
        let buffers = [of(&pool, KEPT_FROM), of(&pool, KEPT_FROM), of(&pool, KEPT_FROM)];
        drop(buffers);
        assert_eq!(pool.kept_bytes(), 8 * KEPT_FROM);
        let outlives = of(&pool, KEPT_FROM);
        drop(pool);
        assert_eq!(outlives.clone().as_slice(), outlives.as_slice());
    }

    #[test]
    fn buffers_are_aligned_grow_and_start_at_zero() {
        for len in [0, 1, 100, 2 * HUGE_PAGE / 4, 3 * HUGE_PAGE / 4 + 5] {
            let mut buffer = Buffer::zeroed(len);
            assert!(buffer.as_slice().iter().all(|v| *v == 0.0));
            assert_eq!((buffer.as_slice().len(), buffer.as_slice().as_ptr() as usize % CACHE_LINE), (len, 0));
            let start = buffer.as_slice().as_ptr();
            buffer.reset(len / 2);
            buffer.reset(len);
            assert_eq!(buffer.as_mut_slice().as_ptr(), start);
        }
    }
}
