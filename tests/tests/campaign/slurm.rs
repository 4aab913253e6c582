//! Campaigns on a real Slurm: the digest of one core, whatever dies meanwhile.
//!
//! A duplicate row cannot go unnoticed: the digest covers the number of each case with its row, and the rows are
//! counted.

mod long;

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::Value;

use crate::support::harness::{Rig, Run, text, until};
use crate::support::programs::workspace;
use crate::support::slurm::Cluster;

/// Polling interval for a campaign.
const LOOK: Duration = Duration::from_millis(200);

/// Campaign with the cluster that works on it.
struct Campaign<'a> {
    rig: &'a Rig,
    cluster: &'a Cluster,
    folder: PathBuf,
}

/// Writes the study: two variants, each with N cases of this duration.
fn study(rig: &Rig, draws: u64, duration_s: f64) -> PathBuf {
    let scenario = workspace().join("scenarios/spring-mass.toml");
    rig.write(
        "study.toml",
        &format!(
            r#"
schema = 1
scenario = "{}"
cases = {draws}
seed = 3
set = ["run.duration_s={duration_s}", "metrics=[]", "requirements=[]"]
[[vary]]
key = "plant.parameters.mass_kg"
kind = "normal"
mean = 1.0
deviation = 0.3
min = 0.2
max = 3.0
[[variants]]
name = "pid"
[[variants]]
name = "hold"
set = ["controller.law=hold"]
"#,
            scenario.display()
        ),
    )
}

fn planned(rig: &Rig, study: &Path, name: &str) -> PathBuf {
    let folder = rig.path(name);
    let arguments = ["campaign", "plan", text(study), "--out", text(&folder)];
    rig.beside(&arguments).expect(0);
    folder
}

impl<'a> Campaign<'a> {
    fn planned(rig: &'a Rig, cluster: &'a Cluster, study: &Path, name: &str) -> Self {
        let folder = planned(rig, study, name);
        Self {
            rig,
            cluster,
            folder,
        }
    }

    /// Returns a command on this campaign, by a `hil` that knows the cluster.
    fn action(&self, action: &str, options: &[&str]) -> Run {
        let mut all = vec!["campaign", action, text(&self.folder)];
        all.extend(options);
        self.rig.program(self.cluster.hil(&all))
    }

    fn submit(&self, options: &[&str]) -> Run {
        self.action("submit", &[&["--slurm"], options].concat())
    }

    /// Runs a program of Slurm.
    fn slurm(&self, program: &str, arguments: &[&str]) -> Run {
        self.rig.program(self.cluster.client(program, arguments))
    }

    fn status(&self) -> Value {
        self.action("status", &["--json"]).expect(0).json()
    }

    fn until(&self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        let mut status = Value::Null;
        until(what, || {
            std::thread::sleep(LOOK); // every poll starts programs
            status = self.status();
            holds(&status)
        });
        status
    }

    fn collected(&self) -> Value {
        self.action("collect", &["--json"]).expect(0).json()
    }
}

/// Returns the results of the same study on one core.
fn on_one_core(rig: &Rig, study: &Path) -> Value {
    let folder = planned(rig, study, "one-core");
    let run = rig.start_hil(&["campaign", "run", text(&folder), "--jobs", "1"]);
    run.finish_late().expect(0);
    let collected = rig.beside(&["campaign", "collect", text(&folder), "--json"]);
    collected.expect(0).json()
}

fn assert_same(there: &Value, here: &Value, cases: u64) {
    assert_eq!(there["digest"], here["digest"]);
    assert!(here["digest"].is_string(), "{here}");
    assert_eq!(there["rows"], cases);
    assert_eq!(there["missing_shards"], 0);
    assert_eq!(there["conflicts"], Value::Array(Vec::new()));
    assert_eq!(there["lost"], Value::Array(Vec::new()));
}

fn nothing_left(rig: &Rig, cluster: Cluster) {
    drop(cluster);
    rig.assert_nothing_left();
}

#[test]
fn a_campaign_on_slurm_has_the_digest_of_one_core() {
    let Some(cluster) = Cluster::begin() else {
        return;
    };
    let rig = Rig::new();
    let study = study(&rig, 30, 0.5);
    let here = on_one_core(&rig, &study);
    let campaign = Campaign::planned(&rig, &cluster, &study, "on-slurm");
    // Several tasks, so that both nodes get some.
    let submitted = campaign.submit(&["--task-s", "0.02"]).expect(0);
    assert!(submitted.stdout.contains("60 cases"), "{submitted:?}");
    campaign.until("all is there", |status| status["missing"] == 0);
    campaign.until("no task is left", |status| {
        status["tasks"]["running"] == 0 && status["tasks"]["waiting"] == 0
    });
    assert_same(&campaign.collected(), &here, 60);
    let again = campaign.submit(&[]).expect(0);
    assert_eq!(again.stdout, "nothing is missing\n");
    nothing_left(&rig, cluster);
}

