//! Bench `loop`: how fast is a whole run, and where does its time go?
//!
//! `cargo bench -p tests --bench loop` prints four tables:
//!
//! - the paper's scenario as `hil run` executes it: recorded with and without compression, not
//!   recorded, and in one process;
//! - the plant's step and each law's step alone;
//! - a plant and a law that do nothing, through engine, link and runner, in two processes, with and
//!   without the recorder;
//! - what the fault layer costs with no fault and with ten.
//!
//! What is compared is measured in turns. There is no time limit on any number; how much of the
//! machine other programs took meanwhile is printed beside them.

#[path = "../experiment.rs"]
mod experiment;
mod faults;
#[path = "../measure.rs"]
mod measure;
mod null;
#[path = "../programs.rs"]
mod programs;
mod runs;
mod steps;

/// Rounds, of which medians are taken.
const ROUNDS: usize = 5;

fn main() -> std::process::ExitCode {
    if let Some(code) = null::answered() {
        return code;
    }
    // `cargo test --all-targets` starts benches too, without this argument.
    if std::env::args().any(|argument| argument == "--bench") {
        println!("machine: {}\n", measure::machine());
        let programs = programs::Programs::built();
        runs::compare(&programs);
        steps::compare();
        null::compare(&programs);
        faults::compare(&programs);
    } else {
        println!("run me with `cargo bench -p tests --bench loop`");
    }
    std::process::ExitCode::SUCCESS
}
