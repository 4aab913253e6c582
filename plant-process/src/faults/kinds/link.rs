//! Faults of the link, applied to messages in transit.
//!
//! The profile scales probabilities and lengths: at g = 0 every message arrives on time and intact.

use shared_types::describe::{ActsOn, Invalid, ListDescription};
use shared_types::random::RandomStream;
use shared_types::state::StateOf;

use super::whole;
use crate::faults::kind::{FaultKind, Moment, Passage, Setup};

/// Delays every copy; a copy delayed beyond the maximum never arrives.
fn delayed(passage: &mut Passage, steps: u32) {
    for copy in &mut passage.copies {
        *copy = copy.map(|late| late.saturating_add(steps));
    }
}

/// Scales a length by the profile, in whole steps, halves away from 0.
fn scaled(steps: u32, gain: f64) -> u32 {
    libm::round(f64::from(steps) * gain) as u32 // below 0 saturates to 0
}

/// Random event of a given probability.
struct Chance {
    probability: f64,
    random: Option<RandomStream>,
}

impl Chance {
    const fn new(probability: f64) -> Self {
        Self {
            probability,
            random: None,
        }
    }

    /// Draws the event. Draws at every call, so that the profile does not shift the sequence.
    fn happens(&mut self, gain: f64) -> bool {
        let number = self.random.as_mut().map_or(1.0, RandomStream::uniform);
        number < self.probability * gain
    }
}

shared_types::table! {
    /// Parameters of [`Loss`].
    pub struct LossParameters {
        /// Probability P that a message is lost.
        probability: "1" = 1.0 in 0.0..=1.0,
    }
}

/// Lost messages.
pub struct Loss {
    chance: Chance,
    /// Repeating pattern of losses; empty for random losses.
    pattern: Vec<bool>,
}

impl FaultKind for Loss {
    const NAME: &'static str = "message-loss";
    const SUMMARY: &'static str =
        "Messages are lost: the receiver keeps the last one, which grows old.";
    const EQUATION: &'static str = "message k never arrives with probability P g; with a pattern: where its place in it is 1 and g is not 0";
    const ACTS_ON: ActsOn = ActsOn::Links;
    type Parameters = LossParameters;
    const OPTIONAL: &'static [&'static str] = &["probability"];

    fn list() -> Option<ListDescription> {
        Some(ListDescription {
            key: "pattern".into(),
            description: "Repeating pattern of lost (1) and delivered (0) messages, instead of random losses.".into(),
            columns: 1,
        })
    }

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.chance.random.clone(),
            |fault, random| fault.chance.random = random,
        ))
    }

    fn start(setup: &Setup<'_, LossParameters>) -> Result<Self, Invalid> {
        if setup.parameters.probability < 1.0 && !setup.list.is_empty() {
            return Err(Invalid(
                "`pattern` replaces `probability`; give only one of them".into(),
            ));
        }
        let lost = |value: &f64| match *value {
            0.0 => Ok(false),
            1.0 => Ok(true),
            other => Err(Invalid(format!(
                "`pattern` contains {other}; use only 0 (delivered) and 1 (lost)"
            ))),
        };
        Ok(Self {
            chance: Chance::new(setup.parameters.probability),
            pattern: setup.list.iter().map(lost).collect::<Result<_, _>>()?,
        })
    }

    fn hold(&mut self, random: RandomStream) {
        self.chance.random = Some(random);
    }

    fn message(&mut self, at: &Moment, passage: &mut Passage) {
        let lost = if self.pattern.is_empty() {
            self.chance.happens(at.gain)
        } else {
            let place = at.since_steps % self.pattern.len() as u64;
            self.pattern[place as usize] && at.gain != 0.0
        };
        if lost {
            passage.copies = [None; Passage::MOST_COPIES];
        }
    }
}

shared_types::table! {
    /// Parameters of [`Delay`].
    pub struct DelayParameters {
        /// Delay n of messages, a whole number.
        steps: "steps" = 1.0 in 0.0..=1000.0,
    }
}

