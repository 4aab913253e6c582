//! A table as comma-separated values.
//!
//! A header with the names, then a line for each row. Numbers are written in the shortest form that reads back as the
//! same bits, undefined numbers as `NaN`, and flags as `true` and `false`. The cell of a missing time or count is
//! empty.

use std::io::{self, Write};

use super::cell::{Cell, Column};

/// Size of a write in bytes.
const BLOCK_BYTES: usize = 1 << 16;

/// A table being written.
pub(super) struct Csv<W> {
    to: W,
    text: Vec<u8>,
    number: zmij::Buffer,
}

impl<W: Write> Csv<W> {
    /// Starts a table with its header. Names consist of letters, digits, `_` and `.`, so nothing needs quotes.
    pub(super) fn new(to: W, columns: &[Column]) -> Self {
        let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
        Self {
            to,
            text: (names.join(",") + "\n").into_bytes(),
            number: zmij::Buffer::new(),
        }
    }

    pub(super) fn row(&mut self, cells: &[Cell]) -> io::Result<()> {
        for (index, cell) in cells.iter().enumerate() {
            if index > 0 {
                self.text.push(b',');
            }
            match cell {
                Cell::Number(value) => {
                    let text = self.number.format(*value);
                    self.text.extend_from_slice(text.as_bytes());
                }
                Cell::Count(count) => write!(self.text, "{count}")?,
                Cell::Flag(flag) => write!(self.text, "{flag}")?,
                Cell::Missing => {}
            }
        }
        self.text.push(b'\n');
        if self.text.len() >= BLOCK_BYTES {
            self.write()?;
        }
        Ok(())
    }

    pub(super) fn finish(mut self) -> io::Result<W> {
        self.write()?;
        Ok(self.to)
    }

    fn write(&mut self) -> io::Result<()> {
        self.to.write_all(&self.text)?;
        self.text.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::cell::CellKind;
    use super::*;

    #[test]
    fn numbers_are_short_and_read_back_as_the_same_bits() {
        let values = [
            (0.1, "0.1"),
            (1.0 / 3.0, "0.3333333333333333"),
            (-2.5e-300, "-2.5e-300"),
            (-0.0, "-0.0"),
            (f64::NAN, "NaN"),
            (f64::NEG_INFINITY, "-inf"),
            (5e-324, "5e-324"),
        ];
        let column = |name: &str| Column {
            name: name.into(),
            unit: String::new(),
            kind: CellKind::Number,
            is_optional: false,
        };
        let mut table = Csv::new(Vec::new(), &[column("step"), column("x_m"), column("ok")]);
        for (step, (value, _)) in (0..).zip(values) {
            let cells = [
                Cell::Count(step),
                Cell::Number(value),
                Cell::Flag(step == 1),
            ];
            table.row(&cells).expect("memory takes everything");
        }
        let text = String::from_utf8(table.finish().expect("written")).expect("text");
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some("step,x_m,ok"));
        for (step, (value, written)) in (0..).zip(values) {
            let line = lines.next().expect("a line for each row");
            assert_eq!(line, format!("{step},{written},{}", step == 1));
            let read: f64 = written.parse().expect("a number");
            assert_eq!(read.to_bits(), value.to_bits());
        }
        assert_eq!(lines.next(), None);
    }
}
