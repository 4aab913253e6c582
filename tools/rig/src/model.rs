//! A port as a plant: commands out, newest valid frames in.
//!
//! No method blocks, but for [`PortIo::wait_for_peer`] before the first step.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use hil_codec::pack::Packer;
use hil_codec::receive::Receiver;
use hil_codec::row::Row;
use hil_config::port::{Carries, Period, Port};
use plant_process::plant::Model;
use shared_types::describe::Invalid;
use shared_types::failure::Failure;
use shared_types::quality::SignalSet;
use shared_types::time::Interval;

use crate::description::{aged, packers};
use crate::keeper::Keeper;
use crate::media::Socket;

/// Largest number of frames that are taken from a medium in one step; a faster peer loses the others.
const MOST_FRAMES: usize = 4096;
/// Pause of the wait for the peer.
const LOOK: Duration = Duration::from_millis(2);

/// Frame that is sent.
struct Outgoing {
    packer: Packer,
    medium: usize,
    period: Period,
    /// Steps from one frame to the next.
    steps: u64,
}

/// Open port.
pub struct PortIo {
    port: Arc<Port>,
    sockets: Vec<Socket>,
    receivers: Vec<Receiver>,
    outgoing: Vec<Outgoing>,
    row: Row,
    /// Column of each signal whose age is a measured signal.
    ages: Vec<usize>,
    safe: Vec<f64>,
    keeper: Keeper,
    period_s: f64,
    /// Longest silence of the peer in s.
    silence_s: f64,
    /// Steps since the last accepted frame.
    silent_steps: u64,
    strangers: u64,
    buffer: Box<[u8]>,
}

impl PortIo {
    /// Opens the media of a port and starts its keeper; `silence_s` is the longest silence of the peer.
    ///
    /// # Errors
    /// If a medium or the watchdog cannot be opened, or the keeper cannot be started.
    pub fn open(port: &Arc<Port>, path: &std::path::Path, silence_s: f64) -> Result<Self, String> {
        let sockets: Result<Vec<Socket>, String> = port.media.iter().map(Socket::open).collect();
        let sockets = sockets?;
        let sample = port.table(Carries::Sample);
        let frames_of = |medium: usize| {
            let frames = port.frames.iter();
            let own = frames
                .filter(move |one| one.carries == Carries::Sample && one.medium == Some(medium));
            own.map(|one| one.frame.clone()).collect::<Vec<_>>()
        };
        let receivers = (0..sockets.len()).map(|medium| {
            Receiver::new(&frames_of(medium), &sample).map_err(|error| error.to_string())
        });
        let column = |name: &str| sample.0.iter().position(|one| one.field.name == name);
        let keeper = Keeper::start(path, &sockets)?;
        Ok(Self {
            receivers: receivers.collect::<Result<_, String>>()?,
            outgoing: outgoing(port)?,
            row: Row::new(sample.0.len()),
            ages: aged(port).filter_map(column).collect(),
            safe: port.safe_row()?,
            port: Arc::clone(port),
            sockets,
            keeper,
            period_s: 1.0,
            silence_s,
            silent_steps: 0,
            strangers: 0,
            buffer: vec![0; 1 << 16].into(),
        })
    }

    /// Waits until the peer has sent a frame.
    ///
    /// # Errors
    /// If the peer was silent for the limit.
    pub fn wait_for_peer(&mut self, wants_stop: &dyn Fn() -> bool) -> Result<(), String> {
        let begin = Instant::now();
        while !self.take()? {
            if wants_stop() {
                return Err("stopped before the peer sent a frame".into());
            }
            if begin.elapsed().as_secs_f64() > self.silence_s {
                return Err(self.silence());
            }
            std::thread::sleep(LOOK);
        }
        Ok(())
    }

    fn silence(&self) -> String {
        let media = self.sockets.iter().map(|socket| match socket.peer {
            Some(peer) => format!("{} ({peer})", socket.name),
            None => socket.name.clone(),
        });
        format!(
            "the peer of port `{}` sent no valid frame for {} s on {}",
            self.port.name,
            self.silence_s,
            media.collect::<Vec<_>>().join(", ")
        )
    }

    /// Takes all frames that have arrived; returns `true` if one was accepted.
    fn take(&mut self) -> Result<bool, String> {
        let mut is_accepted = false;
        for (index, socket) in self.sockets.iter_mut().enumerate() {
            let before = socket.peer;
            for _ in 0..MOST_FRAMES {
                let Some((length, is_peer)) = socket.receive(&mut self.buffer) else {
                    break;
                };
                if !is_peer {
                    self.strangers += 1;
                    continue;
                }
                let bytes = &self.buffer[..length];
                let (_, result) = self.receivers[index].receive(None, bytes, &mut self.row);
                is_accepted |= result.is_ok();
            }
            if socket.peer != before {
                self.keeper.tell_peer(index, socket.peer)?;
            }
        }
        Ok(is_accepted)
    }

    /// Sends the frames that are due at a step.
    fn send(&mut self, step: u64, command: &[f64]) {
        for (index, outgoing) in self.outgoing.iter_mut().enumerate() {
            if step.is_multiple_of(outgoing.steps) {
                let bytes = outgoing.packer.pack(command, &SignalSet::EMPTY);
                self.sockets[outgoing.medium].send(bytes);
                if let Some(counter) = outgoing.packer.counter() {
                    self.keeper.note_counter(index, counter);
                }
            }
        }
    }

