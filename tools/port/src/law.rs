//! The far end of a port as a control law: a sample goes out, a command comes in.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use controller_process::controller::{Answer, Law, LawKind, Row, SetupRows};
use hil_config::port::counts::Counts;
use hil_config::port::{Carries, Exchange, Port};
use hil_session::supervision::Supervision;
use shared_types::describe::{Invalid, LawDescription};
use shared_types::failure::Failure;
use shared_types::layout::SignalKind;
use shared_types::quality::{Quality, SignalSet};

use crate::far_end::{FarEnd, Opening};
use crate::peer::{Peer, longest_wait};
use crate::wire::Wire;

/// Time between two attempts to reach a peer that is not there yet.
const AGAIN: Duration = Duration::from_millis(20);
/// Time after which the first sample is sent once more if nothing has answered, because a peer that starts later than
/// the port may not have seen it.
const RESEND: Duration = Duration::from_millis(250);

/// Facts of the run that a law is in. Without them nothing is opened, as for `--check`.
#[derive(Clone, Debug)]
pub struct Run {
    /// Folder of the port file.
    pub folder: PathBuf,
    /// Time that the other side of the run may take, in s.
    pub wait_limit_s: f64,
    /// Requests of the launcher, which may end a wait.
    pub supervision: Supervision,
}

/// Place of the counts at the end of a run; empty if the port was not opened.
pub type Ledger = Arc<Mutex<Option<Counts>>>;

/// Creates the law of a port; the run is set before the law starts.
///
/// # Errors
/// If its signals do not form valid tables.
pub fn law(
    port: &Arc<Port>,
    run: &Arc<OnceLock<Run>>,
    ledger: &Ledger,
) -> Result<LawKind, Invalid> {
    let (port, run, ledger) = (Arc::clone(port), Arc::clone(run), Arc::clone(ledger));
    LawKind::from_tables(description(&port), move |setup: &SetupRows<'_>| {
        Ok(Box::new(PortLaw::start(
            &port,
            run.get(),
            setup.period_s,
            &ledger,
        )?))
    })
}

/// Builds the tables of a port as a law.
#[must_use]
pub fn description(port: &Port) -> LawDescription {
    let sample = port.table(Carries::Sample);
    LawDescription {
        name: port.name.clone(),
        summary: match port.description.as_str() {
            "" => "The far end of a port.".into(),
            text => format!("{text} (port)"),
        },
        plants: Vec::new(),
        parameters: Vec::new(),
        model: Vec::new(),
        measured: sample.fields(SignalKind::Measured),
        reference: sample.fields(SignalKind::Reference),
        commands: Some(port.table(Carries::Command).fields(SignalKind::Command)),
        internals: Vec::new(),
        saves: false,
        state: None,
        tuning: String::new(),
    }
}

/// Law at the far end of a port.
struct PortLaw {
    open: Option<FarEnd>,
    /// Values that go out: measured, then reference.
    values: Vec<f64>,
    invalid: SignalSet,
    step: u64,
    exchange: Exchange,
    limit: Duration,
    /// Time that the wait for a ready peer took, by which the wait for its first answer is shorter.
    readiness: Duration,
    /// `true` if frames of the first sample may be lost before the peer listens: nothing has said that it is ready, and
    /// nothing has answered.
    is_unheard: bool,
    ledger: Ledger,
    supervision: Supervision,
}

impl PortLaw {
    fn start(
        port: &Port,
        run: Option<&Run>,
        period_s: f64,
        ledger: &Ledger,
    ) -> Result<Self, Invalid> {
        let wait_limit_s = run.map_or(1.0, |run| run.wait_limit_s);
        let begin = Instant::now();
        let open = match run {
            Some(run) => {
                let (folder, supervision) = (&*run.folder, &run.supervision);
                let opening = Opening {
                    folder,
                    wait_limit_s,
                    supervision,
                };
                Some(FarEnd::open(port, Carries::Sample, period_s, &opening).map_err(Invalid)?)
            }
            None => None,
        };
        Ok(Self {
            open,
            values: vec![0.0; port.table(Carries::Sample).len()],
            invalid: SignalSet::default(),
            step: 0,
            exchange: port.exchange,
            limit: longest_wait(wait_limit_s),
            readiness: match port.start.ready {
                Some(_) => begin.elapsed(),
                None => Duration::ZERO,
            },
            is_unheard: port.start.ready.is_none(),
            ledger: Arc::clone(ledger),
            supervision: run.map_or_else(Supervision::default, |run| run.supervision.clone()),
        })
    }

