//! Numbers of the current step, and the record built from them.
//!
//! Owned by the engine; all memory is allocated once, at hello.

use shared_types::describe::{Invalid, Settings};
use shared_types::frame::{Header, VALIDITY_WORDS};
use shared_types::hello::Welcome;
use shared_types::layout::{Signal, SignalKind, SignalTable};
use shared_types::quality::SignalSet;
use shared_types::record::{GROUPS, RecordLayout, Timing, Validity};
use shared_types::table::canonical;
use shared_types::time::Step;
use shared_types::zerocopy::IntoBytes;

/// Index of the group of sensor readings in a record.
const SENSED: usize = index_of_sensed();

const fn index_of_sensed() -> usize {
    let mut index = 0;
    while !matches!(GROUPS[index].as_bytes(), b"sensed") {
        index += 1;
    }
    index
}

/// Rows for the tables agreed on by a plant and a controller.
#[derive(Debug, Default)]
pub struct Rows {
    /// Measured signals, followed by reference signals.
    pub sample: Vec<f64>,
    /// Sensor readings, before faults.
    pub sensed: Vec<f64>,
    /// Reference signals, then inputs of the plant, before changes and faults; computed one step ahead.
    pub stimulus: Vec<f64>,
    /// Step of the computed reference signals.
    pub stimulus_of: Option<Step>,
    /// Reference signals of the sample sent last, then inputs of the plant, before faults.
    pub sent_stimulus: Vec<f64>,
    /// Inputs of the plant that the scenario drives, as applied.
    pub input: Vec<f64>,
    /// Effective values of the plant's faultable parameters.
    pub parameter: Vec<f64>,
    /// Recorded inputs of sensors and of their stages.
    pub sensor: Vec<f64>,
    /// Recorded inputs of actuators and of their stages.
    pub actuator: Vec<f64>,
    /// Inputs, then outputs of the probes.
    pub cut: Vec<f64>,
    /// Invalid signals of the sample sent last.
    pub invalid: SignalSet,
    /// Latest accepted frame of the controller: its commands, then its internals.
    pub frame: Vec<f64>,
    /// The plant's commands as sent.
    pub command: Vec<f64>,
    /// Invalid ones among the plant's commands, first as sent and then as received by the plant.
    pub command_invalid: SignalSet,
    /// The plant's commands as applied.
    pub applied: Vec<f64>,
    /// True state.
    pub truth: Vec<f64>,
    /// Last record.
    pub record: Vec<u64>,
    layout: RecordLayout,
    validity: Validity,
    /// Values of the last record, with invalid values replaced by NaN; empty if there are none.
    known: Vec<f64>,
    /// Signals of the frame, as agreed with the first controller.
    table: SignalTable,
    /// Index of each of the plant's commands in `frame`.
    commands: Vec<usize>,
    /// Index of the first internal in `frame`.
    internals: usize,
    /// Latest frame of the active controller, accepted or not.
    received: Vec<f64>,
    /// Index in the received frame of each signal that the frame contains; `None` if all indices are unchanged.
    places: Option<Vec<Option<usize>>>,
}

/// Returns a frame before the first command: the start values of the commands that declare one, else 0.
fn starts(table: &SignalTable) -> Vec<f64> {
    let starts = { table.0.iter() }.map(|signal| signal.field.default.unwrap_or(0.0));
    starts.collect()
}

impl Rows {
    /// Creates the rows for the agreed tables, of a plant whose records have this layout.
    #[must_use]
    pub fn new(layout: RecordLayout, welcome: &Welcome) -> Self {
        let bound = welcome.command.bind(SignalKind::Command, &layout.command);
        Self {
            sample: vec![0.0; welcome.sample.len()],
            sensed: vec![0.0; layout.measured.len()],
            stimulus: vec![0.0; layout.reference.len() + layout.input.len()],
            stimulus_of: None,
            sent_stimulus: vec![0.0; layout.reference.len() + layout.input.len()],
            input: vec![0.0; layout.input.len()],
            parameter: vec![0.0; layout.parameter.len()],
            sensor: vec![0.0; layout.sensor.len()],
            actuator: vec![0.0; layout.actuator.len()],
            cut: vec![0.0; layout.cut.len()],
            invalid: SignalSet::EMPTY,
            frame: starts(&welcome.command),
            command: vec![0.0; layout.command.len()],
            command_invalid: SignalSet::EMPTY,
            applied: vec![0.0; layout.command.len()],
            truth: vec![0.0; layout.truth.len()],
            record: vec![0; layout.words()],
            // The welcome exists only because they bind.
            commands: bound.unwrap_or_default(),
            internals: welcome.command.len() - layout.internal.len(),
            table: welcome.command.clone(),
            received: vec![0.0; welcome.command.len()],
            places: None,
            validity: layout.validity(),
            known: vec![0.0; layout.values()],
            layout,
        }
    }

