//! FMUs for co-simulation, of FMI 2.0 and 3.0, as plants and as controllers.
//!
//! 1. [`archive`] reads the file without trust; [`description`] is the model description.
//! 2. [`tables`] maps its variables to signals and parameters. Up to here nothing is unpacked or run, which suffices
//!    for `--describe`.
//! 3. `library` loads the shared library, unpacked into a [private folder](PrivateFolder); `instance` calls its
//!    functions in the order of the standard, `values` converts rows to its types and sets and reads them, and `journal` receives its
//!    messages.
//! 4. [`sides`] turns the FMU into a plant or a law for the program `hil-fmu`; `linear` is the linear model of a plant that
//!    provides directional derivatives.
//!
//! An FMU is third-party native code. It runs in its own process, so that a crash is reported as the loss of that side;
//! apart from that, it has all the rights of the user.

use std::collections::BTreeSet;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use glob::Pattern;
use hil_session::private_folder::PrivateFolder;
use hil_session::program;
use shared_types::describe::{Invalid, LibraryNeeds, ModelSettings};

use archive::{Archive, ArchiveError, LIMITS, Limits, TRUSTED};
use description::{DescriptionError, ModelDescription, VariableType};
use library::{Functions, LibraryError, Uses};
use start::Start;
use tables::Tables;

pub mod archive;
pub mod description;
mod instance;
mod journal;
mod library;
mod linear;
mod settable;
pub mod sides;
mod start;
mod status;
pub mod tables;
mod values;

/// Name of the model description in an archive.
const DESCRIPTION: &str = "modelDescription.xml";
/// Maximum size of a model description in bytes; those of large vehicles have about 30 MB.
const LONGEST_DESCRIPTION: u64 = 64 << 20;

/// Error of using an FMU.
#[derive(Debug, thiserror::Error)]
pub enum FmuError {
    /// The archive is invalid.
    #[error(transparent)]
    Archive(#[from] ArchiveError),
    /// The model description is invalid.
    #[error(transparent)]
    Description(#[from] DescriptionError),
    /// There is no library for this machine.
    #[error("the FMU has no library for {platform}, {name}: {there}")]
    Platform {
        /// Folder of this machine's libraries.
        platform: &'static str,
        /// Required name of the library.
        name: String,
        /// Description of the existing libraries.
        there: String,
    },
    /// Requires the user's permission.
    #[error(
        "{reason}; set `{key} = true` in the scenario to run it nevertheless, or pass --{} to describe it",
        flag(key)
    )]
    Forbidden {
        /// Reason for the refusal.
        reason: String,
        /// Key of the permission in the scenario.
        key: &'static str,
    },
    /// The shared library cannot be used.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// The variables have conflicting names, or the parameters are inconsistent.
    #[error("{0}")]
    Invalid(String),
    /// The folder for unpacking cannot be created.
    #[error("cannot create a folder for unpacking: {0}")]
    Place(std::io::Error),
}

impl From<Invalid> for FmuError {
    fn from(invalid: Invalid) -> Self {
        Self::Invalid(invalid.0)
    }
}

/// Returns the flag of `hil describe` that corresponds to a key of the scenario.
fn flag(key: &str) -> String {
    let name = key.split_once('.').map_or(key, |(_, name)| name);
    name.replace('_', "-")
}

/// Permissions of an FMU.
#[derive(Clone, Copy, Debug, Default)]
pub struct Permissions {
    /// Permission to unpack to many times the archive's size.
    pub trust_archive: bool,
    /// Permission to use the tool that the FMU declares to need.
    pub allow_execution_tool: bool,
    /// Set for a controller, clear for a plant.
    pub is_of_controller: bool,
}

