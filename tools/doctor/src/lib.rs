//! `hil doctor`: checks the fitness of this machine for claims about timing, and suggests changes. The doctor changes
//! nothing and runs no scenario.
//!
//! 1. [`cores`] chooses the two cores that are checked.
//! 2. The checks read kernel files through a [`tree`]: [`cores`], [`isolation`], [`kernel`], [`throttling`],
//!    [`power`], [`rights`], [`memory`], [`activity`], [`host`], [`interrupts`].
//! 3. [`measure`] measures what no file contains: wake-ups, exchanges, gaps.
//! 4. Each of the [`checks`] gives one [`finding`]: a grade, and the command that remedies the problem ([`boot`] has the commands
//!    for the kernel's command line). A file that cannot be read makes the grade unknown; nothing is guessed.
//! 5. The [`report`] presents the findings and the conclusion.
//!
//! `hil run` stores [`facts`] in its recordings.

#![expect(
    rustdoc::private_intra_doc_links,
    reason = "the map leads into modules that are closed to other packages"
)]

#[macro_use]
extern crate hil_console; // its macro `tell!` is used everywhere

pub(crate) mod activity;
pub mod arguments;
pub(crate) mod boot;
pub(crate) mod checks;
pub mod cores;
pub(crate) mod finding;
pub(crate) mod host;
pub(crate) mod interrupts;
pub(crate) mod isolation;
pub(crate) mod kernel;
pub mod measure;
pub(crate) mod memory;
pub(crate) mod power;
pub(crate) mod report;
pub mod rights;
pub(crate) mod throttling;
pub mod tree;

use std::io::IsTerminal;

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_session::session;
use hil_session::shared_memory::SharedMemory;

use crate::arguments::DoctorArguments;
use checks::{WAKE_UP_IDLE, WAKE_UP_LOADED};
use cores::Cores;
use finding::{Finding, Grade};
use interrupts::{Interval, Snapshot};
use measure::{Class, company, gaps, ping_pong, wake_up};
use report::{Report, Verdict};
use tree::{Root, Tree};

/// Runs the command.
///
/// # Errors
/// If the chosen cores do not exist or may not be used.
pub fn doctor(arguments: &DoctorArguments) -> Result<Exit, Failure> {
    let machine = Root::machine();
    let cores = Cores::choose(&machine, arguments.cores)?;
    let before = Snapshot::take(&machine);
    // Read first, because measuring causes load as well.
    let mut checks = read(&machine, &cores);
    checks.push(sessions());
    let mut report = Report {
        schema: 1,
        verdict: Verdict::Fit,
        cores: cores.chosen.iter().collect(),
        online_cores: cores.online.to_string(),
        class: None,
        seconds: None,
        checks,
    };
    if arguments.quick {
        let since_boot = Interval::since_boot(before);
        report.checks.extend(counted(&machine, &cores, &since_boot));
    } else {
        let class = Class::of_this_thread(&machine).map_err(Failure::infrastructure)?;
        let measurement = Measurement {
            cores: &cores,
            seconds: arguments.seconds,
            class,
        };
        let mut measured = measurement.undisturbed()?;
        let interval = Interval::between(before, Snapshot::take(&machine));
        measured.push(measurement.loaded()?);
        report.checks.extend(counted(&machine, &cores, &interval));
        report.checks.extend(measured);
        report.class = Some(class.to_string());
        report.seconds = Some(arguments.seconds);
    }
    report.verdict = Verdict::of(&report.checks);
    if arguments.json {
        output::write(&output::pretty(&report)?)?;
    } else {
        output::write_coloured(&report.text(colours()))?;
    }
    Ok(match report.verdict {
        Verdict::Fit => Exit::Pass,
        Verdict::Unfit => Exit::Failed,
    })
}

/// Returns the facts about the machine that a recording stores: the grade and observation of each check that reads
/// files, by name. Takes a few milliseconds and measures nothing.
#[must_use]
pub fn facts() -> Vec<(String, String)> {
    facts_of(&Root::machine())
}

fn facts_of(tree: &dyn Tree) -> Vec<(String, String)> {
    let Ok(cores) = Cores::choose(tree, None) else {
        return Vec::new(); // a machine that tells nothing leaves nothing to keep
    };
    let since_boot = Interval::since_boot(Snapshot::take(tree));
    let findings = (read(tree, &cores).into_iter()).chain(counted(tree, &cores, &since_boot));
    let fact = |finding: Finding| {
        let Finding {
            check,
            grade,
            found,
            ..
        } = finding;
        (
            format!("doctor_{check}"),
            format!("{}: {found}", grade.word()),
        )
    };
    findings.map(fact).collect()
}

/// Runs the checks that read the current state.
fn read(tree: &dyn Tree, cores: &Cores) -> Vec<Finding> {
    vec![
        activity::load(tree, cores),
        cores::count(cores),
        cores::smt(tree, cores),
        isolation::isolation(tree, cores),
        isolation::quota(tree),
        kernel::preemption(tree),
        throttling::throttling(tree, cores),
        kernel::clock_source(tree),
        power::governor(tree, cores),
        power::idle_states(tree, cores),
        rights::priority(tree),
        rights::locked_memory(tree),
        memory::huge_pages(tree),
        memory::swap(tree),
        memory::shared_memory(tree, SharedMemory::look().ok()),
    ]
}

/// Runs the checks that read counters over an interval.
fn counted(tree: &dyn Tree, cores: &Cores, interval: &Interval) -> [Finding; 2] {
    [
        host::virtualisation(tree, cores, interval),
        interrupts::interrupts(tree, cores, interval),
    ]
}

