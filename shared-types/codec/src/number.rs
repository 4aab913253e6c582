//! Numbers on a wire: raw bits to the value of a signal and back.
//!
//! `wire = factor * raw + offset` in the unit of the wire, then `signal = conversion(wire)` in the unit of the signal.
//! Packing inverts both and rounds to the nearest raw number, ties to even as in IEEE 754. Beyond its range a value is
//! packed as the limit; nothing wraps.

use shared_types::units::Conversion;

/// Form of a number in its bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Whole number of at least 0.
    Unsigned,
    /// Whole number in two's complement.
    Signed,
    /// IEEE 754, 32 or 64 bits.
    Float,
}

/// Scale and range of a number, as a file describes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// `wire = factor * raw + offset`.
    pub wire: Conversion,
    /// Range in the unit of the wire; everything that the bits can express if `None`.
    pub range: Option<(f64, f64)>,
    /// Raw number that stands for no value.
    pub invalid: Option<u64>,
    /// Conversion from the unit of the wire to that of the signal.
    pub to_signal: Conversion,
    /// Conversion from the unit of the signal to that of the wire.
    pub to_wire: Conversion,
}

impl Default for Scale {
    fn default() -> Self {
        Self {
            wire: Conversion::IDENTITY,
            range: None,
            invalid: None,
            to_signal: Conversion::IDENTITY,
            to_wire: Conversion::IDENTITY,
        }
    }
}

/// Reason why a scale does not fit its bits.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unfit {
    /// The factor is 0 or not finite, or the offset is not finite.
    #[error("a factor other than 0 and a finite offset are needed")]
    Factor,
    /// A float of another width.
    #[error("a float has 32 or 64 bits, not {0}")]
    FloatWidth(u32),
    /// The range reaches beyond the numbers that the bits can express.
    #[error("the range exceeds what the bits can express")]
    Range {
        /// Least and greatest value that the bits can express, in the unit of the wire.
        possible: (f64, f64),
    },
    /// The range contains no raw number.
    #[error("the range contains no number that the bits can express")]
    Empty,
    /// The raw number for no value is one of a value.
    #[error("the raw number that stands for no value lies inside the range")]
    InvalidInside,
    /// The raw number for no value does not fit the bits, or the number is a float.
    #[error("the raw number that stands for no value must be a whole number that fits the bits")]
    InvalidForm,
}

/// Limits of the raw number.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Limits {
    Unsigned(u64, u64),
    Signed(i64, i64),
    Float32(f32, f32),
    Float64(f64, f64),
}

/// Raw number of a value, or the reason that there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decoded {
    /// The value.
    Value(f64),
    /// The raw number that stands for no value.
    Invalid,
    /// NaN or infinity.
    NotFinite,
    /// A number beyond the range.
    OutOfRange(f64),
}

/// Number on a wire.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number {
    width: u32,
    limits: Limits,
    scale: Scale,
}

/// 2 to the power of 64.
const TWO_64: f64 = 18_446_744_073_709_551_616.0;
/// 2 to the power of 63.
const TWO_63: f64 = 9_223_372_036_854_775_808.0;

impl Number {
    /// Creates a number of 1 to 64 bits; other widths count as the nearest of these.
    ///
    /// # Errors
    /// If the scale does not fit.
    pub fn new(encoding: Encoding, width: u32, mut scale: Scale) -> Result<Self, Unfit> {
        let width = width.clamp(1, 64);
        let Conversion { factor, offset } = scale.wire;
        if factor == 0.0 || !factor.is_finite() || !offset.is_finite() {
            return Err(Unfit::Factor);
        }
        let mask = mask(width);
        let mut limits = match encoding {
            Encoding::Unsigned => Limits::Unsigned(0, mask),
            Encoding::Signed => Limits::Signed(-1 - (mask >> 1) as i64, (mask >> 1) as i64),
            Encoding::Float if width == 32 => Limits::Float32(f32::MIN, f32::MAX),
            Encoding::Float if width == 64 => Limits::Float64(f64::MIN, f64::MAX),
            Encoding::Float => return Err(Unfit::FloatWidth(width)),
        };
        // Its own end of the type is the usual place of the raw number for no value.
        if let Some(invalid) = scale.invalid {
            limits = without(limits, invalid, width).ok_or(Unfit::InvalidForm)?;
        }
        let mut number = Self {
            width,
            limits,
            scale,
        };
        if let Some((low, high)) = scale.range {
            let possible = number.wire_range();
            let raw = |wire: f64| (wire - offset) / factor;
            let (low, high) = match factor > 0.0 {
                true => (raw(low), raw(high)),
                false => (raw(high), raw(low)),
            };
            number.limits = (limits.narrowed(low, high)).ok_or(Unfit::Range { possible })?;
            if number.limits.is_empty() {
                return Err(Unfit::Empty);
            }
        }
        if let Some(invalid) = scale.invalid
            && number.limits.contains(invalid, width)
        {
            return Err(Unfit::InvalidInside);
        }
        scale.range = Some(number.wire_range());
        number.scale = scale;
        Ok(number)
    }

