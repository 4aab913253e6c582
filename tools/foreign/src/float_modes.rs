//! Modes of the floating-point unit that foreign code leaves behind: rounding, flush-to-zero and the precision of the
//! x87 unit.
//!
//! The modes belong to a thread and outlive the call that set them, so a callback that leaves "round up" behind would
//! change the bits of everything that the thread computes after it. [`settle`] looks after each call, names the first
//! call of each mode in the log and puts the default back. Exception masks and flags change no number and stay.

use std::cell::Cell;
use std::fmt::Write as _;

use hil_session::program;

/// Modes of a thread: the bits of its control words that change numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Modes(u64);

/// A mode other than the default: its mask, the bits that it has there, and its name.
type Named = (u64, u64, &'static str);

#[cfg(target_arch = "x86_64")]
mod words {
    use std::arch::asm;

    use super::{Modes, Named};

    /// Rounding, flush-to-zero and denormals-are-zero of MXCSR (Intel SDM volume 1, 10.2.3).
    const MXCSR: u32 = 0xe040;
    /// Precision and rounding of the x87 control word (same, 8.1.5).
    const X87: u16 = 0x0f00;
    /// The x87 word stands above the 32 bits of MXCSR.
    const ABOVE: u32 = 32;
    const EXTENDED: u64 = 0x0300 << ABOVE;

    pub(super) const DEFAULT: Modes = Modes(EXTENDED);
    pub(super) const NAMED: [Named; 10] = [
        (0x6000, 0x2000, "rounding down"),
        (0x6000, 0x4000, "rounding up"),
        (0x6000, 0x6000, "rounding toward zero"),
        (0x8000, 0x8000, "flush-to-zero"),
        (0x0040, 0x0040, "denormals-are-zero"),
        (0x0c00 << ABOVE, 0x0400 << ABOVE, "x87 rounding down"),
        (0x0c00 << ABOVE, 0x0800 << ABOVE, "x87 rounding up"),
        (0x0c00 << ABOVE, 0x0c00 << ABOVE, "x87 rounding toward zero"),
        (0x0300 << ABOVE, 0x0000, "x87 single precision"),
        (0x0300 << ABOVE, 0x0200 << ABOVE, "x87 double precision"),
    ];

    #[inline]
    fn words() -> (u32, u16) {
        let (mut mxcsr, mut x87) = (0_u32, 0_u16);
        // SAFETY: both instructions store a control word at the place that they are given, of its size.
        unsafe {
            asm!(
                "stmxcsr [{mxcsr}]",
                "fnstcw [{x87}]",
                mxcsr = in(reg) &raw mut mxcsr,
                x87 = in(reg) &raw mut x87,
                options(nostack, preserves_flags),
            );
        }
        (mxcsr, x87)
    }

    #[inline]
    pub(super) fn read() -> Modes {
        let (mxcsr, x87) = words();
        Modes(u64::from(mxcsr & MXCSR) | u64::from(x87 & X87) << ABOVE)
    }

    pub(super) fn write(modes: Modes) {
        let (mxcsr, x87) = words();
        let bytes = modes.0.to_le_bytes();
        let [a, b, c, d, e, f, ..] = bytes;
        let mxcsr = mxcsr & !MXCSR | u32::from_le_bytes([a, b, c, d]);
        let x87 = x87 & !X87 | u16::from_le_bytes([e, f]);
        // SAFETY: both instructions load a control word from the place that they are given. Each is the word as it was,
        // with other modes: no reserved bit is set. The compiler assumes the default modes, which this puts back.
        unsafe {
            asm!(
                "ldmxcsr [{mxcsr}]",
                "fldcw [{x87}]",
                mxcsr = in(reg) &raw const mxcsr,
                x87 = in(reg) &raw const x87,
                options(nostack, preserves_flags),
            );
        }
    }
}

#[cfg(target_arch = "aarch64")]
mod words {
    use std::arch::asm;

    use super::{Modes, Named};

    /// Rounding, flush-to-zero of all sizes and default NaN of FPCR (Arm ARM, C5.2.8).
    const FPCR: u64 = 0x03c8_0000;

    pub(super) const DEFAULT: Modes = Modes(0);
    pub(super) const NAMED: [Named; 6] = [
        (0x00c0_0000, 0x0040_0000, "rounding up"),
        (0x00c0_0000, 0x0080_0000, "rounding down"),
        (0x00c0_0000, 0x00c0_0000, "rounding toward zero"),
        (0x0100_0000, 0x0100_0000, "flush-to-zero"),
        (0x0008_0000, 0x0008_0000, "flush-to-zero of 16 bits"),
        (0x0200_0000, 0x0200_0000, "default NaN"),
    ];

    #[inline]
    fn word() -> u64 {
        let word: u64;
        // SAFETY: reads a register that every thread may read.
        unsafe { asm!("mrs {}, fpcr", out(reg) word, options(nomem, nostack, preserves_flags)) };
        word
    }

    #[inline]
    pub(super) fn read() -> Modes {
        Modes(word() & FPCR)
    }

    pub(super) fn write(modes: Modes) {
        let word = word() & !FPCR | modes.0;
        // SAFETY: writes the register as it was, with other modes. The compiler assumes the default modes, which this
        // puts back.
        unsafe { asm!("msr fpcr, {}", in(reg) word, options(nostack, preserves_flags)) };
    }
}

impl Modes {
    /// Lists the modes that differ from the default.
    fn names(self) -> String {
        let mut text = String::new();
        for (mask, bits, name) in words::NAMED {
            if self.0 & mask == bits {
                // Writing to a string cannot fail.
                let _ = write!(text, "{}{name}", if text.is_empty() { "" } else { ", " });
            }
        }
        text
    }
}

thread_local! {
    /// Modes that were named on this thread.
    static NAMED: Cell<u64> = const { Cell::new(0) };
}

/// Puts the default modes back after a call into foreign code, named in the log at the first call that leaves others.
#[inline]
pub(crate) fn settle(call: &str) {
    let modes = words::read();
    if modes != words::DEFAULT {
        restore(call, modes);
    }
}

#[cold]
fn restore(call: &str, modes: Modes) {
    words::write(words::DEFAULT);
    let changed = modes.0 ^ words::DEFAULT.0;
    let known = NAMED.get();
    if changed & !known == 0 {
        return;
    }
    NAMED.set(known | changed);
    let names = modes.names();
    program::say(&format!(
        "warning: `{call}` left the floating-point unit at {names}, which would change what is computed after it; the \
         default is restored"
    ));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mode_is_named_and_put_back() {
        let others = words::NAMED.map(|(mask, bits, name)| {
            let modes = Modes(words::DEFAULT.0 & !mask | bits);
            (modes, name)
        });
        for (modes, name) in others {
            words::write(modes);
            let found = words::read();
            settle("advance");
            let after = words::read();
            // 16-bit flush-to-zero is optional on aarch64.
            if found == modes {
                assert_eq!(modes.names(), name);
            }
            assert_eq!(after, words::DEFAULT, "{name}");
        }
        assert_eq!(words::DEFAULT.names(), "");
    }
}
