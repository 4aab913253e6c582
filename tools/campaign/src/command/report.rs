//! `hil report` for a campaign: one HTML file that presents all cases, for reading and for archiving as evidence.
//!
//! 1. The available results are read once, and [`answers`] evaluates them.
//! 2. [`data`] packs margins, metrics and varied values for the script, [`envelopes`] the curves over time.
//! 3. [`tables`] and [`indices`] render the parts that need no script, [`page`] joins everything.
//!
//! The page loads nothing: its policy forbids connections, and all text of the study is escaped. The page evaluates
//! nothing: its numbers are those of `hil campaign show`.

mod data;
mod envelopes;
mod indices;
mod numbers;
mod page;
mod tables;

use std::path::Path;

use crate::folder::{Conflict, Folder};
use hil_config::study::Study;
use hil_console::files::destination::{Destination, deliver};
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_views::arguments::report::ReportArguments;
use serde::Serialize;
use shared_types::number::counted;

use super::answers::{self, Answers, Gathered};
use super::collect::read;
use super::planned::{cannot, study};
use super::work::open;

/// Campaign with its evaluation.
struct Campaign<'a> {
    folder: &'a Folder,
    study: &'a Study,
    answers: &'a Answers,
    /// Number of cases in published shards.
    rows: u64,
    conflicts: &'a [Conflict],
}

impl Campaign<'_> {
    /// Returns `true` if every case has a result.
    const fn is_complete(&self) -> bool {
        self.answers.digest.is_some()
    }
}

/// Summary of the written page.
#[derive(Debug, Serialize)]
struct PageSummary {
    file: String,
    campaign: String,
    cases: u64,
    /// Number of cases that the plots show.
    shown: usize,
    bytes: usize,
}

/// Runs the command for the folder of a campaign.
///
/// # Errors
/// If an option applies only to reports of runs, the folder is invalid, or the file cannot be written.
pub(super) fn report(arguments: &ReportArguments) -> Result<Exit, Failure> {
    let [path] = &*arguments.runs else {
        return Err(Failure::usage(
            "a campaign report covers a single campaign; create one for each, or compare two with hil campaign compare A B",
        ));
    };
    if !arguments.signal.is_empty() || arguments.scenario.is_some() {
        return Err(Failure::usage(
            "a campaign has no recorded signals; --signal and --scenario apply to runs, and hil campaign case DIR N runs a case",
        ));
    }
    if !arguments.formulas.is_empty() {
        return Err(Failure::usage(
            "a campaign has no recorded signals; --where applies to runs, and hil campaign case DIR N runs a case",
        ));
    }
    if arguments.behind.baseline.is_some() {
        return Err(Failure::usage(
            "a campaign has no recorded signals; --baseline applies to runs, and hil campaign case DIR N runs a case",
        ));
    }
    if arguments.figures.is_some() || arguments.margins.is_some() {
        return Err(Failure::usage(
            "a campaign has no recorded signals; --figures and --margins apply to runs, and hil campaign case DIR N runs a case",
        ));
    }
    let folder = open(path)?;
    let out = Some(arguments.output.as_path()).filter(|path| *path != Path::new("-"));
    write(&folder, out, arguments.force, arguments.json)
}

/// Writes the page of a campaign to a file, or to standard output.
///
/// # Errors
/// If the results cannot be read, or the page cannot be written.
pub(super) fn write(
    folder: &Folder,
    out: Option<&Path>,
    force: bool,
    json: bool,
) -> Result<Exit, Failure> {
    if json && out.is_none() {
        return Err(Failure::usage(
            "--json and the report would both go to standard output; choose a file for the report with -o",
        ));
    }
    // An unwritable file is reported before the work starts.
    let destination = Destination::open(out, force)?;
    let (text, mut summary) = build(folder)?;
    deliver(&text, destination, out)?;
    if let Some(path) = out {
        summary.file = path.display().to_string();
        output::result(json, &summary, || {
            let PageSummary { file, cases, .. } = &summary;
            let size = summary.bytes as f64 / 1e6;
            format!("{file}: {}, {size:.1} MB\n", counted(*cases, "case"))
        })?;
    }
    Ok(Exit::Pass)
}

/// Builds the page and its summary.
fn build(folder: &Folder) -> Result<(String, PageSummary), Failure> {
    let manifest = folder.manifest();
    let study = study(folder)?;
    let mut gathered = Gathered::new(folder, &study);
    let mut data = data::Data::new(folder, &study);
    let collected = read(folder, true, |part| {
        gathered.take(part);
        data.take(part);
    })?;
    let conflicts = folder.conflicts().map_err(|error| cannot(folder, &error))?;
    let answers = answers::of(gathered, &collected);
    let envelopes = envelopes::Envelopes::read(folder, &study);
    data.complete(&answers, envelopes.map_err(|error| cannot(folder, &error))?);
    let campaign = Campaign {
        folder,
        study: &study,
        answers: &answers,
        rows: collected.rows,
        conflicts: &conflicts,
    };
    let text = page::page(&campaign, &data)?;
    let summary = PageSummary {
        file: String::new(),
        campaign: manifest.name.clone(),
        cases: collected.rows,
        shown: data.rows(),
        bytes: text.len(),
    };
    Ok((text, summary))
}
