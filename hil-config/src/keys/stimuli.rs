//! `[[stimuli]]`: the keys of a stimulus and of each waveform.

use shared_types::time::Rate;

use super::tables::TABLE;
use super::waveforms::{ANY, ANY_OR_ZERO, FREQUENCY, MULTISINE, PRBS, PULSE, SEQUENCE, SQUARE};
use super::{Key, LENGTH, MAX_S, TEXT, choice, number_or};

/// `[[stimuli]]`; in addition the keys of the kind in [`WAVEFORMS`].
pub(crate) const STIMULUS: &[Key] = keys! {
    target!: TEXT,
        "Name of the reference signal, its unit at the end; or plant.NAME for an input of the plant that no law commands.";
    kind!: TEXT, "Waveform.";
    unit: TEXT, "Unit of the target. Default: the unit that the name's ending stands for.";
};

/// Kind of waveform.
#[derive(Debug)]
pub(crate) struct WaveformKind {
    /// The stimulus' `kind`.
    pub name: &'static str,
    /// Largest number of time derivatives that are sent with the signal.
    pub derivatives: usize,
    /// Description of the waveform.
    pub text: &'static str,
    /// Keys. Magnitudes without a unit are in the target's unit.
    pub keys: &'static [Key],
}

/// Name of the kind that has the others as its parts.
pub(crate) const SEQUENCE_KIND: &str = "sequence";

/// Waveforms of stimuli.
pub(crate) const WAVEFORMS: &[WaveformKind] = &[
    WaveformKind {
        name: "paper",
        derivatives: 5,
        text: "atan(amplitude sin(2 pi frequency t)) (1 - exp(-onset t^3)), the paper's command.",
        keys: keys! {
            amplitude: number_or("1", f64::MIN, f64::MAX, 0.2), "Factor inside the arc tangent.";
            frequency_hz: number_or("Hz", 0.0, Rate::MAX_HZ, 1.0), "Frequency.";
            onset_per_s3: number_or("1/s3", 0.0, 1e12, 0.1), "Speed of the onset.";
        },
    },
    WaveformKind {
        name: "step",
        derivatives: 0,
        text: "before until at_s, then after.",
        keys: keys! {
            at_s: number_or("s", 0.0, MAX_S, 0.0), "Time of the step.";
            before: ANY_OR_ZERO, "Value before.";
            after!: ANY, "Value from then on.";
        },
    },
    WaveformKind {
        name: "ramp",
        derivatives: 1,
        text: "start until at_s, then a constant slope for duration_s, then end.",
        keys: keys! {
            at_s: number_or("s", 0.0, MAX_S, 0.0), "Begin.";
            duration_s!: LENGTH, "Length of the slope.";
            start: ANY_OR_ZERO, "Value before.";
            end!: ANY, "Value after.";
        },
    },
    WaveformKind {
        name: "sine",
        derivatives: 5,
        text: "offset + amplitude sin(2 pi frequency t + phase).",
        keys: keys! {
            amplitude!: ANY, "Amplitude.";
            frequency_hz!: FREQUENCY, "Frequency.";
            phase_rad: number_or("rad", -1e6, 1e6, 0.0), "Phase.";
            offset: ANY_OR_ZERO, "Mean value.";
        },
    },
    WaveformKind {
        name: "chirp",
        derivatives: 5,
        text: "offset + a sine whose frequency goes from start_hz to end_hz in duration_s and stays there.",
        keys: keys! {
            amplitude!: ANY, "Amplitude.";
            start_hz!: FREQUENCY, "Frequency at the start.";
            end_hz!: FREQUENCY, "Frequency at the end.";
            duration_s!: LENGTH, "Length of the sweep.";
            sweep: choice(&["linear", "logarithmic"]),
                "linear: the frequency rises by the same amount in each second; logarithmic: by the same ratio, both frequencies above 0.";
            offset: ANY_OR_ZERO, "Mean value.";
        },
    },
    WaveformKind {
        name: "square",
        derivatives: 0,
        text: "offset + amplitude in the first part of each period, then offset - amplitude.",
        keys: SQUARE,
    },
    WaveformKind {
        name: "pulse",
        derivatives: 0,
        text: "high for width_s from at_s on, else low; once, or every period_s.",
        keys: PULSE,
    },
    WaveformKind {
        name: "prbs",
        derivatives: 0,
        text: "Pseudo-random binary sequence of maximal length: offset + amplitude or offset - amplitude, the same for the same order and seed as scipy.signal.max_len_seq.",
        keys: PRBS,
    },
    WaveformKind {
        name: "multisine",
        derivatives: 5,
        text: "offset + a sum of sines of given frequencies or of a band.",
        keys: MULTISINE,
    },
    WaveformKind {
        name: SEQUENCE_KIND,
        derivatives: 5,
        text: "Waveforms one after the other, each on its own clock; after the last one its last value is held. Sent with the derivatives that exist where the parts meet.",
        keys: SEQUENCE,
    },
    WaveformKind {
        name: "table",
        derivatives: 5,
        text: "Rows of a file or of lists, constant before the first and by default after the last; some of the times must lie in the run.",
        keys: TABLE,
    },
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{Sweep, Waveform};
    use crate::table::{AfterEnd, Interpolation, Points, Table};

    #[test]
    fn waveforms_have_as_many_derivatives_as_in_the_plan() {
        let named = |name: &str| WAVEFORMS.iter().find(|kind| kind.name == name);
        let [paper, step, ramp, sine, chirp, table] =
            ["paper", "step", "ramp", "sine", "chirp", "table"]
                .map(|name| named(name).expect("a kind"));
        let two_levels = ["square", "pulse", "prbs"];
        for name in two_levels {
            assert_eq!(named(name).expect("a kind").derivatives, 0, "{name}");
        }
        let zero = 0.0;
        let cases = [
            (
                paper,
                Waveform::Paper {
                    amplitude: zero,
                    frequency_hz: zero,
                    onset_per_s3: zero,
                },
            ),
            (
                step,
                Waveform::Step {
                    at_s: zero,
                    before: zero,
                    after: zero,
                },
            ),
            (
                ramp,
                Waveform::Ramp {
                    at_s: zero,
                    duration_s: 1.0,
                    start: zero,
                    end: zero,
                },
            ),
            (
                sine,
                Waveform::Sine {
                    amplitude: zero,
                    frequency_hz: zero,
                    phase_rad: zero,
                    offset: zero,
                },
            ),
            (
                chirp,
                Waveform::Chirp {
                    amplitude: zero,
                    start_hz: zero,
                    end_hz: zero,
                    duration_s: 1.0,
                    sweep: Sweep::Linear,
                    offset: zero,
                },
            ),
            (
                table,
                Waveform::Table(
                    Table::new(
                        Points::new(vec![zero], vec![vec![zero]]).expect("a row"),
                        Interpolation::Cubic,
                        false,
                        AfterEnd::Hold,
                    )
                    .expect("a table"),
                ),
            ),
        ];
        for (kind, waveform) in cases {
            assert_eq!(kind.derivatives, waveform.derivatives(), "{}", kind.name);
            let tagged = serde_json::to_value(&waveform).expect("serialises");
            assert_eq!(tagged["kind"], kind.name);
        }
    }
}
