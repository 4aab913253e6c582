//! Draws the [model](super::model) with the user's display settings, on any terminal.
//!
//! Called for each frame by the [screen](super::screen). In a small terminal the clock, the verdicts and the keys
//! stay, while plots and lists shrink; no number is truncated.

mod lists;
mod plot;

use hil_console::terminal::duration::shown_ns;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Clear, Paragraph};

use super::display::{Abilities, Display};
use super::model::Model;

/// Minimum terminal width to place the lists beside the plots.
const WIDE: u16 = 110;
/// Width of the lists in that case.
const LISTS: u16 = 52;
/// Rows of a plot including its title.
const PLOT_ROWS: u16 = 5;

/// Draws the whole frame. `now_ns` is a time of the monotonic clock.
pub(crate) fn draw(frame: &mut Frame<'_>, model: &Model, display: &Display, now_ns: u64) {
    let area = frame.area();
    let head_rows = if area.height >= 9 { 3 } else { 1 };
    let foot = foot_lines(model, display, area.width, area.height);
    let [head, middle, below] = Layout::vertical([
        Constraint::Length(head_rows),
        Constraint::Min(0),
        Constraint::Length(foot.len() as u16),
    ])
    .areas(area);
    let lines = head_lines(model, display.abilities, head.width, now_ns);
    frame.render_widget(Paragraph::new(lines), head);
    if display.helps {
        help(frame, middle, display);
    } else {
        draw_middle(frame, middle, model, display);
    }
    frame.render_widget(Paragraph::new(foot), below);
}

fn draw_middle(frame: &mut Frame<'_>, area: Rect, model: &Model, display: &Display) {
    if area.width >= WIDE {
        let [plots, _, right] = Layout::horizontal([
            Constraint::Min(0),
            Constraint::Length(2),
            Constraint::Length(LISTS),
        ])
        .areas(area);
        draw_plots(frame, plots, model, display);
        lists::draw(frame, right, model, display);
        return;
    }
    let rows = area.height;
    let plot_rows = match rows {
        0..=2 => 0,
        3..=9 => rows - 2,
        _ => PLOT_ROWS + 1 + (rows - 10) / 3,
    };
    let list_rows = lists::rows(model).min(rows - plot_rows);
    let [plots, below] =
        Layout::vertical([Constraint::Min(0), Constraint::Length(list_rows)]).areas(area);
    draw_plots(frame, plots, model, display);
    lists::draw(frame, below, model, display);
}

fn draw_plots(frame: &mut Frame<'_>, area: Rect, model: &Model, display: &Display) {
    let plots = model.plots();
    if area.height < 2 {
        return;
    }
    if plots.is_empty() {
        let hint = match model.state() {
            "starting" => "waiting for the first step",
            _ => "no signal to draw",
        };
        frame.render_widget(Paragraph::new(hint), area);
        return;
    }
    let [area, axis] = Layout::vertical([Constraint::Min(0), Constraint::Length(1)]).areas(area);
    let places = (area.height / PLOT_ROWS).clamp(1, plots.len() as u16);
    let rects = Layout::vertical((0..places).map(|_| Constraint::Fill(1))).split(area);
    for (place, rect) in rects.iter().enumerate() {
        let number = (display.first_plot + place) % plots.len();
        plot::draw(frame, *rect, model, &plots[number], number, display);
    }
    plot::draw_axis(frame, axis, model, display, usize::from(places));
}

/// Returns as many leading parts as fit into a width, separated by two spaces.
fn fitting<'a>(width: u16, parts: Vec<Span<'a>>) -> Line<'a> {
    let mut line = Line::default();
    for part in parts.into_iter().filter(|part| !part.content.is_empty()) {
        let gap = if line.spans.is_empty() { 0 } else { 2 };
        if line.width() + gap + part.width() > usize::from(width) {
            continue;
        }
        if gap > 0 {
            line.push_span("  ");
        }
        line.push_span(part);
    }
    line
}

fn head_lines<'a>(
    model: &'a Model,
    abilities: Abilities,
    width: u16,
    now_ns: u64,
) -> Vec<Line<'a>> {
    let plan = model.plan();
    let state = Span::styled(
        model.state().to_uppercase(),
        emphasis(abilities, model.state()),
    );
    let clock = plan.run.clock.name();
    let law = format!("{} on {}, {clock}", model.law(), plan.plant.model);
    let session = format!("session {}", model.session);
    let name = bold(plan.name.clone());
    let total_s = model.seconds(plan.run.steps);
    let (now, step) = match model.step() {
        Some(step) => (
            format!("{} of {total_s} s", time(model.seconds(step), model)),
            format!("step {step} of {}", plan.run.steps),
        ),
        None => (format!("- of {total_s} s"), String::new()),
    };
    let share = model.step().unwrap_or(0) as f64 / plan.run.steps as f64;
    let speed = match model.speed(now_ns) {
        Some(speed) if model.state() == "running" && !model.is_owner_stopped => {
            format!("{speed:.*}x real time", usize::from(speed < 100.0))
        }
        _ if model.is_owner_stopped => "hil is stopped".into(),
        _ => "- x real time".into(),
    };
    let lost = match model.lost {
        0 => String::new(),
        lost => format!("{lost} not seen"),
    };
    let held = match model.pace().held {
        0 => String::new(),
        held => format!("{held} commands late"),
    };
    let joined = match model.joined_late() {
        Some(step) => format!("since {} s", time(model.seconds(step), model)),
        None => String::new(),
    };
    let mut figures = vec![bold(speed)];
    match model.pace().round_trips() {
        Some(trips) => {
            figures.push("round trip".into());
            figures.extend([
                bold(format!("p50 {}", shown_ns(trips.p50))),
                Span::from(format!("p99 {}", shown_ns(trips.p99))),
                Span::from(format!("p99.9 {}", shown_ns(trips.p999))),
                Span::from(format!("max {}", shown_ns(trips.max))),
            ]);
        }
        None => figures.push("no round trip yet".into()),
    }
    figures.push(held.into());
    let clock = fitting(
        width,
        vec![
            bold(now),
            step.into(),
            bar(share, 20).into(),
            lost.into(),
            joined.into(),
        ],
    );
    let title = fitting(width, vec![state, name, session.into(), law.into()]);
    vec![title, clock, fitting(width, figures)]
}

