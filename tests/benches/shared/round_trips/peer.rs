//! Both sides of a measurement: this program as the plant, and a second instance of it as the controller.

use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Command, Stdio};

use hil_benchmark::exchange::{End, Trips, follow, lead};
use hil_benchmark::raw;
use hil_session::realtime::pin;
use hil_session::session::{Session, SessionInfo};
use hil_session::waiter::Waiter;
use shared_types::side::Side;
use shared_types::wait::{WaitLimit, WaitStrategy};

use super::{COMMAND_BYTES, Exchange, Place, Round, SAMPLE_BYTES, open};

/// Round trips before the counted ones.
const WARM_UP: u64 = 2000;
/// Time limit in s for the other side, reached only by a failure.
const WAIT_LIMIT_S: f64 = 30.0;

/// Variables that tell the controller's process its task.
const EXCHANGE: &str = "HIL_BENCH_EXCHANGE";
const SESSION: &str = "HIL_BENCH_SESSION";
const TRIPS: &str = "HIL_BENCH_TRIPS";
const CORE: &str = "HIL_BENCH_CORE";
const SHARED_CORE: &str = "HIL_BENCH_SHARED_CORE";

/// Returns a waiter for the calling thread, which stays on one core from now on.
fn waiter(core: usize, shares_core: bool) -> Waiter {
    pin(core as u32).expect("a core that this process may run on");
    let limit = WaitLimit::from_seconds(WAIT_LIMIT_S);
    Waiter::with(limit, WaitStrategy::Hybrid, shares_core)
}

/// Measures one round of N trips.
pub(crate) fn measure(exchange: Exchange, place: Place<'_>, trips: u64) -> Round {
    let trips = Trips {
        warm_up: WARM_UP,
        measured: trips,
    };
    let round = if exchange == Exchange::Raw {
        between_threads(place, trips)
    } else {
        between_processes(exchange, place, trips)
    };
    place.leave();
    round
}

fn between_threads(place: Place<'_>, trips: Trips) -> Round {
    let (mut plant, mut controller) = raw::pair(SAMPLE_BYTES / 8, COMMAND_BYTES / 8);
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let waiter = waiter(place.controller(), place.is_shared());
            follow(&mut controller, trips, waiter, || false).expect("the plant leads");
        });
        led(&mut plant, trips, waiter(place.plant(), place.is_shared()))
    })
}

fn between_processes(exchange: Exchange, place: Place<'_>, trips: Trips) -> Round {
    let session = Session::create(None).expect("a session");
    let mut plant = open(exchange, session.info(), Side::Plant);
    let own = std::env::current_exe().expect("this program");
    let mut controller = Command::new(own)
        .env(EXCHANGE, exchange.name())
        .env(SESSION, &session.info().folder)
        .env(TRIPS, trips.all().to_string())
        .env(CORE, place.controller().to_string())
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
    let waiter = waiter(place.plant(), place.is_shared());
    let round = led(&mut plant, trips, waiter);
    output.read_to_string(&mut line).expect("its end");
    let status = controller.wait().expect("it was started");
    assert!(status.success(), "the other side: {status}");
    round
}

/// Sends and awaits the answer, repeatedly.
fn led(end: &mut impl End, trips: Trips, waiter: Waiter) -> Round {
    let trips_ns = lead(end, trips, waiter, || false).expect("the controller follows");
    let at = |share| trips_ns.at_quantile(share) as f64;
    Round {
        p50: at(0.5),
        p99: at(0.99),
    }
}

/// Runs as the controller of a measurement if this process was started as one; otherwise returns false.
pub(crate) fn answered() -> bool {
    let told = |name: &str| std::env::var(name).ok();
    let Some(exchange) = told(EXCHANGE) else {
        return false;
    };
    let exchange = Exchange::named(&exchange).expect("an exchange");
    let folder = PathBuf::from(told(SESSION).expect("a session"));
    let core = told(CORE).and_then(|text| text.parse().ok());
    let shares_core = told(SHARED_CORE).is_some_and(|text| text == "true");
    let trips = Trips {
        warm_up: 0,
        measured: (told(TRIPS).and_then(|text| text.parse().ok())).expect("a number"),
    };
    let session = SessionInfo::read(&folder).expect("a session");
    let mut controller = open(exchange, &session, Side::Controller);
    let waiter = waiter(core.expect("a core"), shares_core);
    println!("ready");
    follow(&mut controller, trips, waiter, || false).expect("the plant leads");
    true
}
