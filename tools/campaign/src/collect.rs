//! All parts of a campaign in one pass: the digest over its rows, one table of them, and whatever else looks at them.
//!
//! The digest is BLAKE3 over the cells of all rows in the order of cases, each cell as
//! [`Values::feed`](crate::table::Values::feed) has it: the same on one core or many, under any engine, and after
//! accidents. It does not depend on the form of the files.

use std::io::{self, Write};
use std::num::NonZero;
use std::sync::mpsc::sync_channel;
use std::thread;

use crate::curves::Curves;
use crate::folder::Folder;
use crate::shard::part::{Part, circumstance_columns};
use crate::shard::{PartError, Shard};
use crate::table::{CLASS, Column, ColumnKind, LOST, TableError, Writer, sealed};

/// A campaign's rows, collected.
#[derive(Clone, Debug, Default)]
pub struct Collected {
    /// Number of rows.
    pub rows: u64,
    /// Digest over all rows; none unless every case has one.
    pub digest: Option<String>,
    /// Shards without a result.
    pub missing: Vec<u64>,
    /// Shards whose result is broken, which counts as none, with what is wrong.
    pub broken: Vec<(u64, String)>,
    /// Cases that were set aside.
    pub lost: Vec<u64>,
}

/// Reads the parts in the order of cases and hands each on. Changes nothing in the folder. As many parts as there are
/// cores are read, checked and unpacked meanwhile, and as many wait at most.
///
/// # Errors
/// If a part cannot be read, or what it is handed to fails.
pub fn pass(
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
        // Of as many shards in a row as there are readers each reads one.
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

/// Joins the parts: rows of results into one table, their circumstances into another; and hands each on. Changes
/// nothing in the folder. Both tables are to be [sealed](crate::table::sealed::seal).
///
/// # Errors
/// If a table cannot be written, or a part not be read.
pub fn collect<W: Write + Send, V: Write + Send>(
    folder: &Folder,
    results: W,
    circumstances: V,
    mut take: impl FnMut(&Part),
) -> Result<(Collected, W, V), TableError> {
    let mut own = vec![Column::new("case", ColumnKind::Count)];
    own.extend(circumstance_columns());
    let mut table = Writer::new(results, &folder.manifest().columns)?;
    let mut second = Writer::new(circumstances, &own)?;
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

/// Joins the curves of all shards that have a result; counts those whose curves are missing.
///
/// # Errors
/// If a file cannot be read.
pub fn curves(folder: &Folder) -> io::Result<(Curves, u64)> {
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
