//! Flags that run the controller on another machine.

use std::path::PathBuf;

use clap::Args;
use hil_console::terminal::exit::Failure;
use hil_target::name::Target;
use hil_target::way::Way;

/// Machine that runs the controller.
#[derive(Clone, Debug, Default, Args)]
pub struct TargetArguments {
    /// Machine that runs the controller: [user@]host or a name of your ssh configuration, or
    /// serve://HOST:PORT of an agent that listens there
    #[arg(long, value_name = "TARGET")]
    #[expect(
        rustdoc::broken_intra_doc_links,
        reason = "the text of the help, not a link"
    )]
    pub target: Option<Target>,
    /// The hil-target program for that machine [default: a static build of this workspace, else the
    /// one beside hil]
    #[arg(long, value_name = "PATH", requires = "target")]
    pub target_agent: Option<PathBuf>,
    /// File with the key of a listening agent
    #[arg(long, value_name = "FILE", requires = "target")]
    pub key_file: Option<PathBuf>,
}

impl TargetArguments {
    /// Returns `true` if the target serves one session at a time.
    pub const fn serves_one(&self) -> bool {
        matches!(self.target, Some(Target::Serve(_)))
    }

    /// Returns the route to the given target, if there is one.
    ///
    /// # Errors
    /// If the flags contradict each other.
    pub(crate) fn way(&self) -> Result<Option<Way>, Failure> {
        let Some(target) = self.target.clone() else {
            return Ok(None);
        };
        if matches!(target, Target::Ssh(_)) && self.key_file.is_some() {
            return Err(Failure::usage(
                "--key-file is only for a listening agent, --target serve://HOST:PORT; ssh uses its own keys",
            ));
        }
        Ok(Some(Way {
            target,
            agent: self.target_agent.clone(),
            key_file: self.key_file.clone(),
            silence: Way::SILENCE,
        }))
    }
}
