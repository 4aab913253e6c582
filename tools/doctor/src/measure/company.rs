//! Measurement of contention: the time that other programs take of the cores while `hil` sleeps.

use std::time::Duration;

use hil_facts::results::company::core_times;
use serde_json::json;

use crate::checks::CONTENTION;
use crate::cores::CoreList;
use crate::finding::{Check, Finding};
use crate::tree::{Tree, Unread};

/// Smallest shares of a core that are graded fair and poor.
const FAIR: f64 = 0.1;
const POOR: f64 = 0.5;

/// Processor time up to some moment.
#[derive(Clone, Debug)]
struct Times {
    /// Busy ticks and total ticks of each core.
    cores: Vec<(u32, u64, u64)>,
    programs: Vec<Program>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Program {
    process: u32,
    name: String,
    /// Core on which the process last ran.
    core: u32,
    ticks: u64,
}

/// Sleeps for the given time and grades the time that other programs meanwhile took of these cores.
pub(crate) fn measure(tree: &dyn Tree, cores: &CoreList, seconds: f64) -> Finding {
    let judge = || {
        // The cores are read right next to the sleep, because reading the programs is work of this process.
        let programs = Program::all(tree);
        let before = Times {
            cores: busy_of(tree, cores)?,
            programs,
        };
        std::thread::sleep(Duration::from_secs_f64(seconds));
        let after = Times {
            cores: busy_of(tree, cores)?,
            programs: Program::all(tree),
        };
        Ok(finding(&before, &after))
    };
    judge().unwrap_or_else(|unread| CONTENTION.unread(&unread))
}

/// Reads the ticks of these cores.
fn busy_of(tree: &dyn Tree, cores: &CoreList) -> Result<Vec<(u32, u64, u64)>, Unread> {
    let stat = tree.read("proc/stat")?;
    let times = core_times(&stat).filter(|(core, ..)| cores.contains(*core));
    Ok(times.collect())
}

impl Program {
    /// Reads the times of all programs.
    fn all(tree: &dyn Tree) -> Vec<Self> {
        let program = |name: String| {
            let process = name.parse().ok()?;
            Self::of(process, &tree.read(&format!("proc/{process}/stat")).ok()?)
        };
        (tree.names("proc").into_iter())
            .filter_map(program)
            .collect()
    }