/// Delayed messages.
pub struct Delay(u32);

impl FaultKind for Delay {
    const NAME: &'static str = "message-delay";
    const SUMMARY: &'static str = "Every message arrives a constant number of steps late.";
    const EQUATION: &'static str = "message k arrives at step k + round(n g)";
    const ACTS_ON: ActsOn = ActsOn::Links;
    type Parameters = DelayParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, DelayParameters>) -> Result<Self, Invalid> {
        Ok(Self(whole("steps", setup.parameters.steps)?))
    }

    fn message(&mut self, at: &Moment, passage: &mut Passage) {
        delayed(passage, scaled(self.0, at.gain));
    }
}

shared_types::table! {
    /// Parameters of [`Jitter`].
    pub struct JitterParameters {
        /// Longest delay n of a message, a whole number.
        steps: "steps" = 1.0 in 0.0..=1000.0,
    }
}

/// Randomly delayed messages.
pub struct Jitter {
    steps: u32,
    random: Option<RandomStream>,
}

impl FaultKind for Jitter {
    const NAME: &'static str = "message-jitter";
    const SUMMARY: &'static str = "Every message has its own random delay; of several that arrive at one step only the newest is seen.";
    const EQUATION: &'static str = "message k arrives at step k + d, d uniform in 0 .. round(n g)";
    const ACTS_ON: ActsOn = ActsOn::Links;
    type Parameters = JitterParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.random.clone(),
            |fault, random| fault.random = random,
        ))
    }

    fn start(setup: &Setup<'_, JitterParameters>) -> Result<Self, Invalid> {
        Ok(Self {
            steps: whole("steps", setup.parameters.steps)?,
            random: None,
        })
    }

    fn hold(&mut self, random: RandomStream) {
        self.random = Some(random);
    }

    fn message(&mut self, at: &Moment, passage: &mut Passage) {
        let number = self.random.as_mut().map_or(0.0, RandomStream::uniform);
        let longest = f64::from(scaled(self.steps, at.gain));
        delayed(passage, (number * (longest + 1.0)) as u32);
    }
}

shared_types::table! {
    /// Parameters of [`Duplication`].
    pub struct DuplicationParameters {
        /// Probability P that a message arrives twice.
        probability: "1" = 1.0 in 0.0..=1.0,
        /// Delay n of the second copy after the first, a whole number.
        lag_steps: "steps" = 1.0 in 1.0..=1000.0,
    }
}

/// Duplicated messages.
pub struct Duplication {
    chance: Chance,
    lag_steps: u32,
}

impl FaultKind for Duplication {
    const NAME: &'static str = "message-duplication";
    const SUMMARY: &'static str =
        "Messages arrive a second time, after newer ones, with their old content.";
    const EQUATION: &'static str = "with probability P g message k arrives once more n steps later, after what else arrives then";
    const ACTS_ON: ActsOn = ActsOn::Links;
    type Parameters = DuplicationParameters;
    const OPTIONAL: &'static [&'static str] = &["probability", "lag_steps"];

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.chance.random.clone(),
            |fault, random| fault.chance.random = random,
        ))
    }

    fn start(setup: &Setup<'_, DuplicationParameters>) -> Result<Self, Invalid> {
        Ok(Self {
            chance: Chance::new(setup.parameters.probability),
            lag_steps: whole("lag_steps", setup.parameters.lag_steps)?,
        })
    }

    fn hold(&mut self, random: RandomStream) {
        self.chance.random = Some(random);
    }

    fn message(&mut self, at: &Moment, passage: &mut Passage) {
        if !self.chance.happens(at.gain) {
            return;
        }
        let first = passage.copies.iter().flatten().min().copied();
        let free = passage.copies.iter().position(Option::is_none);
        if let (Some(first), Some(free)) = (first, free) {
            passage.copies[free] = Some(first.saturating_add(self.lag_steps));
            passage.overtaken[free] = true;
        }
    }
}