    /// Returns the number of bits.
    #[must_use]
    pub const fn width(&self) -> u32 {
        self.width
    }

    /// Returns the form of the number.
    #[must_use]
    pub const fn encoding(&self) -> Encoding {
        match self.limits {
            Limits::Unsigned(..) => Encoding::Unsigned,
            Limits::Signed(..) => Encoding::Signed,
            Limits::Float32(..) | Limits::Float64(..) => Encoding::Float,
        }
    }

    /// Returns the scale, whose range is the one in effect.
    #[must_use]
    pub const fn scale(&self) -> &Scale {
        &self.scale
    }

    /// Returns the range in the unit of the signal.
    #[must_use]
    pub fn range(&self) -> (f64, f64) {
        let (low, high) = self.wire_range();
        ordered(
            self.scale.to_signal.apply(low),
            self.scale.to_signal.apply(high),
        )
    }

    /// Returns the difference between two neighbouring values in the unit of the signal; `None` for a float, whose
    /// resolution is relative.
    #[must_use]
    pub fn resolution(&self) -> Option<f64> {
        let whole = self.encoding() != Encoding::Float;
        let step = self.scale.wire.factor * self.scale.to_signal.factor;
        whole.then_some(step.abs())
    }

    /// Encodes the value of a signal, which is not NaN; `true` if the value is beyond the range.
    #[must_use]
    #[inline]
    pub fn encode(&self, value: f64) -> (u64, bool) {
        let wire = self.scale.to_wire.apply(value);
        let Conversion { factor, offset } = self.scale.wire;
        let exact = match self.scale.wire.is_identity() {
            true => wire,
            false => (wire - offset) / factor,
        };
        match self.limits {
            Limits::Unsigned(low, high) => {
                let whole = exact.round_ties_even();
                let raw = whole as u64; // saturates
                let raw_in = raw.clamp(low, high);
                (raw_in, raw_in != raw || !(0.0..TWO_64).contains(&whole))
            }
            Limits::Signed(low, high) => {
                let whole = exact.round_ties_even();
                let raw = whole as i64; // saturates
                let raw_in = raw.clamp(low, high);
                let is_beyond = raw_in != raw || !(-TWO_63..TWO_63).contains(&whole);
                (raw_in as u64 & mask(self.width), is_beyond)
            }
            Limits::Float32(low, high) => {
                let raw = exact as f32;
                let raw_in = if raw < low {
                    low
                } else if raw > high {
                    high
                } else {
                    raw
                };
                (u64::from(raw_in.to_bits()), raw_in != raw)
            }
            Limits::Float64(low, high) => {
                let raw_in = if exact < low {
                    low
                } else if exact > high {
                    high
                } else {
                    exact
                };
                (raw_in.to_bits(), raw_in != exact)
            }
        }
    }

