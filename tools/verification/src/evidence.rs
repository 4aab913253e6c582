//! Evidence of runs for the documents that their requirements come from: a table, JUnit XML, and JSON for sphinx-needs.
//!
//! Reads the summaries of runs and evaluates nothing. A requirement of a document that no run verifies is a row, too.

mod junit;
mod listed;
mod needs;
mod run;
mod table;

use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

use hil_console::files::part_file::write_text;
use hil_console::terminal::exit::Failure;
use serde::Serialize;
use shared_types::number::counted;

use listed::Listed;
use run::{Identity, RecordedRun};

/// File names of the three forms.
const FILES: [&str; 3] = ["evidence.csv", "junit.xml", "needs.json"];

/// Request for evidence.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// Folders of runs.
    pub runs: &'a [PathBuf],
    /// Folder to write to.
    pub folder: &'a Path,
    /// List of the requirements to be verified.
    pub needs: Option<&'a Path>,
    /// `true` if existing files may be replaced.
    pub may_replace: bool,
}

/// Written evidence, in numbers.
#[derive(Debug, Serialize)]
pub struct Evidence {
    /// Written files.
    pub files: Vec<PathBuf>,
    /// Number of runs.
    pub runs: usize,
    /// Folders that are copies of a run, whose tests count once.
    pub copies: Vec<RunCopy>,
    /// Number of requirements of their scenarios, counted in each run.
    pub tests: usize,
    /// Number of those that passed.
    pub passed: usize,
    /// Listed requirements that no run verifies.
    pub untested: Vec<String>,
    /// Identifiers that runs verify but the list lacks; empty without a list.
    pub unknown: Vec<String>,
    /// Number of tests that verify no requirement of a document.
    pub unlinked: usize,
}

/// Copy of a run in another folder.
#[derive(Debug, Serialize)]
pub struct RunCopy {
    /// Folder of the copy.
    pub folder: PathBuf,
    /// Folder of the run that counts.
    pub of: PathBuf,
}

/// Writes the evidence of runs.
///
/// # Errors
/// If a run has no summary or is listed twice, the list cannot be read, or a file exists or cannot be written.
pub fn write(request: &Request<'_>) -> Result<Evidence, Failure> {
    let listed = request.needs.map(listed::read).transpose()?;
    let mut runs: Vec<RecordedRun> =
        (request.runs.iter().map(|path| RecordedRun::read(path))).collect::<Result<_, _>>()?;
    refuse_repeated(&runs)?;
    let copies = remove_copies(&mut runs);
    let folder = request.folder;
    fs::create_dir_all(folder)
        .map_err(|error| Failure::usage(format!("cannot create {}: {error}", folder.display())))?;
    let files = FILES.map(|name| folder.join(name));
    if let Some(file) = files.iter().find(|file| file.exists())
        && !request.may_replace
    {
        let file = file.display();
        return Err(Failure::usage(format!(
            "{file} already exists; --force replaces it"
        )));
    }
    let untested = untested(listed.as_deref().unwrap_or_default(), &runs);
    let texts = [
        table::of(&runs, listed.as_deref().unwrap_or_default(), &untested)?,
        junit::of(&runs, &untested)?,
        needs::of(&runs)?,
    ];
    for (file, text) in files.iter().zip(&texts) {
        write_text(file, text)?;
    }
    let tests = || runs.iter().flat_map(|run| &run.requirements);
    let unknown = listed.as_deref().map(|listed| unknown(listed, &runs));
    Ok(Evidence {
        files: files.into(),
        runs: runs.len(),
        copies,
        tests: tests().count(),
        passed: tests().filter(|test| test.outcome() == "pass").count(),
        untested: untested.iter().map(|listed| listed.id.clone()).collect(),
        unknown: unknown.unwrap_or_default(),
        unlinked: tests().filter(|test| test.verifies.is_empty()).count(),
    })
}

/// Refuses a run that is listed twice, whose tests would count twice.
fn refuse_repeated(runs: &[RecordedRun]) -> Result<(), Failure> {
    let mut folders = HashSet::new();
    let repeated = runs.iter().find(|run| {
        let folder = run.folder.canonicalize();
        !folders.insert(folder.unwrap_or_else(|_| run.folder.clone()))
    });
    repeated.map_or(Ok(()), |run| {
        Err(Failure::usage(format!(
            "the run {} is given twice; its tests count once",
            run.folder.display()
        )))
    })
}

/// Removes the copies of runs in other folders, and returns each with the folder whose tests count.
fn remove_copies(runs: &mut Vec<RecordedRun>) -> Vec<RunCopy> {
    let mut counted: HashMap<Identity, PathBuf> = HashMap::new();
    let mut copies = Vec::new();
    runs.retain(|run| match run.identity().map(|id| counted.entry(id)) {
        None => true,
        Some(Entry::Vacant(first)) => {
            first.insert(run.folder.clone());
            true
        }
        Some(Entry::Occupied(first)) => {
            copies.push(RunCopy {
                folder: run.folder.clone(),
                of: first.get().clone(),
            });
            false
        }
    });
    copies
}

/// Returns the listed requirements that no run verifies.
fn untested<'a>(listed: &'a [Listed], runs: &[RecordedRun]) -> Vec<&'a Listed> {
    let verified: HashSet<&str> = verified(runs).collect();
    (listed.iter())
        .filter(|listed| !verified.contains(&*listed.id))
        .collect()
}

/// Returns the verified identifiers that are not listed, each once.
fn unknown(listed: &[Listed], runs: &[RecordedRun]) -> Vec<String> {
    let mut known: HashSet<&str> = listed.iter().map(|listed| &*listed.id).collect();
    let unknown = verified(runs).filter(|id| known.insert(id));
    unknown.map(Into::into).collect()
}

fn verified(runs: &[RecordedRun]) -> impl Iterator<Item = &str> {
    let tests = runs.iter().flat_map(|run| &run.requirements);
    tests.flat_map(|test| &test.verifies).map(String::as_str)
}

impl Evidence {
    /// Describes the evidence for the user.
    pub fn describe(&self) -> String {
        let Self {
            runs,
            tests,
            passed,
            unlinked,
            ..
        } = self;
        let (tests, runs) = (counted(*tests as u64, "test"), counted(*runs as u64, "run"));
        let mut text = format!("{tests} in {runs}, {passed} passed\n");
        for RunCopy { folder, of } in &self.copies {
            let (folder, of) = (folder.display(), of.display());
            text += &format!("{folder} is a copy of {of}; its tests count once\n");
        }
        for (ids, what) in [
            (&self.untested, "without a test"),
            (&self.unknown, "verified but not listed"),
        ] {
            if !ids.is_empty() {
                text += &format!("{what}: {}\n", ids.join(", "));
            }
        }
        if *unlinked > 0 {
            text += &format!("tests without `verifies`: {unlinked}\n");
        }
        for file in &self.files {
            text += &format!("{}\n", file.display());
        }
        text
    }
}
