//! `hil campaign collect`: joins the results into one table in the folder, and the circumstances of the cases into
//! another.

use std::io::{BufWriter, Write as _};

use hil_console::files::part_file::PartFile;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;

use crate::collect::Collected;
use crate::folder::Folder;
use crate::shard::part::Part;
use crate::shard::{Shard, missing};
use crate::table::{TableError, Writer, sealed};
use hil_config::study::Study;
use serde_json::json;
use shared_types::number::counted;

use super::answers::outcomes::{self, OutcomeRow, Outcomes};
use super::planned::{self, cannot};
use super::quoted;
use super::values;
use super::work::open;
use crate::arguments::CollectArguments;

/// File name of the table of results.
pub(super) const RESULTS: &str = "results.parquet";
/// File name of the table of circumstances.
const CIRCUMSTANCES: &str = "circumstances.parquet";
/// File names of the table of faults by outcomes.
const FAULTS: &str = "faults.parquet";
const FAULTS_CSV: &str = "faults.csv";
/// Maximum number of cases or shards that are listed.
const MOST_LISTED: usize = 10;

/// Runs the command.
///
/// # Errors
/// If cases are missing, or a table cannot be written.
pub(super) fn collect(arguments: &CollectArguments) -> Result<Exit, Failure> {
    let folder = open(&arguments.folder)?;
    let study = planned::study(&folder)?;
    let collected = join(&folder, &study, arguments.partial, |_| {})?;
    if !arguments.partial {
        refuse_missing(&folder, &collected.missing)?;
    }
    let conflicts = folder
        .conflicts()
        .map_err(|error| cannot(&folder, &error))?;
    let path = folder.path().join(RESULTS);
    let result = json!({
        "file": path.display().to_string(),
        "rows": collected.rows,
        "digest": collected.digest,
        "missing_shards": collected.missing.len(),
        "lost": collected.lost,
        "conflicts": conflicts,
    });
    output::result(arguments.json, &result, || {
        let digest = collected.digest.as_ref();
        let digest = digest.map_or_else(
            || "no digest: cases are missing".into(),
            |digest| format!("digest {digest}"),
        );
        format!(
            "{} in {}\n{digest}\n",
            counted(collected.rows, "row"),
            path.display()
        )
    })?;
    for conflict in &conflicts {
        tell!("error: {conflict}");
    }
    Ok(exit(&collected, !conflicts.is_empty()))
}

/// Returns the exit code for a collected campaign.
pub(super) const fn exit(collected: &Collected, conflicts: bool) -> Exit {
    if conflicts {
        Exit::Failed
    } else if collected.missing.is_empty() && collected.lost.is_empty() {
        Exit::Pass
    } else {
        Exit::Infrastructure
    }
}

