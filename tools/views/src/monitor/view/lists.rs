//! Requirements and faults, one per line; if not all of them fit, the most important ones come first.

use hil_facts::results::requirements::VACUOUS;
use hil_facts::session::standing::Standing;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;
use shared_types::live::FaultState;
use shared_types::number::{short, short_in};

use super::{bold, emphasis, fitting, time};
use crate::monitor::display::{Abilities, Display};
use crate::monitor::model::{Judged, Model};

/// Returns the number of rows that both lists need in full.
pub(super) fn rows(model: &Model) -> u16 {
    let requirements = match model.judged() {
        Judged::Known(standings) => standings.len(),
        Judged::Unknown | Judged::Silent => 0,
    };
    u16::try_from(2 + requirements + model.faults().len()).unwrap_or(u16::MAX)
}

/// Draws both lists; the titles are always drawn.
pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, model: &Model, display: &Display) {
    let abilities = display.abilities;
    let requirements = requirement_lines(model, abilities, area.width);
    let faults = fault_lines(model, abilities, area.width);
    // A few faults take precedence over a long list of requirements, and both titles over everything.
    let rows = usize::from(area.height);
    let below = faults.len().min(4).min(rows.saturating_sub(1));
    let upper = requirements.len().min(rows - below) as u16;
    let [above, below] =
        Layout::vertical([Constraint::Length(upper), Constraint::Min(0)]).areas(area);
    frame.render_widget(Paragraph::new(cut(requirements, above.height)), above);
    frame.render_widget(Paragraph::new(cut(faults, below.height)), below);
}

/// Returns the title and as many lines as fit; the last line counts the hidden ones.
fn cut(mut lines: Vec<Line<'static>>, rows: u16) -> Vec<Line<'static>> {
    let rows = usize::from(rows);
    if lines.len() > rows && rows > 2 {
        let hidden = lines.len() - rows + 1;
        lines.truncate(rows - 1);
        lines.push(Line::from(format!("  ... {hidden} more")));
    }
    lines
}

fn requirement_lines(model: &Model, abilities: Abilities, width: u16) -> Vec<Line<'static>> {
    let standings = match model.judged() {
        Judged::Unknown => return vec![Line::from("requirements: not known yet")],
        Judged::Silent => return vec![Line::from("requirements: no answer from hil")],
        Judged::Known(standings) if standings.is_empty() => {
            return vec![Line::from("no requirements")];
        }
        Judged::Known(standings) => standings,
    };
    let count = |verdict: &str| {
        standings
            .iter()
            .filter(|one| one.outcome() == verdict)
            .count()
    };
    let part = |verdict: &'static str, word: &'static str| match count(verdict) {
        0 => Span::default(),
        count => Span::styled(format!("{count} {word}"), emphasis(abilities, verdict)),
    };
    let counts = vec![
        part("fail", "FAIL"),
        part("undecided", "open"),
        part(VACUOUS, VACUOUS),
        part("pass", "pass"),
    ];
    // Where not everything fits, the counts matter more than their heading.
    let mut with_heading = counts.clone();
    with_heading.insert(0, bold("requirements"));
    let needs = fitting(u16::MAX, with_heading.clone()).width();
    let heading = if needs > usize::from(width) {
        counts
    } else {
        with_heading
    };
    let mut lines = vec![fitting(width, heading)];
    let name_width = standings
        .iter()
        .map(|one| one.name.len())
        .max()
        .unwrap_or(0);
    // Failed requirements are never hidden.
    let order = |one: &&Standing| match one.outcome() {
        "fail" => 0,
        "undecided" => 1,
        VACUOUS => 2,
        _ => 3,
    };
    let mut sorted: Vec<&Standing> = standings.iter().collect();
    sorted.sort_by_key(order);
    lines.extend(sorted.into_iter().map(|one| {
        let word = match one.outcome() {
            "fail" => "FAIL",
            "undecided" => "open",
            word => word,
        };
        let remark = match (&one.vacuous, one.decided_at_s) {
            (Some(premise), _) => format!("`{premise}` never called for its conclusion"),
            (None, Some(at_s)) => format!("at {} s", time(at_s, model)),
            (None, None) => String::new(),
        };
        fitting(
            width,
            vec![
                Span::styled(word.to_owned(), emphasis(abilities, one.outcome())),
                Span::from(format!("{:<name_width$}", one.name)),
                Span::from(margin(one)),
                Span::from(remark),
            ],
        )
    }));
    lines
}

/// Formats a margin as far as known.
pub(in crate::monitor) fn margin(one: &Standing) -> String {
    let size = |value: f64| short_in(value, &one.unit);
    match (one.robustness, one.at_least, one.at_most) {
        (Some(robustness), ..) => size(robustness),
        (None, None, Some(most)) => format!("<= {}", size(most)),
        (None, Some(least), None) => format!(">= {}", size(least)),
        (None, Some(least), Some(most)) => {
            format!("{} to {}", short(least), size(most))
        }
        (None, None, None) => "no margin yet".into(),
    }
}

fn fault_lines(model: &Model, abilities: Abilities, width: u16) -> Vec<Line<'static>> {
    let faults = model.faults();
    if faults.is_empty() {
        return vec![Line::from("no faults")];
    }
    let count = |state: &str| faults.iter().filter(|one| one.state == state).count();
    let part = |state: &'static str| match count(state) {
        0 => Span::default(),
        count => Span::styled(format!("{count} {state}"), emphasis(abilities, state)),
    };
    let mut lines = vec![fitting(
        width,
        vec![
            bold("faults"),
            part("active"),
            part("waiting"),
            part("ended"),
        ],
    )];
    let mut sorted: Vec<&FaultState> = faults.iter().collect();
    sorted.sort_by_key(|one| match one.state.as_str() {
        "active" => 0,
        "waiting" => 1,
        _ => 2,
    });
    lines.extend(sorted.into_iter().map(|fault| {
        let state = fault.state.clone();
        let style = emphasis(abilities, &fault.state);
        let since = fault.effects.iter().filter_map(|effect| effect.step).min();
        let when = match (&fault.waits_for, since) {
            (Some(what), _) if fault.state == "waiting" => format!("for {what}"),
            (_, Some(step)) => format!("since {} s", time(model.seconds(step), model)),
            _ => String::new(),
        };
        let mut parts = vec![
            Span::from(format!("{} {}", fault.id, fault.kind)),
            Span::styled(state, style),
            Span::from(when),
        ];
        let sized = fault.effects.iter().map(|effect| {
            let (target, size) = (&effect.target, effect.max_effect);
            match effect.step {
                Some(_) => format!("{target} {}", short_in(size, &effect.unit)),
                None => target.clone(),
            }
        });
        let targets = fault.effects.iter().map(|effect| effect.target.as_str());
        let (sized, targets) = (
            sized.collect::<Vec<_>>().join("  "),
            targets.collect::<Vec<_>>().join(" "),
        );
        // Prefers showing every target over the sizes of some.
        let used: usize = parts.iter().map(|part| part.width() + 2).sum();
        let fits = used + sized.len() <= usize::from(width);
        parts.push(Span::from(if fits { sized } else { targets }));
        fitting(width, parts)
    }));
    lines
}
