//! Classes that are declared wrongly: each is refused with its row before anything starts.

use super::{SPRING_MASS, has_python, side};
use crate::support::harness::Rig;

/// Changes of the example's text, and what `hil describe` says.
const WRONG: &[(&str, &str, &str)] = &[
    (
        "    mass_kg: float = hil.parameter(1.0, unit=\"kg\", min=1e-6, max=1e9, tunable=True, doc=\"Mass m.\")\n",
        "    mass_kg: float = 1.0\n",
        "`mass_kg` of `Parameters` has no unit and no description; write `mass_kg: float = hil.parameter(unit=.., doc=..)`",
    ),
    (
        "unit=\"kg\", min=1e-6",
        "unit=\"\", min=1e-6",
        "`mass_kg` has no unit; a dimensionless number has the unit `1`",
    ),
    (
        "hil.parameter(1.0, unit=\"kg\", min=1e-6, max=1e9",
        "hil.parameter(1.0, unit=\"kg\", min=3.0, max=1e9",
        "`mass_kg` has the default 1, outside 3 to 1000000000",
    ),
    (
        "mass_kg: float = hil.parameter(1.0",
        "mass_kg: int = hil.parameter(1",
        "`mass_kg` of `Parameters` is annotated with int; every column is a float",
    ),
    (
        "hil.parameter(1.0, unit=\"kg\"",
        "hil.parameter(True, unit=\"kg\"",
        "the default of `mass_kg` of `Parameters` is True; it must be a number",
    ),
    (
        "energy_j: float = hil.signal(",
        "energy_j: float = hil.parameter(1.0, ",
        "`energy_j` of `Truth` is declared with hil.parameter; use hil.signal in this table",
    ),
    (
        "@dataclass\nclass Truth",
        "class Truth",
        "`truth` of `SpringMass` is `Truth`, which is no dataclass; write @dataclass above it",
    ),
    (
        "def measure(self)",
        "def mesure(self)",
        "`SpringMass` lacks `measure(self)`; nearest: mesure",
    ),
    (
        "def truth(self, time_s: float, command: Command) -> Truth:",
        "def truth(self, time_s: float) -> Truth:",
        "`truth` of `SpringMass` must be `truth(self, time_s, command)`",
    ),
    (
        "        return Motion(self.position_m",
        "        yield Motion(self.position_m",
        "`measure` of `SpringMass` is a generator, because it contains `yield`; it must be an ordinary method",
    ),
    (
        "    def measure(self)",
        "    async def measure(self)",
        "`measure` of `SpringMass` is async; it must be an ordinary method",
    ),
    (
        "    \"\"\"A mass on a spring with a damper, pushed by a commanded force.\"\"\"\n",
        "",
        "`SpringMass` has no docstring; its first sentence is the summary of the plant",
    ),
    (
        "@hil.plant(\n    parameters=Parameters, truth=Truth, measured=Motion, command=Command, state=Motion, faults=[STIFFNESS_LOSS, PUSH]\n)\n",
        "",
        "side.py has no class that is marked with @hil.plant; it has the law `pid`",
    ),
    (
        "    parameters=Parameters, truth=Truth",
        "    parameter=Parameters, truth=Truth",
        "unexpected keyword argument 'parameter'",
    ),
    (
        "moves={\"disturbance_n\"",
        "moves={\"mass_kg\"",
        "the fault `push` of `SpringMass` moves `mass_kg`; the parameters that are faultable are: stiffness_n_per_m, disturbance_n",
    ),
    (
        "(\"scale\", \"factor\")",
        "(\"scale\", \"share\")",
        "the fault `stiffness-loss` of `SpringMass` moves `stiffness_n_per_m` by `share`; the sizes are: factor",
    ),
    (
        "import math\n",
        "import maths\n",
        "No module named 'maths' (side.py line 8, in <module>)",
    ),
    ("import math\n", "import math)\n", "SyntaxError"),
    (
        "@dataclass\nclass Parameters",
        "raise SystemExit(0)\n\n\n@dataclass\nclass Parameters",
        "the file ended its process with exit code 0",
    ),
];

#[test]
fn a_class_that_is_declared_wrongly_is_refused_with_its_row() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    for (from, to, expected) in WRONG {
        let file = side(&rig, from, to).display().to_string();
        let run = rig.hil(&["describe", &file]).expect(2);
        assert!(run.stderr.contains(expected), "{to}\n{}", run.stderr);
        assert!(run.stdout.is_empty(), "{to}\n{}", run.stdout);
    }
    let file = side(&rig, "plants=[\"spring-mass\"]", "plants=[\"spring-mass\"]");
    let file = file.display().to_string();
    rig.hil(&["describe", &file]).expect(0);
    rig.assert_nothing_left();
}

