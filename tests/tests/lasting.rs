//! Long-lived processes: their resources do not grow with the number of jobs. A descriptor or thread leaked per job
//! would end a process after a thousand jobs, because most systems allow 1,024 open files.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::campaign::{STUDY, planned, study};
use crate::support::company::Companion;
use crate::support::harness::{Rig, ended, text, until};
use crate::support::programs::program;

/// Number of jobs per process, far more than the descriptors that one job opens and closes.
const JOBS: usize = 60;

/// Numbers of descriptors and threads.
type Held = [usize; 2];

/// Counts descriptors and threads of a process; `None` if it has ended.
fn held(pid: u32) -> Option<Held> {
    let count = |what: &str| {
        let entries = std::fs::read_dir(format!("/proc/{pid}/{what}"));
        entries.ok().map(Iterator::count)
    };
    Some([count("fd")?, count("task")?])
}

/// Lists the processes started by a test, and their children.
fn processes(rig: &Rig) -> Vec<u32> {
    let variable = format!("{}={}", hil_session::session::GROUP, rig.session());
    let entries = std::fs::read_dir("/proc").expect("/proc").flatten();
    let numbers = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    let is_of_test = |pid: &u32| {
        let environment = std::fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
        let mut variables = environment.split(|byte| *byte == 0);
        variables.any(|other| other == variable.as_bytes())
    };
    numbers.filter(is_of_test).collect()
}

/// Runs a command to its end. Fails if one of its processes that lived throughout, of which there must be some,
/// held more in the last quarter of the time than before.
#[track_caller]
fn assert_no_growth(rig: &Rig, mut command: Command, processes_at_least: usize) {
    command.stdin(Stdio::null());
    command.stdout(Stdio::null()).stderr(Stdio::null());
    let mut process = Companion::start(&mut command);
    let mut samples: Vec<BTreeMap<u32, Held>> = Vec::new();
    until("all jobs are done", || {
        let all = processes(rig).into_iter();
        samples.push(all.filter_map(|pid| Some((pid, held(pid)?))).collect());
        process.try_wait().expect("our child").is_some()
    });
    assert!(ended(&mut process).success(), "{command:?}");
    samples.retain(|sample| sample.len() >= processes_at_least);
    let quarter = samples.len() / 4;
    assert!(quarter > 5, "{} samples are too few", samples.len());
    let (early, late) = (&samples[..quarter], &samples[samples.len() - quarter..]);
    let mut lasting = 0;
    for pid in early[0].keys() {
        let of = |part: &[BTreeMap<u32, Held>]| -> Option<Vec<Held>> {
            part.iter().map(|sample| sample.get(pid).copied()).collect()
        };
        let (Some(early), Some(late)) = (of(early), of(late)) else {
            continue; // did not live throughout
        };
        lasting += 1;
        for (place, what) in ["descriptors", "threads"].into_iter().enumerate() {
            let most = early.iter().map(|held| held[place]).max();
            let least = late.iter().map(|held| held[place]).min();
            assert!(least <= most, "{what} of {pid}: {most:?}, then {least:?}");
        }
    }
    assert!(lasting >= processes_at_least, "{lasting} processes lasted");
}

#[test]
fn hundreds_of_runs_in_one_command_do_not_leak() {
    let rig = Rig::new();
    let scenario = rig.scenario(0.1, "spring-mass", "hold");
    for (link, jobs) in [("iceoryx2", JOBS), ("in-process", 4 * JOBS)] {
        let mut runs = rig.command(program("hil"));
        runs.arg("run").arg(&scenario);
        runs.args(["--repeat", &jobs.to_string(), "--jobs", "1"]);
        runs.args(["--link", link, "--session", rig.session()]);
        runs.arg("--out").arg(rig.path(link));
        assert_no_growth(&rig, runs, 1);
    }
    rig.assert_nothing_left();
}

#[test]
fn a_campaign_worker_does_not_leak() {
    let rig = Rig::new();
    let cases = STUDY.replace("cases = 30", "cases = 300");
    let folder = planned(&rig, &study(&rig, &cases), "many");
    let mut campaign = rig.command(program("hil"));
    campaign.args(["campaign", "run", text(&folder), "--jobs", "1"]);
    // The command and its worker.
    assert_no_growth(&rig, campaign, 2);
    rig.assert_nothing_left();
}

/// Waits until a process holds no more than before.
#[track_caller]
fn until_it_holds(process: &Companion, before: Held) {
    until("it has let go of its visitors", || {
        let now = held(process.id()).expect("it serves");
        now.iter().zip(before).all(|(now, before)| *now <= before)
    });
}

#[test]
fn a_panel_releases_the_resources_of_closed_pages() {
    let rig = Rig::new();
    let run = rig.held();
    let mut panel = rig.command(program("hil"));
    panel.args(["panel", "--json", "--no-open", "--session", rig.session()]);
    let mut panel = Companion::start(panel.stdin(Stdio::null()).stdout(Stdio::piped()));
    let mut line = String::new();
    let mut stdout = BufReader::new(panel.stdout.take().expect("piped"));
    stdout.read_line(&mut line).expect("a line");
    let line: Value = serde_json::from_str(&line).expect("JSON");
    let url = line["url"].as_str().expect("an address");
    let (host, path) = url["http://".len()..].split_once('/').expect("a path");
    let visit = || {
        let mut page = TcpStream::connect(host).expect("it listens");
        let request = format!("GET /{path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        page.write_all(request.as_bytes()).expect("it reads");
        let mut answer = Vec::new();
        page.read_to_end(&mut answer).expect("it answers");
        assert!(answer.starts_with(b"HTTP/1.1 "), "an answer");
    };
    visit();
    let before = held(panel.id()).expect("it serves");
    for _ in 0..JOBS {
        visit();
        // Another client that sends nothing.
        drop(TcpStream::connect(host).expect("it listens"));
    }
    until_it_holds(&panel, before);
    rig.in_session("resume").expect(0);
    run.finish_beside_another().expect(0);
}

#[test]
fn a_listening_board_releases_the_resources_of_disconnected_desks() {
    let rig = Rig::new();
    let key = rig.path("board.key");
    let key = text(&key);
    rig.hil(&["target", "key", key]).expect(0);
    let mut serve = rig.command(program("hil"));
    serve.args(["target", "serve", "--listen", "127.0.0.1:0"]);
    serve.args(["--key-file", key, "--allow"]);
    serve.arg(program("controller-process"));
    let mut serve = Companion::start(serve.stdin(Stdio::null()).stderr(Stdio::piped()));
    let mut lines = BufReader::new(serve.stderr.take().expect("piped"));
    let mut line = String::new();
    lines.read_line(&mut line).expect("a line");
    let address = line.trim_end().strip_prefix("listening on ");
    let address = address.expect("an address").to_owned();
    // Keeps reading, so that the board can always send.
    let reader = std::thread::spawn(move || std::io::copy(&mut lines, &mut std::io::sink()));
    let target = format!("serve://{address}");
    let check = || rig.beside(&["target", "check", &target, "--key-file", key]);
    check().expect(0);
    let before = held(serve.id()).expect("it serves");
    for _ in 0..JOBS {
        drop(TcpStream::connect(&address).expect("it listens"));
    }
    for _ in 0..JOBS / 6 {
        check().expect(0);
    }
    until_it_holds(&serve, before);
    drop(serve);
    let _ = reader.join().expect("it reads to the end");
}
