//! Lower bound for a step: two processes with the work of the scenario and only a wake-up between them.

use std::io::{Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use hil_benchmark::exchange::{End, Trips, follow, lead};
use hil_session::link::bare::Blackboard;
use hil_session::link::bell::{Bell, Owner};
use hil_session::realtime::apply;
use hil_session::session::{Session, SessionInfo};
use hil_session::waiter::Waiter;
use shared_types::frame;
use shared_types::realtime::Settings;
use shared_types::side::Side;
use shared_types::wait::{Sleeper, WaitLimit, WaitStrategy};

use crate::cell::Cell;

const WAY: &str = "HIL_BENCH_BARE";
const SIDE: &str = "HIL_BENCH_SIDE";
const FOLDER: &str = "HIL_BENCH_FOLDER";
const TURNS: &str = "HIL_BENCH_TURNS";
const TRIPS: &str = "HIL_BENCH_TRIPS";
const PRIORITY: &str = "HIL_BENCH_PRIORITY";

/// Number of values in a sample and in a command.
const VALUES: (usize, usize) = (32, 16);
/// Size of their frames in bytes.
const SAMPLE_BYTES: usize = 8 * frame::words(VALUES.0);
const COMMAND_BYTES: usize = 8 * frame::words(VALUES.1);
/// Time limit for the other side, reached only by a failure.
const LIMIT: Duration = Duration::from_secs(60);

/// Work of one step, as iterations of a loop.
#[derive(Clone, Copy)]
pub(crate) struct Work {
    turns: u64,
    seconds: f64,
}

impl Work {
    /// Returns the work that takes this time on an idle core.
    pub(crate) fn of(seconds: f64) -> Self {
        const TURNS: u64 = 10_000_000;
        let since = Instant::now();
        work(TURNS);
        let turns = seconds * TURNS as f64 / since.elapsed().as_secs_f64();
        Self {
            turns: turns as u64,
            seconds,
        }
    }

    pub(crate) const fn seconds(self) -> f64 {
        self.seconds
    }
}

fn work(turns: u64) {
    let mut state = 1_u64;
    for _ in 0..turns {
        state = std::hint::black_box(
            state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1),
        );
    }
}

/// A bare exchange.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Bare {
    /// A UNIX socket that blocks.
    Socket,
    /// Shared memory and a futex, without spinning before it sleeps.
    Futex,
    /// Shared memory, with a yield after each read.
    PingPong,
}

impl Bare {
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Socket => "socket",
            Self::Futex => "futex",
            Self::PingPong => "ping-pong",
        }
    }

    /// Measures us a trip, of N, with half of the work on each side: the mean over as many pairs at once as the cell
    /// has sessions.
    pub(crate) fn measure(self, work: Work, trips: u64, cell: &Cell) -> f64 {
        let sessions = (0..cell.sessions).map(|_| Session::create(None).expect("a session"));
        let sessions: Vec<Session> = sessions.collect();
        let start = |session: &Session, side: &str| -> Child {
            Command::new(std::env::current_exe().expect("this program"))
                .env(WAY, self.name())
                .env(SIDE, side)
                .env(FOLDER, &session.info().folder)
                .env(TURNS, (work.turns / 2).to_string())
                .env(TRIPS, trips.to_string())
                .env(PRIORITY, cell.priority.to_string())
                .stdout(Stdio::piped())
                .spawn()
                .expect("this program")
        };
        let pairs = sessions
            .iter()
            .map(|session| ["lead", "follow"].map(|side| start(session, side)));
        let pairs: Vec<[Child; 2]> = pairs.collect();
        let trips_us = pairs.into_iter().map(|[lead, mut follow]| {
            let output = lead.wait_with_output().expect("an end");
            assert!(follow.wait().expect("an end").success());
            let text = String::from_utf8_lossy(&output.stdout);
            text.trim().parse::<f64>().expect("us a trip")
        });
        trips_us.sum::<f64>() / cell.sessions as f64
    }
}

