//! `hil report` of a campaign: one HTML file that shows all cases, for eyes and for the file of evidence.
//!
//! 1. The results are read once, as far as there are any, and [`answers`] computes what they mean.
//! 2. [`data`] packs margins, metrics and varied values for the script, [`envelopes`] the curves over time.
//! 3. [`tables`] writes what reads without a script, [`page`] joins everything.
//!
//! The page asks for nothing from anywhere: its policy forbids connections, and whatever a study says is escaped.
//! Nothing here judges: the answers are those of `hil campaign show`.

mod data;
mod envelopes;
mod numbers;
mod page;
mod tables;

use std::path::Path;

use crate::folder::{Conflict, Folder};
use hil_config::study::Study;
use hil_console::files::destination::Destination;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_views::arguments::report::ReportArguments;
use hil_views::export::deliver;
use serde::Serialize;
use shared_types::number::counted;

use super::answers::{self, Answers, Gathered};
use super::collect::read;
use super::planned::{cannot, study};
use super::work::open;

/// A campaign and its answers.
struct Campaign<'a> {
    folder: &'a Folder,
    study: &'a Study,
    answers: &'a Answers,
    /// Number of cases with a result.
    rows: u64,
    conflicts: &'a [Conflict],
}

impl Campaign<'_> {
    /// Tells whether every case has a result.
    const fn is_complete(&self) -> bool {
        self.answers.digest.is_some()
    }
}

/// Summary of the written page.
#[derive(Debug, Serialize)]
struct Written {
    file: String,
    campaign: String,
    cases: u64,
    /// Cases that the plots show.
    shown: usize,
    bytes: usize,
}

/// Runs the command for the folder of a campaign.
///
/// # Errors
/// If options are of a report of runs, the folder is broken, or the file cannot be written.
pub(super) fn report(arguments: &ReportArguments) -> Result<Exit, Failure> {
    let [path] = &*arguments.runs else {
        return Err(Failure::usage(
            "a report of a campaign shows that campaign alone; make one for each, or compare two with hil campaign compare A B",
        ));
    };
    if !arguments.signal.is_empty() || arguments.scenario.is_some() {
        return Err(Failure::usage(
            "a campaign has no recorded signals; --signal and --scenario are for runs, and hil campaign case DIR N makes a run of a case",
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
            "--json goes to standard output, where the report goes too; name a file with -o",
        ));
    }
    // A file that cannot be written is told before the work.
    let destination = Destination::open(out, force)?;
    let (text, mut written) = made(folder)?;
    deliver(&text, destination, out)?;
    if let Some(path) = out {
        written.file = path.display().to_string();
        output::result(json, &written, || {
            let Written { file, cases, .. } = &written;
            let size = written.bytes as f64 / 1e6;
            format!("{file}: {}, {size:.1} MB\n", counted(*cases, "case"))
        })?;
    }
    Ok(Exit::Pass)
}

/// Makes the page and its summary.
fn made(folder: &Folder) -> Result<(String, Written), Failure> {
    let manifest = folder.manifest();
    let study = study(folder)?;
    let mut gathered = Gathered::new(manifest, &study);
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
    let written = Written {
        file: String::new(),
        campaign: manifest.name.clone(),
        cases: collected.rows,
        shown: data.rows(),
        bytes: text.len(),
    };
    Ok((text, written))
}
