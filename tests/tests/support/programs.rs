//! Programs run by tests, built once for each test binary with its own profile and target directory, and
//! requirements that a machine may lack.

use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::fmt::Display;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, OnceLock, PoisonError};

/// Cargo variable for builds outside the workspace: debuggers need line tables only, and more debug information
/// would enlarge programs, which each run hashes. All builds into one folder need the same value, or they build
/// twice.
pub(crate) const LINES: (&str, &str) = ("CARGO_PROFILE_DEV_DEBUG", "line-tables-only");

/// Returns the top of the workspace, where every command is run.
pub(crate) fn workspace() -> &'static Path {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    tests.parent().expect("the workspace is above this package")
}

/// Reads a text of the workspace.
pub(crate) fn shipped(path: impl AsRef<Path>) -> String {
    let path = workspace().join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Profile with which the programs are compiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Profile {
    Debug,
    Release,
}

impl Profile {
    /// Returns the profile of this test binary, which lies in `target/<profile>/deps`.
    fn own() -> Self {
        match own_folder().file_name().and_then(OsStr::to_str) {
            Some("debug") => Self::Debug,
            Some("release") => Self::Release,
            other => panic!("tests run with the profiles dev and release, not {other:?}"),
        }
    }

    /// Returns the folder of the programs.
    fn folder(self) -> PathBuf {
        own_folder().with_file_name(match self {
            Self::Debug => "debug",
            Self::Release => "release",
        })
    }

    /// Creates a `cargo build` with this profile into the target directory of the tests.
    fn build(self) -> Command {
        let mut cargo = Command::new(env!("CARGO"));
        cargo.arg("build").current_dir(workspace());
        cargo.arg("--target-dir").arg(target());
        // The library of the Python package is no program.
        cargo.args(["--workspace", "--bins", "--lib"]);
        if self == Self::Release {
            cargo.arg("--release");
        }
        cargo
    }
}

/// Creates a `cargo build` of all programs and of the examples run by tests, with the profile of this test binary.
pub(crate) fn build() -> Command {
    let mut cargo = Profile::own().build();
    cargo.arg("--examples");
    cargo
}

fn own_folder() -> PathBuf {
    let own = std::env::current_exe().expect("a path to this program");
    let folder = own.ancestors().nth(2);
    folder.expect("it lies in target/<profile>/deps").to_owned()
}

/// Returns the target directory.
pub(crate) fn target() -> PathBuf {
    let own = own_folder();
    own.parent().expect("the target directory").to_owned()
}

pub(crate) fn finish(cargo: &mut Command) {
    let output = cargo.output().expect("cargo can be run");
    let [stdout, stderr] =
        [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text));
    assert!(
        output.status.success(),
        "{cargo:?} failed:\n{stdout}{stderr}"
    );
}

/// Builds all programs once, and returns the path of one.
pub(crate) fn program(name: &str) -> PathBuf {
    static BUILT: OnceLock<()> = OnceLock::new();
    BUILT.get_or_init(|| finish(&mut build()));
    Profile::own().folder().join(name)
}

/// Returns the misbehaving controller, from `tests/examples`.
pub(crate) fn misbehaving_controller() -> PathBuf {
    program_of_tests("misbehaving-controller")
}

/// Returns the misbehaving plant.
pub(crate) fn misbehaving_plant() -> PathBuf {
    program_of_tests("misbehaving-plant")
}

/// Returns a plant or controller from `tests/examples`.
pub(crate) fn program_of_tests(name: &str) -> PathBuf {
    program("examples").join(name)
}

/// Builds `hil` with the other profile, which takes minutes.
pub(crate) fn other_hil() -> PathBuf {
    let other = match Profile::own() {
        Profile::Debug => Profile::Release,
        Profile::Release => Profile::Debug,
    };
    finish(&mut other.build());
    other.folder().join("hil")
}

/// Builds a crate of `examples` and returns its program.
pub(crate) fn example(name: &str) -> PathBuf {
    outside(&Path::new("examples").join(name), name)
}

/// Splits a line at its spaces, except those in the paths of the workspace and of builds.
pub(crate) fn words(line: &str) -> Vec<String> {
    let mut line = line.to_owned();
    for folder in [workspace().to_owned(), target()] {
        let folder = folder.display().to_string();
        line = line.replace(&folder, &folder.replace(' ', "\0"));
    }
    let words = line.split_ascii_whitespace();
    words.map(|word| word.replace('\0', " ")).collect()
}

