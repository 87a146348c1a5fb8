//! Which machine this is, and whether a process of it is still there.

/// The machine's name, and a key that differs between machines, their restarts, and containers with process numbers of their own.
pub(super) fn host() -> (String, String) {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default().trim().to_string();
    let link = |path: &str| std::fs::read_link(path).map(|p| p.to_string_lossy().into_owned()).unwrap_or_default();
    let mut name = read("/proc/sys/kernel/hostname");
    if name.is_empty() {
        name = ["HOSTNAME", "COMPUTERNAME"].iter().find_map(|v| std::env::var(v).ok()).unwrap_or_default();
    }
    let key = format!("{name} {} {}", read("/proc/sys/kernel/random/boot_id"), link("/proc/self/ns/pid"));
    (name, key)
}

/// Whether a process of this machine is certainly not there.
#[cfg(target_os = "linux")]
pub(super) fn is_gone(pid: u32) -> bool {
    use rustix::process::{Pid, test_kill_process};
    let Some(known) = i32::try_from(pid).ok().and_then(Pid::from_raw) else { return false };
    match test_kill_process(known) {
        Ok(()) => {
            // A process that was killed stays listed until its parent takes notice.
            let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            stat.rsplit(')').next().is_some_and(|rest| rest.trim_start().starts_with('Z'))
        }
        Err(error) => error == rustix::io::Errno::SRCH,
    }
}

/// Whether a process of this machine is certainly not there; without a key for the machine nothing is certain.
#[cfg(not(target_os = "linux"))]
pub(super) fn is_gone(_: u32) -> bool {
    false
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_ended_is_gone() {
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        assert!(!is_gone(child.id()) && !is_gone(std::process::id()));
        child.kill().unwrap();
        let began = std::time::Instant::now();
        while !is_gone(child.id()) {
            assert!(began.elapsed().as_secs() < 10, "killed, though nobody has waited for it");
        }
        child.wait().unwrap();
        assert!(is_gone(child.id()));
        assert_eq!(host(), host());
    }
}
