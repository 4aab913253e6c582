//! What a fault of timing tells a controller's runner in the header of a sample.
//!
//! Written by the plant's engine, obeyed by the runner; a law never sees it. The word is 0 as long
//! as there is nothing to obey.

/// What the runner is to do with one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Directive {
    /// Busy for so long before it answers, in ns; at most 4.29 s.
    pub busy_ns: u32,
    /// The command of this sample takes effect so many steps later. Until then the last command is
    /// sent again, and no sample is looked at.
    pub late_steps: u32,
}

impl Directive {
    /// The word in the header.
    #[must_use]
    pub const fn to_wire(self) -> u64 {
        (self.late_steps as u64) << 32 | self.busy_ns as u64
    }

    /// What a word in a header says.
    #[must_use]
    pub const fn from_wire(word: u64) -> Self {
        Self {
            busy_ns: word as u32,
            late_steps: (word >> 32) as u32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_directive_survives_the_wire() {
        let directive = Directive {
            busy_ns: u32::MAX,
            late_steps: 7,
        };
        assert_eq!(Directive::from_wire(directive.to_wire()), directive);
        assert_eq!(Directive::default().to_wire(), 0);
    }
}
