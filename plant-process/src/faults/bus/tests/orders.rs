//! Order of a bus among the faults: those of measured signals before it, those on its frames, those of commands after.

use super::{PORT, Rig, event};

#[test]
fn a_sensor_fault_acts_before_the_bus_and_is_rounded_by_it() {
    let bias = event(1, "bias", 0, &[("measured.a_m", &[("bias", 0.3)])]);
    let mut rig = Rig::new(PORT, 1, &[bias]);
    // 1.3 is 5.2 raw numbers.
    assert_eq!(rig.send(1.0, true).a_m, 1.25);
}

#[test]
fn a_command_fault_acts_behind_the_bus_at_every_step() {
    let text = PORT.replace("type = \"f32\"", "type = \"i8\"");
    let bias = event(1, "bias", 1, &[("command.u_n", &[("bias", 0.3)])]);
    let mut rig = Rig::new(&text, 1, &[bias]);
    let applied: Vec<f64> = (0..3)
        .map(|k| rig.send(f64::from(k) + 0.1, true).u_n)
        .collect();
    // The frame of step 0 is held at step 1, and the fault adds to what is held.
    assert_eq!(applied, [0.0, 0.3, 2.3]);
}

#[test]
fn a_link_fault_acts_on_frames_between_both() {
    let bias = event(1, "bias", 0, &[("measured.a_m", &[("bias", 0.3)])]);
    let late = event(2, "message-delay", 0, &[("link.sample", &[("steps", 1.0)])]);
    for events in [[bias.clone(), late.clone()], [late, bias]] {
        let mut rig = Rig::new(PORT, 1, &events);
        rig.send(1.0, true);
        assert_eq!(rig.send(9.0, true).a_m, 1.25);
    }
}
