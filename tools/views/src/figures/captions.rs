//! Captions of figures as LaTeX, one `figure` environment for each. Captions are plain text and never macros.

use std::fmt::Write;

/// Returns the file of captions of figures: name of the files, and caption.
pub(super) fn captions(figures: &[(String, String)]) -> String {
    let mut text = String::from(
        "% Figures of hil report --figures: copy an environment, or \\input this file.\n",
    );
    for (name, caption) in figures {
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n\\begin{{figure}}\n  \\centering\n  \\includegraphics{{{name}}}\n  \\caption{{{}}}\n  \\label{{fig:{name}}}\n\\end{{figure}}\n",
            escaped(caption)
        );
    }
    text
}

/// Returns a plain text as LaTeX that prints it.
fn escaped(text: &str) -> String {
    let mut result = String::new();
    for character in text.chars() {
        match character {
            '#' | '$' | '%' | '&' | '_' | '{' | '}' => {
                result.push('\\');
                result.push(character);
            }
            '\\' => result.push_str("\\textbackslash{}"),
            '~' => result.push_str("\\textasciitilde{}"),
            '^' => result.push_str("\\textasciicircum{}"),
            '<' => result.push_str("\\textless{}"),
            '>' => result.push_str("\\textgreater{}"),
            '|' => result.push_str("\\textbar{}"),
            // An empty line would end the paragraph, which no caption may.
            '\n' | '\r' => result.push(' '),
            other => result.push(other),
        }
    }
    result
}

/// Names of the Greek letters from alpha on; a small sigma has two forms.
const GREEK: [&str; 25] = [
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa",
    "lambda", "mu", "nu", "xi", "omicron", "pi", "rho", "sigma", "sigma", "tau", "upsilon", "phi",
    "chi", "psi", "omega",
];

/// Returns the name of a figure's files from its title: its letters and digits, with `-` between its words. Greek
/// letters are spelled out; a title of other letters alone gives their code points.
pub(super) fn name_of(title: &str) -> String {
    const LONGEST: usize = 60;
    let mut name = String::new();
    for character in title.chars() {
        match character {
            '_' => {
                name.truncate(name.trim_end_matches('-').len());
                name.push('_');
            }
            one if one.is_ascii_alphanumeric() => name.push(one.to_ascii_lowercase()),
            one => match greek(one) {
                Some(letter) => name.push_str(letter),
                None if name.is_empty() || name.ends_with('-') => {}
                None => name.push('-'),
            },
        }
        if name.len() >= LONGEST {
            break;
        }
    }
    match name.trim_matches(['-', '_']) {
        "" => {
            let codes = title.chars().filter(|one| one.is_alphanumeric());
            let codes: Vec<String> = codes
                .take(8)
                .map(|one| format!("u{:x}", u32::from(one)))
                .collect();
            if codes.is_empty() {
                "figure".into()
            } else {
                codes.join("-")
            }
        }
        name => name.into(),
    }
}

/// Returns the name of a Greek letter.
fn greek(letter: char) -> Option<&'static str> {
    let small = letter.to_lowercase().next()?;
    let place = u32::from(small).checked_sub(u32::from('α'))?;
    GREEK.get(usize::try_from(place).ok()?).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_caption_prints_its_own_text() {
        let figures = [("a".to_owned(), "50 % of V_3 \\ {x}".to_owned())];
        let text = captions(&figures);
        assert!(
            text.contains("\\caption{50 \\% of V\\_3 \\textbackslash{} \\{x\\}}"),
            "{text}"
        );
        assert!(text.contains("\\includegraphics{a}"));
        assert_eq!(
            escaped("|x| < 1\nand\n\ny > 2"),
            "\\textbar{}x\\textbar{} \\textless{} 1 and  y \\textgreater{} 2"
        );
    }

    #[test]
    fn a_title_gives_a_name_for_files() {
        for (title, name) in [
            ("Figure 6: control input u_1", "figure-6-control-input-u_1"),
            ("truth.pump*_pressure*_pa", "truth-pump_pressure_pa"),
            ("Kraft über Weg", "kraft-ber-weg"),
            ("../../etc", "etc"),
            ("Ω", "omega"),
            ("ΔP over θ_1", "deltap-over-theta_1"),
            ("力", "u529b"),
            ("速度", "u901f-u5ea6"),
            ("...", "figure"),
        ] {
            assert_eq!(name_of(title), name);
        }
    }
}
