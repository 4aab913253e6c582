//! Plant and controller binaries: their paths, descriptions and hashes.
//!
//! 1. `named` selects the program of a side; `trusted` and `seal` decide which programs a file may name.
//! 2. A program is hashed and then asked for its description, either here or on the machine that runs it ([`reached`]).

use std::path::{Path, PathBuf};
use std::process::Command;

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

use answer::{asked, objection, silence, unprintable};
use beside_desk::BesideDesk;
pub use choices::Choices;
pub use file::beside;
use file::{FileIdentity, hashed, hashed_model};
use host::{Host, ModelKind};
use named::{CONTROLLER, Choice, Named, NamedBy, PLANT, Role};
use reached::Reached;

mod answer;
pub(crate) mod beside_desk;
mod choices;
mod file;
pub mod host;
mod local_map;
pub mod named;
mod python;
pub mod reached;
pub mod seal;
pub mod trusted;

/// Binary with its answer to `--describe`.
#[derive(Clone, Debug)]
pub struct Binary {
    /// Path of the binary.
    pub path: PathBuf,
    /// Description from the binary itself.
    pub description: Description,
    /// Hash of the file.
    pub blake3: String,
    /// Source that named the binary.
    pub by: NamedBy,
    /// Machine that runs the binary, if another.
    pub at: Option<Reached>,
    /// Program that runs the binary, if the binary is a model.
    pub host: Option<Host>,
    /// Comparison with the desk's build, if another build runs on a target.
    pub beside_desk: Option<BesideDesk>,
    /// Identity of the hashed file.
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

impl Binaries {
    /// Returns the program of a side.
    pub const fn of_side(&self, side: Side) -> &Binary {
        match side {
            Side::Plant => &self.plant,
            Side::Controller => &self.controller,
        }
    }

    /// Prints which programs run, unless this follows from the command line.
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

    /// Returns the named programs, for the scenario of the run.
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

    /// Returns advice about unknown plants and laws.
    #[must_use]
    pub fn advice(&self) -> Advice {
        let name = |role: &Role| format!("`{}` in the scenario or {} PATH", role.key, role.flag);
        Advice {
            plant: self.plant.advice("plant", &name(&PLANT)),
            law: self.controller.advice("law", &name(&CONTROLLER)),
        }
    }

    /// Returns the descriptions against which scenarios are checked: plants, laws and fault kinds.
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

    /// Returns the layout of the records of a plan that was checked against these binaries.
    ///
    /// # Errors
    /// If there is no such plant or law.
    pub fn record_layout(&self, plan: &Plan) -> Result<RecordLayout, Failure> {
        let (plants, laws, _) = self.described();
        let both = plan.plant_among(plants).zip(plan.law_among(laws));
        both.map(|(plant, law)| plan.record_layout(&plant, &law))
            .ok_or_else(|| {
                Failure::infrastructure("the plan's plant or law is missing in its binary")
            })
    }
}

impl Binary {
    /// Finds the named plant and asks for its description.
    ///
    /// # Errors
    /// If the plant is missing, cannot be executed or does not speak the protocol.
    pub(crate) fn plant(
        flag: Option<&Path>,
        named: &Named<'_>,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        Self::of_plant(&named.choice(&PLANT, flag, None)?, interruption)
    }

    /// Finds the named controller and asks for its description.
    ///
    /// # Errors
    /// If the controller is missing, cannot be executed or does not speak the protocol.
    pub fn controller(
        flag: Option<&Path>,
        named: &Named<'_>,
        at: Option<&Reached>,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        Self::of_controller(&named.choice(&CONTROLLER, flag, at)?, at, interruption)
    }

    /// Describes a controller that was named with this flag; an FMU has these permissions and settings.
    ///
    /// # Errors
    /// If the controller is missing, cannot be executed, does not speak the protocol or refuses the settings.
    pub fn asked_for(
        path: &Path,
        flag: &'static str,
        of_fmu: (Permissions, ModelSettings),
        at: Option<&Reached>,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        let path = std::path::absolute(path).map_err(Failure::usage)?;
        let (permissions, settings) = match ModelKind::of(&path) {
            Some(ModelKind::Fmu) => of_fmu,
            _ => Default::default(),
        };
        let choice = Choice {
            permissions,
            settings,
            ..Choice::new(path, NamedBy::Person(flag))
        };
        Self::of_controller(&choice, at, interruption)
    }

    /// Describes a program or a model, as this side if it can be either side.
    ///
    /// # Errors
    /// If the file is missing, cannot be executed or does not speak the protocol.
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

    /// Returns advice about an unknown plant or law (`what`); `name` states how to name another program.
    pub fn advice(&self, what: &str, name: &str) -> String {
        let (path, by) = (self.path.display(), &self.by);
        match by {
            NamedBy::Nobody => {
                format!("a custom {what} needs its own program; name the program with {name}")
            }
            by => format!("these are the {what}s of {path} ({by})"),
        }
    }

    /// Returns the permissions of the binary if it is an FMU.
    pub fn permissions(&self) -> Permissions {
        let host = self.host.as_ref();
        host.map_or_else(Permissions::default, |host| host.permissions)
    }

    /// Returns the modules beside a Python file that it imports, as files with their places relative to its folder.
    ///
    /// # Errors
    /// If a folder of a module cannot be read.
    pub fn modules_beside(&self) -> Result<Vec<(PathBuf, PathBuf)>, Failure> {
        let imported = self.description.imported.as_ref();
        let modules = imported.map_or(&[][..], |imported| &imported.modules);
        let names = modules.iter().map(|module| &*module.name);
        python::modules_beside(&self.path, names).map_err(Failure::usage)
    }

