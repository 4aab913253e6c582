//! Tests of curves, from the rows of workers to the joined file.

use std::fs;

use hil_facts::results::curve::{Curve, Grid};

use crate::collect;
use crate::curves::{CURVES, Curves};
use crate::journal;
use crate::shard::Shard;
use crate::shard::tests::Campaign;
use crate::table::{CLASS, Cell, Column, ColumnKind, Row};

const CASES: u64 = 40;
const BINS: usize = 3;

fn grid() -> Grid {
    Grid {
        words: Vec::new(),
        signals: vec![("x_m".into(), "m".into()), ("y_n".into(), "N".into())],
        bins: BINS,
        bin_s: 0.5,
        every: 4,
    }
}

/// Two variants of twenty draws, in shards of ten cases.
fn campaign() -> Campaign {
    campaign_of("curves")
}

fn campaign_of(name: &str) -> Campaign {
    Campaign::with(CASES, 10, |manifest| {
        manifest.name = name.into();
        manifest.columns = vec![
            Column::new("case", ColumnKind::Count),
            Column::new("draw", ColumnKind::Count),
            Column::new("variant", ColumnKind::Text),
            Column::new(CLASS, ColumnKind::Text),
            Column::new("robustness.a", ColumnKind::Number),
        ];
        manifest.curves = Some(grid());
    })
}

/// Value of a signal in a bin, independent of the order of cases.
fn value(case: u64, signal: usize, bin: usize) -> f64 {
    let mixed = (case * 7 + signal as u64 * 3 + bin as u64 * 11) % 23;
    mixed as f64 - 11.0
}

fn margin(case: u64) -> f64 {
    ((case * 13) % 17) as f64 - 5.0
}

fn has_diverged(case: u64) -> bool {
    case % 9 == 5
}

fn row(case: u64) -> Row {
    let class = if has_diverged(case) {
        "diverged"
    } else {
        "pass"
    };
    let variant = if case.is_multiple_of(2) { "a" } else { "b" };
    vec![
        Cell::Count(case),
        Cell::Count(case / 2),
        Cell::Text(variant.into()),
        Cell::Text(class.into()),
        Cell::number(margin(case)),
    ]
}

fn curve(case: u64) -> Curve {
    let grid = grid();
    let mut curve = Curve::new(&grid);
    // The second signal has no value in the last bin.
    for (signal, bin) in [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)] {
        let value = value(case, signal, bin);
        curve.take(&grid, signal, bin, value);
        curve.take(&grid, signal, bin, value + 0.5);
    }
    curve.take(&grid, 1, 2, f64::NAN);
    curve
}

fn run(campaign: &Campaign, shard: u64, is_included: impl Fn(u64) -> bool) {
    let mut attempt = campaign.attempt(shard);
    for case in Shard::of(&campaign.folder, shard).cases() {
        if !attempt.has(case) && is_included(case) {
            attempt
                .row(row(case), 0.1, Some(curve(case)))
                .expect("noted");
        }
    }
    if Shard::of(&campaign.folder, shard)
        .cases()
        .all(|case| attempt.has(case))
    {
        attempt.publish().expect("published");
    }
}

#[test]
fn envelopes_and_worst_cases_cover_all_cases_of_all_workers() {
    let campaign = campaign();
    // The first shard had three workers, of which two died.
    run(&campaign, 0, |case| case % 3 == 0);
    run(&campaign, 0, |case| case % 3 == 1);
    for shard in 0..4 {
        run(&campaign, shard, |_| true);
    }
    let (curves, without) = collect::curves(&campaign.folder).expect("read");
    assert_eq!(without, 0);
    for (remainder, variant) in [(0, "a"), (1, "b")] {
        let cases = (0..CASES).filter(|case| case % 2 == remainder && !has_diverged(*case));
        let envelope = &curves.envelopes[variant];
        for (signal, bin) in [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)] {
            let values = cases.clone().map(|case| value(case, signal, bin));
            let least = values.clone().min_by(f64::total_cmp).expect("some") as f32;
            let greatest = values.max_by(f64::total_cmp).expect("some") as f32 + 0.5;
            assert_eq!(
                envelope.signal(&grid(), signal)[bin],
                [least, greatest],
                "{variant} {signal} {bin}"
            );
        }
        assert!(envelope.signal(&grid(), 1)[2][0].is_nan());
        let mut worst: Vec<u64> = cases.collect();
        worst.sort_by(|a, b| margin(*a).total_cmp(&margin(*b)).then(a.cmp(b)));
        let of = curves.worst.iter().find(|one| one.variant == variant);
        let of = of.expect("a worst case");
        assert_eq!((of.case, of.margin), (worst[0], margin(worst[0])));
        assert_eq!(
            of.curve.signal(&grid(), 0),
            curve(of.case).signal(&grid(), 0)
        );
    }
    // Every fourth draw has two cases.
    let sampled = (0..CASES).filter(|case| (case / 2) % 4 == 0 && !has_diverged(*case));
    assert!(curves.sampled.keys().copied().eq(sampled));
}

