//! Plant and controller binaries: where they are, what they say of themselves, what they are.
//!
//! 1. `named` chooses which program a side has; `trusted` and `seal` say what a file may name.
//! 2. It is asked for its description after its hash was taken: here, or where it runs ([`reached`]).

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use hil_config::plan::{ControllerProgram, Permissions, Plan, Programs};
use hil_config::scenario::Advice;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_session::session::SessionInfo;
use hil_target::bridge::ready_file;
use shared_types::describe::{
    Description, FaultKindDescription, LawDescription, ModelSettings, PROTOCOL, PlantDescription,
};
use shared_types::record::RecordLayout;
use shared_types::side::Side;
use shared_types::text;

use answer::{asked, refusal, unprintable};
use beside_desk::BesideDesk;
pub use file::beside;
use file::{FileIdentity, hashed, hashed_model};
use host::{Host, is_model};
use named::{CONTROLLER, Choice, Named, NamedBy, PLANT, Role};
use reached::Reached;

use crate::arguments::BinaryArguments;

mod answer;
pub mod beside_desk;
mod file;
pub mod host;
pub mod named;
pub mod reached;
pub mod seal;
pub mod trusted;

/// A binary and its answer to `--describe`.
#[derive(Clone, Debug)]
pub struct Binary {
    /// Path of the binary.
    pub path: PathBuf,
    /// Description that the binary gives of itself.
    pub description: Description,
    /// Hash of the file.
    pub blake3: String,
    /// Source that named the binary.
    pub by: NamedBy,
    /// Machine that it runs on, if that is another.
    pub at: Option<Reached>,
    /// Program that runs it, if it is a model and no program.
    pub host: Option<Host>,
    /// Comparison with the desk's build of it, where another build runs elsewhere.
    pub beside_desk: Option<BesideDesk>,
    /// The file that was hashed.
    file: FileIdentity,
}

/// Both binaries of a run.
#[derive(Clone, Debug)]
pub struct Binaries {
    /// The plant.
    pub plant: Binary,
    /// The controller.
    pub controller: Binary,
}

/// Binaries of a run, before they are asked anything.
#[derive(Clone, Debug, PartialEq)]
pub struct Choices {
    plant: Choice,
    controller: Choice,
    at: Option<Reached>,
    /// The controller that would run at this desk, where another place was asked for.
    at_desk: Option<Choice>,
}

impl Choices {
    /// Chooses the binaries that the arguments or a file name.
    ///
    /// # Errors
    /// If what a file names must not be run.
    pub fn of(
        arguments: &BinaryArguments,
        named: &Named<'_>,
        at: Option<&Reached>,
    ) -> Result<Self, Failure> {
        Ok(Self {
            plant: named.choice(&PLANT, arguments.plant_bin.as_deref(), None)?,
            controller: named.choice(&CONTROLLER, arguments.controller_bin.as_deref(), at)?,
            at: at.cloned(),
            // One that must not be run here is compared with nothing.
            at_desk: at.and_then(|_| named.choice(&CONTROLLER, None, None).ok()),
        })
    }

    /// Takes copies of both programs in place of those beside `hil`.
    pub fn copies([plant, controller]: [PathBuf; 2]) -> Self {
        let copy = |path| Choice::new(path, NamedBy::Nobody);
        Self {
            plant: copy(plant),
            controller: copy(controller),
            at: None,
            at_desk: None,
        }
    }

    /// Tells whether one of them was named, by whatever means.
    pub fn names_one(&self) -> bool {
        [&self.plant, &self.controller]
            .iter()
            .any(|choice| choice.by != NamedBy::Nobody)
    }

    /// Asks both what they are.
    ///
    /// # Errors
    /// If one is missing, cannot be executed or does not speak the protocol.
    pub fn find(&self, interruption: &Interruption) -> Result<Arc<Binaries>, Failure> {
        let at = self.at.as_ref();
        let mut controller = Binary::of_controller(&self.controller, at, interruption)?;
        controller.beside_desk = self
            .at_desk
            .as_ref()
            .and_then(|desk| BesideDesk::of(&controller, desk, interruption));
        Ok(Arc::new(Binaries {
            plant: Binary::of_plant(&self.plant, interruption)?,
            controller,
        }))
    }
}

