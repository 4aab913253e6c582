//! Checks of other activity on the machine: load and sessions.

use hil_session::session::SessionError;

use super::checks::{LOAD, SESSIONS};
use super::cores::Cores;
use super::finding::{Finding, known};
use super::tree::Tree;

/// Checks the load average of the last minute.
pub(crate) fn load(tree: &dyn Tree, cores: &Cores) -> Finding {
    let text = known!(LOAD, tree.read("proc/loadavg"));
    let minute = text.split(' ').next().and_then(|s| s.parse::<f64>().ok());
    let Some(minute) = minute else {
        return LOAD.unknown(text);
    };
    let count = cores.online.len();
    let text = format!("{minute:.2} on {count} cores in the last minute");
    let per_core = minute / count as f64;
    let show = "ps -eo pcpu,pid,user,comm --sort=-pcpu | head";
    if per_core < 0.1 {
        LOAD.good(text)
    } else if per_core < 0.5 {
        LOAD.fair(text).mend(show)
    } else {
        LOAD.poor(text).mend(show)
    }
}

/// Checks for other sessions, live or dead.
pub(crate) fn sessions(live: Result<Vec<String>, SessionError>, dead: &[String]) -> Finding {
    let live = match live {
        Ok(live) => live,
        Err(error) => return SESSIONS.unknown(error.to_string()),
    };
    match (live.as_slice(), dead) {
        ([], []) => SESSIONS.good("none"),
        (live, []) => SESSIONS
            .fair(format!("running: {}", live.join(", ")))
            .mend("hil sessions"),
        (_, dead) => SESSIONS
            .fair(format!("dead: {}", dead.join(", ")))
            .mend("hil sessions --clean"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Grade;
    use crate::tree::Fake;

    #[test]
    fn load_is_graded_per_core() {
        let four = Cores::of("0-3", "2-3");
        for (text, grade) in [
            ("0.15 0.30 0.20 1/350 4242", Grade::Good),
            ("0.80 0.30 0.20 3/350 4242", Grade::Fair),
            ("2.00 4.61 4.46 5/120 22520", Grade::Poor),
            ("busy", Grade::Unknown),
        ] {
            let machine = Fake::new(&[("proc/loadavg", text)]);
            assert_eq!(load(&machine, &four).grade, grade, "{text}");
        }
    }

    #[test]
    fn other_sessions_are_named() {
        let names = |names: &[&str]| names.iter().map(|&name| name.into()).collect::<Vec<_>>();
        for (live, dead, grade, expected, mend) in [
            (names(&[]), names(&[]), Grade::Good, "none", None),
            (
                names(&["a", "b"]),
                names(&[]),
                Grade::Fair,
                "running: a, b",
                Some("hil sessions"),
            ),
            (
                names(&["a"]),
                names(&["c"]),
                Grade::Fair,
                "dead: c",
                Some("hil sessions --clean"),
            ),
        ] {
            let finding = sessions(Ok(live), &dead);
            assert_eq!((finding.grade, finding.found.as_str()), (grade, expected));
            assert_eq!(finding.mend.as_deref(), mend);
        }
        let refused = sessions(Err(SessionError::Locked("/dev/shm/hil-0".into())), &[]);
        assert_eq!(refused.grade, Grade::Unknown);
    }
}
