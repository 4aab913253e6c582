use hil_facts::session::standing::Standing;
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::KeyCode;
use ratatui::style::Color;
use shared_types::live::{FaultState, Status};
use shared_types::record::FaultEffectSize;

use super::*;
use crate::monitor::model::tests::{attached, feed, layout, plan};
use crate::monitor::prepared::PreparedFault;

/// Returns a model with seven requirements, one of which failed, and two faults.
fn busy() -> Model {
    let plan = plan();
    let layout = layout(&plan);
    let mut model = attached(plan, &[]);
    for step in 60_000..70_000 {
        feed(&mut model, &layout, step, libm::sin(step as f64 / 2000.0));
    }
    model.hear_standings(Some(
        (0..7)
            .map(|number| Standing {
                name: format!("requirement_{number}"),
                verdict: ["pass", "undecided", "fail"]
                    [usize::from(number > 2) + usize::from(number == 5)]
                .into(),
                robustness: (number <= 2).then_some(2.5e-4),
                at_least: None,
                at_most: Some(1.25),
                unit: "rad".into(),
                decided_at_s: (number <= 2).then_some(7.0),
                vacuous: (number == 1).then(|| "a > 1".into()),
            })
            .collect(),
    ));
    let fault = |id, state: &str, step| FaultState {
        id,
        kind: "leakage".into(),
        source: "scenario".into(),
        state: state.into(),
        waits_for: Some("step 80000".into()),
        effects: vec![FaultEffectSize {
            id,
            effect: 0,
            kind: "leakage".into(),
            target: "actuator1".into(),
            parameter: "leak".into(),
            step,
            ended_step: None,
            acted_steps: 9,
            max_effect: 5e-7,
            unit: "m3/s".into(),
        }],
    };
    model.hear_faults(vec![
        fault(1, "waiting", None),
        fault(2, "active", Some(69_000)),
    ]);
    model
}

fn display(colour: bool) -> Display {
    let abilities = Abilities {
        unicode: true,
        colour,
    };
    let prepared = PreparedFault {
        words: "leakage --actuator 1,2 --coefficient 5e-7,1e-7 --speed 10,0.5".into(),
        toml: String::new(),
    };
    Display::new(abilities, 2.0, vec![prepared])
}

fn drawn(model: &Model, display: &Display, width: u16, height: u16) -> (String, Vec<Color>) {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).expect("a terminal");
    let now_ns = 1_000_000_000 + 70_000 * 3_000;
    terminal
        .draw(|frame| draw(frame, model, display, now_ns))
        .expect("draws");
    let buffer = terminal.backend().buffer().clone();
    let rows = buffer.content.chunks(usize::from(width));
    let lines: Vec<String> = rows
        .map(|row| {
            let text: String = row.iter().map(|cell| cell.symbol()).collect();
            text.trim_end().to_owned()
        })
        .collect();
    let colours = buffer.content.iter().map(|cell| cell.fg).collect();
    (lines.join("\n"), colours)
}

#[test]
fn nothing_essential_is_cut_at_any_size() {
    let model = busy();
    for (width, height) in [(80, 24), (40, 12), (200, 60), (110, 30), (60, 16)] {
        let (text, _) = drawn(&model, &display(true), width, height);
        for essential in [
            "RUNNING",
            "6.9999 of 20 s",
            "x real time",
            "p50 1.5",
            "1 FAIL",
            "1 vacuous",
            "2 pass",
            "1 active",
            "q quit",
            "Figure 3",
        ] {
            assert!(
                text.contains(essential),
                "{width}x{height}: {essential}:\n{text}"
            );
        }
    }
}

#[test]
fn a_usual_terminal_shows_every_unpassed_requirement_and_the_active_fault() {
    let (text, _) = drawn(&busy(), &display(true), 80, 24);
    for essential in [
        "severe-leakage",
        "session demo",
        "step 69999 of 200000",
        "p99.9",
        "FAIL  requirement_5  <= 1.25 rad",
        "open  requirement_3  <= 1.25 rad",
        "2 leakage  active  since 6.9000 s  actuator1 5e-7 m3/s",
        "1 inject",
        "window 2 s",
    ] {
        assert!(text.contains(essential), "{essential}:\n{text}");
    }
    let wide = drawn(&busy(), &display(true), 200, 60).0;
    for number in 0..7 {
        assert!(wide.contains(&format!("requirement_{number}")), "{wide}");
    }
    assert!(
        wide.contains("vacuous  requirement_1  2.5e-4 rad"),
        "{wide}"
    );
    assert!(
        wide.contains("1 leakage  waiting  for step 80000  actuator1"),
        "{wide}"
    );
    assert!(
        wide.contains("pass  requirement_0  2.5e-4 rad  at 7.0000 s"),
        "{wide}"
    );
}

