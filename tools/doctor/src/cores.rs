//! The cores of the machine: their number, the two that are checked, and the hardware that they share.

use std::collections::BTreeSet;
use std::fmt::{self, Display};

use hil_console::terminal::exit::Failure;

use super::checks::{CORES, SMT};
use super::finding::{Finding, known};
use super::tree::{Tree, Unread};

/// File that lists the online cores.
const ONLINE: &str = "sys/devices/system/cpu/online";

/// Set of cores, formatted as the kernel does: `0-3,8`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CoreList(BTreeSet<u32>);

impl CoreList {
    /// Parses a list; an invalid text, such as `(null)`, gives an empty list.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        let range = |part: &str| {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            Some(first.trim().parse().ok()?..=last.trim().parse().ok()?)
        };
        Self(text.split(',').filter_map(range).flatten().collect())
    }

    /// Iterates over the cores in ascending order.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = u32> + Clone {
        self.0.iter().copied()
    }

    /// Returns the number of cores.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Returns `true` if the list is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns `true` if the list contains the core.
    #[must_use]
    pub fn contains(&self, core: u32) -> bool {
        self.0.contains(&core)
    }

    /// Returns `true` if the list contains all cores of another.
    pub(crate) fn covers(&self, other: &Self) -> bool {
        self.0.is_superset(&other.0)
    }

    /// Returns `true` if the lists have a core in common.
    pub(crate) fn meets(&self, other: &Self) -> bool {
        !self.0.is_disjoint(&other.0)
    }

    /// Returns the cores of this list that are not in another.
    #[must_use]
    pub fn without(&self, other: &Self) -> Self {
        self.0.difference(&other.0).copied().collect()
    }

    /// Returns the union of this list and another.
    pub(crate) fn with(&self, other: &Self) -> Self {
        self.0.union(&other.0).copied().collect()
    }
}

impl FromIterator<u32> for CoreList {
    fn from_iter<I: IntoIterator<Item = u32>>(cores: I) -> Self {
        Self(cores.into_iter().collect())
    }
}

impl Display for CoreList {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut runs: Vec<(u32, u32)> = Vec::new();
        for core in self.iter() {
            match runs.last_mut() {
                Some((_, last)) if *last + 1 == core => *last = core,
                _ => runs.push((core, core)),
            }
        }
        let parts: Vec<String> = (runs.iter())
            .map(|(first, last)| match last - first {
                0 => first.to_string(),
                _ => format!("{first}-{last}"),
            })
            .collect();
        f.write_str(&parts.join(","))
    }
}

/// Cores of a machine, and those that are checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cores {
    /// Online cores.
    pub online: CoreList,
    /// Cores that this process may use.
    pub allowed: CoreList,
    /// Cores on which plant and controller would spin: two, or one on a single-core machine.
    pub chosen: CoreList,
}

impl Cores {
    /// Chooses the requested cores, or the last two that share no physical core, preferring isolated ones: system
    /// activity concentrates on the first cores.
    ///
    /// # Errors
    /// If the kernel does not list the cores, or a requested core does not exist.
    pub fn choose(tree: &dyn Tree, requested: Option<[u32; 2]>) -> Result<Self, Failure> {
        let online = tree.read(ONLINE).map_err(Failure::infrastructure)?;
        let online = CoreList::parse(&online);
        let allowed = allowed(tree).unwrap_or_else(|_| online.clone());
        let chosen = match requested {
            None => by_default(tree, &online, &allowed),
            Some(requested) => {
                if let Some(core) = requested.iter().find(|core| !online.contains(**core)) {
                    return Err(Failure::usage(format!(
                        "there is no core {core}; the cores are {online}"
                    )));
                }
                requested.into_iter().collect()
            }
        };
        Ok(Self {
            online,
            allowed,
            chosen,
        })
    }

    /// Creates the cores of a test in which this process may use all of them.
    #[cfg(test)]
    pub(crate) fn of(online: &str, chosen: &str) -> Self {
        Self {
            online: CoreList::parse(online),
            allowed: CoreList::parse(online),
            chosen: CoreList::parse(chosen),
        }
    }

