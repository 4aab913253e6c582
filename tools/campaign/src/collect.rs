//! All parts of a campaign as one table, and the digest over its rows.
//!
//! The digest is BLAKE3 over the cells of all rows in the order of cases, each cell as [`Cell::feed`](crate::table::Cell::feed) has it: the
//! same on one core or many, under any engine, and after accidents. It does not depend on the form of the files.

use std::io::{self, Write};

use crate::curves::Curves;
use crate::folder::Folder;
use crate::shard::{PartError, Shard, circumstance_columns};
use crate::table::{CLASS, Column, Kind, LOST, TableError, Writer};

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

/// Joins the parts: rows of results into one table, their circumstances into another. Changes nothing in the folder.
///
/// # Errors
/// If a table cannot be written, or a part not be read.
pub fn collect<W: Write + Send, V: Write + Send>(
    folder: &Folder,
    results: W,
    circumstances: V,
) -> Result<(Collected, W, V), TableError> {
    let manifest = folder.manifest();
    let mut own = vec![Column::new("case", Kind::Count)];
    own.extend(circumstance_columns());
    let class = manifest
        .columns
        .iter()
        .position(|column| column.name == CLASS);
    let mut table = Writer::new(results, &manifest.columns)?;
    let mut second = Writer::new(circumstances, &own)?;
    let mut hasher = blake3::Hasher::new();
    let mut collected = Collected::default();
    for number in 0..manifest.shards() {
        let shard = Shard::of(folder, number);
        let part = match shard.part() {
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
            Err(PartError::Io(error)) => return Err(error.into()),
        };
        for (row, circumstances) in part.rows.iter().zip(&part.circumstances) {
            row.iter().for_each(|cell| cell.feed(&mut hasher));
            if class.is_some_and(|class| row[class].as_text() == LOST) {
                collected.lost.push(row[0].as_count());
            }
            table.row(row)?;
            second.row([&row[0]].into_iter().chain(&circumstances.cells()))?;
            collected.rows += 1;
        }
    }
    if collected.missing.is_empty() {
        collected.digest = Some(hasher.finalize().to_hex().to_string());
    }
    let facts = [
        ("campaign", folder.id().to_owned()),
        ("digest", collected.digest.clone().unwrap_or_default()),
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
