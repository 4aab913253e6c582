//! Before the first step: agreement with a controller on the content of the frames.

use hil_config::plan::{cut_fields, driven};
use shared_types::describe::Invalid;
use shared_types::hello::{Control, Welcome};
use shared_types::link::{FrameSpec, Link, LinkError};
use shared_types::lockstep::{AbortCode, PlantAction};
use shared_types::record::{Outcome, RecordLayout};
use shared_types::stream::RecordSink;

use super::{Engine, Plant, Progress};
use crate::repeat::Repetition;
use crate::rows::Rows;
use crate::tuning::Offered;

impl<L: Link, S: RecordSink> Engine<L, S> {
    /// Agrees with a controller on the content of the frames, before the first step.
    pub(super) fn greet(&mut self) -> Result<Progress, LinkError> {
        let Some(message) = self.hear()? else {
            return Ok(Progress::Controller);
        };
        let before = self.side.standing();
        match self.take_message(&message, 1) {
            PlantAction::Welcome(welcome) => {
                if let Control::Hello(hello) = message {
                    self.plant.tuning.offer(Offered {
                        epoch: 1,
                        law: hello.law,
                        parameters: hello.tunable,
                    });
                }
                self.welcome(*welcome)?;
            }
            PlantAction::Refuse(reason) => {
                let refusal = Control::Refusal {
                    reason: reason.clone(),
                };
                self.link.send_message(refusal)?;
                self.finish(
                    Outcome::Failed,
                    Some(format!("refused the controller: {reason}")),
                )?;
            }
            action => self.react(&action)?,
        }
        Ok(if self.side.standing() == before {
            Progress::Controller
        } else {
            Progress::Busy
        })
    }

    fn welcome(&mut self, welcome: Welcome) -> Result<(), LinkError> {
        let Plant {
            description,
            reference,
            ..
        } = &self.plant;
        let [sensor, actuator] = self.job.tap_fields(description);
        let layout = RecordLayout {
            sensor,
            actuator,
            cut: cut_fields(&description.commands, &self.job.probes),
            ..RecordLayout::of(description, reference.clone(), &welcome.command)
                .with_inputs(driven(&self.job.stimuli))
        };
        self.link.open_frames(&FrameSpec {
            identity: welcome.frame_identity(),
            outgoing: welcome.sample.len(),
            incoming: welcome.command.len(),
        })?;
        self.publisher.sink.open(&layout)?;
        self.queue.opened(&layout);
        let opened = self.plant.faults.open(&self.plant.builder, &layout);
        self.rows = Rows::new(layout, &welcome);
        let opened = opened.and_then(|()| self.restore());
        let missed = std::mem::take(&mut self.job.missed);
        self.commands.repetition =
            (!missed.is_empty()).then(|| Repetition::new(missed, welcome.command.len()));
        self.plant.faults.faultable(&mut self.rows.parameter);
        self.link
            .send_message(Control::Welcome(Box::new(welcome)))?;
        match opened {
            Ok(()) => Ok(()),
            Err(invalid) => self.give_up(Outcome::Failed, AbortCode::Other, invalid.to_string()),
        }
    }

    /// Restores the state to resume from; the model was restored at the start.
    fn restore(&mut self) -> Result<(), Invalid> {
        let Some(saved) = self.saved.take() else {
            return Ok(());
        };
        let instruments = self.plant.faults.restore_bus(&saved.instruments)?;
        self.plant.instruments.restore(instruments)?;
        self.plant.faults.restore(saved.faults)?;
        (self.plant.tuning).restore(saved.tuning, self.first);
        self.rows.restore_record(&saved.record)
    }
}
