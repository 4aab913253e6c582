//! `[run]`: rate, number of steps, seed and clock.

use shared_types::lockstep::OnLoss;
use shared_types::number::exact as number;
use shared_types::pacer::OverrunPolicy;
use shared_types::time::{Rate, Step};

use crate::keys::MAX_STEPS;
use crate::plan::{Clock, Run};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Steps of a run and their times, into which the rest of a scenario must fit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// Exchange rate.
    pub rate: Rate,
    /// Number of steps.
    pub steps: u64,
}

impl Grid {
    /// Returns the time of the final record.
    pub(super) fn end_s(&self) -> f64 {
        self.rate.seconds(Step(self.steps))
    }
}

/// Returns the whole section, and the grid, which the other parts need even if seed or clock are faulty.
pub(super) fn check(reader: &mut Reader, root: &Section<'_>) -> (Option<Grid>, Option<Run>) {
    let Some(section) = reader.section(root, "run") else {
        return (None, None);
    };
    reader.refuse_unknown(&section, &[]);
    let duration_s = reader.number(&section, "duration_s");
    let rate = reader.number(&section, "rate_hz").and_then(Rate::new);
    let seed = reader.integer(&section, "seed");
    let factor = reader.number(&section, "pace");
    let clock = match reader.text(&section, "clock") {
        Some("paced") => factor.map(|factor| Clock::Paced { factor }),
        Some("realtime") => Some(Clock::Realtime),
        Some(_) => Some(Clock::Lockstep),
        None => None,
    };
    let grid = match (duration_s, rate) {
        (Some(duration_s), Some(rate)) => {
            steps(reader, &section, duration_s, rate).map(|steps| Grid { rate, steps })
        }
        _ => None,
    };
    let overrun = reader.text(&section, "overrun").and_then(|name| {
        let mut policies = OverrunPolicy::ALL.into_iter();
        policies.find(|policy| policy.name() == name)
    });
    let deadline = reader.number(&section, "deadline");
    let on_controller_loss = (reader.text(&section, "on_controller_loss"))
        .and_then(|name| OnLoss::ALL.into_iter().find(|policy| policy.name() == name));
    let run = || {
        let Grid { rate, steps } = grid?;
        Some(Run {
            rate,
            steps,
            seed: seed?.unsigned_abs(), // its range begins at 0
            clock: clock?,
            overrun: overrun?,
            deadline: deadline?,
            on_controller_loss: on_controller_loss?,
        })
    };
    (grid, run())
}

/// Returns the number of steps of a duration, which must be whole.
fn steps(reader: &mut Reader, section: &Section<'_>, duration_s: f64, rate: Rate) -> Option<u64> {
    let exact = duration_s * rate.hz();
    let product = format!(
        "{} s at {} Hz is {} steps",
        number(duration_s),
        number(rate.hz()),
        number((exact * 1e6).round() / 1e6)
    );
    if exact > MAX_STEPS as f64 {
        reader
            .report_at(section, "duration_s", ProblemKind::OutOfRange, product)
            .expected(format!("at most 2^40 = {MAX_STEPS} steps"));
        return None;
    }
    let whole = exact.round();
    // Decimal durations and rates are not exact in binary: allow for rounding of the product, far below any intended
    // fraction.
    if whole >= 1.0 && (exact - whole).abs() <= 1e-9 + 1e-15 * whole {
        return Some(whole as u64);
    }
    let below = Step(exact as u64);
    let neighbours = match below {
        Step(0) => number(rate.seconds(Step(1))),
        _ => format!(
            "{} or {}",
            number(rate.seconds(below)),
            number(rate.seconds(below.next()))
        ),
    };
    reader
        .report_at(section, "duration_s", ProblemKind::Mismatch, product)
        .expected("a whole number of steps, at least 1")
        .help(format!("the nearest durations are {neighbours} s"));
    None
}
