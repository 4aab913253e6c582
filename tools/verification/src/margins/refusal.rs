//! Reasons why a response supports no margins.

use super::extremes::larger;
use super::locus::Margins;
use super::point::{Point, size};
use super::probe::Clipped;

/// Largest share of the loop's own motion in the response.
const OWN_MOTION: f64 = 0.1;
/// Largest relative change of L at half the amplitude, and from one window to another.
pub(super) const CHANGE: f64 = 0.02;
/// Gains at which the response decides about margins.
const DECISIVE: std::ops::RangeInclusive<f64> = 0.1..=10.0;
/// Growth of the own motion from one window to the next that shows an unstable loop.
const GROWTH: f64 = 1.2;

/// Returns the reason why a loop is not stable or not settled, if its motion grows by this share in each period.
pub(super) fn growing(growth: f64, period_s: f64, with: &str) -> String {
    let per_s = libm::log1p(growth) / period_s;
    format!(
        "the loop is unstable, or still settling: {with}, its own motion grows by {per_s:.3e} per second throughout the measurement; choose a later --at if it is stable"
    )
}

/// Returns the reason why responses support no margins, if there is one; `growth` is that of the loop's own motion.
pub(super) fn of(points: &[Point], growth: f64) -> Option<String> {
    if let Some(point) = points.iter().find(|point| !size(point.l).is_finite()) {
        return Some(format!(
            "there is no response at {:.4} Hz",
            point.frequency_hz
        ));
    }
    let worst = |of: &dyn Fn(&Point) -> f64| {
        let decisive = points
            .iter()
            .filter(|point| DECISIVE.contains(&size(point.l)));
        let all = decisive.map(|point| (of(point), point.frequency_hz));
        all.max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let own = worst(&|point| point.own).filter(|(own, _)| *own > OWN_MOTION);
    let unsteady = worst(&Point::unsteadiness).filter(|(share, _)| *share > CHANGE);
    if growth > GROWTH && (own.is_some() || unsteady.is_some()) {
        return Some(format!(
            "the loop is unstable, or follows a stimulus: without the probe, its own motion grows at least {growth:.2}-fold from one period of the measurement to the next; choose another --at if it is stable"
        ));
    }
    if let Some((own, hz)) = own {
        return Some(format!(
            "the loop moves by itself: at {hz:.4} Hz its own motion is {:.1} % of the response; raise --amplitude, or choose another --at",
            100.0 * own
        ));
    }
    if let Some((share, hz)) = unsteady {
        return Some(format!(
            "the response is not steady: at {hz:.4} Hz it changes by {:.1} % from one period to another, so the loop is unstable, still settling or disturbed; choose another --at",
            100.0 * share
        ));
    }
    if let Some((share, hz)) = worst(&Point::nonlinearity).filter(|(share, _)| *share > CHANGE) {
        return Some(format!(
            "the response depends on the amplitude: at {hz:.4} Hz L changes by {:.1} % at half the amplitude, as from a limit or friction; choose another --amplitude",
            100.0 * share
        ));
    }
    None
}

/// Returns the reason if rounding alone of a command of this size could change the response to an amplitude by
/// [`CHANGE`].
pub(super) fn rounded(amplitude: f64, command: f64) -> Option<String> {
    (CHANGE * amplitude < f64::EPSILON * command).then(|| {
        format!(
            "the response is lost in rounding: the amplitude {amplitude:e} is too small beside a command of up to {command:.4}; raise --amplitude"
        )
    })
}

/// Returns the reason to refuse phase and delay margin alone, if a locus has no crossover.
pub(super) fn without_crossover(points: &[Point], margins: &Margins) -> Option<String> {
    let [first, last] = [points.first()?, points.last()?];
    let side = match size(first.l) < 1.0 {
        true => "below",
        false => "above",
    };
    margins.crossovers.is_empty().then(|| {
        format!(
            "no crossover: |L| is {:.4} at {:.4} Hz and {:.4} at {:.4} Hz, and stays {side} 1 between; choose other --frequencies, unless the loop has none",
            size(first.l),
            first.frequency_hz,
            size(last.l),
            last.frequency_hz
        )
    })
}

/// Returns the reasons to refuse the gain margin and the least distance from -1 alone: what changes there, however
/// small L is.
pub(super) fn figures(points: &[Point], margins: &Margins) -> [Option<String>; 2] {
    let beside = |hz: f64| {
        let after = points.partition_point(|point| point.frequency_hz < hz);
        &points[after.saturating_sub(1)..points.len().min(after + 1)]
    };
    let reason = |hz: f64, share: &dyn Fn(&Point) -> f64| {
        let all = beside(hz).iter();
        let all = all.map(|point| {
            let change = larger(point.unsteadiness(), point.nonlinearity());
            share(point) * larger(change, point.own * CHANGE / OWN_MOTION)
        });
        let worst = all.fold(0.0, larger);
        (worst > CHANGE).then(|| {
            format!(
                "the response at {hz:.4} Hz is uncertain by {:.1} %, from period to period, at half the amplitude or by the loop's own motion; raise --amplitude, or choose another --at",
                100.0 * worst
            )
        })
    };
    let gain = (margins.phase_crossover()).and_then(|[hz, _]| reason(hz, &|_| 1.0));
    let to_distance = |point: &Point| size(point.l) / size((1.0 + point.l.0, point.l.1));
    [gain, reason(margins.disc[0], &to_distance)]
}

/// Returns the reason if an actuator stood at the end of its range while the probe ran; `own` has the steps at which it
/// does so without tones.
pub(super) fn limited(commands: &[String], limited: &[u64], own: &[u64]) -> Option<String> {
    let all = commands.iter().zip(limited).zip(own);
    let ((command, steps), own) = all.max_by_key(|((_, steps), _)| **steps)?;
    (*steps > 0).then(|| {
        let advice = match own {
            0 => "lower --amplitude, or choose another --at".to_owned(),
            own => format!(
                "without the probe the loop's own motion takes it there at {own} steps, as a limit cycle does, so no --amplitude helps; choose another --at, or mend the loop"
            ),
        };
        format!(
            "saturation: the actuator of command.{command} is at the end of its range at {steps} steps while the probe runs; {advice}"
        )
    })
}

/// Returns the reason if the law's command stands at a value while the probe runs; `own` is `true` if it does so without
/// tones, too.
pub(super) fn clipped(clipped: &Clipped, own: bool) -> String {
    let value = clipped.value;
    if clipped.is_throughout {
        return format!(
            "saturation: the law's command stands at {value} throughout, whatever the probe does, so it is at a limit, held by a fault, or the law uses no signal that moves; choose another --at, or mend the loop"
        );
    }
    let advice = match own {
        false => "while the probe runs; lower --amplitude, or choose another --at",
        true => {
            "while the probe runs, and without the probe the loop's own motion takes it there, so no --amplitude helps; choose another --at, or mend the loop"
        }
    };
    format!("saturation: the law's command stands at {value} for several steps {advice}")
}
