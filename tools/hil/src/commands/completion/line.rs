//! Command line being completed: its words, and the run or scenario to which it refers.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use hil_config::plan::Plan;
use hil_config::scenario::{Advice, Scenario};
use hil_console::files::runs;
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::BinaryArguments;
use hil_facts::programs::binaries::Choices;
use hil_facts::programs::binaries::named::Named;
use hil_facts::session::observer::Notice;
use hil_facts::tables::FORMATS;
use hil_run::alone::built_in;
use hil_session::session::{self, SessionInfo};
use shared_types::describe::Description;

use super::shells;

/// Commands that address a running session.
const OF_A_SESSION: [&str; 7] = ["inject", "get", "set", "watch", "monitor", "panel", "swap"];

/// Run, scenario or session to which a line refers.
pub(super) struct Subject {
    pub(super) plan: Plan,
    pub(super) plant: Description,
    pub(super) controller: Description,
}

/// Words of a line, beginning with `hil`.
#[derive(Clone, Debug)]
pub(super) struct Line(Vec<String>);

impl Line {
    /// Extracts the words from a script's request: those after `--`, or for `bash` those of the line that it passes.
    pub(super) fn words_of(
        arguments: impl Iterator<Item = OsString>,
        is_bash: bool,
    ) -> Vec<OsString> {
        let mut words: Vec<OsString> = arguments.skip_while(|word| word != "--").skip(1).collect();
        match &mut words[..] {
            [name, line] if is_bash => {
                let [name, line] = [name, line].map(|word| word.to_string_lossy());
                let words = shells::words(&name, &line).unwrap_or_default();
                words.into_iter().map(Into::into).collect()
            }
            // The word being typed includes its opening quote.
            [.., typed] => {
                if let Some(word) = typed.to_str().and_then(shells::unquoted) {
                    *typed = word.into();
                }
                words
            }
            [] => words,
        }
    }

    /// Builds a request with these words.
    pub(super) fn asked(words: Vec<OsString>) -> impl Iterator<Item = OsString> {
        ["hil".into(), "--".into()].into_iter().chain(words)
    }

    pub(super) fn new(words: Vec<OsString>) -> Self {
        let words = words.into_iter();
        Self(
            words
                .map(|word| word.to_string_lossy().into_owned())
                .collect(),
        )
    }

    /// Returns `true` if the line runs a command, given with its subcommand if it has one.
    pub(super) fn is_of(&self, command: &str) -> bool {
        self.0.iter().skip(1).take(2).any(|word| word == command)
    }

    /// Returns the word being typed.
    pub(super) fn typed(&self) -> &str {
        self.0.last().map_or("", String::as_str)
    }

    /// Returns `true` if a word precedes the one being typed.
    pub(super) fn has(&self, word: &str) -> bool {
        let before = self.0.len().saturating_sub(1);
        self.0.iter().take(before).skip(2).any(|one| one == word)
    }

    /// Returns the word after another one.
    pub(super) fn after(&self, word: &str) -> Option<&str> {
        if let Some(value) =
            (self.0.iter()).find_map(|one| one.strip_prefix(word)?.strip_prefix('='))
        {
            return Some(value);
        }
        let place = self.0.iter().position(|one| one == word)?;
        self.0.get(place + 1).map(String::as_str)
    }

    /// Returns the addressed session: the named session, or the only session.
    pub(super) fn session(&self) -> Option<SessionInfo> {
        let mut running = session::peek();
        match self.after("--session") {
            Some(name) => running.into_iter().find(|session| session.name == name),
            None => (running.len() == 1).then(|| running.remove(0)),
        }
    }

    /// Returns the notice of the running session that the line addresses, if any.
    pub(super) fn notice(&self) -> Option<Notice> {
        self.session().and_then(|session| Notice::read(&session))
    }

    /// Returns the scenario, run or running session to which the line refers.
    pub(super) fn subject(&self) -> Option<Subject> {
        match self.scenario() {
            Some(scenario) => self.of_scenario(&scenario),
            None if !OF_A_SESSION.iter().any(|name| self.is_of(name)) => None,
            None => {
                let notice = self.notice()?;
                let plan = notice.plan().ok()?;
                Some(Subject {
                    plan,
                    plant: notice.plant,
                    controller: notice.controller,
                })
            }
        }
    }

    /// Returns the path of the named scenario, or of the named run.
    fn scenario(&self) -> Option<PathBuf> {
        self.0.iter().skip(2).find_map(|word| {
            let path = Path::new(word);
            if path.extension() == Some(OsStr::new("toml")) && path.is_file() {
                return Some(path.to_owned());
            }
            let run = runs::path(word.into()).ok()?;
            let folder = if run.is_file() { run.parent()? } else { &run };
            let scenario = folder.join(runs::SCENARIO);
            scenario.is_file().then_some(scenario)
        })
    }

    fn of_scenario(&self, path: &Path) -> Option<Subject> {
        let scenario = Scenario::read(path).ok()?.with_formats(FORMATS);
        let binaries = BinaryArguments {
            plant_bin: self.after("--plant-bin").map(Into::into),
            controller_bin: self.after("--controller-bin").map(Into::into),
        };
        let choices = Choices::of(&binaries, &Named::by(&scenario), None).ok()?;
        let [plant, controller] = if choices.names_one() {
            let programs = choices.find(&Interruption::default()).ok()?;
            [&programs.plant, &programs.controller].map(|binary| binary.description.clone())
        } else {
            built_in()
        };
        let scenario = scenario.advise(Advice::default());
        let plan = scenario.check(&plant.plants, &controller.laws, &plant.faults);
        Some(Subject {
            plan: plan.ok()?,
            plant,
            controller,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_found_by_the_option_before_them() {
        let request = [
            "hil",
            "--",
            "hil",
            "run",
            "a.toml",
            "--session",
            "demo",
            "--set=b",
            "",
        ];
        let words = Line::words_of(request.into_iter().map(Into::into), false);
        let line = Line::new(words);
        assert_eq!(line.after("--session"), Some("demo"));
        assert_eq!(line.after("--set"), Some("b"));
        assert_eq!(line.after("--plant-bin"), None);
        assert!(line.is_of("run") && !line.is_of("hil") && !line.is_of("demo"));
    }
}
