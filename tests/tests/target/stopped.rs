//! An agent stopped while a run begins: the wait limit ends the run, and names the agent.

use super::{SHORT, log, no_process_there, run, send, there};
use crate::support::board::Board;
use crate::support::harness::{Rig, until};

use rustix::process::Signal;

#[test]
fn an_agent_stopped_while_querying_a_program_ends_the_run_at_the_wait_limit() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    let request = rig.path("asked");
    let program = rig.script(
        "endless",
        &format!("#!/bin/sh\n: >{}\nexec sleep 1000\n", request.display()),
    );
    let program = program.display();
    let arguments = format!("{SHORT} --target me@board --controller-bin {program} --wait-limit 1");
    let running = rig.start_with(board.hil(), &arguments);
    until("the program is asked", || request.exists());
    let agent = there(&board, "agent");
    send(agent, Signal::STOP);
    let run = running.finish_beside_another().expect(3);
    run.says(&["target me@board: nothing received from its agent for 1 s"]);
    // Its `ssh` has ended it, or it notices the closed connection.
    let _ = std::process::Command::new("kill")
        .args(["-CONT", &agent.to_string()])
        .status();
    no_process_there(&board);
}

#[test]
fn a_slow_agent_with_signs_of_life_is_waited_for() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    let slow = crate::support::programs::program("controller-process");
    let program = rig.script(
        "slow",
        &format!(
            "#!/bin/sh\n[ \"$1\" = --session ] || sleep 3\nexec '{}' \"$@\"\n",
            slow.display()
        ),
    );
    let arguments = format!(
        "{SHORT} --target me@board --controller-bin {} --wait-limit 1.5",
        program.display()
    );
    run(&rig, &board, &arguments).expect(0);
}

#[test]
fn an_agent_stopped_at_any_contact_of_the_start_ends_the_run_at_the_wait_limit() {
    // To check the machine, describe the program, check its job, and run it.
    for contact in 1..=4 {
        let rig = Rig::new();
        let count = rig.write("count", "");
        let count = count.display();
        let board = Board::reached_by(
            &rig,
            &format!(
                "export SSH_CONNECTION='127.0.0.1 1 127.0.0.1 2'\n\
                 echo >>{count}\n\
                 if [ $(wc -l <{count}) = {contact} ]; then\n\
                 (while kill -0 $$; do case $(tr '\\0' ' ' </proc/$$/cmdline) in *hil-target/*' agent '*) kill -STOP $$; exit;; esac; done) </dev/null >/dev/null 2>&1 &\n\
                 fi"
            ),
        );
        let started = rig.start_with(
            board.hil(),
            &format!("{SHORT} --target me@board --wait-limit 1"),
        );
        let run = started.finish_beside_another().expect(3);
        let text = [&run.stderr, &*log(&run)].concat();
        assert!(
            text.contains("target me@board: nothing received"),
            "{contact}: {text}"
        );
        for agent in board.processes("agent") {
            let _ = std::process::Command::new("kill")
                .args(["-CONT", &agent.to_string()])
                .status();
        }
        no_process_there(&board);
    }
}
