//! The machine that a run's controller was on, where that was another.

use std::fmt;

use serde::Serialize;
use shared_types::text;

use crate::programs::binaries::Binary;

/// A target, by what its agent found.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Target {
    /// Target as it was named.
    name: String,
    /// Name of the host, as it calls itself.
    host: String,
    /// Type of the machine, as `uname -m` has it.
    machine: String,
    kernel: String,
    boot_id: String,
    cores: u32,
}

impl Target {
    /// The target of a controller, if it has one.
    pub(crate) fn of(controller: &Binary) -> Option<Self> {
        let at = controller.at.as_ref()?;
        let findings = at.findings().clone();
        Some(Self {
            name: at.target().to_string(),
            host: findings.host,
            machine: findings.machine,
            kernel: findings.kernel,
            boot_id: findings.boot_id,
            cores: findings.cores,
        })
    }

    /// The target of a recorded run, if it had one.
    pub(crate) fn recorded<'a>(fact: impl Fn(&str) -> Option<&'a str>) -> Option<Self> {
        let known = |name: &str| text::line(fact(name).unwrap_or_default());
        Some(Self {
            name: text::line(fact("target")?),
            host: known("target_host"),
            machine: known("target_machine"),
            kernel: known("target_kernel"),
            boot_id: known("target_boot_id"),
            cores: known("target_cores").parse().unwrap_or(0),
        })
    }

    /// Facts for the recording, by their names.
    pub(crate) fn facts(&self) -> [(&'static str, String); 6] {
        [
            ("target", self.name.clone()),
            ("target_host", self.host.clone()),
            ("target_machine", self.machine.clone()),
            ("target_kernel", self.kernel.clone()),
            ("target_boot_id", self.boot_id.clone()),
            ("target_cores", self.cores.to_string()),
        ]
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name,
            host,
            machine,
            kernel,
            ..
        } = self;
        let kernel = kernel.split(' ').next().unwrap_or_default();
        write!(
            f,
            "controller on target {name}: host {host}, {machine}, kernel {kernel}"
        )
    }
}
