//! Packing: from a row of signals to the bytes of a frame.

use shared_types::layout::{SignalTable, Unbound};
use shared_types::quality::SignalSet;
use shared_types::table::Field as Column;

use crate::bits::BitField;
use crate::checksum::Algorithm;
use crate::frame::{Body, Content, Counter, Frame, JsonContent, Signal};
use crate::json::{self, Piece};
use crate::number::Number;
use crate::row::FieldResult;

/// Longest text of a number in JSON.
const LONGEST_NUMBER: usize = 32;

/// Reason why a frame cannot be used with the table of a row.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unusable {
    /// The frame has mistakes.
    #[error("frame `{0}` is not well formed")]
    Mistaken(String),
    /// The table lacks a signal.
    #[error("frame `{frame}`: {unbound}")]
    Unbound {
        /// The frame.
        frame: String,
        /// The signal.
        unbound: Unbound,
    },
}

/// Finds the column of a signal.
pub(crate) fn column(frame: &Frame, signal: &Signal, row: &SignalTable) -> Result<usize, Unusable> {
    let required = [Column::signal(&signal.name, &signal.unit, "")];
    let places = row.bind(signal.kind, &required);
    places.map(|places| places[0]).map_err(|mut unbound| {
        let frame = frame.name.clone();
        let unbound = unbound.swap_remove(0);
        Unusable::Unbound { frame, unbound }
    })
}

/// Returns an error if the frame has mistakes.
pub(crate) fn sound(frame: &Frame) -> Result<(), Unusable> {
    match frame.mistakes().is_empty() {
        true => Ok(()),
        false => Err(Unusable::Mistaken(frame.name.clone())),
    }
}

/// Checksum of a frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sum {
    pub bits: BitField,
    pub algorithm: Algorithm,
    pub first: usize,
    pub end: usize,
}

impl Sum {
    /// Computes the sum over the covered bytes without its own.
    #[inline]
    pub(crate) fn compute(&self, bytes: &[u8]) -> u64 {
        let own_first = self.bits.first_byte().clamp(self.first, self.end);
        let own_end = self.bits.end_byte().clamp(self.first, self.end);
        self.algorithm
            .compute(&bytes[self.first..own_first], &bytes[own_end..self.end])
    }
}

/// Signal that a packer packs.
#[derive(Clone, Debug, PartialEq)]
struct Slot {
    column: usize,
    number: Number,
    /// Raw number of the last valid value.
    last: u64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Item {
    Signal(usize),
    Valid(usize),
    Counter(Counter),
}

#[derive(Clone, Debug, PartialEq)]
enum Form {
    Bytes {
        blank: Box<[u8]>,
        items: Box<[(BitField, Item)]>,
        sums: Box<[Sum]>,
    },
    Json {
        pieces: Box<[Piece]>,
        /// Item of each field; `None` for constants.
        items: Box<[Option<Item>]>,
    },
}

/// Sender of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Packer {
    form: Form,
    slots: Box<[Slot]>,
    results: Box<[FieldResult]>,
    saturated: Box<[u64]>,
    counter: u64,
    buffer: Box<[u8]>,
}

impl Packer {
    /// Binds a frame to the table of the row that it is packed from.
    ///
    /// # Errors
    /// If the frame has mistakes, or the table lacks one of its signals.
    pub fn new(frame: &Frame, row: &SignalTable) -> Result<Self, Unusable> {
        sound(frame)?;
        let mut slots = Vec::new();
        let mut slot = |signal: &Signal, number: &Number| {
            let column = column(frame, signal, row)?;
            let (last, _) = number.encode(0.0);
            let number = *number;
            slots.push(Slot {
                column,
                number,
                last,
            });
            Ok::<_, Unusable>(Item::Signal(slots.len() - 1))
        };
        let (form, longest) = match &frame.body {
            Body::Bytes { length, fields } => {
                let mut blank = vec![0; *length];
                let (mut items, mut sums) = (Vec::new(), Vec::new());
                for field in fields {
                    let item = match &field.content {
                        Content::Signal(signal, number) => slot(signal, number)?,
                        Content::Valid(signal) => Item::Valid(column(frame, signal, row)?),
                        Content::Counter(counter) => Item::Counter(*counter),
                        Content::Constant(raw) => {
                            field.bits.write(&mut blank, *raw);
                            continue;
                        }
                        Content::Checksum {
                            algorithm,
                            first,
                            end,
                        } => {
                            sums.push(Sum {
                                bits: field.bits,
                                algorithm: *algorithm,
                                first: *first,
                                end: *end,
                            });
                            continue;
                        }
                    };
                    items.push((field.bits, item));
                }
                let form = Form::Bytes {
                    blank: blank.into(),
                    items: items.into(),
                    sums: sums.into(),
                };
                (form, *length)
            }
            Body::Json(fields) => {
                let mut items = Vec::new();
                for field in fields {
                    items.push(match &field.content {
                        JsonContent::Signal(signal, number) => Some(slot(signal, number)?),
                        JsonContent::Counter(counter) => Some(Item::Counter(*counter)),
                        JsonContent::Text(_) | JsonContent::Number(_) => None,
                    });
                }
                let pieces = json::pieces(fields);
                let text: usize = pieces.iter().map(|piece| piece.text.len()).sum();
                let longest = text + items.len() * LONGEST_NUMBER;
                let (pieces, items) = (pieces.into(), items.into());
                (Form::Json { pieces, items }, longest)
            }
        };
        Ok(Self {
            form,
            results: vec![FieldResult::Missing; slots.len()].into(),
            saturated: vec![0; slots.len()].into(),
            slots: slots.into(),
            counter: 0,
            buffer: vec![0; longest].into(),
        })
    }

