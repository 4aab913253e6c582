//! Tasks of a campaign as Slurm lists them, and what to do about those that will not end by themselves.

use std::collections::BTreeMap;

use serde::Serialize;
use shared_types::number::counted;

/// Reasons to wait that go by themselves.
const ORDINARY: [&str; 6] = [
    "",
    "None",
    "Resources",
    "Priority",
    "BeginTime",
    "Dependency",
];
/// Most tasks of a kind that are named.
const MOST_NAMED: usize = 5;

/// Tasks of a campaign, as Slurm knows them.
#[derive(Debug, Default, PartialEq, Serialize)]
pub(in crate::command) struct Tasks {
    pub(in crate::command) running: u64,
    waiting: u64,
    /// Reasons for which tasks wait, unless it is for other tasks to end, with the number of each.
    reasons: BTreeMap<String, u64>,
    /// Tasks that Slurm starts no more until they are released, with its reason.
    held: Vec<(String, String)>,
    /// Tasks that Slurm has stopped and does not let go on by itself.
    suspended: Vec<String>,
    /// Tasks whose end Slurm waits for.
    ending: Vec<String>,
    /// Jobs that have tasks.
    jobs: Vec<String>,
}

impl Tasks {
    /// Takes the tasks of a job from lines of number, state and reason.
    pub(crate) fn take(&mut self, job: &str, listed: &str) {
        for line in listed.lines().filter(|line| !line.trim().is_empty()) {
            let mut words = line.splitn(3, ' ');
            let (task, state) = (
                words.next().unwrap_or_default(),
                words.next().unwrap_or_default(),
            );
            let reason = words.next().unwrap_or_default().trim();
            let is_held = reason.to_lowercase().contains("held")
                || matches!(state, "REQUEUE_HOLD" | "SPECIAL_EXIT");
            match state {
                _ if is_held => self.held.push((task.into(), reason.into())),
                "SUSPENDED" | "STOPPED" => self.suspended.push(task.into()),
                "COMPLETING" => self.ending.push(task.into()),
                "PENDING" => {
                    self.waiting += 1;
                    if !ORDINARY.contains(&reason) {
                        *self.reasons.entry(reason.into()).or_default() += 1;
                    }
                }
                _ => self.running += 1,
            }
            if !self.jobs.iter().any(|known| known == job) {
                self.jobs.push(job.into());
            }
        }
    }

    /// Describes them, with what to do; `is_done` if no case is missing, `is_worked_on` if a worker is seen at one.
    pub(in crate::command) fn describe(&self, is_done: bool, is_worked_on: bool) -> String {
        let mut text = format!(
            "  slurm: {} running, {} waiting\n",
            counted(self.running, "task"),
            self.waiting
        );
        for line in self.stuck(is_done, is_worked_on) {
            text += &format!("  {line}\n");
        }
        text
    }

