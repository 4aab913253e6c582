//! Contention for a run: processes that a test starts beside it.

use std::ops::{Deref, DerefMut};
use std::process::{Child, Command};

/// Process that does not outlive its test.
pub(crate) struct Companion(Child);

impl Companion {
    pub(crate) fn start(command: &mut Command) -> Self {
        let child = command.spawn();
        Self(child.unwrap_or_else(|error| panic!("{command:?}: {error}")))
    }
}

impl Deref for Companion {
    type Target = Child;

    fn deref(&self) -> &Child {
        &self.0
    }
}

impl DerefMut for Companion {
    fn deref_mut(&mut self) -> &mut Child {
        &mut self.0
    }
}

impl Drop for Companion {
    fn drop(&mut self) {
        let _ = self.0.kill(); // it may have ended by itself
        let _ = self.0.wait();
    }
}

/// Starts a process that occupies a whole core.
pub(crate) fn busy_loop(core: u32) -> Companion {
    let mut shell = Command::new("taskset");
    shell.args(["-c", &core.to_string(), "sh", "-c", "while :; do :; done"]);
    Companion::start(&mut shell)
}