    /// Parses a `stat` file: after the name, which may contain anything, user and system time are the 12th and 13th
    /// word and the core is the 37th.
    fn of(process: u32, stat: &str) -> Option<Self> {
        let (head, rest) = stat.rsplit_once(')')?;
        let (_, name) = head.split_once('(')?;
        let words: Vec<&str> = rest.split_ascii_whitespace().collect();
        let ticks = |place: usize| words.get(place)?.parse::<u64>().ok();
        Some(Self {
            process,
            name: name.to_owned(),
            core: words.get(36)?.parse().ok()?,
            ticks: ticks(11)? + ticks(12)?,
        })
    }
}

fn finding(before: &Times, after: &Times) -> Finding {
    let share = |(core, busy, all): &(u32, u64, u64)| {
        let then = before.cores.iter().find(|(other, ..)| other == core)?;
        let (busy, all) = (busy.checked_sub(then.1)?, all.checked_sub(then.2)?);
        (all > 0).then(|| (*core, busy as f64 / all as f64))
    };
    let shares: Vec<(u32, f64)> = after.cores.iter().filter_map(share).collect();
    let Some((_, most)) = shares.iter().max_by(|a, b| a.1.total_cmp(&b.1)) else {
        return CONTENTION.unknown("/proc/stat has no data for these cores");
    };
    let ticks = |program: &Program| {
        let same = |other: &&Program| other.process == program.process;
        let then = before.programs.iter().find(same);
        program.ticks - then.map_or(0, |then| then.ticks.min(program.ticks))
    };
    // This process sleeps, so it never disturbs a run.
    let is_other = |program: &&Program| {
        program.process != std::process::id()
            && shares.iter().any(|(core, _)| *core == program.core)
    };
    let busiest = (after.programs.iter().filter(is_other))
        .max_by_key(|program| ticks(program))
        .filter(|program| ticks(program) > 0);

    let shares_text: Vec<String> = (shares.iter())
        .map(|(core, share)| format!("{:.0} % of core {core}", 100.0 * share))
        .collect();
    let mut text = format!("other programs take {}", shares_text.join(" and "));
    let grade = if *most < FAIR {
        Check::good
    } else if *most < POOR {
        Check::fair
    } else {
        Check::poor
    };
    let mut mend = None;
    if let Some(Program { process, name, .. }) = busiest
        && *most >= FAIR
    {
        text += &format!("; the busiest is {} ({process})", name.escape_default());
        mend = Some(format!("kill -STOP {process} # and later kill -CONT"));
    }
    let cores = shares
        .iter()
        .map(|(core, share)| json!({"core": core, "others": share}));
    (grade(CONTENTION, text).mend_if(mend)).measured(json!({"cores": cores.collect::<Vec<_>>()}))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Grade;
    use crate::tree::Fake;

    /// Creates a machine whose second core was busy for `busy` ticks of 1000, all of them with one program.
    fn machine(busy: u64) -> Fake {
        let idle = 1000 - busy;
        let stat = format!(
            "cpu  9 9 9 9\ncpu0 7 0 0 1000 0 0 0 50\ncpu1 {busy} 0 0 {idle} 0 0 0\ncpu2 5 0 0 0 0\nintr 7"
        );
        let program = |name: &str, ticks: u64, core: u32| {
            let zeros = "0 ".repeat(23);
            format!("9 ({name}) R 1 1 1 0 -1 0 0 0 0 0 {ticks} 7 {zeros}{core} 0 0 0")
        };
        Fake::new(
            &[
                ("proc/stat", stat),
                ("proc/41/stat", program("cc) 1 plus", busy, 1)),
                ("proc/12/stat", program("idle", 0, 0)),
                ("proc/14/stat", program("moved", 5000, 1)),
                ("proc/13/stat", program("elsewhere", 2000, 2)),
                ("proc/self/stat", program("hil", 3000, 1)),
            ]
            .map(|(path, text)| (path.to_owned(), text)),
        )
    }

    #[test]
    fn the_busiest_program_is_named_with_its_core() {
        let idle = Times {
            cores: vec![(0, 0, 0), (1, 0, 0)],
            // Moved to core 1 meanwhile without doing any work there.
            programs: vec![Program {
                process: 14,
                name: "moved".into(),
                core: 2,
                ticks: 5007,
            }],
        };
        let stop = Some("kill -STOP 41 # and later kill -CONT");
        for (busy, grade, expected, mend) in [
            (60, Grade::Good, "6 % of core 1", None),
            (
                200,
                Grade::Fair,
                "20 % of core 1; the busiest is cc) 1 plus (41)",
                stop,
            ),
            (
                970,
                Grade::Poor,
                "97 % of core 1; the busiest is cc) 1 plus (41)",
                stop,
            ),
        ] {
            let machine = machine(busy);
            let now = Times {
                cores: busy_of(&machine, &CoreList::parse("0-1")).expect("told"),
                programs: Program::all(&machine),
            };
            let finding = finding(&idle, &now);
            let expected = format!("other programs take 1 % of core 0 and {expected}");
            assert_eq!((finding.grade, finding.found), (grade, expected));
            assert_eq!(finding.mend.as_deref(), mend);
        }
    }

    #[test]
    fn cores_without_data_are_unknown() {
        for (machine, core) in [(machine(0), "7"), (Fake::default(), "0")] {
            let finding = measure(&machine, &CoreList::parse(core), 0.0);
            assert_eq!(finding.grade, Grade::Unknown, "{}", finding.found);
        }
    }
}