    /// Returns the cores that are not chosen.
    pub(crate) fn others(&self) -> CoreList {
        self.online.without(&self.chosen)
    }
}

fn allowed(tree: &dyn Tree) -> Result<CoreList, Unread> {
    let status = tree.read("proc/self/status")?;
    let list = (status.lines()).find_map(|line| line.strip_prefix("Cpus_allowed_list:"));
    Ok(CoreList::parse(list.unwrap_or_default()))
}

fn by_default(tree: &dyn Tree, online: &CoreList, allowed: &CoreList) -> CoreList {
    // Isolated cores are not in any default mask, but can be requested.
    let isolated = tree.read("sys/devices/system/cpu/isolated");
    let isolated = CoreList::parse(&isolated.unwrap_or_default());
    let isolated: CoreList = isolated.iter().filter(|c| online.contains(*c)).collect();
    let candidates = if isolated.len() >= 2 {
        &isolated
    } else if allowed.is_empty() {
        online
    } else {
        allowed
    };
    let Some(last) = candidates.iter().next_back() else {
        return CoreList::default();
    };
    let siblings = siblings(tree, last).unwrap_or_default();
    let mut others = candidates.iter().rev().skip(1);
    let distant = others.clone().find(|core| !siblings.contains(*core));
    let second = distant.or_else(|| others.next());
    [Some(last), second].into_iter().flatten().collect()
}

/// Returns the threads of the physical core of this one, including itself.
fn siblings(tree: &dyn Tree, core: u32) -> Result<CoreList, Unread> {
    let path = format!("sys/devices/system/cpu/cpu{core}/topology/thread_siblings_list");
    tree.read(&path).map(|text| CoreList::parse(&text))
}

/// Checks the number of cores, given that both sides spin.
pub(crate) fn count(cores: &Cores) -> Finding {
    let Cores {
        online, allowed, ..
    } = cores;
    let usable = allowed.len();
    let mut text = format!("{} online ({online})", online.len());
    if !allowed.covers(online) {
        text += &format!(", this process may use {allowed}");
    }
    match usable {
        0 => CORES.unknown(text),
        1 => CORES
            .poor(text)
            .mend_if((online.len() > 1).then(|| format!("taskset -pc {online} $$"))),
        2 | 3 => CORES.fair(text),
        _ => CORES.good(text),
    }
}

