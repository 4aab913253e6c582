//! Check of a port as a side of a run: periods in steps, ages, and the ends of frames. Nothing is opened.

use hil_codec::frame::{Body, Frame};
use hil_config::port::{Carries, Exchange, MediumKind, Port, PortFrame};
use shared_types::time::Rate;

use crate::medium::Cut;

/// Returns the number of steps of the period of a frame, for a side that runs once in `period_s`.
pub(super) fn steps(frame: &PortFrame, period_s: f64) -> Result<u64, String> {
    let rate = Rate::new(1.0 / period_s).ok_or_else(|| format!("no port runs at {period_s} s"))?;
    frame.period.steps(rate).map_err(|(below, above)| {
        let name = &frame.frame.name;
        format!(
            "the period of frame `{name}` is no whole number of steps of {period_s} s; use {below} s or {above} s"
        )
    })
}

/// Returns the largest age in steps of an accepted value.
pub(super) fn age_limit(stale_s: f64, period_s: f64) -> u32 {
    let steps = (stale_s / period_s * (1.0 + 1e-9)).floor();
    // A conversion from a float saturates.
    steps as u32
}

/// Returns the ends of the frames that arrive on a medium.
pub(super) fn cut<'a>(
    kind: &MediumKind,
    frames: impl Iterator<Item = &'a Frame>,
) -> Result<Cut, String> {
    if kind.is_stream() {
        return Cut::of(frames, matches!(kind, MediumKind::Serial { .. }));
    }
    let mut bodies = frames.map(|frame| &frame.body);
    Ok(match bodies.any(|body| matches!(body, Body::Json(_))) {
        true => Cut::Line,
        false => Cut::Lengths(Vec::new()),
    })
}

/// Checks a port as a side of a run that sends one direction, without opening anything.
///
/// # Errors
/// If the period of a frame is no whole number of steps, or a frame has no medium.
pub fn check(port: &Port, sends: Carries, period_s: f64) -> Result<(), String> {
    for frame in &port.frames {
        steps(frame, period_s)?;
        if frame.medium.is_none() {
            let name = &frame.frame.name;
            return Err(format!(
                "frame `{name}` has no medium; the far end of a port is reached by one"
            ));
        }
    }
    let of = |carries| port.frames.iter().filter(move |one| one.carries == carries);
    for (index, medium) in port.media.iter().enumerate() {
        let received = of(sends.other()).filter(|one| one.medium == Some(index));
        cut(&medium.kind, received.map(|one| &one.frame))
            .map_err(|error| format!("medium `{}`: {error}", medium.name))?;
    }
    // A plant behind a port waits for nobody.
    if port.exchange == Exchange::Free || sends == Carries::Command {
        return Ok(());
    }
    for command in of(Carries::Command) {
        let divider = steps(command, period_s)?;
        let mut samples = of(Carries::Sample).filter_map(|sample| steps(sample, period_s).ok());
        if !samples.any(|sample| divider.is_multiple_of(sample)) {
            let name = &command.frame.name;
            return Err(format!(
                "frame `{name}` is awaited at steps at which no sample is sent that it could answer; give it the period of a sample, or use `exchange = \"free\"`"
            ));
        }
    }
    Ok(())
}
