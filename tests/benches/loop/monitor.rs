//! Costs of `hil monitor` for the run that it watches.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::experiment::scenario_file;
use crate::programs::Programs;
use crate::pseudo_terminal::open_terminal;
use crate::watched::{Comparison, until};

/// Prints the effect of a monitor.
pub(crate) fn compare(programs: &Programs) {
    let scenario = scenario_file();
    let comparison = Comparison {
        hil: &programs.hil,
        arguments: &[scenario.to_str().expect("a path in UTF-8")],
        title: "severe-leakage.toml alone and with `hil monitor` in a terminal of 80 x 24",
        bench: "loop/monitor",
    };
    comparison.print(|session| Monitor::drawn(&programs.hil, session));
}

/// A monitor in a terminal, which ends when it is dropped.
struct Monitor(Child);

impl Monitor {
    /// Starts a monitor, and waits until it has drawn the held run.
    fn drawn(hil: &Path, session: &str) -> Self {
        let (holder, line) = open_terminal(80, 24);
        let end = || Stdio::from(line.try_clone().expect("another handle"));
        let monitor = Command::new(hil)
            .args(["monitor", "--session", session])
            .env("TERM", "xterm-256color")
            .env("LC_ALL", "C.UTF-8")
            .stdin(end())
            .stdout(end())
            .stderr(end())
            .spawn()
            .expect("hil");
        let is_there = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&is_there);
        std::thread::spawn(move || {
            let mut screen = File::from(holder);
            let (mut bytes, mut seen) = ([0; 4096], Vec::new());
            // Reads on to the end: a full terminal would hold the monitor up.
            while let Ok(count @ 1..) = screen.read(&mut bytes) {
                if !told.load(Ordering::Relaxed) {
                    seen.extend_from_slice(&bytes[..count]);
                    let is_drawn = seen.windows(6).any(|word| word == b"PAUSED");
                    told.store(is_drawn, Ordering::Relaxed);
                }
            }
        });
        until("the monitor is there", || is_there.load(Ordering::Relaxed));
        Self(monitor)
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        self.0.kill().expect("it stays until a key");
        self.0.wait().expect("our child");
    }
}