#[test]
fn paths_with_spaces_quotes_and_percent_signs_reach_the_tasks() {
    let Some(cluster) = Cluster::begin() else {
        return;
    };
    let rig = Rig::new();
    let study = study(&rig, 5, 0.5);
    let campaign = Campaign::planned(&rig, &cluster, &study, "it's 100%A $HOME");
    campaign.submit(&[]).expect(0);
    campaign.until("all is there", |status| status["missing"] == 0);
    let logs = std::fs::read_dir(campaign.folder.join("logs")).expect("the logs");
    assert_eq!(logs.count(), 1);
    nothing_left(&rig, cluster);
}

#[test]
fn status_reports_pending_held_and_running_tasks() {
    let Some(cluster) = Cluster::begin() else {
        return;
    };
    let rig = Rig::new();
    // More than the test waits for.
    let study = study(&rig, 2000, 50.0);
    let campaign = Campaign::planned(&rig, &cluster, &study, "on-slurm");
    assert_eq!(campaign.status()["tasks"], Value::Null);
    campaign.submit(&["--", "--begin=now+1hour"]).expect(0);
    let waits = campaign.until("it waits", |status| {
        status["tasks"]["waiting"].as_u64() > Some(0)
    });
    assert_eq!(waits["tasks"]["running"], 0);
    assert_eq!(waits["tasks"]["reasons"], serde_json::json!({}));
    assert_eq!(waits["missing"], 4000);
    campaign.slurm("scancel", &["--name=study"]).expect(0);

    let nodes = |state: &str| {
        let state = format!("state={state}");
        let update = ["update", "nodename=n1,n2", "reason=test", &state];
        campaign.slurm("scontrol", &update).expect(0);
    };
    nodes("drain");
    campaign.submit(&[]).expect(0);
    campaign.until("its nodes are out of service", |status| {
        status["tasks"]["reasons"].to_string().contains("DRAINED")
    });
    let text = campaign.action("status", &[]).expect(0).stdout;
    assert!(text.contains("sinfo -R lists nodes"), "{text}");
    nodes("resume");
    campaign.slurm("scancel", &["--name=study"]).expect(0);

    campaign.submit(&["--", "--hold"]).expect(0);
    let holds = |status: &Value| status["tasks"]["held"][0][0].as_str().map(str::to_owned);
    let held = campaign.until("it is held", |status| holds(status).is_some());
    let task = holds(&held).expect("a task");
    let text = campaign.action("status", &[]).expect(0).stdout;
    let release = format!("task {task} is held (JobHeldUser); scontrol release {task}");
    assert!(text.contains(&release), "{text}");
    assert!(
        text.contains(&format!("scancel {task} removes it")),
        "{text}"
    );

    // The advice works.
    campaign.slurm("scontrol", &["release", &task]).expect(0);
    campaign.until("it runs", |status| {
        status["tasks"]["running"].as_u64() > Some(0) && status["missing"].as_u64() < Some(4000)
    });
    campaign.slurm("scancel", &["--name=study"]).expect(0);
    campaign.until("it has ended", |status| {
        status["tasks"]["running"] == 0 && status["shards_under_way"] == 0
    });
    nothing_left(&rig, cluster);
}

#[test]
fn leftover_tasks_of_a_complete_campaign_are_listed_with_the_command_to_remove_them() {
    let Some(cluster) = Cluster::begin() else {
        return;
    };
    let rig = Rig::new();
    let study = study(&rig, 5, 0.5);
    let campaign = Campaign::planned(&rig, &cluster, &study, "on-slurm");
    let submitted = campaign.submit(&["--", "--hold"]).expect(0);
    let job = submitted
        .stdout
        .split(['\u{20}', ':'])
        .nth(1)
        .expect("a job")
        .to_owned();
    campaign.action("run", &[]).expect(0);
    let held = campaign.until("it is held", |status| !status["tasks"]["held"][0].is_null());
    assert_eq!(held["missing"], 0);
    let remove = format!("scancel {job} removes them");
    let text = campaign.action("status", &[]).expect(0).stdout;
    assert!(text.contains(&remove), "{text}");
    // A repeated submission shows it too.
    let again = campaign.submit(&[]).expect(0);
    assert_eq!(again.stdout, "nothing is missing\n");
    assert!(again.stderr.contains(&remove), "{again:?}");
    campaign.slurm("scancel", &[&job]).expect(0);
    campaign.until("it is gone", |status| {
        status["tasks"]["jobs"] == serde_json::json!([])
    });
    nothing_left(&rig, cluster);
}