    /// Switches to the commands of another controller. Internals are matched by name and unit; missing ones become NaN,
    /// marked invalid.
    pub fn rebind(&mut self, welcome: &Welcome) {
        let place = |signal: &Signal| {
            let bound = (welcome.command).bind(signal.kind, std::slice::from_ref(&signal.field));
            bound.ok().and_then(|places| places.first().copied())
        };
        self.received = vec![0.0; welcome.command.len()];
        self.places =
            (welcome.command != self.table).then(|| self.table.0.iter().map(place).collect());
    }

    /// Returns the buffer for received frames of the active controller.
    pub fn receiver(&mut self) -> &mut [f64] {
        &mut self.received
    }

    /// Accepts the received frame and adapts its header.
    pub fn take_frame(&mut self, header: &mut Header) {
        let Some(places) = &self.places else {
            std::mem::swap(&mut self.frame, &mut self.received);
            return;
        };
        let mut invalid = [0; VALIDITY_WORDS];
        for (index, place) in places.iter().enumerate() {
            let (value, is_valid) = received(&self.received, header, *place);
            self.frame[index] = value;
            invalid[index / 64] |= u64::from(!is_valid) << (index % 64);
        }
        header.invalid = invalid;
    }

    /// Returns `true` if the frame received with `header` differs from the accepted frame with the header `accepted`.
    pub fn differs(&self, header: &Header, accepted: &Header) -> bool {
        let differs = |(index, value): (usize, &f64)| {
            let place = (self.places.as_ref()).map_or(Some(index), |places| places[index]);
            let (other, is_valid) = received(&self.received, header, place);
            other.to_bits() != value.to_bits() || is_valid != accepted.is_valid(index)
        };
        header.age_steps != accepted.age_steps || self.frame.iter().enumerate().any(differs)
    }

    /// Fills the frame with these settings of the plant's commands, and all other values with NaN. Returns the matching
    /// invalid bits.
    pub fn fill_frame(&mut self, settings: &Settings) -> [u64; VALIDITY_WORDS] {
        self.frame.fill(f64::NAN);
        let mut invalid = [0; VALIDITY_WORDS];
        for index in 0..self.frame.len() {
            invalid[index / 64] |= 1 << (index % 64);
        }
        for (field, place) in self.layout.command.iter().zip(&self.commands) {
            self.frame[*place] = settings.get(&field.name).unwrap_or(0.0);
            invalid[place / 64] &= !(1 << (place % 64));
        }
        invalid
    }

    /// Restores the last record of a resumed run.
    ///
    /// # Errors
    /// If the record does not have this layout.
    pub fn restore_record(&mut self, record: &[u64]) -> Result<(), Invalid> {
        if record.len() != self.record.len() {
            let (theirs, ours) = (record.len(), self.record.len());
            return Err(Invalid(format!(
                "records had {theirs} words when the state was saved, but have {ours} now"
            )));
        }
        self.record.copy_from_slice(record);
        Ok(())
    }

    /// Replaces readings that are marked invalid by those of the last record, which hold the last valid ones; 0 before
    /// the first step.
    pub fn hold_readings(&mut self) {
        let groups = self.layout.groups().map(<[_]>::len);
        let before_sensed: usize = groups[..SENSED].iter().sum();
        let last = &self.layout.view(&self.record).values[before_sensed..];
        for index in self.invalid.iter(self.sensed.len()) {
            self.sensed[index] = last[index];
        }
    }

