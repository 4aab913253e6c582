//! The part of a shard: its published rows and their circumstances, as one table with a checksum.

use std::ops::Range;

use super::PartError;
use crate::folder::Folder;
use crate::journal::Circumstances;
use crate::manifest::MANIFEST;
use crate::table::{self, Cell, Column, ColumnKind, Row, TableError, Values, Writer};

/// Keys of the metadata of a part.
const CAMPAIGN: &str = "campaign";
const SUM: &str = "sum";
/// Marker before the checksum, whose `DIGITS` digits are zeros while it is computed.
const SEAL: &str = "hil-part-sum:";
const DIGITS: usize = 64;

/// Published rows, in the order of cases.
pub(crate) struct Part {
    /// Columns of results, then those of circumstances.
    columns: Vec<Values>,
    /// Number of columns of results.
    results: usize,
}

/// Returns the columns of the circumstances of a row.
pub(crate) fn circumstance_columns() -> Vec<Column> {
    let seconds = Column {
        unit: "s".into(),
        ..Column::new("wall_time_s", ColumnKind::Number)
    };
    vec![
        seconds,
        Column::new("host", ColumnKind::Text),
        Column::new("attempt", ColumnKind::Text),
        Column::new("tries", ColumnKind::Count),
    ]
}

fn all_columns(folder: &Folder) -> Vec<Column> {
    let results = folder.manifest().columns.iter().cloned();
    results.chain(circumstance_columns()).collect()
}

impl Circumstances {
    fn cells(&self) -> [Cell; 4] {
        [
            Cell::number(self.wall_s),
            Cell::Text(self.host.clone()),
            Cell::Text(self.attempt.clone()),
            Cell::Count(self.tries),
        ]
    }

    /// Names the host and attempt that computed the row.
    pub(super) fn maker(&self) -> String {
        format!("{} (attempt {})", self.host, self.attempt)
    }
}

impl Part {
    /// Reads the part of a range of cases.
    pub(super) fn read(
        mut bytes: Vec<u8>,
        folder: &Folder,
        cases: Range<u64>,
    ) -> Result<Self, PartError> {
        // Verified before parsing: the Parquet reader trusts its input.
        let sum = unsealed(&mut bytes);
        if sum.is_none_or(|sum| sum != seal(&bytes)) {
            return Err(PartError::Broken("its checksum does not match".into()));
        }
        Self::fitting(bytes, folder, cases).map_err(|error| match error {
            // The part is intact, so a mismatch may be due to the manifest.
            PartError::Broken(what) if !folder.is_sealed() => {
                let folder_text = folder.path().display();
                PartError::Io(std::io::Error::other(format!(
                    "{what}, or {folder_text}/{MANIFEST} is damaged, which has no checksum; no result was changed; restore the damaged file from a copy"
                )))
            }
            error => error,
        })
    }

    /// Parses a part whose checksum has been verified.
    fn fitting(bytes: Vec<u8>, folder: &Folder, cases: Range<u64>) -> Result<Self, PartError> {
        let table = table::read(bytes, &all_columns(folder))?;
        let of = table.fact(CAMPAIGN);
        if !of.is_some_and(|id| folder.has_results_of(id)) {
            return Err(PartError::Broken("it belongs to another campaign".into()));
        }
        let part = Self {
            columns: table.columns,
            results: folder.manifest().columns.len(),
        };
        if !part.cases().iter().copied().eq(cases) {
            return Err(PartError::Broken("it contains other cases".into()));
        }
        Ok(part)
    }

    /// Encodes rows as the bytes of a part.
    pub(super) fn bytes(
        folder: &Folder,
        rows: &[Row],
        circumstances: &[Circumstances],
    ) -> Result<Vec<u8>, TableError> {
        let mut writer = Writer::new(Vec::new(), &all_columns(folder))?;
        for (row, circumstances) in rows.iter().zip(circumstances) {
            writer.row(row.iter().chain(&circumstances.cells()))?;
        }
        let facts = [
            (CAMPAIGN, folder.id().to_owned()),
            (SUM, format!("{SEAL}{}", "0".repeat(DIGITS))),
        ];
        let mut bytes = writer.finish(&facts)?;
        let sum = seal(&bytes);
        sealed(&mut bytes)
            .ok_or_else(|| TableError::Other("it has no checksum".into()))?
            .copy_from_slice(&sum);
        Ok(bytes)
    }

    /// Returns the columns of results, each with a cell for each case in the order of cases.
    #[must_use]
    pub(crate) fn results(&self) -> &[Values] {
        &self.columns[..self.results]
    }

    /// Returns the columns of circumstances, preceded by the case column.
    pub(crate) fn circumstances(&self) -> Vec<&Values> {
        let circumstances = self.columns[self.results..].iter();
        self.columns[..1].iter().chain(circumstances).collect()
    }

    /// Returns the case numbers of the rows.
    #[must_use]
    pub(crate) fn cases(&self) -> &[u64] {
        match &self.columns[..] {
            [Values::Counts(cases), ..] => cases,
            _ => &[],
        }
    }

    /// Returns a row of results by its index.
    ///
    /// # Panics
    /// If there is no such row.
    #[must_use]
    pub(crate) fn row(&self, place: usize) -> Row {
        let columns = self.results().iter();
        columns.map(|column| column.cell(place)).collect()
    }

    /// Returns the rows of results.
    pub(crate) fn rows(&self) -> impl Iterator<Item = Row> {
        (0..self.cases().len()).map(|place| self.row(place))
    }

    /// Returns the circumstances of a row by its index.
    ///
    /// # Panics
    /// If there is no such row.
    pub(crate) fn circumstances_of(&self, place: usize) -> Circumstances {
        let of = &self.columns[self.results..];
        Circumstances {
            wall_s: of[0].number(place),
            host: of[1].text(place).into(),
            attempt: of[2].text(place).into(),
            tries: of[3].count(place),
        }
    }

    /// Encodes the rows as the input of the campaign's digest.
    pub(crate) fn fed(&self) -> Vec<u8> {
        let bytes = self.results().iter().map(Values::fed_bytes);
        let mut fed = Vec::with_capacity(bytes.sum());
        for place in 0..self.cases().len() {
            for column in self.results() {
                column.feed(place, &mut fed);
            }
        }
        fed
    }
}

/// Computes the checksum of a part whose checksum digits are zeros.
fn seal(bytes: &[u8]) -> [u8; DIGITS] {
    let mut digits = [b'0'; DIGITS];
    digits.copy_from_slice(blake3::hash(bytes).to_hex().as_bytes());
    digits
}

/// Finds the digits of the checksum: the last occurrence, because rows precede them.
fn sealed(bytes: &mut [u8]) -> Option<&mut [u8]> {
    let seal = SEAL.as_bytes();
    let place = bytes.windows(seal.len()).rposition(|word| word == seal)? + seal.len();
    bytes.get_mut(place..place + DIGITS)
}

/// Extracts the checksum of a part and replaces it by zeros.
fn unsealed(bytes: &mut [u8]) -> Option<[u8; DIGITS]> {
    let place = sealed(bytes)?;
    let mut digits = [b'0'; DIGITS];
    digits.swap_with_slice(place);
    Some(digits)
}
