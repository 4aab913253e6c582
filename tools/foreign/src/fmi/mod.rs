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

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use glob::Pattern;
use shared_types::describe::Invalid;
use shared_types::private_folder::PrivateFolder;

use archive::{Archive, ArchiveError};
use description::{DescriptionError, ModelDescription};
use library::{Functions, LibraryError};
use tables::Tables;

pub mod archive;
pub mod description;
mod instance;
mod journal;
mod library;
pub mod sides;
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
    #[error("it has no library for {wanted}; it has {there}")]
    Platform {
        /// Folder that is missing.
        wanted: &'static str,
        /// Folders that are there, as text.
        there: String,
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

/// Description and tables of an FMU.
#[derive(Debug)]
pub struct Model {
    /// The description as the FMU has it.
    pub description: ModelDescription,
    /// Signals and parameters made of it.
    pub tables: Tables,
}

/// An FMU, described; unpacked and loaded when the first instance is made.
#[derive(Debug)]
pub struct Fmu {
    path: PathBuf,
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
    /// a pattern are part of the truth.
    ///
    /// # Errors
    /// If it is no FMU that can be run here.
    pub fn open(path: &Path, patterns: &[Pattern]) -> Result<Self, FmuError> {
        let mut archive = Archive::open(path)?;
        let bytes = archive.content(DESCRIPTION, LONGEST_DESCRIPTION)?;
        let text = std::str::from_utf8(&bytes).map_err(|_| {
            DescriptionError::Xml("it is not UTF-8, which the standard asks for".into())
        })?;
        let description = ModelDescription::read(text)?;
        check_platform(&archive, &description)?;
        let tables = Tables::of(&description, patterns)?;
        Ok(Self {
            path: path.to_owned(),
            model: Arc::new(Model {
                description,
                tables,
            }),
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

    fn load(&self) -> Result<Loaded, FmuError> {
        let Model {
            description,
            tables,
        } = &*self.model;
        let unpacked = PrivateFolder::create("fmu").map_err(FmuError::Place)?;
        let mut archive = Archive::open(&self.path)?;
        let library = library_name(description);
        let folder = format!("binaries/{}/", tables::platform(description.version));
        archive.extract(&folder, unpacked.folder())?;
        archive.extract("resources/", unpacked.folder())?;
        let resources = unpacked.folder().join("resources");
        // Asked for by the standard also where the archive has none.
        std::fs::create_dir_all(&resources).map_err(FmuError::Place)?;
        let columns: [&[_]; 4] = [
            &tables.parameters,
            &tables.inputs,
            &tables.outputs,
            &tables.locals,
        ];
        let functions = Functions::load(
            &unpacked.folder().join(library),
            description.version,
            &tables::kinds(description, &columns),
            description.saves,
        )?;
        Ok(Loaded {
            functions: Arc::new(functions),
            resources,
            _unpacked: unpacked,
        })
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
    let folder = |name: &str| {
        Some(
            name.strip_prefix("binaries/")?
                .split_once('/')?
                .0
                .to_owned(),
        )
    };
    let folders: std::collections::BTreeSet<String> = archive.names().filter_map(folder).collect();
    let there = folders.into_iter().collect::<Vec<_>>().join(", ");
    Err(FmuError::Platform {
        wanted: tables::platform(description.version),
        there: match there.as_str() {
            "" => "none".into(),
            _ => there,
        },
    })
}
