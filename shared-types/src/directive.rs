//! Timing directives that the plant's engine sends to the controller's runner, and the replies; a law never sees them.

use crate::time::Step;

/// Instructions to the runner for one sample, from a timing fault or from the run being repeated. 0 means none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Directive {
    /// Extra busy time before the answer, in ns; at most 4.29 s.
    pub busy_ns: u32,
    /// Delay in steps until the command of this sample takes effect. Until then the runner repeats the last command and
    /// ignores samples. At most 2^31 - 1.
    pub late_steps: u32,
    /// `true` if the repeated run did not receive this sample: the runner sends the last command again.
    pub unseen: bool,
}

const UNSEEN: u64 = 1 << 63;

impl Directive {
    /// Encodes the directive as a header word.
    #[must_use]
    pub const fn to_wire(self) -> u64 {
        let unseen_bit = if self.unseen { UNSEEN } else { 0 };
        unseen_bit | (self.late_steps as u64) << 32 & !UNSEEN | self.busy_ns as u64
    }

    /// Decodes the directive from a header word.
    #[must_use]
    #[inline]
    pub const fn from_wire(word: u64) -> Self {
        Self {
            busy_ns: word as u32,
            late_steps: ((word & !UNSEEN) >> 32) as u32,
            unseen: word & UNSEEN != 0,
        }
    }
}

/// Samples that a controller answered before the sample to which a command belongs.
///
/// In lockstep a controller answers every sample. In real time it may miss some, and some of its commands may be
/// replaced before the plant has seen them, but never more than two in a row: one in progress when the plant polled,
/// and one for each sample since. The last two answers before a command therefore suffice to list all of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Answered {
    /// Steps from the last answered sample to the sample that the command answers; 0 for none.
    pub last_steps: u32,
    /// Steps from the last but one answered sample to the last one; 0 for none.
    pub last_but_one_steps: u32,
}

impl Answered {
    /// Encodes the answered samples as a header word.
    #[must_use]
    pub const fn to_wire(self) -> u64 {
        (self.last_but_one_steps as u64) << 32 | self.last_steps as u64
    }

    /// Decodes the answered samples from a header word.
    #[must_use]
    #[inline]
    pub const fn from_wire(word: u64) -> Self {
        Self {
            last_steps: word as u32,
            last_but_one_steps: (word >> 32) as u32,
        }
    }

    /// Lists the steps answered before a command, latest first.
    pub fn steps(self, command: Step) -> impl Iterator<Item = Step> {
        let before = |step: Step, steps: u32| {
            let before = step.0.checked_sub(u64::from(steps)).map(Step);
            before.filter(|_| steps > 0)
        };
        let last = before(command, self.last_steps);
        let last_but_one = last.and_then(|last| before(last, self.last_but_one_steps));
        last.into_iter().chain(last_but_one)
    }

    /// Returns the value for the next command, which answers a sample `steps` steps after this one.
    #[must_use]
    pub const fn then(self, steps: u32) -> Self {
        Self {
            last_steps: steps,
            last_but_one_steps: self.last_steps,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_names_the_two_answers_before_it() {
        let steps_of = |steps_before: Answered, at| {
            let steps_before = Answered::from_wire(steps_before.to_wire());
            (steps_before.steps(Step(at)).map(|step| step.0)).collect::<Vec<_>>()
        };
        let first = Answered::default();
        assert!(steps_of(first, 0).is_empty());
        let second = first.then(3);
        assert_eq!(steps_of(second, 3), [0]);
        assert_eq!(steps_of(second.then(4), 7), [3, 0]);
        assert_eq!(steps_of(second.then(4).then(1), 8), [7, 3]);
    }

    #[test]
    fn a_directive_survives_the_wire() {
        let directive = Directive {
            busy_ns: u32::MAX,
            late_steps: 7,
            unseen: true,
        };
        assert_eq!(Directive::from_wire(directive.to_wire()), directive);
        assert_eq!(Directive::default().to_wire(), 0);
    }
}
