//! Classic CDR: numbers at multiples of their own size, counted from the end of the header.

/// Kind of number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    Unsigned(usize),
    Signed(usize),
    Float(usize),
}

impl Number {
    /// Returns the kind of a name in `ros2msg`.
    pub(super) fn of(name: &str) -> Option<Self> {
        Some(match name {
            "bool" | "byte" | "uint8" => Self::Unsigned(1),
            "char" | "int8" => Self::Signed(1),
            "uint16" => Self::Unsigned(2),
            "int16" => Self::Signed(2),
            "uint32" => Self::Unsigned(4),
            "int32" => Self::Signed(4),
            "uint64" => Self::Unsigned(8),
            "int64" => Self::Signed(8),
            "float32" => Self::Float(4),
            "float64" => Self::Float(8),
            _ => return None,
        })
    }

    /// Returns the size in bytes.
    pub(super) const fn size(self) -> usize {
        match self {
            Self::Unsigned(size) | Self::Signed(size) | Self::Float(size) => size,
        }
    }
}

/// Place in a message.
pub(super) struct Cursor<'a> {
    /// Message without its header.
    body: &'a [u8],
    at: usize,
    is_little: bool,
}

impl<'a> Cursor<'a> {
    /// Begins after the header; `None` if it is not that of classic CDR.
    pub(super) fn of(data: &'a [u8]) -> Option<Self> {
        let (header, body) = data.split_at_checked(4)?;
        let is_little = match header[..2] {
            [0, 0] => false,
            [0, 1] => true,
            _ => return None,
        };
        Some(Self {
            body,
            at: 0,
            is_little,
        })
    }

    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let bytes = self.body.get(self.at..self.at.checked_add(count)?)?;
        self.at += count;
        Some(bytes)
    }

    fn word(&mut self, size: usize) -> Option<u64> {
        self.at = self.at.next_multiple_of(size);
        let is_little = self.is_little;
        let bytes = self.bytes(size)?.iter();
        let join = |word: u64, byte: &u8| word << 8 | u64::from(*byte);
        Some(match is_little {
            true => bytes.rev().fold(0, join),
            false => bytes.fold(0, join),
        })
    }

    /// Reads a number.
    pub(super) fn number(&mut self, kind: Number) -> Option<f64> {
        let word = self.word(kind.size())?;
        Some(match kind {
            Number::Unsigned(_) => word as f64,
            Number::Signed(size) => {
                let unused = 64 - 8 * size as u32;
                ((word << unused).cast_signed() >> unused) as f64
            }
            Number::Float(4) => f64::from(f32::from_bits(word as u32)),
            Number::Float(_) => f64::from_bits(word),
        })
    }

    /// Skips a number of equal numbers.
    pub(super) fn skip(&mut self, kind: Number, count: usize) -> Option<()> {
        if count > 0 {
            self.at = self.at.next_multiple_of(kind.size());
            self.bytes(count.checked_mul(kind.size())?)?;
        }
        Some(())
    }

    /// Reads the length of a sequence or a text.
    pub(super) fn length(&mut self) -> Option<usize> {
        let length = self.word(4)? as usize;
        // Each element takes at least a byte.
        (length <= self.body.len()).then_some(length)
    }

    /// Skips a text, whose characters have a size.
    pub(super) fn skip_text(&mut self, size: usize) -> Option<()> {
        let length = self.length()?;
        self.bytes(length.checked_mul(size)?)?;
        Some(())
    }
}
