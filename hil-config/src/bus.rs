//! Bus in simulation: the frames of a port file with all their times in steps.
//!
//! Read by the check of a scenario, by `show` and by the plant, which packs and unpacks the frames. Opens no medium.

use std::path::Path;

use hil_codec::frame::Frame;
use hil_codec::pack::{Packer, Unusable};
use shared_types::layout::SignalTable;
use shared_types::number::exact_in;
use shared_types::time::Rate;

use crate::plan::BusPlan;
use crate::port::{Carries, Port, PortFrame, PortTables};
use crate::problem::Problems;

/// Largest delay of a frame in steps, as of a message.
pub const MOST_DELAY_STEPS: u64 = 1000;
/// Largest memory for frames in transit, in bytes.
const MOST_MEMORY: u64 = 64 << 20;

/// Frame of a bus.
#[derive(Clone, Debug, PartialEq)]
pub struct BusFrame {
    /// Layout and contents.
    pub frame: Frame,
    /// Direction.
    pub carries: Carries,
    /// Steps from one frame to the next.
    pub period_steps: u64,
    /// Age in steps above which a received value is stale.
    pub stale_steps: Option<u32>,
    /// Steps for which a received frame suppresses older ones of the other network.
    pub skew_steps: u64,
}

impl BusFrame {
    /// Returns the largest number of frames in transit.
    #[must_use]
    pub const fn most_in_transit(&self) -> u64 {
        MOST_DELAY_STEPS / self.period_steps + 2
    }
}

/// Reads the port file of a bus; messages name it as `origin`.
///
/// # Errors
/// All problems.
pub fn read(plan: &BusPlan, origin: &Path, tables: &PortTables<'_>) -> Result<Port, Problems> {
    Port::parse_with(&plan.text, origin, Some(tables), &plan.dbc)
}

/// Returns the frames with their times in steps.
///
/// # Errors
/// For each frame that this rate cannot carry, the reason and what would be possible.
pub fn frames(
    port: &Port,
    plan: &BusPlan,
    rate: Rate,
) -> Result<Vec<BusFrame>, Vec<(String, String)>> {
    let (mut frames, mut wrong) = (Vec::new(), Vec::new());
    for one in &port.frames {
        match frame(one, plan, rate) {
            Ok(frame) => frames.push(frame),
            Err(reason) => wrong.push(reason),
        }
    }
    if wrong.is_empty() {
        Ok(frames)
    } else {
        Err(wrong)
    }
}

fn frame(one: &PortFrame, plan: &BusPlan, rate: Rate) -> Result<BusFrame, (String, String)> {
    let name = &one.frame.name;
    let period_steps = one.period.steps(rate).map_err(|(below, above)| {
        let rate = exact_in(rate.hz(), "Hz");
        let (below, above) = (exact_in(below, "s"), exact_in(above, "s"));
        (
            format!("the period of frame `{name}` is no whole number of steps at {rate}"),
            format!("a whole number of steps; the nearest are {below} and {above}"),
        )
    })?;
    let stale_steps = one.stale_s.map(|stale_s| {
        // A limit of a whole number of steps must not lose one by rounding.
        (stale_s * rate.hz() * (1.0 + 1e-9)) as u32
    });
    if let (Some(steps), Some(stale_s)) = (stale_steps, one.stale_s)
        && u64::from(steps) + 1 < period_steps
    {
        let period = exact_in(period_steps as f64 * rate.period_s(), "s");
        let stale = exact_in(stale_s, "s");
        return Err((
            format!(
                "values of frame `{name}` are stale after {stale}, before the next one comes after {period}"
            ),
            format!("`stale_s` of at least {period}"),
        ));
    }
    Ok(BusFrame {
        frame: one.frame.clone(),
        carries: one.carries,
        period_steps,
        stale_steps,
        skew_steps: plan.skew_limit_steps.unwrap_or(period_steps),
    })
}

/// Returns the memory for frames in transit in bytes if it is too large, and the limit.
///
/// # Errors
/// If a frame does not fit the tables.
pub fn excess(
    frames: &[BusFrame],
    networks: u8,
    table: impl Fn(Carries) -> SignalTable,
) -> Result<Option<(u64, u64)>, Unusable> {
    let mut memory = 0;
    for frame in frames {
        let packer = Packer::new(&frame.frame, &table(frame.carries))?;
        memory += packer.longest() as u64 * frame.most_in_transit() * u64::from(networks);
    }
    Ok((memory > MOST_MEMORY).then_some((memory, MOST_MEMORY)))
}
