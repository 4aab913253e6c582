//! Program of a side: named by the command line, else by the environment, else by the scenario or the recording,
//! otherwise the program next to `hil`.
//!
//! A program named by a file is run only if nobody but this user and root can have written that file. A program named
//! by a recording is run only if this user made the recording and the program is unchanged.

use std::ffi::OsStr;
use std::fmt;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use hil_config::plan::{ControllerProgram, Permissions, Programs};
use hil_config::scenario::{Scenario, read_regular};
use hil_console::terminal::exit::Failure;
use hil_recording::reader::RunReader;
use shared_types::describe::ModelSettings;

use super::reached::Reached;
use super::{beside, seal, trusted};

/// Side, and the ways of naming its program.
#[derive(Debug, PartialEq, Eq)]
pub struct Role {
    /// Name of the side in messages.
    pub side: &'static str,
    /// Program next to `hil`.
    pub beside: &'static str,
    /// Option that names the program.
    pub flag: &'static str,
    /// Environment variable that names the program.
    pub variable: &'static str,
    /// Key in a scenario.
    pub key: &'static str,
}

/// The plant's side.
pub const PLANT: Role = Role {
    side: "plant",
    beside: "plant-process",
    flag: "--plant-bin",
    variable: "HIL_PLANT_BIN",
    key: "plant.program",
};
/// The controller's side.
pub const CONTROLLER: Role = Role {
    side: "controller",
    beside: "controller-process",
    flag: "--controller-bin",
    variable: "HIL_CONTROLLER_BIN",
    key: "controller.program",
};

/// Fact of a recording with the patterns of local signals.
pub const LOCALS: &str = "plant_locals";

/// Fact of a recording with the keys of the scenario that give an FMU permissions.
pub const PERMISSIONS: &str = "fmu_permissions";

/// Fact of a recording with the settings of FMUs, for plant and controller.
pub const MODEL_SETTINGS: &str = "fmu_settings";

/// Source that named a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NamedBy {
    /// No source: the program next to `hil`.
    Nobody,
    /// A flag or an environment variable.
    Person(&'static str),
    /// Key of a scenario.
    Scenario(&'static str, PathBuf),
    /// Recorded run.
    Recording(PathBuf),
}

impl fmt::Display for NamedBy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nobody => f.write_str("beside hil"),
            Self::Person(name) => f.write_str(name),
            Self::Scenario(key, file) => write!(f, "{key} of {}", file.display()),
            Self::Recording(run) => write!(f, "recorded in {}", run.display()),
        }
    }
}

/// Program of a side.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// File of the program.
    pub path: PathBuf,
    /// Place that names the file.
    pub by: NamedBy,
    /// Required hash.
    pub blake3: Option<String>,
    /// Patterns of local signals recorded as truth, for an FMU.
    pub locals: Vec<String>,
    /// Permissions, for an FMU.
    pub permissions: Permissions,
    /// Settings, for an FMU.
    pub settings: ModelSettings,
    /// `true` if the library of an FMU is loaded to list its requirements.
    pub loads: bool,
}

impl Choice {
    /// Selects a program without further requirements.
    pub(crate) fn new(path: PathBuf, by: NamedBy) -> Self {
        Self {
            path,
            by,
            blake3: None,
            locals: Vec::new(),
            permissions: Permissions::default(),
            settings: ModelSettings::default(),
            loads: false,
        }
    }

    /// Returns the failure of a program that cannot be run.
    pub(super) fn cannot_run(&self, role: &Role, error: &dyn fmt::Display) -> Failure {
        let (path_text, by) = (self.path.display(), &self.by);
        Failure::usage(match by {
            NamedBy::Nobody if !self.path.exists() => format!(
                "no {} program is named, and there is none next to hil: {path_text} does not exist; build all programs with `cargo build --release` in the clone, or name one with {} PATH or {}",
                role.side, role.flag, role.variable
            ),
            // The program is not the cause.
            NamedBy::Nobody if lacks_room(&error.to_string()) => {
                format!("cannot run {path_text}: {error}")
            }
            NamedBy::Nobody => format!(
                "cannot run {path_text}: {error}; build it with `cargo build --release`, or name one with {}",
                role.flag
            ),
            // The user has just typed the flag, but may have set a variable long ago.
            NamedBy::Person(flag) if flag.starts_with("--") => {
                format!("cannot run {path_text}: {error}")
            }
            by => format!("cannot run {path_text} ({by}): {error}"),
        })
    }

