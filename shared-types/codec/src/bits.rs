//! Bit fields: the place of a number in bytes.
//!
//! Bits are numbered as in a DBC file: bit 0 is the least significant of byte 0, bit 8 that of byte 1. A little-endian
//! field starts at its least significant bit and grows upwards; a big-endian field starts at its most significant bit
//! and grows downwards within a byte, then continues at bit 7 of the next byte.

/// Order of the bytes of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ByteOrder {
    /// Least significant byte first, "Intel" in DBC files.
    Little,
    /// Most significant byte first, "Motorola" in DBC files.
    Big,
}

/// Largest frame in bytes.
pub const LONGEST_FRAME: usize = 4096;

/// Place of a number in the bytes of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitField {
    start: usize,
    width: u32,
    order: ByteOrder,
    /// First byte that has bits of the field.
    first: usize,
    /// Number of bytes that have bits of the field, at most 9.
    count: usize,
    /// Number of bits below the field in the number that these bytes form.
    shift: u32,
}

impl BitField {
    /// Creates a field from its start bit and its width; `None` if the width is not 1 to 64 or the field ends beyond the
    /// [longest frame](LONGEST_FRAME).
    #[must_use]
    pub const fn new(start: usize, width: u32, order: ByteOrder) -> Option<Self> {
        if width == 0 || width > 64 || start >= LONGEST_FRAME * 8 {
            return None;
        }
        let (first, bit) = (start / 8, (start % 8) as u32);
        // Bits of the first byte that do not belong to the field, on the side where it begins.
        let before = match order {
            ByteOrder::Little => bit,
            ByteOrder::Big => 7 - bit,
        };
        let count = (before + width).div_ceil(8) as usize;
        if first + count > LONGEST_FRAME {
            return None;
        }
        let shift = match order {
            ByteOrder::Little => before,
            ByteOrder::Big => count as u32 * 8 - before - width,
        };
        Some(Self {
            start,
            width,
            order,
            first,
            count,
            shift,
        })
    }

    /// Returns the start bit.
    #[must_use]
    pub const fn start(&self) -> usize {
        self.start
    }

    /// Returns the number of bits.
    #[must_use]
    pub const fn width(&self) -> u32 {
        self.width
    }

    /// Returns the order of bytes.
    #[must_use]
    pub const fn order(&self) -> ByteOrder {
        self.order
    }

    /// Returns the first byte of the field.
    #[must_use]
    pub const fn first_byte(&self) -> usize {
        self.first
    }

    /// Returns the byte behind the last byte of the field.
    #[must_use]
    pub const fn end_byte(&self) -> usize {
        self.first + self.count
    }

    /// Returns `true` if the field fills its bytes.
    #[must_use]
    pub const fn is_whole_bytes(&self) -> bool {
        self.width as usize == self.count * 8
    }

    /// Returns the start bit of a field of the same order directly behind this one.
    #[must_use]
    pub const fn next_start(&self) -> usize {
        match self.order {
            ByteOrder::Little => self.start + self.width as usize,
            ByteOrder::Big if self.shift == 0 => self.end_byte() * 8 + 7,
            ByteOrder::Big => (self.end_byte() - 1) * 8 + self.shift as usize - 1,
        }
    }

    /// Returns the bits of the field in one byte of the frame.
    #[must_use]
    pub const fn mask_of(&self, byte: usize) -> u8 {
        if byte < self.first || byte >= self.end_byte() {
            return 0;
        }
        let index = match self.order {
            ByteOrder::Little => byte - self.first,
            ByteOrder::Big => self.end_byte() - 1 - byte,
        };
        let mask = self.mask() << self.shift;
        (mask >> (index * 8)) as u8
    }

    /// Returns the bytes in which the fields share bits, in words; `None` if they share none.
    #[must_use]
    pub fn shared_bytes(&self, other: &Self) -> Option<String> {
        let mut bytes = (self.first..self.end_byte())
            .filter(|byte| self.mask_of(*byte) & other.mask_of(*byte) != 0);
        let first = bytes.next()?;
        Some(match bytes.next_back() {
            Some(last) => format!("bytes {first} to {last}"),
            None => format!("byte {first}"),
        })
    }

    /// Returns `true` if the fields share a bit.
    #[must_use]
    pub fn overlaps(&self, other: &Self) -> bool {
        self.shared_bytes(other).is_some()
    }

    /// Returns a raw number of the field with its bytes in reverse; `None` if it has no whole bytes.
    #[must_use]
    pub const fn reversed(&self, raw: u64) -> Option<u64> {
        match self.is_whole_bytes() {
            true => Some(raw.swap_bytes() >> (64 - self.width)),
            false => None,
        }
    }

    const fn mask(&self) -> u128 {
        (1 << self.width) - 1
    }

    /// Reads the raw number; 0 for bytes that are not there.
    #[must_use]
    #[inline]
    pub fn read(&self, bytes: &[u8]) -> u64 {
        let Some(part) = bytes.get(self.first..self.first + self.count) else {
            return 0;
        };
        let number = if self.count <= 8 {
            let mut all = [0; 8];
            match self.order {
                ByteOrder::Little => {
                    all[..self.count].copy_from_slice(part);
                    u64::from_le_bytes(all) >> self.shift
                }
                ByteOrder::Big => {
                    all[8 - self.count..].copy_from_slice(part);
                    u64::from_be_bytes(all) >> self.shift
                }
            }
        } else {
            (self.wide(part) >> self.shift) as u64
        };
        number & self.mask() as u64
    }

