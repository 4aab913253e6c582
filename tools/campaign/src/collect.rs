//! Single pass over all parts of a campaign: computes the digest of the rows, writes them as one table and feeds
//! other consumers.
//!
//! The digest is BLAKE3 over the cells of all rows in the order of cases, with each cell encoded by
//! [`Values::feed`](crate::table::Values::feed). The digest is the same for any number of cores, for any engine and
//! after interruptions, and does not depend on the file format.

use std::io::{self, Write};
use std::num::NonZero;
use std::sync::mpsc::sync_channel;
use std::thread;

use crate::curves::Curves;
use crate::folder::Folder;
use crate::shard::part::{Part, circumstance_columns};
use crate::shard::{PartError, Shard};
use crate::table::{CLASS, Column, ColumnKind, LOST, TableError, Writer, sealed};

/// Summary of the collected rows of a campaign.
#[derive(Clone, Debug, Default)]
pub(crate) struct Collected {
    /// Number of rows.
    pub rows: u64,
    /// Digest over all rows; `None` unless every case has one.
    pub digest: Option<String>,
    /// Shards without a result.
    pub missing: Vec<u64>,
    /// Shards with a broken result, which counts as missing, with the error.
    pub broken: Vec<(u64, String)>,
    /// Cases that were set aside.
    pub lost: Vec<u64>,
}

/// Reads the parts in the order of cases and passes each to `take`, without changing the folder. At any time, up to one
/// part per core is read, checked and unpacked, and as many finished parts wait.
///
/// # Errors
/// If a part cannot be read, or if the consumer fails.
pub(crate) fn pass(
    folder: &Folder,
    mut take: impl FnMut(&Part) -> Result<(), TableError>,
) -> Result<Collected, TableError> {
    let manifest = folder.manifest();
    let columns = manifest.columns.iter();
    let class = columns.clone().position(|column| column.name == CLASS);
    let shards = manifest.shards();
    let cores = thread::available_parallelism().map_or(1, NonZero::get);
    let mut hasher = blake3::Hasher::new();
    let mut collected = Collected::default();
    thread::scope(|scope| {
        // Readers take the shards in turn: with `n` readers each reads every `n`-th shard.
        let readers = (0..shards).take(cores).map(|first| {
            let (send, receive) = sync_channel(1);
            scope.spawn(move || {
                for number in (first..shards).step_by(cores) {
                    let part = Shard::of(folder, number).part();
                    let part = part.map(|part| (part.fed(), part));
                    if send.send(part).is_err() {
                        return; // nobody waits for it any more
                    }
                }
            });
            receive
        });
        let readers: Vec<_> = readers.collect();
        for (number, reader) in (0..shards).zip(readers.iter().cycle()) {
            let Ok(read) = reader.recv() else {
                break; // it panicked, and so does the scope
            };
            let (fed, part) = match read {
                Ok(part) => part,
                Err(PartError::Missing) => {
                    collected.missing.push(number);
                    continue;
                }
                Err(PartError::Broken(what)) => {
                    collected.broken.push((number, what));
                    collected.missing.push(number);
                    continue;
                }
                Err(PartError::Io(error)) => return Err(TableError::Io(error)),
            };
            hasher.update(&fed);
            if let Some(class) = class.map(|class| &part.results()[class]) {
                let cases = part.cases().iter().enumerate();
                let lost = cases.filter(|(place, _)| class.text(*place) == LOST);
                collected.lost.extend(lost.map(|(_, case)| case));
            }
            take(&part)?;
            collected.rows += part.cases().len() as u64;
        }
        Ok::<_, TableError>(())
    })?;
    if collected.missing.is_empty() {
        collected.digest = Some(hasher.finalize().to_hex().to_string());
    }
    Ok(collected)
}

/// Joins all parts: writes the results to one table and the circumstances to another, and passes each part on. Does not
/// change the folder. Both tables still have to be [sealed](crate::table::sealed::seal).
///
/// # Errors
/// If a table cannot be written or a part cannot be read.
pub(crate) fn collect<W: Write + Send, V: Write + Send>(
    folder: &Folder,
    results: W,
    circumstances: V,
    mut take: impl FnMut(&Part),
) -> Result<(Collected, W, V), TableError> {
    let mut columns = vec![Column::new("case", ColumnKind::Count)];
    columns.extend(circumstance_columns());
    let mut table = Writer::new(results, &folder.manifest().columns)?;
    let mut second = Writer::new(circumstances, &columns)?;
    let collected = pass(folder, |part| {
        take(part);
        table.extend(&part.results().iter().collect::<Vec<_>>())?;
        second.extend(&part.circumstances())
    })?;
    let facts = [
        ("campaign", folder.id().to_owned()),
        ("digest", collected.digest.clone().unwrap_or_default()),
        sealed::unsealed(),
    ];
    let results = table.finish(&facts)?;
    let circumstances = second.finish(&facts)?;
    Ok((collected, results, circumstances))
}

/// Joins the curves of all shards with a result; also counts the shards whose curves are missing.
///
/// # Errors
/// If a file cannot be read.
pub(crate) fn curves(folder: &Folder) -> io::Result<(Curves, u64)> {
    let (mut all, mut without) = (Curves::default(), 0);
    let Some(grid) = &folder.manifest().curves else {
        return Ok((all, without));
    };
    for number in 0..folder.manifest().shards() {
        let shard = Shard::of(folder, number);
        if !shard.is_published() {
            continue;
        }
        match shard.curves(grid)? {
            Some(curves) => all.join(curves),
            None => without += 1,
        }
    }
    Ok((all, without))
}

#[cfg(test)]
mod curves;
#[cfg(test)]
mod tests;
