//! Adapters for shells that pass words differently: `bash` splits words at `=` and `:`, and `zsh` passes them with
//! their quotes.

use std::ffi::OsString;
use std::io::{Error, Write};
use std::path::Path;

use clap::Command;
use clap_complete::engine::complete;
use clap_complete::env::{self, EnvCompleter};

/// Variable with the characters at which `bash` splits words.
const BREAKS: &str = "HIL_COMPLETE_BREAKS";

/// Writer of the completions for the words of a line, in a folder.
type Writer = fn(&mut Command, Vec<OsString>, Option<&Path>, &mut dyn Write) -> Result<(), Error>;

/// Adapter for a shell.
pub(super) struct Adapter {
    name: &'static str,
    /// Script, with the placeholders `VARIABLE`, `BIN` for the command to complete, and `COMPLETER` for the program
    /// to call.
    script: &'static str,
    write: Writer,
}

/// Adapter for `bash`, which passes the name of the command and the line up to the cursor.
pub(super) const BASH: Adapter = Adapter {
    name: "bash",
    script: BASH_SCRIPT,
    write: write_for_bash,
};

/// Adapter for `zsh`.
pub(super) const ZSH: Adapter = Adapter {
    name: "zsh",
    script: ZSH_SCRIPT,
    write: |command, words, here, text| env::Zsh.write_complete(command, words, here, text),
};

const BASH_SCRIPT: &str = r#"_hil_complete() {
    mapfile -t COMPREPLY < <(VARIABLE=bash HIL_COMPLETE_BREAKS=$COMP_WORDBREAKS COMPLETER -- "$1" "${COMP_LINE:0:COMP_POINT}" 2>/dev/null)
    [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == *[=/] ]] && compopt -o nospace 2>/dev/null
    return 0
}
complete -o bashdefault -F _hil_complete BIN"#;

const ZSH_SCRIPT: &str = r#"#compdef BIN
_hil_complete() {
    local -a rows folders keys others
    local row value
    rows=("${(@f)$(VARIABLE=zsh _CLAP_IFS=$'\n' _CLAP_COMPLETE_INDEX=$((CURRENT - 1)) COMPLETER -- "${(@Q)words}" 2>/dev/null)}")
    for row in $rows; do
        value=${row%%:*}
        case $value in
            */) folders+=("${value%/}${row#$value}") ;;
            *=) keys+=("$row") ;;
            *) others+=("$row") ;;
        esac
    done
    if (( $#folders )); then _describe -V folder folders -S / -r /; fi
    if (( $#keys )); then _describe -V key keys -S ''; fi
    if (( $#others )); then _describe -V value others; fi
}
compdef _hil_complete BIN"#;

/// Returns the words of a line, beginning with the name of the command; the last word is being typed.
pub(super) fn words(name: &str, line: &str) -> Option<Vec<String>> {
    let (mut words, quote) = parted(line)?;
    if words.is_empty() || (quote.is_none() && line.ends_with(char::is_whitespace)) {
        words.push(String::new());
    }
    let begin = words.iter().position(|word| word == name)?;
    Some(words.split_off(begin))
}

/// Removes the quotes of the word being typed.
pub(super) fn unquoted(word: &str) -> Option<String> {
    let (words, _) = parted(word)?;
    <[String; 1]>::try_from(words).ok().map(|[word]| word)
}

/// Splits a line into words; also returns the quote that the last word leaves open.
fn parted(line: &str) -> Option<(Vec<String>, Option<char>)> {
    if let Some(words) = shlex::split(line) {
        return Some((words, None));
    }
    ['\'', '"'].into_iter().find_map(|quote| {
        let words = shlex::split(&format!("{line}{quote}"))?;
        Some((words, Some(quote)))
    })
}

/// Escapes a word for `bash`, with a backslash before each special character.
fn escaped(word: &str) -> String {
    let mut text = String::new();
    for letter in word.chars() {
        if letter.is_ascii_whitespace() || "\\'\"`$&|;<>()*?!#{}".contains(letter) {
            text.push('\\');
        }
        text.push(letter);
    }
    text
}

/// Writes the completions of a line in the form that `bash` inserts.
fn write_for_bash(
    command: &mut Command,
    words: Vec<OsString>,
    here: Option<&Path>,
    text: &mut dyn Write,
) -> Result<(), Error> {
    let index = words.len().saturating_sub(1);
    let typed = words.last().map(|word| word.to_string_lossy().into_owned());
    let typed = typed.unwrap_or_default();
    let line = std::env::args().next_back().unwrap_or_default();
    let quote = parted(&line).and_then(|(_, quote)| quote);
    let breaks = std::env::var(BREAKS).unwrap_or_default();
    // `bash` replaces only the text after a break character or the open quote.
    let is_break = |letter: char| matches!(letter, '=' | ':') && breaks.contains(letter);
    let prefix = match quote.and_then(|quote| line.rsplit(quote).next()) {
        Some(quoted) => typed.len().saturating_sub(quoted.len()),
        None => typed.rfind(is_break).map_or(0, |place| place + 1),
    };
    for candidate in complete(command, words, index, here)? {
        let value = candidate.get_value().to_string_lossy();
        match (value.get(prefix..), quote) {
            (Some(rest), None) => writeln!(text, "{}", escaped(rest))?,
            (Some(rest), Some(_)) => writeln!(text, "{rest}")?,
            (None, _) => {}
        }
    }
    Ok(())
}

impl EnvCompleter for Adapter {
    fn name(&self) -> &'static str {
        self.name
    }

    fn is(&self, name: &str) -> bool {
        name == self.name
    }

    fn write_registration(
        &self,
        variable: &str,
        _: &str,
        bin: &str,
        completer: &str,
        text: &mut dyn Write,
    ) -> Result<(), Error> {
        let completer = shlex::try_quote(completer).unwrap_or_default();
        let script = (self.script.replace("VARIABLE", variable))
            .replace("COMPLETER", &completer)
            .replace("BIN", bin);
        writeln!(text, "{script}")
    }

    fn write_complete(
        &self,
        command: &mut Command,
        words: Vec<OsString>,
        here: Option<&Path>,
        text: &mut dyn Write,
    ) -> Result<(), Error> {
        (self.write)(command, words, here, text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_of_a_line_begin_with_the_command_and_end_with_the_one_being_typed() {
        for (line, expected) in [
            ("hil run", Some(&["hil", "run"][..])),
            ("hil run ", Some(&["hil", "run", ""])),
            ("A=1 hil --set 'a b'=c", Some(&["hil", "--set", "a b=c"])),
            ("hil 'an open", Some(&["hil", "an open"])),
            ("hil \"an open ", Some(&["hil", "an open "])),
            ("hil an\\ open", Some(&["hil", "an open"])),
            ("other", None),
        ] {
            let parsed = words("hil", line);
            let parsed: Option<Vec<&str>> =
                (parsed.as_ref()).map(|words| words.iter().map(String::as_str).collect());
            assert_eq!(parsed.as_deref(), expected, "{line}");
        }
    }

    #[test]
    fn an_escaped_word_is_read_as_it_was() {
        for (word, text) in [
            ("runs/my own run", "runs/my\\ own\\ run"),
            ("controller.law=pid", "controller.law=pid"),
            ("faults[0].at_s=", "faults[0].at_s="),
            ("it's $5", "it\\'s\\ \\$5"),
        ] {
            assert_eq!(escaped(word), text);
            assert_eq!(unquoted(text).as_deref(), Some(word));
        }
    }
}
