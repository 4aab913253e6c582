//! Unpacking: from the bytes of one frame to a row. Called by the receiver only.

use shared_types::layout::SignalTable;

use crate::bits::BitField;
use crate::frame::{Body, Content, Counter, Frame, JsonContent, Path, Signal};
use crate::json::{self, Leaf};
use crate::number::{Decoded, Number};
use crate::pack::{Sum, Unusable, column, sound};
use crate::row::{FieldResult, Refusal, Row};

/// Signal that is unpacked: its field, its column and its number.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Slot {
    field: usize,
    column: usize,
    number: Number,
}

#[derive(Clone, Debug, PartialEq)]
enum Form {
    Bytes {
        length: usize,
        /// Fields, places and values of constants.
        constants: Box<[(usize, BitField, u64)]>,
        sums: Box<[(usize, Sum)]>,
        counter: Option<(usize, BitField, Counter)>,
        slots: Box<[(BitField, Slot)]>,
        /// Places of validity bits, with the column.
        valid: Box<[(BitField, usize)]>,
    },
    Json {
        paths: Box<[Path]>,
        constants: Box<[(usize, Constant)]>,
        counter: Option<(usize, Counter)>,
        slots: Box<[Slot]>,
        /// Value of each field in the line at hand.
        values: Box<[Option<JsonValue>]>,
    },
}

#[derive(Clone, Debug, PartialEq)]
enum Constant {
    Text(String),
    Number(f64),
}

/// Value of a JSON field.
#[derive(Clone, Copy, Debug, PartialEq)]
enum JsonValue {
    Number(f64),
    NotFinite,
    Null,
    /// Text; `true` if it is the constant of the field.
    Text(bool),
}

/// Counts of one frame on the receiving side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames that were accepted.
    pub accepted: u64,
    /// Frames that repeated the counter of the one before.
    pub repeated: u64,
    /// Frames that were refused for any other reason.
    pub refused: u64,
    /// Frames that are missing according to the counter of accepted ones.
    pub lost: u64,
    /// Fields that were refused in accepted frames.
    pub refused_fields: u64,
}

/// Receiver of one frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Unpacker {
    form: Form,
    last_counter: Option<u64>,
    /// Columns of all signals.
    columns: Box<[usize]>,
    pub counts: Counts,
}

impl Unpacker {
    pub(crate) fn new(frame: &Frame, row: &SignalTable) -> Result<Self, Unusable> {
        sound(frame)?;
        let slot = |field: usize, signal: &Signal, number: &Number| {
            let (column, number) = (column(frame, signal, row)?, *number);
            let slot = Slot {
                field,
                column,
                number,
            };
            Ok::<_, Unusable>(slot)
        };
        let mut columns = Vec::new();
        let form = match &frame.body {
            Body::Bytes { length, fields } => {
                let (mut constants, mut sums) = (Vec::new(), Vec::new());
                let (mut slots, mut valid, mut alive) = (Vec::new(), Vec::new(), None);
                for (index, field) in fields.iter().enumerate() {
                    let bits = field.bits;
                    match &field.content {
                        Content::Signal(signal, number) => {
                            let slot = slot(index, signal, number)?;
                            columns.push(slot.column);
                            slots.push((bits, slot));
                        }
                        Content::Valid(signal) => valid.push((bits, column(frame, signal, row)?)),
                        Content::Constant(raw) => constants.push((index, bits, *raw)),
                        Content::Counter(counter) => alive = Some((index, bits, *counter)),
                        Content::Checksum {
                            algorithm,
                            first,
                            end,
                        } => {
                            let (algorithm, first, end) = (*algorithm, *first, *end);
                            let sum = Sum {
                                bits,
                                algorithm,
                                first,
                                end,
                            };
                            sums.push((index, sum));
                        }
                    }
                }
                Form::Bytes {
                    length: *length,
                    constants: constants.into(),
                    sums: sums.into(),
                    counter: alive,
                    slots: slots.into(),
                    valid: valid.into(),
                }
            }
            Body::Json(fields) => {
                let (mut constants, mut slots, mut alive) = (Vec::new(), Vec::new(), None);
                for (index, field) in fields.iter().enumerate() {
                    match &field.content {
                        JsonContent::Signal(signal, number) => {
                            let slot = slot(index, signal, number)?;
                            columns.push(slot.column);
                            slots.push(slot);
                        }
                        JsonContent::Text(text) => {
                            constants.push((index, Constant::Text(text.clone())));
                        }
                        JsonContent::Number(number) => {
                            constants.push((index, Constant::Number(*number)));
                        }
                        JsonContent::Counter(counter) => alive = Some((index, *counter)),
                    }
                }
                Form::Json {
                    paths: fields.iter().map(|field| field.path.clone()).collect(),
                    constants: constants.into(),
                    counter: alive,
                    slots: slots.into(),
                    values: vec![None; fields.len()].into(),
                }
            }
        };
        Ok(Self {
            form,
            last_counter: None,
            columns: columns.into(),
            counts: Counts::default(),
        })
    }

