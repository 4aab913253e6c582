//! FMUs of FMI 2.0 and 3.0 for co-simulation, as plants and as controllers.
//!
//! 1. [`archive`] is the file, read without trust; [`description`] is what the model says of itself.
//! 2. [`tables`] makes signals and parameters of its variables. So far nothing was unpacked or run, and
//!    `--describe` needs no more.
//! 3. `library` loads the shared library, which was unpacked into a [private folder](PrivateFolder); `instance` calls
//!    its functions in the order of the standard, `values` carries rows to its types, `journal` takes its
//!    messages.
//! 4. [`sides`] makes a plant and a law of it, for the program `hil-fmu`.
//!
//! An FMU is native code of somebody else. It runs in a process of its own, so that a crash is the loss of one
//! side with a name; nothing here keeps it from doing what any program of this user can do.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use glob::Pattern;
use hil_session::private_folder::PrivateFolder;
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
mod settable;
pub mod sides;
mod start;
mod status;
pub mod tables;
mod values;

/// Name of the model description in an archive.
const DESCRIPTION: &str = "modelDescription.xml";
/// Most bytes of a model description: those of large vehicles have some 30 MB.
const LONGEST_DESCRIPTION: u64 = 64 << 20;

/// An FMU cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FmuError {
    /// The archive.
    #[error(transparent)]
    Archive(#[from] ArchiveError),
    /// The model description.
    #[error(transparent)]
    Description(#[from] DescriptionError),
    /// There is no library for this machine.
    #[error("it has no library for {platform}, {name}: {there}")]
    Platform {
        /// Folder of this machine's libraries.
        platform: &'static str,
        /// Name that the library must have.
        name: String,
        /// Libraries that are there, in a sentence.
        there: String,
    },
    /// Refused unless the user permits it.
    #[error(
        "{reason}; `{key} = true` in the scenario runs it all the same, and --{} describes it",
        flag(key)
    )]
    Forbidden {
        /// Reason.
        reason: String,
        /// Key of the scenario.
        key: &'static str,
    },
    /// The shared library.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// The variables cannot have names, or the parameters do not go together.
    #[error("{0}")]
    Invalid(String),
    /// There is no place to unpack into.
    #[error("cannot make a folder to unpack into: {0}")]
    Place(std::io::Error),
}

impl From<Invalid> for FmuError {
    fn from(invalid: Invalid) -> Self {
        Self::Invalid(invalid.0)
    }
}

/// The flag of `hil describe` for a key of the scenario.
fn flag(key: &str) -> String {
    let name = key.split_once('.').map_or(key, |(_, name)| name);
    name.replace('_', "-")
}

/// Permissions that the user gives to an FMU.
#[derive(Clone, Copy, Debug, Default)]
pub struct Permissions {
    /// Permission to unpack to many times the archive's size.
    pub trust_archive: bool,
    /// Permission to use the tool that it says it needs.
    pub allow_execution_tool: bool,
    /// True if they are those of the controller, not of the plant.
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
    /// The description as the FMU has it.
    pub description: ModelDescription,
    /// Signals and parameters made of it.
    pub tables: Tables,
    /// Start of its instances.
    start: Start,
}

impl Model {
    /// The model of a description, with the inner signals whose names match a pattern, whose instances start with
    /// these settings.
    ///
    /// # Errors
    /// If two names cannot be told apart, a pattern matches none or a setting does not fit.
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

    /// Checks that a run of this length ends before the stop time that its scenario gives.
    ///
    /// # Errors
    /// If the run is longer.
    pub fn check_run(&self, length_s: f64) -> Result<(), Invalid> {
        self.start.check_run(length_s)
    }
}

/// An FMU, described; unpacked and loaded when the first instance is made.
#[derive(Debug)]
pub struct Fmu {
    path: PathBuf,
    permissions: Permissions,
    model: Arc<Model>,
    loaded: OnceLock<Loaded>,
}

/// An FMU's library in the memory of this process, and the folder that it came from.
#[derive(Debug)]
struct Loaded {
    functions: Arc<Functions>,
    resources: PathBuf,
    // Removed with the process; files of it may be read at any time.
    _unpacked: PrivateFolder,
}

impl Fmu {
    /// Reads the archive and the model description at a path; runs nothing of it. Inner signals whose names match
    /// a pattern are part of the truth, and instances start with these settings.
    ///
    /// # Errors
    /// If it is no FMU that can be run here.
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
                reason: "it says that it needs the tool that it was made with (needsExecutionTool)"
                    .into(),
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

    /// Description and tables.
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

    /// Loads the library to say what it needs and what of it this machine does not have.
    ///
    /// # Errors
    /// If it cannot be unpacked.
    pub fn needs(&self) -> Result<LibraryNeeds, FmuError> {
        let unpacked = self.unpack()?;
        let description = &self.model.description;
        let library = unpacked.folder().join(library_name(description));
        Ok(library::host::needs(&library, description.needs_tool))
    }

    /// Unpacks the libraries of this machine and the resources.
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
        // Asked for by the standard also where the archive has none.
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
        let functions = Functions::load(
            &unpacked.folder().join(library),
            description.version,
            &kinds,
            &Uses {
                state: description.saves,
                tool: description.needs_tool,
                configuration: !start.structural.row.is_empty(),
            },
        )?;
        Ok(Loaded {
            functions: Arc::new(functions),
            resources,
            _unpacked: unpacked,
        })
    }
}

/// Marks this process as one that only tries an FMU: a crash in freeing an instance that did no step is then no failure.
pub fn begin_trial() {
    crate::crash::begin_trial();
}

/// Ends this process without what the libraries in it do at an exit: an interpreter that an FMU brought along takes
/// itself apart there while its extensions still use it, which ends a complete run as a crash.
pub fn leave(code: u8) -> ! {
    // SAFETY: writes out what the C library holds of all streams, and ends the process.
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
    let there = if !beside.is_empty() {
        let beside = beside.join(", ");
        format!("{platform} has {beside}, and the name must be modelIdentifier's")
    } else if has_sources {
        "it has C sources; build its library with `python3 -m fmpy compile FILE.fmu`, or export it with one for Linux".into()
    } else if folders.is_empty() {
        "it has no library at all; export it with one for Linux".into()
    } else {
        let folders = folders.into_iter().collect::<Vec<_>>().join(", ");
        format!("it has those for {folders}; export it with one for Linux")
    };
    Err(FmuError::Platform {
        platform,
        name: format!("{}.so", description.identifier),
        there,
    })
}
