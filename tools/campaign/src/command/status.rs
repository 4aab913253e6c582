//! `hil campaign status`: cases done, missing and under way, from the folder alone; and the tasks of a cluster, from
//! Slurm.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;

use crate::folder::{Conflict, Folder};
use crate::shard::{PartError, Shard};
use serde::Serialize;
use shared_types::number::counted;

use super::planned::cannot;
use super::quoted;
use super::slurm::{self, Tasks};
use super::work::open;
use crate::arguments::StatusArguments;

/// Interval between two refreshes.
const LOOK: Duration = Duration::from_secs(1);

/// State of a campaign.
#[derive(Debug, Serialize)]
struct Status {
    name: String,
    cases: u64,
    /// Number of cases in published shards.
    published: u64,
    /// Number of cases with a row in unpublished shards.
    begun: u64,
    missing: u64,
    shards: u64,
    shards_published: u64,
    /// Number of shards with an active worker, on this machine or another whose locks are visible here.
    shards_under_way: u64,
    /// Shards with an invalid result, with the error; their cases are missing.
    shards_damaged: BTreeMap<u64, String>,
    conflicts: Vec<Conflict>,
    /// Tasks of a cluster; `None` if none was submitted, or Slurm does not answer.
    tasks: Option<Tasks>,
}

/// Runs the command.
///
/// # Errors
/// If the folder cannot be read.
pub(super) fn status(arguments: &StatusArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let folder = open(&arguments.folder)?;
    let mut sound = BTreeSet::new();
    loop {
        let status = Status::of(&folder, &mut sound)?;
        output::result(arguments.json, &status, || status.describe(&folder))?;
        let damaged = status.shards_damaged.len() as u64;
        if !arguments.watch || status.shards_published + damaged == status.shards {
            return Ok(match (status.conflicts.is_empty(), damaged) {
                (true, 0) => Exit::Pass,
                (true, _) => Exit::Infrastructure,
                (false, _) => Exit::Failed,
            });
        }
        std::thread::sleep(LOOK);
        interruption.check()?;
    }
}

impl Status {
    /// Determines the status of a folder; `sound` holds the shards that were verified earlier and need no second
    /// reading.
    fn of(folder: &Folder, sound: &mut BTreeSet<u64>) -> Result<Self, Failure> {
        let manifest = folder.manifest();
        let mut status = Self {
            name: manifest.name.clone(),
            cases: manifest.cases,
            published: 0,
            begun: 0,
            missing: 0,
            shards: manifest.shards(),
            shards_published: 0,
            shards_under_way: 0,
            shards_damaged: BTreeMap::new(),
            conflicts: folder.conflicts().map_err(|error| cannot(folder, &error))?,
            tasks: slurm::tasks(folder),
        };
        for number in 0..status.shards {
            let shard = Shard::of(folder, number);
            let cases = shard.cases();
            if shard.is_published() {
                if !sound.contains(&number) {
                    match shard.part() {
                        Ok(_) => sound.insert(number),
                        // Set aside by a worker that computes it again.
                        Err(PartError::Missing) => continue,
                        Err(PartError::Broken(what)) => {
                            status.shards_damaged.insert(number, what);
                            continue;
                        }
                        Err(PartError::Io(error)) => return Err(cannot(folder, &error)),
                    };
                }
                status.published += cases.end - cases.start;
                status.shards_published += 1;
            } else {
                let (begun, is_alive) = shard.begun().map_err(|error| cannot(folder, &error))?;
                status.begun += begun;
                status.shards_under_way += u64::from(is_alive);
            }
        }
        status.missing = status.cases - status.published - status.begun;
        Ok(status)
    }

    fn describe(&self, folder: &Folder) -> String {
        let folder_text = quoted(folder.path());
        let Self {
            name,
            published,
            begun,
            missing,
            ..
        } = self;
        let mut text = format!(
            "{name}: {} of {} done, {missing} missing; {} of {} published, {} under way\n",
            published + begun,
            counted(self.cases, "case"),
            self.shards_published,
            counted(self.shards, "shard"),
            self.shards_under_way
        );
        for (number, what) in &self.shards_damaged {
            text += &format!(
                "  shard {number}: {what}; hil campaign run {folder_text} computes it again\n"
            );
        }
        for conflict in &self.conflicts {
            text += &format!("  {conflict}\n");
        }
        if let Some(tasks) = &self.tasks {
            let is_done = self.shards_published == self.shards;
            text += &tasks.describe(is_done, self.shards_under_way > 0);
        }
        let is_left = self.shards_published < self.shards && self.shards_under_way == 0;
        if is_left && self.tasks.as_ref().is_none_or(|tasks| tasks.running == 0) {
            text +=
                &format!("  no worker is active here; hil campaign run {folder_text} continues\n");
        }
        text
    }
}