    /// Decodes a raw number, of which only the lowest bits count.
    #[must_use]
    #[inline]
    pub fn decode(&self, raw: u64) -> Decoded {
        if self.scale.invalid == Some(raw) {
            return Decoded::Invalid;
        }
        let (number, is_inside) = match self.limits {
            Limits::Unsigned(low, high) => (raw as f64, (low..=high).contains(&raw)),
            Limits::Signed(low, high) => {
                let raw = extended(raw, self.width);
                (raw as f64, (low..=high).contains(&raw))
            }
            Limits::Float32(low, high) => {
                let raw = f32::from_bits(raw as u32);
                (f64::from(raw), (low..=high).contains(&raw))
            }
            Limits::Float64(low, high) => {
                let raw = f64::from_bits(raw);
                (raw, (low..=high).contains(&raw))
            }
        };
        let value = (self.scale.to_signal).apply(self.scale.wire.apply(number));
        if !value.is_finite() {
            return Decoded::NotFinite;
        }
        match is_inside {
            true => Decoded::Value(value),
            false => Decoded::OutOfRange(value),
        }
    }

    fn wire_range(&self) -> (f64, f64) {
        let (low, high) = match self.limits {
            Limits::Unsigned(low, high) => (low as f64, high as f64),
            Limits::Signed(low, high) => (low as f64, high as f64),
            Limits::Float32(low, high) => (f64::from(low), f64::from(high)),
            Limits::Float64(low, high) => (low, high),
        };
        let wire = |raw| self.scale.wire.apply(raw);
        ordered(wire(low), wire(high))
    }
}

impl Limits {
    /// Returns the limits between two raw numbers; `None` if they reach beyond these limits by half a number or more.
    fn narrowed(self, low: f64, high: f64) -> Option<Self> {
        if low.is_nan() || high.is_nan() {
            return None;
        }
        let (first, last) = (low.round_ties_even(), high.round_ties_even());
        Some(match self {
            Self::Unsigned(least, most) => {
                if first < least as f64 || last > most as f64 {
                    return None;
                }
                Self::Unsigned(first as u64, (last as u64).min(most))
            }
            Self::Signed(least, most) => {
                if first < least as f64 || last > most as f64 {
                    return None;
                }
                Self::Signed(first as i64, (last as i64).min(most))
            }
            Self::Float32(least, most) => {
                let (low, high) = (low as f32, high as f32);
                if low < least || high > most {
                    return None;
                }
                Self::Float32(low, high)
            }
            Self::Float64(least, most) => {
                if low < least || high > most {
                    return None;
                }
                Self::Float64(low, high)
            }
        })
    }

    fn is_empty(self) -> bool {
        match self {
            Self::Unsigned(low, high) => low > high,
            Self::Signed(low, high) => low > high,
            Self::Float32(low, high) => low > high,
            Self::Float64(low, high) => low > high,
        }
    }

    fn contains(self, raw: u64, width: u32) -> bool {
        match self {
            Self::Unsigned(low, high) => (low..=high).contains(&raw),
            Self::Signed(low, high) => (low..=high).contains(&extended(raw, width)),
            Self::Float32(..) | Self::Float64(..) => false,
        }
    }
}

/// Returns the limits without a raw number at one of their ends; `None` for a float or if the number does not fit.
fn without(limits: Limits, raw: u64, width: u32) -> Option<Limits> {
    if raw > mask(width) || width == 1 {
        return None;
    }
    Some(match limits {
        Limits::Unsigned(low, high) if raw == low => Limits::Unsigned(low + 1, high),
        Limits::Unsigned(low, high) if raw == high => Limits::Unsigned(low, high - 1),
        Limits::Signed(low, high) if extended(raw, width) == low => Limits::Signed(low + 1, high),
        Limits::Signed(low, high) if extended(raw, width) == high => Limits::Signed(low, high - 1),
        Limits::Unsigned(..) | Limits::Signed(..) => limits,
        Limits::Float32(..) | Limits::Float64(..) => return None,
    })
}

/// Returns the greatest unsigned number of this width.
#[must_use]
pub const fn mask(width: u32) -> u64 {
    u64::MAX >> (64 - width)
}

/// Extends the sign of a number of this width.
const fn extended(raw: u64, width: u32) -> i64 {
    ((raw << (64 - width)) as i64) >> (64 - width)
}

fn ordered(one: f64, other: f64) -> (f64, f64) {
    if one <= other {
        (one, other)
    } else {
        (other, one)
    }
}

#[cfg(test)]
mod tests;
