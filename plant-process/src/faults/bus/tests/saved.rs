//! State of a bus in a checkpoint.

use super::{PORT, Passed, Rig, event};

fn rig(networks: u8) -> Rig {
    let (sample, command) = match networks {
        2 => ("link.sample.a", "link.command.b"),
        _ => ("link.sample", "link.command"),
    };
    let chance: &[(&str, f64)] = &[("probability", 0.3)];
    let events = [
        event(1, "message-loss", 3, &[(sample, chance), (command, chance)]),
        event(2, "message-jitter", 5, &[(sample, &[("steps", 9.0)])]),
        event(
            3,
            "message-duplication",
            7,
            &[(sample, &[("probability", 0.5), ("lag_steps", 4.0)])],
        ),
        event(
            4,
            "babble",
            9,
            &[(command, &[("load", 0.5), ("wait_steps", 3.0)])],
        ),
    ];
    Rig::new(PORT, networks, &events)
}

fn run(rig: &mut Rig, steps: u64) -> Vec<Passed> {
    (0..steps)
        .map(|k| rig.send((k * 997 % 8191) as f64, k % 7 != 3))
        .collect()
}

#[test]
fn a_bus_goes_on_from_its_saved_state_bit_by_bit() {
    for networks in [1, 2] {
        for at in [1, 6, 40, 300] {
            let mut first = rig(networks);
            run(&mut first, at);
            let (faults, bus) = (first.layer.save(), first.layer.save_bus());
            let (faults, bus) = (faults.expect("saved"), bus.expect("saved"));
            let mut second = rig(networks);
            second.step = at;
            assert!(second.layer.restore_bus(&bus).expect("its own").is_empty());
            second.layer.restore(faults).expect("its own");
            assert_eq!(
                run(&mut first, 200),
                run(&mut second, 200),
                "{networks}, {at}"
            );
            assert_eq!(first.layer.bus_counts(), second.layer.bus_counts());
            assert_eq!(first.layer.effects(), second.layer.effects());
        }
    }
}

#[test]
fn the_state_of_another_bus_is_refused() {
    let mut one = rig(1);
    run(&mut one, 50);
    let states = one.layer.save_bus().expect("saved");
    assert!(rig(2).layer.restore_bus(&states).is_err());
    assert!(rig(1).layer.restore_bus(&states[..1]).is_err());
}