impl Binaries {
    /// The program of a side.
    pub const fn of_side(&self, side: Side) -> &Binary {
        match side {
            Side::Plant => &self.plant,
            Side::Controller => &self.controller,
        }
    }

    /// Tells which ones run, where that does not follow from the command line.
    pub fn tell(&self) {
        let all = [(&PLANT, &self.plant), (&CONTROLLER, &self.controller)];
        for (role, Binary { path, by, at, .. }) in all {
            let on = at
                .as_ref()
                .map_or_else(String::new, |at| format!(" on {}", at.target()));
            tell!("{}: {} ({by}){on}", role.side, path.display());
        }
        if let Some(beside) = &self.controller.beside_desk {
            tell!("controller: {beside}");
        }
    }

    /// The programs that were named, for the scenario of the run.
    #[must_use]
    pub fn programs(&self) -> Programs {
        let settings = |binary: &Binary| {
            let host = binary.host.as_ref();
            host.map_or_else(Default::default, |host| host.settings.clone())
        };
        Programs {
            plant: self.plant.named().map(Path::to_owned),
            controller: (self.controller.named()).map(|path| ControllerProgram::One(path.into())),
            locals: self
                .plant
                .host
                .as_ref()
                .map_or(Vec::new(), |host| host.locals.clone()),
            plant_permissions: self.plant.permissions(),
            controller_permissions: self.controller.permissions(),
            plant_settings: settings(&self.plant),
            controller_settings: settings(&self.controller),
        }
    }

    /// Returns advice for whoever names a plant or law that the binaries do not have.
    #[must_use]
    pub fn advice(&self) -> Advice {
        let name = |role: &Role| format!("`{}` in the scenario or {} PATH", role.key, role.flag);
        Advice {
            plant: self.plant.advice("plant", &name(&PLANT)),
            law: self.controller.advice("law", &name(&CONTROLLER)),
        }
    }

    /// Returns the descriptions that scenarios are checked against: plants, laws and kinds of faults.
    #[must_use]
    pub fn described(
        &self,
    ) -> (
        &[PlantDescription],
        &[LawDescription],
        &[FaultKindDescription],
    ) {
        let plant = &self.plant.description;
        (
            &plant.plants,
            &self.controller.description.laws,
            &plant.faults,
        )
    }

    /// Describes the records of a run of a plan that was checked against these.
    ///
    /// # Errors
    /// If there is no such plant or law.
    pub fn record_layout(&self, plan: &Plan) -> Result<RecordLayout, Failure> {
        let (plants, laws, _) = self.described();
        let both = plan.plant_among(plants).zip(plan.law_among(laws));
        both.map(|(plant, law)| plan.record_layout(plant, &law))
            .ok_or_else(|| Failure::infrastructure("a binary lost its plant or law"))
    }
}

impl Binary {
    /// Finds the plant that is named and asks what it is.
    ///
    /// # Errors
    /// If it is missing, cannot be executed or does not speak the protocol.
    pub fn plant(
        given: Option<&Path>,
        named: &Named<'_>,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        Self::of_plant(&named.choice(&PLANT, given, None)?, interruption)
    }

    /// Finds the controller that is named and asks what it is.
    ///
    /// # Errors
    /// If it is missing, cannot be executed or does not speak the protocol.
    pub fn controller(
        given: Option<&Path>,
        named: &Named<'_>,
        at: Option<&Reached>,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        Self::of_controller(&named.choice(&CONTROLLER, given, at)?, at, interruption)
    }

    /// Asks a controller what it is that was named with this flag; an FMU has these permissions and settings.
    ///
    /// # Errors
    /// If it is missing, cannot be executed, does not speak the protocol or refuses the settings.
    pub fn asked_for(
        path: &Path,
        flag: &'static str,
        of_fmu: (Permissions, ModelSettings),
        at: Option<&Reached>,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        let path = std::path::absolute(path).map_err(Failure::usage)?;
        let (permissions, settings) = match is_model(&path) {
            true => of_fmu,
            false => Default::default(),
        };
        let choice = Choice {
            permissions,
            settings,
            ..Choice::new(path, NamedBy::Person(flag))
        };
        Self::of_controller(&choice, at, interruption)
    }

