//! Faulty plots, each refused with the problem, its place and the expected value.

use hil_config::problem::ProblemKind::{
    Duplicate, MissingKey, OutOfRange, UnknownKey, UnknownName, WrongType,
};

use crate::bad::{Case, assert_one_problem};
use crate::{BASE, base_with, only, plan, problems};

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
    (SIGNALS, "kind = ^\"spectra\"\nsignals = [\"truth.surface_angle_rad\"]", UnknownName, &["unknown kind of plot `spectra`", "nearest: `spectrum`"]),
    (SIGNALS, "kind = \"xy\"\nx = ^\"eror_rad\"\nsignals = [\"truth.surface_angle_rad\"]", UnknownName, &["`plots[1].x` is `eror_rad`, which is not a signal", "nearest: `error_rad`"]),
    ("\n[[plots]]\ntitle = \"Surface\"\nsignals = [\"truth.surface_angle_rad\"]", "\n^[[plots]]\ntitle = \"Surface\"\nkind = \"xy\"\nsignals = [\"truth.surface_angle_rad\"]", MissingKey, &["`plots[1].x` is missing"]),
    (SIGNALS, "signals = [\"truth.surface_angle_rad\"]\n^window = \"hann\"", UnknownKey, &["unknown key `window`"]),
    (SIGNALS, "kind = \"spectrum\"\nwindow = ^\"hamm\"\nsignals = [\"truth.surface_angle_rad\"]", UnknownName, &["`plots[1].window` is `hamm`", "nearest: `hann`"]),
    (SIGNALS, "kind = \"spectrum\"\nresolution_hz = ^0\nsignals = [\"truth.surface_angle_rad\"]", OutOfRange, &["`plots[1].resolution_hz` is 0"]),
    (SIGNALS, "kind = \"bode\"\nmetric = ^\"surface\"", UnknownName, &["`plots[1].metric` is `surface`, which is not a metric of kind frequency-response"]),
    (SIGNALS, "name = ^\"a b\"\nsignals = [\"truth.surface_angle_rad\"]", OutOfRange, &["`plots[1].name` is `a b`", "letters, digits, - and _"]),
    ("title = \"Error\"\n", "title = \"Error\"\nname = ^\"a b\"\n", OutOfRange, &["`plots[0].name` is `a b`"]),
    (SIGNALS, "from_s = 2\nuntil_s = ^1\nsignals = [\"truth.surface_angle_rad\"]", OutOfRange, &["`plots[1].until_s` is 1", "a time after 2"]),
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
fn further_plots_follow_unless_the_scenario_does_without() {
    assert!(plan(BASE).further_plots);
    let without = |value: &str| format!("further_plots = {value}\n{BASE}");
    assert!(!plan(&without("false")).further_plots);
    assert!(plan(&without("true")).further_plots);
    assert_one_problem(
        &without("^0"),
        WrongType,
        &["`further_plots` is a number", "true or false"],
    );
}

#[test]
fn a_plot_for_other_laws_may_name_their_internal_signals() {
    let text = base_with("laws = [\"ftsc\"]", "laws = [\"pid\", \"nrsc\"]");
    let text = text.replace("\"internal.fault_detected\"]", "\"internal.of_pid\"]");
    assert_eq!(plan(&text).plots[0].signals[1], "internal.of_pid");
}

#[test]
fn every_kind_of_plot_is_shown_as_it_was_written() {
    let own = "
[[plots]]
title = \"A\"
kind = \"xy\"
name = \"a\"
caption = \"All of it\"
x = \"error_rad\"
signals = [\"truth.surface_angle_rad\"]
from_s = 1.0
until_s = 2.0

[[plots]]
title = \"B\"
kind = \"spectrum\"
signals = [\"truth.surface_angle_rad\"]
quantity = \"density\"
window = \"flat-top\"
resolution_hz = 4.0
scale = \"linear\"

[[plots]]
title = \"C\"
kind = \"spectrum\"
signals = [\"truth.surface_angle_rad\"]

[[plots]]
title = \"D\"
kind = \"nichols\"

[[plots]]
title = \"E\"
kind = \"bode\"
";
    let text = base_with(SIGNALS, SIGNALS) + own;
    let plan = plan(&text);
    assert_eq!(plan.plots.len(), 7);
    let effective = crate::descriptions::shown(&plan);
    let (_, plots) = effective.split_once("title = \"A\"").expect("shown");
    let (_, expected) = own.split_once("title = \"A\"").expect("written");
    assert!(plots.starts_with(expected.trim_end()), "{plots}");
}

#[test]
fn two_plots_cannot_share_the_name_of_their_files() {
    let text = base_with("title = \"Error\"", "title = \"Error\"\nname = \"same\"");
    let text = text.replacen(
        "title = \"Surface\"",
        "title = \"Surface\"\nname = \"same\"",
        1,
    );
    let problem = only(problems(&text));
    let expected = "`plots[1].name` is `same`, as is the name of an earlier plot";
    assert!(
        problem.kind == Duplicate && problem.to_string().contains(expected),
        "{problem}"
    );
}
