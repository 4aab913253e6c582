//! Frames as a file describes them: fields with their places and contents.

use std::fmt;

use shared_types::layout::SignalKind;

use crate::bits::{BitField, LONGEST_FRAME};
use crate::checksum::Algorithm;
use crate::number::{Encoding, Number, mask};

pub use crate::path::Path;

/// Identifier of a CAN frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum CanId {
    /// 11 bits.
    Standard(u16),
    /// 29 bits.
    Extended(u32),
}

impl fmt::Display for CanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Standard(id) => write!(f, "{id:#x}"),
            Self::Extended(id) => write!(f, "{id:#x} (extended)"),
        }
    }
}

/// Frame on a wire.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Name.
    pub name: String,
    /// Identifier, on CAN.
    pub id: Option<CanId>,
    /// Fields.
    pub body: Body,
}

/// Fields of a frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Body {
    /// Bits in a fixed number of bytes.
    Bytes {
        /// Number of bytes.
        length: usize,
        /// Fields.
        fields: Vec<Field>,
    },
    /// Line of JSON.
    Json(Vec<JsonField>),
}

/// Field of bits.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Name.
    pub name: String,
    /// Place in the bytes.
    pub bits: BitField,
    /// Content.
    pub content: Content,
}

/// Signal of a row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signal {
    /// Kind.
    pub kind: SignalKind,
    /// Name in the table.
    pub name: String,
    /// Unit in the table.
    pub unit: String,
}

impl Signal {
    /// Returns `true` if both are the same signal, in any unit.
    #[must_use]
    pub fn is(&self, other: &Self) -> bool {
        self.kind == other.kind && self.name == other.name
    }
}

impl fmt::Display for Signal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.kind.prefix(), self.name)
    }
}

/// Content of a field of bits.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Value of a signal.
    Signal(Signal, Number),
    /// 1 while the signal is valid, else 0.
    Valid(Signal),
    /// A fixed raw number.
    Constant(u64),
    /// Number that grows by one with each frame and starts again at 0 beyond its width.
    Counter(Counter),
    /// Checksum of the bytes from the first to before the end, without those of its own field.
    Checksum {
        /// Algorithm.
        algorithm: Algorithm,
        /// First byte.
        first: usize,
        /// Byte behind the last.
        end: usize,
    },
}

/// Alive counter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counter {
    /// Number of bits.
    pub width: u32,
    /// Largest accepted step from one frame to the next.
    pub max_jump: u64,
}

impl Counter {
    /// Returns the counter behind another.
    #[must_use]
    pub const fn next(&self, counter: u64) -> u64 {
        counter.wrapping_add(1) & mask(self.width)
    }
}

/// Field of a JSON line.
#[derive(Clone, Debug, PartialEq)]
pub struct JsonField {
    /// Path from the root.
    pub path: Path,
    /// Content.
    pub content: JsonContent,
}

/// Content of a field of a JSON line.
#[derive(Clone, Debug, PartialEq)]
pub enum JsonContent {
    /// Value of a signal; `null` is no value.
    Signal(Signal, Number),
    /// A fixed text.
    Text(String),
    /// A fixed number.
    Number(f64),
    /// Number that grows by one with each frame.
    Counter(Counter),
}

/// Mistake in a frame. Fields are indices.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Mistake {
    /// No field, or a length that is 0 or too large.
    Length,
    /// A field that ends beyond the frame.
    Outside {
        /// The field.
        field: usize,
    },
    /// Two fields that share a bit.
    Overlap {
        /// The later field.
        field: usize,
        /// The earlier field.
        with: usize,
    },
    /// Two fields of the same signal, or two counters.
    Twice {
        /// The later field.
        field: usize,
        /// The earlier field.
        with: usize,
    },
    /// A validity bit of a signal that the frame does not carry.
    NoValue {
        /// The field.
        field: usize,
    },
    /// A number, constant or counter that needs more bits than its field has or another width, or in JSON a constant
    /// that is not finite or needs escapes.
    Width {
        /// The field.
        field: usize,
    },
    /// A checksum whose field does not fill whole bytes of the algorithm's width, or that covers no byte of the frame.
    Checksum {
        /// The field.
        field: usize,
    },
    /// A path that is the same as another's or leads through it, or an array with gaps.
    Path {
        /// The field.
        field: usize,
    },
}

