//! Direction of a bus: packing, transit and unpacking of its frames.

use std::collections::VecDeque;

use hil_codec::frame::CanId;
use hil_codec::pack::{Packer, Unusable};
use hil_codec::receive::Receiver;
use hil_codec::row::Row as Received;
use hil_config::bus::BusFrame;
use hil_config::port::Carries;
use shared_types::describe::Invalid;
use shared_types::frame::VALIDITY_WORDS;
use shared_types::layout::SignalTable;
use shared_types::quality::{SignalSet, age_signal};
use shared_types::record::{BusCounts, Mark, SaturatedSignal};
use shared_types::time::{Rate, Step};

use super::redundancy::{Redundancy, Verdict, next};
use super::transit::{Sent, Transit};
use crate::faults::effect::{Action, Effect, Networks};
use crate::faults::kind::Passage;

/// Largest number of networks.
const MOST: usize = 2;

/// Direction of a bus.
pub(in crate::faults) struct Line {
    frames: Vec<FrameLine>,
    row: Received,
    /// Step at which the newest accepted content was made, as far as the receiver can know it; none before the first.
    made: Option<i64>,
    /// Columns of ages that the receiver itself fills, each with that of its signal.
    ages: Vec<(usize, usize)>,
    events: VecDeque<Mark>,
}

/// Frame of a direction.
struct FrameLine {
    name: String,
    carries: Carries,
    period_steps: u64,
    packer: Packer,
    /// Names of the packed signals.
    signals: Vec<String>,
    /// Text of the event for each signal, until it first exceeds its range.
    texts: Vec<Option<String>>,
    inlet: Inlet,
    networks: Vec<Transit>,
    /// Frames sent.
    count: u64,
    /// Sequence number of the next frame.
    number: u8,
    /// `true` if the frame is sent at this step.
    is_due: bool,
    /// Its bytes.
    wire: Vec<u8>,
    /// Its way on each network.
    passages: [Passage; MOST],
}

/// Receiving end of one frame.
struct Inlet {
    id: Option<CanId>,
    receiver: Receiver,
    /// `None` with a single network.
    redundancy: Option<Redundancy>,
    out_of_order: u64,
    redundant: u64,
}

impl Inlet {
    /// Takes an intact frame that arrives on a network at a step; returns `true` if it is accepted.
    fn take(
        &mut self,
        (network, step): (usize, u64),
        sent: Sent,
        bytes: &[u8],
        row: &mut Received,
    ) -> bool {
        let verdict = match &mut self.redundancy {
            Some(redundancy) => redundancy.judge(network, sent.number, step),
            None => Verdict::First,
        };
        match verdict {
            Verdict::First => self.receiver.receive(self.id, bytes, row).1.is_ok(),
            Verdict::OutOfOrder => {
                self.out_of_order += 1;
                false
            }
            Verdict::Redundant => {
                self.redundant += 1;
                false
            }
        }
    }
}

