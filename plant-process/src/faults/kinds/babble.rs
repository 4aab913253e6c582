//! A participant that floods a network, so that frames of others wait or are never sent.

use shared_types::describe::{ActsOn, Invalid};
use shared_types::random::RandomStream;
use shared_types::state::StateOf;

use super::whole;
use crate::faults::kind::{FaultKind, Moment, Passage, Setup};

shared_types::table! {
    /// Parameters of [`Babble`].
    pub struct BabbleParameters {
        /// Share L of the steps at which the flood leaves no room.
        load: "1" = 1.0 in 0.0..=1.0,
        /// Longest wait w of a message for room, a whole number.
        wait_steps: "steps" = 0.0 in 0.0..=1000.0,
    }
}

/// Flooded network.
pub struct Babble {
    load: f64,
    wait_steps: u32,
    random: Option<RandomStream>,
}

impl FaultKind for Babble {
    const NAME: &'static str = "babble";
    const SUMMARY: &'static str = "A network is flooded: messages wait for room, and those that wait too long are never sent.";
    const EQUATION: &'static str =
        "message k arrives at step k + d, P(d >= n) = (L g)^n; with d > w it is never sent";
    const ACTS_ON: ActsOn = ActsOn::Links;
    type Parameters = BabbleParameters;
    const OPTIONAL: &'static [&'static str] = &["load", "wait_steps"];

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.random.clone(),
            |fault, random| fault.random = random,
        ))
    }

    fn start(setup: &Setup<'_, BabbleParameters>) -> Result<Self, Invalid> {
        Ok(Self {
            load: setup.parameters.load,
            wait_steps: whole("wait_steps", setup.parameters.wait_steps)?,
            random: None,
        })
    }

    fn hold(&mut self, random: RandomStream) {
        self.random = Some(random);
    }

    fn message(&mut self, at: &Moment, passage: &mut Passage) {
        // Drawn at every call, so that the profile does not shift the sequence.
        let number = self.random.as_mut().map_or(0.0, RandomStream::uniform);
        let load = (self.load * at.gain).clamp(0.0, 1.0);
        // The number of steps without room before one with it, by inversion: P(d >= n) = P(u < load^n).
        let wait_steps = if load == 0.0 {
            0.0
        } else if load == 1.0 || number == 0.0 {
            f64::INFINITY
        } else {
            (libm::log(number) / libm::log(load)).floor()
        };
        let is_sent = wait_steps <= f64::from(self.wait_steps);
        for copy in &mut passage.copies {
            *copy = copy.filter(|_| is_sent);
            *copy = copy.map(|late| late.saturating_add(wait_steps as u32));
        }
    }
}