impl Permissions {
    const fn limits(self) -> &'static Limits {
        match self.trust_archive {
            true => &TRUSTED,
            false => &LIMITS,
        }
    }

    const fn key(self, [plant, controller]: [&'static str; 2]) -> &'static str {
        match self.is_of_controller {
            true => controller,
            false => plant,
        }
    }
}

/// Description and tables of an FMU.
#[derive(Debug)]
pub struct Model {
    /// The description in the form that the FMU provides.
    pub description: ModelDescription,
    /// Signals and parameters derived from the description.
    pub tables: Tables,
    /// Start settings of its instances.
    start: Start,
}

impl Model {
    /// Builds the model of a description, including the local signals that match a pattern; its instances start with
    /// these settings.
    ///
    /// # Errors
    /// If two names conflict, a pattern matches nothing, or a setting is invalid.
    pub fn of(
        description: ModelDescription,
        patterns: &[Pattern],
        settings: &ModelSettings,
    ) -> Result<Self, Invalid> {
        Ok(Self {
            tables: Tables::of(&description, patterns)?,
            start: Start::of(&description, settings)?,
            description,
        })
    }

    /// Checks that a run of this length ends before the stop time of the scenario.
    ///
    /// # Errors
    /// If the run is longer.
    pub fn check_run(&self, length_s: f64) -> Result<(), Invalid> {
        self.start.check_run(length_s)
    }
}

/// FMU with its description; unpacked and loaded when the first instance is created.
#[derive(Debug)]
pub struct Fmu {
    path: PathBuf,
    permissions: Permissions,
    model: Arc<Model>,
    loaded: OnceLock<Loaded>,
}

/// Loaded library of an FMU, with the folder that contains it.
#[derive(Debug)]
struct Loaded {
    functions: Arc<Functions>,
    resources: PathBuf,
    // Removed at the end of the process, because its files may be read at any time.
    _unpacked: PrivateFolder,
}

impl Fmu {
    /// Reads the archive and the model description; runs no code of the FMU. Local signals that match a pattern
    /// become part of the truth, and instances start with these settings.
    ///
    /// # Errors
    /// If the file is not an FMU that can be run here.
    pub fn open(
        path: &Path,
        patterns: &[Pattern],
        permissions: Permissions,
        settings: &ModelSettings,
    ) -> Result<Self, FmuError> {
        let archive = Archive::open(path, permissions.limits());
        let mut archive = archive.map_err(|error| match error {
            ArchiveError::Ratio { .. } => FmuError::Forbidden {
                reason: error.to_string(),
                key: permissions.key(["plant.trust_archive", "controller.trust_archive"]),
            },
            other => other.into(),
        })?;
        let bytes = archive.content(DESCRIPTION, LONGEST_DESCRIPTION)?;
        let description = ModelDescription::resized(&bytes, &settings.structural)?;
        if description.needs_tool && !permissions.allow_execution_tool {
            let keys = [
                "plant.allow_execution_tool",
                "controller.allow_execution_tool",
            ];
            return Err(FmuError::Forbidden {
                reason: "the FMU requires the tool that generated it (needsExecutionTool)".into(),
                key: permissions.key(keys),
            });
        }
        check_platform(&archive, &description)?;
        Ok(Self {
            path: path.to_owned(),
            permissions,
            model: Arc::new(Model::of(description, patterns, settings)?),
            loaded: OnceLock::new(),
        })
    }

    /// Returns the description and tables.
    #[must_use]
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Unpacks and loads the library, once.
    fn loaded(&self) -> Result<&Loaded, FmuError> {
        if let Some(loaded) = self.loaded.get() {
            return Ok(loaded);
        }
        let loaded = self.load()?;
        Ok(self.loaded.get_or_init(|| loaded))
    }

    /// Loads the library to list its dependencies and the missing ones.
    ///
    /// # Errors
    /// If the library cannot be unpacked.
    pub fn needs(&self) -> Result<LibraryNeeds, FmuError> {
        let unpacked = self.unpack()?;
        let description = &self.model.description;
        let library = unpacked.folder().join(library_name(description));
        Ok(library::host::needs(&library, description.needs_tool))
    }

    /// Unpacks this machine's libraries and the resources.
    fn unpack(&self) -> Result<PrivateFolder, FmuError> {
        let unpacked = PrivateFolder::create("fmu").map_err(FmuError::Place)?;
        let mut archive = Archive::open(&self.path, self.permissions.limits())?;
        let platform = tables::platform(self.model.description.version);
        archive.extract(&format!("binaries/{platform}/"), unpacked.folder())?;
        archive.extract("resources/", unpacked.folder())?;
        Ok(unpacked)
    }

    fn load(&self) -> Result<Loaded, FmuError> {
        let Model {
            description,
            tables,
            start,
        } = &*self.model;
        let unpacked = self.unpack()?;
        let library = library_name(description);
        let resources = unpacked.folder().join("resources");
        // The standard requires the folder even if the archive has none.
        std::fs::create_dir_all(&resources).map_err(FmuError::Place)?;
        let columns: [&[_]; 6] = [
            &tables.parameters,
            &tables.inputs,
            &tables.outputs,
            &tables.locals,
            &start.structural.columns,
            &start.initial.columns,
        ];
        let mut kinds = tables::kinds(description, &columns);
        if !start.texts.is_empty() {
            kinds.push(VariableType::String);
        }
        if !tables.states.is_empty() {
            kinds.push(VariableType::Float64);
        }
        let functions = Functions::load(
            &unpacked.folder().join(library),
            description.version,
            &kinds,
            &Uses {
                state: description.saves,
                tool: description.needs_tool,
                configuration: !start.structural.row.is_empty(),
                derivatives: description.differentiates,
            },
        )?;
        Ok(Loaded {
            functions: Arc::new(functions),
            resources,
            _unpacked: unpacked,
        })
    }
}

/// Marks this process as one that only tries an FMU: a crash while freeing an instance without a step does not count as
/// a failure.
pub fn begin_trial() {
    crate::crash::begin_trial();
}

/// Stores the name of the current call in a session's folder, where `hil` finds it if this process is killed.
///
/// # Errors
/// If there is no room for the name.
pub fn share_calls(folder: &Path) -> std::io::Result<()> {
    let path = program::call_file(folder, std::process::id());
    let mut options = std::fs::OpenOptions::new();
    options.read(true).write(true).create_new(true).mode(0o600);
    crate::crash::share(&options.open(path)?)
}

/// Prints on standard output that a trial was completed, which an FMU may prevent by ending the process.
pub fn end_trial() {
    crate::crash::say_checked();
}

/// Ends this process without running exit handlers: an interpreter embedded in an FMU would shut down there while its
/// extensions still use it, so that a complete run would end in a crash.
pub fn leave(code: u8) -> ! {
    // SAFETY: flushes all streams of the C library and ends the process.
    unsafe {
        libc::fflush(std::ptr::null_mut());
        libc::_exit(code.into())
    }
}

fn library_name(description: &ModelDescription) -> String {
    let folder = tables::platform(description.version);
    format!("binaries/{folder}/{}.so", description.identifier)
}

fn check_platform(
    archive: &Archive<std::fs::File>,
    description: &ModelDescription,
) -> Result<(), FmuError> {
    let library = library_name(description);
    if archive.names().any(|name| name == library) {
        return Ok(());
    }
    let platform = tables::platform(description.version);
    let all: Vec<&str> = archive.names().collect();
    let folder = |name: &&str| {
        let (folder, _) = name.strip_prefix("binaries/")?.split_once('/')?;
        Some(folder.to_owned())
    };
    let folders: BTreeSet<String> = all.iter().filter_map(folder).collect();
    let own = format!("binaries/{platform}/");
    let beside = all.iter().filter_map(|name| name.strip_prefix(&own));
    let beside: Vec<&str> = beside.filter(|name| name.ends_with(".so")).collect();
    let has_sources = all.iter().any(|name| {
        name.strip_prefix("sources/")
            .is_some_and(|name| name.ends_with(".c"))
    });
    let existing = if !beside.is_empty() {
        let beside = beside.join(", ");
        format!("{platform} contains {beside}, but the name must be the modelIdentifier")
    } else if has_sources {
        "the FMU has C sources; build the library with `python3 -m fmpy compile FILE.fmu`, or export the FMU with one for Linux".into()
    } else if folders.is_empty() {
        "there is no library at all; export the FMU with one for Linux".into()
    } else {
        let folders = folders.into_iter().collect::<Vec<_>>().join(", ");
        format!("there are libraries for {folders}; export the FMU with one for Linux")
    };
    Err(FmuError::Platform {
        platform,
        name: format!("{}.so", description.identifier),
        there: existing,
    })
}
