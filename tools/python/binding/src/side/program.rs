//! The process of a plant or a law in Python, started by `hil/side.py`.

use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};

use hil_facts::programs::binaries::trusted;
use hil_session::program::{self, CHECKED, Program};
use hil_session::session::SessionInfo;
use hil_session::supervision::Supervision;
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use shared_types::describe::{Description, Imported, ImportedModule};
use shared_types::local_map::LocalMap;
use shared_types::side::Side;

use super::{failure, law_kind, plant_kind};

/// Adds the functions of `hil/side.py` to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(serve, module)?)?;
    module.add_function(wrap_pyfunction!(distrust, module)?)?;
    module.add_function(wrap_pyfunction!(hash_all, module)?)?;
    module.add_function(wrap_pyfunction!(note_fork, module)?)
}

/// Runs the program of a side with these arguments, of which the first is its own path, and returns its exit code.
///
/// `names` are those of the program, its version and its interpreter; `modules` has the name, the version and the hash
/// of each imported module.
#[pyfunction]
fn serve(
    py: Python<'_>,
    role: &str,
    arguments: Vec<OsString>,
    classes: Vec<Bound<'_, PyAny>>,
    names: (String, String, String),
    modules: Vec<(String, String, String)>,
) -> PyResult<u8> {
    let (name, version, interpreter) = names;
    let module = |(name, version, blake3)| ImportedModule {
        name,
        version,
        blake3,
    };
    let imported = Imported {
        format: interpreter,
        modules: modules.into_iter().map(module).collect(),
        ..Imported::default()
    };
    let classes = classes.iter();
    match role {
        "plant" => {
            let plants = classes.map(plant_kind).collect::<PyResult<_>>()?;
            let inner = plant_process::program::of(&name, version, plants);
            Ok(run(py, &Hosted { inner, imported }, arguments))
        }
        "controller" => {
            let laws = classes.map(law_kind).collect::<PyResult<_>>()?;
            let inner = controller_process::program::of(&name, version, laws);
            Ok(run(py, &Hosted { inner, imported }, arguments))
        }
        other => Err(PyValueError::new_err(format!(
            "`{other}` is neither `plant` nor `controller`"
        ))),
    }
}

/// Runs a program without holding the interpreter, which each call of the class takes.
fn run(py: Python<'_>, hosted: &(impl Program + Sync), arguments: Vec<OsString>) -> u8 {
    failure::begin_log();
    py.detach(|| program::with_stack(|| program::answer(hosted, arguments)))
}

/// Returns the reason for which others than this user and root could have written a file; `None` if they could not.
#[pyfunction]
fn distrust(file: PathBuf) -> Option<String> {
    trusted::file(&file).err()
}

/// Returns the BLAKE3 hash of the files of a package, given with the names of its modules.
///
/// For one file it is the hash of its content; for more, the hash of the lines `name hash`.
#[pyfunction]
fn hash_all(files: Vec<(String, PathBuf)>) -> PyResult<String> {
    let hash = |path: &Path| {
        hil_session::file::hash(path)
            .map_err(|error| PyOSError::new_err(format!("{}: {error}", path.display())))
    };
    if let [(_, path)] = &files[..] {
        return hash(path);
    }
    let mut lines = String::new();
    for (name, path) in &files {
        lines += &format!("{name} {}\n", hash(path)?);
    }
    Ok(blake3::hash(lines.as_bytes()).to_hex().to_string())
}

/// Marks this process as a child that `os.fork` made, which must not return into the loop.
#[pyfunction]
fn note_fork() {
    failure::note_fork();
}

/// Program with the facts about Python added to its description.
struct Hosted<P> {
    inner: P,
    imported: Imported,
}

impl<P: Program> Program for Hosted<P> {
    fn description(&self) -> Description {
        Description {
            imported: Some(Box::new(self.imported.clone())),
            ..self.inner.description()
        }
    }

    fn side(&self) -> Side {
        self.inner.side()
    }

    fn check(&self, job: &Path) -> Result<(), String> {
        self.inner.check(job)?;
        // A class that ends the process must not count as one that passed.
        writeln!(std::io::stdout(), "{CHECKED}").map_err(|error| error.to_string())
    }

    fn linearise(&self, question: &Path) -> Result<LocalMap, String> {
        self.inner.linearise(question)
    }

    fn serve(&self, session: &SessionInfo, supervision: &Supervision) -> Result<u8, String> {
        self.inner.serve(session, supervision)
    }
}
