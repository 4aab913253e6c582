use std::collections::BTreeMap;
use std::os::unix::fs::PermissionsExt;
use std::sync::Barrier;

use proptest::prelude::*;

use super::attempt::Published;
use super::*;
use crate::folder::{CONFLICTS, Conflict};
use crate::manifest::{Copied, MANIFEST, Manifest, SCHEMA, Stage};
use crate::table::{Cell, Column, ColumnKind, LOST};

/// Small campaign in a temporary folder.
pub(crate) struct Campaign {
    _root: tempfile::TempDir,
    pub(crate) folder: Folder,
}

impl Campaign {
    pub(crate) fn new(cases: u64, shard_cases: u64) -> Self {
        Self::with(cases, shard_cases, |_| {})
    }

    /// Creates a campaign whose manifest is changed before it is written.
    pub(crate) fn with(cases: u64, shard_cases: u64, change: impl FnOnce(&mut Manifest)) -> Self {
        let root = tempfile::tempdir().expect("a folder");
        let file = || Copied {
            path: "x".into(),
            blake3: "0".into(),
        };
        let mut manifest = Manifest {
            schema: SCHEMA,
            name: "demo".into(),
            cases,
            shard_cases,
            grown: Vec::new(),
            study: file(),
            scenario: file(),
            tables: BTreeMap::new(),
            hil: file(),
            plant: None,
            controller: None,
            pair: None,
            columns: vec![
                Column::new("case", ColumnKind::Count),
                Column::new("x", ColumnKind::Number),
                Column::new("class", ColumnKind::Text),
            ],
            curves: None,
            faults: None,
            case_s: 0.1,
        };
        change(&mut manifest);
        let text = manifest.sealed_text().expect("JSON");
        fs::write(root.path().join(MANIFEST), text).expect("written");
        let folder = Folder::open(root.path()).expect("a campaign");
        Self {
            _root: root,
            folder,
        }
    }

    pub(crate) fn attempt(&self, shard: u64) -> Attempt<'_> {
        Shard::of(&self.folder, shard)
            .attempt()
            .expect("an attempt")
    }

    /// Publishes every shard.
    pub(crate) fn run(&self) {
        for number in missing(&self.folder) {
            let mut attempt = self.attempt(number);
            complete(&mut attempt, |case| row(case, value(case)));
            assert_eq!(attempt.publish().expect("published"), Published::First);
        }
    }
}

/// Numbers of all kinds, including NaN and infinities.
pub(crate) fn value(case: u64) -> f64 {
    match case % 5 {
        0 => f64::NAN,
        1 => f64::NEG_INFINITY,
        2 => 1.0 / 3.0,
        3 => 0.0,
        _ => -5e-324,
    }
}

pub(crate) fn row(case: u64, x: f64) -> Row {
    let class = Cell::Text(
        if case.is_multiple_of(2) {
            "pass"
        } else {
            "fail"
        }
        .into(),
    );
    vec![Cell::Count(case), Cell::number(x), class]
}

pub(crate) fn complete(attempt: &mut Attempt<'_>, row: impl Fn(u64) -> Row) {
    for case in attempt.shard.cases() {
        if !attempt.has(case) {
            attempt.start(case).expect("noted");
            attempt.row(row(case), 0.5, None).expect("noted");
        }
    }
}

#[test]
fn published_rows_are_read_back_to_the_bit() {
    let campaign = Campaign::new(12, 5);
    campaign.run();
    let part = Shard::of(&campaign.folder, 2).part().expect("a part");
    assert!(
        part.rows()
            .eq([row(10, f64::NAN), row(11, f64::NEG_INFINITY)])
    );
    assert_eq!(
        (
            part.circumstances_of(0).wall_s,
            part.circumstances_of(0).tries
        ),
        (0.5, 1)
    );
    let entries = fs::read_dir(Shard::of(&campaign.folder, 2).path()).expect("a folder");
    assert_eq!(entries.count(), 1, "no journal is left");
}

#[test]
fn fifty_workers_on_one_shard_give_one_result() {
    let campaign = Campaign::new(3, 3);
    let barrier = Barrier::new(50);
    let all: Vec<Published> = std::thread::scope(|scope| {
        let work = || {
            barrier.wait();
            let mut attempt = campaign.attempt(0);
            complete(&mut attempt, |case| row(case, value(case)));
            attempt.publish().expect("published")
        };
        let threads: Vec<_> = (0..50).map(|_| scope.spawn(work)).collect();
        let ended = threads
            .into_iter()
            .map(|thread| thread.join().expect("no panic"));
        ended.collect()
    });
    let count = |outcome: &Published| all.iter().filter(|one| *one == outcome).count();
    assert_eq!(
        (count(&Published::First), count(&Published::Again)),
        (1, 49)
    );
    assert_eq!(
        Shard::of(&campaign.folder, 0)
            .part()
            .expect("a part")
            .rows()
            .count(),
        3
    );
}

