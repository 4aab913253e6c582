//! Measures the loop, the bare exchange and the raw limit for each payload and rate.
//!
//! Measurements run one after another. During an exchange only the plant's thread of this process is active; nothing
//! observes or records.

use controller_process::job::JOB_FILE;
use hil_config::plan::Realtime;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::run::LinkKind;
use hil_facts::results::latency::legs::Latency;
use hil_facts::results::latency::times::Times;
use hil_run::realtime;
use hil_session::link::bare::Blackboard;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::realtime::{apply, waiter};
use hil_session::session::{Session, SessionError};
use hil_session::supervision::Supervision;
use plant_process::engine::Engine;
use serde::Serialize;
use shared_types::link::LinkError;
use shared_types::realtime::{CONTROLLER_FILE, Report};
use shared_types::record::{Event, Outcome, RecordLayout, Timing};
use shared_types::side::Side;
use shared_types::stream::RecordSink;
use shared_types::time::Rate;
use shared_types::wait::WaitLimit;
use shared_types::zerocopy::{FromBytes, IntoBytes};

use super::exchange::{NoAnswer, Trips, follow, frame_words, lead};
use super::peer::{Peer, WAIT_LIMIT_S};
use crate::arguments::{LatencyArguments, PeerWork};
use crate::{null, raw};

/// Default number of warm-up steps.
const WARM_UP: u64 = 20_000;
/// Longest warm-up of a paced measurement, in s.
const WARM_UP_S: f64 = 2.0;

/// Measurement of one payload at one rate.
#[derive(Clone, Debug)]
pub struct Case {
    /// Number of signals in a sample.
    pub signals: usize,
    /// Steps per second by the clock; `None` for lockstep at maximum speed.
    pub rate: Option<Rate>,
    /// Number of discarded warm-up steps.
    pub warm_up: u64,
    /// Figures of the loop.
    pub looped: Looped,
    /// Limits of the machine for that payload; `None` for a recorded run.
    pub limits: Option<Limits>,
}

/// Figures of the loop.
#[derive(Clone, Debug, Default)]
pub struct Looped {
    /// Latencies by leg, and the worst steps.
    pub latency: Latency,
    /// Both directions of the round trip; `None` for a law that does not report when it was called.
    pub ways: Option<Ways>,
    /// Times of the first and the last step: when the command arrived, or when the step continued without a command.
    pub span_ns: Option<(u64, u64)>,
    /// Real-time settings of both sides; `None` for a recorded run.
    pub sides: Option<Sides>,
}

/// Real-time settings of both sides, as requested and as granted.
#[derive(Clone, Debug, Serialize)]
pub struct Sides {
    /// Settings of the plant's loop.
    pub plant: Report,
    /// Settings of the controller's loop.
    pub controller: Report,
}

/// Round trip, split at the call of the law.
#[derive(Clone, Debug)]
pub struct Ways {
    /// Time from sending a sample to the call of the law.
    pub sample: Times,
    /// Time from the call of the law to the arrival of the command.
    pub command: Times,
}

/// Round-trip times of payloads of the same size as the loop's frames.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Exchange through atomics between two threads.
    pub raw: Times,
    /// Exchange through a bare iceoryx2 blackboard between two processes.
    pub bare: Times,
}

impl Looped {
    /// Returns the mean duration of a step, in ns.
    pub(crate) fn step_ns(&self) -> Option<f64> {
        let (first_ns, last_ns) = self.span_ns?;
        let steps = self.latency.steps().checked_sub(1)?;
        (steps > 0).then(|| last_ns.saturating_sub(first_ns) as f64 / steps as f64)
    }

    /// Adds the timing of a step.
    pub(crate) fn take(&mut self, step: u64, timing: &Timing, called_ns: u64) {
        self.latency.take(step, timing);
        if timing.is_final() {
            return;
        }
        let received_ns = timing.published_ns;
        if let Some(ways) = &mut self.ways
            && timing.round_trip_ns > 0
        {
            let sent_ns = received_ns - timing.round_trip_ns;
            let both = [
                (&mut ways.sample, called_ns.saturating_sub(sent_ns)),
                (&mut ways.command, received_ns.saturating_sub(called_ns)),
            ];
            for (way, ns) in both {
                way.record(ns);
            }
        }
        let (first_ns, _) = self.span_ns.unwrap_or((received_ns, received_ns));
        self.span_ns = Some((first_ns, received_ns));
    }
}

