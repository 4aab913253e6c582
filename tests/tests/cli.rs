//! Bad input: a clear error, exit code 2, and nothing started.

use std::path::PathBuf;

use crate::support::harness::{Rig, Run, names};
use crate::support::programs::{misbehaving_controller, program, workspace};

const SCENARIO: &str = "scenarios/spring-mass.toml";

/// Plant that leaves a mark when it is started for a run, so that tests see whether it was.
struct Marked {
    plant: PathBuf,
    mark: PathBuf,
}

impl Marked {
    fn new(rig: &Rig) -> Self {
        let mark = rig.path("started");
        let text = format!(
            "#!/bin/sh\ncase \"$1\" in --session) touch {} ;; esac\nexec '{}' \"$@\"\n",
            mark.display(),
            program("plant-process").display()
        );
        Self {
            plant: rig.script("marked-plant", &text),
            mark,
        }
    }
}

/// Runs with these arguments and fails unless they are refused before anything happens.
#[track_caller]
fn refuse(rig: &Rig, arguments: &str, fragments: &[&str]) -> Run {
    let marked = Marked::new(rig);
    let plant = marked.plant.display();
    let run = if arguments.contains("--plant-bin") || arguments.contains("in-process") {
        rig.run(arguments)
    } else {
        rig.run(&format!("{arguments} --plant-bin {plant}"))
    };
    println!("hil run {arguments}\n{}", run.stderr);
    let run = run.expect(2).says(fragments);
    assert_eq!(run.stdout, "", "{arguments}");
    assert!(!run.folder.exists(), "{arguments}: a run folder was made");
    assert!(!marked.mark.exists(), "{arguments}: the plant was started");
    run
}

#[test]
fn the_mark_shows_that_a_plant_was_started() {
    let rig = Rig::new();
    let marked = Marked::new(&rig);
    let plant = marked.plant.display();
    let run = rig.run(&format!("{SCENARIO} --plant-bin {plant} --set metrics=[]"));
    run.expect(0);
    assert!(marked.mark.exists());
}

#[test]
fn wrong_values_are_refused() {
    #[rustfmt::skip] // a table
    let cases: [(&str, &[&str]); 19] = [
        ("run.duraton_s=2", &["unknown key `duraton_s`", "`duration_s`"]),
        ("controller.law=lqr", &["unknown law `lqr`", "`pid`", "--controller-bin"]),
        ("controller.law=ftsc", &["`ftsc`", "spring-mass"]),
        ("plant.model=pendulum", &["unknown plant `pendulum`", "`spring-mass`", "--plant-bin"]),
        ("plant.parameters.mass_kg=0", &["mass_kg", "out of range", "in kg"]),
        ("plant.parameters.mass_kg=nan", &["mass_kg", "not a number"]),
        ("plant.parameters.mass_kg=inf", &["mass_kg", "out of range"]),
        ("plant.parameters.mas_kg=1", &["no parameter `mas_kg`", "`mass_kg`"]),
        ("plant.parameters.mass_kg=heavy", &["mass_kg", "is text"]),
        ("controller.pid.proportional_n_per_m=nan", &["proportional_n_per_m", "not a number"]),
        ("run.rate_hz=0", &["run.rate_hz", "0.001", "1e6", "Hz"]),
        ("run.rate_hz=1e9", &["run.rate_hz", "1e6"]),
        ("run.rate_hz=nan", &["run.rate_hz", "not a number"]),
        ("run.duration_s=0", &["run.duration_s"]),
        ("run.duration_s=-1", &["run.duration_s"]),
        ("run.duration_s=nan", &["run.duration_s", "not a number"]),
        ("run.duration_s=2e9", &["steps", "2^40"]),
        ("run.clock=walltime", &["run.clock", "`lockstep`"]),
        ("run.duration_s", &["run.duration_s"]),
    ];
    let rig = Rig::new();
    for (change, fragments) in cases {
        refuse(&rig, &format!("{SCENARIO} --set {change}"), fragments);
    }
}

