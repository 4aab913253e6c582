//! The results of a campaign as one table in its folder, and the circumstances of its cases as another.

use std::io::{BufWriter, Write as _, sink};

use hil_campaign::collect::Collected;
use hil_campaign::folder::Folder;
use hil_campaign::shard::{Shard, missing};
use serde_json::json;
use shared_types::number::counted;
use tempfile::NamedTempFile;

use super::quoted;
use super::work::{cannot, open};
use crate::arguments::campaign::CollectArguments;
use crate::files::part_file::PartFile;
use crate::terminal::exit::{Exit, Failure};
use crate::terminal::output;

/// Name of the table of results.
pub(super) const RESULTS: &str = "results.parquet";
/// Name of the table of circumstances.
const CIRCUMSTANCES: &str = "circumstances.parquet";
/// Most cases or shards that are listed.
const MOST_LISTED: usize = 10;

/// Joins the results.
///
/// # Errors
/// If cases are missing, or a table cannot be written.
pub(super) fn collect(arguments: &CollectArguments) -> Result<Exit, Failure> {
    let folder = open(&arguments.folder)?;
    let collected = now(&folder, arguments.partial)?;
    let conflicts = folder
        .conflicts()
        .map_err(|error| cannot(&folder, &error))?;
    let shown = folder.path().join(RESULTS);
    let result = json!({
        "file": shown.display().to_string(),
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
            shown.display()
        )
    })?;
    for conflict in &conflicts {
        tell!("error: {conflict}");
    }
    Ok(exit(&collected, !conflicts.is_empty()))
}

/// Returns the exit code of what was collected.
pub(super) const fn exit(collected: &Collected, conflicts: bool) -> Exit {
    if conflicts {
        Exit::Failed
    } else if collected.missing.is_empty() && collected.lost.is_empty() {
        Exit::Pass
    } else {
        Exit::Infrastructure
    }
}

/// Joins the results of a campaign; one that is not complete only if `partial`.
///
/// # Errors
/// If cases are missing, or a table cannot be written.
pub(super) fn now(folder: &Folder, partial: bool) -> Result<Collected, Failure> {
    let collected = join(folder, partial)?;
    if !partial {
        refuse_missing(folder, &collected.missing)?;
    }
    Ok(collected)
}

/// Joins the results of a campaign, sets those aside that do not count, and removes what dead workers left. Without
/// the former the campaign may not be complete any more: tables are written then only if `partial`.
///
/// # Errors
/// If cases are missing before, or a table cannot be written.
pub(super) fn join(folder: &Folder, partial: bool) -> Result<Collected, Failure> {
    if !partial {
        refuse_missing(folder, &missing(folder))?;
    }
    let part = |name: &str| {
        let path = folder.path().join(name);
        let part = PartFile::beside(&path).map_err(|error| cannot(folder, &error))?;
        let file = part
            .file()
            .try_clone()
            .map_err(|error| cannot(folder, &error))?;
        Ok::<_, Failure>((part, BufWriter::new(file), path))
    };
    let (results, to, path) = part(RESULTS)?;
    let (circumstances, also_to, other) = part(CIRCUMSTANCES)?;
    let written = hil_campaign::collect::collect(folder, to, also_to);
    let (collected, to, also_to) = written.map_err(|error| cannot(folder, &error))?;
    for (number, what) in &collected.broken {
        let aside = Shard::of(folder, *number).set_aside();
        let aside = aside.map_err(|error| cannot(folder, &error))?;
        tell!(
            "shard {number}: {what}; it is set aside as {}",
            aside.display()
        );
    }
    for number in 0..folder.manifest().shards() {
        let shard = Shard::of(folder, number);
        if shard.is_published() {
            shard.sweep().map_err(|error| cannot(folder, &error))?;
        }
    }
    tell_lost(folder, &collected);
    if !partial && !collected.missing.is_empty() {
        return Ok(collected);
    }
    for (part, to, path) in [(results, to, path), (circumstances, also_to, other)] {
        let flushed = to
            .into_inner()
            .map_err(|error| cannot(folder, &error.error()))?;
        drop(flushed);
        part.complete(&path, true)
            .map_err(|error| cannot(folder, &error))?;
    }
    Ok(collected)
}

/// Joins the results of a campaign, complete or not if `partial`, for somebody who reads them: in a file that is gone
/// with the answer, as an archive may be read-only.
///
/// # Errors
/// If cases are missing, or a part cannot be read.
pub(super) fn read(folder: &Folder, partial: bool) -> Result<(Collected, NamedTempFile), Failure> {
    if !partial {
        refuse_missing(folder, &missing(folder))?;
    }
    let results = NamedTempFile::new().map_err(Failure::infrastructure)?;
    let file = results.reopen().map_err(Failure::infrastructure)?;
    let collected = hil_campaign::collect::collect(folder, BufWriter::new(file), sink());
    let (collected, mut file, _) = collected.map_err(|error| cannot(folder, &error))?;
    file.flush().map_err(Failure::infrastructure)?;
    for (number, what) in &collected.broken {
        tell!("shard {number}: {what}");
    }
    if !partial {
        refuse_missing(folder, &collected.missing)?;
    }
    tell_lost(folder, &collected);
    Ok((collected, results))
}

/// Tells of cases that were set aside.
fn tell_lost(folder: &Folder, collected: &Collected) {
    if !collected.lost.is_empty() {
        tell!(
            "{} set aside, which {}; hil campaign run {} --again tries once more",
            counted(collected.lost.len() as u64, "case"),
            listed(&collected.lost),
            quoted(folder.path())
        );
    }
}

/// Tells of results that contradict each other; counts them.
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
    let manifest = folder.manifest();
    let cases = manifest.count(missing);
    let (all, shown) = (manifest.cases, quoted(folder.path()));
    Err(Failure::infrastructure(format!(
        "{cases} of {all} cases have no result; hil campaign run {shown} computes them, and a campaign that is not complete gives no probability: slow cases come last"
    )))
}

/// Lists numbers, of many the first.
pub(super) fn listed(numbers: &[u64]) -> String {
    let first: Vec<String> = numbers
        .iter()
        .take(MOST_LISTED)
        .map(ToString::to_string)
        .collect();
    let first = first.join(", ");
    match numbers.len().saturating_sub(MOST_LISTED) {
        0 => format!("are {first}"),
        more => format!("are {first} and {more} more"),
    }
}
