//! Measuring: the loop, the bare exchange and the raw limit, for each payload and rate.
//!
//! One after the other and never two at once. While steps are exchanged this process has one thread
//! awake, the plant's; nobody observes or records.

use controller_process::job::JOB_FILE;
use hil_config::plan::Realtime;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::run::LinkKind;
use hil_facts::results::latency::legs::Latency;
use hil_facts::results::latency::times::Times;
use hil_run::realtime;
use plant_process::engine::Engine;
use serde::Serialize;
use shared_types::link::LinkError;
use shared_types::link::bare::Blackboard;
use shared_types::link::iceoryx::IceoryxLink;
use shared_types::realtime::{CONTROLLER_FILE, Report};
use shared_types::record::{Event, Outcome, RecordLayout, Timing};
use shared_types::session::{Session, SessionError};
use shared_types::side::Side;
use shared_types::stream::RecordSink;
use shared_types::supervision::Supervision;
use shared_types::time::Rate;
use shared_types::wait::WaitLimit;
use shared_types::zerocopy::{FromBytes, IntoBytes};

use super::exchange::{NoAnswer, Trips, follow, frame_words, lead};
use super::peer::{Peer, WAIT_LIMIT_S};
use crate::arguments::{LatencyArguments, PeerWork};
use crate::{null, raw};

/// Steps that are left out at the beginning if nothing else is said.
const WARM_UP: u64 = 20_000;
/// The most of them when they are paced, in s.
const WARM_UP_S: f64 = 2.0;

/// Measurement of one payload at one rate.
#[derive(Clone, Debug)]
pub struct Case {
    /// Signals in a sample.
    pub signals: usize,
    /// Steps per second by the clock; `None` as fast as both sides can.
    pub rate: Option<Rate>,
    /// Steps that were left out at the beginning.
    pub warm_up: u64,
    /// The loop.
    pub looped: Looped,
    /// Limits of the machine for that payload; `None` of a recorded run.
    pub limits: Option<Limits>,
}

/// Measurement of the loop.
#[derive(Clone, Debug, Default)]
pub struct Looped {
    /// Legs and worst steps.
    pub latency: Latency,
    /// Both ways of the round trip; `None` of a law that does not say when it was called.
    pub ways: Option<Ways>,
    /// Times at which the first and the last step had their commands, or went on without.
    pub span_ns: Option<(u64, u64)>,
    /// Real-time settings of both sides; `None` of a recorded run.
    pub sides: Option<Sides>,
}

/// Real-time settings of both sides, as asked for and as granted.
#[derive(Clone, Debug, Serialize)]
pub struct Sides {
    /// The plant's loop.
    pub plant: Report,
    /// The controller's.
    pub controller: Report,
}

/// The round trip, split where the law is called.
#[derive(Clone, Debug)]
pub struct Ways {
    /// From sending a sample to calling the law with it.
    pub sample: Times,
    /// From there to having the command.
    pub command: Times,
}

/// Trips of payloads as large as the loop's frames.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Through atomics between two threads.
    pub raw: Times,
    /// Through a bare iceoryx2 blackboard between two processes.
    pub bare: Times,
}

impl Looped {
    /// Mean time of a step, in ns.
    #[must_use]
    pub fn step_ns(&self) -> Option<f64> {
        let (first_ns, last_ns) = self.span_ns?;
        let steps = self.latency.steps().checked_sub(1)?;
        (steps > 0).then(|| last_ns.saturating_sub(first_ns) as f64 / steps as f64)
    }

    /// Takes in a step.
    pub fn take(&mut self, step: u64, timing: &Timing, called_ns: u64) {
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
/// If a core is not there, or a measurement did not come to its end.
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
        let known = cases.iter().find(|case| case.signals == signals);
        let limits = match known.and_then(|case| case.limits.clone()) {
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
                return Err(Failure::usage("--duration takes a time above 0"));
            }
            plans.push((signals, rate, trips));
        }
    }
    Ok(plans)
}

fn announce(what: &str) {
    tell!("measuring {what}");
}

/// On a thread of its own: what a side asks of the system for its thread ends with that.
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

/// State that all measurements share.
struct Bench {
    realtime: Realtime,
    interruption: Interruption,
}

impl Bench {
    /// The raw limit for frames of N signals.
    fn raw_limit(&self, signals: usize, trips: Trips) -> Result<Times, Failure> {
        let there = frame_words(signals);
        let back = frame_words(null::answered_with(signals));
        let (mut plant, mut controller) = raw::pair(there, back);
        let stop = || self.interruption.came();
        let led = std::thread::scope(|scope| {
            scope.spawn(move || {
                let waiter = self.realtime.controller().apply().waiter(limit());
                follow(&mut controller, trips, waiter, stop)
            });
            let waiter = self.realtime.plant().apply().waiter(limit());
            lead(&mut plant, trips, waiter, stop)
        });
        led.map_err(|error| self.gone(error, None))
    }

    /// The bare exchange of frames of N signals.
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
        // A process starts with what its parent's thread has: first the peer, then the settings.
        let peer = Peer::start(&mut session, work, &supervision)?;
        let waiter = self.realtime.plant().apply().waiter(limit());
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

    /// The loop with N signals: the engine in this thread, the runner in another process.
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
        // Before the peer, which opens what is there.
        let link = IceoryxLink::create(&info).map_err(Failure::infrastructure)?;
        let kind = null::measured_plant(signals);
        let engine = Engine::new(&kind, &[], plant_job, link, meter);
        let mut engine = engine.map_err(Failure::infrastructure)?;
        let peer = Peer::start(&mut session, PeerWork::Controller { signals }, &supervision)?;
        let plant = self.realtime.plant().apply();
        let driven =
            plant_process::program::drive(&mut engine, plant.waiter(limit()), &supervision);
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

/// Takes the timing of records, and passes Ctrl-C on.
struct Meter<'a> {
    looped: &'a mut Looped,
    warm_up: u64,
    /// Places of the timing and of the law's call in a record.
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
    fn each_payload_is_measured_at_each_rate_after_its_warm_up() {
        let planned = |warm_up| -> Vec<(usize, u64, u64)> {
            let plans = plans(&arguments(warm_up, 0.5)).expect("legal");
            let counts =
                |(signals, _, trips): (usize, _, Trips)| (signals, trips.warm_up, trips.measured);
            plans.into_iter().map(counts).collect()
        };
        // Two seconds of 1 kHz are fewer steps than 20 000; those of 20 kHz are more.
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
    fn the_round_trip_is_split_where_the_law_was_called() {
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
        // A step that went on without a command took its time too; the record after the last step is none.
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