    /// Returns all signals of the record before a step, NaN where marked invalid; `None` at step 0.
    pub fn last_values(&mut self, step: Step) -> Option<&[f64]> {
        if step.0 == 0 {
            return None;
        }
        let values = self.layout.view(&self.record).values;
        let mut invalid = self.validity.invalid(&self.record).peekable();
        if invalid.peek().is_none() {
            return Some(values);
        }
        self.known.copy_from_slice(values);
        invalid.for_each(|place| self.known[place] = f64::NAN);
        Some(&self.known)
    }

    /// Extracts the plant's commands from the frame, and their invalid bits from its header.
    pub fn take_command(&mut self, header: &Header) {
        self.command_invalid.clear();
        let invalid = self.command_invalid.words_mut();
        for (index, place) in self.commands.iter().enumerate() {
            self.command[index] = self.frame[*place];
            invalid[index / 64] |= u64::from(!header.is_valid(*place)) << (index % 64);
        }
    }

    /// Writes the record of a step that a command answered.
    pub fn write_record(&mut self, step: Step, header: &Header, timing: &Timing) {
        let mut words = Words(&mut self.record);
        words.put(&[step.0]);
        words.put(&self.invalid.words()[..self.layout.sample_validity_words()]);
        let mut invalid = header.invalid;
        for (index, place) in self.commands.iter().enumerate() {
            let is_invalid = u64::from(self.command_invalid.contains(index));
            let (word, bit) = (&mut invalid[place / 64], place % 64);
            *word = *word & !(1 << bit) | is_invalid << bit;
        }
        words.put(&invalid[..self.layout.command_validity_words()]);
        words.values(&self.truth);
        words.values(&self.sample);
        words.values(&self.command);
        words.values(&self.applied);
        words.values(&self.frame[self.internals..]);
        words.values(&self.input);
        words.values(&self.sensed);
        words.values(&self.sent_stimulus[..self.layout.reference.len()]);
        words.values(&self.parameter);
        words.values(&self.sensor);
        words.values(&self.actuator);
        words.values(&self.cut);
        words.timing(timing);
    }

    /// Writes the record after the last step: the command is missing, and its values are NaN marked as invalid.
    pub fn write_final_record(&mut self, step: Step, timing: &Timing) {
        let mut words = Words(&mut self.record);
        words.put(&[step.0]);
        words.put(&self.invalid.words()[..self.layout.sample_validity_words()]);
        words.fill(u64::MAX, self.layout.command_validity_words());
        words.values(&self.truth);
        words.values(&self.sample);
        let unanswered = 2 * self.layout.command.len() + self.layout.internal.len();
        words.fill(f64::NAN.to_bits(), unanswered);
        words.values(&self.input);
        words.values(&self.sensed);
        words.values(&self.sent_stimulus[..self.layout.reference.len()]);
        words.values(&self.parameter);
        words.values(&self.sensor);
        words.fill(f64::NAN.to_bits(), self.actuator.len() + self.cut.len());
        words.timing(timing);
    }
}

/// Returns the value of a signal at this index, if any, and its validity.
fn received(values: &[f64], header: &Header, place: Option<usize>) -> (f64, bool) {
    place.map_or((f64::NAN, false), |place| {
        (values[place], header.is_valid(place))
    })
}

/// Part of a record that is still to be written.
struct Words<'a>(&'a mut [u64]);

impl<'a> Words<'a> {
    /// Returns the next `count` words for writing.
    fn next(&mut self, count: usize) -> &'a mut [u64] {
        let (next, rest) = std::mem::take(&mut self.0).split_at_mut(count);
        self.0 = rest;
        next
    }

    fn put(&mut self, words: &[u64]) {
        self.next(words.len()).copy_from_slice(words);
    }

    fn fill(&mut self, word: u64, count: usize) {
        self.next(count).fill(word);
    }

    fn values(&mut self, values: &[f64]) {
        for (word, value) in self.next(values.len()).iter_mut().zip(values) {
            *word = canonical(*value).to_bits();
        }
    }

    fn timing(&mut self, timing: &Timing) {
        self.next(Timing::WORDS)
            .as_mut_bytes()
            .copy_from_slice(timing.as_bytes());
    }
}

#[cfg(test)]
mod tests {
    use shared_types::frame::FrameKind;
    use shared_types::hello::{Hello, Offer, agree};
    use shared_types::table::Field;
    use shared_types::time::Rate;

