//! The page in a headless Chromium: every control is used, and its effect is observed in the session.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::Path;
use std::process::{ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};

use serde_json::{Value, json};

use super::stream::held;
use super::{Panel, SCENARIO};
use crate::support::company::Companion;
use crate::support::harness::{Rig, Run, Running};
use crate::support::node::node_packages;
use crate::support::programs::{chromium, skip, workspace};
use crate::support::python::python;

const DROPOUT: &str = "dropout measured.position_m --duration 0.05";

/// Browser script in progress.
pub(crate) struct Play {
    process: Companion,
    stdout: BufReader<ChildStdout>,
}

impl Play {
    /// Plays a script on the page of a session; `None` without a browser.
    pub(super) fn start(name: &str, url: &str) -> Option<Self> {
        Self::of("panel_page.py", name, url)
    }

    /// Plays a script that looks closer at a run.
    pub(super) fn closer(name: &str, url: &str) -> Option<Self> {
        Self::of("panel_closer.py", name, url)
    }

    /// Plays a script of `tests/hosts` on a page.
    pub(crate) fn of(file: &str, name: &str, url: &str) -> Option<Self> {
        Self::with(file, name, url, None)
    }

    /// Plays a script of `tests/hosts` with axe-core; `None` without either.
    pub(super) fn with_axe(name: &str, url: &str) -> Option<Self> {
        let Some(packages) = node_packages("axe-core") else {
            skip("axe-core of tests/node is not installed", "HIL_TEST_NODE");
            return None;
        };
        let axe = packages.join("node_modules/axe-core/axe.min.js");
        Self::with("panel_closer.py", name, url, Some(&axe))
    }

    fn with(file: &str, name: &str, url: &str, axe: Option<&Path>) -> Option<Self> {
        let Some((python, chromium)) = python("playwright.sync_api").zip(chromium()) else {
            skip(
                "python3 with playwright, or chromium, is missing",
                "HIL_TEST_CHROMIUM",
            );
            return None;
        };
        let mut play = Command::new(python);
        play.arg(workspace().join("tests/hosts").join(file));
        play.args([name, url, chromium])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .envs(axe.map(|path| ("AXE", path)));
        let mut process = Companion::start(&mut play);
        let stdout = BufReader::new(process.stdout.take().expect("piped"));
        Some(Self { process, stdout })
    }

    /// Waits until the script requests an action, and tells it when the action is done.
    pub(super) fn at_go(&mut self, does: impl FnOnce()) {
        let mut line = String::new();
        self.stdout.read_line(&mut line).expect("text");
        assert_eq!(line, "go\n");
        does();
        let stdin = self.process.stdin.as_mut().expect("piped");
        stdin.write_all(b"on\n").expect("it listens");
    }

    /// Waits for the end of the script, in which the browser reported no error; returns its result.
    pub(crate) fn result(mut self) -> Value {
        let mut text = String::new();
        self.stdout.read_to_string(&mut text).expect("text");
        let status = self.process.wait().expect("our child");
        assert!(status.success(), "{text}");
        let text: Value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}"));
        assert_eq!(text["wrong"], json!([]), "{text}");
        text
    }
}

/// Starts a run that is paused before step 2500, with a panel that observed it from its beginning.
pub(super) fn begun<'r>(rig: &'r Rig, pace: &str, arguments: &[&str]) -> (Running<'r>, Panel) {
    let paused = format!("{pace} --pause-at 0.001");
    let run = held(rig, Path::new(SCENARIO), &paused);
    let panel = Panel::start(rig, arguments);
    rig.in_session("step 2499").expect(0);
    rig.until_held_at(2500);
    (run, panel)
}

/// Panel of a run that is paused before step 2500, after a browser script has ended.
pub(super) struct Played<'r> {
    pub(super) result: Value,
    pub(super) panel: Panel,
    run: Running<'r>,
}

impl<'r> Played<'r> {
    /// Plays a script on the page of a panel; `None` without a browser.
    pub(super) fn of(rig: &'r Rig, script: &str, arguments: &[&str]) -> Option<Self> {
        let (run, panel) = begun(rig, "", arguments);
        let result = Play::start(script, &panel.url)?.result();
        Some(Self { result, panel, run })
    }

    /// Closes the panel and lets the run end.
    pub(super) fn end(self, rig: &Rig) -> Run {
        drop(self.panel);
        rig.in_session("resume").expect(0);
        self.run.finish()
    }
}

