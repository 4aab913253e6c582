//! Failures injected for minutes. `.ci/run long`.

use std::time::{Duration, Instant};

use shared_types::random::RandomStream;

use super::{Campaign, assert_same, nothing_left, on_one_core, study};
use crate::support::harness::{Rig, until};
use crate::support::slurm::Cluster;

/// Number of draws; each is a case of two variants.
const DRAWS: u64 = 2000;
/// Number of failures injected.
const ACCIDENTS: usize = 12;
/// Time without a worker after which a user resubmits: Slurm takes minutes to notice some lost tasks, and holds
/// others.
const PATIENCE: Duration = Duration::from_secs(15);
/// Time limit of the whole test.
const LIMIT: Duration = Duration::from_secs(1200);

#[test]
#[ignore = "long: .ci/run long"]
fn killed_workers_nodes_and_controllers_change_no_digest() {
    let Some(mut cluster) = Cluster::begin() else {
        return;
    };
    let rig = Rig::new();
    let study = study(&rig, DRAWS, 50.0);
    let here = on_one_core(&rig, &study);
    let folder = Campaign::planned(&rig, &cluster, &study, "on-slurm").folder;
    let mut random = RandomStream::new(1, "accidents");
    let since = Instant::now();
    let mut worked = since;
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
        // A killed controller may assign a number twice, and drains the affected nodes: an administrator must
        // resume them.
        if status["tasks"]["reasons"].to_string().contains("DRAINED") {
            for node in ["n1", "n2"] {
                let node = format!("nodename={node}");
                campaign.slurm("scontrol", &["update", &node, "state=resume"]);
            }
        }
        let works = status["shards_under_way"].as_u64() > Some(0);
        if works {
            worked = Instant::now();
        }
        if submissions == 0 || worked.elapsed() > PATIENCE {
            campaign.slurm("scancel", &["--name=study"]);
            until("it is submitted", || {
                campaign.submit(&["--task-s", "8"]).code == Some(0)
            });
            submissions += 1;
            worked = Instant::now();
        }
        std::thread::sleep(Duration::from_secs_f64(0.5 + 1.5 * random.uniform()));
        // While no worker runs, a failure has no effect.
        if accidents == ACCIDENTS || !works {
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
    assert_eq!(accidents, ACCIDENTS, "it was over too soon");
    let campaign = Campaign {
        rig: &rig,
        cluster: &cluster,
        folder,
    };
    assert_eq!(
        campaign.submit(&[]).expect(0).stdout,
        "nothing is missing\n"
    );
    assert_same(&campaign.collected(), &here, 2 * DRAWS);
    nothing_left(&rig, cluster);
}