    use super::*;

    fn field(name: &str) -> Field {
        Field::signal(name, "m", "x")
    }

    fn welcome(epoch: u32, commands: &[&str], internals: &[&str]) -> Welcome {
        let fields = |names: &[&str]| names.iter().map(|name| field(name)).collect();
        let hello = Hello {
            commands: Some(fields(commands)),
            internals: fields(internals),
            ..Hello::new(5, "any")
        };
        let offer = Offer {
            session: 5,
            epoch,
            rate: Rate::new(10.0).expect("legal"),
            steps: 3,
            first: Step(0),
            against_clock: false,
            measured: &[],
            reference: &[],
            commands: &[field("drive_m")],
        };
        agree(&hello, &offer).expect("agreed")
    }

    fn rows() -> Rows {
        let first = welcome(1, &["spare_m", "drive_m"], &["error_m", "sum_m"]);
        let layout = RecordLayout {
            command: vec![field("drive_m")],
            internal: first.command.fields(SignalKind::Internal),
            command_signals: first.command.len(),
            ..RecordLayout::default()
        };
        Rows::new(layout, &first)
    }

    #[test]
    fn signals_of_another_controller_are_matched_by_name() {
        let mut rows = rows();
        rows.rebind(&welcome(2, &["drive_m"], &["other_m", "error_m"]));
        rows.receiver().copy_from_slice(&[1.0, 2.0, 3.0]);
        let mut header = Header::new(FrameKind::Command, Step(0));
        header.invalid[0] = 0b100; // its error_m
        rows.take_frame(&mut header);
        // spare_m, drive_m, error_m, sum_m as the first controller sent them.
        assert!(rows.frame[0].is_nan() && rows.frame[3].is_nan());
        assert_eq!(rows.frame[1..3], [1.0, 3.0]);
        assert_eq!(header.invalid[0], 0b1101);
        rows.take_command(&header);
        assert_eq!(
            (rows.command[0], rows.command_invalid),
            (1.0, SignalSet::EMPTY)
        );
    }

    #[test]
    fn the_same_signals_need_no_translation() {
        let mut rows = rows();
        rows.rebind(&welcome(2, &["spare_m", "drive_m"], &["error_m", "sum_m"]));
        rows.receiver().copy_from_slice(&[1.0, 2.0, 3.0, 4.0]);
        let header = Header::new(FrameKind::Command, Step(0));
        let mut accepted = header;
        rows.take_frame(&mut accepted);
        assert_eq!(accepted, header);
        assert_eq!(rows.frame, [1.0, 2.0, 3.0, 4.0]);
    }

    #[test]
    fn a_received_frame_can_be_compared_without_being_accepted() {
        for rebound in [false, true] {
            let mut rows = rows();
            if rebound {
                rows.rebind(&welcome(2, &["drive_m", "spare_m"], &["sum_m", "error_m"]));
            }
            let header = Header::new(FrameKind::Command, Step(0));
            rows.receiver().copy_from_slice(&[1.0, 2.0, 3.0, 4.0]);
            let mut accepted = header;
            rows.take_frame(&mut accepted);
            let frame = rows.frame.clone();
            rows.receiver().copy_from_slice(&[1.0, 2.0, 3.0, 4.0]);
            assert!(!rows.differs(&header, &accepted));
            let mut invalid = header;
            invalid.invalid[0] = 0b1000;
            assert!(rows.differs(&invalid, &accepted));
            let older = Header {
                age_steps: 1,
                ..header
            };
            assert!(rows.differs(&older, &accepted));
            rows.receiver()[3] = 4.5;
            assert!(rows.differs(&header, &accepted));
            assert_eq!(rows.frame, frame);
        }
    }

    #[test]
    fn a_frame_of_set_commands_has_nothing_else_that_is_valid() {
        let mut rows = rows();
        let mut safe = Settings::default();
        safe.set("drive_m", -0.5);
        assert_eq!(rows.fill_frame(&safe)[0], 0b1101);
        assert_eq!(rows.frame[1], -0.5);
        assert!(rows.frame[2].is_nan());
        rows.fill_frame(&Settings::default());
        assert_eq!(rows.frame[1], 0.0, "a command that is not set is 0");
    }
}