    /// Returns the columns of all signals.
    pub(crate) fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// Unpacks a frame. A repeated one changes nothing; any other refused one makes its signals invalid.
    #[inline]
    pub(crate) fn unpack(&mut self, bytes: &[u8], row: &mut Row) -> Result<(), Refusal> {
        let counter = self.check(bytes).and_then(|()| self.count(bytes));
        match counter {
            Ok(lost) => {
                self.counts.lost += lost;
                self.counts.accepted += 1;
                self.values(bytes, row);
                Ok(())
            }
            Err(refusal @ Refusal::Repeated { .. }) => {
                self.counts.repeated += 1;
                Err(refusal)
            }
            Err(refusal) => {
                self.counts.refused += 1;
                for column in &self.columns {
                    row.mark(*column, FieldResult::Refused(refusal));
                }
                Err(refusal)
            }
        }
    }

    /// Checks length, constants and checksums; reads the fields of a JSON line.
    pub(crate) fn check(&mut self, bytes: &[u8]) -> Result<(), Refusal> {
        match &mut self.form {
            Form::Bytes {
                length,
                constants,
                sums,
                ..
            } => {
                let (got, expected) = (bytes.len(), *length);
                match got.cmp(&expected) {
                    std::cmp::Ordering::Less => {
                        return Err(Refusal::Truncated {
                            bytes: got,
                            expected,
                        });
                    }
                    std::cmp::Ordering::Greater => {
                        return Err(Refusal::Oversized {
                            bytes: got,
                            expected,
                        });
                    }
                    std::cmp::Ordering::Equal => {}
                }
                for &(field, bits, raw) in constants.iter() {
                    if bits.read(bytes) != raw {
                        return Err(Refusal::Constant { field });
                    }
                }
                for (field, sum) in sums.iter() {
                    let (sent, computed) = (sum.bits.read(bytes), sum.compute(bytes));
                    if sent != computed {
                        let field = *field;
                        return Err(Refusal::Checksum {
                            field,
                            sent,
                            computed,
                        });
                    }
                }
                Ok(())
            }
            Form::Json {
                paths,
                constants,
                values,
                ..
            } => {
                scan(bytes, paths, constants, values)?;
                for (field, constant) in constants.iter() {
                    let field = *field;
                    let is_same = match (constant, values[field]) {
                        (_, None) => return Err(Refusal::Absent { field }),
                        (Constant::Number(one), Some(JsonValue::Number(other))) => *one == other,
                        (Constant::Text(_), Some(JsonValue::Text(is_same))) => is_same,
                        _ => false,
                    };
                    if !is_same {
                        return Err(Refusal::Constant { field });
                    }
                }
                Ok(())
            }
        }
    }

    /// Checks the counter and returns the number of frames lost before this one.
    fn count(&mut self, bytes: &[u8]) -> Result<u64, Refusal> {
        let (field, counter, sent) = match &self.form {
            Form::Bytes { counter, .. } => match counter {
                None => return Ok(0),
                Some((field, bits, counter)) => (*field, *counter, bits.read(bytes)),
            },
            Form::Json {
                counter, values, ..
            } => match counter {
                None => return Ok(0),
                Some((field, counter)) => match values[*field] {
                    None => return Err(Refusal::Absent { field: *field }),
                    Some(JsonValue::Number(number)) if number >= 0.0 && number.fract() == 0.0 => {
                        (*field, *counter, number as u64) // saturates
                    }
                    Some(_) => return Err(Refusal::NotANumber { field: *field }),
                },
            },
        };
        let last = self.last_counter.replace(sent);
        let Some(last) = last else {
            return Ok(0);
        };
        if sent == last {
            let counter = sent;
            return Err(Refusal::Repeated { field, counter });
        }
        let jump = sent.wrapping_sub(last) & crate::number::mask(counter.width);
        // Beyond its width the counter is wrong at once.
        let is_inside = sent <= crate::number::mask(counter.width);
        if !is_inside || jump > counter.max_jump {
            let expected = counter.next(last);
            return Err(Refusal::Jump {
                field,
                expected,
                sent,
            });
        }
        Ok(jump - 1)
    }

