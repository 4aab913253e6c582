//! Display state of the monitor, and the effects of keys on it.
//!
//! Fed with keys by the [screen](super::screen), read by the [view](super::view). Sends no requests: a key that
//! concerns the session is returned as an [`Action`].

use std::env;

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use shared_types::live::Request;

use super::prepared::PreparedFault;

/// Selectable widths of the time axis in s.
const WINDOWS_S: [f64; 17] = [
    0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 120.0, 300.0, 600.0, 1800.0,
    3600.0,
];
/// Number of steps executed by `S`.
const MANY_STEPS: u64 = 100;

/// Capabilities of a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Abilities {
    /// `true` if the terminal shows characters beyond ASCII.
    pub unicode: bool,
    /// `true` if colours are enabled.
    pub colour: bool,
}

impl Abilities {
    /// Reads the capabilities from the environment: the locale's character set, and `NO_COLOR`.
    pub(crate) fn of_environment() -> Self {
        Self::by(|name| env::var(name).ok())
    }

    fn by(variable: impl Fn(&str) -> Option<String>) -> Self {
        let set = |name: &str| variable(name).filter(|value| !value.is_empty());
        let locale = set("LC_ALL")
            .or_else(|| set("LC_CTYPE"))
            .or_else(|| set("LANG"));
        let locale = locale.unwrap_or_default().to_ascii_lowercase();
        Self {
            unicode: locale.contains("utf-8") || locale.contains("utf8"),
            colour: set("NO_COLOR").is_none(),
        }
    }
}

/// Request that awaits confirmation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Question {
    /// Text for the user.
    pub text: String,
    request: Request,
}

/// Effect of a key beyond the display.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Action {
    /// None.
    Nothing,
    /// Leave the monitor.
    Quit,
    /// Leave the monitor as if interrupted.
    Interrupt,
    /// Send a request to the session.
    Ask(Request),
}

/// Display state.
#[derive(Clone, Debug)]
pub(crate) struct Display {
    /// Capabilities of the terminal.
    pub abilities: Abilities,
    /// Width of the time axis in s.
    pub window_s: f64,
    /// Index of the first plot drawn.
    pub first_plot: usize,
    /// `true` while the help is open.
    pub helps: bool,
    /// Request that awaits confirmation.
    pub question: Option<Question>,
    /// Last answer of the session.
    pub answer: Option<String>,
    /// Faults that can be injected with a key.
    pub prepared: Vec<PreparedFault>,
}

impl Display {
    /// Creates the initial state.
    pub(crate) fn new(abilities: Abilities, window_s: f64, prepared: Vec<PreparedFault>) -> Self {
        Self {
            abilities,
            window_s,
            first_plot: 0,
            helps: false,
            question: None,
            answer: None,
            prepared,
        }
    }

    /// Handles a key. `plots` is the number of plots; `ended` is `true` once the session has ended.
    pub(crate) fn press(&mut self, key: KeyEvent, plots: usize, ended: bool) -> Action {
        let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
        if is_control && key.code == KeyCode::Char('c') {
            return Action::Interrupt;
        }
        if let Some(question) = self.question.take() {
            return match key.code {
                KeyCode::Char('y' | 'Y') | KeyCode::Enter => self.ask(question.request),
                _ => {
                    self.answer = Some("cancelled".into());
                    Action::Nothing
                }
            };
        }
        if self.helps {
            self.helps = false;
            return Action::Nothing;
        }
        match key.code {
            KeyCode::Char('q') | KeyCode::Esc => return Action::Quit,
            KeyCode::Char('?' | 'h') => self.helps = true,
            KeyCode::Tab | KeyCode::Right | KeyCode::Down | KeyCode::Char('n') if plots > 0 => {
                self.first_plot = (self.first_plot + 1) % plots;
            }
            KeyCode::BackTab | KeyCode::Left | KeyCode::Up | KeyCode::Char('N') if plots > 0 => {
                self.first_plot = (self.first_plot + plots - 1) % plots;
            }
            KeyCode::Char('+' | '=') => self.zoom(|next, now| next < now),
            KeyCode::Char('-') => self.zoom(|next, now| next > now),
            _ if ended => return Action::Quit,
            KeyCode::Char('p') => return self.ask(Request::Pause),
            KeyCode::Char('r') => return self.ask(Request::Resume),
            KeyCode::Char('s') => return self.ask(Request::Advance { steps: 1 }),
            KeyCode::Char('S') => {
                return self.ask(Request::Advance { steps: MANY_STEPS });
            }
            KeyCode::Char('c') => {
                self.question = Some(Question {
                    text: "end all faults?".into(),
                    request: Request::Clear { id: None },
                });
            }
            KeyCode::Char(digit @ '1'..='9') => self.prepare(digit),
            _ => {}
        }
        Action::Nothing
    }

    fn ask(&mut self, request: Request) -> Action {
        self.answer = Some("asked...".into());
        Action::Ask(request)
    }

