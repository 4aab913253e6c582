//! The ten worst steps, with the events in both threads around them.
//!
//! Plant and controller sample the statistics of their own threads after an unusual step and periodically
//! ([`ThreadStatistics`]); a record carries the latest sample of each. The difference of two samples, before and after
//! a spike, shows the events in between, which may include more than the spike. A spike that neither thread noticed had
//! an external cause: an interrupt, firmware or a hypervisor.

use hil_console::terminal::duration::shown_ns;
use serde::Serialize;
use shared_types::number::counted;
use shared_types::record::Timing;
use shared_types::thread::ThreadStatistics;

/// Number of retained spikes.
pub const KEPT: usize = 10;

/// Step that took long, or whose sample was sent late.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Spike {
    /// The step.
    pub step: u64,
    /// Time from sending the step's sample to receiving its command; 0 without a command.
    pub round_trip_ns: u64,
    /// The controller's share of the round trip.
    pub controller_ns: u64,
    /// The plant's preceding integration, which is not part of the round trip.
    pub plant_ns: u64,
    /// Delay of the sample beyond its due time; 0 if it had no due time.
    pub late_ns: u64,
    /// Statistics of the plant's thread since the previous sample; `None` if there was none.
    pub plant_thread: Option<Since>,
    /// Statistics of the controller's thread since the previous sample; `None` if there was none, or for a new
    /// controller.
    pub controller_thread: Option<Since>,
}

/// Statistics of a thread between two samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Since {
    /// Core of the thread at the previous sample.
    pub from_core: u16,
    /// Core of the thread at the later sample.
    pub core: u16,
    /// Context switches.
    pub switches: u32,
    /// Page faults.
    pub faults: u32,
}

impl Since {
    /// Compares two samples, encoded as words.
    fn between(before: u64, after: u64) -> Self {
        let [before, after] = [before, after].map(ThreadStatistics::from_wire);
        let (switches, faults) = after.since(before);
        Self {
            from_core: before.core,
            core: after.core,
            switches,
            faults,
        }
    }

    /// Describes the events in words; `None` if there were none.
    fn describe(&self) -> Option<String> {
        let mut parts = Vec::new();
        if self.from_core != self.core {
            parts.push(format!(
                "moved from core {} to {}",
                self.from_core, self.core
            ));
        }
        if self.switches > 0 {
            parts.push(counted(self.switches.into(), "switch").replace("switchs", "switches"));
        }
        if self.faults > 0 {
            parts.push(counted(self.faults.into(), "page fault"));
        }
        (!parts.is_empty()).then(|| parts.join(", "))
    }
}

impl Spike {
    /// Describes the events in both threads around the spike.
    #[must_use]
    pub fn surroundings(&self) -> String {
        let threads = [
            ("plant", self.plant_thread),
            ("controller", self.controller_thread),
        ];
        if threads.iter().all(|(_, since)| since.is_none()) {
            return "no earlier thread statistics".into();
        }
        let events: Vec<String> = (threads.into_iter())
            .filter_map(|(who, since)| Some(format!("{who} {}", since?.describe()?)))
            .collect();
        if events.is_empty() {
            "neither thread noticed".into()
        } else {
            events.join("; ")
        }
    }

    /// Describes step, delay of its sample, and thread events.
    pub(crate) fn describe_release(&self) -> String {
        let (step, late) = (self.step, shown_ns(self.late_ns));
        format!("step {step}, {late} late; {}", self.surroundings())
    }

    /// Describes step, durations, and thread events.
    #[must_use]
    pub fn describe(&self) -> String {
        let round_trip = shown_ns(self.round_trip_ns);
        let controller = shown_ns(self.controller_ns);
        let (step, events) = (self.step, self.surroundings());
        format!("step {step}, {round_trip}, of which controller {controller}; {events}")
    }
}

/// Criterion for the worst steps.
#[derive(Clone, Copy, Debug)]
pub enum Order {
    /// Round trip.
    RoundTrip,
    /// Delay of the sent sample.
    Release,
}

