//! Columns in memory: consecutive cells of one kind.

use std::ops::Range;

use bytes::Bytes;
use parquet::data_type::ByteArray;

use super::{Cell, ColumnKind};

/// Cells of one column.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Values {
    /// Unsigned integers.
    Counts(Vec<u64>),
    /// Floating-point numbers.
    Numbers(Vec<f64>),
    /// Texts.
    Texts(Texts),
}

impl Values {
    /// Creates an empty column.
    pub(super) fn new(kind: ColumnKind) -> Self {
        match kind {
            ColumnKind::Count => Self::Counts(Vec::new()),
            ColumnKind::Number => Self::Numbers(Vec::new()),
            ColumnKind::Text => Self::Texts(Texts::default()),
        }
    }

    pub(super) const fn kind(&self) -> ColumnKind {
        match self {
            Self::Counts(_) => ColumnKind::Count,
            Self::Numbers(_) => ColumnKind::Number,
            Self::Texts(_) => ColumnKind::Text,
        }
    }

    /// Returns the number of cells.
    pub(crate) const fn rows(&self) -> usize {
        match self {
            Self::Counts(values) => values.len(),
            Self::Numbers(values) => values.len(),
            Self::Texts(values) => values.ends.len(),
        }
    }

    /// Returns the number of bytes that the column adds to the input of a digest.
    pub(crate) const fn fed_bytes(&self) -> usize {
        let texts = match self {
            Self::Counts(_) | Self::Numbers(_) => 0,
            Self::Texts(values) => values.text.len(),
        };
        texts + self.rows() * size_of::<u64>()
    }

    /// Returns the count of a row; 0 for other kinds.
    ///
    /// # Panics
    /// If there is no such row.
    pub(crate) fn count(&self, row: usize) -> u64 {
        match self {
            Self::Counts(values) => values[row],
            Self::Numbers(_) | Self::Texts(_) => 0,
        }
    }

    /// Returns the number of a row; NaN for other kinds.
    ///
    /// # Panics
    /// If there is no such row.
    #[must_use]
    pub(crate) fn number(&self, row: usize) -> f64 {
        match self {
            Self::Numbers(values) => values[row],
            Self::Counts(_) | Self::Texts(_) => f64::NAN,
        }
    }

    /// Returns the text of a row; empty for other kinds.
    ///
    /// # Panics
    /// If there is no such row.
    pub(crate) fn text(&self, row: usize) -> &str {
        match self {
            Self::Texts(values) => values.get(row),
            Self::Counts(_) | Self::Numbers(_) => "",
        }
    }

    /// Returns the cell of a row.
    ///
    /// # Panics
    /// If there is no such row.
    pub(crate) fn cell(&self, row: usize) -> Cell {
        match self {
            Self::Counts(values) => Cell::Count(values[row]),
            Self::Numbers(values) => Cell::Number(values[row]),
            Self::Texts(values) => Cell::Text(values.get(row).into()),
        }
    }

    /// Appends the cell of a row to the input of a digest: counts and the bits of numbers as 8 bytes, little-endian;
    /// texts as their length in bytes, encoded like a count, followed by the bytes.
    ///
    /// # Panics
    /// If there is no such row.
    pub(crate) fn feed(&self, row: usize, to: &mut Vec<u8>) {
        match self {
            Self::Counts(values) => to.extend_from_slice(&values[row].to_le_bytes()),
            Self::Numbers(values) => to.extend_from_slice(&values[row].to_bits().to_le_bytes()),
            Self::Texts(values) => {
                let text = values.get(row);
                to.extend_from_slice(&(text.len() as u64).to_le_bytes());
                to.extend_from_slice(text.as_bytes());
            }
        }
    }

    /// Appends a cell; returns `false` if the cell is of another kind.
    pub(super) fn push(&mut self, cell: &Cell) -> bool {
        match (self, cell) {
            (Self::Counts(to), Cell::Count(count)) => to.push(*count),
            (Self::Numbers(to), Cell::Number(number)) => to.push(*number),
            (Self::Texts(to), Cell::Text(text)) => to.push(text),
            _ => return false,
        }
        true
    }

    /// Appends rows of another column; does nothing if the kinds differ.
    pub(super) fn extend(&mut self, from: &Self, rows: Range<usize>) {
        match (self, from) {
            (Self::Counts(to), Self::Counts(from)) => to.extend_from_slice(&from[rows]),
            (Self::Numbers(to), Self::Numbers(from)) => to.extend_from_slice(&from[rows]),
            (Self::Texts(to), Self::Texts(from)) => to.extend(from, rows),
            _ => {}
        }
    }