#[test]
fn invalid_scenario_files_are_refused_with_the_location() {
    let rig = Rig::new();
    let missing = rig.path("missing.toml");
    refuse(
        &rig,
        missing.to_str().expect("plain"),
        &["missing.toml", "No such file"],
    );
    let folder = rig.path("");
    refuse(&rig, folder.to_str().expect("plain"), &["directory"]);
    #[rustfmt::skip] // a table
    let cases: [(&str, &[&str]); 4] = [
        ("schema = 1\nname = \n", &["bad.toml", ":2:", "TOML"]),
        ("schema = 1\nname = \"x\"\ncolour = 3\n", &["bad.toml", ":3:", "unknown key `colour`"]),
        ("schema = 2\nname = \"x\"\n", &["bad.toml", ":1:", "`schema` is 2"]),
        ("", &["bad.toml", "`schema` is missing"]),
    ];
    for (text, fragments) in cases {
        let path = rig.write("bad.toml", text);
        refuse(&rig, path.to_str().expect("plain"), fragments);
    }
}

#[test]
fn all_problems_are_reported_at_once() {
    let rig = Rig::new();
    let changes = "--set run.rate_hz=0 --set plant.parameters.mass_kg=nan --set controller.law=lqr";
    let fragments = ["run.rate_hz", "mass_kg", "unknown law `lqr`"];
    refuse(&rig, &format!("{SCENARIO} {changes}"), &fragments);
}

#[test]
fn wrong_flags_are_refused() {
    let rig = Rig::new();
    refuse(
        &rig,
        &format!("{SCENARIO} --wait-limit 0"),
        &["--wait-limit"],
    );
    refuse(
        &rig,
        &format!("{SCENARIO} --wait-limit nan"),
        &["--wait-limit"],
    );
    refuse(&rig, &format!("{SCENARIO} --pace 0"), &["pace"]);
    refuse(
        &rig,
        &format!("{SCENARIO} --pacee 1"),
        &["--pacee", "--pace"],
    );
    let own = format!("{SCENARIO} --link in-process --controller-bin /bin/true");
    refuse(&rig, &own, &["in-process", "--controller-bin"]);
}

#[test]
fn signals_without_a_source_are_refused_with_the_nearest_name() {
    let rig = Rig::new();
    // The teaching plant's own law needs a reference, and there is no stimulus.
    let path = rig.scenario(1.0, "spring-mass", "pid");
    let fragments = ["reference", "position_m"];
    refuse(&rig, path.to_str().expect("plain"), &fragments);
    // A user's law needs a measured signal that no plant has.
    let path = rig.scenario(1.0, "spring-mass", "moons");
    let controller = misbehaving_controller();
    let arguments = format!(
        "{} --controller-bin {}",
        path.display(),
        controller.display()
    );
    refuse(&rig, &arguments, &["positron_m", "position_m"]);
}

#[test]
fn folders_unsuitable_for_a_run_are_refused() {
    let rig = Rig::new();
    let file = rig.write("file", "in the way");
    let full = rig.path("full");
    std::fs::create_dir(&full).expect("it can be made");
    std::fs::write(full.join("other"), "x").expect("it can be written");
    // Root may write everywhere, but not below a file.
    for (out, fragments) in [
        (full.clone(), ["full", "not empty"]),
        (file.clone(), ["file", "in the way"]),
        (file.join("below"), ["below", "in the way"]),
        ("/proc/run".into(), ["/proc/run", "cannot write"]),
    ] {
        let out = out.to_str().expect("plain");
        let session = rig.session();
        let run = rig.hil(&["run", SCENARIO, "--out", out, "--session", session]);
        run.expect(2).says(&fragments);
    }
    assert_eq!(std::fs::read_dir(&full).expect("it is there").count(), 1);
    assert_eq!(
        std::fs::read_to_string(file).expect("it is there"),
        "in the way"
    );
}

#[test]
fn an_empty_folder_is_accepted() {
    let rig = Rig::new();
    let empty = rig.path("empty");
    std::fs::create_dir(&empty).expect("it can be made");
    let out = empty.to_str().expect("plain");
    rig.hil(&["run", SCENARIO, "--out", out]).expect(0);
    assert!(empty.join("summary.json").exists());
}

#[test]
fn invalid_session_names_are_refused() {
    let rig = Rig::new();
    for name in ["", "Demo", "a/b", "..", "a-name-that-is-far-too-long"] {
        let out = rig.path("out");
        let out = out.to_str().expect("plain");
        let run = rig.hil(&["run", SCENARIO, "--session", name, "--out", out]);
        run.expect(2).says(&["session name", "1 to 24"]);
        assert!(!rig.path("out").exists());
    }
}