#[test]
fn a_differing_second_result_is_reported_with_case_and_column() {
    let campaign = Campaign::new(3, 3);
    let (mut first, mut second) = (campaign.attempt(0), campaign.attempt(0));
    complete(&mut first, |case| row(case, 1.0));
    complete(&mut second, |case| {
        row(case, if case == 1 { 2.0 } else { 1.0 })
    });
    assert_eq!(first.publish().expect("published"), Published::First);
    let Published::Otherwise(conflict) = second.publish().expect("published") else {
        panic!("it differs")
    };
    assert_eq!((conflict.case, &*conflict.column), (1, "x"));
    assert_eq!((&*conflict.first, &*conflict.second), ("1", "2"));
    assert_eq!(campaign.folder.conflicts().expect("listed"), [conflict]);
    // The first one counts.
    assert_eq!(
        Shard::of(&campaign.folder, 0)
            .part()
            .expect("a part")
            .row(1),
        row(1, 1.0)
    );
}

#[test]
fn rows_of_a_dead_attempt_are_reused_and_compared() {
    let campaign = Campaign::new(4, 4);
    let mut dead = campaign.attempt(0);
    for case in 0..3 {
        dead.start(case).expect("noted");
        dead.row(row(case, 1.0), 0.25, None).expect("noted");
    }
    let name = dead.journal.name().to_owned();
    drop(dead);
    let mut attempt = campaign.attempt(0);
    assert!((0..3).all(|case| attempt.has(case)) && !attempt.has(3));
    complete(&mut attempt, |case| row(case, 1.0));
    assert_eq!(attempt.publish().expect("published"), Published::First);
    let part = Shard::of(&campaign.folder, 0).part().expect("a part");
    assert_eq!(part.circumstances_of(0).attempt, name);
    assert_ne!(part.circumstances_of(3).attempt, name);

    let campaign = Campaign::new(1, 1);
    for x in [1.0, 2.0] {
        let mut dead = campaign.attempt(0);
        dead.rows.clear(); // as if both had begun together
        dead.row(row(0, x), 0.1, None).expect("noted");
    }
    let attempt = campaign.attempt(0);
    assert!(matches!(attempt.publish(), Ok(Published::Otherwise(_))));
}

#[test]
fn only_dead_attempts_that_did_not_abandon_a_case_count_against_it() {
    let campaign = Campaign::new(2, 2);
    let mut alive = campaign.attempt(0);
    alive.start(0).expect("noted");
    for _ in 0..2 {
        campaign.attempt(0).start(0).expect("noted");
    }
    let mut abandoned = campaign.attempt(0);
    abandoned.start(0).expect("noted");
    abandoned.leave(0).expect("noted");
    drop(abandoned);
    let attempt = campaign.attempt(0);
    assert_eq!((attempt.tries(0), attempt.tries(1)), (2, 0));
    drop(alive);
    assert_eq!(campaign.attempt(0).tries(0), 3);
}

#[test]
fn a_case_that_was_set_aside_contradicts_nothing() {
    let campaign = Campaign::new(1, 1);
    let (mut first, mut second) = (campaign.attempt(0), campaign.attempt(0));
    complete(&mut first, |case| {
        vec![
            Cell::Count(case),
            Cell::number(f64::NAN),
            Cell::Text(LOST.into()),
        ]
    });
    complete(&mut second, |case| row(case, 1.0));
    first.publish().expect("published");
    assert_eq!(second.publish().expect("published"), Published::Again);
}

#[test]
fn rows_of_a_worker_that_died_after_losing_the_race_are_compared_during_cleanup() {
    for (second, differs) in [(1.0, false), (2.0, true)] {
        let campaign = Campaign::new(2, 2);
        let mut late = campaign.attempt(0);
        complete(&mut late, |case| row(case, second));
        let mut first = campaign.attempt(0);
        first.rows.clear(); // as if both had begun together
        complete(&mut first, |case| row(case, 1.0));
        first.publish().expect("published");
        let shard = Shard::of(&campaign.folder, 0);
        shard.sweep().expect("swept");
        assert!(late.journal.path().exists(), "it lives");
        let path = late.journal.path().to_owned();
        drop(late);
        shard.sweep().expect("swept");
        assert!(!path.exists());
        let conflicts = campaign.folder.conflicts().expect("listed");
        let entries = conflicts
            .first()
            .map(|one| (one.case, &*one.column, &*one.second));
        assert_eq!(entries, differs.then_some((0, "x", "2")));
    }
}

