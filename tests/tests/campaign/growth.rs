//! Growing campaigns: the same digest as one planned at the final size, and no case run twice.

use serde_json::Value;

use super::{Planned, STUDY, campaign, planned, study, text};
use crate::support::harness::Rig;

#[test]
fn a_grown_campaign_has_the_digest_of_one_planned_at_that_size() {
    let rig = Rig::new();
    for sampling in ["independent", "sobol"] {
        let of = |cases: u32| {
            STUDY.replace(
                "cases = 30",
                &format!("cases = {cases} # draws\nsampling = \"{sampling}\""),
            )
        };
        let large = planned(&rig, &study(&rig, &of(50)), &format!("large-{sampling}"));
        large.on("run").expect(0);
        let small = planned(&rig, &study(&rig, &of(33)), &format!("small-{sampling}"));
        small.on("run").expect(0);
        let parts = super::below(&small.join("shards"));
        // The second growth happens before the cases of the first have run.
        for cases in ["40", "50"] {
            campaign(&rig, &["grow", text(&small), "--cases", cases]).expect(0);
        }
        let status = small.on("status --json").expect(0).json();
        assert_eq!(
            (&status["cases"], &status["published"]),
            (&100.into(), &66.into())
        );
        small
            .on("show")
            .expect(3)
            .says(&["34 of 100 cases have no result"]);
        small.on("run").expect(0);
        assert_eq!(small.digest(), large.digest());
        let after = super::below(&small.join("shards"));
        assert!(parts.iter().all(|part| after.contains(part)));
        let [of_small, of_large] = [&small, &large].map(|folder| super::page::data(&rig, folder));
        assert_eq!(of_small["envelopes"], of_large["envelopes"]);
        // A new case equals the run of its values too.
        campaign(
            &rig,
            &[
                "case",
                text(&small),
                "98",
                "--in-process",
                "--out",
                text(&rig.path(sampling)),
            ],
        )
        .expect(0)
        .says(&["reproduced the campaign's digest"]);
        let compared = campaign(&rig, &["compare", text(&small), text(&large), "--json"])
            .expect(0)
            .json();
        assert_eq!(compared[0]["first_only"], Value::Array(Vec::new()));
    }
}

#[test]
fn changes_to_existing_cases_are_refused() {
    let rig = Rig::new();
    let hypercube = STUDY.replace("cases = 30", "cases = 30\nsampling = \"latin-hypercube\"");
    let grid = "schema = 1\nscenario = \"SCENARIO\"\nsampling = \"grid\"\n[[vary]]\nkey = \"plant.parameters.mass_kg\"\nkind = \"grid\"\nmin = 0.5\nmax = 2\npoints = 3\n";
    #[rustfmt::skip] // a table
    let rows = [
        ("plain", STUDY, "30", "the campaign already has 30 draws, and draws are never removed"),
        ("plain", STUDY, "200000000", "a whole number from 1 to 100000000"),
        ("hypercube", &hypercube, "60", "a Latin hypercube divides the range of each value"),
        ("grid", grid, "60", "a grid has one draw per point"),
    ];
    for (name, text_of, cases, expected) in rows {
        let folder = rig.path(name);
        if !folder.exists() {
            planned(&rig, &study(&rig, text_of), name);
        }
        let before = std::fs::read(folder.join("manifest.json")).expect("a manifest");
        campaign(&rig, &["grow", text(&folder), "--cases", cases])
            .expect(2)
            .says(&[expected]);
        let after = std::fs::read(folder.join("manifest.json")).expect("a manifest");
        assert_eq!(before, after);
    }
    // Planning the same study with more cases suggests growing.
    let more = study(&rig, &STUDY.replace("cases = 30", "cases = 31"));
    let folder = rig.path("plain");
    campaign(&rig, &["plan", text(&more), "-o", text(&folder)])
        .expect(2)
        .says(&["hil campaign grow", "--cases 31"]);
}

#[test]
fn an_invalid_new_case_is_reported_before_anything_is_written() {
    let rig = Rig::new();
    // Some draw of an unbounded mass is below the plant's minimum; the first draws are not.
    let wide = STUDY
        .replace("cases = 30", "cases = 2")
        .replace("min = 0.2\nmax = 3.0\n", "");
    let folder = planned(&rig, &study(&rig, &wide), "wide");
    let before = super::below(&folder);
    folder
        .on("grow --cases 100000")
        .expect(2)
        .says(&["mass_kg", "in case "]);
    let after = super::below(&folder);
    let is_lock = |path: &std::path::Path| path.ends_with(".growth");
    let after: Vec<_> = after
        .into_iter()
        .filter(|(path, _)| !is_lock(path))
        .collect();
    assert_eq!(before, after);
}

#[test]
fn integer_keys_vary_by_integer_distributions() {
    let rig = Rig::new();
    let substeps = "[[vary]]\nkey = \"plant.substeps\"\nkind = \"uniform\"\nmin = 2\nmax = 5\n";
    let of = |more: &str| {
        STUDY
            .replace(
                "set = [\"plant.substeps=4\"]\n",
                &format!("{substeps}{more}"),
            )
            .replace("cases = 30", "cases = 12")
    };
    let path = study(&rig, &of(""));
    campaign(&rig, &["check", text(&path)]).expect(2).says(&[
        "plant.substeps",
        "set `whole = true` in its [[vary]] to draw whole numbers",
    ]);
    let folder = planned(&rig, &study(&rig, &of("whole = true\n")), "whole");
    folder.on("run").expect(0);
    let mut seen: Vec<u64> = (0..12)
        .map(|draw| {
            let case = (2 * draw).to_string();
            let view = campaign(&rig, &["case", text(&folder), &case, "--show"]).expect(0);
            let line = view
                .stdout
                .lines()
                .find_map(|line| line.strip_prefix("substeps = "));
            let number = line.and_then(|rest| rest.split(' ').next());
            number
                .and_then(|number| number.parse().ok())
                .expect("a whole number")
        })
        .collect();
    seen.sort_unstable();
    seen.dedup();
    assert!(
        seen.len() > 1 && seen.iter().all(|n| (2..=5).contains(n)),
        "{seen:?}"
    );
}

#[test]
fn folders_with_spaces_are_quoted_in_every_hint() {
    let rig = Rig::new();
    let path = study(&rig, STUDY);
    let folder = Planned {
        rig: &rig,
        folder: rig.path("my study"),
    };
    let quoted = format!("'{}'", text(&folder));
    let plan = ["plan", text(&path), "-o", text(&folder)];
    let run = format!("hil campaign run {quoted}");
    campaign(&rig, &plan).expect(0).prints(&[&run]);
    campaign(&rig, &plan).expect(2).says(&[&run]);
    folder
        .on("show")
        .expect(3)
        .says(&[&format!("{run} computes them")]);
    folder
        .on("status")
        .expect(0)
        .prints(&[&format!("{run} continues")]);
    folder
        .on("run")
        .expect(0)
        .prints(&[&format!("hil campaign case {quoted} ")]);
}