/// Measures every payload at every rate.
///
/// # Errors
/// If a core does not exist, or a measurement did not complete.
pub(crate) fn matrix(arguments: &LatencyArguments) -> Result<Vec<Case>, Failure> {
    let plans = plans(arguments)?;
    let realtime = arguments.sides.realtime();
    realtime::check(&realtime, LinkKind::Iceoryx2, None)?;
    let bench = Bench {
        realtime,
        interruption: Interruption::listen()?,
    };
    let mut cases: Vec<Case> = Vec::new();
    for (signals, rate, trips) in plans {
        let earlier = cases.iter().find(|case| case.signals == signals);
        let limits = match earlier.and_then(|case| case.limits.clone()) {
            Some(limits) => limits,
            None => {
                let trips = Trips {
                    warm_up: arguments.warm_up.unwrap_or(WARM_UP),
                    measured: arguments.steps,
                };
                announce(&format!("{signals} signals, the machine's limits"));
                Limits {
                    raw: apart(|| bench.raw_limit(signals, trips))?,
                    bare: apart(|| bench.bare_exchange(signals, trips))?,
                }
            }
        };
        announce(&match rate {
            None => format!("{signals} signals, {} steps", trips.all()),
            Some(rate) => {
                let (hz, takes_s) = (rate.hz(), trips.all() as f64 * rate.period_s());
                format!("{signals} signals at {hz} Hz for {takes_s:.1} s")
            }
        });
        cases.push(Case {
            signals,
            rate,
            warm_up: trips.warm_up,
            looped: apart(|| bench.looped(signals, rate, trips))?,
            limits: Some(limits),
        });
    }
    Ok(cases)
}

/// Lists the measurements in order: each payload at each rate, with its number of steps.
fn plans(arguments: &LatencyArguments) -> Result<Vec<(usize, Option<Rate>, Trips)>, Failure> {
    let mut plans = Vec::new();
    for &signals in &arguments.signals {
        for pace in &arguments.rates {
            let rate = pace.rate();
            let most = rate.map_or(WARM_UP, |rate| rate.step_at_or_after(WARM_UP_S).0);
            let trips = Trips {
                warm_up: (arguments.warm_up).unwrap_or(WARM_UP.min(most)),
                measured: rate.map_or(arguments.steps, |rate| {
                    rate.step_at_or_after(arguments.duration).0
                }),
            };
            if trips.measured == 0 {
                return Err(Failure::usage("--duration must be above 0"));
            }
            plans.push((signals, rate, trips));
        }
    }
    Ok(plans)
}

fn announce(what: &str) {
    tell!("measuring {what}");
}