    /// Asks a program or a model what it is, as this side if it can be both.
    ///
    /// # Errors
    /// If it is missing, cannot be executed or does not speak the protocol.
    pub fn described(
        path: &Path,
        role: &Role,
        (permissions, loads): (Permissions, bool),
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        let path = std::path::absolute(path).map_err(Failure::usage)?;
        let choice = Choice {
            permissions,
            loads,
            ..Choice::new(path, NamedBy::Person("--as"))
        };
        Self::find(&choice, role, None, interruption)
    }

    fn of_plant(choice: &Choice, interruption: &Interruption) -> Result<Self, Failure> {
        let plant = Self::find(choice, &PLANT, None, interruption)?;
        if plant.description.plants.is_empty() {
            return Err(plant.refused("describes no plant"));
        }
        Ok(plant)
    }

    fn of_controller(
        choice: &Choice,
        at: Option<&Reached>,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        let controller = Self::find(choice, &CONTROLLER, at, interruption)?;
        if controller.description.laws.is_empty() {
            return Err(controller.refused("describes no control law"));
        }
        Ok(controller)
    }

    fn refused(&self, why: &str) -> Failure {
        let (path, by) = (self.path.display(), &self.by);
        Failure::usage(match by {
            NamedBy::Nobody => format!("{path} {why}"),
            by => format!("{path} ({by}) {why}"),
        })
    }

    /// Returns advice for whoever names a plant or law, which `what` is, that the binary does not have; `name` says
    /// how to name another program.
    pub fn advice(&self, what: &str, name: &str) -> String {
        let (path, by) = (self.path.display(), &self.by);
        match by {
            NamedBy::Nobody => {
                format!("a {what} of your own is in a program of its own: {name} names it")
            }
            by => format!("these are the {what}s of {path} ({by})"),
        }
    }

    /// Returns the permissions that it has as an FMU.
    pub fn permissions(&self) -> Permissions {
        let host = self.host.as_ref();
        host.map_or_else(Permissions::default, |host| host.permissions)
    }

    /// Returns the path, if somebody named it.
    pub fn named(&self) -> Option<&Path> {
        (self.by != NamedBy::Nobody).then_some(&self.path)
    }

    /// Returns true if what was started of it as the controller of this epoch may be expected to say hello: on a
    /// target it must run there first, which takes as long as `ssh` does.
    pub fn is_ready(&self, session: &SessionInfo, epoch: u32) -> bool {
        self.at.is_none() || session.folder.join(ready_file(epoch)).exists()
    }

    /// Returns `true` if an interpreter runs it.
    pub fn is_script(&self) -> bool {
        file::is_script(&self.path)
    }

    /// Refuses a file that is not the one that was hashed any more.
    ///
    /// # Errors
    /// If the file was changed; the error says what to do.
    pub fn refuse_changed(&self) -> Result<(), Failure> {
        let changed = match &self.host {
            _ if self.file.is_changed(&self.path) => &self.path,
            Some(host) if host.file.is_changed(&host.path) => &host.path,
            _ => return Ok(()),
        };
        Err(Failure::infrastructure(format!(
            "{} was replaced or changed after it was checked, so it is not run; start again with the file as it is now",
            changed.display()
        )))
    }