fn sessions() -> Finding {
    let live = session::list().and_then(|live| Ok((live, session::dead()?)));
    match live {
        Ok((live, dead)) => {
            let live = live.into_iter().map(|session| session.name).collect();
            activity::sessions(Ok(live), &dead)
        }
        Err(error) => activity::sessions(Err(error), &[]),
    }
}

/// Returns `true` if standard output is a terminal and colours are not disabled.
fn colours() -> bool {
    std::io::stdout().is_terminal() && std::env::var_os("NO_COLOR").is_none()
}

/// Settings shared by all measurements.
struct Measurement<'a> {
    cores: &'a Cores,
    seconds: f64,
    class: Class,
}

impl Measurement<'_> {
    /// Runs all measurements without artificial load.
    fn undisturbed(&self) -> Result<Vec<Finding>, Failure> {
        let (seconds, class) = (self.seconds, self.class);
        let core = self.first_core()?;
        self.announce(&format!("contention on cores {}", self.cores.chosen));
        let company = company::measure(&Root::machine(), &self.cores.chosen, seconds);
        self.announce(&format!("wake-ups on core {core}"));
        let wake_ups = wake_up::measure(core, seconds).map_err(|e| self.unusable(&e))?;
        let idle = wake_up::finding(WAKE_UP_IDLE, &wake_ups, core, seconds, class);

        let chosen: Vec<u32> = self.cores.chosen.iter().collect();
        let exchange = match <[u32; 2]>::try_from(chosen.clone()) {
            Ok(pair) => {
                self.announce(&format!("exchanges between cores {}", self.cores.chosen));
                let trips = ping_pong::measure(pair, seconds).map_err(|e| self.unusable(&e))?;
                ping_pong::finding(&trips, pair, seconds, class)
            }
            Err(_) => ping_pong::impossible(),
        };

        let mut holes = Vec::new();
        for core in chosen {
            self.announce(&format!("gaps on core {core}"));
            holes.push(gaps::measure(core, seconds).map_err(|e| self.unusable(&e))?);
        }
        let holes = self.with_priority(gaps::finding(&holes, seconds, class));
        Ok(vec![company, self.with_priority(idle), exchange, holes])
    }

    /// Measures wake-ups while every core is busy.
    fn loaded(&self) -> Result<Finding, Failure> {
        let core = self.first_core()?;
        self.announce(&format!("wake-ups on core {core} under load"));
        let load = wake_up::Load::on(&self.cores.allowed.with(&self.cores.chosen));
        let wake_ups = wake_up::measure(core, self.seconds);
        if !load.end() {
            let reason = "the load would run at real-time priority as well";
            return Ok(WAKE_UP_LOADED.unknown(reason).mend(self.at_priority()));
        }
        let wake_ups = wake_ups.map_err(|e| self.unusable(&e))?;
        Ok(self.with_priority(wake_up::finding(
            WAKE_UP_LOADED,
            &wake_ups,
            core,
            self.seconds,
            self.class,
        )))
    }

    fn first_core(&self) -> Result<u32, Failure> {
        let first = self.cores.chosen.iter().next();
        first.ok_or_else(|| Failure::infrastructure("this machine reports no core to measure on"))
    }

    /// Adds the suggestion to measure at real-time priority: late wake-ups and gaps of an ordinary thread may be due to
    /// its own priority, but at real-time priority they are due to the machine.
    fn with_priority(&self, finding: Finding) -> Finding {
        if finding.grade == Grade::Good || self.class.is_real_time() {
            return finding;
        }
        finding.mend(self.at_priority())
    }

    /// Returns the command that measures at real-time priority; `-R` keeps the load at ordinary priority.
    fn at_priority(&self) -> String {
        let cores: Vec<String> = self.cores.chosen.iter().map(|c| c.to_string()).collect();
        let cores = match cores.len() {
            2 => format!(" --cores {}", cores.join(",")),
            _ => String::new(),
        };
        format!("sudo chrt -R -f 80 \"$(command -v hil)\" doctor{cores}")
    }

    fn unusable(&self, error: &std::io::Error) -> Failure {
        Failure::usage(format!(
            "cores {} cannot be measured: {error}; this process may use {}",
            self.cores.chosen, self.cores.allowed
        ))
    }

    fn announce(&self, what: &str) {
        tell!("measuring {what} for {} s", self.seconds);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::Fake;

    #[test]
    fn a_machine_without_readable_files_is_unknown_everywhere() {
        let machine = Fake::new(&[("sys/devices/system/cpu/online", "0-3")]);
        let cores = Cores::choose(&machine, None).expect("chosen");
        let since_boot = Interval::since_boot(Snapshot::take(&machine));
        let mut findings = read(&machine, &cores);
        findings.extend(counted(&machine, &cores, &since_boot));
        for finding in findings {
            // Only the number of cores is available.
            let expected = match finding.check {
                "cores" => Grade::Good,
                _ => Grade::Unknown,
            };
            assert_eq!(finding.grade, expected, "{}", finding.check);
        }
    }

    #[test]
    fn facts_consist_of_findings_and_grades() {
        let machine = Fake::new(&[
            ("sys/devices/system/cpu/online", "0-3"),
            ("proc/loadavg", "0.10 0.30 0.20 1/350 4242"),
            ("proc/swaps", "Filename\tType\tSize\tUsed\tPriority\n"),
        ]);
        let facts = facts_of(&machine);
        let of = |name: &str| {
            let fact = facts.iter().find(|(key, _)| key == name);
            fact.map(|(_, value)| value.as_str())
        };
        assert_eq!(of("doctor_swap"), Some("good: none"));
        assert_eq!(
            of("doctor_load"),
            Some("good: 0.10 on 4 cores in the last minute")
        );
        assert_eq!(of("doctor_cores"), Some("good: 4 online (0-3)"));
        assert_eq!(facts_of(&Fake::default()), []);
    }
}
