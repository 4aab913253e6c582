//! Floating-point modes that foreign code changes: rounding, flush-to-zero and the precision of the x87 unit.
//!
//! The modes belong to a thread and outlive the call that set them, so a callback that leaves "round up" set would
//! change the bits of all later computations of the thread. [`settle`] checks them after each call, logs the first
//! call that changed each mode, and restores the default. Exception masks and flags do not affect results and are
//! left alone.

use std::cell::Cell;
use std::fmt::Write as _;

use hil_session::program;

/// Floating-point modes of a thread: the bits of its control words that affect results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Modes(u64);

/// Non-default mode: its mask, its bits under the mask, and its name.
type NamedMode = (u64, u64, &'static str);

#[cfg(target_arch = "x86_64")]
mod words {
    use std::arch::asm;

    use super::{Modes, NamedMode};

    /// Rounding, flush-to-zero and denormals-are-zero of MXCSR (Intel SDM volume 1, 10.2.3).
    const MXCSR: u32 = 0xe040;
    /// Precision and rounding of the x87 control word (same, 8.1.5).
    const X87: u16 = 0x0f00;
    /// Position of the x87 word above the 32 bits of MXCSR.
    const ABOVE: u32 = 32;
    const EXTENDED: u64 = 0x0300 << ABOVE;

    pub(super) const DEFAULT: Modes = Modes(EXTENDED);
    pub(super) const NAMED: [NamedMode; 10] = [
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
        // SAFETY: both instructions store a control word of the right size at the given address.
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
        // SAFETY: both instructions load a control word from the given address. Each is the current word with other
        // modes, so no reserved bit is set. The compiler assumes the default modes, which this restores.
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

    use super::{Modes, NamedMode};

    /// Rounding, flush-to-zero of all sizes, and default NaN of FPCR (Arm ARM, C5.2.8).
    const FPCR: u64 = 0x03c8_0000;

    pub(super) const DEFAULT: Modes = Modes(0);
    pub(super) const NAMED: [NamedMode; 6] = [
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
        // SAFETY: reads a register that is accessible to every thread.
        unsafe { asm!("mrs {}, fpcr", out(reg) word, options(nomem, nostack, preserves_flags)) };
        word
    }

    #[inline]
    pub(super) fn read() -> Modes {
        Modes(word() & FPCR)
    }

    pub(super) fn write(modes: Modes) {
        let word = word() & !FPCR | modes.0;
        // SAFETY: writes the current word with other modes. The compiler assumes the default modes, which this
        // restores.
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
    /// Modes that were already reported on this thread.
    static NAMED: Cell<u64> = const { Cell::new(0) };
}

/// Restores the default modes after a call into foreign code; logs the first call that changes each mode.
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
        "warning: `{call}` left the floating-point unit at {names}, which would change later results; the \
         default is restored"
    ));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mode_is_reported_and_restored() {
        let others = words::NAMED.map(|(mask, bits, name)| {
            let modes = Modes(words::DEFAULT.0 & !mask | bits);
            (modes, name)
        });
        for (modes, name) in others {
            words::write(modes);
            let current = words::read();
            settle("advance");
            let after = words::read();
            // 16-bit flush-to-zero is optional on aarch64.
            if current == modes {
                assert_eq!(modes.names(), name);
            }
            assert_eq!(after, words::DEFAULT, "{name}");
        }
        assert_eq!(words::DEFAULT.names(), "");
    }
}