#[test]
fn no_size_and_no_state_panics() {
    let mut models = vec![busy(), attached(plan(), &[])];
    let mut ended = busy();
    ended.end(Some("aborted".into()));
    models.push(ended);
    let mut display = display(true);
    for helps in [false, true] {
        display.helps = helps;
        for model in &models {
            for (width, height) in
                (1..30)
                    .map(|size| (size * 7, size))
                    .chain([(1, 1), (300, 2), (3, 80)])
            {
                for window_s in [1e-6, 0.01, 5.0, 86_400.0] {
                    display.window_s = window_s;
                    drawn(model, &display, width, height);
                }
            }
        }
    }
}

#[test]
fn without_unicode_and_colours_there_are_none() {
    let model = busy();
    let plain = Display::new(
        Abilities {
            unicode: false,
            colour: false,
        },
        2.0,
        Vec::new(),
    );
    let (text, colours) = drawn(&model, &plain, 80, 24);
    assert!(text.is_ascii(), "{text}");
    assert!(colours.iter().all(|colour| *colour == Color::Reset));
    assert!(text.contains('*'), "the plot is drawn:\n{text}");
    let (text, colours) = drawn(&model, &display(true), 80, 24);
    assert!(
        text.chars().any(|c| ('\u{2801}'..='\u{28ff}').contains(&c)),
        "{text}"
    );
    assert!(colours.contains(&Color::Red));
}

#[test]
fn a_one_step_spike_is_visible_when_zoomed_out() {
    let plan = plan();
    let layout = layout(&plan);
    let picture = |spike: f64| {
        let mut model = attached(plan.clone(), &["truth.surface_angle_rad"]);
        for step in 0..200_000 {
            let value = if step == 123_456 {
                spike
            } else {
                (step % 2) as f64
            };
            feed(&mut model, &layout, step, value);
        }
        let mut display = display(true);
        display.window_s = 20.0;
        drawn(&model, &display, 80, 24).0
    };
    let is_told = |line: &str| line.split_whitespace().next() == Some("50");
    assert!(picture(50.0).lines().any(is_told), "{}", picture(50.0));
    assert_ne!(picture(50.0), picture(-50.0));
}

#[test]
fn a_question_a_pause_and_the_end_are_shown() {
    let mut model = busy();
    let mut display = display(true);
    display.press(KeyCode::Char('1').into(), 5, false);
    for (width, height) in [(80, 24), (40, 12)] {
        let (text, _) = drawn(&model, &display, width, height);
        assert!(text.contains("inject leakage"), "{text}");
        assert!(text.contains("y"), "{text}");
    }
    display.press(KeyCode::Char('n').into(), 5, false);
    model.hear_status(Status {
        step: 70_001,
        time_s: 7.0001,
        steps: 200_000,
        paused: true,
    });
    let (text, _) = drawn(&model, &display, 80, 24);
    assert!(
        text.contains("PAUSED") && text.contains("7.0001 of 20 s"),
        "{text}"
    );
    model.run_dir = Some("november/evening/runs/severe-leakage-20261121T140715Z-demo".into());
    model.end(Some("pass".into()));
    for (width, height) in [(80, 24), (60, 12)] {
        let (text, _) = drawn(&model, &display, width, height);
        assert!(text.contains("severe-leakage ended: pass"), "{text}");
        assert!(text.contains("20261121T140715Z-demo"), "{text}");
        assert!(text.contains("any key quits"), "{text}");
    }
    let (text, _) = drawn(&model, &display, 40, 12);
    assert!(text.contains("severe-leakage ended: pass"), "{text}");
    assert!(text.contains("any key quits"), "{text}");
}

#[test]
fn a_constant_signal_is_a_line_with_its_value() {
    let plan = plan();
    let layout = layout(&plan);
    let mut model = attached(plan, &["truth.surface_angle_rad"]);
    let next = f64::from_bits(0.25_f64.to_bits() + 1);
    for step in 60_000..70_000 {
        feed(
            &mut model,
            &layout,
            step,
            if step % 2 == 0 { 0.25 } else { next },
        );
    }
    let (text, _) = drawn(&model, &display(true), 80, 24);
    let is_braille = |c: char| ('\u{2801}'..='\u{28ff}').contains(&c);
    let mut below = text
        .lines()
        .skip_while(|line| !line.contains("surface_angle_rad"))
        .skip(1);
    let drawn: Vec<&str> = below
        .by_ref()
        .take_while(|line| line.trim().is_empty() || line.contains(is_braille))
        .filter(|line| line.contains(is_braille))
        .collect();
    assert_eq!(drawn.len(), 1, "{text}");
    assert!(drawn[0].trim_start().starts_with("0.25 "), "{text}");
}
