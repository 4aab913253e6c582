use std::path::Path;

use shared_types::record::{Outcome, RunEnd};

use super::*;
use crate::fixture::{Content, Folder, layout, record, recorded};
use crate::replay::original::AnswerPlace;

/// Words of a small run's record, in the order of its layout.
const SAMPLE_INVALID: usize = 1;
const COMMAND_INVALID: usize = 2;
const MEASURED: usize = 4;
const COMMAND: usize = 5;
const TIMING: usize = 9;
const EPOCH: usize = TIMING + 1;
const SAMPLE_AGE: usize = TIMING + 2;
const HELD: usize = TIMING + 9;
const ANSWERED: usize = TIMING + 10;
const DIRECTIVE: usize = TIMING + 13;

fn places() -> Places {
    Places {
        sample_invalid: vec![SAMPLE_INVALID],
        answer_invalid: vec![COMMAND_INVALID],
        sample: vec![MEASURED],
        answer: vec![AnswerPlace {
            name: "command.u_n".into(),
            unit: "N".into(),
            word: COMMAND,
            bit: Some(0),
        }],
        sample_age_steps: Some(SAMPLE_AGE),
        held_steps: Some(HELD),
        answered: Some(ANSWERED),
        directive: Some(DIRECTIVE),
        epoch: Some(EPOCH),
    }
}

/// Sample as read from the tape.
#[derive(Debug, PartialEq)]
struct Played {
    head: Head,
    sample: f64,
    answer: Option<f64>,
}

fn played(
    run: &Path,
    steps: u64,
    places: Places,
    clock: Clock,
) -> (Vec<Played>, Result<Length, TapeError>) {
    let reader = RunReader::open(run).expect("opens");
    let mut tape = Tape::start(reader, places, steps, clock);
    let (mut rows, mut batch) = (Vec::new(), None);
    while let Some(next) = tape.batches.exchange(batch.take()) {
        for index in 0..next.len() {
            let row = next.row(index);
            rows.push(Played {
                head: *row.head,
                sample: row.sample[0],
                answer: row.head.is_answered.then_some(row.answer[0]),
            });
        }
        batch = Some(next);
    }
    let length = tape.reader.join().expect("no panic");
    (rows, length)
}

/// Records a run in which record `k` has the measured value `k` and the command `-k`, modified by `change`.
fn run(steps: u64, change: impl Fn(u64, &mut Vec<u64>)) -> Folder {
    let contents: Vec<Content> = (0..steps)
        .map(|step| {
            let mut words = record(step, step as f64, -(step as f64));
            change(step, &mut words);
            Content::Record(words)
        })
        .collect();
    recorded(&layout(), &contents, vec![])
}

fn whole(steps: u64) -> Length {
    Length {
        steps,
        is_whole: true,
    }
}

#[test]
fn in_lockstep_each_sample_comes_with_its_own_answer() {
    let directive = Directive {
        busy_ns: 500,
        late_steps: 2,
        unseen: false,
    };
    let run = run(4, |step, words| {
        if step == 2 {
            (words[SAMPLE_INVALID], words[COMMAND_INVALID]) = (1, 2);
            words[SAMPLE_AGE] = 7;
            words[DIRECTIVE] = directive.to_wire();
        }
    });
    // The fourth record holds the truth after the last step.
    let (rows, length) = played(&run, 3, places(), Clock::Lockstep);
    assert_eq!(length.expect("read"), whole(3));
    let values: Vec<_> = rows
        .iter()
        .map(|row| (row.head.step, row.sample, row.answer))
        .collect();
    assert_eq!(
        values,
        [
            (0, 0.0, Some(-0.0)),
            (1, 1.0, Some(-1.0)),
            (2, 2.0, Some(-2.0))
        ]
    );
    let head = rows[2].head;
    assert_eq!(
        (head.age_steps, head.invalid[0], head.answer_invalid[0]),
        (7, 1, 2)
    );
    let without_busy = Directive {
        busy_ns: 0,
        ..directive
    };
    assert_eq!(head.directive, without_busy);
}

/// Plays a run; `answers` holds, for each step, the step of its command and the earlier answers.
fn outcomes(answers: &[(u64, Answered)], close: u64) -> Vec<(bool, Option<f64>, u32)> {
    let answers = answers.to_vec();
    let steps = answers.len() as u64;
    let run = run(steps, |step, words| {
        let (command, answered) = answers[step as usize];
        words[HELD] = step - command;
        words[ANSWERED] = answered.to_wire();
        words[COMMAND] = (-(command as f64)).to_bits();
    });
    let (rows, length) = played(&run, close, places(), Clock::Realtime);
    assert_eq!(length.expect("read"), whole(steps));
    let outcome = |row: Played| (row.head.directive.unseen, row.answer, row.head.held_steps);
    rows.into_iter().map(outcome).collect()
}