    /// Lists the tasks that Slurm may show for ever, with the commands that end that.
    pub(in crate::command) fn stuck(&self, is_done: bool, is_worked_on: bool) -> Vec<String> {
        let jobs = self.jobs.join(" ");
        let mut lines = Vec::new();
        if is_done && !self.jobs.is_empty() {
            lines.push(format!(
                "no case is missing, so these tasks have nothing left to do; scancel {jobs} removes them"
            ));
        }
        for (reason, count) in self.reasons.iter().filter(|_| !is_done) {
            let advice = match reason.contains("DOWN") || reason.contains("DRAINED") {
                true => {
                    "sinfo -R names nodes that are out of service, and an administrator takes one back by scontrol update nodename=NODE state=resume".into()
                }
                false => format!(
                    "if that does not go by itself, scancel {jobs} withdraws them, and another submission starts what is missing"
                ),
            };
            lines.push(format!(
                "{} waiting: {reason}; {advice}",
                counted(*count, "task")
            ));
        }
        let held = self.held.iter().map(|(task, reason)| {
            format!(
                "task {task} is held ({reason}); scontrol release {task} lets it start again, scancel {task} removes it"
            )
        });
        let suspended = self.suspended.iter().map(|task| {
            format!(
                "task {task} is suspended; scontrol resume {task} lets it go on, scancel {task} removes it"
            )
        });
        let ending = self.ending.iter().map(|task| {
            format!(
                "task {task} is ending; if that lasts, its node does not answer: sinfo -R, and an administrator ends the task by scontrol update nodename=NODE state=down reason=lost"
            )
        });
        let kinds: [(Vec<String>, &str); 3] = [
            (held.collect(), "are held"),
            (suspended.collect(), "are suspended"),
            (ending.collect(), "are ending"),
        ];
        for (named, what) in kinds {
            let more = named.len().saturating_sub(MOST_NAMED);
            lines.extend(named.into_iter().take(MOST_NAMED));
            if more > 0 {
                lines.push(format!("and {more} more {what}"));
            }
        }
        if self.running > 0 && !is_done && !is_worked_on {
            lines.push(format!(
                "no running task is seen at work from here; if that lasts, its node may be lost without Slurm knowing it: sinfo -R and scontrol show job {jobs} tell more, and scancel {jobs} and another submission start what is missing"
            ));
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(listed: &str) -> Tasks {
        let mut tasks = Tasks::default();
        tasks.take("7", listed);
        tasks
    }

    #[test]
    fn every_task_that_will_not_end_by_itself_has_a_command_that_ends_it() {
        for (line, command) in [
            // As Slurm 22.05 writes them.
            ("7_3 PENDING JobHeldUser", "scontrol release 7_3"),
            ("7_3 PENDING JobHeldAdmin", "scancel 7_3"),
            (
                "7_3 PENDING launch failed requeued held",
                "scontrol release 7_3",
            ),
            ("7_3 SPECIAL_EXIT None", "scontrol release 7_3"),
            ("7_3 SUSPENDED None", "scontrol resume 7_3"),
            ("7_3 STOPPED None", "scancel 7_3"),
            ("7_3 COMPLETING None", "state=down"),
            ("7_3 PENDING DependencyNeverSatisfied", "scancel 7"),
            ("7_3 PENDING BadConstraints", "scancel 7"),
            (
                "7_3 PENDING Nodes required for job are DOWN, DRAINED",
                "state=resume",
            ),
            ("7_3 RUNNING None", "scancel 7"),
        ] {
            let lines = of(line).stuck(false, false);
            assert_eq!(lines.len(), 1, "{lines:?}");
            assert!(lines[0].contains(command), "{line}: {lines:?}");
        }
    }

    #[test]
    fn tasks_that_go_by_themselves_need_no_advice() {
        let tasks = of("7_1 RUNNING None\n7_2 PENDING Resources\n7_4 PENDING BeginTime\n");
        assert!(tasks.stuck(false, true).is_empty());
        assert_eq!((tasks.running, tasks.waiting), (1, 2));
        assert!(of("\n").stuck(true, false).is_empty());
    }

    #[test]
    fn tasks_of_a_complete_campaign_are_to_be_removed() {
        let mut tasks = of("7_1 RUNNING None\n7_2 PENDING BadConstraints\n");
        tasks.take("12", "12_0 PENDING Resources\n");
        let lines = tasks.stuck(true, false);
        assert!(lines[0].contains("scancel 7 12 removes them"), "{lines:?}");
        assert_eq!(lines.len(), 1, "{lines:?}");
    }

    #[test]
    fn of_many_held_tasks_some_are_named() {
        let many: String = (0..9)
            .map(|task| format!("7_{task} PENDING JobHeldUser\n"))
            .collect();
        let lines = of(&many).stuck(false, false);
        assert_eq!(lines.len(), MOST_NAMED + 1);
        assert_eq!(lines[MOST_NAMED], "and 4 more are held");
    }
}
