//! Projects of `hil new --lang python`, and campaigns with sides in Python.

use super::{SPRING_MASS, has_python};
use crate::support::harness::{Rig, names};
use crate::support::programs::{path_from, program, shipped, target, workspace};
use crate::support::python::{python, succeeds};

#[test]
fn new_projects_pass_their_tests_and_their_scenarios() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    for (what, name) in [("plant", "cart"), ("controller", "my-law")] {
        let words = ["new", what, name, "--lang", "python"];
        let created = rig.hil_in(&rig.path(""), &words).expect(0);
        assert!(
            created.stdout.contains("python3 -m unittest"),
            "{}",
            created.stdout
        );
        let folder = rig.path(name);
        let (file, test) = (format!("{what}.py"), format!("test_{what}.py"));
        let expected = [
            ".gitignore",
            "README.md",
            &format!("{name}.toml"),
            &file,
            &test,
        ];
        assert_eq!(names(&folder), expected.map(String::from).into());
        for file in expected {
            let text = std::fs::read_to_string(folder.join(file)).expect("text");
            assert!(
                !text.contains('@') || !text.contains("@NAME@") && !text.contains("@CLONE@"),
                "{file}:\n{text}"
            );
        }
        let hil = program("hil");
        let mut unittest = rig.command("python3");
        unittest
            .args(["-m", "unittest"])
            .current_dir(&folder)
            .env("PYTHONPATH", workspace().join("tools/python"))
            .env("PATH", path_from(hil.parent().expect("a folder")));
        succeeds(&mut unittest);
        let scenario = format!("{name}.toml");
        rig.hil_in(&folder, &["run", &scenario, "--out", "runs/a"])
            .expect(0);
        let weak = match what {
            "plant" => "plant.parameters.initial_velocity_mps=0.2",
            _ => "controller.my-law.integral_n_per_m_s=0",
        };
        rig.hil_in(
            &folder,
            &["run", &scenario, "--out", "runs/b", "--set", weak],
        )
        .expect(1);
    }
    rig.assert_nothing_left();
}

#[test]
fn a_campaign_runs_sides_in_python_from_its_own_copies() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let scenario = shipped("scenarios/spring-mass.toml");
    let named = scenario
        .replace("[plant]\n", "[plant]\nprogram = \"side.py\"\n")
        .replace("[controller]\n", "[controller]\nprogram = \"side.py\"\n");
    rig.write("side.py", &shipped(SPRING_MASS));
    rig.write("python.toml", &named);
    rig.write("rust.toml", &scenario);
    let mut figures = Vec::new();
    for name in ["rust", "python"] {
        let study = format!(
            "schema = 1\nname = \"{name}\"\nscenario = \"{name}.toml\"\ncases = 3\n\
             [[vary]]\nname = \"mass\"\nkey = \"plant.parameters.mass_kg\"\nkind = \"uniform\"\nmin = 0.8\nmax = 1.2\n"
        );
        rig.write("study.toml", &study);
        let folder = rig.path(name).display().to_string();
        let study = rig.path("study.toml").display().to_string();
        rig.hil(&["campaign", "plan", &study, "-o", &folder])
            .expect(0);
        // The file is the one that was planned.
        rig.write("side.py", "raise SystemExit\n");
        rig.hil(&["campaign", "run", &folder]).expect(0);
        let results = rig
            .hil(&["campaign", "show", &folder, "--json"])
            .expect(0)
            .json();
        figures.push(results["variants"].clone());
        rig.write("side.py", &shipped(SPRING_MASS));
    }
    assert!(!figures[0].is_null());
    assert_eq!(figures[0], figures[1]);
}

#[test]
fn the_example_and_the_new_projects_pass_mypy() {
    let Some(python) = python("mypy, mcap, numpy, polars") else {
        let why = "python3 with mypy, mcap, numpy and polars is missing";
        return crate::support::programs::skip(why, "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    for (what, name) in [("plant", "cart"), ("controller", "steer")] {
        let words = ["new", what, name, "--lang", "python"];
        rig.hil_in(&rig.path(""), &words).expect(0);
    }
    let files = [
        workspace().join(SPRING_MASS),
        rig.path("cart/plant.py"),
        rig.path("cart/test_plant.py"),
        rig.path("steer/controller.py"),
        rig.path("steer/test_controller.py"),
    ];
    for file in files {
        let mut mypy = rig.command(&python);
        mypy.args(["-m", "mypy", "--strict", "--cache-dir"])
            .arg(target().join("mypy/projects"))
            // The package has a test of its own.
            .args(["--follow-imports", "silent"])
            .arg(&file)
            .current_dir(file.parent().expect("a folder"))
            .env("MYPYPATH", workspace().join("tools/python"));
        succeeds(&mut mypy);
    }
}