    fn find(
        choice: &Choice,
        role: &Role,
        at: Option<&Reached>,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        let Choice {
            path, by, blake3, ..
        } = choice;
        let shown = path.display();
        let cannot = |error: &dyn std::fmt::Display| choice.cannot_run(role, error);
        let host = Host::of(choice, role.side).map_err(|error| cannot(&error))?;
        if let (Some(_), Some(at)) = (&host, at) {
            let target = at.target();
            return Err(cannot(&format!(
                "an FMU runs on this machine, not on {target}"
            )));
        }
        if let (None, Some(reason)) = (&host, choice.only_for_an_fmu(role)) {
            return Err(Failure::usage(format!("{shown} is no FMU, so {reason}")));
        }
        let hashed = match &host {
            Some(_) => hashed_model(path),
            None => hashed(path),
        };
        let (file, found) = hashed.map_err(|error| cannot(&error))?;
        if let Some(wanted) = blake3.as_ref().filter(|wanted| **wanted != found) {
            let (side, flag) = (role.side, role.flag);
            return Err(Failure::usage(format!(
                "{shown} is not the {side} program that was {by} any more: it has hash {found}, that one had {wanted}; {flag} {shown} runs it as it is"
            )));
        }
        let answer = match at {
            Some(at) => at.describe(path, &found, interruption)?,
            None => {
                let asked = match &host {
                    Some(host) => host.ask(path, &["--describe".as_ref()], interruption)?,
                    None => asked(path, &["--describe"], interruption)?,
                };
                asked.map_err(|error| cannot(&error))?
            }
        };
        if !answer.is_success
            && let Some(reason) = refusal(&answer.stderr)
        {
            return Err(cannot(&text::printable(reason)));
        }
        let description: Description = serde_json::from_str(&answer.stdout).map_err(|error| {
            let said = &answer.stderr;
            let said = said.lines().next().map_or(String::new(), |said| format!(" ({})", text::line(said)));
            Failure::usage(format!(
                "{shown} does not speak the protocol: its answer to --describe is not a description: {error}{said}"
            ))
        })?;
        let described = serde_json::to_value(&description).map_err(Failure::infrastructure)?;
        if let Some(text) = unprintable(&described) {
            return Err(Failure::usage(format!(
                "{shown}: its answer to --describe has control characters in {text:?}"
            )));
        }
        if description.protocol != PROTOCOL {
            let theirs = description.protocol;
            return Err(Failure::usage(format!(
                "{shown} speaks protocol {theirs}, this hil {PROTOCOL}; rebuild it"
            )));
        }
        description.check().map_err(|wrong| {
            Failure::usage(format!("{shown}: its answer to --describe: {wrong}"))
        })?;
        let binary = Self {
            path: path.clone(),
            description,
            blake3: found,
            by: by.clone(),
            at: at.cloned(),
            host,
            beside_desk: None,
            file,
        };
        binary.refuse_changed()?;
        Ok(binary)
    }

    /// Asks whether the parameters of a job go together.
    ///
    /// # Errors
    /// If the binary refuses the parameters; the error gives its reason.
    pub fn check(&self, job: &Path, interruption: &Interruption) -> Result<(), Failure> {
        let arguments = ["--check".as_ref(), job.as_os_str()];
        let answer = match &self.at {
            Some(at) => at.check(&self.path, &self.blake3, job, interruption)?,
            None => {
                let asked = match &self.host {
                    Some(host) => host.ask(&self.path, &arguments, interruption)?,
                    None => asked(&self.path, &arguments, interruption)?,
                };
                asked.map_err(|error| {
                    let path = self.path.display();
                    Failure::infrastructure(format!("{path} --check: {error}"))
                })?
            }
        };
        if answer.is_success {
            return Ok(());
        }
        let reason = answer.stderr.trim().trim_start_matches("error: ");
        // A library of somebody else may give its reason on either.
        Err(self.refused_job(format!("{reason}\n{}", answer.stdout).trim()))
    }

    /// The command that starts it in a session, here or where it runs.
    ///
    /// # Errors
    /// If the program that stands here for one elsewhere cannot be found.
    pub fn command(&self, session: &Path) -> Result<Command, Failure> {
        if let Some(at) = &self.at {
            return at.bridge(&self.path, &self.blake3, session);
        }
        let mut command = match &self.host {
            Some(host) => host.command(&self.path),
            None => Command::new(&self.path),
        };
        command.arg("--session").arg(session);
        Ok(command)
    }

    /// Makes the failure of a job that it refuses, with its reason.
    pub fn refused_job(&self, why: &str) -> Failure {
        let (program, why) = (&self.description.program, text::printable(why));
        Failure::usage(format!("{program}: {why}"))
    }
}
