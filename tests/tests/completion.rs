//! Completions in the real shells: candidates from a session, a scenario and the folder, and no side effects.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use crate::support::harness::Rig;
use crate::support::programs::{
    misbehaving_controller, path_from, program, skip, works, workspace,
};
use crate::support::terminal::Terminal;

/// Typed lines with their completions or candidates. Other tests have sessions too.
fn lines(rig: &Rig) -> Vec<(String, String)> {
    let session = rig.session();
    #[rustfmt::skip] // a table
    let lines = [
        (format!("hil pause --session {}", &session[..session.len() - 1]), session),
        (format!("hil inject --session {session} bia"), "bias"),
        (format!("hil inject --session {session} bias measured.pos"), "measured.position_m"),
        (format!("hil inject --session {session} bias measured.position_m --bi"), "--bias"),
        (format!("hil get --session {session} truth.pos"), "truth.position_m"),
        (format!("hil watch --session {session} tracking_err"), "tracking_error_m"),
        (format!("hil set --session {session} controller.pid.prop"), "controller.pid.proportional_n_per_m="),
        (format!("hil set --session {session} plant.parameters.stif"), "plant.parameters.stiffness_n_per_m="),
        (format!("hil set --session {session} --clear ref"), "reference.position_m"),
        ("hil run pla".into(), "plain.toml"),
        ("hil run my".into(), "my own.toml"),
        ("hil run 'my".into(), "my own.toml"),
        ("hil run plain.toml --set controller.pid.prop".into(), "controller.pid.proportional_n_per_m="),
        ("hil run plain.toml --set controller.law=ho".into(), "controller.law=hold"),
        ("hil report lat".into(), "latest"),
        ("hil export runs/fir".into(), "runs/first"),
    ];
    lines.map(|(line, expected)| (line, expected.into())).into()
}

/// Creates a folder with a scenario and a run of it.
fn desk(rig: &Rig) -> PathBuf {
    let desk = rig.path("desk");
    std::fs::create_dir(&desk).expect("a folder");
    let scenario = workspace().join("scenarios/spring-mass.toml");
    for name in ["plain.toml", "my own.toml"] {
        std::fs::copy(&scenario, desk.join(name)).expect("copied");
    }
    let run = ["run", "plain.toml", "--out", "runs/first"];
    rig.hil_in(&desk, &run).expect(0);
    desk
}

/// Returns the path on which `hil` is found.
fn path() -> OsString {
    path_from(program("hil").parent().expect("a folder"))
}

/// Types lines into a shell on a terminal and presses Tab.
fn typed(rig: &Rig, desk: &Path, shell: &[&str], setup: &str) {
    let mut command = rig.command("setsid");
    command.arg("--ctty").args(shell).current_dir(desk);
    command.env("PS1", "ready> ").env("PATH", path());
    command
        .env("HOME", desk)
        .env_remove("EDITOR")
        .env_remove("VISUAL");
    let mut terminal = Terminal::start(command, (150, 50));
    terminal.until_it_shows("ready> ");
    terminal.press(&format!("{setup}; echo set up\n"));
    terminal.until_it_shows("\nset up");
    for (line, expected) in lines(rig) {
        // An empty line on an empty screen.
        terminal.press("\u{15}\u{c}");
        terminal.press(&line);
        terminal.until_it_shows(&line);
        terminal.press("\t\t");
        let quoted = expected.replace(' ', "\\ ");
        let is_open = line.contains('\'');
        terminal.until_it_shows(if is_open { &expected } else { &quoted });
        let text = terminal.text();
        assert!(!text.contains("error:"), "{line}: {text}");
    }
}

/// Checks a shell's candidates during a paused session, if that shell is installed.
fn offered_by(shell: &str, check: impl FnOnce(&Rig, &Path)) {
    if !works(&[shell, "-c", "exit 0"]) {
        return skip(&format!("{shell} is not here"), "HIL_TEST_SHELLS");
    }
    let rig = Rig::new();
    let desk = desk(&rig);
    let running = rig.held();
    check(&rig, &desk);
    rig.in_session("resume").expect(0);
    running.finish().expect(0);
}

#[test]
fn bash_offers_the_available_candidates() {
    let bash = ["bash", "--norc", "--noprofile", "-i"];
    let setup = "source <(hil completions bash)";
    offered_by("bash", |rig, desk| typed(rig, desk, &bash, setup));
}

#[test]
fn zsh_offers_the_available_candidates() {
    let zsh = ["zsh", "-f", "-i"];
    let setup = "bindkey -e; autoload -U compinit; compinit -u -D; source <(hil completions zsh)";
    offered_by("zsh", |rig, desk| typed(rig, desk, &zsh, setup));
}

