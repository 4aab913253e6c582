//! Equations between dollars, as code-hosting sites draw them too.

use std::fmt::Write as _;

use pulldown_cmark::{Event, Options, Parser};
use pulldown_latex::config::{DisplayMode, RenderConfig};
use pulldown_latex::{Storage, push_mathml};

/// The text with MathML in place of its equations; code stays as it is.
///
/// # Errors
/// Returns the unreadable equation, and the reason.
pub(crate) fn as_mathml(text: &str) -> Result<String, String> {
    let options = Options::ENABLE_MATH | Options::ENABLE_TABLES;
    let mut out = String::with_capacity(text.len());
    let mut done = 0;
    for (event, range) in Parser::new_ext(text, options).into_offset_iter() {
        let (tex, display) = match &event {
            Event::InlineMath(tex) => (tex, false),
            Event::DisplayMath(tex) => (tex, true),
            _ => continue,
        };
        out += &text[done..range.start];
        done = range.end;
        out += &equation(tex, display)?;
    }
    Ok(out + &text[done..])
}

fn equation(tex: &str, display: bool) -> Result<String, String> {
    let (formula, number) = numbered(tex);
    let mode = if display {
        DisplayMode::Block
    } else {
        DisplayMode::Inline
    };
    let config = RenderConfig {
        display_mode: mode,
        ..RenderConfig::default()
    };
    let storage = Storage::new();
    let mut mathml = String::new();
    let parser = pulldown_latex::Parser::new(formula, &storage);
    // An error is drawn where it is, which nobody would see; so it is looked for first.
    for event in parser {
        event.map_err(|error| format!("`{tex}`: {error}"))?;
    }
    let parser = pulldown_latex::Parser::new(formula, &storage);
    push_mathml(&mut mathml, parser, config).map_err(|error| format!("`{tex}`: {error}"))?;
    let mathml = inert(&mathml);
    if !display {
        return Ok(mathml);
    }
    let mut block = format!("<span class=\"equation\">{mathml}");
    if let Some(number) = number {
        write!(block, "<span class=\"number\">({number})</span>").map_err(|e| e.to_string())?;
    }
    Ok(block + "</span>")
}

/// Returns a formula and the number that `\tag` gives it.
fn numbered(tex: &str) -> (&str, Option<&str>) {
    let Some((formula, tag)) = tex.split_once("\\tag{") else {
        return (tex, None);
    };
    (formula, tag.split('}').next())
}

/// Returns the text without characters that Markdown would interpret.
fn inert(mathml: &str) -> String {
    let mut text = String::with_capacity(mathml.len());
    let mut inside_tag = false;
    for letter in mathml.chars() {
        match letter {
            '<' => inside_tag = true,
            '>' => inside_tag = false,
            '\n' => continue,
            '|' | '*' | '_' | '[' | ']' | '`' | '\\' | '$' | '~' if !inside_tag => {
                text += &format!("&#{};", u32::from(letter));
                continue;
            }
            _ => {}
        }
        text.push(letter);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equations_become_mathml_and_code_stays() {
        let text = "Is $x_v$ `$HOME`?\n\n$$ |y| \\tag{7} $$\n\n```sh\necho $x $y\n```\n";
        let html = as_mathml(text).expect("equations");
        assert!(
            html.contains("`$HOME`") && html.contains("echo $x $y"),
            "{html}"
        );
        assert_eq!(html.matches("<math").count(), 2, "{html}");
        assert!(html.contains("<span class=\"number\">(7)</span>"), "{html}");
        assert!(html.contains("&#124;") && !html.contains('|'), "{html}");
    }

    #[test]
    fn an_equation_that_cannot_be_read_is_named() {
        let reason = as_mathml("$$ \\frac{1} $$").expect_err("half a fraction");
        assert!(reason.contains("frac"), "{reason}");
    }
}
