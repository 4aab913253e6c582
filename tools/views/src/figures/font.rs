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

    /// Breaks a text into lines of at most this width, at spaces.
    pub(super) fn lines(&self, text: &str, size: f64, width: f64) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        for word in text.split(' ').filter(|word| !word.is_empty()) {
            if let Some(line) = lines.last_mut() {
                let longer = format!("{line} {word}");
                if self.width(&longer, size) <= width {
                    *line = longer;
                    continue;
                }
            }
            lines.push(word.to_owned());
        }
        lines
    }

    /// Returns a text that fits, with an ellipsis for its end if it is too long.
    pub(super) fn shortened(&self, text: &str, size: f64, width: f64) -> String {
        if self.width(text, size) <= width {
            return text.to_owned();
        }
        let mut short = text.to_owned();
        while short.pop().is_some() {
            let with_dots = format!("{}…", short.trim_end());
            if self.width(&with_dots, size) <= width {
                return with_dots;
            }
        }
        short
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