/// Runs a measurement on a separate thread, so that its scheduling settings end with it.
fn apart<T: Send>(measure: impl FnOnce() -> T + Send) -> T {
    let measured = std::thread::scope(|scope| scope.spawn(measure).join());
    measured.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

fn limit() -> WaitLimit {
    WaitLimit::from_seconds(WAIT_LIMIT_S)
}

fn session() -> Result<Session, Failure> {
    Session::create(None).map_err(|error: SessionError| Failure::infrastructure(error))
}

/// State shared by all measurements.
struct Bench {
    realtime: Realtime,
    interruption: Interruption,
}

impl Bench {
    /// Measures the raw limit for frames of `signals` signals.
    fn raw_limit(&self, signals: usize, trips: Trips) -> Result<Times, Failure> {
        let outgoing = frame_words(signals);
        let back = frame_words(null::answered_with(signals));
        let (mut plant, mut controller) = raw::pair(outgoing, back);
        let stop = || self.interruption.came();
        let led = std::thread::scope(|scope| {
            scope.spawn(move || {
                let waiter = waiter(&apply(&self.realtime.controller()), limit());
                follow(&mut controller, trips, waiter, stop)
            });
            let waiter = waiter(&apply(&self.realtime.plant()), limit());
            lead(&mut plant, trips, waiter, stop)
        });
        led.map_err(|error| self.gone(error, None))
    }

    /// Measures the bare exchange for frames of `signals` signals.
    fn bare_exchange(&self, signals: usize, trips: Trips) -> Result<Times, Failure> {
        let mut session = session()?;
        let (_, job) = null::jobs(
            session.info(),
            null::NAME,
            None,
            0,
            &self.realtime,
            WAIT_LIMIT_S,
        );
        (session.info().write_file(JOB_FILE, &job)).map_err(Failure::infrastructure)?;
        let back = null::answered_with(signals);
        let mut plant = Blackboard::open(session.info(), Side::Plant, signals, back)
            .map_err(Failure::infrastructure)?;
        let supervision = Supervision::new();
        let work = PeerWork::Answer {
            signals,
            trips: trips.all(),
        };
        // A child process inherits the settings of the thread, so it is started before they are applied.
        let peer = Peer::start(&mut session, work, &supervision)?;
        let waiter = waiter(&apply(&self.realtime.plant()), limit());
        let stop = || self.interruption.came() || supervision.is_peer_gone();
        match lead(&mut plant, trips, waiter, stop) {
            Ok(trips_ns) => {
                peer.end().map_err(Failure::infrastructure)?;
                Ok(trips_ns)
            }
            Err(error) => Err(self.gone(error, peer.stop().err())),
        }
    }

    fn gone(&self, error: NoAnswer, why: Option<String>) -> Failure {
        if self.interruption.came() {
            return Failure::Interrupted;
        }
        Failure::infrastructure(match why {
            Some(why) => format!("{error}: {why}"),
            None => error.to_string(),
        })
    }

    /// Measures the loop with `signals` signals: the engine in this thread, the runner in another process.
    fn looped(&self, signals: usize, rate: Option<Rate>, trips: Trips) -> Result<Looped, Failure> {
        let mut session = session()?;
        let info = session.info().clone();
        let (plant_job, controller_job) = null::jobs(
            &info,
            null::NAME,
            rate,
            trips.all(),
            &self.realtime,
            WAIT_LIMIT_S,
        );
        (info.write_file(JOB_FILE, &controller_job)).map_err(Failure::infrastructure)?;
        let supervision = Supervision::new();
        let mut looped = Looped {
            ways: Some(Ways {
                sample: Times::default(),
                command: Times::default(),
            }),
            latency: Latency::new(rate.is_some()),
            ..Looped::default()
        };
        let meter = Meter {
            looped: &mut looped,
            warm_up: trips.warm_up,
            timing_place: 0,
            called_place: 0,
            interruption: &self.interruption,
            supervision: &supervision,
        };
        // The peer opens this link, so it must exist first.
        let link = IceoryxLink::create(&info).map_err(Failure::infrastructure)?;
        let kind = null::measured_plant(signals);
        let engine = Engine::new(&kind, &[], plant_job, link, meter);
        let mut engine = engine.map_err(Failure::infrastructure)?;
        let peer = Peer::start(&mut session, PeerWork::Controller { signals }, &supervision)?;
        let plant = apply(&self.realtime.plant());
        let driven =
            plant_process::program::drive(&mut engine, waiter(&plant, limit()), &supervision);
        let end = engine.end().cloned();
        let ended = peer.end();
        self.interruption.check()?;
        driven.map_err(Failure::infrastructure)?;
        match end {
            Some(end) if end.outcome == Outcome::Completed => {
                ended.map_err(Failure::infrastructure)?;
            }
            end => {
                let reasons = [end.and_then(|end| end.reason), ended.err()];
                let reasons: Vec<String> = reasons.into_iter().flatten().collect();
                return Err(Failure::infrastructure(reasons.join("; ")));
            }
        }
        drop(engine);
        looped.sides = Some(Sides {
            plant,
            controller: info
                .read_file(CONTROLLER_FILE)
                .map_err(Failure::infrastructure)?,
        });
        Ok(looped)
    }
}

/// Record sink that takes the timing of each record and passes Ctrl-C on.
struct Meter<'a> {
    looped: &'a mut Looped,
    warm_up: u64,
    /// Indices of the timing and of the law's call time in a record.
    timing_place: usize,
    called_place: usize,
    interruption: &'a Interruption,
    supervision: &'a Supervision,
}

