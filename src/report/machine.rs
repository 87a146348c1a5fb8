//! The machine that a report was made on.

use serde::Serialize;

use crate::simd::Isa;

/// What matters for times.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// The processor's name, where the system tells it.
    pub processor: Option<String>,
    /// Threads that the system has.
    pub cores: usize,
    /// Threads that were used.
    pub threads: usize,
    /// The instruction set of the kernels.
    pub instructions: &'static str,
    /// `linux x86_64`.
    pub system: String,
    /// Mean number of running programs in the minute before the measurement and at its end, where the system tells it.
    pub load_before: Option<f64>,
    pub load_after: Option<f64>,
    /// Peak resident bytes of this process, where the system tells it.
    pub peak_bytes: Option<u64>,
}

impl Machine {
    /// Of now, before anything is measured.
    pub fn new(isa: Isa, threads: usize) -> Self {
        let instructions = match isa {
            Isa::Portable => "portable",
            Isa::Neon => "NEON",
            Isa::Avx2 => "AVX2",
            Isa::Avx512 => "AVX-512",
        };
        Self {
            processor: field("/proc/cpuinfo", "model name"),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            threads,
            instructions,
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            load_before: load(),
            load_after: None,
            peak_bytes: None,
        }
    }

    /// Notes how it ended.
    pub fn finish(&mut self) {
        self.load_after = load();
        self.peak_bytes = peak_of("self");
    }

    /// Whether other programs kept the processor busy: `load_before` holds none of this process.
    pub fn was_busy(&self) -> bool {
        let more = |load: Option<f64>, own: usize| load.is_some_and(|l| l > (self.cores + own) as f64 * 0.5);
        more(self.load_before, 0) || more(self.load_after, 2 * self.threads)
    }
}

/// The value behind a name in one of the system's lists.
fn field(path: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    let line = text.lines().find(|l| l.starts_with(name))?;
    line.split_once(':').map(|(_, value)| value.trim().to_owned())
}

/// Peak resident bytes of a process (its number, or `self`), where the system tells.
pub fn peak_of(process: &str) -> Option<u64> {
    let value = field(&format!("/proc/{process}/status"), "VmHWM")?;
    value.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib * 1024)
}

fn load() -> Option<f64> {
    std::fs::read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_busy_machine_is_known_by_its_load() {
        let idle =
            Machine { cores: 4, threads: 4, load_before: Some(0.3), load_after: Some(4.1), ..Machine::new(Isa::Portable, 1) };
        assert!(!idle.was_busy());
        assert!(Machine { load_before: Some(3.0), ..idle.clone() }.was_busy());
        assert!(Machine { load_after: Some(8.0), ..idle.clone() }.was_busy());
        assert!(!Machine { load_before: None, load_after: None, ..idle }.was_busy());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn linux_tells_its_memory() {
        let mut machine = Machine::new(Isa::Portable, 1);
        machine.finish();
        assert!(machine.peak_bytes.is_some_and(|b| b > 1 << 20) && machine.load_after.is_some());
    }
}
