//! Font of figures: Arimo, whose widths are those of Arial, reduced to the characters of Latin, Greek and formulas.
//!
//! `font/OFL.txt` has its licence, and `font/README.md` says how it was reduced. No other font is read.

use ttf_parser::{Face, GlyphId};

/// File of the font.
pub(super) const FILE: &[u8] = include_bytes!("font/Arimo-Subset.ttf");

/// Name of the font.
pub(super) const NAME: &str = "Arimo";

/// Metrics of the font.
pub(super) struct Font {
    face: Face<'static>,
}

impl Font {
    pub(super) fn new() -> Self {
        let face = Face::parse(FILE, 0).expect("the font of this program");
        Self { face }
    }

    /// Returns the number of a character's glyph; 0, an empty box, if the font lacks the character.
    pub(super) fn glyph(&self, character: char) -> u16 {
        self.face.glyph_index(character).map_or(0, |glyph| glyph.0)
    }

    /// Returns the advance of a glyph in thousandths of the font's size.
    pub(super) fn advance(&self, glyph: u16) -> f64 {
        let advance = self.face.glyph_hor_advance(GlyphId(glyph)).unwrap_or(0);
        f64::from(advance) * self.scale()
    }

    /// Returns the width of a text.
    pub(super) fn width(&self, text: &str, size: f64) -> f64 {
        let advances = text.chars().map(|one| self.advance(self.glyph(one)));
        advances.sum::<f64>() * size / 1000.0
    }

    /// Breaks a text into lines of at most this width, at spaces; a longer word behind a mark between its parts, else
    /// anywhere.
    pub(super) fn lines(&self, text: &str, size: f64, width: f64) -> Vec<String> {
        let fits = |text: &str| self.width(text, size) <= width;
        let mut lines: Vec<String> = Vec::new();
        for word in text.split(' ').filter(|word| !word.is_empty()) {
            let longer = lines.last().map(|line| format!("{line} {word}"));
            match (lines.last_mut(), longer.filter(|longer| fits(longer))) {
                (Some(line), Some(longer)) => *line = longer,
                _ if fits(word) => lines.push(word.to_owned()),
                _ => lines.extend(broken(word, &fits)),
            }
        }
        lines
    }

    /// Returns ascender, descender and height of capitals in thousandths of the font's size.
    pub(super) fn heights(&self) -> [f64; 3] {
        let capitals = self.face.capital_height().unwrap_or(0);
        [self.face.ascender(), self.face.descender(), capitals]
            .map(|height| f64::from(height) * self.scale())
    }

    /// Returns the box that contains all glyphs, in thousandths of the font's size.
    pub(super) fn bounds(&self) -> [f64; 4] {
        let all = self.face.global_bounding_box();
        [all.x_min, all.y_min, all.x_max, all.y_max].map(|edge| f64::from(edge) * self.scale())
    }

    fn scale(&self) -> f64 {
        1000.0 / f64::from(self.face.units_per_em())
    }
}

/// Breaks a word into parts that fit, of which each has a letter at least.
fn broken(word: &str, fits: &dyn Fn(&str) -> bool) -> Vec<String> {
    let mut parts = vec![String::new()];
    for piece in word.split_inclusive(['_', '.', '-', '/', '=', '*']) {
        let pieces: Vec<String> = match fits(piece) {
            true => vec![piece.to_owned()],
            false => piece.chars().map(String::from).collect(),
        };
        for piece in pieces {
            let last = parts.last_mut().expect("one at least");
            match last.is_empty() || fits(&format!("{last}{piece}")) {
                true => last.push_str(&piece),
                false => parts.push(piece),
            }
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_keep_every_letter_and_fit() {
        let font = Font::new();
        let text = "±150 N: healthy_force_fight, incomprehensibilities, recovers";
        for width in [30.0, 60.0, 120.0, 1000.0] {
            let lines = font.lines(text, 7.0, width);
            let letters = |text: &str| text.replace(' ', "");
            assert_eq!(letters(&lines.concat()), letters(text));
            for line in &lines {
                assert!(font.width(line, 7.0) <= width, "{line} in {width}");
            }
        }
        assert_eq!(font.lines(text, 7.0, 1000.0), [text]);
        let narrow = font.lines("healthy_force_fight", 7.0, 50.0);
        assert_eq!(narrow, ["healthy_force_", "fight"]);
    }
}