impl Frame {
    /// Lists all mistakes. Packers and receivers are only made of a frame without any.
    #[must_use]
    pub fn mistakes(&self) -> Vec<Mistake> {
        let mut mistakes = Vec::new();
        match &self.body {
            Body::Bytes { length, fields } => {
                if fields.is_empty() || *length == 0 || *length > LONGEST_FRAME {
                    mistakes.push(Mistake::Length);
                }
                for (field, one) in fields.iter().enumerate() {
                    one.mistakes(field, *length, &fields[..field], &mut mistakes);
                    if let Content::Valid(signal) = &one.content
                        && !self.signals().any(|(other, _)| other == signal)
                    {
                        mistakes.push(Mistake::NoValue { field });
                    }
                }
            }
            Body::Json(fields) => {
                if fields.is_empty() {
                    mistakes.push(Mistake::Length);
                }
                for (field, one) in fields.iter().enumerate() {
                    let twice = fields[..field].iter().position(|other| one.is_twice(other));
                    mistakes.extend(twice.map(|with| Mistake::Twice { field, with }));
                    if !one.is_sound() {
                        mistakes.push(Mistake::Width { field });
                    }
                }
                let paths: Vec<&Path> = fields.iter().map(|field| &field.path).collect();
                let wrong = crate::path::misplaced(&paths);
                mistakes.extend(wrong.into_iter().map(|field| Mistake::Path { field }));
            }
        }
        mistakes
    }

    /// Returns the name of a field.
    #[must_use]
    pub fn field_name(&self, field: usize) -> String {
        match &self.body {
            Body::Bytes { fields, .. } => fields.get(field).map(|field| field.name.clone()),
            Body::Json(fields) => fields.get(field).map(|field| field.path.to_string()),
        }
        .unwrap_or_default()
    }

    /// Lists the signals with their numbers, in the order of the fields.
    pub fn signals(&self) -> impl Iterator<Item = (&Signal, &Number)> {
        let (bytes, json): (&[Field], &[JsonField]) = match &self.body {
            Body::Bytes { fields, .. } => (fields, &[]),
            Body::Json(fields) => (&[], fields),
        };
        let of_bytes = bytes.iter().filter_map(|field| match &field.content {
            Content::Signal(signal, number) => Some((signal, number)),
            _ => None,
        });
        let of_json = json.iter().filter_map(|field| match &field.content {
            JsonContent::Signal(signal, number) => Some((signal, number)),
            _ => None,
        });
        of_bytes.chain(of_json)
    }
}

impl Counter {
    const fn is_sound(&self) -> bool {
        self.width >= 1 && self.width <= 32 && self.max_jump >= 1
    }
}

impl Field {
    fn mistakes(&self, field: usize, length: usize, before: &[Self], mistakes: &mut Vec<Mistake>) {
        if self.bits.end_byte() > length {
            mistakes.push(Mistake::Outside { field });
        }
        let overlap = (before.iter()).position(|other| self.bits.overlaps(&other.bits));
        mistakes.extend(overlap.map(|with| Mistake::Overlap { field, with }));
        let twice = before.iter().position(|other| self.is_twice(other));
        mistakes.extend(twice.map(|with| Mistake::Twice { field, with }));
        let width = self.bits.width();
        let fits = match &self.content {
            Content::Signal(_, number) => number.width() == width,
            Content::Valid(_) => true,
            Content::Constant(raw) => *raw <= mask(width),
            Content::Counter(counter) => counter.is_sound() && counter.width <= width,
            Content::Checksum {
                algorithm,
                first,
                end,
            } => {
                let is_whole = self.bits.is_whole_bytes() && algorithm.width() == width;
                let covers = (*first..*end).any(|byte| self.bits.mask_of(byte) == 0);
                if !is_whole || !covers || *end > length {
                    mistakes.push(Mistake::Checksum { field });
                }
                true
            }
        };
        // Sums are computed in the order of the fields.
        let is_later_sum = matches!(self.content, Content::Checksum { .. });
        if is_later_sum && before.iter().any(|other| other.covers(&self.bits)) {
            mistakes.push(Mistake::Checksum { field });
        }
        if !fits {
            mistakes.push(Mistake::Width { field });
        }
    }

    fn covers(&self, bits: &BitField) -> bool {
        let Content::Checksum { first, end, .. } = self.content else {
            return false;
        };
        first < bits.end_byte() && bits.first_byte() < end
    }

    fn is_twice(&self, other: &Self) -> bool {
        match (&self.content, &other.content) {
            (Content::Signal(one, _), Content::Signal(other, _))
            | (Content::Valid(one), Content::Valid(other)) => one.is(other),
            (Content::Counter(_), Content::Counter(_)) => true,
            _ => false,
        }
    }
}

impl JsonField {
    fn is_sound(&self) -> bool {
        match &self.content {
            JsonContent::Signal(_, number) => {
                number.encoding() == Encoding::Float && number.width() == 64
            }
            JsonContent::Text(text) => is_plain(text),
            JsonContent::Number(number) => number.is_finite(),
            JsonContent::Counter(counter) => counter.is_sound(),
        }
    }

    fn is_twice(&self, other: &Self) -> bool {
        match (&self.content, &other.content) {
            (JsonContent::Signal(one, _), JsonContent::Signal(other, _)) => one.is(other),
            (JsonContent::Counter(_), JsonContent::Counter(_)) => true,
            _ => false,
        }
    }
}

/// Returns `true` if a text is the same in JSON as in memory.
#[must_use]
pub fn is_plain(text: &str) -> bool {
    let is_plain = |c: char| !c.is_control() && c != '"' && c != '\\';
    text.chars().all(is_plain)
}