impl Line {
    /// Creates a direction with these frames, whose signals are those of a row.
    ///
    /// # Errors
    /// If a frame does not fit the row.
    pub(super) fn new<'a>(
        frames: impl Iterator<Item = &'a BusFrame>,
        table: &SignalTable,
        networks: u8,
    ) -> Result<Self, Unusable> {
        let mut row = Received::new(table.len());
        let mut lines = Vec::new();
        for one in frames {
            let line = FrameLine::new(one, table, networks)?;
            if let Some(stale_steps) = one.stale_steps {
                for column in line.inlet.receiver.columns(0) {
                    row.limit_age(*column, stale_steps);
                }
            }
            lines.push(line);
        }
        let ages = table.0.iter().enumerate().filter_map(|(column, signal)| {
            let fields = table.0.iter().map(|one| &one.field);
            Some((age_signal(fields, &signal.field.name)?, column))
        });
        Ok(Self {
            row,
            made: None,
            ages: ages.collect(),
            events: VecDeque::with_capacity(table.len()),
            frames: lines,
        })
    }

    /// Carries a row of a step, whose content has this age, through the frames and the faults that act on them; leaves
    /// in its place what the receiver has, and returns the age of that.
    pub(in crate::faults) fn carry(
        &mut self,
        (effects, acting): (&mut [Effect], &[usize]),
        (step, rate): (Step, Rate),
        (values, invalid): (&mut [f64], &mut [u64; VALIDITY_WORDS]),
        age_steps: u32,
    ) -> u32 {
        let invalid_signals = SignalSet::from(*invalid);
        self.row.advance();
        for frame in &mut self.frames {
            frame.pack(step.0, values, &invalid_signals, &mut self.events);
        }
        // What acts on both networks alike acts before they part.
        let is_common =
            |effect: &Effect| matches!(effect.action, Action::Link(_, Networks::All, ..));
        for common in [true, false] {
            for &index in acting {
                let effect = &mut effects[index];
                if is_common(effect) == common {
                    apply(effect, &mut self.frames, (step, rate));
                }
            }
        }
        for frame in &mut self.frames {
            if let Some(age_steps) = frame.exchange(step.0, age_steps, &mut self.row) {
                let made = step.0 as i64 - i64::from(age_steps);
                self.made = self.made.max(Some(made));
            }
        }
        let made = self.made.unwrap_or(-1);
        let age_steps = u32::try_from(step.0 as i64 - made).unwrap_or(u32::MAX);
        values.copy_from_slice(self.row.values());
        *invalid = [0; VALIDITY_WORDS];
        for column in self.row.invalid().iter(values.len()) {
            invalid[column / 64] |= 1 << (column % 64);
        }
        for &(age, column) in &self.ages {
            values[age] += f64::from(self.row.ages()[column].saturating_sub(age_steps));
            invalid[age / 64] &= !(1 << (age % 64));
        }
        age_steps
    }

    /// Ends an effect on the link: frames that it delayed no longer replace newer ones.
    pub(in crate::faults) fn end(&mut self) {
        for frame in &mut self.frames {
            for network in &mut frame.networks {
                network.overrule(frame.count);
            }
        }
    }

    /// Returns `true` if a signal exceeded its range for the first time.
    pub(in crate::faults) fn has_events(&self) -> bool {
        !self.events.is_empty()
    }

    /// Takes the next event of a signal that exceeded its range for the first time.
    pub(in crate::faults) fn next_event(&mut self) -> Option<Mark> {
        self.events.pop_front()
    }

    /// Returns the number of frames refused by the check of a network.
    pub(in crate::faults) fn rejected(&self) -> u64 {
        let networks = self.frames.iter().flat_map(|frame| &frame.networks);
        networks.map(|network| network.refused).sum()
    }

    /// Returns the counts of each frame.
    pub(in crate::faults) fn counts(&self) -> impl Iterator<Item = BusCounts> + '_ {
        self.frames.iter().map(FrameLine::counts)
    }

    /// Returns the state between two steps.
    pub(in crate::faults) fn save(&self) -> Vec<u64> {
        let mut state = self.row.state();
        state.extend([
            u64::from(self.made.is_some()),
            self.made.unwrap_or(0) as u64,
        ]);
        for frame in &self.frames {
            frame.save(&mut state);
        }
        state
    }

    /// Restores a state.
    ///
    /// # Errors
    /// If it is one of another bus.
    pub(in crate::faults) fn restore(&mut self, state: &[u64]) -> Result<(), Invalid> {
        let restored = self.restored(state);
        restored.ok_or_else(|| Invalid("the state of the bus does not belong to this bus".into()))
    }

    fn restored(&mut self, mut state: &[u64]) -> Option<()> {
        let row = split(&mut state, self.row.state().len())?;
        let made = split(&mut state, 2)?;
        self.made = (made[0] == 1).then_some(made[1] as i64);
        for frame in &mut self.frames {
            frame.restore(&mut state)?;
        }
        (self.row.restore(row) && state.is_empty()).then_some(())
    }
}

