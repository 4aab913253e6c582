//! Direction of the signals between plant and controller, and the medium that they
//! cross.
//!
//! Called by the layer at every step, in the order in which a row takes the way: a sample's signals
//! meet their faults before it is sent, a command's after it has come. Without faults a path only remembers
//! the row, which is what a later fault falls back on.

use serde::{Deserialize, Serialize};
use shared_types::describe::Invalid;
use shared_types::frame::{FrameKind, VALIDITY_WORDS};
use shared_types::time::{Rate, Step};

use super::channel::{About, Channel, SavedChannel};
use super::effect::{Action, Effect};
use super::kind::{Passage, Reading};

/// A row of signals on its way, with its invalid bits.
pub(super) type Row<'a> = (&'a mut [f64], &'a mut [u64; VALIDITY_WORDS]);

/// Direction of signals.
pub(super) struct SignalPath {
    /// Effects that act on signals, in the order in which they took hold.
    signals: Vec<usize>,
    /// Effects that act on the link, likewise.
    link: Vec<usize>,
    /// Signals of the step before, which an invalid signal keeps; 0 before the first step.
    kept: Vec<f64>,
    channel: Channel,
}

/// The state of a direction.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SavedPath {
    signals: Vec<usize>,
    link: Vec<usize>,
    kept: Vec<f64>,
    channel: SavedChannel,
}

impl SignalPath {
    /// A direction with N signals in frames of this kind.
    pub(super) fn new(width: usize, kind: FrameKind) -> Self {
        Self {
            signals: Vec::new(),
            link: Vec::new(),
            kept: vec![0.0; width],
            channel: Channel::new(width, kind),
        }
    }

    /// Returns the state.
    pub(super) fn save(&self) -> SavedPath {
        SavedPath {
            signals: self.signals.clone(),
            link: self.link.clone(),
            kept: self.kept.clone(),
            channel: self.channel.save(),
        }
    }

    /// Puts a state back.
    pub(super) fn restore(&mut self, saved: SavedPath) -> Result<(), Invalid> {
        if saved.kept.len() != self.kept.len() {
            return Err(Invalid("its signals are not those of this plant".into()));
        }
        // Not replaced: they have room for every effect that is armed.
        self.signals.clone_from(&saved.signals);
        self.link.clone_from(&saved.link);
        self.kept = saved.kept;
        self.channel.restore(saved.channel)
    }

    /// Frames that the check sum refused.
    pub(super) const fn rejected(&self) -> u64 {
        self.channel.rejected()
    }

    /// The effects on signals that act.
    pub(super) const fn signals(&mut self) -> &mut Vec<usize> {
        &mut self.signals
    }

    /// The effects on the link that act.
    pub(super) const fn link(&mut self) -> &mut Vec<usize> {
        &mut self.link
    }

    /// An effect on the link takes hold.
    pub(super) fn begin(&mut self, effect: &mut Effect) {
        self.channel.begin();
        if let Action::Link(_, _, arrivals) = &mut effect.action {
            arrivals.continue_from(self.channel.arrivals());
        }
    }

    /// An effect on the link ended.
    pub(super) fn end(&mut self, effects: &mut [Effect], step: Step) {
        self.channel.end(step);
        for &effect in &self.link {
            if let Action::Link(_, _, arrivals) = &mut effects[effect].action {
                arrivals.overrule(step.0);
            }
        }
    }

    /// Lets the faults of the signals act. An invalid signal keeps the value it had when it was
    /// valid last, whatever becomes of it on its way.
    pub(super) fn apply_signal_faults(
        &mut self,
        effects: &mut [Effect],
        step: Step,
        rate: Rate,
        (row, invalid): Row<'_>,
    ) {
        if invalid.iter().fold(0, |all, word| all | word) != 0 {
            for (index, value) in row.iter_mut().enumerate() {
                if is_invalid(invalid, index) {
                    *value = self.kept[index];
                }
            }
        }
        for &effect in &self.signals {
            apply(&mut effects[effect], step, rate, (row, invalid), &self.kept);
        }
        self.kept.copy_from_slice(row);
    }

    /// Carries a row of this age to the receiver; gives the age of what that one has then.
    pub(super) fn apply_link_faults(
        &mut self,
        effects: &mut [Effect],
        step: Step,
        rate: Rate,
        (row, invalid): Row<'_>,
        age_steps: u32,
    ) -> u32 {
        let about = About {
            step: step.0,
            age_steps,
            invalid: *invalid,
        };
        if self.link.is_empty() {
            self.channel.note(row, about);
            return age_steps;
        }
        self.channel.put(row, about);
        let mut passage = Passage::healthy(self.channel.bits());
        let mut received = Some(step.0);
        for &effect in &self.link {
            let effect = &mut effects[effect];
            let at = effect.moment(step, rate);
            let (before, received_before) = (passage, received);
            if let Action::Link(_, fault, arrivals) = &mut effect.action {
                fault.message(&at, &mut passage);
                if self.channel.gets_through(step, &passage) {
                    arrivals.send(step.0, &passage);
                }
                received = arrivals.receive(step.0);
            }
            // What it alone made older, or younger: messages from before step 0 do not exist.
            let sent = |received: Option<u64>| received.map_or(-1, |sent| sent as i64);
            let added_steps = sent(received).abs_diff(sent(received_before));
            effect.note(passage != before, added_steps as f64);
        }
        self.channel.send(step, &passage);
        self.channel.receive(step, row, invalid)
    }
}

fn is_invalid(invalid: &[u64; VALIDITY_WORDS], index: usize) -> bool {
    invalid[index / 64] >> (index % 64) & 1 == 1
}

/// Lets a fault act on one signal.
fn apply(effect: &mut Effect, step: Step, rate: Rate, (row, invalid): Row<'_>, kept: &[f64]) {
    let at = effect.moment(step, rate);
    let Action::Signal(_, index, fault) = &mut effect.action else {
        return;
    };
    let index = *index;
    let before = Reading {
        value: row[index],
        valid: !is_invalid(invalid, index),
    };
    let mut after = fault.coupled(&at, before, row);
    after.valid &= after.value.is_finite();
    let bit = 1 << (index % 64);
    if after.valid {
        invalid[index / 64] &= !bit;
    } else {
        after.value = kept[index];
        invalid[index / 64] |= bit;
    }
    row[index] = after.value;
    effect.note(after != before, (after.value - before.value).abs());
}
