//! How a target runs its check.

use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{LazyLock, Mutex};

use hush_fuzz::Check;

/// A folder in memory, for the files that are read.
static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let memory = if cfg!(target_os = "linux") { PathBuf::from("/dev/shm") } else { std::env::temp_dir() };
    tempfile::Builder::new().prefix("hush-fuzz").tempdir_in(memory).expect("a folder can be made").keep()
});
static LAST_PANIC: Mutex<String> = Mutex::new(String::new());

/// A panic that is caught inside Hush, where the library that reads EXR or USD breaks down, is no finding. One that gets out is.
pub fn start() {
    panic::set_hook(Box::new(|info| {
        if let Ok(mut last) = LAST_PANIC.lock() {
            *last = info.to_string();
        }
    }));
    // One thread, and this one: runs repeat.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
    pool.build_global().expect("there is no other pool yet");
}

/// Runs the check; ends the process where it panics.
pub fn run(check: Check, bytes: &[u8]) {
    if catch_unwind(AssertUnwindSafe(|| check(&FOLDER, bytes))).is_err() {
        eprintln!("{}", LAST_PANIC.lock().map(|last| last.clone()).unwrap_or_default());
        std::process::abort();
    }
}
