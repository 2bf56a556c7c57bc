//! How much memory the machine has and this process uses, as far as the system tells.

/// Bytes of memory this process may expect to have: that of the machine, or of its control group if that is
/// less. `None` where the system does not say (anything but Linux).
pub fn machine_bytes() -> Option<u64> {
    let machine = kibibytes(&std::fs::read_to_string("/proc/meminfo").ok()?, "MemTotal:")?;
    let group = [
        "/sys/fs/cgroup/memory.max",
        "/sys/fs/cgroup/memory/memory.limit_in_bytes",
    ]
    .iter()
    .filter_map(|path| std::fs::read_to_string(path).ok()?.trim().parse().ok())
    .min();
    Some(group.map_or(machine, |group: u64| group.min(machine)))
}

/// What may be used where the user does not say: a quarter of the machine, or 2 GiB where that is unknown.
pub fn default_limit_bytes() -> u64 {
    machine_bytes().map_or(2 << 30, |bytes| bytes / 4)
}

/// Largest resident set of this process so far, mapped files included, in bytes.
pub fn peak_resident_bytes() -> Option<u64> {
    status("VmHWM:")
}

/// Resident memory of this process that no file backs, in bytes.
pub fn anonymous_bytes() -> Option<u64> {
    status("RssAnon:")
}

fn status(key: &str) -> Option<u64> {
    kibibytes(&std::fs::read_to_string("/proc/self/status").ok()?, key)
}

/// The value of a line "key  number kB".
fn kibibytes(text: &str, key: &str) -> Option<u64> {
    let value = text.lines().find_map(|line| line.strip_prefix(key))?;
    value
        .trim()
        .strip_suffix("kB")?
        .trim()
        .parse::<u64>()
        .ok()?
        .checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_proc_are_read() {
        assert_eq!(kibibytes("A: 1 kB\nVmHWM:\t  2048 kB\n", "VmHWM:"), Some(2 << 20));
        assert_eq!(kibibytes("VmHWM: many kB\n", "VmHWM:"), None);
        assert_eq!(kibibytes("", "VmHWM:"), None);
        assert!(default_limit_bytes() > 0);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn linux_tells() {
        assert!(machine_bytes().unwrap() > 1 << 20);
        assert!(peak_resident_bytes().unwrap() >= anonymous_bytes().unwrap());
    }
}
