//! Square waves, pulses, binary sequences, sums of sines and sequences of waveforms in a scenario.

use hil_config::plan::Waveform;
use hil_config::show::show;
use hil_config::stimulus::evaluate;

use crate::{base_with, descriptions, plan, problems};

/// Stimulus of the base that the tests replace.
const STEP: &str = "kind = \"step\"\nat_s = 0.5\nafter = 2.0";

fn waveform(keys: &str) -> Waveform {
    plan(&base_with(STEP, keys)).stimuli[1].waveform.clone()
}

fn value(waveform: &Waveform, step: u32) -> f64 {
    let mut row = vec![f64::NAN; 1 + waveform.derivatives()];
    evaluate(waveform, f64::from(step) / 1000.0, &mut row);
    row[0]
}

const SEQUENCE: &str = r#"kind = "sequence"
[[stimuli.parts]]
kind = "pulse"
length_s = 0.5
at_s = 0.1
width_s = 0.2
high = 3.0
[[stimuli.parts]]
length_s = 0.3
kind = "prbs"
amplitude = 1.0
bit_s = 0.01
order = 5
[[stimuli.parts]]
length_s = 1.2
kind = "multisine"
start_hz = 1.0
end_hz = 8.0
tones = 4
spacing = "logarithmic"
amplitude = 0.5"#;

#[test]
fn a_test_card_is_one_list() {
    let sequence = waveform(SEQUENCE);
    for (step, expected) in [
        (0, 0.0),
        (99, 0.0),
        (100, 3.0),
        (299, 3.0),
        (300, 0.0),
        (499, 0.0),
    ] {
        assert_eq!(value(&sequence, step), expected, "step {step}");
    }
    // x^5 + x^3 + 1 from 11111: s[k+5] = s[k] xor s[k+3].
    let bits = [1, 1, 1, 1, 1, 0, 0, 1, 1, 0, 1, 0, 0, 1, 0];
    for (bit, expected) in (0_u32..).zip(bits) {
        let expected = f64::from(2 * expected - 1);
        assert_eq!(value(&sequence, 500 + 10 * bit), expected, "bit {bit}");
        assert_eq!(value(&sequence, 509 + 10 * bit), expected, "bit {bit}");
    }
    let Waveform::Sequence(parts) = &sequence else {
        panic!("a sequence");
    };
    let Waveform::Multisine(sum) = &parts.parts[2].waveform else {
        panic!("a multisine");
    };
    for (frequency_hz, expected) in sum.frequencies_hz.iter().zip([1.0, 2.0, 4.0, 8.0]) {
        assert!((frequency_hz - expected).abs() < 1e-12, "{frequency_hz}");
    }
    assert_eq!(sum.frequencies_hz.len(), 4);
}

#[test]
fn every_kind_is_shown_as_it_can_be_read() {
    let texts = [
        SEQUENCE,
        "kind = \"square\"\namplitude = 1\nfrequency_hz = 3\nduty = 0.2\nphase_rad = 1.5\noffset = -1",
        "kind = \"pulse\"\nwidth_s = 0.1\nhigh = 2\nperiod_s = 0.3",
        "kind = \"pulse\"\nwidth_s = 0.1\nhigh = 2\nlow = 1",
        "kind = \"prbs\"\namplitude = 2\nbit_s = 0.005\nseed = 5",
        "kind = \"multisine\"\nfrequencies_hz = [1, 2.5]\namplitudes = [1, 2]\nphases_rad = [0, 1]",
        "kind = \"multisine\"\nstart_hz = 1\nend_hz = 9\ntones = 5\namplitude = 1\nphases = \"zero\"",
    ];
    for text in texts {
        let plan = plan(&base_with(STEP, text));
        let text_of_plan = show(
            &plan,
            &descriptions::plants(),
            &descriptions::laws(),
            &descriptions::kinds(),
        );
        let text_of_plan = text_of_plan.expect("described");
        assert_eq!(crate::plan(&text_of_plan), plan, "{text_of_plan}");
    }
}