    /// Writes the lowest bits of a raw number and leaves all other bits of the frame; no effect on bytes that are not
    /// there.
    #[inline]
    pub fn write(&self, bytes: &mut [u8], raw: u64) {
        let Some(part) = bytes.get_mut(self.first..self.first + self.count) else {
            return;
        };
        let mask = self.mask() << self.shift;
        let field = (u128::from(raw) & self.mask()) << self.shift;
        let number = (self.wide(part) & !mask) | field;
        match self.order {
            ByteOrder::Little => part.copy_from_slice(&number.to_le_bytes()[..self.count]),
            ByteOrder::Big => part.copy_from_slice(&number.to_be_bytes()[16 - self.count..]),
        }
    }

    #[inline]
    fn wide(&self, part: &[u8]) -> u128 {
        let mut all = [0; 16];
        match self.order {
            ByteOrder::Little => {
                all[..self.count].copy_from_slice(part);
                u128::from_le_bytes(all)
            }
            ByteOrder::Big => {
                all[16 - self.count..].copy_from_slice(part);
                u128::from_be_bytes(all)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn field(start: usize, width: u32, order: ByteOrder) -> BitField {
        BitField::new(start, width, order).expect("a field")
    }

    #[test]
    fn whole_numbers_have_the_byte_order_of_the_standard_library() {
        let mut bytes = [0; 12];
        field(16, 32, ByteOrder::Little).write(&mut bytes, 0x1234_5678);
        assert_eq!(bytes[2..6], 0x1234_5678_u32.to_le_bytes());
        field(55, 32, ByteOrder::Big).write(&mut bytes, 0x1234_5678);
        assert_eq!(bytes[6..10], 0x1234_5678_u32.to_be_bytes());
    }

    /// The example of the numbering in "DBC File Format Documentation" (Vector, version 01/2007): a Motorola signal of 12
    /// bits that starts at bit 7 fills byte 0 and the upper half of byte 1.
    #[test]
    fn a_big_endian_field_continues_at_bit_7_of_the_next_byte() {
        let one = field(7, 12, ByteOrder::Big);
        let mut bytes = [0; 2];
        one.write(&mut bytes, 0xABC);
        assert_eq!(bytes, [0xAB, 0xC0]);
        assert_eq!((one.mask_of(0), one.mask_of(1)), (0xFF, 0xF0));
        assert_eq!(one.next_start(), 11);
        let other = field(11, 4, ByteOrder::Big);
        assert!(!one.overlaps(&other));
        assert!(one.overlaps(&field(12, 1, ByteOrder::Little)));
        let shared = |other: BitField| one.shared_bytes(&other);
        assert_eq!(shared(other), None);
        assert_eq!(
            shared(field(12, 1, ByteOrder::Little)).as_deref(),
            Some("byte 1")
        );
        assert_eq!(
            shared(field(0, 16, ByteOrder::Little)).as_deref(),
            Some("bytes 0 to 1")
        );
        assert_eq!(one.reversed(0xABC), None);
        assert_eq!(
            field(7, 24, ByteOrder::Big).reversed(0x0012_3456),
            Some(0x0056_3412)
        );
        assert_eq!(other.next_start(), 23);
    }

    #[test]
    fn impossible_fields_are_refused() {
        assert_eq!(BitField::new(0, 0, ByteOrder::Little), None);
        assert_eq!(BitField::new(0, 65, ByteOrder::Little), None);
        assert_eq!(
            BitField::new(LONGEST_FRAME * 8 - 1, 2, ByteOrder::Little),
            None
        );
        assert_eq!(BitField::new(usize::MAX, 8, ByteOrder::Big), None);
    }

    fn any() -> impl Strategy<Value = BitField> {
        let order = prop_oneof![Just(ByteOrder::Little), Just(ByteOrder::Big)];
        (0_usize..128, 1_u32..=64, order).prop_filter_map("a field", |(start, width, order)| {
            BitField::new(start, width, order)
        })
    }

    proptest! {
        #[test]
        fn a_number_is_read_as_it_was_written_and_no_other_bit_changes(
            one in any(), raw: u64, background: [u8; 32],
        ) {
            let mut bytes = background;
            one.write(&mut bytes, raw);
            prop_assert_eq!(one.read(&bytes), raw & one.mask() as u64);
            for (byte, before) in background.iter().enumerate() {
                let mask = one.mask_of(byte);
                prop_assert_eq!(bytes[byte] & !mask, before & !mask);
            }
            let bits: u32 = (0..32).map(|byte| one.mask_of(byte).count_ones()).sum();
            prop_assert_eq!(bits, one.width());
        }

        #[test]
        fn the_next_field_begins_where_the_last_one_ends(one in any()) {
            let next = BitField::new(one.next_start(), 3, one.order()).expect("a field");
            prop_assert!(!one.overlaps(&next));
        }
    }
}