/// Lets an effect act on every frame of a step, and notes the greatest change.
fn apply(effect: &mut Effect, frames: &mut [FrameLine], (step, rate): (Step, Rate)) {
    let at = effect.moment(step, rate);
    let Action::Link(_, networks, fault, _) = &mut effect.action else {
        return;
    };
    let (mut acted, mut change_steps) = (false, 0);
    for frame in frames.iter_mut().filter(|frame| frame.is_due) {
        let passage = match networks {
            Networks::All => &mut frame.passages[0],
            Networks::One(network) => &mut frame.passages[*network],
        };
        let before = *passage;
        fault.message(&at, passage);
        acted |= *passage != before;
        change_steps = change_steps.max(change(&before, passage, frame.period_steps));
        if *networks == Networks::All {
            frame.passages = [frame.passages[0]; MOST];
        }
    }
    effect.note(acted, change_steps as f64);
}

/// Returns the largest change to any copy, in steps: its delay, or the frame's period if the copy is lost or the frame
/// is corrupted.
fn change(before: &Passage, after: &Passage, period_steps: u64) -> u64 {
    if after.flipped > before.flipped {
        return period_steps;
    }
    let copies = before.copies.iter().zip(&after.copies);
    let changes = copies.map(|copy| match copy {
        (Some(before), Some(after)) => after.abs_diff(*before).into(),
        (Some(_), None) => period_steps,
        (None, Some(after)) => u64::from(*after),
        (None, None) => 0,
    });
    changes.max().unwrap_or(0)
}

/// Takes the first words of a state.
fn split<'a>(state: &mut &'a [u64], count: usize) -> Option<&'a [u64]> {
    let (first, rest) = state.split_at_checked(count)?;
    *state = rest;
    Some(first)
}

impl FrameLine {
    fn new(one: &BusFrame, table: &SignalTable, networks: u8) -> Result<Self, Unusable> {
        let packer = Packer::new(&one.frame, table)?;
        let slots = usize::try_from(one.most_in_transit()).unwrap_or(usize::MAX);
        let (name, signals) = (&one.frame.name, one.frame.signals());
        let signals: Vec<String> = signals.map(|(signal, _)| signal.to_string()).collect();
        let text = |signal: &String| Some(format!("{signal} exceeds its range in frame {name}"));
        Ok(Self {
            name: name.clone(),
            carries: one.carries,
            period_steps: one.period_steps,
            texts: signals.iter().map(text).collect(),
            signals,
            inlet: Inlet {
                id: one.frame.id,
                receiver: Receiver::new(std::slice::from_ref(&one.frame), table)?,
                redundancy: (networks > 1).then(|| Redundancy::new(one.skew_steps)),
                out_of_order: 0,
                redundant: 0,
            },
            // One by one: a copy would not keep the reserved room.
            networks: (0..networks)
                .map(|_| Transit::new(packer.longest(), slots))
                .collect(),
            count: 0,
            number: 0,
            is_due: false,
            wire: Vec::with_capacity(packer.longest()),
            passages: [Passage::healthy(0); MOST],
            packer,
        })
    }

    /// Packs the row of a step, if the frame is due, and notes the signals that exceed their range for the first time.
    fn pack(
        &mut self,
        step: u64,
        values: &[f64],
        invalid: &SignalSet,
        events: &mut VecDeque<Mark>,
    ) {
        self.is_due = step.is_multiple_of(self.period_steps);
        if !self.is_due {
            return;
        }
        let bytes = self.packer.pack(values, invalid);
        self.wire.clear();
        self.wire.extend_from_slice(bytes);
        self.passages = [Passage::healthy(Transit::bits(self.wire.len())); MOST];
        for (text, saturated) in self.texts.iter_mut().zip(self.packer.saturated()) {
            if *saturated > 0 {
                events.extend(text.take().map(|text| Mark { step, text }));
            }
        }
    }

