//! What the allocator keeps of freed memory.

/// Gives free memory back to the system: over thousands of short runs, glibc would keep more and more of it in small pieces.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(super) fn give_memory_back() {
    // SAFETY: it touches only memory that is not in use.
    unsafe { libc::malloc_trim(0) };
}

/// Gives free memory back to the system, which other allocators do by themselves.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(super) fn give_memory_back() {}
