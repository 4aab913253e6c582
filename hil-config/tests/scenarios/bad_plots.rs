//! Faulty plots, each refused with the problem, its place and the expected value.

use hil_config::problem::ProblemKind::{
    MissingKey, OutOfRange, UnknownKey, UnknownName, WrongType,
};

use crate::bad::{Case, assert_one_problem};
use crate::{base_with, plan};

const SIGNALS: &str = "signals = [\"truth.surface_angle_rad\"]";

#[rustfmt::skip] // a table reads best with a case on a line
const CASES: &[Case] = &[
    (SIGNALS, "signals = [^\"truth.surface_angel_rad\"]", UnknownName, &["`plots[1].signals[0]` is `truth.surface_angel_rad`, which is not a signal", "nearest: `truth.surface_angle_rad`"]),
    (SIGNALS, "signals = [^\"eror_rad\"]", UnknownName, &["is not a signal of this run", "nearest: `error_rad`"]),
    (SIGNALS, "signals = [^\"internal.gains\"]", UnknownName, &["name them in `laws`"]),
    (SIGNALS, "signals = ^[]", OutOfRange, &["`plots[1].signals` is empty", "at least one"]),
    (SIGNALS, "signals = ^\"error_rad\"", WrongType, &["`plots[1].signals` is text", "a list of texts"]),
    (SIGNALS, "signals = [^1]", WrongType, &["`plots[1].signals[0]` is a number", "text"]),
    ("\n[[plots]]\ntitle = \"Surface\"\nsignals = [\"truth.surface_angle_rad\"]", "\n^[[plots]]\ntitle = \"Surface\"", MissingKey, &["`plots[1].signals` is missing"]),
    ("laws = [\"ftsc\"]", "laws = [\"ftsc\", ^\"fstc\"]", UnknownName, &["`plots[0].laws[1]` is `fstc`, which is not a law", "nearest: `ftsc`"]),
    ("laws = [\"ftsc\"]", "laws = ^[]", OutOfRange, &["`plots[0].laws` is empty"]),
    ("scale = \"log\"", "scale = ^\"cubic\"", UnknownName, &["`plots[0].scale` is `cubic`", "`linear`, `log`"]),
    ("lines = [0.1, 0.2]", "lines = [^nan]", OutOfRange, &["`plots[0].lines[0]` is not a number"]),
    ("lines = [0.1, 0.2]", "^line = 0.1", UnknownKey, &["unknown key `line`", "nearest: `lines`"]),
    ("window_s = 2", "window_s = ^0", OutOfRange, &["`panel.window_s` is 0"]),
    ("\"internal.*\"]", "^\"truth.surface_angel_rad\"]", UnknownName, &["`panel.readings[1]` is `truth.surface_angel_rad`, which is not a signal", "nearest: `truth.surface_angle_rad`"]),
    ("tune = [\"reference.*\"]", "tune = [^\"reference.surface_angel_rad\"]", UnknownName, &["cannot be changed during this run", "nearest: `reference.surface_angle_rad`"]),
    ("inject = [\"leakage --actuator 1\"]", "inject = [^1]", WrongType, &["`panel.inject[0]` is a number"]),
    ("tune = [\"reference.*\"]", "^slider = []", UnknownKey, &["unknown key `slider`"]),
];

#[test]
fn each_faulty_plot_is_refused_with_its_place_and_the_expected_value() {
    for (from, to, kind, pieces) in CASES {
        assert_one_problem(&base_with(from, to), *kind, pieces);
    }
}

#[test]
fn a_plot_for_other_laws_may_name_their_internal_signals() {
    let text = base_with("laws = [\"ftsc\"]", "laws = [\"pid\", \"nrsc\"]");
    let text = text.replace("\"internal.fault_detected\"]", "\"internal.of_pid\"]");
    assert_eq!(plan(&text).plots[0].signals[1], "internal.of_pid");
}