/// Formats a time with the digits that a step of the run needs.
fn time(time_s: f64, model: &Model) -> String {
    let digits = match model.rate().hz() {
        hz if hz > 1000.0 => 4,
        hz if hz > 10.0 => 3,
        _ => 1,
    };
    format!("{time_s:.digits$}")
}

fn bar(share: f64, width: usize) -> String {
    let full = ((share * width as f64) as usize).clamp(0, width);
    format!("[{}{}]", "#".repeat(full), "-".repeat(width - full))
}

fn bold<'a>(text: impl Into<std::borrow::Cow<'a, str>>) -> Span<'a> {
    Span::styled(text, Modifier::BOLD)
}

/// Returns the style of a word that states a verdict or a state.
fn emphasis(abilities: Abilities, word: &str) -> Style {
    let style = Style::new().add_modifier(Modifier::BOLD);
    let colour = match word {
        "running" | "pass" => Some(Color::Green),
        "fail" | "aborted" | "active" => Some(Color::Red),
        _ => None,
    };
    match colour {
        Some(colour) if abilities.colour => style.fg(colour),
        Some(_) => style,
        None if matches!(word, "paused" | "ended") => style.add_modifier(Modifier::REVERSED),
        None => style,
    }
}

/// Returns a message of as many lines as the height allows, and the keys if there is room for both.
fn foot_lines(model: &Model, display: &Display, width: u16, height: u16) -> Vec<Line<'static>> {
    let (text, style) = if let Some(question) = &display.question {
        let text = format!("{} y: yes, any other key: no", question.text);
        let width = usize::from(width);
        let short = format!("{} y/n", question.text);
        let text = if text.len() <= width {
            text
        } else if short.len() <= width {
            short
        } else {
            format!("y/n? {}", question.text)
        };
        (text, Modifier::REVERSED.into())
    } else if let Some(ending) = model.ending() {
        (super::line::ended(model, ending), Modifier::BOLD.into())
    } else if let Some(answer) = &display.answer {
        (answer.clone(), Style::new())
    } else {
        (model.note().unwrap_or_default().into(), Style::new())
    };
    let prepared = match display.prepared.len() {
        0 => String::new(),
        1 => "1 inject".into(),
        count => format!("1-{count} inject"),
    };
    let keys = if model.ending().is_some() {
        fitting(
            width,
            vec![
                "any key quits".into(),
                "tab plots".into(),
                "+- window".into(),
            ],
        )
    } else {
        fitting(
            width,
            vec![
                "q quit".into(),
                "? help".into(),
                "p pause".into(),
                "r resume".into(),
                "s step".into(),
                prepared.into(),
                "tab plots".into(),
                "+- window".into(),
                "S 100 steps".into(),
                "c clear faults".into(),
            ],
        )
    };
    let keys = keys.style(Modifier::DIM);
    if height < 6 && text.is_empty() {
        return vec![keys];
    }
    let most = usize::from((height / 4).max(1));
    let mut lines: Vec<Line<'_>> = wrapped(&text, usize::from(width))
        .into_iter()
        .take(most)
        .map(|line| Line::styled(line, style))
        .collect();
    if height >= 6 {
        lines.push(keys);
    }
    lines
}

/// Wraps a text to lines of at most `width` characters, except for longer words.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}

fn help(frame: &mut Frame<'_>, area: Rect, display: &Display) {
    let mut lines = vec![
        Line::from("q     quit; the run goes on"),
        Line::from("p  r  pause the run, resume it"),
        Line::from("s  S  one step, 100 steps, of a paused run"),
        Line::from("tab   next plots; shift-tab previous plots"),
        Line::from("+  -  shorter, longer window"),
        Line::from("c     end all faults, after y"),
    ];
    for (number, prepared) in (1..).zip(&display.prepared) {
        lines.push(Line::from(format!(
            "{number}     inject {}",
            prepared.words
        )));
    }
    if display.prepared.is_empty() {
        lines.push(Line::from("1-9   faults prepared with --inject, after y"));
    }
    lines.push(Line::from("any key closes this"));
    frame.render_widget(Clear, area);
    frame.render_widget(Paragraph::new(lines), area);
}

#[cfg(test)]
mod tests;