/// Fails unless every curve of every visible plot has ink.
pub(super) fn assert_drawn(ink: &Value) {
    let plots = ink.as_array().expect("plots");
    assert!(!plots.is_empty());
    for curves in plots {
        let curves = curves.as_array().expect("curves");
        // A curve may be almost entirely covered by another.
        let has = |least: u64| {
            curves
                .iter()
                .filter(|ink| ink.as_u64() > Some(least))
                .count()
        };
        assert!(has(40) > 0 && has(3) == curves.len(), "{ink}");
    }
}

fn number(text: &str) -> f64 {
    text.parse()
        .unwrap_or_else(|error| panic!("{error}: {text}"))
}

#[test]
fn every_control_has_its_effect_in_the_session() {
    let rig = Rig::new();
    // Slow, so that the page can pause it again before it ends.
    let (run, panel) = begun(&rig, "--pace 0.2", &["--inject", DROPOUT]);
    let Some(play) = Play::start("controls", &panel.url) else {
        return;
    };
    let output = play.result();
    let run = run.finish();
    let summary = run.summary();
    let faults = summary["faults"].as_array().expect("faults");
    let effects = faults.iter().map(|fault| {
        let effect = &fault["effects"][0];
        json!([
            fault["kind"],
            fault["effective_step"],
            effect["target"],
            effect["max_effect"],
            effect["ended_step"]
        ])
    });
    // The bias was cleared before step 2701, the prepared dropout ended by itself after 50 ms.
    let bias = effects
        .clone()
        .find(|effect| effect[0] == "bias")
        .expect("the bias");
    let size = bias[3].as_f64().expect("a size");
    assert!((size - 0.001).abs() < 1e-12, "{bias}");
    assert_eq!(
        [&bias[1], &bias[2], &bias[4]],
        [&json!(2601), &json!("measured.position_m"), &json!(2701)]
    );
    let dropout = effects
        .clone()
        .find(|effect| effect[0] == "dropout")
        .expect("the dropout");
    assert_eq!([&dropout[1], &dropout[4]], [&json!(2601), &json!(2651)]);
    assert_eq!(faults.len(), 2, "the wrong number was refused");
    assert_eq!(
        summary["marks"],
        json!([{ "step": 2601, "text": "<b>felt & heard</b>", "at_s": 2.601 }])
    );
    assert_eq!(output["bold"], 0, "texts stay texts");
    assert_eq!(output["held"], true);
    assert_eq!(
        (&output["pressed"], &output["theme"]),
        (&json!("false"), &json!("dark"))
    );
    assert_eq!(output["words"], "bias measured.position_m --bias=-0.001");
    // A tenth of the position so far, which is near 1 cm, in one digit.
    let usual = number(output["usual"].as_str().expect("text"));
    assert!((5e-4..=2e-3).contains(&usual), "{usual}");
    let verdict = summary["verdict"].as_str().expect("a verdict");
    assert_eq!(output["state"], format!("ended: {verdict}"));
    for part in ["spring-mass ended", "5000 steps"] {
        assert!(
            output["trouble"].as_str().expect("text").contains(part),
            "{output}"
        );
    }
    for requirement in summary["requirements"].as_array().expect("requirements") {
        let name = requirement["name"].as_str().expect("a name");
        assert!(
            output["requirements"]
                .as_str()
                .expect("text")
                .contains(name),
            "{output}"
        );
    }
    assert!(
        output["readings"]
            .as_str()
            .expect("text")
            .contains("truth.position_m")
    );
    // The first curve was hidden by clicking its name.
    let mut ink = output["ink"].clone();
    assert_eq!(ink[0][0].take(), 0, "{output}");
    ink[0].as_array_mut().expect("curves").remove(0);
    assert_drawn(&ink);
    drop(panel);
}