/// Joins the results of a campaign, passes each part on, sets invalid parts aside, and removes the files of dead
/// workers. Setting a part aside can leave the campaign incomplete; tables are then written only if `partial` is set.
pub(super) fn join(
    folder: &Folder,
    study: &Study,
    partial: bool,
    mut take: impl FnMut(&Part),
) -> Result<Collected, Failure> {
    let mut outcomes = Outcomes::new(folder, study);
    let missing = missing(folder);
    if !partial {
        refuse_missing(folder, &missing)?;
    }
    let cannot_join = |error: &dyn std::fmt::Display| match missing.is_empty() {
        true => Failure::infrastructure(format!(
            "cannot join the results in {}: {error}; the individual results are intact, and hil campaign show {} reads them without writing",
            folder.path().display(),
            quoted(folder.path())
        )),
        false => cannot(folder, error),
    };
    let part = |name: &str| {
        let path = folder.path().join(name);
        let part = PartFile::beside(&path).map_err(|error| cannot_join(&error))?;
        let file = part.file().try_clone();
        let to = BufWriter::new(file.map_err(|error| cannot_join(&error))?);
        Ok::<_, Failure>((part, to, path))
    };
    let (results, to, path) = part(RESULTS)?;
    let (circumstances, also_to, other) = part(CIRCUMSTANCES)?;
    let joined = crate::collect::collect(folder, to, also_to, |part| {
        take(part);
        outcomes.iter_mut().for_each(|table| table.take(part));
    });
    let (collected, to, also_to) = joined.map_err(|error| cannot_join(&error))?;
    for (number, what) in &collected.broken {
        let aside = Shard::of(folder, *number).set_aside();
        let aside = aside.map_err(|error| cannot(folder, &error))?;
        tell!("shard {number}: {what}; set aside as {}", aside.display());
    }
    for number in 0..folder.manifest().shards() {
        let shard = Shard::of(folder, number);
        if shard.is_published() {
            shard.sweep().map_err(|error| cannot(folder, &error))?;
        }
    }
    tell_lost(folder, &collected);
    values::mend(folder, study)?;
    if !partial && !collected.missing.is_empty() {
        return Ok(collected);
    }
    for (part, to, path) in [(results, to, path), (circumstances, also_to, other)] {
        let flushed = to.into_inner();
        let file = flushed.map_err(|error| cannot_join(&error.error()))?;
        sealed::seal(&file).map_err(|error| cannot_join(&error))?;
        part.complete(&path, true)
            .map_err(|error| cannot_join(&error))?;
    }
    if let Some(outcomes) = outcomes {
        write_faults(folder, &outcomes.rows()).map_err(|error| cannot_join(&error))?;
    }
    Ok(collected)
}

/// Writes the table of faults by outcomes as CSV and as Parquet.
fn write_faults(folder: &Folder, rows: &[OutcomeRow]) -> Result<(), TableError> {
    let (columns, rows) = outcomes::exported(rows);
    let mut table = Writer::new(Vec::new(), &columns)?;
    for row in &rows {
        table.row(row)?;
    }
    let parquet = table.finish(&[("campaign", folder.id().to_owned())])?;
    let csv = outcomes::csv(&columns, &rows)?;
    for (name, bytes) in [FAULTS, FAULTS_CSV].into_iter().zip([parquet, csv]) {
        let path = folder.path().join(name);
        let part = PartFile::beside(&path)?;
        part.file().write_all(&bytes)?;
        part.complete(&path, true)?;
    }
    Ok(())
}

/// Reads the results of a campaign and passes each part on; an incomplete campaign is accepted if `partial` is set.
/// Writes nothing, because an archive may be read-only.
///
/// # Errors
/// If cases are missing, or a part cannot be read.
pub(super) fn read(
    folder: &Folder,
    partial: bool,
    mut take: impl FnMut(&Part),
) -> Result<Collected, Failure> {
    if !partial {
        refuse_missing(folder, &missing(folder))?;
    }
    let passed = crate::collect::pass(folder, |part| {
        take(part);
        Ok(())
    });
    let collected = passed.map_err(|error| cannot(folder, &error))?;
    for (number, what) in &collected.broken {
        tell!("shard {number}: {what}");
    }
    if !partial {
        refuse_missing(folder, &collected.missing)?;
    }
    tell_lost(folder, &collected);
    Ok(collected)
}

