//! Provenance of a program, embedded by its build script: commits, uncommitted changes and the lock file.
//!
//! Used by the `build.rs` of each package that has a plant's or controller's `main`; `shared_types::origin!()` reads
//! the embedded record, and `--describe` prints it. Without `git` or a commit the build records their absence and
//! continues.
//!
//! The sources are those of the package and of all its path dependencies; the commit is the last one that changed any
//! of them. The script therefore reruns when a source changes or, while there are uncommitted changes, at the next
//! commit. Commits that touch other files trigger no rebuild. If a commit is later rewritten with the same sources, the
//! program keeps the old hash.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Text in place of a commit for sources outside any commit.
const UNKNOWN: &str = "unknown";
/// Parts of a package from which its program is built.
const PARTS: [&str; 3] = ["src", "Cargo.toml", "build.rs"];

/// Embeds the provenance of the package whose build script calls this function. The build variable `HIL_COMMIT` holds
/// the commit alone.
///
/// # Panics
/// If called outside a build script.
pub fn note() {
    let variable = |name: &str| std::env::var(name).unwrap_or_else(|_| panic!("{name} is not set"));
    let origin = Origin::of(Path::new(&variable("CARGO_MANIFEST_DIR")));
    for path in &origin.watched {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    let modified = if origin.is_modified { "-modified" } else { "" };
    println!("cargo::rustc-env=HIL_COMMIT={}{modified}", origin.commit());
    let file = Path::new(&variable("OUT_DIR")).join("origin.rs");
    let text = origin.expression(&variable("CARGO_PKG_VERSION"));
    fs::write(&file, text).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
}

/// Provenance of a package.
#[derive(Debug, Default)]
struct Origin {
    /// Last commit of the sources in each repository, the package's own first; `None` for packages outside any
    /// repository.
    commits: Vec<Option<String>>,
    is_modified: bool,
    lock: Option<PathBuf>,
    watched: Vec<PathBuf>,
}

impl Origin {
    fn of(package: &Path) -> Self {
        let mut origin = Self::default();
        let packages = Packages::of(package);
        if let Some(root) = &packages.root {
            origin.lock = Some(root.join("Cargo.lock")).filter(|lock| lock.is_file());
            origin.watched.push(root.join("Cargo.toml"));
            origin.watched.extend(origin.lock.clone());
        }
        // Sources by repository; those outside any repository under `None`.
        let mut repositories: Vec<(Option<PathBuf>, Vec<PathBuf>)> = Vec::new();
        for folder in &packages.folders {
            let parts = PARTS.map(|part| folder.join(part));
            let parts = parts.into_iter().filter(|part| part.exists());
            // A folder may lie inside a repository without being tracked by it; such a package has no commit.
            let is_part = git(folder, &["ls-files", "--error-unmatch", "Cargo.toml"]).is_some();
            let top = git(folder, &["rev-parse", "--show-toplevel"]).filter(|_| is_part);
            let top = top.map(PathBuf::from);
            match repositories.iter_mut().find(|(known, _)| *known == top) {
                Some((_, all)) => all.extend(parts),
                None => repositories.push((top, parts.collect())),
            }
        }
        for (top, sources) in repositories {
            let commit = top.and_then(|top| origin.look(&top, &sources));
            origin.commits.push(commit);
            origin.watched.extend(sources);
        }
        origin
    }

    /// Inspects the sources in a repository and returns the last commit that changed them.
    fn look(&mut self, top: &Path, sources: &[PathBuf]) -> Option<String> {
        let ask = |arguments: &[&str]| {
            let sources = sources.iter().map(|source| source.as_os_str());
            let all = arguments.iter().map(OsStr::new);
            git(top, &all.chain(sources).collect::<Vec<_>>())
        };
        let status = ask(&["status", "--porcelain", "--untracked-files=normal", "--"]);
        if status.is_none_or(|changes| !changes.is_empty()) {
            self.is_modified = true;
            let files = ["HEAD", "logs/HEAD"].map(|file| {
                let path = ["rev-parse", "--path-format=absolute", "--git-path", file];
                git(top, &path).map(PathBuf::from)
            });
            let files = files.into_iter().flatten();
            self.watched.extend(files.filter(|file| file.exists()));
        }
        ask(&["log", "-1", "--format=%H", "--"]).filter(|commit| !commit.is_empty())
    }

    /// Joins the commits into one text.
    fn commit(&self) -> String {
        if self.commits.is_empty() {
            return UNKNOWN.into();
        }
        let all = self.commits.iter();
        let all: Vec<&str> = all.map(|one| one.as_deref().unwrap_or(UNKNOWN)).collect();
        all.join("+")
    }

    /// Formats the provenance as the expression that `shared_types::origin!()` includes.
    fn expression(&self, version: &str) -> String {
        let is_known = self.commits.iter().any(Option::is_some);
        let commit = is_known.then(|| self.commit());
        let lock = self.lock.as_deref().and_then(Path::to_str);
        let lock = lock.map_or_else(
            || "None".to_owned(),
            |lock| format!("Some(&include_bytes!({lock:?})[..])"),
        );
        let modified = self.is_modified;
        format!(
            "::shared_types::origin::Origin {{ version: {version:?}.into(), source: Some(::shared_types::origin::Source {{ \
             commit: {commit:?}, modified: {modified}, lock: {lock} }}) }}\n"
        )
    }
}

/// A package with its direct and transitive path dependencies.
#[derive(Debug, Default)]
struct Packages {
    /// Workspace folder, which contains the lock file.
    root: Option<PathBuf>,
    /// Package folders, the package's own first.
    folders: Vec<PathBuf>,
}

impl Packages {
    fn of(package: &Path) -> Self {
        let mut packages = Self {
            root: None,
            folders: vec![package.to_owned()],
        };
        let mut named: BTreeMap<PathBuf, BTreeSet<PathBuf>> = BTreeMap::new();
        let mut place = 0;
        while let Some(folder) = packages.folders.get(place).cloned() {
            place += 1;
            if !named.contains_key(&folder)
                && let Some(metadata) = metadata(&folder)
            {
                packages
                    .root
                    .get_or_insert_with(|| path(&metadata["workspace_root"]));
                named.extend(list(&metadata["packages"]).map(dependencies));
            }
            for next in named.get(&folder).into_iter().flatten() {
                if !packages.folders.contains(next) {
                    packages.folders.push(next.clone());
                }
            }
        }
        packages
    }
}

/// Folder of a package and the folders of its path dependencies, build and dev dependencies excluded.
fn dependencies(package: &Value) -> (PathBuf, BTreeSet<PathBuf>) {
    let manifest = path(&package["manifest_path"]);
    let folder = manifest.parent().unwrap_or(Path::new("")).to_owned();
    let normal = list(&package["dependencies"]).filter(|one| one["kind"].is_null());
    let named = normal.filter(|one| one["path"].is_string());
    (folder, named.map(|one| path(&one["path"])).collect())
}

fn metadata(folder: &Path) -> Option<Value> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let arguments = [
        "metadata",
        "--no-deps",
        "--offline",
        "--format-version",
        "1",
    ];
    let output = Command::new(cargo)
        .args(arguments)
        .current_dir(folder)
        .output()
        .ok()?;
    serde_json::from_slice(&output.stdout).ok()
}

fn list(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten()
}

fn path(value: &Value) -> PathBuf {
    value.as_str().unwrap_or_default().into()
}

/// Output of `git` run in a folder; `None` if it failed or is not installed.
fn git(folder: &Path, arguments: &[impl AsRef<OsStr>]) -> Option<String> {
    let output = Command::new("git")
        .arg("-C")
        .arg(folder)
        .args(arguments)
        // A build must not modify the repository.
        .env("GIT_OPTIONAL_LOCKS", "0")
        .output()
        .ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

#[cfg(test)]
mod tests;