#[test]
fn curves_inside_the_envelope_are_not_journaled() {
    let campaign = campaign();
    run(&campaign, 1, |case| case != 19);
    let shard = campaign.folder.path().join("shards/00000001");
    let journal = journal::paths(&shard).expect("a folder").remove(0);
    let noted = fs::read_to_string(&journal).expect("a journal");
    let with = noted.matches("\"curve\"").count();
    assert!(with > 0 && with < 9, "{with}");
    // The curves of the same cases are inside the envelope when they are run again.
    let content = journal::read(&journal, |id| campaign.folder.has_results_of(id)).expect("read");
    let content = content.expect("whole");
    let mut curves = Curves::default();
    let manifest = campaign.folder.manifest();
    for (case, curve) in &content.curves {
        curves.take(manifest, &row(*case), curve);
    }
    for case in 10_u64..19 {
        let is_sampled = (case / 2).is_multiple_of(4);
        assert_eq!(
            curves.take(manifest, &row(case), &curve(case)),
            is_sampled && !has_diverged(case),
            "{case}"
        );
    }
}

#[test]
fn a_damaged_file_of_curves_costs_no_result() {
    let campaign = campaign();
    for shard in 0..4 {
        run(&campaign, shard, |_| true);
    }
    let path = campaign.folder.path().join("shards/00000002").join(CURVES);
    let mut bytes = fs::read(&path).expect("curves");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&path, bytes).expect("written");
    let (curves, without) = collect::curves(&campaign.folder).expect("read");
    assert_eq!(without, 1);
    assert!(curves.sampled.keys().all(|case| !(20..30).contains(case)));
    assert!(Shard::of(&campaign.folder, 2).part().is_ok());
    // A result that is set aside takes its curves along; computing it again restores them.
    Shard::of(&campaign.folder, 2).set_aside().expect("renamed");
    run(&campaign, 2, |_| true);
    assert_eq!(collect::curves(&campaign.folder).expect("read").1, 0);
}

#[test]
fn curves_of_another_shard_or_campaign_count_as_missing() {
    let campaigns = [campaign(), campaign_of("another")];
    for one in &campaigns {
        for shard in 0..4 {
            run(one, shard, |_| true);
        }
    }
    let [own, other] = &campaigns;
    assert_ne!(own.folder.id(), other.folder.id());
    let path =
        |of: &Campaign, shard: &str| of.folder.path().join("shards").join(shard).join(CURVES);
    let target = path(own, "00000002");
    let whole = fs::read(&target).expect("curves");
    for foreign in [path(own, "00000001"), path(other, "00000002")] {
        fs::copy(&foreign, &target).expect("copied");
        let (curves, without) = collect::curves(&own.folder).expect("read");
        assert_eq!(without, 1, "{}", foreign.display());
        assert!(curves.sampled.keys().all(|case| !(20..30).contains(case)));
    }
    // Earlier versions did not record the shard.
    let text = String::from_utf8(whole).expect("a text");
    let json = journal::unsealed(&text).expect("whole");
    let mut value: serde_json::Value = serde_json::from_str(json).expect("JSON");
    let origin = value.as_object_mut().expect("an object").remove("origin");
    assert_eq!(origin.expect("an origin")["shard"], 2);
    let earlier = value.to_string();
    fs::write(&target, format!("{earlier}{}", journal::sealed(&earlier))).expect("written");
    assert_eq!(collect::curves(&own.folder).expect("read").1, 0);
}
