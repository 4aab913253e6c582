//! `hil new`: creates a project folder that builds, runs and has a test.
//!
//! The folder appears complete or not at all, and refers to the framework by a relative path.

use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

use hil_console::files::folder::refuse_odd;
use hil_console::files::part_file::PartFolder;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use serde::Serialize;

use crate::arguments::new::{Language, NewArguments, What};

/// Packages by which the framework's folder is recognised.
const PACKAGES: [&str; 3] = ["plant-process", "controller-process", "shared-types"];
/// Folder of the package for C.
const FOREIGN: &str = "tools/foreign";
/// Names of built-in plants and laws.
const TAKEN: [&str; 6] = ["drhas", "spring-mass", "pid", "nrsc", "ftsc", "hold"];
/// Names that Cargo reserves for packages, or that clash with the project's folders.
const RESERVED: [&str; 44] = [
    "abstract",
    "alloc",
    "as",
    "async",
    "await",
    "become",
    "box",
    "break",
    "build",
    "const",
    "continue",
    "core",
    "crate",
    "deps",
    "do",
    "dyn",
    "else",
    "enum",
    "examples",
    "extern",
    "false",
    "final",
    "fn",
    "for",
    "if",
    "impl",
    "in",
    "incremental",
    "let",
    "loop",
    "macro",
    "match",
    "mod",
    "move",
    "mut",
    "override",
    "priv",
    "proc-macro",
    "pub",
    "std",
    "test",
    "true",
    "type",
    "use",
];
/// Program of the other side, in the scenario of a project in Python.
const OTHER_IN_PYTHON: &str = "../its-folder/its-file.py";
/// Sentence of a project in Python that is made from a clone.
const OF_CLONE: &str =
    "\nIn a clone that is `export PYTHONPATH=@FRAMEWORK@/tools/python`, with `hil` on the path.";
/// Maximum length of a name in bytes.
const LONGEST: usize = 40;

/// Created project.
#[derive(Serialize)]
struct NewFiles {
    folder: PathBuf,
    files: Vec<String>,
}

/// Creates the folder.
///
/// # Errors
/// If the name is invalid, the folder exists, the framework is not found, or the folder cannot be written.
pub(crate) fn new(arguments: &NewArguments) -> Result<Exit, Failure> {
    let path = &arguments.path;
    let name = name(path)?;
    let path_text = path.display();
    if fs::symlink_metadata(path).is_ok() {
        return Err(Failure::usage(format!(
            "{path_text} already exists; choose another folder"
        )));
    }
    let cannot = |error: io::Error| Failure::usage(format!("cannot create {path_text}: {error}"));
    let parent = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    let place = parent.canonicalize().map_err(cannot)?.join(name);
    refuse_odd(&place)?;
    let is_in_c = arguments.lang == Language::C;
    let is_in_python = arguments.lang == Language::Python;
    if arguments.lang != Language::Rust && arguments.what == What::Scenario {
        let wrong = "--lang applies to a plant or a controller, not to a scenario";
        return Err(Failure::usage(wrong));
    }
    let framework = match arguments.what {
        What::Scenario => None,
        // A wheel is enough.
        What::Plant | What::Controller if is_in_python && arguments.framework.is_none() => {
            framework(None).ok()
        }
        What::Plant | What::Controller => Some(framework(arguments.framework.as_deref())?),
    };
    if let Some(folder) = framework.as_ref().filter(|_| is_in_c)
        && !folder.join(FOREIGN).is_dir()
    {
        let path_text = folder.display();
        return Err(Failure::usage(format!("{path_text} lacks {FOREIGN}")));
    }
    let files = match arguments.lang {
        Language::Rust => files(arguments.what),
        Language::C => files_in_c(arguments.what),
        Language::Python => files_in_python(arguments.what),
    };
    let relative = framework.as_ref().map(|root| relative(root, &place));
    let relative = relative.map_or_else(String::new, |path| path.display().to_string());
    let part = PartFolder::beside(path).map_err(cannot)?;
    let mut project = NewFiles {
        folder: path.clone(),
        files: Vec::new(),
    };
    for (file, template) in files {
        let file = file.replace("@NAME@", name);
        let template = match (arguments.lang, file.ends_with(".toml")) {
            // A program in C lies beside its source.
            (Language::C, true) => template.replace("target/release/", ""),
            (Language::Python, true) => template
                .replace(
                    "target/release/@NAME@",
                    &format!("{}.py", arguments.what.name()),
                )
                .replace("../its-folder/target/release/its-name", OTHER_IN_PYTHON),
            _ => template.to_owned(),
        };
        let text = template
            .replace("@NAME@", name)
            .replace("@KIND@", arguments.what.name())
            .replace("@CLONE@", if relative.is_empty() { "" } else { OF_CLONE })
            .replace("@FRAMEWORK@", &relative);
        write(&part.path().join(&file), &text).map_err(cannot)?;
        project.files.push(file);
    }
    let is_in_rust = arguments.lang == Language::Rust;
    if let Some(framework) = framework.as_ref().filter(|_| is_in_rust) {
        // Versions with which the framework was tested.
        let (from, to) = (framework.join("Cargo.lock"), part.path().join("Cargo.lock"));
        fs::copy(&from, to).map_err(cannot)?;
        project.files.push("Cargo.lock".into());
    }
    part.complete(path).map_err(cannot)?;
    let next = match arguments.what {
        What::Scenario => "",
        What::Plant | What::Controller if is_in_c => "  make test\n  make\n",
        What::Plant | What::Controller if is_in_python => "  python3 -m unittest\n",
        What::Plant | What::Controller => "  cargo test --release\n  cargo build --release\n",
    };
    output::result(arguments.json, &project, || {
        format!(
            "created {path_text}; continue with\n  cd {path_text}\n{next}  hil run {name}.toml\n"
        )
    })?;
    Ok(Exit::Pass)
}

