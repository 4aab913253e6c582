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

use crate::peer::Peer;
use crate::wire::Wire;

/// Part of the wait limit that a peer may use, so that the port names it before the plant gives up.
const SHARE: f64 = 0.8;

/// Longest wait, in s, where there is no limit.
const LONGEST_S: f64 = 1e6;
/// Time between two attempts to reach a peer that is not there yet.
const AGAIN: Duration = Duration::from_millis(20);

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
    open: Option<Open>,
    /// Values that go out: measured, then reference.
    values: Vec<f64>,
    invalid: SignalSet,
    step: u64,
    exchange: Exchange,
    limit: Duration,
    ledger: Ledger,
    supervision: Supervision,
}

struct Open {
    wire: Wire,
    peer: Option<Peer>,
}

impl PortLaw {
    fn start(
        port: &Port,
        run: Option<&Run>,
        period_s: f64,
        ledger: &Ledger,
    ) -> Result<Self, Invalid> {
        let limit_s = SHARE * run.map_or(1.0, |run| run.wait_limit_s);
        let limit = match limit_s < LONGEST_S {
            true => Duration::from_secs_f64(limit_s),
            false => Duration::from_secs_f64(LONGEST_S),
        };
        let open = match run {
            Some(run) => {
                let wire =
                    || Wire::open(port, Carries::Sample, period_s, &run.folder).map_err(Invalid);
                let peer = || {
                    Peer::start(&port.start, &run.folder, limit, &run.supervision).map_err(Invalid)
                };
                // A peer that says when it is ready may use the addresses of the port until then.
                let (wire, peer) = match port.start.ready {
                    Some(_) => {
                        let peer = peer()?;
                        (wire()?, peer)
                    }
                    None => (wire()?, peer()?),
                };
                Some(Open { wire, peer })
            }
            None => None,
        };
        Ok(Self {
            open,
            values: vec![0.0; port.table(Carries::Sample).len()],
            invalid: SignalSet::default(),
            step: 0,
            exchange: port.exchange,
            limit,
            ledger: Arc::clone(ledger),
            supervision: run.map_or_else(Supervision::default, |run| run.supervision.clone()),
        })
    }

    /// Sends the sample and receives the command.
    fn exchange(&mut self) -> Result<(), Failure> {
        let Some(Open { wire, peer }) = &mut self.open else {
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
        let mut resent = Instant::now();
        let until = resent + self.limit;
        loop {
            wire.receive().map_err(|error| in_words(&error))?;
            let Some(frame) = wire.awaited(step) else {
                return Ok(());
            };
            if self.supervision.wants_stop() {
                let name = wire.name(frame);
                return Err(Failure::lost(format!(
                    "stopped while frame `{name}` was awaited"
                )));
            }
            if let Some(end) = peer.as_mut().and_then(Peer::end) {
                // Its last frames may have arrived meanwhile.
                wire.receive().map_err(|error| in_words(&error))?;
                let Some(frame) = wire.awaited(step) else {
                    return Ok(());
                };
                let name = wire.name(frame);
                return Err(Failure::lost(format!(
                    "{end}, while frame `{name}` was awaited"
                )));
            }
            if resent.elapsed() >= AGAIN {
                wire.send_again(step).map_err(|error| in_words(&error))?;
                resent = Instant::now();
            }
            wire.wait(until.min(resent + AGAIN))
                .map_err(|error| in_words(&error))?;
            if Instant::now() >= until {
                return Err(Failure::lost(format!(
                    "no frame `{}` within {:.3} s from {}",
                    wire.name(frame),
                    self.limit.as_secs_f64(),
                    wire.places()
                )));
            }
        }
    }
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
        let Some(Open { wire, .. }) = &self.open else {
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
