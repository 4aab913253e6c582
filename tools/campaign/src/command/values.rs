//! The table of the values of every case, for Parquet readers. No run depends on the table: it follows from the study,
//! so a damaged table is rewritten.

use std::fs;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use crate::draws::{Drawn, Draws};
use crate::folder::Folder;
use crate::manifest::Manifest;
use crate::table::{self, Cell, Column, Row, Writer, sealed};
use hil_config::study::Study;
use hil_console::files::part_file::PartFile;
use hil_console::terminal::exit::Failure;

/// File name of the table.
const CASES: &str = "cases.parquet";
/// Metadata key that binds the table to its campaign.
const CAMPAIGN: &str = "campaign";

/// Builds the cells of a case that are known before it runs.
pub(super) fn head(draws: &Draws, case: u64) -> Row {
    let (draw, variant) = draws.of_case(case);
    let values = draws.values(draw);
    let seed = draws.seed_of(variant, draws.seed(draw), &values);
    let mut row = vec![
        Cell::Count(case),
        Cell::Count(draw),
        Cell::Text(draws.study().variants[variant].name.clone()),
        Cell::Count(seed),
    ];
    row.extend(values.iter().map(Drawn::cell));
    row
}

/// Writes the table into the folder of a campaign, with a checksum and the campaign's identity.
///
/// # Errors
/// If the file cannot be written.
pub(super) fn write(folder: &Path, manifest: &Manifest, draws: &Draws) -> Result<(), Failure> {
    let cannot = |error: &dyn std::fmt::Display| {
        Failure::infrastructure(format!("cannot write the cases: {error}"))
    };
    let path = folder.join(CASES);
    let part = PartFile::beside(&path).map_err(|error| cannot(&error))?;
    let file = part.file().try_clone().map_err(|error| cannot(&error))?;
    let table = Writer::new(BufWriter::new(file), columns(manifest, draws.study()));
    let mut table = table.map_err(|error| cannot(&error))?;
    for case in 0..draws.study().cases() {
        let result = table.row(&head(draws, case));
        result.map_err(|error| cannot(&error))?;
    }
    let facts = [(CAMPAIGN, manifest.id()), sealed::unsealed()];
    let file = table.finish(&facts).map_err(|error| cannot(&error))?;
    let file = file.into_inner().map_err(|error| cannot(&error.error()))?;
    sealed::seal(&file).map_err(|error| cannot(&error))?;
    part.complete(&path, true).map_err(|error| cannot(&error))
}

/// Rewrites the table if it is missing or damaged, and reports the reason.
///
/// # Errors
/// If the file cannot be written.
pub(super) fn mend(folder: &Folder, study: &Study) -> Result<(), Failure> {
    let Err(why) = check(folder, study) else {
        return Ok(());
    };
    let draws = Draws::new(study.clone())?;
    write(folder.path(), folder.manifest(), &draws)?;
    tell!("note: {why}; it will be rewritten");
    Ok(())
}

/// Verifies the table of a campaign by its checksum and the identity of the campaign. A table of an earlier version,
/// which has neither, is verified by its content.
///
/// # Errors
/// If the table does not match; the message states why.
pub(super) fn check(folder: &Folder, study: &Study) -> Result<(), String> {
    let path = folder.path().join(CASES);
    let path_text = path.display();
    if !path.exists() {
        return Err(format!("{path_text} is missing"));
    }
    let damaged = |error: &dyn std::fmt::Display| format!("{path_text} is damaged: {error}");
    match sealed::checked_fact(&path, CAMPAIGN) {
        Ok(Some(id)) if id == folder.id() => Ok(()),
        Ok(Some(_)) => Err(format!("{path_text} belongs to another campaign")),
        Ok(None) => match has_values(&path, folder.manifest(), study) {
            Ok(true) => Ok(()),
            Ok(false) => Err(format!(
                "{path_text} differs from the values that the study draws"
            )),
            Err(error) => Err(damaged(&error)),
        },
        Err(error) => Err(damaged(&error)),
    }
}

/// Returns `true` if the table holds the values that the study draws.
fn has_values(path: &PathBuf, manifest: &Manifest, study: &Study) -> Result<bool, Failure> {
    let bytes = fs::read(path).map_err(Failure::usage)?;
    let table = table::read(bytes, columns(manifest, study)).map_err(Failure::usage)?;
    let draws = Draws::new(study.clone())?;
    let rows = table.columns.first().map_or(0, |column| column.rows());
    let has_row = |case: u64| {
        let Ok(place) = usize::try_from(case) else {
            return false;
        };
        let cells = table.columns.iter().map(|column| column.cell(place));
        cells.eq(head(&draws, case))
    };
    Ok(rows as u64 == study.cases() && (0..study.cases()).all(has_row))
}

/// Lists the columns that are known before a case runs.
fn columns<'a>(manifest: &'a Manifest, study: &Study) -> &'a [Column] {
    let count = manifest.columns.len().min(4 + study.varied.len());
    &manifest.columns[..count]
}