impl RecordSink for Meter<'_> {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        self.timing_place = layout.words() - Timing::WORDS;
        self.called_place = null::called_place(layout);
        Ok(())
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        if self.interruption.came() {
            self.supervision.stop("interrupted");
        }
        Ok(true)
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        let step = words[0];
        let timing = Timing::read_from_bytes(words[self.timing_place..].as_bytes());
        let timing = timing.expect("a whole record");
        if step >= self.warm_up {
            let called_ns = f64::from_bits(words[self.called_place]) as u64;
            self.looped.take(step, &timing, called_ns);
        }
        Ok(())
    }

    fn event(&mut self, _event: &Event) -> Result<(), LinkError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::{Pace, SideArguments};
    use hil_facts::arguments::realtime::WaitKind;

    fn arguments(warm_up: Option<u64>, duration: f64) -> LatencyArguments {
        LatencyArguments {
            run: None,
            signals: vec![8, 32],
            rates: vec![
                Pace::Max,
                Pace::Rate(Rate::new(1000.0).expect("legal")),
                Pace::Rate(Rate::new(20_000.0).expect("legal")),
            ],
            warm_up,
            steps: 777,
            duration,
            sides: SideArguments {
                plant_core: None,
                controller_core: None,
                priority: 0,
                wait: WaitKind::Hybrid,
            },
            csv: None,
            json: false,
        }
    }

    #[test]
    fn each_payload_is_measured_at_each_rate_after_a_warm_up() {
        let planned = |warm_up| -> Vec<(usize, u64, u64)> {
            let plans = plans(&arguments(warm_up, 0.5)).expect("legal");
            let counts =
                |(signals, _, trips): (usize, _, Trips)| (signals, trips.warm_up, trips.measured);
            plans.into_iter().map(counts).collect()
        };
        // Two seconds at 1 kHz are fewer than 20 000 steps; at 20 kHz they are more.
        let of = |signals| {
            [
                (signals, 20_000, 777),
                (signals, 2_000, 500),
                (signals, 20_000, 10_000),
            ]
        };
        assert_eq!(planned(None), [of(8), of(32)].concat());
        let of = |signals| [(signals, 3, 777), (signals, 3, 500), (signals, 3, 10_000)];
        assert_eq!(planned(Some(3)), [of(8), of(32)].concat());
        assert!(plans(&arguments(None, 0.0)).is_err());
    }

    #[test]
    fn the_round_trip_is_split_at_the_call_of_the_law() {
        let mut looped = Looped {
            ways: Some(Ways {
                sample: Times::default(),
                command: Times::default(),
            }),
            ..Looped::default()
        };
        assert_eq!(looped.step_ns(), None);
        for step in 0..5 {
            let timing = Timing {
                epoch: 1,
                published_ns: 100_000 + 2_000 * step,
                round_trip_ns: 1_000,
                ..Timing::default()
            };
            let sent_ns = timing.published_ns - 1_000;
            looped.take(step, &timing, sent_ns + 700);
        }
        let ways = looped.ways.as_ref().expect("split");
        assert_eq!((ways.sample.min(), ways.sample.max()), (700, 700));
        assert_eq!((ways.command.min(), ways.command.max()), (300, 300));
        assert_eq!(looped.step_ns(), Some(2_000.0));
        // A step without a command has a duration, too; the record after the last step has none.
        let without = Timing {
            epoch: 1,
            held_steps: 1,
            published_ns: 100_000 + 2_000 * 5 + 3_000,
            ..Timing::default()
        };
        looped.take(5, &without, 0);
        let after_it = Timing {
            epoch: 1,
            published_ns: 900_000,
            ..Timing::default()
        };
        looped.take(6, &after_it, 0);
        assert_eq!(looped.step_ns(), Some(2_600.0));
        assert_eq!(looped.ways.expect("split").sample.len(), 5);
    }
}