    /// Appends the cells of a page in Parquet's plain encoding; `None` if their number differs.
    pub(super) fn decode(&mut self, page: &[u8], cells: usize) -> Option<()> {
        if let Self::Texts(values) = self {
            return values.decode(page, cells);
        }
        let (words, rest) = page.as_chunks();
        if words.len() != cells || !rest.is_empty() {
            return None;
        }
        let words = words.iter().map(|word| u64::from_le_bytes(*word));
        match self {
            Self::Counts(values) => values.extend(words),
            Self::Numbers(values) => values.extend(words.map(f64::from_bits)),
            Self::Texts(_) => {}
        }
        Some(())
    }
}

/// Texts concatenated into one string, with the end of each.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Texts {
    text: String,
    ends: Vec<usize>,
}

impl Texts {
    fn start(&self, row: usize) -> usize {
        row.checked_sub(1).map_or(0, |before| self.ends[before])
    }

    fn get(&self, row: usize) -> &str {
        &self.text[self.start(row)..self.ends[row]]
    }

    fn push(&mut self, text: &str) {
        self.text.push_str(text);
        self.ends.push(self.text.len());
    }

    fn extend(&mut self, from: &Self, rows: Range<usize>) {
        let Some(last) = rows.end.checked_sub(1) else {
            return;
        };
        let (begin, start) = (self.text.len(), from.start(rows.start));
        self.text.push_str(&from.text[start..from.ends[last]]);
        let ends = from.ends[rows].iter();
        self.ends.extend(ends.map(|end| end - start + begin));
    }

    fn decode(&mut self, page: &[u8], cells: usize) -> Option<()> {
        // Each text is preceded by its length, so a page never reserves more cells than its size allows.
        if cells > page.len() / size_of::<u32>() {
            return None;
        }
        let begin = self.ends.len();
        let mut bytes = Vec::with_capacity(page.len());
        self.ends.reserve(cells);
        let mut rest = page;
        for _ in 0..cells {
            let (length, after) = rest.split_first_chunk()?;
            let length = usize::try_from(u32::from_le_bytes(*length)).ok()?;
            let (text, after) = after.split_at_checked(length)?;
            bytes.extend_from_slice(text);
            self.ends.push(self.text.len() + bytes.len());
            rest = after;
        }
        self.text.push_str(std::str::from_utf8(&bytes).ok()?);
        let mut ends = self.ends[begin..].iter();
        let is_whole = rest.is_empty() && ends.all(|end| self.text.is_char_boundary(*end));
        is_whole.then_some(())
    }

    /// Drains all texts in the representation that `parquet` writes.
    pub(super) fn drain(&mut self) -> Vec<ByteArray> {
        let bytes = Bytes::from(std::mem::take(&mut self.text));
        let mut start = 0;
        let texts = self.ends.drain(..).map(|end| {
            let text = bytes.slice(start..end);
            start = end;
            text.into()
        });
        texts.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(texts: &[&[u8]]) -> Vec<u8> {
        let length = |text: &[u8]| u32::try_from(text.len()).expect("short").to_le_bytes();
        let texts = texts
            .iter()
            .flat_map(|text| [&length(text)[..], text].concat());
        texts.collect()
    }

    #[test]
    fn texts_of_consecutive_pages_are_appended() {
        let mut values = Values::new(ColumnKind::Text);
        values
            .decode(&page(&[b"a", b"", "\u{e4}".as_bytes()]), 3)
            .expect("texts");
        values.decode(&page(&[b"bc"]), 1).expect("a text");
        let texts: Vec<&str> = (0..4).map(|row| values.text(row)).collect();
        assert_eq!(texts, ["a", "", "\u{e4}", "bc"]);
        let mut more = Values::new(ColumnKind::Text);
        assert!(more.push(&Cell::Text("x".into())));
        more.extend(&values, 1..4);
        let texts: Vec<&str> = (0..4).map(|row| more.text(row)).collect();
        assert_eq!(texts, ["x", "", "\u{e4}", "bc"]);
        assert!(!more.push(&Cell::Count(1)));
    }

    #[test]
    fn a_page_with_another_cell_count_or_invalid_utf8_is_rejected() {
        let two = page(&[b"a", b"b"]);
        // A character split by the end of a text is valid UTF-8 only together with the next text.
        let cut = page(&[b"\xc3", b"\xa4"]);
        for (page, cells) in [
            (&*two, 1),
            (&two, 3),
            (&two, usize::MAX),
            (&two[..9], 2),
            (&cut, 2),
            (&page(&[b"\xff"]), 1),
        ] {
            assert_eq!(
                Values::new(ColumnKind::Text).decode(page, cells),
                None,
                "{page:?} {cells}"
            );
        }
        for kind in [ColumnKind::Count, ColumnKind::Number] {
            for (bytes, cells) in [(16, 1), (16, 3), (17, 2), (0, usize::MAX)] {
                let page = vec![0; bytes];
                assert_eq!(
                    Values::new(kind).decode(&page, cells),
                    None,
                    "{bytes} {cells}"
                );
            }
        }
    }
}
