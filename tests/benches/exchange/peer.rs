//! Both sides of a measurement: this program as the plant, and itself again as the controller.

use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Command, Stdio};

use rustix::thread::{CpuSet, sched_setaffinity};
use shared_types::clock::monotonic_ns;
use shared_types::session::{Session, SessionInfo};
use shared_types::wait::{WaitLimit, Waiter};

use crate::patterns::{End, Side, end};
use crate::{Exchange, raw};

/// Trips before those that count.
const WARM_UP: usize = 2000;
/// How long the other side may take; only a failure takes so long.
const WAIT_LIMIT_S: f64 = 30.0;

/// Variables by which the controller's process is told what to do.
const EXCHANGE: &str = "HIL_BENCH_EXCHANGE";
const SESSION: &str = "HIL_BENCH_SESSION";
const TRIPS: &str = "HIL_BENCH_TRIPS";
const CORE: &str = "HIL_BENCH_CORE";
const SHARED_CORE: &str = "HIL_BENCH_SHARED_CORE";

/// On which cores the two sides run.
#[derive(Clone, Copy)]
pub(crate) struct Where<'a> {
    all: &'a [usize],
    plant: usize,
    controller: usize,
}

impl<'a> Where<'a> {
    /// Sides on these two of all cores.
    pub(crate) const fn new(all: &'a [usize], plant: usize, controller: usize) -> Self {
        Self {
            all,
            plant,
            controller,
        }
    }

    /// The cores of plant and controller.
    pub(crate) const fn cores(self) -> [usize; 2] {
        [self.plant, self.controller]
    }

    /// How both sides wait.
    pub(crate) const fn wait(self) -> &'static str {
        if self.plant == self.controller {
            "yield after every poll"
        } else {
            "64 polls, then yield after every poll"
        }
    }

    const fn is_shared(self) -> bool {
        self.plant == self.controller
    }
}

impl std::fmt::Display for Where<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [plant, controller] = self.cores();
        if self.is_shared() {
            write!(f, "both sides on core {plant}, {}", self.wait())
        } else {
            write!(f, "cores {plant} and {controller}, {}", self.wait())
        }
    }
}

/// Keeps the calling thread on one core.
fn pin(core: usize) {
    let mut only = CpuSet::new();
    only.set(core);
    sched_setaffinity(None, &only).expect("a core that this process may run on");
}

/// Lets the calling thread run on all of these cores again.
fn unpin(cores: &[usize]) {
    let mut all = CpuSet::new();
    cores.iter().for_each(|&core| all.set(core));
    sched_setaffinity(None, &all).expect("cores that this process may run on");
}

/// A waiter for a thread that is about to be kept on a core. It looks at the cores of its process:
/// where both sides have a core of their own it must not find only one.
fn waiter(core: usize, shared: bool) -> Waiter {
    let limit = WaitLimit::from_seconds(WAIT_LIMIT_S);
    if shared {
        pin(core);
        Waiter::new(limit)
    } else {
        let waiter = Waiter::new(limit);
        pin(core);
        waiter
    }
}

/// Measures one round: the duration of each trip in ns.
pub(crate) fn measure(exchange: Exchange, place: Where<'_>, trips: usize) -> Vec<u64> {
    let trips_ns = if exchange == Exchange::Raw {
        between_threads(place, trips)
    } else {
        between_processes(exchange, place, trips)
    };
    unpin(place.all);
    trips_ns
}

fn between_threads(place: Where<'_>, trips: usize) -> Vec<u64> {
    let (mut plant, mut controller) = raw::pair();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let waiter = waiter(place.controller, place.is_shared());
            follow(&mut controller, trips, waiter);
        });
        lead(&mut plant, trips, waiter(place.plant, place.is_shared()))
    })
}

fn between_processes(exchange: Exchange, place: Where<'_>, trips: usize) -> Vec<u64> {
    let session = Session::create(None).expect("a session");
    let mut plant = end(exchange, session.info(), Side::Plant);
    let own = std::env::current_exe().expect("this program");
    let mut controller = Command::new(own)
        .env(EXCHANGE, exchange.name())
        .env(SESSION, &session.info().folder)
        .env(TRIPS, trips.to_string())
        .env(CORE, place.controller.to_string())
        .env(SHARED_CORE, place.is_shared().to_string())
        .stdout(Stdio::piped())
        .spawn()
        .expect("this program once more");
    let mut output = BufReader::new(controller.stdout.take().expect("is piped"));
    let mut line = String::new();
    output
        .read_line(&mut line)
        .expect("a word when it is ready");
    assert_eq!(line, "ready\n");
    let waiter = waiter(place.plant, place.is_shared());
    let trips_ns = lead(&mut *plant, trips, waiter);
    output.read_to_string(&mut line).expect("its end");
    let status = controller.wait().expect("it was started");
    assert!(status.success(), "the other side: {status}");
    trips_ns
}

/// Sends and awaits the answer, again and again.
fn lead(end: &mut (impl End + ?Sized), trips: usize, mut waiter: Waiter) -> Vec<u64> {
    let mut trips_ns = Vec::with_capacity(WARM_UP + trips);
    for number in 1..=(WARM_UP + trips) as u64 {
        let since_ns = monotonic_ns();
        end.send(number);
        receive(end, number, &mut waiter);
        trips_ns.push(monotonic_ns() - since_ns);
    }
    trips_ns.split_off(WARM_UP)
}

/// Answers, again and again.
fn follow(end: &mut (impl End + ?Sized), trips: usize, mut waiter: Waiter) {
    for number in 1..=(WARM_UP + trips) as u64 {
        receive(end, number, &mut waiter);
        end.send(number);
    }
}

fn receive(end: &mut (impl End + ?Sized), number: u64, waiter: &mut Waiter) {
    // A blackboard shows what was there before the first payload as well.
    while end.receive() != Some(number) {
        assert!(!waiter.pause(), "the other side is gone at trip {number}");
    }
    waiter.done();
}

/// Is the controller of a measurement if this process was started as one; false if it was not.
pub(crate) fn answered() -> bool {
    let told = |name: &str| std::env::var(name).ok();
    let Some(exchange) = told(EXCHANGE) else {
        return false;
    };
    let exchange = Exchange::named(&exchange).expect("an exchange");
    let folder = PathBuf::from(told(SESSION).expect("a session"));
    let trips = told(TRIPS).and_then(|text| text.parse().ok());
    let core = told(CORE).and_then(|text| text.parse().ok());
    let shared = told(SHARED_CORE).is_some_and(|text| text == "true");
    let session = SessionInfo::read(&folder).expect("a session");
    let mut controller = end(exchange, &session, Side::Controller);
    let waiter = waiter(core.expect("a core"), shared);
    println!("ready");
    follow(&mut *controller, trips.expect("a number"), waiter);
    true
}
