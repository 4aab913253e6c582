//! Frames that have arrived: read from their media, unpacked and noted.

use hil_codec::row::FieldResult;
use hil_config::port::{Carries, MediumKind};

use super::refusals::{is_answer, is_no_frame, report, report_flood, report_note};
use super::{MOST_AT_ONCE, Wire, WireError, gone};
use crate::medium::Arrival;

impl Wire {
    /// Receives all frames that have arrived.
    ///
    /// # Errors
    /// If a medium is gone.
    pub fn receive(&mut self) -> Result<(), WireError> {
        self.read_media(None)
    }

    /// Receives the answers to the frames of a step. Frames behind the last answer of a medium stay there until the next
    /// step: they cannot take the place of the answer, nor make its signals invalid.
    ///
    /// # Errors
    /// If a medium is gone.
    pub fn receive_answers(&mut self, step: u64) -> Result<(), WireError> {
        self.read_media(Some(step))
    }

    fn read_media(&mut self, answered: Option<u64>) -> Result<(), WireError> {
        for index in 0..self.media.len() {
            let is_file = matches!(self.port.media[index].kind, MediumKind::File { .. });
            if is_file && self.media[index].frames.is_empty() {
                continue;
            }
            for number in 0..MOST_AT_ONCE {
                if number == MOST_AT_ONCE - 1 {
                    report_flood(&self.port, index, &mut self.is_flooded);
                }
                if answered.is_some_and(|step| self.is_answered(index, step)) {
                    break;
                }
                let result = self.media[index].medium.receive(&mut self.buffer);
                let Some(arrival) = result.map_err(|error| gone(&self.port, index, error))? else {
                    break;
                };
                self.accept(index, arrival);
            }
            let incoming = &mut self.media[index];
            for note in incoming.medium.take_notes() {
                report_note(&self.port, index, &incoming.frames, &note);
            }
        }
        Ok(())
    }

    /// Returns `true` if all frames have arrived on a medium that are awaited there, and nothing is left to send.
    fn is_answered(&self, medium: usize, step: u64) -> bool {
        let incoming = &self.media[medium];
        let mut frames = incoming.frames.iter();
        !incoming.frames.is_empty()
            && !frames.any(|frame| self.is_awaited(*frame, step))
            && incoming.medium.writable().is_none()
    }

    /// Unpacks a frame, which is in the buffer.
    fn accept(&mut self, medium: usize, arrival: Arrival) {
        self.read += 1;
        let incoming = &mut self.media[medium];
        let bytes = (&self.buffer[..arrival.length], arrival.size);
        let (place, result) = (incoming.receiver).receive(arrival.id, bytes.0, &mut self.row);
        let frame = place.map(|place| incoming.frames[place]);
        match (result, frame.zip(place)) {
            (Ok(()), Some((frame, place))) => {
                self.has_arrived[frame] = true;
                let refused = incoming.receiver.counts(place).refused_fields;
                if refused > self.refused_fields[frame] {
                    self.refused_fields[frame] = refused;
                    let results = self.row.results();
                    let columns = incoming.receiver.columns(place).iter();
                    for result in columns.map(|column| results[*column]) {
                        if let FieldResult::Refused(refusal) = result {
                            let of = (medium, Some(frame));
                            report(&mut self.printed, &self.port, of, &refusal, bytes);
                        }
                    }
                }
            }
            (Err(refusal), _) => {
                // A plant whose frames all jump is lost, however many there are.
                if let Some(frame) = frame
                    && self.port.frames[frame].carries == Carries::Command
                    && is_answer(&refusal)
                {
                    self.has_arrived[frame] = true;
                }
                if is_no_frame(&refusal) {
                    incoming.medium.reject();
                }
                let of = (medium, frame.or(incoming.frames.first().copied()));
                report(&mut self.printed, &self.port, of, &refusal, bytes);
            }
            (Ok(()), None) => {}
        }
    }
}
