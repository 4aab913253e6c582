//! Campaigns whose scenario has a port file: as a bus with a DBC file, and as the controller.

use super::scenario;
use crate::support::harness::Rig;
use crate::support::programs::shipped;

/// Study of three masses.
const STUDY: &str = r#"
schema = 1
name = "masses"
scenario = "SCENARIO"
cases = 3
seed = 3

[[vary]]
key = "plant.parameters.mass_kg"
kind = "uniform"
min = 0.5
max = 2.0
"#;

/// Frame of the reference as a DBC file describes it.
const DBC: &str = r#"VERSION ""

NS_ :

BS_:

BU_: Rig Board

BO_ 258 Target: 8 Rig
 SG_ Position : 0|64@1- (1,0) [0|0] "m" Board

SIG_VALTYPE_ 258 Position : 2;
"#;

#[test]
fn a_campaign_has_copies_of_the_dbc_files_of_its_bus() {
    let rig = Rig::new();
    let bus = shipped("examples/ports/spring-mass.port.toml");
    let (head, rest) = bus.split_once("id = 0x102\n").expect("the target");
    let (_, tail) = rest.split_once("\n\n").expect("a frame behind it");
    let target = "dbc = \"frames/target.dbc\"\nmessage = \"Target\"\nfields = [{ signal = \"reference.position_m\", dbc_signal = \"Position\" }]";
    std::fs::create_dir_all(rig.path("wires/frames")).expect("a folder");
    rig.write(
        "wires/spring-mass.port.toml",
        &format!("{head}{target}\n\n{tail}"),
    );
    rig.write("wires/frames/target.dbc", DBC);
    let text = shipped("examples/ports/spring-mass.toml");
    let (text, _) = text.split_once("[[requirements]]").expect("a requirement");
    rig.write("bus.toml", &text.replace("file = \"", "file = \"wires/"));
    rig.write("study.toml", &STUDY.replace("SCENARIO", "bus.toml"));
    let hil = |line: &[&str]| rig.hil_in(&rig.path(""), line);
    hil(&["campaign", "plan", "study.toml", "-o", "planned"]).expect(0);
    // The folder of a campaign needs nothing outside of it.
    std::fs::remove_dir_all(rig.path("wires")).expect("removed");
    hil(&["campaign", "run", "planned", "--jobs", "2"]).expect(0);
}

#[test]
fn a_campaign_with_a_port_as_controller_runs_one_case_after_another() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["20", "0.5", "1000000"]) else {
        return;
    };
    rig.write("study.toml", &STUDY.replace("SCENARIO", "wire.toml"));
    let hil = |line: &[&str]| rig.hil_in(&rig.path(""), line);
    hil(&["campaign", "plan", "study.toml", "-o", "planned"]).expect(0);
    hil(&["campaign", "run", "planned", "--jobs", "2"])
        .expect(2)
        .says(&["2 cases at once would use the same wire; use --jobs 1"]);
    // The folder of the campaign has what the port starts.
    std::fs::remove_file(rig.path("peer.py")).expect("removed");
    std::fs::remove_file(rig.path("bench.port.toml")).expect("removed");
    hil(&["campaign", "run", "planned", "--jobs", "1"]).expect(0);
    rig.assert_nothing_left();
}

#[test]
fn a_far_end_with_a_clock_of_its_own_has_no_campaign() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["20", "0.5", "1000000"]) else {
        return;
    };
    let path = rig.path("bench.port.toml");
    let text = std::fs::read_to_string(&path).expect("it was written");
    let text = text.replace("ready = ", "exchange = \"free\"\nready = ");
    rig.write("bench.port.toml", &text);
    rig.write("study.toml", &STUDY.replace("SCENARIO", "wire.toml"));
    let line = ["campaign", "plan", "study.toml", "-o", "planned"];
    rig.hil_in(&rig.path(""), &line)
        .expect(2)
        .says(&["a campaign needs cases that can be repeated"]);
}
