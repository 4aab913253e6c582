//! `[run]`: rate, number of steps, seed and clock.

use shared_types::time::{Rate, Step};

use crate::keys::MAX_STEPS;
use crate::plan::{Clock, Run};
use crate::problem::ProblemKind;
use crate::quantity::number;
use crate::reader::{Reader, Section};

pub(super) fn check(reader: &mut Reader, root: &Section<'_>) -> Option<Run> {
    let section = reader.section(root, "run")?;
    reader.refuse_unknown(&section, &[]);
    let duration_s = reader.number(&section, "duration_s");
    let rate = reader.number(&section, "rate_hz").and_then(Rate::new);
    let seed = reader.integer(&section, "seed");
    let factor = reader.number(&section, "pace");
    let clock = match reader.text(&section, "clock") {
        Some("paced") => factor.map(|factor| Clock::Paced { factor }),
        Some(_) => Some(Clock::Lockstep),
        None => None,
    };
    let steps = steps(reader, &section, duration_s?, rate?);
    Some(Run {
        rate: rate?,
        steps: steps?,
        seed: u64::try_from(seed?).ok()?,
        clock: clock?,
    })
}

/// The number of steps of a duration, which must be whole.
fn steps(reader: &mut Reader, section: &Section<'_>, duration_s: f64, rate: Rate) -> Option<u64> {
    let exact = duration_s * rate.hz();
    let path = section.path_of("duration_s");
    let place = section.place_of("duration_s");
    let product = format!(
        "{} s at {} Hz are {} steps",
        number(duration_s),
        number(rate.hz()),
        number(exact)
    );
    if exact > MAX_STEPS as f64 {
        reader
            .report(ProblemKind::OutOfRange, path, place, product)
            .expected(format!("at most 2^40 = {MAX_STEPS} steps"));
        return None;
    }
    let whole = exact.round();
    // Decimal durations and rates are not exact in binary: allow for the rounding of the product,
    // far below anything that a person would write on purpose.
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
        .report(ProblemKind::Mismatch, path, place, product)
        .expected("a whole number of steps, at least 1")
        .help(format!("the nearest durations are {neighbours} s"));
    None
}
