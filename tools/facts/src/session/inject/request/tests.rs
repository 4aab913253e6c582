use shared_types::time::Rate;

use clap::Parser;

use super::*;
use crate::arguments::inject::{InjectCommand, InjectLine};
use crate::rig;

/// Returns the faults that the rig offers.
pub(crate) fn possible() -> Possible {
    let plant = rig::plant();
    Possible {
        rate: Rate::new(1e4).expect("a rate"),
        reference: plant.measured.clone(),
        inputs: Vec::new(),
        plant,
        kinds: rig::kinds(),
        networks: 1,
    }
}

fn typed(line: &str) -> Result<String, Vec<Refusal>> {
    // Quotes keep an expression in one piece, as in a shell.
    let words = line.split('\'').enumerate().flat_map(|(index, part)| {
        if index % 2 == 1 {
            vec![part]
        } else {
            part.split_whitespace().collect()
        }
    });
    let words = ["hil", "inject"]
        .into_iter()
        .chain(words)
        .map(std::ffi::OsString::from);
    let parsed = InjectLine::try_parse_from(crate::arguments::inject::arrange(words));
    match parsed
        .unwrap_or_else(|error| panic!("{line}: {error}"))
        .command
    {
        InjectCommand::Inject(arguments) => toml(&arguments, &possible()),
    }
}

#[test]
fn a_command_line_becomes_the_text_of_a_scenario() {
    let cases = [
        (
            "leakage --actuator 1,2 --coefficient 5e-7,1e-7 --speed 10,0.5 --at 7",
            r#"kind = "leakage" | at_s = 7.0
               | [[faults.effects]] | actuator = 1 | coefficient_m3ps_per_sqrt_pa = 5e-7 | speed_per_s = 10.0
               | [[faults.effects]] | actuator = 2 | coefficient_m3ps_per_sqrt_pa = 1e-7 | speed_per_s = 0.5"#,
        ),
        (
            "leakage actuator1,2 5e-7 --exponential 4 --skew 0,100ms --name both",
            r#"name = "both" | kind = "leakage"
               | [[faults.effects]] | actuator = 1 | coefficient_m3ps_per_sqrt_pa = 5e-7
               | profile = { kind = "exponential", speed_per_s = 4.0 } | skew_s = 0.0
               | [[faults.effects]] | actuator = 2 | coefficient_m3ps_per_sqrt_pa = 5e-7
               | profile = { kind = "exponential", speed_per_s = 4.0 } | skew_s = 0.1"#,
        ),
        (
            "supply-loss plant 0.5 --factor-second 0.25 --at-step 70000 --end 8",
            r#"kind = "supply-loss" | at_step = 70000 | end_s = 8.0
               | [[faults.effects]] | factor_first = 0.5 | factor_second = 0.25"#,
        ),
        (
            "bias measured.surface_angle_rad 0.01 --ramp 2s",
            r#"kind = "bias" | [[faults.effects]] | target = "measured.surface_angle_rad" | bias = 0.01
               | profile = { kind = "ramp", duration_s = 2.0 }"#,
        ),
        (
            "bias measured.a,parameter.actuator1.leak -1,-2e3 --pulse 500ms --duration 1s",
            r#"kind = "bias" | duration_s = 1.0
               | [[faults.effects]] | target = "measured.a" | bias = -1.0
               | profile = { kind = "pulse", duration_s = 0.5 }
               | [[faults.effects]] | target = "parameter.actuator1.leak" | bias = -2000.0
               | profile = { kind = "pulse", duration_s = 0.5 }"#,
        ),
        (
            "saturation command.valve1_current_a -0.5 --max .5 --intermittent 100ms,0.2",
            r#"kind = "saturation" | [[faults.effects]] | target = "command.valve1_current_a" | min = -0.5 | max = 0.5
               | profile = { kind = "intermittent", period_s = 0.1, duty = 0.2 }"#,
        ),
        (
            "dropout measured.x --when 'truth.x > \"a\"' --for 10ms --until 'truth.x<0' --until-for 1",
            r#"kind = "dropout" | when = "truth.x > \"a\"" | for_s = 0.01 | until = "truth.x<0" | until_for_s = 1.0
               | [[faults.effects]] | target = "measured.x""#,
        ),
        (
            "message-loss link.sample --probability 0.1 --duration 1s",
            r#"kind = "message-loss" | duration_s = 1.0
               | [[faults.effects]] | target = "link.sample" | probability = 0.1"#,
        ),
        (
            "message-loss link.command --pattern 1,0,0 --sine 5 --after jam --delay 2ms",
            r#"kind = "message-loss" | after = "jam" | delay_s = 0.002
               | [[faults.effects]] | target = "link.command" | pattern = [1.0, 0.0, 0.0]
               | profile = { kind = "sine", frequency_hz = 5.0, phase_rad = 0.0 }"#,
        ),
        (
            "late controller 200 --occurrences 3 --after 2",
            r#"kind = "late" | after = 2 | occurrences = 3
               | [[faults.effects]] | target = "controller" | busy_us = 200.0"#,
        ),
        (
            "late plant --busy 1ms --histogram 100:0.9,5e3:0.1",
            r#"kind = "late" | [[faults.effects]] | target = "plant" | busy_us = 1000.0
               | histogram = [[100.0, 0.9], [5000.0, 0.1]]"#,
        ),
        (
            "skip 3 --period nan --intermittent 1s,nan",
            r#"kind = "skip" | [[faults.effects]] | target = "controller" | steps = 3.0 | period_s = nan
               | profile = { kind = "intermittent", period_s = 1.0, duty = nan }"#,
        ),
        (
            "skip 3 --sine nan,-inf",
            r#"kind = "skip" | [[faults.effects]] | target = "controller" | steps = 3.0
               | profile = { kind = "sine", frequency_hz = nan, phase_rad = -inf }"#,
        ),
        (
            "skip 3 --period 20ms",
            r#"kind = "skip" | [[faults.effects]] | target = "controller" | steps = 3.0 | period_s = 0.02"#,
        ),
        (
            "bias x --parameter bias=-1",
            r#"kind = "bias" | [[faults.effects]] | target = "x" | bias = -1.0"#,
        ),
    ];
    for (line, expected) in cases {
        let expected: String = expected
            .split('|')
            .map(|line| format!("{}\n", line.trim()))
            .collect();
        assert_eq!(
            typed(line).as_deref(),
            Ok(&*format!("[[faults]]\n{expected}")),
            "{line}"
        );
    }
}