    /// Takes the values of an accepted frame.
    #[inline]
    fn values(&mut self, bytes: &[u8], row: &mut Row) {
        let mut refused = 0;
        let mut take = |row: &mut Row, slot: &Slot, decoded: Decoded| {
            let (column, field) = (slot.column, slot.field);
            let refusal = match decoded {
                Decoded::Value(value) => return row.accept(column, value),
                Decoded::Invalid => return row.mark(column, FieldResult::NotAvailable),
                Decoded::NotFinite => Refusal::NotFinite { field },
                Decoded::OutOfRange => Refusal::OutOfRange { field },
            };
            refused += 1;
            row.mark(column, FieldResult::Refused(refusal));
        };
        match &self.form {
            Form::Bytes { slots, valid, .. } => {
                for (bits, slot) in slots.iter() {
                    take(row, slot, slot.number.decode(bits.read(bytes)));
                }
                for (bits, column) in valid.iter() {
                    if bits.read(bytes) == 0 {
                        row.mark(*column, FieldResult::NotAvailable);
                    }
                }
            }
            Form::Json { slots, values, .. } => {
                for slot in slots.iter() {
                    let field = slot.field;
                    let refusal = match values[field] {
                        Some(JsonValue::Number(number)) => {
                            take(row, slot, slot.number.decode(number.to_bits()));
                            continue;
                        }
                        Some(JsonValue::Null) => {
                            take(row, slot, Decoded::Invalid);
                            continue;
                        }
                        Some(JsonValue::NotFinite) => {
                            take(row, slot, Decoded::NotFinite);
                            continue;
                        }
                        Some(JsonValue::Text(_)) => Refusal::NotANumber { field },
                        None => Refusal::Absent { field },
                    };
                    self.counts.refused_fields += 1;
                    row.mark(slot.column, FieldResult::Refused(refusal));
                }
            }
        }
        self.counts.refused_fields += refused;
    }
}

impl Unpacker {
    pub(crate) fn state(&self) -> [u64; 7] {
        let Counts {
            accepted,
            repeated,
            refused,
            lost,
            refused_fields,
        } = self.counts;
        let (has_counter, counter) = match self.last_counter {
            Some(counter) => (1, counter),
            None => (0, 0),
        };
        [
            has_counter,
            counter,
            accepted,
            repeated,
            refused,
            lost,
            refused_fields,
        ]
    }

    pub(crate) fn restore(&mut self, state: [u64; 7]) {
        let [
            has_counter,
            counter,
            accepted,
            repeated,
            refused,
            lost,
            refused_fields,
        ] = state;
        self.last_counter = (has_counter == 1).then_some(counter);
        self.counts = Counts {
            accepted,
            repeated,
            refused,
            lost,
            refused_fields,
        };
    }
}

/// Reads the fields of a JSON line; of two values at one path the last counts.
fn scan(
    bytes: &[u8],
    paths: &[Path],
    constants: &[(usize, Constant)],
    values: &mut [Option<JsonValue>],
) -> Result<(), Refusal> {
    values.fill(None);
    let mut next = 0;
    let mut visit = |steps: &[json::Step<'_>], leaf: Leaf<'_>| {
        // Lines usually have their fields in the order of the file.
        let field = (next..paths.len()).chain(0..next);
        let Some(field) = { field }.find(|field| json::is_at(steps, &paths[*field].0)) else {
            return;
        };
        next = field + 1;
        values[field] = Some(match leaf {
            Leaf::Number(number) => JsonValue::Number(number),
            Leaf::Boolean(truth) => JsonValue::Number(f64::from(truth)),
            Leaf::NotFinite => JsonValue::NotFinite,
            Leaf::Null => JsonValue::Null,
            Leaf::Text(text) => JsonValue::Text(constants.iter().any(|(other, constant)| {
                let is_constant =
                    |expected: &Constant| matches!(expected, Constant::Text(expected) if expected.as_bytes() == text);
                *other == field && is_constant(constant)
            })),
        });
    };
    json::scan(bytes, &mut visit).map_err(|at| Refusal::NotJson { at })
}