    /// Returns the first setting that applies only to FMUs, with the statement that it has no effect.
    pub(super) fn only_for_an_fmu(&self, role: &Role) -> Option<String> {
        if !self.locals.is_empty() {
            return Some("`plant.locals` has no effect, because the truth contains everything that the plant describes".into());
        }
        let keys = self.permissions.given().chain(self.settings.given());
        let flag = self.loads.then(|| "--load".to_owned());
        let wish = { keys }
            .map(|key| format!("`{}.{key}`", role.side))
            .chain(flag)
            .next()?;
        Some(format!("{wish} has no effect"))
    }
}

/// Source of program names other than the command line.
pub enum Named<'a> {
    /// No other source.
    Nothing,
    /// A scenario.
    Scenario {
        /// File of the scenario.
        file: &'a Path,
        /// Text of the scenario.
        text: &'a str,
        /// Programs that the text names.
        programs: Box<Programs>,
    },
    /// A recording.
    Recorded(&'a Recorded),
}

/// Programs of a recorded run, as far as they were named: programs next to `hil` are not recorded.
#[derive(Clone, Debug)]
pub struct Recorded {
    run: PathBuf,
    plant: Option<PathBuf>,
    controller: Option<PathBuf>,
    /// Patterns of the plant's local signals recorded as truth.
    locals: Vec<String>,
    /// Permissions of plant and controller.
    permissions: [Permissions; 2],
    /// Settings of plant and controller.
    settings: [ModelSettings; 2],
    /// Hashes of the plant's and the controller's program.
    pub blake3: [Option<String>; 2],
    /// `true` if this user recorded the run; the error is the reason why this cannot be determined.
    is_own: Result<bool, String>,
    host: String,
}

impl Recorded {
    /// Reads the programs that the recording of a run names.
    pub fn of(reader: &RunReader, run: &Path) -> Self {
        let fact = |name| reader.fact(name).map(str::to_owned);
        let permitted: Vec<String> = (reader.fact(PERMISSIONS))
            .and_then(|text| serde_json::from_str(text).ok())
            .unwrap_or_default();
        Self {
            run: run.to_owned(),
            plant: fact("plant_binary").map(PathBuf::from),
            controller: fact("controller_binary").map(PathBuf::from),
            locals: (reader.fact(LOCALS))
                .and_then(|text| serde_json::from_str(text).ok())
                .unwrap_or_default(),
            permissions: [&PLANT, &CONTROLLER].map(|role| {
                Permissions::of(|key| permitted.contains(&format!("{}.{key}", role.side)))
            }),
            settings: (reader.fact(MODEL_SETTINGS))
                .and_then(|text| serde_json::from_str(text).ok())
                .unwrap_or_default(),
            blake3: [fact("plant_blake3"), fact("controller_blake3")],
            is_own: seal::is_own(|name| reader.fact(name)),
            host: fact("host").unwrap_or_default(),
        }
    }

    /// Returns `true` if this user recorded the run, as far as can be determined.
    pub fn is_own(&self) -> bool {
        self.is_own == Ok(true)
    }

    /// Returns the programs that a scenario of this run may name.
    pub fn programs(&self) -> Programs {
        if !self.is_own() {
            return Programs::default();
        }
        let [plant_settings, controller_settings] = self.settings.clone();
        Programs {
            plant: self.plant.clone(),
            controller: self.controller.clone().map(ControllerProgram::One),
            locals: self.locals.clone(),
            plant_permissions: self.permissions[0],
            controller_permissions: self.permissions[1],
            plant_settings,
            controller_settings,
        }
    }

    /// Returns the named programs.
    pub fn named(&self) -> impl Iterator<Item = (&'static Role, &Path)> {
        let all = [(&PLANT, &self.plant), (&CONTROLLER, &self.controller)];
        (all.into_iter()).filter_map(|(role, path)| Some((role, path.as_deref()?)))
    }

