//! Checksums of frames, by name.
//!
//! Names, parameters and check values of the CRCs are those of Greg Cook's "Catalogue of parametrised CRC algorithms"
//! (reveng.sourceforge.io/crc-catalogue), which the crate `crc` carries. A sum adds bytes and keeps the lowest bits; xor
//! combines bytes.

use crc::Crc;

macro_rules! catalogue {
    ($($name:literal $constant:ident $kernel:ident $width:ty,)+) => {
        $(static $constant: Crc<$width> = Crc::<$width>::new(&crc::$constant);)+

        /// Algorithms with their names.
        const ALL: &[(&str, Algorithm)] = &[
            ("sum-8", Algorithm(Kernel::Sum(8))),
            ("sum-16", Algorithm(Kernel::Sum(16))),
            ("sum-32", Algorithm(Kernel::Sum(32))),
            ("xor-8", Algorithm(Kernel::Xor)),
            $(($name, Algorithm(Kernel::$kernel(&$constant))),)+
        ];

        /// Names of all algorithms.
        pub const NAMES: &[&str] = &["sum-8", "sum-16", "sum-32", "xor-8", $($name,)+];
    };
}

/// Algorithm of a checksum.
#[derive(Clone, Copy)]
pub struct Algorithm(Kernel);

#[derive(Clone, Copy)]
enum Kernel {
    Sum(u32),
    Xor,
    Crc8(&'static Crc<u8>),
    Crc16(&'static Crc<u16>),
    Crc32(&'static Crc<u32>),
}

catalogue! {
    "crc-8/autosar" CRC_8_AUTOSAR Crc8 u8,
    "crc-8/dvb-s2" CRC_8_DVB_S2 Crc8 u8,
    "crc-8/maxim-dow" CRC_8_MAXIM_DOW Crc8 u8,
    "crc-8/sae-j1850" CRC_8_SAE_J1850 Crc8 u8,
    "crc-8/smbus" CRC_8_SMBUS Crc8 u8,
    "crc-16/arc" CRC_16_ARC Crc16 u16,
    "crc-16/genibus" CRC_16_GENIBUS Crc16 u16,
    "crc-16/ibm-3740" CRC_16_IBM_3740 Crc16 u16,
    "crc-16/ibm-sdlc" CRC_16_IBM_SDLC Crc16 u16,
    "crc-16/kermit" CRC_16_KERMIT Crc16 u16,
    "crc-16/mcrf4xx" CRC_16_MCRF4XX Crc16 u16,
    "crc-16/modbus" CRC_16_MODBUS Crc16 u16,
    "crc-16/xmodem" CRC_16_XMODEM Crc16 u16,
    "crc-32/autosar" CRC_32_AUTOSAR Crc32 u32,
    "crc-32/bzip2" CRC_32_BZIP2 Crc32 u32,
    "crc-32/iscsi" CRC_32_ISCSI Crc32 u32,
    "crc-32/iso-hdlc" CRC_32_ISO_HDLC Crc32 u32,
    "crc-32/mpeg-2" CRC_32_MPEG_2 Crc32 u32,
}

impl Algorithm {
    /// Finds an algorithm by its name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let (_, algorithm) = ALL.iter().find(|(known, _)| *known == name)?;
        Some(*algorithm)
    }

    /// Returns the name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        let same = |(_, other): &&(&str, Self)| other == self;
        ALL.iter().find(same).map_or("", |(name, _)| name)
    }

    /// Returns the number of bits of the sum.
    #[must_use]
    pub const fn width(&self) -> u32 {
        match self.0 {
            Kernel::Sum(width) => width,
            Kernel::Xor | Kernel::Crc8(_) => 8,
            Kernel::Crc16(_) => 16,
            Kernel::Crc32(_) => 32,
        }
    }

    /// Computes the sum of two parts, as if they were one.
    #[must_use]
    #[inline]
    pub fn compute(&self, first: &[u8], second: &[u8]) -> u64 {
        macro_rules! crc {
            ($crc:expr) => {{
                let mut digest = $crc.digest();
                digest.update(first);
                digest.update(second);
                u64::from(digest.finalize())
            }};
        }
        let bytes = || first.iter().chain(second);
        match self.0 {
            Kernel::Sum(width) => {
                bytes().map(|byte| u64::from(*byte)).sum::<u64>() & ((1 << width) - 1)
            }
            Kernel::Xor => u64::from(bytes().fold(0, |sum, byte| sum ^ byte)),
            Kernel::Crc8(crc) => crc!(crc),
            Kernel::Crc16(crc) => crc!(crc),
            Kernel::Crc32(crc) => crc!(crc),
        }
    }
}

/// Algorithms are compared by their parameters: each of the catalogue differs from all others.
impl PartialEq for Algorithm {
    fn eq(&self, other: &Self) -> bool {
        match (self.0, other.0) {
            (Kernel::Sum(one), Kernel::Sum(other)) => one == other,
            (Kernel::Xor, Kernel::Xor) => true,
            (Kernel::Crc8(one), Kernel::Crc8(other)) => std::ptr::eq(one, other),
            (Kernel::Crc16(one), Kernel::Crc16(other)) => std::ptr::eq(one, other),
            (Kernel::Crc32(one), Kernel::Crc32(other)) => std::ptr::eq(one, other),
            _ => false,
        }
    }
}

impl std::fmt::Debug for Algorithm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Check values of the catalogue: the CRC of the text "123456789".
    const PUBLISHED: [(&str, u64); 18] = [
        ("crc-8/autosar", 0xDF),
        ("crc-8/dvb-s2", 0xBC),
        ("crc-8/maxim-dow", 0xA1),
        ("crc-8/sae-j1850", 0x4B),
        ("crc-8/smbus", 0xF4),
        ("crc-16/arc", 0xBB3D),
        ("crc-16/genibus", 0xD64E),
        ("crc-16/ibm-3740", 0x29B1),
        ("crc-16/ibm-sdlc", 0x906E),
        ("crc-16/kermit", 0x2189),
        ("crc-16/mcrf4xx", 0x6F91),
        ("crc-16/modbus", 0x4B37),
        ("crc-16/xmodem", 0x31C3),
        ("crc-32/autosar", 0x1697_D06A),
        ("crc-32/bzip2", 0xFC89_1918),
        ("crc-32/iscsi", 0xE306_9283),
        ("crc-32/iso-hdlc", 0xCBF4_3926),
        ("crc-32/mpeg-2", 0x0376_E6E7),
    ];