    /// Sends the safe values in every frame, in place of a keeper that is gone.
    fn send_safe(&mut self) {
        let safe = self.safe.clone();
        for _ in 0..self.port.safety.repeats {
            self.send(0, &safe);
            std::thread::sleep(Duration::from_secs_f64(self.port.safety.period_s));
        }
    }

    /// Ends the port in order: the keeper sends the safe values.
    pub fn end(self) {
        if self.strangers > 0 {
            let (strangers, name) = (self.strangers, &self.port.name);
            hil_session::program::say(&format!(
                "port `{name}` refused {strangers} frames of other senders than its peer"
            ));
        }
        self.keeper.end();
    }
}

fn outgoing(port: &Port) -> Result<Vec<Outgoing>, String> {
    let frames = { port.frames.iter() }.filter(|one| one.carries == Carries::Command);
    let bound = packers(port)?.into_iter().zip(frames);
    Ok(bound
        .map(|((packer, medium), frame)| Outgoing {
            packer,
            medium,
            period: frame.period,
            steps: 1,
        })
        .collect())
}

/// Returns the number of steps of a period.
fn steps_of(period: Period, period_s: f64, frame: &str) -> Result<u64, Invalid> {
    match period {
        Period::Steps(steps) => Ok(steps),
        Period::Seconds(seconds) => {
            let steps = (seconds / period_s).round();
            if steps >= 1.0 && (steps * period_s - seconds).abs() <= 1e-9 * seconds {
                return Ok(steps as u64);
            }
            Err(Invalid(format!(
                "frame `{frame}` has a period of {seconds} s, which is no whole number of steps of {period_s} s; change `period_s` or `run.rate_hz`"
            )))
        }
    }
}

/// Port that is open while a run lasts, and closed while a job is checked.
pub type Shared = Arc<Mutex<Option<PortIo>>>;

/// A port as a plant.
pub struct PortModel {
    port: Arc<Port>,
    io: Shared,
}

impl PortModel {
    /// Creates the plant of a port that is opened elsewhere.
    #[must_use]
    pub const fn new(port: Arc<Port>, io: Shared) -> Self {
        Self { port, io }
    }

    fn io(&self) -> MutexGuard<'_, Option<PortIo>> {
        self.io.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn closed() -> Failure {
    Failure::lost("the port is closed")
}

impl Model for PortModel {
    fn retune(&mut self, _: &[f64]) -> Result<(), Failure> {
        Ok(())
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<(), Failure> {
        self.read(measured, &mut SignalSet::default())
    }

    fn read(&mut self, measured: &mut [f64], invalid: &mut SignalSet) -> Result<(), Failure> {
        let mut io = self.io();
        let io = io.as_mut().ok_or_else(closed)?;
        io.row.advance();
        let is_accepted = io.take().map_err(Failure::lost)?;
        io.silent_steps = if is_accepted { 0 } else { io.silent_steps + 1 };
        if io.silent_steps as f64 * io.period_s > io.silence_s {
            return Err(Failure::lost(io.silence()));
        }
        let (values, ages) = measured.split_at_mut(io.row.values().len());
        values.copy_from_slice(io.row.values());
        for (age, column) in ages.iter_mut().zip(&io.ages) {
            *age = f64::from(io.row.ages()[*column]);
        }
        for column in io.row.invalid().iter(values.len()) {
            invalid.insert(column);
        }
        Ok(())
    }

    fn truth(&mut self, _: f64, _: &[f64], _: &mut [f64]) -> Result<(), Failure> {
        Ok(())
    }

    fn advance(&mut self, interval: &Interval, command: &[f64]) -> Result<(), Failure> {
        let mut io = self.io();
        let io = io.as_mut().ok_or_else(closed)?;
        if io.keeper.is_gone() {
            io.send_safe();
            return Err(Failure::lost(
                "the keeper of the safe values ended; the port has sent them and ends the run",
            ));
        }
        let step = (interval.start_s / interval.length_s).round() as u64;
        io.send(step, command);
        Ok(())
    }

    fn check_period(&self, period_s: f64) -> Result<(), Invalid> {
        let mut io = self.io();
        let mut sent = 0;
        for one in &self.port.frames {
            let name = &one.frame.name;
            let steps = steps_of(one.period, period_s, name)?;
            if let (Some(io), Carries::Command) = (io.as_mut(), one.carries) {
                io.outgoing[sent].steps = steps;
                debug_assert_eq!(io.outgoing[sent].period, one.period);
                sent += 1;
            }
            if let (Some(io), Carries::Sample, Some(stale_s)) =
                (io.as_mut(), one.carries, one.stale_s)
            {
                let sample = self.port.table(Carries::Sample);
                for (signal, _) in one.frame.signals() {
                    let column = sample
                        .0
                        .iter()
                        .position(|one| one.field.name == signal.name);
                    if let Some(column) = column {
                        io.row
                            .limit_age(column, (stale_s / period_s).round() as u32);
                    }
                }
            }
        }
        if let Some(io) = io.as_mut() {
            io.period_s = period_s;
        }
        Ok(())
    }
}