    /// Packs a row, some of whose signals are invalid, and returns the bytes.
    ///
    /// An invalid signal is packed as the number that stands for no value, as `null` in JSON, or as its last valid value
    /// if its field has no such number.
    ///
    /// # Panics
    /// If the row is shorter than the table.
    #[inline]
    pub fn pack(&mut self, values: &[f64], invalid: &SignalSet) -> &[u8] {
        let is_valid = |column: usize| !values[column].is_nan() && !invalid.contains(column);
        for (place, slot) in self.slots.iter_mut().enumerate() {
            self.results[place] = if is_valid(slot.column) {
                let (raw, is_beyond) = slot.number.encode(values[slot.column]);
                slot.last = raw;
                self.saturated[place] += u64::from(is_beyond);
                match is_beyond {
                    true => FieldResult::Saturated,
                    false => FieldResult::Value,
                }
            } else {
                FieldResult::NotAvailable
            };
        }
        let length = match &self.form {
            Form::Bytes { blank, items, sums } => {
                let bytes = &mut self.buffer[..blank.len()];
                bytes.copy_from_slice(blank);
                for (bits, item) in items {
                    let raw = match *item {
                        Item::Signal(place) => {
                            let slot = &self.slots[place];
                            match (self.results[place], slot.number.scale().invalid) {
                                (FieldResult::NotAvailable, Some(invalid)) => invalid,
                                _ => slot.last,
                            }
                        }
                        Item::Valid(column) => u64::from(is_valid(column)),
                        Item::Counter(_) => self.counter,
                    };
                    bits.write(bytes, raw);
                }
                for sum in sums {
                    let computed = sum.compute(bytes);
                    sum.bits.write(bytes, computed);
                }
                blank.len()
            }
            Form::Json { pieces, items } => {
                let mut end = 0;
                let mut number = zmij::Buffer::new();
                for piece in pieces {
                    append(&mut self.buffer, &mut end, &piece.text);
                    let item = piece.field.and_then(|field| items[field]);
                    let text = match item {
                        None => "",
                        Some(Item::Signal(place)) => match self.results[place] {
                            FieldResult::NotAvailable => "null",
                            _ => number.format_finite(f64::from_bits(self.slots[place].last)),
                        },
                        Some(Item::Valid(column)) => {
                            if is_valid(column) {
                                "true"
                            } else {
                                "false"
                            }
                        }
                        Some(Item::Counter(_)) => number.format_finite(self.counter as f64),
                    };
                    let text = text.strip_suffix(".0").unwrap_or(text);
                    append(&mut self.buffer, &mut end, text.as_bytes());
                }
                end
            }
        };
        if let Some(counter) = self.form.counter() {
            self.counter = counter.next(self.counter);
        }
        &self.buffer[..length]
    }

    /// Returns the counter of the next frame; `None` for a frame without a counter.
    #[must_use]
    pub fn counter(&self) -> Option<u64> {
        self.form.counter().map(|_| self.counter)
    }

    /// Continues a count that another packer began.
    pub const fn continue_at(&mut self, counter: u64) {
        self.counter = counter;
    }

    /// Returns the largest number of bytes of the frame.
    #[must_use]
    pub fn longest(&self) -> usize {
        self.buffer.len()
    }

    /// Returns the columns of the packed signals in the row, in the order of the fields.
    pub fn columns(&self) -> impl Iterator<Item = usize> {
        self.slots.iter().map(|slot| slot.column)
    }

    /// Returns the results of the last frame, in the order of [`columns`](Self::columns).
    #[must_use]
    pub fn results(&self) -> &[FieldResult] {
        &self.results
    }

    /// Returns the state between two frames, for a checkpoint: the counter, then last raw number and count of saturated
    /// values of each signal.
    #[must_use]
    pub fn state(&self) -> Vec<u64> {
        let slots = self.slots.iter().zip(&self.saturated);
        let slots = slots.flat_map(|(slot, saturated)| [slot.last, *saturated]);
        std::iter::once(self.counter).chain(slots).collect()
    }

    /// Restores a state; returns `false` if it is one of another frame.
    #[must_use]
    pub fn restore(&mut self, state: &[u64]) -> bool {
        let Some((counter, slots)) = state.split_first() else {
            return false;
        };
        let slots = slots.chunks_exact(2);
        let is_whole = slots.remainder().is_empty() && slots.len() == self.slots.len();
        if is_whole {
            self.counter = *counter;
            let own = self.slots.iter_mut().zip(&mut self.saturated);
            for ((slot, saturated), state) in own.zip(slots) {
                (slot.last, *saturated) = (state[0], state[1]);
            }
        }
        is_whole
    }

    /// Returns the numbers of values that were beyond the range, in the order of [`columns`](Self::columns).
    #[must_use]
    pub fn saturated(&self) -> &[u64] {
        &self.saturated
    }
}

impl Form {
    fn counter(&self) -> Option<Counter> {
        let of = |item: &Item| match item {
            Item::Counter(counter) => Some(*counter),
            _ => None,
        };
        match self {
            Self::Bytes { items, .. } => items.iter().find_map(|(_, item)| of(item)),
            Self::Json { items, .. } => items.iter().flatten().find_map(of),
        }
    }
}

fn append(buffer: &mut [u8], end: &mut usize, text: &[u8]) {
    buffer[*end..*end + text.len()].copy_from_slice(text);
    *end += text.len();
}
