//! The controller of the workspace, rebuilt with one change in each law. Not a program of the
//! workspace: the tests of `hil replay` give it to `--controller-bin`.
//!
//! | law | what is new |
//! |---|---|
//! | `pid` of the mass on a spring | the last bit of one command |
//! | `pid` of the hydraulic system | a command is gone |
//! | `ftsc` | its internal `fault_detected` is 1e-9 more |
//! | `nrsc` | it never answers a certain sample |
//! | `hold` | it panics there |

use std::process::ExitCode;

use controller_process::controller::{Law, LawKind, Row, Start};
use controller_process::laws;
use shared_types::describe::Invalid;
use shared_types::failure::Failure;

/// Sample from which a law differs.
const WHEN: u64 = 137;
/// Plant of the simplest law.
const SPRING_MASS: &str = "spring-mass";

/// A law with modified answers.
struct Changed {
    law: Box<dyn Law>,
    change: fn(sample: u64, command: &mut [f64], internals: &mut [f64]),
    samples: u64,
}

impl Law for Changed {
    fn step(
        &mut self,
        sample: &Row<'_>,
        command: &mut [f64],
        internals: &mut [f64],
    ) -> Result<(), Failure> {
        self.law.step(sample, command, internals)?;
        (self.change)(self.samples, command, internals);
        self.samples += 1;
        Ok(())
    }
}

/// Returns a shipped law by name, modified.
fn changed(
    start: &Start<'_>,
    is_it: fn(&LawKind) -> bool,
    change: fn(u64, &mut [f64], &mut [f64]),
) -> Result<Box<dyn Law>, Invalid> {
    let laws = laws::all();
    let shipped = laws.iter().find(|law| is_it(law));
    let shipped = shipped.ok_or_else(|| Invalid("no such law".into()))?;
    Ok(Box::new(Changed {
        law: (shipped.start)(start)?,
        change,
        samples: 0,
    }))
}

fn is_simple_pid(law: &LawKind) -> bool {
    law.description.name == "pid"
        && law
            .description
            .plants
            .iter()
            .any(|name| name == SPRING_MASS)
}

fn main() -> ExitCode {
    let mut laws = laws::all();
    for law in &mut laws {
        let simple = is_simple_pid(law);
        let description = &mut law.description;
        match description.name.as_str() {
            "pid" if simple => {
                law.start = Box::new(|start| {
                    changed(start, is_simple_pid, |sample, command, _| {
                        if sample == WHEN {
                            command[0] = command[0].next_up();
                        }
                    })
                });
            }
            "pid" => {
                if let Some(commands) = &mut description.commands {
                    commands.pop();
                }
            }
            "ftsc" => {
                law.start = Box::new(|start| {
                    let is_it = |law: &LawKind| law.description.name == "ftsc";
                    changed(start, is_it, |_, _, internals| internals[2] += 1e-9)
                });
            }
            "nrsc" => {
                law.start = Box::new(|start| {
                    let is_it = |law: &LawKind| law.description.name == "nrsc";
                    changed(start, is_it, |sample, _, _| {
                        if sample == WHEN {
                            loop {
                                std::thread::park();
                            }
                        }
                    })
                });
            }
            "hold" => {
                law.start = Box::new(|start| {
                    let is_it = |law: &LawKind| law.description.name == "hold";
                    changed(start, is_it, |sample, _, _| {
                        assert!(sample < WHEN, "the law fell over");
                    })
                });
            }
            _ => {}
        }
    }
    controller_process::program::run("rebuilt-controller", "0.1.0", laws)
}