/// Returns the last part of a path, if it is a valid name for a package, a plant, a law and a scenario.
fn name(path: &Path) -> Result<&str, Failure> {
    let name = path.file_name().and_then(|name| name.to_str());
    let name = name.ok_or_else(|| {
        Failure::usage(format!(
            "{}: the path must end with the name of the new folder",
            path.display()
        ))
    })?;
    let is_legal = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    let begins = name.starts_with(|c: char| c.is_ascii_lowercase());
    if !begins || name.ends_with('-') || name.len() > LONGEST || !name.chars().all(is_legal) {
        return Err(Failure::usage(format!(
            "`{name}` is not a valid name: use a-z, 0-9 and -, starting with a letter, at most {LONGEST} characters"
        )));
    }
    if TAKEN.contains(&name) || PACKAGES.contains(&name) {
        return Err(Failure::usage(format!(
            "`{name}` is the name of an existing plant, law or package; choose another name"
        )));
    }
    if RESERVED.contains(&name) {
        return Err(Failure::usage(format!(
            "`{name}` is reserved by Cargo; choose another name"
        )));
    }
    Ok(name)
}

/// Returns the files of a project with their templates.
fn files(what: What) -> Vec<(&'static str, &'static str)> {
    let (code, scenario) = match what {
        What::Scenario => {
            return vec![
                ("@NAME@.toml", include_str!("new/scenario.toml.txt")),
                ("README.md", include_str!("new/scenario.md.txt")),
                (".gitignore", "/runs\n"),
            ];
        }
        What::Plant => (
            include_str!("new/plant.rs.txt"),
            include_str!("new/plant.toml.txt"),
        ),
        What::Controller => (
            include_str!("new/controller.rs.txt"),
            include_str!("new/controller.toml.txt"),
        ),
    };
    vec![
        ("Cargo.toml", include_str!("new/package.toml.txt")),
        (".cargo/config.toml", include_str!("new/cargo.toml.txt")),
        ("src/main.rs", code),
        ("@NAME@.toml", scenario),
        ("README.md", include_str!("new/program.md.txt")),
        (".gitignore", "/target\n/runs\n"),
    ]
}