#[test]
fn in_real_time_an_answer_belongs_to_the_sample_that_it_answers() {
    // Sample 1 was answered late, after 3; 2 and 3 were never seen; then 4 was answered in time.
    let at_0 = Answered::default();
    let at_1 = at_0.then(1);
    let at_4 = at_1.then(3);
    let steps = [
        (0, at_0),
        (0, at_0),
        (0, at_0),
        (1, at_1),
        (4, at_4),
        (5, at_4.then(1)),
    ];
    assert_eq!(
        outcomes(&steps, 6),
        [
            (false, Some(-0.0), 0),
            (false, Some(-1.0), 0),
            (true, None, 1),
            (true, None, 2),
            (false, Some(-4.0), 2),
            (false, Some(-5.0), 0),
        ]
    );
}

#[test]
fn a_sample_with_a_superseded_answer_was_seen_and_is_not_compared() {
    // Samples 1 and 2 were answered before the plant polled at step 3, whose answer had arrived as well.
    let at_0 = Answered::default();
    let at_3 = at_0.then(1).then(1).then(1);
    let steps = [(0, at_0), (0, at_0), (0, at_0), (3, at_3)];
    let actual = outcomes(&steps, 4);
    assert_eq!(actual[1..3], [(false, None, 0), (false, None, 1)]);
    assert_eq!(actual[3], (false, Some(-3.0), 2));
}

#[test]
fn samples_without_an_answer_until_the_end_were_not_seen() {
    let at_0 = Answered::default();
    let actual = outcomes(&[(0, at_0), (0, at_0), (0, at_0)], 3);
    assert_eq!(actual[1..], [(true, None, 0), (true, None, 1)]);
}

#[test]
fn batches_keep_all_samples_in_order_when_the_controller_is_absent_for_longer_than_a_batch() {
    let steps = 5 * BATCH as u64 + 3;
    let away = 1000..3000;
    let run = run(steps, |step, words| {
        if away.contains(&step) {
            words[HELD] = step - (away.start - 1);
        } else {
            words[ANSWERED] = Answered::default().then(1).to_wire();
        }
    });
    let (rows, length) = played(&run, steps, places(), Clock::Realtime);
    assert_eq!(length.expect("read"), whole(steps));
    assert_eq!(rows.len() as u64, steps);
    for (step, row) in (0..).zip(&rows) {
        assert_eq!((row.head.step, row.sample), (step, step as f64));
        // The command of step 3000 reports one earlier answer, the one of step 2999.
        let is_unseen = (away.start..away.end - 1).contains(&step);
        assert_eq!(row.head.directive.unseen, is_unseen, "step {step}");
        assert_eq!(row.answer.is_some(), !away.contains(&step), "step {step}");
    }
}

#[test]
fn an_incomplete_recording_is_refused() {
    let refused = |run: &Path, places, clock| {
        let (_, length) = played(run, 10, places, clock);
        length.expect_err("refused").to_string()
    };
    let lockstep = Clock::Lockstep;
    let gap = run(4, |step, words| words[0] += u64::from(step > 1));
    let message = refused(&gap, places(), lockstep);
    assert!(
        message.contains("found record 3 in place of record 2"),
        "{message}"
    );
    let swapped = run(4, |step, words| words[EPOCH] = 1 + u64::from(step > 2));
    let message = refused(&swapped, places(), lockstep);
    assert!(
        message.contains("at step 3 another controller"),
        "{message}"
    );

    let old = Places {
        directive: None,
        answered: None,
        ..places()
    };
    let clocked = run(4, |_, _| ());
    let message = refused(&clocked, old.clone(), Clock::Realtime);
    assert!(
        message.contains("which samples its controller saw"),
        "{message}"
    );
    let skip = Event::Fault(FaultBegun {
        id: 1,
        effect: 0,
        step: 1,
        kind: "skip".into(),
        target: "controller".into(),
        parameter: String::new(),
        canonical: String::new(),
        wall_only: false,
    });
    let records = |step| Content::Record(record(step, 0.0, 0.0));
    let contents = [records(0), Content::Event(skip), records(1)];
    let late = recorded(&layout(), &contents, vec![]);
    let message = refused(&late, old, lockstep);
    assert!(
        message.contains("fault `skip`") && message.contains("step 1"),
        "{message}"
    );
}

#[test]
fn a_short_or_truncated_run_reports_its_length() {
    let stopped = Event::End(RunEnd::new(3, Outcome::Stopped));
    let mut contents: Vec<Content> = (0..3)
        .map(|step| Content::Record(record(step, 0.0, 0.0)))
        .collect();
    contents.push(Content::Event(stopped));
    let early = recorded(&layout(), &contents, vec![]);
    let (rows, length) = played(&early, 10, places(), Clock::Lockstep);
    assert_eq!((rows.len(), length.expect("read")), (3, whole(3)));

    let cut = run(20_000, |_, _| ());
    let path = cut.join(hil_recording::reader::RECORDING);
    let bytes = std::fs::read(&path).expect("read");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    let (rows, length) = played(&cut, 20_000, places(), Clock::Lockstep);
    let length = length.expect("read as far as it goes");
    assert!(!length.is_whole && length.steps == rows.len() as u64);
    assert!(length.steps > 0 && length.steps < 20_000, "{length:?}");
}
