//! Faults of timing: a slow side, and a controller that misses steps.

use shared_types::describe::{ActsOn, Invalid, ListDescription};
use shared_types::directive::Directive;
use shared_types::number::{exact, exact_in};
use shared_types::random::RandomStream;
use shared_types::state::StateOf;

use super::whole;
use crate::faults::kind::{FaultKind, Moment, Setup};

shared_types::table! {
    /// Parameters of [`Late`].
    pub struct LateParameters {
        /// Busy time b per step.
        busy_us: "us" = 0.0 in 0.0..=1e6,
        /// Largest random addition s to the busy time.
        spread_us: "us" = 0.0 in 0.0..=1e6,
    }
}

/// Busy time of a side before it sends.
pub struct Late {
    parameters: LateParameters,
    /// Times in us with cumulative weights, of which the last is 1.
    histogram: Vec<(f64, f64)>,
    random: Option<RandomStream>,
}

impl FaultKind for Late {
    const NAME: &'static str = "late";
    const SUMMARY: &'static str =
        "A side is busy for a while before it sends. This costs time and changes nothing else.";
    const EQUATION: &'static str = "busy for (b + s u) g each step, u uniform in 0 .. 1; with a histogram for a length drawn from it, times g";
    const ACTS_ON: ActsOn = ActsOn::Sides;
    type Parameters = LateParameters;
    const OPTIONAL: &'static [&'static str] = &["busy_us", "spread_us"];

    fn list() -> Option<ListDescription> {
        Some(ListDescription {
            key: "histogram".into(),
            description: "Pairs of a busy time in us and its weight, for example as recorded; a new time is drawn each step.".into(),
            columns: 2,
        })
    }

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.random.clone(),
            |fault, random| fault.random = random,
        ))
    }

    fn start(setup: &Setup<'_, LateParameters>) -> Result<Self, Invalid> {
        let LateParameters { busy_us, spread_us } = setup.parameters;
        if busy_us + spread_us == 0.0 && setup.list.is_empty() {
            return Err(Invalid(
                "`late` needs `busy_us`, `spread_us` or `histogram`".into(),
            ));
        }
        if busy_us + spread_us > 0.0 && !setup.list.is_empty() {
            return Err(Invalid(
                "`histogram` replaces `busy_us` and `spread_us`; omit them".into(),
            ));
        }
        let mut histogram = Vec::new();
        let mut sum = 0.0;
        for pair in setup.list.chunks(2) {
            let &[length_us, weight] = pair else {
                return Err(Invalid("`histogram` has a length without a weight; give pairs of a length and a weight".into()));
            };
            if !(0.0..=1e6).contains(&length_us) || !(0.0..=1e300).contains(&weight) {
                return Err(Invalid(format!(
                    "`histogram` has {} with weight {}; lengths are 0 to 1e6 us, weights at least 0",
                    exact_in(length_us, "us"),
                    exact(weight)
                )));
            }
            sum += weight;
            histogram.push((length_us, sum));
        }
        if !histogram.is_empty() && sum <= 0.0 {
            return Err(Invalid("`histogram` has no positive weight".into()));
        }
        for (_, up_to) in &mut histogram {
            *up_to /= sum;
        }
        Ok(Self {
            parameters: setup.parameters,
            histogram,
            random: None,
        })
    }

    fn hold(&mut self, random: RandomStream) {
        self.random = Some(random);
    }

    fn timing(&mut self, at: &Moment, directive: &mut Directive) {
        let number = self.random.as_mut().map_or(0.0, RandomStream::uniform);
        let busy_us = if self.histogram.is_empty() {
            self.parameters.busy_us + self.parameters.spread_us * number
        } else {
            let place = self
                .histogram
                .partition_point(|&(_, up_to)| up_to <= number);
            self.histogram
                .get(place)
                .map_or(0.0, |&(length_us, _)| length_us)
        };
        let busy_ns = libm::round(busy_us * at.gain * 1e3) as u32; // saturates at both ends
        directive.busy_ns = directive.busy_ns.saturating_add(busy_ns);
    }
}

shared_types::table! {
    /// Parameters of [`Skip`].
    pub struct SkipParameters {
        /// Delay n of a command's effect, a whole number.
        steps: "steps" = 1.0 in 0.0..=1e5,
        /// Number m of late commands in a row, a whole number.
        burst: "1" = 1.0 in 1.0..=1e5,
        /// Steps from burst to burst, a whole number; 0: one burst.
        period_steps: "steps" = 0.0 in 0.0..=1e9,
    }
}

/// Steps missed by the controller.
pub struct Skip {
    steps: u32,
    burst: u64,
    period_steps: u64,
}

impl FaultKind for Skip {
    const NAME: &'static str = "skip";
    const SUMMARY: &'static str = "The controller misses steps: its command takes effect n steps later, and until then the last command holds.";
    const EQUATION: &'static str = "where g is not 0 the command of step k takes effect at step k + n, that of step k + n + 1 at step k + 2 n + 1, and so on, m in a row";
    const ACTS_ON: ActsOn = ActsOn::Controller;
    type Parameters = SkipParameters;
    const OPTIONAL: &'static [&'static str] = &["burst", "period_steps"];

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, SkipParameters>) -> Result<Self, Invalid> {
        let p = setup.parameters;
        let steps = whole("steps", p.steps)?;
        let burst = u64::from(whole("burst", p.burst)?);
        let period_steps = u64::from(whole("period_steps", p.period_steps)?);
        let length = burst * (u64::from(steps) + 1);
        if period_steps > 0 && period_steps < length {
            return Err(Invalid(format!(
                "a burst takes {length} steps, which is longer than `period_steps` {period_steps}; make the period longer or the burst shorter"
            )));
        }
        Ok(Self {
            steps,
            burst,
            period_steps,
        })
    }

    fn timing(&mut self, at: &Moment, directive: &mut Directive) {
        let since = if self.period_steps == 0 {
            at.since_steps
        } else {
            at.since_steps % self.period_steps
        };
        // While it is late the runner ignores samples; the next one it processes is after that.
        let apart = u64::from(self.steps) + 1;
        let strikes = since.is_multiple_of(apart) && since / apart < self.burst;
        if strikes && at.gain != 0.0 {
            directive.late_steps = directive.late_steps.saturating_add(self.steps);
        }
    }
}