/// Returns the files of a project in C with their templates.
fn files_in_c(what: What) -> Vec<(&'static str, &'static str)> {
    let (code, test, scenario) = match what {
        What::Controller => (
            include_str!("new/controller.c.txt"),
            include_str!("new/controller_test.c.txt"),
            include_str!("new/controller.toml.txt"),
        ),
        What::Plant | What::Scenario => (
            include_str!("new/plant.c.txt"),
            include_str!("new/plant_test.c.txt"),
            include_str!("new/plant.toml.txt"),
        ),
    };
    vec![
        ("@NAME@.c", code),
        ("@NAME@_test.c", test),
        ("Makefile", include_str!("new/Makefile.txt")),
        ("@NAME@.toml", scenario),
        ("README.md", include_str!("new/program_c.md.txt")),
        (".gitignore", "/@NAME@\n/@NAME@_test\n/runs\n/target\n"),
    ]
}

/// Returns the files of a project in Python with their templates. They are not named after the project, because a
/// module beside them could have that name.
fn files_in_python(what: What) -> Vec<(&'static str, &'static str)> {
    let (code, test, scenario) = match what {
        What::Controller => (
            ("controller.py", include_str!("new/controller.py.txt")),
            (
                "test_controller.py",
                include_str!("new/controller_test.py.txt"),
            ),
            include_str!("new/controller.toml.txt"),
        ),
        What::Plant | What::Scenario => (
            ("plant.py", include_str!("new/plant.py.txt")),
            ("test_plant.py", include_str!("new/plant_test.py.txt")),
            include_str!("new/plant.toml.txt"),
        ),
    };
    vec![
        code,
        test,
        ("@NAME@.toml", scenario),
        ("README.md", include_str!("new/program_python.md.txt")),
        (".gitignore", "__pycache__\n/runs\n"),
    ]
}

fn write(path: &Path, text: &str) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    fs::write(path, text)
}

/// Returns the folder of the framework: the named folder, or an ancestor of this program.
fn framework(named: Option<&Path>) -> Result<PathBuf, Failure> {
    let is_it = |folder: &Path| {
        let mut packages = PACKAGES.iter();
        packages.all(|package| folder.join(package).join("Cargo.toml").is_file())
            && folder.join("Cargo.lock").is_file()
    };
    if let Some(named) = named {
        let path_text = named.display();
        let folder = (named.canonicalize())
            .map_err(|error| Failure::usage(format!("cannot read {path_text}: {error}")))?;
        return match is_it(&folder) {
            true => Ok(folder),
            false => Err(Failure::usage(format!(
                "{path_text} is not a clone of the framework: it lacks Cargo.lock or one of {}",
                PACKAGES.join(", ")
            ))),
        };
    }
    let program = std::env::current_exe().and_then(|path| path.canonicalize());
    let program = program.map_err(Failure::infrastructure)?;
    let root = program.ancestors().find(|folder| is_it(folder));
    root.map(Into::into).ok_or_else(|| {
        Failure::usage(format!(
            "{} is not inside a clone of the framework; name the clone with --framework",
            program.display()
        ))
    })
}

/// Returns the relative path from a folder to another; both are absolute and free of links.
fn relative(to: &Path, from: &Path) -> PathBuf {
    let common = (to.components().zip(from.components()))
        .take_while(|(a, b)| a == b)
        .count();
    let up = from.components().skip(common).map(|_| Component::ParentDir);
    up.chain(to.components().skip(common)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_relative_path_goes_up_only_as_far_as_necessary() {
        for (to, from, way) in [
            ("/a/hil", "/a/cart", "../hil"),
            ("/a/hil", "/a/hil/x/cart", "../.."),
            ("/hil", "/a/b/c", "../../../hil"),
            ("/a/hilly", "/a/hil", "../hilly"),
        ] {
            assert_eq!(relative(Path::new(to), Path::new(from)), Path::new(way));
        }
    }
}