    /// Sends the frame of a step and receives those that arrive; returns the least age of the accepted content.
    fn exchange(&mut self, step: u64, age_steps: u32, row: &mut Received) -> Option<u32> {
        let sent = Sent {
            count: self.count,
            number: self.number,
            age_steps,
        };
        let healthy = Passage::healthy(Transit::bits(self.wire.len()));
        let mut accepted = None;
        for index in 0..self.networks.len() {
            let network = &mut self.networks[index];
            let is_sent = self.is_due;
            if is_sent && network.is_empty() && self.passages[index] == healthy {
                network.pass(sent.count);
                if self.inlet.take((index, step), sent, &self.wire, row) {
                    accepted = least(accepted, Some(age_steps));
                }
                continue;
            }
            if is_sent {
                network.send(step, &self.passages[index], sent, &self.wire);
            }
            while let Some(age) = self.receive_next(index, step, row) {
                accepted = least(accepted, age);
            }
        }
        if self.is_due {
            self.count += 1;
            self.number = next(self.number);
        }
        accepted
    }

    /// Receives the next frame that arrives on a network at a step, with the age of its content if it is accepted;
    /// `None` if there is no further one.
    fn receive_next(
        &mut self,
        network: usize,
        step: u64,
        row: &mut Received,
    ) -> Option<Option<u32>> {
        let (sent, bytes) = self.networks[network].receive(step)?;
        let is_accepted = self.inlet.take((network, step), sent, bytes, row);
        Some(is_accepted.then_some(sent.age_steps))
    }

    fn counts(&self) -> BusCounts {
        let Inlet {
            receiver,
            out_of_order,
            redundant,
            ..
        } = &self.inlet;
        let counts = receiver.counts(0);
        let saturated = self.signals.iter().zip(self.packer.saturated());
        let saturated = saturated.filter(|(_, count)| **count > 0);
        BusCounts {
            frame: self.name.clone(),
            carries: self.carries.word().into(),
            sent: self.count,
            accepted: counts.accepted,
            refused: counts.refused + counts.repeated,
            corrupted: self.networks.iter().map(|network| network.refused).sum(),
            out_of_order: *out_of_order,
            redundant: *redundant,
            saturated: saturated
                .map(|(signal, count)| SaturatedSignal {
                    signal: signal.clone(),
                    count: *count,
                })
                .collect(),
        }
    }

    fn save(&self, state: &mut Vec<u64>) {
        let inlet = &self.inlet;
        let number = self.number.into();
        state.extend([self.count, number, inlet.out_of_order, inlet.redundant]);
        let redundancy = inlet.redundancy.as_ref();
        state.extend(redundancy.map_or([0; 4], Redundancy::state));
        state.extend(self.packer.state());
        state.extend(inlet.receiver.state());
        for network in &self.networks {
            network.save(state);
        }
    }

    fn restore(&mut self, state: &mut &[u64]) -> Option<()> {
        let (head, rest) = state.split_first_chunk::<8>()?;
        let [count, number, out_of_order, redundant, order @ ..] = *head;
        *state = rest;
        (self.count, self.number) = (count, u8::try_from(number).ok()?);
        let inlet = &mut self.inlet;
        (inlet.out_of_order, inlet.redundant) = (out_of_order, redundant);
        if let Some(redundancy) = &mut inlet.redundancy {
            redundancy.restore(order);
        }
        let packer = split(state, self.packer.state().len())?;
        let receiver = split(state, inlet.receiver.state().len())?;
        if !self.packer.restore(packer) || !inlet.receiver.restore(receiver) {
            return None;
        }
        for (text, saturated) in self.texts.iter_mut().zip(self.packer.saturated()) {
            if *saturated > 0 {
                *text = None;
            }
        }
        let mut networks = self.networks.iter_mut();
        networks.try_for_each(|network| network.restore(state))
    }
}

/// Returns the least of both ages.
fn least(one: Option<u32>, other: Option<u32>) -> Option<u32> {
    match (one, other) {
        (Some(one), Some(other)) => Some(one.min(other)),
        (one, other) => one.or(other),
    }
}
