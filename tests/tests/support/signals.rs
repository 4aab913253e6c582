//! Signals that the test process was started to ignore.

use std::sync::{Arc, Once};

use rustix::process::Signal;

/// Starts programs with the default action of signals that this process was started to ignore, for example by
/// `nohup`: a handler is not inherited.
pub(crate) fn set_default_signals() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let status = std::fs::read_to_string("/proc/self/status").expect("own status");
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        let mask = u64::from_str_radix(mask.expect("a mask").trim(), 16).expect("a number");
        for signal in [Signal::HUP, Signal::INT, Signal::QUIT, Signal::TSTP] {
            if mask >> (signal.as_raw() - 1) & 1 == 1 {
                signal_hook::flag::register(signal.as_raw(), Arc::default()).expect("a handler");
            }
        }
    });
}
