//! SVG of a scene, with texts as texts and the font inside the file.
//!
//! In a page the font stays outside: its widths are those of the usual sans-serif fonts. The text is the same for the
//! same scene, and loads nothing.

use std::fmt::Write;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::font::{FILE, NAME};
use super::scene::{Anchor, BLACK, Colour, Item, Line, POINTS_PER_MM, Scene, Text};

/// Formats a figure as a file of its own.
pub(super) fn file(scene: &Scene) -> String {
    let font = STANDARD.encode(FILE);
    let style = format!(
        "<style>@font-face{{font-family:{NAME};src:url(data:font/ttf;base64,{font})}}</style>\n"
    );
    let text = svg(scene, "figure", &style, hex);
    format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{text}")
}

/// Formats a figure as a part of a page, whose colour of texts it takes; `id` is unique in the page.
pub(super) fn part(scene: &Scene, id: &str) -> String {
    svg(scene, id, "", |colour| match colour {
        BLACK => "currentColor".into(),
        colour => hex(colour),
    })
}

fn hex([red, green, blue]: Colour) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn svg(scene: &Scene, id: &str, style: &str, colour: impl Fn(Colour) -> String) -> String {
    let [width, height] = scene.size;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}mm\" height=\"{}mm\" viewBox=\"0 0 {} {}\" role=\"img\" \
         aria-labelledby=\"{id}-title\" font-family=\"{NAME}, Arial, Helvetica, sans-serif\" fill=\"{}\">\n\
         <title id=\"{id}-title\">{}</title>\n{style}",
        number(width / POINTS_PER_MM),
        number(height / POINTS_PER_MM),
        number(width),
        number(height),
        colour(BLACK),
        escaped(&scene.title)
    );
    for (place, panel) in scene.panels.iter().enumerate() {
        let _ = writeln!(
            text,
            "<clipPath id=\"{id}-{place}\"><rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/></clipPath>",
            number(panel.left),
            number(panel.top),
            number(panel.right - panel.left),
            number(panel.bottom - panel.top)
        );
    }
    for item in &scene.items {
        match item {
            Item::Line(line) => write_line(&mut text, line, id, &colour),
            Item::Text(one) => write_text(&mut text, one),
        }
    }
    text + "</svg>\n"
}

// Writing to a string cannot fail.
fn write_line(text: &mut String, line: &Line, id: &str, colour: &impl Fn(Colour) -> String) {
    let stroke = line.stroke;
    let _ = write!(
        text,
        "<path fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-linejoin=\"round\"",
        colour(stroke.colour),
        number(stroke.width)
    );
    if !stroke.dash.is_empty() {
        let dash: Vec<String> = stroke.dash.iter().copied().map(number).collect();
        let _ = write!(text, " stroke-dasharray=\"{}\"", dash.join(" "));
    }
    if let Some(panel) = line.clip {
        let _ = write!(text, " clip-path=\"url(#{id}-{panel})\"");
    }
    text.push_str(" d=\"");
    for part in &line.parts {
        for (place, [x, y]) in part.iter().enumerate() {
            let command = if place == 0 { 'M' } else { 'L' };
            let _ = write!(text, "{command}{} {}", number(*x), number(*y));
        }
    }
    text.push_str("\"/>\n");
}

fn write_text(text: &mut String, one: &Text) {
    let [x, y] = one.at.map(number);
    let _ = write!(text, "<text font-size=\"{}\"", number(one.size));
    match one.anchor {
        Anchor::Start => {}
        Anchor::Middle => text.push_str(" text-anchor=\"middle\""),
        Anchor::End => text.push_str(" text-anchor=\"end\""),
    }
    let _ = match one.is_upright {
        true => write!(text, " transform=\"translate({x} {y}) rotate(-90)\""),
        false => write!(text, " x=\"{x}\" y=\"{y}\""),
    };
    let _ = writeln!(text, ">{}</text>", escaped(&one.text));
}

/// Formats a length in points with two decimals, which is finer than any printer.
fn number(value: f64) -> String {
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".into()
    } else {
        text.into()
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}
