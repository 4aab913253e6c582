//! Busy loops that run next to a measurement.

use std::io;
use std::process::{Child, Command, Stdio};

use hil_session::realtime::pin;

/// Variable that makes a bench's program a busy loop: its nice value, core and session.
const BURN: &str = "HIL_BENCH_BURN";

/// A process that occupies a whole core until it is dropped.
pub(crate) struct BusyLoop(Child);

impl BusyLoop {
    /// Starts a busy loop with this nice value, on this core if one is named, in a session of its own if `elsewhere`.
    pub(crate) fn start(nice: i32, core: Option<usize>, elsewhere: bool) -> io::Result<Self> {
        let core = core.map_or("-".into(), |core| core.to_string());
        let child = Command::new(std::env::current_exe()?)
            .env(BURN, format!("{nice} {core} {elsewhere}"))
            .stdin(Stdio::null())
            .spawn();
        child.map(Self)
    }
}

impl Drop for BusyLoop {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Computes until the bench ends, if this process was started as a busy loop, and then returns true.
pub(crate) fn burned() -> bool {
    let Ok(asked) = std::env::var(BURN) else {
        return false;
    };
    let mut words = asked.split(' ');
    let mut next = || words.next().expect("three words");
    let nice = next().parse().expect("a nice value");
    rustix::process::nice(nice).expect("less is always allowed");
    if let Ok(core) = next().parse() {
        pin(core).expect("a core");
    }
    if next() == "true" {
        rustix::process::setsid().expect("no leader of a group");
    }
    let parent = rustix::process::getppid();
    let mut count = 0_u64;
    loop {
        count = std::hint::black_box(count + 1);
        if count.is_multiple_of(1 << 26) && rustix::process::getppid() != parent {
            return true;
        }
    }
}
