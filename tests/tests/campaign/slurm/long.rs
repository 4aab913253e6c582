//! Accidents for minutes. `.ci/run long`.

use std::time::{Duration, Instant};

use shared_types::random::RandomStream;

use super::{Campaign, assert_same, nothing_left, on_one_core, study};
use crate::support::harness::{Rig, until};
use crate::support::slurm::Cluster;

/// Draws; each is a case of two variants.
const DRAWS: u64 = 3000;
/// Accidents, after which nothing more is done to it.
const ACCIDENTS: usize = 24;
/// Time that all of it may take.
const LIMIT: Duration = Duration::from_secs(1200);

#[test]
#[ignore = "long: .ci/run long"]
fn killed_workers_nodes_and_controllers_change_no_digest() {
    let test = "killed_workers_nodes_and_controllers_change_no_digest";
    let Some(mut cluster) = Cluster::begin(test) else {
        return;
    };
    let rig = Rig::new();
    let study = study(&rig, DRAWS, 5.0);
    let here = on_one_core(&rig, &study);
    let folder = Campaign::planned(&rig, &cluster, &study, "on-slurm").folder;
    let mut random = RandomStream::new(1, "accidents");
    let since = Instant::now();
    let (mut accidents, mut submissions) = (0, 0);
    loop {
        assert!(since.elapsed() < LIMIT, "watchdog: not within {LIMIT:?}");
        let campaign = Campaign {
            rig: &rig,
            cluster: &cluster,
            folder: folder.clone(),
        };
        let status = campaign.status();
        if status["missing"] == 0 && status["shards_published"] == status["shards"] {
            break;
        }
        let tasks = &status["tasks"];
        let held = tasks["held"].as_array().map_or(0, Vec::len);
        let none = tasks["running"] == 0 && tasks["waiting"] == 0;
        // A task that Slurm holds is one that it lost, and a task that it forgot is in no list.
        if tasks.is_null() || none || held > 0 {
            campaign.slurm("scancel", &["--name=study"]);
            submissions += 1;
            until("it is submitted", || {
                campaign.submit(&["--task-s", "8"]).code == Some(0)
            });
        }
        let pause_s = 0.5 + 4.0 * random.uniform();
        std::thread::sleep(Duration::from_secs_f64(pause_s));
        if accidents == ACCIDENTS {
            continue;
        }
        let kinds = ["kill tasks", "kill n1", "crash n2", "kill ctld"];
        let kind = kinds[accidents % kinds.len()];
        accidents += 1;
        cluster.order(kind);
        if let Some((_, name)) = kind.split_once(' ')
            && name != "tasks"
        {
            std::thread::sleep(Duration::from_secs_f64(2.0 * random.uniform()));
            cluster.order(&format!("start {name}"));
        }
    }
    assert!(accidents > 8, "it was over after {accidents} accidents");
    let campaign = Campaign {
        rig: &rig,
        cluster: &cluster,
        folder,
    };
    assert!(submissions > 0);
    assert_eq!(
        campaign.submit(&[]).expect(0).stdout,
        "nothing is missing\n"
    );
    assert_same(&campaign.collected(), &here, 2 * DRAWS);
    nothing_left(&rig, cluster);
}
