//! Bench `loop`: how fast is a whole run, and where does its time go?
//!
//! `cargo bench -p tests --bench loop` prints these tables, or some of them by name
//! (`cargo bench -p tests --bench loop -- costs idle`):
//!
//! - `runs`: the paper's scenario as `hil run` executes it: recorded with and without compression, not
//!   recorded, and in one process;
//! - `steps`: the plant's step and each law's step alone;
//! - `costs`: a plant and a law that do nothing, through engine, link and runner, in two processes, for
//!   more and more signals and observers, and against the bare exchanges;
//! - `one_core`: everything on one core;
//! - `idle`: what a held and a slowly paced run cost;
//! - `faults`: what the fault layer costs with no fault and with ten;
//! - `instruments`: what eight sensors of all stages cost, and with `HIL_BENCH_BEFORE=PATH` (`hil` of an older
//!   commit) what a run without instruments costs;
//! - `requirements`: what twenty requirements cost;
//! - `monitor`: what `hil monitor` in a terminal costs the run that it watches;
//! - `margins`: how long `hil margins` takes, in one process and in two;
//! - `report`: how long `hil report` takes, and the size of its page;
//! - `many`: what each of very many short runs costs, and whether the thousandth costs more than the first.
//!
//! Compared variants are measured in turns. There is no time limit on any number; how much of the
//! machine other programs took meanwhile is printed beside them. `HIL_BENCH_QUICK=1` only tries whether
//! they work.

mod costs;
#[path = "../shared/effort.rs"]
mod effort;
#[path = "../shared/experiment.rs"]
mod experiment;
mod faults;
mod idle;
mod instruments;
mod many;
mod margins;
#[path = "../shared/measure.rs"]
mod measure;
mod monitor;
mod null;
mod one_core;
#[path = "../shared/programs.rs"]
mod programs;
#[path = "../../shared/pseudo_terminal.rs"]
mod pseudo_terminal;
mod report;
mod requirements;
#[path = "../shared/round_trips/mod.rs"]
mod round_trips;
mod runs;
mod steps;
#[path = "../shared/watched.rs"]
mod watched;

use std::process::ExitCode;

fn main() -> ExitCode {
    if let Some(code) = null::answered() {
        return code;
    }
    if round_trips::answered() {
        return ExitCode::SUCCESS;
    }
    // `cargo test --all-targets` starts benches too, without this argument.
    if std::env::args().any(|argument| argument == "--bench") {
        println!("machine: {}\n", measure::machine());
        let programs = programs::Programs::built();
        let names = null::Names::given();
        let tables: [(&str, &dyn Fn()); 12] = [
            ("runs", &|| runs::compare(&programs)),
            ("steps", &steps::compare),
            ("costs", &|| costs::compare(&programs, &names)),
            ("one_core", &|| one_core::compare(&programs, &names)),
            ("idle", &|| idle::compare(&programs)),
            ("faults", &|| faults::compare(&programs)),
            ("instruments", &|| instruments::compare(&programs)),
            ("requirements", &|| requirements::compare(&programs)),
            ("monitor", &|| monitor::compare(&programs)),
            ("many", &|| many::compare(&programs)),
            ("margins", &|| margins::compare(&programs)),
            ("report", &|| report::compare(&programs)),
        ];
        let wanted: Vec<String> = (std::env::args().skip(1))
            .filter(|argument| !argument.starts_with('-'))
            .collect();
        for (name, compare) in tables {
            if wanted.is_empty() || wanted.iter().any(|wanted| wanted == name) {
                compare();
            }
        }
    } else {
        println!("run me with `cargo bench -p tests --bench loop`");
    }
    ExitCode::SUCCESS
}
