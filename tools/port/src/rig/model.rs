//! A port as a plant: commands out, newest valid frames in.
//!
//! No method blocks, but for [`Rig::await_peer`] before the first step.

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use hil_config::port::counts::Counts;
use hil_config::port::{Carries, Port};
use hil_session::program::say;
use plant_process::plant::Model;
use shared_types::describe::Invalid;
use shared_types::failure::Failure;
use shared_types::quality::SignalSet;
use shared_types::time::Interval;

use super::description::aged;
use crate::far_end::{FarEnd, Opening};
use crate::keeper::Keeper;
use crate::peer::{Peer, longest_wait};
use crate::wire::{self, Wire};

/// Opened port in front of a plant.
pub struct Rig {
    port: Arc<Port>,
    far_end: FarEnd,
    keeper: Keeper,
    /// Column of each signal whose age is a measured signal.
    ages: Vec<usize>,
    /// Safe value of each command.
    safe: Vec<f64>,
    /// Longest silence of the far end.
    limit: Duration,
    /// Time at which the last accepted frame was received.
    heard: Instant,
    /// Traffic until then.
    traffic: u64,
}

impl Rig {
    /// Opens the far end of a port file and starts the keeper.
    ///
    /// # Errors
    /// If a medium or the watchdog cannot be opened, or the keeper or the far end cannot be started.
    pub fn open(
        port: &Arc<Port>,
        path: &Path,
        period_s: f64,
        opening: &Opening<'_>,
    ) -> Result<Self, String> {
        let safe = port.safe_row()?;
        let far_end = FarEnd::open(port, Carries::Command, period_s, opening)?;
        let sample = port.table(Carries::Sample);
        let column = |name: &str| sample.0.iter().position(|one| one.field.name == name);
        Ok(Self {
            // The last, as only an orderly end disarms the watchdog.
            keeper: Keeper::start(path, &far_end.wire)?,
            far_end,
            ages: aged(port).filter_map(column).collect(),
            safe,
            port: Arc::clone(port),
            limit: longest_wait(opening.wait_limit_s),
            heard: Instant::now(),
            traffic: 0,
        })
    }

    /// Sends the safe values until the far end has sent a frame: some answer only.
    ///
    /// # Errors
    /// If the far end is silent for the limit, its program ends, or a stop is requested.
    pub fn await_peer(&mut self, wants_stop: &dyn Fn() -> bool) -> Result<(), String> {
        let period = Duration::from_secs_f64(self.port.safety.period_s);
        self.heard = Instant::now();
        self.far_end.wire.begin();
        loop {
            self.send_safe()?;
            let until = Instant::now() + period;
            while Instant::now() < until {
                let wire = &mut self.far_end.wire;
                wire.wait(until).map_err(|error| error.to_string())?;
                wire.receive().map_err(|error| error.to_string())?;
                if wire.has_heard() {
                    self.note_heard();
                    return self.follow();
                }
            }
            if wants_stop() {
                return Err("stopped before the far end sent a frame".into());
            }
            self.check_far_end()?;
        }
    }

    /// Notes that a frame was accepted.
    fn note_heard(&mut self) {
        (self.heard, self.traffic) = (Instant::now(), self.far_end.wire.traffic());
    }

    /// Checks that the far end is there.
    fn check_far_end(&mut self) -> Result<(), String> {
        if let Some(end) = self.far_end.peer.as_mut().and_then(Peer::end) {
            return Err(end);
        }
        if self.heard.elapsed() <= self.limit {
            return Ok(());
        }
        Err(format!(
            "the far end of port `{}` sent no valid frame for {:.3} s: {}{}",
            self.port.name,
            self.limit.as_secs_f64(),
            self.far_end.wire.places(),
            self.far_end.wire.others(self.traffic, self.heard.elapsed())
        ))
    }

    /// Receives what has arrived and writes the measured row.
    fn read(&mut self, measured: &mut [f64], invalid: &mut SignalSet) -> Result<(), String> {
        let wire = &mut self.far_end.wire;
        wire.begin();
        wire.receive().map_err(|error| error.to_string())?;
        if wire.has_heard() {
            self.note_heard();
        }
        self.check_far_end()?;
        let row = self.far_end.wire.row();
        let (values, ages) = measured.split_at_mut(row.values().len());
        values.copy_from_slice(row.values());
        for (age, column) in ages.iter_mut().zip(&self.ages) {
            *age = f64::from(row.ages()[*column]);
        }
        for column in row.invalid().iter(values.len()) {
            invalid.insert(column);
        }
        Ok(())
    }

