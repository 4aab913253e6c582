//! Contention in a run: the processor time used by other programs meanwhile.

use std::fmt;

use rustix::thread::{CpuSet, sched_getaffinity};
use serde::Serialize;

/// Share of the cores used by others from which they are reported.
const WORTH_TELLING: f64 = 0.1;

/// CPU load by other programs during a run, on the cores available to it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Company {
    /// Average number of cores that other programs kept busy.
    others_cores: f64,
    /// Number of cores available to the run.
    cores: usize,
}

/// Processor time so far, in ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProcessorTime {
    cores: usize,
    /// Total time of the allowed cores.
    all: u64,
    /// Time used by any program.
    busy: u64,
    /// Time used by this process and by its children that have been waited for: concurrent runs count as others until
    /// they end.
    own: u64,
}

/// Parses `/proc/stat`: for each core, its used ticks and all its ticks.
pub fn core_times(stat: &str) -> impl Iterator<Item = (u32, u64, u64)> {
    stat.lines().filter_map(|line| {
        let mut words = line.split_ascii_whitespace();
        let core = words.next()?.strip_prefix("cpu")?.parse().ok()?;
        // user nice system idle iowait irq softirq; the steal time after them is not used by programs of this machine
        let ticks: Vec<u64> = words.take(7).filter_map(|word| word.parse().ok()).collect();
        let all: u64 = ticks.iter().sum();
        let idle: u64 = ticks.iter().skip(3).take(2).sum();
        Some((core, all - idle, all))
    })
}

impl ProcessorTime {
    /// Reads the current values; empty where the system does not provide them.
    #[must_use]
    pub fn now() -> Self {
        let read = |path| std::fs::read_to_string(path).unwrap_or_default();
        let allowed = sched_getaffinity(None).unwrap_or_else(|_| CpuSet::new());
        let is_allowed = |core| core < CpuSet::MAX_CPU && allowed.is_set(core);
        Self::of(&read("/proc/stat"), &read("/proc/self/stat"), is_allowed)
    }

    fn of(machine: &str, own: &str, is_allowed: impl Fn(usize) -> bool) -> Self {
        let number = |word: &str| word.parse::<u64>().unwrap_or_default();
        let mut time = Self::default();
        for (_, busy, all) in core_times(machine).filter(|(core, ..)| is_allowed(*core as usize)) {
            time.cores += 1;
            time.all += all;
            time.busy += busy;
        }
        // The name may contain anything; after it follow user and system time, then those of children.
        let (_, rest) = own.rsplit_once(')').unwrap_or_default();
        time.own = (rest.split_ascii_whitespace().skip(11).take(4))
            .map(number)
            .sum();
        time
    }

    /// Returns the share of the allowed cores used by other programs since an earlier measurement, 0 to 1.
    #[must_use]
    pub fn others_share(&self, since: &Self) -> f64 {
        let of = |part: fn(&Self) -> u64| part(self).saturating_sub(part(since)) as f64;
        let (all, others) = (
            of(|time| time.all),
            of(|time| time.busy) - of(|time| time.own),
        );
        if all > 0.0 && others > 0.0 {
            others / all
        } else {
            0.0
        }
    }

    /// Returns the contention since an earlier measurement.
    pub fn company(&self, since: &Self) -> Company {
        Company {
            others_cores: self.cores as f64 * self.others_share(since),
            cores: self.cores,
        }
    }
}

impl Company {
    /// Returns `true` if other programs used so much time that the times of the run show it.
    pub(crate) fn is_worth_telling(&self) -> bool {
        self.others_cores > WORTH_TELLING * self.cores as f64
    }
}

impl fmt::Display for Company {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "meanwhile other programs kept {:.1} of {} cores busy, so steps may have waited for them: stop them or move them to other cores (`ps -eo pcpu,pid,user,comm --sort=-pcpu | head`)",
            self.others_cores, self.cores
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contention_is_the_used_time_of_the_allowed_cores_minus_the_own_time() {
        let machine = |second: u64| {
            format!(
                "cpu 9 9 9 9 9 9 9 9 9 9\ncpu0 100 0 0 900 0 0 0 0 0 0\ncpu1 {second} 0 100 500 100 0 0 0 7 0\ncpu2 5000 0 0 0 0 0 0 0 0 0\nintr 1 2\n"
            )
        };
        let own = |ticks: u64| format!("7 (a) name) R 1 1 1 0 -1 0 0 0 0 0 {ticks} 20 30 40 20 0");
        let before = ProcessorTime::of(&machine(300), &own(10), |core| core < 2);
        let expected = ProcessorTime {
            cores: 2,
            all: 2000,
            busy: 500,
            own: 100,
        };
        assert_eq!(before, expected);
        // Core 1 used 400 ticks, 100 of them by this process; core 0 was idle.
        let after = ProcessorTime::of(&machine(700), &own(110), |core| core < 2);
        let others_cores = 2.0 * (400.0 - 100.0) / 400.0;
        assert_eq!(
            after.company(&before),
            Company {
                others_cores,
                cores: 2
            }
        );
        assert!(after.company(&before).is_worth_telling());
        assert!(!after.company(&after).is_worth_telling());
        let nothing = ProcessorTime::of("", "", |_| true);
        assert_eq!(nothing.others_share(&nothing), 0.0);
    }
}
