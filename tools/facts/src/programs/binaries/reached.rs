//! Controller program on another machine: described, checked and started there.

use std::path::Path;
use std::process::Command;

use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_target::contact::{Answer, Contact};
use hil_target::machine::{Findings, built_for};
use hil_target::name::Target;
use hil_target::way::{TargetError, Way};

use super::beside;
use crate::arguments::target::TargetArguments;

/// Connected target, with its agent's findings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reached {
    way: Way,
    findings: Findings,
}

impl Reached {
    /// Connects to the given target, if there is one; its agent may be silent for the wait limit.
    ///
    /// # Errors
    /// If the target cannot be reached or used.
    pub fn by(
        arguments: &TargetArguments,
        wait_limit_s: f64,
        interruption: &Interruption,
    ) -> Result<Option<Self>, Failure> {
        let Some(way) = arguments.way()? else {
            return Ok(None);
        };
        let way = way.with_silence(wait_limit_s);
        let contact = open(&way, interruption)?;
        let findings = contact.findings().clone();
        let reason = match (findings.free_bytes, &findings.hindrance) {
            (None, _) => Some("it has no /dev/shm".into()),
            (_, hindrance) => hindrance.clone(),
        };
        if let Some(reason) = reason {
            let target = way.target.to_string();
            return Err(failed(TargetError::Infrastructure { target, reason }));
        }
        if let Some((agent, newer)) = way.stale_agent(&findings.machine) {
            let (agent, newer) = (agent.display(), newer.display());
            tell!("note: the agent {agent} is older than {newer}; rebuild it");
        }
        Ok(Some(Self { way, findings }))
    }

    /// Returns the target's name as given.
    pub const fn target(&self) -> &Target {
        &self.way.target
    }

    /// Returns the findings of the agent.
    pub const fn findings(&self) -> &Findings {
        &self.findings
    }

    /// Opens a connection.
    ///
    /// # Errors
    /// If the target is no longer reachable.
    pub fn contact(&self, interruption: &Interruption) -> Result<Contact, Failure> {
        open(&self.way, interruption)
    }

    /// Returns the size of the agent's file, as an estimate of the size of a program there.
    ///
    /// # Errors
    /// If the agent's file is no longer readable.
    pub fn agent_bytes(&self) -> Result<u64, Failure> {
        let agent = self.way.agent_for(&self.findings.machine).map_err(failed)?;
        let metadata = std::fs::metadata(agent).map_err(Failure::infrastructure)?;
        Ok(metadata.len())
    }

    /// Asks a program on the target for its description.
    pub fn describe(
        &self,
        program: &Path,
        blake3: &str,
        interruption: &Interruption,
    ) -> Result<Answer, Failure> {
        let is_interrupted = || interruption.came();
        let contact = self.contact(interruption)?;
        let provided = contact.provide(program, blake3, &is_interrupted);
        provided
            .and_then(|()| contact.describe(&is_interrupted))
            .map_err(failed)
    }

    /// Asks a program on the target to check its job.
    pub fn check(
        &self,
        program: &Path,
        blake3: &str,
        job: &Path,
        interruption: &Interruption,
    ) -> Result<Answer, Failure> {
        let is_interrupted = || interruption.came();
        let job = std::fs::read_to_string(job).map_err(Failure::infrastructure)?;
        let contact = self.contact(interruption)?;
        let provided = contact.provide(program, blake3, &is_interrupted);
        provided
            .and_then(|()| contact.check(job, &is_interrupted))
            .map_err(failed)
    }

    /// Returns the command of the bridge that represents a program on the target in this session.
    ///
    /// # Errors
    /// If the path of this program cannot be determined.
    pub fn bridge(&self, program: &Path, blake3: &str, session: &Path) -> Result<Command, Failure> {
        let Way {
            target,
            agent,
            key_file,
            silence: _, // the bridge uses the wait limit of its job
        } = &self.way;
        let mut command = Command::new(beside("hil-target")?);
        command.args(["bridge", "--target", &target.to_string()]);
        command.arg("--program").arg(program);
        command.arg("--session").arg(session);
        command.arg("--blake3").arg(blake3);
        for (name, file) in [("--agent", agent), ("--key-file", key_file)] {
            if let Some(file) = file {
                command.arg(name).arg(file);
            }
        }
        Ok(command)
    }

    /// Returns `true` if the target is this machine, for example a container on this machine.
    pub fn is_here(&self) -> bool {
        self.findings.boot_id == Findings::own().boot_id
    }

    /// Returns the level of evidence that a run with this program on the target provides.
    pub fn evidence(&self, program: &Path, is_against_clock: bool) -> &'static str {
        let (own, is_here) = (Findings::own(), self.is_here());
        // An emulated agent on this machine reports the emulated machine type as its own.
        let machine = if is_here {
            &own.machine
        } else {
            &self.findings.machine
        };
        let built = built_for(program).ok().flatten();
        let is_emulated = built.is_some_and(|built| built != *machine);
        match (is_here, is_emulated) {
            (_, true) => "sil-emulated",
            (true, false) => "sil",
            (false, _) if is_against_clock => "hil",
            (false, _) => "pil",
        }
    }
}

fn open(way: &Way, interruption: &Interruption) -> Result<Contact, Failure> {
    Contact::open(way, || (), &|| interruption.came()).map_err(failed)
}

/// Converts an error of a target into the failure of a command.
pub fn failed(error: TargetError) -> Failure {
    match error {
        TargetError::Usage { .. } => Failure::usage(error),
        TargetError::Infrastructure { .. } => Failure::infrastructure(error),
        TargetError::Interrupted => Failure::Interrupted,
    }
}
