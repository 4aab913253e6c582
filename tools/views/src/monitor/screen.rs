//! Main loop of the view: handles keys and redraws about ten times a second.

use std::time::{Duration, Instant};

use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_session::clock::monotonic_ns;
use ratatui::crossterm::event::{Event, KeyEventKind};

use super::asking::Asking;
use super::display::{Action, Display};
use super::keys::{Keys, input_is_gone};
use super::terminal::Screen;
use super::watch::Watch;
use super::{SharedModel, view};

/// Interval between two frames, if no key requires one earlier.
const PICTURE: Duration = Duration::from_millis(100);

/// Shows the session until the user quits.
///
/// # Errors
/// If the session cannot be watched, if the terminal cannot be used, or if a signal arrived.
pub(crate) fn show(
    model: &SharedModel,
    watch: &Watch,
    asking: &Asking,
    mut display: Display,
    interruption: &Interruption,
) -> Result<(), Failure> {
    let no_terminal = |error: std::io::Error| {
        if interruption.came() || input_is_gone() {
            Failure::Interrupted // as when the terminal was closed
        } else {
            Failure::infrastructure(format!("error: the terminal does not answer: {error}"))
        }
    };
    let mut screen = Screen::take().map_err(no_terminal)?;
    let keys = Keys::start();
    let mut last_frame: Option<Instant> = None;
    loop {
        interruption.check()?;
        watch.check()?;
        if watch.has_ended() && model.lock().ending().is_none() {
            return Err(Failure::infrastructure("error: the watching thread ended"));
        }
        if let Some(answer) = asking.answer() {
            display.answer = Some(answer);
            last_frame = None;
        }
        if last_frame.is_none_or(|last_frame| last_frame.elapsed() >= PICTURE) {
            // The frame is composed while the model is locked, and written to the terminal after that.
            let draw = |frame: &mut ratatui::Frame<'_>| {
                view::draw(frame, &model.lock(), &display, monotonic_ns());
            };
            screen.terminal().draw(draw).map_err(no_terminal)?;
            last_frame = Some(Instant::now());
        }
        let remaining = PICTURE
            .saturating_sub(last_frame.map_or(Duration::ZERO, |last_frame| last_frame.elapsed()));
        match keys.next(remaining).map_err(no_terminal)? {
            Some(Event::Key(key)) if key.kind != KeyEventKind::Release => {
                let (plots, ended) = {
                    let model = model.lock();
                    (model.plots().len(), model.ending().is_some())
                };
                match display.press(key, plots, ended) {
                    Action::Nothing => {}
                    Action::Quit => return Ok(()),
                    Action::Interrupt => return Err(Failure::Interrupted),
                    Action::Ask(request) => asking.ask(request),
                }
                last_frame = None;
            }
            Some(Event::Resize(..)) => last_frame = None,
            _ => {}
        }
    }
}
