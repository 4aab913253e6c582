//! Measurements of properties that no kernel file shows.
//!
//! Each runs on the calling thread, pinned to the core under test, in the scheduling class with which `hil` was
//! started; a [partner](ping_pong) and a [load](wake_up) run on other threads. The measurements never use the project's
//! link or loop, because they measure the machine.

pub(crate) mod company;
pub mod gaps;
pub(crate) mod ping_pong;
pub(crate) mod wake_up;

use std::fmt::{self, Display};
use std::io;
use std::num::NonZeroU64;

use hil_console::terminal::duration::shown_ns;
use hil_facts::results::latency::grade::{EXCELLENT_BELOW_NS, GOOD_BELOW_NS, UNFIT_NS};
use hil_facts::results::latency::percentiles::Percentiles;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use super::finding::Grade;
use super::tree::{Tree, Unread};

/// Grades the longest delay by the limits customary among users of LinuxCNC.
pub(crate) const fn jitter_grade(longest_ns: u64) -> Grade {
    match longest_ns {
        0..EXCELLENT_BELOW_NS => Grade::Good,
        EXCELLENT_BELOW_NS..GOOD_BELOW_NS => Grade::Fair,
        _ => Grade::Poor,
    }
}

/// Returns a remark on delays far beyond the limit of the worst grade.
const fn remark(longest_ns: u64) -> &'static str {
    if longest_ns > UNFIT_NS {
        ": unfit for real time"
    } else {
        ""
    }
}

/// Formats median, 99 % quantile and maximum.
fn shown(figures: &Percentiles) -> String {
    let Percentiles { p50, p99, max, .. } = *figures;
    let [p50, p99, max] = [p50, p99, max].map(shown_ns);
    format!("p50 {p50}, p99 {p99}, max {max}")
}

/// Guard that pins the calling thread to a core while the value exists.
#[derive(Debug)]
pub(crate) struct Pinned {
    before: CpuSet,
}

impl Pinned {
    /// Moves the calling thread to a core.
    ///
    /// # Errors
    /// If the thread may not run there.
    pub(crate) fn to(core: u32) -> io::Result<Self> {
        let before = sched_getaffinity(None)?;
        let mut one = CpuSet::new();
        if core as usize >= CpuSet::MAX_CPU {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        one.set(core as usize);
        sched_setaffinity(None, &one)?;
        Ok(Self { before })
    }
}

impl Drop for Pinned {
    fn drop(&mut self) {
        let _ = sched_setaffinity(None, &self.before); // the previous mask is always allowed
    }
}

/// Guard that makes timers of the calling thread exact while the value exists: by default the kernel may delay wake-ups
/// of ordinary threads by 50 us to save power.
#[derive(Debug)]
struct ExactTimers {
    before_ns: u64,
}

impl ExactTimers {
    const SLACK_NS: u64 = 1;

    fn set() -> io::Result<Self> {
        let before_ns = rustix::thread::current_timer_slack()?;
        rustix::thread::set_current_timer_slack(NonZeroU64::new(Self::SLACK_NS))?;
        Ok(Self { before_ns })
    }
}

impl Drop for ExactTimers {
    fn drop(&mut self) {
        let before = NonZeroU64::new(self.before_ns);
        let _ = rustix::thread::set_current_timer_slack(before);
    }
}

/// Scheduling class of a thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Class {
    policy: u32,
    priority: u32,
}

impl Class {
    /// Returns the class of the calling thread.
    ///
    /// # Errors
    /// If the kernel does not report it.
    pub(crate) fn of_this_thread(tree: &dyn Tree) -> Result<Self, Unread> {
        const STAT: &str = "proc/thread-self/stat";
        let stat = tree.read(STAT)?;
        Self::parse(&stat).ok_or_else(|| Unread {
            path: STAT.into(),
            reason: format!("unexpected content `{stat}`"),
        })
    }

    /// Parses the `stat` file of a thread, whose 40th and 41st fields are priority and policy.
    fn parse(stat: &str) -> Option<Self> {
        // The second field is a name that may contain anything but ends with the last bracket.
        let (_, after_name) = stat.rsplit_once(')')?;
        let mut fields = after_name.split_ascii_whitespace().skip(40 - 3);
        let mut next = || fields.next()?.parse().ok();
        let priority = next()?;
        let policy = next()?;
        Some(Self { policy, priority })
    }

    /// Returns `true` if the class has precedence over all ordinary work.
    #[must_use]
    pub(crate) const fn is_real_time(self) -> bool {
        matches!(self.policy, 1 | 2 | 6)
    }
}

impl Display for Class {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self.policy {
            0 => f.write_str("SCHED_OTHER"),
            1 => write!(f, "SCHED_FIFO {}", self.priority),
            2 => write!(f, "SCHED_RR {}", self.priority),
            3 => f.write_str("SCHED_BATCH"),
            5 => f.write_str("SCHED_IDLE"),
            6 => f.write_str("SCHED_DEADLINE"),
            other => write!(f, "scheduling policy {other}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::Root;

    #[test]
    fn delays_are_graded_as_linuxcnc_does() {
        for (longest_us, grade) in [
            (0, Grade::Good),
            (19, Grade::Good),
            (20, Grade::Fair),
            (49, Grade::Fair),
            (50, Grade::Poor),
            (40_000, Grade::Poor),
        ] {
            assert_eq!(jitter_grade(longest_us * 1000), grade, "{longest_us} us");
        }
        assert_eq!(remark(500_000), "");
        assert_eq!(remark(500_001), ": unfit for real time");
    }

    #[test]
    fn the_class_of_a_thread_is_parsed_after_its_name() {
        let stat = |rest: &str| {
            format!(
                "77 (a (b) 9 9) S 1 77 77 0 -1 4194304 100 0 0 0 0 0 0 0 20 0 1 0 5 1000 2 \
                18446744073709551615 1 1 0 0 0 0 0 0 0 0 0 0 17 1 {rest} 0 0 0 0 0 0 0 0 0 0 0"
            )
        };
        for (rest, text, real_time) in [
            ("0 0", "SCHED_OTHER", false),
            ("80 1", "SCHED_FIFO 80", true),
            ("5 2", "SCHED_RR 5", true),
            ("0 3", "SCHED_BATCH", false),
        ] {
            let class = Class::parse(&stat(rest)).expect("a class");
            assert_eq!(
                (class.to_string().as_str(), class.is_real_time()),
                (text, real_time)
            );
        }
        assert_eq!(Class::parse("77 (hil) S 1"), None);
        Class::of_this_thread(&Root::machine()).expect("told");
    }

    #[test]
    fn a_thread_is_pinned_until_the_guard_is_dropped() {
        let mask = || {
            let set = sched_getaffinity(None).expect("told");
            let cores = (0..CpuSet::MAX_CPU).filter(|core| set.is_set(*core));
            cores.map(|core| core as u32).collect::<Vec<_>>()
        };
        let before = mask();
        let last = *before.last().expect("a core");
        let pinned = Pinned::to(last).expect("allowed");
        assert_eq!(mask(), [last]);
        drop(pinned);
        assert_eq!(mask(), before);
        assert!(Pinned::to(u32::MAX).is_err());
    }
}