#[test]
fn a_slider_changes_its_value_on_every_page() {
    let rig = Rig::new();
    let (run, panel) = begun(&rig, "", &[]);
    let Some(play) = Play::start("tune", &panel.url) else {
        return;
    };
    let output = play.result();
    let run = run.finish();
    let summary = run.summary();
    let changes = summary["changes"].as_array().expect("changes");
    let of = |key: &str| {
        let own = changes
            .iter()
            .filter(|change| change["set"][0]["key"] == key);
        own.map(|change| (change["step"].clone(), change["set"][0]["value"].clone()))
            .collect::<Vec<_>>()
    };
    let mass = of("plant.parameters.mass_kg");
    assert_eq!(
        mass,
        [(json!(2500), json!(1.25)), (json!(2600), json!(1.0))]
    );
    let gains = of("controller.pid.proportional_n_per_m");
    assert!(
        gains.len() >= 2 && gains.iter().all(|(step, _)| step == 2500),
        "{gains:?}"
    );
    // A slider of 300 N/m goes from 0 to 600 in 200 steps of 3; a pixel or two of the drag belong to its thumb.
    let (dragged, pressed) = (output["dragged"].as_f64(), output["pressed"].as_f64());
    let (dragged, pressed) = dragged.zip(pressed).expect("numbers");
    assert!((435.0..=465.0).contains(&dragged), "{output}");
    assert_eq!(pressed, dragged + 3.0);
    assert_eq!(gains.last().expect("some").1, pressed);
    let reference = changes
        .iter()
        .find(|change| change["set"][0]["key"] == "reference.position_m");
    assert_eq!(reference.expect("it was set")["ramp_steps"], 100);
    let back = changes
        .iter()
        .find(|change| change["clear"] == json!(["reference.position_m"]));
    assert_eq!(back.expect("it was given back")["step"], 2600);
    // The changes by the slider share one row with a count.
    let rows = output["rows"].as_array().expect("rows");
    let (count, pressed) = (gains.len(), number(&output["pressed"].to_string()));
    let row = format!(
        "changed at step 2500 (2.5 s): controller.pid.proportional_n_per_m = {pressed} N/m ({count} changes since step 2500)"
    );
    assert_eq!(rows, &[json!(row)], "{output}");
    let focused = output["focused"].as_str().expect("a key");
    assert!(focused.starts_with("controller.pid."), "{focused}");
    rig.rerun(&run.folder, &[]).prints(&["same digest"]);
    drop(panel);
}

#[test]
fn everything_can_be_done_without_a_pointer() {
    let rig = Rig::new();
    let (run, panel) = begun(&rig, "", &["--inject", DROPOUT]);
    let Some(play) = Play::start("keyboard", &panel.url) else {
        return;
    };
    let output = play.result();
    let window: Vec<f64> = output["window"]
        .as_array()
        .expect("three")
        .iter()
        .filter_map(Value::as_f64)
        .collect();
    let asks = output["asks"].as_array().expect("looks");
    let question =
        "Inject dropout measured.position_m --duration 0.05?\ny injects it, any other key cancels.";
    let nothing = json!(false);
    assert_eq!(asks[..5], [(); 5].map(|()| nothing.clone()), "{output}");
    assert_eq!(
        asks[5..],
        [json!(question), nothing.clone(), nothing],
        "{output}"
    );
    // The whole run is the longest window.
    assert!(
        window[0] == window[1] && window[2] < window[0],
        "{window:?}"
    );
    assert_eq!(
        (&output["focused"], &output["outlined"]),
        (&json!("kind"), &json!(true))
    );
    assert_eq!(output["skipped"], json!(["plots", panel.url]));
    let reached = output["reached"].as_array().expect("controls");
    for control in [
        "pause", "step", "steps", "mark", "window", "theme", "kind", "target",
    ] {
        assert!(reached.contains(&json!(control)), "{control}: {reached:?}");
    }
    let run = run.finish();
    let summary = run.summary();
    assert_eq!(summary["marks"][0]["text"], "by keys");
    let kinds: Vec<&Value> = (summary["faults"].as_array().expect("faults").iter())
        .map(|fault| &fault["kind"])
        .collect();
    assert_eq!(kinds, ["dropout", "stuck"]);
    drop(panel);
}

#[test]
fn the_page_fits_a_phone_and_a_desktop_in_both_themes() {
    let rig = Rig::new();
    let Some(played) = Played::of(&rig, "looks", &["--inject", DROPOUT]) else {
        return;
    };
    let output = &played.result;
    for name in ["desk-light", "desk-dark", "phone-light", "phone-dark"] {
        let output = &output[name];
        assert_eq!(name.split_once('-').expect("a theme").1, output["theme"]);
        assert!(output["overflow"].as_i64() <= Some(0), "{name}: {output}");
        assert_eq!(output["small"], json!([]), "{name}: too small for a finger");
        assert_drawn(&output["ink"]);
    }
    // Two corners for a line, five for a spike of one stretch, a line between gaps; no value further away than a quarter
    // of a pixel.
    let corners = [("line", 2, 1), ("spike", 5, 1), ("gaps", 8, 4)];
    for (shape, corners, pieces) in corners {
        let course = &output["courses"][shape];
        let (drawn, kept) = (course[1].as_u64(), course[2].as_u64());
        assert_eq!((drawn, kept), (Some(corners), Some(pieces)), "{shape}");
    }
    let courses = output["courses"].as_object().expect("shapes");
    assert_eq!(courses.len(), 6);
    for (shape, course) in courses {
        let farthest = course[0].as_f64().expect("pixels");
        assert!(farthest < 0.25 + 1e-9, "{shape}: {farthest}");
    }
    played.end(&rig).expect(0);
}