shared_types::table! {
    /// Parameters of [`Reordering`].
    pub struct ReorderingParameters {
        /// Probability P that a message changes places with the next.
        probability: "1" = 1.0 in 0.0..=1.0,
    }
}

/// Swapped messages.
pub struct Reordering {
    chance: Chance,
    /// `true` if the last message was swapped, so that this message arrives before it.
    swapped: bool,
}

impl FaultKind for Reordering {
    const NAME: &'static str = "message-reordering";
    const SUMMARY: &'static str =
        "A message changes places with the next one and arrives right after it.";
    const EQUATION: &'static str = "with probability P g message k arrives at step k + 1 after message k + 1, which then stays in its place";
    const ACTS_ON: ActsOn = ActsOn::Links;
    type Parameters = ReorderingParameters;
    const OPTIONAL: &'static [&'static str] = &["probability"];

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| (fault.chance.random.clone(), fault.swapped),
            |fault, (random, swapped)| (fault.chance.random, fault.swapped) = (random, swapped),
        ))
    }

    fn start(setup: &Setup<'_, ReorderingParameters>) -> Result<Self, Invalid> {
        Ok(Self {
            chance: Chance::new(setup.parameters.probability),
            swapped: false,
        })
    }

    fn hold(&mut self, random: RandomStream) {
        self.chance.random = Some(random);
    }

    fn message(&mut self, at: &Moment, passage: &mut Passage) {
        let swaps = self.chance.happens(at.gain) && !self.swapped;
        if swaps {
            delayed(passage, 1);
            passage.overtaken = [true; Passage::MOST_COPIES];
        }
        self.swapped = swaps;
    }
}

shared_types::table! {
    /// Parameters of [`Corruption`].
    pub struct CorruptionParameters {
        /// Probability P that a message is corrupted.
        probability: "1" = 1.0 in 0.0..=1.0,
        /// Number n of inverted bits, a whole number.
        bits: "1" = 1.0 in 1.0..=16.0,
    }
}

/// Inverted bits in messages.
pub struct Corruption {
    chance: Chance,
    bits: usize,
}

impl FaultKind for Corruption {
    const NAME: &'static str = "message-corruption";
    const SUMMARY: &'static str = "Bits of a message are inverted; the checksum of its frame detects this, and the message counts as lost.";
    const EQUATION: &'static str =
        "with probability P g, n different bits of frame k, drawn at random, are inverted";
    const ACTS_ON: ActsOn = ActsOn::Links;
    type Parameters = CorruptionParameters;
    const OPTIONAL: &'static [&'static str] = &["probability", "bits"];

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.chance.random.clone(),
            |fault, random| fault.chance.random = random,
        ))
    }

    fn start(setup: &Setup<'_, CorruptionParameters>) -> Result<Self, Invalid> {
        Ok(Self {
            chance: Chance::new(setup.parameters.probability),
            bits: whole("bits", setup.parameters.bits)? as usize,
        })
    }

    fn hold(&mut self, random: RandomStream) {
        self.chance.random = Some(random);
    }

    fn message(&mut self, at: &Moment, passage: &mut Passage) {
        if !self.chance.happens(at.gain) {
            return;
        }
        let Some(random) = &mut self.chance.random else {
            return;
        };
        let begin = passage.flipped;
        let count = self.bits.min(Passage::MOST_FLIPS - begin);
        // Each choice equally likely, by Floyd (Bentley and Floyd 1987, Commun. ACM 30 (9)): if the number drawn up to
        // the last is taken already, the last itself is not.
        for last in passage.bits - count as u64..passage.bits {
            let choice = (random.uniform() * (last + 1) as f64) as u64;
            let choices = &passage.flips[begin..passage.flipped];
            let bit = if choices.contains(&choice) {
                last
            } else {
                choice
            };
            passage.flips[passage.flipped] = bit;
            passage.flipped += 1;
        }
    }
}
