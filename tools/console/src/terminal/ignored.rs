//! Signals that this process inherited as ignored, such as SIGHUP under `nohup`: installing a handler would undo
//! that.

use std::sync::LazyLock;

/// Bits of the ignored signals; bit 0 is signal 1.
static IGNORED: LazyLock<u64> = LazyLock::new(|| {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    ignored_in(&status)
});

/// Returns `true` if this process was started with the signal ignored. Must be called before any handler is
/// registered.
pub fn is_ignored(signal: i32) -> bool {
    let bit = u32::try_from(signal - 1).ok();
    bit.and_then(|bit| IGNORED.checked_shr(bit)).unwrap_or(0) & 1 == 1
}

fn ignored_in(status: &str) -> u64 {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.unwrap_or(0) // none is known
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignored_signals_are_parsed_from_the_process_status() {
        let status = "Name:\thil\nSigBlk:\t00000000000000ff\nSigIgn:\t0000000000001003\n";
        assert_eq!(ignored_in(status), 1 << 12 | 1 << 1 | 1);
        assert_eq!(ignored_in("Name:\thil\n"), 0);
        // Rust's runtime ignores SIGPIPE; SIGKILL cannot be ignored.
        assert!(is_ignored(13) && !is_ignored(9) && !is_ignored(0) && !is_ignored(70));
    }
}
