//! Tasks of a campaign as Slurm lists them, and advice about tasks that will not end by themselves.

use std::collections::BTreeMap;

use serde::Serialize;
use shared_types::number::counted;

/// Reasons for waiting that resolve themselves.
const ORDINARY: [&str; 6] = [
    "",
    "None",
    "Resources",
    "Priority",
    "BeginTime",
    "Dependency",
];
/// Maximum number of tasks of a kind that are listed.
const MOST_NAMED: usize = 5;

/// Tasks of a campaign, as Slurm reports them.
#[derive(Debug, Default, PartialEq, Serialize)]
pub(in crate::command) struct Tasks {
    pub(in crate::command) running: u64,
    waiting: u64,
    /// Reasons why tasks wait, other than for free resources, with the number of tasks.
    reasons: BTreeMap<String, u64>,
    /// Tasks that Slurm will not start until they are released, with Slurm's reason.
    held: Vec<(String, String)>,
    /// Tasks that Slurm has suspended and will not resume by itself.
    suspended: Vec<String>,
    /// Tasks whose end Slurm is waiting for.
    ending: Vec<String>,
    /// IDs of the jobs that have tasks.
    jobs: Vec<String>,
}

impl Tasks {
    /// Adds the tasks of a job, from lines of ID, state and reason.
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

    /// Describes the tasks with advice; `is_done` if no case is missing, `is_worked_on` if a worker is visibly
    /// active.
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

    /// Lists the tasks that could stay in the queue for ever, with the commands that resolve them.
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
                    "sinfo -R lists nodes that are out of service, and an administrator can return one to service with scontrol update nodename=NODE state=resume".into()
                }
                false => format!(
                    "if that does not resolve itself, scancel {jobs} cancels them, and a new submission starts the missing shards"
                ),
            };
            lines.push(format!(
                "{} waiting: {reason}; {advice}",
                counted(*count, "task")
            ));
        }
        let held = self.held.iter().map(|(task, reason)| {
            format!(
                "task {task} is held ({reason}); scontrol release {task} lets it start, scancel {task} removes it"
            )
        });
        let suspended = self.suspended.iter().map(|task| {
            format!(
                "task {task} is suspended; scontrol resume {task} resumes it, scancel {task} removes it"
            )
        });
        let ending = self.ending.iter().map(|task| {
            format!(
                "task {task} is ending; if that lasts, its node is not responding: check sinfo -R, and an administrator can end the task with scontrol update nodename=NODE state=down reason=lost"
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
                "no running task is visibly active from here; if that lasts, its node may have failed without Slurm noticing: sinfo -R and scontrol show job {jobs} show details, and scancel {jobs} followed by a new submission starts the missing shards"
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
    fn every_stuck_task_comes_with_a_command_that_resolves_it() {
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
    fn tasks_that_will_end_by_themselves_need_no_advice() {
        let tasks = of("7_1 RUNNING None\n7_2 PENDING Resources\n7_4 PENDING BeginTime\n");
        assert!(tasks.stuck(false, true).is_empty());
        assert_eq!((tasks.running, tasks.waiting), (1, 2));
        assert!(of("\n").stuck(true, false).is_empty());
    }

    #[test]
    fn leftover_tasks_of_a_complete_campaign_are_to_be_removed() {
        let mut tasks = of("7_1 RUNNING None\n7_2 PENDING BadConstraints\n");
        tasks.take("12", "12_0 PENDING Resources\n");
        let lines = tasks.stuck(true, false);
        assert!(lines[0].contains("scancel 7 12 removes them"), "{lines:?}");
        assert_eq!(lines.len(), 1, "{lines:?}");
    }

    #[test]
    fn long_lists_of_held_tasks_are_abbreviated() {
        let many: String = (0..9)
            .map(|task| format!("7_{task} PENDING JobHeldUser\n"))
            .collect();
        let lines = of(&many).stuck(false, false);
        assert_eq!(lines.len(), MOST_NAMED + 1);
        assert_eq!(lines[MOST_NAMED], "and 4 more are held");
    }
}