#[test]
fn a_reopened_result_keeps_its_other_rows_and_their_origin() {
    let campaign = Campaign::new(3, 3);
    let shard = Shard::of(&campaign.folder, 0);
    let mut first = campaign.attempt(0);
    complete(&mut first, |case| row(case, 1.0));
    let maker = first.journal.name().to_owned();
    first.publish().expect("published");
    let claim = shard.claim().expect("claimed");
    shard.reopen(|_| false).expect("nothing");
    assert!(shard.is_published(), "a worker has it");
    drop(claim);
    shard
        .reopen(|row| row[0] != Cell::Count(1))
        .expect("opened");
    assert!(!shard.is_published());
    let mut again = campaign.attempt(0);
    assert_eq!([0, 1, 2].map(|case| again.has(case)), [true, false, true]);
    assert_eq!(again.tries(1), 0);
    complete(&mut again, |case| row(case, 2.0));
    assert_eq!(again.publish().expect("published"), Published::First);
    let part = shard.part().expect("a part");
    assert!(part.rows().eq([row(0, 1.0), row(1, 2.0), row(2, 1.0)]));
    let makers = [0, 1, 2].map(|place| part.circumstances_of(place).attempt == maker);
    assert_eq!(makers, [true, false, true]);
    assert_eq!(part.circumstances_of(0).wall_s, 0.5);
}

#[test]
fn growing_a_campaign_keeps_its_shards_and_their_rows() {
    let small = Campaign::new(5, 2);
    small.run();
    let mut manifest = small.folder.manifest().clone();
    let stage = Stage {
        id: small.folder.id().into(),
        cases: 5,
        shard_cases: 2,
    };
    (manifest.cases, manifest.shard_cases) = (12, 3);
    manifest.grown.push(stage);
    let text = manifest.sealed_text().expect("JSON");
    fs::write(small.folder.path().join(MANIFEST), text).expect("written");
    let grown = Folder::open(small.folder.path()).expect("a campaign");
    let cases = (0..manifest.shards()).map(|shard| manifest.cases_of(shard));
    assert!(cases.eq([0..2, 2..4, 4..5, 5..8, 8..11, 11..12]));
    for shard in 0..manifest.shards() {
        for case in manifest.cases_of(shard) {
            assert_eq!(manifest.shard_of(case), shard);
        }
    }
    assert_eq!(missing(&grown), [3, 4, 5]);
    assert_eq!(Shard::of(&grown, 2).part().expect("a part").cases(), [4]);
    assert_ne!(grown.id(), small.folder.id());
    // Attempts made after the growth do not belong to the campaign as it was before.
    let mut attempt = Shard::of(&grown, 5).attempt().expect("an attempt");
    complete(&mut attempt, |case| row(case, value(case)));
    attempt.publish().expect("published");
    assert!(Shard::of(&small.folder, 5).part().is_err());
    assert!(Shard::of(&grown, 5).part().is_ok());
}

#[test]
fn a_claim_excludes_other_workers_until_it_is_dropped() {
    let campaign = Campaign::new(1, 1);
    let shard = Shard::of(&campaign.folder, 0);
    let claim = shard.claim().expect("claimed");
    assert!(claim.is_some());
    assert!(shard.claim().expect("asked").is_none());
    drop(claim);
    assert!(shard.claim().expect("claimed").is_some());
}

#[test]
fn journals_of_another_campaign_are_left_alone() {
    let campaign = Campaign::new(1, 1);
    let other = Campaign::new(2, 2);
    let mut theirs = other.attempt(0);
    complete(&mut theirs, |case| row(case, 1.0));
    let path = Shard::of(&campaign.folder, 0).path();
    fs::create_dir_all(&path).expect("a folder");
    let copy = path.join("attempt-theirs.journal");
    fs::copy(theirs.journal.path(), &copy).expect("copied");
    let attempt = campaign.attempt(0);
    assert!(!attempt.has(0));
    drop(attempt);
    assert!(copy.exists());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn a_truncated_or_damaged_journal_yields_its_first_rows(cut in 0_usize..1500, flip in 0_u8..255) {
        let campaign = Campaign::new(5, 5);
        let mut dead = campaign.attempt(0);
        complete(&mut dead, |case| row(case, value(case)));
        let path = dead.journal.path().to_owned();
        drop(dead);
        let mut bytes = fs::read(&path).expect("read");
        let cut = cut % bytes.len();
        if flip == 0 {
            bytes.truncate(cut);
        } else {
            bytes[cut] ^= flip;
        }
        fs::write(&path, bytes).expect("written");
        let attempt = campaign.attempt(0);
        let whole = (0..5).take_while(|case| attempt.has(*case)).count() as u64;
        for case in 0..5 {
            let expected = (case < whole).then(|| row(case, value(case)));
            prop_assert_eq!(attempt.rows.get(&case).map(|(row, _)| row.clone()), expected);
        }
    }

    #[test]
    fn a_part_with_a_damaged_byte_is_refused_or_yields_the_same_rows(place in 0_usize..10_000, flip in 1_u8..255) {
        let campaign = Campaign::new(6, 6);
        campaign.run();
        let shard = Shard::of(&campaign.folder, 0);
        let path = shard.path().join(PART);
        let mut bytes = fs::read(&path).expect("read");
        let place = place % bytes.len();
        bytes[place] ^= flip;
        fs::write(&path, bytes).expect("written");
        if let Ok(part) = shard.part() {
            let expected: Vec<Row> = (0..6).map(|case| row(case, value(case))).collect();
            prop_assert_eq!(part.rows().collect::<Vec<_>>(), expected);
        }
    }
}

