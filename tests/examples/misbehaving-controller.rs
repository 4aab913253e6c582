//! A controller process with one law for each way to break a run. Not a program of the workspace: the tests of failures
//! give it to `hil run --controller-bin`.

#[macro_use]
#[path = "../shared/law.rs"]
mod law;
#[path = "../shared/position_and_force.rs"]
mod position_and_force;

use std::io::Write;
use std::process::{Command, ExitCode, Stdio};
use std::sync::Once;

use controller_process::controller::{Controller, LawKind, Sample, Setup};
use shared_types::describe::{Invalid, LawDescription};
use shared_types::table;
use shared_types::table::Empty;

use position_and_force::{Force, Position};

/// The sample at which a law misbehaves.
const WHEN: u64 = 100;
/// Command of every law before that sample.
const BEFORE_N: f64 = 0.5;

table! {
    /// Signal that no plant measures.
    struct Missing {
        /// Phase of the moon.
        positron_m: "m",
    }
}

macro_rules! spoiler {
    ($law:ident, $name:literal, $measured:ty, $deed:expr) => {
        struct $law {
            samples: u64,
        }

        law!(
            $law,
            $name,
            "Misbehaves.",
            $measured,
            None,
            Self { samples: 0 },
            |law, _| {
                law.samples += 1;
                let deed: fn() -> f64 = $deed;
                if law.samples > WHEN { deed() } else { BEFORE_N }
            }
        );
    };
}

spoiler!(Leaves, "leaves", Position, || std::process::exit(0));
spoiler!(Panics, "panics", Position, || panic!("the law fell over"));
spoiler!(Sleeps, "sleeps", Position, || loop {
    std::thread::park();
});
spoiler!(Babbles, "babbles", Position, || f64::NAN);
spoiler!(Pushes, "pushes", Position, || 1e12);
spoiler!(Hoards, "hoards", Position, || {
    let mut hoard = Vec::new();
    loop {
        hoard.push(std::hint::black_box(vec![1_u8; 1 << 24]));
    }
});
spoiler!(Mutters, "mutters", Position, || {
    // What a terminal obeys: another title, a full clipboard, a cleared screen, a line gone back.
    eprintln!("\u{1b}]0;t\u{7}\u{1b}]52;c;eA==\u{1b}\\ \u{9b}2J\rmuttered \u{1b}[31mpass");
    std::process::exit(7)
});
spoiler!(Chatters, "chatters", Position, || {
    let line = [b'x'; 1 << 10];
    let mut log = std::io::stderr();
    eprintln!("the first line");
    for _ in 0..64 << 10 {
        log.write_all(&line).expect("written");
    }
    // The middle is left out before the last words come, not just then.
    std::thread::sleep(std::time::Duration::from_secs(1));
    panic!("\nthe law said enough")
});
spoiler!(Forks, "forks", Position, || {
    leave_somebody();
    BEFORE_N
});
spoiler!(ForksAndDies, "forks-and-dies", Position, || {
    leave_somebody();
    std::process::abort()
});
spoiler!(Moons, "moons", Missing, || 0.0);

/// Starts two processes that never end by themselves, one of them in a session of its own and without a parent. Both
/// have this process's session in their arguments.
fn leave_somebody() {
    static DONE: Once = Once::new();
    DONE.call_once(|| {
        let session = std::env::args().nth(2).expect("--session FOLDER");
        let sleep = "while :; do sleep 1000; done";
        for start in [
            sleep,
            "setsid sh -c \"$1\" \"$0\" </dev/null >/dev/null 2>&1 &",
        ] {
            let mut shell = Command::new("sh");
            shell
                .args(["-c", start, &session, sleep])
                .stdin(Stdio::null());
            drop(shell.spawn().expect("a shell"));
        }
        // The second has gone its way when its shell has ended, which nobody waits for.
        std::thread::sleep(std::time::Duration::from_millis(100));
    });
}

table! {
    /// Internals of a law.
    struct Inner {
        /// First position.
        first_m: "m",
        /// Another.
        second_m: "m",
    }
}

/// A law that records internals.
struct Shows;

impl Controller for Shows {
    const NAME: &'static str = "shows";
    const SUMMARY: &'static str = "Shows what it thinks.";
    type Parameters = Empty;
    type Model = Empty;
    type Measured = Position;
    type Reference = Empty;
    type Command = Force;
    type Internals = Inner;

    fn start(_: &Setup<Self>) -> Result<Self, Invalid> {
        Ok(Self)
    }

    fn step(&mut self, _: &Sample<Self>) -> (Force, Inner) {
        let [first_m, second_m] = [1.0, 2.0];
        (Force { force_n: BEFORE_N }, Inner { first_m, second_m })
    }
}

/// The same law under another name; its description changes after the first request.
fn two_faced(name: &str, change: fn(&mut LawDescription)) -> LawKind {
    let mut kind = LawKind::of::<Shows>();
    kind.description.name = name.into();
    if !std::env::args().any(|argument| argument == "--describe") {
        change(&mut kind.description);
    }
    kind
}

fn main() -> ExitCode {
    let laws = vec![
        LawKind::of::<Shows>(),
        two_faced("unreadable", |law| {
            law.internals[0].name = "first m\nfloat64 third_m".into();
        }),
        two_faced("doubles", |law| law.internals[1].name = "first_m".into()),
        two_faced("renames", |law| law.internals[0].name = "third_m".into()),
        two_faced("changes-unit", |law| law.internals[0].unit = "s".into()),
        two_faced("hides", |law| law.internals.truncate(1)),
        two_faced("needs-more", |law| law.reference = law.measured.clone()),
        two_faced("takes-what-there-is", |law| law.commands = None),
        LawKind::of::<Leaves>(),
        LawKind::of::<Panics>(),
        LawKind::of::<Sleeps>(),
        LawKind::of::<Babbles>(),
        LawKind::of::<Pushes>(),
        LawKind::of::<Hoards>(),
        LawKind::of::<Mutters>(),
        LawKind::of::<Chatters>(),
        LawKind::of::<Forks>(),
        LawKind::of::<ForksAndDies>(),
        LawKind::of::<Moons>(),
    ];
    controller_process::program::run("misbehaving-controller", "0.1.0", laws)
}