/// Runs as one side of a bare exchange, if this process was started as one.
pub(crate) fn answered() -> bool {
    let Ok(way) = std::env::var(WAY) else {
        return false;
    };
    let variable = |name: &str| std::env::var(name).expect("set by the bench");
    let number = |name: &str| variable(name).parse::<u64>().expect("a number");
    let leads = variable(SIDE) == "lead";
    let folder = PathBuf::from(variable(FOLDER));
    let end: Box<dyn End> = if way == Bare::Socket.name() {
        Box::new(Stream::open(&folder, leads))
    } else if way == Bare::Futex.name() {
        Box::new(Bells::open(&folder, leads))
    } else {
        let session = SessionInfo::read(&folder).expect("a session");
        Box::new(open_board(&session, leads))
    };
    let settings = Settings {
        priority: number(PRIORITY) as u32,
        ..Settings::default()
    };
    let _ = apply(&settings); // the cell is there only if it is granted
    let turns = number(TURNS);
    let mut end = Working { end, turns };
    let trips = Trips {
        warm_up: 0,
        measured: number(TRIPS),
    };
    let limit = WaitLimit::from_seconds(LIMIT.as_secs_f64());
    let waiter = Waiter::with(limit, WaitStrategy::Yield, true);
    let since = Instant::now();
    if leads {
        lead(&mut end, trips, waiter, || false).expect("answered");
        let us = 1e6 * since.elapsed().as_secs_f64();
        println!("{}", us / trips.measured as f64);
    } else {
        follow(&mut end, trips, waiter, || false).expect("the other side leads");
    }
    true
}

/// An end that does its work before it sends.
struct Working {
    end: Box<dyn End>,
    turns: u64,
}

impl End for Working {
    fn send(&mut self, trip: u64) {
        work(self.turns);
        self.end.send(trip);
    }

    fn receive(&mut self) -> Option<u64> {
        self.end.receive()
    }
}

struct Stream {
    stream: UnixStream,
    outgoing: usize,
    incoming: usize,
}

impl Stream {
    fn open(folder: &Path, leads: bool) -> Self {
        let path = folder.join("bare");
        let stream = if leads {
            let listener = UnixListener::bind(&path).expect("binds");
            listener.set_nonblocking(true).expect("does not block");
            awaited(|| listener.accept().ok()).0
        } else {
            awaited(|| UnixStream::connect(&path).ok())
        };
        stream.set_nonblocking(false).expect("blocks");
        (stream.set_read_timeout(Some(LIMIT))).expect("a limit that is not 0");
        let (outgoing, incoming) = match leads {
            true => (SAMPLE_BYTES, COMMAND_BYTES),
            false => (COMMAND_BYTES, SAMPLE_BYTES),
        };
        Self {
            stream,
            outgoing,
            incoming,
        }
    }
}

impl End for Stream {
    fn send(&mut self, trip: u64) {
        let mut payload = [0; SAMPLE_BYTES];
        payload[..8].copy_from_slice(&trip.to_le_bytes());
        (self.stream.write_all(&payload[..self.outgoing])).expect("sends");
    }

    fn receive(&mut self) -> Option<u64> {
        let mut payload = [0; SAMPLE_BYTES];
        let payload = &mut payload[..self.incoming];
        self.stream.read_exact(payload).expect("receives");
        payload.first_chunk().map(|word| u64::from_le_bytes(*word))
    }
}

struct Bells {
    board: Blackboard,
    own: Bell,
    other: Bell,
}

impl Bells {
    fn open(folder: &Path, leads: bool) -> Self {
        let session = SessionInfo::read(folder).expect("a session");
        let owners = (Owner::Plant, Owner::Controller(1));
        if leads {
            let make = |owner| Bell::create(&session, owner).expect("creates");
            let (own, other) = (make(owners.0), make(owners.1));
            let board = open_board(&session, leads);
            return Self { board, own, other };
        }
        let find = |owner| awaited(|| Bell::open(&session, owner).ok());
        let (other, own) = (find(owners.0), find(owners.1));
        let board = open_board(&session, leads);
        Self { board, own, other }
    }
}

impl End for Bells {
    fn send(&mut self, trip: u64) {
        self.board.send(trip);
        self.other.ring();
    }

    /// Sleeps until something new arrives.
    fn receive(&mut self) -> Option<u64> {
        loop {
            let (announced, since) = (self.own.announce(), Instant::now());
            let trip = self.board.receive();
            if trip.is_none() {
                self.own.sleep(announced, LIMIT.as_nanos() as u64);
            }
            self.own.retire();
            if trip.is_some() {
                return trip;
            }
            assert!(since.elapsed() < LIMIT, "the other side is silent");
        }
    }
}

fn open_board(session: &SessionInfo, leads: bool) -> Blackboard {
    let (there, back) = VALUES;
    match leads {
        true => Blackboard::open(session, Side::Plant, there, back).expect("creates"),
        false => awaited(|| Blackboard::open(session, Side::Controller, there, back).ok()),
    }
}

/// Polls until something new arrives.
fn awaited<T>(mut look: impl FnMut() -> Option<T>) -> T {
    let since = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(since.elapsed() < LIMIT, "the other side did not come");
        std::thread::sleep(Duration::from_millis(1));
    }
}