#[test]
fn a_manifest_with_inconsistent_shards_is_invalid() {
    let campaign = Campaign::new(12, 5);
    let (folder, sound) = (campaign.folder.path(), campaign.folder.manifest());
    let stage = |cases| Stage {
        id: "x".into(),
        cases,
        shard_cases: 5,
    };
    for (shard_cases, grown) in [
        (0, vec![]),
        (5, vec![stage(13)]),
        (5, vec![stage(9), stage(8)]),
    ] {
        let broken = Manifest {
            shard_cases,
            grown,
            ..sound.clone()
        };
        let text = serde_json::to_vec(&broken).expect("JSON");
        std::fs::write(folder.join(MANIFEST), text).expect("written");
        let message = Manifest::read(folder).expect_err("broken").to_string();
        assert!(message.contains("its shards are inconsistent"), "{message}");
    }
}

#[test]
fn no_damaged_byte_of_a_manifest_yields_another_campaign() {
    let campaign = Campaign::new(12, 5);
    let path = campaign.folder.path().join(MANIFEST);
    let whole = fs::read(&path).expect("a manifest");
    assert!(campaign.folder.is_sealed());
    let mut refused = 0;
    for place in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[place] ^= 1;
        fs::write(&path, damaged).expect("written");
        match Folder::open(campaign.folder.path()) {
            Err(error) => {
                refused += 1;
                assert!(error.to_string().contains(MANIFEST), "{error}");
            }
            // The name of the checksum's key.
            Ok(folder) => assert_eq!(
                (folder.is_sealed(), folder.id()),
                (false, campaign.folder.id())
            ),
        }
    }
    assert_eq!(refused, whole.len() - "blake3".len());
}

#[test]
fn an_intact_result_beside_a_manifest_without_a_check_sum_is_not_blamed() {
    let campaign = Campaign::new(2, 2);
    campaign.run();
    let path = campaign.folder.path().join(MANIFEST);
    let text = serde_json::to_string(campaign.folder.manifest()).expect("JSON");
    fs::write(&path, &text).expect("written");
    let folder = Folder::open(campaign.folder.path()).expect("a campaign");
    assert_eq!(folder.id(), campaign.folder.id());
    assert!(Shard::of(&folder, 0).part().is_ok());
    for (sound, damaged) in [("demo", "dfmo"), ("\"x\",", "\"y\",")] {
        fs::write(&path, text.replacen(sound, damaged, 1)).expect("written");
        let folder = Folder::open(campaign.folder.path()).expect("a campaign");
        let error = Shard::of(&folder, 0).part().map(|_| ()).expect_err(damaged);
        assert!(matches!(error, PartError::Io(_)), "{error}");
        assert!(
            error.to_string().contains("which has no checksum"),
            "{error}"
        );
    }
}

#[test]
fn a_recorded_conflict_is_readable_by_everyone_who_can_read_the_results() {
    let campaign = Campaign::new(1, 1);
    let conflict = Conflict {
        case: 0,
        column: "x".into(),
        first: "1".into(),
        second: "2".into(),
        by: "a test".into(),
    };
    campaign.folder.note(&conflict).expect("noted");
    let folder = campaign.folder.path().join(CONFLICTS);
    let note = fs::read_dir(&folder).expect("a folder").next();
    let note = note.expect("a note").expect("read").path();
    let plain = folder.join("plain");
    fs::write(&plain, "").expect("written");
    let mode = |path: &Path| fs::metadata(path).expect("there").permissions().mode();
    assert_eq!(mode(&note), mode(&plain));
}