    fn choice(&self, role: &Role) -> Result<Option<Choice>, Failure> {
        let run = self.run.display();
        let Some((_, path)) = self.named().find(|(named, _)| *named == role) else {
            return Ok(None);
        };
        let (side, flag, path_text) = (role.side, role.flag, path.display());
        if !self.is_own() {
            let origin = match &self.is_own {
                Ok(_) => format!(
                    "{run} was not recorded by this user on this machine (host {:?})",
                    self.host
                ),
                Err(why) => format!("cannot determine whether this user recorded {run} ({why})"),
            };
            return Err(Failure::usage(format!(
                "{origin}, so the {side} program named in it, {path_text}, is not run; choose a program with {flag} PATH"
            )));
        }
        let path = trusted::program(path).map_err(|why| {
            Failure::usage(format!(
                "{run} was recorded with the {side} program {path_text}, which is not run: {why}; choose a program with {flag} PATH"
            ))
        })?;
        let [plant, controller] = &self.blake3;
        let blake3 = if role == &PLANT { plant } else { controller };
        Ok(Some(Choice {
            blake3: Some(blake3.clone().unwrap_or_default()),
            ..Choice::new(path, NamedBy::Recording(self.run.clone()))
        }))
    }
}

/// Refuses flags that configure a program if the scenario names none, because they would have no effect.
///
/// # Errors
/// The first such flag, with the flag that names a program; `flag` returns the flag of a side.
pub fn refuse_set(set: &[String], flag: impl Fn(&Role) -> &str) -> Result<(), Failure> {
    for one in set {
        let key = one.split('=').next().unwrap_or_default().trim();
        let sets = |role: &&&Role| {
            let rest = key.strip_prefix(role.key);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        if let Some(role) = [&PLANT, &CONTROLLER].iter().find(sets) {
            return Err(Failure::usage(format!(
                "--set {key} has no effect, because the scenario names no program; use {} PATH to name the {} program",
                flag(role),
                role.side
            )));
        }
    }
    Ok(())
}

impl<'a> Named<'a> {
    /// Takes a scenario as the source.
    pub fn by(scenario: &'a Scenario) -> Self {
        Self::Scenario {
            file: scenario.path(),
            text: scenario.text(),
            programs: Box::new(scenario.programs()),
        }
    }

    /// Returns the patterns of local signals for a side.
    fn locals(&self, role: &Role) -> Vec<String> {
        match self {
            Self::Scenario { programs, .. } if role == &PLANT => programs.locals.clone(),
            Self::Recorded(recorded) if role == &PLANT => recorded.locals.clone(),
            _ => Vec::new(),
        }
    }

    /// Returns the permissions of a side.
    fn permissions(&self, role: &Role) -> Permissions {
        let [plant, controller] = match self {
            Self::Scenario { programs, .. } => {
                [programs.plant_permissions, programs.controller_permissions]
            }
            Self::Recorded(recorded) => recorded.permissions,
            Self::Nothing => [Permissions::default(); 2],
        };
        if role == &PLANT { plant } else { controller }
    }

    /// Returns the settings of a side.
    fn settings(&self, role: &Role) -> ModelSettings {
        let [plant, controller] = match self {
            Self::Scenario { programs, .. } => {
                [&programs.plant_settings, &programs.controller_settings]
            }
            Self::Recorded(recorded) => recorded.settings.each_ref(),
            Self::Nothing => return ModelSettings::default(),
        };
        let of_side = if role == &PLANT { plant } else { controller };
        of_side.clone()
    }

    /// Returns the program of a side; `given` is the program from the command line, `at` the machine that runs it.
    ///
    /// # Errors
    /// If a program named by a file must not be run.
    pub fn choice(
        &self,
        role: &'static Role,
        argument: Option<&Path>,
        at: Option<&Reached>,
    ) -> Result<Choice, Failure> {
        let variable = std::env::var_os(role.variable).filter(|value| !value.is_empty());
        let person = match (argument, &variable) {
            (Some(path), _) => Some((path, role.flag)),
            (None, Some(path)) => Some((Path::new(path), role.variable)),
            (None, None) => None,
        };
        let choice = if let Some((path, by)) = person {
            // Absolute, so that the program run is the one hashed: a bare name is searched for elsewhere.
            let path = std::path::absolute(path).map_err(Failure::usage)?;
            Choice::new(path, NamedBy::Person(by))
        } else {
            let named = match self {
                Self::Nothing => None,
                Self::Scenario {
                    file,
                    text,
                    programs,
                } => by_scenario(role, file, text, programs, at)?,
                Self::Recorded(recorded) => recorded.choice(role)?,
            };
            match named {
                Some(choice) => choice,
                None => Choice::new(beside(role.beside)?, NamedBy::Nobody),
            }
        };
        Ok(Choice {
            locals: self.locals(role),
            permissions: self.permissions(role),
            settings: self.settings(role),
            ..choice
        })
    }
}

/// Environment variable that names Cargo's target folder instead of `target`.
const TARGET_DIR: &str = "CARGO_TARGET_DIR";

/// Returns the location of a program in Cargo's target folder, if `path` leads into the folder `target` of a
/// package.
fn in_target_folder(path: &Path, folder: &OsStr) -> Option<PathBuf> {
    let mut packages = path.ancestors().skip(1);
    let default = packages.find(|place| {
        let is_package = || place.with_file_name("Cargo.toml").is_file();
        place.file_name().is_some_and(|name| name == "target") && is_package()
    })?;
    let folder = Some(Path::new(folder)).filter(|folder| folder.is_absolute())?;
    Some(folder.join(path.strip_prefix(default).ok()?))
}

fn by_scenario(
    role: &'static Role,
    file: &Path,
    text: &str,
    programs: &Programs,
    at: Option<&Reached>,
) -> Result<Option<Choice>, Failure> {
    let (key, flag, path_text) = (role.key, role.flag, file.display());
    let path = match (&programs.controller, role == &PLANT) {
        (_, true) => programs.plant.as_deref(),
        (None, false) => None,
        (Some(program), false) => {
            let here = rustix::system::uname();
            let here = here.machine().to_string_lossy();
            let machine = at.map_or(&*here, |at| &at.findings().machine);
            let place = at.map_or_else(
                || "this machine".to_owned(),
                |at| format!("target {}", at.target()),
            );
            let program_path = program.for_machine(machine);
            Some(program_path.ok_or_else(|| {
                Failure::usage(format!(
                    "{path_text}: `{key}` has no program for {place}, {machine}; add one, or name it with {flag} PATH"
                ))
            })?)
        }
    };
    let Some(path) = path else {
        return Ok(None);
    };
    let refused = |why: String| {
        let path = path.display();
        Failure::usage(format!(
            "{path_text} names the {} program {path}, which is not run: {why}; choose a program with {flag} PATH",
            role.side
        ))
    };
    let is_missing =
        |path: &Path| fs::metadata(path).is_err_and(|error| error.kind() == ErrorKind::NotFound);
    let moved = std::env::var_os(TARGET_DIR).and_then(|folder| in_target_folder(path, &folder));
    let path = match (is_missing(path), &moved) {
        (false, _) => path,
        (true, Some(moved)) if !is_missing(moved) => moved.as_path(),
        (true, moved) => {
            let also = moved.as_ref().map_or_else(String::new, |moved| {
                format!(", nor does {}, where {TARGET_DIR} points", moved.display())
            });
            return Err(refused(format!(
                "it does not exist{also}; build it (paths in a scenario are relative to its folder)"
            )));
        }
    };
    // The content just read is that of the file, because nobody else can have written the file.
    let (own, _) = trusted::file(file).map_err(refused)?;
    if read_regular(&own).ok().as_deref() != Some(text) {
        return Err(refused(format!("{path_text} was changed meanwhile")));
    }
    let path = trusted::program(path).map_err(refused)?;
    let by = NamedBy::Scenario(key, file.to_owned());
    Ok(Some(Choice::new(path, by)))
}
/// Returns `true` if an error message reports a lack of files, processes or memory.
fn lacks_room(error: &str) -> bool {
    use rustix::io::Errno;
    let lacking = [Errno::MFILE, Errno::NFILE, Errno::AGAIN, Errno::NOMEM];
    let mut numbers = lacking.iter().map(|errno| errno.raw_os_error());
    numbers.any(|number| error.contains(&format!("(os error {number})")))
}