#[test]
fn words_that_cannot_be_understood_are_refused_with_the_possible_ones() {
    #[rustfmt::skip] // a table
    let cases = [
        ("leek --actuator 1", "plant `rig` has no fault `leek` ; a kind that `hil inject --list` shows ; leakage"),
        (
            "leakage --actuator 1 --coeficient 1",
            "`leakage` has no key `coeficient`, and hil has no option `--coeficient` ; \
             one of `actuator`, `coefficient_m3ps_per_sqrt_pa`, `speed_per_s` ; coefficient_m3ps_per_sqrt_pa",
        ),
        ("bias measured.a 1 --duraton 3", "`bias` has no key `duraton`, and hil has no option `--duraton` ; one of `bias` ; --duration"),
        ("skip plant 3", "`skip` does not act on `plant` ; `controller`, or no target, because it is the only one ; "),
        ("supply-loss controller 0.5 0.5", "`supply-loss` does not act on `controller` ; no target, because it acts on the plant ; "),
        ("skip controller x", "`x` is not a number for `steps` ; a number in steps ; "),
        ("supply-loss --factor 1", "`--factor` matches more than one key of `supply-loss` ; one of `factor_first`, `factor_second` ; "),
        ("leakage --coefficient 1", "`leakage` needs `--actuator` ; numbers, for example `--actuator 1,2` ; "),
        ("leakage left 1", "`left` is not a valid actuator ; numbers, for example `--actuator 1,2` ; "),
        ("bias", "`bias` needs a target ; a target that `hil inject --list --kind bias` shows ; "),
        ("leakage 1,2 1,2,3", "`coefficient_m3ps_per_sqrt_pa` has 3 values for 2 targets ; 1 value for all, or 2 ; "),
        ("bias x 1,2", "`bias` has 2 values for 1 target ; 1 value ; "),
        ("bias x 1 2", "`bias` expects 1 value more, not 2: `1`, `2` ; values for `bias` ; "),
        ("bias x --bias 1 --bias 2", "`--bias` is given twice ;  ; "),
        ("bias x much", "`much` is not a number for `bias` ; a number in the unit of the target ; "),
        ("late plant --histogram 1,2", "`1` is not a row of `histogram` ; NUMBER:NUMBER,NUMBER:NUMBER,..: Rows. ; "),
        (
            "bias x 1 --table /nowhere.csv",
            "/nowhere.csv: No such file or directory (os error 2) ; a table of a time and one or more columns ; ",
        ),
    ];
    for (line, expected) in cases {
        let refusals = typed(line).expect_err(line);
        let texts: Vec<String> = (refusals.iter())
            .map(|refusal| {
                let expected = refusal.expected.as_deref().unwrap_or_default();
                format!(
                    "{} ; {expected} ; {}",
                    refusal.message,
                    refusal.nearest.first().map_or("", String::as_str)
                )
            })
            .collect();
        assert_eq!(texts, [expected], "{line}");
    }
}

#[test]
fn options_without_meaning_are_refused() {
    for line in [
        "",
        "--active --clear all",
        "--list --at 7",
        "--active --ramp 1",
        "bias x --delay 1s",
        "bias x --for 1",
        "bias x 1 --at 7 --at-step 3",
        "bias x --bias",
        "--list --plant-bin x --session y",
        "bias x 1 --ramp 2m",
    ] {
        let words = ["hil", "inject"].into_iter().chain(line.split_whitespace());
        let arranged = crate::arguments::inject::arrange(words.map(std::ffi::OsString::from));
        assert!(InjectLine::try_parse_from(arranged).is_err(), "{line}");
    }
}

#[test]
fn a_file_of_points_is_sent_as_numbers() {
    let file = std::env::temp_dir().join(format!("hil-points-{}.csv", std::process::id()));
    std::fs::write(&file, "# ours\ntime_s, value\n0,0\n0.5, 1e-3\n").expect("written");
    let text = typed(&format!("bias x 1 --table {}", file.display()));
    std::fs::write(&file, "time_s,value\n0,a\n").expect("written");
    let refused = typed(&format!("bias x 1 --table {}", file.display()));
    std::fs::remove_file(&file).expect("removed");
    let profile = "profile = { kind = \"table\", time_s = [0.0, 0.5], values = [0.0, 0.001] }\n";
    assert!(
        text.as_ref().is_ok_and(|text| text.ends_with(profile)),
        "{text:?}"
    );
    assert!(
        refused.expect_err("no number")[0]
            .message
            .contains("line 2 `0,a`: not a point: `a` in `value` is not a number")
    );
}