    #[test]
    fn every_crc_has_the_check_value_of_the_catalogue() {
        for (name, expected) in PUBLISHED {
            let algorithm = Algorithm::named(name).expect("a name");
            assert_eq!(algorithm.compute(b"123456789", b""), expected, "{name}");
            assert_eq!(algorithm.compute(b"1234", b"56789"), expected, "{name}");
            assert_eq!(algorithm.name(), name);
        }
        let names: Vec<&str> = ALL.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, NAMES);
        let crcs = names.iter().filter(|name| name.starts_with("crc"));
        assert_eq!(crcs.count(), PUBLISHED.len());
    }

    #[test]
    fn sums_keep_their_lowest_bits() {
        let sum =
            |name: &str, bytes: &[u8]| Algorithm::named(name).expect("a name").compute(bytes, b"");
        // 9 * 0x30 + 45 = 477 = 0x1DD.
        assert_eq!(sum("sum-8", b"123456789"), 0xDD);
        assert_eq!(sum("sum-16", b"123456789"), 0x1DD);
        assert_eq!(sum("sum-32", b"123456789"), 0x1DD);
        // 1 ^ 2 ^ .. ^ 9 = 1, and nine times 0x30 is 0x30.
        assert_eq!(sum("xor-8", b"123456789"), 0x31);
    }
}
