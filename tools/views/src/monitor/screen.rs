//! The loop of the view: keys in, pictures out, some ten times a second.

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

/// Interval between two pictures, if no key asks for one.
const PICTURE: Duration = Duration::from_millis(100);

/// Shows the session until somebody leaves.
///
/// # Errors
/// If the session cannot be watched, the terminal be used, or a signal came.
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
    let mut drawn: Option<Instant> = None;
    loop {
        interruption.check()?;
        watch.check()?;
        if watch.has_ended() && model.lock().ending().is_none() {
            return Err(Failure::infrastructure("error: the watching thread ended"));
        }
        if let Some(answer) = asking.answer() {
            display.answer = Some(answer);
            drawn = None;
        }
        if drawn.is_none_or(|drawn| drawn.elapsed() >= PICTURE) {
            // The picture is made while the model is held still, and goes to the terminal after that.
            let draw = |frame: &mut ratatui::Frame<'_>| {
                view::draw(frame, &model.lock(), &display, monotonic_ns());
            };
            screen.terminal().draw(draw).map_err(no_terminal)?;
            drawn = Some(Instant::now());
        }
        let left = PICTURE.saturating_sub(drawn.map_or(Duration::ZERO, |drawn| drawn.elapsed()));
        match keys.next(left).map_err(no_terminal)? {
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
                drawn = None;
            }
            Some(Event::Resize(..)) => drawn = None,
            _ => {}
        }
    }
}
