//! A controller's program on another machine: described, checked and started where it runs.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::Command;

use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_target::contact::{Answer, Contact};
use hil_target::machine::{Findings, built_for};
use hil_target::name::Target;
use hil_target::way::{TargetError, Way};
use shared_types::origin::Build;

use super::named::Choice;
use super::{Binary, beside};
use crate::arguments::target::TargetArguments;

/// A target that answered, and what its agent found there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reached {
    way: Way,
    findings: Findings,
}

impl Reached {
    /// Reaches the target that was typed, if one was; its agent may be silent for the wait limit.
    ///
    /// # Errors
    /// If it cannot be reached or used.
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
            (None, _) => Some("there is no /dev/shm there".into()),
            (_, hindrance) => hindrance.clone(),
        };
        if let Some(reason) = reason {
            let target = way.target.to_string();
            return Err(failed(TargetError::Infrastructure { target, reason }));
        }
        if let Some((agent, newer)) = way.stale_agent(&findings.machine) {
            let (agent, newer) = (agent.display(), newer.display());
            tell!("note: the agent {agent} is older than {newer}; build it anew");
        }
        Ok(Some(Self { way, findings }))
    }

    /// The target, as it was named.
    pub const fn target(&self) -> &Target {
        &self.way.target
    }

    /// Findings of the agent.
    pub const fn findings(&self) -> &Findings {
        &self.findings
    }

    /// Opens a contact.
    ///
    /// # Errors
    /// If the target cannot be reached any more.
    pub fn contact(&self, interruption: &Interruption) -> Result<Contact, Failure> {
        open(&self.way, interruption)
    }

    /// Length of the agent's file, as a measure of a program there.
    ///
    /// # Errors
    /// If the file cannot be read any more.
    pub fn agent_bytes(&self) -> Result<u64, Failure> {
        let agent = self.way.agent_for(&self.findings.machine).map_err(failed)?;
        let found = std::fs::metadata(agent).map_err(Failure::infrastructure)?;
        Ok(found.len())
    }

    /// Asks a program, there, what it is.
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

    /// Asks a program, there, to look at its job.
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

    /// The command that stands here for a program there, with this session.
    ///
    /// # Errors
    /// If this program's own place cannot be found.
    pub fn bridge(&self, program: &Path, blake3: &str, session: &Path) -> Result<Command, Failure> {
        let Way {
            target,
            agent,
            key_file,
            silence: _, // the bridge takes the wait limit of its job
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

    /// Returns true if the target is this machine, such as a container on it.
    pub fn is_here(&self) -> bool {
        self.findings.boot_id == Findings::own().boot_id
    }

    /// Names the evidence that a run with this program there gives.
    pub fn evidence(&self, program: &Path, is_against_clock: bool) -> &'static str {
        let (own, is_here) = (Findings::own(), self.is_here());
        // One that is emulated on this machine takes the emulated one for its own.
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

/// A controller that is built for another processor, beside the desk's build of it.
#[derive(Clone, Debug)]
pub struct BesideDesk {
    desk: PathBuf,
    /// Builds there and at the desk, as far as they noted their sources.
    builds: [Option<Build>; 2],
}

impl BesideDesk {
    /// Compares a controller that runs elsewhere with what would run at the desk; nothing if that is the same file or
    /// another program.
    pub fn of(there: &Binary, desk: &Choice, interruption: &Interruption) -> Option<Self> {
        let machine = |path: &Path| built_for(path).ok().flatten();
        if machine(&there.path)? == machine(&desk.path)? {
            return None;
        }
        let desk = Binary::of_controller(desk, None, interruption).ok()?;
        let is_same = desk.description.program == there.description.program;
        is_same.then(|| Self {
            builds: [&there.description, &desk.description].map(|one| one.build.clone()),
            desk: desk.path,
        })
    }

    /// True if both are known to be built from the same source; nothing if that cannot be told.
    pub(crate) fn is_same_source(&self) -> Option<bool> {
        match &self.builds {
            [Some(there), Some(desk)] if there.is_of_source_of(desk) => Some(true),
            // Each with changes of its own: nobody knows which.
            [Some(there), Some(desk)] if there == desk => None,
            [Some(_), Some(_)] => Some(false),
            _ => None,
        }
    }
}

impl fmt::Display for BesideDesk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let told = |build: &Option<Build>| match build {
            Some(build) => build.to_string(),
            None => "a build that noted no source".into(),
        };
        let [there, desk] = self.builds.each_ref().map(told);
        let path = self.desk.display();
        match self.is_same_source() {
            Some(true) => write!(f, "built from the source of {path}: {there}"),
            Some(false) => write!(
                f,
                "note: built from another source than {path}: {there}; the desk's {desk}"
            ),
            None => write!(
                f,
                "note: nobody can tell that it is built from the source of {path}: {there}; the desk's {desk}"
            ),
        }
    }
}

fn open(way: &Way, interruption: &Interruption) -> Result<Contact, Failure> {
    Contact::open(way, || (), &|| interruption.came()).map_err(failed)
}

/// The failure of a command whose target let it down.
pub fn failed(error: TargetError) -> Failure {
    match error {
        TargetError::Usage { .. } => Failure::usage(error),
        TargetError::Infrastructure { .. } => Failure::infrastructure(error),
        TargetError::Interrupted => Failure::Interrupted,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beside(commits: [Option<&str>; 2], modified: bool) -> BesideDesk {
        let build = |commit: Option<&str>| {
            commit.map(|commit| Build {
                commit: Some(commit.into()),
                modified,
                lock_blake3: Some("00".into()),
            })
        };
        BesideDesk {
            desk: "desk".into(),
            builds: commits.map(build),
        }
    }

    #[test]
    fn a_build_for_another_processor_is_called_the_same_source_only_where_that_is_known() {
        for (commits, modified, same, told) in [
            (
                [Some("a"), Some("a")],
                false,
                Some(true),
                "built from the source of desk: commit a",
            ),
            (
                [Some("a"), Some("b")],
                false,
                Some(false),
                "from another source than desk: commit a",
            ),
            (
                [Some("a"), Some("b")],
                true,
                Some(false),
                "commit b with changes",
            ),
            ([Some("a"), Some("a")], true, None, "nobody can tell"),
            (
                [None, Some("a")],
                false,
                None,
                "a build that noted no source",
            ),
        ] {
            let beside = beside(commits, modified);
            assert_eq!(beside.is_same_source(), same, "{beside}");
            assert!(beside.to_string().contains(told), "{beside}");
        }
    }
}
