//! Properties that must hold for any input, a function for each entry point of the programs.
//!
//! Called by libFuzzer with inputs that it makes up, and by the workspace's tests with the committed
//! corpus and with changed pieces of it. A function panics if something does not hold and returns
//! otherwise; whether the input was taken or refused is all the same. Starts no process and needs no
//! network.

pub mod expression;
pub mod fault;
pub mod fmu;
pub mod frame;
pub mod hello;
mod numbers;
pub mod panel;
pub mod port;
pub mod recording;
pub mod rig;
pub mod scenario;
pub mod session;

/// An entry point.
pub struct Target {
    /// Name, which is also that of its corpus.
    pub name: &'static str,
    /// Checks the properties for any bytes.
    pub run: fn(&[u8]),
}

/// Every entry point.
pub const ALL: [Target; 10] = [
    Target {
        name: "scenario",
        run: scenario::run,
    },
    Target {
        name: "expression",
        run: expression::run,
    },
    Target {
        name: "fault",
        run: fault::run,
    },
    Target {
        name: "port",
        run: port::run,
    },
    Target {
        name: "recording",
        run: recording::run,
    },
    Target {
        name: "frame",
        run: frame::run,
    },
    Target {
        name: "hello",
        run: hello::run,
    },
    Target {
        name: "session",
        run: session::run,
    },
    Target {
        name: "panel",
        run: panel::run,
    },
    Target {
        name: "fmu",
        run: fmu::run,
    },
];

/// Checks that an error about bad input names something, and contains no control sequence of a terminal.
fn assert_told(told: &str) {
    assert!(!told.trim().is_empty(), "nothing is told");
    let steers = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
    assert!(!told.contains(steers), "a control character in {told:?}");
}