impl Order {
    const fn ns(self, spike: &Spike) -> u64 {
        match self {
            Self::RoundTrip => spike.round_trip_ns,
            Self::Release => spike.late_ns,
        }
    }

    const fn of(self, timing: &Timing) -> u64 {
        match self {
            Self::RoundTrip => timing.round_trip_ns,
            Self::Release => timing.late_ns,
        }
    }
}

/// Worst steps so far. Every other step costs one comparison.
#[derive(Clone, Debug)]
pub(crate) struct Spikes {
    order: Order,
    /// Worst steps, longest first.
    worst: Vec<Spike>,
    /// Time in ns that a step must exceed to be one of the worst.
    least_ns: u64,
    before: Option<Looks>,
    open: Option<Open>,
}

/// Latest thread statistics of both sides, as words.
#[derive(Clone, Copy, Debug)]
struct Looks {
    epoch: u64,
    plant: u64,
    controller: u64,
}

impl Looks {
    const fn of(timing: &Timing) -> Self {
        Self {
            epoch: timing.epoch,
            plant: timing.plant_surroundings,
            controller: timing.controller_surroundings,
        }
    }
}

/// Spike whose controller may not have sampled its statistics since: a delay of the controller after it computed its
/// command shows only in the next record.
#[derive(Clone, Copy, Debug)]
struct Open {
    place: usize,
    before: Looks,
}

impl Spikes {
    /// Creates an empty list.
    pub(crate) const fn new(order: Order) -> Self {
        Self {
            order,
            worst: Vec::new(),
            least_ns: 0,
            before: None,
            open: None,
        }
    }

    /// Adds the timing of a step.
    pub(crate) fn take(&mut self, step: u64, timing: &Timing) {
        // A step without a command repeats the sample that arrived with the last command.
        if timing.round_trip_ns > 0
            && let Some(open) = self.open.take()
            && open.before.epoch == timing.epoch
        {
            let spike = &mut self.worst[open.place];
            let since = Since::between(open.before.controller, timing.controller_surroundings);
            spike.controller_thread = Some(since);
        }
        if self.order.of(timing) > self.least_ns {
            self.keep(step, timing);
        }
        self.before = Some(Looks::of(timing));
    }

    fn keep(&mut self, step: u64, timing: &Timing) {
        // Another controller is another thread, whose statistics cannot be compared.
        let same_controller = self.before.filter(|before| before.epoch == timing.epoch);
        let spike = Spike {
            step,
            round_trip_ns: timing.round_trip_ns,
            controller_ns: timing.controller_ns,
            plant_ns: timing.plant_ns,
            late_ns: timing.late_ns,
            plant_thread: (self.before)
                .map(|before| Since::between(before.plant, timing.plant_surroundings)),
            controller_thread: same_controller
                .map(|before| Since::between(before.controller, timing.controller_surroundings)),
        };
        // Among equals the earlier one comes first.
        let order = self.order;
        let is_longer = |worst: &Spike| order.ns(worst) >= order.ns(&spike);
        let place = self.worst.partition_point(is_longer);
        self.worst.insert(place, spike);
        self.worst.truncate(KEPT);
        if self.worst.len() == KEPT {
            self.least_ns = order.ns(&self.worst[KEPT - 1]);
        }
        self.open = same_controller.map(|before| Open { place, before });
    }