#[test]
fn faulty_keys_are_refused_with_what_is_possible() {
    let multisine = "kind = \"multisine\"\n";
    for (text, message, advice) in [
        (
            "kind = \"pulse\"\nwidth_s = 0.5\nhigh = 2\nperiod_s = 0.5".to_owned(),
            "`stimuli[1].period_s` is 0.5, but a pulse lasts 0.5 and would never end",
            "a number above 0.5 in s",
        ),
        (
            "kind = \"pulse\"\nwidth_s = 0.5\nhigh = 2\nat_s = 9".to_owned(),
            "`stimuli[1].at_s` is 9, which is after the end of the run",
            "from 0 to 2 in s",
        ),
        (
            "kind = \"prbs\"\namplitude = 1\nbit_s = 0.0025".to_owned(),
            "`stimuli[1].bit_s` is 0.0025 s, which is 2.5 steps of the run: bits would differ in length",
            "the nearest are 0.002 and 0.003 s",
        ),
        (
            "kind = \"prbs\"\namplitude = 1\nbit_s = 0.1\norder = 4\nseed = 16".to_owned(),
            "`stimuli[1].seed` is 16, which has more than 4 bits",
            "a whole number from 1 to 15, or another `order`",
        ),
        (
            multisine.to_owned() + "amplitude = 1",
            "a multisine needs exactly one definition of its frequencies",
            "either `frequencies_hz`, or `start_hz`, `end_hz` and `tones`",
        ),
        (
            multisine.to_owned() + "frequencies_hz = [1]",
            "a multisine needs exactly one definition of its amplitudes",
            "either `amplitude` or `amplitudes`",
        ),
        (
            multisine.to_owned()
                + "frequencies_hz = [1]\namplitude = 1\nphases = \"zero\"\nphases_rad = [0]",
            "a multisine takes at most one definition of its phases",
            "`phases`, `phases_rad` or neither",
        ),
        (
            multisine.to_owned() + "frequencies_hz = [1, 2]\namplitudes = [1]",
            "`stimuli[1].amplitudes` has 1 numbers for 2 frequencies",
            "as many numbers as frequencies",
        ),
        (
            multisine.to_owned() + "frequencies_hz = [1, 501]\namplitude = 1",
            "`stimuli[1].frequencies_hz` has a tone of 501 Hz",
            "from 0 to 500 Hz, half of run.rate_hz",
        ),
        (
            multisine.to_owned() + "start_hz = 5\nend_hz = 5\ntones = 3\namplitude = 1",
            "`stimuli[1].start_hz` is 5, and the band ends at 5 Hz",
            "a band from a lower to a higher frequency",
        ),
        (
            "kind = \"sequence\"\nparts = []".to_owned(),
            "`stimuli[1].parts` has 0 parts",
            "1 to 1000 parts",
        ),
        (
            SEQUENCE.replace("length_s = 0.5", "length_s = 2.0"),
            "`stimuli[1].parts[1]` begins at 2 s, and the run ends at 2 s",
            "leave out the part, or raise run.duration_s",
        ),
        (
            SEQUENCE.replace("kind = \"pulse\"", "kind = \"sequence\""),
            "unknown kind of stimulus `sequence`",
            "`prbs`",
        ),
    ] {
        let problem = problems(&base_with(STEP, &text)).remove(0);
        assert_eq!(problem.message, message, "{problem}");
        assert!(problem.to_string().contains(advice), "{problem}");
    }
}

#[test]
fn a_law_gets_the_derivatives_of_a_sequence_or_the_reason_why_there_are_none() {
    let sine = "kind = \"sine\"\namplitude = 0.1\nfrequency_hz = 1.0";
    // 1 s is a whole period: value and slope of both parts meet, and the second derivative is 0.
    let smooth = "kind = \"sequence\"\nparts = [\n\
        { kind = \"sine\", length_s = 1.0, amplitude = 0.1, frequency_hz = 1.0 },\n\
        { kind = \"sine\", length_s = 1.0, amplitude = 0.05, frequency_hz = 2.0 }]";
    let plan = plan(&base_with(sine, smooth));
    assert_eq!(plan.stimuli[0].waveform.derivatives(), 3);
    let torn = smooth.replace("0.05", "0.2");
    let problem = problems(&base_with(sine, &torn)).remove(0);
    assert!(
        problem
            .message
            .starts_with("law `ftsc` needs the reference signal"),
        "{problem}"
    );
    let help = problem.help.as_deref().expect("a reason");
    assert!(
        help.contains(
            "the sequence of `surface_angle_rad` has 1 of 2 derivatives: its slope jumps from"
        ),
        "{help}"
    );
    assert!(help.contains("at 1 s, the end of part 1"), "{help}");
    let stepped = smooth.replace(
        "{ kind = \"sine\", length_s = 1.0, amplitude = 0.05, frequency_hz = 2.0 }",
        "{ kind = \"step\", length_s = 1.0, after = 0.1 }",
    );
    let problem = problems(&base_with(sine, &stepped)).remove(0);
    let help = problem.help.as_deref().expect("a reason");
    assert!(
        help.ends_with("0 of 2 derivatives: its part 2 has none"),
        "{help}"
    );
}