#[test]
fn fish_offers_the_available_candidates() {
    offered_by("fish", fish_offers);
}

fn fish_offers(rig: &Rig, desk: &Path) {
    for (line, expected) in lines(rig) {
        let mut fish = rig.command("fish");
        fish.args(["--no-config", "-c"]).current_dir(desk);
        fish.arg("hil completions fish | source; complete --do-complete $argv[1]");
        fish.arg(&line);
        let output = fish.env("PATH", path()).env("HOME", desk).output();
        let output = output.expect("fish");
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(text, "", "{line}");
        let offered = String::from_utf8_lossy(&output.stdout);
        let values = offered.lines().filter_map(|line| line.split('\t').next());
        let values: Vec<&str> = values.collect();
        assert!(
            values
                .iter()
                .any(|value| value.trim_end_matches('/') == expected),
            "{line}: {offered}"
        );
    }
}

/// Sends a request like the script of `bash`.
fn asked(rig: &Rig, desk: &Path, line: &str) -> String {
    let mut hil = rig.command(program("hil"));
    hil.env("HIL_COMPLETE", "bash");
    hil.env("HIL_COMPLETE_BREAKS", "=:");
    hil.args(["--", "hil", line]).current_dir(desk);
    hil.stdin(Stdio::null());
    let output = hil.output().expect("it can be run");
    assert!(output.status.success(), "{line}");
    assert_eq!(String::from_utf8_lossy(&output.stderr), "", "{line}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn a_request_prints_only_candidates_and_leaves_nothing() {
    let rig = Rig::new();
    let desk = desk(&rig);
    std::fs::write(desk.join("broken.toml"), "schema = [").expect("written");
    let before = listed(&desk);
    for (line, expected) in [
        ("hil run none.toml --set run.", ""),
        ("hil run broken.toml --set run.", ""),
        ("hil run 'open", ""),
        ("hil run my", "my\\ own.toml\n"),
        ("hil run \"my o", "my own.toml\n"),
        ("hil run my' o", " own.toml\n"),
        (
            "hil run plain.toml --set 'controller.law=pi",
            "controller.law=pid\n",
        ),
        ("other run ", ""),
        ("hil run plain.toml --set run.see", "run.seed=\n"),
        ("A=b hil run plain.toml --set=run.see", "run.seed=\n"),
        // Only the text after the last word-breaking character.
        ("hil run plain.toml --set controller.law=pi", "pid\n"),
        ("hil run plain.toml --set run.clock=lo", "lockstep\n"),
        ("hil controller swap --session none --set controller.", ""),
        ("hil judge latest --js", "--json\n"),
        ("hil export latest --signal truth.pos", "truth.position_m\n"),
        ("hil pause --session no-such", ""),
    ] {
        assert_eq!(asked(&rig, &desk, line), expected, "{line}");
    }
    assert_eq!(listed(&desk), before);
    rig.assert_nothing_left();
    // Without a session the built-in plants are used.
    let kinds = asked(&rig, &desk, "hil inject ");
    assert!(kinds.lines().any(|kind| kind == "leakage"), "{kinds}");
    let keys = asked(&rig, &desk, "hil inject leakage --coe");
    assert_eq!(keys, "--coefficient_m3ps_per_sqrt_pa\n");
}

/// Lists all files and folders below a folder.
fn listed(folder: &Path) -> Vec<PathBuf> {
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        entries.push(entry.path());
        if entry.path().is_dir() {
            entries.extend(listed(&entry.path()));
        }
    }
    entries.sort();
    entries
}

#[test]
fn completion_queries_a_user_program_for_its_keys() {
    let rig = Rig::new();
    let desk = desk(&rig);
    let program = misbehaving_controller();
    let line = format!(
        "hil run plain.toml --controller-bin '{}' --set controller.law=pan",
        program.display()
    );
    // The scenario has gains of a law that the program lacks: nothing is offered.
    assert_eq!(asked(&rig, &desk, &line), "");
    let text = std::fs::read_to_string(desk.join("plain.toml")).expect("text");
    let (before, after) = text.split_once("[controller]").expect("a controller");
    let after = after.split_once("[[stimuli]]").expect("stimuli").1;
    let text = format!("{before}[controller]\nlaw = \"babbles\"\n[[stimuli]]{after}");
    std::fs::write(desk.join("plain.toml"), text).expect("written");
    assert_eq!(asked(&rig, &desk, &line), "panics\n");
}