#[test]
fn a_session_name_in_use_is_refused_and_its_run_continues() {
    let rig = Rig::new();
    let first = rig.start("scenarios/severe-leakage.toml --set run.duration_s=100");
    let children = first.children();
    let second = rig.start(SCENARIO).finish_beside_another();
    let second = second.expect(2).says(&[rig.session(), "is running"]);
    assert!(!second.folder.exists());
    assert!(children.iter().all(|child| child.is_alive()));
    first.signal(rustix::process::Signal::INT);
    first.finish().expect(130);
}

#[test]
fn foreign_programs_are_refused() {
    let rig = Rig::new();
    let plain = rig.write("plain", "#!/bin/sh\n");
    let babbler = rig.script("babbler", "#!/bin/sh\necho hello; echo who are you >&2\n");
    let described = "{\"protocol\": 999, \"program\": \"x\", \"version\": \"1\"}";
    let stranger = rig.script("stranger", &format!("#!/bin/sh\necho '{described}'\n"));
    let plant = program("plant-process");
    for flag in ["--plant-bin", "--controller-bin"] {
        #[rustfmt::skip] // a table
        let cases = [
            ("/no/such/program".into(), ["/no/such/program", "No such file"]),
            (plain.clone(), ["plain", "not executable"]),
            (rig.path(""), ["cannot run", "it is a folder"]),
            ("/bin/true".into(), ["/bin/true", "does not speak the protocol"]),
            (babbler.clone(), ["does not speak the protocol", "who are you"]),
            (stranger.clone(), ["stranger", "speaks protocol 999"]),
        ];
        for (path, fragments) in cases {
            refuse(
                &rig,
                &format!("{SCENARIO} {flag} {}", path.display()),
                &fragments,
            );
        }
    }
    let swapped = format!("{SCENARIO} --controller-bin {}", plant.display());
    refuse(&rig, &swapped, &["describes no control law"]);
}

#[test]
fn a_program_that_does_not_answer_is_abandoned() {
    let rig = Rig::new();
    // Without `exec`: the shell's child holds the pipes open, too.
    let silent = rig.script("silent", "#!/bin/sh\nsleep 3600\n");
    let arguments = format!("{SCENARIO} --controller-bin {}", silent.display());
    refuse(&rig, &arguments, &["silent", "no answer within"]);
}

#[test]
fn background_processes_of_a_program_are_not_waited_for() {
    let rig = Rig::new();
    let forking = rig.script("forking", "#!/bin/sh\nsleep 3600 &\n");
    let arguments = format!("{SCENARIO} --controller-bin {}", forking.display());
    refuse(&rig, &arguments, &["forking"]);
}

#[test]
fn without_a_given_folder_a_run_creates_its_own() {
    let rig = Rig::new();
    let scenario = workspace().join(SCENARIO);
    let scenario = scenario.to_str().expect("plain");
    let arguments = ["run", scenario, "--session", rig.session()];
    rig.hil_in(&rig.path(""), &arguments).expect(0);
    let runs: Vec<_> = (std::fs::read_dir(rig.path("runs")).expect("runs").flatten()).collect();
    let [run] = &runs[..] else { panic!("{runs:?}") };
    let name = run.file_name().into_string().expect("plain");
    assert!(
        name.starts_with("spring-mass-") && name.ends_with(rig.session()),
        "{name}"
    );
    let expected = [
        "controller.log",
        "plant.log",
        "run.mcap",
        "scenario.toml",
        "summary.json",
    ];
    assert_eq!(names(&run.path()), expected.map(String::from).into());
}

#[test]
fn the_summary_is_available_as_json() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} --json")).expect(0);
    let printed = run.json();
    assert_eq!(printed, run.summary());
    assert_eq!(printed["verdict"], "pass");
}

#[test]
fn config_show_prints_an_equivalent_scenario() {
    let rig = Rig::new();
    let text = rig.hil(&["config", "show", SCENARIO]).expect(0);
    let path = rig.write("shown.toml", &text.stdout);
    let again = rig.run(path.to_str().expect("plain")).expect(0);
    assert_eq!(again.digest(), rig.run(SCENARIO).expect(0).digest());
}