/// Reports tables in the folder that do not match the results, with the command that rewrites them. The shards remain
/// authoritative in any case.
///
/// Returns `true` unless a table is damaged; a table older than the latest results is not damaged.
pub(super) fn tell_damaged_tables(folder: &Folder, study: &Study, collected: &Collected) -> bool {
    let mut are_whole = true;
    if let Err(why) = values::check(folder, study) {
        are_whole = false;
        tell!(
            "error: {why}; the figures below come from the shards, and hil campaign collect {} rewrites it",
            quoted(folder.path())
        );
    }
    for path in [RESULTS, CIRCUMSTANCES].map(|name| folder.path().join(name)) {
        let path_text = path.display();
        let mend = format!("hil campaign collect {} rewrites it", quoted(folder.path()));
        if !path.is_file() {
            let what = match path.exists() {
                true => format!("note: {path_text} is not a file; remove it, and {mend}"),
                false => format!("note: there is no {path_text}; {mend}"),
            };
            tell!("{what}; the figures below come from the shards");
            continue;
        }
        match sealed::checked_fact(&path, "digest") {
            Ok(digest) if digest == collected.digest => {}
            Ok(None) => tell!(
                "note: {path_text} was written by an earlier version without a checksum, so it cannot be verified; {mend}"
            ),
            Ok(Some(_)) => tell!("note: {path_text} is older than the latest results; {mend}"),
            Err(error) => {
                are_whole = false;
                tell!(
                    "error: {path_text} is damaged: {error}; the figures below come from the intact shards, and {mend}"
                );
            }
        }
    }
    are_whole
}

/// Reports the cases that were set aside.
fn tell_lost(folder: &Folder, collected: &Collected) {
    if !collected.lost.is_empty() {
        tell!(
            "{}; hil campaign run {} --again retries them",
            set_aside(&collected.lost),
            quoted(folder.path())
        );
    }
}

/// Lists the cases that were set aside.
pub(super) fn set_aside(lost: &[u64]) -> String {
    let cases = counted(lost.len() as u64, "case");
    format!("{cases} set aside: {}", listed(lost))
}

/// Reports contradictory results and returns their number.
///
/// # Errors
/// If the folder cannot be read.
pub(super) fn tell_conflicts(folder: &Folder) -> Result<usize, Failure> {
    let conflicts = folder.conflicts().map_err(|error| cannot(folder, &error))?;
    for conflict in &conflicts {
        tell!("error: {conflict}");
    }
    Ok(conflicts.len())
}

fn refuse_missing(folder: &Folder, missing: &[u64]) -> Result<(), Failure> {
    if missing.is_empty() {
        return Ok(());
    }
    let (all, folder_text) = (folder.manifest().cases, quoted(folder.path()));
    Err(Failure::infrastructure(
        match without_row(folder, missing)? {
            0 => format!(
                "{} not published, although each case has a result; hil campaign run {folder_text} publishes them",
                counted(missing.len() as u64, "shard")
            ),
            cases => format!(
                "{cases} of {all} cases have no result; hil campaign run {folder_text} computes them. An incomplete campaign gives no probabilities, because slow cases come last"
            ),
        },
    ))
}

/// Counts the cases of shards without a result that have no row in a journal either.
///
/// # Errors
/// If the folder cannot be read.
fn without_row(folder: &Folder, missing: &[u64]) -> Result<u64, Failure> {
    let mut cases = folder.manifest().count(missing);
    for number in missing {
        let begun = Shard::of(folder, *number).begun();
        cases -= begun.map_err(|error| cannot(folder, &error))?.0;
    }
    Ok(cases)
}

/// Lists numbers, abbreviating long lists.
pub(super) fn listed(numbers: &[u64]) -> String {
    let first: Vec<String> = numbers
        .iter()
        .take(MOST_LISTED)
        .map(ToString::to_string)
        .collect();
    let first = first.join(", ");
    match numbers.len().saturating_sub(MOST_LISTED) {
        0 => first,
        more => format!("{first} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::set_aside;

    #[test]
    fn cases_set_aside_are_listed_and_long_lists_abbreviated() {
        assert_eq!(set_aside(&[3]), "1 case set aside: 3");
        assert_eq!(set_aside(&[3, 9]), "2 cases set aside: 3, 9");
        let many: Vec<u64> = (0..12).collect();
        let text = set_aside(&many);
        assert!(
            text.ends_with(": 0, 1, 2, 3, 4, 5, 6, 7, 8, 9 and 2 more"),
            "{text}"
        );
    }
}
