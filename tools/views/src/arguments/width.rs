//! Width of figures as documents state it, such as `85mm` or `3.5in`. Never a number without a unit.

/// Narrowest and widest figure in mm.
const RANGE_MM: [f64; 2] = [40.0, 1000.0];

/// Width of a figure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Width {
    millimetres: f64,
}

impl Width {
    /// Returns the width in mm.
    #[must_use]
    pub const fn millimetres(self) -> f64 {
        self.millimetres
    }

    /// Parses a number with its unit: mm, cm, in or pt.
    ///
    /// # Errors
    /// If it has no such form, or is too small or too large.
    pub fn parse(text: &str) -> Result<Self, String> {
        let units = [("mm", 1.0), ("cm", 10.0), ("in", 25.4), ("pt", 25.4 / 72.0)];
        let parsed = units.iter().find_map(|(unit, factor)| {
            let number = text.strip_suffix(unit)?.trim_end();
            Some(number.parse::<f64>().ok()? * factor)
        });
        let Some(millimetres) = parsed.filter(|one| one.is_finite()) else {
            return Err("expected a number with a unit, as in 85mm, 8.5cm, 3.35in or 241pt".into());
        };
        let [least, most] = RANGE_MM;
        if !(least..=most).contains(&millimetres) {
            return Err(format!("expected a width from {least} to {most} mm"));
        }
        Ok(Self { millimetres })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_width_has_the_unit_of_a_document() {
        for (text, millimetres) in [
            ("85mm", 85.0),
            ("8.5 cm", 85.0),
            ("2in", 50.8),
            ("720pt", 254.0),
        ] {
            let width = Width::parse(text).expect("a width");
            assert!((width.millimetres - millimetres).abs() < 1e-9, "{text}");
        }
        for text in ["85", "mm", "85 px", "nanmm", "1mm", "1e9mm", "-5cm"] {
            assert!(Width::parse(text).is_err(), "{text}");
        }
    }
}
