use std::fs;

use super::*;
use crate::shard::tests::{Campaign, complete, value};
use crate::table::Cell;

#[test]
fn a_broken_result_counts_as_none_and_is_computed_again_once_it_is_set_aside() {
    let campaign = Campaign::new(2, 2);
    campaign.run();
    let shard = Shard::of(&campaign.folder, 0);
    fs::write(shard.result(), "PAR1, or not").expect("written");
    let (collected, ..) =
        collect(&campaign.folder, Vec::new(), Vec::new(), |_| {}).expect("collected");
    assert_eq!((collected.missing, collected.digest), (vec![0], None));
    assert_eq!(collected.broken[0].0, 0);
    assert!(shard.is_published(), "a reader changes nothing");
    shard.set_aside().expect("renamed");
    assert!(shard.result().with_file_name("broken-1.parquet").exists());
    campaign.run();
    let (collected, ..) =
        collect(&campaign.folder, Vec::new(), Vec::new(), |_| {}).expect("collected");
    assert_eq!(collected.rows, 2);
}

#[test]
fn the_digest_covers_the_cells_in_case_order_for_any_sharding() {
    // Built by hand, in the documented form.
    let mut bytes = Vec::new();
    for case in 0..7_u64 {
        bytes.extend(case.to_le_bytes());
        let value = value(case) + 0.0;
        let bits = if value.is_nan() {
            0x7ff8_0000_0000_0000
        } else {
            value.to_bits()
        };
        bytes.extend(bits.to_le_bytes());
        bytes.extend(4_u64.to_le_bytes());
        bytes.extend(if case.is_multiple_of(2) {
            b"pass"
        } else {
            b"fail"
        });
    }
    let expected = blake3::hash(&bytes).to_hex().to_string();
    for shard_cases in [1, 3, 7, 100] {
        let campaign = Campaign::new(7, shard_cases);
        campaign.run();
        let (collected, results, _) =
            collect(&campaign.folder, Vec::new(), Vec::new(), |_| {}).expect("collected");
        assert_eq!(collected.digest.as_ref(), Some(&expected), "{shard_cases}");
        let (_, again, _) =
            collect(&campaign.folder, Vec::new(), Vec::new(), |_| {}).expect("collected");
        assert!(results == again, "the same bytes");
    }
}

#[test]
fn lost_cases_are_listed() {
    let campaign = Campaign::new(3, 2);
    let mut attempt = campaign.attempt(0);
    complete(&mut attempt, |case| {
        vec![
            Cell::Count(case),
            Cell::number(0.0),
            Cell::Text(if case == 1 { LOST } else { "pass" }.into()),
        ]
    });
    attempt.publish().expect("published");
    campaign.run();
    let (collected, ..) =
        collect(&campaign.folder, Vec::new(), Vec::new(), |_| {}).expect("collected");
    assert_eq!(collected.lost, [1]);
}
