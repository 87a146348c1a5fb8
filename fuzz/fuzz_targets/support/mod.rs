//! How a target runs its check.

use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{LazyLock, Mutex};
use std::time::Duration;

use cpu_time::ProcessTime;
use hush_fuzz::Check;

/// Processor time that an input may take. libFuzzer's own limit is one of wall time, for those that never return.
const MOST_TIME: Duration = Duration::from_secs(10);

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

/// Runs the check; ends the process where it panics or takes too long.
pub fn run(check: Check, bytes: &[u8]) {
    let started = ProcessTime::now();
    let result = catch_unwind(AssertUnwindSafe(|| check(&FOLDER, bytes)));
    let taken = started.elapsed();
    if result.is_err() || taken > MOST_TIME {
        eprintln!("{taken:?}; {}", LAST_PANIC.lock().map(|last| last.clone()).unwrap_or_default());
        std::process::abort();
    }
}