#[test]
fn config_check_has_the_exit_code_of_a_run() {
    let rig = Rig::new();
    rig.hil(&["config", "check", SCENARIO]).expect(0);
    let wrong = rig.hil(&["config", "check", SCENARIO, "--set", "run.rate_hz=0"]);
    wrong.expect(2).says(&["run.rate_hz"]);
}

#[test]
fn the_schema_names_every_plant_and_law() {
    let rig = Rig::new();
    let schema = rig.hil(&["config", "schema"]).expect(0).stdout;
    serde_json::from_str::<serde_json::Value>(&schema).expect("JSON");
    for name in [
        "drhas",
        "spring-mass",
        "ftsc",
        "nrsc",
        "pid",
        "hold",
        "mass_kg",
    ] {
        assert!(schema.contains(&format!("\"{name}\"")), "{name}");
    }
}

#[test]
fn a_program_is_a_path_and_the_hashed_file_is_run() {
    let rig = Rig::new();
    let text = format!(
        "#!/bin/sh\nexec '{}' \"$@\"\n",
        program("plant-process").display()
    );
    let script = rig.script("my-plant", &text);
    let folder = script.parent().expect("it is in a folder");
    let scenario = workspace().join(SCENARIO).display().to_string();
    let arguments = [
        "run",
        &scenario,
        "--plant-bin",
        "my-plant",
        "--out",
        "bare",
        "--json",
    ];
    let summary = rig.hil_in(folder, &arguments).expect(0).json();
    let hash = blake3::hash(text.as_bytes()).to_hex();
    assert_eq!(summary["plant"]["blake3"], hash.as_str());
}

#[test]
fn an_unwritable_output_causes_no_panic() {
    let rig = Rig::new();
    let [hil, plant] =
        ["hil", "plant-process"].map(|name| format!("'{}'", program(name).display()));
    for (line, code) in [
        (format!("exec {hil} config schema >/dev/full"), 3),
        // The doctor's measurements are reported there; its findings are not.
        (
            format!("{hil} doctor --seconds 0.01 2>/dev/full >/dev/null; exec test $? -ne 101"),
            0,
        ),
        // The reader closes the pipe before anything is written.
        (
            format!("{{ {hil} config schema; echo $? >&2; }} | exec true"),
            0,
        ),
        (format!("{plant} --describe | exec true"), 0),
        (format!("exec {plant} --describe >/dev/full"), 3),
    ] {
        let mut shell = rig.command("sh");
        let output = shell
            .args(["-c", &line])
            .output()
            .expect("there is a shell");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{line}: {text}");
        assert!(!text.contains("panicked"), "{line}: {text}");
    }
    drop(rig);
}

#[test]
fn an_endless_file_is_refused_as_a_scenario() {
    let rig = Rig::new();
    let run = rig.hil(&["config", "check", "/dev/zero"]);
    run.expect(2).says(&["not a regular file"]);
}

#[test]
fn a_valid_scenario_has_no_problems_as_json() {
    let rig = Rig::new();
    let scenario = workspace().join(SCENARIO).display().to_string();
    let run = rig.hil(&["config", "check", &scenario, "--json"]).expect(0);
    assert_eq!(run.stdout, "{\"problems\":[]}\n");
}

#[test]
fn lockstep_at_a_pace_is_refused() {
    let rig = Rig::new();
    refuse(
        &rig,
        &format!("{SCENARIO} --clock lockstep --pace 2"),
        &["--clock paced"],
    );
    refuse(&rig, &format!("{SCENARIO} --pace -1"), &["above 0"]);
}

#[test]
fn an_interrupted_query_leaves_no_program_behind() {
    let rig = Rig::new();
    let mark = rig.path("asked");
    let text = format!("#!/bin/sh\necho $$ > {}\nexec sleep 600\n", mark.display());
    let sleeper = rig.script("sleeper", &text);
    let running = rig.start(&format!("{SCENARIO} --plant-bin {}", sleeper.display()));
    crate::support::harness::until("the program is asked", || {
        std::fs::read_to_string(&mark).is_ok_and(|pid| pid.ends_with('\n'))
    });
    running.signal(rustix::process::Signal::INT);
    running.finish().expect(130);
    let pid: u32 = std::fs::read_to_string(&mark)
        .expect("told")
        .trim()
        .parse()
        .expect("a number");
    assert_eq!(hil_session::process::ProcessId::of(pid), None);
}