    fn prepare(&mut self, digit: char) {
        let place = digit as usize - '1' as usize;
        match self.prepared.get(place) {
            Some(prepared) => {
                self.question = Some(Question {
                    text: format!("inject {}?", prepared.words),
                    request: Request::Inject {
                        toml: prepared.toml.clone(),
                    },
                });
            }
            None => {
                self.answer = Some(format!("no fault {digit} is prepared, see --inject"));
            }
        }
    }

    /// Selects the next width in a direction, if there is one.
    fn zoom(&mut self, is_next: impl Fn(f64, f64) -> bool) {
        let now = self.window_s;
        let next = WINDOWS_S.into_iter().filter(|next| is_next(*next, now));
        let nearest = next.min_by(|a, b| (a - now).abs().total_cmp(&(b - now).abs()));
        self.window_s = nearest.unwrap_or(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn display() -> Display {
        let abilities = Abilities {
            unicode: true,
            colour: true,
        };
        let prepared = PreparedFault {
            words: "bias x 1".into(),
            toml: "[[faults]]".into(),
        };
        Display::new(abilities, 5.0, vec![prepared])
    }

    fn press(display: &mut Display, code: KeyCode) -> Action {
        display.press(code.into(), 3, false)
    }

    #[test]
    fn a_prepared_fault_is_injected_only_after_confirmation() {
        let mut display = display();
        assert_eq!(press(&mut display, KeyCode::Char('1')), Action::Nothing);
        assert_eq!(
            display.question.as_ref().expect("asks").text,
            "inject bias x 1?"
        );
        assert_eq!(press(&mut display, KeyCode::Char('p')), Action::Nothing);
        assert_eq!(display.question, None);
        press(&mut display, KeyCode::Char('1'));
        let toml = "[[faults]]".to_owned();
        assert_eq!(
            press(&mut display, KeyCode::Char('y')),
            Action::Ask(Request::Inject { toml })
        );
        press(&mut display, KeyCode::Char('2'));
        assert_eq!(display.question, None);
        assert!(display.answer.expect("told").contains("no fault 2"));
    }

    #[test]
    fn clock_keys_send_their_request_without_confirmation() {
        let mut display = display();
        for (key, request) in [
            ('p', Request::Pause),
            ('r', Request::Resume),
            ('s', Request::Advance { steps: 1 }),
            ('S', Request::Advance { steps: 100 }),
        ] {
            assert_eq!(
                press(&mut display, KeyCode::Char(key)),
                Action::Ask(request)
            );
        }
    }

    #[test]
    fn plot_selection_wraps_around_and_the_window_stays_within_its_sizes() {
        let mut display = display();
        for expected in [1, 2, 0] {
            press(&mut display, KeyCode::Tab);
            assert_eq!(display.first_plot, expected);
        }
        press(&mut display, KeyCode::BackTab);
        assert_eq!(display.first_plot, 2);
        press(&mut display, KeyCode::Char('+'));
        assert_eq!(display.window_s, 2.0);
        for _ in 0..40 {
            press(&mut display, KeyCode::Char('-'));
        }
        assert_eq!(display.window_s, 3600.0);
        display.window_s = 3.3;
        press(&mut display, KeyCode::Char('+'));
        assert_eq!(display.window_s, 2.0);
    }

    #[test]
    fn after_the_end_any_key_but_those_for_viewing_quits() {
        let mut display = display();
        let mut after = |code: KeyCode| display.press(code.into(), 3, true);
        assert_eq!(after(KeyCode::Tab), Action::Nothing);
        assert_eq!(after(KeyCode::Char('-')), Action::Nothing);
        assert_eq!(after(KeyCode::Char('p')), Action::Quit);
        assert_eq!(after(KeyCode::Char(' ')), Action::Quit);
    }

    #[test]
    fn ctrl_c_interrupts_even_during_a_confirmation() {
        let mut display = display();
        press(&mut display, KeyCode::Char('c'));
        let control_c = KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL);
        assert_eq!(display.press(control_c, 3, false), Action::Interrupt);
    }

    #[test]
    fn abilities_follow_the_locale_and_no_color() {
        let by = |variables: &[(&str, &str)]| {
            let variables: Vec<(String, String)> = (variables.iter())
                .map(|(name, value)| ((*name).into(), (*value).into()))
                .collect();
            let abilities = Abilities::by(|name| {
                let mut matching = variables.iter().filter(|(candidate, _)| candidate == name);
                matching.next().map(|(_, value)| value.clone())
            });
            (abilities.unicode, abilities.colour)
        };
        assert_eq!(by(&[]), (false, true));
        assert_eq!(by(&[("LANG", "en_GB.UTF-8")]), (true, true));
        assert_eq!(
            by(&[("LC_ALL", "C"), ("LANG", "en_GB.UTF-8")]),
            (false, true)
        );
        assert_eq!(by(&[("LC_ALL", ""), ("LC_CTYPE", "C.utf8")]), (true, true));
        assert_eq!(by(&[("NO_COLOR", "1")]), (false, false));
        assert_eq!(by(&[("NO_COLOR", "")]), (false, true));
    }
}