    /// Returns `true` if equal runs of the binary give equal records: `false` for a port whose file says otherwise.
    pub fn is_repeatable(&self) -> bool {
        self.host.as_ref().is_none_or(|host| host.is_repeatable)
    }

    /// Returns the path if the binary was named.
    pub fn named(&self) -> Option<&Path> {
        (self.by != NamedBy::Nobody).then_some(&self.path)
    }

    /// Returns `true` if the controller of this epoch can be expected to say hello: on a target it must first be
    /// running, which takes as long as `ssh` does.
    pub fn is_ready(&self, session: &SessionInfo, epoch: u32) -> bool {
        self.at.is_none() || session.folder.join(ready_file(epoch)).exists()
    }

    /// Returns `true` if an interpreter runs the file.
    pub fn is_script(&self) -> bool {
        file::is_script(&self.path)
    }

    /// Refuses a file that has changed since it was hashed.
    ///
    /// # Errors
    /// If the file was changed; the error includes advice.
    pub fn refuse_changed(&self) -> Result<(), Failure> {
        let changed = match &self.host {
            _ if self.file.is_changed(&self.path) => &self.path,
            Some(host) if host.file.is_changed(&host.path) => &host.path,
            _ => return Ok(()),
        };
        Err(Failure::infrastructure(format!(
            "{} was replaced or changed after the check, so it is not run; start again to use the new file",
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
        let path_text = path.display();
        let cannot = |error: &dyn std::fmt::Display| choice.cannot_run(role, error);
        let host = Host::of(choice, role.side).map_err(|error| cannot(&error))?;
        if let (Some(host), Some(at)) = (&host, at) {
            let (words, target) = (host.kind.words(), at.target());
            return Err(cannot(&format!(
                "{words} can run only on this machine, not on {target}; omit --target, or name a controller program"
            )));
        }
        let is_fmu = host
            .as_ref()
            .is_some_and(|host| host.kind == ModelKind::Fmu);
        if let (false, Some(reason)) = (is_fmu, choice.only_for_an_fmu(role)) {
            return Err(Failure::usage(format!(
                "{path_text} is not an FMU, so {reason}"
            )));
        }
        let hashed = match &host {
            Some(_) => hashed_model(path),
            None => hashed(path),
        };
        let (file, actual) = hashed.map_err(|error| cannot(&error))?;
        if let Some(expected) = blake3.as_ref().filter(|expected| **expected != actual) {
            let (side, flag) = (role.side, role.flag);
            return Err(Failure::usage(format!(
                "{path_text} is no longer the {side} program that was {by}: its hash is {actual}, but that program has {expected}; use {flag} {path_text} to run it as it is"
            )));
        }
        let answer = match at {
            Some(at) => at.describe(path, &actual, interruption)?,
            None => {
                let result = match &host {
                    Some(host) => host.ask(path, &["--describe".as_ref()], interruption)?,
                    None => asked(path, &["--describe"], interruption)?,
                };
                result.map_err(|error| cannot(&error))?
            }
        };
        if let Some(reason) = silence(&answer) {
            return Err(cannot(&reason));
        }
        let description: Description = serde_json::from_str(&answer.stdout).map_err(|error| {
            let hint = &answer.stderr;
            let hint = hint.lines().next().map_or(String::new(), |hint| format!(" ({})", text::line(hint)));
            Failure::usage(format!(
                "{path_text} does not speak the protocol: its answer to --describe is not a description: {error}{hint}"
            ))
        })?;
        let described = serde_json::to_value(&description).map_err(Failure::infrastructure)?;
        if let Some(text) = unprintable(&described) {
            return Err(Failure::usage(format!(
                "{path_text}: its answer to --describe has control characters in {text:?}"
            )));
        }
        if description.protocol != PROTOCOL {
            let theirs = description.protocol;
            return Err(Failure::usage(format!(
                "{path_text} speaks protocol {theirs}, but this hil speaks {PROTOCOL}; rebuild it"
            )));
        }
        description.check().map_err(|wrong| {
            Failure::usage(format!("{path_text}: its answer to --describe: {wrong}"))
        })?;
        let binary = Self {
            path: path.clone(),
            description,
            blake3: actual,
            by: by.clone(),
            at: at.cloned(),
            host,
            beside_desk: None,
            file,
        };
        binary.refuse_changed()?;
        Ok(binary)
    }

    /// Checks that the parameters of a job are consistent.
    ///
    /// # Errors
    /// If the binary refuses the parameters; the error gives its reason.
    pub fn check(&self, job: &Path, interruption: &Interruption) -> Result<(), Failure> {
        let arguments = ["--check".as_ref(), job.as_os_str()];
        let answer = match &self.at {
            Some(at) => at.check(&self.path, &self.blake3, job, interruption)?,
            None => {
                let result = match &self.host {
                    Some(host) => host.ask(&self.path, &arguments, interruption)?,
                    None => asked(&self.path, &arguments, interruption)?,
                };
                result.map_err(|error| {
                    let path = self.path.display();
                    Failure::infrastructure(format!("{path} --check: {error}"))
                })?
            }
        };
        match objection(&answer, self.host.is_some()) {
            None => Ok(()),
            Some(why) => Err(self.refused_job(&why)),
        }
    }

    /// Returns the command that starts the binary in a session, here or on its target.
    ///
    /// # Errors
    /// If the program that represents a remote binary here cannot be found.
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

    /// Returns the failure of a job that the binary refuses, with the reason.
    pub fn refused_job(&self, why: &str) -> Failure {
        let (program, why) = (&self.description.program, text::printable(why));
        Failure::usage(format!("{program}: {why}"))
    }
}
