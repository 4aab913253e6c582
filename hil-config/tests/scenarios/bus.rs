//! `[bus]`: what a sound one means, and every mistake.

use hil_config::plan::Plan;
use hil_config::problem::{Problem, ProblemKind};

use crate::{check, descriptions, only, plan, problems};

/// Port file whose frames carry everything.
const PORT: &str = r#"port = 1
[[frames]]
name = "motion"
carries = "sample"
period_s = 0.01
stale_s = 0.025
fields = [
    { signal = "measured.position_m", type = "i16", scale = 1e-6 },
    { signal = "reference.position_m", type = "f64" },
]
[[frames]]
name = "drive"
carries = "command"
fields = [{ signal = "command.force_n", type = "f32" }]
"#;

/// Scenario with a bus of these keys, and more behind it.
fn scenario(bus: &str, more: &str) -> String {
    format!(
        r#"schema = 1
name = "bus"
run = {{ duration_s = 1.0, rate_hz = 1000 }}
plant = {{ model = "spring-mass" }}
controller = {{ law = "pid" }}
[bus]
{bus}
[[stimuli]]
target = "position_m"
kind = "step"
at_s = 0.5
after = 0.01
{more}
"#
    )
}

fn with(port: &str, keys: &str) -> String {
    scenario(&format!("text = '''\n{port}'''\n{keys}"), "")
}

fn wrong(text: &str) -> Problem {
    only(problems(text))
}

#[test]
fn a_bus_is_shown_as_it_is_with_what_follows_from_it() {
    for keys in ["", "redundancy = 2", "redundancy = 2\nskew_limit_s = 0.003"] {
        let plan: Plan = plan(&with(PORT, keys));
        let text = descriptions::shown(&plan);
        assert_eq!(crate::plan(&text), plan, "{text}");
        for line in [
            "# frame motion, sample: every 10 steps (0.01 s), values up to 9 steps old, stale above 25 steps",
            "#   measured.position_m: steps of 1e-6 m, -0.032768 to 0.032767 m",
            "#   reference.position_m: a float of 64 bits\n",
            "# frame drive, command: every 1 step (0.001 s), values up to 0 steps old, never stale",
        ] {
            assert!(text.contains(line), "`{line}` is not in\n{text}");
        }
    }
}

#[test]
fn a_bus_keeps_the_texts_of_its_dbc_files() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let dbc = "VERSION \"\"\nBU_: Rig\nBO_ 513 Drive: 4 Rig\n SG_ Force : 0|16@1- (0.5,0) [0|0] \"N\" Rig\n";
    std::fs::write(folder.path().join("board.dbc"), dbc).expect("written");
    let from = "fields = [{ signal = \"command.force_n\", type = \"f32\" }]";
    let to = "dbc = \"board.dbc\"\nmessage = \"Drive\"\nfields = [{ signal = \"command.force_n\", dbc_signal = \"Force\" }]";
    std::fs::write(folder.path().join("bus.toml"), PORT.replace(from, to)).expect("written");
    let file = folder.path().join("bus.toml");
    let plan = plan(&scenario(&format!("file = {file:?}"), ""));
    drop(folder);
    let text = descriptions::shown(&plan);
    assert!(
        text.contains("#   command.force_n: steps of 0.5 N, "),
        "{text}"
    );
    // Without the files.
    assert_eq!(crate::plan(&text), plan, "{text}");
}

#[test]
fn what_no_frame_carries_is_refused_with_its_list() {
    let port = PORT.replace(
        "measured.position_m\", type = \"i16\", scale = 1e-6",
        "measured.velocity_mps\", type = \"f64\"",
    );
    let port = port.replace(
        "    { signal = \"reference.position_m\", type = \"f64\" },\n",
        "",
    );
    let problem = wrong(&with(&port, ""));
    assert_eq!(problem.kind, ProblemKind::Unbound);
    assert_eq!(
        problem.message,
        "no frame of the bus carries `measured.position_m`, `reference.position_m`"
    );
    // `measured.velocity_mps` is read by no law.
    assert!(check(&with(PORT, "")).is_ok());
}

#[test]
fn times_that_are_no_whole_steps_are_refused_with_the_nearest() {
    let problem = wrong(&with(
        &PORT.replace("period_s = 0.01", "period_s = 0.0125"),
        "",
    ));
    assert_eq!(
        problem.message,
        "the period of frame `motion` is no whole number of steps at 1000 Hz"
    );
    let expected = "a whole number of steps; the nearest are 0.012 s and 0.013 s";
    assert_eq!(problem.expected.as_deref(), Some(expected));
    let problem = wrong(&with(
        &PORT.replace("stale_s = 0.025", "stale_s = 0.004"),
        "",
    ));
    assert!(
        problem.message.contains("are stale after 0.004 s"),
        "{problem}"
    );
}

#[test]
fn faulty_keys_of_a_bus_are_refused() {
    #[rustfmt::skip] // a table
    let cases = [
        (with(PORT, "redundancy = 3"), "`bus.redundancy` is 3"),
        (with(PORT, "skew_limit_s = 0.1"), "`bus.skew_limit_s` has no effect"),
        (with(PORT, "file = \"a.toml\""), "a bus has a file or a text"),
        (scenario("redundancy = 2", ""), "`bus.file` is missing"),
        (scenario("file = \"no.toml\"", ""), "`no.toml` cannot be read"),
        (with(PORT, "colour = 1"), "unknown key `colour`"),
        (with("port = 1\n", ""), "`frames` is missing"),
        (with(&PORT.replace("measured.position_m", "measured.positon_m"), ""), "positon_m"),
        (with(&PORT.replace("type = \"f64\"", "type = \"f64\", byte = 1"), ""), "shares bits with field"),
        (with(&PORT.replace("type = \"f64\"", "type = \"f32\", length = 4"), ""), "unknown key `length`"),
    ];
    for (text, piece) in cases {
        let problem = wrong(&text);
        assert!(problem.to_string().contains(piece), "{piece}\n{problem}");
    }
}

#[test]
fn frames_in_transit_have_a_limit_of_memory() {
    // Lengths tell them apart.
    let many: String = (3000..3030)
        .map(|k| format!("[[frames]]\nname = \"f{k}\"\ncarries = \"sample\"\nlength = {k}\nfields = [{{ kind = \"constant\", name = \"c\", type = \"u8\", value = 1 }}]\n"))
        .collect();
    let problem = wrong(&with(&format!("{PORT}{many}"), ""));
    assert!(
        problem.message.contains("frames in transit would take"),
        "{problem}"
    );
}

#[test]
fn a_network_is_a_target_only_where_there_are_two() {
    let fault = "[[faults]]\nkind = \"message-loss\"\nat_s = 0.1\neffects = [{ target = \"link.sample.b\" }]";
    let text = |keys: &str| scenario(&format!("text = '''\n{PORT}'''\n{keys}"), fault);
    assert!(check(&text("redundancy = 2")).is_ok());
    let problem = wrong(&text(""));
    assert!(
        problem.message.contains("is one of two networks"),
        "{problem}"
    );
    assert_eq!(
        problem.help.as_deref(),
        Some("`redundancy = 2` in `[bus]` makes two networks")
    );
}