    /// Sends the sample and receives the command.
    fn exchange(&mut self) -> Result<(), Failure> {
        let Some(FarEnd { wire, peer }) = &mut self.open else {
            return Err(Failure::lost("the port is not open"));
        };
        let in_words = |error: &dyn std::fmt::Display| Failure::lost(error.to_string());
        let step = self.step;
        self.step += 1;
        wire.send(step, &self.values, &self.invalid)
            .map_err(|error| in_words(&error))?;
        if self.exchange == Exchange::Free {
            wire.receive().map_err(|error| in_words(&error))?;
            return match peer.as_mut().and_then(Peer::end) {
                Some(end) => Err(Failure::lost(end)),
                None => Ok(()),
            };
        }
        let (begin, before) = (Instant::now(), wire.traffic());
        let limit = match step {
            0 => self.limit.saturating_sub(self.readiness),
            _ => self.limit,
        };
        let until = begin + limit;
        let (mut tried, mut resent, mut is_resent) = (begin, begin, false);
        loop {
            wire.receive_answers(step)
                .map_err(|error| in_words(&error))?;
            let Some(frame) = wire.awaited(step) else {
                break;
            };
            if self.supervision.wants_stop() {
                let name = wire.name(frame);
                return Err(Failure::lost(format!(
                    "stopped while frame `{name}` was awaited"
                )));
            }
            if let Some(end) = peer.as_mut().and_then(Peer::end) {
                // Its last frames may have arrived meanwhile.
                wire.receive_answers(step)
                    .map_err(|error| in_words(&error))?;
                let Some(frame) = wire.awaited(step) else {
                    return Ok(());
                };
                let name = wire.name(frame);
                return Err(Failure::lost(format!(
                    "{end}, while frame `{name}` was awaited"
                )));
            }
            if tried.elapsed() >= AGAIN {
                wire.send_again(step).map_err(|error| in_words(&error))?;
                tried = Instant::now();
            }
            if self.is_unheard && resent.elapsed() >= RESEND {
                is_resent |= wire.resend(step).map_err(|error| in_words(&error))?;
                resent = Instant::now();
            }
            wire.wait(until.min(tried + AGAIN))
                .map_err(|error| in_words(&error))?;
            if Instant::now() >= until {
                return Err(Failure::lost(format!(
                    "no frame `{}` within {:.3} s from {}{}",
                    wire.name(frame),
                    limit.as_secs_f64(),
                    wire.places(),
                    wire.others(before, begin.elapsed())
                )));
            }
        }
        self.is_unheard = false;
        match is_resent {
            true => settle(wire, until).map_err(|error| in_words(&error)),
            false => Ok(()),
        }
    }
}

/// Waits until nothing more arrives. The peer may have got several of the samples that were sent once more, and an answer
/// to one of them would be taken for that of the next step.
fn settle(wire: &mut Wire, until: Instant) -> Result<(), Box<dyn std::error::Error>> {
    let (mut quiet, mut arrivals) = (Instant::now(), wire.arrivals());
    while quiet.elapsed() < RESEND && Instant::now() < until {
        wire.wait(until.min(quiet + RESEND))?;
        wire.receive()?;
        if wire.arrivals() != arrivals {
            (quiet, arrivals) = (Instant::now(), wire.arrivals());
        }
    }
    Ok(())
}

impl Law for PortLaw {
    fn step(
        &mut self,
        sample: &Row<'_>,
        command: &mut [f64],
        internals: &mut [f64],
    ) -> Result<(), Failure> {
        let mut held = SignalSet::default();
        let none = SignalSet::default();
        let ages = vec![0; sample.measured.len()];
        let quality = Quality {
            measured: &none,
            reference: &none,
            age_steps: &ages,
        };
        let answer = Answer {
            command,
            internals,
            held: &mut held,
        };
        self.answer(sample, &quality, answer)
    }

    fn answer(
        &mut self,
        sample: &Row<'_>,
        quality: &Quality<'_>,
        answer: Answer<'_>,
    ) -> Result<(), Failure> {
        let (measured, reference) = self.values.split_at_mut(sample.measured.len());
        measured.copy_from_slice(sample.measured);
        reference.copy_from_slice(sample.reference);
        self.invalid.clear();
        let first = sample.measured.len();
        for index in quality.measured.iter(first) {
            self.invalid.insert(index);
        }
        for index in quality.reference.iter(sample.reference.len()) {
            self.invalid.insert(first + index);
        }
        self.exchange()?;
        let Some(FarEnd { wire, .. }) = &self.open else {
            return Ok(());
        };
        let row = wire.row();
        answer.command.copy_from_slice(row.values());
        for column in 0..row.values().len() {
            if !row.is_valid(column) {
                answer.held.insert(column);
            }
        }
        Ok(())
    }
}

impl Drop for PortLaw {
    fn drop(&mut self) {
        if let Some(open) = &self.open {
            *self.ledger.lock().unwrap_or_else(PoisonError::into_inner) = Some(open.wire.counts());
        }
    }
}