/// Checks for physical cores shared by the chosen cores with each other or with other cores.
pub(crate) fn smt(tree: &dyn Tree, cores: &Cores) -> Finding {
    let mut shared = CoreList::default();
    let mut together = false;
    for core in cores.chosen.iter() {
        let all = known!(SMT, siblings(tree, core));
        let others = all.without(&[core].into_iter().collect());
        together |= others.meets(&cores.chosen);
        shared = shared.with(&others);
    }
    let off = "echo off | sudo tee /sys/devices/system/cpu/smt/control";
    let chosen = &cores.chosen;
    if together {
        SMT.poor(format!("{chosen}: threads of one physical core"))
            .mend(off)
    } else if shared.meets(&cores.online) {
        SMT.fair(format!("{chosen}: physical cores shared with {shared}"))
            .mend(off)
    } else {
        SMT.good(format!("{chosen}: whole physical cores"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Grade;
    use crate::tree::Fake;

    /// Creates a machine with this many threads, where thread n and n + half share a physical core.
    fn hyperthreaded(threads: u32) -> Fake {
        let half = threads / 2;
        let mut files = vec![
            (ONLINE.to_owned(), format!("0-{}", threads - 1)),
            (
                "proc/self/status".to_owned(),
                format!(
                    "Name:\thil\nCpus_allowed:\tff\nCpus_allowed_list:\t0-{}\n",
                    threads - 1
                ),
            ),
            ("sys/devices/system/cpu/isolated".to_owned(), String::new()),
        ];
        for core in 0..threads {
            let first = core % half;
            files.push((
                format!("sys/devices/system/cpu/cpu{core}/topology/thread_siblings_list"),
                format!("{first},{}", first + half),
            ));
        }
        Fake::new(&files)
    }

    fn machine(threads: u32, isolated: &str) -> Fake {
        hyperthreaded(threads).with(&[("sys/devices/system/cpu/isolated", isolated)])
    }

    #[test]
    fn core_lists_are_parsed_and_formatted_like_the_kernels() {
        for (text, count, formatted) in [
            ("0-3,8", 5, "0-3,8"),
            ("0", 1, "0"),
            ("0,1,2,5", 4, "0-2,5"),
            ("2-3\n", 2, "2-3"),
            ("", 0, ""),
            ("(null)", 0, ""),
        ] {
            let list = CoreList::parse(text);
            assert_eq!((list.len(), list.to_string().as_str()), (count, formatted));
        }
    }

    #[test]
    fn the_last_two_cores_that_share_no_physical_core_are_chosen() {
        for (threads, isolated, chosen) in [
            (8, "", "6-7"),
            (8, "1,5", "1,5"),
            (8, "1-2", "1-2"),
            (8, "7", "6-7"),
            (8, "2,3,6,7", "6-7"),
            (2, "", "0-1"),
        ] {
            let cores = Cores::choose(&machine(threads, isolated), None).expect("chosen");
            assert_eq!(cores.chosen.to_string(), chosen, "{threads} {isolated}");
        }
        let pairs = Fake::new(&[
            (ONLINE, "0-3"),
            ("proc/self/status", "Cpus_allowed_list:\t0-3"),
            (
                "sys/devices/system/cpu/cpu3/topology/thread_siblings_list",
                "2-3",
            ),
        ]);
        let cores = Cores::choose(&pairs, None).expect("chosen");
        assert_eq!(cores.chosen.to_string(), "1,3");
    }

    #[test]
    fn a_nonexistent_core_is_refused() {
        let failure = Cores::choose(&hyperthreaded(4), Some([1, 9])).expect_err("no core 9");
        let message = failure.to_string();
        assert_eq!(message, "error: there is no core 9; the cores are 0-3");
        let cores = Cores::choose(&hyperthreaded(4), Some([3, 0])).expect("there");
        assert_eq!(cores.chosen.to_string(), "0,3");
        assert_eq!(cores.others().to_string(), "1-2");
    }

    #[test]
    fn the_number_of_usable_cores_is_graded() {
        for (online, allowed, grade, mend) in [
            ("0-7", "0-7", Grade::Good, None),
            ("0-7", "0-1", Grade::Fair, None),
            ("0-1", "0-1", Grade::Fair, None),
            ("0", "0", Grade::Poor, None),
            ("0-7", "3", Grade::Poor, Some("taskset -pc 0-7 $$")),
        ] {
            let cores = Cores {
                online: CoreList::parse(online),
                allowed: CoreList::parse(allowed),
                chosen: CoreList::parse(allowed),
            };
            let finding = count(&cores);
            assert_eq!((finding.grade, finding.mend.as_deref()), (grade, mend));
        }
    }

    #[test]
    fn siblings_as_chosen_cores_are_poor_and_idle_siblings_fair() {
        let eight = hyperthreaded(8);
        let off = "echo off | sudo tee /sys/devices/system/cpu/smt/control";
        for (requested, grade) in [([3, 7], Grade::Poor), ([2, 3], Grade::Fair)] {
            let cores = Cores::choose(&eight, Some(requested)).expect("there");
            let finding = smt(&eight, &cores);
            assert_eq!((finding.grade, finding.mend.as_deref()), (grade, Some(off)));
        }
        let switched_off = eight.with(&[(ONLINE, "0-3")]);
        let cores = Cores::choose(&switched_off, Some([2, 3])).expect("there");
        assert_eq!(smt(&switched_off, &cores).grade, Grade::Good);
        let blind = Fake::new(&[(ONLINE, "0-1")]);
        let cores = Cores::choose(&blind, Some([0, 1])).expect("there");
        assert_eq!(smt(&blind, &cores).grade, Grade::Unknown);
    }
}