#[test]
fn two_browsers_show_each_others_actions() {
    let rig = Rig::new();
    let Some(played) = Played::of(&rig, "several", &[]) else {
        return;
    };
    let output = &played.result;
    assert!(
        output["one"].as_str().expect("text").contains("dropout"),
        "{output}"
    );
    // The mark and the fault belong to one step, and so to one update of the state.
    let log = output["log"].as_array().expect("rows");
    let rows = |part: &str| {
        let has = |row: &&Value| row.as_str().is_some_and(|row| row.contains(part));
        log.iter().filter(has).count()
    };
    assert_eq!(rows("fault 1 dropout on"), 1, "{output}");
    assert_eq!(rows("mark at step 2501 (2.501 s): from the other"), 1);
    for later in ["other-log", "loaded-log"] {
        assert_eq!(output[later], output["log"], "{later}: {output}");
    }
    let summary = played.end(&rig).summary();
    assert_eq!(summary["marks"][0]["text"], "from the other");
    assert_eq!(summary["faults"][0]["effective_step"], 2501);
}

/// Forwarded connection like that of `ssh -L`: another port, and all connections can be cut.
struct Wire {
    port: u16,
    ends: Arc<Mutex<Vec<TcpStream>>>,
}

impl Wire {
    fn to(address: &str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = listener.local_addr().expect("an address").port();
        let ends: Arc<Mutex<Vec<TcpStream>>> = Arc::default();
        let (theirs, address) = (Arc::clone(&ends), address.to_owned());
        // Ends with the tests.
        std::thread::spawn(move || {
            for near in listener.incoming().flatten() {
                let Ok(far) = TcpStream::connect(&address) else {
                    continue;
                };
                let both = || {
                    [
                        near.try_clone().expect("an end"),
                        far.try_clone().expect("an end"),
                    ]
                };
                theirs
                    .lock()
                    .unwrap_or_else(PoisonError::into_inner)
                    .extend(both());
                for [mut from, mut to] in [both(), {
                    let [a, b] = both();
                    [b, a]
                }] {
                    std::thread::spawn(move || {
                        let _ = std::io::copy(&mut from, &mut to); // until it is cut
                        let _ = to.shutdown(Shutdown::Both);
                    });
                }
            }
        });
        Self { port, ends }
    }

    fn cut(&self) {
        for end in self
            .ends
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .drain(..)
        {
            let _ = end.shutdown(Shutdown::Both); // it may be closed already
        }
    }
}

#[test]
fn a_forwarded_connection_recovers_after_a_cut_with_the_missed_data() {
    let rig = Rig::new();
    let (run, panel) = begun(&rig, "", &[]);
    let wire = Wire::to(panel.address());
    let url = format!("http://localhost:{}/#{}", wire.port, panel.secret());
    let Some(mut play) = Play::start("reconnect", &url) else {
        return;
    };
    play.at_go(|| wire.cut());
    let output = play.result();
    assert_drawn(&output["cut"]);
    assert_drawn(&output["loaded"]);
    let log = output["log"].as_array().expect("rows");
    let is_mark = |row: &&Value| row == &"mark at step 2500 (2.5 s): before the cut";
    assert_eq!(log.iter().filter(is_mark).count(), 1, "{output}");
    for later in ["cut-log", "loaded-log"] {
        assert_eq!(output[later], output["log"], "{later}: {output}");
    }
    assert_eq!(
        (&output["state"], &output["url"]),
        (&json!("paused"), &json!(url))
    );
    drop(panel);
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

#[test]
fn a_browser_without_the_secret_and_a_foreign_page_get_nothing() {
    let rig = Rig::new();
    let Some(played) = Played::of(&rig, "strangers", &[]) else {
        return;
    };
    let output = &played.result;
    for (name, part) in [("none", "has no secret"), ("false", "the secret is wrong")] {
        assert!(
            output[name].as_str().expect("text").contains(part),
            "{output}"
        );
        assert_eq!(output[format!("{name}-plots")], 0);
    }
    assert_eq!(
        (&output["foreign"], &output["framed"]),
        (&json!("refused"), &json!("refused")),
        "{output}"
    );
    played.end(&rig).expect(0);
}