    /// Sends the command of a step.
    fn send(&mut self, step: u64, command: &[f64]) -> Result<(), String> {
        if self.keeper.is_gone() {
            send_safe_frames(&mut self.far_end.wire, &self.port, &self.safe);
            return Err(
                "the keeper of the safe values ended; the port has sent them and ends the run"
                    .into(),
            );
        }
        let wire = &mut self.far_end.wire;
        wire.transmit(step, command, &SignalSet::EMPTY)
            .map_err(|error| error.to_string())?;
        self.follow()
    }

    fn send_safe(&mut self) -> Result<(), String> {
        let wire = &mut self.far_end.wire;
        wire.transmit(0, &self.safe, &SignalSet::EMPTY)
            .map_err(|error| error.to_string())?;
        self.follow()
    }

    fn follow(&mut self) -> Result<(), String> {
        self.keeper.follow(&self.far_end.wire)
    }

    /// Ends the port in order: the keeper sends the safe values, or else the port, then the started program is ended.
    /// Returns the counts.
    pub fn end(mut self) -> Counts {
        let safety = &self.port.safety;
        let pauses = safety.repeats.saturating_sub(1);
        let frames = Duration::from_secs_f64(safety.period_s * f64::from(pauses));
        if let Err(error) = self.keeper.end(frames) {
            send_safe_frames(&mut self.far_end.wire, &self.port, &self.safe);
            say(&format!(
                "{error}; the port has sent the safe values itself, and a watchdog stays armed"
            ));
        }
        Counts {
            // Hardware keeps a clock of its own.
            repeatable: false,
            ..self.far_end.wire.counts()
        }
    }
}

/// Sends the safe values as often as the keeper would, which is gone.
fn send_safe_frames(wire: &mut Wire, port: &Port, safe: &[f64]) {
    for _ in 0..port.safety.repeats {
        // A medium that is gone is no reason to give up the others.
        let _ = wire.transmit(0, safe, &SignalSet::EMPTY);
        std::thread::sleep(Duration::from_secs_f64(port.safety.period_s));
    }
}

/// Port that is open while a run lasts, and closed while a job is checked.
pub type Shared = Arc<Mutex<Option<Rig>>>;

/// Locks the port, also after a panic.
pub(super) fn lock(rig: &Shared) -> MutexGuard<'_, Option<Rig>> {
    rig.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A port as a plant.
pub struct RigModel {
    port: Arc<Port>,
    rig: Shared,
}

impl RigModel {
    /// Creates the plant of a port that is opened elsewhere.
    #[must_use]
    pub const fn new(port: Arc<Port>, rig: Shared) -> Self {
        Self { port, rig }
    }

    fn with_rig(&self, work: impl FnOnce(&mut Rig) -> Result<(), String>) -> Result<(), Failure> {
        let mut rig = lock(&self.rig);
        let rig = rig.as_mut();
        let rig = rig.ok_or_else(|| Failure::lost("the port is closed"))?;
        work(rig).map_err(Failure::lost)
    }
}

impl Model for RigModel {
    fn retune(&mut self, _: &[f64]) -> Result<(), Failure> {
        Ok(())
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<(), Failure> {
        self.read(measured, &mut SignalSet::default())
    }

    fn read(&mut self, measured: &mut [f64], invalid: &mut SignalSet) -> Result<(), Failure> {
        self.with_rig(|rig| rig.read(measured, invalid))
    }

    fn truth(&mut self, _: f64, _: &[f64], _: &mut [f64]) -> Result<(), Failure> {
        Ok(())
    }

    fn advance(&mut self, interval: &Interval, command: &[f64]) -> Result<(), Failure> {
        let step = (interval.start_s / interval.length_s).round() as u64;
        self.with_rig(|rig| rig.send(step, command))
    }

    fn check_period(&self, period_s: f64) -> Result<(), Invalid> {
        wire::check(&self.port, Carries::Command, period_s).map_err(Invalid)
    }
}