    /// Returns the worst steps, longest first.
    pub(crate) fn worst(&self) -> &[Spike] {
        &self.worst
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn word(core: u16, switches: u32, faults: u32) -> u64 {
        ThreadStatistics {
            core,
            switches,
            faults,
        }
        .to_wire()
    }

    fn timing(round_trip_ns: u64, plant: u64, controller: u64) -> Timing {
        Timing {
            epoch: 1,
            round_trip_ns,
            controller_ns: 300,
            plant_ns: 700,
            plant_surroundings: plant,
            controller_surroundings: controller,
            ..Timing::default()
        }
    }

    #[test]
    fn the_ten_longest_are_kept_and_of_equals_the_first() {
        let mut spikes = Spikes::new(Order::RoundTrip);
        // Every round trip from 1000 to 1099 ns twice, neither increasing nor decreasing.
        for step in 0..200 {
            spikes.take(step, &timing(1000 + step * 37 % 100, 0, 0));
        }
        let worst: Vec<u64> = spikes.worst().iter().map(|s| s.round_trip_ns).collect();
        let expected = [1099, 1099, 1098, 1098, 1097, 1097, 1096, 1096, 1095, 1095];
        assert_eq!(worst, expected);
        for pair in spikes.worst().chunks(2) {
            assert_eq!(pair[0].step + 100, pair[1].step);
        }
    }

    #[test]
    fn the_latest_releases_are_kept_even_of_steps_without_a_command() {
        let mut spikes = Spikes::new(Order::Release);
        for step in 0..100 {
            let missed = step % 2 == 1;
            let late = Timing {
                late_ns: step * 100,
                held_steps: missed.into(),
                ..timing(if missed { 0 } else { 5_000 }, 0, 0)
            };
            spikes.take(step, &late);
        }
        let latest = spikes.worst()[0];
        assert_eq!((latest.step, latest.round_trip_ns), (99, 0));
        let description = latest.describe_release();
        assert_eq!(description, "step 99, 9.90 us late; neither thread noticed");
    }

    #[test]
    fn a_spike_is_described_with_its_step_and_the_events_in_each_thread() {
        let calm = (word(0, 5, 70), word(1, 9, 40));
        for (plant, controller, later, expected) in [
            (
                word(1, 8, 70),
                calm.1,
                calm.1,
                "plant moved from core 0 to 1, 3 switches",
            ),
            (
                calm.0,
                word(1, 9, 41),
                word(1, 9, 41),
                "controller 1 page fault",
            ),
            // The controller was switched out after its sample: the next record shows it.
            (calm.0, calm.1, word(1, 10, 40), "controller 1 switch"),
            (
                word(0, 6, 72),
                word(0, 9, 40),
                word(0, 9, 40),
                "plant 1 switch, 2 page faults; controller moved from core 1 to 0",
            ),
            (calm.0, calm.1, calm.1, "neither thread noticed"),
        ] {
            let mut spikes = Spikes::new(Order::RoundTrip);
            for step in 0..1000 {
                spikes.take(step, &timing(1300, calm.0, calm.1));
            }
            spikes.take(1000, &timing(812_000, plant, controller));
            for step in 1001..2000 {
                spikes.take(step, &timing(1300, plant, later));
            }
            let worst = spikes.worst()[0];
            assert_eq!((worst.step, worst.round_trip_ns), (1000, 812_000));
            assert_eq!((worst.controller_ns, worst.plant_ns), (300, 700));
            assert_eq!(worst.surroundings(), expected);
            let description = format!("step 1000, 812 us, of which controller 300 ns; {expected}");
            assert_eq!(worst.describe(), description);
        }
    }

    #[test]
    fn a_spike_without_earlier_statistics_claims_nothing() {
        let mut spikes = Spikes::new(Order::RoundTrip);
        spikes.take(0, &timing(9000, word(0, 1, 1), word(1, 1, 1)));
        assert_eq!(
            spikes.worst()[0].surroundings(),
            "no earlier thread statistics"
        );
    }

    #[test]
    fn another_controller_is_not_compared_with_the_one_before() {
        let mut spikes = Spikes::new(Order::RoundTrip);
        spikes.take(0, &timing(1000, word(0, 1, 1), word(1, 900, 900)));
        let next = Timing {
            epoch: 2,
            ..timing(9000, word(0, 1, 1), word(1, 3, 3))
        };
        spikes.take(1, &next);
        let worst = spikes.worst()[0];
        assert_eq!((worst.step, worst.controller_thread), (1, None));
        assert_eq!(worst.plant_thread, Some(Since::default()));
    }
}