/// Returns the arguments that run a scenario with the pendulum of `examples` and its own law.
pub(crate) fn of_pendulum(scenario: impl Display) -> String {
    let (plant, controller) = (example("own-plant"), example("own-controller"));
    let (plant, controller) = (plant.display(), controller.display());
    format!("{scenario} --plant-bin {plant} --controller-bin {controller}")
}

/// Runs the tests of a crate of `examples`, without a network.
pub(crate) fn test_example(name: &str) {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["test", "--offline", "--target-dir"]);
    cargo.arg(target().join("examples-outside"));
    cargo.env(LINES.0, LINES.1);
    finish(cargo.current_dir(workspace().join("examples").join(name)));
}

/// Builds a crate outside the workspace, once for each test binary, and returns a permanent copy of its program,
/// because commands of the book rebuild the same crates meanwhile.
pub(crate) fn outside(folder: &Path, program: &str) -> PathBuf {
    static COPIES: Mutex<BTreeMap<PathBuf, PathBuf>> = Mutex::new(BTreeMap::new());
    // A second caller waits for the build, as it would for Cargo's lock.
    let mut copies = COPIES.lock().unwrap_or_else(PoisonError::into_inner);
    let copy = copies.entry(folder.join(program));
    copy.or_insert_with(|| built_outside(folder, program))
        .clone()
}

fn built_outside(folder: &Path, program: &str) -> PathBuf {
    let target = target().join("examples-outside");
    let mut cargo = Command::new(env!("CARGO"));
    cargo.arg("build").current_dir(workspace().join(folder));
    cargo.env(LINES.0, LINES.1);
    finish(cargo.arg("--target-dir").arg(&target));
    let built = target.join("debug").join(program);
    let content = std::fs::read(&built).expect("it was built");
    let place = target
        .join("copies")
        .join(&*blake3::hash(&content).to_hex());
    let copy = place.join(program);
    if !copy.exists() {
        std::fs::create_dir_all(&place).expect("a folder");
        let part = tempfile::Builder::new()
            .tempdir_in(&place)
            .expect("a folder");
        let whole = part.path().join(program);
        std::fs::copy(&built, &whole).expect("copied");
        // Not renamed: another test may have created it meanwhile, and checked it.
        let made = std::fs::hard_link(&whole, &copy);
        assert!(made.is_ok() || copy.exists(), "{made:?}");
    }
    copy
}

/// Returns `true` if a command can be run here and succeeds.
pub(crate) fn works(command: &[&str]) -> bool {
    let mut run = Command::new(command[0]);
    let output = run.args(&command[1..]).stdin(Stdio::null()).output();
    output.is_ok_and(|output| output.status.success())
}

/// Returns the search path of programs, with a folder in front.
pub(crate) fn path_from(folder: &Path) -> OsString {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::iter::once(folder.to_owned()).chain(std::env::split_paths(&path));
    std::env::join_paths(folders).expect("plain names")
}

/// Finds a Chromium, one without windows first: it starts in less processor time.
pub(crate) fn chromium() -> Option<&'static str> {
    let paths = [
        "/usr/bin/chromium-headless-shell",
        "/usr/bin/chromium",
        "/usr/bin/chromium-browser",
    ];
    paths.into_iter().find(|path| Path::new(path).exists())
}

/// Returns `true` if the environment demands an optional feature.
pub(crate) fn demanded(variable: &str) -> bool {
    std::env::var_os(variable).is_some_and(|value| value != "0")
}

/// Reports that the test on this thread was skipped here.
pub(crate) fn skip(why: &str, variable: &str) {
    assert!(!demanded(variable), "{variable} is set, but {why}");
    // A test's thread has the name of the test, after that of its module.
    let thread = std::thread::current();
    let test = thread.name().and_then(|name| name.rsplit("::").next());
    let test = test.unwrap_or("a test");
    // Not `eprintln`, whose output is shown for failed tests only.
    let output = writeln!(
        std::io::stderr(),
        "SKIPPED {test}: {why}; {variable}=1 insists on it"
    );
    output.expect("standard error can be written");
}