#[test]
fn a_law_needs_a_sentence_on_its_tuning() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let sentence =
        "        \"\"\"The new gains act from the next sample on; the integral stays.\"\"\"\n";
    let file = side(&rig, sentence, "").display().to_string();
    let run = rig
        .hil(&["describe", &file, "--as", "controller"])
        .expect(2);
    let expected = "`retune` of `Pid` has no docstring; its first sentence tells users what the command does when a parameter changes";
    assert!(run.stderr.contains(expected), "{}", run.stderr);
}

#[test]
fn a_description_shows_tables_modules_and_the_interpreter() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    rig.write("gravity.py", "__version__ = \"1.2\"\nG = 9.81\n");
    let file = side(
        &rig,
        "import math\n",
        "import math\n\nprint(\"loud\")\nimport gravity\n",
    );
    let file = file.display().to_string();
    let run = rig.hil(&["describe", &file, "--json"]).expect(0);
    let described = run.json();
    let description = &described["description"];
    assert_eq!(description["plants"][0]["name"], "spring-mass");
    let format = description["imported"]["format"].as_str().expect("text");
    assert!(format.starts_with("Python 3."), "{format}");
    let modules = description["imported"]["modules"]
        .as_array()
        .expect("modules");
    let module = |name: &str| modules.iter().find(|module| module["name"] == name);
    let gravity = module("gravity").expect("recorded");
    assert_eq!(gravity["version"], "1.2");
    let hash = hil_session::file::hash(&rig.path("gravity.py")).expect("read");
    assert_eq!(gravity["blake3"].as_str(), Some(&*hash));
    assert!(module("hil").is_some(), "{modules:?}");
    assert!(module("math").is_none() && module("dataclasses").is_none());
    let text = rig.hil(&["describe", &file]).expect(0).stdout;
    for expected in [
        "stiffness_n_per_m",
        "imported modules:",
        "  gravity 1.2 ",
        "kinds of faults",
    ] {
        assert!(text.contains(expected), "{expected}\n{text}");
    }
    // The recording keeps the description, with both hashes.
    let run = rig
        .run(&format!("scenarios/spring-mass.toml --plant-bin {file}"))
        .expect(0);
    let summary = run.summary();
    let own = hil_session::file::hash(&rig.path("side.py")).expect("read");
    assert_eq!(summary["plant"]["blake3"].as_str(), Some(&*own));
    assert!(summary["plant"]["host_blake3"].is_string(), "{summary}");
}

#[test]
fn a_file_that_others_can_write_is_not_run() {
    use std::os::unix::fs::PermissionsExt;

    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let file = side(&rig, "import hil\n", "import hil\n");
    let scenario = crate::support::programs::shipped("examples/python-plant/spring-mass.toml");
    let scenario = rig.write("own.toml", &scenario.replace("spring_mass.py", "side.py"));
    rig.run(&scenario.display().to_string()).expect(0);
    let mode = std::fs::Permissions::from_mode(0o666);
    std::fs::set_permissions(&file, mode).expect("ours");
    let run = rig.run(&scenario.display().to_string()).expect(2);
    assert!(
        run.stderr.contains("can be written by others"),
        "{}",
        run.stderr
    );
}

#[test]
fn an_interpreter_that_cannot_be_used_is_named() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let describe = |set: &dyn Fn(&mut std::process::Command)| {
        let mut hil = rig.command(crate::support::programs::program("hil"));
        hil.args(["describe", SPRING_MASS]);
        set(&mut hil);
        rig.program(hil)
    };
    let run = describe(&|hil| {
        hil.env("HIL_PYTHON", "/nowhere/python3");
    });
    let run = run.expect(2);
    assert!(run.stderr.contains("/nowhere/python3"), "{}", run.stderr);
    let run = describe(&|hil| {
        hil.env_remove("HIL_PYTHON").env("PATH", "/nowhere");
    });
    let run = run.expect(2);
    let expected = "HIL_PYTHON is not set, and there is no python3 in PATH (/nowhere)";
    assert!(run.stderr.contains(expected), "{}", run.stderr);
    // No interpreter at all.
    let run = describe(&|hil| {
        hil.env("HIL_PYTHON", "/bin/true");
    });
    let run = run.expect(2);
    assert!(
        run.stderr.contains("it ended without a description"),
        "{}",
        run.stderr
    );
}
