//! Company for a run: programs that compute beside it.

use std::process::{Child, Command};

/// A process that wants a whole core.
pub(crate) struct BusyLoop(Child);

impl BusyLoop {
    pub(crate) fn on_core(core: u32) -> Self {
        let mut shell = Command::new("taskset");
        shell.args(["-c", &core.to_string(), "sh", "-c", "while :; do :; done"]);
        Self(shell.spawn().expect("taskset can be run"))
    }
}

impl Drop for BusyLoop {
    fn drop(&mut self) {
        // It never ends by itself.
        self.0.kill().expect("it is our child");
        self.0.wait().expect("it is our child");
    }
}
