//! Machine that ran a run's controller, if another.

use std::fmt;

use serde::Serialize;
use shared_types::text;

use crate::programs::binaries::Binary;
use crate::programs::binaries::beside_desk::BesideDesk;

/// Target, from the findings of its agent.
#[derive(Clone, Debug, Serialize)]
pub struct Target {
    /// Name of the target as typed.
    name: String,
    /// Host name of the machine.
    host: String,
    /// Machine type as reported by `uname -m`.
    machine: String,
    kernel: String,
    boot_id: String,
    cores: u32,
    /// Hash of the agent's file.
    agent_blake3: String,
    /// Highest real-time priority available to the agent.
    most_priority: u32,
    /// Free bytes in the target's `/dev/shm` before the run; null if unknown.
    free_bytes: Option<u64>,
    /// `true` if another build of the controller ran there, and both builds are known to have the same commit and lock
    /// file; null if the file was the same or if this cannot be determined.
    same_source: Option<bool>,
    /// Number of times that the target's output was switched to the safe command because samples were missing, as far
    /// as the desk received reports; null if only the recording is available, where each switch is a mark.
    pub safe_switches: Option<u32>,
}

impl Target {
    /// Returns the target of a controller, if it has one.
    pub fn of(controller: &Binary) -> Option<Self> {
        let at = controller.at.as_ref()?;
        let findings = at.findings().clone();
        Some(Self {
            name: at.target().to_string(),
            host: findings.host,
            machine: findings.machine,
            kernel: findings.kernel,
            boot_id: findings.boot_id,
            cores: findings.cores,
            agent_blake3: findings.agent_blake3,
            most_priority: findings.most_priority,
            free_bytes: findings.free_bytes,
            same_source: controller
                .beside_desk
                .as_ref()
                .and_then(BesideDesk::is_same_source),
            safe_switches: None,
        })
    }

    /// Returns the target of a recorded run, if it had one.
    pub(crate) fn recorded<'a>(fact: impl Fn(&str) -> Option<&'a str>) -> Option<Self> {
        let text_of = |name: &str| text::line(fact(name).unwrap_or_default());
        Some(Self {
            name: text::line(fact("target")?),
            host: text_of("target_host"),
            machine: text_of("target_machine"),
            kernel: text_of("target_kernel"),
            boot_id: text_of("target_boot_id"),
            cores: text_of("target_cores").parse().unwrap_or(0),
            agent_blake3: text_of("target_agent_blake3"),
            most_priority: text_of("target_most_priority").parse().unwrap_or(0),
            free_bytes: text_of("target_free_bytes").parse().ok(),
            same_source: text_of("target_same_source").parse().ok(),
            safe_switches: None,
        })
    }

    /// Returns facts for the recording, by name.
    pub fn facts(&self) -> Vec<(&'static str, String)> {
        let mut facts = vec![
            ("target", self.name.clone()),
            ("target_host", self.host.clone()),
            ("target_machine", self.machine.clone()),
            ("target_kernel", self.kernel.clone()),
            ("target_boot_id", self.boot_id.clone()),
            ("target_cores", self.cores.to_string()),
            ("target_agent_blake3", self.agent_blake3.clone()),
            ("target_most_priority", self.most_priority.to_string()),
        ];
        let free = self.free_bytes.map(|bytes| bytes.to_string());
        facts.extend(free.map(|free| ("target_free_bytes", free)));
        let same = self.same_source.map(|same| same.to_string());
        facts.extend(same.map(|same| ("target_same_source", same)));
        facts
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
