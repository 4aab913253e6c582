//! Path of the signals in one direction between plant and controller, and the medium that they cross.
//!
//! Called by the layer at every step, in the order of processing: a sample's signal faults act before it is sent, and a
//! command's after it has arrived. Without faults a path only remembers the row, as a fallback for a later fault.

use serde::{Deserialize, Serialize};
use shared_types::describe::Invalid;
use shared_types::frame::{FrameKind, VALIDITY_WORDS};
use shared_types::time::{Rate, Step};

use super::bus::Line;
use super::channel::{About, Channel, SavedChannel};
use super::effect::{Action, Effect};
use super::kind::{Passage, Reading};

/// Row of signals in transit, with its invalid bits.
pub(super) type Row<'a> = (&'a mut [f64], &'a mut [u64; VALIDITY_WORDS]);

/// Path of one direction.
pub(super) struct SignalPath {
    /// Effects that act on signals, in the order in which they began.
    signals: Vec<usize>,
    /// Effects that act on the link, in the order in which they began.
    link: Vec<usize>,
    /// Signals of the previous step, whose values replace invalid signals; 0 before the first step.
    previous: Vec<f64>,
    channel: Channel,
    /// Frames in place of the channel.
    line: Option<Box<Line>>,
}

/// Saved state of a path.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SavedPath {
    signals: Vec<usize>,
    link: Vec<usize>,
    previous: Vec<f64>,
    channel: SavedChannel,
}

impl SignalPath {
    /// Creates a path with N signals in frames of this kind.
    pub(super) fn new(width: usize, kind: FrameKind) -> Self {
        Self {
            signals: Vec::new(),
            link: Vec::new(),
            previous: vec![0.0; width],
            channel: Channel::new(width, kind),
            line: None,
        }
    }

    /// Lets the signals cross frames.
    pub(super) fn cross(&mut self, line: Line) {
        self.line = Some(Box::new(line));
    }

    /// Returns the frames that the signals cross, if any.
    pub(super) fn line(&self) -> Option<&Line> {
        self.line.as_deref()
    }

    /// Returns the frames that the signals cross, if any.
    pub(super) fn line_mut(&mut self) -> Option<&mut Line> {
        self.line.as_deref_mut()
    }

    /// Returns the state.
    pub(super) fn save(&self) -> SavedPath {
        SavedPath {
            signals: self.signals.clone(),
            link: self.link.clone(),
            previous: self.previous.clone(),
            channel: self.channel.save(),
        }
    }

    /// Restores a saved state.
    pub(super) fn restore(&mut self, saved: SavedPath) -> Result<(), Invalid> {
        if saved.previous.len() != self.previous.len() {
            return Err(Invalid(
                "the signals in the state are not those of this plant".into(),
            ));
        }
        // Not replaced: they have room for every armed effect.
        self.signals.clone_from(&saved.signals);
        self.link.clone_from(&saved.link);
        self.previous = saved.previous;
        self.channel.restore(saved.channel)
    }

    /// Returns the number of frames rejected by their checksum.
    pub(super) fn rejected(&self) -> u64 {
        self.channel.rejected() + self.line().map_or(0, Line::rejected)
    }

    /// Returns the active effects on signals.
    pub(super) const fn signals(&mut self) -> &mut Vec<usize> {
        &mut self.signals
    }

    /// Returns the active effects on the link.
    pub(super) const fn link(&mut self) -> &mut Vec<usize> {
        &mut self.link
    }

    /// Begins an effect on the link.
    pub(super) fn begin(&mut self, effect: &mut Effect) {
        self.channel.begin();
        if let Action::Link(_, _, _, arrivals) = &mut effect.action {
            arrivals.continue_from(self.channel.arrivals());
        }
    }

    /// Ends an effect on the link.
    pub(super) fn end(&mut self, effects: &mut [Effect], step: Step) {
        if let Some(line) = &mut self.line {
            line.end();
            return;
        }
        self.channel.end(step);
        for &effect in &self.link {
            if let Action::Link(_, _, _, arrivals) = &mut effects[effect].action {
                arrivals.overrule(step.0);
            }
        }
    }

    /// Applies the faults of the signals. An invalid signal keeps its last valid value, whatever happens in transit.
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
                    *value = self.previous[index];
                }
            }
        }
        for &effect in &self.signals {
            apply(
                &mut effects[effect],
                step,
                rate,
                (row, invalid),
                &self.previous,
            );
        }
        self.previous.copy_from_slice(row);
    }

    /// Transmits a row of this age to the receiver; returns the age of the received row.
    pub(super) fn apply_link_faults(
        &mut self,
        effects: &mut [Effect],
        step: Step,
        rate: Rate,
        (row, invalid): Row<'_>,
        age_steps: u32,
    ) -> u32 {
        if let Some(line) = &mut self.line {
            let acting = (effects, &self.link[..]);
            return line.carry(acting, (step, rate), (row, invalid), age_steps);
        }
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
            if let Action::Link(_, _, fault, arrivals) = &mut effect.action {
                fault.message(&at, &mut passage);
                if self.channel.gets_through(step, &passage) {
                    arrivals.send(step.0, &passage);
                }
                received = arrivals.receive(step.0);
            }
            // The age that it alone added or removed: messages from before step 0 do not exist.
            let step_sent =
                |received: Option<u64>| received.map_or(-1, |step_sent| step_sent as i64);
            let added_steps = step_sent(received).abs_diff(step_sent(received_before));
            effect.note(passage != before, added_steps as f64);
        }
        self.channel.send(step, &passage);
        self.channel.receive(step, row, invalid)
    }
}

fn is_invalid(invalid: &[u64; VALIDITY_WORDS], index: usize) -> bool {
    invalid[index / 64] >> (index % 64) & 1 == 1
}

/// Applies a fault to one signal.
fn apply(effect: &mut Effect, step: Step, rate: Rate, (row, invalid): Row<'_>, fallback: &[f64]) {
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
        after.value = fallback[index];
        invalid[index / 64] |= bit;
    }
    row[index] = after.value;
    effect.note(after != before, (after.value - before.value).abs());
}
